"""What a step takes and returns: the state of a system between two steps, and an instant of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jaxpound.simulation.contact.records import GapStep, Turns
from jaxpound.simulation.joints.motion import LinkMotion
from jaxpound.simulation.rods.law import RodStep


class Now(NamedTuple):
    """The instant t_m of a step, and the step from t_m − h/2 to t_m + h/2 about it."""

    time: jax.Array
    ground: jax.Array  # u'' at t_m
    mean_ground: jax.Array  # mean of u'' over the step
    is_first: jax.Array  # whether the run starts at t_m: its first step is the second half alone
    is_last: jax.Array  # whether it ends at t_m
    kick: jax.Array  # length of the step in units of h: 1/2 of the first step, else 1
    loads: tuple[jax.Array, ...] | None = None  # on masses at t_m
    mean_loads: tuple[jax.Array, ...] | None = None  # in the mean over the step
    supports: tuple[jax.Array, ...] = ()  # accelerations u'' of supports that move, at t_m
    mean_supports: tuple[jax.Array, ...] = ()  # in the mean over the step


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

    x: tuple[jax.Array, ...]  # of the masses, and behind them of the last support to the second
    v: tuple[jax.Array, ...]
    rods: tuple[Any, ...]
    joints: tuple[JointState, ...]
    owed: Any = None  # accelerations by mass that dashpots owe from the step before


class Moved(NamedTuple):
    """A joint, or joints that share masses, (n,) each, after a step."""

    now: jax.Array  # closing at t_m
    velocity_now: jax.Array  # w at t_m
    force: jax.Array  # q at t_m
    turns: Turns  # times are after t_m
    turn_forces: tuple[jax.Array, jax.Array]  # q before and after the turn of a step without flow
    change_time: jax.Array  # when the direction of slip last changed, after t_m
    state: JointState
    stop: Any = None  # see ``LinkMotion``

    @staticmethod
    def by(motion: LinkMotion, before: JointState, pull: jax.Array, h: float) -> Moved:
        """Joints that turn at most once in the step."""
        now, time = before.closing, motion.turn_time
        closing, turn = now + h * motion.velocity + motion.jump, now + motion.turn
        turns = Turns(motion.turns, turn, turn, jnp.zeros_like(turn), turn, time, turn, time)
        state = before._replace(
            closing=closing, velocity=motion.velocity, phase=motion.phase, pull=pull
        )
        ends = motion.turn_forces, motion.change_time, state, motion.stop
        return Moved(now, motion.velocity_now, motion.force, turns, *ends)


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
    damping: tuple[jax.Array, ...] | None  # forces on masses by damping that is no rod of results
    loads: tuple[jax.Array, ...] | None  # on masses
    supports: tuple[jax.Array, ...] = ()  # their accelerations u''

    @property
    def on_masses(self) -> list[jax.Array] | None:
        """Forces on masses that are of no rod and no link; None without any."""
        parts = [x for x in (self.damping, self.loads) if x is not None]
        return [sum(forces[1:], forces[0]) for forces in zip(*parts, strict=True)] or None

    @property
    def forces(self) -> tuple[jax.Array, ...]:
        """The forces of the rods."""
        return tuple(rod.force for rod in self.rods)
