"""The loop over time: one ``lax.scan`` over blocks of steps, and the rods' memories between them.

block of steps m0 … m0 + 3                          next block
┌──────────────────────────────────────────────┐
│ ahead: contribution of all c older than the  │    history.ahead
│        previous block to S of these steps    │
│ step m0     S = ahead + near · recent c      │    advance → c of m0
│ step m0+1   S = ahead + near · recent c      │    advance → c of m0+1
│ …                                            │
│ absorb: the previous block's c enter memory  │    history.absorb
└──────────────────────────────────────────────┘

Where a step is a long program, as with contact, the loop is over steps, of which every fourth
begins a block.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Literal

import jax
import jax.numpy as jnp
from jax import lax

from jaxpound.simulation.history import BLOCK, NEAR, HistorySum

Advance = Callable[[Any, list[jax.Array], jax.Array, Any], tuple[Any, list[jax.Array], Any]]

Layout = Literal["written out", "looped", "step by step"]
"""How the loop's program has the steps of a block: one after the other; as a loop within the loop;
or in one loop over steps, with the memories of all rods in one array. Each is less to compile than
the one before it; the first is the fastest for short steps, the last for long ones."""


def _divided(n_steps: int, length: int, segmented: bool) -> tuple[int, int, int]:
    """Numbers of segments, of blocks of ``length`` steps in each, and of idle steps before 0."""
    blocks = -(-(n_steps + 1) // length)
    segment = blocks
    if segmented:
        root = math.isqrt(blocks - 1) + 1
        segment = min(range(root - root // 4, root + 1), key=lambda size: -blocks % size)
    segments = -(-blocks // segment)
    return segments, segment, segments * segment * length - (n_steps + 1)


def scan_with_history(
    advance: Advance,
    carry: Any,
    n_steps: int,
    orders: Sequence[jax.Array],
    history: HistorySum,
    inputs: Any = None,
    segmented: bool = False,
    checkpoint: bool = False,
    layout: Layout = "written out",
) -> tuple[Any, Any]:
    """``lax.scan`` of advance(carry, sums, m, entry) → (carry, c, out) over m = 0 … n_steps.

    ``sums`` are the history sums S_m, one for each of ``orders``, ``c`` the new c_m; ``entry`` is
    entry m of ``inputs``, a pytree of arrays with a leading axis of n_steps+1. To fill whole blocks
    some steps m < 0 come first, with entries of zero: ``advance`` must leave a system at rest there
    at rest, with c = 0. ``segmented`` splits the scan into about √n_steps segments, whose small
    outputs XLA fills faster on a CPU; with ``checkpoint`` reverse mode keeps the first state of
    each only. A ``layout`` other than "written out" compiles the program of a step once.
    """
    advance = jax.jit(advance)  # traced and differentiated once, not for every step of a block
    # Derived from the carry, so that it varies over the mesh axes as the carry does (shard_map).
    zero = 0 * jax.tree.leaves(carry)[0]
    if layout == "step by step":
        length, (block, memories) = 1, _steps(advance, n_steps, orders, history, zero)
    else:
        length, looped = BLOCK, layout == "looped"
        block, memories = _blocks(advance, n_steps, orders, history, zero, looped)
    segments, segment, idle = _divided(n_steps, length, segmented or checkpoint)

    def run(state: Any, entries: Any) -> tuple[Any, Any]:
        return lax.scan(block, state, entries, length=segment)

    if checkpoint:
        run = jax.checkpoint(run, prevent_cse=False)
    state = jnp.asarray(-idle), carry, memories
    inputs = jax.tree.map(lambda x: _in_blocks(x, segments, segment, length, idle), inputs)
    if segments > 1:
        state, out = lax.scan(run, state, inputs, length=segments)
    else:
        state, out = run(state, jax.tree.map(lambda x: x[0], inputs))
    if layout == "written out":
        out = jax.tree.map(lambda *x: jnp.stack(x, -1), *out)
    series = jax.tree.map(lambda x: x.reshape(-1)[idle:], out)
    return state[1], series


def _blocks(
    advance: Advance,
    n_steps: int,
    orders: Sequence[jax.Array],
    history: HistorySum,
    zero: jax.Array,
    looped: bool,
) -> tuple[Callable[[Any, Any], tuple[Any, Any]], Any]:
    """The body of a loop over blocks of steps, and the rods' memories at rest.

    Memories are those of the history, and c_{m0−BLOCK} to c_{m0−1}.
    """
    kernels = [history.kernel(order, n_steps) for order in orders]
    weights = map(history.near, kernels, orders)
    near = [lax.split(weights_of_rod, (1,) * NEAR) for weights_of_rod in weights]

    def single_step(state: Any, item: Any) -> tuple[Any, Any]:
        m, carry, past = state
        far, entry = item
        sums = [
            ahead.squeeze() + sum(w.squeeze() * y for w, y in zip(weight, c[::-1], strict=False))
            for ahead, weight, c in zip(far, near, past, strict=True)
        ]
        carry, new, seen = advance(carry, sums, m, entry)
        return (m + 1, carry, [[*c, now] for c, now in zip(past, new, strict=True)]), seen

    def block(state: Any, entries: Any) -> tuple[Any, Any]:
        start, carry, (memories, recent) = state
        of_rods = zip(kernels, memories, strict=True)
        ahead = [history.ahead(kernel, memory, start) for kernel, memory in of_rods]
        inside = start, carry, recent
        if looped:
            # A window of constant length: c before c_{m0−BLOCK} are in ``ahead``.
            def slid(state: Any, item: Any) -> tuple[Any, Any]:
                (m, carry, past), seen = single_step(state, item)
                return (m, carry, [c[1:] for c in past]), seen

            inside = start, carry, [[zero] * (NEAR - BLOCK) + c for c in recent]
            (_, carry, past), out = lax.scan(slid, inside, (ahead, entries), length=BLOCK)
        else:
            split = [lax.split(far, (1,) * BLOCK) for far in ahead]
            out = []
            for i in range(BLOCK):
                entry = jax.tree.map(lambda x, i=i: x[i], entries)
                inside, seen = single_step(inside, ([far[i] for far in split], entry))
                out.append(seen)
            _, carry, past = inside
        memories = [
            history.absorb(kernel, memory, start, jnp.stack(c))
            for kernel, memory, c in zip(kernels, memories, recent, strict=True)
        ]
        return (start + BLOCK, carry, (memories, [c[-BLOCK:] for c in past])), out

    memories = [jax.tree.map(lambda y: y + zero, history.empty(kernel)) for kernel in kernels]
    return block, (memories, [[zero] * BLOCK for _ in kernels])


def _steps(
    advance: Advance,
    n_steps: int,
    orders: Sequence[jax.Array],
    history: HistorySum,
    zero: jax.Array,
) -> tuple[Callable[[Any, Any], tuple[Any, Any]], Any]:
    """The body of a loop over steps, and the rods' memories at rest, all side by side.

    Memories are those of the history, without the block before, their contributions to the block,
    and c_{m−2 BLOCK} to c_{m−1}. As a block begins, the memory takes in the one before the last.
    """
    of_rods = jnp.stack(orders) if orders else jnp.zeros(0, zero.dtype)
    kernels = jax.vmap(lambda order: history.kernel(order, n_steps))(of_rods)
    weights = jax.vmap(history.near)(kernels, of_rods)
    near = jnp.pad(weights, ((0, 0), (0, 1)))[:, ::-1]  # by the lags 2 BLOCK, …, 1
    lags = jnp.arange(2 * BLOCK, 0, -1)

    # Else reverse mode would keep the kernels and the windows of every step.
    @partial(jax.checkpoint, prevent_cse=False)
    def sums_at(constants: Any, m: Any, memory: Any, ahead: jax.Array, recent: jax.Array) -> Any:
        """S_m, and the memory and its contributions, which are new where a block begins at m."""
        kernels, near = constants

        def absorbed() -> tuple[Any, jax.Array]:
            absorb = jax.vmap(history.absorb, (0, 0, None, 0))
            whole = absorb(kernels, memory, m - BLOCK, recent[:, :BLOCK])
            return whole, jax.vmap(history.ahead, (0, 0, None))(kernels, whole, m)

        i = m % BLOCK
        memory, ahead = lax.cond(i == 0, absorbed, lambda: (memory, ahead))
        inside = jnp.where(lags <= BLOCK + i, near, 0.0)
        total = lax.dynamic_index_in_dim(ahead, i, 1, False) + (inside * recent).sum(axis=1)
        return total, memory, ahead

    def step(state: Any, entry: Any) -> tuple[Any, Any]:
        m, carry, (memory, ahead, recent) = state
        sums, memory, ahead = sums_at((kernels, near), m, memory, ahead, recent)
        now = jax.tree.map(lambda x: x[0], entry)
        carry, new, seen = advance(carry, [sums[r] for r in range(len(orders))], m, now)
        newest = jnp.stack(new)[:, None] if new else recent[:, :1]
        recent = jnp.concatenate([recent[:, 1:], newest], axis=1)
        return (m + 1, carry, (memory, ahead, recent)), seen

    empty = jax.tree.map(lambda y: y + zero, jax.vmap(history.empty)(kernels))
    shapes = (len(orders), BLOCK), (len(orders), 2 * BLOCK)
    return step, (empty, *(jnp.zeros(shape, zero.dtype) + zero for shape in shapes))


def _in_blocks(x: jax.Array, segments: int, segment: int, length: int, idle: int) -> jax.Array:
    """A series with idle zeros before it, shape (segments, segment, length, ...)."""
    padded = jnp.pad(x, [(idle, 0), *[(0, 0)] * (x.ndim - 1)])
    return padded.reshape(segments, segment, length, *x.shape[1:])
