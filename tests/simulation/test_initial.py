"""Runs that do not start at rest, against closed forms and runs from rest that are the same."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from tests.simulation.pairs import OneOf, in_unit_of_time

STILL = jp.Ricker(0.0, [1.0], [0.0])
ELASTIC = jp.ZenerRod(order=1.0, tau_f=0.1, tau_x=0.1)
SPRING = jp.Rod(ELASTIC, 1.0, (0, jp.GROUND))
ONE = jp.System(masses=(1.0,), rods=(SPRING,))


def order_of(errors):
    """Order of convergence of errors at steps that halve."""
    return np.diff(np.log2(errors))


def run(structures, dt, x=(), v=(), until=10.0, ground=STILL):
    grid = jp.TimeGrid.until(until, dt=dt)
    return jp.simulate(structures, ground, grid, initial=jp.InitialState(x, v))


def test_free_vibration():
    errors = []
    for dt in (0.1, 0.05, 0.025):
        found = run(ONE, dt, (0.3,), (0.2,))
        t, (mass,) = np.asarray(found.time), found.masses
        assert mass.x[0] == 0.3
        assert mass.v[0] == pytest.approx(0.2, abs=1e-15)
        x, v = 0.3 * np.cos(t) + 0.2 * np.sin(t), 0.2 * np.cos(t) - 0.3 * np.sin(t)
        peak = found.demand.masses[0].peak_x - np.hypot(0.3, 0.2)
        errors.append([np.abs(mass.x - x).max(), np.abs(mass.v - v).max(), abs(peak)])
    np.testing.assert_allclose(order_of(np.array(errors).T), -2, atol=0.15)
    assert np.max(errors[-1]) < 1e-4


def test_its_derivatives():
    grid = jp.TimeGrid.until(2.0, dt=0.02)

    def end(initial):
        return jp.simulate(ONE, STILL, grid, initial=initial).masses[0].x[-1]

    slopes = jax.grad(end)(jp.InitialState((0.3,), (0.2,)))
    assert slopes.displacements[0] == pytest.approx(np.cos(2.0), abs=1e-4)
    assert slopes.velocities[0] == pytest.approx(np.sin(2.0), abs=1e-4)


def coulomb(t, x, v, mu):
    """Oscillation with Coulomb friction: from turn to turn a cosine about −μ sign(v)."""
    found, start = np.full_like(t, np.nan), 0.0
    way = np.sign(v) if v else -np.sign(x)
    while v or abs(x) > mu:
        centre = -mu * way
        size, phase = np.hypot(x - centre, v), np.arctan2(-v, x - centre)
        lasts = (np.pi - phase) % np.pi or np.pi
        now = (t >= start) & (t <= start + lasts)
        found[now] = centre + size * np.cos(t[now] - start + phase)
        x, v = centre + size * np.cos(lasts + phase), 0.0
        start, way = start + lasts, -way
    return np.where(np.isnan(found), x, found), start


@pytest.mark.parametrize(("x", "v"), [(1.05, 0.0), (1.0, -0.3), (0.05, 0.3), (0.05, 0.01)])
def test_coulomb_decay(x, v):
    """Amplitudes fall by 4 μ a period, until the block sticks."""
    bearing = replace(ONE, links=(jp.Link((0, jp.GROUND), friction=0.1),))
    errors = []
    for dt in (0.05, 0.025, 0.0125):
        found = run(bearing, dt, (x,), (v,), until=18.0)
        exact, stops = coulomb(np.asarray(found.time), x, v, 0.1)
        errors.append(np.abs(found.masses[0].x - exact).max())
        phases = found.phases()
        assert phases[-1].kind == "stick"
        assert phases[-1].start == pytest.approx(stops, abs=dt / 5)
    assert errors[-1] < 5e-5
    assert errors[-1] < errors[0] / 8  # 16 times on average: where in a step events fall varies


def test_a_block_that_friction_holds_stays():
    bearing = replace(ONE, links=(jp.Link((0, jp.GROUND), friction=0.1),))
    found = run(bearing, 0.05, (0.09,))
    np.testing.assert_array_equal(found.masses[0].x, 0.09)
    assert found.demand.links[0].slip_distance == 0


@pytest.mark.parametrize("order", [0.5, 1.0])
def test_relaxed_rods_are_a_run_from_rest_under_a_constant_force(order):
    """x = x0 + y, with y from rest under the force −K x0."""
    rod = jp.Rod(jp.ZenerRod(order=order, tau_f=0.05, tau_x=0.8), 1.7, (0, jp.GROUND))
    structure, grid = jp.System(masses=(1.3,), rods=(rod,)), jp.TimeGrid.until(8.0, dt=0.04)
    found = jp.simulate(structure, STILL, grid, initial=jp.InitialState((0.4,)))
    same = jp.simulate(structure, lambda t: 0 * t + 1.7 * 0.4 / 1.3, grid)
    np.testing.assert_allclose(found.masses[0].x, 0.4 + same.masses[0].x, atol=1e-14)
    np.testing.assert_allclose(found.rods[0].force, 1.7 * 0.4 + same.rods[0].force, atol=1e-14)


SECOND = jp.Rod(ELASTIC, 1.0, (1, jp.GROUND))
LAW = jp.KelvinVoigt(stiffness=1e4, restitution=0.6)


def struck(contact):
    """Two equal oscillators with a gap between them."""
    link = jp.Link((0, 1), gap=0.2, contact=contact)
    return jp.System(masses=(1.0, 1.0), rods=(SPRING, SECOND), links=(link,))


@pytest.mark.parametrize(("contact", "within"), [(jp.Newton(0.6), 1e-4), (LAW, 1e-2)])
def test_a_collision_of_two_equal_blocks(contact, within):
    """The first swings at v; at the gap it gives the other (1 + e)/2 of its speed.

    A pad that cannot pull lets go a little earlier, and faster, than its restitution says.
    """
    found = run(struck(contact), 0.02, v=(0.5, 0.0), until=2.5)
    (impact,) = found.impacts()
    t = np.arcsin(0.4)
    speed = 0.5 * np.cos(t)
    assert impact.time == pytest.approx(t, abs=1e-4)
    assert impact.approach_velocity == pytest.approx(speed, rel=1e-3)
    assert impact.rebound_velocity == pytest.approx(0.6 * speed, rel=2e-3 + 6 * within)
    e = float(impact.rebound_velocity / speed)
    late = np.asarray(found.time) > t + 0.1
    since = np.asarray(found.time)[late] - t
    first = 0.2 * np.cos(since) + (1 - e) / 2 * speed * np.sin(since)
    second = (1 + e) / 2 * speed * np.sin(since)
    np.testing.assert_allclose(found.masses[0].x[late], first, atol=within)
    np.testing.assert_allclose(found.masses[1].x[late], second, atol=within)


def test_a_force_that_jumps_at_touch_has_its_peak_in_a_law_of_ones_own_too():
    """Strong damping: the force jumps, rises a little and falls."""
    law, grid = jp.KelvinVoigt(stiffness=1000.0, restitution=0.2), jp.TimeGrid.until(1.0, dt=0.05)
    push = jp.InitialState((), (0.5, 0.0))
    built_in, own = (
        jp.demand(struck(one), STILL, grid, initial=push) for one in (law, OneOf(0.0, (law,)))
    )
    assert own.peak_contact == pytest.approx(float(built_in.peak_contact), rel=1e-9)
    assert own.contact_work == pytest.approx(float(built_in.contact_work), rel=1e-3)


def test_a_row_with_friction_converges():
    """Links that share a mass: three blocks, pulled apart and let go with a push."""
    rods = tuple(jp.Rod(ELASTIC, k, (i, jp.GROUND)) for i, k in enumerate((1.0, 1.6, 0.7)))
    links = (jp.Link((0, 1), friction=0.05), jp.Link((1, 2), friction=0.1))
    row = jp.System(masses=(1.0, 0.8, 1.2), rods=rods, links=links)
    steps, until = np.array([0.04, 0.02, 0.01, 0.0025]), 6.0
    grid = jp.TimeGrid(steps[0], round(until / steps[-1]))

    @jax.jit
    @jax.vmap
    def paths(unit):
        push = tuple(unit * v for v in (0.0, 0.3, -0.1))
        initial = jp.InitialState((0.5, -0.2, 0.1), push)
        response = jp.simulate(*in_unit_of_time(unit, row, STILL), grid, initial=initial)
        return jnp.stack([mass.x for mass in response.masses])

    displacements = np.asarray(paths(steps / grid.dt))
    ends = [x[:, round(until / dt)] for x, dt in zip(displacements, steps, strict=True)]
    errors = [np.abs(end - ends[-1]).max() for end in ends[:-1]]
    assert errors[-1] < 3e-5
    assert errors[-1] < errors[0] / 8


def test_demand_batches_and_precisions():
    pair, grid = jp.paper.structures(), jp.TimeGrid.until(10.0, dt=0.05)
    ground = jp.paper.ground()

    def smallest(x):
        return jp.demand(pair, ground, grid, initial=jp.InitialState((x, 0.0))).min_gap

    starts = jnp.array([-0.3, 0.0, 0.2])
    found = jax.vmap(smallest)(starts)
    for x, one in zip(starts, found, strict=True):
        run = jp.simulate(pair, ground, grid, initial=jp.InitialState((float(x), 0.0)))
        assert run.min_gap == pytest.approx(float(one), abs=1e-12)
        assert run.demand.min_gap == pytest.approx(float(run.gap.min()), abs=2e-3)
        assert run.demand.min_gap <= run.gap.min() + 1e-12
    assert found[1] == pytest.approx(float(jp.demand(pair, ground, grid).min_gap), abs=1e-3)
    single = jax.tree.map(jnp.float32, jp.InitialState((0.2, 0.0), (0.0, 0.1)))
    structures, shaking = jax.tree.map(jnp.float32, (pair, ground))
    narrow = jp.demand(structures, shaking, grid, initial=single)
    wide = jp.demand(pair, ground, grid, initial=jp.InitialState((0.2, 0.0), (0.0, 0.1)))
    assert narrow.min_gap.dtype == jnp.float32
    assert narrow.min_gap == pytest.approx(float(wide.min_gap), abs=1e-4)


@pytest.mark.parametrize(
    ("initial", "message"),
    [
        (
            jp.InitialState((0.1,)),
            "initial: displacements of 1 numbers must be one number for each",
        ),
        (jp.InitialState((), (0.1,) * 3), "initial: velocities of 3 numbers must be"),
        (jp.InitialState((0.2, 0.0)), "initial: gap of 1–2, floor 1 = 0 must be open, and"),
        (
            jp.InitialState((0.1, 0.0), (9.0, 0.0)),
            "initial: gap of 1–2, floor 1 = 0.1 must be",
        ),
    ],
)
def test_states_that_no_run_can_start_from(initial, message):
    with pytest.raises(ValueError, match=message):
        jp.demand(struck(LAW), STILL, jp.TimeGrid(0.02, 10), initial=initial)
    with pytest.raises(ValueError, match=r"InitialState: displacements\.0 = nan must be finite"):
        jp.InitialState((np.nan, 0.0))


def test_a_traced_state_that_no_run_can_start_from_gives_nan():
    grid = jp.TimeGrid(0.02, 10)

    @jax.jit
    def smallest(x):
        return jp.demand(struck(LAW), STILL, grid, initial=jp.InitialState((x, 0.0))).min_gap

    assert np.isnan(smallest(0.3))
    assert np.isfinite(smallest(0.1))


@pytest.mark.parametrize(
    ("x", "v"), [((), (1.0, -1.0)), ((-0.3, 0.2), ()), ((0.1, 0.0), (0.5, 0.2))]
)
@pytest.mark.parametrize("contact", [None, jp.Newton(0.6), LAW], ids=["none", "newton", "kelvin"])
def test_the_energy_balance_begins_with_the_energy_at_the_start(x, v, contact):
    """Kinetic, and in relaxed rods, each ½ K x²; the ground does no work."""
    energy = run(struck(contact), 0.02, x, v).energy
    at_start = sum(0.5 * value**2 for value in (*x, *v))
    assert float(energy.initial) == pytest.approx(at_start, rel=1e-12)
    assert np.abs(energy.input).max() == 0
    spent = energy.kinetic + energy.rods + energy.contact_stored + energy.contact_lost
    np.testing.assert_allclose(spent, at_start, rtol=2e-3)
    assert 0 < energy.relative_residual < 2e-3


def test_a_run_that_its_step_does_not_resolve_is_warned_of():
    """A stiff block of which a step is a seventh of the period; at rest nothing is to be said."""
    stiff = replace(ONE, rods=(replace(SPRING, stiffness=900.0),))
    with pytest.warns(jp.PlausibilityWarning, match=r"the energy balance leaves 25 % of"):
        coarse = run(stiff, 0.03, v=(1.0,), until=0.9)
    fine = run(stiff, 0.005, v=(1.0,), until=0.9)
    shares = [float(response.energy.relative_residual) for response in (coarse, fine)]
    assert shares[0] == pytest.approx(36 * shares[1], rel=0.3)
    assert shares[1] < 0.01
    with pytest.raises(ValueError, match=r"^simulate: the energy balance leaves"):
        jp.simulate(
            *(stiff, STILL, jp.TimeGrid.until(0.9, dt=0.03)),
            initial=jp.InitialState((), (1.0,)),
            strict=True,
        )
    assert float(run(stiff, 0.03, until=0.9).energy.relative_residual) == 0
