r"""A group of joints, which may touch or share masses, over one step of a run.

A group moves by s'' = A − G (q + p). It runs the local flow (``flows``) in the steps that need it:
in contact, where a gap may close, and, for joints that share masses, where slip or stick ends. All
other steps have closed forms.

An impact is a kink of the path. If the rods took the displacement at an instant of the grid, where
in the step the kink falls would leave a ragged error of order h² in the path that they see, and of
order h in gradients. So after a step with a flow the rods take the mean sample instead,

    mean of s over the step − (h/24) (change of s' over the step),

which is s in its middle to order h⁴ where motion is smooth, and by which their memory integrates a
kinked path as well as a smooth one. The effect of the pull's change by it is then added to the end
of the step.
"""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jaxpound._extrema import larger
from jaxpound._xla.derivatives import kept
from jaxpound.simulation.contact import forces
from jaxpound.simulation.contact.flows import flow
from jaxpound.simulation.contact.records import (
    APART,
    PRESSED,
    Clock,
    Coupling,
    FlowInput,
    FlowResult,
    times,
)
from jaxpound.simulation.joints.friction import EventResolved, FrictionLaw
from jaxpound.simulation.joints.motion import LinkMotion, LinkStep
from jaxpound.simulation.state import JointState, Moved, Now, rise_of


def response(
    group: Coupling, held: jax.Array, pull: jax.Array, prescribed: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """Accelerations A − G q and forces q, held joints at rest; others have ``prescribed`` q."""
    inverse = forces.held_inverse(group.delassus, held)
    return forces.response(group.delassus, inverse, held, pull, prescribed)


class Deviation(NamedTuple):
    """By how much joints, (n,) each, exceed smooth motion under the pull alone in a flow."""

    velocity: jax.Array  # in the mean over the step
    closing: jax.Array  # in the mean over the step
    end: jax.Array  # the velocity at its end


class Flow(NamedTuple):
    """Joints after their local flow, (n,) each."""

    pull: jax.Array  # A during the flow
    result: FlowResult
    used: jax.Array  # whether the joints move by the flow, not in closed form
    mean: jax.Array  # mean sample that the rods take, less the predicted closing at t_m
    now: jax.Array  # true closing at t_m less the predicted one


def without_flow(
    group: Coupling, before: JointState, pull: jax.Array, now: Now, law: FrictionLaw, h: float
) -> Moved:
    """Joints, (n,), after a step without flow; a joint alone has the friction ``law``."""
    rise = rise_of(before, pull, now)
    # Half a step is a whole one with half the pull and half the mobility.
    pushed, mobility = now.kick * pull, now.kick * group.delassus
    if before.closing.size > 1:
        kicked = dataclasses.replace(group, delassus=mobility)
        motion = _motion_without_events(kicked, before.velocity, pushed, rise, h)
    else:
        mobility = mobility.reshape(before.closing.shape)
        link = before.velocity, before.phase, pushed, rise, mobility, group.frictions, h
        motion = law.slide(LinkStep(*link))
    moved = Moved.by(motion, before, pull, h)
    if not group.may_need_flow:
        return moved
    # From the closings at t_{m+1} those at the end of the kick.
    held = (motion.phase == 0) & (group.frictions > 0)
    gain, _ = response(group, held, pull + rise / 2, group.frictions * motion.phase)
    half = moved.state.closing - h / 2 * motion.velocity - h**2 / 8 * gain
    return moved._replace(state=moved.state._replace(half=half))


def _motion_without_events(
    group: Coupling, velocity: jax.Array, pull: jax.Array, rise: jax.Array, h: float
) -> LinkMotion:
    """Motion of joints that share masses, (n,), over a step in which no slip or stick ends.

    Joints without friction may reverse at any time: they have the closed form of a joint alone.
    """
    slip = jnp.sign(jax.lax.stop_gradient(velocity))
    has_friction, inverse_mass = group.frictions > 0, jnp.diagonal(group.delassus)
    friction, held = group.frictions * slip, (slip == 0) & has_friction
    gain, _ = response(group, held, pull, friction)
    bend, _ = response(group, held, rise, 0 * rise)
    others = gain + inverse_mass * friction
    alone = EventResolved().slide(
        LinkStep(velocity, slip, others, bend, inverse_mass, group.frictions, h)
    )

    def shared(free_change: jax.Array) -> jax.Array:
        """Changes of all closings as joints without friction change theirs by their own force."""
        change = jnp.where(has_friction, 0.0, free_change)
        return response(group, held, 0 * change, -change / inverse_mass)[0]

    # What follows is zero where there is no friction, but not its derivative by the friction.
    impulse = (others - (alone.velocity - velocity) / h) / inverse_mass
    gain, force = response(group, held, pull, jnp.where(has_friction, friction, impulse))
    velocity_now = velocity + h / 2 * (gain - bend / 4)
    zero = jnp.zeros_like(velocity)
    moved: dict[str, Any] = {
        "velocity": velocity + h * gain,
        "velocity_now": velocity_now + shared(alone.velocity_now - velocity_now),
        "jump": shared(alone.jump),
    }
    motion = LinkMotion(
        **moved,
        force=force,
        turns=slip > 1,
        turn_time=zero,
        turn=zero,
        turn_forces=(force, force),
        phase=slip,
        change_time=zero,
    )
    return jax.tree.map(lambda x, y: jnp.where(has_friction, x, y), motion, alone._replace(**moved))


def is_flow_needed(
    group: Coupling, before: JointState, pull: jax.Array, *, now: Now, h: float
) -> jax.Array:
    """Whether a group needs the local flow in a step."""
    rise = rise_of(before, pull, now)
    needed = jnp.asarray(group.has_resistance)
    if group.gaps:  # how far each can close in the step at most
        pushed = jnp.abs(group.seen(times(jnp.abs(group.delassus), group.frictions)))
        speed, most = group.seen(before.velocity), group.seen(pull)
        # A single joint's friction opposes its slip: it adds to a closing only while that shrinks.
        if pull.size == 1:
            pushed = jnp.where(speed < 0, pushed, 0.0)
        bend = jnp.abs(group.seen(rise)) / 2
        most = larger(most + bend + pushed, 0.0)
        reach = group.seen(before.half) + h * larger(speed, 0.0) + h**2 / 2 * most
        needed |= ((before.contact.mode != APART) | (reach >= group.sizes)).any()
    if pull.size > 1:
        needed |= ~_is_undisturbed(group, before.velocity, pull, rise, h)
    return needed


def followed(
    group: Coupling,
    in_step: Coupling,
    before: JointState,
    pull: jax.Array,
    *,
    now: Now,
    h: float,
    slots: int,
) -> Flow:
    """A group after its local flow, which is run where it is needed, as it is ``in_step``."""
    used = is_flow_needed(in_step, before, pull, now=now, h=h)
    rise = rise_of(before, pull, now)
    inputs = FlowInput(before.half, before.velocity, pull, rise, group, before.contact)
    begin = jnp.where(now.is_first, h / 2, 0.0).astype(before.velocity.dtype)
    result = flow(h, slots, used, inputs, Clock(now.time, begin, now.is_last))
    # A single joint that did not touch keeps its closed form.
    if pull.size == 1 and not group.has_resistance:
        used = used & ~(result.gaps.log.touched == 0).all()  # true for NaN
    result, used = kept((result, used))
    mean = result.mean - h / 24 * (result.velocity - before.velocity)
    # The first sample of a run is exact.
    shift = jnp.where(used & ~now.is_first, mean - before.closing, 0.0)
    return Flow(
        pull, result, used, shift, jnp.where(used, result.now.closing - before.closing, 0.0)
    )


def after_flow(
    group: Coupling, before: JointState, flow: Flow, without: Moved, pull: jax.Array, h: float
) -> Moved:
    """Joints after a step with a flow, where they move by it, or ``without`` it.

    The pull after the mean samples exceeds that of the flow by a change, whose effect is added.
    """
    result, change = flow.result, pull - flow.pull
    at, turns = result.now, result.turns
    gain, gain_now = (
        response(group, held > 0, change, 0 * change)[0] for held in (result.held, at.held)
    )
    # No position correction while a contact force acts: the force would respond to it.
    pressed = group.joints_where(result.contact.mode == PRESSED)
    pressed_now = group.joints_where(result.gaps.force != 0)
    half = result.closing + jnp.where(pressed, 0.0, h**2 / 2 * gain)
    now = at.closing + jnp.where(pressed_now, 0.0, h**2 / 8 * gain_now)
    velocity, turned = result.velocity + h * gain, turns.exist > 0
    closing = half + h / 2 * velocity + h**2 / 8 * (result.acceleration + gain)
    phase = jnp.where(result.held > 0, 0.0, jnp.sign(velocity))
    farthest, nearest = (jnp.where(turned, y, now) for y in (turns.farthest, turns.nearest))
    moved = Moved(
        now=now,
        velocity_now=at.velocity + h / 2 * gain_now,
        force=at.friction,
        turns=turns._replace(exist=turned, farthest=farthest, nearest=nearest),
        turn_forces=(at.friction, at.friction),
        change_time=result.change_time,
        state=JointState(closing, velocity, phase, pull, half, result.contact),
    )
    return jax.tree.map(lambda a, b: jnp.where(flow.used, a, b), moved, without)


def deviation(before: JointState, flow: Flow, *, now: Now, h: float) -> Deviation:
    """How joints, (n,), have deviated from smooth motion in a flow."""
    s, w, pull, rise = before.half, before.velocity, flow.pull, rise_of(before, flow.pull, now)
    parts = Deviation(
        (flow.result.closing - s) / h - w - h / 2 * pull + h / 12 * rise,
        flow.result.mean - s - h / 2 * w - h**2 / 6 * pull + h**2 / 24 * rise,
        flow.result.velocity - w - h * pull,
    )
    return jax.tree.map(lambda y: jnp.where(flow.used & ~now.is_first, y, 0.0), parts)


def dragged(
    group: Coupling,
    flow: Flow,
    moved: Moved,
    pull: jax.Array,
    mean: jax.Array,
    position: jax.Array,
    end: jax.Array,
    *,
    h: float,
) -> Moved:
    """Joints after a flow that dashpots drag, by accelerations and a change of position.

    The ``mean`` acceleration is in the pull by which they have moved; ``pull`` is that of the next
    step's beginning.
    """
    held = flow.result.held > 0
    gains = [response(group, held, y, 0 * y)[0] for y in (mean, position, end)]
    pressed = group.joints_where(flow.result.contact.mode == PRESSED)
    half = gains[1] + jnp.where(pressed, h**2 / 2 * gains[0], 0.0)
    half = jnp.where(flow.used, half, 0.0)
    later = jnp.where(flow.used, h**2 / 8 * (gains[2] - gains[0]), 0.0)
    state = moved.state._replace(
        closing=moved.state.closing + half + later,
        half=moved.state.half + half,
        pull=jnp.where(flow.used, pull, moved.state.pull),
    )
    return moved._replace(state=state)


def _is_undisturbed(
    group: Coupling, velocity: jax.Array, pull: jax.Array, rise: jax.Array, h: float
) -> jax.Array:
    """Whether no slip or stick ends in a step without contact."""
    slip, frictions = jnp.sign(velocity), group.frictions
    has_friction = frictions > 0
    friction, held = frictions * slip, (slip == 0) & has_friction
    first, first_forces = response(group, held, pull - rise / 2, friction)
    last, last_forces = response(group, held, pull + rise / 2, friction)
    # The speed along the slip is a parabola.
    first, last, speed = slip * first, slip * last, jnp.abs(velocity)
    dips = (first < 0) & (last > 0)
    lowest = speed - h * first**2 / (2 * jnp.where(dips, last - first, 1.0))
    keeps = (speed + h * (first + last) / 2 > 0) & (~dips | (lowest > 0))
    needed = larger(jnp.abs(first_forces), jnp.abs(last_forces))
    return jnp.where(held, needed <= frictions, keeps | ~has_friction).all()
