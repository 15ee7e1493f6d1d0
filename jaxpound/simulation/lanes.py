"""Work that few runs of a batch need at a time, done for those alone.

Under ``vmap`` a loop goes on until all lanes of the batch have finished, and every lane pays for
every turn of it. Here the lanes that need the loop are gathered into small groups, and the loop
runs for one group after the other.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_batching import custom_vmap

from jaxpound.simulation.batches import on_each_device

_WIDTH = 32  # lanes in a group: enough to fill vector registers, few enough to finish together


def where_needed(work: Callable[..., Any]) -> Callable[..., Any]:
    """``(needed, *args)`` to ``work(*args)`` where that is needed, and to zeros elsewhere.

    ``needed`` is one truth value; ``args`` and the result are pytrees of real arrays. With ``work``
    under ``jit`` it is traced but once.
    """

    @custom_vmap
    def one(needed: jax.Array, *args: Any) -> Any:
        shapes = jax.eval_shape(work, *args)
        # Not constants, which are the same on all devices: a result differs.
        none = 0 * needed.astype(int)
        nothing = jax.tree.map(lambda x: jnp.full(x.shape, none, x.dtype), shapes)
        return lax.cond(needed, lambda: work(*args), lambda: nothing)

    @custom_vmap
    def many(needed: jax.Array, *args: Any) -> Any:
        return _in_groups(work, needed, args)

    @one.def_vmap
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

    return one


def _repeated(size: int, batched: Any, args: Any) -> Any:
    """The arguments with a leading axis of the batch, whether they differ in it or not."""
    return jax.tree.map(
        lambda x, differs: x if differs else jnp.broadcast_to(x, (size, *jnp.shape(x))),
        tuple(args),
        tuple(batched),
    )


def _in_groups(work: Callable[..., Any], needed: jax.Array, args: Any) -> Any:
    size, count = needed.shape[0], needed.sum()
    width = min(_WIDTH, size)
    numbers = jnp.arange(size)
    places = jnp.where(needed, jnp.cumsum(needed) - 1, size + width)
    lanes = jnp.full(size + width, size + 0 * count).at[places].set(numbers, mode="drop")

    def taken(which: jax.Array) -> Any:
        # A group is filled up with a lane that needs the work.
        which = jnp.where(which < size, which, lanes[0])
        return jax.tree.map(lambda x: jnp.take(x, which, axis=0, mode="clip"), args)

    leaves, rebuild = jax.tree.flatten(jax.eval_shape(work, *jax.tree.map(lambda x: x[0], args)))
    rows = [leaf.size for leaf in leaves]
    kind = jnp.result_type(*[leaf.dtype for leaf in leaves])

    def one_group(carry: Any) -> Any:
        done, results = carry
        which = lax.dynamic_slice(lanes, (done,), (width,))
        found = jax.tree.leaves(jax.vmap(work)(*taken(which)))
        rows_found = [x.reshape(width, -1).T.astype(kind) for x in found]
        results = results.at[:, which].set(jnp.concatenate(rows_found), mode="drop")
        return done + width, results

    none = 0 * count  # which may differ from device to device
    empty = jnp.zeros((sum(rows), size), kind) + none.astype(kind)
    _, results = lax.while_loop(lambda carry: carry[0] < count, one_group, (none, empty))
    split = jnp.split(results, [sum(rows[:i]) for i in range(1, len(rows))])
    out = [
        part.T.reshape(size, *leaf.shape).astype(leaf.dtype)
        for part, leaf in zip(split, leaves, strict=True)
    ]
    return jax.tree.unflatten(rebuild, out)
