"""Random ground motions of filtered white noise."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxpound import _checks
from jaxpound._errors import InvalidInput
from jaxpound._fields import Checked, parameter, part
from jaxpound.ground.evolving import evolving_noise, high_passed, modulation
from jaxpound.ground.motion import DIMENSIONLESS, SECONDS, time_unit_of
from jaxpound.ground.noise import Filter, filtered
from jaxpound.ground.record import Record, derived
from jaxpound.scenarios.distributions import Distribution
from jaxpound.scenarios.ground_draw import GroundDraw
from jaxpound.scenarios.scenarios import NUMBER_BYTES


class NoiseDraw(Checked, GroundDraw):
    """Base class of noises: a standard normal number for each of at least two samples."""

    samples: int

    def __post_init__(self) -> None:
        super().__post_init__()
        _checks.require_memory("samples", self.samples, self.samples * NUMBER_BYTES)

    @property
    def dimension(self) -> int:
        """One number for each sample."""
        return self.samples

    def parameters(self, z: Float[Array, " d"]) -> dict[str, Any]:
        """The numbers of the noise, by name."""
        return {f"noise_{i + 1}": x for i, x in enumerate(z)}

    def _reals(self, z: Any, dimension: int) -> Array:
        """Standard normal numbers as floats; an ``InvalidInput`` for another shape."""
        z = jnp.asarray(_checks.real("z", z))
        if z.shape != (dimension,):
            rule = f"of shape {z.shape} must be of shape ({dimension},)"
            raise InvalidInput("z", "", rule)
        return z.astype(jnp.result_type(float, z))


@dataclasses.dataclass(frozen=True)
class FilteredNoise(NoiseDraw):
    r"""White noise through a filter, times an envelope: a random ground motion.

    The samples of the record that is drawn are, at t_j = j·dt,

    .. math:: u''_j = I\, q(t_j)\, σ \frac{\sum_{k \le j} c_{j - k}\, z_k}
        {\left(\sum_{k \le j} c_{j - k}^2\right)^{1/2}}

    with the envelope q and the intensity I, linear in the standard normal numbers z_k, one for each
    sample, and joined by straight lines, as in every ``Record``. The weights c_k are the samples of
    the polygon that is nearest, in least squares, to the filter's impulse response: up to 0.3 of
    the highest frequency π/dt the polygon has the power spectral density of the process in
    continuous time, :math:`S_0 |H(ω)|^2`, to 1 % (up to 3 ω_g if dt is a twentieth of 2π/ω_g). The
    standard deviation is I q σ from the first instant on; σ, that of the samples for a process of
    standard deviation 1, is then 0.99 to 1.01.

    The parameters' names are ``noise_1`` to ``noise_n``, and ``intensity`` if it is random. Raises
    ``ValueError`` if an argument breaks its rule, or the memory has no room for the samples.

    Parameters
    ----------
    filter, envelope
        ``KanaiTajimi``, ``CloughPenzien``, or another object with ``impulse_response(t)``; q:
        ``GammaEnvelope``, ``PlateauEnvelope`` or a traceable function of t, 1 by default.
    samples, dt, time_unit
        Number n of samples, at least 2, and their interval > 0, in the unit of time of filter and
        envelope, too: "1/ω1" (also spelled "1/omega1") or "s".
    intensity
        I ≥ 0, the standard deviation where q is 1, in g; or its distribution, which takes one more
        standard normal number, the last. With a ``spectral_density`` a factor of the motion.
    spectral_density
        S0 > 0 of the white noise, two-sided over circular frequency, in g² times the unit of time,
        per radian: for S0 in m²/s³, S0/9.80665². The variance where q is 1 is then
        :math:`I^2 \int S_0 |H(ω)|^2 dω` over all ω; of ``KanaiTajimi``,
        :math:`π S_0 ω_g (1 + 4 ζ_g^2) / (2 ζ_g)`. None for a variance of I².
    high_pass
        Frequency > 0, in cycles per unit of time, of a critically damped oscillator whose
        acceleration is the final motion, as in ``NonstationaryNoise``; None for no such filter. The
        envelope is applied after the first filter: even noise of ``CloughPenzien`` ends metres away
        and with a velocity, on which motion relative to the ground does not depend. Where
        displacements of the ground itself matter, ``high_pass`` (0.1 Hz, say) returns both to zero
        within one or two of its periods after the shaking, for which there must be samples.

    Examples
    --------
    White noise of 0.01 m²/s³ through firm soil, whose record ends at rest:

    >>> soil = jp.ground.CloughPenzien(15.6, 0.6, high_pass=1.5)
    >>> envelope = jp.ground.PlateauEnvelope(rise=2.0, end=10.0, decay=0.5)
    >>> density = 0.01 / jp.STANDARD_GRAVITY**2
    >>> noise = jp.FilteredNoise(
    ...     soil, 1500, 0.02, envelope, time_unit="s", spectral_density=density, high_pass=0.1
    ... )
    >>> noise.draw(np.sin(np.arange(1500) ** 1.5))
    Record(1500 samples, dt = 0.02 s, duration 29.98 s, peak 0.291 g)
    """

    filter: Filter = part(Filter)
    samples: int = parameter(whole=True, least=2)
    dt: float = parameter(above=0, single=True)
    envelope: Callable[[Any], Any] | None = None
    intensity: Any = 1.0
    time_unit: str = DIMENSIONLESS
    spectral_density: Any = parameter(above=0, single=True, optional=True, default=None)
    high_pass: float | None = parameter(above=0, single=True, optional=True, default=None)

    def __post_init__(self) -> None:
        envelope = self.envelope
        if isinstance(envelope, type) or not (envelope is None or callable(envelope)):
            raise InvalidInput("envelope", repr(envelope), "must be a function of t")
        if not isinstance(self.intensity, Distribution):
            value = _checks.number("intensity", self.intensity)
            _checks.not_negative(intensity=value)
            object.__setattr__(self, "intensity", value)
        object.__setattr__(self, "time_unit", time_unit_of(self.time_unit))
        super().__post_init__()

    @property
    def dimension(self) -> int:
        """One number for each sample, and one for a random intensity."""
        return self.samples + isinstance(self.intensity, Distribution)

    def draw(self, z: Float[Array, " d"]) -> Record:
        """The record drawn by z."""
        z = self._reals(z, self.dimension)
        samples = filtered(self.filter, z[: self.samples], self.dt, self.spectral_density)
        if self.envelope is not None:
            samples = samples * self.envelope(np.arange(self.samples, dtype=z.dtype) * self.dt)
        if self.high_pass is not None:
            samples = high_passed(samples, self.dt, self.high_pass)
        return derived(self._intensity(z) * samples, self.dt, time_unit=self.time_unit)

    def parameters(self, z: Float[Array, " d"]) -> dict[str, Any]:
        """The numbers of the noise, and the intensity, if random."""
        intensity = {"intensity": self._intensity(z)} if len(z) > self.samples else {}
        return super().parameters(z[: self.samples]) | intensity

    def _intensity(self, z: Any) -> Any:
        random = isinstance(self.intensity, Distribution)
        return self.intensity.from_normal(z[-1]) if random else self.intensity


@dataclasses.dataclass(frozen=True)
class NonstationaryNoise(NoiseDraw):
    """The site-based ground motion of Rezaeian and Der Kiureghian (2010), of fixed parameters.

    White noise passes an oscillator whose frequency changes linearly, is scaled to unit variance,
    and is multiplied by a gamma function of time. The motion is the acceleration of a critically
    damped oscillator under this noise, so that velocity and displacement return to zero. It is
    linear in one standard normal number for each sample. ``SiteBasedNoise`` draws the six
    parameters for an earthquake and a site, too. Raises ``ValueError`` as ``FilteredNoise``.

    Parameters
    ----------
    arias_intensity
        Expected (π/2) ∫ u''² dt > 0 before the high-pass filter, u'' in g: in g s.
    duration, mid_time
        D5-95 > 0, the time in which the expected Arias intensity grows from 5 % to 95 %, s; t_mid >
        0, the time at which 45 % of it are reached, s. Above 4.92 times ``mid_time`` the modulating
        function follows the mid-time alone.
    frequency, frequency_slope, damping
        Frequency of the filter at ``mid_time``, ω_mid/2π > 0, Hz; its rate of change ω'/2π, Hz/s
        (it stays at or above 0.3 Hz); and its ζ_f, between 0 and 1, both excluded.
    samples, dt, high_pass
        Number n of samples, at least 2, and their interval > 0, s; n·dt should be two or three
        times mid-time and duration. Frequency of the critically damped oscillator > 0, Hz; None for
        no high-pass filter.

    Examples
    --------
    >>> times = {"duration": 12.0, "mid_time": 8.0, "samples": 1500, "dt": 0.02}
    >>> noise = jp.scenarios.NonstationaryNoise(
    ...     arias_intensity=0.05, frequency=5.0, frequency_slope=-0.1, damping=0.2, **times
    ... )
    >>> noise.draw(np.zeros(1500)).time_unit  # scales.to_dimensionless(noise) for scenarios
    's'
    """

    arias_intensity: Any = parameter("I_a", words="Arias intensity", above=0, single=True)
    duration: Any = parameter("D_{5-95}", words="duration", above=0, single=True)
    mid_time: Any = parameter(r"t_{mid}", words="mid-time", above=0, single=True)
    frequency: Any = parameter(r"\omega_{mid}", words="frequency", above=0, single=True)
    frequency_slope: Any = parameter(r"\omega'", words="rate of frequency", single=True)
    damping: Any = parameter(r"\zeta_f", words="damping ratio", above=0, below=1, single=True)
    samples: int = parameter(whole=True, least=2)
    dt: float = parameter(above=0, single=True)
    high_pass: float | None = parameter(above=0, single=True, optional=True, default=0.1)
    time_unit = SECONDS

    def draw(self, z: Float[Array, " d"]) -> Record:
        """The record drawn by z, in g and seconds."""
        z = self._reals(z, self.dimension)
        oscillator = self.frequency, self.frequency_slope, self.mid_time, self.damping
        noise = evolving_noise(z, self.dt, *oscillator)
        t = np.arange(self.samples, dtype=z.dtype) * self.dt
        samples = noise * modulation(t, self.arias_intensity, self.duration, self.mid_time)
        if self.high_pass is not None:
            samples = high_passed(samples, self.dt, self.high_pass)
        return derived(samples, self.dt)
