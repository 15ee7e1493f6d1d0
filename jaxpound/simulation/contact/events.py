"""What may happen in a local flow: each event with what vanishes there, and its effect."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxpound._extrema import larger
from jaxpound.simulation.contact import records
from jaxpound.simulation.contact.forces import Forces, LinkLaws, Regime, times
from jaxpound.simulation.contact.records import APART, PRESSED, REST, Contact, StepLog

_REBOUNDS = 1e-2  # rebounds that would all be over within this share of a step end at once
_SLOWEST = 1e-2  # least touch speed, as a share of what an acceleration adds in a step
_AHEAD = 1e-6  # share of a step after which a force shows its sign
_COUNTS = 1e-4  # share of the fastest approach below which a touch is no impact


class SmoothState(NamedTuple):
    """What changes smoothly between events, (f,) each; as an array, its rows."""

    t: jax.Array  # from the start of the step, the same for all links
    s: jax.Array
    w: jax.Array
    area: jax.Array  # ∫ s dt
    stored: jax.Array
    lost: jax.Array
    impulse: jax.Array


def row(y: jax.Array, name: str) -> jax.Array:
    """A row of a ``SmoothState`` that is an array."""
    return y[SmoothState._fields.index(name)]


def _replaced(y: jax.Array, links: jax.Array, **rows: jax.Array) -> jax.Array:
    """A ``SmoothState`` that is an array with rows, by name, replaced in some links."""
    for name, values in rows.items():
        is_row = np.array([[field == name] for field in SmoothState._fields])
        y = jnp.where(is_row & links[None], values[None], y)
    return y


class Snapshot(NamedTuple):
    """The state of a flow in the middle of the step, as far as results need it."""

    y: jax.Array
    slip: jax.Array
    contact: Contact
    log: StepLog


class FlowState(NamedTuple):
    """The state of a flow."""

    y: jax.Array  # a ``SmoothState``, (7, f)
    slip: jax.Array  # direction of slip, 0 in stick
    contact: Contact  # its impulse is that of ``y``
    rising: jax.Array  # 1 while the contact force grows
    middle: Snapshot
    log: StepLog
    ended: jax.Array  # 1 at the end of the step
    iterations: jax.Array
    length: jax.Array  # of the substep to try
    usual: jax.Array  # length that the error allows
    rejected: jax.Array  # 1 if the last substep was too long

    @property
    def regime(self) -> Regime:
        """What is constant until the next event."""
        return Regime.of(self.slip, self.contact)


class Place(NamedTuple):
    """The links at an instant of a flow, (f,) each."""

    s: jax.Array
    w: jax.Array
    forces: Forces
    growth: jax.Array  # dp/dt of each contact law's force


class Setting(NamedTuple):
    """Constants of a flow."""

    laws: LinkLaws
    clock: records.Clock
    h: float
    slots: int
    pull: jax.Array  # largest |A| of the step, (f,)

    def least_speed(self, acceleration: jax.Array) -> jax.Array:
        """Touch speed of a contact that begins at rest under an acceleration."""
        return lax.stop_gradient(_SLOWEST * self.h * jnp.abs(acceleration))

    def since_middle(self, x: FlowState) -> jax.Array:
        """Time from the middle of the step, (f,)."""
        return x.y[0] - self.h / 2


class Occurrence(NamedTuple):
    """An event that happens."""

    links: jax.Array  # (f,), the face where it does
    forces: Forces  # just before it
    growth: Forces  # their time derivatives
    at_start: jax.Array  # whether it happens as a substep starts


class Event(NamedTuple):
    """An event of a link, found where a value of it falls below zero."""

    value: Callable[[Setting, FlowState, Place], jax.Array]
    armed: Callable[[Setting, FlowState, Place], jax.Array]
    """Faces, (f,), in which the event is possible in a substep, from the place of its start."""
    scale: Callable[[Place, jax.Array], jax.Array]
    """Size of the numbers whose difference the value is, in a substep of a length: rounding is a
    share of it."""
    effect: Callable[[Setting, FlowState, Occurrence], FlowState]  # the state after the event
    of_force: bool = False
    """Whether a value below zero at a substep's start is the event. Otherwise it counts as zero
    there: a gap that is slightly too small, and opens, does not close."""
    may_return: bool = True  # whether values below zero only between a substep's ends count
    of_closing: int = 0  # sign of the closing in a value that is the distance to a gap, else 0


def _speed(at: Place, length: jax.Array) -> jax.Array:
    """Size of the velocities within a substep."""
    return jnp.abs(at.w) + length * jnp.abs(at.forces.acceleration)


def _distance(at: Place, length: jax.Array) -> jax.Array:
    """Size of the closings within a substep."""
    return jnp.abs(at.s) + length * _speed(at, length)


def _force(at: Place) -> jax.Array:
    """Size of the forces in all links, by which those that hold links follow from each other."""
    size = jnp.abs(at.forces.total) + jnp.abs(at.forces.friction)
    return jnp.broadcast_to(size.max(-1, keepdims=True), size.shape)


def table(laws: LinkLaws) -> list[Event]:
    """The events that are possible in a group with these laws; of two at once the first happens."""
    events = [_TURN, _BREAK]
    events += [_TOUCH] if laws.has_contact else []
    events += [_LEAVE] if laws.has_newton else []
    events += [_RELEASE, _TOP] if laws.has_contact_force else []
    events += [_CLIP] if laws.may_clip else []
    return events


def _may_slide(setting: Setting, x: FlowState) -> jax.Array:
    """Links that are not closed at rest; not their other faces, which follow them."""
    slides = ~setting.laws.of_either_face(x.contact.mode == REST)
    return slides & setting.laws.is_link if setting.laws.faces else slides


def seen_from_both_sides(setting: Setting, x: FlowState, links: jax.Array) -> FlowState:
    """The state after an effect on some faces: the other faces of their links follow."""
    laws = setting.laws
    if not laws.faces:
        return x
    follows = laws.of_other_face(links, without=False)
    other = {name: -laws.of_other_face(row(x.y, name), without=0.0) for name in ("s", "w")}
    slip = jnp.where(follows, -laws.of_other_face(x.slip, without=0.0), x.slip)
    return x._replace(y=_replaced(x.y, follows, **other), slip=slip)


def _turn(setting: Setting, x: FlowState, event: Occurrence) -> FlowState:
    """Slip ends: the link sticks, or slides back at once where friction cannot stop it."""
    turns = event.links
    # Friction that reverses changes the acceleration by at most so much.
    change = 2 * setting.laws.friction / setting.laws.mass
    slides_back = x.slip * event.forces.acceleration < -change
    slip = jnp.where(turns, jnp.where(slides_back, -x.slip, 0.0), x.slip)
    x = _record_turns(setting, x, turns, slip)
    return x._replace(y=_replaced(x.y, turns, w=jnp.zeros_like(slip)), slip=slip)


_TURN = Event(
    value=lambda setting, x, at: x.slip * at.w,
    armed=lambda setting, x, at: (x.slip != 0) & _may_slide(setting, x),
    scale=_speed,
    effect=_turn,
)


def _break(setting: Setting, x: FlowState, event: Occurrence) -> FlowState:
    """Stick ends: friction cannot hold the link any more."""
    # Just after the event: a link without friction breaks away from the force zero.
    ahead = event.forces.friction + _AHEAD * setting.h * event.growth.friction
    way = lax.stop_gradient(jnp.sign(ahead))
    slip = jnp.where(event.links, way, x.slip)
    return x._replace(slip=slip, log=_with_change(setting, x, event.links))


_BREAK = Event(
    # Not μ − |q|, which has a kink where q changes its sign.
    value=lambda setting, x, at: setting.laws.friction**2 - at.forces.friction**2,
    armed=lambda setting, x, at: (x.slip == 0) & _may_slide(setting, x),
    scale=lambda at, length: _force(at) ** 2,
    effect=_break,
    of_force=True,
)


def _leave(setting: Setting, x: FlowState, event: Occurrence) -> FlowState:
    """A gap that was closed at rest opens: the reaction would have to pull."""
    return x._replace(
        slip=jnp.where(event.links, -1.0, x.slip),
        contact=_in_mode(x, event.links, APART),
        log=_with_change(setting, x, event.links),
    )


_LEAVE = Event(  # friction can be −μ at the least, and the contact force 0
    value=lambda setting, x, at: at.forces.total + setting.laws.friction,
    armed=lambda setting, x, at: x.contact.mode == REST,
    scale=lambda at, length: _force(at),
    effect=_leave,
    of_force=True,
)


def _release(setting: Setting, x: FlowState, event: Occurrence) -> FlowState:
    """The gap of a law with a force opens."""
    x = _end_impacts(setting, _on_gap(setting, x, event), event.links)
    return x._replace(contact=_in_mode(x, event.links, APART))


_RELEASE = Event(
    value=lambda setting, x, at: at.s - setting.laws.gap,
    armed=lambda setting, x, at: x.regime.deformed,
    scale=_distance,
    effect=_release,
    of_closing=1,
)


def _clip(setting: Setting, x: FlowState, event: Occurrence) -> FlowState:
    """The force of a law that must not pull vanishes, or comes back."""
    other = jnp.where(x.contact.mode == PRESSED, records.CLIPPED, PRESSED)
    return x._replace(contact=_in_mode(x, event.links, other))


_CLIP = Event(
    value=lambda setting, x, at: jnp.where(x.contact.mode == PRESSED, 1.0, -1.0) * at.forces.raw,
    armed=lambda setting, x, at: x.regime.deformed & setting.laws.clips,
    scale=lambda at, length: jnp.abs(at.forces.elastic) + jnp.abs(at.forces.raw),
    effect=_clip,
)


_TOP = Event(  # a substep ends where the force of a law is largest
    value=lambda setting, x, at: at.growth,
    armed=lambda setting, x, at: (x.contact.mode == PRESSED) & (x.rising > 0) & (at.growth > 0),
    scale=lambda at, length: 0 * at.growth,
    effect=lambda setting, x, event: x._replace(rising=jnp.where(event.links, 0.0, x.rising)),
    may_return=False,  # the growth at a touch may be infinite
)


def _touch(setting: Setting, x: FlowState, event: Occurrence) -> FlowState:
    """A gap closes: contact begins under a law with a force, and is over at once under Newton's."""
    x, laws, touches, now = _on_gap(setting, x, event), setting.laws, event.links, event.forces
    contact, log, speed, time = x.contact, x.log, row(x.y, "w"), setting.since_middle(x)
    counts = touches & (speed > _COUNTS * contact.fastest) & (speed > 0)
    slowest = setting.least_speed(larger(jnp.abs(now.acceleration), setting.pull))
    begun = Contact(
        mode=jnp.where(laws.rigid, contact.mode, PRESSED),
        counts=jnp.where(counts, 1.0, 0.0).astype(laws.dtype),
        fastest=lax.stop_gradient(larger(contact.fastest, speed)),
        touch_speed=larger(speed, slowest),
        touch_time=setting.clock.middle + time,
        impulse=0 * speed,
        peak_force=0 * speed,
    )
    contact = jax.tree.map(lambda new, old: jnp.where(touches, new, old), begun, contact)
    log = log._replace(
        touched=larger(log.touched, jnp.where(touches, 1.0, 0.0)),
        touches=log.touches + jnp.where(counts, 1.0, 0.0),
        first_touch=jnp.where(counts & (log.touches == 0), time, log.first_touch),
    )
    x = x._replace(
        y=_replaced(x.y, touches, impulse=jnp.zeros_like(speed)),
        contact=contact,
        rising=jnp.where(touches, 1.0, x.rising),
        log=log,
    )
    return _collide(setting, x, now, touches & laws.rigid) if laws.has_newton else x


_TOUCH = Event(
    value=lambda setting, x, at: setting.laws.gap - at.s,
    armed=lambda setting, x, at: setting.laws.has_law & (x.contact.mode == APART),
    scale=_distance,
    effect=_touch,
    of_closing=-1,
)


def _collide(setting: Setting, x: FlowState, now: Forces, collides: jax.Array) -> FlowState:
    """The state after impacts by Newton's law, and so with other speeds and forces beside them.

    A link is put at rest when its remaining bounces would take less than 1 % of a step (Zeno).
    """
    laws, slip, speed = setting.laws, x.slip, row(x.y, "w")
    mass, restitution = laws.mass, laws.restitution
    pull_in = now.acceleration
    pull_out = pull_in + 2 * laws.friction / mass
    inward = jnp.where(pull_in > 0, pull_in, 1.0)
    outward = jnp.where(pull_in > 0, pull_out, 1.0)
    shrinkage = restitution * jnp.sqrt(inward / outward)
    flight = restitution * speed * (1 / outward + 1 / jnp.sqrt(inward * outward))
    ends = flight <= _REBOUNDS * setting.h * (1 - shrinkage)
    # A sticking link pressed into contact arrives with zero speed, up to rounding.
    eps = 32 * float(jnp.finfo(laws.dtype).eps)
    still = speed <= eps * setting.h * (jnp.abs(pull_in) + pull_out)
    rests = collides & (((pull_in > 0) & ends) | still)
    rebound = jnp.where(collides & ~rests, restitution * speed, 0.0)
    blow = jnp.where(collides, (speed + rebound) * mass, 0.0)

    w = jnp.where(collides, -rebound, speed - times(laws.delassus, blow))
    beside = times(laws.delassus, jnp.where(collides, 1.0, 0.0)) != 0
    struck = beside & ~collides
    slip = jnp.where(struck | collides, jnp.sign(w), slip)
    slip = lax.stop_gradient(jnp.where(rests, 0.0, slip))
    turned = collides | (struck & (x.slip != 0) & (slip != x.slip))
    x = _record_turns(setting, x, turned, slip)
    lost = row(x.y, "lost") + blow * (speed - rebound) / 2
    y = _replaced(x.y, jnp.ones_like(collides), w=w, lost=lost)
    raw, _ = laws.of_contact(row(y, "s"), w, x.regime)
    clips, rest = struck & laws.clips & x.regime.deformed, struck & (x.contact.mode == REST)
    mode = jnp.where(clips, jnp.where(raw < 0, records.CLIPPED, PRESSED), APART)
    x = x._replace(y=_replaced(y, collides, impulse=blow), contact=_in_mode(x, clips | rest, mode))
    x = _end_impacts(setting, x, collides)
    return x._replace(slip=slip, contact=_in_mode(x, rests, REST))


def _in_mode(x: FlowState, links: jax.Array, mode: Any) -> Contact:
    """The contact with another mode in some links."""
    return x.contact._replace(mode=jnp.where(links, mode, x.contact.mode))


def _on_gap(setting: Setting, x: FlowState, event: Occurrence) -> FlowState:
    """The state with the gaps of some links exactly closed, if they have moved there."""
    return x._replace(y=_replaced(x.y, event.links & ~event.at_start, s=setting.laws.gap))


def _end_impacts(setting: Setting, x: FlowState, ends: jax.Array) -> FlowState:
    """The state with the ends of impacts recorded."""
    contact, log, impulse = x.contact, x.log, row(x.y, "impulse")
    over = ends & (contact.counts > 0)
    log = log._replace(
        ended=log.ended + jnp.where(over, 1.0, 0.0),
        strongest=jnp.where(over & (impulse > log.strongest), impulse, log.strongest),
        powers=log.powers + jnp.where(over, contact.peak_force**records.SOFT, 0.0),
    )
    if setting.slots:
        slot = over[:, None] & (jnp.arange(setting.slots)[None] == x.log.ended[:, None])
        impacts = records.Impacts(
            touch_time=contact.touch_time,
            approach_velocity=contact.touch_speed,
            end_time=setting.clock.middle + setting.since_middle(x),
            rebound_velocity=-row(x.y, "w"),
            impulse=impulse,
            peak_force=contact.peak_force,
        )
        recorded = jax.tree.map(
            lambda new, old: jnp.where(slot, new[:, None], old), impacts, log.impacts
        )
        log = log._replace(impacts=recorded)
    return x._replace(log=log)


def _with_change(setting: Setting, x: FlowState, changes: jax.Array) -> StepLog:
    """The log with the time at which the direction of slip changes in some links."""
    changes = setting.laws.of_either_face(changes)
    time = jnp.where(changes, setting.since_middle(x), x.log.change_time)
    return x.log._replace(change_time=time)


def _record_turns(setting: Setting, x: FlowState, turned: jax.Array, slip: jax.Array) -> FlowState:
    """The state with closings recorded where velocities vanished or reversed."""
    log, s, time = _with_change(setting, x, slip != x.slip), row(x.y, "s"), setting.since_middle(x)
    turned = setting.laws.of_either_face(turned)
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
    )
    return x._replace(log=log)
