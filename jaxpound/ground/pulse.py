"""Velocity pulses of earthquakes near their fault."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from jaxpound._extrema import larger, smaller
from jaxpound._fields import check, parameter, pytree_dataclass, static
from jaxpound.ground import motion
from jaxpound.ground.motion import DIMENSIONLESS, SECONDS, GroundMotion
from jaxpound.ground.ricker import too_short
from jaxpound.quantities import STANDARD_GRAVITY


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
        Unit of time: "1/ω1" (also spelled "1/omega1"), that of the dimensionless model, or "s";
        ``Scales.to_dimensionless`` converts a pulse in seconds.

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
        object.__setattr__(self, "time_unit", motion.time_unit_of("Pulse", self.time_unit))
        check(self)

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
        motion.require_seconds("Pulse.dimensionless: pulse", self)
        times = self.period * frequency, self.arrival * frequency
        return Pulse(self._size * frequency, *times, self.phase, self.cycles, DIMENSIONLESS)

    @property
    def _size(self) -> Any:
        """Amplitude in g times the unit of time."""
        return self.amplitude / (STANDARD_GRAVITY if self.time_unit == SECONDS else 1.0)

    def _inside(self, t: ArrayLike) -> tuple[Any, Any]:
        """Time from the centre, held at the ends of the pulse, where it vanishes; 2π/T_p."""
        end = self.cycles * self.period / 2
        return larger(smaller(jnp.asarray(t) - self.arrival, end), -end), 2 * jnp.pi / self.period
