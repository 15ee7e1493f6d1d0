"""Measures of a ground motion's intensity."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.integrate import trapezoid
from jaxtyping import Array, ArrayLike, Float

from jaxpound._checks import Rule, all_hold, array, enforce, finite, is_traced, number, positive
from jaxpound._errors import InvalidInput
from jaxpound._extrema import larger, peak
from jaxpound.grid import TimeGrid
from jaxpound.ground.motion import GroundLike
from jaxpound.ground.record import Record, stacked
from jaxpound.ground.run_input import sampled


def pga(ground: GroundLike, grid: TimeGrid | None = None) -> jax.Array:
    """Peak ground acceleration max |u''|, in g; a ``Record``, in either unit, needs no grid.

    Examples
    --------
    >>> float(jp.pga(jp.Record([0.0, 0.1, -0.2, 0.0], dt=0.5)))
    0.2
    """
    samples, _ = samples_of(ground, grid)
    return peak(samples)


def pgv(ground: GroundLike, grid: TimeGrid | None = None, gravity: float = 1.0) -> Float[Array, ""]:
    """Peak ground velocity max |u'|, from rest, by the trapezoidal rule.

    With a record in g and seconds, ``gravity=9.80665`` gives m/s.

    Examples
    --------
    >>> record = jp.Record([0.0, 0.1, -0.2, 0.0], dt=0.5)
    >>> round(float(jp.ground.pgv(record, gravity=jp.STANDARD_GRAVITY)), 4)  # m/s
    0.4903
    """
    a, dt = samples_of(ground, grid)
    return peak(gravity * dt * jnp.cumsum((a[1:] + a[:-1]) / 2))


def arias_intensity(
    ground: GroundLike, grid: TimeGrid | None = None, gravity: float = 1.0
) -> Float[Array, ""]:
    """Arias intensity (π/2) ∫ u''² dt × gravity, u'' in g (Arias 1970), by the trapezoidal rule.

    With a record in g and seconds, ``gravity=9.80665`` gives m/s, as in ``pgv``.
    """
    a, dt = samples_of(ground, grid)
    return jnp.pi / 2 * gravity * trapezoid(a**2, dx=dt)


def spectral_acceleration(
    ground: GroundLike, grid: TimeGrid | None = None, *, period: Any, damping: Any = 0.05
) -> Float[Array, ""]:
    """Pseudo-spectral acceleration ω² max |x|, in g, of a linear oscillator from rest.

    Its motion is exact for ground acceleration that is linear between instants (Nigam and Jennings
    1969), and so is its largest displacement, also between instants, for periods of at least half
    their interval. The motion after the last instant is not counted.

    ``period`` is the natural period > 0, in the ground motion's unit of time, and ``damping`` the
    damping ratio, 0 ≤ ζ < 1. A ``Record`` needs no grid.

    Examples
    --------
    >>> record = jp.Record([0.0, 0.1, -0.2, 0.0], dt=0.5)
    >>> round(float(jp.spectral_acceleration(record, period=1.0)), 4)
    0.3789
    """
    period, damping = number("period", period), number("damping", damping)
    is_positive = Rule("period", period, (period > 0) & finite(period), "positive and finite")
    enforce(rules := [is_positive, damping_rule(damping)])
    a, h = samples_of(ground, grid)
    parts = _SHORT_PARTS if is_traced((period, h)) or np.min(period) < _SHORT * h else 1
    return jnp.where(all_hold(rules), _pseudo_acceleration(a, h, period, damping, parts), jnp.nan)


def damping_rule(damping: Any) -> Rule:
    """The rule for the damping ratio of a spectrum."""
    return Rule("damping", damping, (damping >= 0) & (damping < 1), "at least 0 and below 1")


def spectra(
    records: Sequence[Record], periods: ArrayLike, damping: Any
) -> Float[np.ndarray, "n m"]:
    """``RecordSuite.spectra``, by one program for records of all lengths and intervals."""
    at, zeta = array("periods", periods, (-1,)), number("damping", damping)
    positive(periods=at)
    enforce([damping_rule(zeta)])
    sizes = np.array([record.n_samples for record in records])
    samples, intervals = stacked(records)
    parts = _SHORT_PARTS if at.min() < _SHORT * intervals.max() else 1
    return np.asarray(_spectra(samples, intervals, sizes, at, float(zeta), parts))


@partial(jax.jit, static_argnames="parts")
def _spectra(
    samples: Any, intervals: Any, sizes: Any, periods: Any, damping: Any, parts: int
) -> jax.Array:
    def of_record(record: Any) -> jax.Array:
        a, h, n = record
        return jax.vmap(lambda t: _pseudo_acceleration(a, h, t, damping, parts, n - 1))(periods)

    # One after the other: the motions of all records would not fit into the memory.
    return jax.lax.map(of_record, (samples, intervals, sizes))


_SHORT, _SHORT_PARTS = 4, 4  # periods below so many sample intervals: so many parts of each


class _Oscillator(NamedTuple):
    """x'' + 2 ζ ω x' + ω² x = −u'', with u'' linear over intervals of length h."""

    w: Any
    zeta: Any
    damped: Any  # its frequency, ω √(1 − ζ²)
    h: Any

    def waves(self, t: Any) -> tuple[Any, Any]:
        """Free vibrations at t from unit velocity and unit displacement, without their decay."""
        decay = jnp.exp(-self.zeta * self.w * t)
        return decay * jnp.sin(self.damped * t) / self.damped, decay * jnp.cos(self.damped * t)

    def motion(
        self, state: tuple[Any, Any], ends: tuple[Any, Any], t: Any, free: tuple[Any, Any]
    ) -> tuple[Any, Any]:
        """Displacement and velocity at 0 ≤ t ≤ h after an instant; ``free`` are the waves at t."""
        (w, zeta, _, h), (x, v), (start, end), (sine, cosine) = self, state, ends, free
        # Free vibration plus the particular solution of x'' + 2 ζ ω x' + ω² x = −(a + s t).
        s = (end - start) / h
        lag = 2 * zeta * s / w**3
        x, v = x - (lag - start / w**2), v + s / w**2
        free_x = (cosine + zeta * w * sine) * x + sine * v
        free_v = (cosine - zeta * w * sine) * v - w**2 * sine * x
        return free_x + lag - (start + s * t) / w**2, free_v - s / w**2


def _pseudo_acceleration(
    a: jax.Array, h: Any, period: Any, zeta: Any, parts: int, last: Any = None
) -> jax.Array:
    """ω² max |x| from rest under straight lines between samples a, up to sample ``last``."""
    # Samples interpolated linearly, with ``parts`` intervals in the place of each.
    share = jnp.arange(parts) / parts
    lines = a[:-1, None] + share[None].astype(a.dtype) * (a[1:, None] - a[:-1, None])
    a, h = jnp.append(lines.reshape(-1), a[-1]), h / parts
    w = 2 * jnp.pi / period
    oscillator = _Oscillator(w, zeta, w * jnp.sqrt(1 - zeta**2), h)
    whole = oscillator.waves(h)

    def step(state: tuple[Any, Any], ends: tuple[Any, Any]) -> tuple[tuple[Any, Any], Any]:
        after = oscillator.motion(state, ends, h, whole)
        return after, after

    rest = jnp.zeros((), jnp.result_type(a, w, zeta))
    x, v = (jnp.pad(y, (1, 0)) for y in jax.lax.scan(step, (rest, rest), (a[:-1], a[1:]))[1])

    # Where the velocity changes its sign, Hermite's cubic estimates the extremum, which decides the
    # interval of the largest displacement; Newton's method finds the instant.
    x0, x1, v0, v1 = x[:-1], x[1:], v[:-1], v[1:]
    turns = ((v0 > 0) & (v1 <= 0)) | ((v0 < 0) & (v1 >= 0))
    place = jnp.where(turns, v0 / jnp.where(turns, v0 - v1, 1.0), 1.0)
    rise, run = place**2 * (3 - 2 * place), place * (1 - place) * h
    estimate = x0 + rise * (x1 - x0) + run * ((1 - place) * v0 - place * v1)
    size = jnp.where(turns, jnp.abs(estimate), jnp.maximum(jnp.abs(x0), jnp.abs(x1)))
    if last is not None:
        size = jnp.where(jnp.arange(x0.size) < last * parts, size, -1.0)
    i = jnp.argmax(size)
    state, ends = (x0[i], v0[i]), (a[i], a[i + 1])

    def improved(t: Any) -> Any:
        y, u = oscillator.motion(state, ends, t, oscillator.waves(t))
        bend = -(a[i] + (a[i + 1] - a[i]) * t / h) - 2 * zeta * w * u - w**2 * y
        return jnp.clip(t - u / jnp.where(bend == 0, 1.0, bend), 0, h)

    t = place[i] * h
    for _ in range(4):
        t = jax.lax.stop_gradient(improved(t))
    t = improved(t)
    at_turn = jnp.abs(oscillator.motion(state, ends, t, oscillator.waves(t))[0])
    return w**2 * jnp.where(turns[i], at_turn, larger(jnp.abs(x0[i]), jnp.abs(x1[i])))


def samples_of(ground: GroundLike, grid: TimeGrid | None) -> tuple[jax.Array, Any]:
    """Acceleration at the instants of a grid, or a record's samples, and their interval."""
    if grid is None and isinstance(ground, Record):
        return jnp.asarray(ground.samples), ground.dt
    if not isinstance(grid, TimeGrid):
        raise InvalidInput("grid", repr(grid), f"must be a TimeGrid for a {type(ground).__name__}")
    return jnp.asarray(sampled(ground, grid).samples), grid.dt
