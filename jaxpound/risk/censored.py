"""Least squares where some of the numbers are only known to be at least so large."""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.special import log_ndtr


@dataclasses.dataclass(frozen=True, eq=False)
class Line:
    """y = x · coefficients + ε with a normal ε, and the covariance of coefficients and σ."""

    coefficients: np.ndarray
    """Shape (p,)."""
    sigma: float
    """Standard deviation of ε."""
    covariance: np.ndarray
    """Of the coefficients and, last, σ; shape (p + 1, p + 1)."""


def regression(x: np.ndarray, y: np.ndarray, censored: np.ndarray) -> Line:
    """A linear regression of y, shape (n,), on x, shape (n, p); if ``censored``, y is a bound.

    Without such bounds least squares, with σ² from n − p degrees of freedom. With them the maximum
    of the likelihood of Tobin (1958), by Newton's method in (1/σ, coefficients/σ), in which its
    logarithm is concave (Olsen 1978). At least p + 1 numbers must be known; where these lie on a
    line exactly, σ is 0 whatever the bounds.
    """
    inner, outer = ~censored, censored
    start, *_ = np.linalg.lstsq(x[inner], y[inner], rcond=None)
    n, p = inner.sum(), x.shape[1]
    sigma = float(np.sqrt(np.sum((y[inner] - x[inner] @ start) ** 2) / (n - p)))
    if not outer.any() or sigma == 0:
        covariance = np.zeros((p + 1, p + 1))
        covariance[:p, :p] = sigma**2 * np.linalg.inv(x.T @ x)
        covariance[p, p] = sigma**2 / (2 * (n - p))
        return Line(start, sigma, covariance)
    rows = np.column_stack([y, -x])  # times (1/σ, coefficients/σ): the normal numbers z

    def likelihood(c: np.ndarray) -> float:
        if c[0] <= 0:
            return -np.inf
        z = rows @ c
        return float(n * np.log(c[0]) - np.sum(z[inner] ** 2) / 2 + log_ndtr(-z[outer]).sum())

    c = np.append(1.0, start) / sigma
    best = likelihood(c)
    for _ in range(100):
        z = rows @ c
        beyond = z[outer]
        fall = np.exp(-(beyond**2) / 2 - np.log(2 * np.pi) / 2 - log_ndtr(-beyond))
        slope = -rows[inner].T @ z[inner] - rows[outer].T @ fall
        information = rows[inner].T @ rows[inner]
        information += (rows[outer].T * (fall * (fall - beyond))) @ rows[outer]
        slope[0] += n / c[0]
        information[0, 0] += n / c[0] ** 2
        step = np.linalg.solve(information, slope)
        if slope @ step < 1e-20 * max(abs(best), 1.0):
            break
        share = 1.0
        while (value := likelihood(c + share * step)) < best and share > 1e-9:
            share /= 2
        c, best = c + share * step, value
    to = np.zeros((p + 1, p + 1))  # derivatives of (coefficients, σ)
    to[:p, 0] = -c[1:] / c[0] ** 2
    to[:p, 1:] = np.eye(p) / c[0]
    to[p, 0] = -1 / c[0] ** 2
    return Line(c[1:] / c[0], float(1 / c[0]), to @ np.linalg.inv(information) @ to.T)
