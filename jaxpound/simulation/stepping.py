"""One step of a system of masses, rods and links.

Kick and drift: velocities live half a step before the positions, v_{m+1/2} = v_{m−1/2} + h a_m and
x_{m+1} = x_m + h v_{m+1/2}. This is the central difference of the paper's eqs. (10) and (12)
without its cancellation.

A link's right end *hangs* on its left end: the unknowns are the left end's position and the link's
closing s = x_i − x_j, so that stick is exact and the gap has no cancellation. A mass linked to the
ground hangs on the ground.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jaxpound.model.system import GROUND, Ends, System, Topology, elongation, load_on
from jaxpound.simulation.friction import LinkMotion, LinkStep
from jaxpound.simulation.rod import RodLaw, rod_law, rod_step
from jaxpound.simulation.scheme import Scheme


class Elements(NamedTuple):
    """Constants of a run, as its steps use them."""

    topology: Topology
    inverse_masses: tuple[jax.Array, ...]
    rods: tuple[RodLaw, ...]
    frictions: tuple[jax.Array, ...]


class LinkState(NamedTuple):
    """State of a link: its closing at t_m, the rest at t_m − h/2 or t_{m−1}."""

    closing: jax.Array
    velocity: jax.Array
    phase: jax.Array
    pull: jax.Array  # A_{m−1}, the relative acceleration without the link


class State(NamedTuple):
    """Positions at t_m, velocities at t_m − h/2, and the state of rods and links.

    A mass that hangs on a link has no position and velocity of its own (None).
    """

    x: tuple[jax.Array | None, ...]
    v: tuple[jax.Array | None, ...]
    excess: tuple[jax.Array, ...]  # K e_{m−1} − f_{m−1} of each rod with elongation e
    links: tuple[LinkState, ...]


class LinkInstant(NamedTuple):
    """A link at an instant t_m, and what friction did around it."""

    closing: jax.Array
    velocity: jax.Array
    motion: LinkMotion


class Instant(NamedTuple):
    """A system at an instant t_m. Hanging masses are left out, as in ``State``."""

    time: jax.Array
    ground_acceleration: jax.Array
    x: tuple[jax.Array | None, ...]
    v: tuple[jax.Array | None, ...]
    forces: tuple[jax.Array, ...]  # of the rods
    links: tuple[LinkInstant, ...]


def elements(system: System, dt: float, order: int) -> Elements:
    """The constants of a run with steps of ``dt``."""
    return Elements(
        topology=system.topology,
        inverse_masses=tuple(1 / m for m in system.masses),
        rods=tuple(rod_law(rod.material, rod.stiffness, dt, order) for rod in system.rods),
        frictions=tuple(link.friction for link in system.links),
    )


def hanging_end(ends: Ends) -> int:
    """Which mass hangs on a link: the right one, or the one that is not the ground."""
    return ends[0] if ends[1] == GROUND else ends[1]


def at_rest(topology: Topology, zero: jax.Array) -> State:
    """The state before the first step."""
    hanging = {hanging_end(ends) for ends in topology.links}
    free = tuple(None if mass in hanging else zero for mass in range(topology.n_masses))
    link = LinkState(zero, zero, zero, zero)
    return State(free, free, (zero,) * len(topology.rods), (link,) * len(topology.links))


def of_all_masses(
    topology: Topology, free: Sequence[Any], relative: Sequence[Any]
) -> tuple[Any, ...]:
    """Positions (or velocities) of all masses, from the free ones' and the links' closings."""
    found = list(free)
    for (i, j), s in zip(topology.links, relative, strict=True):
        if j == GROUND:
            found[i] = s
        else:
            found[j] = -s if i == GROUND else found[i] - s
    return tuple(found)


def step(
    system: Elements,
    state: State,
    sums: Sequence[jax.Array],
    time: jax.Array,
    ground: tuple[jax.Array, jax.Array],
    dt: float,
    scheme: Scheme,
    starts: jax.Array,
) -> tuple[State, list[jax.Array], Instant]:
    """One step: the state at t_{m+1}, each rod's c_m for its history, and the instant t_m.

    ``sums`` are the rods' history sums S_m; ``ground`` is u'' at t_m and its mean over the step
    from t_m − h/2 to t_m + h/2; ``starts`` says that t_m = 0.
    """
    topology, inverse = system.topology, system.inverse_masses
    acceleration, shaking = ground
    x = of_all_masses(topology, state.x, [link.closing for link in state.links])

    # Rods at t_m.
    passed = [
        rod_step(law, excess, total, elongation(ends, x))
        for law, excess, total, ends in zip(
            system.rods, state.excess, sums, topology.rods, strict=True
        )
    ]
    forces = tuple(force for force, _, _ in passed)
    loads = [load_on(topology.rods, mass, forces) for mass in range(topology.n_masses)]

    # Links over the step from t_m − h/2 to t_m + h/2.
    links, seen = [], []
    for ends, friction, link in zip(topology.links, system.frictions, state.links, strict=True):
        pull, resistance = _pull(ends, loads, inverse, shaking), _inverse_mass(ends, inverse)
        bound = GROUND in ends
        rise = pull - (jnp.where(starts, pull, link.pull) if bound else link.pull)
        motion = scheme.friction.slide(
            LinkStep(link.velocity, link.phase, pull, rise, resistance, friction, dt)
        )
        if bound:
            motion = _from_rest(motion, starts, scheme)
        closing = link.closing + dt * motion.velocity + motion.jump
        links.append(LinkState(closing, motion.velocity, motion.phase, pull))
        seen.append(LinkInstant(link.closing, motion.velocity_now, motion))

    # Kick and drift of the free masses, and their velocities at t_m: the mean of those half a step
    # before and after, corrected for the kink that friction makes.
    free_x, free_v, now_v = list(state.x), list(state.v), list(state.v)
    for mass, (x_m, v_m) in enumerate(zip(state.x, state.v, strict=True)):
        if x_m is None or v_m is None:
            continue
        load = loads[mass]
        for ends, one in zip(topology.links, seen, strict=True):
            load = load - one.motion.mean_force if ends[0] == mass else load
        v = v_m + dt * (load * inverse[mass] - shaking)
        drifted, mean = x_m + dt * v, (v_m + v) / 2
        for ends, one, link in zip(topology.links, seen, state.links, strict=True):
            if ends[0] == mass:  # an event's effect is shared in inverse proportion to mass
                whole = _inverse_mass(ends, inverse)
                kink = one.velocity - (link.velocity + one.motion.velocity) / 2
                drifted = drifted + one.motion.jump * inverse[mass] / whole
                mean = mean + kink * inverse[mass] / whole
        free_x[mass], free_v[mass], now_v[mass] = drifted, v, mean

    after = State(
        x=tuple(free_x),
        v=tuple(free_v),
        excess=tuple(excess for _, excess, _ in passed),
        links=tuple(links),
    )
    now = Instant(
        time=time,
        ground_acceleration=acceleration,
        x=state.x,
        v=tuple(now_v),
        forces=forces,
        links=tuple(seen),
    )
    return after, [c for _, _, c in passed], now


def _pull(
    ends: Ends, loads: Sequence[jax.Array], inverse: Sequence[jax.Array], shaking: jax.Array
) -> jax.Array:
    """Relative acceleration of a link's ends without it; between masses u'' drops out."""
    i, j = ends
    if j == GROUND:
        return loads[i] * inverse[i] - shaking
    if i == GROUND:
        return shaking - loads[j] * inverse[j]
    return loads[i] * inverse[i] - loads[j] * inverse[j]


def _inverse_mass(ends: Ends, inverse: Sequence[jax.Array]) -> jax.Array:
    """Relative acceleration of a link's ends under a unit force in the link."""
    i, j = ends
    if j == GROUND:
        return inverse[i]
    return inverse[j] if i == GROUND else inverse[i] + inverse[j]


def _from_rest(motion: LinkMotion, starts: jax.Array, scheme: Scheme) -> LinkMotion:
    """Motion of a sliding bearing: from rest at t = 0 it has half a step, as free masses have.

    A link between two masses needs no such start: it has no load before the ground moves them.
    """
    share = jnp.where(starts, 0.5 if scheme.start == "rest" else 0.0, 1.0)
    share = share.astype(motion.velocity.dtype)
    return motion._replace(
        velocity=share * motion.velocity,
        velocity_now=jnp.where(starts, 0.0, motion.velocity_now),
        jump=jnp.where(starts, 0.0, motion.jump),
    )
