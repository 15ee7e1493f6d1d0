"""What a step takes and returns: the state of a system between two steps, and an instant of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jaxpound.model.joint import Joint
from jaxpound.simulation.contact.records import FlowResult
from jaxpound.simulation.joints.friction import LinkMotion
from jaxpound.simulation.rods.law import RodStep


class Now(NamedTuple):
    """The instant t_m of a step, and the step from t_m − h/2 to t_m + h/2 about it."""

    time: jax.Array
    ground: jax.Array  # u'' at t_m
    mean_ground: jax.Array  # mean of u'' over the step
    is_first: jax.Array  # whether the run starts at t_m: its first step is the second half alone
    is_last: jax.Array  # whether it ends at t_m
    kick: jax.Array  # length of the step in units of h: 1/2 of the first step, else 1


class JointState(NamedTuple):
    """State of a joint, or of joints that share masses, (n,) each."""

    closing: jax.Array  # s at t_m, which a flow may correct
    velocity: jax.Array  # w at t_m − h/2; exactly 0 in stick
    phase: jax.Array  # direction of slip then, 0 in stick
    pull: jax.Array  # A_{m−1}, the relative acceleration of the ends without forces of joints
    half: Any = None  # s at t_m − h/2, where a flow starts; None if the joint never needs a flow
    contact: Any = None  # the ``Contact`` of each gap


def rise_of(before: JointState, pull: jax.Array, now: Now) -> jax.Array:
    """D = A_m − A_{m−1}, the growth of the pull; 0 as a run starts, maybe under a load."""
    return jnp.where(now.is_first, 0.0, pull - before.pull)


class RunState(NamedTuple):
    """Displacements at t_m, velocities at t_m − h/2, and the state of rods and joints."""

    x: tuple[jax.Array, ...]
    v: tuple[jax.Array, ...]
    rods: tuple[Any, ...]
    joints: tuple[JointState, ...]


class Turns(NamedTuple):
    """Closings of joints where their velocity vanished or reversed in a step."""

    exist: jax.Array  # whether the velocity did so
    first: jax.Array  # closing at the first turn
    last: jax.Array
    between: jax.Array  # path from the first turn to the last
    farthest: jax.Array  # largest closing at a turn
    farthest_time: jax.Array  # after t_m
    nearest: jax.Array  # smallest closing at a turn
    nearest_time: jax.Array


class Moved(NamedTuple):
    """A joint, or joints that share masses, (n,) each, after a step."""

    now: jax.Array  # closing at t_m
    state: Any  # a ``JointState``
    motion: LinkMotion
    turns: Turns

    @staticmethod
    def by(motion: LinkMotion, now: jax.Array, state: JointState) -> Moved:
        """Joints that turn at most once in the step."""
        turn, time = now + motion.turn, motion.turn_time
        turns = Turns(motion.turns, turn, turn, jnp.zeros_like(turn), turn, time, turn, time)
        return Moved(now, state, motion, turns)


class GapStep(NamedTuple):
    """The contact of gaps, (g,) each, in a step with a flow; see ``StepLog``."""

    force: jax.Array  # at t_m
    stored: jax.Array  # change of the energy stored in contact until t_m, and over the step
    stored_after: jax.Array
    lost: jax.Array  # energy lost by contact, likewise
    lost_after: jax.Array
    touched: jax.Array
    touches: jax.Array
    first_touch: jax.Array
    ended: jax.Array
    strongest: jax.Array
    powers: jax.Array
    highest: jax.Array
    highest_time: jax.Array
    highest_forces: jax.Array
    impacts: Any

    @staticmethod
    def of(result: FlowResult) -> GapStep:
        """The contact of gaps in their flow."""
        now, log = result.now, result.log
        energies = now.stored, result.stored, now.lost, result.lost
        events = (getattr(log, name) for name in GapStep._fields[5:])
        return GapStep(now.contact_force, *energies, *events)


class LinkInstant(NamedTuple):
    """A link at an instant t_m, and its motion around it, as its own face sees it."""

    closing: jax.Array
    velocity: jax.Array
    friction: Any  # its force; 0 if another link, of which this is the other face, has it
    phase: jax.Array  # direction of slip after the step, and when it began, after t_m
    change_time: jax.Array
    turns: Turns
    jumps: Any  # whether its force jumps in a flow
    inertia: Any  # force of its inerter, or None
    gap: GapStep | None  # of a link with a law of contact, in a step with a flow


class Jump(NamedTuple):
    """An instant at which accelerations of masses may peak: forces of joints jump there."""

    time: jax.Array  # after t_m
    forces: Sequence[jax.Array]  # of friction and contact then, of the joints that share masses


class SeenGroup(NamedTuple):
    """Joints that share masses as they are observed at t_m."""

    forces: Sequence[jax.Array]  # q + p of friction and contact, by joint
    inertia: Sequence[Any]  # forces of inerters, by joint; None of a joint without one
    jumps: Sequence[Jump]
    links: dict[int, LinkInstant]

    @property
    def totals(self) -> list[Any]:
        """Forces of friction, contact and inerters, by joint."""
        return added(self.forces, self.inertia)


def added(forces: Sequence[Any], inertia: Sequence[Any]) -> list[Any]:
    """Forces in joints with those of their inerters, or None."""
    pairs = zip(forces, inertia, strict=True)
    return [force if inert is None else force + inert for force, inert in pairs]


Inertia = Callable[[Sequence[Sequence[Any]]], list[list[Any]]]
"""Forces of inerters from those of friction and contact, of joints by group."""


def link_instants(
    joint: Joint, moved: Moved, jumps: Any, inertia: Any, gaps: dict[int, GapStep]
) -> dict[int, LinkInstant]:
    """The links that make a joint, each with the closing as its face sees it."""
    now, motion, turns = moved.now, moved.motion, moved.turns
    links = {}
    for link, side in joint.faces:
        if side < 0:
            reverse = {"first": -turns.first, "last": -turns.last, "farthest": -turns.nearest}
            turns = turns._replace(**reverse, farthest_time=turns.nearest_time)
        links[link] = LinkInstant(
            closing=side * now,
            velocity=side * motion.velocity_now,
            friction=motion.force if side > 0 else 0 * motion.force,
            phase=side * motion.phase,
            change_time=motion.change_time,
            turns=turns,
            jumps=jumps,
            inertia=inertia if side > 0 else None,
            gap=gaps.get(link),
        )
    return links


class Instant(NamedTuple):
    """A system at an instant t_m."""

    time: jax.Array
    ground: jax.Array  # u''
    x: tuple[jax.Array, ...]
    v: tuple[jax.Array, ...]
    rods: tuple[RodStep, ...]
    groups: tuple[SeenGroup, ...]
    links: tuple[LinkInstant, ...]
    needs_flow: jax.Array | None  # of a step without local flows: whether it needs one

    @property
    def forces(self) -> tuple[jax.Array, ...]:
        """The forces of the rods."""
        return tuple(rod.force for rod in self.rods)
