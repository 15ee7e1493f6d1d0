"""Ground motions in closed form: Ricker wavelets (paper, eq. 6) and near-fault velocity pulses."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from jaxpound._checks import is_traced
from jaxpound._errors import InvalidInput
from jaxpound._extrema import larger, smaller
from jaxpound._fields import check, parameter, pytree_dataclass, static
from jaxpound.grid import TimeGrid
from jaxpound.ground import motion
from jaxpound.ground.motion import DIMENSIONLESS, SECONDS, Excitation, GroundMotion
from jaxpound.quantities import STANDARD_GRAVITY

TAIL = 2  # periods after its centre a Ricker wavelet is over: below 1e-13 of its peak
STEPS_PER_WAVELET = 8  # a sine's mean over an eighth of its period is 2.6 % below its middle


def too_short(name: str, period: float, dt: float) -> list[str]:
    """A sentence if a wavelet's period has too few steps of ``dt``."""
    if not period < STEPS_PER_WAVELET * dt:
        return []
    length = f"{period / dt:.3g} time steps long and should be at least {STEPS_PER_WAVELET}"
    return [f"ground: {name} is {length}: a finer time grid resolves it"]


@pytree_dataclass
class Ricker(GroundMotion):
    r"""A sum of Ricker wavelets, in closed form (paper, eq. 6).

    With :math:`a = π/t_p`, :math:`s = t - t_s` and :math:`v = (a s)^2`, each wavelet is
    :math:`u = u_0 (2v - 1) e^{-v}`.

    Parameters
    ----------
    amplitude
        u0, the displacement amplitude: one number, as in the paper, or one per wavelet.
    periods, arrivals
        t_p > 0 and t_s, the instants of the centres, one per wavelet, shape (n,); or one number.

    Examples
    --------
    >>> ground = jp.Ricker(amplitude=0.5, periods=2.0, arrivals=3.0)
    >>> round(float(ground.acceleration(3.0)), 4)
    7.4022
    >>> round(float((0.1 * ground + jp.Ricker(0.2, 1.0, 5.0)).acceleration(3.0)), 4)
    0.7402
    """

    amplitude: Any = parameter("u_0", "length", "displacement amplitude")
    periods: Any = parameter("t_p", "time", "period", above=0)
    arrivals: Any = parameter("t_s", "time", "arrival")

    def __post_init__(self) -> None:
        check(self)
        amplitude, periods, arrivals = map(jnp.shape, (self.amplitude, self.periods, self.arrivals))
        if periods != arrivals:
            shapes = f"periods of shape {periods} and arrivals of shape {arrivals}"
            raise InvalidInput(shapes, "", "must have one entry per wavelet")
        if len(periods) > 1:
            rule = "must be a number or one-dimensional; a batch of ground motions goes through"
            raise InvalidInput(f"periods of shape {periods}", "", f"{rule} jax.vmap")
        if amplitude not in ((), periods):
            rule = f"must be one number or, like periods, of shape {periods}"
            raise InvalidInput(f"amplitude of shape {amplitude}", "", rule)

    @property
    def duration(self) -> Any:
        """Time after which the last wavelet is over, two periods after its centre."""
        ends = self.arrivals + TAIL * self.periods
        return jnp.max(ends) if is_traced(ends) else np.max(ends)

    def displacement(self, t: ArrayLike) -> jax.Array:
        """u(t), of the shape of ``t``."""
        return self._sum(t, lambda a, s, v: 2 * v - 1)

    def velocity(self, t: ArrayLike) -> jax.Array:
        """u'(t), of the shape of ``t``."""
        return self._sum(t, lambda a, s, v: 2 * a**2 * s * (3 - 2 * v))

    def acceleration(self, t: ArrayLike) -> jax.Array:
        """u''(t), of the shape of ``t``."""
        return self._sum(t, lambda a, s, v: 2 * a**2 * (4 * v**2 - 12 * v + 3))

    def excitation(self, grid: TimeGrid, order: int) -> Excitation:
        """Closed forms of u'' and, for a scheme of order 2, its mean to fourth order in dt.

        The mean is u'' + (h²/24) d²u''/dt²; both share the exponentials, most of the work.
        """
        if order == 1:
            return super().excitation(grid, order)
        u0, tp, ts = (jnp.atleast_1d(x) for x in (self.amplitude, self.periods, self.arrivals))
        a = jnp.pi / tp
        size, c = 2 * a**2 * u0, (a * grid.dt) ** 2 / 24
        mean = (3 - 30 * c, 180 * c - 12, 4 - 120 * c, 16 * c)  # times 1, v, v², v³

        def at(t: Any, _: Any) -> tuple[Any, Any]:
            v = (a * (t - ts)) ** 2
            wave = size * jnp.exp(-v)
            averaged = wave * (((mean[3] * v + mean[2]) * v + mean[1]) * v + mean[0])
            return jnp.sum(wave * ((4 * v - 12) * v + 3)), jnp.sum(averaged)

        return Excitation((), at)

    def unresolved(self, dt: float) -> list[str]:
        """A sentence if the shortest wavelet has too few steps of ``dt``."""
        u0, periods = np.broadcast_arrays(np.asarray(self.amplitude), np.asarray(self.periods))
        shortest = float(periods[u0 != 0].min(initial=np.inf))
        return too_short("the shortest of periods", shortest, dt)

    def energy(self, since: float) -> float:
        """∫ u''² dt of the wavelets with centres at or after ``since``."""
        rate, later = np.pi / np.asarray(self.periods), np.asarray(self.arrivals) >= since
        each = 105 / 4 * np.sqrt(np.pi / 2) * np.asarray(self.amplitude) ** 2 * rate**3
        return float(np.sum(each * later))

    def _later(self, delay: Any) -> Ricker:
        return Ricker(self.amplitude, self.periods, self.arrivals + delay)

    def _sum(self, t: ArrayLike, shape: Callable[..., Any]) -> jax.Array:
        t = jnp.asarray(t)
        u0, tp, ts = (
            jnp.expand_dims(jnp.atleast_1d(x), tuple(range(t.ndim)))
            for x in (self.amplitude, self.periods, self.arrivals)
        )
        a, s = jnp.pi / tp, t[..., None] - ts
        v = (a * s) ** 2
        return jnp.sum(u0 * shape(a, s, v) * jnp.exp(-v), axis=-1)


@pytree_dataclass
class Pulse(GroundMotion):
    r"""The near-fault velocity pulse of Mavroeidis and Papageorgiou (2003), in closed form.

    With :math:`s = t - t_0` and :math:`f = 1/T_p`, for :math:`|s| ≤ γ T_p / 2`,

    .. math:: u' = \frac{A}{2} \left(1 + \cos \frac{2 π f s}{γ}\right) \cos(2 π f s + ν),

    and rest before and after. The acceleration is continuous, at the ends too. Unless ν and γ make
    it vanish, there is a permanent displacement.

    Raises ``ValueError`` if a concrete value breaks its rule, or is no single number.

    Parameters
    ----------
    amplitude
        A, about the peak velocity: in m/s for a pulse in seconds, else in g/ω1.
    period, arrival
        T_p > 0, the pulse's prevailing period, and t0, the instant of its centre.
    phase, cycles
        ν, rad, 0 for a symmetric velocity and π/2 for an antisymmetric one; γ > 0, the duration in
        periods, usually 1 to 3.
    time_unit
        Unit of time, as of ``Record``: "1/ω1" or "s", which ``Scales.to_dimensionless`` converts.

    Examples
    --------
    >>> pulse = jp.Pulse(amplitude=0.8, period=1.5, arrival=3.0, cycles=1.5, time_unit="s")
    >>> round(float(pulse.acceleration(3.4)), 4)  # in g
    -0.2337
    """

    amplitude: Any = parameter("A", "velocity", "velocity amplitude", single=True)
    period: Any = parameter("T_p", "time", "period", above=0, single=True)
    arrival: Any = parameter("t_0", "time", "arrival", single=True)
    phase: Any = parameter(r"\nu", words="phase", single=True, default=0.0)
    cycles: Any = parameter(
        r"\gamma", words="duration in periods", above=0, single=True, default=2.0
    )
    time_unit: str = static(default=DIMENSIONLESS)

    def __post_init__(self) -> None:
        object.__setattr__(self, "time_unit", motion.time_unit_of(self.time_unit))
        check(self)

    @property
    def duration(self) -> Any:
        """Time at which it ends."""
        return self.arrival + self.cycles * self.period / 2

    def displacement(self, t: ArrayLike) -> jax.Array:
        """u(t), from rest, the exact integral of the velocity, of the shape of ``t``."""
        s, w = self._inside(t)
        start = -self.cycles * self.period / 2

        def integral(k: Any) -> Any:  # of cos(k s + ν)
            middle, half = (s + start) / 2, (s - start) / 2
            return 2 * half * jnp.cos(k * middle + self.phase) * jnp.sinc(k * half / jnp.pi)

        sides = integral(w - w / self.cycles) + integral(w + w / self.cycles)
        return self._size / 2 * (integral(w) + sides / 2)

    def velocity(self, t: ArrayLike) -> jax.Array:
        """u'(t), the integral of the acceleration in g, of the shape of ``t``."""
        s, w = self._inside(t)
        return self._size / 2 * (1 + jnp.cos(w * s / self.cycles)) * jnp.cos(w * s + self.phase)

    def acceleration(self, t: ArrayLike) -> jax.Array:
        """u''(t), in g, of the shape of ``t``."""
        s, w = self._inside(t)
        slow, fast = w * s / self.cycles, w * s + self.phase
        rising = jnp.sin(slow) * jnp.cos(fast) / self.cycles
        return -self._size * w / 2 * (rising + (1 + jnp.cos(slow)) * jnp.sin(fast))

    def unresolved(self, dt: float) -> list[str]:
        """A sentence if the pulse has too few steps of ``dt``."""
        moves = np.any(self.amplitude)
        return too_short("the period of a pulse", float(self.period), dt) if moves else []

    def energy(self, since: float) -> float:
        """About ∫ u''² dt if the centre is at or after ``since``, else 0."""
        size = 2 * np.pi * float(self._size) / float(self.period)
        whole = 3 / 16 * size**2 * float(self.cycles * self.period)
        return whole if float(self.arrival) >= since else 0.0

    def dimensionless(self, frequency: Any) -> Pulse:
        """The pulse, in seconds, in units of 1/ω1 for ω1 = ``frequency`` in rad/s."""
        motion.require_seconds("pulse", self)
        times = self.period * frequency, self.arrival * frequency
        return Pulse(self._size * frequency, *times, self.phase, self.cycles, DIMENSIONLESS)

    def _later(self, delay: Any) -> Pulse:
        return dataclasses.replace(self, arrival=self.arrival + delay)

    @property
    def _size(self) -> Any:
        """Amplitude in g times the unit of time."""
        return self.amplitude / (STANDARD_GRAVITY if self.time_unit == SECONDS else 1.0)

    def _inside(self, t: ArrayLike) -> tuple[Any, Any]:
        """Time from the centre, held at the ends of the pulse, where it vanishes; 2π/T_p."""
        end = self.cycles * self.period / 2
        return larger(smaller(jnp.asarray(t) - self.arrival, end), -end), 2 * jnp.pi / self.period
