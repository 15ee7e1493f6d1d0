"""Forces in a group of links at an instant.

A group of n links has f ≥ n faces where gaps may close: one of each link, in the order of the
links, then the other faces of some (``LinkGroup``). The other face of a link sees it from the other
side: its closing and velocity are those of the link with the opposite sign.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxpound._extrema import larger, smaller
from jaxpound.model.contact import Newton, is_affine, may_pull
from jaxpound.simulation.contact.records import PRESSED, REST, Contact, FlowInput, is_deformed


class Regime(NamedTuple):
    """Quantities that are constant between events, (f,) each for f faces."""

    slip: jax.Array  # direction of slip, 0 in stick
    mode: jax.Array  # of contact
    touch_speed: jax.Array  # of the contact under way

    @staticmethod
    def of(slip: jax.Array, contact: Contact) -> Regime:
        """The regime of links that slip in a direction, and of their contact."""
        return Regime(slip, contact.mode, contact.touch_speed)

    @property
    def held(self) -> jax.Array:
        """Whether the closing cannot change: stick, or rest in contact."""
        return (self.slip == 0) | (self.mode == REST)

    @property
    def deformed(self) -> jax.Array:
        """Whether a law of contact stores energy."""
        return is_deformed(self.mode)


class Forces(NamedTuple):
    """Forces in links and the accelerations that they leave, (f,) each, as each face sees them."""

    acceleration: jax.Array  # s''
    friction: jax.Array  # q
    contact: jax.Array  # p, of the face alone
    total: jax.Array  # of the link, q + p of its faces
    raw: jax.Array  # of the laws, not clipped
    elastic: jax.Array  # the part of it that stores energy


class LinkLaws:
    """The laws of a group of n links and f faces, those of contact bound to effective masses.

    Where all forces of laws are linear and no friction depends on the velocity (``are_linear``),
    forces are linear in time, closings and velocities between events.
    """

    def __init__(self, inputs: FlowInput, faces: tuple[int, ...]) -> None:
        laws, self.faces, self.resistances = inputs.laws, faces, inputs.resistances
        self.of_links, self.dtype = inputs.delassus, inputs.delassus.dtype
        self.delassus = seen_by_faces(seen_by_faces(self.of_links, faces).T, faces)
        self.friction, self.mass = inputs.friction, 1 / jnp.diagonal(self.delassus)
        rigid = [isinstance(law, Newton) for law in laws]
        self.forces = [None if isinstance(law, Newton) else law for law in laws]
        self.has_contact, self.has_newton = any(law is not None for law in laws), any(rigid)
        self.has_contact_force = any(law is not None for law in self.forces)
        self.has_resistance = any(law is not None for law in self.resistances)
        forces = [law for law in self.forces if law is not None]
        self.are_linear = not self.has_resistance and all(map(is_affine, forces))
        self.rigid = jnp.asarray(rigid)
        self.has_law = jnp.asarray([law is not None for law in laws])
        clips = [law is not None and not may_pull(law) for law in self.forces]
        self.may_clip, self.clips = any(clips), jnp.asarray(clips)
        self.gap = jnp.where(self.has_law, inputs.gap, 0.0)  # finite
        restitutions = [law.restitution if isinstance(law, Newton) else 1.0 for law in laws]
        self.restitution = jnp.stack([jnp.asarray(e, self.dtype) for e in restitutions])

    @property
    def rate(self) -> jax.Array:
        """Bound of the rates, frequencies and decays, of motions under linear laws, in 1/time."""
        zero = jnp.zeros((), self.dtype)

        def slopes_of(law: Any) -> tuple[jax.Array, jax.Array]:
            def force(depth: jax.Array, speed: jax.Array) -> jax.Array:
                return jnp.asarray(law.force(depth, speed, zero), self.dtype)

            return jax.grad(force, (0, 1))(zero, zero)

        laws = lax.stop_gradient(self.forces)
        slopes = [(zero, zero) if law is None else slopes_of(law) for law in laws]
        weights = [jnp.sqrt(jnp.abs(jnp.stack(of_laws))) for of_laws in zip(*slopes, strict=True)]
        stiffness, damping = (
            (weight[:, None] * jnp.abs(self.delassus) * weight[None]).sum(1).max()
            for weight in weights
        )
        return damping / 2 + jnp.sqrt(damping**2 / 4 + stiffness)

    @property
    def is_link(self) -> jax.Array:
        """Whether a face stands for its link too: in friction, and in its turns."""
        return jnp.arange(len(self.forces)) < len(self.resistances)

    def of_links_alone(self, values: jax.Array) -> jax.Array:
        """Values of links, 0 for their other faces."""
        return jnp.where(self.is_link, values, 0.0) if self.faces else values

    def of_other_face(self, values: jax.Array, without: Any) -> jax.Array:
        """The values of each link's other face, ``without`` where it has none."""
        n, others = len(self.resistances), [jnp.asarray(without, values.dtype)] * len(self.forces)
        for i, k in enumerate(self.faces):
            others[k], others[n + i] = values[n + i], values[k]
        return jnp.stack(others)

    def of_either_face(self, links: jax.Array) -> jax.Array:
        """Faces of links in which something holds for a face."""
        return of_either_face(links, self.faces)

    def inverse(self, regime: Regime) -> jax.Array:
        """``held_inverse`` of the links in a regime."""
        return held_inverse(self.of_links, regime.held[: len(self.resistances)])

    def of_contact(self, s: jax.Array, w: jax.Array, regime: Regime) -> tuple[jax.Array, jax.Array]:
        """Each law's force and its elastic part; zero for links without a law that has one.

        For links that are apart, the force without penetration.
        """
        whole = [jnp.zeros((), self.dtype)] * len(self.forces)
        elastic = whole.copy()
        for j, law in enumerate(self.forces):
            if law is not None:
                depth = jnp.where(regime.deformed[j], s[j] - self.gap[j], 0.0)
                speed = regime.touch_speed[j]
                whole[j] = jnp.asarray(law.force(depth, w[j], speed), self.dtype)
                elastic[j] = jnp.asarray(law.force(depth, 0 * w[j], speed), self.dtype)
        return jnp.stack(whole), jnp.stack(elastic)

    def growth(self, s: jax.Array, w: jax.Array, a: jax.Array, regime: Regime) -> jax.Array:
        """dp/dt of each law's force, with acceleration ``a`` of the closing."""

        def raw(s: jax.Array, w: jax.Array) -> jax.Array:
            return self.of_contact(s, w, regime)[0]

        return jax.jvp(raw, (s, w), (w, a))[1]

    def resistance(self, w: jax.Array, slip: jax.Array) -> jax.Array:
        """What the friction of each link gains with the velocity; 0 in stick."""
        forces = [jnp.zeros((), self.dtype)] * len(self.resistances)
        for k, law in enumerate(self.resistances):
            if law is not None:
                forces[k] = jnp.asarray(law.resistance(larger(slip[k] * w[k], 0.0)), self.dtype)
        return slip[: len(forces)] * jnp.stack(forces)

    def at(
        self, pull: jax.Array, s: jax.Array, w: jax.Array, regime: Regime, inverse: jax.Array
    ) -> Forces:
        """The forces under a pull A; ``inverse`` is that of the links in this regime."""
        zero, n = jnp.zeros_like(s), len(self.resistances)
        raw, elastic = self.of_contact(s, w, regime) if self.has_contact_force else (zero, zero)
        elastic = jnp.where(regime.deformed, elastic, 0.0)
        contact = jnp.where(regime.mode == PRESSED, raw, 0.0)
        on_links = contact
        if self.faces:
            on_links = (contact - self.of_other_face(contact, without=0.0))[:n]
        held, sliding = regime.held[:n], (self.friction * regime.slip)[:n]
        if self.has_resistance:
            sliding += self.resistance(w, regime.slip)
        held_or_not = response(self.of_links, inverse, held, pull[:n], sliding + on_links)
        friction = jnp.where(held, held_or_not[1] - on_links, sliding)
        seen = (*held_or_not, friction)
        acceleration, total, friction = (seen_by_faces(y, self.faces) for y in seen)
        if self.has_newton:
            rest = regime.mode == REST
            most = smaller(jnp.abs(friction), self.friction)
            friction = jnp.where(self.of_either_face(rest), jnp.sign(friction) * most, friction)
            contact = jnp.where(rest, total - friction, contact)
        return Forces(acceleration, friction, contact, total, raw, elastic)


def seen_by_faces(values: jax.Array, faces: tuple[int, ...]) -> jax.Array:
    """Values of links, (n, ...), as their faces see them, (f, ...): the other ones in reverse."""
    return jnp.stack([*values, *(-values[k] for k in faces)]) if faces else values


def of_either_face(holds: jax.Array, faces: tuple[int, ...]) -> jax.Array:
    """Faces, (f,), of links in which something holds for a face."""
    by_face = [*holds]
    for i, k in enumerate(faces, len(by_face) - len(faces)):
        by_face[k] = by_face[i] = holds[k] | holds[i]
    return jnp.stack(by_face) if faces else holds


def held_inverse(delassus: jax.Array, held: jax.Array) -> jax.Array:
    """Inverse of the system of the forces that hold links: G in their rows, 1 in others."""
    rows = jnp.where(held[:, None], delassus, jnp.eye(held.size, dtype=delassus.dtype))
    return inverse_of(rows)


def response(
    delassus: jax.Array, inverse: jax.Array, held: jax.Array, pull: jax.Array, prescribed: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """Accelerations and forces under a pull where some links are held.

    ``prescribed`` are those in the others; ``inverse`` is ``held_inverse``.
    """
    forces = jnp.where(held, times(inverse, jnp.where(held, pull, prescribed)), prescribed)
    return jnp.where(held, 0.0, pull - times(delassus, forces)), forces


def times(matrix: jax.Array, vector: jax.Array) -> jax.Array:
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


def at_gaps(gaps, y):
    return jnp.stack([y[j] * side for j, side in gaps])


def at_joints(gaps, holds, n):
    return jnp.stack([sum([holds[i] for i, (k, _) in enumerate(gaps) if k == j], jnp.zeros((), bool)) for j in range(n)])
