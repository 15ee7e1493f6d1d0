r"""The local flow: links that share masses over one step, from event to event.

Within a step the links see only the pull A(t) of the rods and the ground, linear in time:

    s'' = A(t) − G (q + p),    q ∈ μ Sgn(s'),    p = p(s − ξ0, s'),    G = B_lᵀ M⁻¹ B_l,

with closings s, friction q and contact forces p. The flow solves this small problem event by event:
slip ends, stick breaks, a gap closes, a contact opens. Between events the motion is smooth. Where
no law of contact has a force it is a cubic in time. Elsewhere an embedded Runge–Kutta method of
order 8 integrates it: the stiffness of a contact sets its substeps, never the step of the run. Both
give the links at any time of a substep, and so locate events. The last Newton step in time holds
its slope fixed, so that derivatives contain how the instant of an event moves.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxpound._extrema import larger, smaller
from jaxpound.simulation.forces import (
    APART,
    CLIPPED,
    PRESSED,
    REST,
    SOFT,
    Contact,
    ContactStart,
    FlowInput,
    FlowResult,
    Forces,
    Impacts,
    LinkLaws,
    MidStep,
    Regime,
    StepLog,
    held_inverse,
    times,
)
from jaxpound.simulation.runge_kutta import END, STAGES, error, until, weighted

MOST = 4000  # iterations in a step
_AT_ONCE = 1e-10  # share of a step within which events are at the same instant
_NEAR = 0.05  # longest Newton step to an event, as a share of the substep
_JUST = 1.001  # length of a substep that should end just beyond an event, in units of its time
_NEWTON = 2  # Newton steps to an event before the one that is differentiated
_REBOUNDS = 1e-2  # rebounds that would all be over within this share of a step end at once
_SLOWEST = 1e-2  # touch speed below this share of what the pull adds in a step is set to it


class SmoothState(NamedTuple):
    """What changes smoothly between events, (n,) each; as an array, its rows."""

    t: jax.Array  # from the start of the step, the same for all links
    s: jax.Array
    w: jax.Array
    area: jax.Array  # ∫ s dt
    stored: jax.Array
    lost: jax.Array
    impulse: jax.Array


class FlowState(NamedTuple):
    """The state of a flow."""

    y: jax.Array  # a ``SmoothState``, (7, n)
    regime: Regime
    touch_time: jax.Array
    peak_force: jax.Array
    counts: jax.Array
    fastest: jax.Array
    rising: jax.Array  # 1 while the contact force grows
    now: MidStep
    log: StepLog
    stage: jax.Array  # 0 before the middle of the step, 1 in it, 2 after it, 3 at the end
    iterations: jax.Array
    accepted: jax.Array  # accepted iterations
    length: jax.Array  # of the substep to try
    usual: jax.Array  # length that the error allows
    rejected: jax.Array  # 1 if the last substep was too long


class _Substep(NamedTuple):
    """A substep that has been tried."""

    length: jax.Array
    begin: Forces
    seen: Forces  # at its end, in the regime of its start
    end: jax.Array  # a ``SmoothState``
    slopes: jax.Array  # of s, w and the quadratures in the stages, if laws have forces
    error: jax.Array  # in units of the tolerance
    growth: jax.Array  # of each law's force at the start, and at the end
    growth_end: jax.Array


class _Event(NamedTuple):
    """The first event in a substep."""

    time: jax.Array  # from the start of the substep, inf if there is none
    number: jax.Array  # of the event among all links and events
    stop: jax.Array  # the next instant at which the flow stops in any case


class LocalFlow:
    """The equations of a flow, and one iteration of it."""

    def __init__(self, h: float, slots: int, inputs: FlowInput) -> None:
        self.h, self.slots, self.inputs = h, slots, inputs
        self.n, self.dtype = inputs.closing.shape[0], inputs.closing.dtype
        self.eps = float(jnp.finfo(self.dtype).eps)
        self.tolerance = 1e-8 if self.eps < 1e-10 else 1e-5
        self.laws = LinkLaws(inputs.delassus, inputs.friction, inputs.gap, inputs.laws)
        laws = self.laws
        self.events = ["turn", "breaks"]
        self.events += ["touch"] if laws.has_contact else []
        self.events += ["leaves"] if laws.has_newton else []
        self.events += ["release", "clip", "top"] if laws.has_contact_force else []

    def forces(self, y: jax.Array, regime: Regime, inverse: jax.Array) -> Forces:
        """The forces at a place."""
        at = SmoothState(*y)
        return self.laws.at(self.pull(at.t), at.s, at.w, regime, inverse)

    def pull(self, t: jax.Array) -> jax.Array:
        """A at times from the start of the step."""
        return self.inputs.pull + self.inputs.rise * (t / self.h - 0.5)

    def start(self, contact_start: ContactStart) -> FlowState:
        """The state in which a flow starts."""
        inputs = self.inputs
        # Derived from the input: so vmap and shard_map see the carry as batched from the start.
        zeros = 0 * inputs.closing
        none = zeros[0].astype(int)
        begin, under_way = contact_start.start + zeros[0], inputs.under_way
        s, w = inputs.closing, inputs.velocity
        y = SmoothState(begin + zeros, s, w, s * begin, zeros, zeros, under_way.impulse)
        slip = jnp.sign(lax.stop_gradient(w))
        slots = jnp.repeat(zeros[:, None], self.slots, 1)
        impacts = Impacts(*[slots] * len(Impacts._fields))
        mode, counts, fastest, _ = contact_start
        touched = jnp.where(mode == APART, 0.0, 1.0).astype(self.dtype)
        empty: Any = dict.fromkeys(StepLog._fields, zeros)
        empty |= {"impacts": impacts, "highest_forces": zeros[:, None] * inputs.delassus}
        log = StepLog(**empty)._replace(touched=touched, farthest=zeros - jnp.inf)
        return FlowState(
            y=jnp.stack(y),
            regime=Regime(slip, mode, under_way.touch_speed),
            touch_time=under_way.touch_time,
            peak_force=under_way.peak_force,
            counts=counts,
            fastest=fastest,
            rising=jnp.where(mode == PRESSED, 1.0, 0.0).astype(self.dtype),
            now=MidStep(s, w, *(zeros,) * 5, mode, counts, under_way, zeros, zeros),
            log=log,
            stage=none,
            iterations=none,
            accepted=none,
            length=jnp.asarray(self.h / 2, self.dtype) - begin,
            usual=self.h + zeros[0],
            rejected=zeros[0],
        )

    def unfinished(self, x: FlowState) -> jax.Array:
        """Whether the flow has not reached the end of the step."""
        finite = jnp.isfinite(x.y).all() & jnp.isfinite(self.inputs.pull).all()
        return (x.stage < 3) & (x.iterations < MOST) & finite

    def advance(self, x: FlowState) -> FlowState:
        """Try a substep: accept it, to its end or an event in it, or reject it as too long."""
        inverse = held_inverse(self.inputs.delassus, x.regime.held)
        sub = self._substep(x, inverse)
        stop = self._stop(x)
        flies = ~x.regime.deformed.any()
        event = self._first_event(x, sub, stop)
        exists, at_once = jnp.isfinite(event.time), event.time <= _AT_ONCE * self.h
        wrong = (sub.error > 1) & ~flies

        fixed = LocalFlow(self.h, self.slots, lax.stop_gradient(self.inputs))
        time = fixed.located(*lax.stop_gradient((x, sub, event, inverse)))
        time = jnp.where(at_once, 0.0, time)
        place = jnp.where(at_once, x.y, self._along(x, sub, time))
        now = self.forces(place, x.regime, inverse)
        # A flight may close a gap and open it again before the event that was found.
        touch = self._selected("touch", event.number)
        passes = flies & (self._closes(x, SmoothState(*x.y), SmoothState(*place)) & ~touch).any()
        accepts = ~wrong & (~exists | ~passes | at_once)
        happens = exists & accepts
        step = self._correction(x, sub, event, place, now, time)
        most = jnp.where(at_once, 1e-3 * self.h, _NEAR * sub.length)
        sure = jnp.abs(lax.stop_gradient(step)) <= most
        place = place + jnp.where(happens & sure, step, 0.0) * self._rates(place, now)
        after = self._record_midstep(x, sub, accepts)
        after = after._replace(
            y=jnp.where(accepts, place, x.y),
            rising=jnp.where(accepts, jnp.where(sub.growth_end > 0, 1.0, 0.0), x.rising),
            iterations=x.iterations + 1,
            accepted=x.accepted + jnp.where(accepts, 1, 0),
        )
        after = self._highest(after, now, accepts)
        after = self._apply_event(after, now, jnp.where(happens, event.number, -1), at_once)
        return self._with_next_length(after, x, sub, event, wrong, accepts)

    def _with_next_length(
        self, after: FlowState, x: FlowState, sub: _Substep, event: _Event, wrong: Any, accepts: Any
    ) -> FlowState:
        """The state with the length of the next substep to try."""
        left = larger(lax.stop_gradient(self._stop(after) - after.y[0, 0]), 0.0)
        # Where a law is singular, as at touch, the error decreases slowly with the length.
        power = jnp.where(wrong, -0.25, -0.125)
        factor = 0.9 * larger(sub.error, 1e-8) ** power
        factor = jnp.clip(factor, 0.05, jnp.where(x.rejected > 0, 1.0, 4.0))
        usual = jnp.where(wrong, sub.length * factor, larger(sub.length * factor, x.usual))
        usual = jnp.where(x.regime.deformed.any(), jnp.minimum(usual, self.h), x.usual)
        length = jnp.where(after.regime.deformed.any(), smaller(usual, left), left)
        # An event lies inside a rejected substep: retry with one that ends just past it.
        short = event.time < jnp.where(wrong, 0.9, 1.0) * sub.length
        aims = ~accepts & short & (event.time > _AT_ONCE * self.h)
        aim = jnp.minimum(_JUST * event.time, left)
        return after._replace(
            usual=lax.stop_gradient(usual),
            rejected=jnp.where(wrong, 1.0, 0.0).astype(self.dtype),
            length=lax.stop_gradient(jnp.where(aims, aim, length)),
        )

    # -- a substep ----------------------------------------------------------------------------

    def _substep(self, x: FlowState, inverse: jax.Array) -> _Substep:
        length, end = lax.stop_gradient(x.length), x.y
        begin = self.forces(x.y, x.regime, inverse)
        if self.laws.has_contact_force:
            slopes, worst = self._pushed(x, inverse, length, begin.acceleration)
            end = x.y.at[1:].add(length * weighted(jnp.asarray(END, self.dtype), slopes))
        end = end.at[0].add(length)
        seen = self.forces(end, x.regime, inverse)
        if self.laws.has_contact_force:
            ends = (SmoothState(*x.y), begin), (SmoothState(*end), seen)
            growths = [
                self.laws.growth(at.s, at.w, forces.acceleration, x.regime) for at, forces in ends
            ]
            growth, growth_end = lax.stop_gradient(growths)
        else:
            slopes = growth = growth_end = 0 * x.y[0]
            worst = slopes[0]
        sub = _Substep(length, begin, seen, end, slopes, worst, growth, growth_end)
        return sub._replace(end=self._along(x, sub, length))

    def _along(self, x: FlowState, sub: _Substep, time: jax.Array) -> jax.Array:
        """The links a ``time`` after the start of a substep.

        Without a law's force, accelerations and the forces between links at rest change linearly in
        time from ``sub.begin`` to ``sub.seen``.
        """
        at, begin, seen = SmoothState(*x.y), sub.begin, sub.seen
        share = time / jnp.where(sub.length > 0, sub.length, 1.0)
        a, gain = begin.acceleration, share * (seen.acceleration - begin.acceleration)
        pressing = begin.contact + share / 2 * (seen.contact - begin.contact)
        pressing = time * jnp.where(x.regime.mode == REST, pressing, 0.0)
        flown = at._replace(
            t=at.t + time,
            s=at.s + time * (at.w + time * (a / 2 + gain / 6)),
            w=at.w + time * (a + gain / 2),
            area=at.area + time * (at.s + time * (at.w / 2 + time * (a / 6 + gain / 24))),
            impulse=at.impulse + pressing,
        )
        if not self.laws.has_contact_force:
            return jnp.stack(flown)
        moved = x.y[1:] + sub.length * weighted(until(share), sub.slopes)
        pushed = SmoothState(flown.t, *moved)
        pushed = pushed._replace(impulse=pushed.impulse + pressing)
        return jnp.where(x.regime.deformed.any(), jnp.stack(pushed), jnp.stack(flown))

    def _pushed(
        self, x: FlowState, inverse: jax.Array, length: jax.Array, first: jax.Array
    ) -> tuple[jax.Array, jax.Array]:
        """Slopes of what the laws' forces move in the stages of a step, and the estimated error.

        The error is in units of the tolerance; ``first`` are the accelerations at the start.
        """
        laws, regime, at = self.laws, x.regime, SmoothState(*x.y)
        rise = self.inputs.rise / self.h
        free, rise, yields = laws.affine(self.pull(at.t), rise, regime, inverse)

        def rates(motion: jax.Array, time: jax.Array) -> jax.Array:
            s, w = motion
            raw, elastic = laws.of_contact(s, w, regime)
            contact = jnp.where(regime.mode == PRESSED, raw, 0.0)
            elastic = jnp.where(regime.deformed, elastic, 0.0)
            a = free + time * rise - times(yields, contact)
            return jnp.stack([w, a, s, elastic * w, (contact - elastic) * w, contact])

        start = jnp.stack([at.s, at.w])

        # Scan over the stages: unrolled, they would dominate compile time.
        def stage(slopes: jax.Array, entry: Any) -> Any:
            i, row = entry
            motion = start + length * weighted(row, slopes[:, :2])
            return slopes.at[i].set(rates(motion, row.sum() * length)), None

        table = jnp.asarray(STAGES, self.dtype)
        slopes = jnp.broadcast_to(0 * at.s, (len(table), 6, self.n))
        slopes, _ = lax.scan(stage, slopes, (jnp.arange(len(table)), table))

        w = at.w + length * weighted(jnp.asarray(END, self.dtype), slopes[:, 1])
        sizes = larger(jnp.abs(at.w), jnp.abs(w)) + length * jnp.abs(first)
        sizes = sizes + jnp.where(regime.mode == PRESSED, regime.touch_speed, 0.0)
        sizes = self.tolerance * lax.stop_gradient(sizes) + jnp.finfo(self.dtype).tiny
        wrong = error(lax.stop_gradient(slopes[:, :2]))
        worst = (larger(length * wrong[1], wrong[0]) / sizes).max()
        return slopes, jnp.where(worst < 1e8, worst, 1e8)

    def _rates(self, y: jax.Array, now: Forces) -> jax.Array:
        """Time derivatives of a ``SmoothState``."""
        at = SmoothState(*y)
        rates = SmoothState(
            t=jnp.ones_like(at.t),
            s=at.w,
            w=now.acceleration,
            area=at.s,
            stored=now.elastic * at.w,
            lost=(now.contact - now.elastic) * at.w,
            impulse=now.contact,
        )
        return jnp.stack(rates)

    def _stop(self, x: FlowState) -> jax.Array:
        """The next instant at which the flow stops in any case: mid-step, or the end."""
        return jnp.where(x.stage < 1, self.h / 2, self.h)

    def _record_midstep(self, x: FlowState, sub: _Substep, accepts: jax.Array) -> FlowState:
        """Forces at the start of the substep: the largest so far, and those in mid-step.

        Rejected substeps must not change the state: the reverse pass replays accepted ones only.
        """
        now, mid, at = sub.begin, accepts & (x.stage == 1), SmoothState(*x.y)
        x = self._highest(x, now, accepts)
        seen = MidStep(
            closing=at.s,
            velocity=at.w,
            friction=now.friction,
            contact=now.contact,
            stored=at.stored,
            lost=at.lost,
            held=jnp.where(x.regime.held, 1.0, 0.0).astype(self.dtype),
            mode=x.regime.mode,
            counts=x.counts,
            under_way=self._under_way(x),
            strongest=x.log.strongest,
            powers=x.log.powers,
        )
        return x._replace(
            now=jax.tree.map(lambda a, b: jnp.where(mid, a, b), seen, x.now),
            stage=jnp.where(mid, 2, x.stage),
        )

    def _under_way(self, x: FlowState) -> Contact:
        return Contact(x.regime.touch_speed, x.touch_time, SmoothState(*x.y).impulse, x.peak_force)

    def _highest(self, x: FlowState, now: Forces, valid: jax.Array) -> FlowState:
        """The largest contact force so far, of the step and of the impact."""
        if not self.laws.has_contact:
            return x
        log = x.log
        higher = valid & (now.contact > log.highest)
        log = log._replace(
            highest=jnp.where(higher, now.contact, log.highest),
            highest_time=jnp.where(higher, x.y[0] - self.h / 2, log.highest_time),
            highest_forces=jnp.where(higher[:, None], now.total, log.highest_forces),
        )
        peak = jnp.where(valid & (now.contact > x.peak_force), now.contact, x.peak_force)
        return x._replace(log=log, peak_force=peak)

    # -- events -------------------------------------------------------------------------------

    def _selected(self, name: str, number: jax.Array) -> jax.Array:
        """Links, (n,), whose event with this name has this number."""
        if name not in self.events:
            return jnp.zeros(self.n, bool)
        return jnp.arange(self.n) == number - self.events.index(name) * self.n

    def _first_event(self, x: FlowState, sub: _Substep, stop: jax.Array) -> _Event:
        """The first event in a substep."""
        sub, at = lax.stop_gradient((sub, SmoothState(*x.y)))
        length = sub.length
        times_by_name = {
            **self._events_of_friction(x, sub, at),
            **self._events_of_contact(x, sub, at),
        }
        at_stop = at.t[0] + length >= stop - 1e-12 * self.h
        times_of_all = jnp.concatenate([times_by_name[name] for name in self.events])
        times_of_all = jnp.append(times_of_all, jnp.where(at_stop, stop - at.t[0], jnp.inf))
        times_of_all = jnp.where(
            jnp.isinf(times_of_all), times_of_all, jnp.clip(times_of_all, 0.0, length)
        )
        number = jnp.argmin(times_of_all)
        return _Event(times_of_all[number], number, stop)

    def _events_of_friction(
        self, x: FlowState, sub: _Substep, at: SmoothState
    ) -> dict[str, jax.Array]:
        """When slip and stick end, from the start of the substep; inf if they do not."""
        begin, seen, end, length = sub.begin, sub.seen, SmoothState(*sub.end), sub.length
        a0, eps, never = begin.acceleration, 32 * self.eps, jnp.inf
        slip, rest = x.regime.slip, x.regime.mode == REST
        friction = lax.stop_gradient(self.inputs.friction)

        # The speed along the slip is a quadratic function.
        u0, slope, u1 = slip * at.w, slip * a0, slip * end.w
        bend = (u1 - u0 - slope * length) / jnp.where(length > 0, length, 1.0) ** 2
        noise = eps * (jnp.abs(at.w) + jnp.abs(end.w) + length * jnp.abs(a0))
        lowest = u0 - slope**2 / jnp.where(bend > 0, 4 * bend, 1.0)
        dips = (bend > 0) & (slope < 0) & (-slope < 2 * bend * length) & (lowest < -noise)
        q = _root_factor(u0, slope, bend)
        before = jnp.where(slope < 0, u0, q) / _nonzero(jnp.where(slope < 0, q, bend))
        turn = jnp.where((slip != 0) & ~rest & ((u1 < -noise) | dips), before, never)

        noise = eps * (jnp.abs(begin.total) + jnp.abs(seen.total) + friction)
        limit = jnp.sign(seen.friction) * friction
        before = (limit - begin.friction) / _nonzero(seen.friction - begin.friction) * length
        before = jnp.where(jnp.abs(begin.friction) > friction + noise, 0.0, before)
        over = larger(jnp.abs(begin.friction), jnp.abs(seen.friction)) > friction + noise
        breaks = jnp.where((slip == 0) & ~rest & over, before, never)
        if not self.laws.has_newton:
            return {"turn": turn, "breaks": breaks}

        # The reaction that keeps a gap closed would have to pull.
        least = -friction - noise
        before = (-friction - begin.total) / _nonzero(seen.total - begin.total) * length
        before = jnp.where(begin.total < least, 0.0, before)
        below = rest & (smaller(begin.total, seen.total) < least)
        return {"turn": turn, "breaks": breaks, "leaves": jnp.where(below, before, never)}

    def _events_of_contact(
        self, x: FlowState, sub: _Substep, at: SmoothState
    ) -> dict[str, jax.Array]:
        """When gaps close and contacts let go, from the start of the substep."""
        if not self.laws.has_contact:
            return {}
        laws, mode, length, never = self.laws, x.regime.mode, sub.length, jnp.inf
        end = SmoothState(*sub.end)
        gap = lax.stop_gradient(laws.gap)
        depth0, depth1 = at.s - gap, end.s - gap
        crosses = _crossing(depth0, at.w, depth1, end.w, length)
        closes = self._closes(x, at, end)
        touch = jnp.where(closes, jnp.where(depth0 >= 0, 0.0, crosses), never)
        if not laws.has_contact_force:
            return {"touch": touch}
        opens = x.regime.deformed & (depth1 < 0) & (depth1 < depth0) & ((depth0 > 0) | (at.w <= 0))
        release = jnp.where(opens, jnp.where(depth0 <= 0, 0.0, crosses), never)

        # The force of a law that must not pull vanishes, or comes back.
        begin, seen = sub.begin, sub.seen
        noise = 32 * self.eps * (jnp.abs(begin.elastic) + jnp.abs(seen.elastic) + jnp.abs(seen.raw))
        crosses = _crossing(begin.raw, sub.growth, seen.raw, sub.growth_end, length)
        ends = (mode == PRESSED) & (seen.raw < -noise)
        ends_before = jnp.where(begin.raw <= 0, 0.0, crosses)
        returns = (mode == CLIPPED) & (seen.raw > noise)
        returns_before = jnp.where(begin.raw >= 0, 0.0, crosses)
        clip = jnp.where(ends, ends_before, jnp.where(returns, returns_before, never))
        clip = jnp.where(laws.clips, clip, never)

        # The force of a law is largest.
        tops = (mode == PRESSED) & (x.rising > 0) & (sub.growth > 0) & (sub.growth_end < 0)
        before = length * sub.growth / _nonzero(sub.growth - sub.growth_end)
        top = jnp.where(tops, before, never)
        return {"touch": touch, "release": release, "clip": clip, "top": top}

    def _closes(self, x: FlowState, at: SmoothState, end: SmoothState) -> jax.Array:
        """Links, (n,), whose gap closes from one place to another."""
        gap = lax.stop_gradient(self.laws.gap)
        apart = self.laws.has_law & (x.regime.mode == APART)
        # A gap that is closed at both ends of a flight opened in between: its velocity vanishes
        # first.
        turns = (at.s >= gap) & (at.w < 0)
        return apart & (end.s > gap) & (end.s > at.s) & ~turns

    def located(self, x: FlowState, sub: _Substep, event: _Event, inverse: jax.Array) -> jax.Array:
        """The time of an event from the start of a substep, or its length if there is none."""
        first = jnp.where(jnp.isfinite(event.time), event.time, sub.length)
        most = _NEAR * sub.length

        def nearer(_: Any, time: jax.Array) -> jax.Array:
            place = self._along(x, sub, time)
            now = self.forces(place, x.regime, inverse)
            step = self._correction(x, sub, event, place, now, time)
            return jnp.clip(time + jnp.clip(step, -most, most), 0.0, sub.length)

        return lax.fori_loop(0, _NEWTON, nearer, first)

    def _correction(
        self,
        x: FlowState,
        sub: _Substep,
        event: _Event,
        place: jax.Array,
        now: Forces,
        time: jax.Array,
    ) -> jax.Array:
        """The Newton step in time to an event from a state near it, a ``time`` into the substep.

        Its derivative is that of the event's instant.
        """
        at, laws, begin, seen = SmoothState(*place), self.laws, sub.begin, sub.seen

        def between(first: jax.Array, value: jax.Array, last: jax.Array) -> jax.Array:
            """The step by the slope through this value and those at the ends of the substep."""
            before, after = time, sub.length - time
            slope = (value - first) / _nonzero(before) + (last - value) / _nonzero(after)
            step = _newton(value, slope - (last - first) / _nonzero(sub.length))
            return jnp.where(time > 0, step, 0.0)

        steps = {"turn": _newton(at.w, now.acceleration)}
        sign, friction = jnp.sign(seen.friction), self.inputs.friction
        excess = [sign * forces.friction - friction for forces in (begin, now, seen)]
        steps["breaks"] = between(*excess)
        if laws.has_contact:
            steps["touch"] = _newton(at.s - laws.gap, at.w)
        if laws.has_newton:
            excess = [forces.total + friction for forces in (begin, now, seen)]
            steps["leaves"] = between(*excess)
        if laws.has_contact_force:
            steps["release"] = steps["touch"]
            growth = laws.growth(at.s, at.w, now.acceleration, x.regime)
            steps["clip"] = _newton(now.raw, growth)
            steps["top"] = between(sub.growth, growth, sub.growth_end)
        steps_of_all = jnp.concatenate([steps[name] for name in self.events])
        steps_of_all = jnp.append(steps_of_all, event.stop - at.t[0])
        chosen = (jnp.arange(steps_of_all.size) == event.number) & jnp.isfinite(event.time)
        return jnp.where(chosen, steps_of_all, 0.0).sum()

    def _apply_event(
        self, x: FlowState, now: Forces, number: jax.Array, at_once: jax.Array
    ) -> FlowState:
        """The state after an event, with the forces just before it; number −1 is none."""
        turn, breaks = self._selected("turn", number), self._selected("breaks", number)
        at, regime = SmoothState(*x.y), x.regime
        stage = x.stage + jnp.where(number == len(self.events) * self.n, 1, 0)
        touch, leaves = self._selected("touch", number), self._selected("leaves", number)
        release, clip = self._selected("release", number), self._selected("clip", number)
        rigid = self.laws.rigid
        collides, speed = touch & rigid, at.w
        rests, rebound, blow = self._collision(speed, collides, now)
        jump = jnp.where(collides.any(), times(self.inputs.delassus, blow), 0.0)
        w = jnp.where(collides, -rebound, jnp.where(turn, 0.0, at.w - jump))
        shaken = times(self.inputs.delassus, jnp.where(collides, 1.0, 0.0)) != 0
        struck = collides.any() & ~collides & shaken

        # Directions of slip and modes of contact.
        slip = jnp.where(struck | collides, jnp.sign(w), regime.slip)
        slip = jnp.where(breaks, jnp.sign(now.friction), slip)
        slip = jnp.where(turn | rests, 0.0, jnp.where(leaves, -1.0, slip))
        slip = lax.stop_gradient(slip)
        mode = jnp.where(touch & ~rigid, PRESSED, regime.mode)
        mode = jnp.where(rests, REST, mode)
        mode = jnp.where(leaves | release | (struck & (regime.mode == REST)), APART, mode)
        mode = jnp.where(clip, jnp.where(regime.mode == PRESSED, CLIPPED, PRESSED), mode)
        # Exactly on the gap, where an event closes or opens it.
        s = jnp.where((touch | release) & ~at_once, self.laws.gap, at.s)

        # The impacts that begin and end.
        time = at.t - self.h / 2
        counts = touch & (speed > 1e-4 * x.fastest) & (speed > 0)
        counted = jnp.where(touch, jnp.where(counts, 1.0, 0.0), x.counts).astype(self.dtype)
        slowest = lax.stop_gradient(_SLOWEST * self.h * jnp.abs(now.acceleration))
        peak = jnp.where(touch, 0.0, x.peak_force)
        impulse = jnp.where(touch, blow, at.impulse)
        touch_time = jnp.where(touch, time, x.touch_time)
        touch_speed = jnp.where(touch, larger(speed, slowest), regime.touch_speed)
        over = (release | collides) & (counted > 0)
        log = x.log
        slot = over[:, None] & (jnp.arange(self.slots)[None] == log.ended[:, None])
        entries = Impacts(touch_time, touch_speed, time, -w, impulse, peak)
        log = log._replace(
            touched=larger(log.touched, jnp.where(touch, 1.0, 0.0)),
            touches=log.touches + jnp.where(counts, 1.0, 0.0),
            first_touch=jnp.where(counts & (log.touches == 0), time, log.first_touch),
            ended=log.ended + jnp.where(over, 1.0, 0.0),
            strongest=jnp.where(over & (impulse > log.strongest), impulse, log.strongest),
            powers=log.powers + jnp.where(over, peak**SOFT, 0.0),
            impacts=jax.tree.map(lambda a, b: jnp.where(slot, a[:, None], b), entries, log.impacts),
        )
        turned = turn | collides | (struck & (regime.slip != 0) & (slip != regime.slip))
        x = x._replace(log=log)
        x = self._record_turns(x, s, turned, slip)
        lost = at.lost + blow * (speed - rebound) / 2
        top = self._selected("top", number)
        return x._replace(
            y=jnp.stack(at._replace(s=s, w=w, lost=lost, impulse=impulse)),
            regime=Regime(slip, mode, touch_speed),
            touch_time=touch_time,
            peak_force=peak,
            counts=counted,
            fastest=lax.stop_gradient(jnp.where(touch, larger(x.fastest, speed), x.fastest)),
            rising=jnp.where(touch, 1.0, jnp.where(top, 0.0, x.rising)),
            stage=stage,
        )

    def _collision(
        self, speed: jax.Array, collides: jax.Array, now: Forces
    ) -> tuple[jax.Array, jax.Array, jax.Array]:
        """Which links come to rest, rebound velocities and impulses by Newton's law.

        The latter two are 0 in links that do not collide. A link is put at rest when its remaining
        bounces would take less than 1 % of a step (Zeno).
        """
        if not self.laws.has_newton:
            return collides, jnp.zeros_like(speed), jnp.zeros_like(speed)
        mass, restitution = self.laws.mass, self.laws.restitution
        pull_in = now.acceleration
        pull_out = pull_in + 2 * self.inputs.friction / mass
        inward = jnp.where(pull_in > 0, pull_in, 1.0)
        outward = jnp.where(pull_in > 0, pull_out, 1.0)
        shrinkage = restitution * jnp.sqrt(inward / outward)
        flight = restitution * speed * (1 / outward + 1 / jnp.sqrt(inward * outward))
        ends = flight <= _REBOUNDS * self.h * (1 - shrinkage)
        # A sticking link pressed into contact arrives with zero speed, up to rounding.
        still = speed <= 32 * self.eps * self.h * (jnp.abs(pull_in) + pull_out)
        rests = collides & (((pull_in > 0) & ends) | still)
        rebound = jnp.where(collides & ~rests, restitution * speed, 0.0)
        return rests, rebound, jnp.where(collides, (speed + rebound) * mass, 0.0)

    def _record_turns(
        self, x: FlowState, s: jax.Array, turned: jax.Array, slip: jax.Array
    ) -> FlowState:
        """The state with closings recorded where velocities vanished or reversed."""
        log, time = x.log, x.y[0] - self.h / 2
        turned_before = turned & (log.turns > 0)
        farther = turned & (s > log.farthest)
        path = jnp.abs(s - log.last_turn)
        log = log._replace(
            turns=larger(log.turns, jnp.where(turned, 1.0, 0.0)),
            first_turn=jnp.where(turned & (log.turns == 0), s, log.first_turn),
            last_turn=jnp.where(turned, s, log.last_turn),
            between=log.between + jnp.where(turned_before, path, 0.0),
            farthest=jnp.where(farther, s, log.farthest),
            farthest_time=jnp.where(farther, time, log.farthest_time),
            change_time=jnp.where(slip != x.regime.slip, time, log.change_time),
        )
        return x._replace(log=log)

    # -- the end ------------------------------------------------------------------------------

    def result(self, x: FlowState) -> FlowResult:
        """The result of a flow from the state in which it ended."""
        at, regime = SmoothState(*x.y), x.regime
        mode = jnp.where(regime.mode == PRESSED, CLIPPED, regime.mode)
        inverse = held_inverse(self.inputs.delassus, regime.held)
        end = self.forces(x.y, regime._replace(mode=mode), inverse)
        result = FlowResult(
            closing=at.s,
            velocity=at.w,
            acceleration=end.acceleration,
            held=jnp.where(regime.held, 1.0, 0.0).astype(self.dtype),
            mean=at.area / self.h,
            stored=at.stored,
            lost=at.lost,
            mode=regime.mode,
            counts=x.counts,
            fastest=x.fastest,
            under_way=self._under_way(x),
            now=x.now,
            log=x.log,
        )
        poison = jnp.where(x.stage == 3, 1.0, jnp.nan).astype(self.dtype)
        return jax.tree.map(lambda a: a * poison, result)


def _nonzero(x: jax.Array) -> jax.Array:
    return jnp.where(x == 0, 1.0, x)


def _newton(value: jax.Array, slope: jax.Array) -> jax.Array:
    """−value / slope with the slope held fixed; 0 where that is 0."""
    slope = lax.stop_gradient(slope)
    return jnp.where(slope == 0, 0.0, -value / _nonzero(slope))


def _root_factor(y0: Any, slope: Any, bend: Any) -> jax.Array:
    """q, so that y0 + slope t + bend t² has the roots y0 / q and q / bend: they do not cancel."""
    root = jnp.sqrt(larger(slope**2 - 4 * bend * y0, 0.0))
    return -0.5 * (slope + jnp.where(slope < 0, -root, root))


def _crossing(y0: Any, slope0: Any, y1: Any, slope1: Any, length: Any) -> jax.Array:
    """Where a cubic that changes its sign from 0 to ``length`` vanishes, by safeguarded Newton."""
    d0, d1 = slope0 * length, slope1 * length
    bend, twist = 3 * (y1 - y0) - 2 * d0 - d1, 2 * (y0 - y1) + d0 + d1
    low, high = jnp.zeros_like(y0), jnp.ones_like(y0)
    # Start from the parabola through both values with the first slope.
    curve = y1 - y0 - d0
    q = _root_factor(y0, d0, curve)
    x = y0 / _nonzero(q)
    x = jnp.where((x >= 0) & (x <= 1), x, jnp.clip(q / _nonzero(curve), 0.0, 1.0))
    for _ in range(5):
        y = y0 + x * (d0 + x * (bend + x * twist))
        before = y * jnp.sign(y1) < 0
        low, high = jnp.where(before, x, low), jnp.where(before, high, x)
        step = x - y / _nonzero(d0 + x * (2 * bend + x * 3 * twist))
        x = jnp.where((step >= low) & (step <= high), step, (low + high) / 2)
    return x * length
