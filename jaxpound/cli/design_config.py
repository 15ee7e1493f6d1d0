"""What ``jaxpound design`` is told in a TOML file: buildings, earthquakes, variables; in SI."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from jaxpound._checks import did_you_mean
from jaxpound.cli.config import (
    PAIR,
    Keys,
    in_si,
    is_number,
    named,
    needed,
    require_plausible,
    shown,
)
from jaxpound.cli.earthquake_config import EARTHQUAKES, files, opened, read_records, word
from jaxpound.cli.examples import DESIGN as EXAMPLE
from jaxpound.design.ensemble import Ensemble
from jaxpound.design.objective import (
    PRICES,
    CVaR,
    Goal,
    Limit,
    MeanGap,
    Objective,
    Penalty,
    PoundingProbability,
    SoftMinimum,
    WorstGap,
)
from jaxpound.design.space import Bounds, DesignSpace
from jaxpound.grid import TimeGrid
from jaxpound.ground.reader import read_record
from jaxpound.ground.record import Record
from jaxpound.model import parameters
from jaxpound.model.structures import AdjacentStructures
from jaxpound.quantities import RANGES, Range
from jaxpound.results.demand import kind_of
from jaxpound.simulation.scheme import Scheme
from jaxpound.study.scenarios import Scenarios
from jaxpound.units import Scales

_GOALS = ("mean gap", "worst gap", "soft minimum", "CVaR", "pounding probability")


_TAU = {"tau_f": RANGES["tau_f"].unit, "tau_x": RANGES["tau_x"].unit}


def _bounds(value: Any) -> str:
    """What is wrong with the bounds of a variable, or nothing."""
    rule, allowed = '{low = ..., high = ..., scale = "linear" or "log"}', RANGES["multiple"]
    if not isinstance(value, dict):
        return rule
    if wrong := _entries(value, ("low", "high"), ("low", "high", "scale")):
        return f"{rule}{wrong}"
    if not all(is_number(value[key]) and value[key] in allowed for key in ("low", "high")):
        return f"{rule}, with low and high {allowed.rule}"
    return "" if value.get("scale", "linear") in ("linear", "log") else rule


def _price(key: str, allowed: Range, value: Any) -> str:
    """What is wrong with a limit or a penalty, or nothing."""
    rule = f'a number, or {{{key} = ..., over = "worst", "mean" or a share}}'
    if isinstance(value, dict):
        if wrong := _entries(value, (key,), (key, "over")):
            return f"{rule}{wrong}"
        value = value[key]
    if not is_number(value):
        return rule
    return "" if value in allowed else allowed.rule


def _entries(value: dict[str, Any], needed: tuple[str, ...], allowed: tuple[str, ...]) -> str:
    """What is to be added to a rule because of the keys of a value, or nothing."""
    for key in value:
        if key not in allowed:
            close = did_you_mean(key, allowed)
            return f"; {close}" if close else f", without {key!r}"
    lacking = [key for key in needed if key not in value]
    return f"; it lacks {lacking[0]!r}" if lacking else ""


_KEYS: Keys = PAIR | {
    "earthquakes": EARTHQUAKES,
    "recorded": {"files": files, "units": word},
    "variables": dict.fromkeys(parameters.paths(AdjacentStructures), _bounds),
    "objective": {
        "goal": _GOALS,
        "temperature": RANGES["temperature"],
        "share": RANGES["share"],
        "gap": RANGES["gap"],
    },
    "limits": {
        price: partial(_price, "at_most", RANGES[kind_of(price) or "length"]) for price in PRICES
    },
    "penalties": dict.fromkeys(PRICES, partial(_price, "weight", RANGES["penalty"])),
    "search": {
        "earthquakes": RANGES["count"],
        "fresh": RANGES["count_or_none"],
        "starts": RANGES["count"],
        "iterations": RANGES["count"],
        "batch": RANGES["count"],
        "seed": RANGES["seed"],
    },
}


@dataclasses.dataclass(frozen=True)
class DesignConfiguration:
    """A design of two buildings in SI units; ``text`` is the file's."""

    source: str
    text: str
    space: DesignSpace
    ensemble: Ensemble
    recorded: dict[str, Ensemble]
    objective: Objective
    scales: Scales
    grid: TimeGrid
    scheme: Scheme
    search: dict[str, Any]
    fresh: int


def read_design(path: Path | None, records: Sequence[Path] = ()) -> DesignConfiguration:
    """Read and check the configuration of a design, or the example if ``path`` is None.

    ``records`` are accelerograms in g that join the random earthquakes.

    Raises
    ------
    OSError
        If the file, or one of ``records``, cannot be read.
    ValueError
        As ``config.read_config``, and for a record that it names and that cannot be read.
    """
    read = opened(path, "design", EXAMPLE, _KEYS, by_field="variables")
    source, given, structures, scales = read.source, read.given, read.structures, read.scales
    recorded = _recorded(source, given, read.folder, records)
    grid = read.grid(recorded.values())
    search = {"earthquakes": 256, "fresh": 1000, "seed": 0} | given.get("search", {})
    n = search.pop("earthquakes")
    if search.get("batch", 1) > (most := n + len(recorded)):
        rule = f"at most the number of earthquakes, {most}"
        raise ValueError(f"{source}: [search] batch = {search['batch']} must be {rule}")
    shaking = {name: scales.to_dimensionless(record) for name, record in recorded.items()}
    alone = {name: Ensemble.of([record], grid) for name, record in shaking.items()}
    with named(f"{source}:"):
        ensemble = Ensemble.drawn(Scenarios(structures, read.ground), n, search["seed"])
        whole = Ensemble.of([*ensemble, *shaking.values()], grid) if shaking else ensemble
    return DesignConfiguration(
        source,
        read.text,
        _space(source, given, structures, scales),
        dataclasses.replace(whole, _more=ensemble._more),
        alone,
        _objective(source, given),
        scales,
        grid,
        read.scheme,
        {("key" if key == "seed" else key): x for key, x in search.items() if key != "fresh"},
        search["fresh"],
    )


def _recorded(
    source: str, given: dict[str, Any], folder: Path, more: Sequence[Path]
) -> dict[str, Record]:
    """Recorded earthquakes of the file, and others in g, by name."""
    table = given.get("recorded", {})
    if table and "files" not in table:
        raise ValueError(f"{source}: lacks the key 'files' in [recorded]")
    names, units = table.get("files", []), table.get("units")
    own = read_records(f"{source}: [recorded] files", folder, names, units)
    read = [(folder / name, record) for name, record in zip(names, own, strict=True)]
    read += [(file, read_record(file)) for file in more]
    found: dict[str, Record] = {}
    for file, record in read:
        if file.stem in found:
            raise ValueError(f"record {file}: its name {file.stem!r} must be another's than before")
        found[file.stem] = record
    return found


def _space(
    source: str, given: dict[str, Any], structures: AdjacentStructures, scales: Scales
) -> DesignSpace:
    """The variables; in the file their bounds are factors on the values that it states."""
    variables = given.get("variables", {})
    if not variables:
        raise ValueError(f"{source}: [variables] must name what may be chosen")
    in_si_units = in_si(structures, scales)
    made: dict[str, dict[str, Bounds]] = {"SI": {}, "dimensionless": {}}
    for path, value in variables.items():
        place = f"{source}: [variables] {path}"
        with named(f"{place}:"):
            Bounds(**value)
        if not value["low"] <= 1 <= value["high"]:
            rule = "must hold the factor 1: the search starts at the buildings as they are"
            raise ValueError(f"{place} = {shown(value)} {rule}")
        for units, nominal in (("SI", in_si_units), ("dimensionless", structures)):
            own = float(parameters.get(nominal, path))
            if not own:
                raise ValueError(f"{place} must be of a value above 0, for factors on it")
            low, high = value["low"] * own, value["high"] * own
            with named(f"{place}:"):
                made[units][path] = Bounds(low, high, value.get("scale", "linear"))
    # In SI units first, which messages are about.
    with named(f"{source}: [variables]", _TAU):
        physical = DesignSpace(in_si_units, made["SI"])
        start = physical.shares(in_si_units)
    extremes = []
    for i, path in enumerate(physical.names):
        for end in (0.0, 1.0):
            shares = start.copy()
            shares[i] = end
            place = f"{source}: [variables] {path} = {shown(variables[path])}, at a bound:"
            values = {x: float(y) for x, y in physical.numbers(shares).items()}
            extremes.append((place, path, parameters.put(in_si_units, values)))
    require_plausible(extremes, scales)
    return DesignSpace(structures, made["dimensionless"])


def _objective(source: str, given: dict[str, Any]) -> Objective:
    table = given.get("objective", {})
    kind = table.get("goal", "mean gap")
    own = {"soft minimum": "temperature", "CVaR": "share", "pounding probability": "gap"}
    for key in ("temperature", "share", "gap"):
        if key in table and own.get(kind) != key:
            raise ValueError(f'{source}: [objective] {key} must not be given with goal = "{kind}"')
    if kind == "soft minimum":
        needed(source, given, "objective", "temperature")
    with named(f"{source}: [objective]"):
        goal: Goal
        if kind == "soft minimum":
            goal = SoftMinimum(table["temperature"])
        elif kind == "CVaR":
            goal = CVaR(table.get("share", 0.1))
        elif kind == "pounding probability":
            goal = PoundingProbability(table.get("gap"))
        else:
            goal = WorstGap() if kind == "worst gap" else MeanGap()
    made: dict[str, dict[str, Any]] = {}
    for name, cls in (("limits", Limit), ("penalties", Penalty)):
        made[name] = {}
        for price, value in given.get(name, {}).items():
            with named(f"{source}: [{name}] {price}:"):
                made[name][price] = cls(**value) if isinstance(value, dict) else cls(value)
    return Objective(goal, made["penalties"], made["limits"])


def designed_toml(structures: AdjacentStructures, scales: Scales) -> str:
    """The designed buildings as a configuration of ``jaxpound simulate``."""
    left, right, friction_force, gap = scales.buildings(structures)
    lines = [f"gap = {float(gap)!r}  # m", ""]
    for i, building in enumerate((left, right), start=1):
        lines.append(f"[building_{i}]")
        for name in ("mass", "stiffness", "order", "tau_f", "tau_x"):
            lines.append(f"{name} = {float(np.asarray(getattr(building, name)))!r}")
        lines.append("")
    return "\n".join([*lines, "[damper]", f"friction_force = {float(friction_force)!r}  # N", ""])
