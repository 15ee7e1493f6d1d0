"""Goals of a design: what is to be maximised over an ensemble of earthquakes."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, ClassVar, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
from jax.scipy.special import logsumexp, ndtr

from jaxpound._checks import Rule, enforce, finite, number, positive, require_share
from jaxpound.design.prices import gathered, require_over, require_price, tail_mean
from jaxpound.results.demand import kind_of


@runtime_checkable
class Goal(Protocol):
    """What is to be maximised: a function of the smallest gaps in all earthquakes.

    Of several links, the smallest gap is that of all of them, and the gap at rest is the mean of
    those that are finite.
    """

    def __call__(self, gaps: jax.Array, initial_gaps: jax.Array) -> jax.Array:
        """The goal's value for smallest gaps and gaps at rest, shape (n,) each."""


@dataclasses.dataclass(frozen=True)
class MeanGap:
    """Mean of the smallest gaps."""

    def __call__(self, gaps: jax.Array, initial_gaps: jax.Array) -> jax.Array:
        """Their mean."""
        return jnp.mean(gaps)


@dataclasses.dataclass(frozen=True)
class WorstGap:
    """Smallest gap of all earthquakes."""

    def __call__(self, gaps: jax.Array, initial_gaps: jax.Array) -> jax.Array:
        """The smallest."""
        return gaps[jnp.argmin(gaps)]


@dataclasses.dataclass(frozen=True)
class GapAtRest:
    """Minus the gap at rest, for land is dear: the narrowest gap that keeps the limits.

    Of several links it is minus the mean of their finite gaps. It is for structures whose gap is a
    variable. Where it is not, this goal is constant, and the penalties alone are minimised.
    """

    def __call__(self, gaps: jax.Array, initial_gaps: jax.Array) -> jax.Array:
        """Minus their mean."""
        return -jnp.mean(initial_gaps)


@dataclasses.dataclass(frozen=True)
class SoftMinimum:
    """−T ln of the mean of e^(−ξ/T): between the smallest (T → 0) and the mean (T → ∞) gap.

    Raises
    ------
    ValueError
        If temperature, in the gap's unit, is not positive and finite.
    """

    temperature: float

    def __post_init__(self) -> None:
        positive("SoftMinimum", temperature=number("SoftMinimum", "temperature", self.temperature))

    def __call__(self, gaps: jax.Array, initial_gaps: jax.Array) -> jax.Array:
        """Their soft minimum."""
        t = self.temperature
        return -t * (logsumexp(-gaps / t) - jnp.log(gaps.size))


@dataclasses.dataclass(frozen=True)
class CVaR:
    """Conditional value at risk (Rockafellar and Uryasev 2000): mean of the worst share of gaps.

    Parameters
    ----------
    share
        Between 0 and 1: 0.1 for the mean of the smallest tenth.

    Raises
    ------
    ValueError
        If share is not between 0 and 1.

    Examples
    --------
    >>> gaps = np.array([0.1, 0.4, 0.2, 0.3])
    >>> round(float(jp.CVaR(0.5)(gaps, np.ones(4))), 6)  # mean of the smaller half
    0.15
    """

    share: float = 0.1

    def __post_init__(self) -> None:
        require_share("CVaR", "share", self.share)

    def __call__(self, gaps: jax.Array, initial_gaps: jax.Array) -> jax.Array:
        """The mean of the smallest."""
        return -tail_mean(-gaps, self.share)


@dataclasses.dataclass(frozen=True)
class PoundingProbability:
    """Minus the probability of pounding at a given gap, smoothed so that it has a derivative.

    Every earthquake counts as Φ((required gap − gap) / width), where required gap = initial gap −
    smallest gap. This is for structures without a law of contact: where blocks that meet stop or
    bounce, the smallest gap does not tell which gap they would have needed. Whether they meet is
    the same with and without such a law.

    Parameters
    ----------
    gap
        The gap at rest ≥ 0, for structures all of whose links have one and the same; by default the
        gaps are those of the structures, and pounding is that of any link.
    width
        Width of the smoothing, in the gap's unit; by default Silverman's rule, 1.06 s n^(−1/5),
        with the standard deviation s of the required gaps, taken as constant in the derivative.

    Raises
    ------
    ValueError
        If gap is negative or width not positive.
    """

    gap: float | None = None
    width: float | None = None
    size: ClassVar[float] = 1.0  # order of magnitude of the goal

    def __post_init__(self) -> None:
        owner = "PoundingProbability"
        if self.gap is not None:
            gap = number(owner, "gap", self.gap)
            enforce(owner, [Rule("gap", gap, (gap >= 0) & finite(gap), "finite, not negative")])
        if self.width is not None:
            positive(owner, width=number(owner, "width", self.width))

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
    """Minus a demand, such as the largest storey drift: the design of the least response.

    It needs no gap, as all goals of gaps do: it is the one for a building with braces alone, or for
    dampers between buildings that stand far apart.

    Parameters
    ----------
    demand
        A demand that an ``Objective`` may limit, by name: ``peak_drift``, ``peak_acceleration``,
        ``peak_x1``.
    over
        Its statistic over the earthquakes, as in ``Limit``.

    Raises
    ------
    ValueError
        If there is no such demand, or over is no statistic.

    Examples
    --------
    >>> objective = jp.Objective(jp.LeastDemand("peak_drift"), limits={"total_damper_force": 0.5})
    >>> objective.goal
    LeastDemand(demand='peak_drift', over='mean')
    """

    demand: str
    over: str | float = "mean"

    def __post_init__(self) -> None:
        require_price("LeastDemand", self.demand, "")
        require_over("LeastDemand", self.over)

    @property
    def quantity(self) -> str | None:
        """Kind of quantity of the demand."""
        return kind_of(self.demand)

    def value(self, demands: Mapping[str, Any]) -> jax.Array:
        """Minus the demand over the earthquakes, from columns of demands by name."""
        return -gathered(demands[self.demand], self.over)

    def size(self, demands: Mapping[str, Any]) -> Any:
        """Order of magnitude of the goal, from columns of demands."""
        return -self.value(demands)


@dataclasses.dataclass(frozen=True)
class OfGaps:
    """A ``Goal`` as a function of all demands, of which it takes the gaps."""

    goal: Goal
    demand: ClassVar[str] = "min_gap"

    @property
    def quantity(self) -> str | None:
        """Kind of quantity: a length, unless the goal has a ``size`` of its own."""
        return "length" if self._own_size is None else None

    @property
    def _own_size(self) -> Any:
        return getattr(self.goal, "size", None)

    def value(self, demands: Mapping[str, Any]) -> jax.Array:
        """The goal of the smallest gaps and the gaps at rest, by name."""
        return self.goal(demands["min_gap"], demands["initial_gap"])

    def size(self, demands: Mapping[str, Any]) -> Any:
        """Order of magnitude of the goal: its own, or the mean required gap."""
        if self._own_size is not None:
            return self._own_size
        return jnp.mean(demands["initial_gap"] - demands["min_gap"])
