"""What a sample says of its distribution: probabilities, quantiles, moments, code rules."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import stats

from jaxpound._checks import Rule, enforce, require_share
from jaxpound._tables import Table


class Estimate(NamedTuple):
    """An estimate and its confidence interval; an end that is not known is infinite or NaN."""

    value: float
    low: float
    high: float
    confidence: float = 0.95

    def __str__(self) -> str:
        if not np.isfinite([self.low, self.high]).any():
            return f"{self.value:.4g} (no {self.confidence:.0%} interval)"
        return f"{self.value:.4g} ({self.confidence:.0%}: {self.low:.4g} to {self.high:.4g})"

    def _repr_html_(self) -> str:
        return Table("", (), [("estimate", str(self))]).html()


def probability(successes: int, n: int, confidence: float = 0.95) -> Estimate:
    """Probability of what happened ``successes`` times of n, with Clopper and Pearson's interval.

    It covers the true probability at least as often as it says (Clopper and Pearson 1934).

    Raises
    ------
    ValueError
        If n < 1, successes is not between 0 and n, or confidence not between 0 and 1.
    """
    owner = "probability"
    require_share(owner, "confidence", confidence)
    enforce(
        owner,
        [
            Rule("n", n, n >= 1, "at least 1"),
            Rule("successes", successes, 0 <= successes <= n, f"between 0 and n = {n}"),
        ],
    )
    interval = stats.binomtest(int(successes), int(n)).proportion_ci(confidence, method="exact")
    return Estimate(successes / n, float(interval.low), float(interval.high), confidence)


def quantile(sample: np.ndarray, share: float, confidence: float = 0.95) -> Estimate:
    """Quantile of the distribution of a sample, with a distribution-free interval.

    The interval's ends are order statistics: they enclose the quantile if, of n draws, between so
    many and so many are below it, which is a binomial number (Conover 1999, section 3.2). An end is
    infinite where the sample is too small for any order statistic to do.

    Parameters
    ----------
    sample
        Independent draws, shape (n,).
    share
        Between 0 and 1: the probability of not exceeding the quantile.
    confidence
        Between 0 and 1; each end errs with at most half of the rest.

    Raises
    ------
    ValueError
        If the sample is empty or not finite, or share or confidence is not between 0 and 1.
    """
    owner = "quantile"
    require_share(owner, "share", share)
    require_share(owner, "confidence", confidence)
    sample = np.asarray(sample, float)
    n = sample.size
    if sample.ndim != 1 or not n:
        raise ValueError(f"{owner}: sample of shape {sample.shape} must be (n,) with n ≥ 1")
    enforce(owner, [Rule("sample", sample, np.isfinite(sample), "finite")])
    rest = (1 - confidence) / 2
    # The k-th smallest is above the quantile with probability P(B < k), B ~ binomial(n, share).
    below = int(stats.binom.ppf(rest, n, share))  # largest k with P(B < k) ≤ rest
    above = int(stats.binom.isf(rest, n, share)) + 1  # smallest k with P(B ≥ k) ≤ rest
    middle = (n - 1) * share  # Hyndman and Fan's definition 7, as np.quantile
    wanted = {below - 1, above - 1, int(middle), min(int(middle) + 1, n - 1)}
    ranked = np.partition(sample, sorted(k for k in wanted if 0 <= k < n))
    low = ranked[below - 1] if below >= 1 else -np.inf
    high = ranked[above - 1] if above <= n else np.inf
    lower, upper = ranked[int(middle)], ranked[min(int(middle) + 1, n - 1)]
    value = lower + (middle - int(middle)) * (upper - lower)
    return Estimate(float(value), float(low), float(high), confidence)


class Moments(NamedTuple):
    """Moments of a sample that is seen part by part, and its extremes."""

    n: int = 0
    mean: float = float("nan")
    square: float = 0.0  # sum of squared deviations from the mean
    cube: float = 0.0
    smallest: float = float("nan")
    largest: float = float("nan")

    @staticmethod
    def of(sample: np.ndarray) -> Moments:
        """Moments of one part, shape (n,)."""
        sample = np.asarray(sample, float)
        if not sample.size:
            return Moments()
        mean = float(sample.mean())
        deviation = sample - mean
        squares = deviation * deviation
        square, cube = float(np.sum(squares)), float(np.sum(squares * deviation))
        return Moments(sample.size, mean, square, cube, float(sample.min()), float(sample.max()))

    def __add__(self, other: Moments) -> Moments:  # type: ignore[override]
        """Moments of both parts (Chan, Golub and LeVeque 1979; Pébay 2008)."""
        if not self.n or not other.n:
            return self if self.n else other
        m, n = self.n, other.n
        total, apart = m + n, other.mean - self.mean
        return Moments(
            n=total,
            mean=self.mean + apart * n / total,
            square=self.square + other.square + apart**2 * m * n / total,
            cube=self.cube
            + other.cube
            + apart**3 * m * n * (m - n) / total**2
            + 3 * apart * (m * other.square - n * self.square) / total,
            smallest=min(self.smallest, other.smallest),
            largest=max(self.largest, other.largest),
        )

    def times(self, factor: float) -> Moments:
        """Moments of the sample times a factor > 0."""
        f, (n, mean, square, cube, low, high) = factor, self
        return Moments(n, mean * f, square * f**2, cube * f**3, low * f, high * f)

    @property
    def std(self) -> float:
        """Standard deviation, unbiased in its square; NaN for fewer than two numbers."""
        return (self.square / (self.n - 1)) ** 0.5 if self.n > 1 else float("nan")

    @property
    def skewness(self) -> float:
        """Mean cube of the standardised numbers; NaN where they do not vary."""
        spread = self.square / self.n if self.n else 0.0
        return self.cube / self.n / spread**1.5 if spread else float("nan")


def double_difference_correlation(
    period_1: float, damping_1: float, period_2: float, damping_2: float
) -> float:
    """Correlation coefficient ρ of the double difference combination.

    That of the stationary responses of two oscillators to white noise (Der Kiureghian 1980), as
    used for the separation of buildings by Jeng, Kasai and Maison (1992): with β = T1/T2,
    ρ = 8 √(ζ1 ζ2) (ζ1 + β ζ2) β^1.5 / ((1 − β²)² + 4 ζ1 ζ2 β (1 + β²) + 4 (ζ1² + ζ2²) β²).
    """
    b, z1, z2 = period_1 / period_2, damping_1, damping_2
    above = 8 * (z1 * z2) ** 0.5 * (z1 + b * z2) * b**1.5
    below = (1 - b**2) ** 2 + 4 * z1 * z2 * b * (1 + b**2) + 4 * (z1**2 + z2**2) * b**2
    return above / below if below else 1.0  # equal and undamped
