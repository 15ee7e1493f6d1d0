"""The scalars of a run, accumulated instant by instant.

What happens between instants counts: the gap is smallest where the slip velocity vanishes, smooth
series peak at the vertex of a parabola, and forces jump where slip ends. So the scalars are as
accurate as the response, second order in the step, and so are their derivatives. Exceptions are
accelerations that peak next to a jump of friction (their derivatives), and PGA and PGV, which are
taken at the grid's instants.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jaxpound._extrema import larger
from jaxpound.model.system import System, Topology, load_on
from jaxpound.results.demand import Demand, LinkDemand, MassDemand, RodDemand
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
        turn = now.closing + now.motion.turn
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
            last_turn=jnp.where(turns, turn, self.last_turn),
            distance=self.distance + jnp.where(turns, jnp.abs(turn - self.last_turn), 0.0),
            work=self.work + share * now.motion.force * now.velocity,
            calm=jnp.where(now.motion.turns, 0.0, self.calm + 1),
            softly=softly,
        )

    def demand(self, gap: jax.Array, slip_force: jax.Array | None, temperature: Any) -> LinkDemand:
        """The scalars of the link, with its ``gap`` at rest.

        ``slip_force`` is μ if |q| = μ in any slip, which makes the work exact, else None.
        """
        distance = self.distance + jnp.abs(self.closing - self.last_turn)
        soft = self.softly
        return LinkDemand(
            min_gap=gap - self.farthest,
            min_gap_time=self.farthest_time,
            slip_distance=distance,
            friction_work=self.work if slip_force is None else slip_force * distance,
            residual_offset=-self.closing,
            soft_min_gap=None if soft is None else gap - temperature * soft.value(),
        )


class Tally(NamedTuple):
    """Running values for a ``Demand``."""

    ground: GroundPeaks
    x: tuple[Peak, ...]
    acceleration: tuple[Peak, ...]
    forces: tuple[Peak, ...]  # of the rods
    links: tuple[LinkTally, ...]

    @staticmethod
    def start(topology: Topology, zero: jax.Array, soft: bool) -> Tally:
        """Nothing has happened yet; ``soft`` asks for the soft minimum of the gaps as well."""
        peak = Peak(zero, zero, zero)
        softly = LogMeanExp(zero, zero, zero) if soft else None
        link = LinkTally(zero, zero, zero, zero, zero, zero, zero, softly)
        return Tally(
            ground=GroundPeaks(zero, zero, zero, zero),
            x=(peak,) * topology.n_masses,
            acceleration=(peak,) * topology.n_masses,
            forces=(peak,) * len(topology.rods),
            links=(link,) * len(topology.links),
        )

    def observe(
        self, now: Instant, system: Elements, dt: float, last: jax.Array, temperature: Any
    ) -> Tally:
        """Take one instant into account; ``last`` tells whether the run ends with it."""
        # Weights of the trapezoidal rule: half a step for the first instant and the last.
        share = jnp.where(last | (now.time <= 0), dt / 2, dt).astype(now.forces[0].dtype)
        turns = [link.motion.turns & (~last | (link.motion.turn_time <= 0)) for link in now.links]
        links = tuple(
            link.observe(seen, turned, now.time, share, last, temperature)
            for link, seen, turned in zip(self.links, now.links, turns, strict=True)
        )
        x = of_all_masses(system.topology, now.x, [link.closing for link in now.links])
        return Tally(
            ground=self.ground.observe(now.ground_acceleration, dt, now.time <= 0),
            x=tuple(peak.observe(value) for peak, value in zip(self.x, x, strict=True)),
            acceleration=tuple(
                self._acceleration(mass, now, system, turns, links, dt)
                for mass in range(system.topology.n_masses)
            ),
            forces=tuple(
                peak.observe(force) for peak, force in zip(self.forces, now.forces, strict=True)
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
    ) -> Peak:
        """A mass's peak acceleration: it jumps with the friction of the mass's link."""
        topology, inverse = system.topology, system.inverse_masses[mass]
        load, peak = load_on(topology.rods, mass, now.forces), self.acceleration[mass]
        for ends, link, seen, turned in zip(topology.links, links, now.links, turns, strict=True):
            if mass not in ends:
                continue
            sign = -1.0 if mass == ends[0] else 1.0
            motion = seen.motion
            late = jnp.where(turned, motion.turn_time / dt, 0.0)
            before = load_on(topology.rods, mass, [force.last for force in self.forces])
            at_turn = load + (load - before) * late
            return peak.observe((load + sign * motion.force) * inverse, link.calm >= 3).reaching(
                *(
                    (at_turn + sign * jnp.where(turned, q, motion.force)) * inverse
                    for q in motion.turn_forces
                )
            )
        return peak.observe(load * inverse)

    def demand(self, system: System, set_valued: bool, temperature: Any) -> Demand:
        """The scalars of the instants observed; ``set_valued`` says that |q| = μ in any slip."""
        return Demand(
            masses=tuple(
                MassDemand(peak_x=x.largest, peak_acceleration=a.largest)
                for x, a in zip(self.x, self.acceleration, strict=True)
            ),
            rods=tuple(RodDemand(peak_force=force.largest) for force in self.forces),
            links=tuple(
                tally.demand(link.gap, link.friction if set_valued else None, temperature)
                for tally, link in zip(self.links, system.links, strict=True)
            ),
            pga=self.ground.largest,
            pgv=self.ground.largest_velocity,
        )
