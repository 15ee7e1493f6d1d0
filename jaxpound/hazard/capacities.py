"""Fragility from capacities: the intensities at which each record first reaches a threshold."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import ArrayLike
from scipy.special import log_ndtr

from jaxpound._checks import Rule, array, enforce
from jaxpound._errors import InvalidInput
from jaxpound.study.fragility import Fragility, inverse_mills_ratio, maximum


def fit_capacities(
    capacities: ArrayLike, analysed: ArrayLike | None = None, *, measure: str = ""
) -> Fragility:
    """Lognormal fragility of capacities (Baker 2015, incremental and truncated dynamic analysis).

    If all capacities are finite, ln θ is the mean of their logarithms and β its standard deviation,
    with n − 1. If some are infinite, records that did not reach the threshold up to the intensity
    ``analysed``, both maximise the likelihood ∏ φ(z_i)/β ∏ (1 − Φ(z_max)), z = ln(im / θ) / β.
    The curve's data are the empirical distribution: ``intensity`` are the finite capacities in
    rising order, ``pounding`` how many are at most as large, ``trials`` the number of records.
    Raises ``ValueError`` if shapes differ, a value is not positive, ``analysed`` is missing or
    infinite where it is needed, or fewer than two capacities are finite, or all are equal.

    Parameters
    ----------
    capacities
        Intensity > 0 at which each record first reaches the threshold, shape (n,); infinite where
        it never did.
    analysed
        Highest intensity tried, a number or shape (n,); needed where a capacity is infinite.
    measure
        See ``fit_fragility``.

    Examples
    --------
    >>> curve = jp.hazard.fit_capacities([0.2, 0.3, 0.45])
    >>> round(curve.median, 3), round(curve.dispersion, 4)
    (0.3, 0.4055)
    >>> curve = jp.hazard.fit_capacities([0.2, 0.3, np.inf], analysed=0.4)
    >>> round(curve.median, 3), round(curve.dispersion, 3)
    (0.313, 0.402)
    """
    im = array("capacities", capacities, (-1,))
    enforce([Rule("capacities", im, im > 0, "positive")])
    reached = np.isfinite(im)
    if not reached.all() and analysed is None:
        raise InvalidInput("analysed", "None", "must be given where a capacity is infinite")
    limits = array("analysed", np.inf if analysed is None else analysed, (), im.shape)
    limits = np.broadcast_to(limits, im.shape)
    rule = "positive, and finite where a capacity is not"
    enforce([Rule("analysed", limits, (limits > 0) & (reached | np.isfinite(limits)), rule)])
    finite = np.sort(im[reached])
    n, m = im.size, finite.size
    if m < 2 or finite[0] == finite[-1]:
        fault = "equal" if m > 1 else f"known of {m} of {n}"
        rule = f"must differ, of at least 2 records; they are {fault}"
        raise InvalidInput("capacities", "", rule)
    line = regression(np.ones((n, 1)), np.log(np.where(reached, im, limits)), ~reached)
    above = f", {n - m} more above what was analysed" if n > m else ""
    curve = float(np.exp(line.coefficients[0])), line.sigma, line.covariance
    data = finite, np.arange(1, m + 1), np.full(m, n)
    source, event = f"from {m} capacities{above}", "reaching the threshold"
    return Fragility(*curve, *data, measure=measure, source=source, event=event)


@dataclasses.dataclass(frozen=True, eq=False)
class CensoredRegression:
    """y = x · coefficients + ε with a normal ε, and the covariance of coefficients and σ."""

    coefficients: np.ndarray
    """Shape (p,)."""
    sigma: float
    """Standard deviation of ε."""
    covariance: np.ndarray
    """Of the coefficients and, last, σ; shape (p + 1, p + 1)."""


def regression(x: np.ndarray, y: np.ndarray, censored: np.ndarray) -> CensoredRegression:
    """A linear regression of y, shape (n,), on x, shape (n, p); a censored y is a lower bound.

    Without censored numbers this is least squares, with σ² from n − p degrees of freedom. With them
    it maximises the likelihood of Tobin (1958), by Newton's method in (1/σ, coefficients/σ), in
    which its logarithm is concave (Olsen 1978). At least p + 1 numbers must not be censored; where
    these lie on a line exactly, σ is 0 whatever the bounds.
    """
    inner, outer = ~censored, censored
    start, *_ = np.linalg.lstsq(x[inner], y[inner], rcond=None)
    n, p = inner.sum(), x.shape[1]
    sigma = float(np.sqrt(np.sum((y[inner] - x[inner] @ start) ** 2) / (n - p)))
    if not outer.any() or sigma == 0:
        covariance = np.zeros((p + 1, p + 1))
        covariance[:p, :p] = sigma**2 * np.linalg.inv(x.T @ x)
        covariance[p, p] = sigma**2 / (2 * (n - p))
        return CensoredRegression(start, sigma, covariance)
    rows = np.column_stack([y, -x])  # times (1/σ, coefficients/σ): the normal numbers z

    def likelihood(c: np.ndarray) -> float:
        if c[0] <= 0:
            return -np.inf
        z = rows @ c
        return float(n * np.log(c[0]) - np.sum(z[inner] ** 2) / 2 + log_ndtr(-z[outer]).sum())

    def derivatives(c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        z = rows @ c
        beyond = z[outer]
        fall = inverse_mills_ratio(-beyond)
        slope = -rows[inner].T @ z[inner] - rows[outer].T @ fall
        information = rows[inner].T @ rows[inner]
        information += (rows[outer].T * (fall * (fall - beyond))) @ rows[outer]
        slope[0] += n / c[0]
        information[0, 0] += n / c[0] ** 2
        return slope, information

    c, information = maximum(likelihood, derivatives, np.append(1.0, start) / sigma)
    to = np.diag(np.full(p, 1 / c[0]), 1)  # derivatives of (coefficients, σ)
    to[:, 0] = -np.append(c[1:], 1) / c[0] ** 2
    return CensoredRegression(c[1:] / c[0], float(1 / c[0]), to @ np.linalg.inv(information) @ to.T)
