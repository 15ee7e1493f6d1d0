"""Forces in joints that share masses, and in their gaps, at an instant.

A joint has one closing s. Each of its gaps is on a side σ = ±1 of it, and sees the closing σ s; a
contact force p in the gap adds σ p to the force on the joint.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxpound._extrema import larger, smaller
from jaxpound.model.contact import Newton, is_linear, may_pull
from jaxpound.simulation.contact.records import (
    PRESSED,
    REST,
    Clock,
    Contact,
    FlowInput,
    Gaps,
    is_deformed,
)

_STATIC = {"static": True}
Motion = tuple[jax.Array, jax.Array, jax.Array]
"""Time from the start of the step, and closings and velocities of the joints."""


class Regime(NamedTuple):
    """Quantities that are constant between events."""

    slip: jax.Array  # direction of slip of each joint, 0 in stick
    mode: jax.Array  # of contact in each gap
    touch_speed: jax.Array  # of the contact under way

    @staticmethod
    def of(slip: jax.Array, contact: Contact) -> Regime:
        """The regime of joints that slip in a direction, and of contact in their gaps."""
        return Regime(slip, contact.mode, contact.touch_speed)

    @property
    def deformed(self) -> jax.Array:
        """Whether a law of contact stores energy, by gap."""
        return is_deformed(self.mode)


class Forces(NamedTuple):
    """Forces and the accelerations that they leave."""

    acceleration: jax.Array  # s'', (n,)
    friction: jax.Array  # q
    carried: jax.Array  # by friction, and by gaps that are closed at rest
    total: jax.Array  # q and p of all gaps
    contact: jax.Array  # p, (g,)
    raw: jax.Array  # of the laws, not clipped
    elastic: jax.Array  # the part of it that stores energy


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Constants:
    """What is constant in a flow of n joints and g gaps.

    Where all forces of laws are linear and no friction depends on the velocity (``are_linear``),
    forces are linear in time, closings and velocities between events.
    """

    inputs: FlowInput
    clock: Clock
    laws: list[Any]  # those of contact that have a force, by gap; None for Newton's
    mass: jax.Array  # effective mass of each joint's ends, (n,)
    h: float = field(metadata=_STATIC)
    slots: int = field(metadata=_STATIC)  # impacts recorded for each gap
    sides: np.ndarray | None = field(metadata=_STATIC)  # σ, (g, n); None if it is 1 (n, n)
    rigid: np.ndarray = field(metadata=_STATIC)  # gaps with Newton's law
    clips: np.ndarray = field(metadata=_STATIC)  # gaps whose law has a force that must not pull
    has_resistance: bool = field(metadata=_STATIC)  # whether a friction grows with the velocity
    are_linear: bool = field(metadata=_STATIC)

    @staticmethod
    def of(h: float, slots: int, gaps: Gaps, inputs: FlowInput, clock: Clock) -> Constants:
        """The constants of a flow."""
        laws = [None if isinstance(law, Newton) else law for law in inputs.laws]
        joints, sides = np.arange(inputs.closing.size), np.array(gaps, int).reshape(-1, 2).T
        matrix = np.where(sides[0][:, None] == joints, sides[1][:, None], 0)
        has_resistance = any(law is not None for law in inputs.resistances)
        return Constants(
            inputs=inputs,
            clock=clock,
            laws=laws,
            mass=1 / jnp.diagonal(inputs.delassus),
            h=h,
            slots=slots,
            sides=None if np.array_equal(matrix, np.eye(joints.size)) else matrix,
            rigid=np.array([law is None for law in laws], bool),
            clips=np.array([law is not None and not may_pull(law) for law in laws], bool),
            has_resistance=has_resistance,
            are_linear=not has_resistance and all(law is None or is_linear(law) for law in laws),
        )

    @property
    def dtype(self) -> Any:
        """Type of all numbers."""
        return self.inputs.closing.dtype

    def seen(self, y: jax.Array) -> jax.Array:
        """Closings or velocities of joints as their gaps see them."""
        return y if self.sides is None else times(self.sides.astype(y.dtype), y)

    def on_joints(self, y: jax.Array) -> jax.Array:
        """Forces or positions of gaps, as their joints see them."""
        return y if self.sides is None else times(self.sides.T.astype(y.dtype), y)

    def joints_where(self, holds: jax.Array) -> jax.Array:
        """Joints of which something holds in a gap."""
        return holds if self.sides is None else ((self.sides.T != 0) & holds[None]).any(-1)

    def held(self, regime: Regime) -> jax.Array:
        """Joints whose closing cannot change: in stick, or at rest in contact."""
        held = regime.slip == 0
        return held | self.joints_where(regime.mode == REST) if self.rigid.any() else held

    def inverse(self, regime: Regime) -> jax.Array:
        """``held_inverse`` of the joints in a regime."""
        return held_inverse(self.inputs.delassus, self.held(regime))


def largest_rate(constants: Constants) -> jax.Array:
    """Bound of the rates, frequencies and decays, of motions under linear laws, in 1/time."""
    zero = jnp.zeros((), constants.dtype)

    def slopes_of(law: Any) -> tuple[jax.Array, jax.Array]:
        def force(depth: jax.Array, speed: jax.Array) -> jax.Array:
            return jnp.asarray(law.force(depth, speed, zero), constants.dtype)

        return jax.grad(force, (0, 1))(zero, zero)

    laws = lax.stop_gradient(constants.laws)
    slopes = [(zero, zero) if law is None else slopes_of(law) for law in laws]
    delassus = jnp.abs(constants.inputs.delassus)
    if constants.sides is not None:
        joints = constants.sides.nonzero()[1]
        delassus = delassus[np.ix_(joints, joints)]
    weights = [jnp.sqrt(jnp.abs(jnp.stack(by_gap))) for by_gap in zip(*slopes, strict=True)]
    stiffness, damping = (
        (weight[:, None] * delassus * weight[None]).sum(1).max() for weight in weights
    )
    return damping / 2 + jnp.sqrt(damping**2 / 4 + stiffness)


def law_forces(
    constants: Constants, s: jax.Array, w: jax.Array, regime: Regime
) -> tuple[jax.Array, jax.Array]:
    """Each gap's force by its law and the elastic part of it; zero for Newton's law.

    For gaps that are open, the force without penetration.
    """
    if constants.rigid.all():  # also of no gap
        return (jnp.zeros(len(constants.laws), constants.dtype),) * 2
    whole = [jnp.zeros((), constants.dtype)] * len(constants.laws)
    elastic = whole.copy()
    depths = jnp.where(regime.deformed, constants.seen(s) - constants.inputs.sizes, 0.0)
    speeds = constants.seen(w)
    for j, law in enumerate(constants.laws):
        if law is not None:
            depth, speed, touch_speed = depths[j], speeds[j], regime.touch_speed[j]
            whole[j] = jnp.asarray(law.force(depth, speed, touch_speed), constants.dtype)
            elastic[j] = jnp.asarray(law.force(depth, 0 * speed, touch_speed), constants.dtype)
    return jnp.stack(whole), jnp.stack(elastic)


def force_growth(
    constants: Constants, regime: Regime, s: jax.Array, w: jax.Array, a: jax.Array
) -> jax.Array:
    """dp/dt of each law's force, with accelerations of the joints."""

    def raw(s: jax.Array, w: jax.Array) -> jax.Array:
        return law_forces(constants, s, w, regime)[0]

    return jax.jvp(raw, (s, w), (w, a))[1]


def forces_at(constants: Constants, motion: Motion, regime: Regime, inverse: jax.Array) -> Forces:
    """The forces at an instant; ``inverse`` is that of the joints in this regime."""
    inputs, (t, s, w) = constants.inputs, motion
    pull = inputs.pull + inputs.rise * (t / constants.h - 0.5)
    raw, elastic = law_forces(constants, s, w, regime)
    elastic = jnp.where(regime.deformed, elastic, 0.0)
    contact = jnp.where(regime.mode == PRESSED, raw, 0.0)
    pressed, held = constants.on_joints(contact), constants.held(regime)
    sliding = inputs.friction * regime.slip
    if constants.has_resistance:
        sliding += _resistance(inputs.resistances, w, regime.slip)
    acceleration, total = response(inputs.delassus, inverse, held, pull, sliding + pressed)
    carried = friction = jnp.where(held, total - pressed, sliding)
    if constants.rigid.any():
        rest = regime.mode == REST
        most = smaller(jnp.abs(carried), inputs.friction)
        limited = jnp.sign(carried) * most
        friction = jnp.where(constants.joints_where(rest), limited, carried)
        contact = jnp.where(rest, constants.seen(carried - friction), contact)
    return Forces(acceleration, friction, carried, total, contact, raw, elastic)


def _resistance(laws: tuple[Any, ...], w: jax.Array, slip: jax.Array) -> jax.Array:
    """What the friction of each joint gains with the velocity; 0 in stick."""
    forces = [jnp.zeros((), w.dtype)] * len(laws)
    for k, law in enumerate(laws):
        if law is not None:
            forces[k] = jnp.asarray(law.resistance(larger(slip[k] * w[k], 0.0)), w.dtype)
    return slip * jnp.stack(forces)


def held_inverse(delassus: jax.Array, held: jax.Array) -> jax.Array:
    """Inverse of the system of the forces that hold joints: G in their rows, 1 in others."""
    rows = jnp.where(held[:, None], delassus, jnp.eye(held.size, dtype=delassus.dtype))
    return inverse_of(rows)


def response(
    delassus: jax.Array, inverse: jax.Array, held: jax.Array, pull: jax.Array, prescribed: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """Accelerations and forces under a pull where some joints are held.

    ``prescribed`` are those in the others; ``inverse`` is ``held_inverse``.
    """
    forces = jnp.where(held, times(inverse, jnp.where(held, pull, prescribed)), prescribed)
    return jnp.where(held, 0.0, pull - times(delassus, forces)), forces


def times(matrix: Any, vector: jax.Array) -> jax.Array:
    """Product of a small matrix and a vector, which is compiled as elementwise work is."""
    return (matrix * vector[None]).sum(-1)


def inverse_of(rows: jax.Array) -> jax.Array:
    """Inverse by elimination, which needs no pivoting for these; unrolled, as rows are few."""
    n = rows.shape[0]
    if n == 1:  # what elimination gives as well, in ten operations
        return 1 / rows
    work = jnp.concatenate([rows, jnp.eye(n, dtype=rows.dtype)], axis=1)
    for k in range(n):
        pivot = work[k] / work[k, k]
        other = (jnp.arange(n) != k)[:, None]
        work = jnp.where(other, work - work[:, k : k + 1] * pivot[None], pivot[None])
    return work[:, n:]


def at_gaps(gaps: Gaps, y: jax.Array) -> jax.Array:
    """Closings, velocities or accelerations of joints as the gaps see them, (g,)."""
    return jnp.stack([side * y[joint] for joint, side in gaps])


def at_joints(gaps: Gaps, holds: jax.Array, n: int) -> jax.Array:
    """Joints, (n,), of which something holds for a gap."""
    by_joint = [jnp.zeros((), bool)] * n
    for (joint, _), of_gap in zip(gaps, holds, strict=True):
        by_joint[joint] = by_joint[joint] | of_gap
    return jnp.stack(by_joint)
