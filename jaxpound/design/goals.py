"""Goals of a design, which a search maximises, and statistics over an ensemble of earthquakes."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
from jax.scipy.special import logsumexp, ndtr

from jaxpound._checks import require_share
from jaxpound._errors import InvalidInput
from jaxpound._fields import Checked, parameter
from jaxpound.results.named import require_limited


@dataclasses.dataclass(frozen=True)
class SmallestGap:
    """A statistic of the smallest gaps.

    Parameters
    ----------
    over
        Over the earthquakes: "mean", "worst" (the smallest gap of all), or a share between 0 and 1
        for the mean of the worst: 0.1 for that of the smallest tenth, the conditional value at risk
        (Rockafellar and Uryasev 2000).

    Examples
    --------
    >>> gaps = np.array([0.1, 0.4, 0.2, 0.3])
    >>> round(float(jp.SmallestGap(over=0.5)(gaps, np.ones(4))), 6)  # mean of the smaller half
    0.15
    """

    over: str | float = "mean"

    def __post_init__(self) -> None:
        require_over(self.over)
        if not isinstance(self.over, str):
            object.__setattr__(self, "over", float(self.over))

    def __call__(self, gaps: jax.Array, initial_gaps: jax.Array) -> jax.Array:
        """The statistic."""
        return -gathered(-gaps, self.over)


@dataclasses.dataclass(frozen=True)
class GapAtRest:
    """Minus the gap at rest: the search finds the narrowest gap within the limits.

    Where no gap is a variable, this goal is constant, and the penalties alone are minimised.
    """

    def __call__(self, gaps: jax.Array, initial_gaps: jax.Array) -> jax.Array:
        """Minus their mean."""
        return -jnp.mean(initial_gaps)


@dataclasses.dataclass(frozen=True)
class SoftMinimum(Checked):
    """−T ln of the mean of e^(−ξ/T): between the smallest (T → 0) and the mean (T → ∞) gap.

    The temperature T > 0 is in the gap's unit.
    """

    temperature: float = parameter(above=0, single=True)

    def __call__(self, gaps: jax.Array, initial_gaps: jax.Array) -> jax.Array:
        """Their soft minimum."""
        t = self.temperature
        return -t * (logsumexp(-gaps / t) - jnp.log(gaps.size))


@dataclasses.dataclass(frozen=True)
class PoundingProbability(Checked):
    """Minus the probability of pounding at a given gap, smoothed so that it has a derivative.

    Every earthquake counts as Φ((required gap − gap) / width), where required gap = initial gap −
    smallest gap. This is for structures without a law of contact, by which the smallest gap would
    not tell which gap they would have needed; whether they meet is the same.

    Parameters
    ----------
    gap
        The gap at rest ≥ 0, for structures all of whose links have one and the same; by default the
        gaps are those of the structures, and pounding is that of any link.
    width
        Width > 0 of the smoothing, in the gap's unit; by default Silverman's rule, 1.06 s n^(−1/5),
        with the standard deviation s of the required gaps, taken as constant in the derivative.
    """

    gap: float | None = parameter(least=0, single=True, default=None)
    width: float | None = parameter(above=0, single=True, default=None)
    size: ClassVar[float] = 1.0  # order of magnitude of the goal

    def __call__(self, gaps: jax.Array, initial_gaps: jax.Array) -> jax.Array:
        """Minus the smoothed share of earthquakes with pounding."""
        required = initial_gaps - gaps
        gap = initial_gaps if self.gap is None else self.gap
        width: Any = self.width
        if width is None:
            spread = jnp.std(jax.lax.stop_gradient(required))
            width = jnp.where(spread > 0, 1.06 * spread * gaps.size**-0.2, 1.0)
        return -jnp.mean(ndtr((required - gap) / width))


@dataclasses.dataclass(frozen=True)
class LeastDemand:
    """Minus a demand: the design of the least response. Other goals need a gap.

    Parameters
    ----------
    demand
        A demand that an ``Objective`` may limit, by name: ``peak_drift``, ``peak_x1``.
    over
        Its statistic over the earthquakes, as in ``Limit``.

    Examples
    --------
    >>> goal = jp.design.LeastDemand("peak_drift")
    >>> objective = jp.Objective(goal, limits={"total_damper_force": 0.5})
    >>> objective.goal
    LeastDemand(demand='peak_drift', over='mean')
    """

    demand: str
    over: str | float = "mean"

    def __post_init__(self) -> None:
        require_limited(self.demand, "")
        require_over(self.over)

    def value(self, demands: Mapping[str, Any]) -> jax.Array:
        """Minus the demand over the earthquakes, from columns of demands by name."""
        return -gathered(demands[self.demand], self.over)


def require_over(over: Any) -> None:
    """An ``InvalidInput`` if ``over`` is not "worst", "mean" or a share."""
    if not isinstance(over, str):
        require_share("over", over)
    elif over not in ("worst", "mean"):
        raise InvalidInput("over", repr(over), "must be 'worst', 'mean' or a share")


def gathered(values: jax.Array, over: str | float) -> jax.Array:
    """One number for a demand in all earthquakes, shape (n,); ``over`` is that of ``Limit``."""
    if over == "mean":
        return jnp.mean(values)
    return values[jnp.argmax(values)] if over == "worst" else tail_mean(values, float(over))


def tail_mean(x: jax.Array, share: float) -> jax.Array:
    """Mean of the largest ``share`` of n numbers, shape (n,), the last of them weighted in part."""
    whole = share * x.size
    weights = jnp.clip(whole - jnp.arange(x.size), 0.0, 1.0).astype(x.dtype)
    return jnp.sum(weights * jnp.sort(x, descending=True)) / whole
