"""Least squares where some of the numbers are only known to be at least so large."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import log_ndtr


class Line(NamedTuple):
    """y = x · coefficients + ε with a normal ε, and the covariance of coefficients and σ."""

    coefficients: Float[np.ndarray, " p"]
    sigma: float
    covariance: Float[np.ndarray, "p+1 p+1"]
    """Of the coefficients and, last, σ."""


def regression(
    x: Float[np.ndarray, "n p"], y: Float[np.ndarray, " n"], censored: Bool[np.ndarray, " n"]
) -> Line:
    """A linear regression; where ``censored``, y is a lower bound.

    Without such bounds least squares, with σ² from n − p degrees of freedom. With them the maximum
    of the likelihood of Tobin (1958), by Newton's method in (1/σ, coefficients/σ), in which its
    logarithm is concave (Olsen 1978). At least p + 1 numbers must be known.
    """
    inner, outer = ~censored, censored
    start, *_ = np.linalg.lstsq(x[inner], y[inner], rcond=None)
    n, p = inner.sum(), x.shape[1]
    sigma = float(np.sqrt(np.sum((y[inner] - x[inner] @ start) ** 2) / (n - p)))
    if not outer.any():
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
