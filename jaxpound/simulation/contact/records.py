"""Contact in a gap, and inputs and results of a local flow through one step."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound._extrema import larger, smaller

APART, PRESSED, CLIPPED, REST = 0.0, 1.0, 2.0, 3.0
"""Modes of contact in a gap. ``APART``: open. ``PRESSED``: force ≥ 0. ``CLIPPED``: the force would
pull and is set to 0. ``REST``: closed at rest (Newton's law), with a reaction force."""

SLOTS = 4  # impacts recorded for each gap in one step
DISCRETE = "mode", "counts", "fastest"  # by which, of a ``Contact``, nothing is differentiated


def soft_larger(a: Any, b: Any) -> jax.Array:
    """The norm (a⁸ + b⁸)^(1/8) of forces a, b ≥ 0, a soft maximum: of its own size, not a⁸'s."""
    high = larger(a, b)
    share = smaller(a, b) / jnp.where(high > 0, high, 1.0)
    return high * jnp.sqrt(jnp.sqrt(jnp.sqrt(1 + share**8)))


def is_deformed(mode: jax.Array) -> jax.Array:
    """Whether a law of contact stores energy in this mode of contact."""
    return (mode == PRESSED) | (mode == CLIPPED)


class Contact(NamedTuple):
    """Mode of contact in gaps, and the contact under way; the time is that of the run."""

    mode: jax.Array
    counts: jax.Array  # 1 if the contact under way counts as an impact
    fastest: jax.Array  # largest speed of approach so far in the run
    touch_speed: jax.Array
    touch_time: jax.Array
    impulse: jax.Array  # so far
    peak_force: jax.Array  # so far


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Coupling:
    """Constants of a group of n joints, which share masses or are one, with g gaps of them.

    A joint has one closing s. Each of its gaps is on a side σ of it: σ = 1 if the gap closes as s
    grows, −1 if it closes as s falls.
    """

    delassus: Any  # G = C M⁻¹ Cᵀ, (n, n), or (1 + G b)⁻¹ G with inerters
    frictions: Any  # μ, (n,)
    resistances: tuple[Any, ...]  # what friction gains with the velocity, by joint, or None
    sizes: Any  # ξ0, (g,)
    laws: tuple[Any, ...]  # of contact for the effective masses, by gap
    gaps: tuple[tuple[int, int], ...] = field(metadata={"static": True})  # joint and σ of each

    @property
    def has_resistance(self) -> bool:
        """Whether a joint has friction that grows with the velocity, which needs every flow."""
        return any(law is not None for law in self.resistances)

    @property
    def may_need_flow(self) -> bool:
        """Whether a step of the group may need the local flow."""
        return bool(self.gaps) or len(self.resistances) > 1 or self.has_resistance

    @property
    def sides(self) -> np.ndarray | None:
        """Σ, the matrix of σ, (g, n); None if it is 1 (n, n)."""
        joints = range(len(self.resistances))
        rows = [[side * (joint == k) for k in joints] for joint, side in self.gaps]
        sides = np.reshape(rows, (len(rows), len(joints))).astype(int)
        return None if np.array_equal(sides, np.eye(len(joints))) else sides

    def seen(self, y: jax.Array) -> jax.Array:
        """Closings, velocities or accelerations of joints as their gaps see them, (g,)."""
        return y if self.sides is None else times(self.sides.astype(y.dtype), y)

    def on_joints(self, y: jax.Array) -> jax.Array:
        """Forces or positions of gaps as their joints see them, (n,)."""
        return y if self.sides is None else times(self.sides.T.astype(y.dtype), y)

    def joints_where(self, holds: jax.Array) -> jax.Array:
        """Joints of which something holds in a gap."""
        return holds if self.sides is None else ((self.sides.T != 0) & holds[None]).any(-1)


class FlowInput(NamedTuple):
    """Inputs of a flow over a step of length h."""

    closing: jax.Array  # s, (n,)
    velocity: jax.Array
    pull: jax.Array  # A in the middle of the step, (n,)
    rise: jax.Array  # change of A over the step
    coupling: Coupling
    contact: Contact  # (g,)


class Clock(NamedTuple):
    """When a flow takes place."""

    middle: jax.Array  # time of the run in the middle of the step
    begin: jax.Array  # from the start of the step: 0, or h/2 if the run starts in mid-step
    is_last: jax.Array  # whether the run ends in mid-step


class Impacts(NamedTuple):
    """Impacts that ended in a step, (g, slots) each; times are those of the run."""

    touch_time: jax.Array
    approach_velocity: jax.Array
    end_time: jax.Array
    rebound_velocity: jax.Array
    impulse: jax.Array
    peak_force: jax.Array


class Turns(NamedTuple):
    """Closings of joints, (n,) each, where their velocity vanished or reversed in a step."""

    exist: jax.Array  # whether a velocity did so: 1 or 0 in a flow
    first: jax.Array  # closing at the first turn
    last: jax.Array
    between: jax.Array  # path from the first turn to the last
    farthest: jax.Array  # largest closing at a turn
    farthest_time: jax.Array  # from the middle of the step
    nearest: jax.Array  # smallest closing at a turn
    nearest_time: jax.Array

    @property
    def reversed(self) -> Turns:
        """The turns as a gap on the other side sees them."""
        return self._replace(
            first=-self.first,
            last=-self.last,
            farthest=-self.nearest,
            farthest_time=self.nearest_time,
            nearest=-self.farthest,
            nearest_time=self.farthest_time,
        )


class GapLog(NamedTuple):
    """What happens in gaps, (g,) each, in a step; times from its middle."""

    touched: jax.Array  # 1 if in contact at any time
    touches: jax.Array  # impacts that began
    first_touch: jax.Array  # when the first of them did
    ended: jax.Array  # impacts that ended
    strongest: jax.Array  # largest impulse of those that ended
    soft_peak: jax.Array  # soft maximum of their peak forces
    highest: jax.Array  # largest contact force
    highest_time: jax.Array
    highest_forces: jax.Array  # q + p of all joints then, (g, n): row j for gap j
    impacts: Impacts


class StepLog(NamedTuple):
    """Events of a step."""

    turns: Turns
    change_time: jax.Array  # when the direction of slip last changed, from the middle; (n,)
    gaps: GapLog


class GapStep(NamedTuple):
    """The contact of gaps, (g,) each, in a step with a flow."""

    force: jax.Array  # at t_m, the middle of the step
    stored: jax.Array  # change of the energy stored in contact until t_m, and over the step
    stored_after: jax.Array
    lost: jax.Array  # energy lost by contact, likewise
    lost_after: jax.Array
    log: GapLog


class MidStep(NamedTuple):
    """The joints, (n,) each, in the middle of the step."""

    closing: jax.Array
    velocity: jax.Array
    friction: jax.Array
    held: jax.Array  # 1 where the closing cannot change: stick or rest


class FlowResult(NamedTuple):
    """Result of a flow.

    Where the run ends in mid-step, contact, energies and events are those until then.
    """

    # Of the joints, (n,) each.
    closing: jax.Array  # at the end
    velocity: jax.Array
    acceleration: jax.Array  # at the end, without the force of a contact law
    held: jax.Array  # 1 where the closing cannot change at the end: stick or rest
    mean: jax.Array  # mean closing over the step
    now: MidStep
    turns: Turns
    change_time: jax.Array  # when the direction of slip last changed
    contact: Contact  # at the end, (g,)
    gaps: GapStep


def times(matrix: Any, vector: jax.Array) -> jax.Array:
    """Product of a small matrix and a vector, which is compiled as elementwise work is."""
    return (matrix * vector[None]).sum(-1)
