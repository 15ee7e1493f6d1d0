"""Objectives of a design over an ensemble of earthquakes: a goal, penalties and limits."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound._checks import instance
from jaxpound._errors import InvalidInput, renamed
from jaxpound._fields import Checked, parameter
from jaxpound.design.goals import LeastDemand, SmallestGap, gathered, require_over
from jaxpound.results.named import REQUIRED_GAP, kind_of, require_limited


@dataclasses.dataclass(frozen=True)
class Limit(Checked):
    """An upper bound on a demand, or on the probability that it is reached.

    Parameters
    ----------
    at_most
        Upper bound > 0 of the limited demand, in its unit. It may be left out only of the required
        gap with a probability, which is then that of pounding: that any link closes its own gap.
    over
        Statistic over the earthquakes: "worst", "mean", or a share between 0 and 1 for the mean of
        the worst. Not with a probability.
    probability
        Largest probability, between 0 and 1, with which the demand reaches ``at_most`` in a random
        earthquake, however rare: it is found by ``rare_event``, not from the ensemble.

    Examples
    --------
    >>> jp.design.Limit(0.4, over="mean")
    Limit(at_most=0.4, over='mean', probability=None)

    The least damper with which a gap of 0.645 is exceeded once in a million earthquakes:

    >>> seldom = {"required_gap": jp.design.Limit(0.645, probability=1e-6)}
    >>> objective = jp.Objective(jp.design.LeastDemand("damper_force"), limits=seldom)
    """

    at_most: float | None = parameter(above=0, single=True, default=None)
    over: str | float = "worst"
    probability: float | None = parameter(above=0, below=1, single=True, default=None)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_over(self.over)
        if self.at_most is None and self.probability is None:
            raise InvalidInput("at_most", "None", "must be a number where there is no probability")
        if self.probability is not None and self.over != "worst":
            rule = "must be left out with a probability, which is of a single earthquake"
            raise InvalidInput("over", repr(self.over), rule)

    def event(self, demand: str) -> str:
        """The event whose probability is limited, in words."""
        return "P(pounding)" if self.at_most is None else f"P({demand} >= {self.at_most:.6g})"

    @property
    def statistic(self) -> str:
        """What is limited, in words: a probability, or a statistic over the earthquakes."""
        if isinstance(self.over, str):
            words = {"worst": "largest", "mean": "mean"}[self.over]
            return words if self.probability is None else "probability"
        return f"mean of the worst {100 * self.over:.3g} %"

    @property
    def most(self) -> float:
        """The largest probability, or else the largest demand."""
        most = self.at_most if self.probability is None else self.probability
        assert most is not None
        return most

    @property
    def bound(self) -> float:
        """The largest limited number: ``at_most``; of a probability 1 (see ``limited``)."""
        return self.most if self.probability is None else 1.0

    def limited(self, reached: Any) -> Any:
        """The limited number of what is reached: the demand, or 1 + ln(P/p) of a probability.

        That is nearly linear in a design.
        """
        return reached if self.probability is None else 1 + np.log(reached / self.probability)

    def reached(self, limited: Any) -> Any:
        """Inverse of ``limited``."""
        if self.probability is None:
            return limited
        return self.probability * np.exp(np.minimum(limited - 1, -np.log(self.probability)))


@dataclasses.dataclass(frozen=True)
class Penalty(Checked):
    """The weight of a demand in the objective.

    Parameters
    ----------
    weight
        Loss ≥ 0 per unit of the demand, in the goal's unit.
    over
        See ``Limit``.
    """

    weight: float = parameter(least=0, single=True)
    over: str | float = "mean"

    def __post_init__(self) -> None:
        super().__post_init__()
        require_over(self.over)


@dataclasses.dataclass(frozen=True)
class Objective:
    """The objective of a design: the largest goal less penalties, within limits on demands.

    More friction nearly always means a wider gap, up to locking the blocks together: a goal of gaps
    alone needs a limit or a penalty.

    Raises ``ValueError`` if goal is no function, a demand is unknown, or a penalty or limit is
    neither.

    Parameters
    ----------
    goal
        ``SmallestGap``, ``SoftMinimum``, ``PoundingProbability``, ``GapAtRest``, any traceable
        function of the smallest gaps in all earthquakes and of the gaps at rest, shape (n,) each,
        or ``LeastDemand``. Of several links, the smallest gap is that of all of them, and the gap
        at rest is the mean of those that are finite.
    penalties
        By penalised demand: ``{"peak_f1": Penalty(0.5)}``; a number is the weight of the mean.
    limits
        By limited demand: ``{"peak_f1": Limit(0.4, over="mean")}``; a number limits the worst. With
        a probability also of ``required_gap``, the largest closing of any link.

    Notes
    -----
    All are in SI units of ``Buildings``, else dimensionless. Demands that can be limited or
    penalised are ``peak_f1``, ``peak_f2`` (base shear), ``damper_force`` (its slip force),
    ``peak_x1``, ``peak_x2``, ``peak_acceleration_1``, ``peak_acceleration_2``, ``residual_offset``
    (its absolute value), ``slip_distance`` and ``friction_work``; with a law of contact also
    ``peak_contact``, ``peak_impulse``, ``peak_penetration``, ``contact_work`` and
    ``soft_peak_contact``. Those of a ``Row`` or ``System`` are numbered by its masses, rods and
    links (if there are several): ``peak_x3``, ``peak_f5``, ``peak_drift_2`` (of a storey between
    two floors), ``slip_distance_2``, ``damper_force_2``. Of several dampers there is also
    ``total_damper_force``, the sum of all slip forces and of the forces of viscous dampers at their
    reference velocity, and of inerters ``total_inertance``: a limit on it is a budget that they
    share. ``peak_drift`` and ``peak_acceleration`` are the largest of all storeys and floors, and
    ``peak_contact``, ``peak_impulse`` and ``peak_penetration`` of several links the largest of all.

    Examples
    --------
    >>> objective = jp.Objective(jp.SmallestGap(0.1), {"peak_f1": 0.6}, {"damper_force": 0.3})
    >>> objective.penalties
    {'peak_f1': Penalty(weight=0.6, over='mean')}
    >>> objective.limits
    {'damper_force': Limit(at_most=0.3, over='worst', probability=None)}
    """

    goal: Callable[[jax.Array, jax.Array], jax.Array] | LeastDemand = SmallestGap()
    penalties: Mapping[str, Penalty] = dataclasses.field(default_factory=dict)
    limits: Mapping[str, Limit] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        is_goal = callable(self.goal) or isinstance(self.goal, LeastDemand)
        if not is_goal or isinstance(self.goal, type):
            rule = "must be a function of gaps, or LeastDemand"
            raise InvalidInput("goal", repr(self.goal), rule)
        for name, kind in (("penalties", Penalty), ("limits", Limit)):
            entries = getattr(self, name)
            instance(name, entries, Mapping)
            checked: Any = {}
            for demand, x in entries.items():
                if demand != REQUIRED_GAP or kind is Penalty:
                    require_limited(demand, f" in {name}")
                with renamed(name, {"at_most": demand, "weight": demand}):
                    checked[demand] = x if isinstance(x, kind) else kind(x)
                limit = checked[demand]
                if kind is Limit and demand == REQUIRED_GAP and limit.probability is None:
                    rule = "must have a probability; of gaps over an ensemble there are goals"
                    raise InvalidInput(f"limits: {demand}", repr(limit.at_most), rule)
                if kind is Limit and demand != REQUIRED_GAP and limit.at_most is None:
                    rule = f"must be given: only of {REQUIRED_GAP} it is that of the structures"
                    raise InvalidInput(f"limits: {demand}: at_most", "None", rule)
            object.__setattr__(self, name, checked)

    @property
    def demand(self) -> str:
        """The demand that the goal is of: ``min_gap``, or that of ``LeastDemand``."""
        return self.goal.demand if isinstance(self.goal, LeastDemand) else "min_gap"

    @property
    def quantity(self) -> str | None:
        """The goal's kind of quantity; None for a pure number, a goal of gaps with a ``size``."""
        if isinstance(self.goal, LeastDemand):
            return kind_of(self.goal.demand)
        return "length" if getattr(self.goal, "size", None) is None else None

    def size(self, demands: Mapping[str, Any]) -> float:
        """Order of magnitude of the goal in columns of demands, 1 where they have none."""
        size = getattr(self.goal, "size", None)
        if isinstance(self.goal, LeastDemand):
            size = -self.goal.value(demands)
        elif size is None:
            size = jnp.mean(demands["initial_gap"] - demands["min_gap"])
        return float(size) if 0 < float(size) < float("inf") else 1.0

    def value(self, demands: Mapping[str, Any]) -> jax.Array:
        """Goal less penalties, from columns of demands by name (``DesignProblem.columns``)."""
        if isinstance(self.goal, LeastDemand):
            total = self.goal.value(demands)
        else:
            total = self.goal(demands["min_gap"], demands["initial_gap"])
        for demand, penalty in self.penalties.items():
            total = total - penalty.weight * gathered(demands[demand], penalty.over)
        return total

    @property
    def rare(self) -> tuple[str, ...]:
        """Demands whose probability is limited, by name, in the order of the limits."""
        return tuple(name for name, x in self.limits.items() if x.probability is not None)

    def limited_demands(self, demands: Mapping[str, Any], rare: Any = ()) -> jax.Array:
        """The limited numbers in the order of the limits, (m,), from columns of demands by name.

        ``rare`` are those of the limited probabilities (``Limit.limited``), in their order.
        """
        probable = iter(rare)
        limited = [
            gathered(demands[demand], limit.over) if limit.probability is None else next(probable)
            for demand, limit in self.limits.items()
        ]
        return jnp.stack(limited) if limited else jnp.zeros(0, next(iter(demands.values())).dtype)
