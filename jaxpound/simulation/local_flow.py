"""The local flow of ``events`` as a function that runs can differentiate and batch.

Under vmap a loop goes on until all lanes of the batch have finished, and every lane pays for every
iteration. So ``_where_needed`` gathers the lanes that need the flow into small groups, and runs the
loop for one group after the other.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_batching import custom_vmap
from jax.flatten_util import ravel_pytree

from jaxpound.simulation.batches import on_each_device
from jaxpound.simulation.events import MOST, LocalFlow
from jaxpound.simulation.forces import ContactStart, FlowInput, FlowResult

_WIDTH = 32  # lanes in a group: enough to fill vector registers, few enough to finish together
_STORED = 12  # accepted substeps whose states reverse mode stores at a time


def flow(
    h: float, slots: int, needed: jax.Array, inputs: FlowInput, contact_start: ContactStart
) -> FlowResult:
    """The links at the end of a step of length h; NaN if there are too many events in it.

    Up to ``slots`` impacts that end in the step are recorded for each link. The result is zero
    where the flow is not ``needed``.
    """
    return _differentiable(h, slots)(needed, inputs, contact_start)


@cache
def _differentiable(h: float, slots: int) -> Any:
    """``flow`` with derivatives of both modes, though a loop can be differentiated forwards only.

    Reverse mode stores the inputs only.
    """

    @jax.jit
    def run(inputs: FlowInput, contact_start: ContactStart) -> FlowResult:
        local = LocalFlow(h, slots, inputs)
        end = lax.while_loop(local.unfinished, local.advance, local.start(contact_start))
        return local.result(end)

    @jax.jit
    def push(inputs: FlowInput, contact_start: ContactStart, change: FlowInput) -> FlowResult:
        return jax.jvp(lambda x: run(x, contact_start), (inputs,), (change,))[1]

    @jax.jit
    def pull(inputs: FlowInput, contact_start: ContactStart, weights: FlowResult) -> FlowInput:
        return _pulled(h, slots, inputs, contact_start, weights)

    run_lanes, push_lanes, pull_lanes = (_where_needed(work) for work in (run, push, pull))

    @jax.custom_jvp
    def differentiable(
        needed: jax.Array, inputs: FlowInput, contact_start: ContactStart
    ) -> FlowResult:
        return run_lanes(needed, inputs, contact_start)

    @differentiable.defjvp
    def linear(primals: Any, tangents: Any) -> Any:
        needed, inputs, contact_start = primals
        out = differentiable(needed, inputs, contact_start)

        # The linear map t → J t as the solution (t, J t) of [[1, 0], [−J, 1]] z = (t, 0), whose
        # transpose has the solution (a + Jᵀ b, b): so each direction has the program that suits it.
        # Only second derivatives would evaluate the system itself.
        inputs = jax.tree.map(_differentiated_once, inputs)
        change, as_inputs = ravel_pytree(tangents[1])
        flat, as_out = ravel_pytree(out)
        n = change.size

        def forwards(_: Any, right: jax.Array) -> jax.Array:
            pushed = push_lanes(needed, inputs, contact_start, as_inputs(right[:n]))
            return right.at[n:].add(ravel_pytree(pushed)[0])

        def backwards(_: Any, right: jax.Array) -> jax.Array:
            pulled = pull_lanes(needed, inputs, contact_start, as_out(right[n:]))
            return right.at[:n].add(ravel_pytree(pulled)[0])

        right = jnp.pad(change, (0, flat.size))
        solution = lax.custom_linear_solve(lambda z: z, right, forwards, backwards)
        return out, as_out(solution[n:])

    return differentiable


class _Cotangents(NamedTuple):
    """Derivatives of the weighted result by the state before a substep, and by the inputs."""

    limit: jax.Array  # number of substeps still to be undone
    state: jax.Array  # of the state after them
    inputs: FlowInput


def _pulled(
    h: float, slots: int, inputs: FlowInput, contact_start: ContactStart, weights: FlowResult
) -> FlowInput:
    """Jᵀ weights: back through the accepted substeps, from stored states."""
    local = partial(LocalFlow, h, slots)
    first, rebuild = ravel_pytree(local(inputs).start(contact_start))
    zero = 0 * inputs.closing[0]  # derived from the inputs, as it may differ between devices

    def started(inputs: FlowInput) -> jax.Array:
        return ravel_pytree(local(inputs).start(contact_start))[0]

    def advanced(inputs: FlowInput, state: jax.Array) -> jax.Array:
        return ravel_pytree(local(inputs).advance(rebuild(state)))[0]

    def state_after(limit: jax.Array) -> tuple[jax.Array, jax.Array]:
        """The state after ``limit`` accepted substeps or at the end, and the last states before."""

        def unfinished(carry: Any) -> jax.Array:
            state = rebuild(carry[0])
            return local(inputs).unfinished(state) & (state.accepted < limit)

        def store(carry: Any) -> Any:
            state, states = carry
            return advanced(inputs, state), states.at[rebuild(state).accepted % _STORED].set(state)

        states = jnp.zeros((_STORED, first.size), first.dtype) + zero
        return lax.while_loop(unfinished, store, (first, states))

    def undone(by: _Cotangents) -> _Cotangents:
        """Back through the accepted substeps whose states can be stored."""
        last, states = state_after(by.limit)
        accepted = rebuild(last).accepted
        until = jnp.maximum(accepted - 1, 0) // _STORED * _STORED
        _, pulled = jax.vjp(lambda x, end: local(x).result(rebuild(end)), inputs, last)
        of_inputs, of_state = jax.tree.map(
            lambda a, b: jnp.where(by.limit > MOST, a, b), pulled(weights), (by.inputs, by.state)
        )

        def undo(by: _Cotangents) -> _Cotangents:
            number = by.limit - 1
            more, of_state = jax.vjp(advanced, inputs, states[number % _STORED])[1](by.state)
            return _Cotangents(number, of_state, jax.tree.map(jnp.add, by.inputs, more))

        by = _Cotangents(accepted, of_state, of_inputs)
        return lax.while_loop(lambda by: by.limit > until, undo, by)

    start = _Cotangents(
        limit=MOST + 1 + zero.astype(int),
        state=jnp.zeros_like(first) + zero,
        inputs=jax.tree.map(lambda x: jnp.zeros_like(x) + zero, inputs),
    )
    by = lax.while_loop(lambda by: by.limit > 0, undone, start)
    (more,) = jax.vjp(started, inputs)[1](by.state)
    return jax.tree.map(jnp.add, by.inputs, more)


@jax.custom_jvp
def _differentiated_once(x: jax.Array) -> jax.Array:
    return x


@_differentiated_once.defjvp
def _not_twice(primals: Any, tangents: Any) -> Any:
    raise NotImplementedError("second derivatives of a run with contact are not available")


def _where_needed(work: Callable[..., Any]) -> Callable[..., Any]:
    """A function of ``(needed, *args)``: ``work(*args)`` if needed, else zeros.

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
        return _in_groups(work, needed, args)

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


def _in_groups(work: Callable[..., Any], needed: jax.Array, args: Any) -> Any:
    size, count = needed.shape[0], needed.sum()
    width = min(_WIDTH, size)
    numbers = jnp.arange(size)
    places = jnp.where(needed, jnp.cumsum(needed) - 1, size + width)
    lanes = jnp.full(size + width, size + 0 * count).at[places].set(numbers, mode="drop")

    def taken(numbers: jax.Array) -> Any:
        # A group is filled up with copies of a lane that needs the work.
        numbers = jnp.where(numbers < size, numbers, lanes[0])
        return jax.tree.map(lambda x: jnp.take(x, numbers, axis=0, mode="clip"), args)

    leaves, rebuild = jax.tree.flatten(jax.eval_shape(work, *jax.tree.map(lambda x: x[0], args)))
    rows = [leaf.size for leaf in leaves]
    kind = jnp.result_type(*[leaf.dtype for leaf in leaves])

    def group(carry: Any) -> Any:
        done, results = carry
        numbers = lax.dynamic_slice(lanes, (done,), (width,))
        leaves_of_group = jax.tree.leaves(jax.vmap(work)(*taken(numbers)))
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
