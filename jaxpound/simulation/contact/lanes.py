"""A computation for those lanes of a batch that need it, in small groups.

Under vmap a loop goes on until all lanes of the batch have finished, and every lane pays for every
iteration. So ``where_needed`` gathers the lanes that need it into small groups, and runs the loop
for one group after the other.

On CPUs XLA starts each small operation of a program on its own, which takes longer than the
operation. So the computation may be compiled as one kernel: XLA does that for calls that bear the
attribute by which its own pass for small loops (``SmallWhileLoopHoistingPass``) marks them. All of
a kernel's arguments are one array, as XLA fails where a kernel does not use an argument.
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
from jax.experimental.xla_metadata import set_xla_metadata

from jaxpound.simulation.batches import on_each_device


class _Layout(NamedTuple):
    """Where the arrays of a pytree are in a column of numbers."""

    tree: Any
    shapes: tuple[tuple[int, ...], ...]
    dtypes: tuple[Any, ...]

    @staticmethod
    def of(tree: Any) -> _Layout:
        """The layout of a pytree of arrays or of their shapes."""
        leaves, structure = jax.tree.flatten(tree)
        return _Layout(structure, *zip(*((x.shape, x.dtype) for x in leaves), strict=True))

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


def where_needed(
    work: Callable[..., Any], width: int, one_kernel: bool = False
) -> Callable[..., Any]:
    """A function of ``(needed, *args)``: ``work(*args)`` if needed, else zeros.

    A group has ``width`` lanes: enough to fill vector registers, few enough to finish together.

    ``needed`` is a single truth value; ``args`` and the result are pytrees of real arrays. With
    ``one_kernel``, on CPUs, the work of a group is compiled as one kernel. It may have loops and
    branches, but no operation for which XLA calls a library or has a kernel of its own, such as
    scatter, sort, products of matrices, or sums of 4,096 numbers and more.
    """

    @partial(jax.jit, static_argnums=0)
    def columns(layout: _Layout, column: jax.Array) -> jax.Array:
        result = work(*layout.pytree(column))
        return _Layout.of(result).column(result)

    def kernel(layout: _Layout, column: jax.Array) -> jax.Array:
        result = columns(layout, column)
        if not one_kernel:
            return result
        return set_xla_metadata(result, xla_cpu_small_call="true", inlineable="false")

    @custom_vmap
    def single(needed: jax.Array, *args: Any) -> Any:
        layout, results = _Layout.of(args), _Layout.of(jax.eval_shape(work, *args))
        column = layout.column(args)
        # Derived from the input: constants would be the same on all devices, unlike the result.
        nothing = jnp.full(results.ends[-1], 0 * needed.astype(int), results.dtype)
        return results.pytree(lax.cond(needed, lambda: kernel(layout, column), lambda: nothing))

    @custom_vmap
    def many(needed: jax.Array, *args: Any) -> Any:
        lane = jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape[1:], x.dtype), args)
        results = _Layout.of(jax.eval_shape(work, *lane))
        out = _in_groups(kernel, width, needed, args, _Layout.of(lane), results)
        return jax.vmap(results.pytree, in_axes=1)(out)

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


def _in_groups(
    kernel: Callable[..., jax.Array],
    width: int,
    needed: jax.Array,
    args: Any,
    layout: _Layout,
    results: _Layout,
) -> jax.Array:
    """Columns of results, a lane each, which ``kernel`` makes of groups of columns."""
    size, count = needed.shape[0], needed.sum()
    width = min(width, size)

    def group(carry: Any) -> Any:
        done, out = carry
        # The next lanes that need the work; the group is filled up with copies of its first.
        ranks = done + 1 + jnp.arange(width)
        numbers = (jnp.cumsum(needed)[None] < ranks[:, None]).sum(1)
        lanes = jnp.where(numbers < size, numbers, numbers[0])
        of_group = jax.tree.map(lambda x: jnp.take(x, lanes, axis=0, mode="clip"), args)
        columns = jax.vmap(layout.column, out_axes=1)(of_group)
        columns = jax.vmap(partial(kernel, layout), in_axes=1, out_axes=1)(columns)
        return done + width, out.at[:, numbers].set(columns, mode="drop")

    none = 0 * count  # derived from the input, as it may differ from device to device
    empty = jnp.zeros((results.ends[-1], size), results.dtype) + none.astype(results.dtype)
    return lax.while_loop(lambda carry: carry[0] < count, group, (none, empty))[1]
