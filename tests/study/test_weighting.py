"""Samples with weights: what they say must be what the distribution that they stand for says."""

import dataclasses
import tracemalloc

import numpy as np
import pytest
from scipy import stats

import jaxpound as jp
from jaxpound.study import statistics, weighting
from tests.refusals import refusals, refused
from tests.study.test_fragility import BETA, THETA, cloud, coverage, errors_are_scatter, stripes
from tests.study.test_run import MEDIAN, SIGMA, linear, study, unit

BELOW = "peak_x1", "required_gap", "pga"


def shifted(found):
    """Weights that turn the study's lognormal intensity into one of another median and sigma."""
    peak = unit().pga
    here, there = (stats.lognorm(s, scale=m * peak) for m, s in ((MEDIAN, SIGMA), (0.4, 0.4)))
    return there.pdf(found["pga"]) / here.pdf(found["pga"])


def test_of_some_samples_that_are_all_the_others_are_not_there():
    """Weights of 2 and 0: every statistic is that of a study of the samples that count."""
    found = linear()
    those = np.arange(len(found)) % 3 == 0
    some = found.weighted(np.where(those, 2.0, 0.0))
    columns = {name: found[name][those] for name in (*BELOW, "min_gap", "pounds")}
    for name, x in columns.items():
        mine, of = some.moments(name), statistics.Moments.of(x)
        assert mine[3:5] == of[3:5]
        assert (mine.mean, mine.std) == pytest.approx((of.mean, of.std))
    k, n = np.sum(columns["required_gap"] > 0.5), those.sum()
    exact = stats.binomtest(int(k), int(n)).proportion_ci(method="exact")
    assert some.exceedance("required_gap", 0.5)[:3] == pytest.approx((k / n, *exact))
    assert some.pounding_probability(0.5)[:3] == pytest.approx((k / n, *exact))
    mine, of = some.required_gap(0.1), statistics.quantile(columns["required_gap"], 0.9)
    assert mine[:3] == pytest.approx(of[:3], rel=0.01)
    rank = stats.spearmanr(columns["required_gap"], found.points()[those, 0]).statistic
    assert some.correlations()["amplitude"] == pytest.approx(rank)
    np.testing.assert_array_equal(some.weights, np.where(those, 2.0, 0.0))
    rules = some.separation(0.1)
    u1 = statistics.quantile(columns["peak_x1"], 0.9).value
    assert rules.absolute_sum - u1 == pytest.approx(some.quantile("peak_x2", 0.9).value, rel=0.01)
    assert "weighted" in repr(some)


@pytest.mark.parametrize("normalised", [True, False])
def test_importance_samples_say_what_their_target_does(normalised):
    """The study is linear: its required gap is lognormal, as its intensity is."""
    found = linear()
    there = found.weighted(shifted(found), normalised=normalised)
    gap = float(1.0 - unit().min_gap)  # of an amplitude of 1
    truth = stats.lognorm(0.4, scale=0.4 * gap)
    moments = there.moments("required_gap")
    assert moments.mean == pytest.approx(truth.mean(), rel=0.03)
    assert moments.std == pytest.approx(truth.std(), rel=0.06)
    for p in (0.5, 0.05, 0.005):
        low, high = there.pounding_probability(truth.isf(p), 0.999)[1:3]
        assert low < p < high < 6 * low
        low, high = there.required_gap(p, 0.999)[1:3]
        assert low < truth.isf(p) < high
    assert there.counts("pounds")[1] == pytest.approx(there.pounding_probability())


def test_fragilities_depend_neither_on_how_intensities_are_drawn_nor_on_repetition():
    im, pounding = cloud(20_000)
    w = stats.lognorm.pdf(im, 0.3, scale=0.5) / stats.lognorm.pdf(im, 0.6, scale=0.3)
    fit = jp.fit_fragility(im, pounding, weights=w)
    assert abs(fit.median - THETA) < 4 * fit.median_error < 0.1
    assert abs(fit.dispersion - BETA) < 4 * fit.dispersion_error < 0.1
    again = jp.fit_fragility(im, pounding, weights=1e-6 * w)
    assert again.median == pytest.approx(fit.median)
    np.testing.assert_allclose(again.covariance, fit.covariance)
    levels, k, n = stripes()
    w = np.array([1, 3, 2, 1, 4, 1])
    one, other = jp.fit_fragility(levels, k, n, weights=w), jp.fit_fragility(levels, w * k, w * n)
    assert (one.median, one.dispersion) == pytest.approx((other.median, other.dispersion))
    # A run that is drawn three times is one run: no smaller errors.
    assert one.median_error > 1.2 * other.median_error


def test_white_s_errors_are_the_scatter_of_repetitions():
    def fit(seed):
        im, pounding = cloud(600, seed)
        return jp.fit_fragility(im, pounding, weights=1 / im)

    fits = [fit(seed) for seed in range(200)]
    assert 0.83 < coverage(fits[:100]) < 0.96
    errors_are_scatter(fits, np.median, 0.25)
    assert fits[0].band([0.0])[1] < 1e-200


def draws(n, seed, mean=2.0):
    """Samples of N(mean, 1) with the ratio of densities to N(0, 1)."""
    x = np.random.default_rng(seed).normal(mean, 1.0, n)
    return x, np.exp(mean**2 / 2 - mean * x)


def test_intervals_cover_rare_probabilities_and_quantiles():
    """The smallest, 1.3e-3, with 200 samples: a plain sample would need 7,000 for this."""
    covered, widths = [], []
    for seed in range(300):
        x, w = draws(200, seed)
        estimate = weighting.Hits.of(x > 3.0, w).estimate(False, 0.9)
        covered.append(estimate.low <= stats.norm.sf(3) <= estimate.high)
        widths.append(estimate.high / estimate.low)
    assert 0.86 < np.mean(covered) < 0.96
    assert np.median(widths) < 2.2
    for normalised, tail, mean in ((False, 1e-3, 2.5), (True, 0.3, 0.7), (False, 0.02, 2.0)):
        covered = []
        for seed in range(200):
            x, w = draws(400, seed, mean)
            found = weighting.quantile(x, w, 1 - tail, normalised, 0.9)
            covered.append(found.low <= stats.norm.isf(tail) <= found.high)
        assert 0.83 < np.mean(covered) < 0.97, (normalised, tail)
    x, w = draws(400, 0)
    high, low = (weighting.quantile(s * x, w, p, False) for s, p in ((1, 0.99), (-1, 0.01)))
    assert low[:3] == (-high.value, -high.high, -high.low)
    x = np.arange(10.0)
    found = weighting.quantile(x, np.ones(10), 0.9, True)
    assert found.high == np.inf == statistics.quantile(x, 0.9).high
    none = weighting.Hits.of(x > 20, np.ones(10)).estimate(True)
    assert none[:2] == (0.0, 0.0)
    assert none.high == pytest.approx(stats.beta.ppf(0.975, 1, 10))


def test_a_column_s_weights_are_read_with_the_others(tmp_path):
    measures = {"weight": lambda structures, ground: structures.friction**2}
    found = study(n=50, store=tmp_path, measures=measures)
    by_name = jp.Study.open(tmp_path).weighted("weight")
    by_array = found.weighted(found["weight"])
    for_name, for_array = ([*x.exceedance("required_gap", 0.2)] for x in (by_name, by_array))
    assert for_name == pytest.approx(for_array)
    gap, w = float(np.median(found["required_gap"])), found["weight"]
    curve = by_name.fragility(gap=gap)
    plain = jp.fit_fragility(found["pga"], found["required_gap"] >= gap, weights=w)
    assert (curve.median, curve.dispersion) == (plain.median, plain.dispersion)
    assert by_name.moments("peak_f1") == pytest.approx(by_array.moments("peak_f1"))


def test_a_study_with_weights_needs_no_more_memory():
    """Column by column, part by part: 64 parts of a column that is never whole in memory."""
    found = linear()
    part = np.random.default_rng(0).normal(size=16_384)
    rows, total = [range(64 * part.size)], statistics.Moments.of(part)
    moments = dict.fromkeys(("pga", "weight", "required_gap"), total._replace(smallest=0.0))
    parts = lambda name: (np.abs(part) for _ in range(64))  # noqa: E731
    large = dataclasses.replace(found, rows=rows, _parts=parts, _moments=moments)
    large = large.weighted("weight")
    tracemalloc.start()
    found = large.moments("required_gap"), large.pounding_probability(1.0)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 12 * part.nbytes
    assert found[0].n == 64 * part.size
    w = np.abs(part)
    assert found[0].mean == pytest.approx((w @ w) / w.sum())
    assert found[1].value == pytest.approx(w[w >= 1].sum() / w.sum())


def test_weights_of_runs_that_failed_do_not_matter():
    found = linear()
    parts = {name: np.array(found[name]) for name in found.columns}
    for column in parts.values():
        column[:3] = np.nan
    moments = {name: statistics.Moments.of(x[~np.isnan(x)]) for name, x in parts.items()}
    some = dataclasses.replace(found, _parts=lambda name: (parts[name],), _moments=moments)
    hazard = jp.HazardCurve([1e-3, 10.0], [1.0, 1e-4])
    weights = hazard.weights(some["pga"], jp.LogNormal(MEDIAN * float(unit().pga), SIGMA))
    assert np.isnan(weights[:3]).all()
    there = some.weighted(weights)
    np.testing.assert_array_equal(there.weights, weights)
    rest = np.where(np.isnan(weights), 0.0, weights)
    of = found.weighted(rest).pounding_probability(0.5)
    assert there.pounding_probability(0.5) == pytest.approx(of)
    nowhere, words = np.full(len(some), np.nan), r"weights = nan .* must be finite and not negative"
    refused(words, some.weighted, nowhere)


test_bad_weights_are_named = refusals(
    (lambda x: x.weighted("wait"), "Study.weighted: column 'wait' must be one of"),
    (lambda x: x.weighted([1.0]), r"Study.weighted: weights of shape .* must be \(4000,\)"),
    (lambda x: x.weighted("min_gap"), "weights = -.* must be finite and not negative"),
    (lambda x: x.weighted(np.zeros(4000)), "sum of the weights = 0 must be positive"),
    (lambda x: x.weighted("first_impact_time"), "be one of|be finite in every run"),
    (lambda x: jp.fit_fragility([1, 2], [0, 1], weights=[1]), r"of shape \(1,\) must be \(2,\)"),
    (lambda x: jp.fit_fragility([1, 2], [0, 1], weights=[1, -1]), "weights = -1 .* negative"),
    (lambda x: jp.fit_fragility([1, 2], [0, 1], weights=[0, 0]), "sum of the weights = 0 must"),
    (lambda x: jp.fit_fragility([1, 2], [0, 1], weights=[1, 0]), "it never occurs"),
    (lambda x: weighting.quantile(np.ones(0), np.ones(0), 0.5, True), r"\(0,\) must be \(n,\)"),
    of=lambda call: call(linear()),
)
