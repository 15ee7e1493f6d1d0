"""Buildings on soil: published periods and stiffnesses, and what does not depend on the soil."""

import dataclasses
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from jaxpound.model import Column, Footing, through_soil
from jaxpound.model.ends import along, weighted
from jaxpound.model.places import link_places, mass_places, rod_places
from jaxpound.model.shear_building import in_units
from jaxpound.model.topology import floors
from tests.refusals import refusals

MASS, HEIGHT, RADIUS = 500e3, 10.0, 6.0
OMEGA = 2 * np.pi
STIFFNESS = MASS * OMEGA**2
FRAME = jp.ShearBuilding.of_storeys(
    [MASS], STIFFNESS, heights=HEIGHT, dashpots=2 * 0.05 * MASS * OMEGA
)


def clay(velocity=150.0, ratio=1 / 3):
    return jp.Soil(velocity, 1800.0, ratio)


def on_disk(velocity=150.0, mass=200e3, frame=FRAME):
    return jp.on_soil(frame, clay(velocity), radius=RADIUS, footing_mass=mass)


# √(1 + k/K_h + k h²/K_r) (Veletsos and Meek 1974)
RATIOS = {150: 1.03602, 200: 1.02042, 400: 1.00514}
PERIOD, DAMPING = 1.03609, 0.048717  # on a footing of 200 t, by the eigenvalue


@pytest.mark.parametrize("velocity", RATIOS)
def test_the_period_on_a_light_footing_is_that_of_veletsos_and_meek(velocity):
    building = on_disk(velocity, mass=MASS / 1000)
    assert building.modes().periods[0] == pytest.approx(RATIOS[velocity], rel=1e-4)
    assert building.natural_period == pytest.approx(RATIOS[velocity], rel=1e-4)


def test_the_first_mode_on_a_footing_is_the_published_one():
    """Also its stiffnesses and dashpots, and the inertia m r²/4."""
    building = on_disk()
    footing = building.footing
    numbers = [getattr(footing, f"{x}_{y}") for x in ("sway", "rocking") for y in _NUMBERS]
    published = [1166.4e6, 30.536e6, 34992e6, 549.65e6]
    np.testing.assert_allclose(numbers, published, rtol=2e-5)
    assert footing.rotational_inertia == 1.8e6
    modes, effect = building.modes(), building.soil_effect()
    assert modes.periods[0] == pytest.approx(PERIOD, abs=1e-5)
    assert modes.damping_ratios[0] == pytest.approx(DAMPING, abs=1e-6)
    assert effect.period_ratio == pytest.approx(modes.periods[0])
    # Of a viscous oscillator that keeps 1/1.03609³ of its 5 %.
    assert effect.added_damping == pytest.approx(DAMPING - 0.05 / PERIOD**3, abs=2e-6)
    assert re.search(r"ratio of periods 1\.0361, .* 0\.0038", str(effect))


def test_what_radiation_adds_to_a_fractional_rod_leaves_out_its_own():
    """Its share is that of the rod in series with the springs of the soil, m s² + K*(s) = 0."""
    frame = jp.ShearBuilding.from_period(1, MASS, 0.4, 0.05, height=HEIGHT)
    building = on_disk(mass=MASS / 1000, frame=frame)
    effect, footing, (storey,) = building.soil_effect(), building.footing, frame.storeys
    law = storey.material(1.0)
    soil = 1 / footing.sway_stiffness + HEIGHT**2 / footing.rocking_stiffness
    s = 2j * np.pi / effect.period
    for _ in range(50):
        power = s**law.order
        modulus = storey.stiffness * (1 + law.tau_x * power) / (1 + law.tau_f * power)
        s = 1j * np.sqrt(1 / (1 / modulus + soil) / MASS)
    own = -s.real / abs(s)
    assert effect.own_damping_ratio == pytest.approx(own, rel=1e-3)
    assert effect.added_damping == pytest.approx(effect.damping_ratio - own, abs=2e-5)
    cube = effect.fixed_damping_ratio / effect.period_ratio**3
    assert own - cube > 1e-3  # which is of viscous storeys


def test_overdamped_modes_are_no_first_mode():
    """A light building on a wide footing of soft soil: sway and rocking creep."""
    frame, soil = jp.ShearBuilding.from_period(1, 6e5, 0.15, 0.05, None), jp.Soil(80, 1800, 0.4)
    building = jp.on_soil(frame, soil, radius=12, footing_mass=800e3)
    modes, effect = building.modes(), building.soil_effect()
    assert modes.overdamped.tolist() == [True, False, True]
    assert (effect.period, effect.damping_ratio) == (modes.periods[1], modes.damping_ratios[1])
    creeps = jp.ShearBuilding.of_storeys([MASS], 1e8, dashpots=5e7)
    with pytest.raises(jp.InvalidInput, match="building must vibrate: all its modes are overdamp"):
        on_disk(frame=creeps).soil_effect()


_NUMBERS = ("stiffness", "damping")


def matrices(building):
    """M, C, K and ι of a building on soil by the formulas of a textbook, floors first."""
    n, ups, f = len(building.storeys), np.cumsum(building.heights), building.footing
    masses = np.diag([*(s.mass for s in building.storeys), f.mass, f.rotational_inertia])
    k, c = np.zeros((2, n + 2, n + 2))
    for i, storey in enumerate(building.storeys):
        row = np.zeros(n + 2)
        row[i], row[i - 1 if i else n] = 1.0, -1.0
        row[n + 1] = -building.heights[i]
        k += storey.stiffness * np.outer(row, row)
        c += (storey.dashpot or 0.0) * np.outer(row, row)
    if building.damping is not None:
        c += building.damping.stiffness * k
        for i, storey in enumerate(building.storeys):
            row = np.zeros(n + 2)
            row[i], row[n], row[n + 1] = 1.0, -1.0, -ups[i]
            c += building.damping.mass * storey.mass * np.outer(row, row)
    k += np.diag([*[0.0] * n, f.sway_stiffness, f.rocking_stiffness])
    c += np.diag([*[0.0] * n, f.sway_damping, f.rocking_damping])
    return masses, c, k


def test_modes_of_a_frame_are_the_eigenvalues_of_its_matrices():
    """Three storeys of different heights with Rayleigh's damping, on a rectangle in the soil."""
    damping = jp.Rayleigh(mass=0.3, stiffness=2e-3)
    frame = jp.ShearBuilding.of_storeys(
        [3e5, 2.5e5, 2e5], [2e8, 1.5e8, 1e8], heights=(4.0, 3.0, 3.5), damping=damping
    )
    building = jp.on_soil(
        frame, clay(400.0, 0.2), length=12, width=9, embedment=2.0, footing_mass=3e5
    )
    masses, c, k = matrices(building)
    n, inverse = len(masses), np.linalg.inv(masses)
    equations = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ k, -inverse @ c]])
    values = np.linalg.eigvals(equations)
    vibrating = np.array(sorted(values[values.imag > 1e-6], key=abs))
    modes = building.modes()
    kept = modes.eigenvalues[~modes.overdamped]
    np.testing.assert_allclose(kept, vibrating[: kept.size], rtol=1e-8)
    assert kept.size >= 3
    assert modes.participation.sum() == pytest.approx(1.0)


def test_stiff_soil_is_rigid_ground():
    frame = jp.ShearBuilding.from_period(3, 3e5, 0.5, 0.05)
    building = jp.on_soil(frame, clay(1e4), radius=RADIUS, footing_mass=2e5)
    fixed, soil = frame.modes(), building.modes()
    np.testing.assert_allclose(soil.frequencies[:3], fixed.frequencies, rtol=1e-4)
    np.testing.assert_allclose(soil.damping_ratios[:3], fixed.damping_ratios, rtol=5e-4)


def test_a_rectangle_has_the_stiffnesses_of_pais_and_kausel():
    """Numbers by hand from NIST GCR 12-917-21, tables 2-2a and 2-2b; B = 1 m, L = 1.5 m."""
    soil = jp.Soil(np.sqrt(30e6 / 2000), 2000, 0.3)
    by_hand = {
        (3, 2): (30e6 / 1.7 * (6.8 * 1.5**0.65 + 2.4), 30e6 / 0.7 * (3.73 * 1.5**2.4 + 0.27)),
        (2, 3): (30e6 / 1.7 * (6.8 * 1.5**0.65 + 2.8), 30e6 / 0.7 * (3.2 * 1.5 + 0.8)),
    }
    deeper = {(3, 2): 2 + 1.6 / (0.35 + 1.5**4), (2, 3): 2 + 1.6 / (0.35 + 1.5)}
    for (length, width), numbers in by_hand.items():
        flat = Footing(soil, 1e4, length=length, width=width)
        deep = Footing(soil, 1e4, length=length, width=width, embedment=1.0)
        pair = flat.sway_stiffness, flat.rocking_stiffness
        np.testing.assert_allclose(pair, numbers, rtol=1e-12)
        factors = deep.sway_stiffness / pair[0], deep.rocking_stiffness / pair[1]
        expected = 1.33 + 1.34 / 2.5 - 0.0, deeper[length, width]
        np.testing.assert_allclose(factors, expected, rtol=1e-12)
        # A disk of the same area, or the same second moment, is as stiff within a tenth.
        sway = jp.model.Footing(soil, 1e4, radius=np.sqrt(flat.area / np.pi)).sway_stiffness
        radius = (4 * flat.second_moment / np.pi) ** 0.25
        rocking = jp.model.Footing(soil, 1e4, radius=radius).rocking_stiffness
        np.testing.assert_allclose((sway, rocking), pair, rtol=0.1)


def test_waves_below_a_footing_are_no_faster_than_twice_the_shear_waves():
    ratios = np.array([0.0, 0.2, 1 / 3, 0.4, 0.5])
    speeds = [float(clay(100.0, x).axial_wave_velocity) for x in ratios]
    exact = 100 * np.sqrt(2 * (1 - ratios[:3]) / (1 - 2 * ratios[:3]))
    np.testing.assert_allclose(speeds, [*exact, 200.0, 200.0], rtol=1e-12)
    slope = jax.grad(lambda x: jp.Soil(100.0, 1800.0, x).axial_wave_velocity)(0.5)
    assert slope == 0.0


def test_a_gradient_by_the_velocity_of_shear_waves_is_that_of_differences():
    """Of the largest drift, in one program with sway, rocking and radiation."""
    ground, grid = jp.Ricker(0.03, 1.0, 1.5), jp.TimeGrid.until(4.0, 5e-3)

    def peak(velocity):
        pair = jp.Buildings((on_disk(velocity),))
        return jp.demand(pair, ground, grid).rods[0].peak_drift

    value, slope = jax.jit(jax.value_and_grad(peak))(120.0)
    both = np.asarray(jax.jit(jax.vmap(peak))(jnp.array([119.9, 120.1, 120.0])))
    assert value == pytest.approx(both[2], rel=1e-12)
    assert slope == pytest.approx((both[1] - both[0]) / 0.2, rel=1e-4)


def pair_of(share=0.0, links=()):
    left, right = on_disk(frame=_frame(2)), on_disk(120.0, frame=_frame(1))
    return jp.Buildings((left, right), (*links, *through_soil(left, right, share)))


def _frame(n):
    return jp.ShearBuilding.of_storeys([2e5] * n, 1e8, heights=4.0, damping=jp.Rayleigh(0.05))


def test_places_have_words():
    law = jp.KelvinVoigt(1e9, 0.65)
    links = jp.FloorLink(0, 0, gap=0.05, contact=law), jp.FloorLink(0, 1, next_building=0)
    system = pair_of(0.1, links).system()
    topology = system.topology
    assert mass_places(topology)[:3] == tuple(
        f"{x} of building 1" for x in ("floor 1", "floor 2", "footing")
    )
    assert mass_places(topology)[4:6] == tuple(f"{x} of building 2" for x in ("floor 1", "footing"))
    assert mass_places(topology)[3::3] == tuple(f"rotation of building {b}, at 1 m" for b in (1, 2))
    assert rod_places(topology)[2:5] == (
        "sway of building 1",
        "rocking of building 1, at 1 m",
        "storey 1 of building 2",
    )
    assert link_places(topology) == ("1–2, floor 1", "in 1, floors 1–2", "1–2, footing")
    assert [[mass for mass, _ in x] for x in floors(topology)] == [[0, 1], [4]]
    assert topology.floor_masses == [0, 1, 4]
    assert system.influences == (1.0, 1.0, 1.0, 0.0, 1.0, 1.0, 0.0)


def test_a_rigid_rotation_strains_springs_of_the_soil_only():
    """No storey, dashpot, brace, damper to the ground or column of the building."""
    column = Column(3e8)
    links = (
        jp.FloorLink(0, 1, next_building=0, friction=1e4),
        jp.FloorLink(0, 0, next_building=jp.GROUND, gap=(0.1, 0.2)),
        jp.FloorLink(0, 0, gap=0.1, column=dataclasses.replace(column, side="left")),
    )
    lower = jp.ShearBuilding.of_storeys([2e5], 1e8, heights=2.5, damping=jp.Rayleigh(0.05))
    left = on_disk(frame=_frame(2))
    system = jp.Buildings((left, lower), links).system()
    footing, angle = 0.3, 0.01
    rigid = [footing + 4 * angle, footing + 8 * angle, footing, angle, footing + 2.5 * angle]
    strained = [along(weighted(x), rigid) for x in (*system.rods, *system.damping)]
    of_left = [x for x in strained if abs(x) < 1e-12]
    springs = [float(x) for x in strained if abs(x) >= 1e-12]
    # Sway and rocking with their dashpots, and the neighbour's storey with its own.
    other = rigid[-1]
    np.testing.assert_allclose(
        sorted(springs), sorted([footing, angle, other, footing, angle, other, other])
    )
    assert len(of_left) == 2 + 4
    right_face, left_face = system.links[1:3]
    assert left_face.ends == right_face.ends._replace(side=-1)
    closings = [along(weighted(x), rigid) for x in (system.links[0], right_face, system.links[3])]
    np.testing.assert_allclose(closings, 0.0, atol=1e-12)


def test_a_left_face_alone_closes_to_the_left():
    links = (jp.FloorLink(0, 0, next_building=jp.GROUND, gap=0.1, side="left"),)
    (link,) = jp.Buildings((on_disk(frame=_frame(2)),), links).system().links
    assert along(weighted(link), [-1.0, 0.0, 0.0, 0.0]) == 1.0


def test_soil_between_footings_adds_its_share():
    """Of stiffness and dashpot, and nothing without."""
    assert through_soil(on_disk(), on_disk(), 0.0) == ()
    apart, joined = pair_of(), pair_of(0.2)
    k = np.sqrt(np.prod([x.footing.sway_stiffness for x in apart.buildings]))
    c = np.sqrt(np.prod([x.footing.sway_damping for x in apart.buildings]))
    spring, dashpot = joined.system().rods[-2:]
    assert (spring.ends, dashpot.ends) == ((2, 5), (2, 5))
    assert float(spring.stiffness) == pytest.approx(0.2 * k)
    assert float(dashpot.material.coefficient) == pytest.approx(0.2 * c)
    assert dashpot.stiffness is None
    alone = [x.modes().periods[0] for x in apart.buildings]
    np.testing.assert_allclose(sorted(jp.modes(apart).periods[:2]), sorted(alone), rtol=1e-9)
    first = jp.modes(joined).periods[0]
    assert max(alone) > first > 0.99 * max(alone)  # stiffer


def test_dimensionless_buildings_on_soil_have_the_same_modes():
    pair = pair_of(0.15)
    row, scales = pair.dimensionless()
    frequencies = jp.modes(row).frequencies * float(scales.frequency)
    np.testing.assert_allclose(frequencies, jp.modes(pair).frequencies, rtol=1e-9)


def test_tuned_masses_stand_on_soil_in_either_order():
    """The tuning is that to the first mode of what the mass is put on."""
    frame, soil = _frame(2), clay()
    before = on_disk(frame=jp.tuned_mass_damper(frame, 0.05))
    after = jp.tuned_mass_damper(on_disk(frame=frame), 0.05)
    periods = [x.storeys[-1].natural_period for x in (before, after)]
    on_ground = frame.natural_period, on_disk(frame=frame).natural_period
    np.testing.assert_allclose(np.divide(*periods), np.divide(*on_ground), rtol=0.02)
    for building in (before, after):
        topology = in_units(building, 1.0, 1.0, 1.0).system().topology
        assert mass_places(topology)[2:] == tuple(
            f"{x} of building 1{y}"
            for x, y in (("tuned mass", ""), ("footing", ""), ("rotation", ", at 1 m"))
        )
    assert jp.on_soil(jp.Buildings((frame,)), soil, radius=6, footing_mass=2e5).buildings[0].footing


def test_a_tuned_mass_moves_the_number_of_the_footing():
    """A link made for the building without it would join the tuned masses."""
    building = on_disk(frame=_frame(2))
    tuned, soil = jp.tuned_mass_damper(building, 0.05), through_soil(building, building, 0.1)
    says = "tuned mass to that, or the footing, of a neighbour; the footing of building 1 is floor"
    with pytest.raises(jp.InvalidInput, match=f"{says} 3; .* building 2 is floor 3"):
        jp.Buildings((tuned, tuned), soil)
    with pytest.raises(jp.InvalidInput, match=f"{says} 3; .* building 2 is floor 2"):
        jp.Buildings((tuned, building), soil)
    (link,) = jp.Buildings((tuned, building), through_soil(tuned, building, 0.1)).links
    assert str(link) == "1–2, floors 4–3"


def test_bearings_stand_on_the_footing():
    """Their friction and the wall are between base and footing."""
    bearing, wall = jp.FrictionPendulum(2.0, 0.06), jp.MoatWall(0.2)
    base, links = jp.on_bearings(_frame(2), bearing, 2e5, wall=wall)
    system = jp.Buildings((on_disk(frame=base),), links).system()
    assert weighted(system.links[0]) == ((0, 1.0), (3, -1.0), (4, -0.5))
    assert weighted(system.rods[0]) == weighted(system.links[0])
    yields = on_disk(frame=_frame(2)).yielding(base_shear_coefficient=0.2, hardening=0.1)
    assert yields.with_p_delta().footing is yields.footing is not None


def test_the_least_inertia_is_that_of_the_lightest_plate():
    """So that the inertia by default is never refused."""
    lightest, disk = MASS * 1e-4, {"radius": RADIUS, "footing_mass": 1e5}
    plate = on_disk(mass=lightest * 1.001).footing.rotational_inertia
    assert jp.on_soil(FRAME, clay(), **disk, footing_inertia=plate).footing.inertia == plate


def test_a_block_rocks_by_its_height():
    """Of several buildings only blocks take it."""
    block, disk = FRAME.storeys[0], {"radius": RADIUS, "footing_mass": 2e5}
    on_soil = jp.on_soil(jp.Buildings((block, FRAME)), clay(), **disk, height=HEIGHT)
    assert [x.heights for x in on_soil.buildings] == [(HEIGHT,), (HEIGHT,)]
    assert on_soil.modes(0).periods[0] == pytest.approx(PERIOD, abs=1e-5)


def test_a_footing_in_tonnes_is_told_of():
    frame = jp.ShearBuilding.from_period(3, 300e3, 0.4, 0.05)
    light = jp.on_soil(frame, jp.Soil(200.0, 1800.0, 0.3), radius=6.0, footing_mass=200.0)
    message = "the footing of building 1 has a mass of 200 kg, should be at least 810 kg"
    with pytest.warns(jp.PlausibilityWarning, match=message):
        jp.Buildings((light,))


def test_plausible_footings_are_no_floors():
    """Contact between them is not judged by a storey, nor masses in t by that of a footing."""
    law = jp.KelvinVoigt(2e9, 0.65)
    contacts = [jp.FloorLink(*ends, gap=0.05, contact=law) for ends in ((0, 0), (0, 2, 1))]
    pair_of(links=contacts)  # warnings are errors
    tonnes = jp.ShearBuilding.from_period(2, 300.0, 0.5, 0.05)
    with pytest.warns(jp.PlausibilityWarning, match="the heaviest floor, of 300 kg, should be"):
        jp.Buildings((jp.on_soil(tonnes, clay(), radius=RADIUS, footing_mass=2e5),))


test_wrong_numbers_are_refused = refusals(
    (lambda: jp.Soil(1.5, 1800, 0.3), r"Soil: shear_wave_velocity = 1\.5 must be between 20"),
    (lambda: jp.Soil(150, 1.8, 0.3), r"Soil: density = 1\.8 must"),
    (lambda: jp.Soil(150, 1800, 0.6), r"Soil: poisson_ratio = 0\.6 must be between 0 and 0\.5"),
    (lambda: on_disk(mass=0.0), r"on_soil: footing_mass = 0 must be .*infinitely fast"),
    (lambda: on_disk(mass=10.0), r"on_soil: footing_mass = 10 must be at least 0\.0001 times"),
    (  # 1e-4 of 500 t on a radius of gyration of 3 m: 450 kg m²
        lambda: jp.on_soil(FRAME, clay(), radius=6, footing_mass=1e5, footing_inertia=440),
        r"on_soil: footing_inertia = 440 must be at least that of a thin plate of 0\.0001 times",
    ),
    (
        lambda: jp.on_soil(FRAME, clay(), length=5, footing_mass=1e5),
        r"on_soil: width = None must be stated",
    ),
    (
        lambda: jp.on_soil(FRAME, clay(), length=5, radius=6, footing_mass=1e5),
        r"on_soil: length = 5 must be left out beside radius",
    ),
    (
        lambda: jp.on_soil(FRAME, clay(), radius=6, embedment=1, footing_mass=1e5),
        r"on_soil: embedment = 1 must be left out",
    ),
    (lambda: on_disk(frame=FRAME.storeys[0]), r"on_soil: height = None must be stated, in m"),
    (
        lambda: jp.on_soil(FRAME.storeys[0], clay(), radius=6, footing_mass=1e5, height=-1),
        r"on_soil: height = -1 must be",
    ),
    (
        lambda: jp.on_soil(FRAME, clay(), radius=6, footing_mass=1e5, height=3),
        r"on_soil: height = 3 must be left out: a ShearBuilding has heights",
    ),
    (lambda: on_disk(frame=on_disk()), r"on_soil: building must not be on soil"),
    (lambda: FRAME.soil_effect(), r"footing = None must be stated"),
    (lambda: through_soil(FRAME, on_disk(), 0.1), r"through_soil: left\.footing = None"),
    (lambda: through_soil(on_disk(), on_disk(), 0.9), r"share = 0\.9 must be between 0 and 0\.5"),
    (
        lambda: jp.on_bearings(on_disk(), jp.FrictionPendulum(2.0, 0.06), 2e5),
        r"on_bearings: building must be put on soil afterwards",
    ),
    (
        lambda: jp.tuned_inerter_damper(on_disk(), 0.05),
        r"tuned_inerter_damper: building must be put on soil afterwards",
    ),
    (
        lambda: jp.Storeys((1.0, 1.0, 1.0), jp.Rod(jp.model.Spring(), 1.0), heights=(1.0, 2.0)),
        r"heights, 2 of them, must be 1",
    ),
)
