"""Tuned masses and tuned inerters, in closed form."""

import numpy as np
import pytest

import jaxpound as jp
from tests.model.test_isolation import frequencies, matrices
from tests.refusals import refusals

FRAME = jp.ShearBuilding.from_period(3, 300e3, period=0.5, damping_ratio=0.03)


@pytest.mark.parametrize("ratio", [0.02, 0.1])
def test_a_tuned_mass_on_an_undamped_block_leaves_den_hartog_s_equal_peaks(ratio):
    block = jp.Building(300e3, 4e7, 1.0, 1e-9, 1e-9)
    tuned = jp.tuned_mass_damper(block, ratio)
    top, own = tuned.storeys[1], np.sqrt(block.stiffness / block.mass)
    assert top.mass == pytest.approx(ratio * block.mass, rel=1e-9)
    frequency = np.sqrt(top.dynamic_stiffness / top.mass)
    assert frequency == pytest.approx(own / (1 + ratio), rel=1e-9)
    # Den Hartog's ratio is over 2 m Ω, Ω being the block's frequency and not that of the mass.
    of_block = top.damping_ratio * frequency / own
    assert of_block == pytest.approx(np.sqrt(3 * ratio / (8 * (1 + ratio) ** 3)), rel=1e-6)
    omega = own * np.linspace(0.7, 1.2, 20_001)
    masses, stiffness = matrices(tuned)
    moduli = np.asarray(top.zener().complex_modulus(omega))[:, None, None]
    way = np.array([[1.0, -1.0], [-1.0, 1.0]]) * float(top.stiffness)
    dynamic = stiffness - way + way * moduli - masses * omega[:, None, None] ** 2
    load = np.broadcast_to(np.array([[1.0], [0.0]]), (omega.size, 2, 1))
    amplitude = np.abs(np.linalg.solve(dynamic, load)[:, 0, 0]) * block.stiffness
    inner = amplitude[1:-1]
    peaks = inner[(inner > amplitude[:-2]) & (inner > amplitude[2:])]
    # He makes the mean of two optima, whose peaks are equal but for 4e-4 at a tenth.
    np.testing.assert_allclose(peaks, np.sqrt(1 + 2 / ratio), rtol=5e-3)
    assert peaks[0] == pytest.approx(peaks[1], rel=4e-3)


def test_a_tuned_mass_is_a_share_of_the_modal_mass_at_the_roof():
    tuned = jp.tuned_mass_damper(FRAME, 0.05, frequency_ratio=0.9, damping_ratio=0.2)
    assert tuned.storeys[:3] == FRAME.storeys
    assert tuned.heights == (3.0, 3.0, 3.0, 1.5)
    shape = np.sin((np.arange(3) + 1) * np.pi / 7)  # of equal floors on equal storeys
    modal_mass = 300e3 * np.sum((shape / shape[-1]) ** 2)
    top = tuned.storeys[3]
    assert top.mass == pytest.approx(0.05 * modal_mass, rel=1e-6)
    assert top.natural_period == pytest.approx(0.5 / 0.9, rel=1e-6)
    assert top.damping_ratio == pytest.approx(0.2, rel=1e-6)
    # With hardly any damping the modes are those of the springs.
    block = jp.Building(300e3, 4e7, 1.0, 1e-9, 1e-9)
    light = jp.tuned_mass_damper(block, 0.1, damping_ratio=1e-6)
    np.testing.assert_allclose(light.modes().frequencies, frequencies(light), rtol=1e-6)


@pytest.mark.parametrize(("ratio", "light"), [(0.05, 1e-6), (0.2, 1e-6), (0.05, 0.04)])
def test_a_tuned_inerter_of_a_block_leaves_the_equal_peaks_of_a_tuned_mass(ratio, light):
    """Under a load on the block a mass and an inertance to the ground are one mass."""
    block = jp.Building(300e3, 4e7, 1.0, 1e-9, 1e-9)
    tuned, (link,) = jp.tuned_inerter_damper(block, ratio, mass_ratio=light)
    top, own, total = tuned.storeys[1], np.sqrt(block.stiffness / block.mass), ratio + light
    assert link.inerter.inertance == pytest.approx(ratio * block.mass, rel=1e-9)
    omega = own * np.linspace(0.7, 1.2, 20_001)[:, None, None]
    masses, stiffness = matrices(tuned)
    assert masses[1, 1] == pytest.approx(light * block.mass, rel=1e-9)
    masses[1, 1] += link.inerter.inertance
    way = np.array([[1.0, -1.0], [-1.0, 1.0]]) * float(top.stiffness)
    moduli = np.asarray(top.zener().complex_modulus(omega))
    dynamic = stiffness - way + way * moduli - masses * omega**2
    load = np.broadcast_to(np.array([[1.0], [0.0]]), (omega.size, 2, 1))
    amplitude = np.abs(np.linalg.solve(dynamic, load)[:, 0, 0]) * block.stiffness
    inner = amplitude[1:-1]
    peaks = inner[(inner > amplitude[:-2]) & (inner > amplitude[2:])]
    np.testing.assert_allclose(peaks, np.sqrt(1 + 2 / total), rtol=5e-3)
    buildings = jp.Buildings((tuned,), (link,))
    poles = np.sort(np.abs(jp.modes(buildings).eigenvalues))
    free = np.sort(np.abs(jp.modes(buildings).frequencies))
    np.testing.assert_allclose(poles, free, rtol=0.05)


@pytest.mark.parametrize(("floor", "near"), [(jp.GROUND, 0.01), (0, 0.06), (1, 0.16)])
def test_a_tuned_inerter_has_the_share_of_the_modal_mass_that_its_floors_move(floor, near):
    """The first mode splits as by a tuned mass, less so where its spring bridges few storeys."""
    tuned, (link,) = jp.tuned_inerter_damper(FRAME, 0.05, floor=floor, number=1)
    shape = np.sin(np.arange(4) * np.pi / 7)  # of the ground and equal floors on equal storeys
    shape /= shape[-1]
    inertance = 0.05 * 300e3 * np.sum(shape**2) / (1 - shape[floor + 1]) ** 2
    assert link.inerter.inertance == pytest.approx(inertance, rel=1e-6)
    assert tuned.storeys[:3] == FRAME.storeys
    assert tuned.storeys[3].mass == pytest.approx(5e-4 * 300e3 * np.sum(shape**2), rel=1e-6)
    ends = {jp.GROUND: "2–ground, floor 4", 0: "in 2, floors 1–4", 1: "in 2, floors 2–4"}
    assert str(link) == ends[floor]
    first = jp.tuned_inerter_damper(FRAME, 0.05, floor=floor)
    periods = jp.modes(jp.Buildings((first[0],), first[1])).periods[:2]
    by_mass = jp.tuned_mass_damper(FRAME, 0.05).modes().periods[:2]
    np.testing.assert_allclose(periods, by_mass, rtol=near)


TUNED, INERTER = jp.tuned_mass_damper, jp.tuned_inerter_damper
NOT_POSITIVE = "must be positive and finite"

test_bad_tuned_masses_are_refused = refusals(
    (
        TUNED,
        3.0,
        0.05,
        r"^tuned_mass_damper: building = 3.0 must be of type ShearBuilding or Build",
    ),
    (TUNED, FRAME, 0.0, f"^tuned_mass_damper: mass_ratio = 0 {NOT_POSITIVE}"),
    (
        lambda: TUNED(FRAME, 0.1, frequency_ratio=0),
        f"^tuned_mass_.*frequency_ratio = 0 {NOT_POSITIVE}",
    ),
    (
        lambda: TUNED(FRAME, 0.1, damping_ratio=0),
        f"^tuned_mass_.*: damping_ratio = 0 {NOT_POSITIVE}",
    ),
    (
        lambda: TUNED(FRAME, 0.1, damping_ratio=2.0),
        "^tuned_mass_damper: damping_ratio = 2 must be between 0 and 1",
    ),
    (
        lambda: TUNED(FRAME, 0.1, frequency_ratio=1e3),
        "^tuned_mass_damper: frequency_ratio: period = 0.0005 must be between 0.002 and 60 s",
    ),
    (
        lambda: TUNED(FRAME, 1e9, frequency_ratio=1),
        "^tuned_mass_damper: mass_ratio: mass = .* must be between 0.001 and 1e.10",
    ),
    (INERTER, FRAME, 0.0, f"^tuned_inerter_damper: inertance_ratio = 0 {NOT_POSITIVE}"),
    (INERTER, 3.0, 0.1, "^tuned_inerter_damper: building = 3.0 must be of type ShearBuilding"),
    (lambda: INERTER(FRAME, 0.1, floor=2), "floor = 2 must be a floor below the roof, from 0 to 1"),
    (lambda: INERTER(FRAME.storeys[0], 0.1, floor=0), "^tuned_.*floor = 0 must be GROUND"),
    (lambda: INERTER(FRAME, 0.1, mass_ratio=-1), f"mass_ratio = -1 {NOT_POSITIVE}"),
    (
        lambda: INERTER(FRAME, 0.1, number=-1),
        "^tuned_inerter_damper: number = -1 must be a whole number from 0",
    ),
    (jp.Inerter, -1.0, "^Inerter: inertance = -1 must be finite and not negative"),
)
