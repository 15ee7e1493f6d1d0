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

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jaxpound._extrema import larger
from jaxpound.simulation.contact import forces, records
from jaxpound.simulation.contact.flows import flow
from jaxpound.simulation.contact.forces import at_gaps, at_joints, times
from jaxpound.simulation.contact.records import APART, PRESSED, FlowInput, FlowResult, Gaps
from jaxpound.simulation.joints.friction import EventResolved, FrictionLaw, LinkMotion, LinkStep
from jaxpound.simulation.state import JointState, Moved, Now, Turns, rise_of


class Coupling(NamedTuple):
    """Constants of a group of n joints, with g gaps that have a law of contact."""

    delassus: jax.Array  # G = C M⁻¹ Cᵀ, (n, n), or (1 + G b)⁻¹ G with inerters
    frictions: jax.Array  # μ, (n,)
    resistances: tuple[Any, ...]  # what friction gains with the velocity, by joint, or None
    sizes: jax.Array  # ξ0, (g,)
    laws: tuple[Any, ...]  # of contact for the effective masses, by gap

    @property
    def has_resistance(self) -> bool:
        """Whether a joint has friction that grows with the velocity, which needs every flow."""
        return any(law is not None for law in self.resistances)

    def response(
        self, held: jax.Array, pull: jax.Array, prescribed: jax.Array
    ) -> tuple[jax.Array, jax.Array]:
        """Accelerations A − G q and forces q, held joints at rest; others have ``prescribed`` q."""
        inverse = forces.held_inverse(self.delassus, held)
        return forces.response(self.delassus, inverse, held, pull, prescribed)

    def gained(self, held: jax.Array, pull: jax.Array) -> jax.Array:
        """Accelerations of joints under a pull alone, where some are held."""
        return self.response(held, pull, 0 * pull)[0]


class Flow(NamedTuple):
    """Joints after their local flow, (n,) each."""

    pull: jax.Array  # A during the flow
    result: FlowResult
    used: jax.Array  # whether the joints move by the flow, not in closed form
    mean: jax.Array  # mean sample that the rods take, less the predicted closing at t_m
    now: jax.Array  # true closing at t_m less the predicted one


def motion_without_flow(
    group: Coupling, before: JointState, pull: jax.Array, now: Now, law: FrictionLaw, h: float
) -> LinkMotion:
    """Motion of joints, (n,), over a step without flow; a joint alone has the friction ``law``."""
    rise = rise_of(before, pull, now)
    # Half a step is a whole one with half the pull and half the mobility.
    pull, group = now.kick * pull, group._replace(delassus=now.kick * group.delassus)
    if before.closing.size > 1:
        return _motion_without_events(group, before.velocity, pull, rise, h)
    motion = law.slide(
        LinkStep(
            before.velocity[0],
            before.phase[0],
            pull[0],
            rise[0],
            group.delassus[0, 0],
            group.frictions[0],
            h,
        )
    )
    return jax.tree.map(lambda y: y[None], motion)


def _motion_without_events(
    group: Coupling, velocity: jax.Array, pull: jax.Array, rise: jax.Array, h: float
) -> LinkMotion:
    """Motion of joints that share masses, (n,), over a step in which no slip or stick ends.

    Joints without friction may reverse at any time: they have the closed form of a joint alone.
    """
    slip = jnp.sign(jax.lax.stop_gradient(velocity))
    has_friction, inverse_mass = group.frictions > 0, jnp.diagonal(group.delassus)
    friction, held = group.frictions * slip, (slip == 0) & has_friction
    gain, _ = group.response(held, pull, friction)
    bend = group.gained(held, rise)
    others = gain + inverse_mass * friction
    alone = EventResolved().slide(
        LinkStep(velocity, slip, others, bend, inverse_mass, group.frictions, h)
    )

    def shared(free_change: jax.Array) -> jax.Array:
        """Changes of all closings as joints without friction change theirs by their own force."""
        change = jnp.where(has_friction, 0.0, free_change)
        return group.response(held, 0 * change, -change / inverse_mass)[0]

    # What follows is zero where there is no friction, but not its derivative by the friction.
    impulse = (others - (alone.velocity - velocity) / h) / inverse_mass
    gain, force = group.response(held, pull, jnp.where(has_friction, friction, impulse))
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
    group: Coupling, gaps: Gaps, before: JointState, pull: jax.Array, now: Now, h: float
) -> jax.Array:
    """Whether a group needs the local flow in a step."""
    rise = rise_of(before, pull, now)
    # How far each gap can close in the step at most.
    pushed = times(jnp.abs(group.delassus), group.frictions)
    needed = jnp.asarray(group.has_resistance)
    if gaps:
        speed, most = at_gaps(gaps, before.velocity), at_gaps(gaps, pull)
        pushed_gaps = jnp.stack([pushed[joint] for joint, _ in gaps])
        # A single joint's friction opposes its slip: it adds to a closing only while that shrinks.
        if pushed.size == 1:
            pushed_gaps = jnp.where(speed < 0, pushed_gaps, 0.0)
        bend = jnp.abs(at_gaps(gaps, rise)) / 2
        most = larger(most + bend + pushed_gaps, 0.0)
        reach = at_gaps(gaps, before.half) + h * larger(speed, 0.0) + h**2 / 2 * most
        needed |= ((before.contact.mode != APART) | (reach >= group.sizes)).any()
    if pushed.size > 1:
        needed |= ~_is_undisturbed(group, before.velocity, pull, rise, h)
    return needed


def run_flow(
    group: Coupling,
    gaps: Gaps,
    before: JointState,
    pull: jax.Array,
    now: Now,
    h: float,
    slots: int,
) -> tuple[FlowResult, jax.Array]:
    """The local flow of a group where it is needed, and whether the group moves by it."""
    needed = is_flow_needed(group, gaps, before, pull, now, h)
    inputs = FlowInput(
        before.half, before.velocity, pull, rise_of(before, pull, now), *group, before.contact
    )
    begin = jnp.where(now.is_first, h / 2, 0.0).astype(before.velocity.dtype)
    clock = records.Clock(now.time, begin, now.is_last)
    result = flow(h, slots, gaps, needed, inputs, clock)
    # A single joint that did not touch keeps its closed form.
    is_shared = before.closing.size > 1 or group.has_resistance
    if not is_shared:
        needed = needed & ~(result.log.touched == 0).all()  # true for NaN
    return result, needed


def samples(
    result: FlowResult, used: jax.Array, before: JointState, now: Now, h: float
) -> tuple[jax.Array, jax.Array]:
    """The mean sample, and the closing at t_m, each less the closing as predicted."""
    mean = result.mean - h / 24 * (result.velocity - before.velocity)
    # The first sample of a run is exact.
    shift = jnp.where(used & ~now.is_first, mean - before.closing, 0.0)
    return shift, jnp.where(used, result.now.closing - before.closing, 0.0)


def after_flow(
    group: Coupling,
    gaps: Gaps,
    before: JointState,
    flow: Flow,
    without: Moved,
    pull: jax.Array,
    h: float,
) -> Moved:
    """Joints after a step with a flow, where they move by it, or ``without`` it.

    The pull after the mean samples exceeds that of the flow by a change, whose effect is added.
    """
    result, at, log, change = flow.result, flow.result.now, flow.result.log, pull - flow.pull
    gain, gain_now = (group.gained(held > 0, change) for held in (result.held, at.held))
    # No position correction while a contact force acts: the force would respond to it.
    pressed = at_joints(gaps, result.contact.mode == PRESSED, before.closing.size)
    pressed_now = at_joints(gaps, at.contact_force != 0, before.closing.size)
    half = result.closing + jnp.where(pressed, 0.0, h**2 / 2 * gain)
    closing_now = at.closing + jnp.where(pressed_now, 0.0, h**2 / 8 * gain_now)
    velocity, turned = result.velocity + h * gain, log.turns > 0
    closing = half + h / 2 * velocity + h**2 / 8 * (result.acceleration + gain)
    phase = jnp.where(result.held > 0, 0.0, jnp.sign(velocity))
    farthest, nearest = (jnp.where(turned, y, closing_now) for y in (log.farthest, log.nearest))
    motion = LinkMotion(
        velocity=velocity,
        force=at.friction,
        velocity_now=at.velocity + h / 2 * gain_now,
        jump=closing - before.closing - h * velocity,
        turns=turned,
        turn_time=log.farthest_time,
        turn=farthest - closing_now,
        turn_forces=(at.friction, at.friction),
        phase=phase,
        change_time=log.change_time,
    )
    turns = Turns(
        turned,
        log.first_turn,
        log.last_turn,
        log.between,
        farthest,
        log.farthest_time,
        nearest,
        log.nearest_time,
    )
    state = JointState(closing, velocity, phase, pull, half, result.contact)
    moved = Moved(closing_now, state, motion, turns)
    return jax.tree.map(lambda a, b: jnp.where(flow.used, a, b), moved, without)


def after_none(
    group: Coupling, before: JointState, pull: jax.Array, motion: LinkMotion, now: Now, h: float
) -> Moved:
    """Joints after a step without flow."""
    closing = before.closing + h * motion.velocity + motion.jump
    held = (motion.phase == 0) & (group.frictions > 0)
    rise = rise_of(before, pull, now)
    gain, _ = group.response(held, pull + rise / 2, group.frictions * motion.phase)
    # From the closings at t_{m+1} those at the end of the kick.
    half = closing - h / 2 * motion.velocity - h**2 / 8 * gain
    state = JointState(closing, motion.velocity, motion.phase, pull, half, before.contact)
    return Moved.by(motion, before.closing, state)


def _is_undisturbed(
    group: Coupling, velocity: jax.Array, pull: jax.Array, rise: jax.Array, h: float
) -> jax.Array:
    """Whether no slip or stick ends in a step without contact."""
    slip, frictions = jnp.sign(velocity), group.frictions
    has_friction = frictions > 0
    friction, held = frictions * slip, (slip == 0) & has_friction
    first, first_forces = group.response(held, pull - rise / 2, friction)
    last, last_forces = group.response(held, pull + rise / 2, friction)
    # The speed along the slip is a parabola.
    first, last, speed = slip * first, slip * last, jnp.abs(velocity)
    dips = (first < 0) & (last > 0)
    lowest = speed - h * first**2 / (2 * jnp.where(dips, last - first, 1.0))
    keeps = (speed + h * (first + last) / 2 > 0) & (~dips | (lowest > 0))
    needed = larger(jnp.abs(first_forces), jnp.abs(last_forces))
    return jnp.where(held, needed <= frictions, keeps | ~has_friction).all()
