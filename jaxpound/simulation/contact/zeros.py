"""Where a value first falls below zero, from its values and slopes at the ends of an interval."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from jaxpound._extrema import larger, smaller

_STEEPEST = 1e3  # largest slope, over the values


def first_zero(
    start: Any, slope: Any, end: Any, slope_end: Any, noise: Any, may_return: Any = True
) -> jax.Array:
    """Where a cubic on [0, 1] first falls below zero; inf if it never falls below −``noise``.

    The cubic is given by its values and slopes at both ends; its ``start`` is ≥ 0. The zero in its
    first monotone part that ends below zero is found by Laguerre's method, safeguarded by halving.
    Unless it ``may_return``, only a cubic that ends below zero counts.
    """
    # Some forces start with an infinite slope, in which all other numbers would be lost.
    steepest = _STEEPEST * (jnp.abs(start) + jnp.abs(end))
    slope, slope_end = (jnp.clip(x, -steepest, steepest) for x in (slope, slope_end))
    bend, twist = 3 * (end - start) - 2 * slope - slope_end, 2 * (start - end) + slope + slope_end

    def cubic(x: Any) -> Any:
        return start + x * (slope + x * (bend + x * twist))

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

    first, x = low, (low + high) / 2
    starts_there = cubic(first) <= noise
    for _ in range(4):
        y, fall = cubic(x), slope + x * (2 * bend + x * 3 * twist)
        low, high = jnp.where(y > 0, x, low), jnp.where(y > 0, high, x)
        root = jnp.sqrt(larger(4 * fall**2 - 12 * y * (bend + x * 3 * twist), 0.0))
        step = x - 3 * y / _nonzero(fall - root)
        x = jnp.where((step >= low) & (step <= high), step, (low + high) / 2)
    return jnp.where(falls, jnp.where(starts_there, first, x), jnp.inf)


def _nonzero(x: jax.Array) -> jax.Array:
    return jnp.where(x == 0, 1.0, x)
