r"""The local flow: links that share masses over one step, from event to event.

Within a step the links see only the pull A(t) of the rods and the ground, linear in time:

    s'' = A(t) − G (q + p),    q ∈ μ Sgn(s'),    p = p(s − ξ0, s'),    G = B_lᵀ M⁻¹ B_l,

with closings s, friction q and contact forces p. The flow solves this small problem event by event
(``events``). Between events the motion is smooth. Where all forces are linear in the closings and
their velocities it is a power series in time, a cubic where no contact is deformed. Else an
embedded Runge–Kutta method of order 8 integrates it. The stiffness of a contact sets the substeps,
never the step of the run. Both give the links at any time of a substep, and so locate events by
Newton steps in time. Their slope is recomputed, but not differentiated, so that the derivative of
the last step is that of the event's instant.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxpound._extrema import larger, smaller
from jaxpound.simulation.contact import events, records
from jaxpound.simulation.contact.dop853 import coefficients, error, weighted
from jaxpound.simulation.contact.events import FlowState, Occurrence, Place, SmoothState, Snapshot
from jaxpound.simulation.contact.forces import Forces, LinkLaws, Regime, times
from jaxpound.simulation.contact.records import PRESSED, FlowInput, FlowResult, MidStep, StepLog
from jaxpound.simulation.contact.substeps import Integrated, PowerSeries
from jaxpound.simulation.contact.zeros import first_zero

_MOST_ITERATIONS = 4000  # iterations in a step
_AT_ONCE = 1e-10  # share of a step within which events are at the same instant
_NEAR = 0.05  # longest Newton step to an event, as a share of the substep
_NEWTON_STEPS = 3  # Newton steps to an event
_SOON = 1e-3  # share of a substep within which a motion is that of its start
_JUST = 1.001  # length of a substep that should end just beyond an event, in units of its time
_ORDER, _LONGEST = 12, 0.8  # of a series, and of a substep by it in units of 1/rate


class _First(NamedTuple):
    """The first event in a substep."""

    time: jax.Array  # from the start of the substep, inf if there is none
    number: jax.Array  # of the event among all links and events
    at_start: jax.Array  # whether it is as the substep starts
    is_none: jax.Array  # whether it is there by the cubic, but not by the motion


class LocalFlow:
    """The equations of a flow, and one iteration of it."""

    def __init__(
        self, h: float, slots: int, faces: tuple[int, ...], inputs: FlowInput, clock: records.Clock
    ) -> None:
        self.h, self.inputs = h, inputs
        self.n_faces, self.dtype = inputs.closing.shape[0], inputs.closing.dtype
        self.eps = float(jnp.finfo(self.dtype).eps)
        self.tolerance = 1e-9 if self.eps < 1e-10 else 1e-5
        self.laws = LinkLaws(inputs, faces)
        most = jnp.abs(inputs.pull) + jnp.abs(inputs.rise) / 2
        self.setting = events.Setting(self.laws, clock, h, slots, most)
        self.events = events.table(self.laws)

    def pull(self, t: jax.Array) -> jax.Array:
        """A at times from the start of the step."""
        return self.inputs.pull + self.inputs.rise * (t / self.h - 0.5)

    def start(self) -> FlowState:
        """The state in which a flow starts."""
        inputs, clock = self.inputs, self.setting.clock
        # A load that has grown since a slow touch would creep: the law is too stiff for it.
        contact, slowest = inputs.contact, self.setting.least_speed(self.setting.pull)
        slowest = jnp.where(records.is_deformed(contact.mode), slowest, 0.0)
        contact = contact._replace(touch_speed=larger(contact.touch_speed, slowest))
        # Derived from the input: so vmap and shard_map see the carry as batched from the start.
        zeros = 0 * inputs.closing
        none = zeros[0].astype(int)
        begin, s, w = clock.begin + zeros, inputs.closing, inputs.velocity
        y = SmoothState(begin, s, w, s * begin, zeros, zeros, contact.impulse)
        slots = jnp.repeat(zeros[:, None], self.setting.slots, 1)
        empty: Any = dict.fromkeys(StepLog._fields, zeros)
        empty |= {"impacts": records.Impacts(*[slots] * len(records.Impacts._fields))}
        empty |= {"highest_forces": zeros[:, None] * self.laws.delassus}
        slip = jnp.sign(lax.stop_gradient(w))
        touched = self._one_where(contact.mode != records.APART)
        log = StepLog(**empty)._replace(touched=touched, farthest=zeros - jnp.inf)
        return FlowState(
            y=jnp.stack(y),
            slip=slip,
            contact=contact,
            rising=self._one_where(contact.mode == PRESSED),
            middle=Snapshot(jnp.stack(y), slip, contact, log),
            log=log,
            ended=zeros[0],
            iterations=none,
            length=self._longest(Regime.of(slip, contact), self.h - begin[0]),
            usual=self.h / 2 + zeros[0],
            rejected=zeros[0],
        )

    def unfinished(self, x: FlowState) -> jax.Array:
        """Whether the flow has not reached the end of the step."""
        finite = jnp.isfinite(x.y).all() & jnp.isfinite(self.inputs.pull).all()
        return (x.ended < 1) & (x.iterations < _MOST_ITERATIONS) & finite

    def advance(self, x: FlowState) -> FlowState:
        """Try a substep: accept it, to its end or an event in it, or reject it as too long."""
        regime, inverse = x.regime, self.laws.inverse(x.regime)
        begin = self._forces(x.y, regime, inverse)
        x = self._with_highest(x, begin)
        substep, worst = self._substep(x, begin, inverse)
        # Which event is the first is not differentiated, only its instant.
        inputs = lax.stop_gradient((self.inputs, self.setting.clock))
        fixed = LocalFlow(self.h, 0, self.laws.faces, *inputs)
        event = fixed._first_event(*lax.stop_gradient((x, substep, inverse)))
        y, place, rates = self._located(x, substep, event, inverse)
        # The cubic of a long substep may have an event that the motion has not, or has before.
        backwards = y[0, 0] < x.y[0, 0] - _AT_ONCE * self.h
        is_none = event.is_none | (~event.at_start & backwards)
        wrong = ((worst > 1) & self._is_limited(regime)) | is_none
        after = x._replace(
            y=jnp.where(wrong, x.y, y),
            middle=self._middle(x, substep, ~wrong & (y[0, 0] >= self.h / 2)),
            rising=jnp.where(wrong, x.rising, self._one_where(place.growth > 0)),
            iterations=x.iterations + 1,
        )
        happens = ~wrong & jnp.isfinite(event.time)
        numbers = jnp.arange(len(self.events) * self.n_faces).reshape(-1, self.n_faces)
        links = happens & (numbers == event.number)
        for kind, which in zip(self.events, links, strict=True):
            after = kind.effect(
                self.setting, after, Occurrence(which, place.forces, rates.forces, event.at_start)
            )
            after = events.seen_from_both_sides(self.setting, after, which)
        ends = happens & (event.number == numbers.size)
        after = after._replace(ended=after.ended + self._one_where(ends))
        after = self._with_next_length(after, substep.length, event, worst, wrong, regime)
        halved = lax.stop_gradient(substep.length / 2)
        return after._replace(length=jnp.where(is_none, halved, after.length))

    def within(self, x: FlowState, time: jax.Array) -> jax.Array:
        """Times, closings and contact forces, (3, f), a ``time`` after a substep's start."""
        inverse = self.laws.inverse(x.regime)
        substep, _ = self._substep(x, self._forces(x.y, x.regime, inverse), inverse)
        y = substep.at(time)
        return jnp.stack([*y[:2], self._forces(y, x.regime, inverse).contact])

    def _middle(
        self, x: FlowState, substep: PowerSeries | Integrated, reached: jax.Array
    ) -> Snapshot:
        """The middle of the step: in this substep if it has ``reached`` the middle, or before."""
        left = self.h / 2 - x.y[0, 0]
        passes = reached & (left > 0)
        y = substep.at(jnp.where(passes, left, 0.0))
        seen = Snapshot(y, x.slip, x.contact, x.log)
        return jax.tree.map(lambda new, old: jnp.where(passes, new, old), seen, x.middle)

    def _with_next_length(
        self,
        after: FlowState,
        length: jax.Array,
        event: _First,
        worst: jax.Array,
        wrong: jax.Array,
        regime: Regime,
    ) -> FlowState:
        """The state with the length of the next substep to try."""
        left = larger(self.h - after.y[0, 0], 0.0)
        if self.laws.are_linear:
            return after._replace(length=self._longest(after.regime, left))
        # Where a law is singular, as at touch, the error decreases slowly with the length.
        factor = 0.9 * larger(worst, 1e-8) ** jnp.where(wrong, -0.25, -0.125)
        usual = length * jnp.clip(factor, 0.05, jnp.where(after.rejected > 0, 1.0, 4.0))
        usual = jnp.minimum(jnp.where(wrong, usual, larger(usual, after.usual)), self.h / 2)
        usual = jnp.where(self._is_limited(regime), usual, after.usual)
        tried = jnp.where(self._is_limited(after.regime), smaller(usual, left), left)
        # An event lies inside a rejected substep: retry with one that ends just past it.
        aims = wrong & (event.time < 0.9 * length) & ~event.at_start
        tried = jnp.where(aims, jnp.minimum(_JUST * event.time, left), tried)
        usual, tried = lax.stop_gradient((usual, tried))
        return after._replace(usual=usual, length=tried, rejected=self._one_where(wrong))

    def _longest(self, regime: Regime, left: jax.Array) -> jax.Array:
        """Length of the substep to try, of the time that is left, where no error is known."""
        longest: Any = self.h / 2
        if self.laws.are_linear and self.laws.has_contact_force:
            longest = _LONGEST / self.laws.rate
        tried = jnp.where(self._is_limited(regime), smaller(longest, left), left)
        return lax.stop_gradient(tried)

    def _forces(self, y: jax.Array, regime: Regime, inverse: jax.Array | None = None) -> Forces:
        inverse = self.laws.inverse(regime) if inverse is None else inverse
        return self._forces_in(regime, inverse)(*y[:3])

    def _forces_in(self, regime: Regime, inverse: jax.Array) -> Callable[..., Forces]:
        """The forces in a regime as a function of time, closings and velocities."""
        return lambda t, s, w: self.laws.at(self.pull(t), s, w, regime, inverse)

    def _is_limited(self, regime: Regime) -> jax.Array:
        """Whether forces of laws limit the length of a substep: it is no cubic."""
        limited = regime.deformed.any()
        if self.laws.has_resistance:
            limited |= (regime.slip != 0).any()
        return limited

    def _rates(self, y: jax.Array, now: Forces) -> jax.Array:
        """Time derivatives of a ``SmoothState``."""
        s, w = y[1:3]
        lost = (now.contact - now.elastic) * w
        return jnp.stack(
            [jnp.ones_like(s), w, now.acceleration, s, now.elastic * w, lost, now.contact]
        )

    def _substep(
        self, x: FlowState, begin: Forces, inverse: jax.Array
    ) -> tuple[PowerSeries | Integrated, jax.Array]:
        """A substep, and its error in units of the tolerance."""
        y, length, regime = x.y, x.length, x.regime
        if self.laws.are_linear:
            _, change = jax.linearize(self._forces_in(regime, inverse), *y[:3])
            order = _ORDER if self.laws.has_contact_force else 4
            return PowerSeries.of(y, length, begin, change, order), 0 * length

        # Scan over the stages: unrolled, they would dominate compile time.
        def stage(slopes: jax.Array, entry: Any) -> Any:
            i, row = entry
            motion = y[:3] + length * weighted(row, slopes[:, :3])
            rates = self._rates(motion, self._forces(motion, regime, inverse))
            return slopes.at[i].set(rates), None

        stages = jnp.asarray(coefficients().stages, self.dtype)
        slopes = jnp.broadcast_to(0 * y[0], (len(stages), *y.shape))
        slopes, _ = lax.scan(stage, slopes, (jnp.arange(len(stages)), stages))

        still, speed, a = lax.stop_gradient((slopes, y[2], begin.acceleration))
        end = speed + length * weighted(jnp.asarray(coefficients().end, self.dtype), still[:, 2])
        speeds = larger(jnp.abs(speed), jnp.abs(end)) + length * jnp.abs(a)
        speeds += jnp.where(regime.mode == PRESSED, lax.stop_gradient(regime.touch_speed), 0.0)
        speeds += jnp.finfo(self.dtype).tiny ** 0.5
        # A link that has just broken away is as inexact as the accelerations that cancel in it.
        parts = jnp.abs(self.inputs.pull) + times(jnp.abs(self.laws.delassus), jnp.abs(begin.total))
        rounding = 8 * self.eps * length * lax.stop_gradient(parts)
        sizes = self.tolerance * speeds + rounding
        errors = error(still[:, [1, 2, 4]])
        # The rate of the stored energy has a kink where a clipped contact ends.
        error_of_energy = errors[2] / (self.laws.mass * speeds)
        errors = larger(larger(length * errors[1], errors[0]), length * error_of_energy)
        worst = (errors / sizes).max()
        worst = jnp.where(worst < 1e8, worst, 1e8)
        return Integrated(y, length, slopes[:, 1:]), worst

    def _with_highest(self, x: FlowState, now: Forces) -> FlowState:
        """The state with the largest contact force so far, of the step and of the impact."""
        if not self.laws.has_contact:
            return x
        log, contact = x.log, x.contact
        higher, of_faces = now.contact > log.highest, now.total
        if self.laws.faces:
            of_faces = self.laws.of_links_alone(now.friction) + now.contact
        log = log._replace(
            highest=jnp.where(higher, now.contact, log.highest),
            highest_time=jnp.where(higher, self.setting.since_middle(x), log.highest_time),
            highest_forces=jnp.where(higher[:, None], of_faces, log.highest_forces),
        )
        peak = larger(contact.peak_force, now.contact)
        return x._replace(log=log, contact=contact._replace(peak_force=peak))

    def _values(
        self, x: FlowState, y: jax.Array, inverse: jax.Array
    ) -> tuple[Place, Place, jax.Array, jax.Array]:
        """The links at a place and their time derivatives; the same of all events' values.

        The values have the shape (events, n).
        """
        (t, s, w), regime = y[:3], x.regime
        now, along = jax.linearize(self._forces_in(regime, inverse), t, s, w)
        a = now.acceleration
        change = along(jnp.ones_like(t), w, a)
        growth = bend = jnp.zeros_like(s)
        if self.laws.has_contact_force:
            growth, bend = jax.jvp(
                lambda s, w, a: self.laws.growth(s, w, a, regime),
                (s, w, a),
                (w, a, change.acceleration),
            )

        def values(place: Place) -> jax.Array:
            return jnp.stack([kind.value(self.setting, x, place) for kind in self.events])

        place, rate = Place(s, w, now, growth), Place(w, a, change, bend)
        return place, rate, *jax.jvp(values, (place,), (rate,))

    def _first_event(
        self, x: FlowState, substep: PowerSeries | Integrated, inverse: jax.Array
    ) -> _First:
        """The first event in a substep."""
        length = substep.length
        both = jnp.stack([x.y, substep.at(length)])
        places, rates, values, slopes = jax.vmap(lambda y: self._values(x, y, inverse))(both)
        begin, rate = jax.tree.map(lambda z: z[0], (places, rates))
        scales = jnp.stack(
            [jax.vmap(kind.scale, (0, None))(places, length) for kind in self.events]
        )
        noise = 32 * self.eps * scales.sum(1)
        armed = jnp.stack([kind.armed(self.setting, x, begin) for kind in self.events])
        of_force, may_return, signs = (
            jnp.asarray([getattr(kind, name) for kind in self.events])[:, None]
            for name in ("of_force", "may_return", "of_closing")
        )
        # A value below zero at the start, such as a gap at rest has by a correction, is the zero of
        # the end too: a gap that opens from there does not close.
        below = smaller(values[0], 0.0)
        shares = first_zero(
            values[0] - below,
            length * slopes[0],
            values[1] - below,
            length * slopes[1],
            noise,
            may_return,
        )
        shares = jnp.where(of_force & (values[0] < -noise), 0.0, shares)
        instants = jnp.where(armed & (shares <= 1), shares * length, jnp.inf).ravel()
        ends = x.y[0, 0] + length >= (1 - 1e-12) * self.h
        instants = jnp.append(instants, jnp.where(ends, self.h - x.y[0, 0], jnp.inf))
        number = jnp.argmin(instants)
        time = instants[number]
        # By its cubic a gap may close at once that opens, slowly at first, by the next derivatives.
        t, jerk = _SOON * length, rate.forces.acceleration
        moved = begin.w + t / 2 * (begin.forces.acceleration + t / 3 * jerk)
        rises = jnp.append((signs * moved[None]).ravel() > 0, False)
        at_start = time <= _AT_ONCE * self.h
        return _First(time, number, at_start, at_start & rises[number])

    def _located(
        self, x: FlowState, substep: PowerSeries | Integrated, event: _First, inverse: jax.Array
    ) -> tuple[jax.Array, Place, Place]:
        """The state at an event, or at the end of a substep without one; the links there.

        The last are their time derivatives.
        """
        length, exists = substep.length, jnp.isfinite(event.time)
        # An event at a start with a longer step comes from a jump of the forces: it stays there.
        near = jnp.where(event.at_start, 1e-3 * self.h, _NEAR * length)
        farthest = jnp.where(event.at_start, 0.0, near)

        def nearer(_: Any, state: Any) -> Any:
            time = lax.stop_gradient(state[0])
            y = substep.at(time)
            place, rate, values, slopes = self._values(x, y, inverse)
            value, slope = jnp.append(values, self.h - y[0, 0]), jnp.append(slopes, -1.0)
            value, slope = value[event.number], lax.stop_gradient(slope[event.number])
            step = jnp.where(exists & (slope != 0), -value / jnp.where(slope == 0, 1.0, slope), 0.0)
            step = jnp.where(jnp.abs(step) <= near, step, jnp.sign(step) * farthest)
            moved = y + step * self._rates(y, place.forces)
            return jnp.clip(time + step, 0.0, length), moved, place, rate

        time = jnp.where(event.at_start, 0.0, jnp.where(exists, event.time, length))
        zero = jnp.zeros_like(x.y[0])
        nowhere = Place(zero, zero, Forces(*[zero] * len(Forces._fields)), zero)
        start = time, x.y, nowhere, nowhere
        return lax.fori_loop(0, _NEWTON_STEPS, nearer, start)[1:]

    def result(self, x: FlowState) -> FlowResult:
        """The result of a flow from the state in which it ended."""
        # NaN in what the run goes on from makes all of its results NaN.
        poison = jnp.where(x.ended > 0, 1.0, jnp.nan).astype(self.dtype)
        y, middle = x.y * poison, x.middle._replace(y=x.middle.y * poison)
        at, mode = SmoothState(*y), x.contact.mode
        unpressed = jnp.where(mode == PRESSED, records.CLIPPED, mode)
        end = self._forces(y, x.regime._replace(mode=unpressed))
        now, until_middle = self._midstep(middle)
        until_end = x.contact._replace(impulse=at.impulse), at.stored, at.lost, x.log
        contact, stored, lost, log = jax.tree.map(
            lambda a, b: jnp.where(self.setting.clock.is_last, a, b), until_middle, until_end
        )
        return FlowResult(
            closing=at.s,
            velocity=at.w,
            acceleration=end.acceleration,
            held=self._one_where(x.regime.held),
            mean=at.area / self.h,
            contact=contact,
            stored=stored,
            lost=lost,
            now=now,
            log=log._replace(touched=log.touched * poison),  # so that a failure is used
        )

    def _midstep(self, middle: Snapshot) -> tuple[MidStep, tuple[Any, ...]]:
        """The links in the middle; and their contact, its energies and the log until then."""
        at, regime = SmoothState(*middle.y), Regime.of(middle.slip, middle.contact)
        forces, contact, log = self._forces(middle.y, regime), middle.contact, middle.log
        peak = larger(contact.peak_force, forces.contact)
        now = MidStep(
            closing=at.s,
            velocity=at.w,
            friction=self.laws.of_links_alone(forces.friction),
            contact_force=forces.contact,
            stored=at.stored,
            lost=at.lost,
            held=self._one_where(regime.held),
        )
        contact = contact._replace(impulse=at.impulse, peak_force=peak)
        log = log._replace(highest=larger(log.highest, forces.contact))
        return now, (contact, at.stored, at.lost, log)

    def _one_where(self, holds: jax.Array) -> jax.Array:
        return jnp.where(holds, 1.0, 0.0).astype(self.dtype)
