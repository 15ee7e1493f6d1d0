"""Eccentric floors that meet at two corners of a face, against a solver from event to event.

A floor has a displacement x and a rotation θ about the vertical axis through its centre of mass:
its point at y is displaced by x − y θ. Frames stand at two y, and links are at both corners.
"""

import dataclasses

import numpy as np
import pytest

import jaxpound as jp
from tests.simulation.pairs import SHAKING
from tests.simulation.test_weights import STEPS, at_instants, reference, relative_way

STEEL = jp.ZenerRod(1.0, 0.03, 0.12)
LAWS = {"kelvin": jp.KelvinVoigt(150.0, 0.6), "newton": jp.Newton(0.6)}
MASSES, STIFFNESSES, REACH, GAP = (1.0, 0.45, 0.8, 0.3), (5.0, 7.0), 0.8, 0.05


def frames(x, stiffness, eccentricity):
    """Two frames at y = ±``REACH``, whose centre of stiffness is at y = ``eccentricity``."""
    share = eccentricity / REACH
    return [
        jp.Rod(STEEL, stiffness * (1 + side * share) / 2, ((x, 1.0), (x + 1, -side * REACH)))
        for side in (1, -1)
    ]


def corner(y, friction, law):
    return jp.Link(((0, 1.0), (1, -y), (2, -1.0), (3, y)), friction, GAP, law)


def floors(eccentricities, law, frictions=(0.03, 0.01), masses=MASSES):
    """Two floors with x and rotation of each, which meet at y = 1 and y = −1."""
    rods = zip((0, 2), STIFFNESSES, eccentricities, strict=True)
    links = [corner(y, mu, law) for y, mu in zip((1.0, -1.0), frictions, strict=True)]
    rods = [rod for numbers in rods for rod in frames(*numbers)]
    return jp.System(masses, rods, links, influence=(1, 0, 1, 0))


CASES = [("kelvin", 0.3, -0.2), ("kelvin", 0.3, 0.0), ("newton", 0.3, -0.2), ("newton", 0.3, 0.0)]


def errors_of(law, *eccentricities, steps=STEPS):
    """Of displacements, and of their derivative along a way of all numbers, at each step.

    By Newton's law it is the median of the derivative's (see ``test_weights``).
    """
    system = floors(eccentricities, LAWS[law])
    way = relative_way(system, 1)
    path, slope, kinds = reference(system, way)
    assert kinds.count("touch") > 5
    assert kinds.count("turn") > 5
    size = (lambda z: np.median(np.abs(z))) if law == "newton" else np.linalg.norm
    errors = []
    for step in steps:
        x, along_way = at_instants(system, way, step)
        of_path = np.linalg.norm(x - path) / np.linalg.norm(path)
        errors.append((of_path, size(along_way - slope) / size(slope)))
    return np.array(errors).T.tolist()


@pytest.mark.parametrize("case", CASES, ids=str)
def test_two_corners_are_of_second_order(case):
    errors = np.array(errors_of(*case))
    assert (errors[:, 0] > 10 * errors[:, -1]).all(), errors  # 16 would be of second order
    assert (errors[:, -1] < (5e-4, 3e-3)).all(), errors


def displacements(system, step):
    return at_instants(system, relative_way(system, 1), step)[0]


@pytest.mark.parametrize("inertias", [(0.45, 0.3), (1.0, 0.8)], ids=["narrow", "at corners"])
def test_symmetric_floors_do_not_rotate_and_are_a_pair(inertias):
    """Of one link, with the stiffness and the dashpot of both.

    Both corners have all events at the same instants, up to rounding; with inertias m y² a blow at
    a corner does not move the other.
    """
    law, (m, m2) = LAWS["kelvin"], MASSES[::2]
    masses = m, inertias[0], m2, inertias[1]
    system = floors((0.0, 0.0), law, (0.02, 0.02), masses)
    of_corner, of_pair = (1 / sum(1 / x for x in y) for y in (masses, (m, m2)))
    damping_ratio = float(law.damping_ratio) * np.sqrt(2 * of_corner / of_pair)
    restitution = np.exp(-np.pi * damping_ratio / np.sqrt(1 - damping_ratio**2))
    link = jp.Link((0, 1), 0.04, GAP, jp.KelvinVoigt(2 * law.stiffness, restitution))
    rods = [jp.Rod(STEEL, k, (i, jp.GROUND)) for i, k in enumerate(STIFFNESSES)]
    pair, differences = jp.System((m, m2), rods, (link,)), []
    for step in STEPS[:2]:
        x, of_two = displacements(system, step), displacements(pair, step)
        assert np.abs(x[:, 1::2]).max() < 1e-14
        differences.append(np.abs(x[:, ::2] - of_two).max())
    assert differences[1] < 1e-5
    assert differences[0] > 3 * differences[1]  # a flow of two joints has steps of its own


@pytest.mark.parametrize("friction", [0.0, 0.02])
def test_corners_whose_forces_peak_at_one_instant_end_their_step(friction):
    """At which of many stiffnesses rounding orders the peaks anew is a matter of chance."""
    for stiffness in np.linspace(100.0, 200.0, 11).tolist():
        law = jp.KelvinVoigt(stiffness, 0.6)
        system = floors((0.0, 0.0), law, (friction, friction), (1.0, 1.0, 0.8, 0.8))
        assert np.isfinite(displacements(system, STEPS[0])).all(), stiffness


@pytest.mark.parametrize("law", LAWS)
def test_a_mirror_image_swaps_corners(law):
    """And eccentricities and rotations change their signs."""
    here = displacements(floors((0.3, -0.2), LAWS[law], (0.03, 0.01)), STEPS[0])
    there = displacements(floors((-0.3, 0.2), LAWS[law], (0.01, 0.03)), STEPS[0])
    np.testing.assert_allclose(there, here * [1, -1, 1, -1], rtol=0, atol=1e-9)
    assert np.abs(here[:, 1::2]).max(0).min() > 0.1


def test_a_blow_at_a_corner_is_that_of_rigid_floors():
    """By Newton's law: with the effective mass of the corner, impulse and moment of it."""
    system = floors((0.3, -0.2), LAWS["newton"], (0.0, 0.0))
    soft = [dataclasses.replace(rod, stiffness=1e-6) for rod in system.rods]
    system = dataclasses.replace(system, rods=soft)
    start = jp.InitialState((0.0, 0.04, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    grid = jp.TimeGrid(0.005, 6)  # ends before the other corner closes
    response = jp.simulate(system, SHAKING, grid, initial=start)
    (impact,) = response.impacts()
    weights = np.array([1.0, 1.0, -1.0, -1.0])  # of the closing at y = −1
    effective = 1 / (weights**2 / MASSES).sum()
    assert impact.link == 1
    assert impact.time == pytest.approx(GAP - 0.04, rel=1e-6)
    assert impact.impulse == pytest.approx(1.6 * effective, rel=1e-6)
    assert impact.rebound_velocity == pytest.approx(0.6, rel=1e-6)
    after = [1.0, 0.0, 0.0, 0.0] - 1.6 * effective * weights / MASSES
    np.testing.assert_allclose([mass.v[-1] for mass in response.masses], after, atol=1e-6)
