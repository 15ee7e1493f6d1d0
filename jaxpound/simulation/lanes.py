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

_WIDTH = 16  # lanes in a group: enough to fill vector registers, few enough to finish together


def where_needed(work: Callable[..., Any]) -> Callable[..., Any]:
    """``work(needed, *args)``, whose result is zero in lanes of a batch that do not need it.

    ``needed`` is one truth value; ``args`` and the result are pytrees of real arrays.
    """
    mapped = custom_vmap(work)

    @mapped.def_vmap
    def gathered(size: int, batched: Any, needed: jax.Array, *args: Any) -> Any:
        is_batched = tuple(batched[1:])
        needed = jnp.broadcast_to(needed, (size,))
        axes = jax.tree.map(lambda one: 0 if one else None, is_batched)
        group = jax.vmap(work, in_axes=(0, *axes))
        width = min(_WIDTH, size)
        (lanes,) = jnp.nonzero(needed, size=size + width, fill_value=size)
        count = needed.sum()

        def taken(which: jax.Array) -> Any:
            return jax.tree.map(
                lambda x, one: jnp.take(x, which, axis=0, mode="clip") if one else x,
                args,
                is_batched,
            )

        shapes = jax.eval_shape(group, needed[:width], *taken(lanes[:width]))
        leaves, rebuild = jax.tree.flatten(shapes)
        rows = [leaf.size // width for leaf in leaves]
        kind = jnp.result_type(*[leaf.dtype for leaf in leaves])

        def one_group(carry: Any) -> Any:
            done, results = carry
            which = lax.dynamic_slice(lanes, (done,), (width,))
            found = jax.tree.leaves(group(which < size, *taken(which)))
            rows_found = [x.reshape(width, -1).T.astype(kind) for x in found]
            results = results.at[:, which].set(jnp.concatenate(rows_found), mode="drop")
            return done + width, results

        empty = jnp.zeros((sum(rows), size), kind)
        _, results = lax.while_loop(
            lambda carry: carry[0] < count, one_group, (jnp.zeros_like(count), empty)
        )
        split = jnp.split(results, [sum(rows[:i]) for i in range(1, len(rows))])
        out = [
            part.T.reshape(size, *leaf.shape[1:]).astype(leaf.dtype)
            for part, leaf in zip(split, leaves, strict=True)
        ]
        return jax.tree.unflatten(rebuild, out), jax.tree.unflatten(rebuild, [True] * len(out))

    return mapped
