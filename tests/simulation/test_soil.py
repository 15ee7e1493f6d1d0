"""Two buildings that rock on soil and pound, against a solver from event to event.

The reference has equations of its own: elongations by heights, sway, rocking and their dashpots.
"""

import numpy as np
import pytest

import jaxpound as jp
from jaxpound.model import Spring
from tests.simulation.contact import rods_without_memory as exact
from tests.simulation.test_weights import STEPS, errors_along, reference, relative_way

G = jp.GROUND
STEEL = jp.ZenerRod(1.0, 0.03, 0.12)
HEIGHTS = 1.3, 1.1


def block(mass, stiffness, height, footing, springs, dashpots):
    """One storey on a footing, with a dashpot beside the storey."""
    sway, rocking = springs
    rods = (jp.Rod(STEEL, stiffness), jp.Rod(Spring(), sway), jp.Rod(Spring(), rocking))
    of_storey, *of_soil = dashpots
    ends = [((0, 1.0), (1, -1.0), (2, -height)), (1, G), (2, G)]
    damping = [
        jp.Rod(jp.Dashpot(c), ends=x) for c, x in zip((of_storey, *of_soil), ends, strict=True)
    ]
    masses = (mass, *footing)
    return jp.Storeys(masses, rods, damping=tuple(damping), heights=(height,))


def pair(share):
    """Two blocks in contact at their floors, and the soil between the footings."""
    left = block(1.0, 5.0, HEIGHTS[0], (0.5, 0.3), (40.0, 30.0), (0.1, 2.0, 0.8))
    right = block(0.7, 14.0, HEIGHTS[1], (0.4, 0.25), (50.0, 25.0), (0.05, 1.5, 0.6))
    law = jp.KelvinVoigt(300.0, 0.6)
    links = [jp.FloorLink(0, 0, gap=0.02, contact=law)]
    if share:
        damper = jp.Rod(jp.Dashpot(share * 1.7), share * 45.0)
        links.append(jp.FloorLink(0, 1, damper=damper))
    return jp.Row((left, right), tuple(links))


def frame_of(row):
    """The reference's masses, springs, dashpots and face."""
    masses = tuple(float(x) for building in row.buildings for x in building.masses)
    influence = (1.0, 1.0, 0.0) * 2
    springs, dashpots = [], []
    for b, (building, height) in enumerate(zip(row.buildings, HEIGHTS, strict=True)):
        floor, footing, rotation = range(3 * b, 3 * b + 3)
        drift = ((floor, 1.0), (footing, -1.0), (rotation, -height))
        ends = drift, ((footing, 1.0),), ((rotation, 1.0),)
        steel = building.rods[0].material
        times = (float(steel.tau_f), float(steel.tau_x)), (1.0, 1.0), (1.0, 1.0)
        for rod, own, taus in zip(building.rods, ends, times, strict=True):
            springs.append(exact.Spring(float(rod.stiffness), *taus, own))
        weights = building.damping[0].weights  # which are numbers of the building, and may change
        own_dashpot = tuple(zip((floor, footing, rotation), map(float, weights), strict=True))
        for rod, own in zip(building.damping, (own_dashpot, *ends[1:]), strict=True):
            dashpots.append(exact.Dashpot(float(rod.material.coefficient), own))
    impact, *through = row.links
    for link in through:
        ends = exact.between(1, 4)
        springs.append(exact.Spring(float(link.damper.stiffness), 1.0, 1.0, ends))
        dashpots.append(exact.Dashpot(float(link.damper.material.coefficient), ends))
    ends = exact.between(0, 3)
    numbers = float(impact.contact.stiffness), float(impact.contact.restitution)
    law = exact.kelvin_voigt(*numbers, exact.effective_mass(ends, masses))
    faces = (exact.Face(0, 1, float(impact.gap), law),)
    sliders = (exact.Slider(0.0, ends),)
    return exact.Frame(masses, tuple(springs), sliders, faces, influence, tuple(dashpots))


SHARES = 0.0, 0.2


def errors_of(share, steps=STEPS):
    """Of displacements, and of their derivative along a way of all numbers, at each step."""
    row = pair(share)
    way = relative_way(row, 1)
    path, slope, kinds = reference(row, way, frame_of, apart=0.0)
    assert kinds.count("touch") > 2
    assert np.abs(path[:, 2]).max() > 0.02  # it rocks
    return errors_along(row, way, path, slope, steps)


@pytest.mark.parametrize("share", SHARES)
def test_buildings_that_rock_and_pound_are_of_second_order(share):
    """In displacements, and their derivative along a way of all numbers, the soil's included."""
    errors = np.array(errors_of(share))
    assert (errors[:, 0] > 10 * errors[:, -1]).all(), errors  # 16 would be of second order
    assert (errors[:, -1] < (1e-3, 1e-2)).all(), errors
