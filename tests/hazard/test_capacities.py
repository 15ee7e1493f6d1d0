"""Fragility from capacities: moments, and the likelihood where some are not known."""

import numpy as np
import pytest
from scipy import stats

import jaxpound as jp
from tests.refusals import refusals

RANDOM = np.random.default_rng(5)
CAPACITIES = 0.6 * np.exp(0.4 * RANDOM.standard_normal(40))


def test_known_and_unknown_capacities_are_fitted():
    curve = jp.hazard.fit_capacities(CAPACITIES)
    z = np.log(CAPACITIES)
    assert curve.median == pytest.approx(np.exp(z.mean()))
    assert curve.dispersion == pytest.approx(z.std(ddof=1))
    assert curve.median_error == pytest.approx(curve.median * z.std(ddof=1) / 40**0.5)
    # Its data are the empirical distribution.
    shares = curve.pounding / curve.trials
    np.testing.assert_allclose(shares, [(x >= CAPACITIES).mean() for x in curve.intensity[:40]])
    assert "from 40 capacities" in repr(curve)
    most = 0.7
    seen = np.where(most >= CAPACITIES, CAPACITIES, np.inf)
    curve = jp.hazard.fit_capacities(seen, most)
    logarithms = np.log(np.minimum(CAPACITIES, most))
    censored = stats.CensoredData.right_censored(logarithms, most < CAPACITIES)
    mean, spread = stats.norm.fit(censored)
    assert np.log(curve.median) == pytest.approx(mean, abs=1e-4)
    assert curve.dispersion == pytest.approx(spread, rel=1e-3)
    assert f"{np.isinf(seen).sum()} more above what was analysed" in repr(curve)


@pytest.mark.parametrize("n", [7, 11, 40])
def test_the_band_covers_the_truth(n):
    """Of suites as small as codes allow, too."""
    at, inside = np.array([0.25, 0.4, 0.6, 0.9, 1.4]), []
    truth = stats.norm.cdf(np.log(at / 0.6) / 0.4)
    for _ in range(600):
        curve = jp.hazard.fit_capacities(0.6 * np.exp(0.4 * RANDOM.standard_normal(n)))
        low, high = curve.band(at, 0.95)
        inside.append((low <= truth) & (truth <= high))
    np.testing.assert_allclose(np.mean(inside, axis=0), 0.95, atol=0.03)


test_wrong_capacities = refusals(
    (([],), r"capacities of shape \(0,\)"),
    (([0.1, -0.2],), "capacities = -0.2 .* must be positive"),
    (([0.1, 0.2, np.inf],), "analysed = None must be given"),
    (([0.1, 0.2, np.inf], np.inf), "analysed = inf .* positive, and finite where a capacity"),
    (([0.1, 0.2, np.inf], [0.4, 0.4]), r"analysed of shape \(2,\) must be one number or \(3,\)"),
    (("ab",), "capacities = 'ab' must be a real number"),
    (([0.1, np.inf], 0.4), "at least 2 records; they are known of 1 of 2"),
    (([0.1, 0.1],), "they are equal"),
    of=lambda arguments: jp.hazard.fit_capacities(*arguments),
)
