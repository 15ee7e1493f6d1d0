"""Estimates from a sample: probabilities, quantiles, moments."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import betaincinv

from jaxpound._checks import Rule, array, enforce, require_share
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

    require_share("share", share)
    require_share("confidence", confidence)
    sample = array("sample", sample, (-1,))
    enforce([Rule("sample", sample, np.isfinite(sample), "finite")])
    ends = stats.quantile_test(sample, p=share).confidence_interval(confidence)
    # NaN if no order statistic suffices.
    low, high = np.where(np.isnan(ends), (-np.inf, np.inf), ends).tolist()
    return Estimate(float(np.quantile(sample, share)), low, high, confidence)


class Moments(NamedTuple):
    """Moments and extremes of a sample, perhaps with weights, that is read in parts."""

    n: int = 0
    mean: float = float("nan")
    spread: float = 0.0  # sum of weighted squared deviations from the mean
    smallest: float = float("nan")
    largest: float = float("nan")
    weight: float = 0.0  # sum of the weights
    square: float = 0.0  # sum of their squares

    @staticmethod
    def of(sample: np.ndarray, weights: np.ndarray | None = None) -> Moments:
        """Moments of a part, shape (n,), of equal weights by default."""
        x = np.asarray(sample, float)
        w = np.ones(x.shape) if weights is None else weights
        if not (weight := float(w.sum())):
            return Moments()
        mean = float(w @ x) / weight
        ends = float(x[w > 0].min()), float(x[w > 0].max())
        return Moments(x.size, mean, float(w @ (x - mean) ** 2), *ends, weight, float(w @ w))

    def __str__(self) -> str:
        extremes = f"{self.smallest:.4g} to {self.largest:.4g}"
        return f"mean {self.mean:.4g}, standard deviation {self.std:.4g}, {extremes} ({self.n:,})"

    def __add__(self, other: Moments) -> Moments:  # type: ignore[override]
        """Moments of both parts (Chan, Golub and LeVeque 1979), with weights for counts."""
        if not self.n or not other.n:
            return self if self.n else other
        weight, difference = self.weight + other.weight, other.mean - self.mean
        mean = self.mean + difference * other.weight / weight
        between = difference**2 * self.weight * other.weight / weight
        ends = min(self.smallest, other.smallest), max(self.largest, other.largest)
        spread, square = self.spread + other.spread + between, self.square + other.square
        return Moments(self.n + other.n, mean, spread, *ends, weight, square)

    def times(self, factor: float) -> Moments:
        """Moments of the sample times a factor > 0."""
        mean, spread = self.mean * factor, self.spread * factor**2
        ends = self.smallest * factor, self.largest * factor
        return Moments(self.n, mean, spread, *ends, self.weight, self.square)

    @property
    def std(self) -> float:
        """Standard deviation; its square is unbiased for weights that do not depend on the sample.

        NaN for fewer than two numbers.
        """
        free = self.weight - self.square / self.weight if self.n else 0.0
        return (self.spread / free) ** 0.5 if free > 0 else float("nan")
