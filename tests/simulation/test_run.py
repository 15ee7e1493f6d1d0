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
from jaxpound.simulation import rollout
from jaxpound.simulation import run as simulation
from tests.reference import convergence_order, load, paper_algorithm

PAPER = load("paper_case")
ELASTIC = jp.ZenerRod(0.5, 0.1, 0.1)

# What is tried there may be coarse, at rest or in records of 22 g.
IMPLAUSIBLE = pytest.mark.filterwarnings("ignore::jaxpound.PlausibilityWarning")


def paper_run(dt, scheme=None, duration=20.0):
    grid = jp.TimeGrid.until(duration, dt)
    return jp.simulate(jp.paper.structures(), jp.paper.ground(), grid, scheme or jp.Scheme())


@pytest.fixture(scope="module")
def fine():
    return paper_run(0.002)


# One block on one rod.


@pytest.mark.parametrize("rod", ["rod_1", "rod_2"])
def test_step_response_of_order_one_against_the_inverse_laplace_transform(rod):
    """Of order two: the case "rods" of the verification."""
    case = load("rods")[rod]
    times = np.array([float(t) for t in case["step_response"]])
    exact = np.array(list(case["step_response"].values()))
    tested = jp.ZenerRod(case["order"], case["tau_f"], case["tau_x"])
    # Without friction block 2 is alone: mass 1 (ρ = 1) on the stiffness ε.
    structures = jp.AdjacentStructures(ELASTIC, tested, 1.0, float(case["stiffness"]), 0.0, 1.0)
    steps, errors = [0.02, 0.01, 0.005], []
    for h in steps:
        grid = jp.TimeGrid.until(20.0, h)
        run = jp.simulate(structures, lambda t: 1.0, grid, jp.Scheme(order=1))
        errors.append(np.abs(np.asarray(run.x2)[np.round(times / h).astype(int)] - exact).max())
    assert errors[-1] < 1e-3
    assert abs(convergence_order(steps, errors) - 1) < 0.15


# Den Hartog's oscillator with dry friction.


def den_hartog(until):
    """y = x1 − x2 of y'' + y + b sgn(y') = cos(r t) − 1, by r and b: block 2 is too heavy to move.

    The ground starts from rest at u = 0, so that its motion is cos(r t) − 1; the offset moves the
    steady state, not its amplitude.
    """

    @jax.jit
    @jax.vmap
    def run(r, b):
        structures = jp.AdjacentStructures(ELASTIC, ELASTIC, 1e-9, 1.0, b, 100.0)
        return jp.simulate(structures, lambda t: -(r**2) * jnp.cos(r * t), grid)

    grid = jp.TimeGrid.until(until, 0.01)
    return run


def test_den_hartog_s_steady_amplitude():
    cases = load("den_hartog")["cases"]
    r, b, amplitude = (np.array([case[name] for case in cases]) for name in ("r", "b", "X"))
    longest = 2 * np.pi / r.min()
    response = den_hartog(60 * longest)(r, b)
    steady = np.asarray(response.x1 - response.x2)[:, -round(2 * longest / 0.01) :]
    np.testing.assert_allclose(np.ptp(steady, axis=1) / 2, amplitude, rtol=1e-3)


def test_den_hartog_s_oscillator_is_stuck_until_the_spring_exceeds_friction():
    """Held still, the block feels |cos(r t) − 1| ≤ 2."""
    stuck, sliding = den_hartog(24.0)(np.array([0.8, 0.8]), np.array([2.001, 1.999]))
    assert float(stuck.demand.slip_distance) == 0
    assert [phase.kind for phase in stuck.phases()] == ["stick"]
    assert float(sliding.demand.slip_distance) > 0


# The paper's case.


def test_min_gap_of_the_paper_s_case(fine):
    assert float(fine.min_gap) - 1 == pytest.approx(PAPER["min_gap"], abs=3e-6)
    assert float(fine.demand.min_gap_time) == pytest.approx(PAPER["t_min"], abs=1e-4)
    assert float(paper_run(0.02).min_gap) - 1 == pytest.approx(PAPER["min_gap"], abs=2e-4)


def test_all_phase_changes_of_the_paper_s_case(fine):
    kinds = {0: "stick", 1: "slip right", -1: "slip left"}
    phases = fine.phases()
    assert phases[0].kind == "stick"
    assert [p.kind for p in phases[1:]] == [kinds[event[1]] for event in PAPER["events"]]
    late = [p.start - event[0] for p, event in zip(phases[1:], PAPER["events"], strict=True)]
    assert np.abs(late).max() < 2e-5  # a hundredth of the step


def errors_at_reference_times(run):
    """Largest errors of x and v, interpolated between instants by the run's own derivatives."""
    t = np.asarray(run.time)
    a1, a2 = (np.asarray(a - run.ground_acceleration) for a in run.absolute_accelerations)
    x_error, v_error = 0.0, 0.0
    for x, v, a, block in ((run.x1, run.v1, a1, "1"), (run.x2, run.v2, a2, "2")):
        x, v = np.asarray(x), np.asarray(v)
        x_there = CubicHermiteSpline(t, x, v)(PAPER["t"])
        v_there = CubicHermiteSpline(t, v, a)(PAPER["t"])
        x_error = max(x_error, np.abs(x_there - PAPER["x" + block]).max())
        v_error = max(v_error, np.abs(v_there - PAPER["v" + block]).max())
    return x_error, v_error


def test_displacements_and_velocities_of_the_paper_s_case(fine):
    x_error, v_error = errors_at_reference_times(fine)
    print(x_error, v_error)
    assert x_error < 2e-5
    assert v_error < 5e-5


def test_friction_force_of_the_paper_s_case(fine):
    q = np.interp(PAPER["t"], np.asarray(fine.time), np.asarray(fine.friction))
    np.testing.assert_allclose(q, PAPER["q"], atol=2e-5)


def test_second_order_through_the_phase_changes():
    steps = [0.02, 0.01, 0.005]
    runs = [paper_run(h) for h in steps]
    x_errors, v_errors = zip(*[errors_at_reference_times(run) for run in runs], strict=True)
    gap_errors = [abs(float(run.min_gap) - 1 - PAPER["min_gap"]) for run in runs]
    for errors in (x_errors, v_errors, gap_errors):
        print(errors)
        assert abs(convergence_order(steps, errors) - 2) < 0.25


def test_the_paper_s_scheme_is_the_paper_s_algorithm():
    """Instant by instant, through stick, slip and reversal, against plain NumPy loops."""
    structures, ground, grid = jp.paper.structures(), jp.paper.ground(), jp.TimeGrid(0.01, 1400)
    run = jp.simulate(structures, ground, grid, jp.PAPER_SCHEME)
    t = grid.times()
    shaking = dict(zip(t.tolist(), np.asarray(ground.acceleration(t)).tolist(), strict=True))
    x1, x2, q = paper_algorithm(structures, lambda s: shaking[s], 0.01, 1400)
    assert {p.kind for p in run.phases()} == {"stick", "slip right", "slip left"}
    np.testing.assert_allclose(run.x1, x1, atol=1e-10)
    np.testing.assert_allclose(run.x2, x2, atol=1e-10)
    np.testing.assert_allclose(run.friction[1:], q[1:], atol=1e-8)


def test_the_paper_s_scheme_has_its_known_error_and_order_one():
    steps = [0.01, 0.005, 0.002]
    errors = [
        abs(float(paper_run(h, jp.PAPER_SCHEME).min_gap) - 1 - PAPER["min_gap"]) for h in steps
    ]
    assert errors[-1] == pytest.approx(6.4e-4, abs=0.1e-4)
    assert abs(convergence_order(steps, errors) - 1) < 0.4  # ragged: it switches by whole steps


@pytest.mark.parametrize("h", [0.02, 0.002])
def test_modal_history_stands_for_full_history(h):
    full = paper_run(h, jp.Scheme(history=jp.FullHistory()))
    modal = paper_run(h)
    assert np.abs(full.x1 - modal.x1).max() < 1e-6
    assert np.abs(full.x2 - modal.x2).max() < 1e-6


# Friction in the limit, and the energy balance.


def test_smoothed_friction_tends_to_the_event_resolved_response(fine):
    distances = []
    for velocity in (0.1, 0.01, 0.001):
        run = paper_run(0.002, jp.Scheme(jp.Smoothed(velocity)))
        distances.append(np.abs(run.x1 - fine.x1).max())
    assert distances[0] > 4 * distances[1] > 16 * distances[2]


@pytest.mark.parametrize("velocity", [1e-6, 1e-30, 1e-300])
def test_no_width_overflows(velocity, fine):
    run = paper_run(0.002, jp.Scheme(jp.Smoothed(velocity)))
    assert np.abs(run.x1 - fine.x1).max() < 1e-3


def test_smoothed_friction_of_a_resolved_width_is_second_order():
    """Against the same law on a four times finer grid; the width spans several steps."""
    scheme, steps = jp.Scheme(jp.Smoothed(0.3)), [0.02, 0.005]
    truth = paper_run(0.00125, scheme)
    errors = [
        np.abs(paper_run(h, scheme).x1 - truth.x1[:: round(h / 0.00125)]).max() for h in steps
    ]
    print(errors)
    assert abs(convergence_order(steps, errors) - 2) < 0.3


@pytest.mark.parametrize(("scheme", "order"), [(jp.Scheme(), 2), (jp.PAPER_SCHEME, 1)])
def test_energy_residual_falls_at_least_at_the_order_of_the_scheme(scheme, order):
    steps = [0.02, 0.01, 0.005]
    runs = [paper_run(h, scheme) for h in steps]
    errors = [np.abs(run.energy.residual).max() / run.energy.input.max() for run in runs]
    print(errors)
    assert errors[-1] < 3e-4
    assert convergence_order(steps, errors) > order - 0.25


def test_energy_is_balanced_under_wavelets_of_few_steps_and_single_spikes():
    """The ground's work, and each kick, by the ground's own integral over the step."""
    grid, n = jp.TimeGrid(0.02, 800), 32
    structures, random = jp.paper.structures(), np.random.default_rng(0)

    def residual(response):
        energy = response.energy
        return jnp.abs(energy.residual).max() / jnp.abs(energy.input).max()

    def shaken(size, period, arrival):
        ground = jp.Ricker(size * period**2, period[None], arrival[None])
        return residual(jp.simulate(structures, ground, grid))

    sizes, arrivals = random.uniform(0.1, 1, n), random.uniform(1, 6, n)
    wavelets = jax.jit(jax.vmap(shaken))(sizes, 0.02 * random.uniform(8, 20, n), arrivals)
    assert float(wavelets.max()) < 8e-3

    for interval in (0.5, 1.0, 1.37):  # of the record in steps

        def struck(samples, dt=interval * grid.dt):
            ground = jp.Record(samples, dt, time_unit="1/ω1")
            return residual(jp.simulate(structures, ground, grid))

        spikes = np.zeros((16, 100))
        spikes[range(16), range(40, 56)] = 1.0
        assert float(jax.jit(jax.vmap(struck))(spikes).max()) < 8e-3


# Invariants of every run.

rods = st.builds(
    lambda order, tau_f, ratio: jp.ZenerRod(order, tau_f, tau_f * ratio),
    st.floats(0.05, 1.0),
    st.floats(0.01, 1.0),
    st.floats(1.0, 20.0),
)
structures_ = st.builds(
    jp.AdjacentStructures,
    rods,
    rods,
    st.floats(0.3, 3.0),
    st.floats(0.3, 3.0),
    st.floats(0.0, 1.0).map(lambda x: round(x, 4)),
    st.floats(0.0, 2.0).map(lambda x: round(x, 4)),
)
grounds = st.builds(
    jp.Ricker,
    st.floats(-1.0, 1.0),
    st.lists(st.floats(0.8, 4.0), min_size=3, max_size=3),
    st.lists(st.floats(0.0, 6.0), min_size=3, max_size=3),
)
GRID = jp.TimeGrid(0.02, 600)


@IMPLAUSIBLE
@given(structures_, grounds)
def test_invariants(structures, ground):
    run = jp.simulate(structures, ground, GRID)
    q, slip = np.asarray(run.friction), np.asarray(run.slip_velocity)
    mu = structures.friction
    assert (np.abs(q) <= mu).all()
    assert (q * slip >= 0).all()
    # Stick is stick: no slip velocity, and a gap that stays as it is.
    stuck = np.asarray(run.phase[:-1]) == 0
    still = stuck & np.r_[True, stuck[:-1]]
    assert np.abs(slip[:-1][still]).max(initial=0.0) < 1e-14
    pull = np.abs(structures.mass_ratio * run.f2 - run.f1).max() + (1 + structures.mass_ratio) * mu
    assert np.abs(np.diff(run.gap)[stuck]).max(initial=0.0) <= GRID.dt**2 / 4 * pull
    inside = stuck[:-1] & stuck[1:]
    assert (np.diff(run.gap)[1:][inside] == 0).all()
    # Friction takes energy at every instant.
    assert np.diff(run.energy.friction).min() >= -1e-14 * (1 + run.energy.friction[-1])
    # The smallest gap is at most that of the grid, and that of the grid is close.
    assert float(run.min_gap) <= float(run.gap.min()) + 1e-3
    assert float(run.min_gap) >= float(run.gap.min()) - 1e-2
    # The rods are passive: they never give back more than they took, up to the quadrature.
    assert run.energy.rods.min() >= -1e-3 * (run.energy.kinetic.max() + 1e-9)


@IMPLAUSIBLE
@given(structures_, grounds)
def test_swapping_the_structures_mirrors_the_response(structures, ground):
    """Seen in block 2's own units: times √(ρε), lengths and forces by what follows (eq. 8)."""
    frequency = 1.5  # ω2 / ω1
    s = dataclasses.replace(structures, stiffness_ratio=frequency**2 / structures.mass_ratio)
    swapped = jp.AdjacentStructures(
        rod_1=dataclasses.replace(
            s.rod_2,
            tau_f=s.rod_2.tau_f * frequency**s.rod_2.order,
            tau_x=s.rod_2.tau_x * frequency**s.rod_2.order,
        ),
        rod_2=dataclasses.replace(
            s.rod_1,
            tau_f=s.rod_1.tau_f * frequency**s.rod_1.order,
            tau_x=s.rod_1.tau_x * frequency**s.rod_1.order,
        ),
        mass_ratio=1 / s.mass_ratio,
        stiffness_ratio=1 / s.stiffness_ratio,
        friction=s.friction * s.mass_ratio,
        initial_gap=s.initial_gap * frequency**2,
    )
    t = GRID.times()
    samples = np.asarray(ground.acceleration(t))
    one = jp.simulate(s, jp.Record(samples, GRID.dt, time_unit="1/ω1"), GRID)
    # Seen from the other side everything runs the other way, the ground too.
    grid = jp.TimeGrid(GRID.dt * frequency, GRID.n_steps)
    other = jp.simulate(swapped, jp.Record(-samples, grid.dt, time_unit="1/ω1"), grid)
    length = frequency**2
    np.testing.assert_allclose(other.x1, -one.x2 * length, atol=2e-9 * length)
    np.testing.assert_allclose(other.x2, -one.x1 * length, atol=2e-9 * length)
    np.testing.assert_allclose(other.gap, one.gap * length, atol=4e-9 * length)
    assert float(other.min_gap) == pytest.approx(float(one.min_gap) * length, abs=4e-9 * length)


@IMPLAUSIBLE
@given(rods, grounds, st.floats(0.0, 1.0))
def test_equal_structures_never_slip(rod, ground, friction):
    run = jp.simulate(jp.AdjacentStructures(rod, rod, 1.0, 1.0, friction, 0.5), ground, GRID)
    np.testing.assert_array_equal(run.gap, 0.5)
    assert (run.demand.min_gap, run.demand.slip_distance, run.demand.friction_work) == (0.5, 0, 0)


@IMPLAUSIBLE
@given(structures_)
def test_without_shaking_nothing_moves(structures):
    run = jp.simulate(structures, jp.Ricker(0.0, 1.0, 2.0), GRID)
    for name in ("x1", "x2", "v1", "v2", "f1", "f2", "friction"):
        np.testing.assert_array_equal(getattr(run, name), 0)
    assert float(run.min_gap) == structures.initial_gap


@IMPLAUSIBLE
@given(structures_, grounds)
def test_the_response_scales_with_the_shaking(structures, ground):
    """Twice the ground motion and twice the friction force give twice the response."""
    doubled = dataclasses.replace(
        structures, friction=2 * structures.friction, initial_gap=2 * structures.initial_gap
    )
    one, two = jp.simulate(structures, ground, GRID), jp.simulate(doubled, 2 * ground, GRID)
    np.testing.assert_allclose(two.x1, 2 * one.x1, rtol=1e-9, atol=1e-10)
    assert float(two.min_gap) == pytest.approx(2 * float(one.min_gap), rel=1e-9, abs=1e-10)


# Transformations and precision.


def test_demand_is_the_simulation_s():
    for scheme in (jp.Scheme(), jp.Scheme(jp.Smoothed(0.01)), jp.PAPER_SCHEME):
        run = paper_run(0.02, scheme)
        scalars = jp.demand(
            jp.paper.structures(), jp.paper.ground(), jp.TimeGrid.until(20.0, 0.02), scheme
        )
        for name, value in run.demand.scalars().items():
            assert float(scalars.scalars()[name]) == pytest.approx(float(value), rel=1e-12), name
        accelerations = run.absolute_accelerations
        for name, series in zip(
            ("x1", "x2", "f1", "f2", "acceleration_1", "acceleration_2"),
            (run.x1, run.x2, run.f1, run.f2, *accelerations),
            strict=True,
        ):
            seen = float(np.abs(series).max())  # the grid may miss the top, by a little
            assert seen * (1 - 1e-12) <= float(getattr(scalars, f"peak_{name}")) < 1.01 * seen, name
        work = np.trapezoid(run.friction * run.slip_velocity, run.time)
        assert float(scalars.friction_work) == pytest.approx(work, rel=5e-3)
        distance = np.trapezoid(np.abs(run.slip_velocity), run.time)
        assert float(scalars.slip_distance) == pytest.approx(distance, rel=5e-3)
        assert float(scalars.residual_offset) == pytest.approx(float(run.gap[-1] - 1))
        assert float(scalars.pounds) == 0


def test_intensity_of_the_shaking_is_that_of_the_ground_motion_on_the_grid():
    structures, ricker, grid = jp.paper.structures(), jp.paper.ground(), jp.TimeGrid(0.04, 200)
    record = jp.Record(np.random.default_rng(2).normal(size=60), 0.1, time_unit="1/ω1")
    for ground in (ricker, record, lambda t: np.cos(t) - 0.3, 2.0 * record - 0.5 * ricker):
        demand = jax.jit(lambda s, ground=ground: jp.demand(s, ground, grid))
        pga, pgv = jax.jit(lambda s, demand=demand: (demand(s).pga, demand(s).pgv))(structures)
        assert float(pga) == pytest.approx(float(jp.pga(ground, grid)), rel=1e-12)
        assert float(pgv) == pytest.approx(float(jp.pgv(ground, grid)), rel=1e-12)


def test_checkpoints_change_no_result():
    """Nor a derivative: test_gradients.py."""
    case = jp.paper.structures(), jp.paper.ground(), jp.TimeGrid.until(20.0, 0.04)
    for history in (jp.ModalHistory(), jp.FullHistory()):
        plain, checked = (
            jp.simulate(*case, jp.Scheme(history=history, checkpoint=on)) for on in (False, True)
        )
        np.testing.assert_allclose(plain.x1, checked.x1, atol=1e-13)
        np.testing.assert_allclose(plain.gap, checked.gap, atol=1e-13)


def test_a_last_stop_at_the_smallest_gap_tells_when_it_was():
    """Stuck ever after: the gap is smallest from the stop on, not at the end of the run."""
    structures = dataclasses.replace(jp.paper.structures(), friction=2.6)
    ground = jp.Ricker(-0.5, 2.0, 3.0)

    def when(friction):
        harder = dataclasses.replace(structures, friction=friction)
        return jp.demand(harder, ground, GRID).min_gap_time

    response = jp.simulate(structures, ground, GRID)
    stop = response.phases()[-1]
    assert stop.kind == "stick"
    found, slope = jax.jvp(when, (2.6,), (1.0,))
    assert float(found) == pytest.approx(stop.start, abs=1e-12)
    assert float(found) == pytest.approx(3.8648, abs=5e-4)  # event-driven reference
    difference = (when(2.6 + 1e-5) - when(2.6 - 1e-5)) / 2e-5
    assert float(slope) == pytest.approx(float(difference), rel=1e-4)
    assert abs(float(slope)) > 0.1


def test_the_soft_minimum_is_its_definition_between_minimum_and_mean():
    grid = jp.TimeGrid.until(20.0, 0.02)
    case = jp.paper.structures(), jp.paper.ground(), grid
    gap, time = (np.asarray(x) for x in (jp.simulate(*case).gap, grid.times()))
    for temperature in (1e-3, 0.02, 0.3, 100.0):
        scalars = jp.demand(*case, temperature=temperature)
        mean = np.trapezoid(np.exp(-(gap - gap.min()) / temperature), time) / 20
        expected = gap.min() - temperature * np.log(mean)
        assert float(scalars.soft_min_gap) == pytest.approx(expected, rel=1e-9)
        assert float(scalars.min_gap) < expected < np.trapezoid(gap, time) / 20 + 1e-12
    assert jp.demand(*case).soft_min_gap is None
    near = jp.demand(*case, temperature=1e-4)
    assert float(near.soft_min_gap) == pytest.approx(float(near.min_gap), abs=1e-3)


def test_the_soft_minimum_s_derivative_against_differences():
    def soft(mu, temperature):
        structures = dataclasses.replace(jp.paper.structures(), friction=mu)
        grid = jp.TimeGrid.until(20.0, 0.02)
        return jp.demand(structures, jp.paper.ground(), grid, temperature=temperature).soft_min_gap

    slopes = jax.jit(jax.grad(soft, argnums=(0, 1)))(0.25, 0.05)
    by_mu = (soft(0.2501, 0.05) - soft(0.2499, 0.05)) / 2e-4
    by_temperature = (soft(0.25, 0.0501) - soft(0.25, 0.0499)) / 2e-4
    np.testing.assert_allclose(slopes, (by_mu, by_temperature), rtol=1e-3)


@pytest.mark.unchecked
@pytest.mark.parametrize("temperature", [0.0, -1.0, np.nan, np.inf, "hot", [0.1, 0.2]])
def test_an_impossible_temperature_is_refused(temperature):
    with pytest.raises(ValueError, match="demand: temperature"):
        jp.demand(
            jp.paper.structures(), jp.paper.ground(), jp.TimeGrid(0.02, 10), temperature=temperature
        )


def test_new_values_do_not_trace_again():
    traces = []

    def gap(friction, amplitude):
        traces.append(friction)
        structures = dataclasses.replace(jp.paper.structures(), friction=friction)
        return jp.demand(structures, jp.Ricker(amplitude, [2.0], [3.0]), jp.TimeGrid(0.04, 50))

    batch = jax.jit(jax.vmap(lambda *x: gap(*x).min_gap))
    slope = jax.jit(jax.vmap(jax.grad(lambda *x: gap(*x).min_gap)))
    for compiled in (batch, slope):
        for scale in (0.1, 0.2, 0.3):
            compiled(scale * jnp.ones(4), jnp.linspace(0.1, 1, 4))
    assert len(traces) == 2
    size = simulation._demand._cache_size()
    for mu in (0.1, 0.2, 0.3):
        jp.demand(
            dataclasses.replace(jp.paper.structures(), friction=mu),
            jp.Ricker(mu, [2.0], [3.0]),
            jp.TimeGrid(0.04, 51),
        )
    assert simulation._demand._cache_size() == size + 1


def test_float32_stays_float32_and_close():
    single = jax.tree.map(np.float32, (jp.paper.structures(), jp.paper.ground()))
    grid = jp.TimeGrid(0.01, 2000)
    run = jp.simulate(*single, grid)
    assert {leaf.dtype for leaf in jax.tree.leaves(run)} == {jnp.dtype("float32")}
    double = jp.demand(jp.paper.structures(), jp.paper.ground(), grid)
    assert float(run.min_gap) == pytest.approx(float(double.min_gap), abs=1e-3)


@pytest.mark.filterwarnings("ignore:.*the energy balance leaves")  # the steps are coarse
def test_compiled_and_eager_runs_agree():
    structures, ground, grid = jp.paper.structures(), jp.paper.ground(), jp.TimeGrid(0.1, 13)
    for scheme in (jp.Scheme(), jp.Scheme(jp.Smoothed(0.1)), jp.PAPER_SCHEME):
        compiled = jax.jit(lambda s, scheme=scheme: jp.simulate(s, ground, grid, scheme))(
            structures
        )
        with jax.disable_jit():
            eager = jp.simulate(structures, ground, grid, scheme)
        np.testing.assert_allclose(eager.x1, compiled.x1, rtol=1e-10, atol=1e-14)
        np.testing.assert_allclose(eager.gap, compiled.gap, rtol=1e-10, atol=1e-14)


@pytest.mark.parametrize("scheme", [jp.Scheme(), jp.Scheme(jp.Smoothed(0.01)), jp.PAPER_SCHEME])
def test_a_batch_is_the_loop_over_every_leaf(scheme):
    rng = np.random.default_rng(3)

    def vary(leaf):
        return np.asarray(leaf)[None] * rng.uniform(0.9, 1.1, (3, *np.shape(leaf)))

    pair = (jp.paper.structures(), jp.paper.ground())
    batch = jax.tree.map(vary, pair)
    grid = jp.TimeGrid(0.02, 500)
    together = jax.vmap(lambda s, g: jp.simulate(s, g, grid, scheme))(*batch)
    assert together.x1.shape == (3, 501)
    for i in range(3):
        alone = jp.simulate(*jax.tree.map(lambda leaf, i=i: leaf[i], batch), grid, scheme)
        np.testing.assert_allclose(together.x1[i], alone.x1, rtol=1e-9, atol=1e-12)
        assert float(together.min_gap[i]) == pytest.approx(float(alone.min_gap), rel=1e-10)
        np.testing.assert_allclose(together.energy.residual[i], alone.energy.residual, atol=1e-10)


@IMPLAUSIBLE
def test_a_record_shakes_as_the_wavelets_it_samples():
    structures, ground, grid = jp.paper.structures(), jp.paper.ground(), jp.TimeGrid(0.02, 600)
    record = jp.Record(
        np.asarray(ground.acceleration(0.005 * np.arange(2500))), 0.005, time_unit="1/ω1"
    )
    smooth, sampled = (float(jp.demand(structures, g, grid).min_gap) for g in (ground, record))
    assert sampled == pytest.approx(smooth, abs=2e-3)
    fine = jp.TimeGrid(0.0025, 4800)
    smooth, sampled = (float(jp.demand(structures, g, fine).min_gap) for g in (ground, record))
    assert sampled == pytest.approx(smooth, abs=2e-4)


def test_gradient_by_the_time_scale_of_a_rough_record():
    """The record's kinks lie on the grid; the truth is a central difference on a finer one."""
    rough = np.random.default_rng(5).normal(size=300)

    def min_gap(interval, dt):
        record = jp.Record(rough, interval, time_unit="1/ω1")
        return jp.demand(jp.paper.structures(), record, jp.TimeGrid.until(14.0, dt)).min_gap

    h = 1e-5
    truth = float(min_gap(0.05 + h, 0.00125) - min_gap(0.05 - h, 0.00125)) / (2 * h)
    slope = jax.jit(jax.jacfwd(min_gap), static_argnums=1)
    coarse, fine = (float(slope(0.05, dt)) for dt in (0.025, 0.005))
    print(truth, coarse, fine)
    assert fine == pytest.approx(truth, rel=0.02)
    assert coarse == pytest.approx(truth, rel=0.2)


def test_user_functions_shake_as_the_wavelets_they_sample():
    structures, ground, grid = jp.paper.structures(), jp.paper.ground(), jp.TimeGrid(0.02, 600)
    expected = float(jp.demand(structures, ground, grid).min_gap)

    class Shaker:
        def acceleration(self, t):
            return ground.acceleration(t)

    def min_gap(shaking):
        return float(jp.demand(structures, shaking, grid).min_gap)

    assert min_gap(0.5 * ground + 0.5 * ground) == pytest.approx(expected, abs=1e-12)
    # Of a function the mean over a step is known to second order, of wavelets to fourth.
    alike = min_gap(ground.acceleration)
    assert alike == pytest.approx(expected, abs=1e-4)
    assert min_gap(Shaker()) == pytest.approx(alike, abs=1e-12)
    mixed = 0.5 * ground + (lambda t: 0.5 * np.asarray(ground.acceleration(t)))
    assert min_gap(mixed) == pytest.approx(alike, abs=1e-12)


def test_a_new_user_function_is_never_mistaken_for_an_old_one():
    class Shaker:
        strength = 1.0

        def acceleration(self, t):
            return self.strength * np.sin(t)

    shaker, grid = Shaker(), jp.TimeGrid(0.02, 300)
    one = float(jp.demand(jp.paper.structures(), shaker, grid).peak_x1)
    shaker.strength = 2.0
    assert float(jp.demand(jp.paper.structures(), shaker, grid).peak_x1) > 1.5 * one


def test_values_do_not_retrace():
    traces = []

    @jax.jit
    def min_gap(structures, ground):
        traces.append(1)
        return jp.demand(structures, ground, jp.TimeGrid(0.02, 50)).min_gap

    for friction in (0.1, 0.2, 0.3):
        structures = dataclasses.replace(jp.paper.structures(), friction=friction)
        min_gap(structures, jp.paper.ground())
        min_gap(structures, jp.Record([0.0, 0.1, friction], 0.5, f"record {friction}", "1/ω1"))
    assert len(traces) == 2


# Bad input.


@IMPLAUSIBLE
@pytest.mark.parametrize("scheme", [jp.Scheme(), jp.Scheme(order=1)])
def test_the_stability_limit_is_where_stepping_starts_to_diverge(scheme, monkeypatch):
    """Just below the limit a push dies away; just above it, with the check taken out, it grows."""
    structures = dataclasses.replace(jp.paper.structures(), friction=0.0)
    limit = jp.stability_limit(structures, scheme)
    push = jp.Ricker(0.01, 2.0, 1.0)
    below = jp.simulate(structures, push, jp.TimeGrid(0.99 * limit, 2000), scheme)
    assert np.abs(below.x2[-100:]).max() < 0.01
    monkeypatch.setattr(rollout, "is_stable", lambda *_: True)
    monkeypatch.setattr(simulation, "require_stable", lambda *_: None)
    try:
        above = jp.simulate(structures, push, jp.TimeGrid(1.01 * limit, 2000), scheme)
    except FloatingPointError:
        return
    assert np.abs(above.x2[-100:]).max() > 1e6


@pytest.mark.parametrize(
    ("structures", "unit"),
    [
        (jp.paper.structures(), "/ω1"),
        (jp.Buildings((jp.Building.from_period(5e5, period=0.9, damping_ratio=0.05),)), " s"),
    ],
)
def test_a_step_above_the_limit_is_refused_with_the_limit_in_its_unit(structures, unit):
    limit = jp.stability_limit(structures)
    message = rf"dt = \S+{unit} must be below the stability limit {limit:.8g}{unit} of these"
    with pytest.raises(ValueError, match=message):
        jp.demand(structures, jp.paper.ground(), jp.TimeGrid(1.01 * limit, 100))


@pytest.mark.unchecked
@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: jp.TimeGrid(0.0, 10), "dt = 0 must be positive"),
        (lambda: jp.TimeGrid(float("nan"), 10), "dt = nan must be positive"),
        (lambda: jp.TimeGrid(0.1, 1), "n_steps = 1 must be a whole number, at least 2"),
        (
            lambda: jp.TimeGrid(0.1, 10**12),
            "TimeGrid: n_steps = 1,000,000,000,000 would take 16 TB",
        ),
        (lambda: jp.TimeGrid(0.1, 10.5), "n_steps = 10.5 must be a whole number"),
        (lambda: jp.TimeGrid.until(-1.0, 0.1), "duration = -1 must be positive"),
        (lambda: jp.TimeGrid("0.1", 10), "dt = '0.1' must be a real number"),
        (lambda: jp.TimeGrid(0.1, None), "n_steps = None must be a real number"),
        (lambda: jp.ModalHistory(tolerance="a"), "tolerance = 'a' must be a real number"),
        (lambda: jp.Smoothed("a"), "velocity = 'a' must be a real number"),
        (lambda: jp.Scheme(jp.EventResolved), "must be a friction law"),
        (lambda: jp.Scheme(history=jp.FullHistory), "must be a history"),
        (lambda: jp.Scheme(order=3), "order = 3 must be 1 or 2"),
        (lambda: jp.Scheme(friction="dry"), "friction = 'dry' must be a friction law"),
        (lambda: jp.Scheme(history=None), "history = None must be a history"),
        (lambda: jp.Scheme(start="jump"), "start = 'jump' must be 'rest' or 'paper'"),
    ],
)
def test_bad_grids_and_schemes_are_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()


@pytest.mark.unchecked
def test_bad_arguments_are_named():
    s, g, grid = jp.paper.structures(), jp.paper.ground(), jp.TimeGrid(0.02, 100)
    with pytest.raises(ValueError, match="structures = 'x' must be AdjacentStructures, a System"):
        jp.simulate("x", g, grid)
    with pytest.raises(ValueError, match="ground = 3 must have acceleration"):
        jp.simulate(s, 3, grid)
    with pytest.raises(ValueError, match="grid = 100 must be of type TimeGrid"):
        jp.demand(s, g, 100)
    with pytest.raises(ValueError, match=r"friction of shape \(2,\) must be one number"):
        jp.demand(dataclasses.replace(s, friction=np.array([0.1, 0.2])), g, grid)
    with pytest.raises(ValueError, match="finite"):
        jp.demand(s, lambda t: np.full_like(t, np.nan), grid)


invalid = {
    "order": lambda s, x: dataclasses.replace(s, rod_1=jp.ZenerRod(1.0 + x, 0.1, 1.0)),
    "tau_f": lambda s, x: dataclasses.replace(s, rod_2=jp.ZenerRod(0.5, -x, 1.0)),
    "tau_x": lambda s, x: dataclasses.replace(s, rod_1=jp.ZenerRod(0.5, 0.1, 0.1 - x)),
    "mass_ratio": lambda s, x: dataclasses.replace(s, mass_ratio=-x),
    "stiffness_ratio": lambda s, x: dataclasses.replace(s, stiffness_ratio=-x),
    "friction": lambda s, x: dataclasses.replace(s, friction=-x),
    "gap": lambda s, x: dataclasses.replace(s, initial_gap=-x),
    "nan": lambda s, x: dataclasses.replace(s, friction=x + np.nan),
    "unstable": lambda s, x: dataclasses.replace(s, stiffness_ratio=1e6 * x),
}


def broken(name):
    """Structures that break a rule, and their derivative: traced, so that nothing raises."""
    change = jax.jit(lambda x: jax.jvp(partial(invalid[name], jp.paper.structures()), (x,), (1.0,)))
    return change(0.05)


@cache
def short_runs():
    """Programs for a batch of runs, and for a derivative."""
    ground, grid = jp.paper.ground(), jp.TimeGrid(0.02, 50)

    def slope(structures, direction):
        return jax.jvp(lambda s: jp.demand(s, ground, grid).min_gap, (structures,), (direction,))[1]

    return jax.jit(jax.vmap(lambda s: jp.simulate(s, ground, grid))), jax.jit(slope)


@pytest.mark.parametrize("name", invalid)
def test_a_traced_invalid_run_is_nan_in_every_result(name):
    """Under vmap values are traced and cannot raise; only the invalid entry of a batch is NaN."""
    pair = jax.tree.map(lambda *x: jnp.stack(x), jp.paper.structures(), broken(name)[0])
    both = short_runs()[0](pair)
    for path, leaf in jax.tree_util.tree_leaves_with_path((both, both.demand.pounds)):
        assert np.isfinite(leaf[0]).all(), path
        assert np.isnan(leaf[1]).all(), path


@pytest.mark.parametrize("name", invalid)
def test_derivatives_of_an_invalid_run_are_nan(name):
    """A zero would look like an optimum."""
    assert np.isnan(short_runs()[1](*broken(name)))


def test_an_invalid_run_says_so():
    run = jax.jit(
        lambda mu: jp.simulate(
            dataclasses.replace(jp.paper.structures(), friction=mu),
            jp.paper.ground(),
            jp.TimeGrid(0.02, 50),
        )
    )(-1.0)
    assert "invalid run" in repr(run)
    assert np.isnan(run.energy.residual).all()


def test_a_traced_invalid_ground_motion_is_nan_in_every_result():
    s, grid = jp.paper.structures(), jp.TimeGrid(0.02, 50)

    def ricker(period):
        return jp.demand(s, 2.0 * jp.Ricker(0.5, period, 1.0), grid)

    def record(sample):
        return jp.demand(
            s, jp.Record(jnp.array([0.0, 0.1, 0.2]).at[1].set(sample), 0.1, time_unit="1/ω1"), grid
        )

    for result in (jax.jit(ricker)(-1.0), jax.jit(record)(jnp.nan)):
        assert all(np.isnan(leaf) for leaf in jax.tree.leaves((result, result.pounds)))


def test_a_run_that_overflows_raises():
    with pytest.raises(FloatingPointError, match="non-finite"):
        jp.demand(jp.paper.structures(), 1e308 * jp.Ricker(1e5, 1.0, 0.1), jp.TimeGrid(0.02, 50))
