"""A shorter program for the runs of a batch that do not need the whole one.

A batch computes what any of its runs may need for all of them. Of a step with an inner loop that is
most of the work, though few runs need it at a time. ``with_shortcut`` takes a program without it
for all runs of the batch, which also tests what each of them needs; those that need more are
computed once more by the whole program, in groups.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from operator import or_
from typing import Any

import jax
import jax.numpy as jnp
from jax import core, lax
from jax.custom_batching import custom_vmap
from jax.custom_derivatives import SymbolicZero
from jax.extend.core import Jaxpr

from jaxpound._xla.batches import on_each_device
from jaxpound._xla.lanes import next_lanes

_SMALLEST = 64  # runs of a group, at least: so many take hardly longer than a few
_MOST_GROUPS = 8  # of a batch: each of them reads and writes the results of all runs


def with_shortcut(
    whole: Callable[..., Any], short: Callable[..., tuple[Any, jax.Array]]
) -> Callable[..., Any]:
    """``whole``, a function of pytrees of arrays, that takes a shortcut in a batch.

    ``short`` returns the results of ``whole``, which are right unless the run needs ``whole``, and
    whether it does. A single run and all derivatives are computed by ``whole``.
    """

    def function(*args: Any) -> Any:
        program, shapes = jax.make_jaxpr(whole, return_shape=True)(*args)
        shorter = jax.make_jaxpr(short)(*args)
        n, end = len(program.consts), len(program.consts) + len(shorter.consts)
        whole_program, short_program = map(_without_outside, (program.jaxpr, shorter.jaxpr))

        def all_of_it(*values: Any) -> list[Any]:
            return core.eval_jaxpr(whole_program, (), *values[:n], *values[end:])

        def part_of_it(*values: Any) -> list[Any]:
            return core.eval_jaxpr(short_program, (), *values[n:])

        outside = *program.consts, *shorter.consts
        results = _in_batches(all_of_it, part_of_it, *outside, *jax.tree.leaves(args))
        return jax.tree.unflatten(jax.tree.structure(shapes), results)

    return function


def _without_outside(program: Jaxpr) -> Jaxpr:
    """A program that holds nothing of the outside: what it uses of it are its first arguments."""
    inputs = *program.constvars, *program.invars
    names = program.debug_info.with_unknown_names()
    return Jaxpr((), inputs, program.outvars, program.eqns, program.effects, names)


@partial(jax.custom_jvp, nondiff_argnums=(0, 1))
def _in_batches(whole: Callable[..., Any], short: Callable[..., Any], *values: Any) -> list[Any]:
    single = custom_vmap(whole)

    @single.def_vmap
    def batch(size: int, batched: Sequence[bool], *values: Any) -> tuple[list[Any], list[bool]]:
        axes, shared = [0 if differs else None for differs in batched], [not x for x in batched]
        whole_batch, short_batch = jax.vmap(whole, axes), jax.vmap(short, axes)

        def on_device(*values: Any) -> list[Any]:
            *results, needed = short_batch(*values)
            return _replaced(whole_batch, needed, shared, values, results)

        @custom_vmap
        def runs(*values: Any) -> list[Any]:
            return on_each_device(on_device, *values, size=size, shared=shared)

        @runs.def_vmap
        def batch_of_batches(n: int, outer: Sequence[bool], *values: Any) -> Any:
            joined = [
                _joined(n, size, x, *differs)
                for x, *differs in zip(values, outer, batched, strict=True)
            ]
            results, are_batched = batch(n * size, [*map(or_, outer, batched)], *joined)
            return [x.reshape(n, size, *x.shape[1:]) for x in results], are_batched

        results = runs(*values)
        return results, [True] * len(results)

    return single(*values)


def _joined(n: int, size: int, x: Any, in_outer: bool, in_inner: bool) -> Any:
    """A number of n batches as that of one batch of all of their runs, if it differs in any."""
    if not (in_outer or in_inner):
        return x
    x = x if in_outer else x[None]
    x = x if in_inner else x[:, None]
    return jnp.broadcast_to(x, (n, size, *x.shape[2:])).reshape(n * size, *x.shape[2:])


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
    size = needed.shape[0]
    width = min(max(_SMALLEST, -(-size // _MOST_GROUPS)), size)

    def group(state: Any) -> Any:
        needed, results = state
        places = jnp.cumsum(needed)
        is_in_group = needed & (places <= width)
        # Filled up with a run that does not need it, so that its copies take no time.
        numbers = next_lanes(places, jnp.zeros_like(places[0]), width)
        lanes = jnp.where(numbers < size, numbers, jnp.argmin(needed))
        of_group = [
            x if common else jnp.take(x, lanes, axis=0, mode="clip")
            for x, common in zip(values, shared, strict=True)
        ]

        def placed(result: jax.Array, of_group: jax.Array) -> jax.Array:
            mask = is_in_group.reshape(-1, *(1,) * (result.ndim - 1))
            return jnp.where(mask, jnp.take(of_group, places - 1, axis=0, mode="clip"), result)

        return needed & ~is_in_group, [*map(placed, results, whole(*of_group))]

    return lax.while_loop(lambda state: state[0].any(), group, (needed, results))[1]
