import numpy as np
import pytest
from scipy import stats
from scipy.optimize import minimize

import jaxpound as jp
from tests.refusals import refusals

THETA, BETA = 0.4, 0.5


def cloud(n, seed=0):
    random = np.random.default_rng(seed)
    im = np.exp(random.normal(np.log(0.3), 0.6, n))
    return im, random.random(n) < stats.norm.cdf(np.log(im / THETA) / BETA)


def stripes(seed=0, trials=40):
    levels, trials = np.array([0.1, 0.2, 0.3, 0.5, 0.8, 1.2]), np.full(6, trials)
    chances = stats.norm.cdf(np.log(levels / THETA) / BETA)
    return levels, np.random.default_rng(seed).binomial(trials, chances), trials


def by_runs(hits, trials):
    return np.concatenate([np.arange(n) < k for k, n in zip(hits, trials, strict=True)])


def test_known_parameters_are_recovered_within_errors_that_are_their_scatter():
    fit = jp.fit_fragility(*cloud(100_000))
    assert fit.median == pytest.approx(THETA, rel=0.01)
    assert fit.dispersion == pytest.approx(BETA, rel=0.02)
    assert abs(fit.median - THETA) < 4 * fit.median_error < 0.01
    assert abs(fit.dispersion - BETA) < 4 * fit.dispersion_error < 0.02
    np.testing.assert_allclose(fit.probability(THETA * np.exp(BETA)), stats.norm.cdf(1), atol=0.02)
    assert fit.probability(0.0) == 0
    low, high = fit.band([fit.median])
    slope = stats.norm.pdf(0) / fit.dispersion * fit.median_error / fit.median
    assert (high - low)[0] == pytest.approx(2 * 1.96 * slope, rel=1e-3)
    assert low[0] < 0.5 < high[0]
    fits = [jp.fit_fragility(*cloud(400, seed)) for seed in range(200)]
    errors_are_scatter(fits, np.mean, 0.2)


@pytest.mark.parametrize("data", [cloud(500), stripes()], ids=["cloud", "stripes"])
def test_estimates_and_errors_are_those_of_statsmodels_probit(data):
    sm = pytest.importorskip("statsmodels.api")
    fit = jp.fit_fragility(*data)
    im, k, n = fit.intensity, fit.pounding, fit.trials
    x = np.repeat(np.log(im), n)
    y = by_runs(k, n)
    theirs = sm.Probit(y.astype(float), sm.add_constant(x)).fit(disp=0, tol=1e-12)
    a, b = theirs.params
    assert fit.median == pytest.approx(np.exp(-a / b), rel=1e-7)
    assert fit.dispersion == pytest.approx(1 / b, rel=1e-7)
    to = np.array([[-1 / b, a / b**2], [0, -1 / b**2]])
    np.testing.assert_allclose(fit.covariance, to @ theirs.cov_params() @ to.T, rtol=1e-5)


def test_stripes_are_the_cloud_of_their_runs_with_one_number_of_trials():
    levels, k, n = stripes()
    im, pounding = np.repeat(levels, n), by_runs(k, n)
    one, other = jp.fit_fragility(levels, k, n), jp.fit_fragility(im, pounding)
    assert one.median == pytest.approx(other.median, rel=1e-9)
    np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-6)
    assert (n == n[0]).all()
    one, each = jp.fit_fragility(levels, k, int(n[0])), jp.fit_fragility(levels, k, n)
    assert (one.median, one.stripes) == (each.median, True)
    np.testing.assert_array_equal(one.trials, each.trials)


def test_stripes_are_fitted_as_baker_s_own_program_fits_its_example():
    """The data of the example of Baker's public program for his eq. (11), 40 motions a stripe.

    The program maximises the binomial likelihood of (θ, β) by a simplex from (0.8, 0.4).
    """
    levels = np.array([0.2, 0.3, 0.4, 0.6, 0.7, 0.8, 0.9, 1.0])
    collapses, motions = np.array([0, 0, 0, 4, 6, 13, 12, 16]), np.full(8, 40)

    def unlikelihood(x):
        p = stats.norm.cdf(np.log(levels), np.log(x[0]), x[1])
        return -np.sum(stats.binom.logpmf(collapses, motions, p))

    theirs = minimize(unlikelihood, [0.8, 0.4], method="Nelder-Mead", options={"xatol": 1e-9})
    fit = jp.fit_fragility(levels, collapses, motions)
    assert (fit.median, fit.dispersion) == pytest.approx(theirs.x, rel=1e-5)
    assert (round(fit.median, 3), round(fit.dispersion, 3)) == (1.076, 0.429)


@pytest.mark.parametrize(
    "draw",
    [
        lambda seed: cloud(300, seed),
        stripes,
        lambda seed: cloud(60, seed),  # little data
        lambda seed: stripes(seed, 15),
    ],
)
def test_the_band_covers_the_truth(draw):
    fits = (jp.fit_fragility(*draw(seed)) for seed in range(200))
    assert 0.89 < coverage(fits) < 0.98


def coverage(fits):
    """How often the bands of 90 % cover the truth."""
    at = np.array([0.2, 0.4, 0.8])
    truth = stats.norm.cdf(np.log(at / THETA) / BETA)
    ends = [fit.band(at, 0.9) for fit in fits]
    return np.mean([(low <= truth) & (truth <= high) for low, high in ends])


def errors_are_scatter(fits, average, rel):
    for name in ("median", "dispersion"):
        scatter = np.std([getattr(fit, name) for fit in fits])
        told = average([getattr(fit, f"{name}_error") for fit in fits])
        assert told == pytest.approx(scatter, rel=rel)


def test_a_curve_in_numbers_needs_no_data():
    curve, z = jp.study.Fragility(0.6, 0.4), np.log([0.4 / 0.6])
    expected = [0, stats.norm.cdf(z[0] / 0.4), 1]
    np.testing.assert_allclose(curve.probability([0.0, 0.4, np.inf]), expected)
    assert "fitted" not in repr(curve)
    assert np.isnan(curve.band([0.4])).all()
    known = jp.study.Fragility(0.6, 0.4, np.diag([0.01, 0.0]))
    low, high = known.band([0.4], 0.9)
    reach = stats.norm.ppf(0.95) * 0.1
    np.testing.assert_allclose(low, stats.norm.cdf((z - reach) / 0.4))
    np.testing.assert_allclose(high, stats.norm.cdf((z + reach) / 0.4))


test_what_cannot_be_fitted_says_why = refusals(
    (lambda: jp.fit_fragility([], []), r"intensity \(0,\), pounding \(0,\)"),
    (lambda: jp.fit_fragility([1.0, 2.0], [True]), r"pounding \(1,\)"),
    (lambda: jp.fit_fragility([0.0, 1.0], [0, 1]), "intensity = 0 .* must be positive"),
    (lambda: jp.fit_fragility([1.0, 2.0], [0, 3], [2, 2]), "pounding = 3 .* must be from 0 to"),
    (lambda: jp.fit_fragility([1.0, 2.0], [0, 0], [2, 0]), "trials = 0 .* must be whole"),
    (lambda: jp.study.Fragility(-0.6, 0.4), "Fragility: median = -0.6 must be positive"),
    (lambda: jp.study.Fragility(0.6, 0.0), "Fragility: dispersion = 0 must be positive"),
    (lambda: jp.study.Fragility(0.6, [0.4, 0.5]), r"dispersion of shape \(2,\) must be one number"),
    (
        lambda: jp.study.Fragility(0.6, 0.4, [0.1, 0.1]),
        r"covariance of shape \(2,\) must be \(2, 2",
    ),
    (lambda: jp.fit_fragility("im", [0, 1]), "fit_fragility: intensity = 'im' must be a real"),
    (lambda: jp.fit_fragility([1.0, 2.0], ["no", "yes"]), "pounding = .* must be a real"),
    (lambda: jp.fit_fragility(*stripes()).probability(-1.0), "intensity = -1 must be not neg"),
    (lambda: jp.fit_fragility([1.0, 2.0], [0, 0]), "it never occurs"),
    (lambda: jp.fit_fragility([1.0, 2.0], [1, 1]), "it always occurs"),
    (lambda: jp.fit_fragility([1.0, 2.0, 3.0], [0, 0, 1]), "always occurs above im = 2 and never"),
    (lambda: jp.fit_fragility([0.3, 0.3], [1, 0]), "all intensities are 0.3"),
    (lambda: jp.fit_fragility([1.0, 2.0, 3.0], [1, 0, 0]), "does not become more frequent"),
    (lambda: jp.fit_fragility(*stripes()).band([1.0], 1.0), "confidence = 1 must be between"),
)
