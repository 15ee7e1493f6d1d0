"""How a run starts: at rest, or displaced and moving.

A run at rest has velocities half a step before t = 0 from which the first kick leaves those half a
step after it. A run that starts displaced or moving has its velocities at t = 0 itself in the place
of those, and its first kick is half a step long: a whole one with half the shaking and twice the
masses. Its rods are relaxed as they are at the start, and have constant forces besides.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeVar

import jax
import jax.numpy as jnp

from jaxpound.simulation.contact.group import ContactState
from jaxpound.simulation.friction import LinkMotion
from jaxpound.simulation.rod import RodLaw, SpringLaw
from jaxpound.simulation.scheme import Scheme
from jaxpound.simulation.state import LinkState, RunState, StepConstants, each

T = TypeVar("T")

MovedLink = tuple[jax.Array, ContactState | None, LinkMotion]
"""Closing of a link at t_m, state of its contact after the step, and its motion in the step."""


class AtRest:
    """The start of a run at rest; ``first_velocity`` is that half a step before t = 0."""

    halfway = True
    """Whether flows of the first step start in its middle."""

    def __init__(self, first_velocity: jax.Array) -> None:
        self.first_velocity = first_velocity

    def before(self, state: RunState, starts: jax.Array) -> RunState:
        """The state before a step, which may be the first (``starts``)."""
        first = self.first_velocity
        return state._replace(v=jax.tree.map(lambda v: jnp.where(starts, first, v), state.v))

    def kick(
        self, system: StepConstants, shaking: jax.Array, starts: jax.Array
    ) -> tuple[StepConstants, jax.Array]:
        """Constants and shaking of a step."""
        return system, shaking

    def pull(self, pull: jax.Array, starts: jax.Array) -> jax.Array:
        """A pull, from that of the step's kick."""
        return pull

    def elongations(self, elongations: list[jax.Array]) -> list[jax.Array]:
        """Those of rods from where they are relaxed."""
        return elongations

    def forces(
        self, forces: tuple[jax.Array, ...], rods: Sequence[RodLaw | SpringLaw]
    ) -> tuple[jax.Array, ...]:
        """The forces of rods, from those of their relaxed elongations."""
        return forces

    def hysteresis_starts(self, starts: jax.Array) -> jax.Array | None:
        """Whether rods that yield begin displaced or moving, None if they never do."""
        return None

    def rise(self, pull: jax.Array, last: jax.Array, starts: jax.Array, on_ground: bool) -> Any:
        """The growth of a pull since the step before: none where the run starts under a load."""
        return pull - (jnp.where(starts, pull, last) if on_ground else last)

    def on_ground(self, motion: LinkMotion, starts: jax.Array, scheme: Scheme) -> LinkMotion:
        """Motion of a sliding bearing: from rest at t = 0 it has half a step, as free masses have.

        A link between two masses needs no such start: it has no load before the ground moves them.
        """
        share = jnp.where(starts, 0.5 if scheme.start == "rest" else 0.0, 1.0)
        share = share.astype(motion.velocity.dtype)
        return motion._replace(
            velocity=share * motion.velocity,
            velocity_now=jnp.where(starts, 0.0, motion.velocity_now),
            jump=jnp.where(starts, 0.0, motion.jump),
        )

    def link(self, link: LinkState, moved: MovedLink, starts: jax.Array, dt: float) -> MovedLink:
        """A link in a step, from its state before and from how it has moved."""
        return moved

    def velocity_now(self, v_now: jax.Array, v: jax.Array, starts: jax.Array) -> jax.Array:
        """Velocity of a free mass at t_m; v is that before the step."""
        return v_now

    def smooth(self, time: jax.Array, dt: float) -> jax.Array | bool:
        """Whether three samples until now may be those of a smooth motion."""
        return True

    def kept(self, time: jax.Array, before: T, after: T) -> T:
        """What a step leaves, of which some are idle before the first."""
        return after


class Displaced(AtRest):
    """The start of a run that is displaced or moving; ``initial`` are elongations of the rods."""

    halfway = False

    def __init__(self, initial: tuple[jax.Array, ...]) -> None:
        self.initial = initial

    def before(self, state: RunState, starts: jax.Array) -> RunState:
        """The state as it is."""
        return state

    def kick(
        self, system: StepConstants, shaking: jax.Array, starts: jax.Array
    ) -> tuple[StepConstants, jax.Array]:
        """Those of half a kick at the start: its share of shaking and of inverse masses."""
        share = _share_of_kick(shaking, starts)
        inverse_masses = tuple(share * inverse for inverse in system.inverse_masses)
        couplings = each(lambda x: x._replace(delassus=share * x.delassus), system.couplings)
        inerters = system.inerters and system.inerters.for_masses_over(share)
        system = system._replace(
            inverse_masses=inverse_masses, couplings=couplings, inerters=inerters
        )
        return system, share * shaking

    def pull(self, pull: jax.Array, starts: jax.Array) -> jax.Array:
        """A pull, from that of the step's kick."""
        return pull / _share_of_kick(pull, starts)

    def elongations(self, elongations: list[jax.Array]) -> list[jax.Array]:
        """Those of rods from where they are relaxed."""
        return [length - rest for length, rest in zip(elongations, self.initial, strict=True)]

    def forces(
        self, forces: tuple[jax.Array, ...], rods: Sequence[RodLaw | SpringLaw]
    ) -> tuple[jax.Array, ...]:
        """The forces with those of the initial elongations."""
        by_rod = zip(forces, rods, self.initial, strict=True)
        return tuple(force + law.modulus * rest for force, law, rest in by_rod)

    def hysteresis_starts(self, starts: jax.Array) -> jax.Array | None:
        """Whether the run begins."""
        return starts

    def rise(self, pull: jax.Array, last: jax.Array, starts: jax.Array, on_ground: bool) -> Any:
        """None at the start."""
        return pull - jnp.where(starts, pull, last)

    def on_ground(self, motion: LinkMotion, starts: jax.Array, scheme: Scheme) -> LinkMotion:
        """Motion as it is."""
        return motion

    def link(self, link: LinkState, moved: MovedLink, starts: jax.Array, dt: float) -> MovedLink:
        """With the closing of the start and no turns before it."""
        closing, contact, motion = moved
        motion = motion._replace(
            velocity_now=jnp.where(starts, link.velocity, motion.velocity_now),
            jump=jnp.where(starts, 0.0, motion.jump),
            turns=motion.turns & ~starts,
            turn_time=jnp.where(starts, 0.0, motion.turn_time),
            turn=jnp.where(starts, 0.0, motion.turn),
            change_time=jnp.where(starts, 0.0, motion.change_time),
        )
        if contact is not None:  # after the first half step
            half = link.closing + dt / 4 * (link.velocity + motion.velocity)
            before = jnp.where(starts, half, contact.closing_before)
            contact = contact._replace(closing_before=before)
        return jnp.where(starts, link.closing, closing), contact, motion

    def velocity_now(self, v_now: jax.Array, v: jax.Array, starts: jax.Array) -> jax.Array:
        """That of the start."""
        return jnp.where(starts, v, v_now)

    def smooth(self, time: jax.Array, dt: float) -> jax.Array | bool:
        """Not with samples before the start."""
        return time > dt

    def kept(self, time: jax.Array, before: T, after: T) -> T:
        """Nothing of idle steps before the first."""
        return jax.tree.map(lambda old, new: jnp.where(time < 0, old, new), before, after)


def _share_of_kick(y: jax.Array, starts: jax.Array) -> jax.Array:
    return jnp.where(starts, 0.5, 1.0).astype(y.dtype)
