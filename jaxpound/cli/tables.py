"""Tables that configurations have in common: contact, a run, distributions, earthquakes; in SI."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from inspect import signature
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, cast

import jax.numpy as jnp
import numpy as np
from msgspec import Meta

import jaxpound as jp
from jaxpound._checks import Range
from jaxpound.cli import reading
from jaxpound.cli.reading import Count, Form, Section, between, named, of_field, refused, says
from jaxpound.ground.supports import DISTANCE, VELOCITY
from jaxpound.model.plausibility import FRICTION, GAP
from jaxpound.model.shear_building import HEIGHT
from jaxpound.scenarios.distributions import RARE, Distribution, reach
from jaxpound.scenarios.random_ground import GroundDraw
from jaxpound.simulation.time_steps import DURATION

Gap = Annotated[float, between(*GAP)]
_FACES = "a number, or two, [left, right], of which one may be inf"
_Face = Annotated[float, between(0, math.inf, "m", "infinite on a side where nothing is")]
_Faces = Annotated[list[_Face], Meta(min_length=2, max_length=2)]
Gaps = Annotated[Gap | _Faces, says(_FACES, GAP, alone=Gap)]
Friction = Annotated[float, between(*FRICTION)]
SampleInterval = Annotated[float, between(1e-6, 10, "s", "a sample interval")]
_Distance = Annotated[float, between(*DISTANCE)]
_Distances = Annotated[list[_Distance], says(f"a list of numbers {DISTANCE.rule}", min_length=1)]


class WaveSection(Section):
    """A wave that travels along supports: its velocity, and the distance of each support."""

    velocity: Annotated[float, between(*VELOCITY)]
    distances: _Distances

    def __len__(self) -> int:
        return len(self.distances)


class RecordFile(Section):
    """A file of a record, with what it does not state and which of its components is meant."""

    file: str
    column: Annotated[int, Count] | str | None = None
    vertical: bool | None = None
    rows: str | None = None
    units: str | None = None
    dt: SampleInterval | None = None


_FILES = "a list of paths or {file = ...} with, if needed, column, vertical, rows, units and dt"
Files = Annotated[list[str | RecordFile], says(_FILES, min_length=1)]


def of_faces(gap: float | list[float] | None) -> Any:
    """A gap as the library has it, or those of both faces; a ``ValueError`` for a wrong one."""
    if not isinstance(gap, list):
        return math.inf if gap is None else gap
    for side, x in zip(("left", "right"), gap, strict=True):
        if x != math.inf or {*gap} == {math.inf}:  # one of them closes
            GAP.require(f"gap: {side}", x)
    return tuple(gap)


class OfClass(Section):
    """A table whose first key names a class, or a function that makes an object of one.

    The parameters of the class or function are keys.
    """

    CLASSES: ClassVar[dict[str, Any]]

    def __post_init__(self) -> None:
        key = self.__struct_fields__[0]
        by_name = f'{key} = "{getattr(self, key)}"'
        fields = {name: signature(kind).parameters for name, kind in self.CLASSES.items()}
        taken = fields[getattr(self, key)].values()
        keys = {x.name: x.default is x.empty for x in taken if x.name in self.__struct_fields__}
        others = {*itertools.chain(*fields.values())} - keys.keys()
        give = f"; give {', '.join(keys)}" if keys else ""
        self.refuse_any(others, f"must not be given with {by_name}{give}")
        self.require_all(filter(keys.get, keys), f", which {by_name} needs")
        with named(""):
            self.model()

    def model(self) -> Any:
        """The library's object, in SI units."""
        kind, stated = self.CLASSES[getattr(self, self.__struct_fields__[0])], self.stated()
        return kind(**{key: x for key, x in stated.items() if key in signature(kind).parameters})


class ContactSection(OfClass):
    """The law of contact between the buildings when the gap closes."""

    CLASSES: ClassVar = {
        "newton": jp.Newton,
        "kelvin-voigt": jp.KelvinVoigt,
        "hertz": jp.Hertz,
        "hertz-damped": jp.HertzDamped,
        "jankowski": jp.Jankowski,
    }
    law: Literal["newton", "kelvin-voigt", "hertz", "hertz-damped", "jankowski"]
    stiffness: Annotated[float, of_field(jp.KelvinVoigt, "stiffness")] | None = None
    restitution: Annotated[float, of_field(jp.Newton, "restitution")] | None = None
    tension: bool | None = None
    damping: Literal["exact", "muthukumar", "ye", "hunt-crossley"] | None = None


class DamperSection(OfClass):
    """A dashpot; one with a power of the velocity, in series with a spring; a viscoelastic rod."""

    CLASSES: ClassVar = {"dashpot": jp.Dashpot, "power": jp.PowerLaw, "zener": jp.ZenerRod}
    law: Literal["dashpot", "power", "zener"]
    coefficient: Annotated[float, of_field(jp.Dashpot, "coefficient")] | None = None
    stiffness: Annotated[float, of_field(jp.Building, "stiffness")] | None = None
    force: Friction | None = None
    exponent: Annotated[float, of_field(jp.PowerLaw, "exponent")] | None = None
    velocity: Annotated[float, of_field(jp.PowerLaw, "velocity")] | None = None
    order: Annotated[float, of_field(jp.Building, "order")] | None = None
    tau_f: Annotated[float, of_field(jp.Building, "tau_f")] | None = None
    tau_x: Annotated[float, of_field(jp.Building, "tau_x")] | None = None

    def __post_init__(self) -> None:
        if self.law != "dashpot":  # beside which a spring may be
            self.require_all(["stiffness"], f', which law = "{self.law}" needs')
        super().__post_init__()

    def model(self) -> jp.Rod:
        """The library's rod, in SI units."""
        return jp.Rod(super().model(), self.stiffness)


class VelocityFrictionSection(Section):
    """What the friction gains with the velocity."""

    increase: Friction
    velocity: Annotated[float, of_field(jp.VelocityFriction, "velocity")]

    def model(self) -> jp.VelocityFriction:
        """The library's law, in SI units."""
        return jp.VelocityFriction(**self.stated())


class InerterSection(Section):
    """A force in proportion to the relative acceleration."""

    inertance: Annotated[float, of_field(jp.Inerter, "inertance")]

    def model(self) -> jp.Inerter:
        """The library's inerter, in SI units."""
        return jp.Inerter(**self.stated())


class ColumnSection(Section):
    """The columns of a storey that a floor of the neighbour hits."""

    rigidity: Annotated[float, of_field(jp.model.Column, "rigidity")]
    ends: Literal["fixed", "pinned"] | None = None
    capacity: Annotated[float, of_field(jp.model.Column, "capacity")] | None = None
    position: Annotated[float, between(1e-6, 1 - 1e-6, "", "of the height")] | None = None
    height: Annotated[float, between(*HEIGHT)] | None = None
    side: Literal["left", "right"] | None = None

    def model(self) -> jp.model.Column:
        """The library's column, in SI units."""
        return jp.model.Column(**self.stated())


LAWS: dict[str, Any] = {  # the tables of a link that are objects of the library
    "contact": ContactSection,
    "damper": DamperSection,
    "velocity_friction": VelocityFrictionSection,
    "inerter": InerterSection,
    "column": ColumnSection,
}
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

    @property
    def scheme(self) -> jp.Scheme:
        """The discretisation, in SI units."""
        if self.smoothing_velocity is not None:
            return jp.Scheme(jp.Smoothed(self.smoothing_velocity), order=self.order)
        law = jp.simulation.Switching() if self.friction == "switching" else jp.EventResolved()
        return jp.Scheme(law, order=self.order)


_FORMS = (
    "{normal = [mean, std]}, {lognormal = [median, sigma]}, {uniform = [low, high]} or "
    "{hazard = [[intensity, annual rate], ...]}"
)
_Finite = Annotated[float, between(-1e300, 1e300)]
_Two = Annotated[tuple[_Finite, _Finite], says("two finite numbers")]
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

    @property
    def inverse(self) -> DistributionSpec | None:
        """The distribution of 1 over the variable; None if it is none of a file."""
        if self.lognormal is None:
            return None
        return DistributionSpec(lognormal=(1 / self.lognormal[0], self.lognormal[1]))

    def require(self, place: str, allowed: Range) -> None:
        """A ``ValueError`` if it is no distribution, or some of its draws would be out of range."""
        with named(f"{place}:"):
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


def read_records(place: str, folder: Path, files: Files, units: str | None) -> list[jp.Record]:
    """The accelerograms of files in a folder; ``place`` is where a configuration names them."""
    stated = [{"file": x} if isinstance(x, str) else x.stated() for x in files]
    try:
        return [jp.read_record(folder / x.pop("file"), **{"units": units} | x) for x in stated]
    except (OSError, ValueError) as error:
        raise ValueError(f"{place}: {str(error).removeprefix('read_record: ')}") from error


_Amplitude = drawn(-10, 10, "m", "no ground has moved farther")
_Periods = drawn(1e-3, 60, "s", "of a wavelet, for models and for towers")
_Arrivals = drawn(0, 3600, "s", "from the start of the run")
_Intensity = drawn(0, 1e3, "", "a factor on the amplitudes")
_Weight = Annotated[float, between(0, 1e9, "", "a relative frequency")]
_Weights = says("a list of numbers between 0 and 1e+09 (relative frequencies)", min_length=1)

_Instant = Annotated[float, between(1e-3, 3600, "s", "from the start of the noise")]
_Frequency = Annotated[float, between(0.01, 100, "Hz", "of soil: soft has 0.5 Hz, rock 10 Hz")]
_Damping = Annotated[float, between(0.01, 0.99, "", "of the critical damping")]
_STRENGTH = Range(0, 10, "g", "the standard deviation of the acceleration at its strongest")
_OF_NOISE = "a standard deviation in g, or its distribution, {lognormal = [median, sigma]}"
_Strength = Annotated[float, between(1e-6, *_STRENGTH[1:])]  # a run needs shaking
_Acceleration = Annotated[_Strength | DistributionSpec, says(_OF_NOISE, _STRENGTH, _Strength)]
_SAMPLES_IN_A_PERIOD = 20
_GAMMA, _PLATEAU = Form(("peak", "power")), Form(("rise", "end", "decay"))
_WAVELETS = Form(("wavelets", "amplitude", "periods", "arrivals"), ("negative", "intensity"))
_RECORDS = Form(("records",), ("units", "factor", "weights"))
_NOISE = Form(
    ("filter", "frequency", "damping", "acceleration", "duration"),
    ("high_pass", "high_pass_damping", "dt", "envelope"),
)


class EnvelopeTable(Section):
    """How the noise grows and fades: a gamma function, or a rise, a plateau and a decay."""

    peak: _Instant | None = None
    power: Annotated[float, between(1e-3, 1e3, "", "the larger, the shorter")] | None = None
    rise: _Instant | None = None
    end: _Instant | None = None
    decay: Annotated[float, between(1e-3, 1e3, "1/s", "of the exponential decay")] | None = None

    def __post_init__(self) -> None:
        self.require_form(_GAMMA, _PLATEAU)
        self.model()

    def model(self) -> jp.GammaEnvelope | jp.ground.PlateauEnvelope:
        """The library's envelope, in seconds."""
        kind: Any = jp.GammaEnvelope if self.peak is not None else jp.ground.PlateauEnvelope
        with named(""):
            return kind(**self.stated())


class Earthquakes(Section):
    """Random earthquakes: sums of wavelets, records from a list and scaled, or filtered noise."""

    wavelets: Annotated[int, Count] | None = None
    amplitude: Annotated[DistributionSpec, _Amplitude] | None = None
    periods: Annotated[DistributionSpec, _Periods] | None = None
    arrivals: Annotated[DistributionSpec, _Arrivals] | None = None
    negative: Annotated[float, between(0, 1, "", "a probability")] | None = None
    intensity: Annotated[DistributionSpec, _Intensity] | None = None

    records: Files | None = None
    units: str | None = None
    factor: Annotated[DistributionSpec, drawn(*FACTOR_ON_RECORD)] | None = None
    weights: Annotated[list[_Weight], _Weights] | None = None

    filter: Literal["kanai-tajimi", "clough-penzien"] | None = None
    frequency: _Frequency | None = None
    damping: _Damping | None = None
    high_pass: _Frequency | None = None
    high_pass_damping: _Damping | None = None
    duration: Annotated[float, between(*DURATION)] | None = None
    dt: Annotated[float, between(1e-4, 10, "s", "an interval of samples")] | None = None
    acceleration: _Acceleration | None = None
    envelope: EnvelopeTable | None = None

    def __post_init__(self) -> None:
        self.require_form(_WAVELETS, _RECORDS, _NOISE)
        for key, allowed in reading.ranges(Earthquakes).items():
            if isinstance(distribution := getattr(self, key), DistributionSpec):
                distribution.require(key, allowed)
        if self.filter == "kanai-tajimi":
            only = 'must be given with filter = "clough-penzien" only'
            self.refuse_any(("high_pass", "high_pass_damping"), only)
        elif self.filter is not None:
            self.require_all(("high_pass",), ', which filter = "clough-penzien" needs')
        if (frequency := self.frequency) is None:
            return
        if self.dt is not None and self.dt > 0.5 / frequency:
            rule = f"must be at most half of the soil's period, {0.5 / frequency:.4g} s"
            raise refused("dt", rule, f"{self.dt:g} s")
        if self.high_pass is not None and self.high_pass >= frequency:
            rule = f"must be below frequency = {frequency:g} Hz"
            raise refused("high_pass", rule, f"{self.high_pass:g} Hz")

    def shapes(self, records: Sequence[jp.Record]) -> list[jp.Record]:
        """These records and a sample of the noise, for which a time grid must be fine enough."""
        if self.filter is None:
            return [*records]
        noise = self._noise()
        return [*records, noise.draw(jnp.zeros(noise.dimension))]

    def motion(self, records: Sequence[jp.Record]) -> GroundDraw:
        """The random ground motion; ``records`` are those that the file names."""
        if self.filter is not None:
            return self._noise()
        drawn = {
            key: x.times(1.0) for key, x in self.stated().items() if isinstance(x, DistributionSpec)
        }
        if records:
            weights = tuple(self.weights) if self.weights else None
            return jp.RandomRecord(tuple(records), weights=weights, **drawn)
        negative = 0.5 if self.negative is None else self.negative
        return jp.RandomRicker(cast("int", self.wavelets), negative=negative, **drawn)

    def _noise(self) -> jp.FilteredNoise:
        table: Any = self  # with all keys that its filter needs
        ground = 2 * math.pi * table.frequency, self.damping
        filter: Any = jp.KanaiTajimi(*ground)
        if self.high_pass is not None:
            share = {"high_pass_damping": self.high_pass_damping} if self.high_pass_damping else {}
            corner = 2 * math.pi * self.high_pass
            filter = jp.ground.CloughPenzien(*ground, high_pass=corner, **share)
        dt = self.dt or 1 / (_SAMPLES_IN_A_PERIOD * table.frequency)
        strength = table.acceleration
        return jp.FilteredNoise(
            filter,
            samples=max(2, math.ceil(table.duration / dt * (1 - 1e-9)) + 1),
            dt=dt,
            envelope=self.envelope.model() if self.envelope else None,
            intensity=strength.times(1.0) if isinstance(strength, DistributionSpec) else strength,
            time_unit="s",
        )
