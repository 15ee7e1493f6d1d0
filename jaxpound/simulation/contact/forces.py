"""Forces in joints that share masses, and in their gaps, at an instant.

A contact force p in a gap on the side σ = ±1 of its joint adds σ p to the force on the joint.
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
    Coupling,
    FlowInput,
    is_deformed,
    times,
)

_STATIC = {"static": True}
Motion = tuple[jax.Array, jax.Array, jax.Array]
"""Time from the start of the step, and closings and velocities of the joints."""


class Regime(NamedTuple):
    """Quantities that are constant between events."""

    slip: jax.Array  # direction of slip of each joint, 0 in stick
    mode: jax.Array  # of contact in each gap
    touch_speed: jax.Array  # of the contact under way

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
    rigid: np.ndarray = field(metadata=_STATIC)  # gaps with Newton's law
    clips: np.ndarray = field(metadata=_STATIC)  # gaps whose law has a force that must not pull
    are_linear: bool = field(metadata=_STATIC)

    @staticmethod
    def of(h: float, slots: int, inputs: FlowInput, clock: Clock) -> Constants:
        """The constants of a flow."""
        coupling = inputs.coupling
        laws = [None if isinstance(law, Newton) else law for law in coupling.laws]
        linear = all(law is None or is_linear(law) for law in laws)
        return Constants(
            inputs=inputs,
            clock=clock,
            laws=laws,
            mass=1 / jnp.diagonal(coupling.delassus),
            h=h,
            slots=slots,
            rigid=np.array([law is None for law in laws], bool),
            clips=np.array([law is not None and not may_pull(law) for law in laws], bool),
            are_linear=linear and not coupling.has_resistance,
        )

    @property
    def coupling(self) -> Coupling:
        """The joints and their gaps."""
        return self.inputs.coupling

    @property
    def dtype(self) -> Any:
        """Type of all numbers."""
        return self.inputs.closing.dtype

    def held(self, regime: Regime) -> jax.Array:
        """Joints whose closing cannot change: in stick, or at rest in contact."""
        held = regime.slip == 0
        return held | self.coupling.joints_where(regime.mode == REST) if self.rigid.any() else held

    def inverse(self, regime: Regime) -> jax.Array:
        """``held_inverse`` of the joints in a regime."""
        return held_inverse(self.coupling.delassus, self.held(regime))


def largest_rate(constants: Constants) -> jax.Array:
    """Bound of the rates, frequencies and decays, of motions under linear laws, in 1/time."""
    zero = jnp.zeros((), constants.dtype)

    def slopes_of(law: Any) -> tuple[jax.Array, jax.Array]:
        def force(depth: jax.Array, speed: jax.Array) -> jax.Array:
            return jnp.asarray(law.force(depth, speed, zero), constants.dtype)

        return jax.grad(force, (0, 1))(zero, zero)

    laws = lax.stop_gradient(constants.laws)
    slopes = [(zero, zero) if law is None else slopes_of(law) for law in laws]
    delassus = jnp.abs(constants.coupling.delassus)
    if constants.coupling.sides is not None:
        joints = np.array([joint for joint, _ in constants.coupling.gaps])
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
    coupling = constants.coupling
    depths = jnp.where(regime.deformed, coupling.seen(s) - coupling.sizes, 0.0)
    speeds = coupling.seen(w)
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
    inputs, coupling, (t, s, w) = constants.inputs, constants.coupling, motion
    pull = inputs.pull + inputs.rise * (t / constants.h - 0.5)
    raw, elastic = law_forces(constants, s, w, regime)
    elastic = jnp.where(regime.deformed, elastic, 0.0)
    contact = jnp.where(regime.mode == PRESSED, raw, 0.0)
    pressed, held = coupling.on_joints(contact), constants.held(regime)
    sliding = coupling.frictions * regime.slip
    if coupling.has_resistance:
        sliding += _resistance(coupling.resistances, w, regime.slip)
    acceleration, total = response(coupling.delassus, inverse, held, pull, sliding + pressed)
    carried = friction = jnp.where(held, total - pressed, sliding)
    if constants.rigid.any():
        rest = regime.mode == REST
        most = smaller(jnp.abs(carried), coupling.frictions)
        limited = jnp.sign(carried) * most
        friction = jnp.where(coupling.joints_where(rest), limited, carried)
        contact = jnp.where(rest, coupling.seen(carried - friction), contact)
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
