"""Estimates from a sample: probabilities, quantiles, moments."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import betaincinv

from jaxpound._checks import Rule, enforce, require_share
from jaxpound._errors import InvalidInput
from jaxpound._tables import TextTable


class Estimate(NamedTuple):
    """An estimate and its confidence interval; an unknown end is infinite or NaN."""

    value: float
    low: float
    high: float
    confidence: float = 0.95

    def __str__(self) -> str:
        if not np.isfinite([self.low, self.high]).any():
            return f"{self.value:.4g} (no {self.confidence:.0%} interval)"
        return f"{self.value:.4g} ({self.confidence:.0%}: {self.low:.4g} to {self.high:.4g})"

    def _repr_html_(self) -> str:
        return TextTable("", (), [("estimate", str(self))]).html()


def probability(successes: int, n: int, confidence: float = 0.95) -> Estimate:
    """Probability of an event with ``successes`` in n, with its ``binomial_interval``."""
    owner = "probability"
    require_share(owner, "confidence", confidence)
    between = Rule("successes", successes, 0 <= successes <= n, f"between 0 and n = {n}")
    enforce(owner, [Rule("n", n, n >= 1, "at least 1"), between])
    share = successes / n
    return Estimate(share, *binomial_interval(share, n, confidence), confidence)


def binomial_interval(share: float, n: float, confidence: float) -> tuple[float, float]:
    """Interval of Clopper and Pearson (1934) by a share of n samples; n need not be whole."""
    hits, tail = share * n, (1 - confidence) / 2
    low = float(betaincinv(hits, n - hits + 1, tail)) if share > 0 else 0.0
    high = float(betaincinv(hits + 1, n - hits, 1 - tail)) if share < 1 else 1.0
    return low, high


def quantile(sample: np.ndarray, share: float, confidence: float = 0.95) -> Estimate:
    """Quantile of the distribution of independent draws, shape (n,), with an interval.

    ``share``, between 0 and 1, is the probability of not exceeding the quantile. The interval's
    ends are order statistics: the number of draws below the quantile is binomial (Conover 1999,
    section 3.2). Each end errs with a probability of at most (1 − confidence) / 2; it is infinite
    if the sample is too small for any order statistic to have that confidence.
    """
    from scipy import stats  # only here: it takes a second to import

    owner = "quantile"
    require_share(owner, "share", share)
    require_share(owner, "confidence", confidence)
    sample = np.asarray(sample, float)
    if sample.ndim != 1 or not sample.size:
        raise InvalidInput(owner, "sample", "", f"of shape {sample.shape} must be (n,) with n ≥ 1")
    enforce(owner, [Rule("sample", sample, np.isfinite(sample), "finite")])
    ends = stats.quantile_test(sample, p=share).confidence_interval(confidence)
    # NaN if no order statistic suffices.
    low, high = np.where(np.isnan(ends), (-np.inf, np.inf), ends).tolist()
    return Estimate(float(np.quantile(sample, share)), low, high, confidence)


class Moments(NamedTuple):
    """Moments and extremes of a sample that is read in parts."""

    n: int = 0
    mean: float = float("nan")
    square: float = 0.0  # sum of squared deviations from the mean
    smallest: float = float("nan")
    largest: float = float("nan")

    @staticmethod
    def of(sample: np.ndarray) -> Moments:
        """Moments of a part, shape (n,)."""
        sample = np.asarray(sample, float)
        if not sample.size:
            return Moments()
        mean = float(sample.mean())
        square = float(np.sum((sample - mean) ** 2))
        return Moments(sample.size, mean, square, float(sample.min()), float(sample.max()))

    def __add__(self, other: Moments) -> Moments:  # type: ignore[override]
        """Moments of both parts (Chan, Golub and LeVeque 1979)."""
        if not self.n or not other.n:
            return self if self.n else other
        m, n = self.n, other.n
        total, difference = m + n, other.mean - self.mean
        mean = self.mean + difference * n / total
        square = self.square + other.square + difference**2 * m * n / total
        ends = min(self.smallest, other.smallest), max(self.largest, other.largest)
        return Moments(total, mean, square, *ends)

    def times(self, factor: float) -> Moments:
        """Moments of the sample times a factor > 0."""
        n, mean, square, low, high = self
        return Moments(n, mean * factor, square * factor**2, low * factor, high * factor)

    @property
    def std(self) -> float:
        """Standard deviation, unbiased in its square; NaN for fewer than two numbers."""
        return (self.square / (self.n - 1)) ** 0.5 if self.n > 1 else float("nan")
