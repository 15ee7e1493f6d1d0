"""Stepping: one pure ``step``, one scan; ``simulate`` keeps every instant, ``demand`` only scalars.

Kick and drift: velocities live half a step before the positions, v_{m+1/2} = v_{m−1/2} + h a_m and
x_{m+1} = x_m + h v_{m+1/2}. This is the central difference of eqs. (10) and (12) without its
cancellation. Block 1 and the relative motion x1 − x2 are the unknowns, so that stick is exact.
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxpound._checks import all_hold, enforce, instance, is_traced
from jaxpound.friction import Link
from jaxpound.ground import (
    Ground,
    GroundLike,
    ground_rules,
    mean_acceleration,
    require_ground,
    sampled,
)
from jaxpound.response import Demand, Instant, Response, Tally
from jaxpound.rods import RodLaw, RodState, rod_at_rest, rod_law, rod_step
from jaxpound.scheme import Scheme, TimeGrid, courant, stability_limit
from jaxpound.structures import AdjacentStructures

# Two steps a turn of the loop halve what the loop itself costs a single run on a CPU.
_UNROLL = 2


class _Laws(NamedTuple):
    """Constants of a run."""

    rods: RodLaw
    mass_ratio: jax.Array
    friction: jax.Array
    initial_gap: jax.Array


class State(NamedTuple):
    """Positions at t_m, velocities at t_m − h/2, and what rods and damper remember."""

    x1: jax.Array
    v1: jax.Array
    slip: jax.Array  # x1 − x2
    slip_velocity: jax.Array
    rods: RodState
    phase: jax.Array
    pull: jax.Array  # A_{m−1} = −f1 + ρ f2


def step(
    laws: _Laws,
    state: State,
    time: jax.Array,
    shaking: tuple[jax.Array, jax.Array],
    dt: float,
    scheme: Scheme,
) -> tuple[State, Instant]:
    """One step of eq. (9): from t_m to t_{m+1}, and what is seen at t_m.

    ``shaking`` is u'' at t_m, and its mean over the step from t_m − h/2 to t_m + h/2.
    """
    x1, x2 = state.x1, state.x1 - state.slip
    rho = laws.mass_ratio

    # Rod forces at t_m.
    rods, (f1, f2) = rod_step(laws.rods, state.rods, jnp.stack([x1, x2]), scheme.history)

    # Friction over the step from t_m − h/2 to t_m + h/2.
    pull = rho * f2 - f1
    w = state.slip_velocity
    link = Link(w, state.phase, pull, state.pull, 1 + rho, laws.friction, dt)
    slip = scheme.friction.slide(link)

    # Kick.
    shaking_now, shaking_mean = (x.astype(x1.dtype) for x in shaking)
    v1 = state.v1 - dt * (f1 + slip.mean_force + shaking_mean)

    # Drift. What friction's change within the step displaces is shared as the masses have it.
    after = State(
        x1=x1 + dt * v1 + slip.jump / (1 + rho),
        v1=v1,
        slip=state.slip + dt * slip.velocity + slip.jump,
        slip_velocity=slip.velocity,
        rods=rods,
        phase=slip.phase,
        pull=pull,
    )

    # At t_m the centre of mass moves with its mean velocity; the slip velocity has a kink.
    kink = slip.velocity_now - (w + slip.velocity) / 2
    v1_now = (state.v1 + v1) / 2 + kink / (1 + rho)
    gap = laws.initial_gap - state.slip
    now = Instant(
        time=time,
        x1=x1,
        x2=x2,
        v1=v1_now,
        v2=v1_now - slip.velocity_now,
        f1=f1,
        f2=f2,
        friction=slip.force,
        ground_acceleration=shaking_now,
        gap=gap,
        slip_velocity=slip.velocity_now,
        turn_gap=jnp.where(slip.turns, gap - slip.turn, jnp.inf),
        turn_time=time + slip.turn_time,
        phase=slip.phase,
        change_time=time + slip.change_time,
    )
    return after, now


def simulate(
    structures: AdjacentStructures,
    ground: GroundLike,
    grid: TimeGrid,
    scheme: Scheme = Scheme(),
) -> Response:
    """Response of two adjacent structures to a ground motion, at every instant of the grid.

    Parameters
    ----------
    structures
        The dimensionless system of eq. (9), at rest at t = 0.
    ground
        A ground motion in units of g over time in units of 1/ω1: ``Ricker``, ``Record``, sums and
        scalings of them, any object with ``acceleration(t)`` or any function of t. One that is not
        a pytree of arrays is evaluated on the grid before the run.
    grid
        The instants.
    scheme
        The discretisation; the default is second-order accurate through stick and slip.

    Returns
    -------
    Response
        Time series of shape (n_steps+1,) and the run's ``Demand``.

    Raises
    ------
    ValueError
        If dt is above the stability limit, or a known value is invalid.
    FloatingPointError
        If the run ends in non-finite numbers although its input was valid.

    Notes
    -----
    Works under ``jit``, ``vmap``, ``grad`` and ``jacfwd`` over every leaf of structures and ground.
    There values are traced and cannot raise: an invalid run gives NaN in every result.
    """
    ground = _prepare(structures, ground, grid, scheme)
    return _finished(_simulate(structures, ground, grid, scheme))


def demand(
    structures: AdjacentStructures,
    ground: GroundLike,
    grid: TimeGrid,
    scheme: Scheme = Scheme(),
) -> Demand:
    """Scalars of a run, streamed: as ``simulate(...).demand``, in O(modes) memory.

    Parameters, errors and transformations are those of ``simulate``; a batch is
    ``jax.vmap`` of this function.
    """
    ground = _prepare(structures, ground, grid, scheme)
    return _finished(_demand(structures, ground, grid, scheme))


def _prepare(
    structures: AdjacentStructures, ground: GroundLike, grid: TimeGrid, scheme: Scheme
) -> Ground:
    """Refuse what is known to be wrong; put the ground motion in a form that can be traced."""
    instance("run", "structures", structures, AdjacentStructures)
    instance("run", "grid", grid, TimeGrid)
    instance("run", "scheme", scheme, Scheme)
    require_ground("ground", ground)
    for rule in structures.rules():
        if jnp.ndim(rule.value):
            raise ValueError(
                f"structures: {rule.name} of shape {jnp.shape(rule.value)} must be one number; "
                "a batch of structures goes through jax.vmap"
            )
    enforce("structures", structures.rules())
    if not is_traced(structures):
        known = jax.tree.map(np.asarray, structures)
        if not courant(known, grid.dt, scheme, np) < 1:
            limit = stability_limit(structures, scheme)
            raise ValueError(
                f"grid: dt = {grid.dt:.8g} must be below the stability limit {limit:.8g} "
                "of these structures"
            )
    leaves = jax.tree.leaves(ground)
    if isinstance(ground, Ground) and all(hasattr(x, "dtype") or np.isscalar(x) for x in leaves):
        return ground
    return sampled(ground, grid)


def _run(
    structures: AdjacentStructures, ground: Ground, grid: TimeGrid, scheme: Scheme, keep: bool
) -> tuple[Demand, Any]:
    """The scalars of a run, and its instants if they are to be kept."""
    dtype = jnp.result_type(float, *jax.tree.leaves((structures, ground)))
    structures, ground = jax.tree.map(lambda x: jnp.asarray(x, dtype), (structures, ground))
    dt, n = grid.dt, grid.n_steps
    rho, history = structures.mass_ratio, scheme.history
    both = jax.tree.map(lambda *rods: jnp.stack(rods), structures.rod_1, structures.rod_2)
    modulus = jnp.stack([jnp.ones((), dtype), structures.stiffness_ratio])
    laws = _Laws(
        rods=rod_law(both, modulus, dt, n, scheme.order, history),
        mass_ratio=rho,
        friction=structures.friction,
        initial_gap=structures.initial_gap,
    )

    # A run that breaks a rule starts from NaN, and so is NaN throughout.
    valid = all_hold(structures.rules()) & (courant(structures, dt, scheme) < 1)
    valid &= all_hold(ground_rules(ground))
    zero = jnp.where(valid, jnp.zeros((), dtype), jnp.nan)
    # Velocity at −h/2, such that the first kick leaves (h/2) × acceleration, or nothing.
    mean = mean_acceleration(ground)
    before = dt * mean(jnp.zeros((), dtype), dt) * (0.5 if scheme.start == "rest" else 1.0)
    before = before.astype(dtype)
    state = State(
        x1=zero,
        v1=before,
        slip=zero,
        slip_velocity=zero,
        rods=rod_at_rest(laws.rods, history),
        phase=zero,
        pull=zero,
    )

    def advance(carry: tuple[State, Tally], m: jax.Array) -> tuple[tuple[State, Tally], Any]:
        state, tally = carry
        time = m.astype(dtype) * dt
        shaking = (ground.acceleration(time), mean(time, dt))
        state, now = step(laws, state, time, shaking, dt, scheme)
        tally = tally.observe(now, rho, dt, m == n)
        return (state, tally), (now if keep else None)

    carry = (state, Tally.start(laws.initial_gap + zero))
    (state, tally), series = lax.scan(advance, carry, jnp.arange(n + 1), unroll=_UNROLL)
    result = tally.demand(laws.initial_gap), series
    # One that fails on its way is NaN throughout as well.
    finite = jnp.isfinite(state.x1) & jnp.isfinite(state.slip)
    # A factor, not a choice, so that its derivatives are NaN as well.
    return jax.tree.map(lambda x: x * jnp.where(finite, 1.0, jnp.nan).astype(dtype), result)


@partial(jax.jit, static_argnames=("grid", "scheme"))
def _demand(
    structures: AdjacentStructures, ground: Ground, grid: TimeGrid, scheme: Scheme
) -> Demand:
    return _run(structures, ground, grid, scheme, keep=False)[0]


@partial(jax.jit, static_argnames=("grid", "scheme"))
def _simulate(
    structures: AdjacentStructures, ground: Ground, grid: TimeGrid, scheme: Scheme
) -> Response:
    scalars, series = _run(structures, ground, grid, scheme, keep=True)
    seen = series._asdict()
    for name in ("slip_velocity", "turn_gap", "turn_time"):
        del seen[name]
    one = jnp.ones_like(scalars.min_gap)
    return Response(
        **seen,
        mass_1=one,
        mass_2=one / structures.mass_ratio,
        demand=scalars,
        method=f"{scheme.friction}, order {scheme.order}, {scheme.history}",
    )


def _finished(result: Any) -> Any:
    """The result of a run; a run that is known to have failed raises."""
    scalars = result.demand if isinstance(result, Response) else result
    if not is_traced(scalars) and not all(np.isfinite(x).all() for x in jax.tree.leaves(scalars)):
        raise FloatingPointError(
            "the run ended in non-finite numbers: the ground motion returns some, or overflows"
        )
    return result
