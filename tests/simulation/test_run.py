import dataclasses
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import CubicHermiteSpline

import jaxpound as jp
from jaxpound._xla import plan
from jaxpound.simulation import rollout
from jaxpound.simulation import run as simulation
from tests.reference import convergence_order, load, paper_algorithm
from tests.refusals import refusals, refused
from tests.simulation.pairs import in_unit_of_time

REFERENCE = load("paper_case")
PAIR, WAVES = jp.paper.structures(), jp.paper.ground()
ELASTIC = jp.ZenerRod(0.5, 0.1, 0.1)
RESOLVED, FULL = jp.Scheme(), jp.Scheme(history=jp.simulation.FullHistory())
SMOOTHED = jp.Scheme(jp.Smoothed(0.1))
SCHEMES = RESOLVED, SMOOTHED, jp.PAPER_SCHEME
STEPS = (0.02, 0.01, 0.005)
GRID, SHORT = jp.TimeGrid(0.02, 600), jp.TimeGrid(0.02, 50)
LONG = jp.TimeGrid(0.02, 10_000)
"""Until 20 at steps of 0.002, in a unit of time of which 0.02 are one: see ``in_unit``."""


@pytest.fixture(autouse=True, scope="module")
def planned_as_users_runs_are():
    with plan.chosen(plan.fast):
        yield


@pytest.fixture
def looped():
    with plan.chosen(plan.looped):
        yield


LOOPED = pytest.mark.usefixtures("looped")
"""Tests of little but their programs, which compile in half the time as loops."""

# What is tried there may be coarse, at rest or in records of 22 g.
IMPLAUSIBLE = pytest.mark.filterwarnings("ignore::jaxpound.PlausibilityWarning")


def changed(structures=PAIR, **values):
    return dataclasses.replace(structures, **values)


@partial(jax.jit, static_argnames=("grid", "scheme"))
def in_unit(unit, structures, ground, grid=LONG, scheme=RESOLVED):
    """A run of steps ``unit`` times the grid's, by one program for all, and its energy."""
    run = jp.simulate(*in_unit_of_time(unit, structures.system(), ground), grid, scheme)
    return run, run.energy


@cache
def long_run(dt, scheme=RESOLVED, structures=PAIR, amplitude=WAVES.amplitude):
    """The paper's case at a step and its energy, over all of ``LONG``."""
    inputs, unit = (structures, changed(WAVES, amplitude=amplitude)), dt / LONG.dt
    run, energy = jax.device_get(in_unit(unit, *jax.tree.map(np.asarray, inputs), scheme=scheme))
    return jp.Scales(mass=1.0, frequency=1 / unit, gravity=unit**-2.0).to_si(run), energy


def until_20(dt, result):
    return jax.tree.map(lambda x: x[: round(20 / dt) + 1] if np.ndim(x) else x, result)


def paper_run(dt, *case, **values):
    return until_20(dt, long_run(dt, *case, **values)[0])


def furthest(series, other):
    return np.abs(series - other).max()


@LOOPED
def test_step_responses_of_order_one_against_the_inverse_laplace_transform():
    """Of order two: the case "rods" of the verification."""
    rods = [load("rods")[name] for name in ("rod_1", "rod_2")]
    steps, grid = np.array(STEPS), jp.TimeGrid(STEPS[0], round(20 / STEPS[-1]))

    @jax.jit
    @partial(jax.vmap, in_axes=(0, None))
    @partial(jax.vmap, in_axes=(None, 0))
    def displacements(unit, rod):
        # Without friction block 2 is alone: mass 1 (ρ = 1) on the stiffness ε.
        pair = jp.AdjacentStructures(ELASTIC, jp.ZenerRod(*rod[:3]), 1.0, rod[3], 0.0, 1.0)
        system, _ = in_unit_of_time(unit, pair.system(), WAVES)
        return jp.simulate(system, lambda t: unit**2 + 0 * t, grid, jp.Scheme(order=1)).x2

    numbers = [[rod[name] for name in ("order", "tau_f", "tau_x", "stiffness")] for rod in rods]
    runs = np.asarray(displacements(steps / grid.dt, np.array(numbers, float)))
    for rod, paths in zip(rods, runs.swapaxes(0, 1), strict=True):
        times, exact = np.array([(float(t), x) for t, x in rod["step_response"].items()]).T
        samples = zip(paths, np.round(times / steps[:, None]).astype(int), strict=True)
        errors = [furthest(x[at], exact) for x, at in samples]
        assert errors[-1] < 1e-3
        assert abs(convergence_order(steps, errors) - 1) < 0.15


@LOOPED
def test_den_hartog_s_oscillator_is_stuck_if_friction_exceeds_2():
    """Of y'' + y + b sgn(y') = cos(r t) − 1, at most 2; its motion: verification, den_hartog."""

    @jax.jit
    def run(b):
        structures = jp.AdjacentStructures(ELASTIC, ELASTIC, 1e-9, 1.0, b, 100.0)
        return jp.simulate(structures, lambda t: -(0.8**2) * jnp.cos(0.8 * t), GRID)

    stuck, sliding = run(2.001), run(1.999)
    assert float(stuck.demand.slip_distance) == 0
    assert [phase.kind for phase in stuck.phases()] == ["stick"]
    assert float(sliding.demand.slip_distance) > 0


def errors_at_reference_times(run):
    """Largest errors of x and v, interpolated between instants by the run's own derivatives."""
    t, errors = np.asarray(run.time), []
    a1, a2 = (np.asarray(a - run.ground_acceleration) for a in run.absolute_accelerations)
    for x, v, a, block in ((run.x1, run.v1, a1, "1"), (run.x2, run.v2, a2, "2")):
        x, v = np.asarray(x), np.asarray(v)
        there = {"x": CubicHermiteSpline(t, x, v), "v": CubicHermiteSpline(t, v, a)}
        errors.append([furthest(there[q](REFERENCE["t"]), REFERENCE[q + block]) for q in "xv"])
    return np.max(errors, axis=0)


def test_the_paper_s_case_is_that_of_the_reference():
    run = paper_run(0.002)
    assert float(run.min_gap) - 1 == pytest.approx(REFERENCE["min_gap"], abs=3e-6)
    assert float(run.demand.min_gap_time) == pytest.approx(REFERENCE["t_min"], abs=1e-4)
    assert float(paper_run(0.02).min_gap) - 1 == pytest.approx(REFERENCE["min_gap"], abs=2e-4)
    kinds = {0: "stick", 1: "slip right", -1: "slip left"}
    first, *later = run.phases()
    assert first.kind == "stick"
    assert [phase.kind for phase in later] == [kinds[event[1]] for event in REFERENCE["events"]]
    late = [p.start - event[0] for p, event in zip(later, REFERENCE["events"], strict=True)]
    assert np.abs(late).max() < 2e-5  # a hundredth of the step
    assert (errors_at_reference_times(run) < (2e-5, 5e-5)).all()
    q = np.interp(REFERENCE["t"], np.asarray(run.time), np.asarray(run.friction))
    np.testing.assert_allclose(q, REFERENCE["q"], atol=2e-5)


def test_a_hundredth_of_ground_friction_and_gap_gives_a_hundredth_of_everything():
    assert round(float(jp.pga(WAVES, jp.paper.grid()))) == 22
    whole, smaller = paper_run(0.02), changed(friction=0.0025, initial_gap=0.01)
    small = paper_run(0.02, structures=smaller, amplitude=0.005)
    for name in ("x1", "x2", "f1", "f2", "friction", "gap"):
        np.testing.assert_allclose(100 * getattr(small, name), getattr(whole, name), atol=1e-10)
    starts = [[phase.start for phase in run.phases()] for run in (small, whole)]
    assert starts[0] == pytest.approx(starts[1], abs=1e-9)


def gap_errors(steps, scheme=RESOLVED):
    return [abs(float(paper_run(h, scheme).min_gap) - 1 - REFERENCE["min_gap"]) for h in steps]


def test_second_order_through_the_phase_changes_and_energy_at_the_order_of_the_scheme():
    motions = zip(*[errors_at_reference_times(paper_run(h)) for h in STEPS], strict=True)
    for errors in (*motions, gap_errors(STEPS)):
        assert abs(convergence_order(STEPS, errors) - 2) < 0.25, errors
    for scheme, order, steps in ((RESOLVED, 2, STEPS), (jp.PAPER_SCHEME, 1, (0.02, 0.01, 0.002))):
        balances = [until_20(h, long_run(h, scheme)[1]) for h in steps]
        errors = [np.abs(energy.residual).max() / energy.input.max() for energy in balances]
        assert errors[-1] < 3e-4 * steps[-1] / 0.005
        assert convergence_order(steps, errors) > order - 0.25, errors


def test_the_paper_s_scheme_is_the_paper_s_algorithm_with_its_known_error_of_order_one():
    """Instant by instant, through stick, slip and reversal, against plain NumPy loops."""
    run = paper_run(0.01, jp.PAPER_SCHEME)
    t = np.asarray(run.time)
    shaking = dict(zip(t.tolist(), np.asarray(WAVES.acceleration(t)).tolist(), strict=True))
    x1, x2, q = paper_algorithm(PAIR, lambda s: shaking[s], 0.01, 2000)
    assert {p.kind for p in run.phases()} == {"stick", "slip right", "slip left"}
    np.testing.assert_allclose((run.x1, run.x2), (x1, x2), atol=1e-10)
    np.testing.assert_allclose(run.friction[1:], q[1:], atol=1e-8)
    steps = [0.01, 0.002]
    errors = gap_errors(steps, jp.PAPER_SCHEME)
    assert errors[-1] == pytest.approx(6.4e-4, abs=0.1e-4)
    assert abs(convergence_order(steps, errors) - 1) < 0.4  # ragged: it switches by whole steps


def test_modal_history_stands_for_full_history_and_checkpoints_change_no_result():
    """Nor a derivative (test_gradients.py), nor a full history (test_scan.py)."""
    for h in (0.02, 0.002):
        full, modal = paper_run(h, FULL), paper_run(h)
        assert max(furthest(full.x1, modal.x1), furthest(full.x2, modal.x2)) < 1e-6
    plain, checked = paper_run(0.02), paper_run(0.02, changed(RESOLVED, checkpoint=True))
    np.testing.assert_allclose((plain.x1, plain.gap), (checked.x1, checked.gap), atol=1e-13)


def smoothed_x1(width, dt):
    """By one program, as larger forces and motions are those of a smaller width."""
    unit = dt / LONG.dt
    factor = SMOOTHED.friction.velocity / (unit * width)
    larger = changed(friction=PAIR.friction * factor, initial_gap=PAIR.initial_gap * factor)
    waves = changed(WAVES, amplitude=WAVES.amplitude * factor)
    inputs = jax.tree.map(np.asarray, (larger, waves))
    return np.asarray(in_unit(unit, *inputs, scheme=SMOOTHED)[0].x1)[: round(20 / dt) + 1] / factor


@IMPLAUSIBLE
def test_smoothed_friction_tends_to_the_event_resolved_response_and_no_width_overflows():
    coulomb, widths = paper_run(0.002), (0.1, 0.01, 0.001, 1e-6, 1e-30)
    distances = [furthest(smoothed_x1(width, 0.002), coulomb.x1) for width in widths]
    assert distances[0] > 4 * distances[1] > 16 * distances[2]
    narrowest = paper_run(0.002, jp.Scheme(jp.Smoothed(1e-300))).x1
    assert max(*distances[3:], furthest(narrowest, coulomb.x1)) < 1e-3
    # Of second order where the width spans several steps: the same law on a finer grid.
    steps, truth = [0.02, 0.01], smoothed_x1(0.3, 0.002)
    errors = [furthest(smoothed_x1(0.3, h), truth[:: round(h / 0.002)]) for h in steps]
    assert abs(convergence_order(steps, errors) - 2) < 0.3, errors


@LOOPED
def test_energy_is_balanced_under_wavelets_of_few_steps_and_single_spikes():
    """The ground's work, and each kick, by the ground's own integral over the step."""
    grid, n, random = jp.TimeGrid(0.02, 800), 32, np.random.default_rng(0)

    def residual(ground):
        energy = jp.simulate(PAIR, ground, grid).energy
        return jnp.abs(energy.residual).max() / jnp.abs(energy.input).max()

    def shaken(size, period, arrival):
        return residual(jp.Ricker(size * period**2, period[None], arrival[None]))

    sizes, arrivals = random.uniform(0.1, 1, n), random.uniform(1, 6, n)
    wavelets = jax.jit(jax.vmap(shaken))(sizes, 0.02 * random.uniform(8, 20, n), arrivals)
    assert float(wavelets.max()) < 8e-3
    spikes = np.zeros((16, 100))
    spikes[range(16), range(40, 56)] = 1.0

    @jax.jit
    @partial(jax.vmap, in_axes=(0, None))
    def struck(samples, dt):
        return residual(jp.Record(samples, dt, time_unit="1/ω1"))

    for interval in (0.5, 1.0, 1.37):  # of the record in steps
        assert float(struck(spikes, interval * grid.dt).max()) < 8e-3


rods = st.builds(
    lambda order, tau_f, ratio: jp.ZenerRod(order, tau_f, tau_f * ratio),
    *(st.floats(*ends) for ends in ((0.05, 1.0), (0.01, 1.0), (1.0, 20.0))),
)
structures_ = st.builds(
    *(jp.AdjacentStructures, rods, rods, st.floats(0.3, 3.0), st.floats(0.3, 3.0)),
    *(st.floats(0.0, high).map(lambda x: round(x, 4)) for high in (1.0, 2.0)),
)
grounds = st.builds(
    *(jp.Ricker, st.floats(-1.0, 1.0)),
    *(st.lists(st.floats(*ends), min_size=3, max_size=3) for ends in ((0.8, 4.0), (0.0, 6.0))),
)


@jax.jit
def shaken(structures, samples):
    """A run over ``GRID`` by a record of its instants, and its energy."""
    run = jp.simulate(structures, jp.Record(samples, GRID.dt, time_unit="1/ω1"), GRID)
    return run, run.energy


@given(structures_, grounds)
def test_invariants(structures, ground):
    samples = np.asarray(ground.acceleration(GRID.times()))
    run, energy = jax.device_get(shaken(structures, samples))
    q, slip = np.asarray(run.friction), np.asarray(run.slip_velocity)
    mu = structures.friction
    assert (np.abs(q) <= mu).all()
    assert (q * slip >= 0).all()
    # Stick is stick: no slip velocity, and a gap that stays as it is.
    stuck = np.asarray(run.phase[:-1]) == 0
    resting = stuck & np.r_[True, stuck[:-1]]
    assert np.abs(slip[:-1][resting]).max(initial=0.0) < 1e-14
    pull = np.abs(structures.mass_ratio * run.f2 - run.f1).max() + (1 + structures.mass_ratio) * mu
    assert np.abs(np.diff(run.gap)[stuck]).max(initial=0.0) <= GRID.dt**2 / 4 * pull
    inside = stuck[:-1] & stuck[1:]
    assert (np.diff(run.gap)[1:][inside] == 0).all()
    # Friction takes energy at every instant.
    assert np.diff(energy.friction).min() >= -1e-14 * (1 + energy.friction[-1])
    # The smallest gap is at most that of the grid, and that of the grid is close.
    assert float(run.min_gap) <= float(run.gap.min()) + 1e-3
    assert float(run.min_gap) >= float(run.gap.min()) - 1e-2
    # The rods are passive: they never give back more than they took, up to the quadrature.
    assert energy.rods.min() >= -1e-3 * (energy.kinetic.max() + 1e-9)
    # Twice the ground motion and twice the friction force give twice the response.
    doubled = changed(structures, friction=2 * mu, initial_gap=2 * structures.initial_gap)
    double, _ = shaken(doubled, 2 * samples)
    np.testing.assert_allclose(double.x1, 2 * run.x1, rtol=1e-9, atol=1e-10)
    assert float(double.min_gap) == pytest.approx(2 * float(run.min_gap), rel=1e-9, abs=1e-10)
    # Equal structures never slip.
    rod = structures.rod_1
    equal, _ = shaken(jp.AdjacentStructures(rod, rod, 1.0, 1.0, mu, 0.5), samples)
    np.testing.assert_array_equal(equal.gap, 0.5)
    demand = equal.demand
    assert (demand.min_gap, demand.slip_distance, demand.friction_work) == (0.5, 0, 0)
    # Without shaking nothing moves.
    still, _ = shaken(structures, 0 * samples)
    for name in ("x1", "x2", "v1", "v2", "f1", "f2", "friction"):
        np.testing.assert_array_equal(getattr(still, name), 0)
    assert float(still.min_gap) == structures.initial_gap


@IMPLAUSIBLE
@given(structures_, grounds)
def test_swapping_the_structures_mirrors_the_response(structures, ground):
    """Seen in block 2's own units: times √(ρε), lengths and forces by what follows (eq. 8)."""
    frequency = 1.5  # ω2 / ω1
    s = changed(structures, stiffness_ratio=frequency**2 / structures.mass_ratio)

    def in_its_units(rod):
        scale = frequency**rod.order
        return dataclasses.replace(rod, tau_f=rod.tau_f * scale, tau_x=rod.tau_x * scale)

    length = frequency**2
    ratios = 1 / s.mass_ratio, 1 / s.stiffness_ratio
    link = s.friction * s.mass_ratio, s.initial_gap * length
    swapped = jp.AdjacentStructures(in_its_units(s.rod_2), in_its_units(s.rod_1), *ratios, *link)
    samples = np.asarray(ground.acceleration(GRID.times()))
    run, _ = jax.device_get(shaken(s, samples))
    # Seen from the other side everything runs the other way, the ground too.
    grid = jp.TimeGrid(GRID.dt * frequency, GRID.n_steps)
    other = jp.simulate(swapped, jp.Record(-samples, grid.dt, time_unit="1/ω1"), grid)
    opposite = -run.x2 * length, -run.x1 * length
    np.testing.assert_allclose((other.x1, other.x2), opposite, atol=2e-9 * length)
    np.testing.assert_allclose(other.gap, run.gap * length, atol=4e-9 * length)
    assert float(other.min_gap) == pytest.approx(float(run.min_gap) * length, abs=4e-9 * length)


@LOOPED
def test_demand_is_the_simulation_s_and_its_intensity_that_of_the_ground():
    for scheme in SCHEMES:
        run, _ = long_run(LONG.dt, scheme)
        options = {"temperature": 0.02} if scheme is RESOLVED else {}
        demand = jp.demand(PAIR, WAVES, LONG, scheme, **options)
        scalars = demand.scalars()
        assert ("soft_min_gap" in scalars) == bool(options)
        for name, value in run.demand.scalars().items():
            assert float(scalars[name]) == pytest.approx(float(value), rel=1e-12), name
        names = "acceleration_1", "acceleration_2"
        of_blocks = zip(names, run.absolute_accelerations, strict=True)
        series = [(name, getattr(run, name)) for name in ("x1", "x2", "f1", "f2")]
        for name, values in (*series, *of_blocks):
            seen = float(np.abs(values).max())  # the grid may miss the top, by a little
            assert seen * (1 - 1e-12) <= float(getattr(demand, f"peak_{name}")) < 1.01 * seen, name
        work = np.trapezoid(run.friction * run.slip_velocity, run.time)
        assert float(demand.friction_work) == pytest.approx(work, rel=5e-3)
        distance = np.trapezoid(np.abs(run.slip_velocity), run.time)
        assert float(demand.slip_distance) == pytest.approx(distance, rel=5e-3)
        assert float(demand.residual_offset) == pytest.approx(float(run.gap[-1] - 1))
        assert float(demand.pounds) == 0
    # The intensity of the shaking is that of the ground motion on the grid.
    grid, only = jp.TimeGrid(0.04, 200), ("pga", "pgv")
    record = jp.Record(np.random.default_rng(2).normal(size=60), 0.1, time_unit="1/ω1")
    for ground in (WAVES, lambda t: np.cos(t) - 0.3, 2.0 * record - 0.5 * WAVES):
        demand = jax.jit(lambda x, ground=ground: jp.demand(x, ground, grid, only=only))(PAIR)
        of_ground = jp.pga(ground, grid), jp.ground.pgv(ground, grid)
        np.testing.assert_allclose((demand.pga, demand.pgv), of_ground, rtol=1e-12)


@LOOPED
def test_a_last_stop_at_the_smallest_gap_tells_when_it_was():
    """Stuck ever after: the gap is smallest from the stop on, not at the end of the run."""

    def when(friction):
        run = jp.simulate(changed(friction=friction), jp.Ricker(-0.5, 2.0, 3.0), GRID)
        return run.demand.min_gap_time, run

    stop = jax.jit(lambda friction: jax.jvp(when, (friction,), (1.0,), has_aux=True))

    time, slope, run = stop(2.6)
    last = run.phases()[-1]
    assert last.kind == "stick"
    assert float(time) == pytest.approx(last.start, abs=1e-12)
    assert float(time) == pytest.approx(3.8648, abs=5e-4)  # event-driven reference
    difference = (stop(2.6 + 1e-5)[0] - stop(2.6 - 1e-5)[0]) / 2e-5
    assert float(slope) == pytest.approx(float(difference), rel=1e-4)
    assert abs(float(slope)) > 0.1


@LOOPED
def test_the_soft_minimum_is_its_definition_between_minimum_and_mean():
    """Its slopes by all inputs of a run: test_gradients.py."""
    run, _ = long_run(LONG.dt)
    gap, time, least = run.gap, run.time, float(run.min_gap)

    def soft(temperature):
        return jp.demand(PAIR, WAVES, LONG, temperature=temperature).soft_min_gap

    for temperature in (1e-4, 1e-3, 0.02, 0.3, 100.0):
        mean = np.trapezoid(np.exp(-(gap - gap.min()) / temperature), time) / time[-1]
        expected = gap.min() - temperature * np.log(mean)
        assert float(soft(temperature)) == pytest.approx(expected, rel=1e-9)
        assert least < expected < np.trapezoid(gap, time) / time[-1] + 1e-12
        assert temperature > 1e-4 or expected < least + 1e-3
    slope = jax.jit(lambda x: jax.jvp(soft, (x,), (1.0,))[1])(0.05)
    difference = (soft(0.0501) - soft(0.0499)) / 2e-4
    assert float(slope) == pytest.approx(float(difference), rel=1e-3)


test_an_impossible_temperature_is_refused = pytest.mark.unchecked(
    refusals(
        *((wrong, "demand: temperature") for wrong in (0.0, -1.0, np.nan, np.inf, "hot", [0.1, 1])),
        of=lambda wrong: jp.demand(PAIR, WAVES, SHORT, temperature=wrong),
    )
)


@LOOPED
def test_new_values_do_not_trace_again():
    traces = []

    def gap(friction, ground):
        traces.append(friction)
        return jp.demand(changed(friction=friction), ground, SHORT).min_gap

    def in_waves(friction, amplitude):
        return gap(friction, jp.Ricker(amplitude, [2.0], [3.0]))

    batch, compiled = jax.jit(jax.vmap(jax.value_and_grad(in_waves))), jax.jit(gap)
    for mu in (0.1, 0.2, 0.3):
        batch.trace(mu * np.ones(4), np.linspace(0.1, 1, 4))
        compiled.trace(mu, WAVES)
        compiled.trace(mu, jp.Record([0.0, 0.1, mu], 0.5, f"record {mu}", "1/ω1"))
    assert len(traces) == 3
    size = simulation._demand._cache_size()
    for mu in (0.1, 0.2, 0.3):
        jp.demand(changed(friction=mu), jp.Ricker(mu, [2.0], [3.0]), jp.TimeGrid(0.04, 51))
    assert simulation._demand._cache_size() == size + 1


@IMPLAUSIBLE
def test_compiled_and_eager_runs_agree_and_float32_stays_float32_and_close():
    """A full history is the same in a longer run."""
    grid = jp.TimeGrid(0.2, 7)
    runs = {scheme: paper_run(grid.dt, scheme) for scheme in (FULL, jp.PAPER_SCHEME)}
    runs[SMOOTHED] = jax.jit(lambda: jp.simulate(PAIR, WAVES, grid, SMOOTHED))()
    for scheme, compiled in runs.items():
        with jax.disable_jit():
            eager = jp.simulate(PAIR, WAVES, grid, scheme)
        assert np.abs(eager.slip_velocity).max() > 0
        series = compiled.x1[:8], compiled.gap[:8]
        np.testing.assert_allclose((eager.x1, eager.gap), series, rtol=1e-10, atol=1e-14)
    single = jp.simulate(*jax.tree.map(np.float32, (PAIR, WAVES)), jp.TimeGrid.until(20.0, 0.02))
    assert {leaf.dtype for leaf in jax.tree.leaves(single)} == {jnp.dtype("float32")}
    assert float(single.min_gap) == pytest.approx(float(paper_run(0.02).min_gap), abs=1e-3)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_batch_is_the_loop_over_every_leaf(scheme):
    rng = np.random.default_rng(3)

    def vary(leaf):
        return np.asarray(leaf)[None] * rng.uniform(0.9, 1.1, (3, *np.shape(leaf)))

    grid = GRID if scheme is jp.PAPER_SCHEME else LONG  # a full history has its price
    batch, run = jax.tree.map(vary, (PAIR, WAVES)), partial(in_unit, 1.0, grid=grid, scheme=scheme)
    together, energies = jax.device_get(jax.vmap(run)(*batch))
    assert together.x1.shape == (3, grid.n_steps + 1)
    for i in range(3):
        alone, energy = run(*jax.tree.map(lambda leaf, i=i: leaf[i], batch))
        np.testing.assert_allclose(together.x1[i], alone.x1, rtol=1e-9, atol=1e-12)
        assert float(together.min_gap[i]) == pytest.approx(float(alone.min_gap), rel=1e-10)
        np.testing.assert_allclose(energies.residual[i], energy.residual, atol=1e-10)


@LOOPED
@IMPLAUSIBLE
def test_records_and_user_functions_shake_as_the_wavelets_they_sample():
    class Shaker:
        motion = staticmethod(WAVES.acceleration)

        def acceleration(self, t):
            return self.motion(t)

    def result(shaking, name="min_gap"):
        return float(getattr(jp.demand(PAIR, shaking, GRID, only=("min_gap", "peak_x1")), name))

    samples = np.asarray(WAVES.acceleration(0.005 * np.arange(2500)))

    @jax.jit
    def smallest_gaps(unit):  # at steps of 0.02 times that unit of time
        system, waves = in_unit_of_time(unit, PAIR.system(), WAVES)
        record = jp.Record(unit**2 * samples, 0.005 / unit, time_unit="1/ω1")
        grid, only = jp.TimeGrid(0.02, 4800), ("min_gap",)
        return [jp.demand(system, ground, grid, only=only).min_gap for ground in (record, waves)]

    for unit, within in ((1.0, 2e-3), (0.125, 2e-4)):
        of_record, of_waves = smallest_gaps(unit)
        assert float(of_record) == pytest.approx(float(of_waves), abs=within)
    expected, shaker = result(WAVES), Shaker()
    assert result(0.5 * WAVES + 0.5 * WAVES) == pytest.approx(expected, abs=1e-12)
    # Of a function the mean over a step is known to second order, of wavelets to fourth.
    alike = result(WAVES.acceleration)
    assert alike == pytest.approx(expected, abs=1e-4)
    assert result(shaker) == pytest.approx(alike, abs=1e-12)
    mixed = 0.5 * WAVES + (lambda t: 0.5 * np.asarray(WAVES.acceleration(t)))
    assert result(mixed) == pytest.approx(alike, abs=1e-12)
    # A changed function is never mistaken for what it was.
    shaker.motion = np.sin
    weak = result(shaker, "peak_x1")
    shaker.motion = lambda t: 2.0 * np.sin(t)
    assert result(shaker, "peak_x1") > 1.5 * weak


@LOOPED
def test_gradient_by_the_time_scale_of_a_rough_record():
    """The record's kinks lie on the grid; the truth is a central difference on a finer one."""
    rough = np.random.default_rng(5).normal(size=300)[:280]
    grid = jp.TimeGrid(0.025, round(14 / 0.00125))

    @jax.jit
    def value_and_slope(interval, dt):
        unit = dt / grid.dt

        def min_gap(interval):
            system, _ = in_unit_of_time(unit, PAIR.system(), WAVES)
            record = jp.Record(unit**2 * rough, interval / unit, time_unit="1/ω1")
            return jp.demand(system, record, grid, only=("min_gap",)).min_gap

        return jax.jvp(min_gap, (interval,), (1.0,))

    h = 1e-5
    more, less = (float(value_and_slope(0.05 + change, 0.00125)[0]) for change in (h, -h))
    for dt, within in ((0.025, 0.2), (0.005, 0.02)):
        truth = (more - less) / (2 * h)
        assert float(value_and_slope(0.05, dt)[1]) == pytest.approx(truth, rel=within)


@LOOPED
@pytest.mark.parametrize("scheme", [RESOLVED, jp.Scheme(order=1)])
def test_the_stability_limit_is_where_stepping_starts_to_diverge(scheme, monkeypatch):
    """Just below the limit a push dies away; just above it, with the check taken out, it grows."""
    structures = changed(friction=0.0)
    limit = jp.stability_limit(structures, scheme)
    stable = jp.TimeGrid(0.99 * limit, 2000)
    simulation.require_stable(structures, scheme, stable.dt)  # raises nothing
    monkeypatch.setattr(rollout, "is_stable", lambda *_: True)
    case = structures, jp.Ricker(0.01, 2.0, 1.0), jp.TimeGrid(limit, 2000), scheme
    below, above = (np.abs(in_unit(x, *case)[0].x2[-100:]).max() for x in (0.99, 1.01))
    assert below < 0.01
    assert above > 1e6


def test_a_step_above_the_limit_is_refused_with_the_limit_in_its_unit():
    building = jp.Building.from_period(5e5, period=0.9, damping_ratio=0.05)
    for structures, unit in ((PAIR, "/ω1"), (jp.Buildings((building,)), " s")):
        limit = jp.stability_limit(structures)
        says = rf"dt = \S+{unit} must be positive and below the stability limit {limit:.8g}{unit}"
        refused(says, jp.demand, structures, WAVES, jp.TimeGrid(1.01 * limit, 100))


REAL, TWO_FRICTIONS = "must be a real number", changed(friction=np.array([0.1, 0.2]))
test_bad_grids_schemes_and_arguments_are_named = pytest.mark.unchecked(
    refusals(
        (jp.TimeGrid, 0.0, 10, "dt = 0 must be positive"),
        (jp.TimeGrid, float("nan"), 10, "dt = nan must be positive"),
        (jp.TimeGrid, 0.1, 1, "n_steps = 1 must be at least 2"),
        (jp.TimeGrid, 0.1, 10**12, "TimeGrid: n_steps = 1,000,000,000,000 would take 16 TB"),
        (jp.TimeGrid, 0.1, 10.5, "n_steps = 10.5 must be a positive whole number"),
        (jp.TimeGrid.until, -1.0, 0.1, "duration = -1 must be positive"),
        (jp.TimeGrid, "0.1", 10, f"dt = '0.1' {REAL}"),
        (jp.TimeGrid, 0.1, None, "n_steps = None must be a positive whole number"),
        (lambda: jp.ModalHistory(tolerance="a"), f"tolerance = 'a' {REAL}"),
        (jp.Smoothed, "a", f"velocity = 'a' {REAL}"),
        (jp.Scheme, jp.EventResolved, "must be a friction law"),
        (lambda: jp.Scheme(history=jp.simulation.FullHistory), "must be a history"),
        (lambda: jp.Scheme(order=3), "order = 3 must be 1 or 2"),
        (lambda: jp.Scheme(start="jump"), "start = 'jump' must be 'rest' or 'paper'"),
        (jp.simulate, "x", WAVES, SHORT, "structures = 'x' must be AdjacentStructures, a System"),
        (jp.simulate, PAIR, 3, SHORT, "ground = 3 must have acceleration"),
        (jp.demand, PAIR, WAVES, 100, "grid = 100 must be of type TimeGrid"),
        (jp.demand, TWO_FRICTIONS, WAVES, SHORT, r"friction of shape \(2,\) must be one number"),
        (jp.demand, PAIR, lambda t: np.full_like(t, np.nan), SHORT, "finite"),
    )
)

invalid = {
    "order": lambda x: changed(rod_1=jp.ZenerRod(1.0 + x, 0.1, 1.0)),
    "tau_f": lambda x: changed(rod_2=jp.ZenerRod(0.5, -x, 1.0)),
    "tau_x": lambda x: changed(rod_1=jp.ZenerRod(0.5, 0.1, 0.1 - x)),
    "mass_ratio": lambda x: changed(mass_ratio=-x),
    "stiffness_ratio": lambda x: changed(stiffness_ratio=-x),
    "friction": lambda x: changed(friction=-x),
    "gap": lambda x: changed(initial_gap=-x),
    "nan": lambda x: changed(friction=x + np.nan),
    "unstable": lambda x: changed(stiffness_ratio=1e6 * x),
}


@cache
def short_runs():
    def slope(structures, direction):
        return jax.jvp(lambda s: jp.demand(s, WAVES, SHORT).min_gap, (structures,), (direction,))[1]

    def run(structures):
        response = jp.simulate(structures, WAVES, SHORT)
        return response, response.demand.pounds, response.energy.residual

    return jax.jit(jax.vmap(run)), jax.jit(slope)


@LOOPED
@pytest.mark.parametrize("name", invalid)
def test_a_traced_invalid_run_is_nan_in_every_result_and_derivative_and_says_so(name):
    """Of a batch only the invalid entry is; a derivative of zero would look like an optimum."""
    runs, slope = short_runs()
    # Structures that break a rule, and their derivative: traced, so that nothing raises.
    traced = jax.jit(lambda x: jax.jvp(invalid[name], (x,), (1.0,)))(0.05)
    broken, way = jax.tree.map(lambda x: np.asarray(x, float), traced)
    batch = jax.device_get(runs(jax.tree.map(lambda *x: np.stack(x), PAIR, broken)))
    for path, (valid, failed) in jax.tree_util.tree_leaves_with_path(batch):
        assert np.isfinite(valid).all(), path
        assert np.isnan(failed).all(), path
    assert "invalid run" in repr(batch[0][1])
    assert np.isnan(slope(broken, way))


@LOOPED
def test_a_traced_invalid_ground_motion_is_nan_in_every_result_and_one_that_overflows_raises():
    def record(sample):
        samples = jnp.array([0.0, 0.1, 0.2]).at[1].set(sample)
        return jp.Record(samples, 0.1, time_unit="1/ω1")

    for ground, x in ((lambda period: 2.0 * jp.Ricker(0.5, period, 1.0), -1.0), (record, jnp.nan)):
        result = jax.jit(lambda x, ground=ground: jp.demand(PAIR, ground(x), SHORT))(x)
        assert all(np.isnan(leaf) for leaf in jax.tree.leaves((result, result.pounds)))
    with pytest.raises(FloatingPointError, match="non-finite"):
        jp.demand(PAIR, 1e308 * jp.Ricker(1e5, 1.0, 0.1), SHORT)
