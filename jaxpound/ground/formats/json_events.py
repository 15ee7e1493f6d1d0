"""JSON of SimCenter's workflows (EE-UQ) and of scripts: time steps and histories under keys."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from jaxpound.ground.formats import units
from jaxpound.ground.formats.layout import Channel
from jaxpound.ground.formats.rows import ValueRow, even_interval, flatten, stated_in
from jaxpound.ground.formats.statements import Stated, Statement, interval, state_numbers
from jaxpound.ground.formats.text import MisreadError, OtherKindError, TextLine, shown

_INTERVALS = {"dT", "dt", "DT", "delta", "timeStep", "time_step"}
_COUNTS = {"npts", "NPTS", "numSteps", "numPoints"}
_FACTORS = {"factor", "scaleFactor"}
_OTHER_TYPES = ("UniformVelocity", "UniformDisplacement")  # of a pattern of loads


def read(lines: list[TextLine]) -> list[Channel]:
    """The histories of a file, in its order."""
    ends = [line.number for line in lines[1:]] + [lines[-1].number]
    text = "\n" * (lines[0].number - 1)
    text += "".join(x.text + "\n" * (end - x.number) for x, end in zip(lines, ends, strict=True))
    if other := next((kind for kind in _OTHER_TYPES if f'"{kind}"' in text), None):
        raise OtherKindError(None, f"must be an acceleration history, but its type is {other}")
    try:
        tree = json.loads(text, parse_float=_Printed, parse_int=_Printed)
    except json.JSONDecodeError as error:
        raise MisreadError(error.lineno, f"is no valid JSON: {error.msg}") from None
    except RecursionError:
        raise MisreadError(None, "is JSON of too many levels") from None
    channels = list(_histories(tree, {}))
    times = [x for x in channels if "".join(x.names).lower() in units.TIMES]
    if len(times) == 1 and len(channels) > 1:
        stated = even_interval(times[0].rows)
        return [x._replace(times=stated) for x in channels if x is not times[0]]
    if channels:
        return channels
    raise OtherKindError(None, "is JSON without a list of numbers: it must hold a history")


class _Printed(str):
    """A number as printed."""


def _histories(tree: Any, above: dict[str, Any]) -> Iterator[Channel]:
    """The lists of numbers of a tree, with what the objects around them state."""
    if isinstance(tree, dict):
        for key in _INTERVALS & tree.keys() & above.keys():
            if tree[key] != above[key]:
                raise MisreadError(None, f'"{key}" is both {above[key]} and {tree[key]}')
        above = above | {key: x for key, x in tree.items() if not isinstance(x, list)}
        for key, value in tree.items():
            name = str(tree.get("name", key)) if key == "data" else key.removeprefix("data_")
            for channel in _histories(value, above):
                yield channel._replace(names=channel.names or (name,))
    elif isinstance(tree, list) and tree and all(isinstance(x, _Printed) for x in tree):
        rows = [ValueRow(1, [str(number).upper() for number in tree])]
        yield Channel((), _stated(above), rows, flatten(rows))
    elif isinstance(tree, list):
        if any(isinstance(x, _Printed) for x in tree):
            bad = next(x for x in tree if not isinstance(x, _Printed))
            raise MisreadError(None, f"{shown(json.dumps(bad))} in a list must be a finite number")
        for branch in tree:
            yield from _histories(branch, above)


def _stated(above: dict[str, Any]) -> Stated:
    stated = stated_in([TextLine(1, str(above["info"]))] if "info" in above else [])
    for key, number in above.items():
        if isinstance(number, str) and key not in _INTERVALS | _COUNTS:
            state_numbers([TextLine(1, f"{key[:40]}: {number[:40]}")], stated)
        if not isinstance(number, _Printed):
            continue
        text = f'"{key}": {number}'
        if key in _INTERVALS:
            stated.intervals.append(interval(1, text, number))
        elif key in _COUNTS:
            stated.counts.append(Statement(1, text, float(number)))
        elif key in _FACTORS and float(number) != 1:
            raise MisreadError(None, f"{text} must be 1: scale the values by it")
    unit = above.get("units", above.get("unit"))
    if isinstance(unit, dict):
        of_length = f"{unit['length']}/{unit.get('time')}2" if "length" in unit else None
        unit = unit.get("acceleration", unit.get("acc", of_length))
    if isinstance(unit, str):
        if not (name := units.whole_unit(unit)):
            raise MisreadError(None, f'"units": {shown(unit)} must be among {[*units.UNITS]}')
        units.state(stated.units, name, 1)
    return stated
