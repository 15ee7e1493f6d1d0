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

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from jaxpound._xla.blocks import scan_blocks, steps_of_block
from jaxpound._xla.plan import Plan
from jaxpound.simulation.time.history import BLOCK, NEAR, HistorySum

Advance = Callable[[Any, list[jax.Array], jax.Array, Any], tuple[Any, list[jax.Array], Any]]


def scan_with_history(
    advance: Advance,
    carry: Any,
    n_steps: int,
    orders: Sequence[jax.Array],
    history: HistorySum,
    inputs: Any,
    plan: Plan,
    checkpoint: bool = False,
    short: Advance | None = None,
) -> tuple[Any, Any]:
    """``lax.scan`` of advance(carry, sums, m, entry) → (carry, c, out) over m = 0 … n_steps.

    ``sums`` are the history sums S_m, one for each of ``orders``, ``c`` the new c_m; ``entry`` is
    entry m of ``inputs``, a pytree of arrays with a leading axis of n_steps+1. To fill whole blocks
    some steps m < 0 come first, with entries of zero: ``advance`` must leave a system at rest there
    at rest, with c = 0. With ``checkpoint`` reverse mode keeps few states only.

    The ``plan`` says how the steps are laid out. ``short`` does what ``advance`` does in steps that
    need no more, and its out is (out, whether the step needs more).
    """
    kernels = [history.kernel(order, n_steps) for order in orders]
    weights = map(history.near, kernels, orders)
    near = [lax.split(weights_of_rod, (1,) * NEAR) for weights_of_rod in weights]

    def single_step(advance: Advance, state: Any, item: Any) -> tuple[Any, Any]:
        (m, carry, past), (far, entry) = state, item
        sums = [
            ahead.squeeze() + sum(w.squeeze() * y for w, y in zip(weight, c[::-1], strict=False))
            for ahead, weight, c in zip(far, near, past, strict=True)
        ]
        carry, new, seen = advance(carry, sums, m, entry)
        return (m + 1, carry, [[*c, now] for c, now in zip(past, new, strict=True)]), seen

    # Derived from the carry, so that it varies over the mesh axes as the carry does (shard_map).
    zero = 0 * jax.tree.leaves(carry)[0]
    # A step is traced and differentiated once, not for every step of a block.
    whole = partial(single_step, jax.jit(advance))
    shorter = None if short is None else partial(single_step, jax.jit(short))
    steps = steps_of_block(plan, whole, shorter, BLOCK, NEAR, zero)

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

    memories = [jax.tree.map(lambda y: y + zero, history.empty(kernel)) for kernel in kernels]
    recent = [[zero] * BLOCK for _ in kernels]
    state = carry, memories, recent
    state, series = scan_blocks(plan, of_block, state, inputs, BLOCK, n_steps + 1, checkpoint)
    return state[1], series
