"""The scalars of a run, accumulated instant by instant.

Events between instants count: the gap is smallest where the slip velocity vanishes, smooth
series peak at the vertex of a parabola, and forces jump where slip ends. So the scalars and their
derivatives are second-order accurate in the step. Exceptions are derivatives of accelerations that
peak next to a jump of friction, and PGA and PGV, which are taken at the grid's instants.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jaxpound.model.ends import WeightedEnds, along, link_ends, load_on, times
from jaxpound.model.system import System
from jaxpound.model.topology import Topology, is_storey
from jaxpound.results.demand import Demand
from jaxpound.results.element_demands import MassDemand, RodDemand
from jaxpound.simulation.constants import StepConstants
from jaxpound.simulation.contact.records import Contact
from jaxpound.simulation.joints.coupled import Group
from jaxpound.simulation.observe.link_tally import WINDOW, ContactTally, LinkTally, LogMeanExp
from jaxpound.simulation.observe.peaks import GroundPeaks, Peak, Peaks, Sample
from jaxpound.simulation.rods.yielding import time_until
from jaxpound.simulation.state import Instant, RunState, added


def each(function: Callable[..., Any], *series: Iterable[Any]) -> tuple[Any, ...]:
    """A function of the entries of several series one by one; None where an entry is None."""
    rows = zip(*series, strict=True)
    return tuple(None if any(x is None for x in row) else function(*row) for row in rows)


class _Observed(NamedTuple):
    """An instant as peaks are observed in it."""

    now: Instant
    system: StepConstants
    smooth: Any  # whether no jump of all series is among the last three samples
    links: tuple[LinkTally, ...]  # with this instant
    last_forces: Sequence[jax.Array]  # of the rods, an instant before
    last_on_masses: Sequence[jax.Array] | None
    last_ground: jax.Array
    last_supports: Sequence[jax.Array]

    def displacement(self, ends: WeightedEnds) -> Sample:
        """The displacement of a mass or elongation of a rod; impacts are kinks of the path."""
        now = self.now
        position, speed = along(ends, now.x), along(ends, now.v)
        reached = list[jax.Array]()
        for group in self.groups_at(ends):
            links = [[link for link, _ in joint.faces] for joint in group.joints]
            for number, of_joint in enumerate(links):
                steps = [step for k in of_joint if (step := now.links[k].gap) is not None]
                if steps:
                    # The closing at its turn, as far as its own change moves the masses.
                    zeros = (0.0,) * len(links)
                    shares = [group.shares.get(mass, zeros) for mass in range(len(now.x))]
                    share = along(ends, [of_mass[number] for of_mass in shares])
                    link = now.links[of_joint[0]]
                    late, turn = link.turns.farthest_time, link.turns.farthest - link.closing
                    turned = position + late * (speed - share * link.velocity) + share * turn
                    met = sum(step.log.touched for step in steps) > 0
                    reached.append(jnp.where(met & link.turns.exist, turned, position))
        return Sample(position, self.without_impact(ends), reached, self.terms(ends))

    def groups_at(self, ends: WeightedEnds) -> list[Group]:
        """The groups of joints that move masses at these ends."""
        return [group for group in self.system.groups if {*group.shares} & {*dict(ends)}]

    def without_impact(self, ends: WeightedEnds) -> jax.Array:
        """Whether no impact of masses at these ends is among the last three samples."""
        joints = [joint for group in self.groups_at(ends) for joint in group.joints]
        links = [link for joint in joints for link, _ in joint.faces]
        kinks = [contact.is_kink for k in links if (contact := self.links[k].contact) is not None]
        smooth: jax.Array = self.smooth & ~jnp.stack(kinks).any() if kinks else self.smooth
        return smooth

    def terms(self, ends: WeightedEnds) -> jax.Array | None:
        """Size of the displacements whose difference may rest while a joint sticks; else None."""
        masses = {*dict(ends)}
        if not any(len(masses & {*group.shares}) > 1 for group in self.system.groups):
            return None
        sizes = [jnp.abs(times(weight, self.now.x[mass])) for mass, weight in ends]
        return sum(sizes[1:], sizes[0])

    def force(self, number: int) -> Sample:
        """A rod's force, which has kinks where it yields, by its number."""
        system, law, rod = self.system, self.system.rods[number], self.now.rods[number]
        smooth = self.smooth if rod.kinked is None else self.smooth & ~rod.kinked
        if law.viscosity is not None:  # velocities jump at impacts
            smooth = self.without_impact(system.rod_ends[number])
        forces, terms = [force for _, force in rod.reached], self.terms(system.rod_ends[number])
        terms = None if terms is None else law.modulus * terms
        return Sample(rod.force, smooth & (not law.peaks_at_kinks), forces, terms)

    def acceleration(self, mass: int) -> Sample:
        """A mass's acceleration: it jumps with the forces of its joints, and has kinks of rods."""
        now, reached, settled = self.now, list[jax.Array](), self.smooth
        rods = [k for k, ends in enumerate(self.system.rod_ends) if mass in dict(ends)]
        groups, forces = self.system.groups, list[jax.Array]()
        group = next((k for k, group in enumerate(groups) if mass in group.shares), None)
        if group is not None:
            forces = [*now.groups[group].forces]
            links = [self.links[joint.link] for joint in groups[group].joints]
            settled &= jnp.stack([link.instants_since_turn >= WINDOW for link in links]).all()
            for jump in now.groups[group].jumps:
                reached.append(self.accelerated(mass, group, jump.forces, jump.time))
        elif len(rods) == 1 and now.on_masses is None:  # of its rod
            force = self.force(rods[0])
            share = dict(self.system.rod_ends[rods[0]])[mass] / self.system.masses[mass]
            return Sample(share * force.value, force.smooth, [share * y for y in force.others])
        value, smooth = self.accelerated(mass, group, forces), settled
        for number in rods:
            if (rod := now.rods[number]).kinked is not None:
                smooth &= ~rod.kinked
                for late, force in rod.reached:
                    time, kink = late * self.system.dt, {number: force}
                    at_kink = self.accelerated(mass, group, forces, time, kink)
                    reached.append(jnp.where(settled & (late > -1), at_kink, value))
        return Sample(value, smooth, reached)

    def accelerated(
        self,
        mass: int,
        group: int | None,
        forces: Sequence[Any],
        late: Any = None,
        kink: Mapping[int, jax.Array] = MappingProxyType({}),
    ) -> jax.Array:
        """A mass's acceleration under forces of its group of joints, some time after the instant.

        ``kink`` is the force of a rod then, by its number; all others are linear in time.
        """
        system, ground, share = self.system, self.now.ground, None
        if late is not None:  # all else as it has changed since the instant before
            share = late / system.dt
            ground = ground + (ground - self.last_ground) * share

        def then(force: jax.Array, last: jax.Array) -> jax.Array:
            return force if share is None else force + (force - last) * share

        def rod_force(number: int) -> jax.Array:
            force = then(self.now.forces[number], self.last_forces[number])
            return kink.get(number, force)

        more = None
        if (on_masses := self.now.on_masses) is not None and self.last_on_masses is not None:
            more = [*map(then, on_masses, self.last_on_masses)]

        ends, acting = list[WeightedEnds](), list[Any]()
        for number, rod_ends in enumerate(system.rod_ends):
            if mass in dict(rod_ends):
                ends.append(rod_ends)
                acting.append(rod_force(number))
        if group is not None:
            inertia = self.now.groups[group].inertia
            if late is not None and any(inert is not None for inert in inertia):
                by_group = [seen.forces for seen in self.now.groups]
                by_group[group] = forces
                forces_then = [*map(rod_force, range(len(system.rods)))]
                supports = [*map(then, self.now.supports, self.last_supports)]
                free = system.free_accelerations(forces_then, more, supports)
                inertia = system.inertia(free, ground, by_group)[group]
            ends += [joint.ends for joint in system.groups[group].joints]
            acting += added(forces, inertia)
        load = load_on(mass, ends, acting)
        return (load if more is None else load + more[mass]) / system.masses[mass]


def paths(system: StepConstants, topology: Topology) -> list[WeightedEnds]:
    """The displacements that are observed: of each mass, and elongations that differ from these."""
    ends: dict[int, WeightedEnds] = {mass: ((mass, 1),) for mass in range(topology.n_masses)}
    for number, rod_ends in zip(topology.elongations, system.rod_paths, strict=True):
        ends.setdefault(number, rod_ends)
    return [*ends.values()]


def _first_yield(
    limit: jax.Array, first: jax.Array, before: Peak, peak: Peak, time: jax.Array, dt: float
) -> jax.Array:
    """When a rod yields first, by the peaks of its elongation until the instant before and now."""
    yields = (before.largest < limit) & (peak.largest >= limit)
    # As the parabola through the last three elongations passes the limit.
    side = jnp.where(peak.last < 0, -1.0, 1.0).astype(peak.last.dtype)
    gain = side * (peak.rise - before.rise)
    speed = side * peak.rise + gain / 2
    late, _ = time_until(limit - side * peak.last, speed, gain)
    late = jnp.where((late <= 0) & (late >= -1), late, 0.0)
    return jnp.where(yields, time + dt * late, first)


class Tally(NamedTuple):
    """Running values for a ``Demand``."""

    ground: GroundPeaks
    displacements: Peaks  # of the ``paths``
    acceleration: Peaks  # of the masses
    forces: Peaks  # of the rods
    first_yields: tuple[jax.Array | None, ...]  # times, of rods that yield
    links: tuple[LinkTally, ...]
    on_masses: list[jax.Array] | None = None  # forces of no rod and no link, an instant before
    supports: tuple[jax.Array, ...] = ()  # their accelerations then

    @staticmethod
    def start(
        constants: StepConstants, system: System, zero: jax.Array, soft: bool, state: RunState
    ) -> Tally:
        """The tally of a run before the first instant, which has a state.

        ``soft`` adds the soft minimum of the gaps.
        """
        topology = system.topology
        closings = [along(ends, state.x) for ends in link_ends(system.links)]
        counter = jax.lax.stop_gradient(zero)  # numbers of instants have no derivatives
        softly = LogMeanExp(zero, zero, zero) if soft else None
        zeros = ContactTally(*(zero,) * len(ContactTally._fields))
        never = zeros._replace(
            first=zero + jnp.inf, since_touch=counter + WINDOW, since_end=counter + WINDOW
        )
        links = tuple(
            LinkTally(
                closing=closing,
                farthest=closing,
                farthest_time=zero,
                last_turn=closing,
                distance=zero,
                work=zero,
                instants_since_turn=counter,
                opened=closing if topology.n_supports else None,
                softly=softly,
                contact=None if link.contact is None else never,
            )
            for link, closing in zip(system.links, closings, strict=True)
        )
        peaks = partial(Peaks.start, zero, in_arrays=constants.plan.peaks_in_arrays)
        return Tally(
            ground=GroundPeaks(zero, zero, zero, zero),
            displacements=peaks(len(paths(constants, topology))),
            acceleration=peaks(topology.n_masses),
            forces=peaks(len(topology.rods)),
            first_yields=each(
                lambda _: zero + jnp.inf, (rod.yield_displacement for rod in constants.rods)
            ),
            links=links,
            on_masses=[zero] * topology.n_masses if constants.has_forces_on_masses else None,
            supports=(zero,) * topology.n_supports,
        )

    def observe(
        self, now: Instant, system: StepConstants, topology: Topology, last: Any, temperature: Any
    ) -> Tally:
        """Add one instant; ``last`` says whether the run ends with it."""
        dt = system.dt
        smooth = now.time > dt  # of three samples, all are of the run
        # Weights of the trapezoidal rule: half a step for the first instant and the last.
        share = jnp.where(last | (now.time <= 0), dt / 2, dt).astype(now.forces[0].dtype)
        links = tuple(
            link.observe(seen, now.time, share, last, temperature)
            for link, seen in zip(self.links, now.links, strict=True)
        )
        last_forces = [force.last for force in self.forces.each()]
        last = last_forces, self.on_masses, self.ground.last, self.supports
        instant = _Observed(now, system, smooth, links, *last)
        observed = paths(system, topology)
        displacements = self.displacements.observe([*map(instant.displacement, observed)])
        before, after = self.displacements.each(), displacements.each()
        accelerations = [*map(instant.acceleration, range(topology.n_masses))]
        return Tally(
            ground=self.ground.observe(now.ground, dt, now.time <= 0),
            displacements=displacements,
            acceleration=self.acceleration.observe(accelerations),
            forces=self.forces.observe([*map(instant.force, range(len(now.rods)))]),
            first_yields=each(
                partial(_first_yield, time=now.time, dt=dt),
                (rod.yield_displacement for rod in system.rods),
                self.first_yields,
                (before[i] for i in topology.elongations),
                (after[i] for i in topology.elongations),
            ),
            links=links,
            on_masses=now.on_masses,
            supports=now.supports,
        )

    def demand(
        self,
        constants: StepConstants,
        system: System,
        state: RunState,
        contacts: Sequence[Contact | None],
        set_valued: bool,
        temperature: Any,
    ) -> Demand:
        """The scalars of all instants; ``state`` is that after the last, with links' contacts.

        ``set_valued`` says that |q| = μ in any slip.
        """
        slip_forces = [
            link.friction if set_valued and not link.velocity_friction else None
            for link in system.links
        ]
        topology, displacements = system.topology, self.displacements.each()
        peaks = [displacements[i] for i in topology.elongations]
        scalars = [
            law.scalars(end, peak.largest, peak.last)
            for law, end, peak in zip(constants.rods, state.rods, peaks, strict=True)
        ]
        storeys = zip(topology.rods, peaks, strict=True)
        drifts = [peak.largest if is_storey(ends) else None for ends, peak in storeys]
        return Demand(
            masses=tuple(
                MassDemand(peak_x=x.largest, peak_acceleration=a.largest)
                for x, a in zip(displacements, self.acceleration.each(), strict=False)
            ),
            rods=tuple(
                RodDemand(force.largest, drift, first_yield_time=first, **more)
                for force, drift, first, more in zip(
                    self.forces.each(), drifts, self.first_yields, scalars, strict=True
                )
            ),
            links=tuple(
                tally.demand(link, end, slip_force, temperature)
                for tally, link, end, slip_force in zip(
                    self.links, system.links, contacts, slip_forces, strict=True
                )
            ),
            pga=self.ground.largest,
            pgv=self.ground.largest_velocity,
            topology=topology,
        )
