"""What ``jaxpound design`` is told in a TOML file: buildings, earthquakes, variables; in SI."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from jaxpound.config import BUILDING, RUN, Keys, named, needed
from jaxpound.design_space import Bounds, DesignSpace
from jaxpound.earthquake_config import EARTHQUAKES, files, opened, word
from jaxpound.ensembles import Ensemble
from jaxpound.examples import DESIGN as EXAMPLE
from jaxpound.ground import Record
from jaxpound.objectives import (
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
from jaxpound.records import read_record
from jaxpound.scenarios import PARAMETERS, Scenarios
from jaxpound.scheme import Scheme, TimeGrid
from jaxpound.structures import AdjacentStructures
from jaxpound.units import Scales

_GOALS = ("mean gap", "worst gap", "soft minimum", "CVaR", "pounding probability")


def _bounds(value: Any) -> str:
    rule = '{low = ..., high = ..., scale = "linear" or "log"}'
    if not (isinstance(value, dict) and {"low", "high"} <= {*value} <= {"low", "high", "scale"}):
        return rule
    right = all(type(value[key]) in (int, float) for key in ("low", "high"))
    return "" if right and value.get("scale", "linear") in ("linear", "log") else rule


def _price(key: str, value: Any) -> str:
    rule = f'a number, or {{{key} = ..., over = "worst", "mean" or a share}}'
    if type(value) in (int, float):
        return ""
    return "" if isinstance(value, dict) and key in value and {*value} <= {key, "over"} else rule


_KEYS: Keys = {
    "": {"gap": float},
    "building_1": BUILDING,
    "building_2": BUILDING,
    "damper": {"friction_force": float},
    "earthquakes": EARTHQUAKES,
    "recorded": {"files": files, "units": word},
    "variables": dict.fromkeys(PARAMETERS, _bounds),
    "objective": {
        "goal": _GOALS,
        "temperature": float,
        "share": float,
        "gap": float,
    },
    "limits": dict.fromkeys(PRICES, lambda value: _price("at_most", value)),
    "penalties": dict.fromkeys(PRICES, lambda value: _price("weight", value)),
    "run": RUN,
    "search": {
        "earthquakes": int,
        "fresh": int,
        "starts": int,
        "iterations": int,
        "batch": int,
        "seed": int,
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
        If a file cannot be read.
    ValueError
        As ``config.read_config``.
    """
    read = opened(path, "design", EXAMPLE, _KEYS, by_field="variables")
    source, given, structures, scales = read.source, read.given, read.structures, read.scales
    recorded = _recorded(source, given, read.folder, records)
    grid = read.grid(recorded.values())
    search = {"earthquakes": 256, "fresh": 1000, "seed": 0} | given.get("search", {})
    for key, value in search.items():
        if value < (key not in ("seed", "fresh")):
            raise ValueError(f"{source}: [search] {key} = {value} must be positive")
    n = search.pop("earthquakes")
    if search["seed"] >= 2**32:
        raise ValueError(f"{source}: [search] seed = {search['seed']} must be below 2^32")
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
        _space(source, given, structures),
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
    read = [
        (folder / file, read_record(folder / file, units=table.get("units", "g")))
        for file in table.get("files", [])
    ]
    read += [(file, read_record(file)) for file in more]
    found: dict[str, Record] = {}
    for file, record in read:
        if file.stem in found:
            raise ValueError(f"record {file}: its name {file.stem!r} must be another's than before")
        found[file.stem] = record
    return found


def _space(source: str, given: dict[str, Any], structures: AdjacentStructures) -> DesignSpace:
    """The variables; in the file their bounds are factors on the values that it states."""
    variables = given.get("variables", {})
    if not variables:
        raise ValueError(f"{source}: [variables] must name what may be chosen")
    bounds = {}
    for path, value in variables.items():
        nominal, place = float(attrgetter(path)(structures)), f"{source}: [variables] {path}"
        if not nominal:
            raise ValueError(f"{place} must be of a value above 0, for factors on it")
        if not value["low"] < value["high"]:
            rule = f"above low = {value['low']:.6g}"
            raise ValueError(f"{place}: high = {value['high']:.6g} must be {rule}")
        with named(f"{source}: [variables] {path}:"):
            bounds[path] = Bounds(
                value["low"] * nominal, value["high"] * nominal, value.get("scale", "linear")
            )
    with named(f"{source}: [variables]"):
        return DesignSpace(structures, bounds)


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
