"""Random earthquakes: sums of wavelets, recorded accelerograms, or filtered white noise."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any, Literal, cast

import jax.numpy as jnp

import jaxpound as jp
from jaxpound.cli.reading import Count, Range, Section, between, named, ranges, refused, says
from jaxpound.cli.tables import FACTOR_ON_RECORD, DistributionSpec, Files, drawn
from jaxpound.scenarios.ground_draw import GroundDraw
from jaxpound.simulation.buildings import DURATION

_Amplitude = drawn(-10, 10, "m", "no ground has moved farther")
_Periods = drawn(1e-3, 60, "s", "of a wavelet, for models and for towers")
_Arrivals = drawn(0, 3600, "s", "from the start of the run")
_Intensity = drawn(0, 1e3, "", "a factor on the amplitudes")
_Weight = Annotated[float, between(0, 1e9, "", "a relative frequency")]
_Weights = says("a list of numbers between 0 and 1e+09 (relative frequencies)", min_length=1)
_OF_WAVELETS = ("wavelets", "amplitude", "periods", "arrivals")

_Instant = Annotated[float, between(1e-3, 3600, "s", "from the start of the noise")]
_Frequency = Annotated[float, between(0.01, 100, "Hz", "of soil: soft has 0.5 Hz, rock 10 Hz")]
_Damping = Annotated[float, between(0.01, 0.99, "", "of the critical damping")]
_STRENGTH = Range(0, 10, "g", "the standard deviation of the acceleration at its strongest")
_LEAST_STRENGTH = 1e-6  # if it is not random: a run needs shaking
_Acceleration = Annotated[
    float | DistributionSpec,
    says("a standard deviation in g, or its distribution, {lognormal = [median, sigma]}"),
]
_OF_SOIL = ("frequency", "damping", "acceleration", "duration")
_NEEDED = {"kanai-tajimi": _OF_SOIL, "clough-penzien": (*_OF_SOIL, "high_pass")}
_SAMPLES_IN_A_PERIOD = 20
_OF_GAMMA, _OF_PLATEAU = ("peak", "power"), ("rise", "end", "decay")


class EnvelopeTable(Section):
    """How the noise grows and fades: a gamma function, or a rise, a plateau and a decay."""

    peak: _Instant | None = None
    power: Annotated[float, between(1e-3, 1e3, "", "the larger, the shorter")] | None = None
    rise: _Instant | None = None
    end: _Instant | None = None
    decay: Annotated[float, between(1e-3, 1e3, "1/s", "of the exponential decay")] | None = None

    def __post_init__(self) -> None:
        if self.stated().keys() not in ({*_OF_GAMMA}, {*_OF_PLATEAU}):
            raise ValueError(f"must have {', '.join(_OF_GAMMA)}, or {', '.join(_OF_PLATEAU)}")
        self.model()

    def model(self) -> jp.GammaEnvelope | jp.PlateauEnvelope:
        """The library's envelope, in seconds."""
        kind: Any = jp.GammaEnvelope if self.peak is not None else jp.PlateauEnvelope
        with named("", {"rise": "s", "end": "s"}):
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
        if self.filter is not None:
            self._require_noise(self.filter)
            return
        keys = self.__struct_fields__
        self.refuse_any(keys[keys.index("filter") :], "must not be given without filter")
        if self.records is None:
            self.refuse_any(("units", "factor", "weights"), "must not be given without records")
            self.require_all(_OF_WAVELETS)
        else:
            others = (*_OF_WAVELETS, "negative", "intensity")
            self.refuse_any(others, "must not be given with records")
        for key, allowed in ranges(Earthquakes).items():
            if isinstance(distribution := getattr(self, key), DistributionSpec):
                distribution.require(key, allowed)

    def _require_noise(self, filter: str) -> None:
        keys = self.__struct_fields__
        self.refuse_any(keys[: keys.index("filter")], "must not be given with filter")
        self.require_all(_NEEDED[filter])
        if filter == "kanai-tajimi":
            only = 'must be given with filter = "clough-penzien" only'
            self.refuse_any(("high_pass", "high_pass_damping"), only)
        if isinstance(self.acceleration, DistributionSpec):
            self.acceleration.require("acceleration", _STRENGTH)
        else:
            _STRENGTH._replace(low=_LEAST_STRENGTH).require("acceleration", self.acceleration)
        assert self.frequency
        if self.dt is not None and self.dt > 0.5 / self.frequency:
            rule = f"must be at most half of the soil's period, {0.5 / self.frequency:.4g} s"
            raise refused("dt", rule, f"{self.dt:g} s")
        if self.high_pass is not None and self.high_pass >= self.frequency:
            rule = f"must be below frequency = {self.frequency:g} Hz"
            raise refused("high_pass", rule, f"{self.high_pass:g} Hz")

    def shapes(self, records: Sequence[jp.Record]) -> list[jp.Record]:
        """These records and a sample of the noise, for which a time grid must be fine enough."""
        if self.filter is None:
            return [*records]
        noise = self._noise()
        return [*records, noise.draw(jnp.zeros(noise.dimension))]

    def motion(self, records: Sequence[jp.Record], scales: jp.Scales) -> GroundDraw:
        """The random ground motion, dimensionless; ``records`` are those that the file names."""
        if self.filter is not None:
            return scales.to_dimensionless(self._noise())
        if records:
            motions = tuple(scales.to_dimensionless(record) for record in records)
            factor = self.factor.times(1.0) if self.factor else None
            return jp.RandomRecord(motions, factor, tuple(self.weights) if self.weights else None)
        units = {"amplitude": scales.length, "periods": scales.time, "arrivals": scales.time}
        return jp.RandomRicker(
            **{key: getattr(self, key).times(1 / float(unit)) for key, unit in units.items()},
            wavelets=cast("int", self.wavelets),
            negative=0.5 if self.negative is None else self.negative,
            intensity=self.intensity.times(1.0) if self.intensity else None,
        )

    def _noise(self) -> jp.FilteredNoise:
        table: Any = self  # with all keys that its filter needs
        ground = 2 * math.pi * table.frequency, self.damping
        filter: Any = jp.KanaiTajimi(*ground)
        if self.high_pass is not None:
            share = {"high_pass_damping": self.high_pass_damping} if self.high_pass_damping else {}
            filter = jp.CloughPenzien(*ground, high_pass=2 * math.pi * self.high_pass, **share)
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
