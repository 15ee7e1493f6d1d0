"""Runs that do not start at rest, against closed forms and runs from rest that are the same."""

import base64
import pickle
import zlib
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from tests.reference import load
from tests.refusals import refusals
from tests.simulation.pairs import OneOf, displacements_in_units, in_unit_of_time

STILL = jp.Ricker(0.0, [1.0], [0.0])
ELASTIC = jp.ZenerRod(order=1.0, tau_f=0.1, tau_x=0.1)
SPRING = jp.Rod(ELASTIC, 1.0, (0, jp.GROUND))
ONE = jp.System(masses=(1.0,), rods=(SPRING,))
BEARING = replace(ONE, links=(jp.Link((0, jp.GROUND), friction=0.1),))
DECAY = jp.TimeGrid(0.05, 1440)


def run(structures, dt, x=(), v=(), until=10.0, ground=STILL, **options):
    grid = jp.TimeGrid.until(until, dt=dt)
    return jp.simulate(structures, ground, grid, initial=jp.InitialState(x, v), **options)


@partial(jax.jit, static_argnums=4)
def in_unit(unit, system, x, v, grid):
    """A free run in another unit of time, of which a step of the grid is ``unit`` times as long."""
    system, start = in_unit_of_time(unit, system, jp.InitialState((x,), (v,)))
    return jp.simulate(system, STILL, grid, initial=start)


def test_free_vibration_and_its_derivatives():
    errors, grid = [], jp.TimeGrid(0.1, 400)
    for dt in (0.1, 0.05, 0.025):
        response = in_unit(dt / grid.dt, ONE, 0.3, 0.2, grid)
        t = dt * np.arange(round(10.0 / dt) + 1)
        assert response.x1[0] == 0.3
        assert response.v1[0] == pytest.approx(0.2 * dt / grid.dt, abs=1e-15)
        x, v = 0.3 * np.cos(t) + 0.2 * np.sin(t), 0.2 * np.cos(t) - 0.3 * np.sin(t)
        moves, speed = response.x1[: t.size], response.v1[: t.size] * grid.dt / dt
        peak = response.demand.peak_x1 - np.hypot(0.3, 0.2)
        errors.append([np.abs(moves - x).max(), np.abs(speed - v).max(), abs(peak)])
    np.testing.assert_allclose(np.diff(np.log2(np.array(errors).T)), -2, atol=0.15)
    assert np.max(errors[-1]) < 1e-4
    of_start = jax.grad(lambda x, v: run(ONE, 0.02, (x,), (v,), 2.0).x1[-1], (0, 1))
    slopes = jax.jit(of_start)(0.3, 0.2)
    np.testing.assert_allclose(slopes, (np.cos(2.0), np.sin(2.0)), rtol=0, atol=1e-4)


def coulomb(t, x, v, mu):
    """Oscillation with Coulomb friction: from turn to turn a cosine about −μ sign(v)."""
    motion, start = np.full_like(t, np.nan), 0.0
    way = np.sign(v) if v else -np.sign(x)
    while v or abs(x) > mu:
        centre = -mu * way
        size, phase = np.hypot(x - centre, v), np.arctan2(-v, x - centre)
        lasts = (np.pi - phase) % np.pi or np.pi
        now = (t >= start) & (t <= start + lasts)
        motion[now] = centre + size * np.cos(t[now] - start + phase)
        x, v = centre + size * np.cos(lasts + phase), 0.0
        start, way = start + lasts, -way
    return np.where(np.isnan(motion), x, motion), start


@pytest.mark.parametrize(("x", "v"), [(1.05, 0.0), (1.0, -0.3), (0.05, 0.3), (0.05, 0.01)])
def test_coulomb_decay(x, v):
    """Amplitudes fall by 4 μ a period, until the block sticks."""
    errors = []
    for dt in (0.05, 0.025, 0.0125):
        response = in_unit(dt / DECAY.dt, BEARING, x, v, DECAY)
        exact, stops = coulomb(dt * np.arange(DECAY.n_steps + 1), x, v, 0.1)
        errors.append(np.abs(response.x1 - exact).max())
        last = response.phases()[-1]
        assert last.kind == "stick"
        assert last.start * dt / DECAY.dt == pytest.approx(stops, abs=dt / 5)
    assert errors[-1] < 5e-5
    assert errors[-1] < errors[0] / 8  # 16 times on average: where in a step events fall varies


def test_a_block_that_friction_holds_stays():
    response = in_unit(1.0, BEARING, 0.09, 0.0, DECAY)
    np.testing.assert_array_equal(response.masses[0].x, 0.09)
    assert response.demand.links[0].slip_distance == 0


@pytest.mark.parametrize("order", [0.5, 1.0])
def test_relaxed_rods_are_a_run_from_rest_under_a_constant_force(order):
    """x = x0 + y, with y from rest under the force −K x0."""
    rod = jp.Rod(jp.ZenerRod(order=order, tau_f=0.05, tau_x=0.8), 1.7, (0, jp.GROUND))
    structure = jp.System(masses=(1.3,), rods=(rod,))
    response = run(structure, 0.04, (0.4,), until=8.0)
    same = jp.simulate(structure, lambda t: 0 * t + 1.7 * 0.4 / 1.3, jp.TimeGrid.until(8.0, 0.04))
    np.testing.assert_allclose(response.x1, 0.4 + same.x1, atol=1e-14)
    np.testing.assert_allclose(response.f1, 1.7 * 0.4 + same.f1, atol=1e-14)


LAW = jp.KelvinVoigt(stiffness=1e4, restitution=0.6)


def struck(contact):
    rods = (SPRING, replace(SPRING, ends=(1, jp.GROUND)))
    return jp.System((1.0, 1.0), rods, (jp.Link((0, 1), gap=0.2, contact=contact),))


@pytest.mark.parametrize(("contact", "within"), [(jp.Newton(0.6), 1e-4), (LAW, 1e-2)])
def test_a_collision_of_two_equal_blocks(contact, within):
    """The other gets (1 + e)/2 of the first's speed; a pad lets go a little earlier, and faster."""
    response = run(struck(contact), 0.02, (0.0, 0.0), (0.5, 0.0))
    impact, after, *_ = response.impacts()
    assert after.time > 2.5
    t = np.arcsin(0.4)
    speed = 0.5 * np.cos(t)
    assert impact.time == pytest.approx(t, abs=1e-4)
    assert impact.approach_velocity == pytest.approx(speed, rel=1e-3)
    assert impact.rebound_velocity == pytest.approx(0.6 * speed, rel=2e-3 + 6 * within)
    e, time = float(impact.rebound_velocity / speed), np.asarray(response.time)
    between = (time > t + 0.1) & (time <= 2.5)
    since = time[between] - t
    first = 0.2 * np.cos(since) + (1 - e) / 2 * speed * np.sin(since)
    second = (1 + e) / 2 * speed * np.sin(since)
    np.testing.assert_allclose(response.x1[between], first, atol=within)
    np.testing.assert_allclose(response.x2[between], second, atol=within)


def test_a_force_that_jumps_at_touch_has_its_peak_in_a_law_of_ones_own_too():
    """Strong damping: the force jumps, rises a little and falls."""
    law, push = jp.KelvinVoigt(stiffness=1000.0, restitution=0.2), ((0.0, 0.0), (0.5, 0.0))
    laws = OneOf(0.0, (law,)), law
    written, built_in = (run(struck(contact), 0.02, *push).demand for contact in laws)
    assert written.peak_contact == pytest.approx(float(built_in.peak_contact), rel=1e-9)
    assert written.contact_work == pytest.approx(float(built_in.contact_work), rel=1e-3)


def test_a_row_with_friction_converges():
    """Links that share a mass: three blocks, pulled apart and let go with a push."""
    rods = tuple(jp.Rod(ELASTIC, k, (i, jp.GROUND)) for i, k in enumerate((1.0, 1.6, 0.7)))
    row = jp.System((1.0, 0.8, 1.2), rods, (jp.Link((0, 1), 0.05), jp.Link((1, 2), 0.1)))
    steps, until = (0.04, 0.02, 0.01, 0.0025), 6.0
    start = jp.InitialState((0.5, -0.2, 0.1), (0.0, 0.3, -0.1))
    displacements = displacements_in_units(row, steps, until, STILL, start)
    ends = [x[:, round(until / dt)] for x, dt in zip(displacements, steps, strict=True)]
    errors = [np.abs(end - ends[-1]).max() for end in ends[:-1]]
    assert errors[-1] < 3e-5
    assert errors[-1] < errors[0] / 8


def test_demand_batches_and_precisions():
    grid, case = jp.TimeGrid.until(10.0, dt=0.05), (jp.paper.structures(), jp.paper.ground())

    def smallest_from(initial, case=case):
        return jp.demand(*case, grid, initial=initial, only=("min_gap",)).min_gap

    starts = np.array([-0.3, 0.0, 0.2])
    gaps = jax.jit(jax.vmap(lambda x: smallest_from(jp.InitialState((x, 0.0)))))(starts)
    for x, gap in zip(starts, gaps, strict=True):
        response = run(case[0], 0.05, (float(x), 0.0), ground=case[1])
        assert response.min_gap == pytest.approx(float(gap), abs=1e-12)
        assert response.demand.min_gap == pytest.approx(float(response.gap.min()), abs=2e-3)
        assert response.demand.min_gap <= response.gap.min() + 1e-12
    assert gaps[1] == pytest.approx(float(smallest_from(None)), abs=1e-3)
    double = jp.InitialState((0.2, 0.0), (0.0, 0.1)), case
    wide, narrow = (smallest_from(*x) for x in (double, jax.tree.map(np.float32, double)))
    assert narrow.dtype == jnp.float32
    assert narrow == pytest.approx(float(wide), abs=1e-4)


def run_from(*initial):
    grid = jp.TimeGrid(0.02, 10)
    initial = jp.InitialState(*initial)
    return jp.demand(struck(LAW), STILL, grid, initial=initial, only=("min_gap",)).min_gap


test_states_that_no_run_can_start_from = refusals(
    ((0.1,), "initial: displacements of 1 numbers must be one number for each"),
    ((), (0.1,) * 3, "initial: velocities of 3 numbers must be"),
    ((0.2, 0.0), "initial: gap of 1–2, floor 1 = 0 must be open, and"),
    ((0.1, 0.0), (9.0, 0.0), "initial: gap of 1–2, floor 1 = 0.1 must be"),
    ((np.nan, 0.0), r"InitialState: displacements\.0 = nan must be finite"),
    of=run_from,
)


def test_a_traced_state_that_no_run_can_start_from_gives_nan():
    smallest = jax.jit(lambda x: run_from((x, 0.0)))
    assert np.isnan(smallest(0.3))
    assert np.isfinite(smallest(0.1))


energy_of = jax.jit(lambda response: response.energy)

STARTS = [((0.0, 0.0), (1.0, -1.0)), ((-0.3, 0.2), (0.0, 0.0)), ((0.1, 0.0), (0.5, 0.2))]


@pytest.mark.parametrize(("x", "v"), STARTS)
@pytest.mark.parametrize("contact", [None, jp.Newton(0.6), LAW], ids=["none", "newton", "kelvin"])
def test_the_energy_balance_begins_with_the_energy_at_the_start(x, v, contact):
    """Kinetic, and in relaxed rods, each ½ K x²; the ground does no work."""
    energy = energy_of(run(struck(contact), 0.02, x, v))
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
        run(stiff, 0.03, v=(1.0,), until=0.9, strict=True)
    assert float(run(stiff, 0.03, v=(0.0,), until=0.9).energy.relative_residual) == 0


@pytest.mark.parametrize(("case", "impacts"), [(0, 0), (1, 7)], ids=["pair", "between walls"])
def test_a_pickled_response_of_an_earlier_version_is_still_what_a_run_gives(case, impacts):
    pickled = zlib.decompress(base64.b85decode(load("earlier")["pickle"]))
    system, ground, grid, start, earlier = pickle.loads(pickled)[case]
    response = jp.simulate(system, ground, grid, initial=start)
    assert jax.tree.structure(response) == jax.tree.structure(earlier)
    leaves = jax.tree_util.tree_leaves_with_path(earlier)
    for (path, wanted), value in zip(leaves, jax.tree.leaves(response), strict=True):
        name = jax.tree_util.keystr(path)
        np.testing.assert_allclose(value, wanted, rtol=1e-10, atol=1e-10, err_msg=name)
    assert len(earlier.impacts()) == impacts
    kinds = ([phase.kind for phase in x.phases(0)] for x in (earlier, response))
    assert len({*map(tuple, kinds)}) == 1
