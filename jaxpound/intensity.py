"""Measures of a ground motion's intensity."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax.scipy.integrate import trapezoid
from jaxtyping import Array, Float

from jaxpound._branches import peak
from jaxpound.ground import GroundLike, Record, sampled
from jaxpound.scheme import TimeGrid


def pga(ground: GroundLike, grid: TimeGrid | None = None) -> jax.Array:
    """Peak ground acceleration max |u''|, in g; a ``Record`` needs no grid."""
    return peak(_samples(ground, grid)[0])


def pgv(ground: GroundLike, grid: TimeGrid | None = None, gravity: float = 1.0) -> Float[Array, ""]:
    """Peak ground velocity max |u'|, from rest, by the trapezoidal rule.

    With a record in g and seconds, ``gravity=9.80665`` gives m/s.
    """
    a, dt = _samples(ground, grid)
    velocity = gravity * dt * jnp.cumsum((a[1:] + a[:-1]) / 2)
    return peak(velocity)


def arias_intensity(
    ground: GroundLike, grid: TimeGrid | None = None, gravity: float = 1.0
) -> Float[Array, ""]:
    """Arias intensity (π/2) ∫ u''² dt × gravity, u'' in g (Arias 1970), by the trapezoidal rule.

    With a record in g and seconds, ``gravity=9.80665`` gives m/s.
    """
    a, dt = _samples(ground, grid)
    return jnp.pi / 2 * gravity * trapezoid(a**2, dx=dt)


def _samples(ground: GroundLike, grid: TimeGrid | None) -> tuple[jax.Array, Any]:
    if grid is None and isinstance(ground, Record):
        return jnp.asarray(ground.samples), ground.dt
    if not isinstance(grid, TimeGrid):
        raise ValueError(f"grid = {grid!r} must be a TimeGrid for a {type(ground).__name__}")
    return jnp.asarray(sampled(ground, grid).samples), grid.dt
