"""Bearings and moat walls, in closed form."""

import dataclasses

import numpy as np
import pytest
from scipy.linalg import eigh

import jaxpound as jp
from jaxpound import FrictionPendulum, LeadRubber, MoatWall
from tests.refusals import refusals

G, BASE = jp.STANDARD_GRAVITY, 350e3
FRAME = jp.ShearBuilding.from_period(3, 300e3, period=0.5, damping_ratio=0.03)
MASS = BASE + 3 * 300e3
SLIDING, RUBBER = FrictionPendulum(2.24, 0.06), LeadRubber(2.5, 0.05, 0.012)
LAW, SOFT = jp.KelvinVoigt(2e9, 0.7), jp.Jankowski(3e9, 0.5)


def equivalent_damping(energy, force, displacement):
    """Of a cycle's energy and the largest force and displacement."""
    return float(energy / (2 * np.pi * force * displacement))


def loop_area(force, displacement):
    return np.sum((force[1:] + force[:-1]) / 2 * np.diff(displacement))


def matrices(building):
    """Masses and stiffnesses of a building whose rods are springs."""
    n = len(building.storeys)
    way = np.eye(n) - np.eye(n, k=-1)
    stiffness = np.diag([float(storey.stiffness) for storey in building.storeys])
    return np.diag([float(storey.mass) for storey in building.storeys]), way.T @ stiffness @ way


def frequencies(building):
    mass, stiffness = matrices(building)
    return np.sqrt(eigh(stiffness, mass, eigvals_only=True))


def test_a_friction_pendulum_has_the_period_of_a_pendulum_and_the_damping_of_its_loop():
    assert SLIDING.period == pytest.approx(2 * np.pi * np.sqrt(2.24 / 9.80665), rel=1e-12)
    weight, phase = 5e6, np.linspace(0, 2 * np.pi, 20_001)
    spring, friction = SLIDING.storey(BASE, weight).stiffness, SLIDING.between(weight)["friction"]
    sizes = np.array([0.02, 0.2])
    for size, ratio in zip(sizes, SLIDING.damping_ratio(sizes), strict=True):
        x, v = size * np.sin(phase), np.cos(phase)
        force = spring * x + friction * np.sign(v)
        known = equivalent_damping(loop_area(force, x), spring * size + friction, size)
        assert ratio == pytest.approx(known, rel=1e-3)


def test_a_lead_rubber_bearing_has_the_damping_and_the_stiffness_of_its_loop():
    storey = RUBBER.storey(BASE, MASS * G)
    law, stiffness = storey.hysteresis, storey.stiffness
    for size in (0.05, 0.2):
        turns = size * np.array([0.0, 1.0, -1.0, 1.0])
        test = jp.study.cyclic_test(law, turns, stiffness, 500)
        force, x, dissipated = (part[500:] for part in (test.force, test.displacement, test[2]))
        ratio = RUBBER.damping_ratio(size)
        area, energy = loop_area(force, x), dissipated[-1] - dissipated[0]
        assert ratio == pytest.approx(equivalent_damping(area, force[-1], size), rel=1e-3)
        assert ratio == pytest.approx(equivalent_damping(energy, force[-1], size), rel=1e-10)
        after_yield = (force[-1] - force[-2]) / (x[-1] - x[-2])
        assert after_yield == pytest.approx(MASS * (2 * np.pi / 2.5) ** 2, rel=1e-8)
        assert force[-1] - after_yield * size == pytest.approx(0.05 * MASS * G, rel=1e-8)
    assert RUBBER.damping_ratio(0.012) == RUBBER.damping_ratio(0.005) == 0
    limited = LeadRubber(2.5, 0.05, 0.012, ultimate_displacement=0.4).storey(BASE, MASS * G)
    assert (law.yield_displacement, law.ultimate_displacement) == (0.012, np.inf)
    assert limited.hysteresis.ultimate_displacement == 0.4


@pytest.mark.parametrize("gravity", [G, 1.62])
def test_an_isolated_building_has_its_base_as_floor_0_and_bearings_under_its_whole_weight(gravity):
    sliding, (link,) = jp.on_bearings(FRAME, SLIDING, BASE, gravity=gravity)
    rubber, none = jp.on_bearings(FRAME, RUBBER, BASE, gravity=gravity, height=0.8)
    assert none == ()
    for building, height in ((sliding, 0.5), (rubber, 0.8)):
        assert (building.n_floors, building.heights) == (4, (height, 3.0, 3.0, 3.0))
        assert (building.storeys[0].mass, building.storeys[1:]) == (BASE, FRAME.storeys)
        assert building.storeys[0].tau_f == building.storeys[0].tau_x
    bearing = rubber.storeys[0]
    after_yield = bearing.stiffness * bearing.hysteresis.hardening
    assert after_yield == pytest.approx(MASS * (2 * np.pi / 2.5) ** 2, rel=1e-12)
    strength = (bearing.stiffness - after_yield) * 0.012
    assert strength == pytest.approx(0.05 * MASS * gravity, rel=1e-12)
    assert sliding.storeys[0].hysteresis is None
    assert sliding.storeys[0].stiffness == pytest.approx(MASS * gravity / 2.24, rel=1e-12)
    assert link.friction == pytest.approx(0.06 * MASS * gravity, rel=1e-12)
    assert (link.building, link.floor, link.next_building) == (0, 0, jp.GROUND)
    assert (link.gap, link.contact, link.damper, link.velocity_friction) == (np.inf, *3 * (None,))


def test_modes_are_those_of_the_springs_before_yield():
    block = jp.Building(300e3, 4e7, 1.0, 1e-6, 1e-6)
    for bearing in (SLIDING, RUBBER):
        building, _ = jp.on_bearings(block, bearing, BASE)
        assert building.heights == (0.5, 3.0)
        modes = building.modes()
        np.testing.assert_allclose(modes.frequencies, frequencies(building), rtol=1e-9)
        np.testing.assert_allclose(modes.damping_ratios, 0, atol=1e-9)
    # Nearly rigid above the bearings: the base and all floors swing as one pendulum.
    stiff = jp.ShearBuilding.from_period(3, 300e3, period=0.01, damping_ratio=0.03)
    modes = jp.on_bearings(stiff, SLIDING, BASE)[0].modes()
    assert modes.periods[0] == pytest.approx(float(SLIDING.period), rel=2e-5)
    np.testing.assert_allclose(modes.shapes[:, 0].real, 1, rtol=2e-5)


def test_the_link_to_the_ground_has_friction_once_and_a_face_for_each_wall():
    building, links = jp.on_bearings(FRAME, SLIDING, BASE, wall=MoatWall((0.2, 0.3), (LAW, SOFT)))
    right, left = jp.Buildings((building,), links).links
    assert (right.side, right.gap, right.contact) == ("right", 0.3, SOFT)
    assert (left.side, left.gap, left.contact) == ("left", 0.2, LAW)
    assert right.friction == pytest.approx(0.06 * MASS * G, rel=1e-12)
    assert left.friction == 0
    # One gap is that of both sides; bearings without friction have the wall's link alone.
    building, links = jp.on_bearings(FRAME, RUBBER, BASE, wall=MoatWall(0.3, LAW))
    faces = jp.Buildings((building,), links).links
    assert [(face.gap, face.contact, face.friction) for face in faces] == 2 * [(0.3, LAW, 0.0)]
    # A wall on one side only; without a law it measures the gap.
    for gap, law in (((0.2, np.inf), LAW), ((np.inf, 0.2), LAW), ((0.2, np.inf), None)):
        building, links = jp.on_bearings(FRAME, SLIDING, BASE, wall=MoatWall(gap, law))
        faces = jp.Buildings((building,), links).links[::-1]
        assert tuple(face.gap for face in faces) == gap
        assert [face.contact for face in faces] == [law if x == 0.2 else None for x in gap]
    # The number of the building is that in the row.
    number = {"wall": MoatWall(0.3, LAW), "number": 1}
    building, links = jp.on_bearings(FRAME, SLIDING, BASE, **number)
    row = jp.Buildings((FRAME, building), (*links, jp.FloorLink(0, 1, 2, gap=0.5))[:1])
    assert [link.building for link in row.links] == [1, 1]
    assert row.system().topology.links == ((3, jp.GROUND), (jp.GROUND, 3))
    _, (link,) = jp.on_bearings(FRAME, SLIDING, BASE, number=2)
    assert link.building == 2


def test_friction_grows_with_the_velocity_from_slow_to_fast():
    bearing = FrictionPendulum(2.24, 0.04, fast_friction=0.1, rate=30.0)
    building, links = jp.on_bearings(FRAME, bearing, BASE, wall=MoatWall(0.3, LAW))
    right, left = jp.Buildings((building,), links).links
    assert left.velocity_friction is None
    speeds, weight = np.array([0.0, 0.01, 0.1, 10.0]), MASS * G
    forces = right.friction + right.velocity_friction.resistance(speeds)
    known = weight * (0.1 - (0.1 - 0.04) * np.exp(-30.0 * speeds))
    np.testing.assert_allclose(forces, known, rtol=1e-12)
    assert bearing.damping_ratio(0.2) == FrictionPendulum(2.24, 0.04).damping_ratio(0.2)


PENDULUM = FrictionPendulum
NOT_POSITIVE, UNMOVED = "must be positive and finite", "damping_ratio: displacement = 0"
test_bad_bearings_are_refused = refusals(
    (PENDULUM, 0.0, 0.06, f"^FrictionPendulum: radius = 0 {NOT_POSITIVE}"),
    (PENDULUM, 100.0, 0.06, r"^FrictionPendulum: radius = 100 must be between 0.05 and 50 m"),
    (PENDULUM, "2", 0.06, r"^FrictionPendulum: radius = '2' must be a real number"),
    (PENDULUM, 2.0, -0.1, r"^FrictionPendulum: friction = -0.1 must be finite and not negative"),
    (PENDULUM, 2.0, 1.5, r"^FrictionPendulum: friction = 1.5 must be between 0 and 1 "),
    (
        PENDULUM,
        2.0,
        0.06,
        0.05,
        r"fast_friction = 0.05 must be finite and at least friction =",
    ),
    (PENDULUM, 2.0, 0.06, 1.5, r"fast_friction = 1.5 must be between 0 and 1 \(a coefficient"),
    (PENDULUM, 2.0, 0.06, None, 30.0, r"rate = 30.0 must not be given without fast_friction: fric"),
    (PENDULUM, 2.0, 0.06, 0.1, 0.0, f"^FrictionPendulum: rate = 0 {NOT_POSITIVE}"),
    (PENDULUM, 2.0, 0.06, 0.1, 0.02, r"rate = 0.02 must be between 1 and 10000 s/m"),
    (SLIDING.damping_ratio, 0.0, f"^FrictionPendulum.{UNMOVED} {NOT_POSITIVE}"),
    (LeadRubber, 0.0, 0.05, f"^LeadRubber: period = 0 {NOT_POSITIVE}"),
    (LeadRubber, 2500.0, 0.05, r"^LeadRubber: period = 2500 must be between 0.002 and 60 s"),
    (LeadRubber, 2.5, 0.0, f"^LeadRubber: strength = 0 {NOT_POSITIVE}"),
    (LeadRubber, 2.5, 50e3, r"^LeadRubber: strength = 50000 must be between 0.0001 and 1 \(of the"),
    (LeadRubber, 2.5, 0.05, 0.0, f"^LeadRubber: yield_displacement = 0 {NOT_POSITIVE}"),
    (LeadRubber, 2.5, 0.05, 10.0, r"yield_displacement = 10 must be between 1e-05 and 1 m"),
    (
        *(LeadRubber, 2.5, 0.05, 0.02, 0.01),
        r"^LeadRubber: ultimate_displacement = 0.01 must be at least yield_displacement = 0.02",
    ),
    (RUBBER.damping_ratio, -1.0, f"^LeadRubber.damping_ratio: displacement = -1 {NOT_POSITIVE}"),
)

test_bad_walls_are_refused = refusals(
    (-0.1, r"gap = -0.1 must be not negative"),
    ((0.3, -1.0), r"gap = -1 must be not negative"),
    ((0.1, 0.2, 0.3), r"gap = \(0.1, 0.2, 0.3\) must be two, \(left, right\)"),
    (0.3, 3.0, r"contact = 3.0 must be of type ContactLaw or Newton or None"),
    of=MoatWall,
)

test_bad_buildings_are_refused = refusals(
    (3.0, SLIDING, BASE, {}, "building = 3.0 must be of type ShearBuilding or"),
    (FRAME, 3.0, BASE, {}, "bearing = 3.0 must be of type FrictionPendulum or"),
    (FRAME, SLIDING, 0.0, {}, f"base_mass = 0 {NOT_POSITIVE}"),
    (FRAME, SLIDING, BASE, {"wall": 0.3}, "wall = 0.3 must be of type MoatWall or None"),
    (FRAME, SLIDING, BASE, {"gravity": -1.0}, f"gravity = -1 {NOT_POSITIVE}"),
    (FRAME, RUBBER, BASE, {"number": -1}, "number = -1 must be a whole number from 0 on"),
    (FRAME, SLIDING, BASE, {"height": 0.0}, f"height = 0 {NOT_POSITIVE}"),
    (FRAME, RUBBER, 1e11, {}, "base_mass = 1e.11 must be between 0.001 and"),
    of=lambda building, bearing, mass, more: jp.on_bearings(building, bearing, mass, **more),
    before="^on_bearings: ",
)


def test_links_of_the_building_are_carried_along_and_its_modes_count_them():
    tuned, (inerter,) = jp.tuned_inerter_damper(FRAME, 0.05)
    _, (carried, sliding) = jp.on_bearings(tuned, SLIDING, BASE, links=(inerter,), number=1)
    assert inerter.other_floor == jp.GROUND
    ends = carried.floor, carried.other_building, carried.other_floor
    assert ends == (inerter.floor + 1, 1, 0)  # the base
    assert sliding.other_floor == jp.GROUND
    alone = jp.Buildings((tuned,), (inerter,))
    neighbour = jp.FloorLink(0, 1, gap=0.1)
    beside = jp.Buildings((FRAME, tuned), (dataclasses.replace(inerter, building=1), neighbour))
    np.testing.assert_allclose(beside.modes(1).periods, alone.modes(0).periods, rtol=1e-12)
    np.testing.assert_allclose(beside.modes(0).periods, FRAME.modes().periods, rtol=1e-12)
    assert abs(alone.modes(0).periods[0] / tuned.modes().periods[0] - 1) > 1e-3
