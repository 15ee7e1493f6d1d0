"""The scalars of a run, accumulated instant by instant.

What happens between instants counts: the gap is smallest where the slip velocity vanishes, smooth
series peak at the vertex of a parabola, and forces jump where slip ends. So the scalars are as
accurate as the response, second order in the step, and so are their derivatives. Exceptions are
accelerations that peak next to a jump of friction (their derivatives), and PGA and PGV, which are
taken at the grid's instants.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jaxpound._extrema import larger
from jaxpound.model.system import (
    GROUND,
    Ends,
    System,
    elongation,
    is_storey,
    link_groups,
    load_on,
)
from jaxpound.results.demand import Demand, LinkDemand, MassDemand, RodDemand
from jaxpound.simulation.contact import ContactMotion
from jaxpound.simulation.forces import APART, is_deformed
from jaxpound.simulation.friction import LinkMotion
from jaxpound.simulation.passage import SOFT, UnderWay
from jaxpound.simulation.stepping import Elements, Instant, LinkInstant, of_all_masses


class Peak(NamedTuple):
    """Largest absolute value of a series, between its samples too where it is smooth."""

    largest: jax.Array
    last: jax.Array
    rise: jax.Array  # from the sample before to the last

    def observe(self, y: jax.Array, smooth: jax.Array | bool = True) -> Peak:
        """The peak with one more sample; ``smooth`` says that no jump is among the last three."""
        rise = y - self.last
        # The parabola through them turns within half a step of the middle one; exactly half a step
        # where two of them tie.
        up, down = (self.rise >= 0) & (rise <= 0), (self.rise <= 0) & (rise >= 0)
        arch = smooth & (up | down) & (rise != self.rise)
        bend = jnp.where(arch, rise - self.rise, 1.0)
        vertex = jnp.where(arch, self.last - (self.rise + rise) ** 2 / (8 * bend), y)
        largest = larger(self.largest, larger(jnp.abs(y), jnp.abs(vertex)))
        return Peak(largest, y, rise)

    def reaching(self, *values: jax.Array) -> Peak:
        """The peak with further values, not samples, taken into account."""
        largest = self.largest
        for value in values:
            largest = larger(largest, jnp.abs(value))
        return self._replace(largest=largest)


class LogMeanExp(NamedTuple):
    """log of the mean of e^z over time: largest z so far, sum of e^(z − largest), and time."""

    largest: jax.Array
    total: jax.Array
    time: jax.Array

    def observe(self, z: jax.Array, share: jax.Array) -> LogMeanExp:
        """One more value, which stands for a time ``share``."""
        # Which z is the largest does not change the result, nor its derivative.
        largest = jax.lax.stop_gradient(jnp.maximum(self.largest, z))
        total = self.total * jnp.exp(self.largest - largest) + share * jnp.exp(z - largest)
        return LogMeanExp(largest, total, self.time + share)

    def value(self) -> jax.Array:
        """The result."""
        return self.largest + jnp.log(self.total / self.time)


class GroundPeaks(NamedTuple):
    """Largest ground acceleration and velocity at the instants, from rest."""

    last: jax.Array  # u''
    velocity: jax.Array
    largest: jax.Array
    largest_velocity: jax.Array

    def observe(self, a: jax.Array, dt: float, starts: jax.Array) -> GroundPeaks:
        """The peaks with one more acceleration, the first of all if the run ``starts``."""
        gained = jnp.where(starts, 0.0, dt * (self.last + a) / 2)
        velocity = self.velocity + gained
        return GroundPeaks(
            a,
            velocity,
            larger(self.largest, jnp.abs(a)),
            larger(self.largest_velocity, jnp.abs(velocity)),
        )


class ContactTally(NamedTuple):
    """Running values for the scalars of a link's contact."""

    highest: jax.Array  # largest force
    strongest: jax.Array  # largest impulse
    touches: jax.Array  # impacts that began
    first: jax.Array  # when the first did
    lost: jax.Array  # energy until t_m + h/2
    stored: jax.Array
    lost_now: jax.Array  # until t_m
    stored_now: jax.Array
    powers: jax.Array  # sum of the powers ``SOFT`` of the peak forces of impacts that ended
    slid: jax.Array  # distance until t_m
    since_touch: jax.Array  # instants passed since an impact began
    since_end: jax.Array  # and since one ended
    mode: jax.Array  # of contact at t_m, as in ``forces``
    counts: jax.Array  # whether the contact under way at t_m counts as an impact
    under_way: UnderWay  # at t_m, with the time of the run

    @property
    def is_kink(self) -> jax.Array:
        """Whether an impact has begun and ended within the last three instants."""
        return (self.since_touch < 3) & (self.since_end < 3)

    def observe(self, seen: ContactMotion, time: jax.Array, last: jax.Array) -> ContactTally:
        """Take one step into account; of the last one only what was before its middle."""
        now, record = seen.passed.now, seen.passed.record
        late = last & (record.highest_time > 0)
        touches = jnp.where(last & (record.first_touch > 0), 0.0, record.touches)
        begins = (touches > 0) & (self.touches == 0)
        return self._replace(
            highest=larger(self.highest, jnp.where(late, now.contact, record.highest)),
            strongest=larger(self.strongest, jnp.where(last, now.strongest, record.strongest)),
            touches=self.touches + touches,
            first=jnp.where(begins, time + record.first_touch, self.first),
            lost=self.lost + seen.passed.lost,
            stored=self.stored + seen.passed.stored,
            lost_now=self.lost + now.lost,
            stored_now=self.stored + now.stored,
            powers=self.powers + jnp.where(last, now.powers, record.powers),
            since_touch=jnp.where(record.touches > 0, 0.0, self.since_touch + 1),
            since_end=jnp.where(record.ended > 0, 0.0, self.since_end + 1),
            mode=now.mode,
            counts=now.counts,
            under_way=now.under_way,
        )


class LinkTally(NamedTuple):
    """Running values for the scalars of a link."""

    closing: jax.Array
    farthest: jax.Array  # largest closing, where the gap is smallest
    farthest_time: jax.Array
    last_turn: jax.Array  # closing where the slip velocity vanished last
    distance: jax.Array  # slid until then
    work: jax.Array  # ∫ q w dt by the trapezoidal rule
    calm: jax.Array  # instants passed since the slip velocity vanished last
    softly: LogMeanExp | None  # of closing / temperature
    contact: ContactTally | None  # of a link that may touch

    def observe(
        self,
        now: LinkInstant,
        turns: jax.Array,
        time: jax.Array,
        share: jax.Array,
        last: jax.Array,
        temperature: Any,
    ) -> LinkTally:
        """Take one instant into account; ``last`` tells whether the run ends with it.

        ``turns`` says whether the slip velocity vanishes near it, and ``share`` is the time that it
        stands for.
        """
        turn, seen = now.closing + now.motion.turn, now.motion.contact
        # Where contact acts there may be several turns in a step.
        first, final, between = turn, turn, 0.0
        calm = jnp.where(now.motion.turns, 0.0, self.calm + 1)
        if seen is not None:
            record = seen.passed.record
            first, final = (
                jnp.where(seen.used, x, turn) for x in (record.first_turn, record.last_turn)
            )
            between = record.between
            turn = jnp.where(seen.used, record.farthest, turn)
            calm = jnp.where(seen.used & (record.highest_time != 0), 0.0, calm)
        distance = self.distance + jnp.where(turns, jnp.abs(first - self.last_turn) + between, 0.0)
        last_turn = jnp.where(turns, final, self.last_turn)
        contact = self.contact
        if contact is not None:
            passed = turns & (now.motion.turn_time <= 0)
            slid = jnp.where(passed, distance, self.distance) + jnp.abs(
                now.closing - jnp.where(passed, last_turn, self.last_turn)
            )
            contact = contact.observe(seen, time, last)._replace(slid=slid)
        higher = turns & (turn > self.farthest)
        farthest = jnp.where(higher, turn, self.farthest)
        farthest_time = jnp.where(higher, time + now.motion.turn_time, self.farthest_time)
        # The run's end counts only if the link slips there: in stick the largest closing was at the
        # stop before, from which the closing since differs by the error of a step.
        ends = last & (now.velocity > 0) & (now.closing > farthest)
        softly = self.softly
        if softly is not None:
            softly = softly.observe(now.closing / temperature, jnp.where(time < 0, 0.0, share))
        return LinkTally(
            closing=now.closing,
            farthest=jnp.where(ends, now.closing, farthest),
            farthest_time=jnp.where(ends, time, farthest_time),
            last_turn=last_turn,
            distance=distance,
            work=self.work + share * now.motion.force * now.velocity,
            calm=calm,
            softly=softly,
            contact=contact,
        )

    def demand(
        self,
        gap: jax.Array,
        slip_force: jax.Array | None,
        temperature: Any,
    ) -> LinkDemand:
        """The scalars of the link, with its ``gap`` at rest.

        ``slip_force`` is μ if |q| = μ in any slip, which makes the work exact, else None.
        """
        distance = self.distance + jnp.abs(self.closing - self.last_turn)
        soft, contact = self.softly, self.contact
        demand = LinkDemand(
            min_gap=gap - self.farthest,
            min_gap_time=self.farthest_time,
            slip_distance=distance,
            friction_work=self.work if slip_force is None else slip_force * distance,
            residual_offset=-self.closing,
            soft_min_gap=None if soft is None else gap - temperature * soft.value(),
        )
        if contact is None:
            return demand
        # The contact in which the run ends.
        counts, last = (contact.mode != APART) & (contact.counts > 0), contact.under_way
        powers = contact.powers + jnp.where(counts, last.peak_force**SOFT, 0.0)
        deformed = counts & is_deformed(contact.mode)
        hit = powers > 0
        return dataclasses.replace(
            demand,
            peak_contact=contact.highest,
            peak_impulse=larger(contact.strongest, jnp.where(deformed, last.impulse, 0.0)),
            peak_penetration=jnp.where(demand.min_gap < 0, -demand.min_gap, 0.0),
            n_impacts=contact.touches,
            first_impact_time=contact.first,
            contact_work=contact.lost_now,
            soft_peak_contact=jnp.where(hit, jnp.where(hit, powers, 1.0) ** (1 / SOFT), 0.0),
        )


def _total_force(motion: LinkMotion) -> jax.Array:
    """The force q + p at t_m."""
    if motion.contact is None:
        return motion.force
    return motion.force + motion.contact.passed.now.contact


def _displaced(
    peak: Peak,
    ends: Ends,
    x: Sequence[Any],
    v: Sequence[Any],
    now: Instant,
    system: Elements,
    links: tuple[LinkTally, ...],
    smooth: Any,
) -> Peak:
    """The peak of x_i − x_j, or of x_i where j is the ground: at an impact the path has a kink."""
    here, speed = elongation(ends, x), elongation(ends, v)
    kinks, reached = [], []
    for group, coupled in zip(link_groups(system.topology), system.couplings, strict=True):
        if coupled is None or not {*ends} & {*group.masses}:
            continue
        for n, k in enumerate(group.links):
            contact, link = links[k].contact, now.links[k]
            if contact is not None:
                kinks.append(contact.is_kink)
            # Where a closing turned in the step, as far as its own change moves the masses.
            shares = [coupled.shifts[m][n] if m in group.masses else 0.0 for m in range(len(x))]
            share = elongation(ends, shares)
            late, met = link.motion.turn_time, link.motion.contact.passed.record.touched > 0
            drift = late * (speed - share * link.velocity)
            reached.append(jnp.where(met, here + drift + share * link.motion.turn, here))
    if not kinks:
        return peak.observe(here, smooth)
    return peak.observe(here, smooth & ~jnp.stack(kinks).any()).reaching(*reached)


class Tally(NamedTuple):
    """Running values for a ``Demand``."""

    ground: GroundPeaks
    x: tuple[Peak, ...]
    acceleration: tuple[Peak, ...]
    forces: tuple[Peak, ...]  # of the rods
    drifts: tuple[Peak | None, ...]  # of those between two masses
    links: tuple[LinkTally, ...]

    @staticmethod
    def start(system: System, zero: jax.Array, soft: bool, closings: Sequence[jax.Array]) -> Tally:
        """Nothing has happened yet; ``soft`` asks for the soft minimum of the gaps as well.

        ``closings`` are those of all links before the run.
        """
        topology, peak = system.topology, Peak(zero, zero, zero)
        softly = LogMeanExp(zero, zero, zero) if soft else None
        apart = UnderWay(*(zero,) * 4)
        start = (*(zero,) * 3, zero + jnp.inf, *(zero,) * 6, zero + 3, zero + 3, zero, zero)
        never = ContactTally(*start, apart)
        links = tuple(
            LinkTally(
                *(closing, closing, zero, closing, zero, zero, zero),
                softly,
                None if link.contact is None else never,
            )
            for link, closing in zip(system.links, closings, strict=True)
        )
        return Tally(
            ground=GroundPeaks(zero, zero, zero, zero),
            x=(peak,) * topology.n_masses,
            acceleration=(peak,) * topology.n_masses,
            forces=(peak,) * len(topology.rods),
            drifts=tuple(peak if is_storey(ends) else None for ends in topology.rods),
            links=links,
        )

    def observe(
        self, now: Instant, system: Elements, dt: float, last: jax.Array, temperature: Any
    ) -> Tally:
        """Take one instant into account; ``last`` tells whether the run ends with it.

        A run that does not start at rest has nothing before t = 0, and no parabola through it.
        """
        if system.relaxed is None:
            return self._observed(now, system, dt, last, temperature, True)
        found = self._observed(now, system, dt, last, temperature, now.time > dt)
        return jax.tree.map(lambda old, new: jnp.where(now.time < 0, old, new), self, found)

    def _observed(
        self,
        now: Instant,
        system: Elements,
        dt: float,
        last: jax.Array,
        temperature: Any,
        smooth: Any,
    ) -> Tally:
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

        def observed(peak: Peak, ends: Ends) -> Peak:
            return _displaced(peak, ends, x, v, now, system, links, smooth)

        return Tally(
            ground=self.ground.observe(now.ground_acceleration, dt, now.time <= 0),
            x=tuple(observed(peak, (mass, GROUND)) for mass, peak in enumerate(self.x)),
            acceleration=tuple(
                self._acceleration(mass, now, system, turns, links, dt, smooth)
                for mass in range(topology.n_masses)
            ),
            forces=tuple(
                peak.observe(force, smooth)
                for peak, force in zip(self.forces, now.forces, strict=True)
            ),
            drifts=tuple(
                None if peak is None else observed(peak, ends)
                for peak, ends in zip(self.drifts, topology.rods, strict=True)
            ),
            links=links,
        )

    def _acceleration(
        self,
        mass: int,
        now: Instant,
        system: Elements,
        turns: list[jax.Array],
        links: tuple[LinkTally, ...],
        dt: float,
        smooth: Any,
    ) -> Peak:
        """A mass's peak acceleration: it jumps with the friction of the mass's link."""
        topology, inverse = system.topology, system.inverse_masses[mass]
        load, peak = load_on(topology.rods, mass, now.forces), self.acceleration[mass]
        before = load_on(topology.rods, mass, [force.last for force in self.forces])
        signs = {
            k: -1.0 if mass == ends[0] else 1.0
            for k, ends in enumerate(topology.links)
            if mass in ends
        }
        if not signs:
            return peak.observe(load * inverse, smooth)
        totals = {k: sign * _total_force(now.links[k].motion) for k, sign in signs.items()}
        others = sum(totals.values())
        smooth &= jnp.stack([links[k].calm >= 3 for k in signs]).all()
        reached = []
        for k, sign in signs.items():
            motion, seen = now.links[k].motion, now.links[k].motion.contact
            late = jnp.where(turns[k], motion.turn_time / dt, 0.0)
            if seen is not None:
                (group,) = (one.links for one in link_groups(topology) if k in one.links)
                record = seen.passed.record
                at_peak = sum(signs[i] * record.highest_forces[group.index(i)] for i in signs)
                there = load + (load - before) * record.highest_time / dt + at_peak
                reached.append(jnp.where(record.highest > 0, there, load + others) * inverse)
                late = jnp.where(seen.used, 0.0, late)
            at_turn = load + (load - before) * late
            for q in motion.turn_forces:
                other = jnp.where(turns[k], sign * q + others - totals[k], others)
                if seen is not None:
                    other = jnp.where(seen.used, others, other)
                reached.append((at_turn + other) * inverse)
        return peak.observe((load + others) * inverse, smooth).reaching(*reached)

    def demand(self, system: System, set_valued: bool, temperature: Any) -> Demand:
        """The scalars of the instants observed.

        ``set_valued`` says that |q| = μ in any slip.
        """
        return Demand(
            masses=tuple(
                MassDemand(peak_x=x.largest, peak_acceleration=a.largest)
                for x, a in zip(self.x, self.acceleration, strict=True)
            ),
            rods=tuple(
                RodDemand(
                    peak_force=force.largest, peak_drift=None if drift is None else drift.largest
                )
                for force, drift in zip(self.forces, self.drifts, strict=True)
            ),
            links=tuple(
                tally.demand(link.gap, link.friction if set_valued else None, temperature)
                for tally, link in zip(self.links, system.links, strict=True)
            ),
            pga=self.ground.largest,
            pgv=self.ground.largest_velocity,
            topology=system.topology,
        )
