r"""The local flow: links that share masses over one step, from event to event.

Within a step the links see only the pull A(t) of the rods and the ground, linear in time:

    s'' = A(t) − G (q + p),    q ∈ μ Sgn(s'),    p = p(s − ξ0, s'),    G = B_lᵀ M⁻¹ B_l,

with closings s, friction q and contact forces p. This small problem is solved as it stands,
whatever happens in it: slip ends, stick breaks, a gap closes, a contact lets go. Between events
the motion is smooth and is followed by an embedded Runge–Kutta method of order 8, which is exact
where no contact acts; the stiffness of a contact sets its substeps, never the step of the run.
Events are located by interpolation, then moved to by a Newton step whose slope is held fixed, so
that derivatives contain how the event's instant moves.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jax.flatten_util import ravel_pytree

from jaxpound._extrema import larger, smaller
from jaxpound.model.contact import Newton, bound, may_pull
from jaxpound.simulation.lanes import where_needed
from jaxpound.simulation.runge_kutta import STAGES, error, weighted

APART, PRESSED, CLIPPED, REST = 0.0, 1.0, 2.0, 3.0
"""A link's contact: apart; a law's force acts; it would pull, so that there is none; at rest in
contact (Newton's law), where what keeps the gap closed is whatever it takes."""

SLOTS = 4
"""Impacts that can be recorded in one step of a link."""

_MOST = 4000  # iterations in a step
_LANDING = 1e-4  # how near to an event, as a share of the substep, the Newton step may begin
_AT_ONCE = 1e-10  # share of a step within which events are at the same instant
_FLAT = 2e-3  # the same for a maximum
_REBOUNDS = 1e-2  # rebounds that would all be over within this share of a step end at once
_SLOWEST = 1e-2  # touch speed below this share of what the pull adds in a step is set to it


class Given(NamedTuple):
    """What a flow is given for a step that ends h after it starts; (n,) each for n links.

    These are what its results are differentiated by.
    """

    closing: jax.Array
    velocity: jax.Array
    pull: jax.Array  # A in the middle of the step
    rise: jax.Array  # by how much A grows in the step
    delassus: jax.Array  # G, (n, n)
    friction: jax.Array  # μ
    gap: jax.Array  # ξ0
    laws: tuple[Any, ...]  # of contact, None for a link without
    touch_speed: jax.Array  # of the contact under way
    impulse: jax.Array  # of it so far
    peak_force: jax.Array  # of it so far
    touch_time: jax.Array  # of it, from the middle of the step


class Modes(NamedTuple):
    """What a flow starts in, and is not differentiated by."""

    contact: jax.Array  # (n,)
    counts: jax.Array  # (n,), whether the contact under way counts as an impact
    fastest: jax.Array  # (n,), largest speed of approach so far
    start: jax.Array  # 0, or h/2 if the run starts in the middle of the step
    needed: jax.Array  # whether to follow the links at all


class Impacts(NamedTuple):
    """Impacts that ended in a step, (SLOTS, n) each; times from the middle of the step."""

    touch_time: jax.Array
    approach_velocity: jax.Array
    end_time: jax.Array
    rebound_velocity: jax.Array
    impulse: jax.Array
    peak_force: jax.Array


class Passed(NamedTuple):
    """Result of a flow, (n,) each."""

    closing: jax.Array  # at the end
    velocity: jax.Array
    mean: jax.Array  # mean closing over the step
    closing_now: jax.Array  # in the middle of the step
    velocity_now: jax.Array
    friction_now: jax.Array
    contact_now: jax.Array
    stored_now: jax.Array  # gained by the energy stored in contact until then
    lost_now: jax.Array  # lost by contact until then
    held_now: jax.Array
    acceleration: jax.Array  # at the end, without the force of a contact law
    held: jax.Array  # 1 where the closing cannot change at the end: stick or rest
    mode: jax.Array  # contact at the end
    touched: jax.Array  # 1 if in contact at any time
    stored: jax.Array
    lost: jax.Array
    touch_speed: jax.Array
    touch_time: jax.Array
    impulse: jax.Array
    peak_force: jax.Array
    counts: jax.Array
    fastest: jax.Array
    touches: jax.Array  # impacts that began
    first_touch: jax.Array  # when the first of them did, from the middle of the step
    strongest: jax.Array  # largest impulse of the impacts, that under way included
    turns: jax.Array  # 1 if a velocity vanished or reversed
    first_turn: jax.Array  # closing where it first did
    last_turn: jax.Array
    between: jax.Array  # path from the first to the last
    farthest: jax.Array  # largest closing at a turn
    farthest_time: jax.Array
    change_time: jax.Array  # when the direction of slip last changed
    highest: jax.Array  # largest contact force in the step
    highest_time: jax.Array
    highest_forces: jax.Array  # q + p of all links then, (n, n): row j for link j
    impacts: Impacts


class _State(NamedTuple):
    """Where a flow is. Quantities without a comment are as in ``Passed``."""

    t: jax.Array  # from the start of the step
    length: jax.Array  # of the substep to try
    target: jax.Array  # index of the event it should end at, or −1
    tries: jax.Array  # to end at it
    usual: jax.Array  # length that the error allows
    iterations: jax.Array
    half: jax.Array  # 0 before the middle of the step, 1 in it, 2 after it, 3 at the end
    s: jax.Array
    w: jax.Array
    slip: jax.Array  # direction of slip, 0 in stick
    mode: jax.Array
    rising: jax.Array  # 1 while the contact force grows
    sum_s: jax.Array  # ∫ s dt
    stored: jax.Array
    lost: jax.Array
    touched: jax.Array
    touch_speed: jax.Array
    touch_time: jax.Array
    impulse: jax.Array
    peak_force: jax.Array
    counts: jax.Array
    fastest: jax.Array
    touches: jax.Array
    first_touch: jax.Array
    strongest: jax.Array
    turns: jax.Array
    first_turn: jax.Array
    last_turn: jax.Array
    between: jax.Array
    farthest: jax.Array
    farthest_time: jax.Array
    change_time: jax.Array
    highest: jax.Array
    highest_time: jax.Array
    highest_forces: jax.Array
    ended: jax.Array  # number of impacts recorded
    impacts: Impacts
    now: tuple[jax.Array, ...]  # closing, velocity, friction, contact, stored, lost, held there


class _Forces(NamedTuple):
    acceleration: jax.Array
    friction: jax.Array
    contact: jax.Array
    total: jax.Array
    raw: jax.Array  # what the laws say, clipped or not
    elastic: jax.Array


def flow(h: float, given: Given, modes: Modes) -> Passed:
    """The links at the end of a step of length h; NaN if there are too many events in it.

    Zero in lanes of a batch that do not need it.
    """
    return _differentiable(h)(given, modes)


@cache
def _differentiable(h: float) -> Any:
    """``flow`` with derivatives of both modes, though a loop can be differentiated forwards only.

    Reverse mode stores what is given and no more.
    """

    def follow(_: jax.Array, given: Given, modes: Modes) -> Passed:
        problem = _Problem(h, given)
        end = lax.while_loop(problem.unfinished, problem.advance, problem.start(modes))
        return problem.passed(end)

    def push(needed: jax.Array, given: Given, modes: Modes, change: Given) -> Passed:
        return jax.jvp(lambda x: follow(needed, x, modes), (given,), (change,))[1]

    def pull(needed: jax.Array, given: Given, modes: Modes, weights: Passed) -> Given:
        flat, rebuild = ravel_pytree(given)

        def by(one: jax.Array) -> jax.Array:
            changes = jax.tree.leaves(push(needed, given, modes, rebuild(one)))
            pairs = zip(changes, jax.tree.leaves(weights), strict=True)
            terms = [(change * weight).sum() for change, weight in pairs]
            return sum(terms[1:], terms[0])

        return rebuild(jax.vmap(by)(jnp.eye(flat.size, dtype=flat.dtype)))

    follow_lanes, push_lanes = where_needed(follow), where_needed(push)
    pull_lanes = where_needed(pull)

    @jax.custom_jvp
    def differentiable(given: Given, modes: Modes) -> Passed:
        return follow_lanes(modes.needed, given, modes)

    @differentiable.defjvp
    def linear(primals: Any, tangents: Any) -> Any:
        given, modes = primals
        out = differentiable(given, modes)

        # The linear map t → J t as the solution (t, J t) of [[1, 0], [−J, 1]] z = (t, 0), whose
        # transpose has the solution (a + Jᵀ b, b): so each direction has the program that suits it.
        # The system itself would only be asked for by second derivatives.
        given = jax.tree.map(_differentiated_once, given)
        change, as_given = ravel_pytree(tangents[0])
        flat, as_out = ravel_pytree(out)
        n = change.size

        def forwards(_: Any, right: jax.Array) -> jax.Array:
            pushed = push_lanes(modes.needed, given, modes, as_given(right[:n]))
            return right.at[n:].add(ravel_pytree(pushed)[0])

        def backwards(_: Any, right: jax.Array) -> jax.Array:
            pulled = pull_lanes(modes.needed, given, modes, as_out(right[n:]))
            return right.at[:n].add(ravel_pytree(pulled)[0])

        right = jnp.pad(change, (0, flat.size))
        solution = lax.custom_linear_solve(lambda z: z, right, forwards, backwards)
        return out, as_out(solution[n:])

    return differentiable


@jax.custom_jvp
def _differentiated_once(x: jax.Array) -> jax.Array:
    return x


@_differentiated_once.defjvp
def _not_twice(primals: Any, tangents: Any) -> Any:
    raise NotImplementedError("second derivatives of a run with contact are not available")


class _Problem:
    """The equations of a flow, and one iteration of it."""

    def __init__(self, h: float, given: Given) -> None:
        self.h, self.given = h, given
        self.n, self.dtype = given.closing.shape[0], given.closing.dtype
        self.eps = float(jnp.finfo(self.dtype).eps)
        self.tolerance = 1e-9 if self.eps < 1e-10 else 1e-5
        mass = 1 / jnp.diagonal(given.delassus)
        self.laws = [
            law if law is None or isinstance(law, Newton) else bound(law, mass[j])
            for j, law in enumerate(given.laws)
        ]
        self.rigid = _mask(isinstance(law, Newton) for law in given.laws)
        self.meets = _mask(law is not None for law in given.laws)
        self.clips = _mask(
            law is not None and not isinstance(law, Newton) and not may_pull(law)
            for law in given.laws
        )
        self.gap = jnp.where(self.meets, given.gap, 0.0)  # finite
        restitutions = [law.restitution if isinstance(law, Newton) else 1.0 for law in given.laws]
        self.restitution = jnp.stack([jnp.asarray(e, self.dtype) for e in restitutions])

    def pull(self, t: jax.Array) -> jax.Array:
        return self.given.pull + self.given.rise * (t / self.h - 0.5)

    # -- forces -------------------------------------------------------------------------------

    def law_forces(self, s: jax.Array, w: jax.Array, touch_speed: jax.Array) -> tuple[Any, Any]:
        """What each law says, and its elastic part; zero for links without such a law."""
        zero = jnp.zeros((), self.dtype)
        raw, elastic = [], []
        for j, law in enumerate(self.laws):
            if law is None or isinstance(law, Newton):
                raw.append(zero)
                elastic.append(zero)
            else:
                depth = s[j] - self.gap[j]
                raw.append(jnp.asarray(law.force(depth, w[j], touch_speed[j]), self.dtype))
                elastic.append(jnp.asarray(law.force(depth, 0 * w[j], touch_speed[j]), self.dtype))
        return jnp.stack(raw), jnp.stack(elastic)

    def forces(
        self, t: Any, s: Any, w: Any, slip: Any, mode: Any, touch_speed: Any, inverse: Any
    ) -> _Forces:
        """Forces and accelerations; ``inverse`` is that of ``held_system``."""
        raw, elastic = self.law_forces(s, w, touch_speed)
        elastic = jnp.where((mode == PRESSED) | (mode == CLIPPED), elastic, 0.0)
        contact = jnp.where(mode == PRESSED, raw, 0.0)
        held = (slip == 0) | (mode == REST)
        pull = self.pull(t)
        known = self.given.friction * slip + contact
        total = inverse @ jnp.where(held, pull, known)
        total = jnp.where(held, total, known)
        acceleration = jnp.where(held, 0.0, pull - self.given.delassus @ total)
        rest = mode == REST
        friction = jnp.where(held, total - contact, self.given.friction * slip)
        most = smaller(jnp.abs(friction), self.given.friction)
        friction = jnp.where(rest, jnp.sign(friction) * most, friction)
        contact = jnp.where(rest, total - friction, contact)
        return _Forces(acceleration, friction, contact, total, raw, elastic)

    def held_system(self, slip: Any, mode: Any) -> jax.Array:
        """Inverse of the system of the forces that hold links: G in their rows, 1 in others."""
        held = (slip == 0) | (mode == REST)
        rows = jnp.where(held[:, None], self.given.delassus, jnp.eye(self.n, dtype=self.dtype))
        return inverse_of(rows)

    # -- the start ----------------------------------------------------------------------------

    def start(self, modes: Modes) -> _State:
        given, n = self.given, self.n
        zeros = jnp.zeros_like(given.closing)
        each = Impacts(*[jnp.zeros((SLOTS, n), self.dtype)] * 6)
        begin = modes.start
        return _State(
            t=begin,
            length=jnp.asarray(self.h / 2, self.dtype) - begin,
            target=jnp.asarray(-1),
            tries=jnp.asarray(0),
            usual=jnp.asarray(self.h, self.dtype),
            iterations=jnp.asarray(0),
            half=jnp.where(modes.needed, 0, 3),
            s=given.closing,
            w=given.velocity,
            slip=jnp.sign(lax.stop_gradient(given.velocity)),
            mode=modes.contact,
            rising=jnp.where(modes.contact == PRESSED, 1.0, 0.0).astype(self.dtype),
            sum_s=given.closing * begin,
            stored=zeros,
            lost=zeros,
            touched=jnp.where(modes.contact == APART, 0.0, 1.0).astype(self.dtype),
            touch_speed=given.touch_speed,
            touch_time=given.touch_time,
            impulse=given.impulse,
            peak_force=given.peak_force,
            counts=modes.counts,
            fastest=modes.fastest,
            touches=zeros,
            first_touch=zeros,
            strongest=zeros,
            turns=zeros,
            first_turn=zeros,
            last_turn=zeros,
            between=zeros,
            farthest=zeros - jnp.inf,
            farthest_time=zeros,
            change_time=zeros,
            highest=zeros,
            highest_time=zeros,
            highest_forces=jnp.zeros((n, n), self.dtype),
            ended=zeros,
            impacts=each,
            now=(given.closing, given.velocity, zeros, zeros, zeros, zeros, zeros),
        )

    # -- one iteration ------------------------------------------------------------------------

    def unfinished(self, x: _State) -> jax.Array:
        finite = jnp.isfinite(x.s + x.w).all() & jnp.isfinite(self.given.pull).all()
        return (x.half < 3) & (x.iterations < _MOST) & finite

    def advance(self, x: _State) -> _State:
        """Try a substep; move to its end, or to an event, or set out for a shorter one."""
        inverse = self.held_system(x.slip, x.mode)
        sub = self._substep(x, inverse)
        x = self._noted(x, sub)
        stop = jnp.where(x.half < 2, self.h / 2, self.h)
        events = self._events(x, sub, stop)
        found, index = events.soonest, events.which
        wrong = sub.error > 1
        at_once = found <= _AT_ONCE * self.h
        value = lax.stop_gradient(
            self._correction(events, sub, sub.end, sub.end_rates, x.touch_speed)
        )
        value = jnp.where(at_once, 0.0, value)
        # The force's maximum need not be met as exactly: it is flat there.
        flat = (index >= 6 * self.n) & (index < 7 * self.n)
        near = jnp.abs(value) <= jnp.where(flat, _FLAT, _LANDING) * sub.length
        arrives = jnp.isfinite(found) & (near | at_once | (x.tries >= 6))
        moves = ~wrong & (jnp.isinf(found) | arrives)
        happens = ~wrong & arrives

        # The state at the end of the substep, or where it was; then two Newton steps to the event,
        # of which the first is not differentiated: the second one's slope is that at the event.
        most = jnp.where(at_once, 1e-3 * self.h, 2 * _FLAT * sub.length)
        first = jnp.where(happens & (jnp.abs(value) <= most), value, 0.0)
        place, rates = jax.tree.map(
            lambda a, b: jnp.where(at_once, a, b),
            (sub.start, sub.begin_rates),
            (sub.end, sub.end_rates),
        )
        place = jax.tree.map(lambda a, b: a + first * b, place, rates)
        now = self.forces(place.t, place.s, place.w, x.slip, x.mode, x.touch_speed, inverse)
        rates = _rates(place.s, place.w, now)
        second = self._correction(events, sub, place, rates, x.touch_speed)
        sure = jnp.abs(lax.stop_gradient(second)) <= most
        second = jnp.where(happens & sure, second, 0.0)
        place = jax.tree.map(lambda a, b: a + second * b, place, rates)
        place = jax.tree.map(lambda a, b: jnp.where(moves, b, a), sub.start, place)
        grows = sub.growth_end > 0
        after = x._replace(
            t=place.t,
            s=place.s,
            w=place.w,
            sum_s=place.sum_s,
            stored=place.stored,
            lost=place.lost,
            impulse=place.impulse,
            rising=jnp.where(moves, jnp.where(grows, 1.0, 0.0), x.rising),
            iterations=x.iterations + 1,
        )
        after = self._highest(after, now, moves)
        after = self._happened(after, now, jnp.where(happens, index, -1), at_once)

        # The next substep.
        # Where a law is singular, as at touch, the error falls slowly with the length.
        power = jnp.where(wrong, -0.25, -0.125)
        factor = jnp.clip(0.9 * larger(sub.error, 1e-8) ** power, 0.05, 4.0)
        usual = jnp.where(wrong, sub.length * factor, larger(sub.length * factor, x.usual))
        usual = smaller(usual, jnp.asarray(self.h, self.dtype))
        stop = jnp.where(after.half < 2, self.h / 2, self.h)
        left = larger(lax.stop_gradient(stop - after.t), 0.0)
        acts = ((after.mode == PRESSED) | (after.mode == CLIPPED)).any()
        length = jnp.where(acts, smaller(usual, left), left)
        aims = ~wrong & ~moves
        # One that was not reached lies beyond the end of the substep.
        aim = jnp.where(found < sub.length, found, smaller(sub.length + larger(value, 0.0), left))
        return after._replace(
            usual=lax.stop_gradient(usual),
            length=lax.stop_gradient(jnp.where(aims, aim, length)),
            target=jnp.where(aims, index, -1),
            tries=jnp.where(aims, x.tries + 1, 0),
        )

    def _substep(self, x: _State, inverse: jax.Array) -> _Substep:
        length = lax.stop_gradient(x.length)

        def forces(t: Any, s: Any, w: Any) -> _Forces:
            return self.forces(t, s, w, x.slip, x.mode, x.touch_speed, inverse)

        begin = forces(x.t, x.s, x.w)
        start = _Where(x.t, x.s, x.w, x.sum_s, x.stored, x.lost, x.impulse)
        first = _rates(x.s, x.w, begin)

        # A loop over the stages, not one after the other: the program is long enough.
        def stage(i: jax.Array, carry: Any) -> Any:
            slopes, _, _ = carry
            row = jnp.asarray(STAGES, self.dtype)[i]
            moved = jax.tree.map(lambda y, k: y + length * weighted(row, k), start, slopes)
            now = forces(moved.t, moved.s, moved.w)
            rates = _rates(moved.s, moved.w, now)
            slopes = jax.tree.map(lambda k, one: k.at[i + 1].set(one), slopes, rates)
            return slopes, moved, now

        none = jax.tree.map(lambda k: jnp.zeros((len(STAGES) + 1, *k.shape), k.dtype), first)
        slopes = jax.tree.map(lambda k, one: k.at[0].set(one), none, first)
        slopes, end, seen = lax.fori_loop(0, len(STAGES), stage, (slopes, start, begin))
        last = jax.tree.map(lambda k: k[-1], slopes)
        sizes = larger(jnp.abs(x.w), jnp.abs(end.w)) + length * jnp.abs(first.w)
        sizes = sizes + jnp.where(x.mode == PRESSED, x.touch_speed, 0.0)
        sizes = self.tolerance * sizes + jnp.finfo(self.dtype).tiny
        wrong = larger(length * error(slopes.w), error(slopes.s))
        worst = (lax.stop_gradient(wrong) / sizes).max()
        worst = jnp.where(worst < 1e8, worst, 1e8)
        speed = x.touch_speed
        grows = (
            self._growth(x.s, x.w, first.w, speed),
            self._growth(end.s, end.w, last.w, speed),
        )
        grows = lax.stop_gradient(grows)
        return _Substep(length, start, begin, seen, end, first, last, worst, *grows)

    def _growth(self, s: Any, w: Any, a: Any, touch_speed: Any) -> jax.Array:
        """dp/dt of each law's force."""
        return jax.jvp(lambda s, w: self.law_forces(s, w, touch_speed)[0], (s, w), (w, a))[1]

    def _noted(self, x: _State, sub: _Substep) -> _State:
        """Forces at the start of the substep: the largest so far, and those in mid-step."""
        now, mid = sub.begin, x.half == 1
        x = self._highest(x, now, True)
        seen = (x.s, x.w, now.friction, now.contact, x.stored, x.lost)
        held = jnp.where((x.slip == 0) | (x.mode == REST), 1.0, 0.0).astype(self.dtype)
        return x._replace(
            now=tuple(jnp.where(mid, a, b) for a, b in zip((*seen, held), x.now, strict=True)),
            half=jnp.where(mid, 2, x.half),
        )

    def _highest(self, x: _State, now: _Forces, valid: Any) -> _State:
        """The largest contact force so far, of the step and of the impact."""
        higher = valid & (now.contact > x.highest)
        return x._replace(
            highest=jnp.where(higher, now.contact, x.highest),
            highest_time=jnp.where(higher, x.t - self.h / 2, x.highest_time),
            highest_forces=jnp.where(higher[:, None], now.total, x.highest_forces),
            peak_force=jnp.where(valid & (now.contact > x.peak_force), now.contact, x.peak_force),
        )

    def _events(self, x: _State, sub: _Substep, stop: jax.Array) -> _Events:
        """The first event in a substep, with the time from its end at which it happens."""
        begin, seen, end, length = lax.stop_gradient((sub.begin, sub.seen, sub.end, sub.length))
        s0, w0, t0 = lax.stop_gradient((x.s, x.w, x.t))
        a0, eps = begin.acceleration, 32 * self.eps
        positive = jnp.where(length > 0, length, 1.0)
        never = jnp.inf

        # Slip ends: the speed along the slip is a quadratic function.
        u0, slope, u1 = x.slip * w0, x.slip * a0, x.slip * end.w
        bend = (u1 - u0 - slope * length) / positive**2
        noise = eps * (jnp.abs(w0) + jnp.abs(end.w) + length * jnp.abs(a0))
        lowest = u0 - slope**2 / jnp.where(bend > 0, 4 * bend, 1.0)
        dips = (bend > 0) & (slope < 0) & (-slope < 2 * bend * length) & (lowest < -noise)
        slides = (x.slip != 0) & (x.mode != REST)
        root = jnp.sqrt(larger(slope**2 - 4 * bend * u0, 0.0))
        q = -0.5 * (slope + jnp.where(slope < 0, -root, root))
        before = jnp.where(slope < 0, u0, q) / _nonzero(jnp.where(slope < 0, q, bend))
        turn = jnp.where(slides & ((u1 < -noise) | dips), before, never)

        # Stick breaks, or what keeps a gap closed would have to pull.
        friction = self.given.friction
        noise = eps * (jnp.abs(begin.total) + jnp.abs(seen.total) + friction)
        sticks = (x.slip == 0) & (x.mode != REST)
        limit = jnp.sign(seen.friction) * friction
        before = (limit - begin.friction) / _nonzero(seen.friction - begin.friction) * length
        before = jnp.where(jnp.abs(begin.friction) > friction + noise, 0.0, before)
        over = larger(jnp.abs(begin.friction), jnp.abs(seen.friction)) > friction + noise
        breaks = jnp.where(sticks & over, before, never)
        least = -friction - noise
        before = (-friction - begin.total) / _nonzero(seen.total - begin.total) * length
        before = jnp.where(begin.total < least, 0.0, before)
        below = (x.mode == REST) & (smaller(begin.total, seen.total) < least)
        leaves = jnp.where(below, before, never)

        # The gap closes, or opens.
        depth0, depth1 = s0 - self.gap, end.s - self.gap
        before = _crossing(depth0, w0, depth1, end.w, length)
        # A flight that begins in touch and ends in it turns first.
        closes = self.meets & (x.mode == APART) & (depth1 > 0) & (depth1 > depth0)
        closes = closes & ((depth0 < 0) | (w0 >= 0))
        touch = jnp.where(closes, jnp.where(depth0 >= 0, 0.0, before), never)
        acts = (x.mode == PRESSED) | (x.mode == CLIPPED)
        opens = acts & (depth1 < 0) & (depth1 < depth0) & ((depth0 > 0) | (w0 <= 0))
        release = jnp.where(opens, jnp.where(depth0 <= 0, 0.0, before), never)

        # The force of a law that must not pull vanishes, or comes back.
        noise = eps * (jnp.abs(begin.elastic) + jnp.abs(seen.elastic) + jnp.abs(seen.raw))
        before = _crossing(begin.raw, sub.growth, seen.raw, sub.growth_end, length)
        ends = (x.mode == PRESSED) & (seen.raw < -noise)
        ends_before = jnp.where(begin.raw <= 0, 0.0, before)
        returns = (x.mode == CLIPPED) & (seen.raw > noise)
        returns_before = jnp.where(begin.raw >= 0, 0.0, before)
        clip = jnp.where(ends, ends_before, jnp.where(returns, returns_before, never))
        clip = jnp.where(self.clips, clip, never)

        # The force of a law is largest.
        tops = (x.mode == PRESSED) & (x.rising > 0) & (sub.growth > 0) & (sub.growth_end < 0)
        before = length * sub.growth / _nonzero(sub.growth - sub.growth_end)
        top = jnp.where(tops, before, never)

        at_stop = t0 + length >= stop - 1e-12 * self.h
        times = jnp.concatenate([turn, breaks, leaves, touch, release, clip, top])
        times = jnp.append(times, jnp.where(at_stop, stop - t0, never))
        times = jnp.where(jnp.isinf(times), times, jnp.clip(times, 0.0, length))
        aimed = (jnp.arange(times.size) == x.target) & jnp.isinf(times)
        times = jnp.where(aimed, length, times)
        index = jnp.argmin(times)

        # How far those events are estimated to be that have no Newton step of their own.
        kind = index // self.n
        plain = (kind == 1) | (kind == 2) | (kind == 5)
        soonest = times[index]
        beyond = jnp.where(plain & (soonest > _AT_ONCE * self.h), soonest - length, 0.0)
        return _Events(soonest, index, beyond, stop)

    def _correction(
        self, events: _Events, sub: _Substep, place: _Where, rates: _Where, touch_speed: Any
    ) -> jax.Array:
        """The Newton step in time to an event from a place near it.

        Its derivative is that of the event's instant. That matters where something jumps: where
        slip ends, a gap closes or opens, at the stops, and for the largest force; elsewhere it may
        be left out.
        """
        depth, none = place.s - self.gap, jnp.zeros_like(place.s)
        growth = self._growth(place.s, place.w, rates.w, touch_speed)
        top = _newton(growth, (sub.growth_end - sub.growth) / _nonzero(sub.length))
        steps = jnp.concatenate(
            [
                _newton(place.w, rates.w),
                none,
                none,
                _newton(depth, rates.s),
                _newton(depth, rates.s),
                none,
                jnp.where(sub.growth_end < sub.growth, top, 0.0),
            ]
        )
        return jnp.append(steps, events.stop - place.t)[events.which] + events.beyond

    def _happened(self, x: _State, now: _Forces, index: jax.Array, at_once: jax.Array) -> _State:
        """The state after an event, with the forces just before it; index −1 is none."""
        given, n = self.given, self.n
        kinds = [(index >= k * n) & (index < (k + 1) * n) for k in range(7)]
        link = jnp.arange(n) == index % n
        turn, breaks, leaves, touch, release, clip, top = [kind & link for kind in kinds]
        stops = index == 7 * n
        time = x.t - self.h / 2

        # An impact: Newton's law, at rest if all rebounds to come were over in no time.
        speed, collides = x.w, touch & self.rigid
        mass = 1 / jnp.diagonal(given.delassus)
        pull_in = now.acceleration
        pull_out = pull_in + 2 * given.friction / mass
        inward = jnp.where(pull_in > 0, pull_in, 1.0)
        outward = jnp.where(pull_in > 0, pull_out, 1.0)
        again = self.restitution * jnp.sqrt(inward / outward)
        flight = self.restitution * speed * (1 / outward + 1 / jnp.sqrt(inward * outward))
        ends = flight <= _REBOUNDS * self.h * (1 - again)
        rests = collides & (pull_in > 0) & ends
        rebound = jnp.where(rests, 0.0, self.restitution * speed)
        blow = jnp.where(collides, (speed + rebound) * mass, 0.0)
        w = x.w - jnp.where(collides.any(), given.delassus @ blow, 0.0)
        w = jnp.where(collides, -rebound, jnp.where(turn, 0.0, w))
        struck = collides.any() & ~link & (given.delassus @ jnp.where(collides, 1.0, 0.0) != 0)
        counts = touch & (speed > 1e-4 * x.fastest) & (speed > 0)

        # Directions of slip and modes of contact.
        falls = lax.stop_gradient(jnp.sign(w))
        slip = jnp.where(struck | collides, falls, x.slip)
        slip = jnp.where(breaks, jnp.sign(now.friction), slip)
        slip = lax.stop_gradient(jnp.where(turn | rests, 0.0, jnp.where(leaves, -1.0, slip)))
        mode = jnp.where(touch & ~self.rigid, PRESSED, x.mode)
        mode = jnp.where(rests, REST, mode)
        mode = jnp.where(leaves | release | (struck & (x.mode == REST)), APART, mode)
        mode = jnp.where(clip, jnp.where(x.mode == PRESSED, CLIPPED, PRESSED), mode)
        # Where the gap is known to be closed exactly.
        s = jnp.where((touch | release) & ~at_once, self.gap, x.s)

        # What impacts and turns leave behind.
        slowest = lax.stop_gradient(_SLOWEST * self.h * jnp.abs(now.acceleration))
        begins = touch & ~self.rigid
        peak = jnp.where(touch, 0.0, x.peak_force)
        impulse = jnp.where(begins, 0.0, jnp.where(collides, blow, x.impulse))
        touch_time = jnp.where(touch, time, x.touch_time)
        touch_speed = jnp.where(touch, larger(speed, slowest), x.touch_speed)
        counted = jnp.where(touch, jnp.where(counts, 1.0, 0.0), x.counts).astype(self.dtype)
        over = (release | collides) & (counted > 0)
        entries = Impacts(touch_time, touch_speed, time + 0 * w, -w, impulse, peak)
        slot = over[None] & (jnp.arange(SLOTS)[:, None] == x.ended[None])
        turned = turn | collides | (struck & (x.slip != 0) & (slip != x.slip))
        once_more = turned & (x.turns > 0)
        farther = turned & (s > x.farthest)
        return x._replace(
            s=s,
            w=w,
            slip=slip,
            mode=mode,
            half=x.half + jnp.where(stops, 1, 0),
            rising=jnp.where(touch, 1.0, jnp.where(top, 0.0, x.rising)),
            lost=x.lost + jnp.where(collides, blow * (speed - rebound) / 2, 0.0),
            touched=larger(x.touched, jnp.where(touch, 1.0, 0.0)),
            touch_speed=touch_speed,
            touch_time=touch_time,
            impulse=impulse,
            peak_force=peak,
            counts=counted,
            fastest=lax.stop_gradient(jnp.where(touch, larger(x.fastest, speed), x.fastest)),
            touches=x.touches + jnp.where(counts, 1.0, 0.0),
            first_touch=jnp.where(counts & (x.touches == 0), time, x.first_touch),
            strongest=jnp.where(over & (impulse > x.strongest), impulse, x.strongest),
            turns=larger(x.turns, jnp.where(turned, 1.0, 0.0)),
            first_turn=jnp.where(turned & (x.turns == 0), s, x.first_turn),
            last_turn=jnp.where(turned, s, x.last_turn),
            between=x.between + jnp.where(once_more, jnp.abs(s - x.last_turn), 0.0),
            farthest=jnp.where(farther, s, x.farthest),
            farthest_time=jnp.where(farther, time, x.farthest_time),
            change_time=jnp.where(slip != x.slip, time, x.change_time),
            ended=x.ended + jnp.where(over, 1.0, 0.0),
            impacts=jax.tree.map(lambda a, b: jnp.where(slot, a[None], b), entries, x.impacts),
        )

    # -- the end ------------------------------------------------------------------------------

    def passed(self, x: _State) -> Passed:
        inverse = self.held_system(x.slip, x.mode)
        mode = jnp.where(x.mode == PRESSED, CLIPPED, x.mode)
        end = self.forces(x.t, x.s, x.w, x.slip, mode, x.touch_speed, inverse)
        closing_now, velocity_now, friction_now, contact_now, stored_now, lost_now, held_now = x.now
        # A contact under way is the strongest so far if no other is.
        strongest = jnp.where(
            (x.counts > 0) & (x.mode != APART) & (x.impulse > x.strongest), x.impulse, x.strongest
        )
        passed = Passed(
            closing=x.s,
            velocity=x.w,
            mean=x.sum_s / self.h,
            closing_now=closing_now,
            velocity_now=velocity_now,
            friction_now=friction_now,
            contact_now=contact_now,
            stored_now=stored_now,
            lost_now=lost_now,
            held_now=held_now,
            acceleration=end.acceleration,
            held=jnp.where((x.slip == 0) | (x.mode == REST), 1.0, 0.0).astype(self.dtype),
            mode=x.mode,
            touched=x.touched,
            stored=x.stored,
            lost=x.lost,
            touch_speed=x.touch_speed,
            touch_time=x.touch_time,
            impulse=x.impulse,
            peak_force=x.peak_force,
            counts=x.counts,
            fastest=x.fastest,
            touches=x.touches,
            first_touch=x.first_touch,
            strongest=strongest,
            turns=x.turns,
            first_turn=x.first_turn,
            last_turn=x.last_turn,
            between=x.between,
            farthest=x.farthest,
            farthest_time=x.farthest_time,
            change_time=x.change_time,
            highest=x.highest,
            highest_time=x.highest_time,
            highest_forces=x.highest_forces,
            impacts=x.impacts,
        )
        poison = jnp.where(x.half == 3, 1.0, jnp.nan).astype(self.dtype)
        return jax.tree.map(lambda a: a * poison, passed)


class _Where(NamedTuple):
    """What moves smoothly between events."""

    t: Any
    s: Any
    w: Any
    sum_s: Any
    stored: Any
    lost: Any
    impulse: Any


class _Substep(NamedTuple):
    """A substep that has been tried."""

    length: jax.Array
    start: _Where
    begin: _Forces
    seen: _Forces  # at its end, in the modes of its start
    end: _Where
    begin_rates: _Where
    end_rates: _Where
    error: jax.Array  # in units of the tolerance
    growth: jax.Array  # of each law's force at the start, and at the end
    growth_end: jax.Array


class _Events(NamedTuple):
    soonest: jax.Array  # from the start of the substep, inf if none
    which: jax.Array  # its index
    beyond: jax.Array  # from the end of the substep, for events without a Newton step
    stop: jax.Array  # the next instant at which the flow stops in any case


def _rates(s: jax.Array, w: jax.Array, now: _Forces) -> _Where:
    """By how much what moves smoothly grows in time."""
    return _Where(
        t=jnp.ones((), s.dtype),
        s=w,
        w=now.acceleration,
        sum_s=s,
        stored=now.elastic * w,
        lost=(now.contact - now.elastic) * w,
        impulse=now.contact,
    )


def _mask(which: Iterable[bool]) -> jax.Array:
    return jnp.asarray(list(which))


def _nonzero(x: jax.Array) -> jax.Array:
    return jnp.where(x == 0, 1.0, x)


def _newton(value: jax.Array, slope: jax.Array) -> jax.Array:
    """−value / slope with the slope held fixed; 0 where that is 0."""
    slope = lax.stop_gradient(slope)
    return jnp.where(slope == 0, 0.0, -value / _nonzero(slope))


def inverse_of(rows: jax.Array) -> jax.Array:
    """Inverse by elimination, which needs no pivoting here; unrolled, as there are few rows."""
    n = rows.shape[0]
    work = jnp.concatenate([rows, jnp.eye(n, dtype=rows.dtype)], axis=1)
    for k in range(n):
        pivot = work[k] / work[k, k]
        other = (jnp.arange(n) != k)[:, None]
        work = jnp.where(other, work - work[:, k : k + 1] * pivot[None], pivot[None])
    return work[:, n:]


def _crossing(y0: Any, slope0: Any, y1: Any, slope1: Any, length: Any) -> jax.Array:
    """Where a cubic that changes its sign from 0 to ``length`` vanishes, by safeguarded Newton."""
    d0, d1 = slope0 * length, slope1 * length
    bend, twist = 3 * (y1 - y0) - 2 * d0 - d1, 2 * (y0 - y1) + d0 + d1
    low, high = jnp.zeros_like(y0), jnp.ones_like(y0)
    x = jnp.clip(y0 / _nonzero(y0 - y1), 0.0, 1.0)
    for _ in range(8):
        y = y0 + x * (d0 + x * (bend + x * twist))
        before = y * jnp.sign(y1) < 0
        low, high = jnp.where(before, x, low), jnp.where(before, high, x)
        step = x - y / _nonzero(d0 + x * (2 * bend + x * 3 * twist))
        x = jnp.where((step >= low) & (step <= high), step, (low + high) / 2)
    return x * length
