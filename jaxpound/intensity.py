"""Measures of a ground motion's intensity."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax.scipy.integrate import trapezoid
from jaxtyping import Array, Float

from jaxpound._branches import peak
from jaxpound._checks import Rule, all_hold, enforce, finite, number
from jaxpound.ground import GroundLike, Record, sampled
from jaxpound.scheme import TimeGrid


def pga(ground: GroundLike, grid: TimeGrid | None = None) -> jax.Array:
    """Peak ground acceleration max |u''|, in g; a ``Record``, in either unit, needs no grid.

    Examples
    --------
    >>> float(jp.pga(jp.Record([0.0, 0.1, -0.2, 0.0], dt=0.5)))
    0.2
    >>> round(float(jp.pga(jp.paper.ground(), jp.paper.grid())), 2)
    21.99
    """
    return peak(_samples(ground, grid)[0])


def pgv(ground: GroundLike, grid: TimeGrid | None = None, gravity: float = 1.0) -> Float[Array, ""]:
    """Peak ground velocity max |u'|, from rest, by the trapezoidal rule.

    With a record in g and seconds, ``gravity=9.80665`` gives m/s.

    Examples
    --------
    >>> record = jp.Record([0.0, 0.1, -0.2, 0.0], dt=0.5)
    >>> round(float(jp.pgv(record, gravity=jp.STANDARD_GRAVITY)), 4)  # m/s
    0.4903
    """
    a, dt = _samples(ground, grid)
    velocity = gravity * dt * jnp.cumsum((a[1:] + a[:-1]) / 2)
    return peak(velocity)


def arias_intensity(
    ground: GroundLike, grid: TimeGrid | None = None, gravity: float = 1.0
) -> Float[Array, ""]:
    """Arias intensity (π/2) ∫ u''² dt × gravity, u'' in g (Arias 1970), by the trapezoidal rule.

    With a record in g and seconds, ``gravity=9.80665`` gives m/s.

    Examples
    --------
    >>> record = jp.Record([0.0, 0.1, -0.2, 0.0], dt=0.5)
    >>> round(float(jp.arias_intensity(record, gravity=jp.STANDARD_GRAVITY)), 4)  # m/s
    0.3851
    """
    a, dt = _samples(ground, grid)
    return jnp.pi / 2 * gravity * trapezoid(a**2, dx=dt)


def spectral_acceleration(
    ground: GroundLike, grid: TimeGrid | None = None, *, period: Any, damping: Any = 0.05
) -> Float[Array, ""]:
    """Pseudo-spectral acceleration ω² max |x|, in g, of a linear oscillator from rest.

    Its motion is exact for ground acceleration that is linear between instants (Nigam and Jennings
    1969); the largest displacement is that of the instants.

    Parameters
    ----------
    ground, grid
        The ground motion; a ``Record`` needs no grid.
    period
        Natural period T > 0, in the ground motion's unit of time.
    damping
        Damping ratio ζ, 0 ≤ ζ < 1.

    Raises
    ------
    ValueError
        If a known period or damping breaks its rule. Traced, the result is NaN.

    Examples
    --------
    >>> record = jp.Record([0.0, 0.1, -0.2, 0.0], dt=0.5)
    >>> round(float(jp.spectral_acceleration(record, period=1.0)), 4)
    0.1766
    """
    owner = "spectral_acceleration"
    period, damping = number(owner, "period", period), number(owner, "damping", damping)
    rules = [
        Rule("period", period, (period > 0) & finite(period), "positive and finite"),
        Rule("damping", damping, (damping >= 0) & (damping < 1), "at least 0 and below 1"),
    ]
    enforce(owner, rules)
    a, h = _samples(ground, grid)
    w, zeta = 2 * jnp.pi / period, damping
    damped = w * jnp.sqrt(1 - zeta**2)
    decay = jnp.exp(-zeta * w * h)
    sine, cosine = decay * jnp.sin(damped * h) / damped, decay * jnp.cos(damped * h)

    def step(state: tuple[Any, Any], ends: tuple[Any, Any]) -> tuple[tuple[Any, Any], Any]:
        (x, v), (start, end) = state, ends
        # Less the particular solution of x'' + 2 ζ ω x' + ω² x = −(a + s t), the motion is free.
        s = (end - start) / h
        lag = 2 * zeta * s / w**3
        x, v = x - (lag - start / w**2), v + s / w**2
        free_x = (cosine + zeta * w * sine) * x + sine * v
        free_v = (cosine - zeta * w * sine) * v - w**2 * sine * x
        x, v = free_x + lag - end / w**2, free_v - s / w**2
        return (x, v), x

    rest = jnp.zeros((), jnp.result_type(a, w, zeta))
    _, x = jax.lax.scan(step, (rest, rest), (a[:-1], a[1:]))
    return jnp.where(all_hold(rules), w**2 * peak(x), jnp.nan)


def _samples(ground: GroundLike, grid: TimeGrid | None) -> tuple[jax.Array, Any]:
    if grid is None and isinstance(ground, Record):
        return jnp.asarray(ground.samples), ground.dt
    if not isinstance(grid, TimeGrid):
        raise ValueError(f"grid = {grid!r} must be a TimeGrid for a {type(ground).__name__}")
    return jnp.asarray(sampled(ground, grid).samples), grid.dt
