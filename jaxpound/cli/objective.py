"""The objective of a design: [objective], [limits] and [penalties] of its configuration."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal

from msgspec.structs import astuple

import jaxpound as jp
from jaxpound._checks import did_you_mean
from jaxpound.cli.reading import Range, Table, between, named, says, unknown_key
from jaxpound.cli.tables import OF_DEMANDS, Gap
from jaxpound.design.goals import Goal
from jaxpound.design.prices import prices_of
from jaxpound.model.system import Structures, is_closable
from jaxpound.results.demand import kind_of, known_of
from jaxpound.risk.demanded import REQUIRED_GAP
from jaxpound.risk.rare_event import RAREST

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

Temperature = between(1e-9, 10, "m", "of the soft minimum of gaps")


_SHARE = '"worst", "mean" or a share'
_Share = Annotated[float, between(1e-6, 1, "", "of the earthquakes")]
_Over = Annotated[str | _Share, says(_SHARE)]


class Objective(Table):
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
    temperature: Annotated[float, Temperature] | None = None
    share: _Share | None = None
    gap: Gap | None = None
    demand: str | None = None
    over: _Over | None = None

    def __post_init__(self) -> None:
        own = _GOALS[self.goal][1]
        for key in ("temperature", "share", "gap", "demand", "over"):
            if getattr(self, key) is not None and key not in own:
                raise ValueError(f'{key} must not be given with goal = "{self.goal}"')
        for key in ("temperature", "demand"):
            if key in own and getattr(self, key) is None:
                raise ValueError(f"lacks the key {key!r}")
        with named(""):
            self.function()

    def function(self) -> Goal | jp.LeastDemand:
        """The library's object for the goal."""
        kind, keys = _GOALS[self.goal]
        given = {key: x for key in keys if (x := getattr(self, key)) is not None}
        goal: Goal | jp.LeastDemand = kind(**given)
        return goal


class AtMost(Table):
    """An upper bound of a demand, and the statistic over the earthquakes that it limits.

    Or the probability with which it may be reached in a random earthquake.
    """

    at_most: float | None = None
    over: _Over = "worst"
    probability: Annotated[float, between(RAREST, 0.5, "", "in one earthquake")] | None = None


class Weighted(Table):
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

_BY_FORCE = ("peak_contact", "soft_peak_contact", "peak_penetration")
"""Demands that are 0 in every impact by Newton's law: no limit on them could be exceeded."""


def priced(
    name: str,
    objective: Objective,
    limits: Mapping[str, float | AtMost],
    penalties: Mapping[str, float | Weighted],
    structures: Structures,
    laws: Sequence[str],
) -> jp.Objective:
    """The library's ``Objective`` of these structures.

    ``name`` is the file's, ``laws`` are the names of its laws of contact.
    """
    if laws and objective.goal == "pounding probability":
        rule = "must not be given with a law of [contact]: whether they meet is the same"
        raise ValueError(f'{name}: [objective] goal = "{objective.goal}" {rule}')
    links = structures.system().links
    if objective.demand is None and not any(is_closable(link.gap) for link in links):
        rule = 'must be "least demand" where no [[link]] has a gap'
        raise ValueError(f'{name}: [objective] goal = "{objective.goal}" {rule}')
    made: dict[str, dict[str, Any]] = {"limits": {}, "penalties": {}}
    stated: list[tuple[str, Any, Mapping[str, Any]]] = [
        ("limits", jp.Limit, limits),
        ("penalties", jp.Penalty, penalties),
    ]
    allowed = prices_of(structures.system())
    if objective.demand is not None:
        _require_price(f"{name}: [objective]", objective.demand, allowed, laws, "demand")
    for table, kind, prices in stated:
        for price, x in prices.items():
            place = f"{name}: [{table}] {price}"
            rare = isinstance(x, AtMost) and x.probability is not None
            gaps = [REQUIRED_GAP] if rare else []
            _require_price(f"{name}: [{table}]", price, [*allowed, *gaps], laws)
            number, *more = [x] if isinstance(x, float) else astuple(x)
            within = OF_DEMANDS[kind_of(price)] if table == "limits" else _PENALTY
            if number is not None:
                within.require(place, number)
            with named(f"{place}:"):
                made[table][price] = kind(number, *more)
    with named(f"{name}: [objective]"):
        return jp.Objective(objective.function(), **made)


def _require_price(
    place: str, price: str, allowed: Sequence[str], laws: Sequence[str], what: str = "key"
) -> None:
    """A ``ValueError`` for a name that is no demand of the structures, or one that is always 0.

    ``what`` says what the name is in the file.
    """
    about = known_of(price)
    if price not in allowed:
        if about is not None and about.only == "contact" and not laws:
            raise ValueError(f"{place} {price} must not be given without a law of [contact]")
        if price == REQUIRED_GAP and place.endswith("[limits]"):
            rule = "must be given with a probability, such as {at_most = 0.2, probability = 1e-3}"
            raise ValueError(f"{place} {price} {rule}")
        words = did_you_mean(price, allowed) or f"allowed are {', '.join(allowed)}"
        raise ValueError(unknown_key(place, price, words, what))
    if {*laws} == {"newton"} and re.sub(r"_\d+$", "", price) in _BY_FORCE:
        rule = 'must not be given with law = "newton", whose impacts have none'
        raise ValueError(f"{place} {price} {rule}; peak_impulse is what they have")
