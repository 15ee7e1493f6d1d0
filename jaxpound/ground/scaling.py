"""The factors with which records meet a target spectrum."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from jaxpound._checks import Rule, enforce, positive

OWNER = "RecordSuite.scaled_to"


class Bounds(NamedTuple):
    """Between which the factors must lie."""

    low: float
    high: float

    @classmethod
    def of(cls, factors: Any) -> Bounds:
        """A pair of numbers as bounds; a ``ValueError`` for anything else."""
        if np.shape(factors) != (2,):
            raise ValueError(f"{OWNER}: factors = {factors!r} must be bounds (low, high)")
        low, high = positive(OWNER, **{f"factors[{i}]": x for i, x in enumerate(factors)})
        enforce(OWNER, [Rule("factors", high, high >= low, f"at least the lower bound, {low:g}")])
        return cls(float(low), float(high))


def misfit(logarithms: Any) -> Any:
    """Root mean square of the logarithm of a ratio, over the last axis."""
    return np.sqrt(np.mean(logarithms**2, axis=-1))


def fitted_factors(ratios: np.ndarray, bounds: Bounds) -> np.ndarray:
    """Least squares in the logarithm: the factor f of each record within bounds, shape (n,).

    It minimises Σ (ln f − ln r)² over the ratios r, shape (n, m), of the target to the record: a
    parabola in ln f, whose least value within bounds is at its vertex or the bound next to it.
    """
    return np.clip(np.exp(np.log(ratios).mean(axis=1)), *bounds)


def raised(
    factors: np.ndarray,
    ratios: np.ndarray,
    bounds: Bounds,
    least: float,
) -> np.ndarray:
    """Factors times the smallest common one with which the mean spectrum reaches the target.

    That is ``least`` of the target at every period; no factor exceeds its upper bound.

    Raises
    ------
    ValueError
        If it does not even with all factors at the upper bound.
    """
    from scipy.optimize import brentq

    def short(common: float) -> float:
        mean = np.mean(np.minimum(common * factors, bounds.high)[:, None] / ratios, axis=0)
        return float(mean.min() - least)

    if short(1.0) >= 0:
        return factors
    most = bounds.high / factors.min()
    if (reached := short(most)) < 0:
        rule = f"at most {reached + least:.4g}, which factors of {bounds.high:g} reach"
        raise ValueError(f"{OWNER}: least = {least:g} must be {rule}")
    common = brentq(short, 1.0, most, xtol=1e-13, rtol=1e-13)
    return np.minimum(common * factors, bounds.high)
