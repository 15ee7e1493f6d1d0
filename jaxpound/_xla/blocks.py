"""The loop over the steps of a run, in blocks of a few steps, laid out by its plan.

A step is a function of its state, (number, carry, windows), and of what it is handed. It returns
the next state and its results, having put one number at the end of each window.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from jaxpound._xla.derivatives import Program, recomputed
from jaxpound._xla.plan import Plan
from jaxpound._xla.quotients import differentiated_once, unit_of
from jaxpound._xla.shortcut import with_shortcut


def steps_of_block(
    plan: Plan, step: Program, short: Program | None, length: int, window: int, zero: jax.Array
) -> Program:
    """A block as a function of (number, carry, windows), numbers and entries for its steps.

    It returns the carry, the windows and the results of ``scan_blocks``. Windows have the last
    numbers of a block, and as many as ``window`` in a step. ``short`` does what ``step`` does where
    it needs no inner loop; its results are (results, whether it needs one).
    """
    if plan.block != "loop":  # in which the carry is computed once in any case
        steps = partial(_written_out, step, length, unit_of(zero))
        return recomputed(steps) if plan.block == "recomputed" else steps
    steps = partial(_in_loop, step, length, window, zero)
    if short is None or plan.shortcut == "none":
        return steps
    if plan.shortcut == "loop":
        shorter = partial(_in_loop, short, length, window, zero)
    else:
        shorter = partial(_in_arrays, partial(_written_out, short, length, None))
    return with_shortcut(steps, partial(_tested, shorter))


def scan_blocks(
    plan: Plan, block: Program, state: Any, inputs: Any, length: int, n_steps: int, checkpoint: bool
) -> tuple[Any, Any]:
    """``lax.scan`` of blocks: (number, *state) at the end, and the series of steps' results.

    ``inputs`` are arrays with a leading axis of steps. Idle steps fill up the blocks before them,
    with negative numbers. With ``checkpoint`` reverse mode keeps the state of each segment only.
    """
    segment = blocks = -(-n_steps // length)
    if plan.segments or checkpoint:
        root = math.isqrt(blocks - 1) + 1
        segment = min(range(root - root // 4, root + 1), key=lambda size: -blocks % size)
    segments = -(-blocks // segment)
    idle = segments * segment * length - n_steps

    def in_blocks(x: jax.Array) -> jax.Array:
        padded = jnp.pad(x, [(idle, 0), *[(0, 0)] * (x.ndim - 1)])
        return padded.reshape(segments, segment, length, *x.shape[1:])

    run: Program = partial(lax.scan, block, length=segment)
    run = recomputed(run) if checkpoint else run
    state, inputs = (jnp.asarray(-idle), *state), jax.tree.map(in_blocks, inputs)
    if segments > 1:
        state, out = lax.scan(run, state, inputs, length=segments)
    else:
        state, out = run(state, jax.tree.map(lambda x: x[0], inputs))
    if plan.block != "loop":
        out = jax.tree.map(lambda *x: jnp.stack(x, -1), *out)
    return state, jax.tree.map(lambda x: x.reshape(-1)[idle:], out)


def _written_out(
    step: Program, length: int, unit: jax.Array | None, state: Any, ahead: Any, entries: Any
) -> Any:
    """The steps of a block one after the other, with their results in a list."""
    split, out = [lax.split(x, (1,) * length) for x in ahead], []
    for i in range(length):
        if unit is not None:
            state = state[0], differentiated_once(state[1], unit), state[2]
        entry = jax.tree.map(lambda x, i=i: x[i], entries)
        state, results = step(state, ([x[i] for x in split], entry))
        out.append(results)
    _, carry, windows = state
    return carry, [c[-length:] for c in windows], out


def _in_arrays(steps: Program, *args: Any) -> Any:
    """Steps that are written out, with their results in arrays."""
    carry, windows, out = steps(*args)
    return carry, windows, jax.tree.map(lambda *x: jnp.stack(x), *out)


def _tested(shorter: Program, *args: Any) -> Any:
    """What shorter steps return, and whether any of them needs more."""
    carry, windows, (results, needs_more) = shorter(*args)
    return (carry, windows, results), needs_more.any()


def _in_loop(
    step: Program, length: int, window: int, zero: jax.Array, state: Any, ahead: Any, entries: Any
) -> Any:
    """The steps of a block as a loop, with windows of constant length, and results in arrays."""

    def slid(state: Any, item: Any) -> tuple[Any, Any]:
        (m, carry, windows), results = step(state, item)
        return (m, carry, [c[1:] for c in windows]), results

    start, carry, recent = state
    windows = [[zero] * (window - length) + c for c in recent]
    state, out = lax.scan(slid, (start, carry, windows), (ahead, entries), length=length)
    _, carry, windows = state
    return carry, [c[-length:] for c in windows], out
