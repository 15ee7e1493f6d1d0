"""What ``jaxpound montecarlo`` is told in a TOML file: buildings, earthquakes, uncertainty; SI."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp

from jaxpound.chunks import Measure
from jaxpound.config import (
    BUILDING,
    RUN,
    STEPS_PER_PERIOD,
    Keys,
    check_keys,
    example,
    named,
    needed,
    pair,
    parse,
    read_text,
    require_stable,
    time_grid,
)
from jaxpound.distributions import Distribution, LogNormal, Normal, Uniform
from jaxpound.ground import GroundLike
from jaxpound.intensity import spectral_acceleration
from jaxpound.records import read_record
from jaxpound.scenarios import (
    PARAMETERS,
    RandomRecord,
    RandomRicker,
    Scenarios,
    UncertainStructures,
)
from jaxpound.scheme import Scheme, TimeGrid, stability_limit
from jaxpound.structures import AdjacentStructures
from jaxpound.units import Scales

EXAMPLE = "example_study.toml"

_KINDS: dict[str, Callable[[float, float], Distribution]] = {
    "normal": Normal,
    "lognormal": LogNormal,
    "uniform": Uniform,
}
_WAVELETS = ("wavelets", "amplitude", "periods", "arrivals", "negative", "intensity")
_RECORDS = ("records", "units", "factor", "weights")


def _distribution(value: Any) -> str:
    """What is wrong with a distribution, or nothing."""
    rule = "{normal = [mean, std]}, {lognormal = [median, sigma]} or {uniform = [low, high]}"
    if not (isinstance(value, dict) and len(value) == 1 and {*value} <= {*_KINDS}):
        return rule
    (numbers,) = value.values()
    right = isinstance(numbers, list) and len(numbers) == 2
    return "" if right and all(type(x) in (int, float) for x in numbers) else rule


def _files(value: Any) -> str:
    right = isinstance(value, list) and value and all(isinstance(x, str) for x in value)
    return "" if right else "a list of files"


def _word(value: Any) -> str:
    return "" if isinstance(value, str) else "a text"


def _flag(value: Any) -> str:
    return "" if isinstance(value, bool) else "true or false"


def _numbers(value: Any) -> str:
    right = isinstance(value, list) and value and all(type(x) in (int, float) for x in value)
    return "" if right else "a list of numbers"


_KEYS: Keys = {
    "": {"gap": float},
    "building_1": BUILDING,
    "building_2": BUILDING,
    "damper": {"friction_force": float},
    "earthquakes": {
        "wavelets": int,
        "amplitude": _distribution,
        "periods": _distribution,
        "arrivals": _distribution,
        "negative": float,
        "intensity": _distribution,
        "records": _files,
        "units": _word,
        "factor": _distribution,
        "weights": _numbers,
    },
    "uncertain": dict.fromkeys(PARAMETERS, _distribution),
    "run": RUN,
    "study": {
        "samples": int,
        "seed": int,
        "sampling": ("plain", "sobol"),
        "chunk_size": int,
        "keep_failures": _flag,
        "spectral_acceleration": _flag,
    },
}


@dataclasses.dataclass(frozen=True)
class StudyConfiguration:
    """A Monte Carlo study of two buildings in SI units; ``text`` is the file's."""

    source: str
    text: str
    scenarios: Scenarios
    scales: Scales
    grid: TimeGrid
    scheme: Scheme
    samples: int
    seed: int
    sampling: str
    chunk_size: int | None
    keep_failures: bool
    measures: dict[str, Measure]


def read_study(path: Path | None) -> StudyConfiguration:
    """Read and check the configuration of a study, or the example if ``path`` is None.

    Raises
    ------
    OSError
        If the file, or a record that it names, cannot be read.
    ValueError
        As ``config.read_config``.
    """
    source = "example study" if path is None else str(path)
    text = example(EXAMPLE) if path is None else read_text(path)
    given = parse(source, text)
    if isinstance(uncertain := given.get("uncertain"), dict):
        given["uncertain"] = _flat(uncertain)
    check_keys(source, given, _KEYS)
    left, right, structures, scales, scheme = pair(source, given)
    folder = Path() if path is None else path.parent
    ground, record_dt, length = _ground(source, given, folder, scales)
    periods = [float(building.natural_period) for building in (left, right)]
    shortest = min(min(periods) / STEPS_PER_PERIOD, record_dt)
    grid = _grid(source, given.get("run", {}), scales, structures, scheme, shortest, length)
    study = given.get("study", {})
    samples, chunk_size = study.get("samples", 10_000), study.get("chunk_size")
    for key, value in (("samples", samples), ("chunk_size", chunk_size)):
        if value is not None and value < 1:
            raise ValueError(f"{source}: [study] {key} = {value} must be positive")
    if not 0 <= (seed := study.get("seed", 0)) < 2**32:
        raise ValueError(f"{source}: [study] seed = {seed} must be from 0 to 2^32 - 1")
    drawn: AdjacentStructures | UncertainStructures = structures
    if uncertain := given.get("uncertain", {}):
        with named(f"{source}: [uncertain]"):
            drawn = UncertainStructures(
                structures,
                {
                    path: _scaled(value, float(attrgetter(path)(structures)))
                    for path, value in uncertain.items()
                },
            )
    with named(f"{source}:"):
        scenarios = Scenarios(drawn, ground)
    sampling = study.get("sampling", "plain")
    measures: dict[str, Measure] = {}
    if study.get("spectral_acceleration", False):
        gravity = float(scales.gravity)
        for i in (0, 1):
            measure = partial(_spectral_acceleration, grid, i, gravity)
            measures[f"spectral_acceleration_{i + 1}"] = measure
    return StudyConfiguration(
        source,
        text,
        scenarios,
        scales,
        grid,
        scheme,
        samples,
        seed,
        sampling,
        chunk_size,
        study.get("keep_failures", False),
        measures,
    )


def _spectral_acceleration(
    grid: TimeGrid,
    building: int,
    gravity: float,
    structures: AdjacentStructures,
    ground: GroundLike,
) -> jax.Array:
    """At the natural period of a building, with 5 % of damping, m/s²."""
    period = 2 * jnp.pi / structures.natural_frequencies[building]
    return gravity * spectral_acceleration(ground, grid, period=period)


def _flat(table: dict[str, Any]) -> dict[str, Any]:
    """``rod_1.tau_x = ...`` without quotation marks is a table within the table."""
    flat: dict[str, Any] = {}
    for key, value in table.items():
        nested = isinstance(value, dict) and key in ("rod_1", "rod_2")
        flat |= {f"{key}.{name}": x for name, x in value.items()} if nested else {key: value}
    return flat


def _scaled(value: dict[str, Any], factor: float) -> Distribution:
    """A distribution of the file, times a factor."""
    ((kind, (first, second)),) = value.items()
    scaled = (first * factor, second if kind == "lognormal" else second * factor)
    return _KINDS[kind](*scaled)


def _ground(
    source: str, given: dict[str, Any], folder: Path, scales: Scales
) -> tuple[RandomRicker | RandomRecord, float, float | None]:
    """The random ground motion; its records' shortest interval and longest duration, s."""
    table = given.get("earthquakes", {})
    by_record = "records" in table
    for key in _WAVELETS if by_record else _RECORDS:
        if key in table:
            rule = "be given with records" if by_record else "be given without records"
            raise ValueError(f"{source}: [earthquakes] {key} must not {rule}")
    length, time = float(scales.length), float(scales.time)
    if not by_record:
        wavelets, amplitude, periods, arrivals = (
            needed(source, given, "earthquakes", key) for key in _WAVELETS[:4]
        )
        with named(f"{source}: [earthquakes]"):
            waves = RandomRicker(
                wavelets,
                _scaled(amplitude, 1 / length),
                _scaled(periods, 1 / time),
                _scaled(arrivals, 1 / time),
                table.get("negative", 0.5),
                _scaled(table["intensity"], 1.0) if "intensity" in table else None,
            )
        return waves, float("inf"), None
    units = table.get("units", "g")
    records = [read_record(folder / file, units=units) for file in table["records"]]
    with named(f"{source}: [earthquakes]"):
        factor = _scaled(table["factor"], 1.0) if "factor" in table else None
        motions = tuple(scales.to_dimensionless(record) for record in records)
        drawn = RandomRecord(motions, factor, table.get("weights"))
    shortest = min(float(record.dt) for record in records)
    return drawn, shortest, max(float(record.duration) for record in records)


def _grid(
    source: str,
    run: dict[str, Any],
    scales: Scales,
    structures: AdjacentStructures,
    scheme: Scheme,
    shortest: float,
    length: float | None,
) -> TimeGrid:
    limit = stability_limit(structures, scheme) * float(scales.time)
    dt = run.get("dt", min(shortest, limit / 2))
    require_stable(source, dt, limit, "the nominal buildings")
    duration = run.get("duration", length)
    if duration is None:
        raise ValueError(f"{source}: lacks the key 'duration' in [run]")
    return time_grid(source, scales, duration, dt)
