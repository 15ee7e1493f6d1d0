"""One step of a system of masses, rods and links.

Kick and drift: velocities live half a step before the positions, v_{m+1/2} = v_{m−1/2} + h a_m and
x_{m+1} = x_m + h v_{m+1/2}. This is the central difference of the paper's eqs. (10) and (12)
without its cancellation.

A link's right end *hangs* on its left end: the unknowns are the left end's position and the link's
closing s = x_i − x_j, so that stick is exact and the gap has no cancellation. A mass linked to the
ground hangs on the ground.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jaxpound.model.system import (
    GROUND,
    Ends,
    LinkGroup,
    System,
    Topology,
    elongation,
    link_groups,
    load_on,
)
from jaxpound.simulation.alike import for_each
from jaxpound.simulation.contact import (
    ContactState,
    Coupling,
    GroupStep,
    apart,
    coupling,
    follow,
    is_followed,
    mean_sample,
    plain_motion,
    settle,
)
from jaxpound.simulation.friction import LinkMotion, LinkStep
from jaxpound.simulation.passage import Passed
from jaxpound.simulation.rod import RodLaw, rod_law, rod_moved, rod_step
from jaxpound.simulation.scheme import Scheme

WRITTEN_OUT = 4
"""Rods and followed links up to which the steps of a block are written out one after the other;
beyond they are a loop, which compiles in a third of the time and runs at most a fifth slower."""


class Elements(NamedTuple):
    """Constants of a run, as its steps use them."""

    topology: Topology
    inverse_masses: tuple[jax.Array, ...]
    rods: tuple[RodLaw, ...]
    frictions: tuple[jax.Array, ...]
    couplings: tuple[Coupling | None, ...]  # by group of links, of those that are followed
    slots: int  # impacts of a link in a step that are recorded
    relaxed: tuple[jax.Array, ...] | None  # elongations at which the rods start; None at rest

    @property
    def is_long(self) -> bool:
        """Whether a step has more than ``WRITTEN_OUT`` rods and followed links."""
        groups = zip(link_groups(self.topology), self.couplings, strict=True)
        followed = sum(len(group.links) for group, coupled in groups if coupled is not None)
        return len(self.rods) + followed > WRITTEN_OUT


class LinkState(NamedTuple):
    """State of a link: its closing at t_m, the rest at t_m − h/2 or t_{m−1}."""

    closing: jax.Array
    velocity: jax.Array
    phase: jax.Array
    pull: jax.Array  # A_{m−1}, the relative acceleration without the link
    contact: ContactState | None  # of a link in a group that is followed


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


def elements(
    system: System, dt: float, order: int, slots: int, displaced: Sequence[Any] | None = None
) -> Elements:
    """The constants of a run with steps of ``dt`` that records up to ``slots`` impacts in each.

    ``displaced`` are the displacements of all masses from which it starts; None for one at rest.
    """
    topology, inverse = system.topology, tuple(1 / m for m in system.masses)
    return Elements(
        topology=topology,
        inverse_masses=inverse,
        rods=tuple(rod_law(rod.material, rod.stiffness, dt, order) for rod in system.rods),
        frictions=tuple(link.friction for link in system.links),
        couplings=tuple(
            coupling(topology, group, system.links, inverse)
            if is_followed(group, system.links)
            else None
            for group in link_groups(topology)
        ),
        slots=slots,
        relaxed=None
        if displaced is None
        else tuple(elongation(ends, displaced) for ends in topology.rods),
    )


def at_rest(system: System, zero: jax.Array) -> State:
    """The state before the first step."""
    topology = system.topology
    groups = link_groups(topology)
    hanging = {far for group in groups for _, _, far in group.hanging}
    free = tuple(None if mass in hanging else zero for mass in range(topology.n_masses))
    links: dict[int, LinkState] = {}
    for group in groups:
        contact = apart(zero) if is_followed(group, system.links) else None
        links |= {k: LinkState(zero, zero, zero, zero, contact) for k in group.links}
    in_order = tuple(links[k] for k in range(len(links)))
    return State(free, free, (zero,) * len(topology.rods), in_order)


def moved(system: System, rest: State, x: Sequence[jax.Array], v: Sequence[jax.Array]) -> State:
    """The state at t = 0 of masses that are displaced by x and move with v, (n_masses,) each."""
    links = []
    for link, ends in zip(rest.links, system.topology.links, strict=True):
        closing, contact = elongation(ends, x), link.contact
        links.append(
            link._replace(
                closing=closing,
                velocity=elongation(ends, v),
                contact=None if contact is None else contact._replace(half=closing),
            )
        )
    free = [old is not None for old in rest.x]
    return rest._replace(
        x=tuple(new if own else None for own, new in zip(free, x, strict=True)),
        v=tuple(new if own else None for own, new in zip(free, v, strict=True)),
        links=tuple(links),
    )


def of_all_masses(
    topology: Topology, free: Sequence[Any], relative: Sequence[Any]
) -> tuple[Any, ...]:
    """Positions (or velocities) of all masses, from the free ones' and the links' closings."""
    found = list(free)
    for group in link_groups(topology):
        for k, near, far in group.hanging:
            left, s = topology.links[k][0] == near, relative[k]
            if near == GROUND:
                found[far] = -s if left else s
            else:
                found[far] = found[near] - s if left else found[near] + s
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

    A run that does not start at rest has its velocities at t = 0 itself there, and its first kick
    is of half a step: of a whole one with half the shaking and twice the masses.
    """
    acceleration, shaking = ground
    share: Any = 1.0
    if begins := system.relaxed is not None:
        share = jnp.where(starts, 0.5, 1.0).astype(time.dtype)
        system, shaking = _heavier(system, share), share * shaking
    topology, inverse = system.topology, system.inverse_masses
    x = of_all_masses(topology, state.x, [link.closing for link in state.links])

    # Rods at t_m.
    stretched = _stretched(system, x)
    passed = [
        rod_step(law, excess, total, length)
        for law, excess, total, length in zip(
            system.rods, state.excess, sums, stretched, strict=True
        )
    ]
    forces = _forces(system, passed)
    loads = [load_on(topology.rods, mass, forces) for mass in range(topology.n_masses)]

    # Links that may touch or share masses, over the step from t_m − h/2 to t_m + h/2.
    pulls = [_pull(ends, loads, inverse, shaking) for ends in topology.links]
    groups = link_groups(topology)
    flows = _followed(
        [
            _before(system, group, coupled, state, pulls, starts, time, dt)
            for group, coupled in zip(groups, system.couplings, strict=True)
            if coupled is not None
        ]
    )

    # After a step that was followed the rods are given the mean sample, which changes the pull on
    # all links whose masses have these rods.
    if flows:
        passed = _given_mean_samples(system, passed, flows)
        forces = _forces(system, passed)
        loads = [load_on(topology.rods, mass, forces) for mass in range(topology.n_masses)]
        pulls = [_pull(ends, loads, inverse, shaking) for ends in topology.links]

    # The motion of all links under that pull.
    now = [link.closing for link in state.links]
    contacts: list[ContactState | None] = [None] * len(now)
    motions = {
        k: _slide(system, k, state.links[k], pulls[k], starts, dt, scheme)
        for group in groups
        for k in group.links
        if len(group.links) == 1
    }
    for group, coupled, before, passage, used, _ in flows:
        more = jnp.stack([pulls[k] for k in group.links]) - before.pull
        before = dataclasses.replace(before, pull=before.pull + more, rise=before.rise + more)
        plain = _without_contact(system, group, coupled, before, motions, scheme)
        closing, contact, motion = settle(coupled, before, plain, passage, used, more)
        for j, k in enumerate(group.links):
            now[k] = closing[j]
            contacts[k], motions[k] = jax.tree.map(lambda y, j=j: y[j], (contact, motion))

    if begins:
        for k, link in enumerate(state.links):
            now[k] = jnp.where(starts, link.closing, now[k])
            motions[k] = _begun(motions[k], link, starts)
            contacts[k] = _begun_contact(contacts[k], link, motions[k], starts, dt)
        pulls = [pull / share for pull in pulls]

    free: list[_Free | None] = [
        None
        if state.x[mass] is None
        else _kick_and_drift(system, state, mass, loads[mass], shaking, motions, now, dt)
        for mass in range(topology.n_masses)
    ]
    if begins:
        free = [_begun_free(one, v, starts) for one, v in zip(free, state.v, strict=True)]
    after = State(
        x=tuple(None if one is None else one.x for one in free),
        v=tuple(None if one is None else one.v for one in free),
        excess=tuple(excess for _, excess, _ in passed),
        links=tuple(
            LinkState(
                link.closing + dt * motions[k].velocity + motions[k].jump,
                motions[k].velocity,
                motions[k].phase,
                pulls[k],
                contacts[k],
            )
            for k, link in enumerate(state.links)
        ),
    )
    instant = Instant(
        time=time,
        ground_acceleration=acceleration,
        x=tuple(None if one is None else one.x_now for one in free),
        v=tuple(None if one is None else one.v_now for one in free),
        forces=forces,
        links=tuple(
            LinkInstant(now[k], motions[k].velocity_now, motions[k]) for k in range(len(now))
        ),
    )
    return after, [c for _, _, c in passed], instant


def _heavier(system: Elements, share: jax.Array) -> Elements:
    """All masses divided by a share."""
    return system._replace(
        inverse_masses=tuple(share * inverse for inverse in system.inverse_masses),
        couplings=tuple(
            None if one is None else one._replace(delassus=share * one.delassus)
            for one in system.couplings
        ),
    )


def _stretched(system: Elements, x: Sequence[Any]) -> list[Any]:
    """The rods' elongations, from which those of relaxed rods are taken."""
    found = [elongation(ends, x) for ends in system.topology.rods]
    if system.relaxed is None:
        return found
    return [length - rest for length, rest in zip(found, system.relaxed, strict=True)]


def _forces(system: Elements, passed: Sequence[tuple[jax.Array, ...]]) -> tuple[jax.Array, ...]:
    """The rods' forces, to which those of relaxed rods are added."""
    if system.relaxed is None:
        return tuple(force for force, _, _ in passed)
    return tuple(
        force + law.modulus * rest
        for (force, _, _), law, rest in zip(passed, system.rods, system.relaxed, strict=True)
    )


def _begun(motion: LinkMotion, link: LinkState, starts: jax.Array) -> LinkMotion:
    """Motion of a link whose run does not start at rest: nothing turns before t = 0."""
    return motion._replace(
        velocity_now=jnp.where(starts, link.velocity, motion.velocity_now),
        jump=jnp.where(starts, 0.0, motion.jump),
        turns=motion.turns & ~starts,
        turn_time=jnp.where(starts, 0.0, motion.turn_time),
        turn=jnp.where(starts, 0.0, motion.turn),
        change_time=jnp.where(starts, 0.0, motion.change_time),
    )


def _begun_free(one: _Free | None, v: Any, starts: jax.Array) -> _Free | None:
    return one and one._replace(v_now=jnp.where(starts, v, one.v_now))


def _begun_contact(
    contact: ContactState | None, link: LinkState, motion: LinkMotion, starts: jax.Array, dt: float
) -> ContactState | None:
    """State of contact after the first half step of such a run."""
    if contact is None:
        return None
    half = link.closing + dt / 4 * (link.velocity + motion.velocity)
    return contact._replace(half=jnp.where(starts, half, contact.half))


class _Free(NamedTuple):
    """A free mass after the step, and at t_m."""

    x: jax.Array
    v: jax.Array
    x_now: jax.Array
    v_now: jax.Array


def _kick_and_drift(
    system: Elements,
    state: State,
    mass: int,
    load: jax.Array,
    shaking: jax.Array,
    motions: dict[int, LinkMotion],
    closings: list[jax.Array],
    dt: float,
) -> _Free:
    """Kick and drift of a free mass under the load of its rods; ``closings`` are those at t_m.

    Its velocity at t_m is the mean of those half a step before and after, corrected for the kinks
    that links make. An event's effect is shared so that the group's centre of mass stays.
    """
    topology, x, v_before = system.topology, state.x[mass], state.v[mass]
    assert x is not None
    assert v_before is not None
    hung = [n for n, group in enumerate(link_groups(topology)) if group.root == mass]
    links = link_groups(topology)[hung[0]].links if hung else ()
    for k in links:
        if mass in (ends := topology.links[k]):
            force = motions[k].mean_force
            load = load - force if ends[0] == mass else load + force
    v = v_before + dt * (load * system.inverse_masses[mass] - shaking)
    free = _Free(x + dt * v, v, x, (v_before + v) / 2)
    if not links:
        return free
    share = partial(_shared, system, hung[0], mass)
    kinks = [
        motions[k].velocity_now - (state.links[k].velocity + motions[k].velocity) / 2 for k in links
    ]
    free = free._replace(
        x=free.x + share([motions[k].jump for k in links]), v_now=free.v_now + share(kinks)
    )
    if system.couplings[hung[0]] is None:
        return free
    return free._replace(x_now=x + share([closings[k] - state.links[k].closing for k in links]))


class _Step(NamedTuple):
    """A group before its local flow."""

    group: LinkGroup
    coupling: Coupling
    before: GroupStep


class _Flow(NamedTuple):
    """A group after its local flow, before the rods have been given the mean sample."""

    group: LinkGroup
    coupling: Coupling
    before: GroupStep
    passed: Passed
    used: jax.Array
    shift: jax.Array  # of the closings, to their mean sample


def _given_mean_samples(system: Elements, passed: list[Any], flows: list[_Flow]) -> list[Any]:
    """The rods at t_m with the positions of masses that were followed replaced."""
    shifts: dict[int, jax.Array] = {}
    for one in flows:
        shifts |= {mass: share @ one.shift for mass, share in one.coupling.shifts.items()}
    every = [shifts.get(mass, 0.0) for mass in range(system.topology.n_masses)]
    return [
        rod_moved(law, one, elongation(ends, every)) if shifts.keys() & {*ends} else one
        for law, one, ends in zip(system.rods, passed, system.topology.rods, strict=True)
    ]


def _followed(steps: Sequence[_Step]) -> list[_Flow]:
    """All groups after their local flows."""
    given = [(one.coupling._replace(shifts={}), one.before) for one in steps]
    flows = []
    for one, (passed, used) in zip(steps, for_each(follow, given), strict=True):
        shift = jnp.where(used, mean_sample(passed, one.before) - one.before.closing, 0.0)
        flows.append(_Flow(*one, passed, used, shift))
    return flows


def _before(
    system: Elements,
    group: LinkGroup,
    coupled: Coupling,
    state: State,
    pulls: list[jax.Array],
    starts: jax.Array,
    time: jax.Array,
    dt: float,
) -> _Step:
    links = [state.links[k] for k in group.links]
    pull = jnp.stack([pulls[k] for k in group.links])
    last = jnp.stack([link.pull for link in links])
    begins = system.relaxed is not None
    bound = group.root == GROUND or begins
    before = GroupStep(
        closing=jnp.stack([link.closing for link in links]),
        velocity=jnp.stack([link.velocity for link in links]),
        state=jax.tree.map(lambda *y: jnp.stack(y), *(link.contact for link in links)),
        pull=pull,
        rise=pull - (jnp.where(starts, pull, last) if bound else last),
        time=time,
        starts=starts,
        halfway=not begins,
        dt=dt,
        slots=system.slots,
    )
    return _Step(group, coupled, before)


def _without_contact(
    system: Elements,
    group: LinkGroup,
    coupled: Coupling,
    before: GroupStep,
    motions: dict[int, LinkMotion],
    scheme: Scheme,
) -> LinkMotion:
    """Motion of a group whose step needs no local flow; ``motions`` has that of single links."""
    if len(group.links) == 1:
        return jax.tree.map(lambda y: y[None], motions[group.links[0]])
    plain = plain_motion(coupled, before)
    at_rest = group.root == GROUND and before.halfway
    return _from_rest(plain, before.starts, scheme) if at_rest else plain


def _slide(
    system: Elements,
    k: int,
    link: LinkState,
    pull: jax.Array,
    starts: jax.Array,
    dt: float,
    scheme: Scheme,
) -> LinkMotion:
    """Motion of a link that shares no mass, without contact."""
    ends, inverse = system.topology.links[k], system.inverse_masses
    begins = system.relaxed is not None
    bound = GROUND in ends or begins
    rise = pull - (jnp.where(starts, pull, link.pull) if bound else link.pull)
    whole, friction = _inverse_mass(ends, inverse), system.frictions[k]
    motion = scheme.friction.slide(
        LinkStep(link.velocity, link.phase, pull, rise, whole, friction, dt)
    )
    return _from_rest(motion, starts, scheme) if bound and not begins else motion


def _shared(system: Elements, group: int, mass: int, changes: Sequence[jax.Array]) -> jax.Array:
    """By how much a mass shifts as a group's closings change about a fixed centre of mass."""
    coupled, topology = system.couplings[group], system.topology
    if coupled is not None:
        return coupled.shifts[mass] @ jnp.stack(changes)
    (k,), (change,) = link_groups(topology)[group].links, changes
    inverse = system.inverse_masses
    return change * inverse[mass] / _inverse_mass(topology.links[k], inverse)


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
