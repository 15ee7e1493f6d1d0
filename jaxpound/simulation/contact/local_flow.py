r"""The local flow: joints that share masses over one step, from event to event.

Within a step the joints see only the pull A(t) of the rods and the ground, linear in time:

    s'' = A(t) − G (q + Σᵀ p),    q ∈ μ Sgn(s'),    p = p(Σ s − ξ0, Σ s'),    G = C M⁻¹ Cᵀ,

with closings s and friction q of the joints, and contact forces p of their gaps, of which Σ has a
row each: the side ±1 at the joint of the gap. The flow solves this small problem event by event
(``events``). Between events the motion is smooth. Where all forces are linear in the closings and
their velocities it is a power series in time, a cubic where no contact is deformed. Else an
embedded Runge–Kutta method of order 8 integrates it. The stiffness of a contact sets the substeps,
never the step of the run. Both give the joints at any time of a substep, and so locate events by
Newton steps in time. Their slope is recomputed, but not differentiated, so that the derivative of
the last step is that of the event's instant.
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxpound._extrema import larger, smaller
from jaxpound.simulation.contact import events, records
from jaxpound.simulation.contact.dop853 import coefficients, error, weighted
from jaxpound.simulation.contact.events import FlowState, Local, Occurrence, since_middle
from jaxpound.simulation.contact.forces import (
    Constants,
    Forces,
    Motion,
    Regime,
    force_growth,
    forces_at,
    largest_rate,
)
from jaxpound.simulation.contact.records import (
    PRESSED,
    FlowResult,
    GapLog,
    GapStep,
    MidStep,
    StepLog,
    Turns,
    times,
)
from jaxpound.simulation.contact.substeps import Integrated, PowerSeries, SmoothState, Substep
from jaxpound.simulation.contact.zeros import first_zero

_MOST_ITERATIONS = 4000  # iterations in a step
_AT_ONCE = 1e-10  # share of a step within which events are at the same instant
_NEAR = 0.05  # longest Newton step to an event, as a share of the substep
_NEWTON_STEPS = 3  # Newton steps to an event
_SOON = 1e-3  # share of a substep within which a motion is that of its start
_JUST = 1.001  # length of a substep that should end just beyond an event, in units of its time
_ORDER, _LONGEST = 12, 0.8  # of a series, and of a substep by it in units of 1/rate


class FlowProgress(NamedTuple):
    """How far a flow has come."""

    now: FlowState
    middle: FlowState  # in the middle of the step
    ended: jax.Array  # whether it has reached the end of the step
    iterations: jax.Array
    length: jax.Array  # of the substep to try
    usual: jax.Array  # length that the error allows
    rejected: jax.Array  # whether the last substep was too long


class _First(NamedTuple):
    """The first event in a substep."""

    time: jax.Array  # from the start of the substep, inf if there is none
    number: jax.Array  # of the event among the values of all
    at_start: jax.Array  # whether it is as the substep starts
    is_none: jax.Array  # whether it is there by the cubic, but not by the motion
    begin: Local  # the joints and gaps as the substep starts
    rate: Local  # and their time derivatives


def start(constants: Constants) -> FlowProgress:
    """The state in which a flow starts."""
    inputs, h = constants.inputs, constants.h
    # A load that has grown since a slow touch would creep: the law is too stiff for it.
    contact = inputs.contact
    slowest = jnp.where(records.is_deformed(contact.mode), events.least_speed(constants), 0.0)
    contact = contact._replace(touch_speed=larger(contact.touch_speed, slowest))
    # Derived from the input: so vmap and shard_map see the carry as batched from the start.
    by_joint = 0 * inputs.closing
    zero = by_joint[0]
    by_gap = jnp.broadcast_to(zero, contact.mode.shape)
    begin, s, w = constants.clock.begin + zero, inputs.closing, inputs.velocity
    y = SmoothState(begin, s, w, s * begin, by_gap, by_gap, contact.impulse)
    slots = jnp.broadcast_to(zero, (by_gap.size, constants.slots))
    impacts = records.Impacts(*(slots,) * len(records.Impacts._fields))
    touched = (contact.mode != records.APART).astype(constants.dtype)
    highest_forces = jnp.broadcast_to(zero, (by_gap.size, by_joint.size))
    gaps = GapLog(touched, *(by_gap,) * 7, highest_forces, impacts)
    turns = Turns(*(by_joint,) * len(Turns._fields))
    turns = turns._replace(farthest=by_joint - jnp.inf, nearest=by_joint + jnp.inf)
    now = FlowState(
        y=y,
        slip=jnp.sign(lax.stop_gradient(w)),
        contact=contact,
        rising=(contact.mode == PRESSED).astype(constants.dtype),
        log=StepLog(turns, by_joint, gaps),
    )
    never = zero != 0
    length = _longest(constants, now.regime, h - begin)
    return FlowProgress(now, now, never, zero.astype(int), length, h / 2 + zero, never)


def unfinished(constants: Constants, flow: FlowProgress) -> jax.Array:
    """Whether the flow has not reached the end of the step."""
    finite = jnp.isfinite(flow.now.y.flat).all() & jnp.isfinite(constants.inputs.pull).all()
    return ~flow.ended & (flow.iterations < _MOST_ITERATIONS) & finite


def advance(constants: Constants, flow: FlowProgress) -> FlowProgress:
    """Try a substep: accept it, to its end or an event in it, or reject it as too long."""
    h, x = constants.h, flow.now
    regime, inverse = x.regime, constants.inverse(x.regime)
    begin = forces_at(constants, x.y.motion, regime, inverse)
    x = _with_highest(constants, x, begin)
    substep, worst = _substep(constants, x, flow.length, begin, inverse)
    # Which event is the first is not differentiated, only its instant.
    event = _first_event(*lax.stop_gradient((constants, x, substep, inverse)))
    y, local, rates = _located(constants, x, substep, event, inverse)
    # The cubic of a long substep may have an event that the motion has not, or has before.
    backwards = y.t < x.y.t - _AT_ONCE * h
    is_none = event.is_none | (~event.at_start & backwards)
    wrong = ((worst > 1) & _is_limited(constants, regime)) | is_none
    left = h / 2 - x.y.t
    passes = ~wrong & (y.t >= h / 2) & (left > 0)
    middle = x._replace(y=substep.at(jnp.where(passes, left, 0.0)))
    # A force at its peak does not rise again, by rounding, as another's peaks at the same instant.
    rises_on = wrong | (y.t - x.y.t <= _AT_ONCE * h)
    after = x._replace(
        y=jax.tree.map(partial(jnp.where, wrong), x.y, y),
        rising=jnp.where(rises_on, x.rising, local.growth > 0),
    )
    happens, number = ~wrong & jnp.isfinite(event.time), 0
    for kind, size in events.possible(constants):
        where = happens & (event.number == number + np.arange(size))
        occurrence = Occurrence(where, local.forces, rates.forces, event.at_start)
        after = kind.effect(constants, after, occurrence)
        number += size
    flow = flow._replace(
        now=after,
        middle=jax.tree.map(partial(jnp.where, passes), middle, flow.middle),
        ended=flow.ended | (happens & (event.number == number)),
        iterations=flow.iterations + 1,
    )
    flow = _with_next_length(constants, flow, substep.length, event, worst, wrong, regime)
    halved = lax.stop_gradient(substep.length / 2)
    return flow._replace(length=jnp.where(is_none, halved, flow.length))


def within(constants: Constants, flow: FlowProgress, time: jax.Array) -> tuple[jax.Array, ...]:
    """Time, and closings and contact forces of the gaps, a ``time`` after a substep's start."""
    x, inverse = flow.now, constants.inverse(flow.now.regime)
    begin = forces_at(constants, x.y.motion, x.regime, inverse)
    y = _substep(constants, x, flow.length, begin, inverse)[0].at(time)
    forces = forces_at(constants, y.motion, x.regime, inverse)
    return y.t, constants.coupling.seen(y.s), forces.contact


def result(constants: Constants, flow: FlowProgress) -> FlowResult:
    """The result of a flow from the state in which it ended."""
    # NaN in what the run goes on from makes all of its results NaN.
    poison = jnp.where(flow.ended, 1.0, jnp.nan).astype(constants.dtype)
    end, middle = (
        x._replace(y=jax.tree.map(lambda z: z * poison, x.y)) for x in (flow.now, flow.middle)
    )
    y, at, mode = end.y, middle.y, end.contact.mode
    unpressed = jnp.where(mode == PRESSED, records.CLIPPED, mode)
    acceleration = _forces(constants, y, end.regime._replace(mode=unpressed)).acceleration
    forces, held_now = _forces(constants, at, middle.regime), constants.held(middle.regime)
    middle = middle.with_gaps(highest=larger(middle.log.gaps.highest, forces.contact))
    peak = larger(middle.contact.peak_force, forces.contact)
    middle = middle._replace(contact=middle.contact._replace(peak_force=peak))
    last = jax.tree.map(partial(jnp.where, constants.clock.is_last), middle, end)
    log = last.log.gaps._replace(touched=last.log.gaps.touched * poison)  # a failure is used
    return FlowResult(
        closing=y.s,
        velocity=y.w,
        acceleration=acceleration,
        held=constants.held(end.regime).astype(constants.dtype),
        mean=y.area / constants.h,
        now=MidStep(at.s, at.w, forces.friction, held_now.astype(constants.dtype)),
        turns=last.log.turns,
        change_time=last.log.change_time,
        contact=last.contact._replace(impulse=last.y.impulse),
        gaps=GapStep(forces.contact, at.stored, last.y.stored, at.lost, last.y.lost, log),
    )


def _with_next_length(
    constants: Constants,
    flow: FlowProgress,
    length: jax.Array,
    event: _First,
    worst: jax.Array,
    wrong: jax.Array,
    regime: Regime,
) -> FlowProgress:
    """The state with the length of the next substep to try."""
    left, regime_after = larger(constants.h - flow.now.y.t, 0.0), flow.now.regime
    if constants.are_linear:
        return flow._replace(length=_longest(constants, regime_after, left))
    # Where a law is singular, as at touch, the error decreases slowly with the length.
    factor = 0.9 * larger(worst, 1e-8) ** jnp.where(wrong, -0.25, -0.125)
    usual = length * jnp.clip(factor, 0.05, jnp.where(flow.rejected, 1.0, 4.0))
    usual = jnp.minimum(jnp.where(wrong, usual, larger(usual, flow.usual)), constants.h / 2)
    usual = jnp.where(_is_limited(constants, regime), usual, flow.usual)
    tried = jnp.where(_is_limited(constants, regime_after), smaller(usual, left), left)
    # An event lies inside a rejected substep: retry with one that ends just past it.
    aims = wrong & (event.time < 0.9 * length) & ~event.at_start
    tried = jnp.where(aims, jnp.minimum(_JUST * event.time, left), tried)
    usual, tried = lax.stop_gradient((usual, tried))
    return flow._replace(usual=usual, length=tried, rejected=wrong)


def _longest(constants: Constants, regime: Regime, left: jax.Array) -> jax.Array:
    """Length of the substep to try, of the time that is left, where no error is known."""
    longest: Any = constants.h / 2
    if constants.are_linear and not constants.rigid.all():
        longest = _LONGEST / largest_rate(constants)
    tried = jnp.where(_is_limited(constants, regime), smaller(longest, left), left)
    return lax.stop_gradient(tried)


def _is_limited(constants: Constants, regime: Regime) -> jax.Array:
    """Whether forces of laws limit the length of a substep: it is no cubic."""
    limited = regime.deformed.any()
    if constants.coupling.has_resistance:
        limited |= (regime.slip != 0).any()
    return limited


def _forces(constants: Constants, y: SmoothState, regime: Regime) -> Forces:
    return forces_at(constants, y.motion, regime, constants.inverse(regime))


def _substep(
    constants: Constants, x: FlowState, length: jax.Array, begin: Forces, inverse: jax.Array
) -> tuple[Substep, jax.Array]:
    """A substep, and its error in units of the tolerance."""
    y, regime = x.y, x.regime
    if constants.are_linear:
        _, change = jax.linearize(lambda z: forces_at(constants, z, regime, inverse), y.motion)
        order = 4 if constants.rigid.all() else _ORDER
        return PowerSeries.of(constants, y, length, begin, change, order), 0 * length

    # Scan over the stages: unrolled, they would dominate compile time.
    def stage(slopes: jax.Array, entry: Any) -> Any:
        i, (row, time) = entry
        now = y.rebuilt(y.t + length * time, y.flat + length * weighted(row, slopes))
        forces = forces_at(constants, now.motion, regime, inverse)
        return slopes.at[i].set(now.rates(constants, forces).flat), None

    stages = jnp.asarray(coefficients().stages, constants.dtype)
    slopes = jnp.broadcast_to(0 * y.flat, (len(stages), y.flat.size))
    entries = jnp.arange(len(stages)), (stages, stages.sum(1))
    slopes, _ = lax.scan(stage, slopes, entries)
    substep = Integrated(y, length, slopes)
    return substep, _error(constants, substep, regime, begin)


def _error(constants: Constants, substep: Integrated, regime: Regime, begin: Forces) -> jax.Array:
    """The largest error of an integrated substep in units of the tolerance."""
    y, length, slopes = substep
    eps = jnp.finfo(constants.dtype).eps
    slopes, speed, a = lax.stop_gradient((slopes, y.w, begin.acceleration))
    change = weighted(jnp.asarray(coefficients().end, constants.dtype), slopes)
    end = speed + length * y.rebuilt(y.t, change).w
    speeds = larger(jnp.abs(speed), jnp.abs(end)) + length * jnp.abs(a)
    pressed = jnp.where(regime.mode == PRESSED, lax.stop_gradient(regime.touch_speed), 0.0)
    speeds += (
        jnp.abs(constants.coupling.on_joints(pressed)) + jnp.finfo(constants.dtype).tiny ** 0.5
    )
    # A joint that has just broken away is as inexact as the accelerations that cancel in it.
    delassus = constants.coupling.delassus
    parts = jnp.abs(constants.inputs.pull) + times(jnp.abs(delassus), jnp.abs(begin.total))
    tolerance = 1e-9 if eps < 1e-10 else 1e-5
    sizes = tolerance * speeds + 8 * eps * length * lax.stop_gradient(parts)
    errors = y.rebuilt(y.t, error(slopes))
    # The rate of the stored energy has a kink where a clipped contact ends.
    of_energy = errors.stored / jnp.abs(constants.coupling.seen(constants.mass * speeds * sizes))
    worst = jnp.concatenate([larger(length * errors.w, errors.s) / sizes, of_energy]).max()
    return jnp.where(worst < 1e8, worst, 1e8)


def _with_highest(constants: Constants, x: FlowState, now: Forces) -> FlowState:
    """The state with the largest contact force so far, of the step and of the impact."""
    log, force = x.log.gaps, now.contact
    higher = force > log.highest
    x = x.with_gaps(
        highest=jnp.where(higher, force, log.highest),
        highest_time=jnp.where(higher, since_middle(constants, x), log.highest_time),
        highest_forces=jnp.where(higher[:, None], now.total[None], log.highest_forces),
    )
    peak = larger(x.contact.peak_force, force)
    return x._replace(contact=x.contact._replace(peak_force=peak))


def _values(
    constants: Constants, x: FlowState, motion: Motion, inverse: jax.Array
) -> tuple[Local, Local, jax.Array, jax.Array]:
    """The joints and gaps at an instant and their time derivatives; the same of events' values.

    The values are those of all events, one after the other, by joint or gap.
    """
    regime, (t, s, w) = x.regime, motion
    now, changes = jax.linearize(lambda z: forces_at(constants, z, regime, inverse), motion)
    a = now.acceleration
    change = changes((jnp.ones_like(t), w, a))
    growth = bend = jnp.zeros_like(now.contact)
    if not constants.rigid.all():
        along = w, a, change.acceleration
        growth, bend = jax.jvp(partial(force_growth, constants, regime), (s, w, a), along)

    def values(local: Local) -> jax.Array:
        kinds = events.possible(constants)
        return jnp.concatenate([kind.value(constants, x, local) for kind, _ in kinds])

    local, rate = Local(s, w, now, growth), Local(w, a, change, bend)
    return local, rate, *jax.jvp(values, (local,), (rate,))


def _first_event(
    constants: Constants, x: FlowState, substep: Substep, inverse: jax.Array
) -> _First:
    """The first event in a substep."""
    h, length = constants.h, substep.length
    kinds, sizes = zip(*events.possible(constants), strict=True)
    motions = jax.tree.map(lambda *z: jnp.stack(z), x.y.motion, substep.at(length).motion)
    at_ends, rates, values, slopes = jax.vmap(lambda z: _values(constants, x, z, inverse))(motions)

    def scale(local: Local) -> jax.Array:
        return jnp.concatenate([kind.scale(constants, local, length) for kind in kinds])

    noise = 32 * jnp.finfo(constants.dtype).eps * jax.vmap(scale)(at_ends).sum(0)
    begin, rate = jax.tree.map(lambda z: z[0], (at_ends, rates))
    armed = jnp.concatenate([kind.armed(constants, x, begin) for kind in kinds])
    of_force, may_return = (
        np.repeat([getattr(kind, name) for kind in kinds], sizes)
        for name in ("of_force", "may_return")
    )
    # A value below zero at the start, such as a gap at rest has by a correction, is the zero of
    # the end too: a gap that opens from there does not close.
    below = smaller(values[0], 0.0)
    (first, last), falls = values - below[None], length * slopes
    shares = first_zero(first, falls[0], last, falls[1], noise, may_return)
    shares = jnp.where(of_force & (values[0] < -noise), 0.0, shares)
    instants = jnp.where(armed & (shares <= 1), shares * length, jnp.inf)
    ends = x.y.t + length >= (1 - 1e-12) * h
    instants = jnp.append(instants, jnp.where(ends, h - x.y.t, jnp.inf))
    number = jnp.argmin(instants)
    time = instants[number]
    # By its cubic a gap may close at once that opens, slowly at first, by the next derivatives.
    t, jerk = _SOON * length, rate.forces.acceleration
    moved = constants.coupling.seen(begin.w + t / 2 * (begin.forces.acceleration + t / 3 * jerk))
    rises = [
        kind.of_closing * moved > 0 if kind.of_closing else jnp.zeros(size, bool)
        for kind, size in zip(kinds, sizes, strict=True)
    ]
    is_rise = jnp.concatenate([*rises, jnp.zeros(1, bool)])[number]
    at_start = time <= _AT_ONCE * h
    return _First(time, number, at_start, at_start & is_rise, begin, rate)


def _located(
    constants: Constants, x: FlowState, substep: Substep, event: _First, inverse: jax.Array
) -> tuple[SmoothState, Local, Local]:
    """The state at an event, or at the end of a substep without one; the joints and gaps there.

    The last are their time derivatives.
    """
    length, exists, h = substep.length, jnp.isfinite(event.time), constants.h
    # An event at a start with a longer step comes from a jump of the forces: it stays there.
    near = jnp.where(event.at_start, 1e-3 * h, _NEAR * length)
    farthest = jnp.where(event.at_start, 0.0, near)

    def nearer(_: Any, state: Any) -> Any:
        time = lax.stop_gradient(state[0])
        y = substep.at(time)
        local, rate, values, slopes = _values(constants, x, y.motion, inverse)
        value, slope = jnp.append(values, h - y.t), jnp.append(slopes, -1.0)
        value, slope = value[event.number], lax.stop_gradient(slope[event.number])
        step = jnp.where(exists & (slope != 0), -value / jnp.where(slope == 0, 1.0, slope), 0.0)
        step = jnp.where(jnp.abs(step) <= near, step, jnp.sign(step) * farthest)
        moved = jax.tree.map(lambda z, rate: z + step * rate, y, y.rates(constants, local.forces))
        return jnp.clip(time + step, 0.0, length), moved, local, rate

    time = jnp.where(event.at_start, 0.0, jnp.where(exists, event.time, length))
    first = time, x.y, event.begin, event.rate
    return lax.fori_loop(0, _NEWTON_STEPS, nearer, first)[1:]
