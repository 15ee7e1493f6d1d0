"""Rare events by subset simulation, against closed forms and plain Monte Carlo."""

import dataclasses
import re
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import ndtr, ndtri

import jaxpound as jp
from jaxpound.reliability import SubsetSearch
from tests.pickled import assert_survives_pickling
from tests.refusals import refusals, refused
from tests.reliability.searches import event_of, simulated

GRID = jp.TimeGrid.until(4.0, dt=0.1)
SLIDING = dataclasses.replace(jp.paper.structures(), friction=0.0)


def wave(z):
    """Its amplitude is normal, whatever the number of z."""
    return jp.Ricker(z.sum() / jnp.sqrt(len(z)), [2.0], [1.5])


SCENARIOS = jp.Scenarios(SLIDING, jp.CustomDraw(wave, 4))


@pytest.fixture(scope="module")
def scaled():
    """Without friction a peak is proportional to the amplitude of the ground: half-normal."""
    state = jp.LimitState(SCENARIOS, GRID, demand="peak_x1", threshold=1.0)
    of_one = float(state.value(jnp.full(4, 0.5))) + 1.0
    return lambda beta: dataclasses.replace(state, threshold=beta * of_one)


@pytest.fixture(scope="module")
def four(scaled):
    return simulated(scaled(4.0), progress=False)


def test_a_half_normal_peak(scaled, four):
    for beta, event in ((2.5, simulated(scaled(2.5), progress=False)), (4.0, four)):
        exact = 2 * ndtr(-beta)
        assert abs(event.probability - exact) < 3 * event.cov * exact
        assert 0.01 < event.cov < 0.2
        assert event.beta == pytest.approx(-float(ndtri(event.probability)))
        assert (event.warnings, event.gradients, event.design_points.z.shape) == ((), 0, (0, 4))
        assert np.isnan(event.form)
        again = assert_survives_pickling(event)
    np.testing.assert_array_equal(
        again.limit_state.values(four.samples.points[:3]), four.samples.values[:3]
    )


def test_the_weighted_points_are_a_sample_whose_tail_falls_as_a_normal_one(four):
    samples = four.samples
    assert len(samples.points) == len(samples.values) == len(samples.weights) == four.runs
    assert samples.weights.mean() == pytest.approx(1.0)
    assert np.mean(samples.weights * (samples.values >= 0)) == pytest.approx(four.probability)
    unit = four.limit_state.level / 4.0
    for beta in (1.0, 2.0, 3.0):
        likelier = np.mean(samples.weights * (samples.values >= (beta - 4.0) * unit))
        assert likelier == pytest.approx(2 * ndtr(-beta), rel=0.15)
    # −d ln P/db of a normal tail; its error is that of the repeats, whose samples are alike.
    exact = np.exp(-(4.0**2) / 2) / np.sqrt(2 * np.pi) / ndtr(-4.0) / unit
    assert abs(four.decay.value - exact) < 3 * four.decay.error
    assert 0.01 < four.decay.error / exact < 0.1
    independent = resampled(four, repeats=np.zeros(0, int))
    assert four.decay.error > 1.2 * independent.decay.error


def resampled(event, **changes):
    """The event with other arrays of its samples."""
    samples = dataclasses.replace(event.samples, **changes)
    return dataclasses.replace(event, samples=samples)


@pytest.mark.parametrize("index", [1.4, 2.0, 4.0])
def test_slopes_of_a_tail_as_heavy_as_that_of_a_hazard_curve(four, index):
    """The exceedance of a demand y falls as y^(-index), as factors of a hazard curve make it."""
    unit = four.limit_state.level / 4.0
    peaks = four.samples.values / unit + 4.0
    demands = (2 * ndtr(-peaks)) ** (-1 / index)
    threshold = float((2 * ndtr(-4.0)) ** (-1 / index))
    demand_of = {z.tobytes(): y for z, y in zip(four.samples.points, demands, strict=True)}

    def sensitivities(points, chosen):
        return {"factor of the ground": np.array([demand_of[z.tobytes()] for z in points])}

    state = SimpleNamespace(sensitivities=sensitivities)
    event = dataclasses.replace(resampled(four, values=demands - threshold), limit_state=state)
    assert abs(event.decay.value - index / threshold) < 3 * event.decay.error
    assert event.decay.error < 0.1 * event.decay.value
    (slope,) = event.slopes_by().values()
    assert abs(slope.value - index) < 3 * slope.error
    assert slope.error < 0.1 * slope.value


def test_trains_of_wavelets_with_random_signs_against_plain_monte_carlo():
    """Three wavelets: twelve numbers, three of them discrete."""
    ground = jp.RandomRicker(3, jp.LogNormal(0.1, 0.5), jp.Uniform(1, 3.8), jp.Uniform(1, 5))
    n, grid = 20_000, jp.TimeGrid.until(8.0, dt=0.1)
    trains = jp.LimitState(jp.Scenarios(jp.paper.structures(), ground), grid, threshold=0.62)
    values = trains.values(np.random.default_rng(1).standard_normal((n, trains.dimension)))
    for more in (0.0, 0.15):  # 1e-2 and 1e-3, nearly
        exact = np.mean(values >= more)
        event = simulated(dataclasses.replace(trains, threshold=0.62 + more), progress=False)
        error = np.hypot(event.cov * exact, np.sqrt(exact / n))
        assert 2e-4 < exact < 3e-2
        assert abs(event.probability - exact) < 3 * error


def test_the_wanted_coefficient_of_variation_is_reached_by_more_repeats_under_a_bar(scaled, capsys):
    few = simulated(scaled(3.0), n=200, repeats=4, progress=False)
    many = simulated(scaled(3.0), n=200, repeats=4, cov=0.05, progress=False)
    assert few.cov > 0.05 >= many.cov
    assert many.runs > few.runs
    assert "4 repeats" in few.method
    bounded = simulated(scaled(3.0), n=200, repeats=4, cov=0.01, max_runs=8_000, progress=False)
    assert bounded.runs <= 8_000
    assert any("max_runs" in x for x in bounded.warnings)
    simulated(scaled(3.0), n=200, repeats=4)
    shown = capsys.readouterr().err
    assert "P < 0.1" in shown
    assert "c.o.v." in shown


def test_the_stated_interval_covers():
    """Of 60 studies with 95 % intervals at least 51 (85 %) hold the exact number."""
    exact = ndtr(-3.5)
    found = [simulated(Plane(3.5), n=400, key=k, progress=False) for k in range(60)]
    inside = [x.estimate.low <= exact <= x.estimate.high for x in found]
    assert sum(inside) >= 51
    measured = np.std([x.probability for x in found], ddof=1) / exact
    stated = np.mean([x.cov for x in found])
    assert 1 / 1.5 < measured / stated < 1.5
    assert np.mean([x.probability for x in found]) == pytest.approx(exact, rel=0.05)


def test_events_that_always_occur_or_are_out_of_reach(scaled):
    event = simulated(scaled(0.0), n=100, repeats=2, progress=False)
    assert event.probability == 1
    sure = "the event occurs in each of 200 random runs: its probability is above 0.985133 (95 %)"
    assert event.warnings == (sure,)
    state = scaled(30.0)
    event = simulated(state, n=100, repeats=2, progress=False)
    assert event.probability == 1e-12
    assert np.isnan(event.cov)
    (warning,) = event.warnings
    assert warning.startswith("out of reach: the probability is below 1e-12")
    assert "is a bound and no estimate" in warning
    nearest = float(re.search(r"stays ([\d.]+) below the threshold", warning)[1])
    assert 0.6 * state.level < nearest < 0.85 * state.level  # 7 standard deviations of 30


class Plane:
    """A limit state without a simulation, so that a study of studies takes a second."""

    dimension, level = 10, 0.0

    def __init__(self, beta, changed=lambda z, values: values):
        self.beta, self.changed = beta, changed

    def values(self, z):
        return self.changed(z, z.sum(axis=1) / np.sqrt(self.dimension) - self.beta)


def test_runs_that_fail_or_are_all_the_same_and_few_repeats_are_told():
    # No contact, no force: plain samples bound the probability, and no more is said.
    silent = Plane(9.0, lambda z, values: np.maximum(values, -1.0))
    event = simulated(silent, n=100, repeats=2, progress=False)
    assert event.probability == pytest.approx(0.015, rel=0.01)  # 1 − 0.05^(1/200)
    words = "in which the largest demands are all the same; the demand stays 1 below"
    assert words in event.warnings[0]
    failing = Plane(2.5, lambda z, values: np.where(z[:, 0] > 1, np.nan, values))
    event = simulated(failing, progress=False)
    assert 0.1 * ndtr(-2.5) < event.probability < ndtr(-2.5)
    assert re.match(r"[\d,]+ of [\d,]+ runs failed and count as safe", event.warnings[0])
    for value, words in ((np.nan, "be a number, but is none in 1,000"), (-0.1, "depend on the")):
        constant = Plane(0.0, lambda z, values, value=value: np.full(len(z), value))
        refused(f"demand must {words} random", simulated, constant, progress=False)

    def hidden(z, values):
        """Failures that lie in a corner which the way up does not pass."""
        return np.where(np.abs(z[:, 0]) > 3.6, 1.0, np.minimum(values, -1.0))

    event = simulated(Plane(5.0, hidden), n=100, repeats=10, progress=False)
    assert any("repeats never reach" in x for x in event.warnings)
    assert any("tells the order of magnitude" in x for x in event.warnings)


LONG = {"demand": "peak_x" + "9" * 3000, "threshold": 1.0}
test_arguments_that_break_a_rule = refusals(
    ({"cov": -0.1}, "cov = -0.1 must be positive"),
    ({"key": -1}, "key = -1 must be a whole number from 0"),
    ({"search": SubsetSearch(max_runs=10**12)}, "max_runs = 1,000,000,000,000 would take"),
    ({"search": 100}, "search = 100 must be of type SubsetSearch"),
    ({"gap": -0.1}, "gap = -0.1 must be finite and not negative"),
    ({"gap": 0.3, "demand": "peak_x1"}, "gap = 0.3 must be None"),
    ({"demand": "peak_y", "threshold": 1.0}, "unknown demand 'peak_y'"),
    ({"demand": "y" * 3000}, r"unknown demand 'y{12}\.\.\.y{13}'; demands are named"),
    (LONG, r"unknown demand 'peak_x9{6}\.\.\.9{13}'; (did you mean|allowed)"),
    of=lambda wrong: jp.subset_simulation(SCENARIOS, GRID, **{"progress": False} | wrong),
)
test_samples_that_break_a_rule = refusals(
    ({"n": 0}, "n = 0 must be a positive whole number"),
    ({"n": 50}, "p0 n = 5 must be at least 10"),
    ({"p0": 0.7}, r"p0 = 0.7 must be in \(0, 0.5\]"),
    ({"p0": 0.0}, r"p0 = 0 must be in \(0, 0.5\]"),
    (
        {"repeats": 1},
        r"repeats = 1 must be at least 2 \(for the spread of the estimate\)",
    ),
    of=lambda wrong: SubsetSearch(**wrong),
    before="SubsetSearch: ",
)

STORED = {"n": 300, "repeats": 10, "key": 3, "progress": False}  # two parts at the first level


def stopped(monkeypatch, after, call, method="values", owner=jp.LimitState):
    """The runs of a search that is stopped by an interrupt in one of its batches."""
    made, run = [], getattr(owner, method)

    def stopping(self, z, *arguments):
        if len(made) == after:
            raise KeyboardInterrupt
        made.append(len(z))
        return run(self, z, *arguments)

    with monkeypatch.context() as patch:
        patch.setattr(owner, method, stopping)
        with pytest.raises(KeyboardInterrupt):
            call()
    return sum(made)


def without_runs(monkeypatch, state, **options):
    """A search that finds all it needs in its store."""
    with monkeypatch.context() as patch:
        patch.setattr(jp.LimitState, "values", None)
        return simulated(state, **options)


def assert_same(found, expected):
    for name in ("points", "weights", "values", "repeats"):
        arrays = (getattr(event.samples, name) for event in (found, expected))
        np.testing.assert_array_equal(*arrays)
    for name in ("probability", "cov", "runs", "method", "warnings"):
        assert getattr(found, name) == getattr(expected, name)


@pytest.fixture(scope="module")
def whole(scaled):
    return simulated(scaled(3.0), **STORED)


def test_a_stopped_search_goes_on_and_damaged_files_are_made_anew(
    scaled, whole, tmp_path, monkeypatch
):
    """Stopped within the first level, and within others; all that was done is kept."""
    state, folder = scaled(3.0), tmp_path / "search"
    options = STORED | {"store": folder}
    ran = sum(stopped(monkeypatch, k, lambda: simulated(state, **options)) for k in (1, 9))
    counted, run = [], jp.LimitState.values
    with monkeypatch.context() as patch:
        patch.setattr(jp.LimitState, "values", lambda s, z: counted.append(len(z)) or run(s, z))
        assert_same(simulated(state, **options), whole)
    assert ran + sum(counted) == whole.runs
    assert_same(without_runs(monkeypatch, state, **options), whole)
    files = sorted(folder.glob("chunk-*.npz"))
    for path in (files[1], files[4]):
        path.write_bytes(path.read_bytes()[:-9])
    words = r"store .*search: chunk 1 is damaged .*; chunk 4 is .*; its runs are made anew"
    with pytest.warns(UserWarning, match=words):
        assert_same(simulated(state, **options), whole)
    assert_same(without_runs(monkeypatch, state, **options), whole)
    assert sorted(folder.glob("chunk-*.npz")) == files


def test_a_store_grows_to_more_repeats_and_a_smaller_cov(scaled, whole, tmp_path, monkeypatch):
    state, options = scaled(3.0), STORED | {"store": tmp_path / "search"}
    few = simulated(state, **options | {"repeats": 4})
    assert_same(simulated(state, **options), whole)
    assert_same(without_runs(monkeypatch, state, **options | {"repeats": 4}), few)
    finer = {"cov": 0.6 * whole.cov}
    found = simulated(state, **options, **finer)
    assert found.runs > 2 * whole.runs
    assert_same(found, simulated(state, **STORED, **finer))
    assert_same(without_runs(monkeypatch, state, **options), whole)


def test_another_search_is_refused(scaled, tmp_path):
    options = STORED | {"store": tmp_path / "search", "n": 100, "repeats": 2}
    simulated(scaled(2.0), **options)
    for state, changed, words in (
        (scaled(2.5), {}, r"threshold is .* there and .* here"),
        (scaled(2.0), {"n": 200}, "n is 100 there and 200 here"),
        (scaled(2.0), {"p0": 0.2}, r"p0 is 0\.1 there and 0\.2 here"),
        (scaled(2.0), {"key": 4}, "key.numbers is .* there and .* here"),
    ):
        refused(f"holds another study: {words}", simulated, state, **options | changed)
    words = "search is 'a subset simulation' there and 'a search by design"
    stored = {"store": options["store"], "progress": False}
    refused(words, event_of, scaled(2.0), method="design points", **stored)
    refused("must hold a study, but holds a subset simulation", jp.Study.open, stored["store"])


def test_a_search_that_falls_back_on_subset_simulation_goes_on(tmp_path, monkeypatch):
    """Its gradients are zero: nothing leads to the limit state, and that is kept too."""

    def rounded(z):
        return jp.Ricker(0.05 * jnp.round(z.sum()) / jnp.sqrt(30), [2.0], [1.5])

    scenarios = jp.Scenarios(SLIDING, jp.CustomDraw(rounded, 30))
    state = jp.LimitState(scenarios, GRID, demand="peak_x1", threshold=0.25)
    options = {"store": tmp_path / "search", "progress": False, "cov": 0.3}
    first = event_of(state, **options)
    assert "to the limit state: subset simulation" in first.method
    with monkeypatch.context() as patch:
        for name in ("values", "values_and_times", "gradients"):
            patch.setattr(jp.LimitState, name, None)
        assert_same(event_of(state, **options), first)
    for name in ("design-points.npz", "chunk-000000.npz"):
        (options["store"] / name).write_bytes(b"damaged")
    told = [rf"search: {x} is damaged .* made anew" for x in ("design-points.npz", "chunk 0")]
    with pytest.warns(UserWarning, match=told[0]), pytest.warns(UserWarning, match=told[1]):
        assert_same(event_of(state, **options), first)


KILLED = """
import sys
import jax
jax.config.update("jax_enable_x64", True)
import jaxpound as jp
from jaxpound._xla import plan
plan.choose(plan.looped)
from tests.reliability.searches import simulated
from tests.reliability.test_subset import GRID, SCENARIOS, STORED
event = {"demand": "peak_x1", "threshold": float(sys.argv[2])}
state = jp.LimitState(SCENARIOS, GRID, **event)
simulated(state, **STORED, store=sys.argv[1])
"""


def test_a_search_killed_at_any_moment_goes_on(scaled, whole, tmp_path, monkeypatch):
    """SIGKILL while a part is run or written."""
    state, folder = scaled(3.0), tmp_path / "search"
    command = [sys.executable, "-c", KILLED, str(folder), repr(state.threshold)]
    with subprocess.Popen(command, stderr=subprocess.PIPE) as worker:
        while worker.poll() is None and len([*folder.glob("chunk-*.npz")]) < 3:
            time.sleep(0.001)
        worker.kill()
        _, errors = worker.communicate()
    assert worker.returncode == -signal.SIGKILL, errors
    assert_same(simulated(state, **STORED, store=folder), whole)
    assert not [*folder.glob("*.part")]
