"""Substeps of a local flow: the links at any time between two events."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp

from jaxpound.simulation.contact.dop853 import until, weighted
from jaxpound.simulation.contact.events import SmoothState
from jaxpound.simulation.contact.forces import Forces


class Flight(NamedTuple):
    """A substep of links without a contact force, whose accelerations change linearly in time."""

    y: jax.Array  # at its start
    length: jax.Array
    first: Forces  # at its start
    last: Forces  # and at its end

    def at(self, time: jax.Array) -> jax.Array:
        """The links a ``time`` after the start; contact forces are those of links at rest."""
        at, share = SmoothState(*self.y), _share(time, self.length)
        a, p = self.first.acceleration, self.first.contact
        a_gain, p_gain = share * (self.last.acceleration - a), share * (self.last.contact - p)
        flown = at._replace(
            t=at.t + time,
            s=at.s + time * (at.w + time * (a / 2 + a_gain / 6)),
            w=at.w + time * (a + a_gain / 2),
            area=at.area + time * (at.s + time * (at.w / 2 + time * (a / 6 + a_gain / 24))),
            impulse=at.impulse + time * (p + p_gain / 2),
        )
        return jnp.stack(flown)


class Integrated(NamedTuple):
    """A substep of the Runge–Kutta method."""

    y: jax.Array
    length: jax.Array
    slopes: jax.Array  # of all rows but the time, in the stages

    def at(self, time: jax.Array) -> jax.Array:
        """The links a ``time`` after the start."""
        rows = self.y[1:] + self.length * weighted(until(_share(time, self.length)), self.slopes)
        return jnp.concatenate([self.y[:1] + time, rows])


def _share(time: jax.Array, length: jax.Array) -> jax.Array:
    return time / jnp.where(length > 0, length, 1.0)
