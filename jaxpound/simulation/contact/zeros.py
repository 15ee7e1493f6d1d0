"""Where a value first falls below zero, from its values and slopes at the ends of an interval."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from jaxpound._extrema import larger, smaller
from jaxpound._xla.quotients import unknown

_STEEPEST = 1e3  # largest slope, over the values
_ITERATIONS = 3  # of Laguerre's method


def first_zero(
    start: Any, slope: Any, end: Any, slope_end: Any, noise: Any, may_return: Any = True
) -> jax.Array:
    """Where a cubic on [0, 1] first falls below zero; inf if it never falls below −``noise``.

    The cubic is given by its values and slopes at both ends; its ``start`` is ≥ 0. The zero in its
    first monotone part that ends below zero is found by Laguerre's method, safeguarded by halving,
    from that of the parabola with the same value and slope where that part starts and the same
    value where it ends. Unless it ``may_return``, only a cubic that ends below zero counts.
    """
    # Some forces start with an infinite slope, in which all other numbers would be lost.
    steepest = _STEEPEST * (jnp.abs(start) + jnp.abs(end))
    slope, slope_end = (jnp.clip(x, -steepest, steepest) for x in (slope, slope_end))
    bend, twist = 3 * (end - start) - 2 * slope - slope_end, 2 * (start - end) + slope + slope_end

    def cubic(x: Any) -> Any:
        return start + x * (slope + x * (bend + x * twist))

    def growth(x: Any) -> Any:
        return slope + x * (2 * bend + x * 3 * twist)

    # Extrema, where slope + 2 bend x + 3 twist x² = 0; 0 for those outside.
    root = jnp.sqrt(larger(bend**2 - 3 * twist * slope, 0.0))
    q = -(bend + jnp.where(bend < 0, -root, root))
    extrema = [q / _nonzero(3 * twist), slope / _nonzero(q)]
    inside = [jnp.where((x > 0) & (x < 1), x, 0.0) for x in extrema]
    early, late = smaller(*inside), larger(*inside)
    at_early, at_late = (may_return & (cubic(x) < -noise) for x in (early, late))
    low = jnp.where(at_early, 0.0, jnp.where(at_late, early, late))
    high = jnp.where(at_early, early, jnp.where(at_late, late, 1.0))
    falls = at_early | at_late | (end < -noise)

    # Else XLA would compute all this anew for each result.
    low, high, slope, bend, twist = unknown((low, high, slope, bend, twist))
    first, width, value, fall = low, high - low, cubic(low), (high - low) * growth(low)
    starts_there = value <= noise
    root = jnp.sqrt(larger(fall**2 - 4 * value * (cubic(high) - value - fall), 0.0))
    x = low + width * jnp.clip(2 * value / _nonzero(root - fall), 0.0, 1.0)

    def nearer(_: Any, state: tuple[jax.Array, ...]) -> tuple[jax.Array, ...]:
        x, low, high = state
        y, fall = cubic(x), growth(x)
        low, high = jnp.where(y > 0, x, low), jnp.where(y > 0, high, x)
        root = jnp.sqrt(larger(4 * fall**2 - 12 * y * (bend + x * 3 * twist), 0.0))
        step = x - 3 * y / _nonzero(fall - root)
        return jnp.where((step >= low) & (step <= high), step, (low + high) / 2), low, high

    x = lax.fori_loop(0, _ITERATIONS, nearer, (x, low, high))[0]
    return jnp.where(falls, jnp.where(starts_there, first, x), jnp.inf)


def _nonzero(x: jax.Array) -> jax.Array:
    return jnp.where(x == 0, 1.0, x)
