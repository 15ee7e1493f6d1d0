"""The scalars of a run, folded over its instants as they pass.

What happens between instants counts: the gap is smallest where the slip velocity vanishes, smooth
series peak at the vertex of a parabola, and forces jump where slip ends. So the scalars are as
accurate as the response, second order in the step, and so are their derivatives, but for those of
an acceleration that peaks by a jump of friction, and of what is taken from the grid's instants, PGA
and PGV.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jaxpound._extrema import larger
from jaxpound.results.response import Demand


class Instant(NamedTuple):
    """The state of the system at one instant t_m, and what friction did around it."""

    time: jax.Array
    ground_acceleration: jax.Array
    x1: jax.Array
    slip: jax.Array  # x1 − x2
    v1: jax.Array
    slip_velocity: jax.Array
    f1: jax.Array
    f2: jax.Array
    friction: jax.Array
    turns: jax.Array  # whether the slip velocity vanishes within h/2 of t_m; then
    turn_time: jax.Array  # when, after t_m,
    turn: jax.Array  # by how much x1 − x2 differs there from its value at t_m,
    turn_friction: tuple[jax.Array, jax.Array]  # and the friction force before and after.
    phase: jax.Array  # direction of slip at t_m + h/2, 0 in stick
    change_time: jax.Array  # when that phase took over, if it differs from the last


class Peak(NamedTuple):
    """Largest absolute value of a series, between its samples too where it is smooth."""

    largest: jax.Array
    last: jax.Array
    rise: jax.Array  # from the sample before to the last

    def observe(self, y: jax.Array, smooth: jax.Array | bool = True) -> Peak:
        """The peak with one more sample; ``smooth`` says that the last three lie on one arc."""
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
        """One more value, held for a time ``share``."""
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


class Tally(NamedTuple):
    """A ``Demand`` in the making."""

    ground: GroundPeaks

    slip: jax.Array
    farthest: jax.Array  # largest x1 − x2, where the gap is smallest
    farthest_time: jax.Array
    last_turn: jax.Array  # x1 − x2 where the slip velocity vanished last
    distance: jax.Array  # slid until then
    work: jax.Array  # ∫ q w dt by the trapezoidal rule
    x1: Peak
    x2: Peak
    f1: Peak
    f2: Peak
    acceleration_1: Peak
    acceleration_2: Peak
    calm: jax.Array  # instants passed since the slip velocity vanished last
    softly: LogMeanExp | None  # of (x1 − x2) / temperature

    @staticmethod
    def start(zero: jax.Array, soft: bool) -> Tally:
        """Nothing has happened yet; ``soft`` asks for the soft minimum of the gap as well."""
        peaks = [Peak(zero, zero, zero)] * 6
        softly = LogMeanExp(zero, zero, zero) if soft else None
        ground = GroundPeaks(zero, zero, zero, zero)
        fields: list[Any] = [ground, *[zero] * 6, *peaks, zero, softly]
        return Tally(*fields)

    def observe(
        self,
        now: Instant,
        mass_ratio: jax.Array,
        dt: float,
        last: jax.Array,
        temperature: Any,
    ) -> Tally:
        """Take one instant into account; ``last`` tells whether the run ends with it."""
        turns = now.turns & (~last | (now.turn_time <= 0))
        turn = now.slip + now.turn
        higher = turns & (turn > self.farthest)
        farthest = jnp.where(higher, turn, self.farthest)
        farthest_time = jnp.where(higher, now.time + now.turn_time, self.farthest_time)
        # The run's end is the farthest only if the blocks slide there: where they stick, the stop
        # before was, and differs from the position since by the error of a step.
        ends = last & (now.slip_velocity > 0) & (now.slip > farthest)

        # Trapezoidal sums; the run starts at rest, and half of its first instant is before it.
        share = jnp.where(last | (now.time <= 0), dt / 2, dt).astype(now.x1.dtype)

        def accelerations(q: jax.Array, late: jax.Array) -> tuple[jax.Array, jax.Array]:
            f1 = now.f1 + (now.f1 - self.f1.last) * late
            f2 = now.f2 + (now.f2 - self.f2.last) * late
            return f1 + q, mass_ratio * (q - f2)

        a1, a2 = accelerations(now.friction, jnp.zeros_like(now.f1))
        calm = jnp.where(now.turns, 0.0, self.calm + 1)
        smooth = calm >= 3
        late = jnp.where(turns, now.turn_time / dt, 0.0)
        before, after = (
            accelerations(jnp.where(turns, q, now.friction), late) for q in now.turn_friction
        )
        softly = self.softly
        if softly is not None:
            softly = softly.observe(now.slip / temperature, jnp.where(now.time < 0, 0.0, share))
        return Tally(
            ground=self.ground.observe(now.ground_acceleration, dt, now.time <= 0),
            slip=now.slip,
            farthest=jnp.where(ends, now.slip, farthest),
            farthest_time=jnp.where(ends, now.time, farthest_time),
            last_turn=jnp.where(turns, turn, self.last_turn),
            distance=self.distance + jnp.where(turns, jnp.abs(turn - self.last_turn), 0.0),
            work=self.work + share * now.friction * now.slip_velocity,
            x1=self.x1.observe(now.x1),
            x2=self.x2.observe(now.x1 - now.slip),
            f1=self.f1.observe(now.f1),
            f2=self.f2.observe(now.f2),
            acceleration_1=self.acceleration_1.observe(a1, smooth).reaching(before[0], after[0]),
            acceleration_2=self.acceleration_2.observe(a2, smooth).reaching(before[1], after[1]),
            calm=calm,
            softly=softly,
        )

    def demand(
        self, initial_gap: jax.Array, slip_force: jax.Array | None, temperature: Any
    ) -> Demand:
        """The scalars of the instants seen.

        ``slip_force`` is the force in any slip, where there is one: its work is exact then.
        """
        distance = self.distance + jnp.abs(self.slip - self.last_turn)
        soft = self.softly
        return Demand(
            min_gap=initial_gap - self.farthest,
            min_gap_time=self.farthest_time,
            peak_x1=self.x1.largest,
            peak_x2=self.x2.largest,
            peak_f1=self.f1.largest,
            peak_f2=self.f2.largest,
            peak_acceleration_1=self.acceleration_1.largest,
            peak_acceleration_2=self.acceleration_2.largest,
            slip_distance=distance,
            friction_work=self.work if slip_force is None else slip_force * distance,
            residual_offset=-self.slip,
            pga=self.ground.largest,
            pgv=self.ground.largest_velocity,
            soft_min_gap=None if soft is None else initial_gap - temperature * soft.value(),
        )
