"""Loads on masses: a step load in closed form, and loads that move all as the ground does."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from jaxpound._xla import plan
from jaxpound.ground.run_input import as_pytree
from jaxpound.plots.contact_paths import followed_contacts
from jaxpound.reliability.instants import _accelerations
from jaxpound.simulation.rollout import Rollout
from tests.refusals import refusals

G = jp.GROUND
SPRING = jp.model.Spring()
GRID = jp.TimeGrid.until(6.0, 0.02)


def still(t):
    return 0.0 * t


def block(material=SPRING):
    return jp.System((2.0,), (jp.Rod(material, 8.0, (0, G)),))


def test_a_step_load_moves_a_block_as_in_closed_form():
    """x = p/k (1 − cos ωt), to second order; its energy is that of the spring and the mass."""
    errors = []
    for step in (0.04, 0.02, 0.01):
        grid = jp.TimeGrid.until(6.0, step)
        response = jp.simulate(block(), still, grid, loads={0: lambda t: 0.5 + 0.0 * t})
        exact = 0.5 / 8.0 * (1 - np.cos(2.0 * grid.times()))
        errors.append(np.abs(response.masses[0].x - exact).max())
        acceleration = 0.5 / 2.0 * np.cos(2.0 * grid.times())
        np.testing.assert_allclose(response.absolute_accelerations[0], acceleration, atol=step**2)
        assert float(response.energy.relative_residual) < step**2
        assert float(response.demand.peak_acceleration_1) == pytest.approx(0.25, rel=step**2)
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.05) == errors[1] / errors[2]
    assert float(response.energy.input.max()) == pytest.approx(0.5**2 / 8.0 * 2, rel=1e-3)


def test_an_elastoplastic_block_under_a_step_load_has_biggs_s_ductility():
    """1/(2 (1 − 1/r)) for a load of 1/r of the yield force."""
    weak = block(jp.Bilinear(0.1))
    ratio, errors = 1.51, []
    for step in (0.04, 0.02, 0.01):
        load = {0: lambda t: 8.0 * 0.1 / ratio + 0.0 * t}
        demand = jp.simulate(weak, still, jp.TimeGrid.until(6.0, step), loads=load).demand
        errors.append(float(demand.ductility_1) - 1 / (2 * (1 - 1 / ratio)))
    assert abs(errors[2]) < 1e-3
    assert abs(errors[0]) > 10 * abs(errors[2])


def towers(law, dashpots):
    """Two and three floors with friction, contact and an inerter, with or without dashpots."""
    steel = jp.ZenerRod(0.6, 0.05, 0.2)
    ends = (0, G), (1, 0), (2, G), (3, 2), (4, 3)
    rods = [jp.Rod(steel, 4.0 + k, x) for k, x in enumerate(ends)]
    damping = [jp.Rod(jp.Dashpot(0.2 + 0.1 * k), ends=x) for k, x in enumerate(ends[::2])]
    link = jp.Link((0, 2), friction=0.05, gap=0.03, contact=law, inerter=jp.Inerter(0.1))
    links = (link, jp.Link((1, 3), friction=0.02, gap=0.08))
    masses = (1.0, 0.8, 1.2, 0.9, 0.7)
    return jp.System(masses, rods, links, damping=damping if dashpots else ())


@pytest.mark.parametrize("law", [None, jp.KelvinVoigt(80.0, 0.7), jp.Newton(0.7)], ids=str)
@pytest.mark.parametrize("dashpots", [False, True], ids=["rods", "dashpots"])
def test_loads_in_proportion_to_masses_are_a_ground_motion(law, dashpots):
    """−m u'' on each mass moves all as u'' does, relative to the ground, which then rests."""
    system = towers(law, dashpots)

    def ground(t):
        return 0.6 * jnp.sin(2.5 * t) * jnp.exp(-0.2 * t)

    loads = {k: (lambda t, m=m: -m * ground(t)) for k, m in enumerate(system.masses)}
    shaken = jp.simulate(system, ground, GRID)
    loaded = jp.simulate(system, still, GRID, loads=loads)
    for a, b in zip(shaken.masses, loaded.masses, strict=True):
        np.testing.assert_allclose(a.x, b.x, rtol=0, atol=1e-11)
    relative = [a - shaken.ground_acceleration for a in shaken.absolute_accelerations]
    for a, b in zip(relative, loaded.absolute_accelerations, strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-8)
    for a, b in zip(shaken.demand.links, loaded.demand.links, strict=True):
        assert float(a.min_gap) == pytest.approx(float(b.min_gap), abs=1e-9)
    works = float(shaken.energy.input[-1]), float(loaded.energy.input[-1])
    assert works[1] == pytest.approx(works[0], rel=2e-2, abs=1e-3)
    if law is not None:
        assert float(loaded.demand.n_impacts) > 0


def test_a_series_is_linear_between_the_instants():
    kinked = jp.TimeGrid.until(6.0, 0.1)
    series = np.sin(0.3 * np.arange(kinked.n_steps + 1.0))
    of_series = jp.simulate(block(), still, kinked, loads={0: series}).masses[0].x
    fine = jp.TimeGrid.until(6.0, 0.005)

    def load(t):
        return jnp.interp(t, kinked.times(), series)

    exact = jp.simulate(block(), still, fine, loads={0: load}).masses[0].x[::20]
    coarse = np.abs(of_series - exact).max()
    same = jp.simulate(block(), still, kinked, loads={0: np.full(kinked.n_steps + 1, 0.5)})
    constant = jp.simulate(block(), still, kinked, loads={0: lambda t: 0.5 + 0.0 * t})
    np.testing.assert_allclose(same.masses[0].v, constant.masses[0].v, rtol=0, atol=1e-14)
    halved = kinked.halved
    again = np.interp(halved.times(), kinked.times(), series)
    finer = jp.simulate(block(), still, halved, loads={0: again}).masses[0].x[::2]
    assert coarse > 3 * np.abs(finer - exact).max()


def test_gradients_batches_and_single_precision():
    """By the size of a load, that of a series and one of the structure's numbers."""
    system = towers(jp.KelvinVoigt(80.0, 0.7), True)
    shape = jnp.sin(2.5 * GRID.times()) * jnp.exp(-0.2 * GRID.times())

    def gap(size, dtype=float):
        cast, series = jax.tree.map(lambda x: jnp.asarray(x, dtype), (system, size * shape))
        response = jp.simulate(cast, jp.Ricker(0.02, 2.0, 2.0), GRID, loads={0: series, 4: series})
        return response.demand.links[0].min_gap

    sizes = jnp.array([0.3, 0.6])
    values, slopes = jax.jit(jax.vmap(jax.value_and_grad(gap)))(sizes)
    for size, value, slope in zip(sizes, values, slopes, strict=True):
        assert float(gap(size)) == pytest.approx(float(value), rel=1e-11)
        central = (gap(size + 1e-5) - gap(size - 1e-5)) / 2e-5
        assert float(slope) == pytest.approx(float(central), rel=1e-5)
    with pytest.warns(jp.PlausibilityWarning, match="float32"):
        single = gap(jnp.float32(0.3), jnp.float32)
    assert float(single) == pytest.approx(float(values[0]), rel=1e-3, abs=1e-4)


@pytest.mark.parametrize(
    ("scheme", "largest"),
    [(jp.Scheme(extrapolated=True), 2e-5), (jp.PAPER_SCHEME, 5e-2)],
    ids=["extrapolated", "paper"],
)
def test_other_schemes_take_loads(scheme, largest):
    swing = {0: lambda t: 0.5 * jnp.sin(t) ** 2}
    fine = jp.simulate(block(), still, jp.TimeGrid.until(6.0, 0.0025), loads=swing).masses[0].x[::8]
    ours = jp.simulate(block(), still, GRID, scheme, loads=swing).masses[0].x
    assert np.abs(ours - fine).max() < largest * np.abs(fine).max()


def test_a_block_starts_displaced_under_a_load():
    """It rests where the load holds it."""
    start = jp.InitialState((0.5 / 8.0,), (0.0,))
    load = {0: lambda t: 0.5 + 0.0 * t}
    response = jp.simulate(block(), still, GRID, initial=start, loads=load)
    np.testing.assert_allclose(response.masses[0].x, 0.5 / 8.0, rtol=1e-12)


def test_a_traced_load_that_breaks_a_rule_is_nan():
    def peak(period):
        loads = {0: jp.Ricker(0.1, period, 2.0)}
        return jp.simulate(block(), still, GRID, loads=loads).demand.peak_x1

    peaks = jax.jit(jax.vmap(peak))(jnp.array([1.0, -1.0]))
    assert float(peaks[0]) > 0
    assert np.isnan(peaks[1])


def test_paths_of_contact_and_limit_states_know_loads_and_damping():
    """Paths within steps are those of the same motion by the ground; as are accelerations."""
    system = towers(jp.KelvinVoigt(80.0, 0.7), True)

    def ground(t):
        return 0.6 * jnp.sin(2.5 * t) * jnp.exp(-0.2 * t)

    loads = {k: (lambda t, m=m: -m * ground(t)) for k, m in enumerate(system.masses)}
    runs = jp.simulate(system, ground, GRID), jp.simulate(system, still, GRID, loads=loads)
    paths = [followed_contacts(run)[0] for run in runs]
    np.testing.assert_allclose(paths[1].force, paths[0].force, rtol=0, atol=1e-6)
    peak = max(float(np.abs(path.force).max()) for path in paths)
    assert peak == pytest.approx(float(runs[0].demand.links[0].peak_contact), rel=1e-2)
    with plan.chosen(plan.plain):
        run = Rollout.of(system, as_pytree(ground, GRID), GRID, jp.Scheme())
        _, series = run.observed(lambda n, now, m: (n, _accelerations(run.constants, now)), 0)
    for ours, others in zip(series, runs[0].absolute_accelerations, strict=True):
        np.testing.assert_allclose(ours[-len(others) :], others, rtol=0, atol=1e-9)


@pytest.mark.filterwarnings("ignore:.*energy balance")
def test_loads_that_steps_do_not_resolve_are_told_of():
    with pytest.warns(jp.PlausibilityWarning, match="loads: .*step"):
        jp.simulate(block(), still, GRID, loads={0: jp.Ricker(1e-4, 0.05, 1.0)})


def test_loads_on_buildings_are_in_newtons_by_building_and_floor():
    frame = jp.ShearBuilding.from_period(2, 3e5, period=0.4, damping=jp.Rayleigh(0.05))
    buildings = jp.Buildings((jp.Building.from_period(3e5, 0.5, 0.05), frame))
    response = jp.simulate(
        buildings, still, loads={(1, 1): lambda t: 1e5 + 0 * t}, duration=6.0, dt=0.01
    )
    np.testing.assert_array_equal(response.masses[0].x, 0.0)
    np.testing.assert_allclose(response.masses[2].load, 1e5)
    np.testing.assert_array_equal(response.masses[1].load, 0.0)
    soft = sum(1e5 / float(storey.stiffness) for storey in frame.storeys)
    assert float(response.masses[2].x[-1]) == pytest.approx(soft, rel=2e-2)
    assert "load_3_N" in response.to_columns()


test_faults_are_named = refusals(
    ({3: still}, r"loads: 3 must be by \(building, floor\), from 0, or by a mass, from 0 to 0"),
    ({(0, 1): still}, r"loads: \(0, 1\) must be by \(building, floor\), from 0"),
    ({0: still, (0, 0): still}, r"loads\[\(0, 0\)\] must be of another mass than those before it"),
    ({0: [1.0, 2.0]}, r"loads\[0\] of shape \(2,\) must be \(301,\), a number for each instant"),
    ({0: jp.Record([0.0, 0.1, 0.0], 0.1)}, r"loads\[0\] = Record.* must be a force, but is in g"),
    ({0: np.full(301, np.nan)}, r"loads\[0\] .*must be finite"),
    of=lambda loads: jp.simulate(block(), still, GRID, loads=loads),
)
