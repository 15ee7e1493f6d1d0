"""Two columns, time and acceleration, or values without times: what has no header of its own."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from jaxpound.ground.formats.rows import (
    FEW,
    Block,
    Format,
    Row,
    Values,
    check_print,
    flatten,
    print_rounding,
    read_block,
    require_width,
)
from jaxpound.ground.formats.text import Line, MisreadError, TextFile, plain, set_of, shown
from jaxpound.ground.formats.units import (
    BRACKET,
    NO_UNITS,
    OTHER_QUANTITIES,
    RATIO,
    SECONDS,
    TIME_UNIT,
    TIMES,
    UNIT,
    UNIT_WORDS,
    UNITS,
    WORD,
    goes_on,
    inside_of,
    is_value_of_unit,
    looks_like_unit,
    state,
    time_unit,
    whole_unit,
    words_of,
)

_CELL = re.compile(r"[^\s(\[]++(?: ?[(\[][^()\[\]]{0,40}+[)\]])?+")
_NO_TIMES = set_of(
    "period periods tn frequency frequencies freq f hz distance index no number n i k id point "
    "points sample samples count step steps"
)
_COMPONENTS = (
    NO_UNITS
    | TIMES
    | set_of("v u d acc accel acceleration hor ver comp ch chan channel canal long lat tran trans")
)


def _read(file: TextFile, dt: float | None, notes: list[str]) -> Values:
    block = read_block(file.lines, 0, notes)
    header, rows, stated = block.header, block.rows, block.stated
    if not rows:
        raise MisreadError(None, "no data: it must hold rows of numbers")
    if len(rows[0].numbers) == 2:
        _read_column_names(header, stated)
        samples, step = _read_two_columns(rows)
        # 0.02, not 0.019999999999999997
        step = float(f"{step * SECONDS[time_unit(stated) or 's']:.12g}")
        rows = [Row(row.line, row.numbers[1:]) for row in rows]
    else:
        samples, step = _read_values(block, dt, notes)
    values = Values(samples, step, rows, stated)
    check_print(values, file.ended, notes)
    return values


FORMAT = Format(lambda lines: True, _read)


def _read_values(
    block: Block, dt: float | None, notes: list[str]
) -> tuple[NDArray[np.float64], float]:
    rows = block.rows
    width = len(rows[0].numbers)
    if dt is None:
        says = f"{width} value(s) a row and no times: pass dt, the time step in s"
        raise MisreadError(rows[0].line, says)
    full = rows[:-1] if len(rows[-1].numbers) < width else rows
    require_width(full, width)
    if width > 1 and (names := _names_columns(block, width)):
        says = f"the header names {width} columns: there must be one of accelerations, and of times"
        raise MisreadError(names, says)
    _require_no_times(full, dt)
    if width > 1 and len(full) >= 2 * FEW:
        table = flatten(full).reshape(-1, width)
        along, down = (np.abs(np.diff(table, axis=axis)).mean() for axis in (1, 0))
        if along > 2 * down:
            seem = f"rows of {width} values seem to be columns side by side"
            notes.append(f"{seem}: they are read along the rows, as one history")
    samples = flatten(rows)
    if len(samples) >= FEW and len(samples) - samples[0] in {1, 2}:
        says = f"{rows[0].numbers[0]} must be a value, and not the number of those that follow"
        raise MisreadError(rows[0].line, says)
    return samples, float(dt)


def _require_no_times(rows: list[Row], dt: float) -> None:
    """Refuse rows one of whose columns is times or an index."""
    width = len(rows[0].numbers)
    for k in range(width):
        if _rises_evenly([float(row.numbers[k]) for row in rows], dt, alone=width == 1):
            if width == 1:
                what, rule = "the only column", "it must hold accelerations"
            else:
                what = f"column {k + 1}"
                rule = f"times must come with one column of values, not {width - 1}"
            says = f"{what} rises evenly from row to row, as times or an index do: {rule}"
            raise MisreadError(rows[0].line, says)


def _rises_evenly(column: list[float], dt: float, *, alone: bool) -> bool:
    """Whether a column is times or an index; with many rows, also if it is coarsely printed."""
    n = len(column)
    steps = np.diff(column)
    if n > 2 and any(np.allclose(steps, step, rtol=1e-3, atol=0) for step in (dt, 1000 * dt)):
        return True
    if n < (FEW if alone else 4) or not column[-1] > column[0]:
        return False
    off = column - np.linspace(column[0], column[-1], n)
    return bool(np.abs(off).max() <= (2.1 if n >= 4 * FEW else 0.01) * steps.mean())


def _read_two_columns(rows: list[Row]) -> tuple[NDArray[np.float64], float]:
    require_width(rows, 2)
    if len(rows) < 2:
        raise MisreadError(rows[0].line, "a record must have at least two samples, this has one")
    times, samples = flatten(rows).reshape(-1, 2).T
    dt = (times[-1] - times[0]) / (len(times) - 1)
    rounding = print_rounding([row.numbers[0] for row in rows])
    slack = rounding + max(rounding[0], rounding[-1])
    if slack.max() > 0.4 * dt:  # a lost sample shows as dt / 2
        slack = np.zeros_like(slack)
    off = np.abs(times - times[0] - dt * np.arange(len(times)))
    # 1e-5: times summed up step by step in floating point, printed with all their digits.
    if not (dt > 0 and np.all(off <= slack + 1e-5 * dt)):
        steps = np.diff(times)
        usual = np.median(steps)
        worst = int(np.argmax(np.abs(steps - usual)))
        rule = "uniform and positive within the rounding of the printed times"
        says = f"time step = {steps[worst]:.6g} must be {rule}; the usual one is {usual:.6g}"
        raise MisreadError(rows[worst + 1].line, says)
    return samples, float(dt)


def _read_column_names(header: Sequence[Line], stated: dict[str, int]) -> None:
    """Check the names of two columns, and add their units to those stated.

    The names are on the last line of words in the header, or one above if the last has units.

    Raises
    ------
    MisreadError
        If the first column is not time, or the second not acceleration, or if they are in units
        that are not known or not those stated.
    """
    for number, raw in [line for line in header if WORD.search(line.text)][-2:]:
        cells = _column_names(raw)
        if len(cells) != 2 or not (first := words_of(cells[0])) or not words_of(cells[1]):
            continue
        if first[0] in _NO_TIMES:
            says = f"the first column must be times, but the header says {first[0]}"
            raise MisreadError(number, says)
        if first[0] not in TIMES:
            continue
        if others := [word for word in words_of(cells[1]) if word in OTHER_QUANTITIES]:
            says = f"must be an acceleration history, but the header says {others[0]}"
            raise MisreadError(number, says)
        for cell, pattern, known in zip(cells, (TIME_UNIT, UNIT), (SECONDS, UNITS), strict=True):
            if unit := _unit_of_cell(number, cell, pattern, known):
                state(stated, unit, number)


def _names_columns(block: Block, width: int) -> int | None:
    """Number of the line that names the columns, one of the last two with words; None if neither.

    It has as many names as a row has values, with the same separators as the rows, or consists of
    names of directions and channels only.
    """
    row = block.first
    for number, raw in [line for line in block.header if WORD.search(line.text)][-2:]:
        cells = _column_names(raw)
        if len(cells) != width or not all(WORD.search(cell) for cell in cells):
            continue
        separated = any(mark in row and mark in raw for mark in ",;\t")
        if separated or all(set(words_of(cell)) <= _COMPONENTS for cell in cells):
            return number
    return None


def _column_names(raw: str) -> list[str]:
    text = raw.lstrip("#%/ \t").rstrip(",; \t")
    for separator in ";,\t":
        if separator in text:
            return [plain(cell) for cell in text.split(separator)]
    return _CELL.findall(plain(text))


def _unit_of_cell(
    number: int, cell: str, pattern: re.Pattern[str], known: dict[str, float]
) -> str | None:
    """The unit of a column: in brackets, after an underscore or a slash, or its whole name."""
    if unit := whole_unit(pattern, cell):
        return unit
    if bracket := BRACKET.search(cell):
        inside = inside_of(bracket)
        if (unit := whole_unit(pattern, inside)) or set(words_of(inside)) <= NO_UNITS - {"h"}:
            return unit
    else:
        inside = re.split("_|/| in ", cell, maxsplit=1, flags=re.I)[-1]
        begins = words_of(cell)[0] in UNIT_WORDS | {"m"} or goes_on(cell) or is_value_of_unit(cell)
        if not begins and (unit := whole_unit(pattern, inside)):
            return unit
        if begins or inside == cell or (pattern is UNIT and RATIO.search(cell)):
            inside = cell
        if not (begins or looks_like_unit(inside) or words_of(inside)[:1] == ["min"]):
            return None
    rule = f"must be one of the known ones: {', '.join(known)}"
    raise MisreadError(number, f"the column's units = {shown(inside)} {rule}")
