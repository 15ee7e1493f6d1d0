"""Tables that configurations have in common: contact, a run, earthquakes; all in SI."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta
from msgspec.structs import asdict

import jaxpound as jp
from jaxpound.cli.reading import (
    Count,
    File,
    Range,
    Table,
    between,
    named,
    of_field,
    ranges,
    says,
)
from jaxpound.model.plausibility import FRICTION, GAP
from jaxpound.results.demand import kind_of
from jaxpound.risk.demanded import REQUIRED_GAP
from jaxpound.simulation.buildings import DURATION
from jaxpound.study.distributions import RARE, Distribution, reach
from jaxpound.study.ground_draw import GroundDraw

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
    """A ``ValueError`` for a threshold of a demand that is none; ``place`` says where it stands.

    That is one that every run reaches, or none does.
    """
    of_demand = OF_DEMANDS[kind_of(demand)]
    if demand == REQUIRED_GAP:
        of_demand = GAP._replace(low=of_demand.low)
    of_demand.require(place, value)


# --- contact and run ---------------------------------------------------------------------------

LAWS = {
    "newton": jp.Newton,
    "kelvin-voigt": jp.KelvinVoigt,
    "hertz": jp.Hertz,
    "hertz-damped": jp.HertzDamped,
    "jankowski": jp.Jankowski,
}
"""The library's laws of contact; the keys of each are the fields of its class."""

Restitution = of_field(jp.Newton, "restitution")
Stiffer = of_field(jp.KelvinVoigt, "stiffness")


class Contact(Table):
    """The law of contact between the buildings when the gap closes."""

    law: Literal["newton", "kelvin-voigt", "hertz", "hertz-damped", "jankowski"]
    stiffness: Annotated[float, Stiffer] | None = None
    restitution: Annotated[float, Restitution] | None = None
    tension: bool | None = None
    damping: Literal["exact", "muthukumar", "ye", "hunt-crossley"] | None = None

    def __post_init__(self) -> None:
        given, own = self._given(), dataclasses.fields(LAWS[self.law])
        keys = [field.name for field in own]
        for key in given:
            if key not in keys:
                rule = f'must not be given with law = "{self.law}"; give {", ".join(keys)}'
                raise ValueError(f"{key} {rule}")
        for field in own:
            if field.default is dataclasses.MISSING and field.name not in given:
                raise ValueError(f'lacks the key {field.name!r}, which law = "{self.law}" needs')

    def _given(self) -> dict[str, Any]:
        return {k: x for k, x in asdict(self).items() if k != "law" and x is not None}

    def model(self) -> Any:
        """The library's law, in SI units."""
        return LAWS[self.law](**self._given())


Velocity = between(1e-9, 1, "m/s", "the damper slips at up to about 1 m/s")


class Run(Table):
    """Time grid and scheme; the library chooses what is left out."""

    duration: Annotated[float, between(*DURATION)] | None = None
    dt: Annotated[float, between(1e-7, 10, "s", "a time step")] | None = None
    friction: Literal["event-resolved", "switching", "smoothed"] = "event-resolved"
    smoothing_velocity: Annotated[float, Velocity] | None = None
    order: Annotated[int, between(1, 2)] = 2

    def __post_init__(self) -> None:
        if (self.friction == "smoothed") != (self.smoothing_velocity is not None):
            rule = 'must be given with friction = "smoothed", and only then'
            raise ValueError(f"smoothing_velocity {rule}")

    def scheme(self, scales: jp.Scales) -> jp.Scheme:
        """The discretisation of the dimensionless system."""
        if self.smoothing_velocity is not None:
            velocity = self.smoothing_velocity * float(scales.time / scales.length)
            return jp.Scheme(jp.Smoothed(velocity), order=self.order)
        law = jp.Switching() if self.friction == "switching" else jp.EventResolved()
        return jp.Scheme(law, order=self.order)


# --- what is random -----------------------------------------------------------------------------

_FORMS = (
    "{normal = [mean, std]}, {lognormal = [median, sigma]}, {uniform = [low, high]} or "
    "{hazard = [[intensity, annual rate], ...]}"
)
_Two = Annotated[
    tuple[Annotated[float, between(-1e300, 1e300)], Annotated[float, between(-1e300, 1e300)]],
    says("two finite numbers"),
]


class Stated(Table):
    """A distribution by its name and two numbers, or by the points of a hazard curve."""

    normal: _Two | None = None
    lognormal: _Two | None = None
    uniform: _Two | None = None
    hazard: Annotated[list[_Two], says("pairs [intensity, annual rate]", min_length=2)] | None = (
        None
    )

    def __post_init__(self) -> None:
        if len([x for x in asdict(self).values() if x is not None]) != 1:
            raise ValueError("it must be one of them")

    def __str__(self) -> str:
        ((kind, x),) = ((kind, x) for kind, x in asdict(self).items() if x is not None)
        told = "[" + ", ".join(_pair(*pair) for pair in x) + "]" if self.hazard else _pair(*x)
        return f"{{{kind} = {told}}}"

    def times(self, factor: float) -> Distribution:
        """The distribution of the variable times a factor."""
        if self.hazard:
            intensity, annual_rate = np.transpose(self.hazard)
            return jp.HazardCurve(factor * intensity, annual_rate).distribution()
        if self.lognormal:
            median, sigma = self.lognormal
            return jp.LogNormal(factor * median, sigma)
        if self.uniform:
            return jp.Uniform(*(factor * x for x in self.uniform))
        return jp.Normal(*(factor * x for x in self.normal or ()))

    def require(self, place: str, allowed: Range) -> None:
        """A ``ValueError`` if it is no distribution, or some of its draws would be out of range."""
        names = ("mean", "std", "median", "low", "high", "intensity")
        with named(f"{place}:", dict.fromkeys(names, allowed.unit)):
            found = self.times(1.0)
        for end in reach(found):
            if end not in allowed:
                often = "" if self.uniform else f" once in {1 / RARE:,.0f} draws"
                what = f"{place} = {self} reaches {allowed.told(f'{end:.4g}')}{often}; it"
                raise ValueError(f"{what} must stay {allowed.rule}")


def _pair(a: float, b: float) -> str:
    return f"[{a:.8g}, {b:.8g}]"


def drawn(low: float, high: float, unit: str, why: str) -> Meta:
    """Annotation of a distribution: the range that all its draws must be in."""
    return says(_FORMS, Range(low, high, unit, why))


Periods = drawn(1e-3, 60, "s", "of a wavelet, for models and for towers")
RecordFactor = drawn(-1e3, 1e3, "", "a factor on the record's acceleration")
Weight = Annotated[float, between(0, 1e9, "", "a relative frequency")]
Weights = says("a list of numbers between 0 and 1e+09 (relative frequencies)", min_length=1)


class Earthquakes(Table):
    """Random earthquakes: sums of wavelets, or records drawn from a list and scaled."""

    wavelets: Annotated[int, Count] | None = None
    amplitude: Annotated[Stated, drawn(-10, 10, "m", "no ground has moved farther")] | None = None
    periods: Annotated[Stated, Periods] | None = None
    arrivals: Annotated[Stated, drawn(0, 3600, "s", "from the start of the run")] | None = None
    negative: Annotated[float, between(0, 1, "", "a probability")] | None = None
    intensity: Annotated[Stated, drawn(0, 1e3, "", "a factor on the amplitudes")] | None = None

    records: Files | None = None
    units: str | None = None
    factor: Annotated[Stated, RecordFactor] | None = None
    weights: Annotated[list[Weight], Weights] | None = None

    def __post_init__(self) -> None:
        given = {key: value for key, value in asdict(self).items() if value is not None}
        needed = ("wavelets", "amplitude", "periods", "arrivals")
        of_wavelets, of_records = {*needed, "negative", "intensity"}, {"units", "factor", "weights"}
        for key in given:
            if key in (of_records if self.records is None else of_wavelets):
                how = "without" if self.records is None else "with"
                raise ValueError(f"{key} must not be given {how} records")
        for key in needed:
            if self.records is None and key not in given:
                raise ValueError(f"lacks the key {key!r}")
        for key, allowed in ranges(Earthquakes).items():
            if isinstance(stated := given.get(key), Stated):
                stated.require(key, allowed)

    def motion(self, records: Sequence[jp.Record], scales: jp.Scales) -> GroundDraw:
        """The random ground motion; ``records`` are those that the file names."""
        length, time = float(scales.length), float(scales.time)
        if records:
            motions = tuple(scales.to_dimensionless(record) for record in records)
            factor = self.factor.times(1.0) if self.factor else None
            return jp.RandomRecord(motions, factor, tuple(self.weights) if self.weights else None)
        assert self.wavelets
        assert self.amplitude
        assert self.periods
        assert self.arrivals
        return jp.RandomRicker(
            self.wavelets,
            self.amplitude.times(1 / length),
            self.periods.times(1 / time),
            self.arrivals.times(1 / time),
            0.5 if self.negative is None else self.negative,
            self.intensity.times(1.0) if self.intensity else None,
        )


def read_records(
    place: str, file: File, names: Iterable[str], units: str | None
) -> list[jp.Record]:
    """The accelerograms of files beside a configuration; ``place`` is where it names them."""
    try:
        return [jp.read_record(file.folder / name, units=units) for name in names]
    except (OSError, ValueError) as error:
        raise ValueError(f"{place}: {str(error).removeprefix('read_record: ')}") from error
