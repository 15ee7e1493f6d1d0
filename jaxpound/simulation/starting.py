"""How a run starts: at rest, or displaced and moving.

A run at rest starts with velocities at t = −h/2, chosen so that those at t = h/2, after the first
kick, are right. A run that starts displaced or moving has its velocities at t = 0 in their place,
and its first kick is half a step long: a whole one with half the acceleration of the ground and
twice the masses.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp

from jaxpound.simulation.contact.group import MovedLink
from jaxpound.simulation.friction import LinkMotion
from jaxpound.simulation.scheme import Scheme
from jaxpound.simulation.state import LinkState, RunState, StepConstants

T = TypeVar("T")


class RunStart(NamedTuple):
    """The start of a run: at rest, or displaced or moving."""

    first_velocity: jax.Array  # of all masses half a step before t = 0, where all is at rest
    at_rest: bool  # flows of the first step then start in its middle

    def before(self, state: RunState, is_first: jax.Array) -> RunState:
        """The state before a step, which may be the first (``is_first``)."""
        if not self.at_rest:
            return state
        first = self.first_velocity
        return state._replace(v=jax.tree.map(lambda v: jnp.where(is_first, first, v), state.v))

    def kick(
        self, system: StepConstants, acceleration: jax.Array, is_first: jax.Array
    ) -> tuple[StepConstants, jax.Array]:
        """The constants of a step and the mean acceleration of the ground in it."""
        if self.at_rest:
            return system, acceleration
        share = _share_of_kick(acceleration, is_first)
        system = system._replace(
            inverse_masses=tuple(share * inverse for inverse in system.inverse_masses),
            groups=tuple(groups.for_masses_over(share) for groups in system.groups),
            inerters=system.inerters and system.inerters.for_masses_over(share),
        )
        return system, share * acceleration

    def pull(self, pull: jax.Array, is_first: jax.Array) -> jax.Array:
        """A pull, from that of the step's kick."""
        return pull if self.at_rest else pull / _share_of_kick(pull, is_first)

    def rise(self, pull: jax.Array, last: jax.Array, is_first: jax.Array, on_ground: bool) -> Any:
        """The growth of a pull since the step before: none where the run starts under a load."""
        under_load = on_ground or not self.at_rest
        return pull - (jnp.where(is_first, pull, last) if under_load else last)

    def on_ground(self, motion: LinkMotion, is_first: jax.Array, scheme: Scheme) -> LinkMotion:
        """Motion of a sliding bearing: from rest at t = 0 it has half a step, as free masses have.

        A link between two masses needs no such start: it has no load before the ground moves them.
        """
        if not self.at_rest:
            return motion
        share = jnp.where(is_first, 0.5 if scheme.start == "rest" else 0.0, 1.0)
        share = share.astype(motion.velocity.dtype)
        return motion._replace(
            velocity=share * motion.velocity,
            velocity_now=jnp.where(is_first, 0.0, motion.velocity_now),
            jump=jnp.where(is_first, 0.0, motion.jump),
        )

    def link(self, link: LinkState, moved: MovedLink, is_first: jax.Array, dt: float) -> MovedLink:
        """A link in a step, which may be the first, from its state before and how it has moved."""
        if self.at_rest:
            return moved
        closing, contact, motion = moved
        motion = motion._replace(
            velocity_now=jnp.where(is_first, link.velocity, motion.velocity_now),
            jump=jnp.where(is_first, 0.0, motion.jump),
            turns=motion.turns & ~is_first,
            turn_time=jnp.where(is_first, 0.0, motion.turn_time),
            turn=jnp.where(is_first, 0.0, motion.turn),
            change_time=jnp.where(is_first, 0.0, motion.change_time),
        )
        if contact is not None:  # after the first half step
            half = link.closing + dt / 4 * (link.velocity + motion.velocity)
            before = jnp.where(is_first, half, contact.closing_before)
            contact = contact._replace(closing_before=before)
        return MovedLink(jnp.where(is_first, link.closing, closing), contact, motion)

    def velocity_now(self, v_now: jax.Array, v: jax.Array, is_first: jax.Array) -> jax.Array:
        """Velocity of a free mass at t_m; v is that before the step, or of the start."""
        return v_now if self.at_rest else jnp.where(is_first, v, v_now)

    def smooth(self, time: jax.Array, dt: float) -> jax.Array | bool:
        """Whether three samples until now may be those of a smooth motion."""
        return self.at_rest or time > dt

    def kept(self, time: jax.Array, before: T, after: T) -> T:
        """The state after a step; idle steps before the first leave it unchanged."""
        if self.at_rest:
            return after
        return jax.tree.map(lambda old, new: jnp.where(time < 0, old, new), before, after)


def _share_of_kick(y: jax.Array, is_first: jax.Array) -> jax.Array:
    return jnp.where(is_first, 0.5, 1.0).astype(y.dtype)
