import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import stats

from jaxpound.study.statistics import Estimate, Moments, quantile
from jaxpound.study.weighting import Hits
from tests.refusals import refusals


def probability(k, n, confidence=0.95):
    return Hits.of(np.arange(n) < k, np.ones(n)).estimate(True, confidence)


def test_intervals_of_probabilities_are_beta_quantiles_and_cover_or_are_none():
    for k, n in ((0, 10), (1, 10), (5, 10), (10, 10), (37, 10_000)):
        estimate = probability(k, n, 0.9)
        assert estimate.value == k / n
        assert estimate.low == pytest.approx(stats.beta.ppf(0.05, k, n - k + 1) if k else 0.0)
        assert estimate.high == pytest.approx(stats.beta.ppf(0.95, k + 1, n - k) if k < n else 1.0)
    # At least as often as it says, in 2,000 repetitions of 200 draws.
    for p in (0.01, 0.1, 0.5):
        counts = np.random.default_rng(0).binomial(200, p, 2000)
        limits = {k: probability(int(k), 200, 0.9) for k in np.unique(counts)}
        covered = np.mean([limits[k].low <= p <= limits[k].high for k in counts])
        assert 0.9 - 0.01 < covered < 0.99
    for share in (0.05, 0.5, 0.9):
        draws = np.random.default_rng(1).standard_exponential((2000, 101)) ** 2
        truth = stats.expon.ppf(share) ** 2
        # The ends are order statistics: those of the numbers from 0 on are their ranks.
        _, low, high, _ = quantile(np.arange(101.0), share, 0.9)
        ranked = np.sort(draws)
        covered = np.mean((ranked[:, int(low)] <= truth) & (truth <= ranked[:, int(high)]))
        assert 0.9 - 0.01 < covered < 0.96
    assert str(Estimate(0.25, 0.2, np.inf)) == "0.25 (95%: 0.2 to inf)"
    for end in (np.nan, np.inf):
        assert str(Estimate(0.25, -end, end, 0.9)) == "0.25 (no 90% interval)"
    assert str(quantile(np.array([0.25]), 0.5)) == "0.25 (no 95% interval)"


@given(
    arrays(float, st.integers(1, 60), elements=st.floats(-1e3, 1e3)),
    st.floats(0.01, 0.99),
    st.sampled_from([0.5, 0.9, 0.99]),
)
def test_a_quantile_is_numpy_s_and_its_ends_are_order_statistics(sample, share, confidence):
    estimate = quantile(sample, share, confidence)
    assert estimate.value == pytest.approx(np.quantile(sample, share), rel=1e-12, abs=1e-9)
    ranked, n, rest = np.sort(sample), sample.size, (1 - confidence) / 2
    below = [k for k in range(1, n + 1) if stats.binom.cdf(k - 1, n, share) <= rest]
    above = [k for k in range(1, n + 1) if stats.binom.sf(k - 1, n, share) <= rest]
    assert estimate.low == (ranked[max(below) - 1] if below else -np.inf)
    assert estimate.high == (ranked[min(above) - 1] if above else np.inf)


test_bad_values_are_named = refusals(
    (lambda: probability(0, 0), "n = 0 must be at least 1"),
    (lambda: probability(1, 2, 1.0), "confidence = 1 must be between 0 and 1"),
    (lambda: quantile([], 0.5), r"sample of shape \(0,\) must be"),
    (lambda: quantile([1.0, np.nan], 0.5), r"sample = nan \(at index \[1\]\) must be finite"),
    (lambda: quantile([1.0], 0.0), "share = 0 must be between 0 and 1"),
)


@given(arrays(float, st.integers(2, 50), elements=st.floats(-100, 100)), st.data())
def test_moments_of_parts_are_those_of_the_whole(sample, data):
    cuts = data.draw(st.lists(st.integers(0, sample.size), max_size=3))
    parts = [Moments.of(part) for part in np.split(sample, sorted(cuts))]
    whole = sum(parts, Moments())
    assert whole.n == sample.size
    assert (whole.smallest, whole.largest) == (sample.min(), sample.max())
    assert whole.mean == pytest.approx(sample.mean(), abs=1e-10)
    assert whole.std == pytest.approx(sample.std(ddof=1), rel=1e-9, abs=1e-9)
    if sample.std() > 1e-3:
        assert whole.times(3.0).std == pytest.approx(3 * whole.std)
