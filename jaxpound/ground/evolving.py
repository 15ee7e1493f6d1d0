r"""Noise whose intensity and frequency change in the course of an earthquake.

The site-based model of Rezaeian and Der Kiureghian (2008, 2010): white noise through an oscillator
whose frequency changes linearly, scaled to unit variance, times a modulating function; then a
high-pass filter.

The oscillator's response to an impulse keeps the frequency ω_k of the instant of the impulse, so
that the sum over impulses is no convolution. But as ω_k is linear in time, with centred times τ,

.. math:: ω_k (τ_i - τ_k) = ω_c s - ω' s^2 / 2 + ω' (τ_i^2 - τ_k^2) / 2, \qquad s = τ_i - τ_k,

so that the oscillation is one between two factors of modulus 1 (a chirp transform). Its decay
:math:`e^{-ζ ω_k s}` is interpolated in ln ω_k between ``NODES`` values, for each of which it is a
convolution. For damping ratios from .02 to .8 the process is right to 1e-8 of its standard
deviation where the frequency changes by a factor of 3 in the course of the motion, to 1e-5 where it
does by a factor of 10, to 2e-4 by one of 20.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import gammaln
from jaxtyping import Array, Float
from numpy.polynomial import Chebyshev
from scipy.fft import next_fast_len
from scipy.special import gammaincinv

from jaxpound._extrema import larger, smaller
from jaxpound.ground.noise import causal, unit_variance

NODES = 12
"""Frequencies between which the decay of the oscillations is interpolated."""

LOWEST = 0.3
"""Below this the frequency of the filter does not fall, Hz."""


def modulation(t: Any, arias: Any, duration: Any, mid_time: Any) -> Any:
    """The modulating function q(t | α) ≥ 0 of given Arias intensity and duration.

    q² is in proportion to a gamma density: (π/2) ∫ q² dt is the Arias intensity, of which 5 % are
    over ``duration`` before 95 % are, and 45 % are over at ``mid_time``. No such function has a
    duration above 4.92 mid-times and is bounded: it then has the mid-time asked for, and the
    duration that is nearest.
    """
    log_shape, log_middle = _shapes()
    x = jnp.log(jnp.asarray(duration) / mid_time)
    shape = jnp.exp(log_shape(larger(smaller(x, log_shape.high), log_shape.low)))
    scale = mid_time / (shape * jnp.exp(log_middle(jnp.log(shape))))
    share = jnp.asarray(t) / scale
    some = share > 0
    share = jnp.where(some, share, 1.0)
    density = jnp.exp((shape - 1) * jnp.log(share) - share - gammaln(shape)) / scale
    return jnp.where(some, jnp.sqrt(2 / jnp.pi * arias * density), 0.0)


def evolving_noise(
    z: Float[Array, " n"], dt: Any, frequency: Any, slope: Any, mid_time: Any, damping: Any
) -> Float[Array, " n"]:
    """White noise through a filter of changing frequency, of unit variance at every instant.

    Parameters
    ----------
    z
        Independent standard normal numbers, shape (n,): impulses at the instants j·dt.
    dt
        Interval between them, s.
    frequency, slope
        Frequency of the filter at ``mid_time``, Hz, and its rate, Hz/s; it stays above ``LOWEST``.
    mid_time
        In s.
    damping
        Damping ratio of the filter, above 0 and below 1.

    Returns
    -------
    Shape (n,), linear in z; 0 at t = 0.
    """
    n = z.shape[-1]
    tau = (np.arange(n, dtype=z.dtype) - (n - 1) / 2).astype(z.dtype) * dt
    rate = 2 * jnp.pi * slope
    centre = 2 * jnp.pi * (frequency + slope * ((n - 1) / 2 * dt - mid_time))
    lowest = 2 * math.pi * LOWEST
    w = centre + rate * tau
    falls = w < lowest
    w = larger(w, jnp.full_like(w, lowest))
    across = jnp.sqrt(1 - jnp.asarray(damping, z.dtype) ** 2)
    size = w / across  # of the response to an impulse; its square has half of that of 1 − cos
    inputs = jnp.stack([size * z, size**2 / 2, size**2 / 2])
    decay = damping * jnp.asarray([1.0, 2.0, 2.0], z.dtype)
    turn = across * jnp.asarray([1.0, 0.0, 2.0], z.dtype)

    def both(v: Any, decay: Any, turn: Any) -> Any:
        changing = _oscillations(jnp.where(falls, 0.0, v), tau, w, decay, turn, centre, rate, NODES)
        held = jnp.full_like(w, lowest)
        return changing + _oscillations(
            jnp.where(falls, v, 0.0), tau, held, decay, turn, lowest, 0.0, 1
        )

    wave, whole, double = jax.vmap(both)(inputs, decay, turn)
    first = np.arange(n) == 0  # when no impulse has moved it yet
    return unit_variance(wave.imag, jnp.where(first, 0.0, whole.real - double.real))


def high_passed(x: Float[Array, " n"], dt: Any, corner: Any) -> Float[Array, " n"]:
    """Acceleration of a critically damped oscillator, of frequency ``corner`` in Hz, that x drives.

    Exact at the samples for x of straight lines between them, shape (n,): velocity and displacement
    of what is left return to zero.
    """
    t = np.arange(-1, x.shape[-1] + 1, dtype=x.dtype) * dt
    lag = larger(t, jnp.zeros_like(t)) * jnp.exp(-2 * jnp.pi * corner * t)
    return causal((lag[2:] - 2 * lag[1:-1] + lag[:-2]) / dt, x)


def _oscillations(
    v: Any, tau: Any, w: Any, decay: Any, turn: Any, centre: Any, rate: Any, nodes: int
) -> Any:
    """Σ_{k ≤ i} v_k exp((i turn − decay) w_k (τ_i − τ_k)), shape (n,), where w = centre + rate τ.

    Where v is 0, w may be anything positive.
    """
    n = v.shape[-1]
    size, s = next_fast_len(2 * n), tau - tau[0]
    x = jnp.log(w)
    middle, half = (x.max() + x.min()) / 2, (x.max() - x.min()) / 2
    some = half > 1e-6
    u = jnp.where(some, (x - middle) / jnp.where(some, half, 1.0), 0.0)
    places = np.cos(np.pi * (np.arange(nodes) + 0.5) / nodes)
    polynomials = _chebyshev(places, nodes) * np.where(np.arange(nodes) == 0, 1, 2)[:, None] / nodes
    shares = jnp.asarray(polynomials.T, v.dtype) @ jnp.stack(_chebyshev_list(u, nodes))
    around = _turned(1.0, turn * rate * tau**2 / 2)
    inputs, phase = v * jnp.conj(around), turn * (centre * s - rate * s**2 / 2)

    def add(total: Any, node: Any) -> tuple[Any, None]:
        place, share = node
        response = _turned(jnp.exp(-decay * jnp.exp(middle + half * place) * s), phase)
        return total + jnp.fft.fft(response, size) * jnp.fft.fft(share * inputs, size), None

    start = jnp.zeros(size, inputs.dtype)
    total, _ = jax.lax.scan(add, start, (jnp.asarray(places, v.dtype), shares))
    return around * jnp.fft.ifft(total)[:n]


def _turned(radius: Any, angle: Any) -> Any:
    return jax.lax.complex(radius * jnp.cos(angle), radius * jnp.sin(angle))


def _chebyshev(x: np.ndarray, n: int) -> np.ndarray:
    return np.stack(_chebyshev_list(x, n))


def _chebyshev_list(x: Any, n: int) -> list[Any]:
    """Chebyshev's polynomials of degrees 0 to n − 1 at x."""
    found = [x * 0 + 1, x]
    while len(found) < n:
        found.append(2 * x * found[-1] - found[-2])
    return found[:n]


class Smooth:
    """A smooth function on an interval, by Chebyshev's polynomials: traceable, differentiable."""

    def __init__(
        self, function: Callable[[Any], Any], low: float, high: float, degree: int
    ) -> None:
        self.low, self.high = low, high
        self.fit = Chebyshev.interpolate(function, degree, domain=[low, high])

    def __call__(self, x: Any) -> Any:
        """The function at x, which must be in the interval, of the shape of ``x``."""
        u = (2 * jnp.asarray(x) - (self.high + self.low)) / (self.high - self.low)
        after, last = jnp.zeros_like(u), jnp.zeros_like(u)
        for c in self.fit.coef[:0:-1]:  # Clenshaw's recursion
            after, last = 2 * u * after - last + float(c), after
        return u * after - last + float(self.fit.coef[0])


@cache
def _shapes() -> tuple[Smooth, Smooth]:
    """Ln shape of a gamma density by ln(D5-95 / t_mid), and ln(t_mid / mean) by ln shape."""

    def ratio(k: Any) -> Any:
        early, middle, late = (gammaincinv(k, p) for p in (0.05, 0.45, 0.95))
        return (late - early) / middle

    from scipy.optimize import brentq  # only here: it takes half a second to import

    first, last = 1.0, 1e4
    low, high = math.log(ratio(last)), math.log(ratio(first))

    def shape(x: Any) -> Any:
        ends = -0.1, math.log(last) + 0.1
        found = [brentq(lambda y, one=one: math.log(ratio(math.exp(y))) - one, *ends) for one in x]
        return np.array(found)

    return (
        Smooth(shape, low, high, 40),
        Smooth(lambda y: np.log(gammaincinv(np.exp(y), 0.45)) - y, -0.1, math.log(last) + 0.1, 30),
    )
