"""Buildings in SI units, the dimensionless system of eq. (9), and results back in SI."""

import dataclasses
import itertools
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import jaxpound as jp
from jaxpound.model.contact import with_mass
from tests.made import in_si, log_uniform
from tests.model.test_system import KnownCushion
from tests.refusals import refusals, refused

BUILDING_1 = jp.Building(2.0e5, 8.0e6, 0.4, 0.01, 0.15)
BUILDING_2 = jp.Building(1.3e5, 9.0e6, 0.7, 0.02, 0.20)
SLIP_FORCE, GAP = 6.0e4, 0.05
DT, N_SAMPLES = 0.01, 500

masses, stiffnesses, orders = log_uniform(1.0, 1e7), log_uniform(1.0, 1e10), st.floats(0.01, 1.0)
buildings = st.builds(
    lambda m, k, order, tau_f, ratio: jp.Building(m, k, order, tau_f, tau_f * ratio),
    *(masses, stiffnesses, orders, log_uniform(1e-4, 1.0), log_uniform(1.0, 1e4)),
)


def ground(gravity=jp.STANDARD_GRAVITY, sign=1.0):
    """A swept sine of up to 3 m/s², as a record in units of ``gravity``."""
    t = DT * np.arange(N_SAMPLES)
    shaking = 3.0 * np.sin(2 * np.pi * (0.6 + 0.2 * t) * t) * np.sin(np.pi * t / t[-1])
    return jp.Record(sign * shaking / gravity, DT, "sweep", units="g")


def dimensionless(first, second, friction, gap, gravity=jp.STANDARD_GRAVITY, contact=None):
    link = jp.FloorLink(0, 0, friction=friction, gap=gap, contact=contact)
    return jp.Buildings((first, second), (link,), gravity).dimensionless()


def run(building_1, building_2, friction, gap, gravity=jp.STANDARD_GRAVITY, sign=1.0):
    structures, scales = dimensionless(building_1, building_2, friction, gap, gravity)
    record = scales.to_dimensionless(ground(gravity, sign))
    response = jp.simulate(structures, record, scales.grid(5.0, 0.01))
    return response, scales, scales.to_si(response)


@cache
def sliding(friction_force=SLIP_FORCE):
    return run(BUILDING_1, BUILDING_2, friction_force, GAP)


def assert_close(actual, expected, rel):
    """Within ``rel`` of the largest value."""
    np.testing.assert_allclose(actual, expected, rtol=0, atol=rel * np.abs(expected).max())


@pytest.mark.filterwarnings("ignore::jaxpound.PlausibilityWarning")  # of floors of 4 kg
def test_dimensionless_system_by_hand():
    first = jp.Building(mass=4, stiffness=16, order=0.5, tau_f=0.1, tau_x=3)
    second = jp.Building(mass=2, stiffness=8, order=1, tau_f=0.2, tau_x=1.5)
    row, scales = dimensionless(first, second, friction=10, gap=5, gravity=10)
    system = row.system()
    (rod_1, rod_2), (link,) = system.rods, system.links
    # ω1 = 2, so time is in 1/2 s, length in 10/4 m, force in 40 N.
    assert (scales.frequency, scales.time, scales.length, scales.force) == (2.0, 0.5, 2.5, 40.0)
    assert (scales.mass, scales.gravity) == (4.0, 10.0)
    assert (system.masses, rod_1.stiffness, rod_2.stiffness) == ((1.0, 0.5), 1.0, 0.5)
    assert (link.friction, link.gap) == (0.25, 2.0)
    assert rod_1.material.tau_f == pytest.approx(0.1 * 2**0.5, rel=1e-15)
    assert rod_1.material.tau_x == pytest.approx(3 * 2**0.5, rel=1e-15)
    assert (rod_1.material.order, rod_2.material.order) == (0.5, 1.0)
    # Both rods are timed by building 1: τ̄ = τ ω1^β.
    assert (rod_2.material.tau_f, rod_2.material.tau_x) == (0.4, 3.0)


@pytest.mark.filterwarnings("ignore::jaxpound.PlausibilityWarning")  # of any period
@given(buildings, buildings, log_uniform(1.0, 1e7), st.floats(0, 1), st.floats(1, 20))
def test_buildings_survive_the_round_trip_with_their_periods(first, second, force, gap, gravity):
    row, scales = dimensionless(first, second, force, gap, gravity)
    system = row.system()
    (mass_1, mass_2), (rod_1, rod_2), (link,) = system.masses, system.rods, system.links
    ratios = mass_1 / mass_2, rod_2.stiffness / rod_1.stiffness
    between = *ratios, link.friction, link.gap
    structures = jp.AdjacentStructures(rod_1.material, rod_2.material, *between)
    pair = in_si(structures, scales)
    vibrations = zip(structures.natural_frequencies, structures.damping_ratios, strict=True)
    for before, after, (omega, zeta) in zip(
        (first, second), pair.buildings, vibrations, strict=True
    ):
        numbers = map(jax.tree.leaves, (after, before))
        assert next(numbers) == pytest.approx(next(numbers), rel=1e-12)
        period = 2 * np.pi / (float(omega) * scales.frequency)
        assert before.natural_period == pytest.approx(period, rel=1e-9)
        assert before.damping_ratio == pytest.approx(float(zeta), rel=1e-6, abs=1e-12)
    assert (pair.links[0].friction, pair.links[0].gap) == pytest.approx((force, gap), rel=1e-12)


LAWS = [jp.Newton(0.65), jp.KelvinVoigt(1.6e9, 0.65, tension=True), jp.Hertz(3e9)]
LAWS += [jp.HertzDamped(3e9, 0.65, "ye"), jp.Jankowski(3e9, 0.65)]


@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_a_contact_law_keeps_its_force_in_other_units(law):
    row, scales = dimensionless(BUILDING_1, BUILDING_2, SLIP_FORCE, GAP, contact=law)
    other = row.links[0].contact
    assert jax.tree.structure(other) == jax.tree.structure(law)
    back = scales.contact_to_si(other)
    assert jax.tree.leaves(back) == pytest.approx(jax.tree.leaves(law), rel=1e-14)
    if isinstance(law, jp.Newton):
        assert other.restitution == 0.65
        return
    state = np.array([0.002, 0.3, 0.5])
    units = np.array([scales.length, *[scales.length / scales.time] * 2])
    force = with_mass(law, 8e4).force(*state)
    same = with_mass(other, 8e4 / scales.mass).force(*state / units)
    assert same * scales.force == pytest.approx(float(force), rel=1e-13)


def test_contact_stiffness_goes_with_the_scales_and_units_of_other_laws_are_not_guessed():
    scales = jp.Scales(mass=4.0, frequency=2.0, gravity=10.0)
    # m1 ω1² = 16 N/m, and m1 g / (g/ω1²)^1.5 = 40 / 2.5^1.5 N/m^1.5.
    assert scales.contact_to_si(jp.KelvinVoigt(2.0, 0.5)).stiffness == 32.0
    hertz = scales.contact_to_si(jp.Hertz(2.0)).stiffness
    assert hertz == pytest.approx(80 / 2.5**1.5, rel=1e-14)
    slope = jax.grad(lambda s: s.contact_to_si(jp.KelvinVoigt(3.0, 0.5)).stiffness)(scales)
    assert slope.frequency == pytest.approx(2 * 3 * 4 * 2, rel=1e-14)
    assert scales.contact_to_si(None) is None
    scales, rule = jp.Scales(1e5, 4.0), "must be a law of this package: the units of a law of one's"
    for law in (KnownCushion(1.0), with_mass(jp.KelvinVoigt(1.0, 0.5), 1.0)):
        refused(rf"Scales.contact_to_si: law = .* {rule}", scales.contact_to_si, law)
    for law in (3.0, jp.Newton, BUILDING_1):
        refused(r"law = .* must be of type ContactLaw or Newton", scales.contact_to_si, law)
    own = partial(dimensionless, BUILDING_1, BUILDING_2, 6e4, 0.1, contact=KnownCushion(1.0))
    refused(rf"^Buildings\.dimensionless: links\.0\.contact = .* {rule}", own)


def test_dimensionless_is_differentiable_and_batched():
    def friction(mass):
        building = dataclasses.replace(BUILDING_1, mass=mass)
        return dimensionless(building, BUILDING_2, SLIP_FORCE, GAP)[0].links[0].friction

    # μ = F / (m1 g)
    expected = SLIP_FORCE / (2e5 * jp.STANDARD_GRAVITY)
    assert friction(2e5) == pytest.approx(expected, rel=1e-15)
    assert jax.grad(friction)(2e5) == pytest.approx(-expected / 2e5, rel=1e-12)
    batch = jax.vmap(friction)(jnp.array([2e5, 4e5]))
    np.testing.assert_allclose(batch, [expected, expected / 2], rtol=1e-14)


test_buildings_and_their_links_refuse_bad_values = refusals(
    ({"first": None}, r"buildings\.0 = None must be of type ShearBuilding or Building"),
    ({"second": 3.0}, r"buildings\.1 = 3\.0 must be of type ShearBuilding or Building"),
    ({"friction": -1.0}, "friction = -1 must be finite and not negative"),
    ({"friction": "x"}, "friction = 'x' must be a real number"),
    ({"gap": -0.1}, r"gap = -0\.1 must be not negative"),
    ({"gap": np.nan}, "gap = nan must be"),
    ({"gap": [0.1, -0.2]}, r"gap = -0\.2 \(at index \[1\]\)"),
    ({"gap": None}, "gap = None must be a real number"),
    ({"gravity": 0}, "gravity = 0 must be positive and finite"),
    ({"gravity": "g"}, "gravity = 'g' must be a real number"),
    ({"contact": 0.65}, r"contact = 0\.65 must be of type ContactLaw or Newton or None"),
    of=lambda changes: dimensionless(
        **{"first": BUILDING_1, "second": BUILDING_2, "friction": 6e4, "gap": 0.1, **changes}
    ),
)

test_building_refuses_bad_values = refusals(
    ({"mass": 0}, "Building: mass = 0 must be positive and finite"),
    ({"mass": None}, "Building: mass = None must be a real number"),
    ({"mass": [1.0, np.nan]}, r"Building: mass = nan \(at index \[1\]\)"),
    ({"stiffness": -1.0}, "Building: stiffness = -1 must be positive and finite"),
    ({"stiffness": np.inf}, "Building: stiffness = inf must be positive"),
    ({"order": 2}, r"order = 2 must be in \(0, 1\]"),
    ({"tau_f": 0}, "tau_f = 0 must be positive"),
    ({"tau_x": 0.001}, r"tau_x = 0\.001 must be finite and at least tau_f = 0\.01"),
    ({"mass": [1.0, 2.0], "tau_x": [1.0] * 3}, r"Building: the shapes of mass \(2,\), .*batch"),
    of=lambda changes: dataclasses.replace(BUILDING_1, **changes),
)

shares, reaches = st.just(0.0) | st.floats(0.0, 0.9), st.none() | log_uniform(1e-3, 1.0)


@given(log_uniform(1.0, 1e8), log_uniform(0.05, 20.0), shares, st.floats(0.05, 1.0), reaches)
def test_building_from_period_has_that_period_and_damping(mass, period, share, order, reach):
    omega = 2 * np.pi / period
    tau_f = None if reach is None else reach / omega**order
    theta = np.pi / 2 * order
    zeta = share * largest_damping(theta, 0.01 if reach is None else reach)
    building = jp.Building.from_period(mass, period, zeta, order, tau_f)
    assert building.natural_period == pytest.approx(period, rel=1e-8)
    assert building.damping_ratio == pytest.approx(zeta, rel=1e-8, abs=1e-13)
    assert building.dynamic_stiffness == pytest.approx(mass * omega**2, rel=1e-8)
    assert building.mass == mass


def largest_damping(theta, reach):
    """Half the loss factor of z / (1 + reach z), z = e^iθ: the limit of a rod for τ_x → ∞."""
    z = np.exp(1j * theta)
    limit = z / (1 + reach * z)
    return limit.imag / limit.real / 2


def test_unattainable_damping_is_refused_with_the_largest_or_spoils_the_run():
    largest = largest_damping(np.pi / 4, 0.01)
    with_damping = partial(jp.Building.from_period, 1e5, 1.0)
    refused(rf"damping_ratio = 0\.6 .* can give, {largest:.8g}", with_damping, 0.6)
    refused("damping_ratio = ", with_damping, 1.0001 * largest)
    with_damping(0.9999 * largest)
    says = rf"= 0\.4 \(at index \[1\]\) .* can give, {largest_damping(0.15 * np.pi, 0.01):.8g}"
    refused(says, with_damping, [0.1, 0.4, 0.1], [0.9, 0.3, 0.5])

    @jax.jit
    def smallest_gap(damping):
        building = jp.Building.from_period(1e5, 1.0, damping)
        structures, _ = dimensionless(building, building, 0.0, 0.05)
        return jp.demand(structures, jp.Ricker(0.1, 2.0, 1.0), jp.TimeGrid(0.02, 50)).min_gap

    assert jnp.isfinite(smallest_gap(0.05))
    assert jnp.isnan(smallest_gap(0.6))
    of_mass = jax.jit(lambda mass: jp.Building.from_period(mass, 1.0, 0.6))
    refused(r"damping_ratio = 0\.6", of_mass, 1e5)


def test_buildings_from_periods_come_in_batches_and_are_differentiable():
    periods, dampings = [0.5, 1.0, 2.0], [0.02, 0.05, 0.0]
    batch = jp.Building.from_period(1e5, periods, dampings)
    np.testing.assert_allclose(batch.natural_period, periods, rtol=1e-12)
    np.testing.assert_allclose(batch.damping_ratio, dampings, rtol=1e-12, atol=1e-15)
    of_mass = jax.jit(jax.vmap(partial(jp.Building.from_period, 1e5)))
    mapped = of_mass(np.array(periods), np.array(dampings))
    np.testing.assert_allclose(mapped.stiffness, batch.stiffness, rtol=1e-12)
    np.testing.assert_allclose(mapped.tau_x, batch.tau_x, rtol=1e-12)

    def stiffness(period):
        return jp.Building.from_period(1e5, period, 0.05).stiffness

    # With τ_f ω^γ fixed the period only scales time: k ∝ 1/T².
    assert jax.grad(stiffness)(2.0) == pytest.approx(-2 * stiffness(2.0) / 2.0, rel=1e-12)


test_building_from_period_refuses_bad_values = refusals(
    ((0, 1, 0.05), "mass = 0 must be positive and finite"),
    ((1, -1, 0.05), "period = -1 must be positive and finite"),
    ((1, "1", 0.05), "period = '1' must be a real number"),
    ((1, 1, -0.05), r"damping_ratio = -0\.05 must be finite and not negative"),
    ((1, 1, np.nan), "damping_ratio = nan must be finite"),
    ((1, 1, "five"), "damping_ratio = 'five' must be a real number"),
    ((1, 1, 0.05, 0), r"order = 0 must be in \(0, 1\]"),
    ((1, 1, 0.05, 1.2), r"order = 1\.2 must be in \(0, 1\]"),
    ((1, 1, 0.05, "x"), "order = 'x' must be a real number"),
    ((1, 1, 0.05, 0.5, 0), "tau_f = 0 must be positive"),
    ((1, 1, 0.05, 0.5, "x"), "tau_f = 'x' must be a real number"),
    ((1, [1, 2], [0.05] * 3), r"period \(2,\), damping_ratio \(3,\)"),
    of=lambda arguments: jp.Building.from_period(*arguments),
)


def test_every_series_of_a_response_has_its_unit():
    response, scales, si = sliding()
    speed = scales.length / scales.time
    factors = {"ground_acceleration": scales.gravity, "phase": 1.0}
    factors |= dict.fromkeys(("time", "change_time"), scales.time)
    factors |= dict.fromkeys(("x1", "x2", "gap"), scales.length)
    factors |= dict.fromkeys(("v1", "v2", "ground_velocity", "slip_velocity"), speed)
    factors |= dict.fromkeys(("f1", "f2", "friction"), scales.force)
    factors |= dict.fromkeys(("mass_1", "mass_2"), scales.mass)
    flat = {x for _, names in response.columns() for x in names if getattr(response, x) is not None}
    flat |= {"time", "ground_acceleration", "ground_velocity"}
    assert flat == factors.keys()  # those of contact: tests/results/test_demand.py
    for name, factor in factors.items():
        expected = factor * getattr(response, name)
        np.testing.assert_allclose(getattr(si, name), expected, rtol=1e-14, err_msg=name)
    assert (response.si, si.si) == (False, True)
    assert si.method == response.method
    # The factor of each: test_quantities.py.
    assert si.demand.scalars() == scales.to_si(response.demand).scalars()


def mean_shaking(si):
    """Mean over a step of the record, whose straight lines join the instants of the grid."""
    u = np.asarray(si.ground_acceleration)
    return np.r_[0, (u[:-2] + 6 * u[1:-1] + u[2:]) / 8, 0]


def test_blocks_obey_newton_in_si_and_dampers_pull_with_their_slip_force():
    _, _, si = sliding(0.0)
    for i, building in enumerate((BUILDING_1, BUILDING_2)):
        inertia = building.mass * (np.diff(si.masses[i].x, 2) / DT**2 + mean_shaking(si)[1:-1])
        assert_close(inertia, -si.rods[i].force[1:-1], rel=1e-9)
        assert_close(si.absolute_accelerations[i][1:-1], inertia / building.mass, rel=1e-9)
    _, _, si = sliding()
    assert np.abs(si.friction).max() == pytest.approx(SLIP_FORCE, rel=1e-12)
    # Where it slips throughout, the block's own motion tells the force as well.
    slips = np.abs(np.convolve(si.phase, np.ones(5) / 5, "same")) == 1
    acceleration = np.pad(np.diff(si.x1, 2) / DT**2, 1)
    pull = -BUILDING_1.mass * (acceleration + mean_shaking(si)) - si.f1
    assert slips.sum() > 100
    np.testing.assert_allclose(np.abs(pull[slips]), SLIP_FORCE, rtol=1e-6)


def test_gap_ground_energies_and_phases_are_in_si_and_not_converted_twice():
    response, scales, si = sliding()
    assert si.gap[0] == pytest.approx(GAP, rel=1e-14)
    np.testing.assert_allclose(si.gap, GAP + si.x2 - si.x1, atol=1e-12)
    shaking = ground().samples * jp.STANDARD_GRAVITY
    np.testing.assert_allclose(si.ground_acceleration[:N_SAMPLES], shaking, atol=1e-9)
    assert si.time[-1] == pytest.approx(5.0)
    for result in (si, si.demand):
        refused("to_si: result must be dimensionless", scales.to_si, result)
    energy = si.energy
    kinetic = BUILDING_1.mass * si.v1**2 / 2 + BUILDING_2.mass * si.v2**2 / 2
    assert_close(energy.kinetic, kinetic, rel=1e-12)
    assert_close(energy.friction[-1], si.demand.friction_work, rel=1e-3)
    assert_close(si.demand.friction_work, SLIP_FORCE * si.demand.slip_distance, rel=1e-2)
    assert np.abs(energy.residual).max() < 5e-3 * energy.input.max()
    for term, dimensionless in zip(energy, response.energy, strict=True):
        expected = dimensionless * scales.force * scales.length
        np.testing.assert_allclose(term, expected, rtol=1e-9, atol=1e-9 * energy.input.max())
    for before, after in zip(response.phases(), si.phases(), strict=True):
        assert after.kind == before.kind
        assert after.end == pytest.approx(before.end * scales.time, rel=1e-12)


def test_batches_of_results_are_converted():
    structures, scales = dimensionless(BUILDING_1, BUILDING_2, SLIP_FORCE, GAP)
    grid, shaking = scales.grid(0.5, 0.01), scales.to_dimensionless(ground())

    def respond(factor):
        response = jp.simulate(structures, factor * shaking, grid)
        return response, scales.to_si(response)

    together, inside = jax.vmap(respond)(jnp.array([1.0, 2.0]))
    together = scales.to_si(together)
    assert together.x1.shape == (2, 51)
    assert inside.si
    np.testing.assert_allclose(together.x1, inside.x1, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(together.demand.peak_f1, inside.demand.peak_f1, rtol=1e-12)
    np.testing.assert_allclose(together.mass_1, [2e5, 2e5], rtol=1e-15)


def test_gravity_only_sets_the_scale_and_either_building_may_set_it():
    _, _, si = sliding()
    _, _, other = run(BUILDING_1, BUILDING_2, SLIP_FORCE, GAP, gravity=1.7)
    for name in ("x1", "x2", "v1", "v2", "f1", "f2", "friction", "gap", "ground_acceleration"):
        assert_close(getattr(other, name), getattr(si, name), rel=1e-8)
    for name, value in si.demand.scalars().items():
        assert other.demand.scalars()[name] == pytest.approx(float(value), rel=1e-8), name
    # Seen from the other side of the street the ground moves the other way.
    _, _, mirrored = run(BUILDING_2, BUILDING_1, SLIP_FORCE, GAP, sign=-1.0)
    for kind, (i, j) in itertools.product("xvf", ((1, 2), (2, 1))):
        assert_close(getattr(mirrored, f"{kind}{i}"), -getattr(si, f"{kind}{j}"), rel=1e-7)
    assert_close(mirrored.gap, si.gap, rel=1e-7)
    assert_close(mirrored.friction, si.friction, rel=1e-7)
    assert mirrored.min_gap == pytest.approx(float(si.min_gap), rel=1e-6)


def test_grids_and_records_keep_their_acceleration_and_scale_their_time():
    scales = jp.Scales(mass=1e5, frequency=4.0)
    grid = scales.grid(10.0, 0.01)
    assert grid == jp.TimeGrid(0.04, 1000)
    assert grid.duration * scales.time == pytest.approx(10.0)
    assert scales.grid(10, 1).n_steps == 10
    batch = jp.Scales(1e5, [4.0, 5.0])
    refused(r"frequency of shape \(2,\) must be one number", batch.grid, 10.0, 0.01)
    refused("cannot be traced", jax.jit(lambda scales: scales.grid(10.0, 0.01)), scales)
    record = ground()
    other = scales.to_dimensionless(record)
    np.testing.assert_array_equal(other.samples, record.samples)
    assert jp.pga(other) == jp.pga(record)
    assert other.duration == pytest.approx(4.0 * record.duration)
    assert (other.name, other.time_unit, record.time_unit) == ("sweep", "1/ω1", "s")
    assert other.acceleration(4.0 * 1.234) == pytest.approx(float(record.acceleration(1.234)))


test_grid_refuses_bad_values_in_the_users_units = refusals(
    (-1.0, 0.01, "duration = -1 must be positive and finite"),
    (np.inf, 0.01, "duration = inf must be positive and finite"),
    ("10", 0.01, "duration = '10' must be a real number"),
    (10.0, 0, "dt = 0 must be positive and finite"),
    (10.0, None, "dt = None must be a real number"),
    (10.0, [0.1, 0.2], r"dt of shape \(2,\) must be one number"),
    of=jp.Scales(1e5, 4.0).grid,
    before=r"Scales\.grid: ",
)


def test_scales_refuse_bad_values_and_conversions_name_the_type_they_take():
    values = {"mass": 1e5, "frequency": 4.0, "gravity": 9.81}
    for name, bad in itertools.product(values, (0, -1.0, np.nan, np.inf, None, "1")):
        refused(f"Scales: {name} = ", jp.Scales, **(values | {name: bad}))
    types = {"to_si": "result = .* must be of type Response or Demand"}
    types |= {"to_dimensionless": "record = .* must be of type Record"}
    for method, bad in itertools.product(types, (None, 3.0, np.ones(3), BUILDING_1)):
        refused(f"Scales.{method}: {types[method]}", getattr(jp.Scales(1e5, 4.0), method), bad)
