"""PEER's AT2 files: a header with the number of values and the time step, then the values."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from jaxpound.ground.formats import text, units
from jaxpound.ground.formats.rows import Values, check_print, flatten, read_block, require_count
from jaxpound.ground.formats.text import NUMBER, MisreadError, TextFile, TextLine

_NPTS = re.compile(r"\bNPTS\b", re.I)
_STATES = re.compile(rf" ?[=:]? ?({NUMBER})", re.I)
_DT = re.compile(r"\bDT\b", re.I)
_NPTS_BEHIND = re.compile(rf"({NUMBER})[ ,]{{1,3}}({NUMBER})[ ,]{{1,3}}NPTS\b", re.I)
_DT_UNIT = re.compile(r"[ ,]{0,2}[(\[]? ?([^\W\d_]++)(?! ?[=:])", re.I)


def fits(lines: Sequence[TextLine]) -> bool:
    """Whether a line states the number of values."""
    return any(map(_is_npts, lines))


def read(file: TextFile, _dt: float | None, notes: list[str]) -> Values:
    """The values of a file, and notes."""
    at = next(i for i, line in enumerate(file.lines) if _is_npts(line))
    block = read_block(file.lines, at + 1, notes)
    line, samples = file.lines[at], flatten(block.rows)
    npts, dt = _npts_and_dt(line)
    require_count(line.number, f"NPTS = {npts}", npts, len(samples))
    values = Values(samples, dt, block.rows, block.stated)
    check_print(values, file.ended, notes)
    return values


def _is_npts(line: TextLine) -> bool:
    return _NPTS.search(line.text) is not None and not text.is_comment(text.trimmed(line.text))


def _npts_and_dt(line: TextLine) -> tuple[int, float]:
    """The number of values and the time step, in s, that a line states: both positive."""
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
        return int(count), step
    in_unit = units.whole_unit(unit[1], units.TIME_UNIT)
    is_last = not header[unit.end() :].strip(" ,.;)]")
    if not in_unit and (is_last or unit[1].lower() in {"min", "minutes", "hz", "h", "us"}):
        raise MisreadError(line.number, f"DT = {dt} {unit[1]}: its unit must be s or ms")
    return int(count), step * units.SECONDS[in_unit or "s"]


def _stated(name: re.Pattern[str], header: str, begin: int, letters: str) -> tuple[str, int]:
    """The number after a name, up to a separator or a letter of a unit, and its end; "" if none."""
    for match in name.finditer(header, begin):
        number = _STATES.match(header, match.end())
        if number and (header[number.end() :][:1].lower() or " ") in " ,;" + letters:
            return number[1], number.end()
    return "", len(header)
