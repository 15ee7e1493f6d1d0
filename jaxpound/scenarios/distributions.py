"""Distributions as increasing, traceable functions of a standard normal number."""

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

from jaxpound._checks import is_traced, require_share
from jaxpound._errors import InvalidInput, warn
from jaxpound._extrema import larger, smaller
from jaxpound._fields import Checked, parameter, part

RARE = 1e-6  # probability of each tail that ``reach`` leaves out
_LEAST = 0.1  # smallest probability of a distribution inside an interval that truncates it
_UNSAID = 1e-3  # probability outside that is not worth a word: errors of sampling are larger


@runtime_checkable
class Distribution(Protocol):
    """A random number as an increasing function of a standard normal one."""

    def from_normal(self, z: Any) -> Any:
        """The value that is not exceeded with probability Φ(z)."""

    def to_normal(self, x: Any) -> Any:
        """Inverse of ``from_normal``: −∞ below the support, ∞ above it."""


@dataclasses.dataclass(frozen=True)
class Normal(Checked):
    """Normal distribution of a mean and a standard deviation > 0; else a ``ValueError``.

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
    """Lognormal distribution of a median and a std sigma of ln x, both > 0; else a ``ValueError``.

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
    """Uniform distribution between low and high > low, both finite; else a ``ValueError``.

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


@dataclasses.dataclass(frozen=True)
class TwoSided(Checked):
    """Numbers of either sign: a random size and a random sign from one standard normal number z.

    With probability ``negative``, between 0 and 1, it is minus a draw from ``size``, a distribution
    of positive numbers, else plus such a draw; other arguments raise ``ValueError``. If the sizes
    start at 0, the number is a continuous function of z with a derivative, unlike a size and a sign
    from two numbers. (At z = Φ⁻¹(negative) the slope with a ``LogNormal`` is unbounded.)

    Examples
    --------
    >>> amplitude = jp.scenarios.TwoSided(jp.LogNormal(median=0.1, sigma=0.5))
    >>> [round(float(amplitude.from_normal(z)), 4) for z in (-0.6745, 0.6745, 2.0)]
    [-0.1, 0.1, 0.2328]
    """

    size: Distribution = part(Distribution)
    negative: float = parameter(words="probability", least=0, most=1, single=True, default=0.5)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_share("negative", self.negative)
        if ndtr(self.size.to_normal(0.0)) != 0:
            raise InvalidInput("size", repr(self.size), "must have positive numbers only")

    def from_normal(self, z: Any) -> Any:
        """Minus or plus the size, which grows with the distance of z from Φ⁻¹(negative)."""
        z = jnp.asarray(z)
        z = z.astype(jnp.result_type(float, z))
        below = z < ndtri(jnp.asarray(self.negative, z.dtype))
        whole = jnp.where(below, self.negative, 1 - self.negative)
        beyond = ndtr(jnp.where(below, z, -z)) / whole  # probability of a larger size
        if self.negative == 0.5:
            smaller_sizes = jax.lax.erf(jnp.abs(z) / math.sqrt(2.0))
        else:
            smaller_sizes = jnp.abs(ndtr(z) - self.negative) / whole
        tiny = jnp.finfo(z.dtype).tiny
        lower = smaller_sizes < 0.5
        low = ndtri(larger(jnp.where(lower, smaller_sizes, 0.5), tiny))
        high = -ndtri(larger(jnp.where(lower, 0.5, beyond), tiny))
        size = self.size.from_normal(jnp.where(lower, low, high))
        return jnp.where(below, -size, size)

    def to_normal(self, x: Any) -> Any:
        """Inverse of ``from_normal``."""
        x = jnp.asarray(x, float)
        beyond = ndtr(-self.size.to_normal(jnp.abs(x)))
        down, up = ndtri(self.negative * beyond), -ndtri((1 - self.negative) * beyond)
        return jnp.where(x < 0, down, up)


def density(distribution: Distribution, x: ArrayLike) -> np.ndarray:
    """Probability density at numbers x, of their shape: φ(z) dz/dx; 0 outside the support."""
    flat = jnp.ravel(jnp.asarray(x, float))
    z = jax.vmap(distribution.to_normal)(flat)
    slope = jax.vmap(jax.grad(distribution.to_normal))(flat)
    inside = np.isfinite(z)
    values = np.exp(-(np.where(inside, z, 0.0) ** 2) / 2) / math.sqrt(2 * math.pi) * slope
    return np.where(inside, values, 0.0).reshape(np.shape(x))


def reach(distribution: Distribution) -> tuple[float, float]:
    """Interval of nearly all draws: the bounds, or the quantiles at ``RARE`` and 1 − ``RARE``."""
    if isinstance(distribution, Uniform):
        return float(distribution.low), float(distribution.high)
    z = NormalDist().inv_cdf(RARE)
    return float(distribution.from_normal(z)), float(distribution.from_normal(-z))


def truncated(distribution: Distribution, z: Any, low: Any, high: Any) -> jax.Array:
    """Value for z of the distribution truncated to [low, high]; an end if it has none in there."""
    # Probabilities are measured from the nearer end, to keep their precision in the tails.
    below, above = distribution.to_normal(low), distribution.to_normal(high)
    from_above = ((z > 0) | (below > 0)) & (above > 0)
    sign = jnp.where(from_above, -1.0, 1.0)
    near_end, far_end = jnp.where(from_above, -above, below), jnp.where(from_above, -below, above)
    start = ndtr(near_end)
    p = start + (ndtr(far_end) - start) * ndtr(sign * z)
    limits = jnp.finfo(p.dtype)
    x = distribution.from_normal(sign * ndtri(larger(smaller(p, 1 - limits.eps), limits.tiny)))
    return larger(smaller(x, high), low)


def require_inside(name: str, distribution: Distribution, low: Any, high: Any) -> None:
    """Refuse a distribution nearly all outside [low, high]; warn of one that this truncates."""
    with jax.ensure_compile_time_eval():  # of known numbers, in a traced function too
        shares = [ndtr(distribution.to_normal(x)) for x in (low, high)]
    if is_traced(shares):
        return
    (below, upto), inside = map(float, shares), f"[{float(low):.6g}, {float(high):.6g}]"
    drawn, share = f"{name} ~ {distribution}", below + 1 - upto
    if 1 - share < _LEAST:
        rule = f"must have at least {_LEAST:.0%} of its probability in {inside}"
        raise InvalidInput(drawn, "", rule)
    if share > _UNSAID:
        lost = f"{share:.2%} of its probability, outside {inside}, is cut off"
        warn([f"{drawn}: {lost}; draws are of the rest"], strict=False)
