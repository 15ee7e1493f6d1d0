"""The course of a run: what moves the masses from one instant to the next, and nothing else.

``simulate`` and ``demand`` observe it at every instant, ``positions_at`` at one of them.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import ArrayLike

from jaxpound._checks import Rule, all_hold
from jaxpound._fields import rules
from jaxpound.grid import TimeGrid
from jaxpound.ground.motion import Ground, GroundLike, as_pytree, excitation
from jaxpound.model.initial import InitialState, initial_rules
from jaxpound.model.system import Structures, System
from jaxpound.simulation.batches import spread
from jaxpound.simulation.extrapolation import extrapolated
from jaxpound.simulation.scan import scan_with_history
from jaxpound.simulation.scheme import Scheme, is_stable
from jaxpound.simulation.stepping import (
    Elements,
    State,
    at_rest,
    elements,
    moved,
    of_all_masses,
    step,
)


class Course(NamedTuple):
    """All that a scan over the instants of a run needs."""

    system: System
    """The structures in the run's dtype."""
    constants: Elements
    zero: jax.Array
    """0; NaN in a run whose input breaks a rule, which makes all of it NaN."""
    start: State
    given: Any
    """The caller's own numbers, cast and spread with all others."""
    advance: Callable[[State, list[jax.Array], jax.Array, Any], Any]
    """From the state, the history sums, the step m and its input to the next state, each rod's c_m
    and the instant t_m."""
    scan: Callable[..., tuple[Any, Any]]
    """``scan_with_history`` of these steps."""

    @staticmethod
    def of(
        structures: Structures,
        ground: Ground,
        grid: TimeGrid,
        scheme: Scheme,
        given: Any = None,
        more_rules: Callable[[Any], list[Rule]] = lambda given: [],
        slots: int = 0,
        initial: InitialState | None = None,
    ) -> Course:
        """The course of structures in a ground motion.

        Parameters
        ----------
        structures, ground, grid, scheme
            See ``simulate``; the ground motion is a pytree.
        given
            A pytree of further numbers that the run uses, or None.
        more_rules
            Rules of ``given``.
        slots
            Impacts of a link in a step that are recorded.
        initial
            The state at t = 0; None at rest.
        """
        dtype = jnp.result_type(float, *jax.tree.leaves((structures, ground)))
        structures, ground, given, initial = jax.tree.map(
            lambda x: jnp.asarray(x, dtype), (structures, ground, given, initial)
        )
        # Where structures are constants of the program, XLA would fold all that follows from them.
        structures = jax.tree.map(lax.optimization_barrier, structures)
        # Before the batch is spread: orders and samples that all runs share are not copied.
        orders = [jnp.asarray(rod.material.order, dtype) for rod in structures.system().rods]
        series = excitation(ground, grid, scheme.order).series
        structures, ground, given, initial, series = spread(
            (structures, ground, given, initial, series)
        )
        system = jax.tree.map(lambda x: jnp.asarray(x, dtype), structures.system())
        dt = grid.dt

        # A run that breaks a rule starts from NaN, and so is NaN throughout.
        valid = all_hold([*rules(structures), *rules(system), *rules(ground)])
        valid &= all_hold(more_rules(given)) & is_stable(system, dt, scheme)
        valid &= all_hold([] if initial is None else initial_rules(initial, system, dt))
        zero = jnp.where(valid, jnp.zeros((), dtype), jnp.nan)
        begin, displaced = at_rest(system, zero), None
        if initial is not None:
            displaced, velocities = ([zero + y for y in ys] for ys in initial.of(system))
            begin = moved(system, begin, displaced, velocities)
        constants = elements(system, dt, scheme.order, slots, displaced)
        shaking = excitation(ground, grid, scheme.order)._replace(series=series)
        # Velocity at −h/2, such that the first kick leaves (h/2) × acceleration, or nothing.
        first = jax.tree.map(lambda x: x[0], shaking.series)
        start = shaking.at(jnp.zeros((), dtype), first)[1]
        before = (dt * start * (0.5 if scheme.start == "rest" else 1.0)).astype(dtype)

        def advance(state: State, sums: list[jax.Array], m: jax.Array, entry: Any) -> Any:
            time = m.astype(dtype) * dt
            now_and_mean = shaking.at(jnp.maximum(time, 0), entry)
            a, mean = (jnp.where(m < 0, zero, x.astype(dtype)) for x in now_and_mean)
            starts = m == 0
            if initial is None:
                v = jax.tree.map(lambda v: jnp.where(starts, before, v), state.v)
                state = state._replace(v=v)
            after = step(constants, state, sums, time, (a, mean), dt, scheme, starts)
            if initial is None:
                return after
            # Idle steps before the first leave all as it is.
            idle = state, [zero] * len(sums)
            kept = jax.tree.map(lambda old, new: jnp.where(m < 0, old, new), idle, after[:2])
            return *kept, after[2]

        def scan(advance: Any, carry: Any, *, segmented: bool = False) -> tuple[Any, Any]:
            return scan_with_history(
                advance,
                carry,
                grid.n_steps,
                orders,
                scheme.history,
                shaking.series,
                segmented=segmented,
                checkpoint=scheme.checkpoint,
                looped=constants.is_long,
            )

        return Course(system, constants, zero, begin, given, advance, scan)


class Positions(NamedTuple):
    """Where structures are at one instant."""

    x: tuple[Any, ...]
    """Displacement of each mass."""
    closings: tuple[Any, ...]
    """x_i − x_j of each link's ends: its gap at rest less its gap now."""


def positions_at(
    structures: Structures, ground: GroundLike, grid: TimeGrid, scheme: Scheme, instant: ArrayLike
) -> Positions:
    """Positions at the instant with a number, from 0 to n_steps, which may be traced.

    For many derivatives: no series are kept and nothing else is observed. The input is not checked
    (``demand`` does it); an invalid run gives NaN.
    """
    ground = as_pytree(ground, scheme.finest(grid))
    return _positions_at(structures, ground, grid, scheme, jnp.asarray(instant))


@partial(jax.jit, static_argnames=("grid", "scheme"))
def _positions_at(
    structures: Structures, ground: Ground, grid: TimeGrid, scheme: Scheme, instant: jax.Array
) -> Positions:
    found = _positions(structures, ground, grid, scheme, instant)
    if not scheme.extrapolated:
        return found
    finer = _positions(structures, ground, grid.halved, scheme, 2 * instant)
    return extrapolated(found, finer)


def _positions(
    structures: Structures, ground: Ground, grid: TimeGrid, scheme: Scheme, instant: jax.Array
) -> Positions:
    run = Course.of(structures, ground, grid, scheme)

    def advance(carry: Any, sums: list[jax.Array], m: jax.Array, entry: Any) -> Any:
        state, kept = carry
        state, c, now = run.advance(state, sums, m, entry)
        here = now.x, tuple(link.closing for link in now.links)
        kept = jax.tree.map(lambda old, new: jnp.where(m == instant, new, old), kept, here)
        return (state, kept), c, None

    rest = run.start.x, tuple(link.closing for link in run.start.links)
    (_, (x, closings)), _ = run.scan(advance, (run.start, rest))
    return Positions(of_all_masses(run.system.topology, x, closings), closings)
