"""Substeps of a local flow: the joints and gaps at any time between two events."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxpound.simulation.contact.dop853 import until, weighted
from jaxpound.simulation.contact.forces import Constants, Forces, Motion


class SmoothState(NamedTuple):
    """What changes smoothly between events."""

    t: jax.Array  # from the start of the step
    s: jax.Array  # of the joints, (n,) each
    w: jax.Array
    area: jax.Array  # ∫ s dt
    stored: jax.Array  # of the gaps, (g,) each
    lost: jax.Array
    impulse: jax.Array

    @property
    def motion(self) -> Motion:
        """Time, closings and velocities."""
        return self[:3]

    def rates(self, constants: Constants, now: Forces) -> SmoothState:
        """The derivatives by time."""
        speed = constants.coupling.seen(self.w)
        lost = (now.contact - now.elastic) * speed
        work = now.elastic * speed, lost, now.contact
        return SmoothState(jnp.ones_like(self.t), self.w, now.acceleration, self.s, *work)

    @property
    def flat(self) -> jax.Array:
        """All numbers but the time in one array, by which sums of them are short programs."""
        return jnp.concatenate(self[1:])

    def rebuilt(self, t: jax.Array, flat: jax.Array) -> SmoothState:
        """The state with other numbers."""
        ends = np.cumsum([y.size for y in self[1:-1]])
        return SmoothState(t, *jnp.split(flat, ends))

    def after(self, time: jax.Array, change: jax.Array) -> SmoothState:
        """The state a ``time`` later, after a change of its other numbers."""
        return self.rebuilt(self.t + time, self.flat + change)


class PowerSeries(NamedTuple):
    """A substep of joints whose forces are linear in time, closings and velocities: power series.

    Row k of the coefficients belongs to power k + 1 of the share of the substep that has passed.
    """

    y: SmoothState  # at its start
    length: jax.Array
    coefficients: jax.Array  # of all numbers but the time

    @staticmethod
    def of(
        constants: Constants,
        y: SmoothState,
        length: jax.Array,
        begin: Forces,
        change: Callable[[Motion], Forces],
        order: int,
    ) -> PowerSeries:
        """The series up to an order, from the forces at the start.

        ``change`` are changes of the forces with those of time, closings and velocities, in which
        it is linear: coefficients of one power give those of the next.
        """

        def power(motion: Motion, k: jax.Array) -> Any:
            t, s, w = motion
            forces = change(motion)
            ahead = 0 * t, length * w / (k + 1), length * forces.acceleration / (k + 1)
            return ahead, (s, w, constants.coupling.seen(w), forces.contact, forces.elastic)

        powers = jnp.arange(1.0, order + 1).astype(y.s.dtype)
        first = length, length * y.w, length * begin.acceleration
        _, rest = lax.scan(power, first, powers)
        start = y.s, y.w, constants.coupling.seen(y.w), begin.contact, begin.elastic
        rates = (jnp.concatenate([x[None], z[:-1]]) for x, z in zip(start, rest, strict=True))
        s_rate, _, speed, contact, elastic = rates
        works = _product(jnp.stack([elastic, contact - elastic], 1), speed[:, None])
        integrated = jnp.concatenate([s_rate, works[:, 0], works[:, 1], contact], 1)
        integrated *= length / powers[:, None]
        return PowerSeries(y, length, jnp.concatenate([*rest[:2], integrated], 1))

    def at(self, time: jax.Array) -> SmoothState:
        """The state a ``time`` after the start."""
        share = _share(time, self.length)
        powers = share[None]
        while len(powers) < len(self.coefficients):
            powers = jnp.concatenate([powers, powers[-1] * powers])
        change = weighted(powers[: len(self.coefficients)], self.coefficients)
        return self.y.after(time, change)


class Integrated(NamedTuple):
    """A substep of the Runge–Kutta method."""

    y: SmoothState
    length: jax.Array
    slopes: jax.Array  # of all numbers but the time, in the stages

    def at(self, time: jax.Array) -> SmoothState:
        """The state a ``time`` after the start."""
        change = self.length * weighted(until(_share(time, self.length)), self.slopes)
        return self.y.after(time, change)


Substep = PowerSeries | Integrated


def _product(a: jax.Array, b: jax.Array) -> jax.Array:
    """Coefficients of the product of two power series, along the first axis, up to their order."""

    def term(state: tuple[jax.Array, jax.Array], factor: jax.Array) -> Any:
        product, shifted = state
        product += factor[None] * shifted
        return (product, jnp.concatenate([0 * shifted[:1], shifted[:-1]])), None

    return lax.scan(term, (0 * a, b), a)[0][0]


def _share(time: jax.Array, length: jax.Array) -> jax.Array:
    return time / jnp.where(length > 0, length, 1.0)
