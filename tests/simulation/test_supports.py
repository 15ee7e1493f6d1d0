"""Supports that move apart: springs and dashpots in closed form, joints beside heavy masses."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import jaxpound as jp
from jaxpound.model import parameters
from jaxpound.model.places import rod_places
from jaxpound.model.topology import soil_spring
from jaxpound.plots.contact_paths import followed_contacts
from jaxpound.reliability.instants import series_of
from jaxpound.results import named
from tests.refusals import refusals
from tests.simulation.pairs import SHAKING
from tests.simulation.test_weights import GRID as COARSE
from tests.simulation.test_weights import INSTANTS, STEPS, along, floats, reference, relative_way

G, SPRING = jp.GROUND, jp.model.Spring()
STEEL = jp.ZenerRod(0.6, 0.05, 0.2)
FIRST, SECOND = jp.support(1), jp.support(2)
GRID = jp.TimeGrid.until(5.0, 0.01)


def pulse(t, size, period, at, xp=jnp):
    """A Ricker pulse of acceleration, after which velocity and displacement are 0."""
    y = (np.pi * (t - at) / period) ** 2
    return size * (1 - 2 * y) * xp.exp(-y)


NUMBERS = (0.5, 1.5, 1.8), (0.4, 1.2, 2.0), (-0.3, 1.0, 2.2)
AT_0, AT_1, AT_2 = (lambda t, numbers=numbers: pulse(t, *numbers) for numbers in NUMBERS)


def deck(stiffness=20.0, coefficient=1.5):
    """A deck of mass 2 on the ground and, by a spring and a dashpot, on support 1."""
    springs = [jp.Rod(SPRING, stiffness, (0, end)) for end in (G, FIRST)]
    dashpot = jp.Rod(jp.Dashpot(coefficient), ends=(0, FIRST))
    return jp.System((2.0,), (*springs, dashpot))


def exact(stiffness, coefficient):
    """x, v of the deck and d, v of the support, relative to support 0, by SciPy."""

    def rates(t, y):
        x, v, d, rate = y
        force = -stiffness * x - stiffness * (x - d) - coefficient * (v - rate)
        u, other = (pulse(t, *numbers, xp=np) for numbers in NUMBERS[:2])
        return v, force / 2.0 - u, rate, other - u

    return solve_ivp(rates, (0, 5), [0.0] * 4, rtol=1e-10, atol=1e-12, t_eval=GRID.times()[::4]).y


def test_a_deck_on_two_supports_is_that_of_scipy_to_second_order():
    """Displacements, velocities, forces, energy, and the derivatives by stiffness and dashpot."""
    x, v, d, rate = exact(20.0, 1.5)
    change = 1e-4
    slopes = [
        (exact(20.0 + change, 1.5)[0] - exact(20.0 - change, 1.5)[0]) / (2 * change),
        (exact(20.0, 1.5 + change)[0] - exact(20.0, 1.5 - change)[0]) / (2 * change),
    ]
    errors = []
    for step in (0.04, 0.02, 0.01):
        grid, every = jp.TimeGrid.until(5.0, step), round(0.04 / step)

        def displacement(k, c, grid=grid):
            return jp.simulate(deck(k, c), (AT_0, AT_1), grid).masses[0].x

        response = jp.simulate(deck(), (AT_0, AT_1), grid)
        by_k, by_c = jax.jacfwd(displacement, (0, 1))(20.0, 1.5)
        support = response.supports[1]
        series = [
            (response.masses[0].x, x),
            (response.masses[0].v, v),
            (support.displacement, d),
            (support.velocity, rate),
            (response.rods[1].force, 20.0 * (x - d)),
            (response.rods[2].force, 1.5 * (v - rate)),
            (by_k, slopes[0]),
            (by_c, slopes[1]),
        ]
        errors.append([np.abs(y[::every] - z).max() / np.abs(z).max() for y, z in series])
        assert float(response.energy.relative_residual) < 15 * step**2
        np.testing.assert_allclose(support.acceleration, AT_1(grid.times()), atol=1e-12)
    for coarse, middle, fine in np.transpose(errors):
        assert coarse / middle == pytest.approx(4, rel=0.15) == middle / fine
        assert fine < 3e-3


def bridge(law, first, second, friction, masses=(), rods=(), dashpots=True):
    """Two decks between two abutments; where contact has a law of force, links close a ring."""
    rods = [*rods, jp.Rod(STEEL, 4.0, (0, first)), jp.Rod(SPRING, 2.0, (0, G))]
    rods.append(jp.Rod(STEEL, 9.0, (1, second)))
    if dashpots:
        rods += [jp.Rod(jp.Dashpot(0.3), ends=(0, first)), jp.Rod(jp.Dashpot(0.2), ends=(0, 1))]
    links = [jp.Link((0, 1), friction=friction, gap=0.01, contact=law)]
    if isinstance(law, jp.KelvinVoigt) and not friction:
        links.append(jp.Link((first, 0), gap=0.008, contact=law, inerter=jp.Inerter(0.1)))
    links.append(jp.Link((1, second), friction=friction / 2, gap=0.012, contact=law))
    return jp.System((1.0, 0.7, *masses), rods, links)


LAWS = {
    "Kelvin–Voigt, in a ring": (jp.KelvinVoigt(1e3, 0.6), 0.0, True),
    "Newton": (jp.Newton(0.6), 0.0, False),
    "friction": (None, 0.1, True),
}


@pytest.mark.parametrize("name", LAWS)
def test_joints_at_supports_are_those_at_masses_too_heavy_to_move(name):
    """A support is a mass of 10⁸ under a load that moves it as the support's ground moves."""
    law, friction, dashpots = LAWS[name]
    own = bridge(law, FIRST, SECOND, friction, dashpots=dashpots)
    response = jp.simulate(own, (AT_0, AT_1, AT_2), GRID)
    heavy = 1e8
    weak = [jp.Rod(SPRING, 1.0, (mass, G)) for mass in (2, 3)]
    beside = bridge(law, 2, 3, friction, (heavy, heavy), weak, dashpots)
    loads = {2: lambda t: heavy * AT_1(t), 3: lambda t: heavy * AT_2(t)}
    expected = jp.simulate(beside, AT_0, GRID, loads=loads)
    for mass in (0, 1):
        for field in ("x", "v"):
            pair = [getattr(y.masses[mass], field) for y in (response, expected)]
            np.testing.assert_allclose(*pair, atol=1e-4)
    for support, mass in zip(response.supports[1:], expected.masses[2:], strict=True):
        np.testing.assert_allclose(support.displacement, mass.x, atol=2e-5)
        # That of a mass lacks the mean of its load half a step before and after.
        np.testing.assert_allclose(support.velocity, mass.v, atol=2e-4)
    for link, other in zip(response.links, expected.links, strict=True):
        np.testing.assert_allclose(link.gap, other.gap, atol=2e-5)
    for rod, other in zip(response.demand.rods, expected.demand.rods[2:], strict=True):
        assert float(rod.peak_force) == pytest.approx(float(other.peak_force), rel=1e-3)
    if law is not None:
        assert any(link.n_impacts > 0 for link in response.demand.links)
        assert followed_contacts(response).keys() == followed_contacts(expected).keys()
    assert float(response.energy.relative_residual) < 0.02


def test_all_supports_move_alike_under_one_motion_and_an_infinite_velocity():
    """Two equal spans keep their gap; a single motion is that of all supports."""
    spans = [jp.Rod(STEEL, 5.0, (mass, end)) for mass, end in enumerate((G, FIRST))]
    pair = jp.System((1.0, 1.0), spans, [jp.Link((0, 1), gap=0.1)])
    together = jp.simulate(pair, jp.travelling(AT_0, np.inf, (0.0, 100.0)), GRID)
    assert float(together.demand.min_gap) == 0.1
    one = jp.simulate(pair, AT_0, GRID)
    np.testing.assert_array_equal(one.masses[0].x, together.masses[0].x)
    assert float(jnp.abs(one.supports[1].displacement).max()) == 0.0


def test_equal_spans_half_a_period_apart_move_against_each_other():
    """Steady vibration at ω: total displacements ∓ H(ω) u, with H = K*/(K* − m ω²)."""
    omega, amplitude = 2 * np.pi / 1.6, 0.01
    spans = [jp.Rod(jp.ZenerRod(1.0, 0.02, 0.08), 5.0, (m, e)) for m, e in enumerate((G, FIRST))]
    pair = jp.System((1.0, 1.0), spans, [jp.Link((0, 1), gap=0.1)])
    wave = jp.travelling(
        lambda t: -amplitude * omega**2 * jnp.sin(omega * t), 200.0, (0.0, 200.0 * 0.8)
    )
    grid = jp.TimeGrid.until(80.0, 0.02)
    response = jp.simulate(pair, wave, grid)
    stiffness = 5.0 * complex(spans[0].material.complex_modulus(omega))
    transfer = abs(stiffness / (stiffness - omega**2))
    steady = grid.times() > 60.0
    # The velocity of the ground starts with a jump, so that supports drift apart.
    apart = np.asarray(response.masses[0].x - response.masses[1].x)[steady]
    drift = np.polyfit(grid.times()[steady], apart, 1)
    size = np.ptp(apart - np.polyval(drift, grid.times()[steady])) / 2
    assert size == pytest.approx(2 * transfer * amplitude, rel=5e-3)


def test_batches_precisions_and_derivatives_by_the_velocity_of_a_wave():
    system = bridge(jp.KelvinVoigt(1e3, 0.6), FIRST, SECOND, 0.0, dashpots=False)

    def gap(velocity):
        wave = jp.travelling(jp.Ricker(0.02, 1.5, 2.0), velocity, (0.0, 0.15, 0.3))
        return jp.demand(system, wave, GRID).min_gap

    velocities = jnp.array([0.6, 1.0])
    gaps, slopes = jax.vmap(jax.value_and_grad(gap))(velocities)
    for velocity, value, slope in zip(velocities, gaps, slopes, strict=True):
        assert float(gap(velocity)) == pytest.approx(float(value), rel=1e-12)
        difference = (gap(velocity + 1e-5) - gap(velocity - 1e-5)) / 2e-5
        assert float(difference) == pytest.approx(float(slope), rel=1e-4)
    single = jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), deck())
    wave = jp.travelling(jp.Ricker(0.2, 1.5, 2.0), 1.0, (0.0, 0.3))
    wave = jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), wave)
    response = jp.simulate(single, wave, jp.TimeGrid.until(2.0, 0.02))
    assert response.supports[1].displacement.dtype == jnp.float32


def test_buildings_stand_on_supports_in_si_and_results_name_them():
    pier = jp.Building.from_period(mass=900e3, period=0.8, damping_ratio=0.05)
    law = jp.KelvinVoigt(stiffness=4e9, restitution=0.65)
    links = [
        jp.FloorLink(0, 0, gap=0.08, contact=law),
        jp.FloorLink(1, 0, gap=0.06, contact=law, next_building=jp.support(2)),
    ]
    decks = jp.Buildings((pier, pier), links, supports=(0, 1))
    pulse = jp.Ricker(0.03, 0.9, 2.0)
    wave = jp.travelling(pulse, velocity=400.0, distances=(0.0, 60.0, 120.0))
    grid = jp.TimeGrid.until(10.0, 0.01)
    response = jp.simulate(decks, wave, grid)
    assert decks.system().topology.rods == ((0, -1), (1, FIRST))
    assert [str(link) for link in decks.links] == ["1–2, floor 1", "2–support 3, floor 1"]
    assert len(response.supports) == 3
    later = np.interp(grid.times() - 0.15, grid.times(), np.asarray(response.ground_acceleration))
    np.testing.assert_allclose(response.supports[1].acceleration, later, atol=0.05)
    names = response._index_and_columns()[1]
    assert "support_displacement_2_m" in names
    assert "support_acceleration_3_m_per_s2" in names
    assert "2–support 3, floor 1" in str(response)


def test_the_opening_of_joints_is_that_of_their_series_and_a_named_demand():
    """A turn between instants counts, so that it is at least that of the series, by little."""
    system = two_decks("kelvin", True, FIRST)
    response = jp.simulate(system, (SHAKING, (1 - MOVED) * SHAKING), GRID)
    demand = response.demand
    for k, (link, scalars) in enumerate(zip(response.links, demand.links, strict=True)):
        series = float((link.gap - system.links[k].gap).max())
        assert series <= float(scalars.peak_opening) * (1 + 1e-12) < 1.002 * series
        assert named.value_of(system, demand, f"peak_opening_{k + 1}") > 0
    both = [float(x.peak_opening) for x in demand.links]
    assert float(demand.peak_opening) == max(both) > 1.5 * min(both)
    assert "peak_opening_2" in named.limitable_demands(system)
    assert jp.demand(two_decks("kelvin", True, G), AT_0, GRID).links[0].peak_opening is None
    rows = series_of(system, "peak_opening_2", pounding=False)
    np.testing.assert_array_equal([x.row for x in rows], [[0, 0, 0, 0, -1, 0, 0]])
    assert len(series_of(system, "peak_opening", pounding=False)) == 2


def test_a_slider_to_a_support_is_no_joint_that_opens():
    pier = jp.Building.from_period(mass=900e3, period=0.8, damping_ratio=0.05)
    joint = jp.FloorLink(0, 0, gap=0.05)
    slider = jp.FloorLink(0, 0, friction=1e4, next_building=jp.support(1))
    decks = jp.Buildings((pier, pier), (joint, slider), supports=(0, 1))
    wave = jp.travelling(jp.Pulse(0.3, 1.0, 2.0, time_unit="s"), 300.0, (0.0, 90.0))
    response = jp.simulate(decks, wave, jp.TimeGrid.until(5.0, 0.01))
    opening = [float(link.peak_opening) for link in response.demand.links]
    series = float((response.links[0].gap - 0.05).max())
    assert series <= opening[0] < 1.002 * series
    assert opening[1] == 0 < float(response.demand.links[1].slip_distance)
    assert float(response.demand.peak_opening) == opening[0]
    limitable = named.limitable_demands(decks.system())
    assert [x for x in limitable if x.startswith("peak_opening_")] == ["peak_opening_1"]
    assert len(series_of(decks.system(), "peak_opening", pounding=False)) == 1


def test_a_deck_that_sticks_to_a_support_moves_as_it_does():
    stuck = jp.System((2.0,), (jp.Rod(SPRING, 8.0, (0, G)),), [jp.Link((0, FIRST), 1e3)])
    response = jp.simulate(stuck, (AT_0, AT_1), GRID)
    deck, support = response.masses[0], response.supports[1]
    np.testing.assert_allclose(deck.x, support.displacement, atol=1e-12)
    np.testing.assert_allclose(deck.v, support.velocity, atol=1e-12)
    assert float(response.energy.relative_residual) < 2e-3


def test_drifts_of_rare_events_are_relative_to_the_support():
    rows = series_of(two_decks("kelvin", True, FIRST), "peak_drift_2", pounding=False)
    np.testing.assert_array_equal(rows[0].row, [0, 1, -1, 0, 0, 0, 0])


def test_a_ring_may_have_numbers_that_are_traced():
    ring = two_decks("kelvin", False, FIRST)
    changed = jax.eval_shape(lambda gap: parameters.put(ring, {"links.0.gap": gap}), 0.05)
    assert changed.topology == ring.topology


def test_soil_lies_on_the_support_of_its_building():
    frame = jp.ShearBuilding.from_period(2, 250e3, 0.5, 0.05)
    soil = jp.on_soil(frame, jp.Soil(150.0, 1800.0, 0.4), radius=6.0, footing_mass=250e3)
    topology = jp.Buildings((frame, soil), supports=(0, 1)).system().topology
    footing, rotation = topology.n_masses - 2, topology.n_masses - 1
    springs = [soil_spring(topology, mass) for mass in (footing, rotation)]
    assert [topology.rods[k] for k in springs] == [(footing, FIRST), (rotation, G)]
    assert rod_places(topology)[springs[0]].startswith("sway of building 2")


LINEAR = jp.ZenerRod(1.0, 0.03, 0.12)
MOVED = 1.7  # share of the ground's motion that support 1 moves the other way, relative to it
CONTACT = {"kelvin": jp.KelvinVoigt(150.0, 0.6), "newton": jp.Newton(0.6)}
CASES = [("kelvin", True), ("kelvin", False), ("newton", True)]


def two_decks(law, sliding, end, masses=(), rods=()):
    """Two decks, one on support 1, with a joint between them and one at its abutment.

    Without friction there is one at the other abutment, too, and joints close a ring.
    """
    stiffnesses = ((0, G), 5.0), ((1, end), 7.0), ((0, end), 1.0)
    rods = [*(jp.Rod(LINEAR, k, ends) for ends, k in stiffnesses), *rods]
    joints = [jp.Link((0, 1), 0.03 * sliding, 0.05, CONTACT[law])]
    joints.append(jp.Link((1, end), 0.02 * sliding, 0.04, CONTACT[law]))
    if not sliding:
        joints.append(jp.Link((G, 0), 0.0, 0.06, CONTACT[law]))
    shares = (1.0, 1.0, MOVED)[: 2 + len(masses)]
    return jp.System((1.0, 0.8, *masses), rods, joints, influence=shares)


def errors_of(law, sliding, steps=STEPS):
    """Of displacements, and of their derivative along a way of all numbers, at each step.

    The reference has a mass of 10¹⁰ in the place of support 1. By Newton's law it is the median of
    the derivative's (see ``test_weights``).
    """
    own = two_decks(law, sliding, FIRST)
    heavy = two_decks(law, sliding, 2, (1e10,), [jp.Rod(LINEAR, 1.0, (2, G))])
    way = relative_way(heavy, 1)
    path, slope, kinds = reference(heavy, way)
    assert kinds.count("touch") > 5
    leaves, n = jax.tree.leaves(way), 3 + 4 * len(own.rods)
    numbers = [*leaves[:2], *leaves[3:n], *leaves[n + 4 :]]  # without the mass and its rod
    way = jax.tree.unflatten(jax.tree.structure(own), numbers)
    size = (lambda z: np.median(np.abs(z))) if law == "newton" else np.linalg.norm
    wave, errors = jp.ground.SupportMotions((SHAKING, (1 - MOVED) * SHAKING)), []
    for step in steps:
        series = along(floats(own), floats(way), step / COARSE.dt, floats(wave))
        unit = round(COARSE.dt / step)
        x, along_way = (np.asarray(y)[unit::unit][: len(INSTANTS)] for y in series)
        of_path = np.linalg.norm(x - path[:, :2]) / np.linalg.norm(path[:, :2])
        errors.append((of_path, size(along_way - slope[:, :2]) / size(slope[:, :2])))
    return np.array(errors).T.tolist()


@pytest.mark.parametrize("case", CASES, ids=str)
def test_decks_that_pound_on_supports_that_move_apart_are_of_second_order(case):
    errors = np.array(errors_of(*case))
    assert (errors[:, 0] > 10 * errors[:, -1]).all(), errors  # 16 would be of second order
    assert (errors[:, -1] < (1e-3, 5e-3)).all(), errors


def gapless(number):
    return jp.Buildings((jp.Building(1e5, 1e7),), supports=(number,) * 2)


def isolated():
    frame = jp.ShearBuilding.from_period(2, 300e3, period=0.5, damping_ratio=0.03)
    base, links = jp.on_bearings(frame, jp.FrictionPendulum(2.24, 0.06), 350e3)
    return jp.Buildings((base,), links, supports=(1,))


def unnamed():
    rods = [jp.Rod(SPRING, 1.0, (0, G))]
    return jp.System((1.0,), rods, damping=[jp.Rod(jp.Dashpot(0.3), ends=(0, FIRST))])


test_wrong_supports_are_refused = refusals(
    (unnamed, r"damping.0.ends = \(0, -2\) must lead to a support that a rod or a link leads to"),
    (isolated, r"links.0.next_building = -1 must be support\(1\), on which bearings"),
    (jp.support, -1, "number = -1 must be a whole number from 0 on"),
    (jp.Rod, SPRING, 1.0, (FIRST, G), "must be two different masses"),
    (jp.simulate, deck(), (AT_0, AT_1, AT_2), GRID, "motions of 3 supports, must be of 2: struct"),
    (jp.demand, deck(), 2 * jp.ground.SupportMotions((AT_0,) * 3), GRID, "motions of 3 supports"),
    (jp.travelling, AT_0, 0.0, (0.0,), "velocity = 0 must be positive"),
    (jp.travelling, AT_0, 1.0, (0.0, -1.0), r"distances\[1\] = -1 must be finite and not negative"),
    (jp.travelling, (AT_0, AT_1), 1.0, (0.0, 1.0), "must be one motion"),
    (gapless, 1, r"supports = \(1, 1\) must be a whole number .* each of the 1 buildings"),
)
