"""Forces in a group of links at an instant."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jaxpound._extrema import smaller
from jaxpound.model.contact import Newton, may_pull
from jaxpound.simulation.contact.records import PRESSED, REST, Contact, is_deformed


class Regime(NamedTuple):
    """Quantities that are constant between events, (n,) each for n links."""

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
    """Forces in links and the accelerations that they leave, (n,) each."""

    acceleration: jax.Array  # s''
    friction: jax.Array  # q
    contact: jax.Array  # p
    total: jax.Array  # q + p
    raw: jax.Array  # of the laws, not clipped
    elastic: jax.Array  # the part of it that stores energy


class LinkLaws:
    """The laws of a group of n links, those of contact bound to their effective masses.

    Where no law has a force (not ``has_contact_force``), accelerations change linearly in time
    between events.
    """

    def __init__(
        self, delassus: jax.Array, friction: jax.Array, gap: jax.Array, laws: tuple[Any, ...]
    ) -> None:
        self.delassus, self.friction, self.dtype = delassus, friction, delassus.dtype
        self.mass = 1 / jnp.diagonal(delassus)
        rigid = [isinstance(law, Newton) for law in laws]
        self.forces = [None if isinstance(law, Newton) else law for law in laws]
        self.has_contact, self.has_newton = any(law is not None for law in laws), any(rigid)
        self.has_contact_force = any(law is not None for law in self.forces)
        self.rigid = jnp.asarray(rigid)
        self.has_law = jnp.asarray([law is not None for law in laws])
        clips = [law is not None and not may_pull(law) for law in self.forces]
        self.may_clip, self.clips = any(clips), jnp.asarray(clips)
        self.gap = jnp.where(self.has_law, gap, 0.0)  # finite
        restitutions = [law.restitution if isinstance(law, Newton) else 1.0 for law in laws]
        self.restitution = jnp.stack([jnp.asarray(e, self.dtype) for e in restitutions])

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

    def at(
        self, pull: jax.Array, s: jax.Array, w: jax.Array, regime: Regime, inverse: jax.Array
    ) -> Forces:
        """The forces under a pull A; ``inverse`` is ``held_inverse`` in this regime."""
        zero = jnp.zeros_like(s)
        raw, elastic = self.of_contact(s, w, regime) if self.has_contact_force else (zero, zero)
        elastic = jnp.where(regime.deformed, elastic, 0.0)
        contact = jnp.where(regime.mode == PRESSED, raw, 0.0)
        held, sliding = regime.held, self.friction * regime.slip
        acceleration, total = response(self.delassus, inverse, held, pull, sliding + contact)
        friction = jnp.where(held, total - contact, sliding)
        if self.has_newton:
            rest = regime.mode == REST
            most = smaller(jnp.abs(friction), self.friction)
            friction = jnp.where(rest, jnp.sign(friction) * most, friction)
            contact = jnp.where(rest, total - friction, contact)
        return Forces(acceleration, friction, contact, total, raw, elastic)


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
