"""Envelopes of artificial earthquakes: how the intensity of a noise builds up and decays."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import ArrayLike

from jaxpound._extrema import larger, smaller
from jaxpound._fields import parameter, pytree_dataclass


@pytree_dataclass
class GammaEnvelope:
    r"""A gamma function of time with peak 1: :math:`q = (τ e^{1 - τ})^p`, with τ = t / peak.

    Zero before t = 0. ``peak`` > 0 is the instant of the peak, and ``power`` p > 0: the larger, the
    shorter. Raises ``ValueError`` if a concrete value is not positive and finite.

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
    over the unit of time. Raises ``ValueError`` if a concrete value breaks its rule.

    Examples
    --------
    >>> envelope = jp.PlateauEnvelope(rise=4.0, end=15.0, decay=0.3)
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
