r"""Links that may touch or that share masses, over one step of a run.

Such links, a group, are followed by the local flow (``events``) where it is needed: in contact,
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

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jaxpound._extrema import larger
from jaxpound.model.system import Link, LinkGroup, Topology
from jaxpound.simulation.events import (
    APART,
    PRESSED,
    Given,
    Impacts,
    Modes,
    Passed,
    flow,
    inverse_of,
)
from jaxpound.simulation.friction import LinkMotion


class Coupling(NamedTuple):
    """Constants of a group of n links that is followed."""

    delassus: jax.Array  # G (n, n): relative accelerations of ends under unit forces in the links
    shifts: dict[int, jax.Array]  # (n,) by mass: its shift by each closing about a fixed centre
    frictions: jax.Array  # (n,)
    gaps: jax.Array
    laws: tuple[Any, ...]  # of contact


class ContactState(NamedTuple):
    """State of a link in a group that is followed, beside that of any link."""

    half: jax.Array  # closing at t_m − h/2
    mode: jax.Array  # of contact, as in ``events``
    touch_speed: jax.Array  # of the contact under way, as the next four
    touch_time: jax.Array
    impulse: jax.Array
    peak_force: jax.Array
    counts: jax.Array  # 1 if it is an impact
    fastest: jax.Array  # largest speed of approach so far


class ContactMotion(NamedTuple):
    """What contact did to a link in a step from t_m − h/2 to t_m + h/2."""

    used: jax.Array  # whether the local flow was needed; if not, all below is of no account
    force: jax.Array  # p at t_m
    stored_now: jax.Array  # gained until t_m by the energy stored, and in the whole step
    stored: jax.Array
    lost_now: jax.Array  # the same of the energy lost
    lost: jax.Array
    touched: jax.Array  # 1 if in contact at any time
    touches: jax.Array  # number of impacts that began
    first_touch: jax.Array  # when the first did, after t_m
    strongest: jax.Array  # largest impulse of an impact that was under way
    farthest: jax.Array  # largest closing where the slip velocity vanished or was reversed
    first_turn: jax.Array  # closing where the slip velocity first vanished or was reversed,
    last_turn: jax.Array  # and where it last did
    between: jax.Array  # path from the one to the other
    highest: jax.Array  # largest p
    highest_time: jax.Array  # after t_m
    highest_forces: jax.Array  # q + p of all links of the group then, (n,)
    impacts: Impacts  # that ended, (SLOTS,) each


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
        laws=tuple(links[k].contact for k in group.links),
    )


def apart(zero: jax.Array) -> ContactState:
    """The state of a link before the first step."""
    return ContactState(*(zero,) * len(ContactState._fields))


class GroupStep(NamedTuple):
    """What a group is given for a step from t_m − h/2 to t_m + h/2; (n,) for n links."""

    closing: jax.Array  # at t_m, as predicted
    velocity: jax.Array  # at t_m − h/2
    state: ContactState
    pull: jax.Array  # A_m
    rise: jax.Array  # A_m − A_{m−1}
    time: jax.Array
    starts: jax.Array  # whether t_m = 0
    dt: float  # h


def plain_motion(group: Coupling, before: GroupStep) -> LinkMotion:
    """Motion of links that share masses over a step in which no slip or stick ends."""
    slip = jnp.sign(jax.lax.stop_gradient(before.velocity))
    known, held = group.frictions * slip, slip == 0
    gain, force = _response(group, held, before.pull, known)
    bend, _ = _response(group, held, before.rise, 0 * known)
    zero = jnp.zeros_like(before.velocity)
    return LinkMotion(
        velocity=before.velocity + before.dt * gain,
        mean_force=force,
        force=force,
        velocity_now=before.velocity + before.dt / 2 * (gain - bend / 4),
        jump=zero,
        turns=slip > 1,
        turn_time=zero,
        turn=zero,
        turn_forces=(force, force),
        phase=slip,
        change_time=zero,
    )


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
        touch_speed=state.touch_speed,
        impulse=state.impulse,
        peak_force=state.peak_force,
        touch_time=state.touch_time - before.time,
    )
    start = jnp.where(before.starts, h / 2, 0.0).astype(before.velocity.dtype)
    passed = flow(h, given, Modes(state.mode, state.counts, state.fastest, start, needed))
    # A single link that came near but did not touch has its closed form.
    used = needed if len(group.laws) > 1 else needed & (passed.touched > 0).any()
    return passed, used


def mean_sample(passed: Passed, before: GroupStep) -> jax.Array:
    """The closings that the rods are given for t_m after a step that was followed."""
    kink = passed.velocity - before.velocity
    # A run starts at rest: its first sample is as it is.
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

    ``more`` is by how much the mean sample has changed the pull.
    """
    h, state = before.dt, before.state
    gain, _ = _response(group, passed.held > 0, more, 0 * more)
    # A law's force gives way to a shift of the closing at once; a shift would only shake it.
    shift = jnp.where(passed.mode == PRESSED, 0.0, h**2 / 2 * gain)
    velocity, half = passed.velocity + h * gain, passed.closing + shift
    after = half + h / 2 * velocity + h**2 / 8 * (passed.acceleration + gain)
    gain_now, _ = _response(group, passed.held_now > 0, more, 0 * more)
    shift_now = jnp.where(passed.contact_now != 0, 0.0, h**2 / 8 * gain_now)
    closing_now = passed.closing_now + shift_now
    kick = before.pull + more - (velocity - before.velocity) / h
    followed = LinkMotion(
        velocity=velocity,
        mean_force=inverse_of(group.delassus) @ kick,
        force=passed.friction_now,
        velocity_now=passed.velocity_now + h / 2 * gain_now,
        jump=after - before.closing - h * velocity,
        turns=passed.turns > 0,
        turn_time=passed.farthest_time,
        turn=jnp.where(passed.turns > 0, passed.farthest, 0.0) - closing_now,
        turn_forces=(passed.friction_now, passed.friction_now),
        phase=jnp.where(passed.held > 0, 0.0, jnp.sign(velocity)),
        change_time=passed.change_time,
    )
    motion = jax.tree.map(lambda a, b: jnp.where(used, a, b), followed, plain)

    # Without the flow: the closing at the end from that at t_{m+1}.
    next_closing = before.closing + h * plain.velocity + plain.jump
    held = plain.phase == 0
    known = group.frictions * plain.phase
    end, _ = _response(group, held, before.pull + before.rise / 2, known)
    plain_half = next_closing - h / 2 * plain.velocity - h**2 / 8 * end
    contact = ContactState(
        half=half,
        mode=passed.mode,
        touch_speed=passed.touch_speed,
        touch_time=passed.touch_time + before.time,
        impulse=passed.impulse,
        peak_force=passed.peak_force,
        counts=passed.counts,
        fastest=passed.fastest,
    )
    contact = jax.tree.map(
        lambda a, b: jnp.where(used, a, b), contact, state._replace(half=plain_half)
    )
    zero = jnp.zeros_like(half)
    seen = ContactMotion(
        used=used & (zero == 0),
        force=passed.contact_now,
        stored_now=passed.stored_now,
        stored=passed.stored,
        lost_now=passed.lost_now,
        lost=passed.lost,
        touched=passed.touched,
        touches=passed.touches,
        first_touch=passed.first_touch,
        strongest=passed.strongest,
        farthest=passed.farthest,
        first_turn=passed.first_turn,
        last_turn=passed.last_turn,
        between=passed.between,
        highest=passed.highest,
        highest_time=passed.highest_time,
        highest_forces=passed.highest_forces,
        impacts=jax.tree.map(jnp.transpose, passed.impacts),
    )
    quiet = jax.tree.map(lambda x: jnp.where(used, x, jnp.zeros_like(x)), seen)
    now = jnp.where(used, closing_now, before.closing)
    return now, contact, motion._replace(contact=quiet)


def _response(
    group: Coupling, held: jax.Array, pull: jax.Array, known: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """Accelerations and forces where some links are held, and forces are known in the others."""
    rows = jnp.where(held[:, None], group.delassus, jnp.eye(held.size, dtype=pull.dtype))
    forces = jnp.where(held, inverse_of(rows) @ jnp.where(held, pull, known), known)
    return jnp.where(held, 0.0, pull - group.delassus @ forces), forces


def _is_undisturbed(group: Coupling, before: GroupStep) -> jax.Array:
    """Whether no slip or stick ends in the step, if nothing touches."""
    slip, h = jnp.sign(before.velocity), before.dt
    known, held = group.frictions * slip, slip == 0
    starts, first_forces = _response(group, held, before.pull - before.rise / 2, known)
    ends, last_forces = _response(group, held, before.pull + before.rise / 2, known)
    # The speed along the slip is a parabola.
    first, last, speed = slip * starts, slip * ends, jnp.abs(before.velocity)
    dips = (first < 0) & (last > 0)
    lowest = speed - h * first**2 / (2 * jnp.where(dips, last - first, 1.0))
    keeps = (speed + h * (first + last) / 2 > 0) & (~dips | (lowest > 0))
    forces = larger(jnp.abs(first_forces), jnp.abs(last_forces))
    return jnp.where(held, forces <= group.frictions, keeps).all()
