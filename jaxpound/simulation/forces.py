"""Forces of a group of links at an instant: friction, contact, and what holds links in place."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jaxpound._extrema import smaller
from jaxpound.model.contact import Newton, may_pull

APART, PRESSED, CLIPPED, REST = 0.0, 1.0, 2.0, 3.0
"""A link's contact: apart; a law's force acts; it would pull, so that there is none; at rest in
contact (Newton's law), where what keeps the gap closed is whatever it takes."""


class Phase(NamedTuple):
    """What stays as it is between events, (n,) each for n links."""

    slip: jax.Array  # direction of slip, 0 in stick
    mode: jax.Array  # of contact
    touch_speed: jax.Array  # of the contact under way

    @property
    def held(self) -> jax.Array:
        """Whether the closing cannot change: stick, or rest in contact."""
        return (self.slip == 0) | (self.mode == REST)

    @property
    def deformed(self) -> jax.Array:
        """Whether a law of contact stores energy."""
        return is_deformed(self.mode)


def is_deformed(mode: jax.Array) -> jax.Array:
    """Whether a law of contact stores energy in this mode of contact."""
    return (mode == PRESSED) | (mode == CLIPPED)


class Forces(NamedTuple):
    """Forces in links and the accelerations that they leave, (n,) each."""

    acceleration: jax.Array  # s''
    friction: jax.Array  # q
    contact: jax.Array  # p
    total: jax.Array  # q + p
    raw: jax.Array  # what the laws say, clipped or not
    elastic: jax.Array  # the part of it that stores energy


class LinkLaws:
    """The laws of a group of n links, those of contact bound to their effective masses.

    ``restless`` says whether any law of contact has a force: without one the links' accelerations
    change linearly in time between events.
    """

    def __init__(
        self, delassus: jax.Array, friction: jax.Array, gap: jax.Array, laws: tuple[Any, ...]
    ) -> None:
        self.delassus, self.friction, self.dtype = delassus, friction, delassus.dtype
        self.mass = 1 / jnp.diagonal(delassus)
        rigid = [isinstance(law, Newton) for law in laws]
        forceful = [law is not None and not one for law, one in zip(laws, rigid, strict=True)]
        self.touches, self.collides = any(law is not None for law in laws), any(rigid)
        self.restless = any(forceful)
        self.forces = [law if one else None for law, one in zip(laws, forceful, strict=True)]
        self.rigid = jnp.asarray(rigid)
        self.meets = jnp.asarray([law is not None for law in laws])
        self.clips = jnp.asarray(
            [one and not may_pull(law) for law, one in zip(laws, forceful, strict=True)]
        )
        self.gap = jnp.where(self.meets, gap, 0.0)  # finite
        self.restitution = jnp.stack(
            [
                jnp.asarray(law.restitution if one else 1.0, self.dtype)
                for law, one in zip(laws, rigid, strict=True)
            ]
        )

    def of_contact(self, s: jax.Array, w: jax.Array, phase: Phase) -> tuple[jax.Array, jax.Array]:
        """What each law says, and its elastic part; zero for links without such a law.

        A law of links that are apart is asked for its force without penetration.
        """
        zero = jnp.zeros((), self.dtype)
        raw, elastic = [], []
        for j, law in enumerate(self.forces):
            if law is None:
                raw.append(zero)
                elastic.append(zero)
            else:
                depth = jnp.where(phase.deformed[j], s[j] - self.gap[j], 0.0)
                speed = phase.touch_speed[j]
                raw.append(jnp.asarray(law.force(depth, w[j], speed), self.dtype))
                elastic.append(jnp.asarray(law.force(depth, 0 * w[j], speed), self.dtype))
        return jnp.stack(raw), jnp.stack(elastic)

    def growth(self, s: jax.Array, w: jax.Array, a: jax.Array, phase: Phase) -> jax.Array:
        """dp/dt of each law's force, with acceleration ``a`` of the closing."""

        def raw(s: jax.Array, w: jax.Array) -> jax.Array:
            return self.of_contact(s, w, phase)[0]

        return jax.jvp(raw, (s, w), (w, a))[1]

    def at(
        self, pull: jax.Array, s: jax.Array, w: jax.Array, phase: Phase, inverse: jax.Array
    ) -> Forces:
        """The forces under a pull A; ``inverse`` is ``held_inverse`` in this phase."""
        raw, elastic = self.of_contact(s, w, phase)
        elastic = jnp.where(phase.deformed, elastic, 0.0)
        contact = jnp.where(phase.mode == PRESSED, raw, 0.0)
        held, rest = phase.held, phase.mode == REST
        known = self.friction * phase.slip + contact
        acceleration, total = response(self.delassus, inverse, held, pull, known)
        friction = jnp.where(held, total - contact, self.friction * phase.slip)
        most = smaller(jnp.abs(friction), self.friction)
        friction = jnp.where(rest, jnp.sign(friction) * most, friction)
        contact = jnp.where(rest, total - friction, contact)
        return Forces(acceleration, friction, contact, total, raw, elastic)

    def affine(
        self, pull: jax.Array, rise: jax.Array, phase: Phase, inverse: jax.Array
    ) -> tuple[jax.Array, jax.Array, jax.Array]:
        """Accelerations as an affine function of time and the forces of contact laws.

        Without such forces, (n,); their growth in time where the pull grows at the rate ``rise``;
        and by how much each force lowers them, (n, n).
        """
        held = phase.held

        def under(pull: jax.Array, known: jax.Array) -> jax.Array:
            return response(self.delassus, inverse, held, pull, known)[0]

        free, growth = under(pull, self.friction * phase.slip), under(rise, 0 * rise)
        each = [under(0 * pull, one) for one in jnp.eye(held.size, dtype=self.dtype)]
        return free, growth, -jnp.stack(each, -1)


def held_inverse(delassus: jax.Array, held: jax.Array) -> jax.Array:
    """Inverse of the system of the forces that hold links: G in their rows, 1 in others."""
    rows = jnp.where(held[:, None], delassus, jnp.eye(held.size, dtype=delassus.dtype))
    return inverse_of(rows)


def response(
    delassus: jax.Array, inverse: jax.Array, held: jax.Array, pull: jax.Array, known: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """Accelerations and forces under a pull where some links are held.

    Forces are ``known`` in the others; ``inverse`` is ``held_inverse``.
    """
    forces = jnp.where(held, times(inverse, jnp.where(held, pull, known)), known)
    return jnp.where(held, 0.0, pull - times(delassus, forces)), forces


def times(matrix: jax.Array, vector: jax.Array) -> jax.Array:
    """Product of a small matrix and a vector, which is compiled as elementwise work is."""
    return (matrix * vector[None]).sum(-1)


def inverse_of(rows: jax.Array) -> jax.Array:
    """Inverse by elimination, which needs no pivoting here; unrolled, as there are few rows."""
    n = rows.shape[0]
    work = jnp.concatenate([rows, jnp.eye(n, dtype=rows.dtype)], axis=1)
    for k in range(n):
        pivot = work[k] / work[k, k]
        other = (jnp.arange(n) != k)[:, None]
        work = jnp.where(other, work - work[:, k : k + 1] * pivot[None], pivot[None])
    return work[:, n:]
