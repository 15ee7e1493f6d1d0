"""Systems of masses, rods and links, against references that know nothing of steps."""

import dataclasses
import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from tests.reference import convergence_order
from tests.simulation.pairs import SHAKING as GROUND

STEEL = jp.ZenerRod(0.5, 0.01, 0.05)
RUBBER = jp.ZenerRod(0.8, 0.05, 0.4)
ELASTIC = jp.ZenerRod(0.5, 0.1, 0.1)
END = 12.0


def storeys(first, materials, stiffness, mass):
    """Masses and rods of a shear building; its floors are numbered from ``first``."""
    rods = [
        jp.Rod(material, stiffness, (first + i, first + i - 1 if i else jp.GROUND))
        for i, material in enumerate(materials)
    ]
    return [mass] * len(rods), rods


def two_buildings(n, friction):
    """Two buildings of n storeys of different rods, with a damper at every floor."""
    left_masses, left = storeys(0, [STEEL, RUBBER] * (n // 2) + [STEEL] * (n % 2), 20.0, 1.0)
    right_masses, right = storeys(n, [RUBBER] * n, 30.0, 0.7)
    links = [jp.Link((i, n + i), friction * (1 + i), 0.5 + 0.1 * i) for i in range(n)]
    return jp.System((*left_masses, *right_masses), (*left, *right), tuple(links))


def test_a_pair_is_the_system_that_it_says():
    grid, pair = jp.TimeGrid.until(END, 0.04), jp.paper.structures()
    as_pair, as_system = (jp.simulate(s, GROUND, grid) for s in (pair, pair.system()))
    for one, other in zip(jax.tree.leaves(as_pair), jax.tree.leaves(as_system), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-14)
    assert jp.stability_limit(pair) == jp.stability_limit(pair.system())
    for name, series in {"x2": as_pair.masses[1].x, "f2": as_pair.rods[1].force}.items():
        np.testing.assert_array_equal(getattr(as_pair, name), series)
    assert as_pair.demand.min_gap == as_pair.demand.links[0].min_gap == as_pair.min_gap


def seen(system, dt):
    """Final closings, smallest gaps, work and accelerations of a run."""
    found = jp.simulate(system, GROUND, jp.TimeGrid.until(END, dt))
    return jnp.hstack(
        [
            *(mass.x[-1] for mass in found.masses),
            *(link.min_gap for link in found.demand.links),
            *(link.friction_work for link in found.demand.links),
            *(rod.peak_force for rod in found.demand.rods),
            *(rod.peak_drift for rod in found.demand.rods if rod.peak_drift is not None),
        ]
    )


@pytest.fixture(scope="module")
def convergence():
    """Values, and derivatives along a direction of all parameters, of shrinking steps."""
    system = two_buildings(2, 0.05)
    leaves, structure = jax.tree.flatten(system)
    draw = np.random.default_rng(3)
    way = jax.tree.unflatten(structure, [x * draw.uniform(-0.3, 0.3) for x in leaves])
    system, way = (jax.tree.map(jnp.asarray, tree) for tree in (system, way))
    steps = np.array([0.04, 0.02, 0.005])

    @functools.partial(jax.jit, static_argnums=0)
    def along_way(dt):
        return jax.jvp(lambda s: seen(s, dt), (system,), (way,))

    return steps, [along_way(float(dt)) for dt in steps]


@pytest.mark.parametrize("what", ["value", "derivative"])
def test_storeys_with_friction_converge_at_second_order(convergence, what):
    steps, found = convergence
    *coarse, fine = (np.asarray(both[what == "derivative"]) for both in found)
    errors = [np.sqrt(np.mean((one - fine) ** 2)) for one in coarse]
    print(errors, np.abs(fine).max())
    assert errors[-1] < 8e-3 * np.abs(fine).max()
    assert convergence_order(steps[:-1], errors) > 1.6


def test_the_energy_of_storeys_and_dampers_balances():
    run = jp.simulate(two_buildings(2, 0.05), GROUND, jp.TimeGrid.until(END, 0.01))
    energy = run.energy
    supplied = np.asarray(energy.input).max()
    assert np.abs(energy.residual).max() < 2e-3 * supplied
    assert (np.diff(energy.friction) > -1e-12).all()
    assert energy.friction[-1] > 1
    works = sum(float(link.friction_work) for link in run.demand.links)
    assert works == pytest.approx(float(energy.friction[-1]), rel=2e-3)


def chain(n, dt_share):
    """A run of n equal elastic storeys at a share of the largest stable step of theory."""
    masses, rods = storeys(0, [ELASTIC] * n, 3.0, 0.5)
    fastest = 2 * math.sqrt(3.0 / 0.5) * math.sin((2 * n - 1) * math.pi / (2 * (2 * n + 1)))
    return jp.System(tuple(masses), tuple(rods)), 2 / fastest * dt_share


@pytest.mark.parametrize("n", [1, 2, 5])
def test_the_stability_limit_of_elastic_storeys_is_that_of_their_fastest_mode(n):
    system, limit = chain(n, 1.0)
    assert jp.stability_limit(system) == pytest.approx(limit, rel=1e-9)


def test_a_step_below_the_stability_limit_is_stable_and_one_above_it_is_refused():
    system, dt = chain(5, 0.999)
    slow = jp.Ricker(0.4, 10.0, 12.0)
    assert float(jp.demand(system, slow, jp.TimeGrid(dt, 3000)).masses[4].peak_x) < 20
    system, dt = chain(5, 1.001)
    with pytest.raises(ValueError, match=r"dt = .* must be below the stability limit"):
        jp.demand(system, slow, jp.TimeGrid(dt, 100))
    grid = jp.TimeGrid(dt, 100)
    traced = jax.jit(lambda m: jp.demand(dataclasses.replace(system, masses=m), GROUND, grid).pga)
    assert np.isnan(traced((0.5,) * 5))
    assert np.isfinite(traced((0.502,) * 5))


def test_a_batch_of_buildings_calls_no_lapack():
    """Two calls at a time wait for each other for ever on two cores (XLA's thread pool)."""
    both = storeys(0, [ELASTIC] * 3, 3.0, 0.5), storeys(3, [ELASTIC] * 2, 2.0, 0.5)
    (masses, rods), (more, others) = both
    system = jp.System((*masses, *more), (*rods, *others))

    def run(mass):
        varied = dataclasses.replace(system, masses=(mass, *system.masses[1:]))
        return jp.demand(varied, GROUND, GRID).pga

    assert "lapack" not in jax.jit(jax.vmap(run)).lower(jnp.ones(4)).as_text()


GRID = jp.TimeGrid.until(END, 0.04)


def bearing(friction, ends=(0, jp.GROUND), rod_ends=(0, jp.GROUND)):
    """A block on an elastic rod and a sliding bearing."""
    rod = jp.Rod(ELASTIC, 1.0, rod_ends)
    return jp.System((1.0,), (rod,), (jp.Link(ends, friction),))


def test_a_bearing_without_friction_is_none():
    run = jp.simulate(bearing(0.0), GROUND, GRID)
    free = jp.simulate(jp.System((1.0,), bearing(0.0).rods), GROUND, GRID)
    np.testing.assert_allclose(run.masses[0].x, free.masses[0].x, atol=1e-12)
    np.testing.assert_allclose(run.rods[0].force, free.rods[0].force, atol=1e-12)


def test_which_end_is_named_first_turns_the_signs_of_rod_and_link_only():
    one = jp.simulate(bearing(0.2), GROUND, GRID)
    rod = jp.simulate(bearing(0.2, rod_ends=(jp.GROUND, 0)), GROUND, GRID)
    link = jp.simulate(bearing(0.2, ends=(jp.GROUND, 0)), GROUND, GRID)
    for other, rod_sign, link_sign in ((rod, -1, 1), (link, 1, -1)):
        np.testing.assert_allclose(other.masses[0].x, one.masses[0].x, atol=1e-12)
        np.testing.assert_allclose(other.rods[0].force, rod_sign * one.rods[0].force, atol=1e-12)
        friction = link_sign * one.links[0].friction
        np.testing.assert_allclose(other.links[0].friction, friction, atol=1e-12)
        for field in ("x", "v"):
            there, here = (getattr(run.masses[0], field) for run in (other, one))
            np.testing.assert_allclose(there, here, atol=1e-12)


@pytest.mark.parametrize("start", [0.0, 0.7])
def test_a_bearing_converges_at_second_order_from_its_first_step_on(start):
    """A ground motion that is there at t = 0 shakes the block from rest, sliding or stuck."""

    def shaking(t):
        return 0.9 * jnp.cos(2 * t + start)

    def moved(dt):
        run = jp.simulate(bearing(0.2), shaking, jp.TimeGrid.until(4.0, dt))
        return np.asarray(run.masses[0].x)[:: round(0.08 / dt)]

    fine = moved(0.0025)
    steps = np.array([0.08, 0.04, 0.02])
    errors = [np.abs(moved(h) - fine).max() for h in steps]
    print(errors)
    assert convergence_order(steps, errors) == pytest.approx(2, abs=0.35)


def small():
    """Two storeys beside one, a damper between the roofs."""
    rods = (
        jp.Rod(STEEL, 4.0, (0, jp.GROUND)),
        jp.Rod(STEEL, 3.0, (1, 0)),
        jp.Rod(RUBBER, 2.0, (2, jp.GROUND)),
    )
    return jp.System((1.0, 0.8, 0.6), rods, (jp.Link((1, 2), 0.1, 0.6),))


def test_a_batch_of_systems_is_its_runs_one_by_one():
    system = small()

    def run(mu, mass):
        link = dataclasses.replace(system.links[0], friction=mu)
        changed = dataclasses.replace(system, masses=(1.0, mass, 0.6), links=(link,))
        return jp.demand(changed, GROUND, GRID)

    frictions, masses = np.array([0.0, 0.1, 0.3]), np.array([0.5, 0.8, 1.1])
    batch = jax.vmap(run)(frictions, masses)
    for i, (mu, mass) in enumerate(zip(frictions, masses, strict=True)):
        for one, many in zip(
            jax.tree.leaves(run(mu, mass)), jax.tree.leaves(batch[i]), strict=True
        ):
            np.testing.assert_allclose(many, one, rtol=1e-12, atol=1e-13)
    chunks = jp.in_chunks(run, chunk_size=2)(frictions, masses)
    np.testing.assert_allclose(chunks.links[0].min_gap, batch.links[0].min_gap, rtol=1e-12)


def test_gradients_of_a_system_are_systems_and_agree_in_both_modes():
    system = jax.tree.map(jnp.asarray, small())

    def goal(s):
        found = jp.demand(s, GROUND, GRID)
        return found.min_gap + found.masses[1].peak_acceleration

    reverse = jax.grad(goal)(system)
    assert isinstance(reverse, jp.System)
    leaves, structure = jax.tree.flatten(system)
    way = np.random.default_rng(0).normal(size=len(leaves))
    _, forward = jax.jvp(goal, (system,), (jax.tree.unflatten(structure, [*way]),))
    assert float(forward) == pytest.approx(way @ np.array(jax.tree.leaves(reverse)), rel=1e-9)
    assert all(np.isfinite(x) and x != 0 for x in jax.tree.leaves(reverse))


def test_single_precision_stays_so_and_is_near():
    double = jp.demand(small(), GROUND, GRID)
    single = jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), (small(), GROUND))
    found = jp.demand(*single, GRID)
    for narrow, wide in zip(jax.tree.leaves(found), jax.tree.leaves(double), strict=True):
        assert narrow.dtype == jnp.float32
        np.testing.assert_allclose(narrow, wide, rtol=2e-3, atol=1e-4)


def test_gaps_without_end_and_systems_without_links_have_numbers_for_all_else():
    system = small()
    open_gap = dataclasses.replace(system, links=(jp.Link((1, 2), 0.1),))
    found = jp.demand(open_gap, GROUND, GRID)
    assert (float(found.min_gap), float(found.pounds)) == (math.inf, 0.0)
    assert found.masses[0].peak_x == jp.demand(system, GROUND, GRID).masses[0].peak_x
    alone = jp.simulate(dataclasses.replace(system, links=()), GROUND, GRID)
    assert (float(alone.min_gap), alone.links) == (math.inf, ())
    assert "min_gap" not in alone.demand.scalars()
    assert np.abs(alone.energy.residual).max() < 1e-2 * np.asarray(alone.energy.input).max()


def test_several_links_are_told_apart_by_number():
    run = jp.simulate(two_buildings(2, 0.05), GROUND, jp.TimeGrid.until(END, 0.04))
    found = run.demand
    gaps = [float(link.min_gap) for link in found.links]
    assert float(found.min_gap) == min(gaps) == found.scalars()["min_gap"]
    assert [found.scalars()[f"min_gap_{k}"] for k in (1, 2)] == gaps
    assert float(found.peak_x4) == float(found.masses[3].peak_x)
    assert {"gap_1", "gap_2", "slip_direction_2", "x4", "f4"} <= {*run.to_columns()}
    assert [len(run.phases(k)) > 3 for k in (0, 1)] == [True, True]
    with pytest.raises(AttributeError, match=r"no 'gap': links\[i\].gap has it of each of its 2 l"):
        run.gap  # noqa: B018
    with pytest.raises(ValueError, match="link = 2 must be the number of one of the 2 links"):
        run.phases(2)
    again = jp.Demand.of_columns(found.scalars(), si=False)
    assert again.scalars() == found.scalars()
    scales = jp.Scales(mass=2e5, frequency=6.0)
    assert float(scales.to_si(run).links[1].gap[0]) == pytest.approx(0.6 * scales.length)
    shown = str(run), str(found)
    assert "damper 1–2, floor 2" in shown[0]
    for words in ("floor 2 of building 1", "storey 1 of building 2", "1–2, floor 1"):
        assert words in shown[1]
