"""One step of a system, from t_m to t_{m+1}, in the order of the page on the numerics.

    M x'' = −Bᵀ f − Cᵀ (q + p) − M ι u''     rods f(e), e = B x;   joints q(s'), p(s, s'), s = C x

with −D x' of dashpots (``damping``) and loads on the right, where a run has any.

Rods have forces f, joints friction q and contact forces p. Velocities live half a step before
displacements: v_{m+1/2} = v_{m−1/2} + h a_m is the kick, x_{m+1} = x_m + h v_{m+1/2} the drift.
This is the central difference of the paper's eqs. (10) and (12) without its cancellation. Every
mass moves freely; a joint has a closing s and a velocity w of its own, so that stick is exact, and
masses follow their joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp

from jaxpound._xla.alike import map_alike
from jaxpound.model.ends import along, less_ground
from jaxpound.simulation.constants import StepConstants
from jaxpound.simulation.rods.law import RodLaw, RodStep
from jaxpound.simulation.state import Instant, JointState, Moved, Now, RunState, SeenGroup


def one_step(
    system: StepConstants, before: RunState, sums: Sequence[Any], now: Now, with_flows: bool
) -> tuple[RunState, list[Any], Instant]:
    """One step: the state at t_{m+1}, each rod's c_m for its history, and the instant t_m.

    ``sums`` are the history sums S_m of the rods that have a memory. A step without flows is right
    where no joint needs a flow.
    """
    h = system.dt

    # The rods at t_m, and the pull on the joints, A = C (a − ι u'') with a = −M⁻¹ Bᵀ f.
    rods = rods_at(system, before, sums, now, range(len(system.rods)), before.x)
    free, ground = system.accelerations(rods, before.v, before.owed, now)
    pulls = [kind.in_step.pull(free, ground) for kind in system.joints]

    # The joints from t_m − h/2 to t_m + h/2, s'' = A − G (q + p) with G = C M⁻¹ Cᵀ. The rods take
    # the mean sample of a path that flows have kinked, which changes the pull.
    flows: list[Any] = [None] * len(pulls)
    drag = None
    if with_flows:
        joints = zip(system.joints, before.joints, pulls, strict=True)
        flows = [kind.flow(y, pull, now, h, system.slots) for kind, y, pull in joints]
    if any(flow is not None for flow in flows):
        rods = with_mean_samples(system, before, sums, now, rods, flows)
        if system.damping is not None:
            drag = system.damping.drag(system.joints, before.joints, flows, now)
        free, ground = system.accelerations(rods, before.v, before.owed, now, drag)
        pulls = [kind.in_step.pull(free, ground) for kind in system.joints]
    moved = [
        with_start(system, y, kind.after(y, flow, pull, now, system.friction, h), now)
        for kind, y, flow, pull in zip(system.joints, before.joints, flows, pulls, strict=True)
    ]

    # Kick and drift of the masses, which follow their joints: v + S (w − C v), S = M⁻¹ Cᵀ G⁻¹.
    a = [less_ground(a, iota, ground) for a, iota in zip(free, system.influence, strict=True)]
    kicked = [v + now.kick * h * a for v, a in zip(before.v, a, strict=True)]
    for kind, y in zip(system.joints, moved, strict=True):
        if y.stop is not None:
            kind.stop(kicked, y.stop)
    v = system.follow(kicked, [y.state.velocity for y in moved], flows)
    drifted = [x + h * v for x, v in zip(before.x, v, strict=True)]
    owed = None
    if system.damping is not None:
        owed = system.damping.owed(system.joints, moved)
    if drag is not None:  # as dashpots drag masses and joints; the pull is that after all jumps
        jumped = [v - now.kick * h * a for v, a in zip(v, a, strict=True)]
        free, ground = system.accelerations(rods, jumped, before.owed, now)
        dragged = drag.position + h**2 / 8 * drag.end
        drifted = [x + y for x, y in zip(drifted, dragged, strict=True)]
        moved = [
            kind.dragged(y, flow, kind.in_step.pull(free, ground), drag, h)
            for kind, y, flow in zip(system.joints, moved, flows, strict=True)
        ]
    x = system.follow(drifted, [y.state.closing for y in moved], flows)

    rod_states, joint_states = tuple(rod.state for rod in rods), tuple(y.state for y in moved)
    after = RunState(x, v, rod_states, joint_states, owed)
    remembered = [rod.remembered for rod in rods if rod.remembered is not None]
    needs_flow = None
    if not with_flows:
        joints = zip(system.joints, before.joints, pulls, strict=True)
        needs_flow = jnp.stack([kind.needs_flow(y, pull, now, h) for kind, y, pull in joints]).any()
    instant = observed(system, before, after, rods, moved, flows, now, needs_flow)
    return after, remembered, instant


def rods_at(
    system: StepConstants,
    before: RunState,
    sums: Sequence[Any],
    now: Now,
    numbers: Sequence[int],
    *x: Sequence[Any],
) -> list[RodStep]:
    """The rods with these numbers at t_m, for displacements then, and maybe those in the mean."""
    remaining = iter(sums)
    totals = [None if law.order is None else next(remaining) for law in system.rods]
    is_first = None if system.starts_at_rest else now.is_first

    def at(law: RodLaw, state: Any, total: Any, elongation: Any, *mean: Any) -> RodStep:
        return law.step(state, elongation, total, is_first, *mean)

    arguments = [
        (system.rods[n], before.rods[n], totals[n], *(along(system.rod_paths[n], y) for y in x))
        for n in numbers
    ]
    return map_alike(at, arguments, system.plan.laws_in_arrays)


def with_mean_samples(
    system: StepConstants,
    before: RunState,
    sums: Sequence[Any],
    now: Now,
    rods: list[RodStep],
    flows: Sequence[Any],
) -> list[RodStep]:
    """The rods at t_m, of which those at joints with a flow take the mean sample of the path."""
    x_now, x_mean, masses = [*before.x], [*before.x], set[int]()
    for kind, flow in zip(system.joints, flows, strict=True):
        if flow is not None:
            kind.follow(x_now, flow.now)
            kind.follow(x_mean, flow.mean)
            masses |= {mass for group in kind.of for mass in group.shares}
    numbers = [n for n, ends in enumerate(system.rod_ends) if masses & dict(ends).keys()]
    changed = rods_at(system, before, sums, now, numbers, x_now, x_mean)
    by_number = dict(zip(numbers, changed, strict=True))
    return [by_number.get(n, rod) for n, rod in enumerate(rods)]


def with_start(system: StepConstants, before: JointState, moved: Moved, now: Now) -> Moved:
    """Joints after a step; the first step is its second half alone, which begins at t_m = 0."""
    moved = moved._replace(
        velocity_now=jnp.where(now.is_first, before.velocity, moved.velocity_now)
    )
    if system.starts_at_rest:
        return moved
    # What has happened is taken for what happens after the start.
    turns = moved.turns._replace(exist=moved.turns.exist & ~now.is_first)
    change_time = jnp.where(now.is_first, 0.0, moved.change_time)
    return moved._replace(turns=turns, change_time=change_time)


def observed(
    system: StepConstants,
    before: RunState,
    after: RunState,
    rods: Sequence[RodStep],
    moved: Sequence[Moved],
    flows: Sequence[Any],
    now: Now,
    needs_flow: jax.Array | None,
) -> Instant:
    """The instant t_m: its velocities are the mean of those half a step before and after it."""
    x = before.x
    if any(flow is not None for flow in flows):
        x = system.follow(x, [y.now for y in moved])
    mean = [(v + w) / 2 for v, w in zip(before.v, after.v, strict=True)]
    v = system.follow(mean, [y.velocity_now for y in moved])
    v = tuple(jnp.where(now.is_first, a, b) for a, b in zip(before.v, v, strict=True))
    at_rates = [*rods]
    for number, (law, ends) in enumerate(zip(system.rods, system.rod_paths, strict=True)):
        if law.viscosity is not None:
            at_rates[number] = rods[number]._replace(force=law.viscosity * along(ends, v))
    forces = tuple(rod.force for rod in at_rates)
    damping = None if system.damping is None else system.damping.forces(v)
    instant = Instant(
        time=now.time,
        ground=now.ground,
        x=x,
        v=v,
        rods=tuple(at_rates),
        groups=(),
        links=(),
        needs_flow=needs_flow,
        damping=damping,
        loads=now.loads,
        supports=now.supports,
    )
    free = system.free_accelerations(forces, instant.on_masses, now.supports)
    groups = list[SeenGroup]()
    for kind, y, flow in zip(system.joints, moved, flows, strict=True):
        groups += kind.seen(y, flow, partial(kind.inertia, free, now.ground))
    links = {k: link for seen in groups for k, link in seen.links.items()}
    links_seen = tuple(links[k] for k in sorted(links))
    return instant._replace(groups=tuple(groups), links=links_seen)
