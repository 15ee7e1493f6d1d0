r"""The local flow: links that share masses over one step, from event to event.

Within a step the links see only the pull A(t) of the rods and the ground, linear in time:

    s'' = A(t) − G (q + p),    q ∈ μ Sgn(s'),    p = p(s − ξ0, s'),    G = B_lᵀ M⁻¹ B_l,

with closings s, friction q and contact forces p. This small problem is solved as it stands,
whatever happens in it: slip ends, stick breaks, a gap closes, a contact lets go. Between events
the motion is smooth. Where no law of contact has a force it is a cubic in time. Elsewhere it is
followed by an embedded Runge–Kutta method of order 8: the stiffness of a contact sets its
substeps, never the step of the run. Both say where the links are at any time of a substep, and so
where an event is in it. A last Newton step in time, whose slope is held fixed, leads to the event:
so derivatives contain how its instant moves.
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
    Forces,
    LinkLaws,
    Phase,
    held_inverse,
    times,
)
from jaxpound.simulation.passage import (
    SOFT,
    Given,
    Impacts,
    MidStep,
    Modes,
    Passed,
    Record,
    UnderWay,
)
from jaxpound.simulation.runge_kutta import END, STAGES, error, until, weighted

MOST = 4000  # iterations in a step
_AT_ONCE = 1e-10  # share of a step within which events are at the same instant
_NEAR = 0.05  # longest Newton step to an event, as a share of the substep
_JUST = 1.001  # length of a substep that should end just beyond an event, in units of its time
_NEWTON = 2  # Newton steps to an event before the one that is differentiated
_REBOUNDS = 1e-2  # rebounds that would all be over within this share of a step end at once
_SLOWEST = 1e-2  # touch speed below this share of what the pull adds in a step is set to it


class Smooth(NamedTuple):
    """What moves smoothly between events, (n,) each; as an array, its rows."""

    t: jax.Array  # from the start of the step, the same for all links
    s: jax.Array
    w: jax.Array
    area: jax.Array  # ∫ s dt
    stored: jax.Array
    lost: jax.Array
    impulse: jax.Array


class _State(NamedTuple):
    """Where a flow is."""

    y: jax.Array  # a ``Smooth``, (7, n)
    phase: Phase
    touch_time: jax.Array
    peak_force: jax.Array
    counts: jax.Array
    fastest: jax.Array
    rising: jax.Array  # 1 while the contact force grows
    now: MidStep
    record: Record
    half: jax.Array  # 0 before the middle of the step, 1 in it, 2 after it, 3 at the end
    iterations: jax.Array
    moves: jax.Array  # iterations that were not in vain
    length: jax.Array  # of the substep to try
    usual: jax.Array  # length that the error allows
    again: jax.Array  # 1 if the last one tried was too long


class _Substep(NamedTuple):
    """A substep that has been tried."""

    length: jax.Array
    begin: Forces
    seen: Forces  # at its end, in the phase of its start
    end: jax.Array  # a ``Smooth``
    slopes: jax.Array  # of s, w and the quadratures in the stages, if laws have forces
    error: jax.Array  # in units of the tolerance
    growth: jax.Array  # of each law's force at the start, and at the end
    growth_end: jax.Array


class _Event(NamedTuple):
    """The first event in a substep."""

    time: jax.Array  # from the start of the substep, inf if there is none
    which: jax.Array  # its index
    stop: jax.Array  # the next instant at which the flow stops in any case


class Problem:
    """The equations of a flow, and one iteration of it."""

    def __init__(self, h: float, slots: int, given: Given) -> None:
        self.h, self.slots, self.given = h, slots, given
        self.n, self.dtype = given.closing.shape[0], given.closing.dtype
        self.eps = float(jnp.finfo(self.dtype).eps)
        self.tolerance = 1e-8 if self.eps < 1e-10 else 1e-5
        self.laws = LinkLaws(given.delassus, given.friction, given.gap, given.laws)
        laws = self.laws
        self.events = ["turn", "breaks"]
        self.events += ["touch"] if laws.touches else []
        self.events += ["leaves"] if laws.collides else []
        self.events += ["release", "clip", "top"] if laws.restless else []

    def forces(self, y: jax.Array, phase: Phase, inverse: jax.Array) -> Forces:
        """The forces at a place."""
        at = Smooth(*y)
        return self.laws.at(self.pull(at.t), at.s, at.w, phase, inverse)

    def pull(self, t: jax.Array) -> jax.Array:
        """A at times from the start of the step."""
        return self.given.pull + self.given.rise * (t / self.h - 0.5)

    def start(self, modes: Modes) -> _State:
        """The state in which a flow starts."""
        given = self.given
        # Not constants: transformations of a loop then find at once what differs in it.
        zeros = 0 * given.closing
        none = zeros[0].astype(int)
        begin = modes.start + zeros[0]
        y = Smooth(
            t=begin + zeros,
            s=given.closing,
            w=given.velocity,
            area=given.closing * begin,
            stored=zeros,
            lost=zeros,
            impulse=given.under_way.impulse,
        )
        slip = jnp.sign(lax.stop_gradient(given.velocity))
        slots = jnp.repeat(zeros[:, None], self.slots, 1)
        impacts = Impacts(*[slots] * len(Impacts._fields))
        touched = jnp.where(modes.contact == APART, 0.0, 1.0).astype(self.dtype)
        nothing: Any = dict.fromkeys(Record._fields, zeros)
        nothing |= {"impacts": impacts, "highest_forces": zeros[:, None] * given.delassus}
        record = Record(**nothing)._replace(touched=touched, farthest=zeros - jnp.inf)
        return _State(
            y=jnp.stack(y),
            phase=Phase(slip, modes.contact, given.under_way.touch_speed),
            touch_time=given.under_way.touch_time,
            peak_force=given.under_way.peak_force,
            counts=modes.counts,
            fastest=modes.fastest,
            rising=jnp.where(modes.contact == PRESSED, 1.0, 0.0).astype(self.dtype),
            now=MidStep(
                given.closing,
                given.velocity,
                *(zeros,) * 5,
                modes.contact,
                modes.counts,
                given.under_way,
                zeros,
                zeros,
            ),
            record=record,
            half=none,
            iterations=none,
            moves=none,
            length=jnp.asarray(self.h / 2, self.dtype) - begin,
            usual=self.h + zeros[0],
            again=zeros[0],
        )

    def unfinished(self, x: _State) -> jax.Array:
        """Whether there is more of the step to follow."""
        finite = jnp.isfinite(x.y).all() & jnp.isfinite(self.given.pull).all()
        return (x.half < 3) & (x.iterations < MOST) & finite

    def advance(self, x: _State) -> _State:
        """Try a substep; move to its end, or to an event in it, or set out for a shorter one."""
        inverse = held_inverse(self.given.delassus, x.phase.held)
        sub = self._substep(x, inverse)
        stop = self._stop(x)
        flies = ~x.phase.deformed.any()
        event = self._first_event(x, sub, stop)
        exists, at_once = jnp.isfinite(event.time), event.time <= _AT_ONCE * self.h
        wrong = (sub.error > 1) & ~flies

        fixed = Problem(self.h, self.slots, lax.stop_gradient(self.given))
        time = fixed.located(*lax.stop_gradient((x, sub, event, inverse)))
        time = jnp.where(at_once, 0.0, time)
        place = jnp.where(at_once, x.y, self._along(x, sub, time))
        now = self.forces(place, x.phase, inverse)
        # A flight may close a gap and open it again before another event.
        touch = self._is("touch", event.which)
        passes = flies & (self._closes(x, Smooth(*x.y), Smooth(*place)) & ~touch).any()
        moves = ~wrong & (~exists | ~passes | at_once)
        happens = exists & moves
        step = self._correction(x, sub, event, place, now, time)
        most = jnp.where(at_once, 1e-3 * self.h, _NEAR * sub.length)
        sure = jnp.abs(lax.stop_gradient(step)) <= most
        place = place + jnp.where(happens & sure, step, 0.0) * self._rates(place, now)
        after = self._noted(x, sub, moves)
        after = after._replace(
            y=jnp.where(moves, place, x.y),
            rising=jnp.where(moves, jnp.where(sub.growth_end > 0, 1.0, 0.0), x.rising),
            iterations=x.iterations + 1,
            moves=x.moves + jnp.where(moves, 1, 0),
        )
        after = self._highest(after, now, moves)
        after = self._happened(after, now, jnp.where(happens, event.which, -1), at_once)
        return self._next_length(after, x, sub, event, wrong, moves)

    def _next_length(
        self,
        after: _State,
        x: _State,
        sub: _Substep,
        event: _Event,
        wrong: jax.Array,
        moves: jax.Array,
    ) -> _State:
        """The state with the next substep to try."""
        left = larger(lax.stop_gradient(self._stop(after) - after.y[0, 0]), 0.0)
        # Where a law is singular, as at touch, the error falls slowly with the length.
        power = jnp.where(wrong, -0.25, -0.125)
        factor = 0.9 * larger(sub.error, 1e-8) ** power
        factor = jnp.clip(factor, 0.05, jnp.where(x.again > 0, 1.0, 4.0))
        usual = jnp.where(wrong, sub.length * factor, larger(sub.length * factor, x.usual))
        usual = jnp.where(x.phase.deformed.any(), jnp.minimum(usual, self.h), x.usual)
        length = jnp.where(after.phase.deformed.any(), smaller(usual, left), left)
        # Beyond an event a law may be smooth no more, and a gap that a flight closes is met first.
        short = event.time < jnp.where(wrong, 0.9, 1.0) * sub.length
        aims = ~moves & short & (event.time > _AT_ONCE * self.h)
        aim = jnp.minimum(_JUST * event.time, left)
        return after._replace(
            usual=lax.stop_gradient(usual),
            again=jnp.where(wrong, 1.0, 0.0).astype(self.dtype),
            length=lax.stop_gradient(jnp.where(aims, aim, length)),
        )

    # -- a substep ----------------------------------------------------------------------------

    def _substep(self, x: _State, inverse: jax.Array) -> _Substep:
        length = lax.stop_gradient(x.length)
        begin = self.forces(x.y, x.phase, inverse)
        if not self.laws.restless:
            seen = self.forces(x.y.at[0].add(length), x.phase, inverse)
            none = 0 * x.y[0]
            sub = _Substep(length, begin, seen, x.y, none, none[0], none, none)
            return sub._replace(end=self._along(x, sub, length))

        slopes, worst = self._pushed(x, inverse, length, begin.acceleration)
        end = x.y.at[1:].add(length * weighted(jnp.asarray(END, self.dtype), slopes))
        end = end.at[0].add(length)
        seen = self.forces(end, x.phase, inverse)
        start, last = Smooth(*x.y), Smooth(*end)
        grows = (
            self.laws.growth(start.s, start.w, begin.acceleration, x.phase),
            self.laws.growth(last.s, last.w, seen.acceleration, x.phase),
        )
        grows = lax.stop_gradient(grows)
        sub = _Substep(length, begin, seen, end, slopes, worst, *grows)
        return sub._replace(end=self._along(x, sub, length))

    def _along(self, x: _State, sub: _Substep, time: jax.Array) -> jax.Array:
        """Where links are a ``time`` after the start of a substep.

        Without a law's force, accelerations and the forces between links at rest change linearly in
        time from ``sub.begin`` to ``sub.seen``.
        """
        at, begin, seen = Smooth(*x.y), sub.begin, sub.seen
        share = time / jnp.where(sub.length > 0, sub.length, 1.0)
        a, gain = begin.acceleration, share * (seen.acceleration - begin.acceleration)
        pressing = begin.contact + share / 2 * (seen.contact - begin.contact)
        pressing = time * jnp.where(x.phase.mode == REST, pressing, 0.0)
        flown = Smooth(
            t=at.t + time,
            s=at.s + time * (at.w + time * (a / 2 + gain / 6)),
            w=at.w + time * (a + gain / 2),
            area=at.area + time * (at.s + time * (at.w / 2 + time * (a / 6 + gain / 24))),
            stored=at.stored,
            lost=at.lost,
            impulse=at.impulse + pressing,
        )
        if not self.laws.restless:
            return jnp.stack(flown)
        moved = x.y[1:] + sub.length * weighted(until(share), sub.slopes)
        pushed = Smooth(flown.t, *moved)
        pushed = pushed._replace(impulse=pushed.impulse + pressing)
        return jnp.where(x.phase.deformed.any(), jnp.stack(pushed), jnp.stack(flown))

    def _pushed(
        self, x: _State, inverse: jax.Array, length: jax.Array, first: jax.Array
    ) -> tuple[jax.Array, jax.Array]:
        """Slopes of all that laws' forces move in the stages of a step, and its estimated error.

        The error is in units of the tolerance; ``first`` are the accelerations at the start.
        """
        laws, phase, at = self.laws, x.phase, Smooth(*x.y)
        rise = self.given.rise / self.h
        free, rise, yields = laws.affine(self.pull(at.t), rise, phase, inverse)

        def rates(motion: jax.Array, time: jax.Array) -> jax.Array:
            s, w = motion
            raw, elastic = laws.of_contact(s, w, phase)
            contact = jnp.where(phase.mode == PRESSED, raw, 0.0)
            elastic = jnp.where(phase.deformed, elastic, 0.0)
            a = free + time * rise - times(yields, contact)
            return jnp.stack([w, a, s, elastic * w, (contact - elastic) * w, contact])

        start = jnp.stack([at.s, at.w])

        # A loop over the stages, not one after the other: the program is long enough.
        def stage(slopes: jax.Array, entry: Any) -> Any:
            i, row = entry
            motion = start + length * weighted(row, slopes[:, :2])
            return slopes.at[i].set(rates(motion, row.sum() * length)), None

        table = jnp.asarray(STAGES, self.dtype)
        slopes = jnp.broadcast_to(0 * at.s, (len(table), 6, self.n))
        slopes, _ = lax.scan(stage, slopes, (jnp.arange(len(table)), table))

        w = at.w + length * weighted(jnp.asarray(END, self.dtype), slopes[:, 1])
        sizes = larger(jnp.abs(at.w), jnp.abs(w)) + length * jnp.abs(first)
        sizes = sizes + jnp.where(phase.mode == PRESSED, phase.touch_speed, 0.0)
        sizes = self.tolerance * lax.stop_gradient(sizes) + jnp.finfo(self.dtype).tiny
        wrong = error(lax.stop_gradient(slopes[:, :2]))
        worst = (larger(length * wrong[1], wrong[0]) / sizes).max()
        return slopes, jnp.where(worst < 1e8, worst, 1e8)

    def _rates(self, y: jax.Array, now: Forces) -> jax.Array:
        """By how much what moves smoothly grows in time."""
        at = Smooth(*y)
        rates = Smooth(
            t=jnp.ones_like(at.t),
            s=at.w,
            w=now.acceleration,
            area=at.s,
            stored=now.elastic * at.w,
            lost=(now.contact - now.elastic) * at.w,
            impulse=now.contact,
        )
        return jnp.stack(rates)

    def _stop(self, x: _State) -> jax.Array:
        """The next instant at which the flow stops in any case: mid-step, or the end."""
        return jnp.where(x.half < 1, self.h / 2, self.h)

    def _noted(self, x: _State, sub: _Substep, moves: jax.Array) -> _State:
        """Forces at the start of the substep: the largest so far, and those in mid-step.

        An attempt that does not move changes nothing, as reverse mode leaves it out.
        """
        now, mid, at = sub.begin, moves & (x.half == 1), Smooth(*x.y)
        x = self._highest(x, now, moves)
        seen = MidStep(
            closing=at.s,
            velocity=at.w,
            friction=now.friction,
            contact=now.contact,
            stored=at.stored,
            lost=at.lost,
            held=jnp.where(x.phase.held, 1.0, 0.0).astype(self.dtype),
            mode=x.phase.mode,
            counts=x.counts,
            under_way=self._under_way(x),
            strongest=x.record.strongest,
            powers=x.record.powers,
        )
        return x._replace(
            now=jax.tree.map(lambda a, b: jnp.where(mid, a, b), seen, x.now),
            half=jnp.where(mid, 2, x.half),
        )

    def _under_way(self, x: _State) -> UnderWay:
        return UnderWay(x.phase.touch_speed, x.touch_time, Smooth(*x.y).impulse, x.peak_force)

    def _highest(self, x: _State, now: Forces, valid: jax.Array) -> _State:
        """The largest contact force so far, of the step and of the impact."""
        if not self.laws.touches:
            return x
        record = x.record
        higher = valid & (now.contact > record.highest)
        record = record._replace(
            highest=jnp.where(higher, now.contact, record.highest),
            highest_time=jnp.where(higher, x.y[0] - self.h / 2, record.highest_time),
            highest_forces=jnp.where(higher[:, None], now.total, record.highest_forces),
        )
        peak = jnp.where(valid & (now.contact > x.peak_force), now.contact, x.peak_force)
        return x._replace(record=record, peak_force=peak)

    # -- events -------------------------------------------------------------------------------

    def _is(self, name: str, which: jax.Array) -> jax.Array:
        """Links, (n,), whose event of a name has the index ``which``."""
        if name not in self.events:
            return jnp.zeros(self.n, bool)
        return jnp.arange(self.n) == which - self.events.index(name) * self.n

    def _first_event(self, x: _State, sub: _Substep, stop: jax.Array) -> _Event:
        """The first event in a substep."""
        sub, at = lax.stop_gradient((sub, Smooth(*x.y)))
        length = sub.length
        times = {**self._events_of_friction(x, sub, at), **self._events_of_contact(x, sub, at)}
        at_stop = at.t[0] + length >= stop - 1e-12 * self.h
        every = jnp.concatenate([times[name] for name in self.events])
        every = jnp.append(every, jnp.where(at_stop, stop - at.t[0], jnp.inf))
        every = jnp.where(jnp.isinf(every), every, jnp.clip(every, 0.0, length))
        which = jnp.argmin(every)
        return _Event(every[which], which, stop)

    def _events_of_friction(self, x: _State, sub: _Substep, at: Smooth) -> dict[str, jax.Array]:
        """When slip and stick end, from the start of the substep; inf if they do not."""
        begin, seen, end, length = sub.begin, sub.seen, Smooth(*sub.end), sub.length
        a0, eps, never = begin.acceleration, 32 * self.eps, jnp.inf
        slip, rest = x.phase.slip, x.phase.mode == REST
        friction = lax.stop_gradient(self.given.friction)

        # The speed along the slip is a quadratic function.
        u0, slope, u1 = slip * at.w, slip * a0, slip * end.w
        bend = (u1 - u0 - slope * length) / jnp.where(length > 0, length, 1.0) ** 2
        noise = eps * (jnp.abs(at.w) + jnp.abs(end.w) + length * jnp.abs(a0))
        lowest = u0 - slope**2 / jnp.where(bend > 0, 4 * bend, 1.0)
        dips = (bend > 0) & (slope < 0) & (-slope < 2 * bend * length) & (lowest < -noise)
        root = jnp.sqrt(larger(slope**2 - 4 * bend * u0, 0.0))
        q = -0.5 * (slope + jnp.where(slope < 0, -root, root))
        before = jnp.where(slope < 0, u0, q) / _nonzero(jnp.where(slope < 0, q, bend))
        turn = jnp.where((slip != 0) & ~rest & ((u1 < -noise) | dips), before, never)

        noise = eps * (jnp.abs(begin.total) + jnp.abs(seen.total) + friction)
        limit = jnp.sign(seen.friction) * friction
        before = (limit - begin.friction) / _nonzero(seen.friction - begin.friction) * length
        before = jnp.where(jnp.abs(begin.friction) > friction + noise, 0.0, before)
        over = larger(jnp.abs(begin.friction), jnp.abs(seen.friction)) > friction + noise
        breaks = jnp.where((slip == 0) & ~rest & over, before, never)
        if not self.laws.collides:
            return {"turn": turn, "breaks": breaks}

        # What keeps a gap closed would have to pull.
        least = -friction - noise
        before = (-friction - begin.total) / _nonzero(seen.total - begin.total) * length
        before = jnp.where(begin.total < least, 0.0, before)
        below = rest & (smaller(begin.total, seen.total) < least)
        return {"turn": turn, "breaks": breaks, "leaves": jnp.where(below, before, never)}

    def _events_of_contact(self, x: _State, sub: _Substep, at: Smooth) -> dict[str, jax.Array]:
        """When gaps close and contacts let go, from the start of the substep."""
        if not self.laws.touches:
            return {}
        laws, mode, length, never = self.laws, x.phase.mode, sub.length, jnp.inf
        end = Smooth(*sub.end)
        gap = lax.stop_gradient(laws.gap)
        depth0, depth1 = at.s - gap, end.s - gap
        crosses = _crossing(depth0, at.w, depth1, end.w, length)
        closes = self._closes(x, at, end)
        touch = jnp.where(closes, jnp.where(depth0 >= 0, 0.0, crosses), never)
        if not laws.restless:
            return {"touch": touch}
        opens = x.phase.deformed & (depth1 < 0) & (depth1 < depth0) & ((depth0 > 0) | (at.w <= 0))
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

    def _closes(self, x: _State, at: Smooth, end: Smooth) -> jax.Array:
        """Links, (n,), whose gap closes from one place to another."""
        gap = lax.stop_gradient(self.laws.gap)
        apart = self.laws.meets & (x.phase.mode == APART)
        # A flight that begins in touch and ends in it turns first.
        turns = (at.s >= gap) & (at.w < 0)
        return apart & (end.s > gap) & (end.s > at.s) & ~turns

    def located(self, x: _State, sub: _Substep, event: _Event, inverse: jax.Array) -> jax.Array:
        """The time of an event from the start of a substep, or its length if there is none."""
        first = jnp.where(jnp.isfinite(event.time), event.time, sub.length)
        most = _NEAR * sub.length

        def nearer(_: Any, time: jax.Array) -> jax.Array:
            place = self._along(x, sub, time)
            now = self.forces(place, x.phase, inverse)
            step = self._correction(x, sub, event, place, now, time)
            return jnp.clip(time + jnp.clip(step, -most, most), 0.0, sub.length)

        return lax.fori_loop(0, _NEWTON, nearer, first)

    def _correction(
        self,
        x: _State,
        sub: _Substep,
        event: _Event,
        place: jax.Array,
        now: Forces,
        time: jax.Array,
    ) -> jax.Array:
        """The Newton step in time to an event from a place near it, a ``time`` into the substep.

        Its derivative is that of the event's instant.
        """
        at, laws, begin, seen = Smooth(*place), self.laws, sub.begin, sub.seen

        def between(first: jax.Array, value: jax.Array, last: jax.Array) -> jax.Array:
            """The step where but values at the ends of the substep are known beside this one."""
            before, after = time, sub.length - time
            slope = (value - first) / _nonzero(before) + (last - value) / _nonzero(after)
            step = _newton(value, slope - (last - first) / _nonzero(sub.length))
            return jnp.where(time > 0, step, 0.0)

        steps = {"turn": _newton(at.w, now.acceleration)}
        sign, friction = jnp.sign(seen.friction), self.given.friction
        excess = [sign * one.friction - friction for one in (begin, now, seen)]
        steps["breaks"] = between(*excess)
        if laws.touches:
            steps["touch"] = _newton(at.s - laws.gap, at.w)
        if laws.collides:
            excess = [one.total + friction for one in (begin, now, seen)]
            steps["leaves"] = between(*excess)
        if laws.restless:
            steps["release"] = steps["touch"]
            growth = laws.growth(at.s, at.w, now.acceleration, x.phase)
            steps["clip"] = _newton(now.raw, growth)
            steps["top"] = between(sub.growth, growth, sub.growth_end)
        every = jnp.concatenate([steps[name] for name in self.events])
        every = jnp.append(every, event.stop - at.t[0])
        chosen = (jnp.arange(every.size) == event.which) & jnp.isfinite(event.time)
        return jnp.where(chosen, every, 0.0).sum()

    def _happened(self, x: _State, now: Forces, which: jax.Array, at_once: jax.Array) -> _State:
        """The state after an event, with the forces just before it; index −1 is none."""
        turn, breaks = self._is("turn", which), self._is("breaks", which)
        at, phase = Smooth(*x.y), x.phase
        half = x.half + jnp.where(which == len(self.events) * self.n, 1, 0)
        touch, leaves = self._is("touch", which), self._is("leaves", which)
        release, clip = self._is("release", which), self._is("clip", which)
        rigid = self.laws.rigid
        collides, speed = touch & rigid, at.w
        rests, rebound, blow = self._collision(speed, collides, now)
        jump = jnp.where(collides.any(), times(self.given.delassus, blow), 0.0)
        w = jnp.where(collides, -rebound, jnp.where(turn, 0.0, at.w - jump))
        shaken = times(self.given.delassus, jnp.where(collides, 1.0, 0.0)) != 0
        struck = collides.any() & ~collides & shaken

        # Directions of slip and modes of contact.
        slip = jnp.where(struck | collides, jnp.sign(w), phase.slip)
        slip = jnp.where(breaks, jnp.sign(now.friction), slip)
        slip = jnp.where(turn | rests, 0.0, jnp.where(leaves, -1.0, slip))
        slip = lax.stop_gradient(slip)
        mode = jnp.where(touch & ~rigid, PRESSED, phase.mode)
        mode = jnp.where(rests, REST, mode)
        mode = jnp.where(leaves | release | (struck & (phase.mode == REST)), APART, mode)
        mode = jnp.where(clip, jnp.where(phase.mode == PRESSED, CLIPPED, PRESSED), mode)
        # Where the gap is known to be closed exactly.
        s = jnp.where((touch | release) & ~at_once, self.laws.gap, at.s)

        # The impacts that begin and end.
        time = at.t - self.h / 2
        counts = touch & (speed > 1e-4 * x.fastest) & (speed > 0)
        counted = jnp.where(touch, jnp.where(counts, 1.0, 0.0), x.counts).astype(self.dtype)
        slowest = lax.stop_gradient(_SLOWEST * self.h * jnp.abs(now.acceleration))
        peak = jnp.where(touch, 0.0, x.peak_force)
        impulse = jnp.where(touch, blow, at.impulse)
        touch_time = jnp.where(touch, time, x.touch_time)
        touch_speed = jnp.where(touch, larger(speed, slowest), phase.touch_speed)
        over = (release | collides) & (counted > 0)
        record = x.record
        slot = over[:, None] & (jnp.arange(self.slots)[None] == record.ended[:, None])
        entries = Impacts(touch_time, touch_speed, time, -w, impulse, peak)
        record = record._replace(
            touched=larger(record.touched, jnp.where(touch, 1.0, 0.0)),
            touches=record.touches + jnp.where(counts, 1.0, 0.0),
            first_touch=jnp.where(counts & (record.touches == 0), time, record.first_touch),
            ended=record.ended + jnp.where(over, 1.0, 0.0),
            strongest=jnp.where(over & (impulse > record.strongest), impulse, record.strongest),
            powers=record.powers + jnp.where(over, peak**SOFT, 0.0),
            impacts=jax.tree.map(
                lambda a, b: jnp.where(slot, a[:, None], b), entries, record.impacts
            ),
        )
        turned = turn | collides | (struck & (phase.slip != 0) & (slip != phase.slip))
        x = x._replace(record=record)
        x = self._turned(x, s, turned, slip)
        lost = at.lost + blow * (speed - rebound) / 2
        top = self._is("top", which)
        return x._replace(
            y=jnp.stack(at._replace(s=s, w=w, lost=lost, impulse=impulse)),
            phase=Phase(slip, mode, touch_speed),
            touch_time=touch_time,
            peak_force=peak,
            counts=counted,
            fastest=lax.stop_gradient(jnp.where(touch, larger(x.fastest, speed), x.fastest)),
            rising=jnp.where(touch, 1.0, jnp.where(top, 0.0, x.rising)),
            half=half,
        )

    def _collision(
        self, speed: jax.Array, collides: jax.Array, now: Forces
    ) -> tuple[jax.Array, jax.Array, jax.Array]:
        """Which links come to rest, rebound velocities and impulses by Newton's law.

        The latter two are 0 in links that do not collide. A link comes to rest at once if all
        rebounds to come were over in no time.
        """
        if not self.laws.collides:
            return collides, jnp.zeros_like(speed), jnp.zeros_like(speed)
        mass, restitution = self.laws.mass, self.laws.restitution
        pull_in = now.acceleration
        pull_out = pull_in + 2 * self.given.friction / mass
        inward = jnp.where(pull_in > 0, pull_in, 1.0)
        outward = jnp.where(pull_in > 0, pull_out, 1.0)
        again = restitution * jnp.sqrt(inward / outward)
        flight = restitution * speed * (1 / outward + 1 / jnp.sqrt(inward * outward))
        ends = flight <= _REBOUNDS * self.h * (1 - again)
        # One that is pressed into touch from stick has no speed but by rounding.
        still = speed <= 32 * self.eps * self.h * (jnp.abs(pull_in) + pull_out)
        rests = collides & (((pull_in > 0) & ends) | still)
        rebound = jnp.where(collides & ~rests, restitution * speed, 0.0)
        return rests, rebound, jnp.where(collides, (speed + rebound) * mass, 0.0)

    def _turned(self, x: _State, s: jax.Array, turned: jax.Array, slip: jax.Array) -> _State:
        """The state with closings recorded where velocities vanished or reversed."""
        record, time = x.record, x.y[0] - self.h / 2
        once_more = turned & (record.turns > 0)
        farther = turned & (s > record.farthest)
        path = jnp.abs(s - record.last_turn)
        record = record._replace(
            turns=larger(record.turns, jnp.where(turned, 1.0, 0.0)),
            first_turn=jnp.where(turned & (record.turns == 0), s, record.first_turn),
            last_turn=jnp.where(turned, s, record.last_turn),
            between=record.between + jnp.where(once_more, path, 0.0),
            farthest=jnp.where(farther, s, record.farthest),
            farthest_time=jnp.where(farther, time, record.farthest_time),
            change_time=jnp.where(slip != x.phase.slip, time, record.change_time),
        )
        return x._replace(record=record)

    # -- the end ------------------------------------------------------------------------------

    def passed(self, x: _State) -> Passed:
        """The result of a flow from the state in which it ended."""
        at, phase = Smooth(*x.y), x.phase
        mode = jnp.where(phase.mode == PRESSED, CLIPPED, phase.mode)
        inverse = held_inverse(self.given.delassus, phase.held)
        end = self.forces(x.y, phase._replace(mode=mode), inverse)
        passed = Passed(
            closing=at.s,
            velocity=at.w,
            acceleration=end.acceleration,
            held=jnp.where(phase.held, 1.0, 0.0).astype(self.dtype),
            mean=at.area / self.h,
            stored=at.stored,
            lost=at.lost,
            mode=phase.mode,
            counts=x.counts,
            fastest=x.fastest,
            under_way=self._under_way(x),
            now=x.now,
            record=x.record,
        )
        poison = jnp.where(x.half == 3, 1.0, jnp.nan).astype(self.dtype)
        return jax.tree.map(lambda a: a * poison, passed)


def _nonzero(x: jax.Array) -> jax.Array:
    return jnp.where(x == 0, 1.0, x)


def _newton(value: jax.Array, slope: jax.Array) -> jax.Array:
    """−value / slope with the slope held fixed; 0 where that is 0."""
    slope = lax.stop_gradient(slope)
    return jnp.where(slope == 0, 0.0, -value / _nonzero(slope))


def _crossing(y0: Any, slope0: Any, y1: Any, slope1: Any, length: Any) -> jax.Array:
    """Where a cubic that changes its sign from 0 to ``length`` vanishes, by safeguarded Newton."""
    d0, d1 = slope0 * length, slope1 * length
    bend, twist = 3 * (y1 - y0) - 2 * d0 - d1, 2 * (y0 - y1) + d0 + d1
    low, high = jnp.zeros_like(y0), jnp.ones_like(y0)
    # Start from the parabola through both values with the first slope.
    curve = y1 - y0 - d0
    root = jnp.sqrt(larger(d0**2 - 4 * curve * y0, 0.0))
    q = -0.5 * (d0 + jnp.where(d0 < 0, -root, root))
    x = y0 / _nonzero(q)
    x = jnp.where((x >= 0) & (x <= 1), x, jnp.clip(q / _nonzero(curve), 0.0, 1.0))
    for _ in range(5):
        y = y0 + x * (d0 + x * (bend + x * twist))
        before = y * jnp.sign(y1) < 0
        low, high = jnp.where(before, x, low), jnp.where(before, high, x)
        step = x - y / _nonzero(d0 + x * (2 * bend + x * 3 * twist))
        x = jnp.where((step >= low) & (step <= high), step, (low + high) / 2)
    return x * length
