"""What XLA must not know, or it would compute it anew for each use.

XLA merges operations into kernels, and in each kernel computes again what it needs of products and
sums; only a quotient it computes once. So a number that is used often is written as a quotient, or
divided by a unit: a number that is always 1, but that XLA cannot know. Otherwise reverse mode, for
one, would repeat the derivative of a whole step for each of its results. Nor must XLA know the
numbers of a run: it would turn quotients by constants into products.
"""

from __future__ import annotations

from functools import partial
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_derivatives import SymbolicZero

T = TypeVar("T")


def unknown(tree: T) -> T:
    """The same numbers, which XLA computes once, together, and holds for no constants."""
    return lax.optimization_barrier(tree)


def unit_of(zero: jax.Array) -> jax.Array:
    """The unit from a zero that XLA does not know either: 0 times a finite number of the run."""
    return lax.stop_gradient(1 + zero)


def once(tree: T, unit: jax.Array) -> T:
    """The same numbers, which are computed once, as are their derivatives."""
    return jax.tree.map(lambda y: y / unit, tree)


def for_each_run(tree: T, zero: jax.Array) -> T:
    """The same numbers, of each run of a batch apart, which XLA does not know either.

    It would fold all that follows from constants of the program, and turn quotients by numbers that
    runs share into products; derivatives by these would be summed over the batch at every step, not
    once at the end.
    """
    return jax.tree.map(partial(jnp.add, lax.stop_gradient(zero)), tree)


def differentiated_once(tree: T, unit: jax.Array) -> T:
    """The same numbers, of which the derivatives alone are computed ``once``."""
    return jax.tree.map(partial(_over_unit, unit), tree)


@jax.custom_jvp
def _over_unit(unit: jax.Array, x: jax.Array) -> jax.Array:
    return x


@_over_unit.defjvp
def _(primals: Any, tangents: Any) -> tuple[jax.Array, jax.Array]:
    (unit, x), (_, change) = primals, tangents
    return x, once(change, unit) if change.dtype == unit.dtype else change


@jax.custom_jvp
def differentiated_with(x: jax.Array, numbers: Any) -> jax.Array:
    """x, with a derivative of zero by the numbers, so that all that starts as x has one.

    Otherwise JAX finds out step by step which states have a derivative, and differentiates a step
    anew each time.
    """
    return x


@partial(differentiated_with.defjvp, symbolic_zeros=True)
def _(primals: Any, tangents: Any) -> Any:
    changes = [t for t in jax.tree.leaves(tangents) if not isinstance(t, SymbolicZero)]
    # Not 0 * change: a weight in reverse mode may be infinite, and an array of numbers empty.
    return primals[0], jnp.where(False, changes[0], 0).sum()
