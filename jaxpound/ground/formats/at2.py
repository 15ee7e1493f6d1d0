"""PEER's AT2 files: a header with the number of values and the time step, then the values."""

from __future__ import annotations

import math
import re

from jaxpound.ground.formats.rows import (
    Format,
    Values,
    check_print,
    flatten,
    read_block,
    require_count,
)
from jaxpound.ground.formats.text import (
    NUMBER,
    Line,
    MisreadError,
    TextFile,
    is_comment,
    plain,
    shown,
    to_float,
    trimmed,
)
from jaxpound.ground.formats.units import SECONDS, TIME_UNIT, whole_unit

_NPTS = re.compile(r"\bNPTS\b", re.I)
_STATES = re.compile(rf" ?[=:]? ?({NUMBER})", re.I)
_DT = re.compile(r"\bDT\b", re.I)
_NPTS_BEHIND = re.compile(rf"({NUMBER})[ ,]{{1,3}}({NUMBER})[ ,]{{1,3}}NPTS\b", re.I)
_DT_UNIT = re.compile(r"[ ,]{0,2}[(\[]? ?([^\W\d_]++)(?! ?[=:])", re.I)


def _read(file: TextFile, _dt: float | None, notes: list[str]) -> Values:
    at = next(i for i, line in enumerate(file.lines) if _is_npts(line))
    block = read_block(file.lines, at + 1, notes)
    line, samples = file.lines[at], flatten(block.rows)
    npts, dt = _npts_and_dt(line)
    require_count(line.number, f"NPTS = {npts}", npts, len(samples))
    values = Values(samples, dt, block.rows, block.stated)
    check_print(values, file.ended, notes)
    return values


def _is_npts(line: Line) -> bool:
    """Whether a line has the word NPTS, as the header of PEER's AT2 files has."""
    return _NPTS.search(line.text) is not None and not is_comment(trimmed(line.text))


FORMAT = Format(lambda lines: any(map(_is_npts, lines)), _read)


def _npts_and_dt(line: Line) -> tuple[int, float]:
    """The number of values and the time step, in s, that a line states.

    Raises
    ------
    MisreadError
        If it states no numbers for them or not positive ones, or a unit of time that is not known.
    """
    text = plain(line.text)
    if behind := _NPTS_BEHIND.match(text):
        npts, dt = behind[1], behind[2]
        after = match.end() if (match := _DT.search(text, behind.end())) else behind.end()
    else:
        first, after_npts = _stated(_NPTS, text, 0, "")
        second, after = _stated(_DT, text, after_npts, "sm")
        if not (first and second):
            raise MisreadError(line.number, f"{shown(text)} must state numbers for NPTS and DT")
        npts, dt = first, second
    count, step = to_float(npts), to_float(dt)
    if not (0 < count < math.inf and count.is_integer()):
        raise MisreadError(line.number, f"NPTS = {npts} must be a positive whole number")
    if not 0 < step < math.inf:
        raise MisreadError(line.number, f"DT = {dt} must be positive and finite")
    unit = _DT_UNIT.match(text, after)
    if not unit:
        return int(count), step
    known = whole_unit(TIME_UNIT, unit[1])
    alone = not text[unit.end() :].strip(" ,.;)]")
    if not known and (alone or unit[1].lower() in {"min", "minutes", "hz", "h", "us"}):
        raise MisreadError(line.number, f"DT = {dt} {unit[1]}: its unit must be s or ms")
    return int(count), step * SECONDS[known or "s"]


def _stated(name: re.Pattern[str], text: str, begin: int, units: str) -> tuple[str, int]:
    """The number after a name, and where it ends; "" if no number follows the name."""
    for match in name.finditer(text, begin):
        number = _STATES.match(text, match.end())
        if number and (text[number.end() :][:1].lower() or " ") in " ,;" + units:
            return number[1], number.end()
    return "", len(text)
