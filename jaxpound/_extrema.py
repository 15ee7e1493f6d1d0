"""Maximum and minimum of two numbers, with a derivative that survives compilation.

``jnp.maximum`` and ``jnp.max`` find the branch of their derivative by comparing the result with the
operands. A compiled program may evaluate an operand twice, rounded differently; it then equals
neither, and the derivative is lost as a zero, or as 0/0. Here comparing the operands with each
other selects the branch, for the value and the derivative alike.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp


def larger(a: Any, b: Any) -> jax.Array:
    """The larger of a and b, elementwise; a where they are equal."""
    return jnp.where(b > a, b, a)


def smaller(a: Any, b: Any) -> jax.Array:
    """The smaller of a and b, elementwise; a where they are equal."""
    return jnp.where(b < a, b, a)


def peak(series: jax.Array) -> jax.Array:
    """Largest |y| of a series y, shape (n,)."""
    size = jnp.abs(series)
    return size[jnp.argmax(size)]
