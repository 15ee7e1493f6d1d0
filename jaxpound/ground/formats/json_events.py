"""JSON of SimCenter's workflows (EE-UQ) and of scripts: time steps and histories under keys."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from jaxpound.ground.formats import units
from jaxpound.ground.formats.header import require_acceleration, stated_units
from jaxpound.ground.formats.layout import Channel
from jaxpound.ground.formats.rows import ValueRow, flatten
from jaxpound.ground.formats.statements import Stated, Statement, interval
from jaxpound.ground.formats.text import MisreadError, OtherKindError, TextLine, shown

_INTERVALS = ("dT", "dt", "timeStep", "time_step")
_COUNTS = ("npts", "NPTS", "numSteps", "numPoints")
_FACTORS = ("factor", "scaleFactor")
_TEXTS = ("info", "description")
_AXES = {"data_x": "x", "data_y": "y", "data_z": "z", "1": "x", "2": "y", "3": "z"}
_OTHER_KINDS = ("velocity", "displacement")


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
        for pattern in tree.get("pattern") or []:
            above = above | _of_pattern(pattern)
        for key, value in tree.items():
            names = above.get(f"axis of {tree.get('name')}"), _AXES.get(key, key)
            for channel in _histories(value, above):
                yield channel._replace(names=channel.names or tuple(filter(None, names))[:1])
    elif isinstance(tree, list) and tree and all(isinstance(x, _Printed) for x in tree):
        rows = [ValueRow(1, [str(number).upper() for number in tree])]
        yield Channel((), _stated(above), rows, flatten(rows))
    elif isinstance(tree, list):
        if any(isinstance(x, _Printed) for x in tree):
            bad = next(x for x in tree if not isinstance(x, _Printed))
            raise MisreadError(None, f"{shown(json.dumps(bad))} in a list must be a finite number")
        for branch in tree:
            yield from _histories(branch, above)


def _of_pattern(pattern: Any) -> dict[str, Any]:
    """The axis of a time series, from the pattern of loads of an event."""
    if not isinstance(pattern, dict):
        return {}
    kind = str(pattern.get("type"))
    if other := next((x for x in _OTHER_KINDS if x in kind.lower()), None):
        raise OtherKindError(
            None, f"must be an acceleration history, but its type is {kind}: {other}"
        )
    return {f"axis of {pattern.get('timeSeries')}": _AXES.get(str(pattern.get("dof")))}


def _stated(above: dict[str, Any]) -> Stated:
    stated = Stated()
    for key, number in above.items():
        if not isinstance(number, _Printed):
            continue
        if key in _INTERVALS + _FACTORS and not float(number) > 0:
            raise MisreadError(None, f"{key} = {number} must be positive")
        if key in _INTERVALS:
            stated.intervals.append(interval(1, f'"{key}"', number))
        elif key in _COUNTS:
            stated.counts.append(Statement(1, f'"{key}" = {number}', float(number), 0.0))
        elif key in _FACTORS and float(number) != 1:
            raise MisreadError(None, f"{key} = {number} must be 1: scale the values by it")
    texts = [TextLine(1, text) for key in _TEXTS if isinstance(text := above.get(key), str)]
    require_acceleration(texts)
    stated.units |= stated_units(texts)
    unit = above.get("units", above.get("unit"))
    if isinstance(unit, dict):
        of_length = f"{unit.get('length')}/{unit.get('time')}2" if "length" in unit else None
        unit = unit.get("acceleration", unit.get("acc", of_length))
    if isinstance(unit, str):
        if not (name := units.whole_unit(unit)):
            rule = f"must be one of {', '.join(units.UNITS)}"
            raise MisreadError(None, f'"units" = {shown(unit)} {rule}')
        units.state(stated.units, name, 1)
    return stated
