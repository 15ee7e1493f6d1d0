"""Systems of masses, rods and links, against references that know nothing of steps."""

import dataclasses
import math
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from tests.reference import convergence_order
from tests.refusals import refused
from tests.simulation.pairs import SHAKING as GROUND
from tests.simulation.pairs import in_unit_of_time

STEEL = jp.ZenerRod(0.5, 0.01, 0.05)
RUBBER = jp.ZenerRod(0.8, 0.05, 0.4)
ELASTIC = jp.ZenerRod(0.5, 0.1, 0.1)
END = 12.0
GRID = jp.TimeGrid.until(END, 0.04)
# Two storeys beside one, a damper between the roofs.
LAWS = (STEEL, 4.0, (0, jp.GROUND)), (STEEL, 3.0, (1, 0)), (RUBBER, 2.0, (2, jp.GROUND))
RODS = tuple(jp.Rod(*law) for law in LAWS)
SMALL = jp.System((1.0, 0.8, 0.6), RODS, (jp.Link((1, 2), 0.1, 0.6),))


def storeys(first, materials, stiffness, mass):
    """Masses and rods of a shear building; its floors are numbered from ``first``."""
    rods = [
        jp.Rod(material, stiffness, (first + i, first + i - 1 if i else jp.GROUND))
        for i, material in enumerate(materials)
    ]
    return [mass] * len(rods), rods


def two_buildings(n, friction):
    left_masses, left = storeys(0, [STEEL, RUBBER] * (n // 2) + [STEEL] * (n % 2), 20.0, 1.0)
    right_masses, right = storeys(n, [RUBBER] * n, 30.0, 0.7)
    links = [jp.Link((i, n + i), friction * (1 + i), 0.5 + 0.1 * i) for i in range(n)]
    return jp.System((*left_masses, *right_masses), (*left, *right), tuple(links))


def assert_close(trees, **within):
    for leaf, other in zip(*map(jax.tree.leaves, trees), strict=True):
        np.testing.assert_allclose(leaf, other, **within)


def test_a_pair_is_the_system_that_it_says():
    pair = jp.paper.structures()
    as_pair, as_system = (jp.simulate(s, GROUND, GRID) for s in (pair, pair.system()))
    assert_close((as_pair, as_system), rtol=1e-10, atol=1e-14)
    assert jp.stability_limit(pair) == jp.stability_limit(pair.system())
    for name, series in {"x2": as_pair.masses[1].x, "f2": as_pair.rods[1].force}.items():
        np.testing.assert_array_equal(getattr(as_pair, name), series)
    assert as_pair.demand.min_gap == as_pair.demand.links[0].min_gap == as_pair.min_gap


def seen(system, unit, grid):
    """Final closings, smallest gaps, work and forces of a run that is shaken for the last END."""
    rests = grid.n_steps * grid.dt * unit - END
    ground = dataclasses.replace(GROUND, arrivals=rests + np.asarray(GROUND.arrivals))
    response = jp.simulate(*in_unit_of_time(unit, system, ground), grid)
    links, rods = response.demand.links, response.demand.rods
    lengths = [mass.x[-1] for mass in response.masses] + [link.min_gap for link in links]
    lengths += [rod.peak_drift for rod in rods if rod.peak_drift is not None]
    forces = [link.friction_work for link in links] + [rod.peak_force for rod in rods]
    return jnp.hstack([*lengths, *(force / unit**2 for force in forces)])


def test_storeys_with_friction_converge_at_second_order():
    """Values, and derivatives along a direction of all parameters."""
    system, draw = jax.tree.map(jnp.asarray, two_buildings(2, 0.05)), np.random.default_rng(3)
    way = jax.tree.map(lambda x: x * draw.uniform(-0.3, 0.3), system)
    steps = (0.04, 0.02, 0.005)
    grid = jp.TimeGrid(steps[0], round(END / steps[-1]))

    @jax.jit
    def along_way(unit):
        return jax.jvp(lambda s: seen(s, unit, grid), (system,), (way,))

    for runs in zip(*[along_way(dt / grid.dt) for dt in steps], strict=True):
        *coarse, fine = map(np.asarray, runs)
        errors = [np.sqrt(np.mean((run - fine) ** 2)) for run in coarse]
        assert errors[-1] < 8e-3 * np.abs(fine).max()
        assert convergence_order(steps[:-1], errors) > 1.6


def test_a_step_is_stable_up_to_the_limit_of_theory_and_above_it_refused():
    for n in (1, 2, 5):
        masses, rods = storeys(0, [ELASTIC] * n, 3.0, 0.5)
        fastest = 2 * math.sqrt(3.0 / 0.5) * math.sin((2 * n - 1) * math.pi / (2 * (2 * n + 1)))
        system, limit = jp.System(tuple(masses), tuple(rods)), 2 / fastest
        assert jp.stability_limit(system) == pytest.approx(limit, rel=1e-9)
    slow = jp.Ricker(0.4, 10.0, 12.0)
    assert float(jp.demand(system, slow, jp.TimeGrid(0.999 * limit, 3000)).masses[4].peak_x) < 20
    grid = jp.TimeGrid(1.001 * limit, 100)
    refused(r"dt = .* must be .* below the stability limit", jp.demand, system, slow, grid)
    traced = jax.jit(lambda m: jp.demand(dataclasses.replace(system, masses=m), GROUND, grid).pga)
    assert np.isnan(traced((0.5,) * 5))
    assert np.isfinite(traced((0.502,) * 5))


def bearing(friction, ends=(0, jp.GROUND), rod_ends=(0, jp.GROUND)):
    rod = jp.Rod(ELASTIC, 1.0, rod_ends)
    return jp.System((1.0,), (rod,), (jp.Link(ends, friction),))


def test_a_bearing_without_friction_is_none_and_the_end_named_first_turns_its_signs_only():
    """Those of rod and link."""
    free = jp.System((1.0,), bearing(0.0).rods)
    without, free = (jp.simulate(system, GROUND, GRID) for system in (bearing(0.0), free))
    np.testing.assert_allclose((without.x1, without.f1), (free.x1, free.f1), atol=1e-12)
    turned, response = (jp.GROUND, 0), jp.simulate(bearing(0.2), GROUND, GRID)
    here = response.x1, response.v1, response.f1, response.friction
    for ends, rod_sign, link_sign in (({"rod_ends": turned}, -1, 1), ({"ends": turned}, 1, -1)):
        other = jp.simulate(bearing(0.2, **ends), GROUND, GRID)
        there = other.x1, other.v1, rod_sign * other.f1, link_sign * other.friction
        np.testing.assert_allclose(there, here, atol=1e-12)


def test_a_bearing_converges_at_second_order_from_its_first_step_on():
    """A ground motion that is there at t = 0 shakes the block from rest, sliding or stuck."""
    steps, fine = (0.08, 0.04, 0.02), 0.0025
    grid = jp.TimeGrid(steps[0], round(4.0 / fine))

    @jax.jit
    @partial(jax.vmap, in_axes=(0, None))
    def displacements(unit, start):
        def shaking(t):
            return unit**2 * 0.9 * jnp.cos(2 * unit * t + start)

        system, _ = in_unit_of_time(unit, bearing(0.2), GROUND)
        return jp.simulate(system, shaking, grid).masses[0].x

    for start in (0.0, 0.7):
        runs = np.asarray(displacements(np.array([*steps, fine]) / grid.dt, start))
        at = [x[:: round(0.08 / dt)][:51] for x, dt in zip(runs, (*steps, fine), strict=True)]
        errors = [np.abs(x - at[-1]).max() for x in at[:-1]]
        assert convergence_order(steps, errors) == pytest.approx(2, abs=0.35)


def test_a_batch_of_systems_is_its_runs_one_by_one_and_single_precision_stays_near():
    def run(mu, mass):
        link = dataclasses.replace(SMALL.links[0], friction=mu)
        changed = dataclasses.replace(SMALL, masses=(1.0, mass, 0.6), links=(link,))
        return jp.demand(changed, GROUND, GRID)

    frictions, masses = np.array([0.0, 0.1, 0.3]), np.array([0.5, 0.8, 1.1])
    batch = jax.device_get(jax.vmap(run)(frictions, masses))
    for i, case in enumerate(zip(frictions, masses, strict=True)):
        assert_close((batch[i], run(*case)), rtol=1e-12, atol=1e-13)
    narrow = jp.demand(*jax.tree.map(np.float32, (SMALL, GROUND)), GRID)
    assert {leaf.dtype for leaf in jax.tree.leaves(narrow)} == {jnp.dtype("float32")}
    assert_close((narrow, batch[1]), rtol=2e-3, atol=1e-4)


def test_a_batch_of_buildings_calls_no_lapack():
    """Two calls at a time wait for each other for ever on two cores (XLA's thread pool)."""
    system = two_buildings(3, 0.0)

    def run(mass):
        heavier = dataclasses.replace(system, masses=(mass, *system.masses[1:]), links=())
        return jp.demand(heavier, GROUND, GRID).pga

    assert "lapack" not in jax.jit(jax.vmap(run)).lower(jnp.ones(4)).as_text()


def test_gradients_of_a_system_are_systems_and_agree_in_both_modes():
    """Of two storeys with a damper between the roof and the ground."""
    damper = jp.Link((1, jp.GROUND), 0.1, 0.6)
    system = jax.tree.map(np.asarray, jp.System((1.0, 0.8), SMALL.rods[:2], (damper,)))

    def goal(s):
        demand = jp.demand(s, GROUND, GRID, only=("min_gap", "peak_acceleration_2"))
        return demand.min_gap + demand.masses[1].peak_acceleration

    reverse = jax.jit(jax.grad(goal))(system)
    assert isinstance(reverse, jp.System)
    slopes = np.array(jax.tree.leaves(reverse))
    way = np.random.default_rng(0).normal(size=slopes.size)
    along = jax.jit(lambda s, t: jax.jvp(goal, (s,), (t,))[1])
    forward = along(system, jax.tree.structure(system).unflatten([*way]))
    assert float(forward) == pytest.approx(way @ slopes, rel=1e-9)
    assert (np.isfinite(slopes) & (slopes != 0)).all()


def test_gaps_without_end_and_systems_without_links_have_numbers_for_all_else():
    endless = dataclasses.replace(SMALL, links=(jp.Link((1, 2), 0.1),))
    demand = jp.demand(endless, GROUND, GRID)
    assert (float(demand.min_gap), float(demand.pounds)) == (math.inf, 0.0)
    assert demand.masses[0].peak_x == jp.demand(SMALL, GROUND, GRID).masses[0].peak_x
    alone = jp.simulate(dataclasses.replace(SMALL, links=()), GROUND, GRID)
    assert (float(alone.min_gap), alone.links) == (math.inf, ())
    assert "min_gap" not in alone.demand.scalars()
    energy = jax.jit(lambda run: run.energy)(alone)
    assert np.abs(energy.residual).max() < 1e-2 * np.asarray(energy.input).max()


def test_storeys_and_dampers_balance_their_energy_and_are_told_apart_by_number():
    run = jp.simulate(two_buildings(2, 0.05), GROUND, jp.TimeGrid.until(END, 0.01))
    energy = jax.jit(lambda run: run.energy)(run)
    assert np.abs(energy.residual).max() < 2e-3 * np.asarray(energy.input).max()
    assert (np.diff(energy.friction) > -1e-12).all()
    assert energy.friction[-1] > 1
    works = sum(float(link.friction_work) for link in run.demand.links)
    assert works == pytest.approx(float(energy.friction[-1]), rel=2e-3)
    demand, scalars = run.demand, run.demand.scalars()
    gaps = [float(link.min_gap) for link in demand.links]
    assert float(demand.min_gap) == min(gaps) == scalars["min_gap"]
    assert [scalars[f"min_gap_{k}"] for k in (1, 2)] == gaps
    assert float(demand.peak_x4) == float(demand.masses[3].peak_x)
    assert {"gap_1", "gap_2", "slip_direction_2", "x4", "f4"} <= {*run.to_columns()}
    assert [len(run.phases(k)) > 3 for k in (0, 1)] == [True, True]
    with pytest.raises(AttributeError, match=r"no 'gap': links\[i\].gap has it of each of its 2 l"):
        run.gap  # noqa: B018
    refused("link = 2 must be the number of one of the 2 links", run.phases, 2)
    assert {name: float(getattr(demand, name)) for name in scalars} == scalars
    scales = jp.Scales(mass=2e5, frequency=6.0)
    assert float(scales.to_si(run).links[1].gap[0]) == pytest.approx(0.6 * scales.length)
    assert "damper 1–2, floor 2" in str(run)
    for words in ("floor 2 of building 1", "storey 1 of building 2", "1–2, floor 1"):
        assert words in str(demand)


def test_a_motion_that_begins_with_a_jump_is_of_second_order():
    """A constant acceleration from t = 0 on moves a unit mass on a unit spring by 1 − cos t."""
    mass = jp.System((1.0,), (jp.Rod(ELASTIC, 1.0, (0, jp.GROUND)),))
    constant = jp.Record(-np.ones(501), 0.02, time_unit="1/ω1")

    def error(dt):
        run = jp.simulate(mass, constant, jp.TimeGrid.until(10.0, dt))
        return np.abs(run.masses[0].x - (1 - np.cos(run.time))).max()

    assert error(0.02) < 2e-4
    assert 3.8 < error(0.04) / error(0.02) < 4.2
