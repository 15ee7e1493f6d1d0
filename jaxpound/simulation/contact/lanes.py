"""A computation for those lanes of a batch that need it, in small groups.

Under vmap a loop goes on until all lanes of the batch have finished, and every lane pays for every
iteration. So ``where_needed`` picks the lanes that need it, and runs the loop for them alone.

Lanes are picked in small groups. The computation of a lane may be compiled as one kernel
(``kernels``): then those of a group are run one after the other, elsewhere side by side. All of a
kernel's arguments are one array, as it must use them all.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import accumulate
from math import prod
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_batching import custom_vmap

from jaxpound.simulation.batches import on_each_device
from jaxpound.simulation.kernels import in_kernel

_OfColumn = Callable[[jax.Array], jax.Array]
_ToColumn = Callable[[Any], jax.Array]


_PICKED = 8
"""Lanes that are picked at a time where they are computed one after the other."""


_COMPARED = 4096
"""Lanes up to which comparing all of them finds the next ones; beyond, a binary search."""


class _Layout(NamedTuple):
    """Where the arrays of a pytree are in a column of numbers."""

    tree: Any
    kind: int  # hash of the tree, since those of different classes may be equal
    shapes: tuple[tuple[int, ...], ...]
    dtypes: tuple[Any, ...]

    @staticmethod
    def of(tree: Any) -> _Layout:
        """The layout of a pytree of arrays or of their shapes."""
        leaves, structure = jax.tree.flatten(tree)
        return _Layout(
            structure, hash(structure), *zip(*((x.shape, x.dtype) for x in leaves), strict=True)
        )

    @property
    def ends(self) -> list[int]:
        """The row after each array."""
        return [*accumulate(map(prod, self.shapes))]

    @property
    def dtype(self) -> Any:
        """The type of a column's numbers."""
        return jnp.result_type(*self.dtypes)

    def column(self, tree: Any) -> jax.Array:
        """The numbers of such a pytree, (n,)."""
        return jnp.concatenate([x.astype(self.dtype).ravel() for x in jax.tree.leaves(tree)])

    def pytree(self, column: jax.Array) -> Any:
        """The pytree of such a column."""
        parts = zip(jnp.split(column, self.ends[:-1]), self.shapes, self.dtypes, strict=True)
        leaves = [part.reshape(shape).astype(kind) for part, shape, kind in parts]
        return jax.tree.unflatten(self.tree, leaves)


def where_needed(work: Callable[..., Any], width: int | None = None) -> Callable[..., Any]:
    """A function of ``(needed, *args)``: ``work(*args)`` if needed, else zeros.

    ``needed`` is a single truth value; ``args`` and the result are pytrees of real arrays. Up to a
    ``width`` lanes of a batch work side by side. Without one the work of each lane is one kernel.
    """

    @partial(jax.jit, static_argnums=0)
    def columns(layout: _Layout, column: jax.Array) -> jax.Array:
        result = work(*layout.pytree(column))
        return _Layout.of(result).column(result)

    def lane(layout: _Layout, column: jax.Array) -> jax.Array:
        result = columns(layout, column)
        return in_kernel(result) if width is None else result

    @custom_vmap
    def single(needed: jax.Array, *args: Any) -> Any:
        layout, results = _Layout.of(args), _Layout.of(jax.eval_shape(work, *args))
        column = layout.column(args)
        # Derived from the input: constants would be the same on all devices, unlike the result.
        nothing = jnp.full(results.ends[-1], 0 * needed.astype(int), results.dtype)
        return results.pytree(lax.cond(needed, lambda: lane(layout, column), lambda: nothing))

    @custom_vmap
    def many(needed: jax.Array, *args: Any) -> Any:
        of_lane = jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape[1:], x.dtype), args)
        results = _Layout.of(jax.eval_shape(work, *of_lane))
        # Derived from the input, as it may differ from device to device.
        nothing = 0 * needed[0].astype(results.dtype)
        empty = jnp.full((results.ends[-1], needed.shape[0]), nothing)
        layout = _Layout.of(of_lane)
        group = partial(_one_by_one if width is None else _side_by_side, partial(lane, layout))
        out = _in_groups(width or _PICKED, group, layout.column, needed, args, empty)
        return jax.vmap(results.pytree, in_axes=1)(out)

    def flat(*args: Any) -> Any:
        size, each = args[0].shape
        joined = jax.tree.map(lambda x: x.reshape(size * each, *x.shape[2:]), args)
        return jax.tree.map(lambda x: x.reshape(size, each, *x.shape[1:]), many(*joined))

    single.def_vmap(_on_devices(many))
    many.def_vmap(_on_devices(flat))
    return single


def _on_devices(function: Callable[..., Any]) -> Callable[..., Any]:
    """The rule of a batch: arguments get its axis, also those that all lanes share."""

    def repeated(size: int, x: Any, differs: bool) -> Any:
        return x if differs else jnp.broadcast_to(x, (size, *jnp.shape(x)))

    def rule(size: int, batched: Any, *args: Any) -> Any:
        args = jax.tree.map(partial(repeated, size), args, tuple(batched))
        out = on_each_device(function, *args, size=size)
        return out, jax.tree.map(lambda _: True, out)

    return rule


def _in_groups(
    width: int,
    work: Callable[..., jax.Array],
    column_of: _ToColumn,
    needed: jax.Array,
    args: Any,
    out: jax.Array,
) -> jax.Array:
    """Columns of results, a lane each, with those of the lanes that need it computed by groups.

    ``work`` puts results of the first lanes of a group, which may not be full, in their places.
    """
    size, places = needed.shape[0], jnp.cumsum(needed)
    width, count = min(width, size), places[-1]

    def group(carry: Any) -> Any:
        done, out = carry
        # The next lanes that need the work; the group is filled up with copies of its first.
        numbers = next_lanes(places, done, width)
        lanes = jnp.where(numbers < size, numbers, numbers[0])
        of_group = jax.tree.map(lambda x: jnp.take(x, lanes, axis=0, mode="clip"), args)
        columns = jax.vmap(column_of, out_axes=1)(of_group)
        return done + width, work(columns, numbers, count - done, out)

    return lax.while_loop(lambda carry: carry[0] < count, group, (0 * count, out))[1]


def next_lanes(places: jax.Array, done: jax.Array, width: int) -> jax.Array:
    """Numbers of the next lanes that need the work; the size of the batch where there are none.

    ``places`` counts those up to each lane, of which some are ``done``.
    """
    method = "compare_all" if places.size <= _COMPARED else "scan"
    return jnp.searchsorted(places, done + 1 + jnp.arange(width), method=method)


def _one_by_one(
    work: _OfColumn, columns: jax.Array, numbers: jax.Array, count: jax.Array, out: jax.Array
) -> jax.Array:
    """Results of the first ``count`` columns, each computed after the other, in their places."""

    def lane(k: jax.Array, out: jax.Array) -> jax.Array:
        result = work(lax.dynamic_index_in_dim(columns, k, 1, False))
        return lax.dynamic_update_index_in_dim(out, result, numbers[k], 1)

    return lax.fori_loop(0 * count, jnp.minimum(count, len(numbers)), lane, out)


def _side_by_side(
    work: _OfColumn, columns: jax.Array, numbers: jax.Array, count: jax.Array, out: jax.Array
) -> jax.Array:
    """Results of all columns, computed together, in the places of those that have one."""
    return out.at[:, numbers].set(jax.vmap(work, in_axes=1, out_axes=1)(columns), mode="drop")
