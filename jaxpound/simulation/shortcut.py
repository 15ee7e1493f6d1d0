"""A shorter program for the runs of a batch that do not need the whole one.

A batch computes what any of its runs may need for all of them, and of a step with contact that is
most of the work, though few runs have contact at a time. ``with_shortcut`` takes a program without
it for all runs of the batch, which also tests what each of them needs; those that need more are
computed once more by the whole program, in groups.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import core, lax
from jax.custom_batching import custom_vmap
from jax.custom_derivatives import SymbolicZero

from jaxpound.simulation.batches import on_each_device
from jaxpound.simulation.contact.lanes import next_lanes

_GROUP = 64
"""Runs of a group: so many take hardly longer than a few."""


def with_shortcut(
    whole: Callable[..., Any], short: Callable[..., tuple[Any, jax.Array]]
) -> Callable[..., Any]:
    """``whole``, a function of pytrees of arrays, that takes a shortcut in a batch.

    ``short`` returns what ``whole`` does where that is not needed, and whether it is needed. A
    single run and all derivatives are computed by ``whole``.
    """

    def function(*args: Any) -> Any:
        program, shapes = jax.make_jaxpr(whole, return_shape=True)(*args)
        shorter = jax.make_jaxpr(short)(*args)
        n, outside = len(program.consts), [*program.consts, *shorter.consts]
        inputs = slice(len(outside), None)

        def all_of_it(*values: Any) -> list[Any]:
            return core.eval_jaxpr(program.jaxpr, values[:n], *values[inputs])

        def part_of_it(*values: Any) -> list[Any]:
            return core.eval_jaxpr(shorter.jaxpr, values[n : len(outside)], *values[inputs])

        results = _in_batches(all_of_it, part_of_it, *outside, *jax.tree.leaves(args))
        return jax.tree.unflatten(jax.tree.structure(shapes), results)

    return function


@partial(jax.custom_jvp, nondiff_argnums=(0, 1))
def _in_batches(whole: Callable[..., Any], short: Callable[..., Any], *values: Any) -> list[Any]:
    single = custom_vmap(whole)

    @single.def_vmap
    def batch(size: int, batched: Sequence[bool], *values: Any) -> tuple[list[Any], list[bool]]:
        axes, shared = [0 if differs else None for differs in batched], [not x for x in batched]
        whole_batch, short_batch = jax.vmap(whole, axes), jax.vmap(short, axes)

        def program(*values: Any) -> list[Any]:
            *results, needed = short_batch(*values)
            return _replaced(whole_batch, needed, shared, values, results)

        results = on_each_device(program, *values, size=size, shared=shared)
        return results, [True] * len(results)

    return single(*values)


@partial(_in_batches.defjvp, symbolic_zeros=True)
def _(
    whole: Callable[..., Any], short: Callable[..., Any], values: Any, changes: Any
) -> tuple[list[Any], list[Any]]:
    moved = [i for i, change in enumerate(changes) if not isinstance(change, SymbolicZero)]

    def of_moved(*numbers: Any) -> list[Any]:
        replaced = dict(zip(moved, numbers, strict=True))
        return whole(*(replaced.get(i, x) for i, x in enumerate(values)))

    return jax.jvp(of_moved, [values[i] for i in moved], [changes[i] for i in moved])


def _replaced(
    whole: Callable[..., list[Any]],
    needed: jax.Array,
    shared: Sequence[bool],
    values: Sequence[Any],
    results: list[Any],
) -> list[Any]:
    """The results of a batch with those of the runs that need the ``whole`` replaced by its own."""
    places = jnp.cumsum(needed)
    width, idle = min(_GROUP, needed.shape[0]), jnp.argmin(needed)

    def group(state: Any) -> Any:
        done, results = state
        numbers = next_lanes(places, done, width)
        lanes = jnp.where(numbers < needed.shape[0], numbers, idle)
        of_group = [
            x if common else jnp.take(x, lanes, axis=0, mode="clip")
            for x, common in zip(values, shared, strict=True)
        ]
        slots = places - 1 - done
        is_in_group = needed & (slots >= 0) & (slots < width)

        def placed(result: jax.Array, of_group: jax.Array) -> jax.Array:
            mask = is_in_group.reshape(-1, *(1,) * (result.ndim - 1))
            return jnp.where(mask, jnp.take(of_group, slots, axis=0, mode="clip"), result)

        return done + width, [*map(placed, results, whole(*of_group))]

    return lax.while_loop(lambda state: state[0] < places[-1], group, (0 * places[0], results))[1]
