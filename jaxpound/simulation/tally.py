"""The scalars of a run, accumulated instant by instant.

Events between instants count: the gap is smallest where the slip velocity vanishes, smooth
series peak at the vertex of a parabola, and forces jump where slip ends. So the scalars and their
derivatives are second-order accurate in the step. Exceptions are derivatives of accelerations that
peak next to a jump of friction, and PGA and PGV, which are taken at the grid's instants.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jaxpound.model.dampers import Dashpot
from jaxpound.model.system import System
from jaxpound.model.topology import GROUND, Ends, elongation, is_storey, link_groups, load_on
from jaxpound.results.demand import Demand
from jaxpound.results.element_demands import MassDemand, RodDemand
from jaxpound.simulation.link_tally import WINDOW, ContactTally, LinkTally, LogMeanExp
from jaxpound.simulation.peaks import GroundPeaks, Peak, Peaks, Sample
from jaxpound.simulation.starting import RunStart
from jaxpound.simulation.state import Instant, RunState, StepConstants, each, of_all_masses
from jaxpound.simulation.yielding import HysteresisConstants, HysteresisState, time_until


class _ObservedInstant(NamedTuple):
    """An instant as peaks are observed in it."""

    now: Instant
    x: Sequence[jax.Array]  # of all masses
    v: Sequence[jax.Array]
    system: StepConstants
    dt: float
    smooth: Any  # whether no jump of all series is among the last three samples
    turns: list[jax.Array]  # by link: whether its slip velocity vanishes near the instant
    links: tuple[LinkTally, ...]  # with this instant
    last_forces: Sequence[jax.Array]  # of the rods, an instant before
    last_acceleration: jax.Array

    def displacement(self, ends: Ends) -> Sample:
        """x_i − x_j, or x_i where j is the ground; impacts are kinks of the path."""
        position, speed = elongation(ends, self.x), elongation(ends, self.v)
        kinks, reached = [], []
        groups = enumerate(link_groups(self.system.topology))
        for number, group in groups:
            mass_shares = self.system.mass_shares.get(number)
            if mass_shares is None or not {*ends} & {*group.masses}:
                continue
            tallied = [self.links[k].contact for k in group.links]
            kinks += [contact.is_kink for contact in tallied if contact is not None]
            motions = [self.now.links[k].motion.contact for k in group.links]
            if motions[0] is None:  # a step without flow
                continue
            touched = [motion.result.log.touched > 0 for motion in motions]
            for n, k in enumerate(group.links[: len(group.hanging)]):
                link = self.now.links[k]
                # The closing at its turn in the step, as far as its own change moves the masses.
                shares = {mass: share[n] for mass, share in mass_shares.items()}
                share = elongation(ends, [shares.get(mass, 0.0) for mass in range(len(self.x))])
                late, met = link.motion.turn_time, touched[n]
                for i, link_of_face in enumerate(group.faces):
                    met |= touched[len(group.hanging) + i] if link_of_face == n else False
                drift = late * (speed - share * link.velocity)
                turned = position + drift + share * link.motion.turn
                reached.append(jnp.where(met, turned, position))
        smooth = self.smooth & ~jnp.stack(kinks).any() if kinks else self.smooth
        return Sample(position, smooth, reached)

    def acceleration(self, mass: int) -> Sample:
        """A mass's acceleration: it jumps with the friction of the mass's link."""
        topology, inverse = self.system.topology, self.system.inverse_masses[mass]
        load = load_on(topology.rods, mass, self.now.forces)
        before = load_on(topology.rods, mass, self.last_forces)
        signs = {
            k: -1.0 if mass == ends[0] else 1.0
            for k, ends in enumerate(topology.links)
            if mass in ends
        }
        if self.system.inerters is not None:  # by which other links of the group act on it, too
            groups = (group for group in link_groups(topology) if mass in group.masses)
            signs = {k: 0.0 for group in groups for k in group.links} | signs
        if not signs:
            return Sample(load * inverse, self.smooth)
        motions = {k: self.now.links[k].motion for k in signs}
        totals = {k: sign * motions[k].total_force for k, sign in signs.items()}
        others = sum(totals.values())
        now = self.with_inertia(load + others, signs)
        settled = [self.links[k].instants_since_turn >= WINDOW for k in signs]
        smooth = self.smooth & jnp.stack(settled).all()
        reached = []
        for k, sign in signs.items():
            turned, motion, flow = self.turns[k], motions[k], motions[k].contact
            late = jnp.where(turned, motion.turn_time / self.dt, 0.0)
            if flow is not None:
                (group,) = (group.links for group in link_groups(topology) if k in group.links)
                log = flow.result.log
                at_peak = sum(signs[i] * log.highest_forces[group.index(i)] for i in signs)
                time = log.highest_time / self.dt
                at_highest = load + (load - before) * time + at_peak
                forces = dict(zip(group, log.highest_forces, strict=True))
                at_highest = self.with_inertia(at_highest, signs, time, forces)
                reached.append(jnp.where(log.highest > 0, at_highest, now) * inverse)
                late = jnp.where(flow.used, 0.0, late)
            at_turn = load + (load - before) * late
            for q in motion.turn_forces:
                other = jnp.where(turned, sign * q + others - totals[k], others)
                if flow is not None:
                    other = jnp.where(flow.used, others, other)
                reached.append((at_turn + other) * inverse)
                if self.system.inerters is not None:
                    q = jnp.where(turned, q, motion.force)
                    if flow is not None:
                        q = jnp.where(flow.used, motion.total_force, q)
                    reached[-1] = self.with_inertia(at_turn + other, signs, late, {k: q}) * inverse
        return Sample(now * inverse, smooth, reached)

    def with_inertia(
        self,
        load: jax.Array,
        signs: dict[int, float],
        late: Any = 0.0,
        changed: Mapping[int, jax.Array] = MappingProxyType({}),
    ) -> jax.Array:
        """A load on a mass with that of inerters, steps after now, as links change their forces."""
        if self.system.inerters is None:
            return load
        rods = zip(self.now.forces, self.last_forces, strict=True)
        forces = [force + (force - last) * late for force, last in rods]
        acceleration = self.now.ground_acceleration
        acceleration = acceleration + (acceleration - self.last_acceleration) * late
        links = enumerate(self.now.links)
        totals = [changed.get(k, link.motion.total_force) for k, link in links]
        inertia = self.system.inerter_forces(forces, acceleration, totals)
        return load + sum(sign * inertia[k] for k, sign in signs.items() if k in inertia)


def _first_yield(
    law: HysteresisConstants, first: jax.Array, before: Peak, peak: Peak, time: jax.Array, dt: float
) -> jax.Array:
    """When a rod yields first, by the peaks of its elongation until the instant before and now."""
    if isinstance(law.law, Dashpot):
        return first
    limit = law.law.yield_displacement
    yields = (before.largest < limit) & (peak.largest >= limit)
    # As the parabola through the last three elongations passes the limit.
    side = jnp.where(peak.last < 0, -1.0, 1.0).astype(peak.last.dtype)
    gain = side * (peak.rise - before.rise)
    speed = side * peak.rise + gain / 2
    late, _ = time_until(limit - side * peak.last, speed, gain)
    late = jnp.where((late <= 0) & (late >= -1), late, 0.0)
    return jnp.where(yields, time + dt * late, first)


def _yield_demands(
    law: HysteresisConstants, end: HysteresisState, peak: Peak, first: jax.Array
) -> dict[str, jax.Array]:
    """The scalars of a rod that yields, with its state at the ``end``; of a damper its energy."""
    if isinstance(law.law, Dashpot):
        return {"dissipated_energy": law.dissipated(end)}
    largest, reduced = peak.largest, law.law.reduced_force(end.elongation, end.of_law)
    return {
        "ductility": largest / law.law.yield_displacement,
        "residual_drift": jnp.abs(peak.last - reduced),
        "dissipated_energy": law.dissipated(end),
        "first_yield_time": first,
        "collapsed": 0 * largest + (largest > law.ultimate).astype(largest.dtype),
    }


class Tally(NamedTuple):
    """Running values for a ``Demand``."""

    ground: GroundPeaks
    displacements: Peaks  # of the ``observed_ends``
    acceleration: Peaks  # of the masses
    forces: Peaks  # of the rods
    first_yields: tuple[jax.Array | None, ...]  # times, of rods that yield
    links: tuple[LinkTally, ...]

    @staticmethod
    def start(
        constants: StepConstants,
        system: System,
        zero: jax.Array,
        soft: bool,
        closings: Sequence[jax.Array],
    ) -> Tally:
        """The tally before the first instant; ``soft`` adds the soft minimum of the gaps.

        ``closings`` are those of all links before the run.
        """
        topology = system.topology
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
                softly=softly,
                contact=None if link.contact is None else never,
            )
            for link, closing in zip(system.links, closings, strict=True)
        )
        peaks = partial(Peaks.start, zero, in_arrays=constants.plan.peaks_in_arrays)
        return Tally(
            ground=GroundPeaks(zero, zero, zero, zero),
            displacements=peaks(len(topology.observed_ends)),
            acceleration=peaks(topology.n_masses),
            forces=peaks(len(topology.rods)),
            first_yields=each(lambda _: zero + jnp.inf, constants.hysteresis),
            links=links,
        )

    def observe(
        self,
        now: Instant,
        system: StepConstants,
        starting: RunStart,
        dt: float,
        last: jax.Array,
        temperature: Any,
    ) -> Tally:
        """Add one instant; ``last`` says whether the run ends with it."""
        smooth = starting.smooth(now.time, dt)
        # Weights of the trapezoidal rule: half a step for the first instant and the last.
        share = jnp.where(last | (now.time <= 0), dt / 2, dt).astype(now.forces[0].dtype)
        turns = [link.motion.turns & (~last | (link.motion.turn_time <= 0)) for link in now.links]
        links = tuple(
            link.observe(seen, turned, now.time, share, last, temperature)
            for link, seen, turned in zip(self.links, now.links, turns, strict=True)
        )
        topology = system.topology
        x = of_all_masses(topology, now.x, [link.closing for link in now.links])
        v = of_all_masses(topology, now.v, [link.velocity for link in now.links])
        last_forces = [force.last for force in self.forces.each()]
        instant = _ObservedInstant(
            now, x, v, system, dt, smooth, turns, links, last_forces, self.ground.last
        )
        paths = topology.observed_ends
        displacements = self.displacements.observe([*map(instant.displacement, paths)])
        places = [paths.index(ends) for ends in topology.rods]
        before, after = self.displacements.each(), displacements.each()
        observed = Tally(
            ground=self.ground.observe(now.ground_acceleration, dt, now.time <= 0),
            displacements=displacements,
            acceleration=self.acceleration.observe(
                [*map(instant.acceleration, range(topology.n_masses))]
            ),
            forces=self.forces.observe([Sample(force, smooth) for force in now.forces]),
            first_yields=each(
                partial(_first_yield, time=now.time, dt=dt),
                system.hysteresis,
                self.first_yields,
                (before[i] for i in places),
                (after[i] for i in places),
            ),
            links=links,
        )
        return starting.kept(now.time, self, observed)

    def demand(
        self,
        constants: StepConstants,
        system: System,
        state: RunState,
        set_valued: bool,
        temperature: Any,
    ) -> Demand:
        """The scalars of all instants; ``state`` is that after the last.

        ``set_valued`` says that |q| = μ in any slip.
        """
        slip_forces = [
            link.friction if set_valued and not link.velocity_friction else None
            for link in system.links
        ]
        topology, rods = system.topology, system.topology.rods
        paths = dict(zip(topology.observed_ends, self.displacements.each(), strict=True))
        peaks = [paths[ends] for ends in rods]
        yielded = each(
            _yield_demands, constants.hysteresis, state.yielding, peaks, self.first_yields
        )
        drifts = [paths[ends].largest if is_storey(ends) else None for ends in rods]
        return Demand(
            masses=tuple(
                MassDemand(peak_x=paths[mass, GROUND].largest, peak_acceleration=a.largest)
                for mass, a in enumerate(self.acceleration.each())
            ),
            rods=tuple(
                RodDemand(peak_force=force.largest, peak_drift=drift, **(more or {}))
                for force, drift, more in zip(self.forces.each(), drifts, yielded, strict=True)
            ),
            links=tuple(
                tally.demand(link.gap, end.contact and end.contact.contact, slip_force, temperature)
                for tally, link, end, slip_force in zip(
                    self.links, system.links, state.links, slip_forces, strict=True
                )
            ),
            pga=self.ground.largest,
            pgv=self.ground.largest_velocity,
            topology=topology,
        )
