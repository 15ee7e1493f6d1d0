"""Rare events against closed forms and reference probabilities."""

import dataclasses
import functools
import gc
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import ndtr

import jaxpound as jp
from jaxpound.reliability import limit_state
from jaxpound.reliability.design_points import DesignPoints, find_design_points
from jaxpound.reliability.importance import signs_of_missed_failures
from jaxpound.reliability.result import Samples
from tests.pickled import assert_survives_pickling
from tests.refusals import refusals, refused
from tests.reliability import case_w
from tests.reliability.searches import event_of
from tests.reliability.test_hidden_failures import Analytic, by_points
from tests.reliability.test_subset import stopped


@pytest.fixture(scope="module")
def events():
    """One after the other, each from the design points of the one before."""
    found, event = {}, None
    for gap in case_w.REFERENCE:
        event = event_of(case_w.state(gap), key=1, start=event, progress=False)
        found[gap] = event
    return found


def test_the_ground_motion_is_that_of_the_references():
    z = 3 * np.sin(0.06 * np.arange(case_w.N))
    assert case_w.MATRIX[10, 0] / 0.3 == pytest.approx(0.00892874, abs=1e-8)
    assert (case_w.MATRIX @ z)[[100, 250]] == pytest.approx([-2.470771, 2.035574], abs=1e-6)
    assert case_w.state(0.0).values(z[None])[0] == pytest.approx(4.821937, abs=1e-6)


@pytest.mark.parametrize("gap", case_w.REFERENCE)
def test_probabilities_of_case_w(events, gap):
    event, (probability, cov) = events[gap], case_w.REFERENCE[gap]
    assert event.cov <= 0.1
    allowed = 3 * np.hypot(event.cov, cov) + 0.01
    assert event.probability == pytest.approx(probability, rel=allowed)
    assert event.warnings == ()
    # The union of the linearised limit states comes near without a run; the best of them does not.
    assert 0.4 < event.form / probability < 1.2
    assert ndtr(-event.design_points.betas[0]) < 0.3 * probability
    # 1e-6 in less than 6,000 run equivalents, where a gradient costs some 3 runs.
    assert event.runs + 4 * event.gradients < 6000


def test_starts_from_other_events_and_from_few_instants(events):
    cold, *warm = events.values()
    assert cold.gradients > 500
    assert max(event.gradients for event in warm) < 250
    # Into an event that is common, or certain: plain Monte Carlo takes over, as without it.
    warmly = {"key": 1, "start": events[0.27], "progress": False}
    common, sure = (event_of(case_w.state(gap), **warmly) for gap in (0.1, 0.0))
    assert common.method.startswith("plain Monte Carlo")
    assert common.gradients > 0
    assert (sure.probability, sure.cov) == (1.0, 0.0)
    # An event without design points is no start.
    again = event_of(case_w.state(0.1), key=1, start=common, progress=False)
    assert (again.probability, again.gradients) == (common.probability, 0)
    # Each neighbour of an instant with a point is sought from it: a curve loses none for good.
    event = events[0.645]
    few = by_points(event, slice(2))
    how = {"max_runs": 10, "method": "design points", "progress": False}
    again = event_of(event.limit_state, start=few, **how)
    assert "fail far from all design points" in again.warnings[0]
    assert len(again.instants) > 3
    assert set(event.instants[:2]) < set(again.instants)


class Stuck(Analytic):
    """A limit state of closings that are 0 within 4 of the origin, and linear beyond."""

    series = ("closing",)

    @staticmethod
    def gradients(z, instants, series):
        ways = np.sin(0.02 * instants[:, None] * np.arange(1, 41))
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)
        along = (z * ways).sum(axis=1)
        slips = np.abs(along) > 4
        values = np.where(slips, along - 4 * np.sign(along), 0.0) - 1
        return values, np.where(slips[:, None], ways, 0.0)


class Steep(Stuck):
    """A plane; at every third instant a steep slope far from the limit state."""

    @staticmethod
    def gradients(z, instants, series):
        wrong = instants % 3 == 0
        slopes = np.where(wrong, 1e4, 1.0)[:, None] * np.eye(1, 40)
        return np.where(wrong, 0.0, z[:, 0]) - 3, slopes


def test_ways_to_the_limit_state_are_found():
    found = find_design_points(Steep, 0)
    assert len(found) > 10
    assert (found.instants % 3 > 0).all()
    assert found.betas == pytest.approx(3)
    # Slopes are 0 around the origin, and behind it they lead back into where they are.
    for key in range(3):
        found = find_design_points(Stuck, key)
        assert len(found) == 26
        assert found.betas == pytest.approx(5)


def test_samples_depend_on_key_and_number_alone_and_all_runs_count(events):
    for most, runs in ((10, 512), (1100, 1024)):
        options = {"start": events[0.27], "cov": 0.01, "max_runs": most, "progress": False}
        event = event_of(case_w.state(0.47), **options)
        assert event.runs == runs
        assert f"raise max_runs = {most:,}" in event.warnings[0]
    event = events[0.47]
    again = event_of(case_w.state(0.47), key=1, start=events[0.27], cov=0.2, progress=False)
    n = len(again.samples.values)
    assert n < len(event.samples.values)
    points = again.samples.points, event.samples.points[:n]
    assert np.array_equal(*points)
    assert np.array_equal(again.samples.values, event.samples.values[:n])


def test_a_stopped_search_goes_on(events, tmp_path, monkeypatch):
    """Stopped by an interrupt in the third batch, and after that at none of its runs."""
    state, folder = case_w.state(0.47), tmp_path / "search"
    options = {"key": 1, "start": events[0.27], "store": folder, "progress": False}
    stopped(monkeypatch, 2, lambda: event_of(state, **options), "values_and_times")
    after = event_of(state, **options)
    assert np.array_equal(after.samples.values, events[0.47].samples.values)
    for name in ("probability", "gradients"):
        assert getattr(after, name) == getattr(events[0.47], name)
    with monkeypatch.context() as patch:
        patch.setattr(jp.LimitState, "values_and_times", None)
        patch.setattr(jp.LimitState, "gradients", None)
        assert event_of(state, **options).probability == after.probability
    refused(r"study: threshold is 0\.47 there and 0\.5 he", event_of, case_w.state(0.5), **options)


def test_design_earthquakes_close_the_gap(events):
    event = events[0.645]
    first = event.design_earthquakes[0]
    assert first.beta == pytest.approx(5.23, abs=0.02)
    # 0.645 at its instant, so at least that over the run.
    assert -0.003 < event.limit_state.values(first.z[None])[0] < 0.05
    times, shares = event.samples.failures_by_instant
    assert shares.sum() == pytest.approx(1)
    assert abs(first.time - np.average(times, weights=shares)) < 1.5
    assert np.asarray(first.ground.samples) == pytest.approx(case_w.MATRIX @ first.z)


def test_the_slope_of_a_probability_of_a_millionth(events):
    options = {"key": 3, "start": events[0.645], "cov": 0.05, "progress": False}
    event = event_of(case_w.state(0.645), **options)
    slope = event.slope("friction")
    assert abs(slope.value - case_w.SLOPE) < 3 * np.hypot(slope.error, 0.03 * case_w.SLOPE)
    assert slope.error < 0.12 * abs(slope.value)
    # The tail between neighbouring references: ln P falls by 6.73 from 0.645 to 0.785 and by 4.88
    # from 0.47 to 0.645.
    assert 26 < event.decay.value < 34
    assert event.slope("initial_gap").value == 0
    (alone,) = event.slopes_by(["friction"]).values()
    assert alone == pytest.approx(slope, rel=1e-9)
    refused("unknown path 'fiction'", event.slopes_by, ["fiction"])
    refused("unknown path 'fiction'; did you mean 'friction'", event.slope, "fiction")
    refused("path = 3 must be the name of a parameter", event.slope, 3)


@pytest.fixture(scope="module")
def linear():
    """Without friction every closing is linear in z: the event is a union of half-spaces."""
    state, n = case_w.state(0.645 * 1.6, friction=0.0), case_w.GRID.n_steps
    every = np.arange(1, n + 1)
    _, slopes = state.gradients(np.zeros((n, case_w.N)), every, np.zeros(n, int))
    sizes = np.linalg.norm(slopes, axis=1)
    good = sizes > 1e-3
    return state, slopes[good], sizes[good], every[good]


def test_linear_pairs_have_exact_closings_design_points_and_probabilities(linear):
    """The demand, which looks between instants too, is the largest of the linear closings."""
    state, slopes, sizes, every = linear
    z = np.random.default_rng(0).standard_normal((20, case_w.N))
    largest = (z @ slopes.T).max(axis=1)
    found = state.values(z) + state.level
    assert (found > largest - 1e-9).all()
    assert found == pytest.approx(largest, rel=1e-2)
    found = find_design_points(state, 0)
    rows = np.searchsorted(every, found.instants)
    assert len(found) > 10
    assert found.betas == pytest.approx(state.level / sizes[rows], rel=1e-9)
    assert found.z == pytest.approx(slopes[rows] * (state.level / sizes[rows] ** 2)[:, None])
    # That of the union over all 500 instants, exact but for what happens between them.
    directions, betas = slopes / sizes[:, None], state.level / sizes
    order = np.argsort(betas)
    none = np.zeros(len(order), int)
    union = DesignPoints(none, directions[order], betas[order], every[order], none, 0, 0)
    exact = union.form(4000)
    event = event_of(state, progress=False)
    assert 1e-7 < exact < 1e-2
    assert event.probability == pytest.approx(exact, rel=3 * event.cov + 0.03)
    # The bound by the rate of upcrossings, and that by the best instant.
    assert ndtr(-betas.min()) < event.probability < ndtr(-betas).sum()


# References are of four runs of subset simulation each, of 75,000 runs.
INSTANT_DEMANDS = ("peak_acceleration_1", 1.464, 2.24e-4, 0.03), ("peak_f1", 1.176, 3.33e-4, 0.04)


@pytest.mark.parametrize(("demand", "threshold", "probability", "cov"), INSTANT_DEMANDS)
def test_instants_of_accelerations_and_forces(demand, threshold, probability, cov):
    """Friction jumps, but between jumps there is a design point at each instant."""
    state = jp.LimitState(case_w.SCENARIOS, case_w.GRID, demand=demand, threshold=threshold)
    event = event_of(state, progress=False)
    assert event.warnings == ()
    assert event.method.startswith("importance sampling")
    assert np.isfinite(event.instants).all()
    assert event.probability == pytest.approx(probability, rel=3 * np.hypot(event.cov, cov))
    assert event.runs + 4 * event.gradients < 6000


SHORT = jp.TimeGrid.until(8.0, dt=0.1)
HILLS = 0.2 * np.exp(-(np.subtract.outer(np.arange(0, 8, 0.1), np.arange(1.0, 6.0)) ** 2))


def hills(factor, z):
    """Five hills, times a factor."""
    return jp.Record(factor * HILLS @ z, 0.1, time_unit="1/ω1")


def drawn(factor):
    """Motions of five hills, times a factor."""
    return jp.Scenarios(jp.paper.structures(), jp.CustomDraw(functools.partial(hills, factor), 5))


FEW, STILL = drawn(1), drawn(0)
BY_POINTS = jp.reliability.EventSearch("design points")
FRICTION = {"friction": jp.paper.structures().friction}
STATE = jp.LimitState(FEW, SHORT, threshold=0.3, changes=FRICTION)


def test_limit_states_share_programs_while_one_is_in_use(monkeypatch):
    """Those of the same scenarios, grid, scheme and demand, whatever the threshold."""
    made, make = [], limit_state.LimitStatePrograms.__init__
    monkeypatch.setattr(
        limit_state.LimitStatePrograms, "__init__", lambda x, of: made.append(of) or make(x, of)
    )
    scenarios = drawn(1)
    state = jp.LimitState(scenarios, SHORT, threshold=0.3)
    dataclasses.replace(state, threshold=0.4, changes=FRICTION)
    jp.LimitState(scenarios, jp.TimeGrid.until(8.0, dt=0.1), threshold=0.2)
    assert len(made) == 1
    dataclasses.replace(state, demand="peak_x1")
    jp.LimitState(drawn(1), SHORT, threshold=0.3)  # of other scenarios, though equal ones
    assert len(made) == 3
    del state, made[:]
    gc.collect()
    jp.LimitState(scenarios, SHORT, threshold=0.3)
    assert len(made) == 1


def few(gap, method="design points", **options):
    """The event of a gap; all share their programs, also with searches for a friction."""
    state = dataclasses.replace(STATE, threshold=gap)
    return event_of(state, method=method, progress=False, **options)


def assert_alike(event, other):
    """Probabilities are the same within three standard errors."""
    apart = np.log(event.probability / other.probability)
    assert abs(apart) < 3 * np.hypot(event.cov, other.cov)


def test_a_demand_as_a_series_and_as_a_function():
    options = {"threshold": 0.5, "cov": 0.05, "search": BY_POINTS, "progress": False}
    by_name, by_function = (
        jp.rare_event(FEW, SHORT, demand=demand, **options)
        for demand in ("peak_x1", lambda demand: demand.masses[0].peak_x)
    )
    assert by_name.probability < 1e-2
    refused("start of the demand 'peak_x1' must be of 'required_gap'", few, 0.5, start=by_name)
    assert np.isfinite(by_name.instants).all()
    assert np.isnan(by_function.instants).all()
    assert_alike(by_name, by_function)


def test_events_that_are_not_rare_and_the_method_of_each():
    sure, out = few(0.0), few(0.9)
    assert (sure.probability, sure.cov, sure.runs) == (1.0, 0.0, 256)
    assert "in each of 256 random runs" in sure.warnings[0]
    assert (out.probability, *out.estimate[:3]) == (1e-12, 1e-12, 0.0, 1e-12)
    assert ("out of reach" in out.warnings[0], "out of reach" in repr(out)) == (True, True)
    # Where no point is found within reach, nothing is known.
    refused("gradients must lead to the limit state, but none of 26", few, 50.0)
    words = r"z of shape .* must be of shape \(n, 5\), n at least 1"
    for shape in ((5,), (0, 5), (2, 4)):
        refused(words, STATE.values, np.zeros(shape))
    discrete = jp.rare_event(Chosen(), SHORT, 0.1, cov=0.5, progress=False)
    by_number = few(0.1, "auto", cov=0.5)
    assert discrete.method.startswith("z_4 discrete: subset simulation")
    assert by_number.method.startswith("5 random numbers, fewer than 30: subset simulation")
    assert discrete.probability == by_number.probability
    assert_alike(few(0.1), by_number)


class Chosen:
    dimension, discrete = 5, (3,)
    realize = staticmethod(FEW.realize)


def two_demands(demand):
    return np.ones(2) * demand.pga


MEASURE, POINTS = {"threshold": 1.0}, {"search": BY_POINTS}
test_bad_input = refusals(
    (FEW, -1, {}, "gap = -1"),
    (FEW, 1.0, {"cov": 1.5}, "cov = 1.5"),
    (FEW, 1.0, {"search": "subset"}, "search = 'subset' must be of type EventSearch"),
    (FEW, None, {"demand": "peak_x3"} | MEASURE, "unknown demand 'peak_x3'"),
    (FEW, None, {"demand": "peak_x1"}, "threshold = None"),
    (FEW, 1.0, {"demand": "peak_x1"}, "gap = 1.0 must be None"),
    (FEW, None, MEASURE | {"demand": two_demands}, r"demand of shape \(2,\) must be one number"),
    (FEW, None, MEASURE | {"demand": lambda _: None}, "demand = None must be a real number"),
    (STILL, 1.0, POINTS, "demand must depend on the random numbers"),
    (Chosen(), 1.0, POINTS, "z_4 must not be discrete for design points"),
    of=lambda draw, gap, options: jp.rare_event(draw, SHORT, gap, progress=False, **options),
)


test_searches_that_break_a_rule = refusals(
    ({"method": "desing points"}, "method = 'desing points'; did you mean 'design points'"),
    ({"start": 0.3}, "start = 0.3 must be of type RareEvent or None"),
    ({"max_runs": 0}, "max_runs = 0 must be a positive whole number"),
    of=lambda wrong: jp.reliability.EventSearch(**wrong),
    before="EventSearch: ",
)


def test_the_friction_for_a_probability(tmp_path, monkeypatch):
    """With the structures of case W in fewer numbers; the benchmark has case W itself."""
    args, options = (1e-4, FEW, SHORT, 0.3), {"tolerance": 0.3, "progress": False}
    start = few(0.3, cov=0.15)
    cold = jp.reliability.reach_probability("friction", *args, **options)
    assert cold.event.probability == pytest.approx(1e-4, rel=0.3)
    assert cold.structures.friction == cold.value == cold.event.limit_state.changes["friction"]
    assert len(cold.steps) <= 6
    # From the event at the first friction, whose points are not sought again; and from files.
    options |= {"start": start}
    warm = jp.reliability.reach_probability("friction", *args, **options, store=tmp_path)
    assert warm.value == pytest.approx(cold.value, rel=0.05)
    assert warm.gradients < cold.gradients
    assert_survives_pickling(warm)
    with monkeypatch.context() as patch:
        patch.setattr(jp.LimitState, "gradients", None)
        again = jp.reliability.reach_probability("friction", *args, **options, store=tmp_path)
    assert again.value == warm.value
    # A closing does not depend on the gap at rest: where P is right already, any gap is.
    args = (cold.steps[0].probability, *args[1:])
    any_gap = jp.reliability.reach_probability("initial_gap", *args, **options)
    assert (any_gap.value, any_gap.error) == (1.0, np.inf)
    refused("unknown path", jp.reliability.reach_probability, "fiction", *args, **options)
    words = "reach_probability: scenarios: z_4 must not be discrete"
    refused(words, jp.reliability.reach_probability, "friction", 1e-5, Chosen(), SHORT, 0.3)


def test_a_period_of_structure_1_is_in_the_unit_of_the_instants():
    """The only design point is at 1 s and half of the failures at 1.8 s, a period of 0.63 s on."""
    state = SimpleNamespace(grid=SimpleNamespace(dt=0.01), time_step=0.1)
    samples = Samples(np.zeros((20, 1)), *np.ones((2, 20)), times=np.repeat([1.0, 1.8], 10))
    point, first = np.ones((1, 1)), np.zeros(1, int)
    points = DesignPoints(point, point, np.ones(1), np.array([100]), first)
    (sign,) = signs_of_missed_failures(state, samples, points, thin=0.0)
    assert sign.startswith("50% of the estimate comes from runs whose demand is largest at times")
