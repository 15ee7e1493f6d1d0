"""A computation for those lanes of a batch that need it, in small groups.

Under vmap a loop goes on until all lanes of the batch have finished, and every lane pays for every
iteration. So ``where_needed`` gathers the lanes that need it into small groups, and runs the loop
for one group after the other.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_batching import custom_vmap

from jaxpound.simulation.batches import on_each_device


def where_needed(work: Callable[..., Any], width: int) -> Callable[..., Any]:
    """A function of ``(needed, *args)``: ``work(*args)`` if needed, else zeros.

    A group has ``width`` lanes: enough to fill vector registers, few enough to finish together.

    ``needed`` is a single truth value; ``args`` and the result are pytrees of real arrays. If
    ``work`` is jitted, it is traced only once.
    """

    @custom_vmap
    def single(needed: jax.Array, *args: Any) -> Any:
        shapes = jax.eval_shape(work, *args)
        # Derived from the input: constants would be the same on all devices, unlike the result.
        none = 0 * needed.astype(int)
        nothing = jax.tree.map(lambda x: jnp.full(x.shape, none, x.dtype), shapes)
        return lax.cond(needed, lambda: work(*args), lambda: nothing)

    @custom_vmap
    def many(needed: jax.Array, *args: Any) -> Any:
        return _in_groups(work, width, needed, args)

    @single.def_vmap
    def batch(size: int, batched: Any, *args: Any) -> Any:
        out = on_each_device(many, *_repeated(size, batched, args))
        return out, jax.tree.map(lambda _: True, out)

    @many.def_vmap
    def batch_of_batches(size: int, batched: Any, *args: Any) -> Any:
        def flat(*args: Any) -> Any:
            size, each = args[0].shape
            joined = jax.tree.map(lambda x: x.reshape(size * each, *x.shape[2:]), args)
            return jax.tree.map(lambda x: x.reshape(size, each, *x.shape[1:]), many(*joined))

        out = on_each_device(flat, *_repeated(size, batched, args))
        return out, jax.tree.map(lambda _: True, out)

    return single


def _repeated(size: int, batched: Any, args: Any) -> Any:
    """The arguments with a leading axis of the batch, also those that all lanes share."""
    return jax.tree.map(
        lambda x, differs: x if differs else jnp.broadcast_to(x, (size, *jnp.shape(x))),
        tuple(args),
        tuple(batched),
    )


def _in_groups(work: Callable[..., Any], width: int, needed: jax.Array, args: Any) -> Any:
    size, count = needed.shape[0], needed.sum()
    width = min(width, size)
    leaves, rebuild = jax.tree.flatten(jax.eval_shape(work, *jax.tree.map(lambda x: x[0], args)))
    rows = [leaf.size for leaf in leaves]
    kind = jnp.result_type(*[leaf.dtype for leaf in leaves])

    def group(carry: Any) -> Any:
        done, results = carry
        # The next lanes that need the work; the group is filled up with copies of its first.
        ranks = done + 1 + jnp.arange(width)
        numbers = (jnp.cumsum(needed)[None] < ranks[:, None]).sum(1)
        lanes = jnp.where(numbers < size, numbers, numbers[0])
        lanes_of_group = jax.tree.map(lambda x: jnp.take(x, lanes, axis=0, mode="clip"), args)
        leaves_of_group = jax.tree.leaves(jax.vmap(work)(*lanes_of_group))
        rows_of_group = [x.reshape(width, -1).T.astype(kind) for x in leaves_of_group]
        results = results.at[:, numbers].set(jnp.concatenate(rows_of_group), mode="drop")
        return done + width, results

    none = 0 * count  # derived from the input, as it may differ from device to device
    empty = jnp.zeros((sum(rows), size), kind) + none.astype(kind)
    _, results = lax.while_loop(lambda carry: carry[0] < count, group, (none, empty))
    split = jnp.split(results, [sum(rows[:i]) for i in range(1, len(rows))])
    out = [
        part.T.reshape(size, *leaf.shape).astype(leaf.dtype)
        for part, leaf in zip(split, leaves, strict=True)
    ]
    return jax.tree.unflatten(rebuild, out)
