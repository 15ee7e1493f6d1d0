"""Clouds: the regression, its fragility, and demands that are only known to be large."""

import numpy as np
import pytest
from scipy import optimize, stats

import jaxpound as jp
from tests.ground.test_suite import SUITE
from tests.hazard.test_ida import GAP, PAIR, analysed
from tests.hazard.test_stripes import ROW
from tests.pickled import assert_survives_pickling
from tests.refusals import refusals

RANDOM = np.random.default_rng(3)
IM = np.exp(RANDOM.uniform(-2, 0.5, 400))
DEMAND = 0.1 * IM**1.2 * np.exp(0.3 * RANDOM.standard_normal(400))


def of_pair(**changed):
    return jp.cloud_analysis(jp.Analysis(PAIR, SUITE, **changed))


def of_row():
    return jp.cloud_analysis(jp.Analysis(ROW, SUITE))


def test_a_cloud_is_a_regression_of_logarithms_and_its_fragility_the_share_above_the_threshold():
    cloud = jp.hazard.fit_cloud(IM, DEMAND)
    known = stats.linregress(np.log(IM), np.log(DEMAND))
    assert cloud.slope == pytest.approx(known.slope)
    assert cloud.intercept == pytest.approx(known.intercept)
    errors = np.sqrt(np.diag(cloud.line.covariance))
    np.testing.assert_allclose(errors[:2], [known.intercept_stderr, known.stderr])
    assert cloud.dispersion == pytest.approx(0.3, rel=0.1)
    np.testing.assert_allclose(cloud.median(1.0), np.exp(known.intercept))
    curve = cloud.fragility(0.05)
    for im in (0.3, 0.6):
        z = (np.log(0.05) - np.log(cloud.median(im))) / cloud.dispersion
        assert curve.probability(im) == pytest.approx(stats.norm.sf(z))
    # Its standard errors are those of many clouds of this size.
    found = []
    for _ in range(400):
        demand = 0.1 * IM**1.2 * np.exp(0.3 * RANDOM.standard_normal(IM.size))
        one = jp.hazard.fit_cloud(IM, demand).fragility(0.05)
        found.append((np.log(one.median), one.dispersion))
    np.testing.assert_allclose(np.std(found, axis=0), np.sqrt(np.diag(curve.covariance)), rtol=0.15)
    (low, high), middle = curve.band([0.3, 0.6]), curve.probability([0.3, 0.6])
    assert ((low < middle) & (middle < high) & (high - low < 0.2)).all()


def test_censored_demands_maximise_the_likelihood():
    limit = 0.08
    cloud = jp.hazard.fit_cloud(IM, DEMAND, limit)
    assert cloud.censored.sum() == (limit <= DEMAND).sum() > 50

    def unlikely(p):
        z = (np.log(np.minimum(DEMAND, limit)) - p[0] - p[1] * np.log(IM)) / p[2]
        known = stats.norm.logpdf(z) - np.log(p[2])
        return -np.where(cloud.censored, stats.norm.logsf(z), known).sum()

    best = optimize.minimize(unlikely, [-2.0, 1.0, 0.5], method="Nelder-Mead", tol=1e-10)
    values = [cloud.intercept, cloud.slope, cloud.dispersion]
    np.testing.assert_allclose(values, best.x, rtol=1e-4)
    # The truth is found again, which the demands below the limit alone do not give.
    errors = np.sqrt(np.diag(cloud.line.covariance))
    assert (np.abs(values - np.array([np.log(0.1), 1.2, 0.3])) < 3 * errors).all()
    assert (
        jp.hazard.fit_cloud(IM[limit > DEMAND], DEMAND[limit > DEMAND]).slope < 1.2 - 3 * errors[1]
    )


def test_records_as_they_are():
    cloud = of_pair()
    np.testing.assert_allclose(cloud.intensity, SUITE.pgas)
    single = analysed(intensities=[1.0], measure=np.ones(3))
    np.testing.assert_allclose(cloud.demand, single.demands[:, 0], rtol=1e-10)
    assert cloud.threshold == pytest.approx(GAP)
    assert "required gap (m) of 3 records over PGA (g)" in repr(cloud)
    assert_survives_pickling(cloud)


test_wrong_arguments = refusals(
    (lambda: jp.hazard.fit_cloud([1.0, 2.0], [1.0, 2.0]), "at least 3 records"),
    (lambda: jp.hazard.fit_cloud([1.0] * 3, [1.0, 2.0, 3.0]), "of different intensity"),
    (lambda: jp.hazard.fit_cloud(IM, DEMAND, 1e-6), "below the limit"),
    (lambda: jp.hazard.fit_cloud(IM, DEMAND[:2]), r"intensity \(400,\) and demand \(2,\)"),
    (lambda: jp.hazard.fit_cloud(IM, 0.1 * IM**2), "σ = .* must be positive: demands that are a"),
    (lambda: jp.hazard.fit_cloud(IM, 0.1 * IM**2, 0.05), "σ = .* must be positive"),
    (lambda: jp.hazard.fit_cloud(IM, -DEMAND), "demand = .* must be positive"),
    (lambda: jp.hazard.fit_cloud(IM, DEMAND).fragility(), "threshold = None must be a number"),
    (
        lambda: jp.hazard.fit_cloud(IM, DEMAND).fragility([0.1, 0.2]),
        r"threshold of shape \(2,\) must",
    ),
    (
        lambda: jp.hazard.fit_cloud(IM, DEMAND).median(-1.0),
        "Cloud.median: intensity = -1 must be pos",
    ),
    (lambda: of_pair(threshold=0), "threshold = 0 must"),
    (of_row, "threshold = None must be a gap: those at rest of the links differ"),
    (lambda: jp.hazard.fit_cloud(IM, 1 / DEMAND).fragility(1.0), "slope b = -1.* must be positive"),
)
