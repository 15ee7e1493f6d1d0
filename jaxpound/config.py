"""What ``jaxpound simulate`` is told in a TOML file: two buildings, damper, ground, run; in SI."""

from __future__ import annotations

import dataclasses
import re
import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import resources
from pathlib import Path
from typing import Any

from jaxpound._checks import did_you_mean
from jaxpound.buildings import record_grid, simulate_buildings
from jaxpound.friction import EventResolved, FrictionLaw, Smoothed, Switching
from jaxpound.ground import Record
from jaxpound.intensity import pga
from jaxpound.response import Response
from jaxpound.scheme import Scheme, TimeGrid
from jaxpound.structures import AdjacentStructures
from jaxpound.units import Building, Scales, dimensionless

_BY_ROD = ("mass", "stiffness", "order", "tau_f", "tau_x")
_BY_PERIOD = ("mass", "period", "damping_ratio")
BUILDING = dict.fromkeys((*_BY_ROD, *_BY_PERIOD), float)

Keys = dict[str, dict[str, Any]]
"""Allowed keys of each table ("" is the top level): a number, a whole number, one of some words, or
what a function (of the value) says is wrong with it."""

RUN: dict[str, Any] = {
    "duration": float,
    "dt": float,
    "friction": ("event-resolved", "switching", "smoothed"),
    "smoothing_velocity": float,
    "order": int,
}
_KEYS: Keys = {
    "": {"gap": float},
    "building_1": BUILDING,
    "building_2": BUILDING,
    "damper": {"friction_force": float},
    "ground": {"baseline": ("none", "mean", "linear"), "scale": float, "pga": float},
    "run": RUN,
    "output": {"series": ("npz", "csv", "none")},
}
_MOST_PGA = 20.0  # in g, several times the largest ever recorded: beyond it the units are wrong


@dataclasses.dataclass(frozen=True)
class Configuration:
    """Two buildings in SI units, what shakes them and how the run is made.

    ``source`` is the file's name, the start of every message; ``given`` is what the file says.
    """

    source: str
    given: dict[str, Any]
    building_1: Building
    building_2: Building
    structures: AdjacentStructures
    scales: Scales
    scheme: Scheme

    @property
    def series(self) -> str:
        """Format of the time series: "npz", "csv" or "none"."""
        return self.given.get("output", {}).get("series", "npz")

    def shaking(self, record: Record) -> Record:
        """The record with the baseline correction and the scaling asked for.

        Raises
        ------
        ValueError
            If the target PGA is not positive or the record is zero throughout; if the result
            exceeds any earthquake.
        """
        ground = self.given.get("ground", {})
        if (baseline := ground.get("baseline", "none")) != "none":
            record = record.baseline_corrected(baseline)
        if "pga" in ground:
            with named(f"{self.source}: [ground]"):
                record = record.scaled_to_pga(ground["pga"])
        elif (scale := ground.get("scale", 1.0)) != 1:
            record = Record(record.samples * scale, record.dt, record.name, record.time_unit)
        if not (peak := float(pga(record))) <= _MOST_PGA:
            rule = f"at most {_MOST_PGA:g} g: are the record's units right?"
            raise ValueError(f"{self.source}: record: PGA = {peak:.4g} g must be {rule}")
        return record

    def grid(self, record: Record) -> TimeGrid:
        """The dimensionless time grid of the run.

        Raises
        ------
        ValueError
            If dt or duration breaks its rule.
        """
        place = f"{self.source}: [run]"
        return record_grid(place, self.structures, self.scales, self.scheme, record, **self._run)

    def response(self, record: Record, *, strict: bool = False) -> Response:
        """The run in SI units, as ``simulate_buildings`` makes it.

        Raises
        ------
        ValueError
            If dt or duration breaks its rule; if strict, where there would be a warning.
        """
        self.grid(record)  # so that messages on dt and duration have their place in the file
        with named(f"{self.source}:"):
            return simulate_buildings(
                self.building_1,
                self.building_2,
                record,
                friction_force=self.given["damper"]["friction_force"],
                gap=self.given["gap"],
                scheme=self.scheme,
                strict=strict,
                **self._run,
            )

    @property
    def _run(self) -> dict[str, float]:
        """Duration and time step, as far as they are given, s."""
        run = self.given.get("run", {})
        return {key: run[key] for key in ("duration", "dt") if key in run}


def example(name: str = "example_config.toml") -> str:
    """A documented example configuration, as text."""
    return (resources.files("jaxpound") / name).read_text(encoding="utf-8")


def read_config(path: Path | None) -> Configuration:
    """Read and check a configuration file, or the example if ``path`` is None.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If it is not TOML, has a key that is not allowed, lacks one that is needed, or a value is
        of the wrong type or breaks its rule. The message names file, table, key, value and rule.
    """
    source = "example configuration" if path is None else str(path)
    given = parse(source, example() if path is None else read_text(path))
    check_keys(source, given, _KEYS)
    if "scale" in given.get("ground", {}) and "pga" in given["ground"]:
        raise ValueError(f"{source}: [ground] must have scale or pga, not both")
    return Configuration(source, given, *pair(source, given))


def read_text(path: Path) -> str:
    """A file's text, which must be UTF-8."""
    try:
        return path.read_bytes().decode("utf-8")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: must be text in UTF-8 ({error})") from error


def parse(source: str, text: str) -> dict[str, Any]:
    """A configuration's tables."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{source}{_place(str(error))}: {error}") from error


def pair(
    source: str, given: dict[str, Any]
) -> tuple[Building, Building, AdjacentStructures, Scales, Scheme]:
    """The two buildings, the dimensionless system with its scales, and the scheme."""
    for table in ("building_1", "building_2", "damper"):
        if table not in given:
            raise ValueError(f"{source}: lacks the table [{table}]")
    friction_force = needed(source, given, "damper", "friction_force")
    gap = needed(source, given, "", "gap")
    left, right = (_building(source, given, table) for table in ("building_1", "building_2"))
    with named(f"{source}:"):
        structures, scales = dimensionless(left, right, friction_force, gap)
    return left, right, structures, scales, _scheme(source, given.get("run", {}), scales)


def _place(message: str) -> str:
    line = re.search(r"at line (\d+)", message)
    return f":{line[1]}" if line else ""


def check_keys(source: str, given: dict[str, Any], keys: Keys) -> None:
    """Refuse a key that is not allowed where it stands, or a value of the wrong kind."""
    for name, value in given.items():
        if name not in keys or name == "":
            if name not in keys[""]:
                raise ValueError(f"{source}: {_unknown('', name, keys)}")
            _check_value(f"{source}: {name}", keys[""][name], value)
        elif not isinstance(value, dict):
            raise ValueError(f"{source}: {name} = {value!r} must be a table, [{name}]")
        else:
            for key, entry in value.items():
                if key not in keys[name]:
                    raise ValueError(f"{source}: {_unknown(name, key, keys)}")
                _check_value(f"{source}: [{name}] {key}", keys[name][key], entry)


def _unknown(table: str, key: str, keys: Keys) -> str:
    """What is wrong with a key that is not allowed here, and what may have been meant."""
    allowed = [*keys[table], *(name for name in keys if name and not table)]
    where = f"[{table}] has" if table else "the top level has"
    homes = [_title(other) for other in keys if key in keys[other]]
    close = did_you_mean(key.lower(), allowed)
    if homes:
        hint = f"it belongs in {' or '.join(homes)}"
    elif close:
        hint = close
    else:
        hint = f"allowed are {', '.join(allowed)}"
    return f"{where} an unknown key {key!r}; {hint}"


def _title(table: str) -> str:
    return f"[{table}]" if table else "the top level, before the first [table]"


def _check_value(place: str, kind: Any, value: Any) -> None:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if kind is float:
        right, rule = number and abs(value) <= sys.float_info.max, "a finite number"
    elif kind is int:
        right, rule = number and isinstance(value, int), "a whole number"
    elif isinstance(kind, tuple):
        right, rule = value in kind, "one of " + ", ".join(f'"{word}"' for word in kind)
    else:
        rule = kind(value)
        right = not rule
    if not right:
        raise ValueError(f"{place} = {value!r} must be {rule}")


def needed(source: str, given: dict[str, Any], table: str, key: str) -> Any:
    """The value of a key that must be there."""
    values = given.get(table, {}) if table else given
    if key not in values:
        raise ValueError(f"{source}: lacks the key {key!r} in {_title(table)}")
    return values[key]


def _building(source: str, given: dict[str, Any], table: str) -> Building:
    values = given[table]
    ways = f"{', '.join(_BY_PERIOD)} (order, tau_f), or {', '.join(_BY_ROD)}"
    by_period = not values.keys().isdisjoint(("period", "damping_ratio"))
    clashing = [key for key in ("stiffness", "tau_x") if by_period and key in values]
    if clashing:
        raise ValueError(f"{source}: [{table}] must not have {clashing[0]} here; give {ways}")
    missing = [key for key in (_BY_PERIOD if by_period else _BY_ROD) if key not in values]
    if missing:
        raise ValueError(f"{source}: [{table}] lacks {', '.join(missing)}; give {ways}")
    numbers = {key: float(value) for key, value in values.items()}
    with named(f"{source}: [{table}]"):
        return Building.from_period(**numbers) if by_period else Building(**numbers)


def _scheme(source: str, run: dict[str, Any], scales: Scales) -> Scheme:
    name, velocity = run.get("friction", "event-resolved"), run.get("smoothing_velocity")
    if (name == "smoothed") != (velocity is not None):
        rule = 'must be given with friction = "smoothed", and only then'
        raise ValueError(f"{source}: [run] smoothing_velocity {rule}")
    law: FrictionLaw = Switching() if name == "switching" else EventResolved()
    if velocity is not None:
        if velocity <= 0:
            rule = "must be positive"
            raise ValueError(f"{source}: [run] smoothing_velocity = {velocity:.6g} m/s {rule}")
        law = Smoothed(velocity * float(scales.time / scales.length))
    with named(f"{source}: [run]"):
        return Scheme(law, order=run.get("order", 2))


@contextmanager
def named(place: str) -> Iterator[None]:
    """Put the place in the file where the core's messages have the name of a class."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{place} {re.sub(r'^[A-Za-z_.]+: ', '', str(error))}") from error
