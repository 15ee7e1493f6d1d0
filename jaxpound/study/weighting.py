"""Estimates from samples with weights, such as importance samples: part by part, as they are read.

Intervals are those of as many samples of one weight as would have the estimate's variance.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import ArrayLike
from scipy.special import betaincinv

from jaxpound._checks import Rule, enforce, real, require_share
from jaxpound.study.statistics import Estimate, Moments


@dataclasses.dataclass(frozen=True, eq=False)
class Weighting:
    """The weights of a study's samples; ``Study.weighted`` makes it."""

    by: str | np.ndarray
    """A column's name, or the weights, shape (n,)."""
    normalised: bool
    """Whether estimates are divided by the sum of the weights, or by the number of samples."""
    curve: Any = None
    """The points of the hazard curve that made the weights; None if they are others."""

    def of(
        self, parts: Iterable[np.ndarray], read: Callable[[str], Iterable[np.ndarray]]
    ) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Every part of a column with its weights; ``read`` gives the parts of another column."""
        if isinstance(self.by, str):
            yield from zip(parts, read(self.by), strict=True)
            return
        start = 0
        for part in parts:
            yield part, self.by[start : start + len(part)]
            start += len(part)


def checked(
    owner: str, weights: str | ArrayLike, n: int, column: Moments | None
) -> str | np.ndarray:
    """A column's name, whose moments are known, or n weights; a ``ValueError`` for no weights."""
    if isinstance(weights, str):
        assert column is not None
        by: str | np.ndarray = weights
        ends, right = np.array([column.smallest, column.largest]), column.n == n
        rule = "be finite in every run that did not fail"
    else:
        by = ends = np.asarray(real(owner, "weights", weights), float)
        right, rule = by.shape == (n,), f"be ({n},)"
    if not right:
        raise ValueError(f"{owner}: weights must {rule}")
    enforce(
        owner,
        [
            Rule("weights", ends, (ends >= 0) & np.isfinite(ends), "finite and not negative"),
            Rule("sum of the weights", ends.max(), ends.max() > 0, "positive"),
        ],
    )
    return by


class Hits(NamedTuple):
    """Sums over samples, some of which are hits: what a probability and its interval need."""

    n: int = 0
    weight: float = 0.0
    """Sum of the weights."""
    square: float = 0.0
    """Sum of their squares."""
    hit: float = 0.0
    """Sum of the weights of hits."""
    hit_square: float = 0.0
    """Sum of the squares of the weights of hits."""

    @staticmethod
    def of(hits: np.ndarray, weights: np.ndarray) -> Hits:
        """The sums of one part: hits true or false, and their weights, shape (n,) each."""
        w, those = weights, weights[hits]
        return Hits(w.size, w.sum(), (w**2).sum(), those.sum(), (those**2).sum())

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

    def size(self, p: float, normalised: bool) -> float:
        """Samples of one weight with the variance that an estimate p of the probability has.

        p (1 − p) over the variance (Korn and Graubard 1998). Where that is not known, because no
        sample is a hit or all are, (Σ w)² / Σ w² (Kish 1965).
        """
        square = self.variance(p, normalised)
        if not (0 < p < 1 and square > 0):
            return float(self.weight**2 / self.square)
        return float(p * (1 - p) / square)

    def estimate(self, normalised: bool, confidence: float = 0.95) -> Estimate:
        """The probability, with Clopper and Pearson's interval for ``size`` samples."""
        require_share("probability", "confidence", confidence)
        p = self.share(normalised)
        low, high = _limits(min(p, 1.0), self.size(p, normalised), confidence)
        return Estimate(p, low, high, confidence)


def _limits(p: float, n: float, confidence: float) -> tuple[float, float]:
    """Clopper and Pearson's interval of p, of samples whose number need not be whole."""
    hits, tail = p * n, (1 - confidence) / 2
    low = float(betaincinv(hits, n - hits + 1, tail)) if p > 0 else 0.0
    high = float(betaincinv(hits + 1, n - hits, 1 - tail)) if p < 1 else 1.0
    return low, high


def quantile(
    sample: np.ndarray,
    weights: np.ndarray,
    share: float,
    normalised: bool,
    confidence: float = 0.95,
) -> Estimate:
    """Quantile of the distribution that weights give a sample, with Woodruff's interval.

    The sample is counted from the nearer tail, where importance samples are. The interval's ends
    are the samples exceeded with the probabilities that are the interval of 1 − share (Woodruff
    1952); an end is infinite if these are less than the weight of the outermost sample.

    Raises
    ------
    ValueError
        If the sample is empty, or a share is not between 0 and 1.
    """
    require_share("quantile", "share", share)
    require_share("quantile", "confidence", confidence)
    if not sample.size:
        raise ValueError(f"quantile: sample of shape {sample.shape} must be (n,), n ≥ 1")
    sign = 1.0 if share >= 0.5 else -1.0
    tail = 1 - share if share >= 0.5 else share
    order = np.argsort(sign * sample)[::-1]
    ranked, w = sign * sample[order], weights[order]
    all_of = w.sum() if normalised else w.size
    reached = np.cumsum(w) / all_of  # share of the samples down to and with each

    def exceeded_by(p: float) -> float:
        """The smallest sample that no more than this share exceeds."""
        return float(ranked[min(int(np.searchsorted(reached, p, side="right")), w.size - 1)])

    value = exceeded_by(tail)
    beyond = ranked > value
    sums = Hits.of(beyond if beyond.any() else ranked >= value, w)
    low, high = _limits(tail, sums.size(tail, normalised), confidence)
    upper = exceeded_by(low) if low >= reached[0] else np.inf
    lower = exceeded_by(high) if high <= reached[-1] - w[-1] / all_of else -np.inf
    below, above = sorted([sign * lower, sign * upper])
    return Estimate(sign * value, below, above, confidence)


def moments(parts: Iterable[tuple[np.ndarray, np.ndarray]]) -> Moments:
    """Moments of samples and their weights, part by part, normalised.

    The variance is unbiased for weights that do not depend on the sample: Σ w (x − mean)² over
    Σ w − Σ w² / Σ w.
    """
    n, weight, square, mean, spread = 0, 0.0, 0.0, 0.0, 0.0
    low, high = np.inf, -np.inf
    for x, w in parts:
        more = w.sum()
        if not more:
            continue
        centre = (w @ x) / more
        # Chan, Golub and LeVeque (1979), with weights for counts.
        apart, both = centre - mean, weight + more
        spread += w @ (x - centre) ** 2 + apart**2 * weight * more / both
        mean += apart * more / both
        n, weight, square = n + x.size, both, square + (w**2).sum()
        low, high = min(low, x[w > 0].min()), max(high, x[w > 0].max())
    if not n:
        return Moments()
    free = weight - square / weight
    variance = spread / free if free > 0 else np.nan
    return Moments(n, float(mean), float(variance * (n - 1)), float(low), float(high))


def correlation(x: np.ndarray, y: np.ndarray, weights: np.ndarray | None, *, ranks: bool) -> float:
    """Correlation coefficient, linear or of (weighted) ranks; NaN where one does not vary."""
    if not (x.size and np.ptp(x) and np.ptp(y)):
        return float("nan")
    if weights is None:
        from scipy import stats  # only here: it takes a second to import

        return float((stats.spearmanr if ranks else stats.pearsonr)(x, y).statistic)
    both = np.stack([_ranks(a, weights) if ranks else a for a in (x, y)])
    covariance = np.cov(both, aweights=weights)
    return float(covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1]))


def _ranks(x: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """The weight of smaller samples and half that of equal ones."""
    _, which = np.unique(x, return_inverse=True)
    of_value = np.bincount(which, weights)
    return (np.cumsum(of_value) - of_value / 2)[which]
