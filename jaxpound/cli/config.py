"""What ``jaxpound simulate`` is told in a TOML file: two buildings, damper, ground, run; in SI."""

from __future__ import annotations

import dataclasses
import json
import re
import sys
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from jaxpound._checks import did_you_mean
from jaxpound.cli.examples import example
from jaxpound.grid import TimeGrid
from jaxpound.ground.intensity import pga
from jaxpound.ground.reader import require_possible
from jaxpound.ground.record import Record
from jaxpound.model.building import Building
from jaxpound.model.rod import ZenerRod
from jaxpound.model.structures import AdjacentStructures
from jaxpound.quantities import RANGES, Range, with_unit
from jaxpound.results.response import Response
from jaxpound.simulation.buildings import record_grid, simulate_buildings
from jaxpound.simulation.friction import EventResolved, FrictionLaw, Smoothed, Switching
from jaxpound.simulation.scheme import Scheme
from jaxpound.units import Scales, dimensionless

_BY_ROD = ("mass", "stiffness", "order", "tau_f", "tau_x")
_BY_PERIOD = ("mass", "period", "damping_ratio")
_BUILDING = {key: RANGES[key] for key in (*_BY_PERIOD, *_BY_ROD)}

Keys = dict[str, dict[str, Any]]
"""Allowed keys of each table ("" is the top level): a number in a ``Range``, one of some words, or
what a function (of the value) says is wrong with it."""

PAIR: Keys = {
    "": {"gap": RANGES["gap"]},
    "building_1": _BUILDING,
    "building_2": _BUILDING,
    "damper": {"friction_force": RANGES["friction_force"]},
    "run": {
        "duration": RANGES["duration"],
        "dt": RANGES["dt"],
        "friction": ("event-resolved", "switching", "smoothed"),
        "smoothing_velocity": RANGES["smoothing_velocity"],
        "order": RANGES["accuracy"],
    },
}
"""What every kind of configuration says of two buildings and a run."""

UNITS = {key: RANGES[key].unit for key in (*_BUILDING, "gap", "friction_force")}
"""Unit of each number of two buildings and the damper, by key."""

_KEYS: Keys = PAIR | {
    "ground": {
        "baseline": ("none", "mean", "linear"),
        "scale": RANGES["factor"],
        "pga": RANGES["pga"],
    },
    "output": {"series": ("npz", "csv", "none")},
}
_MOST_BYTES = 2**20  # of a file: a configuration is a page of text
_MOST_SHOWN = 80  # characters of a value in a message


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
        hint = "is [ground] pga or scale right?"
        require_possible(f"{self.source}: record", "PGA", float(pga(record)), hint)
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
    """A file's text, which must be UTF-8 and of a configuration's size."""
    with path.open("rb") as file:
        content = file.read(_MOST_BYTES + 1)
    if len(content) > _MOST_BYTES:
        raise ValueError(f"{path}: must be a configuration of at most {_MOST_BYTES:,} bytes")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: must be text in UTF-8 ({error})") from error


def parse(source: str, text: str) -> dict[str, Any]:
    """A configuration's tables."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{source}{_place(str(error))}: {error}") from error
    except RecursionError as error:
        raise ValueError(f"{source}: its lists or tables are nested too deeply") from error
    except ValueError:
        # Python makes no whole number of more than 4,300 digits. One of 4,300 exceeds every range
        # as well, and is refused by the name of its key.
        return parse(source, re.sub(r"\d[\d_]*", _shortened, text))


def _shortened(digits: re.Match[str]) -> str:
    most = sys.get_int_max_str_digits()
    return digits[0] if len(digits[0]) <= most else digits[0].replace("_", "")[:most]


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
    with named(f"{source}:", UNITS):
        structures, scales = dimensionless(left, right, float(friction_force), float(gap))
    return left, right, structures, scales, _scheme(source, given.get("run", {}), scales)


def in_si(structures: AdjacentStructures, scales: Scales) -> AdjacentStructures:
    """The same parameters in SI units: relaxation times in s^order, slip force in N, gap in m.

    Their rules are the same in every unit, so that what breaks one is named as the file has it.
    """
    left, right, friction_force, gap = scales.buildings(structures)
    return dataclasses.replace(
        structures,
        rod_1=ZenerRod(left.order, left.tau_f, left.tau_x),
        rod_2=ZenerRod(right.order, right.tau_f, right.tau_x),
        friction=friction_force,
        initial_gap=gap,
    )


_STANDS_FOR = {
    "friction": ("damper", "friction_force"),
    "initial_gap": ("", "gap"),
    "mass_ratio": ("building_2", "mass"),
    "stiffness_ratio": ("building_2", "stiffness"),
    **{f"rod_{i}.{key}": (f"building_{i}", key) for i in (1, 2) for key in _BY_ROD[2:]},
}
"""Table and key that each parameter of the structures stands for."""


def require_plausible(
    extremes: Iterable[tuple[str, str, AdjacentStructures]], scales: Scales
) -> None:
    """A ``ValueError`` for a parameter that leaves the range of what it stands for.

    ``extremes`` are a place in a file, the path of a parameter, and the structures in SI units
    (``in_si``) where it is at an end. Natural periods come last, as all parameters of a building
    make them.
    """
    periods = []
    for place, path, at in extremes:
        table, key = _STANDS_FOR[path]
        stiffness = scales.mass * scales.frequency**2
        with named(place, UNITS):
            buildings = {
                "building_1": Building(scales.mass, stiffness, **vars(at.rod_1)),
                "building_2": Building(
                    scales.mass / at.mass_ratio, stiffness * at.stiffness_ratio, **vars(at.rod_2)
                ),
            }
        if table in buildings:
            periods.append((f"{place} [{table}] natural period", buildings[table]))
            value = getattr(buildings[table], key)
        else:
            value = at.friction if table else at.initial_gap
        require_in_range(f"{place} {f'[{table}] ' if table else ''}{key}", key, value)
    for place, building in periods:
        require_in_range(place, "period", building.natural_period)


def require_in_range(place: str, quantity: str, value: Any) -> None:
    """A ``ValueError`` for a number that no such quantity has."""
    allowed = RANGES[quantity]
    if (number := float(value)) not in allowed:
        told = with_unit(f"{number:.6g}", allowed.unit)
        raise ValueError(f"{place} = {told} must be {allowed.rule}")


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
    if isinstance(kind, Range):
        told = shown(value)
        if not is_number(value):
            rule = "a finite number"
        elif kind.whole and not isinstance(value, int):
            rule = "a whole number"
        else:
            told, rule = with_unit(told, kind.unit), "" if value in kind else kind.rule
    elif isinstance(kind, tuple):
        told, rule = shown(value), ""
        if value not in kind:
            rule = "one of " + ", ".join(f'"{word}"' for word in kind)
            if close := isinstance(value, str) and did_you_mean(value, kind):
                rule += f"; {close}"
    else:
        told, rule = shown(value), kind(value)
    if rule:
        raise ValueError(f"{place} = {told} must be {rule}")


def is_number(value: Any) -> bool:
    """Whether a value of a file is a finite number."""
    return type(value) in (int, float) and abs(value) <= sys.float_info.max  # false for NaN too


def shown(value: Any) -> str:
    """A value as a file has it, shortened where it is long."""
    text = _shown(value, 3)
    return text if len(text) <= _MOST_SHOWN else f"{text[: _MOST_SHOWN - 4]} ..."


def _shown(value: Any, depth: int) -> str:
    if isinstance(value, bool | str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, int) and abs(value) > sys.float_info.max:
        return f"a whole number of more than {sys.float_info.max_10_exp} digits"
    if isinstance(value, float):
        return repr(value) if len(repr(value)) <= 8 else f"{value:.8g}"
    if isinstance(value, dict | list) and not depth:
        return "..."
    if isinstance(value, list):
        return f"[{', '.join(_shown(x, depth - 1) for x in value[:_MOST_SHOWN])}]"
    if isinstance(value, dict):
        entries = list(value.items())[:_MOST_SHOWN]
        return f"{{{', '.join(f'{key} = {_shown(x, depth - 1)}' for key, x in entries)}}}"
    return str(value)


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
    place = f"{source}: [{table}]"
    with named(place, UNITS):
        building = Building.from_period(**numbers) if by_period else Building(**numbers)
    if not by_period:
        require_in_range(f"{place} natural period", "period", building.natural_period)
    return building


def _scheme(source: str, run: dict[str, Any], scales: Scales) -> Scheme:
    name, velocity = run.get("friction", "event-resolved"), run.get("smoothing_velocity")
    if (name == "smoothed") != (velocity is not None):
        rule = 'must be given with friction = "smoothed", and only then'
        raise ValueError(f"{source}: [run] smoothing_velocity {rule}")
    law: FrictionLaw = Switching() if name == "switching" else EventResolved()
    if velocity is not None:
        law = Smoothed(velocity * float(scales.time / scales.length))
    with named(f"{source}: [run]"):
        return Scheme(law, order=run.get("order", 2))


@contextmanager
def named(place: str, units: Mapping[str, str] | None = None) -> Iterator[None]:
    """Put the place in the file where the core's messages have the name of a class.

    ``units`` are those of the numbers in these messages, by name.
    """
    try:
        yield
    except ValueError as error:
        words = re.sub(r"^[A-Za-z_.]+: ", "", str(error))
        for name, unit in (units or {}).items():
            if unit:
                words = re.sub(rf"(?<!\w)({name} = -?[\w.+-]*\w)", rf"\1 {unit}", words)
        raise ValueError(f"{place} {words}") from error
