"""A computation for those lanes of a batch that need it, in small groups.

Under vmap a loop goes on until all lanes of the batch have finished, and every lane pays for every
iteration. So ``where_needed`` picks the lanes that need it, and runs the loop for them alone.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_batching import custom_vmap

from jaxpound._xla.batches import on_each_device

_FEW = 16  # lanes, all computed where any needs it: XLA makes no kernel of a loop that scatters
_COMPARED = 4096  # lanes up to which comparing all of them finds the next; beyond, a binary search


def lanes_at_a_time(reverse: bool) -> int:
    """The default width of ``where_needed``; in reverse each lane has a dozen columns."""
    return 256 if jax.default_backend() != "cpu" else 2 if reverse else 8


def where_needed(work: Callable[..., Any], width: int) -> Callable[..., Any]:
    """A function of ``(needed, *args)``: ``work(*args)`` if needed, else zeros.

    ``needed`` is a single truth value; ``args`` and the result are pytrees of arrays. Up to a
    ``width`` lanes of a batch work side by side.
    """

    def nothing(needed: jax.Array, shapes: Any) -> Any:
        # Derived from the input: constants would be the same on all devices, unlike the result.
        zero = 0 * needed.ravel()[0].astype(int)
        return jax.tree.map(lambda x: jnp.full(x.shape, zero.astype(x.dtype)), shapes)

    @custom_vmap
    def single(needed: jax.Array, *args: Any) -> Any:
        zeros = partial(nothing, needed, jax.eval_shape(work, *args))
        return lax.cond(needed, lambda: work(*args), zeros)

    @custom_vmap
    def many(needed: jax.Array, *args: Any) -> Any:
        side_by_side = jax.vmap(work)
        empty = nothing(needed, jax.eval_shape(side_by_side, *args))
        if needed.size > _FEW:
            return _in_groups(width, side_by_side, needed, args, empty)

        def masked() -> Any:
            used = partial(jax.vmap(jnp.where), needed)
            return jax.tree.map(used, side_by_side(*args), empty)

        return lax.cond(needed.any(), masked, lambda: empty)

    def flat(*args: Any) -> Any:
        size, each = args[0].shape
        joined = jax.tree.map(lambda x: x.reshape(size * each, *x.shape[2:]), args)
        return jax.tree.map(lambda x: x.reshape(size, each, *x.shape[1:]), many(*joined))

    single.def_vmap(partial(_on_devices, many))
    many.def_vmap(partial(_on_devices, flat))
    return single


def _on_devices(function: Callable[..., Any], size: int, batched: Any, *args: Any) -> Any:
    """The rule of a batch: arguments get its axis, also those that all lanes share."""

    def repeated(x: Any, differs: bool) -> Any:
        return x if differs else jnp.broadcast_to(x, (size, *jnp.shape(x)))

    out = on_each_device(function, *jax.tree.map(repeated, args, tuple(batched)), size=size)
    return out, jax.tree.map(lambda _: True, out)


def _in_groups(width: int, work: Callable[..., Any], needed: jax.Array, args: Any, out: Any) -> Any:
    """``out`` with the results of ``work`` in the lanes that need it, computed by groups."""
    size, places = needed.shape[0], jnp.cumsum(needed)
    width, count = min(width, size), places[-1]

    def group(carry: Any) -> Any:
        done, out = carry
        # The next lanes that need the work; the group is filled up with copies of its first.
        numbers = next_lanes(places, done, width)
        lanes = jnp.where(numbers < size, numbers, numbers[0])

        def picked(x: Any) -> Any:
            return x.at[lanes].get(mode="promise_in_bounds", wrap_negative_indices=False)

        def placed(x: Any, part: Any) -> Any:
            return x.at[numbers].set(part, mode="drop", wrap_negative_indices=False)

        return done + width, jax.tree.map(placed, out, work(*jax.tree.map(picked, args)))

    return lax.while_loop(lambda carry: carry[0] < count, group, (0 * count, out))[1]


def next_lanes(places: jax.Array, done: jax.Array, width: int) -> jax.Array:
    """Numbers of the next lanes that need the work; the size of the batch where there are none.

    ``places`` counts those up to each lane, of which some are ``done``.
    """
    method = "compare_all" if places.size <= _COMPARED else "scan"
    return jnp.searchsorted(places, done + 1 + jnp.arange(width), method=method)
