"""Stepping: one pure ``step``, one scan; ``simulate`` keeps every instant, ``demand`` only scalars.

Kick and drift: velocities live half a step before the positions, v_{m+1/2} = v_{m−1/2} + h a_m and
x_{m+1} = x_m + h v_{m+1/2}. This is the central difference of eqs. (10) and (12) without its
cancellation. Block 1 and the relative motion x1 − x2 are the unknowns, so that stick is exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from jaxpound._checks import Rule, all_hold, enforce, finite, instance, is_traced, number
from jaxpound._fields import rules
from jaxpound.grid import TimeGrid
from jaxpound.ground.motion import (
    Ground,
    GroundLike,
    acceleration_and_mean,
    as_pytree,
    ground_rules,
    require_ground,
    unresolved,
    velocity_and_bulge,
)
from jaxpound.ground.plausibility import excessive, far_apart, tell
from jaxpound.model.structures import AdjacentStructures
from jaxpound.results.response import Demand, Response
from jaxpound.simulation.batches import spread
from jaxpound.simulation.friction import Link
from jaxpound.simulation.history import scan_with_history
from jaxpound.simulation.rod import RodLaw, rod_law, rod_step
from jaxpound.simulation.scheme import Scheme, courant, stability_limit
from jaxpound.simulation.tally import Instant, Tally


class _Laws(NamedTuple):
    """Constants of a run."""

    rod_1: RodLaw
    rod_2: RodLaw
    mass_ratio: jax.Array
    friction: jax.Array


class State(NamedTuple):
    """Positions at t_m, velocities at t_m − h/2, and what rods and damper remember of t_{m−1}."""

    x1: jax.Array
    v1: jax.Array
    slip: jax.Array  # x1 − x2
    slip_velocity: jax.Array
    excess_1: jax.Array  # K1 x1 − f1
    excess_2: jax.Array
    phase: jax.Array
    pull: jax.Array  # A_{m−1} = −f1 + ρ f2


def step(
    laws: _Laws,
    state: State,
    sums: list[jax.Array],
    time: jax.Array,
    ground: tuple[jax.Array, jax.Array],
    dt: float,
    scheme: Scheme,
) -> tuple[State, list[jax.Array], Instant]:
    """One step of eq. (9): the state at t_{m+1}, both rods' c_m, and what is seen at t_m.

    ``sums`` are both rods' history sums S_m; ``ground`` is u'' at t_m and its mean over the step
    from t_m − h/2 to t_m + h/2.
    """
    ground_acceleration, shaking = ground
    x1, x2 = state.x1, state.x1 - state.slip
    rho = laws.mass_ratio

    # Rod forces at t_m.
    f1, excess_1, c1 = rod_step(laws.rod_1, state.excess_1, sums[0], x1)
    f2, excess_2, c2 = rod_step(laws.rod_2, state.excess_2, sums[1], x2)

    # Friction over the step from t_m − h/2 to t_m + h/2.
    pull = rho * f2 - f1
    w = state.slip_velocity
    link = Link(w, state.phase, pull, state.pull, 1 + rho, laws.friction, dt)
    slip = scheme.friction.slide(link)

    # Kick.
    v1 = state.v1 - dt * (f1 + slip.mean_force + shaking)

    # Drift. What friction's change within the step displaces is shared as the masses have it.
    after = State(
        x1=x1 + dt * v1 + slip.jump / (1 + rho),
        v1=v1,
        slip=state.slip + dt * slip.velocity + slip.jump,
        slip_velocity=slip.velocity,
        excess_1=excess_1,
        excess_2=excess_2,
        phase=slip.phase,
        pull=pull,
    )

    # At t_m the centre of mass moves with its mean velocity; the slip velocity has a kink.
    kink = slip.velocity_now - (w + slip.velocity) / 2
    now = Instant(
        time=time,
        ground_acceleration=ground_acceleration,
        x1=x1,
        slip=state.slip,
        v1=(state.v1 + v1) / 2 + kink / (1 + rho),
        slip_velocity=slip.velocity_now,
        f1=f1,
        f2=f2,
        friction=slip.force,
        turns=slip.turns,
        turn_time=slip.turn_time,
        turn=slip.turn,
        turn_friction=slip.turn_forces,
        phase=slip.phase,
        change_time=time + slip.change_time,
    )
    return after, [c1, c2], now


def simulate(
    structures: AdjacentStructures,
    ground: GroundLike,
    grid: TimeGrid,
    scheme: Scheme = Scheme(),
    *,
    strict: bool = False,
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
    strict
        Whether what is only warned of is refused.

    Returns
    -------
    Response
        Time series of shape (n_steps+1,) and the run's ``Demand``.

    Raises
    ------
    ValueError
        If dt is above the stability limit, a known value is invalid, or the ground motion is made
        of a record in seconds; if ``strict``, also where there would be a warning.
    FloatingPointError
        If the run ends in non-finite numbers although its input was valid.

    Warns
    -----
    PlausibilityWarning
        If the grid has fewer than 8 steps a period of the shortest wavelet, or is coarser than a
        record and loses more than 1 % of its energy; if a record shakes with more than 5 g; if the
        gap is more than 100 times what the buildings move. A plain function of t, whose periods are
        not known, is not judged by steps.

    Notes
    -----
    Works under ``jit``, ``vmap``, ``grad`` and ``jacfwd`` over every leaf of structures and ground.
    There values are traced and can neither raise nor be warned of: an invalid run gives NaN in
    every result.

    Examples
    --------
    >>> grid = jp.TimeGrid.until(20.0, dt=0.05)
    >>> response = jp.simulate(jp.paper.structures(), jp.paper.ground(), grid)
    >>> round(float(response.min_gap), 3)
    0.304
    >>> [(phase.kind, round(phase.start, 2)) for phase in response.phases()[:3]]
    [('stick', 0.0), ('slip left', 0.64), ('slip right', 1.19)]
    """
    response = respond("simulate", structures, ground, grid, scheme, strict)
    _look("simulate", structures, ground, response.demand, strict)
    return response


def respond(
    owner: str,
    structures: AdjacentStructures,
    ground: GroundLike,
    grid: TimeGrid,
    scheme: Scheme,
    strict: bool,
) -> Response:
    """As ``simulate``, in the name of an owner, which is to look at what was found."""
    shaking = _prepare(owner, structures, ground, grid, scheme, strict)
    return _finished(_simulate(structures, shaking, grid, scheme))


def demand(
    structures: AdjacentStructures,
    ground: GroundLike,
    grid: TimeGrid,
    scheme: Scheme = Scheme(),
    *,
    temperature: ArrayLike | None = None,
    strict: bool = False,
) -> Demand:
    """Scalars of a run, streamed: as ``simulate(...).demand``, in O(modes) memory.

    A batch is ``jax.vmap`` of this function; where JAX has several devices of a kind (the cores of
    a CPU after ``use_cores``), a batch that they can share evenly, with at least 16 runs each, is
    spread over them. ``in_chunks`` spreads batches of any size, and keeps them in the caches.

    Parameters
    ----------
    structures, ground, grid, scheme
        As of ``simulate``.
    temperature
        T > 0, dimensionless as the gap ξ (in g/ω1²), asks for ``Demand.soft_min_gap``, −T log of
        the mean of e^(−ξ/T) over the run's instants: smooth in every parameter, and between the
        smallest ξ of them (T → 0) and their mean (T → ∞). Never below the smallest, and nearer to
        the mean the longer the quiet end of a run.
    strict
        As of ``simulate``.

    Returns
    -------
    Demand

    Raises
    ------
    ValueError
        As ``simulate``, and if temperature is not positive and finite.
    FloatingPointError
        As ``simulate``.

    Warns
    -----
    PlausibilityWarning
        As ``simulate``.

    Examples
    --------
    >>> grid = jp.TimeGrid.until(20.0, dt=0.05)
    >>> demand = jp.demand(jp.paper.structures(), jp.paper.ground(), grid)
    >>> round(float(demand.min_gap), 3), round(float(demand.min_gap_time), 2)
    (0.304, 7.48)
    >>> float(demand.pounds)
    0.0
    """
    shaking = _prepare("demand", structures, ground, grid, scheme, strict)
    if temperature is not None:
        temperature = number("demand", "temperature", temperature)
        enforce("demand", _temperature_rules(temperature))
    found = _finished(_demand(structures, shaking, grid, scheme, temperature))
    _look("demand", structures, ground, found, strict)
    return found


def _temperature_rules(temperature: Any) -> list[Rule]:
    if temperature is None:
        return []
    holds = (temperature > 0) & finite(temperature)
    return [Rule("temperature", temperature, holds, "positive and finite")]


def _prepare(
    owner: str,
    structures: AdjacentStructures,
    ground: GroundLike,
    grid: TimeGrid,
    scheme: Scheme,
    strict: bool,
) -> Ground:
    """Refuse what is known to be wrong; put the ground motion in a form that can be traced."""
    instance("run", "structures", structures, AdjacentStructures)
    instance("run", "grid", grid, TimeGrid)
    instance("run", "scheme", scheme, Scheme)
    require_ground("ground", ground)
    for rule in rules(structures):
        if jnp.ndim(rule.value):
            raise ValueError(
                f"structures: {rule.name} of shape {jnp.shape(rule.value)} must be one number; "
                "a batch of structures goes through jax.vmap"
            )
    enforce("structures", rules(structures))
    if not is_traced(structures):
        known = jax.tree.map(np.asarray, structures)
        if not courant(known, grid.dt, scheme, np) < 1:
            limit = stability_limit(structures, scheme)
            raise ValueError(
                f"grid: dt = {grid.dt:.8g} must be below the stability limit {limit:.8g} "
                "of these structures"
            )
    traceable = as_pytree(ground, grid)
    if not is_traced((structures, traceable)):
        tell(owner, unresolved(ground, grid.dt), strict)
    return traceable


def _look(
    owner: str, structures: AdjacentStructures, ground: GroundLike, found: Demand, strict: bool
) -> None:
    """Warn of what a run that is known shows to be implausible, or refuse it."""
    if is_traced((structures, found)):
        return
    moved = found.peak_x1 + found.peak_x2
    findings = far_apart("initial_gap", structures.initial_gap, moved, si=False)
    tell(owner, excessive(ground, found.pga) + findings, strict)


def _run(
    structures: AdjacentStructures,
    ground: Ground,
    grid: TimeGrid,
    scheme: Scheme,
    temperature: ArrayLike | None,
    keep: Sequence[str],
) -> tuple[Demand, list[jax.Array]]:
    """The scalars of a run, and the series of an instant's fields that are to be kept."""
    structures, ground, temperature = spread((structures, ground, temperature))
    dtype = jnp.result_type(float, *jax.tree.leaves((structures, ground)))
    structures, ground, temperature = jax.tree.map(
        lambda x: jnp.asarray(x, dtype), (structures, ground, temperature)
    )
    dt, n = grid.dt, grid.n_steps
    rho = structures.mass_ratio
    laws = _Laws(
        rod_1=rod_law(structures.rod_1, jnp.ones((), dtype), dt, scheme.order),
        rod_2=rod_law(structures.rod_2, structures.stiffness_ratio, dt, scheme.order),
        mass_ratio=rho,
        friction=structures.friction,
    )

    # A run that breaks a rule starts from NaN, and so is NaN throughout.
    valid = all_hold(rules(structures)) & (courant(structures, dt, scheme) < 1)
    valid &= all_hold([*ground_rules(ground), *_temperature_rules(temperature)])
    zero = jnp.where(valid, jnp.zeros((), dtype), jnp.nan)
    # Velocity at −h/2, such that the first kick leaves (h/2) × acceleration, or nothing.
    accelerations = acceleration_and_mean(ground, dt, scheme.order)
    start = accelerations(jnp.zeros((), dtype))[1]
    before = dt * start * (0.5 if scheme.start == "rest" else 1.0)
    before = before.astype(dtype)

    def advance(
        carry: tuple[State, Tally], sums: list[jax.Array], m: jax.Array
    ) -> tuple[tuple[State, Tally], list[jax.Array], list[jax.Array]]:
        state, tally = carry
        time = m.astype(dtype) * dt
        now_and_mean = accelerations(jnp.maximum(time, 0))
        a, mean = (jnp.where(m < 0, zero, x.astype(dtype)) for x in now_and_mean)
        state = state._replace(v1=jnp.where(m == 0, before, state.v1))
        state, c, now = step(laws, state, sums, time, (a, mean), dt, scheme)
        tally = tally.observe(now, rho, dt, m == n, temperature)
        return (state, tally), c, [getattr(now, name) for name in keep]

    rest = State(*[zero] * len(State._fields))
    (state, tally), series = scan_with_history(
        advance,
        (rest, Tally.start(zero, temperature is not None)),
        n,
        [structures.rod_1.order, structures.rod_2.order],
        scheme.history,
        segmented=bool(keep),
        checkpoint=scheme.checkpoint,
    )
    slip_force = structures.friction if scheme.friction.set_valued else None
    result = tally.demand(structures.initial_gap, slip_force, temperature), series
    # One that fails on its way is NaN throughout as well.
    finite = jnp.isfinite(state.x1) & jnp.isfinite(state.slip)
    # A factor, not a choice, so that its derivatives are NaN as well.
    return jax.tree.map(lambda x: x * jnp.where(finite, 1.0, jnp.nan).astype(dtype), result)


@partial(jax.jit, static_argnames=("grid", "scheme"))
def _demand(
    structures: AdjacentStructures,
    ground: Ground,
    grid: TimeGrid,
    scheme: Scheme,
    temperature: ArrayLike | None,
) -> Demand:
    return _run(structures, ground, grid, scheme, temperature, keep=())[0]


_KEPT = ("x1", "slip", "v1", "slip_velocity", "f1", "f2", "friction", "phase", "change_time")


@partial(jax.jit, static_argnames=("grid", "scheme"))
def _simulate(
    structures: AdjacentStructures, ground: Ground, grid: TimeGrid, scheme: Scheme
) -> Response:
    scalars, kept = _run(structures, ground, grid, scheme, None, _KEPT)
    x1, slip, v1, slip_velocity, f1, f2, friction, phase, change_time = kept
    # What follows from the rest is not carried out of the scan; an invalid run's is NaN too.
    time = jnp.asarray(grid.times(), x1.dtype)
    ground_velocity, bulge = (y.astype(x1.dtype) for y in velocity_and_bulge(ground, time, grid.dt))
    # v1 is the mean of the velocities half a step away, where the ground's is more than now by the
    # bulge; but the run starts at rest.
    v1 = v1 + bulge.at[0].set(0)
    return Response(
        time=time + 0 * x1,
        x1=x1,
        x2=x1 - slip,
        v1=v1,
        v2=v1 - slip_velocity,
        f1=f1,
        f2=f2,
        friction=friction,
        ground_acceleration=jax.vmap(ground.acceleration)(time).astype(x1.dtype) + 0 * x1,
        ground_velocity=ground_velocity + 0 * x1,
        gap=structures.initial_gap - slip,
        phase=phase,
        change_time=change_time,
        mass_1=jnp.ones_like(scalars.min_gap),
        mass_2=jnp.ones_like(scalars.min_gap) / structures.mass_ratio,
        demand=scalars,
        method=f"{scheme.friction}, order {scheme.order}, {scheme.history}",
    )


def _finished(result: Any) -> Any:
    """The result of a run; a run that is known to have failed raises."""
    scalars = result.demand if isinstance(result, Response) else result
    if not is_traced(scalars) and not all(np.isfinite(x).all() for x in jax.tree.leaves(scalars)):
        raise FloatingPointError(
            "the run ended in non-finite numbers: the ground motion returns some or overflows, "
            "or the temperature is too small"
        )
    return result
