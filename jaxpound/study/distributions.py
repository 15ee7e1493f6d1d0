"""Distributions as increasing maps of a standard normal number: traceable, easy to truncate."""

from __future__ import annotations

import dataclasses
import math
from statistics import NormalDist
from typing import Any, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import ndtr, ndtri
from jaxtyping import ArrayLike

from jaxpound._extrema import larger, smaller
from jaxpound._fields import Checked, parameter


@runtime_checkable
class Distribution(Protocol):
    """A random number as an increasing function of a standard normal one."""

    def from_normal(self, z: Any) -> Any:
        """The value whose probability of not being exceeded is Φ(z)."""

    def to_normal(self, x: Any) -> Any:
        """Inverse of ``from_normal``: −∞ below the support, ∞ above it."""


@dataclasses.dataclass(frozen=True)
class Normal(Checked):
    """Normal distribution of a mean and a standard deviation > 0.

    Raises
    ------
    ValueError
        If mean is not finite or std is not positive and finite.

    Examples
    --------
    >>> jp.Normal(mean=2.0, std=0.5).from_normal(-1.0)
    1.5
    """

    mean: float = parameter(single=True)
    std: float = parameter(above=0, single=True)

    def from_normal(self, z: Any) -> Any:
        """Mean + std z."""
        return self.mean + self.std * z

    def to_normal(self, x: Any) -> Any:
        """(x − mean) / std."""
        return (x - self.mean) / self.std


@dataclasses.dataclass(frozen=True)
class LogNormal(Checked):
    """Lognormal distribution: ln x is normal about ln median > 0 with standard deviation sigma > 0.

    Raises
    ------
    ValueError
        If median or sigma is not positive and finite.

    Examples
    --------
    >>> friction = jp.LogNormal(median=0.25, sigma=0.2)
    >>> round(float(friction.from_normal(1.0)), 4)  # one standard deviation above the median
    0.3054
    """

    median: float = parameter(above=0, single=True)
    sigma: float = parameter(above=0, single=True)

    def from_normal(self, z: Any) -> Any:
        """Median e^(sigma z)."""
        return self.median * jnp.exp(self.sigma * z)

    def to_normal(self, x: Any) -> Any:
        """ln(x / median) / sigma."""
        inside = jnp.asarray(x) > 0
        logarithm = jnp.log(jnp.where(inside, x, 1.0) / self.median)
        return jnp.where(inside, logarithm / self.sigma, -jnp.inf)


@dataclasses.dataclass(frozen=True)
class Uniform(Checked):
    """Uniform distribution between low and high > low.

    Raises
    ------
    ValueError
        If one is not finite, or high is not above low.

    Examples
    --------
    >>> float(jp.Uniform(1.0, 3.0).from_normal(0.0))  # the median
    2.0
    """

    low: float = parameter(single=True)
    high: float = parameter(above="low", single=True)

    def from_normal(self, z: Any) -> Any:
        """Low + (high − low) Φ(z)."""
        return self.low + (self.high - self.low) * ndtr(jnp.asarray(z, float))

    def to_normal(self, x: Any) -> Any:
        """Φ⁻¹((x − low) / (high − low))."""
        share = (jnp.asarray(x, float) - self.low) / (self.high - self.low)
        inside = (share > 0) & (share < 1)
        outside = jnp.where(share <= 0, -jnp.inf, jnp.inf)
        return jnp.where(inside, ndtri(jnp.where(inside, share, 0.5)), outside)


def density(distribution: Distribution, x: ArrayLike) -> np.ndarray:
    """Probability density at numbers x, of their shape: φ(z) dz/dx; 0 outside the support."""
    at = jnp.ravel(jnp.asarray(x, float))
    z = jax.vmap(distribution.to_normal)(at)
    slope = jax.vmap(jax.grad(distribution.to_normal))(at)
    inside = np.isfinite(z)
    found = np.exp(-(np.where(inside, z, 0.0) ** 2) / 2) / math.sqrt(2 * math.pi) * slope
    return np.where(inside, found, 0.0).reshape(np.shape(x))


RARE = 1e-6
"""Probability of the tail that ``reach`` leaves out on either side."""


def reach(distribution: Distribution) -> tuple[float, float]:
    """Interval of nearly all draws: the bounds, or the quantiles at ``RARE`` and 1 − ``RARE``."""
    if isinstance(distribution, Uniform):
        return float(distribution.low), float(distribution.high)
    z = NormalDist().inv_cdf(RARE)
    return float(distribution.from_normal(z)), float(distribution.from_normal(-z))


def truncated(distribution: Distribution, z: Any, low: Any, high: Any) -> jax.Array:
    """The value for z of the distribution truncated to [low, high].

    If the distribution has no probability there, the nearer end of the interval.
    """
    # Probability is counted from the nearer end, which keeps its precision in the tails.
    below, above = distribution.to_normal(low), distribution.to_normal(high)
    from_above = ((z > 0) | (below > 0)) & (above > 0)
    sign = jnp.where(from_above, -1.0, 1.0)
    near, far = jnp.where(from_above, -above, below), jnp.where(from_above, -below, above)
    start = ndtr(near)
    p = start + (ndtr(far) - start) * ndtr(sign * z)
    limits = jnp.finfo(p.dtype)
    x = distribution.from_normal(sign * ndtri(larger(smaller(p, 1 - limits.eps), limits.tiny)))
    return larger(smaller(x, high), low)
