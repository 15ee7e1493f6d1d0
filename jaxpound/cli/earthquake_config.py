"""Random and recorded earthquakes as configuration files state them; in SI."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

from jaxpound._checks import did_you_mean
from jaxpound.cli.config import (
    Keys,
    check_keys,
    is_number,
    named,
    needed,
    pair,
    parse,
    read_text,
    shown,
)
from jaxpound.cli.examples import example
from jaxpound.grid import TimeGrid
from jaxpound.ground.reader import read_record
from jaxpound.ground.record import Record
from jaxpound.model.structures import AdjacentStructures
from jaxpound.quantities import RANGES, Range, with_unit
from jaxpound.simulation.buildings import natural_periods, require_stable, time_grid, time_step
from jaxpound.simulation.scheme import Scheme, stability_limit
from jaxpound.study.distributions import RARE, LogNormal, Normal, Uniform, reach
from jaxpound.study.random_ground import RandomRecord, RandomRicker
from jaxpound.units import Scales

Stated = Normal | LogNormal | Uniform
"""The distributions that a file can state."""

_KINDS: dict[str, type[Normal] | type[LogNormal] | type[Uniform]] = {
    "normal": Normal,
    "lognormal": LogNormal,
    "uniform": Uniform,
}
_WAVELETS = ("wavelets", "amplitude", "periods", "arrivals", "negative", "intensity")
_RECORDS = ("records", "units", "factor", "weights")


def distribution(value: Any) -> str:
    """What is wrong with a distribution, or nothing."""
    rule = "{normal = [mean, std]}, {lognormal = [median, sigma]} or {uniform = [low, high]}"
    if not (isinstance(value, dict) and len(value) == 1):
        return rule
    ((kind, given),) = value.items()
    if kind not in _KINDS:
        close = did_you_mean(kind, _KINDS)
        return f"{rule}; {close}" if close else rule
    right = isinstance(given, list) and len(given) == 2
    return "" if right and all(map(is_number, given)) else f"{rule}, of finite numbers"


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


def weights(value: Any) -> str:
    """What is wrong with a list of relative frequencies, or nothing."""
    right = isinstance(value, list) and value and all(map(is_number, value))
    if not right:
        return "a list of finite numbers"
    allowed = RANGES["weight"]
    return "" if all(x in allowed for x in value) else f"of numbers {allowed.rule}"


EARTHQUAKES: dict[str, Any] = {
    "wavelets": RANGES["count"],
    "amplitude": distribution,
    "periods": distribution,
    "arrivals": distribution,
    "negative": RANGES["probability"],
    "intensity": distribution,
    "records": files,
    "units": word,
    "factor": distribution,
    "weights": weights,
}
"""Allowed keys of the table [earthquakes]."""


def by_path(table: dict[str, Any]) -> dict[str, Any]:
    """``rod_1.tau_x = ...`` without quotation marks is a table within the table."""
    flat: dict[str, Any] = {}
    for key, value in table.items():
        nested = isinstance(value, dict) and key in ("rod_1", "rod_2")
        flat |= {f"{key}.{name}": x for name, x in value.items()} if nested else {key: value}
    return flat


def drawn(source: str, given: dict[str, Any], table: str, key: str, unit: str) -> Stated:
    """The distribution of a key, in the file's unit."""
    value = needed(source, given, table, key)
    ((kind, numbers),) = value.items()
    names = ("mean", "std", "median", "low", "high")
    with named(f"{source}: [{table}] {key}:", dict.fromkeys(names, unit)):
        return _KINDS[kind](*map(float, numbers))


def scaled(distribution: Stated, factor: float) -> Stated:
    """The distribution of a factor's multiples."""
    if isinstance(distribution, LogNormal):
        return LogNormal(distribution.median * factor, distribution.sigma)
    if isinstance(distribution, Normal):
        return Normal(distribution.mean * factor, distribution.std * factor)
    return Uniform(distribution.low * factor, distribution.high * factor)


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
    place = f"{source}: [earthquakes]"

    def one(key: str) -> Stated:
        allowed = RANGES[key]
        found = drawn(source, given, "earthquakes", key, allowed.unit)
        require_reach(f"{place} {key}", table[key], found, allowed)
        return found

    length, time = float(scales.length), float(scales.time)
    if not by_record:
        wavelets = needed(source, given, "earthquakes", "wavelets")
        amplitude, periods, arrivals = map(one, ("amplitude", "periods", "arrivals"))
        intensity = one("intensity") if "intensity" in table else None
        with named(place):
            waves = RandomRicker(
                wavelets,
                scaled(amplitude, 1 / length),
                scaled(periods, 1 / time),
                scaled(arrivals, 1 / time),
                table.get("negative", 0.5),
                intensity,
            )
        return waves, float("inf"), None
    records = read_records(f"{place} records", folder, table["records"], table.get("units"))
    factor = one("factor") if "factor" in table else None
    with named(place):
        motions = tuple(scales.to_dimensionless(record) for record in records)
        chosen = RandomRecord(motions, factor, table.get("weights"))
    shortest = min(float(record.dt) for record in records)
    return chosen, shortest, max(float(record.duration) for record in records)


def read_records(place: str, folder: Path, names: Iterable[str], units: str | None) -> list[Record]:
    """The accelerograms of files beside a configuration; ``place`` is where it names them."""
    try:
        return [read_record(folder / name, units=units) for name in names]
    except (OSError, ValueError) as error:
        raise ValueError(f"{place}: {str(error).removeprefix('read_record: ')}") from error


def require_reach(place: str, value: Any, found: Stated, allowed: Range) -> None:
    """A ``ValueError`` for a distribution some of whose draws would be outside of a range."""
    for end in reach(found):
        if end not in allowed:
            told = with_unit(f"{end:.4g}", allowed.unit)
            often = "" if isinstance(found, Uniform) else f" once in {1 / RARE:,.0f} draws"
            what = f"{place} = {shown(value)} reaches {told}{often}; it"
            raise ValueError(f"{what} must stay {allowed.rule}")


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
        grid = time_grid(f"{self.source}: [run]", self.scales, duration, dt)
        if "arrivals" in (table := self.given["earthquakes"]):
            within = Range(0.0, duration, "s", "the run, so that every wavelet shakes")
            arrivals = drawn(self.source, self.given, "earthquakes", "arrivals", within.unit)
            place = f"{self.source}: [earthquakes] arrivals"
            require_reach(place, table["arrivals"], arrivals, within)
        return grid


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
