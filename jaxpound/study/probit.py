"""Maximum likelihood of a rising curve P = Φ(a + b z), fitted to counts: probit regression."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.special import log_ndtr


def no_maximum(im: np.ndarray, k: np.ndarray, n: np.ndarray) -> str:
    """The reason why the likelihood of a rising curve has no maximum; empty if it has one."""
    if not k.any() or (k == n).all():
        return "it always occurs" if k.any() else "it never occurs"
    if im.min() == im.max():
        return f"all intensities are {im[0]:.6g}"
    pounding, safe = im[k > 0], im[k < n]
    if pounding.min() >= safe.max():
        return f"it always occurs above im = {safe.max():.6g} and never below"
    z = np.log(im)
    # The likelihood rises with the slope at slope zero if and only if this covariance is positive.
    if np.sum(z * (k - n * (k.sum() / n.sum()))) <= 0:
        return "it does not become more frequent as the intensity grows"
    return ""


def maximise(
    z: np.ndarray, k: np.ndarray, n: np.ndarray, start: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(a, b) of P = Φ(a + b z) by Newton's method, and the observed information, shape (2, 2)."""
    x = np.stack([np.ones_like(z), z])

    def likelihood(c: np.ndarray) -> float:
        eta = c @ x
        return float(np.sum(k * log_ndtr(eta) + (n - k) * log_ndtr(-eta)))

    def derivatives(c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        eta = c @ x
        rise, fall = ratios(eta)
        weight = k * rise * (rise + eta) + (n - k) * fall * (fall - eta)
        return x @ (k * rise - (n - k) * fall), (x * weight) @ x.T

    return maximum(likelihood, derivatives, start)


def maximum(
    likelihood: Callable[[np.ndarray], float],
    derivatives: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    start: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Where a concave log likelihood is largest, by Newton's method, and the information there."""
    c, best = start, likelihood(start)
    for _ in range(100):
        slope, information = derivatives(c)  # the gradient, and minus the second derivatives
        step = np.linalg.solve(information, slope)
        if slope @ step < 1e-20 * max(abs(best), 1.0):
            break
        share = 1.0
        while (value := likelihood(c + share * step)) < best and share > 1e-9:
            share /= 2
        c, best = c + share * step, value
    return c, information


def ratios(eta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """φ/Φ at η and at −η: derivatives of ln Φ(η), and of ln Φ(−η) with the other sign."""
    density = -(eta**2) / 2 - np.log(2 * np.pi) / 2
    return np.exp(density - log_ndtr(eta)), np.exp(density - log_ndtr(-eta))
