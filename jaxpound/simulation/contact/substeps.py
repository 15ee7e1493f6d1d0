"""Substeps of a local flow: the links at any time between two events."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxpound.simulation.contact.dop853 import until, weighted
from jaxpound.simulation.contact.forces import Forces


class PowerSeries(NamedTuple):
    """A substep of links whose forces are linear in time, closings and velocities: power series.

    Row k of the coefficients belongs to power k + 1 of the share of the substep that has passed.
    """

    y: jax.Array  # at its start
    length: jax.Array
    coefficients: jax.Array  # of all rows but the time

    @staticmethod
    def of(
        y: jax.Array, length: jax.Array, begin: Forces, change: Callable[..., Forces], order: int
    ) -> PowerSeries:
        """The series up to an order, from the forces at the start.

        ``change`` are changes of the forces with those of time, closings and velocities, in which
        it is linear: coefficients of one power give those of the next.
        """
        s, w = y[1:3]
        a = begin.acceleration

        def power(state: Any, k: jax.Array) -> Any:
            t, s, w = state
            forces = change(t, s, w)
            ahead = 0 * t, length * w / (k + 1), length * forces.acceleration / (k + 1)
            return ahead, (s, w, forces.contact, forces.elastic)

        powers = jnp.arange(1.0, order + 1).astype(y.dtype)
        first = jnp.broadcast_to(length, s.shape), length * w, length * a
        _, rest = lax.scan(power, first, powers)
        start = s, w, begin.contact, begin.elastic
        rates = (jnp.concatenate([x[None], z[:-1]]) for x, z in zip(start, rest, strict=True))
        s_rate, w_rate, contact, elastic = rates
        works = jnp.stack([elastic, contact - elastic], 1)
        products = _product(works, w_rate[:, None])
        integrated = jnp.concatenate([s_rate[:, None], products, contact[:, None]], 1)
        integrated *= length / powers[:, None, None]
        return PowerSeries(y, length, jnp.concatenate([jnp.stack(rest[:2], 1), integrated], 1))

    def at(self, time: jax.Array) -> jax.Array:
        """The links a ``time`` after the start."""
        share = _share(time, self.length)
        powers = share[None]
        while len(powers) < len(self.coefficients):
            powers = jnp.concatenate([powers, powers[-1] * powers])
        rows = self.y[1:] + weighted(powers[: len(self.coefficients)], self.coefficients)
        return jnp.concatenate([self.y[:1] + time, rows])


class Integrated(NamedTuple):
    """A substep of the Runge–Kutta method."""

    y: jax.Array
    length: jax.Array
    slopes: jax.Array  # of all rows but the time, in the stages

    def at(self, time: jax.Array) -> jax.Array:
        """The links a ``time`` after the start."""
        rows = self.y[1:] + self.length * weighted(until(_share(time, self.length)), self.slopes)
        return jnp.concatenate([self.y[:1] + time, rows])


def _product(a: jax.Array, b: jax.Array) -> jax.Array:
    """Coefficients of the product of two power series, along the first axis, up to their order."""

    def term(state: tuple[jax.Array, jax.Array], factor: jax.Array) -> Any:
        product, shifted = state
        product += factor[None] * shifted
        return (product, jnp.concatenate([0 * shifted[:1], shifted[:-1]])), None

    return lax.scan(term, (0 * a, b), a)[0][0]


def _share(time: jax.Array, length: jax.Array) -> jax.Array:
    return time / jnp.where(length > 0, length, 1.0)
