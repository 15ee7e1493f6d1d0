"""White noise through a filter, the ground as an oscillator that the bedrock shakes; envelopes."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.signal import fftconvolve
from jaxtyping import Array, ArrayLike, Float

from jaxpound._checks import Rule
from jaxpound._extrema import larger, smaller
from jaxpound._fields import like, parameter, pytree_dataclass

_PLACES = 8  # in each interval of samples, where impulse responses are integrated


@runtime_checkable
class Filter(Protocol):
    """The interface of a filter of ``FilteredNoise``: its impulse response."""

    def impulse_response(self, t: Any) -> Any:
        """Output at t ≥ 0 for a unit impulse at t = 0, of the shape of ``t``."""


@pytree_dataclass
class KanaiTajimi:
    r"""The filter of Kanai (1957) and Tajimi (1960): soil as an oscillator on shaking bedrock.

    Its output is the absolute acceleration of an oscillator whose support is accelerated. The
    transfer function is :math:`(ω_g^2 + 2 i ζ_g ω_g ω) / (ω_g^2 - ω^2 + 2 i ζ_g ω_g ω)`.

    ``frequency`` is ω_g > 0, the ground's circular frequency in radians per unit of time, and
    ``damping`` its damping ratio ζ_g, between 0 and 1, both excluded.

    Examples
    --------
    >>> firm = jp.KanaiTajimi(frequency=15.6, damping=0.6)  # rad/s, for firm soil
    >>> round(float(firm.gain(15.6)), 4)  # at its own frequency
    1.3017
    """

    frequency: Any = parameter(r"\omega_g", words="frequency of the ground", above=0)
    damping: Any = parameter(r"\zeta_g", words="damping ratio of the ground", above=0, below=1)

    def impulse_response(self, t: ArrayLike) -> jax.Array:
        """h(t) at t ≥ 0, of the shape of ``t``."""
        w, zeta, t = self.frequency, self.damping, jnp.asarray(t)
        damped = w * jnp.sqrt(1 - zeta**2)
        sine = (w**2 - 2 * (zeta * w) ** 2) / damped
        wave = 2 * zeta * w * jnp.cos(damped * t) + sine * jnp.sin(damped * t)
        return jnp.exp(-zeta * w * t) * wave

    def gain(self, frequency: ArrayLike) -> jax.Array:
        """|H(ω)|, amplification of a harmonic vibration of circular frequency ω."""
        share, zeta = jnp.asarray(frequency) / self.frequency, self.damping
        through = (2 * zeta * share) ** 2
        return jnp.sqrt((1 + through) / ((1 - share**2) ** 2 + through))


@pytree_dataclass
class CloughPenzien:
    r"""Kanai and Tajimi's filter, then a high-pass filter.

    The latter prevents drift of velocity and displacement. Clough and Penzien (1975) multiply the
    transfer function of ``KanaiTajimi``, whose ``frequency`` ω_g and ``damping`` ζ_g these are, by
    :math:`-ω^2 / (ω_f^2 - ω^2 + 2 i ζ_f ω_f ω)`. ``high_pass`` is ω_f > 0, the circular frequency
    of the second filter, below ω_g, usually a tenth of it, and ``high_pass_damping`` its damping
    ratio ζ_f, between 0 and 1, both excluded.

    Examples
    --------
    >>> firm = jp.ground.CloughPenzien(15.6, 0.6, high_pass=1.5, high_pass_damping=0.6)  # rad/s
    >>> float(firm.gain(0.0)), round(float(firm.gain(15.6)), 3)
    (0.0, 1.305)
    """

    frequency: Any = like(KanaiTajimi, "frequency")
    damping: Any = like(KanaiTajimi, "damping")
    high_pass: Any = parameter(r"\omega_f", words="frequency of the high-pass filter", above=0)
    high_pass_damping: Any = parameter(
        r"\zeta_f", words="damping ratio of the high-pass filter", above=0, below=1, default=0.6
    )

    def more_rules(self, prefix: str) -> list[Rule]:
        """The second filter is below the first."""
        low = f"below frequency = {self.frequency}"
        return [Rule(f"{prefix}high_pass", self.high_pass, self.high_pass < self.frequency, low)]

    def impulse_response(self, t: ArrayLike) -> jax.Array:
        """h(t) at t ≥ 0, of the shape of ``t``, from the poles of the transfer function."""
        t = jnp.asarray(t)
        ground = _pole(self.frequency, self.damping)
        second = _pole(self.high_pass, self.high_pass_damping)
        through = 2 * self.damping * self.frequency, self.frequency**2

        def part(pole: Any, other: Any) -> Any:
            numerator = pole**2 * (through[0] * pole + through[1])
            separation = (pole - other) * (pole - jnp.conj(other))
            residue = numerator / (2j * pole.imag * separation)
            return 2 * jnp.exp(pole.real * t) * (residue * turned(pole.imag * t)).real

        return part(ground, second) + part(second, ground)

    def gain(self, frequency: ArrayLike) -> jax.Array:
        """|H(ω)|, amplification of a harmonic vibration of circular frequency ω."""
        ground = KanaiTajimi(self.frequency, self.damping).gain(frequency)
        share, zeta = jnp.asarray(frequency) / self.high_pass, self.high_pass_damping
        return ground * share**2 / jnp.sqrt((1 - share**2) ** 2 + (2 * zeta * share) ** 2)


def _pole(w: Any, zeta: Any) -> Any:
    return jax.lax.complex(*jnp.broadcast_arrays(-zeta * w * 1.0, w * jnp.sqrt(1 - zeta**2)))


@pytree_dataclass
class GammaEnvelope:
    r"""A gamma function of time with peak 1: :math:`q = (τ e^{1 - τ})^p`, with τ = t / peak.

    Zero before t = 0. ``peak`` > 0 is the instant of the peak, and ``power`` p > 0: the larger, the
    shorter.

    Examples
    --------
    >>> [round(float(jp.GammaEnvelope(peak=5.0, power=2.0)(t)), 4) for t in (0.0, 5.0, 20.0)]
    [0.0, 1.0, 0.0397]
    """

    peak: Any = parameter("t_p", "time", "instant of the peak", above=0)
    power: Any = parameter("p", words="power", above=0)

    def __call__(self, t: ArrayLike) -> jax.Array:
        """q(t), of the shape of ``t``."""
        share = jnp.asarray(t) / self.peak
        inside = share > 0
        share = jnp.where(inside, share, 1.0)
        return jnp.where(inside, jnp.exp(self.power * (jnp.log(share) + 1 - share)), 0.0)


@pytree_dataclass
class PlateauEnvelope:
    r"""A quadratic rise, a plateau of height 1, and an exponential decay (Amin and Ang 1968).

    :math:`(t / t_1)^2` up to t1, 1 up to t2, then :math:`e^{-c (t - t_2)}`; zero before t = 0. The
    artificial earthquakes of Jennings, Housner and Tsai (1968) have this envelope.

    ``rise`` is t1 > 0 and ``end`` t2 > t1, begin and end of the plateau; ``decay`` is c > 0, in one
    over the unit of time.

    Examples
    --------
    >>> envelope = jp.ground.PlateauEnvelope(rise=4.0, end=15.0, decay=0.3)
    >>> [round(float(envelope(t)), 4) for t in (2.0, 10.0, 20.0)]
    [0.25, 1.0, 0.2231]
    """

    rise: Any = parameter("t_1", "time", "end of the rise", above=0)
    end: Any = parameter("t_2", "time", "end of the plateau", above="rise")
    decay: Any = parameter("c", words="decay", above=0)

    def __call__(self, t: ArrayLike) -> jax.Array:
        """q(t), of the shape of ``t``."""
        t = jnp.asarray(t)
        rising = larger(smaller(t / self.rise, 1.0), 0.0) ** 2
        return rising * jnp.exp(-self.decay * larger(t - self.end, 0.0))


def turned(angle: Any) -> Any:
    """e^(i·angle)."""
    return jax.lax.complex(jnp.cos(angle), jnp.sin(angle))


def causal(kernel: Any, x: Float[Array, " n"]) -> Float[Array, " n"]:
    """Σ_{k ≤ j} kernel_{j−k} x_k, shape (n,), in O(n log n) by Fourier transforms."""
    return fftconvolve(kernel, x)[: x.shape[-1]].astype(x.dtype)


def filtered(
    filter: Filter, z: Float[Array, " n"], dt: Any, spectral_density: Any = None
) -> Float[Array, " n"]:
    """Samples of white noise through a filter, of constant standard deviation, shape (n,).

    They are linear in the independent standard normal numbers z, impulses at the instants j·dt. The
    straight lines between them have the power spectral density of the filtered noise, to 0.2 % up
    to 0.2 of the highest frequency π/dt. ``spectral_density`` is that of ``FilteredNoise``; None
    makes the variance of the filtered noise, which is continuous in time, 1.
    """
    kernel, power = _of_straight_lines(filter, z.shape[-1], dt, z.dtype)
    density = 1 / power if spectral_density is None else 2 * np.pi * spectral_density
    variances = jnp.cumsum(kernel**2)
    noise = unit_variance(causal(kernel, z), variances)
    return (noise * jnp.sqrt(density * dt * variances[-1])).astype(z.dtype)


def _of_straight_lines(
    filter: Filter, n: int, dt: Any, dtype: Any
) -> tuple[Float[Array, " n"], Float[Array, ""]]:
    """Samples at j·dt of the response to an impulse, shape (n,), and ∫ h² dt of the response h.

    The polygon that fits h in least squares neither aliases nor attenuates high frequencies. Its
    samples are ∫ h φ_j dt, with the triangle φ_j of unit area around j·dt, corrected for the
    overlap of the triangles, (2 + cos ω dt) / 3 in the frequency domain, by the causal filter of
    this gain, as the phases of a noise are arbitrary.
    """
    place = (np.arange(_PLACES) + 0.5) / _PLACES
    instants = (np.arange(n)[:, None] + place).astype(dtype) * dt
    h = jnp.asarray(filter.impulse_response(instants), dtype)
    later, earlier = h @ (1 - place).astype(dtype), h @ place.astype(dtype)
    means = (later + jnp.pad(earlier[:-1], (1, 0))) / _PLACES
    root, k = 2 - np.sqrt(3), np.arange(n)
    overlap = 6 * root * (k + 1) * (-root) ** k
    return causal(overlap.astype(dtype), means), jnp.sum(h**2) * dt / _PLACES


def unit_variance(x: Any, variance: Any) -> Any:
    """Numbers over their standard deviations; 0 where the variance is."""
    positive = variance > 0
    return jnp.where(positive, x / jnp.sqrt(jnp.where(positive, variance, 1.0)), 0.0)
