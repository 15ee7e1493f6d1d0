"""A group of links: forces at an instant, and inputs and results of a flow through one step."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jaxpound._extrema import smaller
from jaxpound.model.contact import Newton, may_pull

APART, PRESSED, CLIPPED, REST = 0.0, 1.0, 2.0, 3.0
"""Modes of a link's contact. ``APART``: open. ``PRESSED``: force ≥ 0. ``CLIPPED``: the force would
pull and is set to 0. ``REST``: closed at rest (Newton's law), with a reaction force."""

SLOTS = 4
"""Impacts recorded for each link in one step."""

SOFT = 8
"""Exponent of the norm of impacts' peak forces that is a soft maximum."""


class Regime(NamedTuple):
    """Quantities that are constant between events, (n,) each for n links."""

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
        self.clips = jnp.asarray(clips)
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
        raw, elastic = self.of_contact(s, w, regime)
        elastic = jnp.where(regime.deformed, elastic, 0.0)
        contact = jnp.where(regime.mode == PRESSED, raw, 0.0)
        held, rest = regime.held, regime.mode == REST
        prescribed = self.friction * regime.slip + contact
        acceleration, total = response(self.delassus, inverse, held, pull, prescribed)
        friction = jnp.where(held, total - contact, self.friction * regime.slip)
        most = smaller(jnp.abs(friction), self.friction)
        friction = jnp.where(rest, jnp.sign(friction) * most, friction)
        contact = jnp.where(rest, total - friction, contact)
        return Forces(acceleration, friction, contact, total, raw, elastic)

    def affine(
        self, pull: jax.Array, rise: jax.Array, regime: Regime, inverse: jax.Array
    ) -> tuple[jax.Array, jax.Array, jax.Array]:
        """Accelerations as an affine function of time and the forces of contact laws.

        Without such forces, (n,); their growth in time where the pull grows at the rate ``rise``;
        and their decrease by a unit of each force, (n, n).
        """
        held = regime.held

        def under(pull: jax.Array, prescribed: jax.Array) -> jax.Array:
            return response(self.delassus, inverse, held, pull, prescribed)[0]

        free, growth = under(pull, self.friction * regime.slip), under(rise, 0 * rise)
        each = [under(0 * pull, unit_force) for unit_force in jnp.eye(held.size, dtype=self.dtype)]
        return free, growth, -jnp.stack(each, -1)


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
    work = jnp.concatenate([rows, jnp.eye(n, dtype=rows.dtype)], axis=1)
    for k in range(n):
        pivot = work[k] / work[k, k]
        other = (jnp.arange(n) != k)[:, None]
        work = jnp.where(other, work - work[:, k : k + 1] * pivot[None], pivot[None])
    return work[:, n:]


class Contact(NamedTuple):
    """The contact under way of each link, (n,); times from the middle of the step."""

    touch_speed: jax.Array
    touch_time: jax.Array
    impulse: jax.Array  # so far
    peak_force: jax.Array  # so far


class FlowInput(NamedTuple):
    """Inputs of a flow over a step of length h, by which it is differentiated; (n,) for n links."""

    closing: jax.Array
    velocity: jax.Array
    pull: jax.Array  # A in the middle of the step
    rise: jax.Array  # change of A over the step
    delassus: jax.Array  # G, (n, n)
    friction: jax.Array  # μ
    gap: jax.Array  # ξ0
    laws: tuple[Any, ...]  # of contact for the effective masses, None for a link without
    under_way: Contact


class ContactStart(NamedTuple):
    """Contact at the start of a flow, by which it is not differentiated."""

    contact: jax.Array  # (n,), its mode: APART … REST
    counts: jax.Array  # (n,), 1 if the contact under way counts as an impact
    fastest: jax.Array  # (n,), largest speed of approach so far
    start: jax.Array  # 0, or h/2 if the run starts in the middle of the step


class Impacts(NamedTuple):
    """Impacts that ended in a step, (n, slots) each; times from the middle of the step."""

    touch_time: jax.Array
    approach_velocity: jax.Array
    end_time: jax.Array
    rebound_velocity: jax.Array
    impulse: jax.Array
    peak_force: jax.Array


class MidStep(NamedTuple):
    """Links in the middle of the step, (n,) each."""

    closing: jax.Array
    velocity: jax.Array
    friction: jax.Array
    contact: jax.Array
    stored: jax.Array  # change of the energy stored in contact until then
    lost: jax.Array  # lost by contact until then
    held: jax.Array  # 1 where the closing cannot change: stick or rest
    mode: jax.Array  # of contact
    counts: jax.Array  # 1 if the contact under way counts as an impact
    under_way: Contact
    strongest: jax.Array  # as in ``StepLog``, until then
    powers: jax.Array


class StepLog(NamedTuple):
    """Events of a step, (n,) each; times from its middle."""

    touched: jax.Array  # 1 if in contact at any time
    touches: jax.Array  # impacts that began
    first_touch: jax.Array  # when the first of them did
    ended: jax.Array  # impacts that ended
    strongest: jax.Array  # largest impulse of those that ended
    powers: jax.Array  # sum of their peak forces to the power ``SOFT``
    turns: jax.Array  # 1 if a velocity vanished or reversed
    first_turn: jax.Array  # closing where it first did
    last_turn: jax.Array
    between: jax.Array  # path from the first to the last
    farthest: jax.Array  # largest closing at a turn
    farthest_time: jax.Array
    change_time: jax.Array  # when the direction of slip last changed
    highest: jax.Array  # largest contact force
    highest_time: jax.Array
    highest_forces: jax.Array  # q + p of all links then, (n, n): row j for link j
    impacts: Impacts


class FlowResult(NamedTuple):
    """Result of a flow, (n,) each."""

    closing: jax.Array  # at the end
    velocity: jax.Array
    acceleration: jax.Array  # at the end, without the force of a contact law
    held: jax.Array  # 1 where the closing cannot change at the end: stick or rest
    mean: jax.Array  # mean closing over the step
    stored: jax.Array  # change of the energy stored in contact
    lost: jax.Array  # lost by contact
    mode: jax.Array  # contact at the end
    counts: jax.Array
    fastest: jax.Array
    under_way: Contact
    now: MidStep
    log: StepLog
