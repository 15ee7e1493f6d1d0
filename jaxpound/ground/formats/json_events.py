"""JSON of SimCenter's workflows (EE-UQ) and of scripts: time step and histories under their keys."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from jaxpound.ground.formats import units
from jaxpound.ground.formats.layout import Channel
from jaxpound.ground.formats.rows import ValueRow, flatten
from jaxpound.ground.formats.statements import Stated, Statement, interval
from jaxpound.ground.formats.text import MisreadError, TextLine, shown

_INTERVALS = ("dT", "dt", "timeStep", "time_step")
_COUNTS = ("npts", "numSteps", "NPTS", "nPts")
_UNITS = ("units", "unit")
_AXES = {"data_x": "x", "data_y": "y", "data_z": "z"}


def fits(lines: list[TextLine]) -> bool:
    """Whether a file begins as JSON does."""
    return lines[0].text.lstrip()[:1] in ("{", "[")


def read(lines: list[TextLine]) -> list[Channel]:
    """The histories of a file, in its order."""
    text = "\n" * (lines[0].number - 1)
    for line, following in zip(lines, [*lines[1:], None], strict=True):
        text += line.text + "\n" * (following.number - line.number if following else 0)
    try:
        tree = json.loads(text, parse_float=_Printed, parse_int=_Printed)
    except json.JSONDecodeError as error:
        raise MisreadError(error.lineno, f"is no valid JSON: {error.msg}") from None
    except RecursionError:
        raise MisreadError(None, "is JSON of too many levels") from None
    if channels := list(_histories(tree, {})):
        return channels
    raise MisreadError(None, "is JSON without a list of numbers: it must hold a history")


class _Printed(str):
    """A number as printed."""


def _histories(tree: Any, above: dict[str, Any]) -> Iterator[Channel]:
    """The lists of numbers of a tree, with what the objects around them state."""
    if isinstance(tree, dict):
        above = above | {key: x for key, x in tree.items() if not isinstance(x, list)}
        for key, value in tree.items():
            for channel in _histories(value, above):
                yield channel._replace(names=channel.names or (_AXES.get(key, key),))
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
    stated = Stated()
    for key in _INTERVALS:
        if isinstance(number := above.get(key), _Printed):
            if not float(number) > 0:
                raise MisreadError(None, f"{key} = {number} must be positive")
            stated.intervals.append(interval(1, f'"{key}"', number))
    for key in _COUNTS:
        if isinstance(number := above.get(key), _Printed):
            stated.counts.append(Statement(1, f'"{key}"', float(number), 0.0))
    for key in _UNITS:
        unit = above.get(key)
        unit = unit.get("acceleration", unit.get("acc")) if isinstance(unit, dict) else unit
        if isinstance(unit, str):
            if not (name := units.whole_unit(unit)):
                rule = f"must be one of {', '.join(units.UNITS)}"
                raise MisreadError(None, f'"{key}" = {shown(unit)} {rule}')
            stated.units[name] = 1
    return stated
