"""Objectives of a design over an ensemble of earthquakes: a goal, penalties and limits."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from typing import Any, ClassVar, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
from jax.scipy.special import logsumexp, ndtr

from jaxpound._checks import (
    Rule,
    enforce,
    finite,
    hint,
    instance,
    number,
    positive,
    require_share,
)
from jaxpound.model.system import GROUND, System, Topology
from jaxpound.results.demand import known_of, limited_columns
from jaxpound.results.elements import of_link
from jaxpound.study.demands import names_over_all

DAMPER, BUDGET = "damper_force", "total_damper_force"


def prices_of(system: System) -> tuple[str, ...]:
    """Demands of a system that may be limited or penalised.

    Scalars of ``Demand`` by flat name, ``residual_offset`` by its absolute value;
    ``damper_force``, the slip force μ of a single link, or of several links ``damper_force_1`` and
    so on, and their sum, ``total_damper_force``; and the largest demands of all floors, storeys and
    contacts (``names_over_all``). Scalars of contact are those of links with a law of contact.
    """
    touching = [link.contact is not None for link in system.links]
    n, topology = len(touching), system.topology
    return (
        *(of_link(DAMPER, k, n) for k in range(n)),
        *((BUDGET,) if n > 1 else ()),
        *limited_columns(topology, touching),
        *names_over_all(topology, touching),
    )


_PAIR = Topology(2, ((0, GROUND), (1, GROUND)), ((0, 1),))
PRICES = (DAMPER, *limited_columns(_PAIR, touching=[True]))
"""Those of two adjacent structures with a law of contact."""

_MEANT = (*PRICES, BUDGET, "peak_drift", "peak_acceleration")
"""What an unknown name is compared with."""


def _is_price(name: str) -> bool:
    """Whether a system can have such a demand that may be limited or penalised."""
    known = known_of(name)
    return known is not None and known.limited


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


def tail_mean(x: jax.Array, share: float) -> jax.Array:
    """Mean of the largest ``share`` of n numbers, shape (n,), the last of them weighted in part."""
    whole = share * x.size
    weights = jnp.clip(whole - jnp.arange(x.size), 0.0, 1.0).astype(x.dtype)
    return jnp.sum(weights * jnp.sort(x, descending=True)) / whole


@dataclasses.dataclass(frozen=True)
class Limit:
    """An upper bound on a demand.

    Parameters
    ----------
    at_most
        Upper bound > 0 of the limited demand, in its unit.
    over
        Statistic over the earthquakes: "worst", "mean", or a share between 0 and 1 for the mean of
        the worst (``CVaR``).

    Raises
    ------
    ValueError
        If at_most is not positive and finite or over is something else.

    Examples
    --------
    >>> jp.Limit(0.4, over="mean")
    Limit(at_most=0.4, over='mean')
    """

    at_most: float
    over: str | float = "worst"

    def __post_init__(self) -> None:
        positive("Limit", at_most=number("Limit", "at_most", self.at_most))
        require_over("Limit", self.over)


@dataclasses.dataclass(frozen=True)
class Penalty:
    """The weight of a demand in the objective.

    Parameters
    ----------
    weight
        Loss ≥ 0 per unit of the demand, in the goal's unit.
    over
        See ``Limit``.

    Raises
    ------
    ValueError
        If weight is negative or not finite, or over is something else.
    """

    weight: float
    over: str | float = "mean"

    def __post_init__(self) -> None:
        w = number("Penalty", "weight", self.weight)
        enforce("Penalty", [Rule("weight", w, (w >= 0) & finite(w), "finite and not negative")])
        require_over("Penalty", self.over)


def require_over(owner: str, over: Any) -> None:
    """A ``ValueError`` if ``over`` is not "worst", "mean" or a share."""
    if isinstance(over, str):
        if over not in ("worst", "mean"):
            raise ValueError(f"{owner}: over = {over!r} must be 'worst', 'mean' or a share")
    else:
        require_share(owner, "over", over)


def gathered(prices: jax.Array, over: str | float) -> jax.Array:
    """One number for a demand in all earthquakes, shape (n,); ``over`` is that of ``Limit``."""
    if over == "mean":
        return jnp.mean(prices)
    if over == "worst":
        return prices[jnp.argmax(prices)]
    return tail_mean(prices, float(over))


@dataclasses.dataclass(frozen=True)
class Objective:
    """What a design is to achieve: the largest goal less penalties, within limits on demands.

    For one pair more friction nearly always means a wider gap, up to locking the blocks together: a
    goal of gaps alone needs a limit or a penalty.

    Parameters
    ----------
    goal
        ``MeanGap``, ``WorstGap``, ``SoftMinimum``, ``CVaR``, ``PoundingProbability``,
        ``GapAtRest``, or any function of gaps and initial gaps that JAX can trace.
    penalties
        By penalised demand: ``{"peak_f1": Penalty(0.5)}``; a number is the weight of the mean.
    limits
        By limited demand: ``{"peak_f1": Limit(0.4, over="mean")}``; a number limits the worst.

    Raises
    ------
    ValueError
        If goal is no function, a demand is unknown, or a penalty or limit is neither.

    Notes
    -----
    All are in dimensionless units, or in SI units where the design is given scales. Demands that
    can be limited or penalised are ``peak_f1``, ``peak_f2`` (base shear), ``damper_force`` (its
    slip force), ``peak_x1``, ``peak_x2``, ``peak_acceleration_1``, ``peak_acceleration_2``,
    ``residual_offset`` (its absolute value), ``slip_distance`` and ``friction_work``; with a law of
    contact also ``peak_contact``, ``peak_impulse``, ``peak_penetration``, ``contact_work`` and
    ``soft_peak_contact``. Those of a ``Row`` or ``System`` are numbered by its masses, rods and
    links (if there are several): ``peak_x3``, ``peak_f5``, ``peak_drift_2`` (of a storey between
    two floors), ``slip_distance_2``, ``damper_force_2``. Of several links there is also
    ``total_damper_force``, the sum of all slip forces: a limit on it is a budget that the dampers
    share. ``peak_drift`` and ``peak_acceleration`` are the largest of all storeys and floors, and
    ``peak_contact``, ``peak_impulse`` and ``peak_penetration`` of several links the largest of all.

    Examples
    --------
    >>> budget = jp.Objective(jp.MeanGap(), limits={"total_damper_force": 0.5, "peak_drift": 0.2})
    >>> budget.limits["total_damper_force"]
    Limit(at_most=0.5, over='worst')
    >>> objective = jp.Objective(jp.CVaR(0.1), {"peak_f1": 0.6}, {"damper_force": 0.3})
    >>> objective.penalties
    {'peak_f1': Penalty(weight=0.6, over='mean')}
    >>> objective.limits
    {'damper_force': Limit(at_most=0.3, over='worst')}
    """

    goal: Goal = MeanGap()
    penalties: Mapping[str, Penalty] = dataclasses.field(default_factory=dict)
    limits: Mapping[str, Limit] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        if not callable(self.goal) or isinstance(self.goal, type):
            raise ValueError(f"Objective: goal = {self.goal!r} must be a function of gaps")
        for name, kind in (("penalties", Penalty), ("limits", Limit)):
            given = getattr(self, name)
            instance("Objective", name, given, Mapping)
            for price in given:
                if not _is_price(price):
                    meant = hint(price, _MEANT)
                    raise ValueError(f"Objective: unknown price {price!r} in {name}; {meant}")
            made: Any = {}
            for price, x in given.items():
                try:
                    made[price] = x if isinstance(x, kind) else kind(x)
                except ValueError as error:
                    what = re.sub(r"^\w+: \w+", f"Objective: {name}: {price}", str(error))
                    raise ValueError(what) from error
            object.__setattr__(self, name, made)

    @property
    def quantity(self) -> str | None:
        """Its kind of quantity: a length, unless the goal has a ``size`` of its own."""
        return "length" if getattr(self.goal, "size", None) is None else None

    def value(self, demands: Mapping[str, Any]) -> jax.Array:
        """Goal less penalties, from columns of demands, ``min_gap`` and ``initial_gap`` by name."""
        total = self.goal(demands["min_gap"], demands["initial_gap"])
        for price, penalty in self.penalties.items():
            total = total - penalty.weight * gathered(demands[price], penalty.over)
        return total

    def prices(self, demands: Mapping[str, Any]) -> jax.Array:
        """The limited demands, in the order of the limits, shape (m,)."""
        found = [gathered(demands[price], limit.over) for price, limit in self.limits.items()]
        return jnp.stack(found) if found else jnp.zeros(0, demands["min_gap"].dtype)
