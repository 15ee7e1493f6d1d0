"""The local flow as a function that runs can differentiate and batch."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jax.flatten_util import ravel_pytree

from jaxpound.simulation.events import MOST, Problem
from jaxpound.simulation.lanes import where_needed
from jaxpound.simulation.passage import Given, Modes, Passed

_STORED = 12  # moves whose states reverse mode stores at a time


def flow(h: float, slots: int, needed: jax.Array, given: Given, modes: Modes) -> Passed:
    """The links at the end of a step of length h; NaN if there are too many events in it.

    Up to ``slots`` impacts that end in the step are recorded for each link. The result is zero
    where the flow is not ``needed``.
    """
    return _differentiable(h, slots)(needed, given, modes)


@cache
def _differentiable(h: float, slots: int) -> Any:
    """``flow`` with derivatives of both modes, though a loop can be differentiated forwards only.

    Reverse mode stores what is given and no more.
    """

    @jax.jit
    def follow(given: Given, modes: Modes) -> Passed:
        problem = Problem(h, slots, given)
        end = lax.while_loop(problem.unfinished, problem.advance, problem.start(modes))
        return problem.passed(end)

    @jax.jit
    def push(given: Given, modes: Modes, change: Given) -> Passed:
        return jax.jvp(lambda x: follow(x, modes), (given,), (change,))[1]

    @jax.jit
    def pull(given: Given, modes: Modes, weights: Passed) -> Given:
        return _pulled(h, slots, given, modes, weights)

    follow_lanes, push_lanes, pull_lanes = (where_needed(work) for work in (follow, push, pull))

    @jax.custom_jvp
    def differentiable(needed: jax.Array, given: Given, modes: Modes) -> Passed:
        return follow_lanes(needed, given, modes)

    @differentiable.defjvp
    def linear(primals: Any, tangents: Any) -> Any:
        needed, given, modes = primals
        out = differentiable(needed, given, modes)

        # The linear map t → J t as the solution (t, J t) of [[1, 0], [−J, 1]] z = (t, 0), whose
        # transpose has the solution (a + Jᵀ b, b): so each direction has the program that suits it.
        # The system itself would only be asked for by second derivatives.
        given = jax.tree.map(_differentiated_once, given)
        change, as_given = ravel_pytree(tangents[1])
        flat, as_out = ravel_pytree(out)
        n = change.size

        def forwards(_: Any, right: jax.Array) -> jax.Array:
            pushed = push_lanes(needed, given, modes, as_given(right[:n]))
            return right.at[n:].add(ravel_pytree(pushed)[0])

        def backwards(_: Any, right: jax.Array) -> jax.Array:
            pulled = pull_lanes(needed, given, modes, as_out(right[n:]))
            return right.at[:n].add(ravel_pytree(pulled)[0])

        right = jnp.pad(change, (0, flat.size))
        solution = lax.custom_linear_solve(lambda z: z, right, forwards, backwards)
        return out, as_out(solution[n:])

    return differentiable


class _Cotangents(NamedTuple):
    """Derivatives of the weighted result by what went into a move, and by what is given."""

    limit: jax.Array  # number of moves that are still to be undone
    state: jax.Array  # of the state before them
    given: Given


def _pulled(h: float, slots: int, given: Given, modes: Modes, weights: Passed) -> Given:
    """Jᵀ weights: back through the iterations that moved, from stored states."""
    first, rebuild = ravel_pytree(Problem(h, slots, given).start(modes))
    zero = 0 * given.closing[0]  # which may differ from device to device, as what begins with it

    def started(given: Given) -> jax.Array:
        return ravel_pytree(Problem(h, slots, given).start(modes))[0]

    def advanced(given: Given, state: jax.Array) -> jax.Array:
        return ravel_pytree(Problem(h, slots, given).advance(rebuild(state)))[0]

    def ended(given: Given, state: jax.Array) -> Passed:
        return Problem(h, slots, given).passed(rebuild(state))

    def followed(limit: jax.Array) -> tuple[jax.Array, jax.Array]:
        """The state after a number of moves or at the end, and the last states before it."""

        def unfinished(carry: Any) -> jax.Array:
            state = rebuild(carry[0])
            return Problem(h, slots, given).unfinished(state) & (state.moves < limit)

        def store(carry: Any) -> Any:
            state, states = carry
            return advanced(given, state), states.at[rebuild(state).moves % _STORED].set(state)

        states = jnp.zeros((_STORED, first.size), first.dtype) + zero
        return lax.while_loop(unfinished, store, (first, states))

    def undone(by: _Cotangents) -> _Cotangents:
        """Back through the moves whose states can be stored."""
        last, states = followed(by.limit)
        moves = rebuild(last).moves
        until = jnp.maximum(moves - 1, 0) // _STORED * _STORED
        of_end = jax.vjp(ended, given, last)[1](weights)
        of_given, of_state = jax.tree.map(
            lambda a, b: jnp.where(by.limit > MOST, a, b), of_end, (by.given, by.state)
        )

        def undo(by: _Cotangents) -> _Cotangents:
            move = by.limit - 1
            more, of_state = jax.vjp(advanced, given, states[move % _STORED])[1](by.state)
            return _Cotangents(move, of_state, jax.tree.map(jnp.add, by.given, more))

        by = _Cotangents(moves, of_state, of_given)
        return lax.while_loop(lambda by: by.limit > until, undo, by)

    nothing = _Cotangents(
        limit=MOST + 1 + zero.astype(int),
        state=jnp.zeros_like(first) + zero,
        given=jax.tree.map(lambda x: jnp.zeros_like(x) + zero, given),
    )
    by = lax.while_loop(lambda by: by.limit > 0, undone, nothing)
    (more,) = jax.vjp(started, given)[1](by.state)
    return jax.tree.map(jnp.add, by.given, more)


@jax.custom_jvp
def _differentiated_once(x: jax.Array) -> jax.Array:
    return x


@_differentiated_once.defjvp
def _not_twice(primals: Any, tangents: Any) -> Any:
    raise NotImplementedError("second derivatives of a run with contact are not available")
