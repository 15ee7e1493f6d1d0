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
from jaxpound.simulation.shortcut import with_shortcut

Advance = Callable[[Any, list[jax.Array], jax.Array, Any], tuple[Any, list[jax.Array], Any]]
BlockForm = Literal["written out", "loop", "recomputed"]
SingleStep = Callable[[Any, Any], tuple[Any, Any]]


def _layout(n_steps: int, segmented: bool) -> tuple[int, int, int]:
    """Numbers of segments, of blocks in each (about as many), and of idle steps before step 0."""
    blocks = -(-(n_steps + 1) // BLOCK)
    segment = blocks
    if segmented:
        root = math.isqrt(blocks - 1) + 1
        segment = min(range(root - root // 4, root + 1), key=lambda size: -blocks % size)
    segments = -(-blocks // segment)
    return segments, segment, segments * segment * BLOCK - (n_steps + 1)


def scan_with_history(
    advance: Advance,
    carry: Any,
    n_steps: int,
    orders: Sequence[jax.Array],
    history: HistorySum,
    inputs: Any = None,
    segmented: bool = False,
    checkpoint: bool = False,
    block: BlockForm = "written out",
    short: Advance | None = None,
) -> tuple[Any, Any]:
    """``lax.scan`` of advance(carry, sums, m, entry) → (carry, c, out) over m = 0 … n_steps.

    ``sums`` are the history sums S_m, one for each of ``orders``, ``c`` the new c_m; ``entry`` is
    entry m of ``inputs``, a pytree of arrays with a leading axis of n_steps+1. To fill whole blocks
    some steps m < 0 come first, with entries of zero: ``advance`` must leave a system at rest there
    at rest, with c = 0. ``segmented`` splits the scan into about √n_steps segments, whose small
    outputs XLA fills faster on a CPU; with ``checkpoint`` reverse mode keeps the first state of
    each only.

    The steps of a ``block`` are "written out" one after the other; in a "loop" of their own, so
    that the program of a long step is compiled once; or written out and "recomputed" in reverse
    mode, which then keeps the state before each block only.

    With ``short`` a batch takes a shortcut from this loop (``with_shortcut``): it does what
    ``advance`` does in steps that need no more, and its out is (out, whether the step needs more).
    """
    segments, segment, idle = _layout(n_steps, segmented or checkpoint)
    in_loop = block == "loop"
    kernels = [history.kernel(order, n_steps) for order in orders]
    weights = map(history.near, kernels, orders)
    near = [lax.split(weights_of_rod, (1,) * NEAR) for weights_of_rod in weights]

    def single_step(advance: Advance, state: Any, item: Any) -> tuple[Any, Any]:
        m, carry, past = state
        # In a loop the carry is computed once in any case.
        carry = carry if in_loop else jax.tree.map(partial(_differentiated_once, unit), carry)
        far, entry = item
        sums = [
            ahead.squeeze() + sum(w.squeeze() * y for w, y in zip(weight, c[::-1], strict=False))
            for ahead, weight, c in zip(far, near, past, strict=True)
        ]
        carry, new, seen = advance(carry, sums, m, entry)
        return (m + 1, carry, [[*c, now] for c, now in zip(past, new, strict=True)]), seen

    # Derived from the carry, so that it varies over the mesh axes as the carry does (shard_map).
    zero = 0 * jax.tree.leaves(carry)[0]
    unit = lax.stop_gradient(1 + zero)
    # A step is traced and differentiated once, not for every step of a block.
    whole = partial(single_step, jax.jit(advance))
    steps: Callable[..., Any] = partial(_written_out, whole)
    if in_loop:
        steps = partial(_in_loop, whole, zero)
    elif block == "recomputed":
        steps = jax.checkpoint(steps, prevent_cse=False)
    if short is not None:
        steps = with_shortcut(steps, partial(_shorter, partial(single_step, jax.jit(short))))

    def of_block(state: Any, entries: Any) -> tuple[Any, Any]:
        start, carry, memories, recent = state  # c_{m0−BLOCK} and on
        of_rods = zip(kernels, memories, strict=True)
        ahead = [history.ahead(kernel, memory, start) for kernel, memory in of_rods]
        carry, past, out = steps((start, carry, recent), ahead, entries)
        memories = [
            history.absorb(kernel, memory, start, jnp.stack(c))
            for kernel, memory, c in zip(kernels, memories, recent, strict=True)
        ]
        return (start + BLOCK, carry, memories, past), out

    def run(state: Any, entries: Any) -> tuple[Any, Any]:
        return lax.scan(of_block, state, entries, length=segment)

    memories = [jax.tree.map(lambda y: y + zero, history.empty(kernel)) for kernel in kernels]
    recent = [[zero] * BLOCK for _ in kernels]
    state = jnp.asarray(-idle), carry, memories, recent
    if checkpoint:
        run = jax.checkpoint(run, prevent_cse=False)
    inputs = jax.tree.map(lambda x: _in_blocks(x, segments, segment, idle), inputs)
    if segments > 1:
        state, out = lax.scan(run, state, inputs, length=segments)
    else:
        state, out = run(state, jax.tree.map(lambda x: x[0], inputs))
    if not in_loop:
        out = jax.tree.map(lambda *x: jnp.stack(x, -1), *out)
    series = jax.tree.map(lambda x: x.reshape(-1)[idle:], out)
    return state[1], series


@jax.custom_jvp
def _differentiated_once(unit: jax.Array, x: jax.Array) -> jax.Array:
    """x, whose derivative is divided by a number that is always 1, but that XLA cannot know.

    XLA computes quotients once, and other expressions again at each use, which in reverse mode
    would repeat the derivative of a whole step.
    """
    return x


@_differentiated_once.defjvp
def _(primals: Any, tangents: Any) -> tuple[jax.Array, jax.Array]:
    (unit, x), (_, change) = primals, tangents
    return x, change / unit if change.dtype == unit.dtype else change


def _written_out(single_step: SingleStep, state: Any, ahead: Any, entries: Any) -> Any:
    """The steps of a block one after the other: the carry, its c, and a list of outs."""
    split, out = [lax.split(far, (1,) * BLOCK) for far in ahead], []
    for i in range(BLOCK):
        entry = jax.tree.map(lambda x, i=i: x[i], entries)
        state, seen = single_step(state, ([far[i] for far in split], entry))
        out.append(seen)
    _, carry, past = state
    return carry, [c[-BLOCK:] for c in past], out


def _shorter(single_step: SingleStep, state: Any, ahead: Any, entries: Any) -> Any:
    """The same of shorter steps, with the outs in arrays, and whether any of them needs more."""
    carry, past, out = _written_out(single_step, state, ahead, entries)
    seen, needs_more = jax.tree.map(lambda *x: jnp.stack(x), *out)
    return (carry, past, seen), needs_more.any()


def _in_loop(single_step: SingleStep, zero: jax.Array, state: Any, ahead: Any, entries: Any) -> Any:
    """The steps of a block as a loop, with a window of c of constant length, and outs in arrays."""

    def slid(state: Any, item: Any) -> tuple[Any, Any]:
        (m, carry, past), seen = single_step(state, item)
        return (m, carry, [c[1:] for c in past]), seen

    start, carry, recent = state
    window = [[zero] * (NEAR - BLOCK) + c for c in recent]
    (_, carry, past), out = lax.scan(slid, (start, carry, window), (ahead, entries), length=BLOCK)
    return carry, [c[-BLOCK:] for c in past], out


def _in_blocks(x: jax.Array, segments: int, segment: int, idle: int) -> jax.Array:
    """A series with idle zeros before it, shape (segments, segment, BLOCK, ...)."""
    padded = jnp.pad(x, [(idle, 0), *[(0, 0)] * (x.ndim - 1)])
    return padded.reshape(segments, segment, BLOCK, *x.shape[1:])
