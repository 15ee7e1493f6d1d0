"""Joints that never need a local flow: they share no mass with others, and cannot touch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jaxpound.model.ends import along, less_ground, mobility
from jaxpound.model.joint import Joint
from jaxpound.model.system import System
from jaxpound.simulation.joints.friction import FrictionLaw, LinkStep
from jaxpound.simulation.state import (
    Inertia,
    JointState,
    Jump,
    Moved,
    Now,
    SeenGroup,
    link_instants,
    rise_of,
)


class Sliding(NamedTuple):
    """The constants of a joint that moves in closed form, s'' = A − R q."""

    joint: Joint
    mobility: jax.Array  # R = C M⁻¹ Cᵀ, or R/(1 + R b) with an inerter
    friction: jax.Array  # μ
    shares: dict[int, jax.Array]  # by mass its entry of S = M⁻¹ Cᵀ/R
    influence: Any  # C ι, by which the ground's acceleration pulls at it
    inertance: jax.Array | None  # b
    reduction: jax.Array | None  # 1/(1 + R b), the factor of pull and mobility

    @staticmethod
    def of(
        joint: Joint, system: System, masses: Sequence[jax.Array], influence: Sequence[Any]
    ) -> Sliding:
        """The constants of a joint of a system."""
        link, ends = system.links[joint.link], joint.ends
        response = mobility(ends, masses)
        shares = {mass: weight / masses[mass] / response for mass, weight in ends}
        inertance = reduction = None
        if link.inerter is not None:
            inertance = link.inerter.inertance
            reduction = 1 / (1 + response * inertance)
            response = reduction * response
        driven = along(ends, influence)
        return Sliding(joint, response, link.friction, shares, driven, inertance, reduction)

    @property
    def groups(self) -> list[tuple[list[Joint], dict[int, Any]]]:
        """The joint, and how its masses share its motion."""
        return [([self.joint], self.shares)]

    def start(self, zero: jax.Array, x: Sequence[Any], v: Sequence[Any]) -> JointState:
        """Its state at the start of a run."""
        closing, velocity = zero + self.along(x), zero + self.along(v)
        return JointState(closing, velocity, jax.lax.stop_gradient(zero), zero)

    def along(self, y: Sequence[Any]) -> Any:
        """C y: its closing, velocity or acceleration from those of the masses."""
        return along(self.joint.ends, y)

    def pull(self, free: Sequence[Any], ground: jax.Array) -> Any:
        """A = C (a − ι u''), its relative acceleration from the free ones of the masses."""
        pull = less_ground(self.along(free), self.influence, ground)
        return pull if self.reduction is None else self.reduction * pull

    def follow(self, y: list[Any], missing: Any) -> None:
        """Add S times a missing closing to the motions of masses, so that its ends have it."""
        for mass, share in self.shares.items():
            y[mass] = y[mass] + share * missing

    def stop(self, v: list[Any], stop: jax.Array) -> None:
        """Add to velocities of masses what its last end makes alone of a change of its own."""
        mass, weight = self.joint.ends[-1]
        v[mass] = v[mass] + stop / weight

    def flow(self, before: JointState, pull: jax.Array, now: Now, h: float, slots: int) -> None:
        """The joint needs no flow."""

    def needs_flow(self, before: JointState, pull: jax.Array, now: Now, h: float) -> jax.Array:
        """Whether the joint needs a flow: it never does."""
        return jnp.zeros((), bool)

    def after(
        self,
        before: JointState,
        flow: None,
        pull: jax.Array,
        now: Now,
        law: FrictionLaw,
        h: float,
    ) -> Moved:
        """The joint after a step, by the law of friction: slip until θ, stick until φ, slip."""
        rise = rise_of(before, pull, now)
        # Half a step is a whole one with half the pull and half the mobility.
        pushed, mobility = now.kick * pull, now.kick * self.mobility
        motion = law.slide(
            LinkStep(before.velocity, before.phase, pushed, rise, mobility, self.friction, h)
        )
        closing = before.closing + h * motion.velocity + motion.jump
        state = JointState(closing, motion.velocity, motion.phase, pull)
        return Moved.by(motion, before.closing, state)

    def seen(self, moved: Moved, flow: None, inertia: Inertia) -> list[SeenGroup]:
        """The joint as it is observed; where it turns its force may jump."""
        motion = moved.motion
        time, force = jnp.where(motion.turns, motion.turn_time, 0.0), motion.force
        jumps = [Jump(time, [jnp.where(motion.turns, q, force)]) for q in motion.turn_forces]
        ((inert,),) = inertia([[force]])
        links = link_instants(self.joint, moved, False, inert, {})
        return [SeenGroup([force], [inert], jumps, links)]

    def inertia(
        self, free: Sequence[Any], ground: jax.Array, forces: Sequence[Sequence[Any]]
    ) -> list[list[Any]]:
        """The force b s'' of its inerter beside other forces in it; None without an inerter."""
        if self.inertance is None:
            return [[None]]
        return [[self.inertance * (self.pull(free, ground) - self.mobility * forces[0][0])]]
