r"""White noise through a filter, the ground as an oscillator that the bedrock shakes; envelopes.

Noise of changing intensity and frequency is the site-based model of Rezaeian and Der Kiureghian
(2008, 2010): white noise through an oscillator whose frequency changes linearly, scaled to unit
variance, times a modulating function; then a high-pass filter.

The response to an impulse keeps the frequency ω_k of the oscillator at the impulse, so that the sum
over impulses is no convolution. But as ω_k is linear in time, with centred times τ,

.. math:: ω_k (τ_i - τ_k) = ω_c s - ω' s^2 / 2 + ω' (τ_i^2 - τ_k^2) / 2, \qquad s = τ_i - τ_k,

so that the oscillation is a convolution between two factors of modulus 1 (a chirp transform). Its
decay :math:`e^{-ζ ω_k s}` is interpolated in ln ω_k between ``NODES`` values, with a convolution
for each. For damping ratios from .02 to .8 the error is 1e-8 of the standard deviation if the
frequency changes by a factor of 3 during the motion, 1e-5 for a factor of 10, 2e-4 for 20.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.signal import fftconvolve
from jax.scipy.special import gammaln
from jaxtyping import Array, ArrayLike, Float
from numpy.polynomial import Chebyshev
from numpy.polynomial.chebyshev import chebval, chebvander
from scipy.fft import next_fast_len
from scipy.special import gammaincinv

from jaxpound._checks import Rule
from jaxpound._extrema import larger, smaller
from jaxpound._fields import like, parameter, pytree_dataclass

NODES = 12  # frequencies between which the decay of the oscillations is interpolated
LOWEST = 0.3  # lower bound of the frequency of the filter, Hz
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
            return 2 * jnp.exp(pole.real * t) * (residue * jnp.exp(1j * pole.imag * t)).real

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


@jax.jit
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


@jax.jit
def unit_variance(x: Any, variance: Any) -> Any:
    """Numbers over their standard deviations; 0 where the variance is."""
    positive = variance > 0
    return jnp.where(positive, x / jnp.sqrt(jnp.where(positive, variance, 1.0)), 0.0)


@jax.jit
def modulation(t: Any, arias: Any, duration: Any, mid_time: Any) -> Any:
    """The modulating function q(t | α) ≥ 0 of this Arias intensity, duration and mid-time.

    q² is in proportion to a gamma density. (π/2) ∫ q² dt is the Arias intensity; it grows from 5 %
    to 95 % of its final value during ``duration`` and reaches 45 % at ``mid_time``. Bounded
    functions have durations up to 4.92 mid-times; a longer duration is reduced to that.
    """
    log_shape, log_middle = _shapes()
    x = jnp.log(jnp.asarray(duration) / mid_time)
    shape = jnp.exp(log_shape(larger(smaller(x, log_shape.high), log_shape.low)))
    scale = mid_time / (shape * jnp.exp(log_middle(jnp.log(shape))))
    share = jnp.asarray(t) / scale
    positive = share > 0
    share = jnp.where(positive, share, 1.0)
    density = jnp.exp((shape - 1) * jnp.log(share) - share - gammaln(shape)) / scale
    return jnp.where(positive, jnp.sqrt(2 / jnp.pi * arias * density), 0.0)


@jax.jit
def evolving_noise(
    z: Float[Array, " n"], dt: Any, frequency: Any, slope: Any, mid_time: Any, damping: Any
) -> Float[Array, " n"]:
    """White noise through a filter of changing frequency, of unit variance at every instant.

    Linear in the independent standard normal numbers z, shape (n,): impulses at the instants j·dt.
    0 at t = 0. The frequency of the filter is ``frequency`` in Hz at ``mid_time`` in s, changes by
    ``slope`` in Hz/s, and stays above ``LOWEST``; 0 < ``damping`` < 1 is its damping ratio.
    """
    n = z.shape[-1]
    tau = (np.arange(n, dtype=z.dtype) - (n - 1) / 2).astype(z.dtype) * dt
    rate = 2 * jnp.pi * slope
    centre = 2 * jnp.pi * (frequency + slope * ((n - 1) / 2 * dt - mid_time))
    lowest = 2 * math.pi * LOWEST
    w = centre + rate * tau
    falls, w = w < lowest, larger(w, jnp.full_like(w, lowest))
    across = jnp.sqrt(1 - jnp.asarray(damping, z.dtype) ** 2)
    size, s = w / across, tau - tau[0]
    inputs = jnp.stack([size * z, size**2])  # to the responses, and to their squares
    changing, held = jnp.where(falls[None], 0.0, inputs), jnp.where(falls[None], inputs, 0.0)
    around = jnp.exp(1j * across * rate * tau**2 / 2)
    phase = jnp.exp(1j * across * (centre * s - rate * s**2 / 2))
    total = _responses(changing, s, w, damping, around, phase)
    low = jnp.exp(-damping * lowest * s) * jnp.sin(across * lowest * s)
    noise, variance = total + jax.vmap(causal)(jnp.stack([low, low**2]), held)
    # At first there is no response to an impulse yet.
    return unit_variance(noise, jnp.where(np.arange(n) == 0, 0.0, variance))


@jax.jit
def high_passed(x: Float[Array, " n"], dt: Any, corner: Any) -> Float[Array, " n"]:
    """Acceleration of a critically damped oscillator, of frequency ``corner`` in Hz, driven by x.

    Exact for straight lines between the samples, shape (n,); velocity and displacement end at zero.
    """
    t = np.arange(-1, x.shape[-1] + 1, dtype=x.dtype) * dt
    lag = larger(t, jnp.zeros_like(t)) * jnp.exp(-2 * jnp.pi * corner * t)
    return causal((lag[2:] - 2 * lag[1:-1] + lag[:-2]) / dt, x)


def _responses(
    v: Float[Array, "2 n"], s: Any, w: Any, damping: Any, around: Any, phase: Any
) -> Float[Array, "2 n"]:
    """Sums over k ≤ i of v_k h and of v_k h², where h = e^(−ζ w_k s) sin(√(1 − ζ²) w_k s).

    sin² is (1 − cos)/2: a sum that oscillates twice as fast, and one that does not oscillate. Where
    v is 0, w may be any positive number. Of the impulses s are times from the first one and w the
    frequencies, shape (n,); ``around`` (by i and k) and ``phase`` (by s) are the factors of modulus
    1 of the oscillation.
    """
    n = v.shape[-1]
    size = next_fast_len(2 * n)
    x = jnp.log(w)
    middle, half = (x.max() + x.min()) / 2, (x.max() - x.min()) / 2
    varies = half > 1e-6
    u = jnp.where(varies, (x - middle) / jnp.where(varies, half, 1.0), 0.0)
    k = np.arange(NODES)
    places = np.cos(np.pi * (k + 0.5) / NODES)
    series = chebvander(places, NODES - 1).T * np.where(k == 0, 1, 2)[:, None] / NODES
    shares = chebval(u[None], series[..., None]).astype(w.dtype)
    squared = v[1] / 2
    waves = jnp.stack([v[0] * jnp.conj(around), squared * jnp.conj(around) ** 2])
    turns = jnp.stack([phase, phase**2])

    def add(totals: Any, node: Any) -> tuple[Any, None]:
        place, share = node
        decay = jnp.exp(-damping * jnp.exp(middle + half * place) * s)
        decays = jnp.stack([decay, decay**2])
        turning = jnp.fft.fft(decays * turns, size) * jnp.fft.fft(share[None] * waves, size)
        real = jnp.fft.rfft(jnp.stack([decays[1], share * squared]), size)
        return (totals[0] + turning, totals[1] + real[0] * real[1]), None

    start = jnp.zeros((2, size), waves.dtype), jnp.zeros(size // 2 + 1, waves.dtype)
    (turning, plain), _ = jax.lax.scan(add, start, (jnp.asarray(places, w.dtype), shares))
    wave, double = jnp.fft.ifft(turning)[:, :n] * jnp.stack([around, around**2])
    return jnp.stack([wave.imag, jnp.fft.irfft(plain, size)[:n].astype(w.dtype) - double.real])


class ChebyshevFit:
    """A smooth function on an interval by Chebyshev polynomials: traceable, differentiable."""

    def __init__(self, function: Callable[..., Any], low: float, high: float, degree: int) -> None:
        self.low, self.high = low, high
        self.fit = Chebyshev.interpolate(function, degree, domain=[low, high])

    def __call__(self, x: Any) -> Any:
        """The function at x, which must be in the interval, of the shape of ``x``."""
        u = (2 * jnp.asarray(x) - (self.high + self.low)) / (self.high - self.low)
        return chebval(u, self.fit.coef).astype(u.dtype)


@cache
def _shapes() -> tuple[ChebyshevFit, ChebyshevFit]:
    """Ln shape of a gamma density by ln(D5-95 / t_mid), and ln(t_mid / mean) by ln shape."""

    def ratio(k: Any) -> Any:
        early, middle, late = (gammaincinv(k, p) for p in (0.05, 0.45, 0.95))
        return (late - early) / middle

    from scipy.optimize import brentq  # its import takes half a second

    ends = -0.1, math.log(1e4) + 0.1

    def log_shape(logarithm: float) -> float:
        return brentq(lambda y: math.log(ratio(math.exp(y))) - logarithm, *ends)

    low, high = math.log(ratio(1e4)), math.log(ratio(1.0))
    shapes = ChebyshevFit(lambda x: np.array([*map(log_shape, x)]), low, high, 40)
    return shapes, ChebyshevFit(lambda y: np.log(gammaincinv(np.exp(y), 0.45)) - y, *ends, 30)
