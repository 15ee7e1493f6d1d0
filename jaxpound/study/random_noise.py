"""Random ground motions of filtered white noise."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxpound._checks import Rule, count, enforce, finite, number, positive, real, require_memory
from jaxpound._fields import Checked, parameter, part
from jaxpound.ground.evolving import evolving_noise, high_passed, modulation
from jaxpound.ground.motion import DIMENSIONLESS, SECONDS, known_unit
from jaxpound.ground.noise import Filter, filtered
from jaxpound.ground.record import Record, derived
from jaxpound.study.distributions import Distribution
from jaxpound.study.ground_draw import GroundDraw
from jaxpound.study.scenarios import NUMBER_BYTES


@dataclasses.dataclass(frozen=True)
class FilteredNoise(Checked, GroundDraw):
    r"""White noise through a filter, times an envelope: a random ground motion.

    The samples of the record that is drawn are, at t_j = j·dt,

    .. math:: u''_j = I\, q(t_j)\, σ \frac{\sum_{k \le j} c_{j - k}\, z_k}
        {\left(\sum_{k \le j} c_{j - k}^2\right)^{1/2}}

    with the envelope q and the intensity I. They are linear in the standard normal numbers z_k, one
    for each sample, and straight lines join them, as those of every ``Record``: so the steps of a
    run need not be finer than dt. With the weights c_k the straight lines, not the samples, have
    the spectrum of the filter: by its gain, they are the samples of the polygon that is nearest, in
    least squares, to its impulse response. Up to 0.3 of the highest frequency π/dt the power
    spectral density is that of the process in continuous time, :math:`S_0 |H(ω)|^2`, to 1 %: up to
    3 ω_g, where dt is a twentieth of 2π/ω_g. Nothing vibrates faster than π/dt. The standard
    deviation I q σ holds from the first instant on; σ, that of the samples where the process has 1,
    is 0.99 to 1.01 there.

    Parameters
    ----------
    filter
        ``KanaiTajimi``, ``CloughPenzien``, or another object with ``impulse_response(t)``.
    samples
        Number n of samples, at least 2.
    dt
        Their interval > 0, in the unit of time.
    envelope
        q: ``GammaEnvelope``, ``PlateauEnvelope`` or a traceable function of t; 1 by default, for
        stationary noise that starts and ends abruptly.
    intensity
        I ≥ 0, the standard deviation where q is 1, in g; or its distribution, which takes one more
        standard normal number, the last. A factor of the motion if there is a
        ``spectral_density``.
    time_unit
        Unit of time of filter, envelope and dt: "1/ω1" (also spelled "1/omega1") or "s". Scenarios
        take the first; ``Scales.to_dimensionless`` makes it of the second.
    spectral_density
        S0 > 0 of the white noise, two-sided over circular frequency, in g² times the unit of time,
        per radian: for S0 in m²/s³, S0/9.80665². The variance where q is 1 is then
        :math:`I^2 \int S_0 |H(ω)|^2 dω` over all ω; of ``KanaiTajimi``,
        :math:`π S_0 ω_g (1 + 4 ζ_g^2) / (2 ζ_g)`. None for a variance of I².
    high_pass
        Frequency > 0, in cycles per unit of time, of a critically damped oscillator through whose
        acceleration the motion goes at last, as that of ``NonstationaryNoise``; None for none.

    Raises
    ------
    ValueError
        If an argument breaks its rule, or there are more samples than the memory has room for.

    Notes
    -----
    The parameters' names are ``noise_1`` to ``noise_n``, and ``intensity`` if it is random. By
    Fourier transforms, the samples cost O(n log n).

    The envelope comes after the filter: noise of ``CloughPenzien``, too, ends metres away and with
    a velocity. What moves relative to the ground does not notice. Where displacements of the ground
    itself matter, ``high_pass`` (0.1 Hz, say) returns both to zero, within one or two of its
    periods after the shaking, for which there must be samples.

    Examples
    --------
    >>> noise = jp.FilteredNoise(
    ...     jp.KanaiTajimi(frequency=2.0, damping=0.6),
    ...     samples=500,
    ...     dt=0.04,
    ...     envelope=jp.GammaEnvelope(peak=5.0, power=2.0),
    ...     intensity=0.3,
    ... )
    >>> scenarios = jp.Scenarios(jp.paper.structures(), noise)
    >>> scenarios.dimension
    500
    >>> noise.draw(3 * np.sin(0.06 * np.arange(500)))
    Record(500 samples, dt = 0.04 1/ω1, duration 19.96 1/ω1, peak 4.204 g)

    White noise of 0.01 m²/s³ through firm soil, and the record that it draws back at rest:

    >>> noise = jp.FilteredNoise(
    ...     jp.CloughPenzien(15.6, 0.6, high_pass=1.5),
    ...     samples=1500,
    ...     dt=0.02,
    ...     envelope=jp.PlateauEnvelope(rise=2.0, end=10.0, decay=0.5),
    ...     time_unit="s",
    ...     spectral_density=0.01 / jp.STANDARD_GRAVITY**2,
    ...     high_pass=0.1,
    ... )
    >>> noise.draw(np.sin(np.arange(1500) ** 1.5))
    Record(1500 samples, dt = 0.02 s, duration 29.98 s, peak 0.291 g)
    """

    filter: Filter = part(Filter)
    samples: int = part(int)
    dt: float = parameter(above=0, single=True)
    envelope: Callable[[Any], Any] | None = None
    intensity: Any = 1.0
    time_unit: str = DIMENSIONLESS
    spectral_density: Any = None
    high_pass: float | None = None

    def __post_init__(self) -> None:
        owner = "FilteredNoise"
        object.__setattr__(self, "samples", known_samples(owner, self.samples))
        envelope = self.envelope
        if isinstance(envelope, type) or not (envelope is None or callable(envelope)):
            raise ValueError(f"{owner}: envelope = {envelope!r} must be a function of t")
        if not isinstance(self.intensity, Distribution):
            intensity = number(owner, "intensity", self.intensity)
            holds = (intensity >= 0) & finite(intensity)
            enforce(owner, [Rule("intensity", intensity, holds, "finite and not negative")])
            object.__setattr__(self, "intensity", intensity)
        object.__setattr__(self, "time_unit", known_unit(owner, self.time_unit))
        require_positive(owner, "spectral_density", self.spectral_density)
        require_positive(owner, "high_pass", self.high_pass)
        super().__post_init__()

    @property
    def dimension(self) -> int:
        """One number for each sample, and one for a random intensity."""
        return self.samples + isinstance(self.intensity, Distribution)

    def draw(self, z: Float[Array, " d"]) -> Record:
        """The record drawn by z."""
        z = reals("FilteredNoise", z, self.dimension)
        samples = filtered(self.filter, z[: self.samples], self.dt, self.spectral_density)
        if self.envelope is not None:
            samples = samples * self.envelope(np.arange(self.samples, dtype=z.dtype) * self.dt)
        if self.high_pass is not None:
            samples = high_passed(samples, self.dt, self.high_pass)
        return derived(self._intensity(z) * samples, self.dt, time_unit=self.time_unit)

    def parameters(self, z: Float[Array, " d"]) -> dict[str, Any]:
        """The numbers of the noise, and the intensity, if random."""
        found = numbered(z[: self.samples])
        return found | ({"intensity": self._intensity(z)} if len(z) > self.samples else {})

    def _intensity(self, z: Any) -> Any:
        random = isinstance(self.intensity, Distribution)
        return self.intensity.from_normal(z[-1]) if random else self.intensity


@dataclasses.dataclass(frozen=True)
class NonstationaryNoise(Checked, GroundDraw):
    """The site-based ground motion of Rezaeian and Der Kiureghian (2010), of given parameters.

    White noise through an oscillator whose frequency changes linearly, of unit variance, times a
    modulating function that is a gamma function of time; then a critically damped oscillator, of
    whose acceleration the motion consists, takes out the lowest frequencies, so that velocity and
    displacement return to zero. Linear in one standard normal number for each sample.

    Parameters
    ----------
    arias_intensity
        Expected (π/2) ∫ u''² dt > 0 before the high-pass filter, u'' in g: in g s.
    duration
        D5-95 > 0, the time in which the expected Arias intensity grows from 5 % to 95 %, s. Above
        4.92 times ``mid_time`` the modulating function keeps to the mid-time alone.
    mid_time
        t_mid > 0, when 45 % of it are reached, s.
    frequency
        Frequency of the filter at ``mid_time``, ω_mid/2π > 0, Hz.
    frequency_slope
        Its rate of change ω'/2π, Hz/s. The frequency does not fall below 0.3 Hz.
    damping
        ζ_f of the filter, between 0 and 1, both excluded.
    samples
        Number n of samples, at least 2; n·dt should be two or three times mid-time and duration.
    dt
        Their interval > 0, s.
    high_pass
        Frequency of the critically damped oscillator > 0, Hz; None for no high-pass filter.

    Raises
    ------
    ValueError
        If an argument breaks its rule, or there are more samples than the memory has room for.

    See Also
    --------
    SiteBasedNoise : Draws the six parameters for an earthquake and a site, too.

    Examples
    --------
    >>> noise = jp.NonstationaryNoise(
    ...     arias_intensity=0.05,
    ...     duration=12.0,
    ...     mid_time=8.0,
    ...     frequency=5.0,
    ...     frequency_slope=-0.1,
    ...     damping=0.2,
    ...     samples=1500,
    ...     dt=0.02,
    ... )
    >>> noise.draw(np.zeros(1500)).time_unit  # scales.to_dimensionless(noise) for scenarios
    's'
    """

    arias_intensity: Any = parameter("I_a", words="Arias intensity", above=0, single=True)
    duration: Any = parameter("D_{5-95}", words="duration", above=0, single=True)
    mid_time: Any = parameter(r"t_{mid}", words="mid-time", above=0, single=True)
    frequency: Any = parameter(r"\omega_{mid}", words="frequency", above=0, single=True)
    frequency_slope: Any = parameter(r"\omega'", words="rate of frequency", single=True)
    damping: Any = parameter(r"\zeta_f", words="damping ratio", above=0, most=1, single=True)
    samples: int = part(int)
    dt: float = parameter(above=0, single=True)
    high_pass: float | None = 0.1
    time_unit = SECONDS

    def __post_init__(self) -> None:
        owner = "NonstationaryNoise"
        object.__setattr__(self, "samples", known_samples(owner, self.samples))
        require_positive(owner, "high_pass", self.high_pass)
        super().__post_init__()
        below = Rule("damping", self.damping, self.damping < 1, "below 1")
        enforce(owner, [below])

    @property
    def dimension(self) -> int:
        """One number for each sample."""
        return self.samples

    def draw(self, z: Float[Array, " d"]) -> Record:
        """The record drawn by z, in g and seconds."""
        z = reals("NonstationaryNoise", z, self.dimension)
        noise = evolving_noise(
            z, self.dt, self.frequency, self.frequency_slope, self.mid_time, self.damping
        )
        t = np.arange(self.samples, dtype=z.dtype) * self.dt
        samples = noise * modulation(t, self.arias_intensity, self.duration, self.mid_time)
        if self.high_pass is not None:
            samples = high_passed(samples, self.dt, self.high_pass)
        return derived(samples, self.dt)

    def parameters(self, z: Float[Array, " d"]) -> dict[str, Any]:
        """The numbers of the noise."""
        return numbered(z)


def numbered(z: Any) -> dict[str, Any]:
    """The numbers of a noise by name."""
    return {f"noise_{i + 1}": x for i, x in enumerate(z)}


def reals(owner: str, z: Any, dimension: int) -> Array:
    """Standard normal numbers as an array of floats, which keep their precision.

    Raises
    ------
    ValueError
        If they are of another shape than (dimension,).
    """
    z = jnp.asarray(real(owner, "z", z))
    if z.shape != (dimension,):
        raise ValueError(f"{owner}: z of shape {z.shape} must be of shape ({dimension},)")
    return z.astype(jnp.result_type(float, z))


def known_samples(owner: str, samples: Any) -> int:
    """A number of samples; a ``ValueError`` if it is no count, too small or too large."""
    n = count(owner, "samples", samples)
    enforce(owner, [Rule("samples", n, np.asarray(n >= 2), "at least 2")])
    require_memory(owner, "samples", n, n * NUMBER_BYTES)
    return n


def require_positive(owner: str, name: str, value: Any) -> None:
    """A ``ValueError`` for a value that is neither a positive number nor None."""
    if value is not None:
        positive(owner, **{name: number(owner, name, value)})
