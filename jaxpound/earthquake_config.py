"""Random and recorded earthquakes as configuration files state them; in SI."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

from jaxpound.buildings import natural_periods, require_stable, time_grid, time_step
from jaxpound.config import (
    Keys,
    check_keys,
    example,
    named,
    needed,
    pair,
    parse,
    read_text,
)
from jaxpound.distributions import Distribution, LogNormal, Normal, Uniform
from jaxpound.ground import Record
from jaxpound.records import read_record
from jaxpound.scenarios import RandomRecord, RandomRicker
from jaxpound.scheme import Scheme, TimeGrid, stability_limit
from jaxpound.structures import AdjacentStructures
from jaxpound.units import Scales

_KINDS: dict[str, Callable[[float, float], Distribution]] = {
    "normal": Normal,
    "lognormal": LogNormal,
    "uniform": Uniform,
}
_WAVELETS = ("wavelets", "amplitude", "periods", "arrivals", "negative", "intensity")
_RECORDS = ("records", "units", "factor", "weights")


def distribution(value: Any) -> str:
    """What is wrong with a distribution, or nothing."""
    rule = "{normal = [mean, std]}, {lognormal = [median, sigma]} or {uniform = [low, high]}"
    if not (isinstance(value, dict) and len(value) == 1 and {*value} <= {*_KINDS}):
        return rule
    (given,) = value.values()
    right = isinstance(given, list) and len(given) == 2
    return "" if right and all(type(x) in (int, float) for x in given) else rule


def files(value: Any) -> str:
    """What is wrong with a list of files, or nothing."""
    right = isinstance(value, list) and value and all(isinstance(x, str) for x in value)
    return "" if right else "a list of files"


def word(value: Any) -> str:
    """What is wrong with a text, or nothing."""
    return "" if isinstance(value, str) else "a text"


def flag(value: Any) -> str:
    """What is wrong with a flag, or nothing."""
    return "" if isinstance(value, bool) else "true or false"


def numbers(value: Any) -> str:
    """What is wrong with a list of numbers, or nothing."""
    right = isinstance(value, list) and value and all(type(x) in (int, float) for x in value)
    return "" if right else "a list of numbers"


EARTHQUAKES: dict[str, Any] = {
    "wavelets": int,
    "amplitude": distribution,
    "periods": distribution,
    "arrivals": distribution,
    "negative": float,
    "intensity": distribution,
    "records": files,
    "units": word,
    "factor": distribution,
    "weights": numbers,
}
"""Allowed keys of the table [earthquakes]."""


def by_path(table: dict[str, Any]) -> dict[str, Any]:
    """``rod_1.tau_x = ...`` without quotation marks is a table within the table."""
    flat: dict[str, Any] = {}
    for key, value in table.items():
        nested = isinstance(value, dict) and key in ("rod_1", "rod_2")
        flat |= {f"{key}.{name}": x for name, x in value.items()} if nested else {key: value}
    return flat


def scaled(value: dict[str, Any], factor: float) -> Distribution:
    """A distribution of the file, times a factor."""
    ((kind, (first, second)),) = value.items()
    scaled = (first * factor, second if kind == "lognormal" else second * factor)
    return _KINDS[kind](*scaled)


def random_ground(
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
                scaled(amplitude, 1 / length),
                scaled(periods, 1 / time),
                scaled(arrivals, 1 / time),
                table.get("negative", 0.5),
                scaled(table["intensity"], 1.0) if "intensity" in table else None,
            )
        return waves, float("inf"), None
    units = table.get("units", "g")
    records = [read_record(folder / file, units=units) for file in table["records"]]
    with named(f"{source}: [earthquakes]"):
        factor = scaled(table["factor"], 1.0) if "factor" in table else None
        motions = tuple(scales.to_dimensionless(record) for record in records)
        drawn = RandomRecord(motions, factor, table.get("weights"))
    shortest = min(float(record.dt) for record in records)
    return drawn, shortest, max(float(record.duration) for record in records)


class Opened(NamedTuple):
    """What files of random earthquakes have in common, read and checked."""

    source: str
    text: str
    given: dict[str, Any]
    folder: Path
    structures: AdjacentStructures
    scales: Scales
    scheme: Scheme
    ground: RandomRicker | RandomRecord
    record_dt: float
    """Shortest sample interval of the records, s; infinite where there are none."""
    duration: float | None
    """Of the longest record, s."""

    def grid(self, records: Iterable[Record] = ()) -> TimeGrid:
        """The dimensionless time grid, for further records as well."""
        run, records = self.given.get("run", {}), list(records)
        shortest = min([self.record_dt, *(float(record.dt) for record in records)])
        limit = stability_limit(self.structures, self.scheme) * float(self.scales.time)
        periods = natural_periods(self.structures, self.scales)
        dt = run.get("dt", time_step(periods, limit, shortest))
        require_stable(f"{self.source}: [run]", dt, limit, "the nominal buildings")
        lengths = [float(record.duration) for record in records]
        longest = max([*lengths, *([] if self.duration is None else [self.duration])], default=None)
        duration = run.get("duration", longest)
        if duration is None:
            raise ValueError(f"{self.source}: lacks the key 'duration' in [run]")
        return time_grid(f"{self.source}: [run]", self.scales, duration, dt)


def opened(path: Path | None, kind: str, standard: str, keys: Keys, by_field: str) -> Opened:
    """Read and check a file, or the example ``standard`` of its kind if path is None.

    ``by_field`` is the table whose keys are field paths.
    """
    source = f"example {kind}" if path is None else str(path)
    text = example(standard) if path is None else read_text(path)
    given = parse(source, text)
    if isinstance(table := given.get(by_field), dict):
        given[by_field] = by_path(table)
    check_keys(source, given, keys)
    _, _, structures, scales, scheme = pair(source, given)
    folder = Path() if path is None else path.parent
    ground, record_dt, duration = random_ground(source, given, folder, scales)
    return Opened(
        source, text, given, folder, structures, scales, scheme, ground, record_dt, duration
    )
