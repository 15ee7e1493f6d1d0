"""Rare events against closed forms and reference probabilities."""

import dataclasses

import numpy as np
import pytest
from scipy.special import ndtr

import jaxpound as jp
from jaxpound.risk.design_points import DesignPoints, find_design_points
from jaxpound.risk.run import event_of
from tests.risk import case_w


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
    nearest = np.linalg.norm(event.design_points[0])
    assert ndtr(-nearest) < 0.3 * probability
    # 1e-6 in less than 6,000 run equivalents, where a gradient costs some 3 runs.
    assert event.runs + 4 * event.gradients < 6000


def test_a_warm_start_needs_few_gradients(events):
    cold, *warm = events.values()
    assert cold.gradients > 500
    assert max(event.gradients for event in warm) < 250


def test_a_start_from_a_rarer_event(events):
    """Into an event that is common, or certain: plain Monte Carlo takes over, as without it."""
    common, sure = (
        event_of(case_w.state(gap), key=1, start=events[0.27], progress=False) for gap in (0.1, 0.0)
    )
    assert common.method.startswith("plain Monte Carlo")
    assert common.gradients > 0
    assert (sure.probability, sure.cov) == (1.0, 0.0)
    # An event without design points is no start.
    again = event_of(case_w.state(0.1), key=1, start=common, progress=False)
    assert (again.probability, again.gradients) == (common.probability, 0)


def test_a_start_from_few_instants(events):
    """Each neighbour of an instant with a point is sought from it: a curve loses none for good."""
    event = events[0.645]
    few = {name: getattr(event, name)[:2] for name in ("design_points", "instants", "series")}
    again = event_of(
        event.limit_state,
        start=dataclasses.replace(event, **few),
        max_runs=10,
        method="design points",
        progress=False,
    )
    assert "fail far from all design points" in again.warnings[0]
    assert len(again.instants) > 3
    assert set(event.instants[:2]) < set(again.instants)


class Stuck:
    """A limit state of closings that are 0 within 4 of the origin, and linear beyond."""

    dimension, series = 40, ("closing",)
    grid = jp.TimeGrid.until(8.0, dt=0.1)

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


def test_a_steep_slope_is_no_way_to_the_limit_state():
    found = find_design_points(Steep, 0)
    assert len(found) > 10
    assert (found.instants % 3 > 0).all()
    assert found.betas == pytest.approx(3)


@pytest.mark.parametrize("key", range(3))
def test_motions_that_open_lead_to_those_that_close(key):
    """Slopes are 0 around the origin, and behind it they lead back into where they are."""
    found = find_design_points(Stuck, key)
    assert len(found) == 26
    assert found.betas == pytest.approx(5)


def test_max_runs_counts_all(events):
    state = case_w.state(0.47)
    for most, runs in ((10, 768), (1100, 1024)):
        event = event_of(state, cov=0.01, max_runs=most, progress=False)
        assert event.runs == runs
        assert f"raise max_runs = {most:,}" in event.warnings[0]


def test_samples_depend_on_key_and_number_alone(events):
    event = events[0.47]
    again = event_of(case_w.state(0.47), key=1, start=events[0.27], cov=0.2, progress=False)
    n = len(again.points)
    assert n < len(event.points)
    assert np.array_equal(again.points, event.points[:n])
    assert np.array_equal(again.values, event.values[:n])


def test_a_stopped_search_goes_on(events, tmp_path, monkeypatch):
    """Stopped by an interrupt in the third batch, and after that at none of its runs."""
    state, folder = case_w.state(0.47), tmp_path / "search"
    options = {"key": 1, "start": events[0.27], "store": folder, "progress": False}
    made, run = [], jp.LimitState.values_and_times

    def stopping(self, z):
        if len(made) == 2:
            raise KeyboardInterrupt
        made.append(len(z))
        return run(self, z)

    with monkeypatch.context() as patch:
        patch.setattr(jp.LimitState, "values_and_times", stopping)
        with pytest.raises(KeyboardInterrupt):
            event_of(state, **options)
    after = event_of(state, **options)
    assert np.array_equal(after.values, events[0.47].values)
    assert (after.probability, after.gradients) == (
        events[0.47].probability,
        events[0.47].gradients,
    )
    with monkeypatch.context() as patch:
        patch.setattr(jp.LimitState, "values_and_times", None)
        patch.setattr(jp.LimitState, "gradients", None)
        assert event_of(state, **options).probability == after.probability
    with pytest.raises(ValueError, match=r"another study: threshold is 0\.47 there and 0\.5 here"):
        event_of(case_w.state(0.5), **options)


def test_design_earthquakes_close_the_gap(events):
    event = events[0.645]
    first = event.design_earthquakes[0]
    assert first.beta == pytest.approx(5.23, abs=0.02)
    # 0.645 at its instant, so at least that over the run.
    value = event.limit_state.values(first.z[None])[0]
    assert -0.003 < value < 0.05
    times, shares = event.failures_by_instant
    assert shares.sum() == pytest.approx(1)
    assert abs(first.time - np.average(times, weights=shares)) < 1.5
    assert np.asarray(first.ground.samples) == pytest.approx(case_w.MATRIX @ first.z)


def test_the_slope_of_a_probability_of_a_millionth():
    event = event_of(case_w.state(0.645), key=3, cov=0.05, progress=False)
    slope = event.slope("friction")
    assert abs(slope.value - case_w.SLOPE) < 3 * np.hypot(slope.error, 0.03 * case_w.SLOPE)
    assert slope.error < 0.12 * abs(slope.value)
    # The tail between neighbouring references: ln P falls by 6.73 from 0.645 to 0.785 and by 4.88
    # from 0.47 to 0.645.
    assert 26 < event.decay.value < 34
    assert event.slopes["initial_gap"].value == 0
    with pytest.raises(ValueError, match="unknown path 'fiction'; did you mean 'friction'"):
        event.slope("fiction")
    with pytest.raises(ValueError, match="path = 3 must be the name of a parameter"):
        event.slope(3)


@pytest.fixture(scope="module")
def linear():
    """Without friction every closing is linear in z: the event is a union of half-spaces."""
    state, n = case_w.state(0.645 * 1.6, friction=0.0), case_w.GRID.n_steps
    every = np.arange(1, n + 1)
    _, slopes = state.gradients(np.zeros((n, case_w.N)), every, np.zeros(n, int))
    sizes = np.linalg.norm(slopes, axis=1)
    good = sizes > 1e-3
    return state, slopes[good], sizes[good], every[good]


def test_linear_closings(linear):
    """The demand, which looks between instants too, is the largest of the linear closings."""
    state, slopes, _, _ = linear
    z = np.random.default_rng(0).standard_normal((20, case_w.N))
    largest = (z @ slopes.T).max(axis=1)
    found = state.values(z) + state.level
    assert (found > largest - 1e-9).all()
    assert found == pytest.approx(largest, rel=1e-2)


def test_design_points_of_a_linear_pair_are_exact(linear):
    state, slopes, sizes, every = linear
    found = find_design_points(state, 0)
    rows = np.searchsorted(every, found.instants)
    assert len(found) > 10
    assert found.betas == pytest.approx(state.level / sizes[rows], rel=1e-9)
    assert found.z == pytest.approx(slopes[rows] * (state.level / sizes[rows] ** 2)[:, None])


def test_the_probability_of_a_linear_pair(linear):
    """That of the union over all 500 instants, exact but for what happens between them."""
    state, slopes, sizes, every = linear
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


SHORT = jp.TimeGrid.until(8.0, dt=0.1)
HILLS = 0.2 * np.exp(-(np.subtract.outer(np.arange(0, 8, 0.1), np.arange(1.0, 6.0)) ** 2))
FEW = jp.Scenarios(
    jp.paper.structures(),
    jp.CustomDraw(lambda z: jp.Record(HILLS @ z, 0.1, time_unit="1/ω1"), 5),
)


def test_a_demand_as_a_series_and_as_a_function():
    by_name, by_function = (
        jp.rare_event(
            FEW,
            SHORT,
            demand=demand,
            threshold=0.5,
            cov=0.05,
            method="design points",
            progress=False,
        )
        for demand in ("peak_x1", lambda found: found.masses[0].peak_x)
    )
    assert by_name.probability < 1e-2
    with pytest.raises(ValueError, match="start of the demand 'peak_x1' must be of 'required_gap'"):
        jp.rare_event(FEW, SHORT, 0.5, start=by_name, progress=False)
    assert np.isfinite(by_name.instants).all()
    assert np.isnan(by_function.instants).all()
    apart = np.log(by_name.probability / by_function.probability)
    assert abs(apart) < 3 * np.hypot(by_name.cov, by_function.cov)


def test_events_that_are_not_rare():
    sure = jp.rare_event(FEW, SHORT, gap=0.0, method="design points", progress=False)
    assert (sure.probability, sure.cov, sure.runs) == (1.0, 0.0, 256)
    assert "in each of 256 random runs" in sure.warnings[0]
    out = jp.rare_event(FEW, SHORT, gap=0.9, method="design points", progress=False)
    assert out.probability == 1e-12
    assert out.estimate[:3] == (1e-12, 0.0, 1e-12)
    assert "out of reach" in out.warnings[0]
    assert "out of reach" in repr(out)
    # Where no point is found within reach, nothing is known.
    with pytest.raises(ValueError, match="gradients must lead to the limit state, but none of 26"):
        jp.rare_event(FEW, SHORT, gap=50.0, method="design points", progress=False)


def test_bad_input():
    def two(found):
        return np.ones(2) * found.pga

    def none(found):
        return None

    def refuses(match, *args, **kwargs):
        with pytest.raises(ValueError, match=match):
            jp.rare_event(*args, progress=False, **kwargs)

    refuses("gap = -1", FEW, SHORT, -1)
    refuses("cov = 1.5", FEW, SHORT, 1.0, cov=1.5)
    refuses(
        "method = 'desing points'; did you mean 'design points'",
        FEW,
        SHORT,
        1.0,
        method="desing points",
    )
    refuses("unknown demand 'peak_x3'", FEW, SHORT, demand="peak_x3", threshold=1.0)
    refuses("threshold = None", FEW, SHORT, demand="peak_x1")
    refuses("gap = 1.0 must be None", FEW, SHORT, 1.0, demand="peak_x1")
    still = jp.Scenarios(
        jp.paper.structures(),
        jp.CustomDraw(lambda z: jp.Record(0 * HILLS @ z, 0.1, time_unit="1/ω1"), 5),
    )
    by = {"method": "design points"}
    refuses("demand of shape \\(2,\\) must be one number", FEW, SHORT, demand=two, threshold=1.0)
    refuses("demand = None must be a real number", FEW, SHORT, demand=none, threshold=1.0)
    refuses("demand must depend on the random numbers", still, SHORT, 1.0, **by)
    refuses("z_4 must not be discrete for design points", Chosen(), SHORT, 1.0, **by)


@pytest.mark.parametrize("shape", [(5,), (0, 5), (2, 4)])
def test_points_of_another_shape(shape):
    with pytest.raises(ValueError, match=r"z of shape .* must be of shape \(n, 5\), n at least 1"):
        jp.LimitState(FEW, SHORT, threshold=0.3).values(np.zeros(shape))


class Chosen:
    """Scenarios that say which of their numbers are discrete."""

    dimension, discrete = 5, (3,)
    realize = staticmethod(FEW.realize)


def test_which_method_and_why():
    discrete, few = (
        event_of(jp.LimitState(scenarios, SHORT, threshold=0.1), cov=0.5, progress=False)
        for scenarios in (Chosen(), FEW)
    )
    assert discrete.method.startswith("z_4 discrete: subset simulation")
    assert few.method.startswith("5 random numbers, fewer than 30: subset simulation")
    assert discrete.probability == few.probability
    by_points = jp.rare_event(FEW, SHORT, 0.1, method="design points", progress=False)
    apart = np.log(by_points.probability / few.probability)
    assert abs(apart) < 3 * np.hypot(by_points.cov, few.cov)


def test_the_friction_for_a_probability(tmp_path, monkeypatch):
    """With the structures of case W in fewer numbers; the benchmark has case W itself."""
    found = jp.reach_probability("friction", 1e-4, FEW, SHORT, 0.3, tolerance=0.3, progress=False)
    assert found.event.probability == pytest.approx(1e-4, rel=0.3)
    assert found.structures.friction == found.value == found.event.limit_state.changes["friction"]
    assert len(found.steps) <= 6
    # A closing does not depend on the gap at rest: where P is right already, any gap is.
    p = found.steps[0].probability
    any_gap = jp.reach_probability("initial_gap", p, FEW, SHORT, 0.3, tolerance=0.3, progress=False)
    assert (any_gap.value, any_gap.error) == (1.0, np.inf)
    # From the event at the first friction, whose points are not sought again; and from files.
    args, options = ("friction", 1e-4, FEW, SHORT, 0.3), {"tolerance": 0.3, "progress": False}
    options |= {"start": any_gap.event, "store": tmp_path}
    warm = jp.reach_probability(*args, **options)
    assert warm.value == pytest.approx(found.value, rel=0.05)
    assert warm.gradients < found.gradients
    with monkeypatch.context() as patch:
        patch.setattr(jp.LimitState, "gradients", None)
        assert jp.reach_probability(*args, **options).value == warm.value
    with pytest.raises(ValueError, match="unknown path"):
        jp.reach_probability("fiction", 1e-5, FEW, SHORT, 0.3, progress=False)
    with pytest.raises(ValueError, match="reach_probability: scenarios: z_4 must not be discrete"):
        jp.reach_probability("friction", 1e-5, Chosen(), SHORT, 0.3, progress=False)
