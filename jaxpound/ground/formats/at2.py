"""PEER's AT2 files: a header with the number of values and the time step, then the values."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from jaxpound.ground.formats import text, units
from jaxpound.ground.formats.layout import Layout
from jaxpound.ground.formats.statements import Stated, Statement, interval
from jaxpound.ground.formats.text import NUMBER, MisreadError, TextLine

_LINE = re.compile(r"(?!\s*(?:#|%|//)).*\bNPTS\b", re.I)
_NPTS = re.compile(r"\bNPTS\b", re.I)
_STATES = re.compile(rf" ?[=:]? ?({NUMBER})", re.I)
_DT = re.compile(r"\bDT\b", re.I)
_NPTS_BEHIND = re.compile(rf"({NUMBER})[ ,]{{1,3}}({NUMBER})[ ,]{{1,3}}NPTS\b", re.I)
_DT_UNIT = re.compile(r"[ ,]{0,2}[(\[]? ?([^\W\d_]++)(?! ?[=:])", re.I)


def _state(header: Sequence[TextLine], stated: Stated) -> None:
    """Replace what was read as prose by the numbers of the line of NPTS and DT."""
    line = next(line for line in header if _LINE.match(line.text))
    npts, dt, unit = _npts_and_dt(line)
    stated.counts[:] = [Statement(line.number, f"NPTS = {npts}", float(npts), 0.0)]
    stated.intervals[:] = [interval(line.number, f"DT = {dt}", dt, units.SECONDS[unit])]


def _npts_and_dt(line: TextLine) -> tuple[int, str, str]:
    """The number of values, the time step as printed and its unit, that a line states."""
    header = text.plain(line.text)
    if values_first := _NPTS_BEHIND.match(header):
        npts, dt = values_first[1], values_first[2]
        after = (_DT.search(header, values_first.end()) or values_first).end()
    else:
        npts, after_npts = _stated(_NPTS, header, 0, "")
        dt, after = _stated(_DT, header, after_npts, "sm")
        if not (npts and dt):
            rule = "must state numbers for NPTS and DT"
            raise MisreadError(line.number, f"{text.shown(header)} {rule}")
    count, step = text.to_float(npts), text.to_float(dt)
    if not (0 < count < math.inf and count.is_integer()):
        raise MisreadError(line.number, f"NPTS = {npts} must be a positive whole number")
    if not 0 < step < math.inf:
        raise MisreadError(line.number, f"DT = {dt} must be positive and finite")
    if not (unit := _DT_UNIT.match(header, after)):
        return int(count), dt, "s"
    in_unit = units.whole_unit(unit[1], units.TIME_UNIT)
    is_last = not header[unit.end() :].strip(" ,.;)]")
    if not in_unit and (is_last or unit[1].lower() in {"min", "minutes", "hz", "h", "us"}):
        raise MisreadError(line.number, f"DT = {dt} {unit[1]}: its unit must be s or ms")
    return int(count), dt, in_unit or "s"


def _stated(name: re.Pattern[str], header: str, begin: int, letters: str) -> tuple[str, int]:
    """The number after a name, up to a separator or a letter of a unit, and its end; "" if none."""
    for match in name.finditer(header, begin):
        number = _STATES.match(header, match.end())
        if number and (header[number.end() :][:1].lower() or " ") in " ,;" + letters:
            return number[1], number.end()
    return "", len(header)


LAYOUT = Layout(
    name="PEER AT2",
    signature=_LINE.pattern,
    component=r"(?!.*NPTS)[^,]*,[^,]*,.*?([^,\s][^,]{0,11}?)\s*$",
    state=_state,
    behind=_LINE.pattern,
    history=True,
)
