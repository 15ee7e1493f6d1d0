r"""Links that may touch or that share masses, over one step of a run.

A group of such links runs the local flow (``flows``) where it needs it: in contact, where a
gap may close within the step, and, for links that share masses, where slip or stick ends. All other
steps have closed forms.

An impact is a kink of the path. If the rods took the position at an instant of the grid, where in
the step the kink falls would leave a ragged error of order h² in the path that they see, and of
order h in gradients. So after a step with a flow the rods take the mean sample instead,

    mean of s over the step − (h/24) (change of s' over the step),

which is s in its middle to order h⁴ where motion is smooth, and by which their memory integrates a
kinked path as well as a smooth one. The change of the rods' pull by it is then added to the end of
the step.
"""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound._extrema import larger
from jaxpound.model.contact import with_mass
from jaxpound.model.system import Link, System
from jaxpound.model.topology import LinkGroup, Topology, link_groups
from jaxpound.simulation.contact import forces, records
from jaxpound.simulation.contact.flows import flow
from jaxpound.simulation.contact.forces import times
from jaxpound.simulation.contact.records import (
    APART,
    GAPS_LOG,
    PRESSED,
    Contact,
    FlowInput,
    FlowResult,
    Gaps,
    MidStep,
)
from jaxpound.simulation.friction import EventResolved, FrictionLaw, LinkMotion, LinkStep
from jaxpound.simulation.inertance import Inerters

_REVERSED = "velocity", "velocity_now", "jump", "turn", "phase"  # for a link's other face


class Coupling(NamedTuple):
    """Constants of a group of n links and f faces (``forces``) that may need the local flow."""

    delassus: jax.Array  # G (n, n): relative accelerations of ends under unit forces in the links
    frictions: jax.Array  # (f,)
    gaps: jax.Array
    laws: tuple[Any, ...]  # of contact, for the effective masses, by face
    resistances: tuple[Any, ...]  # by link

    @property
    def has_resistance(self) -> bool:
        """Whether a link has friction that grows with the velocity, which needs every flow."""
        return any(law is not None for law in self.resistances)

    @property
    def with_law(self) -> list[int]:
        """Faces with a law of contact: the gaps of a flow."""
        return [j for j, law in enumerate(self.laws) if law is not None]

    def sides(self, faces: tuple[int, ...]) -> Gaps:
        """The gaps of a flow by joint and side; those on side −1 are other faces of links."""
        n = len(self.resistances)
        return tuple((j, 1) if j < n else (faces[j - n], -1) for j in self.with_law)

    def by_gap(self, y: jax.Array) -> jax.Array:
        """The values of the faces with a law."""
        return y if len(self.with_law) == y.size else y[np.array(self.with_law, int)]

    def flow_input(self, motion: tuple[jax.Array, ...], contact: Contact) -> FlowInput:
        """The input of a flow from closings, velocities, pulls and their rise, by face.

        ``contact`` is that of the gaps.
        """
        n = len(self.resistances)
        closing, velocity, pull, rise, friction = (y[:n] for y in (*motion, self.frictions))
        return FlowInput(
            closing=closing,
            velocity=velocity,
            pull=pull,
            rise=rise,
            delassus=self.delassus,
            friction=friction,
            resistances=self.resistances,
            sizes=self.by_gap(self.gaps),
            laws=tuple(self.laws[j] for j in self.with_law),
            contact=contact,
        )

    def by_face(self, result: FlowResult, faces: tuple[int, ...]) -> FlowResult:
        """The result of a flow as faces see it; zeros of contact for those without a law."""
        n, number = len(self.resistances), {j: gap for gap, j in enumerate(self.with_law)}
        if not faces and len(number) == n:
            return result
        both = [*range(n), *faces]

        def seen(y: jax.Array) -> jax.Array:
            return seen_by_faces(y, faces)

        def same(y: jax.Array) -> jax.Array:
            return jnp.stack([y[k] for k in both])

        def spread(y: jax.Array) -> jax.Array:
            none = jnp.broadcast_to(0 * result.closing[0], y.shape[1:])
            return jnp.stack([y[number[j]] if j in number else none for j in range(len(both))])

        def of_turn(farthest: jax.Array, nearest: jax.Array) -> jax.Array:
            return jnp.stack([*farthest, *(nearest[k] for k in faces)])

        log, now = result.log, result.now
        turned = {name: seen(getattr(log, name)) for name in ("first_turn", "last_turn")}
        turned |= {name: same(getattr(log, name)) for name in ("turns", "between", "change_time")}
        touched = {name: spread(getattr(log, name)) for name in GAPS_LOG}
        highest_forces = jnp.pad(spread(log.highest_forces), ((0, 0), (0, len(faces))))
        log = log._replace(
            **turned,
            **touched,
            impacts=jax.tree.map(spread, log.impacts),
            farthest=of_turn(log.farthest, -log.nearest),
            farthest_time=of_turn(log.farthest_time, log.nearest_time),
            nearest=of_turn(log.nearest, -log.farthest),
            nearest_time=of_turn(log.nearest_time, log.farthest_time),
            highest_forces=highest_forces,
        )
        now = MidStep(
            closing=seen(now.closing),
            velocity=seen(now.velocity),
            friction=_of_links_alone(now.friction, faces),
            held=same(now.held),
            contact_force=spread(now.contact_force),
            stored=spread(now.stored),
            lost=spread(now.lost),
        )
        return FlowResult(
            closing=seen(result.closing),
            velocity=seen(result.velocity),
            acceleration=seen(result.acceleration),
            held=same(result.held),
            mean=seen(result.mean),
            contact=jax.tree.map(spread, result.contact),
            stored=spread(result.stored),
            lost=spread(result.lost),
            now=now,
            log=log,
        )

    def response(
        self, held: jax.Array, pull: jax.Array, prescribed: jax.Array
    ) -> tuple[jax.Array, jax.Array]:
        """Accelerations and forces where some links are held; ``prescribed`` act in the others."""
        inverse = forces.held_inverse(self.delassus, held)
        return forces.response(self.delassus, inverse, held, pull, prescribed)

    def gained(self, faces: tuple[int, ...], held: jax.Array, pull: jax.Array) -> jax.Array:
        """Accelerations, as the faces see them, of links under a pull, where some are held."""
        n = len(self.resistances)
        gain, _ = self.response(held[:n], pull[:n], 0 * pull[:n])
        return seen_by_faces(gain, faces)


class ContactState(NamedTuple):
    """State of a face in a group that may need the local flow, besides that of any link."""

    closing_before: jax.Array  # closing at t_m − h/2
    contact: Contact


class ContactMotion(NamedTuple):
    """Motion of such a link in a step from t_m − h/2 to t_m + h/2."""

    used: jax.Array  # whether the local flow was needed
    result: FlowResult  # zero if it was not, but for the turns of a link that did not touch


class MovedLink(NamedTuple):
    """A link, or the links of a group, after a step."""

    closing: jax.Array  # at t_m
    contact: ContactState | None  # after the step
    motion: LinkMotion  # in the step


def needs_flow(group: LinkGroup, links: tuple[Link, ...]) -> bool:
    """Whether a group's steps may need the local flow."""
    of_group = [links[k] for k in group.links]
    return len(group.hanging) > 1 or any(x.contact or x.velocity_friction for x in of_group)


def may_flow(system: System) -> bool:
    """Whether steps of a system may need the local flow."""
    return any(needs_flow(group, system.links) for group in link_groups(system.topology))


def coupling(
    topology: Topology,
    group: LinkGroup,
    links: tuple[Link, ...],
    inverse: tuple[jax.Array, ...],
    inerters: Inerters | None,
) -> tuple[Coupling, dict[int, jax.Array]]:
    """The constants of a group, and how its masses share changes of closings.

    These are, by mass, its shift by each closing, the centre of mass fixed; 0 for other faces.
    ``inverse`` are the inverse masses.
    """
    n, of_group = len(group.hanging), [links[k] for k in group.links]
    link_of_face = (*range(n), *group.faces)
    ends = [topology.links[k] for k in group.links[:n]]
    signs = {
        mass: jnp.asarray([(mass == i) - (mass == j) for i, j in ends], inverse[0].dtype)
        for mass in group.masses
    }
    weighed = [inverse[mass] * jnp.outer(sign, sign) for mass, sign in signs.items()]
    delassus = sum(weighed[1:], weighed[0])
    whole = forces.inverse_of(delassus)
    shares = {mass: inverse[mass] * (sign @ whole) for mass, sign in signs.items()}
    if inerters is not None:  # whose impulses do not change the shares
        delassus = inerters.delassus[np.ix_(group.links[:n], group.links[:n])]
    constants = Coupling(
        delassus=delassus,
        frictions=jnp.stack([of_group[k].friction for k in link_of_face]),
        gaps=jnp.stack([link.gap for link in of_group]),
        laws=tuple(
            None if link.contact is None else with_mass(link.contact, 1 / delassus[k, k])
            for link, k in zip(of_group, link_of_face, strict=True)
        ),
        resistances=tuple(link.velocity_friction for link in of_group[:n]),
    )
    return constants, {mass: _of_links_alone(share, group.faces) for mass, share in shares.items()}


def seen_by_faces(values: jax.Array, faces: tuple[int, ...]) -> jax.Array:
    """Values of links, (n, ...), as their faces see them, (f, ...): the other ones in reverse."""
    return jnp.stack([*values, *(-values[k] for k in faces)]) if faces else values


def of_either_face(holds: jax.Array, faces: tuple[int, ...]) -> jax.Array:
    """Faces, (f,), of links in which something holds for a face."""
    by_face = [*holds]
    for i, k in enumerate(faces, len(by_face) - len(faces)):
        by_face[k] = by_face[i] = holds[k] | holds[i]
    return jnp.stack(by_face) if faces else holds


def _of_links_alone(values: jax.Array, faces: tuple[int, ...]) -> jax.Array:
    """Values of links, (n,), with zeros for their other faces, (f,)."""
    return jnp.pad(values, (0, len(faces))) if faces else values


def with_other_faces(motion: LinkMotion, faces: tuple[int, ...]) -> LinkMotion:
    """The motion of links, (n,) each, as their faces see it, (f,); the force is of the link."""
    if not faces:
        return motion
    seen: Any = {name: seen_by_faces(getattr(motion, name), faces) for name in _REVERSED}
    forces: Any = {name: getattr(motion, name) for name in ("mean_force", "force", "turn_forces")}
    times: Any = {name: getattr(motion, name) for name in ("turns", "turn_time", "change_time")}
    forces = jax.tree.map(lambda y: _of_links_alone(y, faces), forces)
    times = jax.tree.map(lambda y: jnp.stack([*y, *(y[k] for k in faces)]), times)
    return LinkMotion(**seen, **forces, **times)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class GroupStep:
    """Inputs of a group for a step from t_m − h/2 to t_m + h/2; (f,) for f faces."""

    closing: jax.Array  # at t_m, as predicted
    velocity: jax.Array  # at t_m − h/2
    phase: jax.Array  # direction of slip then, 0 in stick
    state: ContactState
    pull: jax.Array  # A_m
    rise: jax.Array  # A_m − A_{m−1}
    time: jax.Array
    is_first: jax.Array  # whether t_m = 0
    is_last: jax.Array  # whether the run ends at t_m
    at_rest: bool = dataclasses.field(metadata={"static": True})  # whether the run starts at rest
    dt: float = dataclasses.field(metadata={"static": True})  # h
    slots: int = dataclasses.field(metadata={"static": True})  # impacts of a face to be recorded
    faces: tuple[int, ...] = dataclasses.field(metadata={"static": True})  # of ``LinkGroup``
    on_ground: bool = dataclasses.field(metadata={"static": True})  # its masses slide there

    @property
    def of_links(self) -> GroupStep:
        """The same of the links alone, (n,)."""
        n = self.closing.size - len(self.faces)
        return jax.tree.map(lambda y: y[:n] if y.ndim else y, self) if self.faces else self


def motion_without_flow(group: Coupling, before: GroupStep, law: FrictionLaw) -> LinkMotion:
    """Motion of links, (n,), over a step without flow; ``law`` is that of a link without others."""
    if len(group.resistances) > 1:
        return _motion_without_events(group, before)
    velocity, phase = before.velocity[0], before.phase[0]
    of_link = velocity, phase, before.pull[0], before.rise[0], group.delassus[0, 0]
    motion = law.slide(LinkStep(*of_link, group.frictions[0], before.dt))
    return jax.tree.map(lambda y: y[None], motion)


def _motion_without_events(group: Coupling, before: GroupStep) -> LinkMotion:
    """Motion of links that share masses, (n,), over a step in which no slip or stick ends.

    Links without friction may reverse at any time: they have the closed form of a link alone.
    """
    before = before.of_links
    group = group._replace(frictions=group.frictions[: before.closing.size])
    slip = jnp.sign(jax.lax.stop_gradient(before.velocity))
    has_friction, inverse_mass = group.frictions > 0, jnp.diagonal(group.delassus)
    friction, held = group.frictions * slip, (slip == 0) & has_friction
    gain, _ = group.response(held, before.pull, friction)
    bend, _ = group.response(held, before.rise, 0 * friction)
    others = gain + inverse_mass * friction
    step = LinkStep(before.velocity, slip, others, bend, inverse_mass, group.frictions, before.dt)
    alone = EventResolved().slide(step)

    def shared(free_change: jax.Array) -> jax.Array:
        """Changes of all closings as links without friction change theirs by their own force."""
        change = jnp.where(has_friction, 0.0, free_change)
        return group.response(held, 0 * change, -change / inverse_mass)[0]

    # What follows is zero where there is no friction, but not its derivative by the friction.
    friction = jnp.where(has_friction, friction, alone.mean_force)
    gain, force = group.response(held, before.pull, friction)
    velocity_now = before.velocity + before.dt / 2 * (gain - bend / 4)
    zero = jnp.zeros_like(before.velocity)
    moved: dict[str, Any] = {
        "velocity": before.velocity + before.dt * gain,
        "velocity_now": velocity_now + shared(alone.velocity_now - velocity_now),
        "jump": shared(alone.jump),
    }
    motion = LinkMotion(
        **moved,
        mean_force=force,
        force=force,
        turns=slip > 1,
        turn_time=zero,
        turn=zero,
        turn_forces=(force, force),
        phase=slip,
        change_time=zero,
    )
    return jax.tree.map(lambda x, y: jnp.where(has_friction, x, y), motion, alone._replace(**moved))


def is_flow_needed(group: Coupling, before: GroupStep) -> jax.Array:
    """Whether a group needs the local flow in a step."""
    state, h = before.state, before.dt
    # How far each link can close in the step at most.
    n = len(group.resistances)
    pushed = times(jnp.abs(group.delassus), group.frictions[:n])
    pushed = jnp.abs(seen_by_faces(pushed, before.faces))
    # A single link's friction opposes its slip: it adds to the closing only while the link opens.
    if n == 1:
        pushed = jnp.where(before.velocity < 0, pushed, 0.0)
    most = larger(before.pull + jnp.abs(before.rise) / 2 + pushed, 0.0)
    reach = state.closing_before + h * larger(before.velocity, 0.0) + h**2 / 2 * most
    meets = jnp.asarray([law is not None for law in group.laws])
    needed = (meets & ((state.contact.mode != APART) | (reach >= group.gaps))).any()
    if n > 1:
        needed = needed | ~_is_undisturbed(group, before)
    return needed | group.has_resistance


def run_flow(group: Coupling, before: GroupStep) -> tuple[FlowResult, jax.Array]:
    """The local flow of a group where it is needed, and whether its result is used."""
    state, h, needed = before.state, before.dt, is_flow_needed(group, before)
    motion = state.closing_before, before.velocity, before.pull, before.rise
    inputs = group.flow_input(motion, jax.tree.map(group.by_gap, state.contact))
    begin = jnp.where(before.is_first & before.at_rest, h / 2, 0.0).astype(before.velocity.dtype)
    clock = records.Clock(before.time, begin, before.is_last)
    result = flow(h, before.slots, group.sides(before.faces), needed, inputs, clock)
    result = group.by_face(result, before.faces)
    # A single link that did not touch keeps its closed form.
    touched = ~(result.log.touched == 0).all()  # true for NaN
    is_shared = len(group.resistances) > 1 or group.has_resistance
    used = needed if is_shared else needed & touched
    return result, used


def mean_sample_shift(
    _: Coupling, result: FlowResult, used: jax.Array, before: GroupStep
) -> jax.Array:
    """Shifts of the closings at t_m to those that the rods take after a step with a flow."""
    kink = result.velocity - before.velocity
    # The first sample of a run is exact.
    mean = jnp.where(before.is_first, before.closing, result.mean - before.dt / 24 * kink)
    return jnp.where(used, mean - before.closing, 0.0)


def finish_step(
    group: Coupling,
    before: GroupStep,
    motion_without_flow: LinkMotion,
    result: FlowResult,
    used: jax.Array,
    pull_change: jax.Array,
) -> MovedLink:
    """The end of a step: the closings at t_m, the state after it, and the motion in it.

    ``before`` has the pull after the mean samples, which changed it by ``pull_change``.
    """
    h, at, log = before.dt, result.now, result.log
    n, faces = len(group.resistances), before.faces
    gain = group.gained(faces, result.held > 0, pull_change)
    # No position correction while a contact force acts: the force would respond to it.
    pressed = of_either_face(result.contact.mode == PRESSED, faces)
    shift = jnp.where(pressed, 0.0, h**2 / 2 * gain)
    velocity, closing_after = result.velocity + h * gain, result.closing + shift
    after = closing_after + h / 2 * velocity + h**2 / 8 * (result.acceleration + gain)
    gain_now = group.gained(faces, at.held > 0, pull_change)
    pressed_now = of_either_face(at.contact_force != 0, faces)
    shift_now = jnp.where(pressed_now, 0.0, h**2 / 8 * gain_now)
    closing_now = at.closing + shift_now
    kick = before.pull - (velocity - before.velocity) / h
    motion_of_flow = LinkMotion(
        velocity=velocity,
        mean_force=_of_links_alone(times(forces.inverse_of(group.delassus), kick[:n]), faces),
        force=at.friction,
        velocity_now=at.velocity + h / 2 * gain_now,
        jump=after - before.closing - h * velocity,
        turns=log.turns > 0,
        turn_time=log.farthest_time,
        turn=jnp.where(log.turns > 0, log.farthest - closing_now, 0.0),
        turn_forces=(at.friction, at.friction),
        phase=jnp.where(result.held > 0, 0.0, jnp.sign(velocity)),
        change_time=log.change_time,
    )
    after_flow = MovedLink(closing_now, ContactState(closing_after, result.contact), motion_of_flow)
    after_none = finish_without_flow(group, before, motion_without_flow)
    moved = jax.tree.map(lambda a, b: jnp.where(used, a, b), after_flow, after_none)
    seen = ContactMotion(jnp.broadcast_to(used, closing_after.shape), result)
    return moved._replace(motion=moved.motion._replace(contact=seen))


def finish_without_flow(group: Coupling, before: GroupStep, motion: LinkMotion) -> MovedLink:
    """The end of a step without flow, as that of ``finish_step``."""
    n, h = len(group.resistances), before.dt
    next_closing = before.closing + h * motion.velocity + motion.jump
    held = (motion.phase == 0) & (group.frictions > 0)
    friction = group.frictions * motion.phase
    gain, _ = group.response(held[:n], (before.pull + before.rise / 2)[:n], friction[:n])
    gain = seen_by_faces(gain, before.faces)
    # From the closings at t_{m+1} those at the end of the kick.
    closing_after = next_closing - h / 2 * motion.velocity - h**2 / 8 * gain
    return MovedLink(before.closing, before.state._replace(closing_before=closing_after), motion)


def _is_undisturbed(group: Coupling, before: GroupStep) -> jax.Array:
    """Whether no slip or stick ends in a step without contact."""
    before = before.of_links
    slip, h = jnp.sign(before.velocity), before.dt
    frictions = group.frictions[: slip.size]
    has_friction = frictions > 0
    friction, held = frictions * slip, (slip == 0) & has_friction
    first, first_forces = group.response(held, before.pull - before.rise / 2, friction)
    last, last_forces = group.response(held, before.pull + before.rise / 2, friction)
    # The speed along the slip is a parabola.
    first, last, speed = slip * first, slip * last, jnp.abs(before.velocity)
    dips = (first < 0) & (last > 0)
    lowest = speed - h * first**2 / (2 * jnp.where(dips, last - first, 1.0))
    keeps = (speed + h * (first + last) / 2 > 0) & (~dips | (lowest > 0))
    forces = larger(jnp.abs(first_forces), jnp.abs(last_forces))
    return jnp.where(held, forces <= frictions, keeps | ~has_friction).all()
