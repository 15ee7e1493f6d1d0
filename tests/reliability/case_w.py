"""Case W: the paper's structures in filtered white noise of 500 numbers, with known probabilities.

The noise is that of Kanai and Tajimi (ω = 2, ζ = 0.6), of unit variance at every instant, under an
envelope. References are from independent prototypes: plain Monte Carlo of a million runs at 0.27
and 0.47, and importance sampling of up to 40,000 runs.
"""

import dataclasses

import jax.numpy as jnp
import numpy as np

import jaxpound as jp

DT, N = 0.04, 500
GRID = jp.TimeGrid.until(20.0, dt=DT)

REFERENCE = {
    0.27: (1.023e-2, 0.007),
    0.47: (1.047e-4, 0.011),
    0.645: (7.97e-7, 0.012),
    0.785: (9.50e-9, 0.020),
}
"""Probability that the required gap reaches a number, and the coefficient of variation of it."""

SLOPE = -36.6
"""d ln P/dμ at a gap of 0.645."""


def matrix():
    """Accelerations at the samples are this matrix times z."""
    omega, zeta, t = 2.0, 0.6, DT * np.arange(N)
    damped = omega * np.sqrt(1 - zeta**2)
    cosine = 2 * zeta * omega * np.cos(damped * t)
    sine = (omega**2 - 2 * zeta**2 * omega**2) / damped * np.sin(damped * t)
    h = np.exp(-zeta * omega * t) * (cosine + sine)
    lags = np.subtract.outer(np.arange(N), np.arange(N))
    filtered = np.where(lags >= 0, h[np.abs(lags)], 0.0)
    envelope = (t / 5 * np.exp(1 - t / 5)) ** 2
    return (0.3 * envelope / np.sqrt((filtered**2).sum(axis=1)))[:, None] * filtered


MATRIX = matrix()


def ground(z):
    return jp.Record(jnp.asarray(MATRIX, z.dtype) @ z, DT, time_unit="1/ω1")


SCENARIOS = jp.Scenarios(jp.paper.structures(), jp.CustomDraw(ground, N))


def state(gap, friction=0.25):
    """The limit state of a gap; all share their programs."""
    return dataclasses.replace(NOMINAL, threshold=gap, changes={"friction": friction})


NOMINAL = jp.LimitState(SCENARIOS, GRID, threshold=0.645)
