"""Dormand and Prince's explicit Runge–Kutta method of order 8, DOP853.

Coefficients as in Hairer, Nørsett and Wanner, Solving Ordinary Differential Equations I (1993), and
as SciPy has them, with their estimate of the error by embedded methods of order 5 and 3, and their
interpolation of order 7 between the ends of a step, for which there are four more stages.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

_THIRD = {0: 0.2440944881889764, 8: 0.7338466882816119, 11: 0.022058823529411766}
"""Weights of the slopes, by stage, in the result of the embedded method of order 3."""


class Coefficients(NamedTuple):
    """Weights of the slopes of all 16 stages, along the last axis."""

    stages: np.ndarray  # in each stage, of the slopes before it
    end: np.ndarray  # in the result; the thirteenth stage is there
    errors: np.ndarray  # in the errors that the embedded methods of order 5 and 3 estimate
    interpolation: np.ndarray  # in the products θ, θ (1 − θ), θ² (1 − θ), … that interpolate


@cache
def coefficients() -> Coefficients:
    """The coefficients of the method."""
    from scipy.integrate import DOP853  # its import takes a quarter of a second

    stages = np.zeros((16, 16))
    stages[:12, :12], stages[12, :12], stages[13:] = DOP853.A, DOP853.B, DOP853.A_EXTRA
    first, last, end = *np.eye(16)[[0, 12]], stages[12]
    errors = np.array([np.pad(DOP853.E5, (0, 3)), end - [_THIRD.get(i, 0.0) for i in range(16)]])
    between = np.array([end, first - end, 2 * end - first - last, *DOP853.D])
    return Coefficients(stages, end, errors, between)


def weighted(weights: jax.Array, slopes: jax.Array) -> jax.Array:
    """Sum by weights of slopes along their first axis."""
    return (jnp.expand_dims(weights, range(1, slopes.ndim)) * slopes).sum(0)


def until(share: jax.Array) -> jax.Array:
    """Weights, (16,), of the slopes for where a step is after a ``share`` of its length."""
    products = [share]
    rows = coefficients().interpolation
    for i in range(len(rows) - 1):
        products.append(products[-1] * (share if i % 2 else 1 - share))
    return weighted(jnp.stack(products), jnp.asarray(rows, share.dtype))


def error(slopes: jax.Array) -> jax.Array:
    """Estimated error of a step of length 1, from the slopes of all stages."""
    orders = coefficients().errors
    fifth, third = (weighted(jnp.asarray(row, slopes.dtype), slopes) for row in orders)
    both = fifth**2 + 0.01 * third**2
    return fifth**2 / jnp.sqrt(jnp.where(both > 0, both, 1.0))
