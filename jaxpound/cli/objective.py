"""The objective of a design: [objective], [limits] and [penalties] of its configuration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal

from msgspec.structs import astuple

import jaxpound as jp
from jaxpound._checks import did_you_mean
from jaxpound.cli.buildings import BuildingsLayout
from jaxpound.cli.reading import Range, Section, between, named, refused, says, unknown_key
from jaxpound.cli.tables import OF_DEMANDS, Gap
from jaxpound.design.goals import Goal
from jaxpound.reliability.result import RAREST
from jaxpound.results import named as demands
from jaxpound.results.named import REQUIRED_GAP

_GOALS: dict[str, tuple[Any, tuple[str, ...]]] = {
    "mean gap": (jp.MeanGap, ()),
    "worst gap": (jp.WorstGap, ()),
    "soft minimum": (jp.SoftMinimum, ("temperature",)),
    "CVaR": (jp.CVaR, ("share",)),
    "pounding probability": (jp.PoundingProbability, ("gap",)),
    "gap at rest": (jp.GapAtRest, ()),
    "least demand": (jp.LeastDemand, ("demand", "over")),
}
"""The library's goals, and the keys of each goal's parameters, in their order."""

_Temperature = Annotated[float, between(1e-9, 10, "m", "of the soft minimum of gaps")]
_SHARE = '"worst", "mean" or a share'
_Share = Annotated[float, between(1e-6, 1, "", "of the earthquakes")]
_Over = Annotated[str | _Share, says(_SHARE)]


class ObjectiveTable(Section):
    """The goal: a function of the smallest gaps, or a demand that is to be least."""

    goal: Literal[
        "mean gap",
        "worst gap",
        "soft minimum",
        "CVaR",
        "pounding probability",
        "gap at rest",
        "least demand",
    ] = "mean gap"
    temperature: _Temperature | None = None
    share: _Share | None = None
    gap: Gap | None = None
    demand: str | None = None
    over: _Over | None = None

    def __post_init__(self) -> None:
        allowed = _GOALS[self.goal][1]
        others = {*self.__struct_fields__} - {"goal", *allowed}
        self.refuse_any(others, f'must not be given with goal = "{self.goal}"')
        self.require_all(key for key in ("temperature", "demand") if key in allowed)
        with named(""):
            self.function()

    def function(self) -> Goal | jp.LeastDemand:
        """The library's object for the goal."""
        kind, keys = _GOALS[self.goal]
        goal: Goal | jp.LeastDemand = kind(**{k: x for k, x in self.stated().items() if k in keys})
        return goal


class AtMost(Section):
    """The bound of a demand in some of the earthquakes, or by probability in a random one."""

    at_most: float | None = None
    over: _Over = "worst"
    probability: Annotated[float, between(RAREST, 0.5, "", "in one earthquake")] | None = None


class Weighted(Section):
    """The weight of a demand, and the statistic over the earthquakes that is penalised."""

    weight: float
    over: _Over = "mean"


_AtMost = Annotated[
    float | AtMost,
    says(f"a number, {{at_most = ..., over = {_SHARE}}} or {{at_most = ..., probability = ...}}"),
]
_Weighted = Annotated[float | Weighted, says(f"a number, or {{weight = ..., over = {_SHARE}}}")]
Limits = dict[str, _AtMost]
Penalties = dict[str, _Weighted]

_PENALTY = Range(0, 1e9, "", "metres of the goal for a unit of the price")


def priced(
    name: str,
    objective: ObjectiveTable,
    limits: Mapping[str, float | AtMost],
    penalties: Mapping[str, float | Weighted],
    layout: BuildingsLayout,
) -> jp.Objective:
    """The library's ``Objective`` of these buildings; ``name`` is the name of the file."""
    laws, system = layout.laws, layout.structures.system()
    goal = f'"{objective.goal}"'
    if laws and objective.goal == "pounding probability":
        rule = "must not be given with a law of [contact]: whether they meet is the same"
        raise refused(f"{name}: [objective] goal", rule, goal)
    if objective.demand is None and not layout.gaps:
        rule = 'must be "least demand" where no [[link]] has a gap'
        raise refused(f"{name}: [objective] goal", rule, goal)
    tables: dict[str, Any] = {"limits": (jp.Limit, limits), "penalties": (jp.Penalty, penalties)}
    priced: dict[str, dict[str, Any]] = {table: {} for table in tables}
    allowed = demands.limited_demands(system)
    if objective.demand is not None:
        _require_price(f"{name}: [objective]", objective.demand, allowed, laws, "demand")
    for table, (kind, prices) in tables.items():
        for price, x in prices.items():
            place = f"{name}: [{table}] {price}"
            rare = isinstance(x, AtMost) and x.probability is not None
            gaps = [REQUIRED_GAP] if rare else []
            _require_price(f"{name}: [{table}]", price, [*allowed, *gaps], laws)
            number, *more = [x] if isinstance(x, float) else astuple(x)
            within = OF_DEMANDS[demands.kind_of(price)] if table == "limits" else _PENALTY
            if number is not None:
                within.require(place, number)
            with named(f"{place}:"):
                priced[table][price] = kind(number, *more)
    with named(f"{name}: [objective]"):
        return jp.Objective(objective.function(), **priced)


def _require_price(
    place: str, price: str, allowed: Sequence[str], laws: Sequence[str], key: str = "key"
) -> None:
    """Require a demand that the structures have; ``key`` is where its name is in the file."""
    quantity, rule = demands.quantity_named(price), ""
    if price not in allowed:
        if quantity is not None and quantity.only == "contact" and not laws:
            rule = "must not be given without a law of [contact]"
        elif price == REQUIRED_GAP and place.endswith("[limits]"):
            rule = "must be given with a probability, such as {at_most = 0.2, probability = 1e-3}"
        else:
            words = did_you_mean(price, allowed) or f"allowed are {', '.join(allowed)}"
            raise ValueError(unknown_key(place, price, words, key))
    elif {*laws} == {"newton"} and demands.is_zero_by_newton(price):  # never above a limit
        impulse = "peak_impulse is what they have"
        rule = f'must not be given with law = "newton", whose impacts have none; {impulse}'
    if rule:
        raise refused(f"{place} {price}", rule)
