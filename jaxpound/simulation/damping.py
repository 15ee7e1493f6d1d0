r"""Pure dashpots, whose forces −D x' a step takes at the mean of its velocities.

    (M + h/2 D) v⁺ = (M − h/2 D) v⁻ + h (loads − Cᵀ (q + p)),    D = Σ c b bᵀ,    P = (M + h/2 D)⁻¹

The left side is constant, so that steps are stable however strong a dashpot is. Joints have the
mobility C P Cᵀ in the place of C M⁻¹ Cᵀ, but in a local flow, within which dashpots have not acted.

The mean velocity of a step is the mean of those at its ends unless forces of joints jump within it.
Where slip stops or turns, the dashpots owe what they miss by it, and pay it in the next step. A
local flow takes the joints to the end of the step without what dashpots do against their jumps:
this follows from the mean velocity and the mean closing of the flow, and is added to its end.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jaxpound._xla.alike import in_array
from jaxpound.model.dampers import Dashpot
from jaxpound.model.ends import along, moving_ends
from jaxpound.model.system import Rod, System
from jaxpound.simulation.contact.forces import inverse_of
from jaxpound.simulation.joints.coupled import Coupled
from jaxpound.simulation.joints.group import Flow
from jaxpound.simulation.state import JointState, Moved, Now


class Drag(NamedTuple):
    """What dashpots do within a step against jumps of velocities in its flows, by mass.

    Arrays have zeros for supports behind those of the masses.
    """

    velocity: jax.Array  # by which the mean velocity of the step exceeds that of smooth motion
    mean: jax.Array  # acceleration by it, in the mean over the step
    position: jax.Array  # change of position by it, less that of the mean acceleration
    end: jax.Array  # acceleration by it at the step's end


class Damping(NamedTuple):
    """Dashpots of a system over steps of one length."""

    matrix: jax.Array  # D, (n, n), and columns of supports, of which it takes velocities
    inverse: jax.Array  # P
    influence: jax.Array  # P M ι
    h: float
    inherent: jax.Array | None = None  # the part of D by dashpots that are no rods of results

    @staticmethod
    def of(system: System, h: float) -> Damping | None:
        """Those of a system; None without dashpots."""
        dashpots = [rod for rod in system.rods if isinstance(rod.material, Dashpot)]
        if not dashpots and not system.damping:
            return None
        masses = jnp.stack(system.masses)
        n, n_all = masses.size, masses.size + system.topology.n_supports
        unit_motions = [*jnp.eye(n_all, dtype=masses.dtype)]
        no_dashpots = jnp.zeros((n, n_all), masses.dtype)

        def matrix_of(dashpots: Sequence[Rod]) -> jax.Array:
            if not dashpots:
                return no_dashpots
            rows = jnp.stack([along(moving_ends(rod), unit_motions) for rod in dashpots])
            coefficients = jnp.stack([rod.material.coefficient for rod in dashpots])
            return rows.T[:n] @ (coefficients[:, None] * rows)

        inherent = matrix_of(system.damping) if system.damping else None
        matrix = matrix_of(dashpots) + (no_dashpots if inherent is None else inherent)
        inverse = inverse_of(jnp.diag(masses) + h / 2 * matrix[:, :n])
        influence = inverse @ (masses * jnp.asarray(system.influences, masses.dtype))
        return Damping(matrix, inverse, influence, h, inherent)

    def forces(self, v: Sequence[Any]) -> tuple[Any, ...] | None:
        """Forces on masses that move with v, by dashpots that are no rods of results."""
        if self.inherent is None:
            return None
        force = self.inherent @ in_array(v)
        return tuple(-force[mass] for mass in range(force.size))

    def accelerations(
        self, loads: Sequence[Any], v: Sequence[Any], ground: Any, owed: Any, drag: Drag | None
    ) -> jax.Array:
        """Mean accelerations P (loads − D v − M ι u'') of a step before which masses move with v.

        With those that are ``owed`` from the step before.
        """
        start = in_array(v) if drag is None else in_array(v) + drag.velocity
        free = self.inverse @ (in_array(loads) - self.matrix @ start)
        return free - self.influence * ground + owed

    def at_rest(self) -> list[Any]:
        """A zero for each mass and each support."""
        return [0.0 * self.influence[0]] * self.matrix.shape[1]

    def against(self, y: jax.Array) -> jax.Array:
        """Accelerations −P D y by which dashpots oppose velocities y; none of supports."""
        free, (n, n_all) = -self.inverse @ (self.matrix @ y), self.matrix.shape
        return jnp.pad(free, (0, n_all - n)) if n_all > n else free

    def drag(
        self,
        kinds: Sequence[Coupled],
        before: Sequence[JointState],
        flows: Sequence[Flow | None],
        now: Now,
    ) -> Drag:
        """Of the flows of a step, by how their joints deviate from smooth motion."""
        h, (velocity, position, end) = self.h, (self.at_rest(), self.at_rest(), self.at_rest())
        for kind, state, flow in zip(kinds, before, flows, strict=True):
            if flow is not None:
                deviation = kind.deviation(state, flow, now, h)
                kind.follow(velocity, deviation.velocity)
                kind.follow(position, deviation.closing)
                kind.follow(end, deviation.end)
        path = in_array(position)
        speed = in_array(velocity) + self.against(path)
        shift = h * self.against(path - h / 2 * speed)
        return Drag(speed, self.against(speed), shift, self.against(in_array(end)))

    def owed(self, kinds: Sequence[Coupled], moved: Sequence[Moved]) -> jax.Array:
        """Accelerations that dashpots owe as slip has stopped or turned within the step."""
        missed = self.at_rest()
        for kind, joints in zip(kinds, moved, strict=True):
            kind.in_step.follow(missed, kind.in_step.kink(joints, self.h))
        return self.against(in_array(missed))[: len(self.influence)]
