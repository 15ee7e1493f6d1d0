"""Objectives of a design over an ensemble of earthquakes: a goal, penalties and limits."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp

from jaxpound._checks import Rule, enforce, finite, instance, number, positive
from jaxpound.design.goals import Goal, LeastDemand, MeanGap, OfGaps
from jaxpound.design.prices import gathered, require_over, require_price


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


@dataclasses.dataclass(frozen=True)
class Objective:
    """What a design is to achieve: the largest goal less penalties, within limits on demands.

    For one pair more friction nearly always means a wider gap, up to locking the blocks together: a
    goal of gaps alone needs a limit or a penalty.

    Parameters
    ----------
    goal
        ``MeanGap``, ``WorstGap``, ``SoftMinimum``, ``CVaR``, ``PoundingProbability``,
        ``GapAtRest``, or any function of gaps and initial gaps that JAX can trace; or
        ``LeastDemand``, for the least response.
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

    goal: Goal | LeastDemand = MeanGap()
    penalties: Mapping[str, Penalty] = dataclasses.field(default_factory=dict)
    limits: Mapping[str, Limit] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        known = callable(self.goal) or isinstance(self.goal, LeastDemand)
        if not known or isinstance(self.goal, type):
            rule = "a function of gaps, or LeastDemand"
            raise ValueError(f"Objective: goal = {self.goal!r} must be {rule}")
        for name, kind in (("penalties", Penalty), ("limits", Limit)):
            given = getattr(self, name)
            instance("Objective", name, given, Mapping)
            for price in given:
                require_price("Objective", price, f" in {name}")
            made: Any = {}
            for price, x in given.items():
                try:
                    made[price] = x if isinstance(x, kind) else kind(x)
                except ValueError as error:
                    what = re.sub(r"^\w+: \w+", f"Objective: {name}: {price}", str(error))
                    raise ValueError(what) from error
            object.__setattr__(self, name, made)

    @property
    def _goal(self) -> LeastDemand | OfGaps:
        """The goal as a function of all demands."""
        return self.goal if isinstance(self.goal, LeastDemand) else OfGaps(self.goal)

    @property
    def needs_gap(self) -> bool:
        """Whether it is for structures with a gap that can close."""
        return not isinstance(self.goal, LeastDemand)

    @property
    def demand(self) -> str:
        """The demand that the goal is of: ``min_gap``, or that of ``LeastDemand``."""
        return self._goal.demand

    @property
    def quantity(self) -> str | None:
        """The goal's kind of quantity; None for a pure number."""
        return self._goal.quantity

    def size(self, demands: Mapping[str, Any]) -> float:
        """Order of magnitude of the goal in these columns of demands, 1 where they have none."""
        size = float(self._goal.size(demands))
        return size if 0 < size < float("inf") else 1.0

    def value(self, demands: Mapping[str, Any]) -> jax.Array:
        """Goal less penalties, from columns of demands by name (``DesignProblem.columns``)."""
        total = self._goal.value(demands)
        for price, penalty in self.penalties.items():
            total = total - penalty.weight * gathered(demands[price], penalty.over)
        return total

    def prices(self, demands: Mapping[str, Any]) -> jax.Array:
        """The limited demands, in the order of the limits, shape (m,)."""
        found = [gathered(demands[price], limit.over) for price, limit in self.limits.items()]
        return jnp.stack(found) if found else jnp.zeros(0, next(iter(demands.values())).dtype)
