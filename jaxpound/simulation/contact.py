r"""Links that may touch or that share masses, over one step of a run.

Such links, a group, are followed by the local flow (``local_flow``) where it is needed: in contact,
where a gap may close within the step, and, for links that share masses, where slip or stick ends.
All other steps have closed forms.

An impact is a kink of the path. Were the rods given the position at an instant of the grid, where
in the step the kink falls would leave a ragged error of order h² in the path that they see, and of
order h in gradients. So after a step that was followed they are given the mean sample instead,

    mean of s over the step − (h/24) (change of s' over the step),

which is s in its middle to order h⁴ where motion is smooth, and by which their memory integrates a
kinked path as well as a smooth one. By how much that changes the pull of the rods is then added to
the end of the step.
"""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jaxpound._extrema import larger
from jaxpound.model.contact import bound
from jaxpound.model.system import Link, LinkGroup, Topology
from jaxpound.simulation.forces import APART, PRESSED, held_inverse, inverse_of, response
from jaxpound.simulation.friction import EventResolved, LinkMotion, LinkStep
from jaxpound.simulation.local_flow import flow
from jaxpound.simulation.passage import Given, Modes, Passed, UnderWay


class Coupling(NamedTuple):
    """Constants of a group of n links that is followed."""

    delassus: jax.Array  # G (n, n): relative accelerations of ends under unit forces in the links
    shifts: dict[int, jax.Array]  # (n,) by mass: its shift by each closing about a fixed centre
    frictions: jax.Array  # (n,)
    gaps: jax.Array
    laws: tuple[Any, ...]  # of contact, for the effective masses


class ContactState(NamedTuple):
    """State of a link in a group that is followed, beside that of any link."""

    half: jax.Array  # closing at t_m − h/2
    mode: jax.Array  # of contact, as in ``forces``
    counts: jax.Array  # 1 if the contact under way is an impact
    fastest: jax.Array  # largest speed of approach so far
    under_way: UnderWay  # with the time of the run


class ContactMotion(NamedTuple):
    """What a link that is followed did in a step from t_m − h/2 to t_m + h/2."""

    used: jax.Array  # whether the local flow was needed
    passed: Passed  # its result; zero if it was not; ``now`` with the time of the run


def is_followed(group: LinkGroup, links: tuple[Link, ...]) -> bool:
    """Whether a group's steps may need the local flow."""
    return len(group.links) > 1 or links[group.links[0]].contact is not None


def coupling(
    topology: Topology,
    group: LinkGroup,
    links: tuple[Link, ...],
    inverse: tuple[jax.Array, ...],
) -> Coupling:
    """The constants of a group; ``inverse`` are the inverse masses."""
    ends = [topology.links[k] for k in group.links]
    pulls = {
        mass: jnp.asarray([(mass == i) - (mass == j) for i, j in ends], inverse[0].dtype)
        for mass in group.masses
    }
    weighed = [inverse[mass] * jnp.outer(pull, pull) for mass, pull in pulls.items()]
    delassus = sum(weighed[1:], weighed[0])
    whole = inverse_of(delassus)
    return Coupling(
        delassus=delassus,
        shifts={mass: inverse[mass] * (pull @ whole) for mass, pull in pulls.items()},
        frictions=jnp.stack([links[k].friction for k in group.links]),
        gaps=jnp.stack([links[k].gap for k in group.links]),
        laws=tuple(
            None if links[k].contact is None else bound(links[k].contact, 1 / delassus[j, j])
            for j, k in enumerate(group.links)
        ),
    )


def apart(zero: jax.Array) -> ContactState:
    """The state of a link before the first step."""
    return ContactState(*(zero,) * 4, UnderWay(*(zero,) * 4))


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class GroupStep:
    """What a group is given for a step from t_m − h/2 to t_m + h/2; (n,) for n links."""

    closing: jax.Array  # at t_m, as predicted
    velocity: jax.Array  # at t_m − h/2
    state: ContactState
    pull: jax.Array  # A_m
    rise: jax.Array  # A_m − A_{m−1}
    time: jax.Array
    starts: jax.Array  # whether t_m = 0
    halfway: bool = dataclasses.field(metadata={"static": True})  # a run starts in mid-step
    dt: float = dataclasses.field(metadata={"static": True})  # h
    slots: int = dataclasses.field(metadata={"static": True})  # impacts of a link to be recorded


def plain_motion(group: Coupling, before: GroupStep) -> LinkMotion:
    """Motion of links that share masses over a step in which no slip or stick ends.

    Links without friction may reverse at any time: they have the closed form of a link alone.
    """
    slip = jnp.sign(jax.lax.stop_gradient(before.velocity))
    rubs, own = group.frictions > 0, jnp.diagonal(group.delassus)
    known, held = group.frictions * slip, (slip == 0) & rubs
    gain, _ = _response(group, held, before.pull, known)
    bend, _ = _response(group, held, before.rise, 0 * known)
    others = gain + own * known
    step = LinkStep(before.velocity, slip, others, bend, own, group.frictions, before.dt)
    alone = EventResolved().slide(step)

    def shared(own_change: jax.Array) -> jax.Array:
        """Changes of all closings as links without friction change theirs by their own force."""
        change = jnp.where(rubs, 0.0, own_change)
        return _response(group, held, 0 * change, -change / own)[0]

    # What follows is zero where there is no friction, but not its derivative by the friction.
    known = jnp.where(rubs, known, alone.mean_force)
    gain, force = _response(group, held, before.pull, known)
    velocity_now = before.velocity + before.dt / 2 * (gain - bend / 4)
    zero = jnp.zeros_like(before.velocity)
    motion = LinkMotion(
        velocity=before.velocity + before.dt * gain,
        mean_force=force,
        force=force,
        velocity_now=velocity_now + shared(alone.velocity_now - velocity_now),
        jump=shared(alone.jump),
        turns=slip > 1,
        turn_time=zero,
        turn=zero,
        turn_forces=(force, force),
        phase=slip,
        change_time=zero,
    )
    moved = {name: getattr(motion, name) for name in ("velocity", "velocity_now", "jump")}
    return jax.tree.map(lambda x, y: jnp.where(rubs, x, y), motion, alone._replace(**moved))


def follow(group: Coupling, before: GroupStep) -> tuple[Passed, jax.Array]:
    """The local flow of a group where it is needed, and whether it was."""
    state, h = before.state, before.dt
    # How far each link can close in the step at most.
    pushed = jnp.abs(group.delassus) @ group.frictions
    if len(group.laws) == 1:  # its own friction never drives it
        pushed = jnp.where(before.velocity < 0, pushed, 0.0)
    most = larger(before.pull + jnp.abs(before.rise) / 2 + pushed, 0.0)
    reach = state.half + h * larger(before.velocity, 0.0) + h**2 / 2 * most
    meets = jnp.asarray([law is not None for law in group.laws])
    needed = (meets & ((state.mode != APART) | (reach >= group.gaps))).any()
    if len(group.laws) > 1:
        needed = needed | ~_is_undisturbed(group, before)
    given = Given(
        closing=state.half,
        velocity=before.velocity,
        pull=before.pull,
        rise=before.rise,
        delassus=group.delassus,
        friction=group.frictions,
        gap=group.gaps,
        laws=group.laws,
        under_way=_at(-before.time, state.under_way),
    )
    start = jnp.where(before.starts & before.halfway, h / 2, 0.0).astype(before.velocity.dtype)
    modes = Modes(state.mode, state.counts, state.fastest, start)
    passed = flow(h, before.slots, needed, given, modes)
    # A single link that came near but did not touch has its closed form.
    touched = ~(passed.record.touched == 0).all()  # true for NaN
    used = needed if len(group.laws) > 1 else needed & touched
    return passed, used


def _at(shift: jax.Array, contact: UnderWay) -> UnderWay:
    """A contact under way with its time counted from another instant."""
    return contact._replace(touch_time=contact.touch_time + shift)


def mean_sample(passed: Passed, before: GroupStep) -> jax.Array:
    """The closings that the rods are given for t_m after a step that was followed."""
    kink = passed.velocity - before.velocity
    # The first sample of a run is as it is.
    return jnp.where(before.starts, before.closing, passed.mean - before.dt / 24 * kink)


def settle(
    group: Coupling,
    before: GroupStep,
    plain: LinkMotion,
    passed: Passed,
    used: jax.Array,
    more: jax.Array,
) -> tuple[jax.Array, ContactState, LinkMotion]:
    """The end of a step: the closings at t_m, the state after it, and the motion in it.

    ``before`` has the pull after the mean samples, which have changed it by ``more``.
    """
    h, state, at, record = before.dt, before.state, passed.now, passed.record
    gain, _ = _response(group, passed.held > 0, more, 0 * more)
    # A law's force gives way to a shift of the closing at once; a shift would only shake it.
    shift = jnp.where(passed.mode == PRESSED, 0.0, h**2 / 2 * gain)
    velocity, half = passed.velocity + h * gain, passed.closing + shift
    after = half + h / 2 * velocity + h**2 / 8 * (passed.acceleration + gain)
    gain_now, _ = _response(group, at.held > 0, more, 0 * more)
    shift_now = jnp.where(at.contact != 0, 0.0, h**2 / 8 * gain_now)
    closing_now = at.closing + shift_now
    kick = before.pull - (velocity - before.velocity) / h
    followed = LinkMotion(
        velocity=velocity,
        mean_force=inverse_of(group.delassus) @ kick,
        force=at.friction,
        velocity_now=at.velocity + h / 2 * gain_now,
        jump=after - before.closing - h * velocity,
        turns=record.turns > 0,
        turn_time=record.farthest_time,
        turn=jnp.where(record.turns > 0, record.farthest - closing_now, 0.0),
        turn_forces=(at.friction, at.friction),
        phase=jnp.where(passed.held > 0, 0.0, jnp.sign(velocity)),
        change_time=record.change_time,
    )
    motion = jax.tree.map(lambda a, b: jnp.where(used, a, b), followed, plain)

    # Without the flow: the closing at the end from that at t_{m+1}.
    next_closing = before.closing + h * plain.velocity + plain.jump
    held = (plain.phase == 0) & (group.frictions > 0)
    known = group.frictions * plain.phase
    end, _ = _response(group, held, before.pull + before.rise / 2, known)
    plain_half = next_closing - h / 2 * plain.velocity - h**2 / 8 * end
    contact = ContactState(
        half=half,
        mode=passed.mode,
        counts=passed.counts,
        fastest=passed.fastest,
        under_way=_at(before.time, passed.under_way),
    )
    contact = jax.tree.map(
        lambda a, b: jnp.where(used, a, b), contact, state._replace(half=plain_half)
    )
    at = at._replace(under_way=_at(before.time, at.under_way))
    quiet = jax.tree.map(lambda x: jnp.where(used, x, jnp.zeros_like(x)), passed._replace(now=at))
    seen = ContactMotion(jnp.broadcast_to(used, half.shape), quiet)
    now = jnp.where(used, closing_now, before.closing)
    return now, contact, motion._replace(contact=seen)


def _response(
    group: Coupling, held: jax.Array, pull: jax.Array, known: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """Accelerations and forces where some links are held, and forces are known in the others."""
    inverse = held_inverse(group.delassus, held)
    return response(group.delassus, inverse, held, pull, known)


def _is_undisturbed(group: Coupling, before: GroupStep) -> jax.Array:
    """Whether no slip or stick ends in the step, if nothing touches."""
    slip, h = jnp.sign(before.velocity), before.dt
    rubs = group.frictions > 0
    known, held = group.frictions * slip, (slip == 0) & rubs
    starts, first_forces = _response(group, held, before.pull - before.rise / 2, known)
    ends, last_forces = _response(group, held, before.pull + before.rise / 2, known)
    # The speed along the slip is a parabola.
    first, last, speed = slip * starts, slip * ends, jnp.abs(before.velocity)
    dips = (first < 0) & (last > 0)
    lowest = speed - h * first**2 / (2 * jnp.where(dips, last - first, 1.0))
    keeps = (speed + h * (first + last) / 2 > 0) & (~dips | (lowest > 0))
    forces = larger(jnp.abs(first_forces), jnp.abs(last_forces))
    return jnp.where(held, forces <= group.frictions, keeps | ~rubs).all()
