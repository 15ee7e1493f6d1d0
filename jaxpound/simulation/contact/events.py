"""What may happen in a local flow: each event with what vanishes there, and its effect."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxpound._extrema import larger
from jaxpound.model.contact import Newton
from jaxpound.simulation.contact import records
from jaxpound.simulation.contact.forces import Constants, Forces, Regime, held_inverse, law_forces
from jaxpound.simulation.contact.records import APART, PRESSED, REST, Contact, StepLog, Turns, times
from jaxpound.simulation.contact.substeps import SmoothState

_REBOUNDS = 1e-2  # rebounds that would all be over within this share of a step end at once
_SLOWEST = 1e-2  # least touch speed, as a share of what an acceleration adds in a step
_AHEAD = 1e-6  # share of a step after which a force shows its sign
_COUNTS = 1e-4  # share of the fastest approach below which a touch is no impact


class FlowState(NamedTuple):
    """The joints and gaps in a flow, and what has happened to them in it."""

    y: SmoothState
    slip: jax.Array  # direction of slip of each joint, 0 in stick
    contact: Contact  # its impulse is that of ``y``
    rising: jax.Array  # 1 while the contact force of a gap grows
    log: StepLog

    @property
    def regime(self) -> Regime:
        """What is constant until the next event."""
        return Regime(self.slip, self.contact.mode, self.contact.touch_speed)

    def with_gaps(self, **entries: Any) -> FlowState:
        """The state with other entries in the log of the gaps."""
        return self._replace(log=self.log._replace(gaps=self.log.gaps._replace(**entries)))


class Local(NamedTuple):
    """The joints and gaps at an instant of a flow."""

    s: jax.Array  # (n,)
    w: jax.Array
    forces: Forces
    growth: jax.Array  # dp/dt of each gap's law, (g,)


class Occurrence(NamedTuple):
    """An event that happens."""

    where: jax.Array  # whether it does, by joint, (n,), or gap, (g,)
    forces: Forces  # just before it
    growth: Forces  # their time derivatives
    at_start: jax.Array  # whether it happens as a substep starts


class Event(NamedTuple):
    """An event of joints, or of gaps, found where a value of theirs falls below zero."""

    value: Callable[[Constants, FlowState, Local], jax.Array]
    armed: Callable[[Constants, FlowState, Local], jax.Array]
    """Where the event is possible in a substep, from its start."""
    scale: Callable[[Constants, Local, jax.Array], jax.Array]
    """Size of the numbers whose difference the value is, in a substep of a length: rounding is a
    share of it."""
    effect: Callable[[Constants, FlowState, Occurrence], FlowState]  # the state after the event
    of_force: bool = False
    """Whether a value below zero at a substep's start is the event. Otherwise it counts as zero
    there: a gap that is slightly too small, and opens, does not close."""
    may_return: bool = True  # whether values below zero only between a substep's ends count
    of_closing: int = 0  # sign of the closing in a value that is the distance to a gap, else 0


def _speed(at: Local, length: jax.Array) -> jax.Array:
    """Size of the velocities within a substep."""
    return jnp.abs(at.w) + length * jnp.abs(at.forces.acceleration)


def _distance(constants: Constants, at: Local, length: jax.Array) -> jax.Array:
    """Size of the closings within a substep, by gap."""
    return jnp.abs(constants.coupling.seen(jnp.abs(at.s) + length * _speed(at, length)))


def _force(at: Local) -> jax.Array:
    """Size of the forces in all joints, by which those that hold joints follow from each other."""
    return (jnp.abs(at.forces.total) + jnp.abs(at.forces.friction)).max()


def possible(constants: Constants) -> list[tuple[Event, int]]:
    """The events that are possible, with the number of joints or gaps of which each has a value.

    Of two events at once the first happens.
    """
    rigid, joints = constants.rigid, constants.mass.size
    of_gaps = [_TOUCH] if rigid.size else []
    of_gaps += [_LEAVE] if rigid.any() else []
    of_gaps += [] if rigid.all() else [_RELEASE, _TOP]
    of_gaps += [_CLIP] if constants.clips.any() else []
    return [(_TURN, joints), (_BREAK, joints), *((event, rigid.size) for event in of_gaps)]


def least_speed(constants: Constants, acceleration: Any = 0.0) -> jax.Array:
    """Touch speed of a contact that begins at rest, by gap, under the pull or an acceleration."""
    inputs = constants.inputs
    most = jnp.abs(constants.coupling.seen(jnp.abs(inputs.pull) + jnp.abs(inputs.rise) / 2))
    fastest = larger(jnp.abs(acceleration), most)
    return lax.stop_gradient(_SLOWEST * constants.h * fastest)


def since_middle(constants: Constants, x: FlowState) -> jax.Array:
    """Time from the middle of the step."""
    return x.y.t - constants.h / 2


def _may_slide(constants: Constants, x: FlowState) -> jax.Array:
    """Joints that are not closed at rest."""
    return ~constants.coupling.joints_where(x.contact.mode == REST)


def _turn(constants: Constants, x: FlowState, event: Occurrence) -> FlowState:
    """Slip ends: the joint sticks, or slides back at once where friction cannot stop it."""
    turns = event.where
    # Friction that reverses changes the acceleration by at most so much.
    change = 2 * constants.coupling.frictions / constants.mass
    slides_back = x.slip * event.forces.acceleration < -change
    slip = jnp.where(turns, jnp.where(slides_back, -x.slip, 0.0), x.slip)
    x = _record_turns(constants, x, turns, slip)
    return x._replace(y=x.y._replace(w=jnp.where(turns, 0.0, x.y.w)), slip=slip)


_TURN = Event(
    value=lambda constants, x, at: x.slip * at.w,
    armed=lambda constants, x, at: (x.slip != 0) & _may_slide(constants, x),
    scale=lambda constants, at, length: _speed(at, length),
    effect=_turn,
)


def _break(constants: Constants, x: FlowState, event: Occurrence) -> FlowState:
    """Stick ends: friction cannot hold the joint any more."""
    # Just after the event: a joint without friction breaks away from the force zero.
    ahead = event.forces.friction + _AHEAD * constants.h * event.growth.friction
    slip = jnp.where(event.where, lax.stop_gradient(jnp.sign(ahead)), x.slip)
    return x._replace(slip=slip, log=_with_change(constants, x, event.where))


_BREAK = Event(
    # Not μ − |q|, which has a kink where q changes its sign.
    value=lambda constants, x, at: constants.coupling.frictions**2 - at.forces.friction**2,
    armed=lambda constants, x, at: (x.slip == 0) & _may_slide(constants, x),
    scale=lambda constants, at, length: jnp.broadcast_to(_force(at) ** 2, at.s.shape),
    effect=_break,
    of_force=True,
)


def _leave(constants: Constants, x: FlowState, event: Occurrence) -> FlowState:
    """A gap that was closed at rest opens: the reaction would have to pull."""
    opens = constants.coupling.joints_where(event.where)
    away = -constants.coupling.on_joints(event.where.astype(constants.dtype))
    return x._replace(
        slip=jnp.where(opens, away, x.slip),
        contact=_in_mode(x, event.where, APART),
        log=_with_change(constants, x, opens),
    )


_LEAVE = Event(  # friction can be −μ at the least, and the contact force 0
    value=lambda constants, x, at: (
        constants.coupling.seen(at.forces.carried)
        + jnp.abs(constants.coupling.seen(constants.coupling.frictions))
    ),
    armed=lambda constants, x, at: x.contact.mode == REST,
    scale=lambda constants, at, length: jnp.broadcast_to(_force(at), at.growth.shape),
    effect=_leave,
    of_force=True,
)


def _release(constants: Constants, x: FlowState, event: Occurrence) -> FlowState:
    """The gap of a law with a force opens."""
    x = _end_impacts(constants, _on_gap(constants, x, event), event.where)
    return x._replace(contact=_in_mode(x, event.where, APART))


_RELEASE = Event(
    value=lambda constants, x, at: constants.coupling.seen(at.s) - constants.coupling.sizes,
    armed=lambda constants, x, at: x.regime.deformed,
    scale=_distance,
    effect=_release,
    of_closing=1,
)


def _clip(constants: Constants, x: FlowState, event: Occurrence) -> FlowState:
    """The force of a law that must not pull vanishes, or comes back."""
    other = jnp.where(x.contact.mode == PRESSED, records.CLIPPED, PRESSED)
    return x._replace(contact=_in_mode(x, event.where, other))


_CLIP = Event(
    value=lambda constants, x, at: jnp.where(x.contact.mode == PRESSED, 1.0, -1.0) * at.forces.raw,
    armed=lambda constants, x, at: x.regime.deformed & constants.clips,
    scale=lambda constants, at, length: jnp.abs(at.forces.elastic) + jnp.abs(at.forces.raw),
    effect=_clip,
)


_TOP = Event(  # a substep ends where the force of a law is largest
    value=lambda constants, x, at: at.growth,
    armed=lambda constants, x, at: (x.contact.mode == PRESSED) & (x.rising > 0) & (at.growth > 0),
    scale=lambda constants, at, length: 0 * at.growth,
    effect=lambda constants, x, event: x._replace(rising=jnp.where(event.where, 0.0, x.rising)),
    may_return=False,  # the growth at a touch may be infinite
)


def _touch(constants: Constants, x: FlowState, event: Occurrence) -> FlowState:
    """A gap closes: contact begins under a law with a force, and is over at once under Newton's."""
    x, touches, now = _on_gap(constants, x, event), event.where, event.forces
    contact, log, time = x.contact, x.log.gaps, since_middle(constants, x)
    speed, zeros = constants.coupling.seen(x.y.w), jnp.zeros_like(contact.mode)
    counts = touches & (speed > _COUNTS * contact.fastest) & (speed > 0)
    begun = Contact(
        mode=jnp.where(constants.rigid, contact.mode, PRESSED),
        counts=counts.astype(constants.dtype),
        fastest=lax.stop_gradient(larger(contact.fastest, speed)),
        touch_speed=larger(
            speed, least_speed(constants, constants.coupling.seen(now.acceleration))
        ),
        touch_time=constants.clock.middle + time,
        impulse=zeros,
        peak_force=zeros,
    )
    x = x.with_gaps(
        touched=jnp.where(touches, 1.0, log.touched),
        touches=log.touches + counts,
        first_touch=jnp.where(counts & (log.touches == 0), time, log.first_touch),
    )._replace(
        y=x.y._replace(impulse=jnp.where(touches, 0.0, x.y.impulse)),
        contact=jax.tree.map(lambda new, old: jnp.where(touches, new, old), begun, contact),
        rising=jnp.where(touches, 1.0, x.rising),
    )
    rigid = constants.rigid
    return _collide(constants, x, now, touches & rigid) if rigid.any() else x


_TOUCH = Event(
    value=lambda constants, x, at: constants.coupling.sizes - constants.coupling.seen(at.s),
    armed=lambda constants, x, at: x.contact.mode == APART,
    scale=_distance,
    effect=_touch,
    of_closing=-1,
)


def _collide(constants: Constants, x: FlowState, now: Forces, collides: jax.Array) -> FlowState:
    """The state after an impact by Newton's law, and so with other speeds and forces beside it.

    A gap is put at rest when its remaining bounces would take less than 1 % of a step (Zeno). Then
    others at rest stay so, unless its blow pulls there by more than the reaction in that time: else
    gaps that share masses would open each other without end.
    """
    delassus, laws = constants.coupling.delassus, constants.coupling.laws
    values = [law.restitution if isinstance(law, Newton) else 1.0 for law in laws]
    restitution = jnp.stack([jnp.asarray(e, constants.dtype) for e in values])
    mass = jnp.abs(constants.coupling.seen(constants.mass))
    speed, pull_in = constants.coupling.seen(x.y.w), constants.coupling.seen(now.acceleration)
    pull_out = pull_in + 2 * jnp.abs(constants.coupling.seen(constants.coupling.frictions)) / mass
    inward = jnp.where(pull_in > 0, pull_in, 1.0)
    outward = jnp.where(pull_in > 0, pull_out, 1.0)
    shrinkage = restitution * jnp.sqrt(inward / outward)
    flight = restitution * speed * (1 / outward + 1 / jnp.sqrt(inward * outward))
    ends = flight <= _REBOUNDS * constants.h * (1 - shrinkage)
    # A sticking joint pressed into contact arrives with zero speed, up to rounding.
    still = speed <= 32 * jnp.finfo(constants.dtype).eps * constants.h * (
        jnp.abs(pull_in) + pull_out
    )
    rests = collides & (((pull_in > 0) & ends) | still)
    rebound = jnp.where(collides & ~rests, restitution * speed, 0.0)
    blow = jnp.where(collides, (speed + rebound) * mass, 0.0)

    hit, back = constants.coupling.joints_where(collides), constants.coupling.on_joints(-rebound)
    elsewhere = constants.coupling.seen(hit.astype(constants.dtype)) == 0
    pulled = mass * constants.coupling.seen(times(delassus, constants.coupling.on_joints(blow)))
    stays = elsewhere & (x.contact.mode == REST) & rests.any()
    stays &= pulled <= _REBOUNDS * constants.h * now.contact
    fixed = hit | constants.coupling.joints_where(stays)
    blows = times(held_inverse(delassus, fixed), jnp.where(fixed, x.y.w - back, 0.0))
    blow = jnp.where(collides, constants.coupling.seen(blows), 0.0)
    w = jnp.where(fixed, back, x.y.w - times(delassus, blows))
    struck = (times(jnp.abs(delassus), fixed.astype(constants.dtype)) != 0) & ~fixed
    slip = jnp.where(struck | hit, jnp.sign(w), x.slip)
    slip = lax.stop_gradient(jnp.where(constants.coupling.joints_where(rests), 0.0, slip))
    turned = hit | (struck & (x.slip != 0) & (slip != x.slip))
    x = _record_turns(constants, x, turned, slip)
    lost = x.y.lost + blow * (speed - rebound) / 2
    x = x._replace(y=x.y._replace(w=w, lost=lost, impulse=jnp.where(collides, blow, x.y.impulse)))
    beside = (constants.coupling.seen((struck | hit).astype(constants.dtype)) != 0) & ~collides
    raw, _ = law_forces(constants, x.y.s, w, x.regime)
    clips, rest = beside & constants.clips & x.regime.deformed, beside & (x.contact.mode == REST)
    mode = jnp.where(clips, jnp.where(raw < 0, records.CLIPPED, PRESSED), APART)
    x = x._replace(contact=_in_mode(x, clips | rest, mode))
    x = _end_impacts(constants, x, collides)
    return x._replace(slip=slip, contact=_in_mode(x, rests, REST))


def _in_mode(x: FlowState, where: jax.Array, mode: Any) -> Contact:
    """The contact with another mode in some gaps."""
    return x.contact._replace(mode=jnp.where(where, mode, x.contact.mode))


def _on_gap(constants: Constants, x: FlowState, event: Occurrence) -> FlowState:
    """The state with a gap exactly closed, if its joint has moved there."""
    moves = event.where & ~event.at_start
    there = constants.coupling.on_joints(jnp.where(moves, constants.coupling.sizes, 0.0))
    return x._replace(
        y=x.y._replace(s=jnp.where(constants.coupling.joints_where(moves), there, x.y.s))
    )


def _end_impacts(constants: Constants, x: FlowState, ends: jax.Array) -> FlowState:
    """The state with the ends of impacts recorded."""
    contact, log, impulse = x.contact, x.log.gaps, x.y.impulse
    over, impacts = ends & (contact.counts > 0), log.impacts
    if constants.slots:
        slot = over[:, None] & (jnp.arange(constants.slots)[None] == log.ended[:, None])
        time = constants.clock.middle + since_middle(constants, x)
        ended = records.Impacts(
            touch_time=contact.touch_time,
            approach_velocity=contact.touch_speed,
            end_time=jnp.broadcast_to(time, impulse.shape),
            rebound_velocity=-constants.coupling.seen(x.y.w),
            impulse=impulse,
            peak_force=contact.peak_force,
        )
        impacts = jax.tree.map(lambda new, old: jnp.where(slot, new[:, None], old), ended, impacts)
    return x.with_gaps(
        ended=log.ended + over,
        strongest=jnp.where(over & (impulse > log.strongest), impulse, log.strongest),
        soft_peak=records.soft_larger(log.soft_peak, jnp.where(over, contact.peak_force, 0.0)),
        impacts=impacts,
    )


def _with_change(constants: Constants, x: FlowState, changes: jax.Array) -> StepLog:
    """The log with the time at which the direction of slip changes in some joints."""
    time = jnp.where(changes, since_middle(constants, x), x.log.change_time)
    return x.log._replace(change_time=time)


def _record_turns(
    constants: Constants, x: FlowState, turned: jax.Array, slip: jax.Array
) -> FlowState:
    """The state with closings recorded where velocities of joints vanished or reversed."""
    turns, s, time = x.log.turns, x.y.s, since_middle(constants, x)
    had_turned, path = turns.exist > 0, jnp.abs(s - turns.last)
    farther, nearer = turned & (s > turns.farthest), turned & (s < turns.nearest)
    turns = Turns(
        exist=jnp.where(turned, 1.0, turns.exist),
        first=jnp.where(turned & ~had_turned, s, turns.first),
        last=jnp.where(turned, s, turns.last),
        between=turns.between + jnp.where(turned & had_turned, path, 0.0),
        farthest=jnp.where(farther, s, turns.farthest),
        farthest_time=jnp.where(farther, time, turns.farthest_time),
        nearest=jnp.where(nearer, s, turns.nearest),
        nearest_time=jnp.where(nearer, time, turns.nearest_time),
    )
    return x._replace(log=_with_change(constants, x, slip != x.slip)._replace(turns=turns))
