"""One step of a system of masses, rods and links.

Kick and drift: velocities live half a step before the positions, v_{m+1/2} = v_{m−1/2} + h a_m and
x_{m+1} = x_m + h v_{m+1/2}. This is the central difference of the paper's eqs. (10) and (12)
without its cancellation.

In each group of links that share masses one end of a link *hangs* on the other, outwards from the
root, a mass or the ground: the unknowns are the position of the root and the closings of the links,
s = x_i − x_j, so that stick is exact and the gap has no cancellation.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp

from jaxpound._xla.alike import map_alike, unstacked
from jaxpound.model.topology import GROUND, LinkGroup, elongation, link_groups
from jaxpound.simulation import state
from jaxpound.simulation.contact import group as contact_group
from jaxpound.simulation.contact.group import ContactState, Coupling, GroupStep, MovedLink
from jaxpound.simulation.contact.group_flows import GroupFlows, Groups, flows_of, need_flows
from jaxpound.simulation.friction import LinkMotion, LinkStep
from jaxpound.simulation.rod import RodStep, SpringLaw, rod_moved, rod_step
from jaxpound.simulation.scheme import Scheme
from jaxpound.simulation.starting import RunStart
from jaxpound.simulation.state import Instant, LinkInstant, LinkState, RunState, StepConstants
from jaxpound.simulation.yielding import HysteresisConstants, HysteresisStep, hysteresis_step, moved


def step(
    system: StepConstants,
    starting: RunStart,
    before: RunState,
    sums: Sequence[jax.Array],
    time: jax.Array,
    ground: tuple[jax.Array, jax.Array],
    dt: float,
    scheme: Scheme,
    is_first: jax.Array,
    is_last: jax.Array,
    with_flows: bool,
) -> tuple[RunState, list[jax.Array], Instant]:
    """One step: the state at t_{m+1}, each rod's c_m for its history, and the instant t_m.

    c is K τ_x e − τ_f f of a rod, of which its law has a fractional derivative; ``sums`` are the
    history sums S_m of the rods that have one. ``ground`` is u'' at t_m and its mean over the step
    from t_m − h/2 to t_m + h/2; ``is_first`` and ``is_last`` say whether the run starts and ends at
    t_m, and ``starting`` how it starts. A step without flows is right where it needs none.
    """
    acceleration, mean_acceleration = ground
    of_run = system  # not of its first step, which may be another
    system, mean_acceleration = starting.kick(system, mean_acceleration, is_first)
    topology = system.topology
    x = state.of_all_masses(topology, before.x, [link.closing for link in before.links])
    elongations = [elongation(ends, x) for ends in topology.rods]
    now = time, mean_acceleration, dt, scheme, is_first, is_last
    this = _Step(system, starting, before, elongations, *now)

    rod_steps = this.rod_steps(sums)
    yielding = this.yielding(elongations)
    forces, loads, pulls = this.loads(rod_steps, yielding)
    groups = [(of_shape, this.group_step(of_shape, pulls)) for of_shape in system.groups]
    flows = [flows_of(*of_groups) for of_groups in groups] if with_flows else []
    # After a flow the rods take the mean sample, which changes the pull on all links whose masses
    # have these rods.
    if flows:
        rod_steps, yielding = this.with_mean_samples(rod_steps, yielding, flows)
        forces, loads, pulls = this.loads(rod_steps, yielding)

    moved_links = this.moved_links(pulls, groups, flows)
    closings, motions = [x.closing for x in moved_links], [x.motion for x in moved_links]
    free = {
        mass: this.kick_and_drift(mass, loads[mass], motions, closings)
        for mass in range(topology.n_masses)
        if before.x[mass] is not None
    }

    def of_free(name: str) -> tuple[jax.Array | None, ...]:
        return tuple(getattr(free.get(mass), name, None) for mass in range(topology.n_masses))

    links = tuple(
        LinkState(
            closing=link.closing + dt * motions[k].velocity + motions[k].jump,
            velocity=motions[k].velocity,
            phase=motions[k].phase,
            pull=starting.pull(pulls[k], is_first),
            contact=moved_links[k].contact,
        )
        for k, link in enumerate(before.links)
    )
    after = RunState(
        x=of_free("x"),
        v=of_free("v"),
        excess=tuple(rod.excess for rod in rod_steps),
        yielding=tuple(None if rod is None else rod.state for rod in yielding),
        links=links,
    )
    totals = [motion.total_force for motion in motions]
    inertia = of_run.inerter_forces(forces, acceleration, totals)
    seen = tuple(
        LinkInstant(closings[k], motion.velocity_now, motion, inertia.get(k))
        for k, motion in enumerate(motions)
    )
    dissipated = state.each(HysteresisConstants.dissipated, system.hysteresis, after.yielding)
    x_now, v_now = of_free("x_now"), of_free("v_now")
    needs_flow = None if with_flows else need_flows(groups)
    instant = Instant(time, acceleration, x_now, v_now, forces, dissipated, seen, needs_flow)
    return after, [rod.remembered for rod in rod_steps if rod.remembered is not None], instant


class _FreeMass(NamedTuple):
    """A free mass after the step, and at t_m."""

    x: jax.Array
    v: jax.Array
    x_now: jax.Array
    v_now: jax.Array


class _Step(NamedTuple):
    """The inputs of a step, and its parts."""

    system: StepConstants
    starting: RunStart
    before: RunState  # the state at t_m
    elongations: list[jax.Array]  # of the rods, at t_m
    time: jax.Array
    mean_acceleration: jax.Array  # of the ground over the step
    dt: float
    scheme: Scheme
    is_first: jax.Array
    is_last: jax.Array

    def rod_steps(self, sums: Sequence[jax.Array]) -> list[RodStep]:
        """Force, excess and c_m of each rod at t_m; rods are relaxed as they are at the start."""
        elongations, remaining = self.starting.elongations(self.elongations), iter(sums)
        rods = zip(self.system.rods, self.before.excess, elongations, strict=True)
        return [
            RodStep(law.modulus * x, None, None)
            if isinstance(law, SpringLaw)
            else rod_step(law, excess, next(remaining), x)
            for law, excess, x in rods
        ]

    def yielding(self, elongations: Sequence[jax.Array]) -> list[HysteresisStep | None]:
        """The rods at t_m, if they yield, with their elongations."""
        starts = None if self.starting.at_rest else self.is_first
        rods = zip(self.system.hysteresis, self.before.yielding, elongations, strict=True)
        those = {r: rod for r, rod in enumerate(rods) if rod[0] is not None}
        function = partial(hysteresis_step, is_first=starts)
        steps = map_alike(function, [*those.values()], self.system.plan.laws_in_arrays)
        by_number = dict(zip(those, steps, strict=True))
        return [by_number.get(r) for r in range(len(elongations))]

    def loads(
        self, rod_steps: Sequence[RodStep], yielding: Sequence[HysteresisStep | None]
    ) -> tuple[tuple[jax.Array, ...], list[jax.Array], list[jax.Array]]:
        """Forces of the rods at t_m, mean loads on the masses, and mean pulls on the links."""
        system = self.system
        forces = self.starting.forces(tuple(rod.force for rod in rod_steps), system.rods)
        forces = tuple(f - y.lost if y else f for f, y in zip(forces, yielding, strict=True))
        means = tuple(f - y.kink if y else f for f, y in zip(forces, yielding, strict=True))
        topology = system.topology
        loads = topology.loads(means)
        return forces, loads, system.link_pulls(loads, self.mean_acceleration)

    def with_mean_samples(
        self, rods: list[RodStep], yielding: list[HysteresisStep | None], flows: list[GroupFlows]
    ) -> tuple[list[RodStep], list[HysteresisStep | None]]:
        """The rods at t_m with the positions of masses of a flow replaced."""
        system = self.system
        changed = {mass for shares in system.mass_shares.values() for mass in shares}

        def shifts(of_flow: Callable[[GroupFlows], jax.Array]) -> list[Any]:
            by_mass: dict[int, jax.Array] = {}
            for flow in flows:
                by_mass |= flow.mass_shifts(of_flow(flow), system.mass_shares)
            by_number = [by_mass.get(mass, 0.0) for mass in range(system.topology.n_masses)]
            return [elongation(ends, by_number) for ends in system.topology.rods]

        to_mean = shifts(lambda flow: flow.shift)
        rods, yielding, now = list(rods), list(yielding), list[HysteresisStep | None]()
        if any(system.hysteresis):
            to_now = shifts(lambda flow: flow.shift_now)
            now = self.yielding([x + dx for x, dx in zip(self.elongations, to_now, strict=True)])
        for k, ends in enumerate(system.topology.rods):
            if not changed & {*ends}:
                continue
            rods[k] = rod_moved(system.rods[k], rods[k], to_mean[k])
            if law := system.hysteresis[k]:
                of_rod = cast("HysteresisStep", now[k])
                yielding[k] = moved(law, of_rod, self.elongations[k] + to_mean[k])
        return rods, yielding

    def group_step(self, groups: Groups, pulls: Sequence[jax.Array]) -> GroupStep:
        """The inputs of groups of links, under the pulls on all links."""
        links: LinkState = groups.gather(self.before.links)
        now = (self.time, self.is_first, self.is_last)
        time, is_first, is_last = (jnp.broadcast_to(x, groups.shape[:-1]) for x in now)
        pull, rise = self._pull_and_rise(groups, pulls)
        return GroupStep(
            closing=links.closing,
            velocity=links.velocity,
            phase=links.phase,
            state=cast("ContactState", links.contact),
            pull=pull,
            rise=rise,
            time=time,
            is_first=is_first,
            is_last=is_last,
            at_rest=self.starting.at_rest,
            dt=self.dt,
            slots=self.system.slots,
            faces=groups.faces,
            on_ground=groups.on_ground,
        )

    def _pull_and_rise(
        self, groups: Groups, pulls: Sequence[jax.Array]
    ) -> tuple[jax.Array, jax.Array]:
        """The pull on the links of groups, and its growth since the step before."""
        pull = groups.gather(pulls)
        last = groups.gather([link.pull for link in self.before.links])
        return pull, self.starting.rise(pull, last, self.is_first, groups.on_ground)

    def moved_links(
        self,
        pulls: Sequence[jax.Array],
        groups: Sequence[tuple[Groups, GroupStep]],
        flows: Sequence[GroupFlows],
    ) -> list[MovedLink]:
        """All links after the step, under their pulls; without ``flows`` where none is needed."""
        moved = dict[int, MovedLink]()
        for n, (of_groups, before) in enumerate(groups):
            if flows:
                after = self._after_flow(flows[n], pulls)
            else:
                motion = of_groups.map(self._motion_without_flow, before)
                after = of_groups.map(contact_group.finish_without_flow, before, motion)
            moved |= of_groups.by_link(after)
        for number, group in enumerate(link_groups(self.system.topology)):
            if number not in self.system.mass_shares:
                for k, motion in self._slides(group, pulls).items():
                    moved[k] = MovedLink(self.before.links[k].closing, None, motion)
        links = enumerate(self.before.links)
        return [self.starting.link(link, moved[k], self.is_first, self.dt) for k, link in links]

    def _after_flow(self, flow: GroupFlows, pulls: Sequence[jax.Array]) -> MovedLink:
        """Groups after a step with their flows, under the pulls after it."""
        pull, rise = self._pull_and_rise(flow.groups, pulls)
        change = pull - flow.before.pull
        before = dataclasses.replace(flow.before, pull=pull, rise=rise)
        plain = flow.groups.map(self._motion_without_flow, before)
        result = plain, flow.result, flow.used, change
        return flow.groups.map(contact_group.finish_step, before, *result)

    def _motion_without_flow(self, coupling: Coupling, before: GroupStep) -> LinkMotion:
        """The closed form of a group's motion."""
        motion = contact_group.motion_without_flow(coupling, before, self.scheme.friction)
        if before.on_ground:
            motion = self.starting.on_ground(motion, self.is_first, self.scheme)
        return contact_group.with_other_faces(motion, before.faces)

    def _slides(self, group: LinkGroup, pulls: Sequence[jax.Array]) -> dict[int, LinkMotion]:
        """Motion of a link that needs no flow, and as its other face sees it, if it has one."""
        k, system = group.links[0], self.system
        link, ends, pull = self.before.links[k], system.topology.links[k], pulls[k]
        rise = self.starting.rise(pull, link.pull, self.is_first, GROUND in ends)
        inverse_mass = state.link_inverse_mass(ends, system.inverse_masses)
        if system.inerters is not None:
            inverse_mass = system.inerters.delassus[k, k]
        friction = system.frictions[k]
        motion = self.scheme.friction.slide(
            LinkStep(link.velocity, link.phase, pull, rise, inverse_mass, friction, self.dt)
        )
        if GROUND in ends:
            motion = self.starting.on_ground(motion, self.is_first, self.scheme)
        if not group.faces:
            return {k: motion}
        single = jax.tree.map(lambda y: y[None], motion)
        by_face = unstacked(contact_group.with_other_faces(single, group.faces))
        return dict(zip(group.links, by_face, strict=True))

    def kick_and_drift(
        self, mass: int, load: jax.Array, motions: list[LinkMotion], closings: list[jax.Array]
    ) -> _FreeMass:
        """Kick and drift of a free mass under the load of its rods; ``closings`` are those at t_m.

        Its velocity at t_m is the mean of those half a step before and after, corrected for the
        kinks that links make. An event's effect is shared so that the group's centre of mass stays.
        """
        system, before, inverse = self.system, self.before, self.system.inverse_masses
        x, v_before = before.x[mass], before.v[mass]
        assert x is not None
        assert v_before is not None
        groups = link_groups(system.topology)
        hung = [n for n, group in enumerate(groups) if group.root == mass]
        links = groups[hung[0]].links if hung else ()
        for k in links:
            if mass in (ends := system.topology.links[k]):
                force = motions[k].mean_force
                if system.inerters is not None and k in system.inerters.inertances:
                    kick = motions[k].velocity - before.links[k].velocity
                    force = force + system.inerters.inertances[k] * kick / self.dt
                load = load - force if ends[0] == mass else load + force
        v = v_before + self.dt * (load * inverse[mass] - self.mean_acceleration)
        x_after, x_now, v_now = x + self.dt * v, x, (v_before + v) / 2
        if links:
            shares = system.mass_shares.get(hung[0])

            def share(changes: Sequence[jax.Array]) -> jax.Array:
                """The shift of the mass by changes of closings, the centre of mass fixed."""
                if shares is not None:
                    return (shares[mass] * jnp.stack(changes)).sum()
                ends = system.topology.links[links[0]]
                return changes[0] * inverse[mass] / state.link_inverse_mass(ends, inverse)

            x_after += share([motions[k].jump for k in links])
            kinks = [
                motions[k].velocity_now - (before.links[k].velocity + motions[k].velocity) / 2
                for k in links
            ]
            v_now += share(kinks)
            if shares is not None:
                x_now = x + share([closings[k] - before.links[k].closing for k in links])
        v_now = self.starting.velocity_now(v_now, v_before, self.is_first)
        return _FreeMass(x_after, v, x_now, v_now)
