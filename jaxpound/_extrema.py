"""Maximum and minimum of two numbers, with a derivative that survives compilation.

``jnp.maximum`` and ``jnp.max`` differentiate by comparing the result with the operands. A compiled
program may round an operand twice, differently; the derivative then becomes 0 or 0/0. These
functions compare the operands with each other, for value and derivative alike.
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
