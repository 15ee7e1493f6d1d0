"""Estimates from weighted samples, such as importance samples, that are read in parts."""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import numpy as np

from jaxpound._checks import Rule, array, enforce, not_negative, require_share
from jaxpound.study.statistics import Estimate, binomial_interval


@dataclasses.dataclass(frozen=True, eq=False)
class Weighting:
    """The weights of a study's samples; ``Study.weighted`` makes it."""

    by: str | np.ndarray  # a column's name, or the weights, shape (n,)
    normalised: bool  # see ``Study.weighted``


def require_weights(weights: np.ndarray) -> None:
    """An ``InvalidInput`` for weights that are negative, not finite, or all 0."""
    not_negative(weights=weights)
    whole = weights.sum()
    enforce([Rule("sum of the weights", whole, whole > 0, "positive")])


class Hits(NamedTuple):
    """Sums over samples and hits, from which a probability and its interval follow."""

    n: int = 0
    weight: float = 0.0  # sum of the weights
    square: float = 0.0  # sum of their squares
    hit: float = 0.0  # sum of the weights of hits
    hit_square: float = 0.0  # sum of the squares of the weights of hits

    @staticmethod
    def of(hits: np.ndarray, weights: np.ndarray) -> Hits:
        """The sums of a part: hits true or false, and weights, shape (n,) each."""
        w, hit = weights, weights[hits]
        return Hits(w.size, w.sum(), (w**2).sum(), hit.sum(), (hit**2).sum())

    def __add__(self, other: Hits) -> Hits:  # type: ignore[override]
        """The sums of both parts."""
        n, *sums = (a + b for a, b in zip(self, other, strict=True))
        return Hits(int(n), *sums)

    def share(self, normalised: bool) -> float:
        """Estimate of the hits' probability."""
        return float(self.hit / (self.weight if normalised else self.n))

    def variance(self, p: Any, normalised: bool) -> Any:
        """Variance of an estimate p of the probability, to first order.

        Of a ratio of sums if normalised (Owen 2013, section 9.2), else of a mean.
        """
        if normalised:
            missed = self.square - self.hit_square
            return ((1 - p) ** 2 * self.hit_square + p**2 * missed) / self.weight**2
        return np.maximum(self.hit_square / self.n**2 - p**2 / self.n, 0.0)

    def effective_size(self, p: float, normalised: bool) -> float:
        """Number of samples of equal weight with the variance of an estimate p of the probability.

        p (1 − p) over the variance (Korn and Graubard 1998); if no sample or every sample is a hit,
        (Σ w)² / Σ w² (Kish 1965).
        """
        square = self.variance(p, normalised)
        if not (0 < p < 1 and square > 0):
            return float(self.weight**2 / self.square)
        return float(p * (1 - p) / square)

    def estimate(self, normalised: bool, confidence: float = 0.95) -> Estimate:
        """The probability, with Clopper and Pearson's interval for ``effective_size`` samples."""
        require_share("confidence", confidence)
        enforce([Rule("n", self.n, self.n >= 1, "at least 1")])
        p = self.share(normalised)
        low, high = binomial_interval(min(p, 1.0), self.effective_size(p, normalised), confidence)
        return Estimate(p, low, high, confidence)


def quantile(
    sample: np.ndarray,
    weights: np.ndarray,
    share: float,
    normalised: bool,
    confidence: float = 0.95,
) -> Estimate:
    """Quantile of the distribution of a weighted sample, with Woodruff's interval.

    Probabilities are summed from the nearer tail, where importance samples are. The interval's ends
    are the samples exceeded with the probabilities at the ends of the interval of 1 − share
    (Woodruff 1952); an end is infinite if its probability is less than the weight of the outermost
    sample.
    """
    require_share("share", share)
    require_share("confidence", confidence)
    sample = array("sample", sample, (-1,))
    sign = 1.0 if share >= 0.5 else -1.0
    tail = 1 - share if share >= 0.5 else share
    order = np.argsort(sign * sample)[::-1]
    ranked, w = sign * sample[order], weights[order]
    whole = w.sum() if normalised else w.size
    shares = np.cumsum(w) / whole  # of the samples down to each, itself included

    def exceeded_by(p: float) -> float:
        """The smallest sample that at most this share exceeds."""
        return float(ranked[min(int(np.searchsorted(shares, p, side="right")), w.size - 1)])

    value = exceeded_by(tail)
    beyond = ranked > value
    hits = Hits.of(beyond if beyond.any() else ranked >= value, w)
    low, high = binomial_interval(tail, hits.effective_size(tail, normalised), confidence)
    upper = exceeded_by(low) if low >= shares[0] else np.inf
    lower = exceeded_by(high) if high <= shares[-1] - w[-1] / whole else -np.inf
    below, above = sorted([sign * lower, sign * upper])
    return Estimate(sign * value, below, above, confidence)


def correlation(x: np.ndarray, y: np.ndarray, weights: np.ndarray, *, ranks: bool) -> float:
    """Correlation coefficient, linear or of weighted ranks; NaN if x or y does not vary."""
    if not (x.size and np.ptp(x) and np.ptp(y)):
        return float("nan")
    pair = np.stack([_ranks(a, weights) if ranks else a for a in (x, y)])
    covariance = np.cov(pair, aweights=weights)
    return float(covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1]))


def _ranks(x: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Weighted ranks: the weight of smaller samples plus half the weight of equal samples."""
    _, index = np.unique(x, return_inverse=True)
    by_value = np.bincount(index, weights)
    return (np.cumsum(by_value) - by_value / 2)[index]
