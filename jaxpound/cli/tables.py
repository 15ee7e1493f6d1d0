"""Tables that configurations have in common: contact, a run, distributions; all in SI."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta

import jaxpound as jp
from jaxpound._checks import Range
from jaxpound.cli.reading import Section, between, named, of_field, refused, says
from jaxpound.model.plausibility import FRICTION, GAP
from jaxpound.results.named import REQUIRED_GAP, kind_of
from jaxpound.scenarios.distributions import RARE, Distribution, reach
from jaxpound.simulation.buildings import DURATION

OF_DEMANDS = {
    "force": Range(1e-6, 1e12, "N", "a hundred times the weight of the heaviest tower"),
    "length": Range(1e-9, 1e3, "m", "up to a kilometre"),
    "acceleration": Range(1e-6, 1e4, "m/s²", "up to a thousand times gravity"),
    "velocity": Range(1e-6, 1e3, "m/s", "faster than sound"),
    "time": Range(1e-6, 3600, "s", "from the start of the run"),
    "energy": Range(1e-9, 1e15, "J", "a force and a length of these sizes"),
    "impulse": Range(1e-9, 1e15, "N s", "a force for a time"),
    None: Range(1e-9, 1e9, "", "of a count or a ratio"),
}
"""Ranges of limits and thresholds of a demand, by its kind of quantity."""
Gap = Annotated[float, between(*GAP)]
Friction = Annotated[float, between(*FRICTION)]
Files = Annotated[list[str], says("a list of files", min_length=1)]


def require_threshold(place: str, demand: str, value: float) -> None:
    """A ``ValueError`` for a threshold that every run reaches, or none; ``place`` names it."""
    of_demand = OF_DEMANDS[kind_of(demand)]
    if demand == REQUIRED_GAP:
        of_demand = GAP._replace(low=of_demand.low)
    of_demand.require(place, value)


LAWS = {
    "newton": jp.Newton,
    "kelvin-voigt": jp.KelvinVoigt,
    "hertz": jp.Hertz,
    "hertz-damped": jp.HertzDamped,
    "jankowski": jp.Jankowski,
}
"""The library's laws of contact; the keys of each are the fields of its class."""


class ContactSection(Section):
    """The law of contact between the buildings when the gap closes."""

    law: Literal["newton", "kelvin-voigt", "hertz", "hertz-damped", "jankowski"]
    stiffness: Annotated[float, of_field(jp.KelvinVoigt, "stiffness")] | None = None
    restitution: Annotated[float, of_field(jp.Newton, "restitution")] | None = None
    tension: bool | None = None
    damping: Literal["exact", "muthukumar", "ye", "hunt-crossley"] | None = None

    def __post_init__(self) -> None:
        law, fields = f'law = "{self.law}"', dataclasses.fields(LAWS[self.law])
        keys = [field.name for field in fields]
        others = {*self.__struct_fields__} - {"law", *keys}
        self.refuse_any(others, f"must not be given with {law}; give {', '.join(keys)}")
        needed = [field.name for field in fields if field.default is dataclasses.MISSING]
        self.require_all(needed, f", which {law} needs")

    def model(self) -> Any:
        """The library's law, in SI units."""
        numbers = self.stated()
        return LAWS[numbers.pop("law")](**numbers)


Velocity = between(1e-9, 1, "m/s", "the damper slips at up to about 1 m/s")


class RunSection(Section):
    """Time grid and scheme; the library chooses what is left out."""

    duration: Annotated[float, between(*DURATION)] | None = None
    dt: Annotated[float, between(1e-7, 10, "s", "a time step")] | None = None
    friction: Literal["event-resolved", "switching", "smoothed"] = "event-resolved"
    smoothing_velocity: Annotated[float, Velocity] | None = None
    order: Annotated[int, between(1, 2)] = 2

    def __post_init__(self) -> None:
        if (self.friction == "smoothed") != (self.smoothing_velocity is not None):
            rule = 'must be given with friction = "smoothed", and only then'
            raise refused("smoothing_velocity", rule)

    def scheme(self, scales: jp.Scales) -> jp.Scheme:
        """The discretisation of the dimensionless system."""
        if self.smoothing_velocity is not None:
            velocity = self.smoothing_velocity * float(scales.time / scales.length)
            return jp.Scheme(jp.Smoothed(velocity), order=self.order)
        law = jp.Switching() if self.friction == "switching" else jp.EventResolved()
        return jp.Scheme(law, order=self.order)


_FORMS = (
    "{normal = [mean, std]}, {lognormal = [median, sigma]}, {uniform = [low, high]} or "
    "{hazard = [[intensity, annual rate], ...]}"
)
_Two = Annotated[
    tuple[Annotated[float, between(-1e300, 1e300)], Annotated[float, between(-1e300, 1e300)]],
    says("two finite numbers"),
]
_Points = says("pairs [intensity, annual rate]", min_length=2)


class DistributionSpec(Section):
    """A distribution by its name and two numbers, or by the points of a hazard curve."""

    normal: _Two | None = None
    lognormal: _Two | None = None
    uniform: _Two | None = None
    hazard: Annotated[list[_Two], _Points] | None = None

    def __post_init__(self) -> None:
        if len(self.stated()) != 1:
            raise ValueError("it must be one of them")

    def __str__(self) -> str:
        ((kind, x),) = self.stated().items()
        pairs = ", ".join(f"[{a:.8g}, {b:.8g}]" for a, b in self.hazard or [x])
        return f"{{{kind} = [{pairs}]}}" if self.hazard else f"{{{kind} = {pairs}}}"

    def times(self, factor: float) -> Distribution:
        """The distribution of the variable times a factor."""
        ((kind, x),) = self.stated().items()
        if kind == "hazard":
            intensity, annual_rate = np.transpose(x)
            return jp.HazardCurve(factor * intensity, annual_rate).distribution()
        if kind == "lognormal":
            return jp.LogNormal(factor * x[0], x[1])
        return (jp.Uniform if kind == "uniform" else jp.Normal)(factor * x[0], factor * x[1])

    def require(self, place: str, allowed: Range) -> None:
        """A ``ValueError`` if it is no distribution, or some of its draws would be out of range."""
        names = ("mean", "std", "median", "low", "high", "intensity")
        with named(f"{place}:", dict.fromkeys(names, allowed.unit)):
            distribution = self.times(1.0)
        for end in reach(distribution):
            if end not in allowed:
                often = "" if self.uniform else f" once in {1 / RARE:,.0f} draws"
                number = allowed.with_unit(f"{end:.4g}")
                rule = f"reaches {number}{often}; it must stay {allowed.rule}"
                raise refused(place, rule, str(self))


def drawn(low: float, high: float, unit: str, why: str) -> Meta:
    """Annotation of a distribution: the range that all its draws must be in."""
    return says(_FORMS, Range(low, high, unit, why))


FACTOR_ON_RECORD = Range(-1e3, 1e3, "", "a factor on the record's acceleration")


def read_records(
    place: str, folder: Path, names: Iterable[str], units: str | None
) -> list[jp.Record]:
    """The accelerograms of files in a folder; ``place`` is where a configuration names them."""
    try:
        return [jp.read_record(folder / name, units=units) for name in names]
    except (OSError, ValueError) as error:
        raise ValueError(f"{place}: {str(error).removeprefix('read_record: ')}") from error
