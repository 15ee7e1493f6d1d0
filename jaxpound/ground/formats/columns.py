"""Two columns, time and acceleration, or values without times: files without a special header."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from jaxpound.ground.formats import rows as printed
from jaxpound.ground.formats import units
from jaxpound.ground.formats.rows import FEW, Block, ValueRow, flatten
from jaxpound.ground.formats.text import MisreadError, TextFile, TextLine, plain, set_of, shown

_CELL = re.compile(r"[^\s(\[]++(?: ?[(\[][^()\[\]]{0,40}+[)\]])?+")
_NO_TIMES = set_of(
    "period periods tn frequency frequencies freq f hz distance index no number n i k id point "
    "points sample samples count step steps"
)
_COMPONENTS = (
    units.NO_UNITS
    | units.TIMES
    | set_of("v u d acc accel acceleration hor ver comp ch chan channel canal long lat tran trans")
)


def read(file: TextFile, dt: float | None, notes: list[str]) -> printed.Values:
    """The values of a file; the user's ``dt`` is that of one that states none."""
    block = printed.read_block(file.lines, 0, notes)
    rows, stated = block.rows, block.stated
    if not rows:
        raise MisreadError(None, "no data: it must hold rows of numbers")
    if len(rows[0].numbers) == 2:
        _read_column_names(block.header, stated)
        samples, step = _read_two_columns(rows)
        unit = units.stated_among(stated, units.SECONDS) or "s"
        step = float(f"{step * units.SECONDS[unit]:.12g}")  # 0.02, not 0.019999999999999997
        rows = [ValueRow(row.line, row.numbers[1:]) for row in rows]
    else:
        samples, step = _read_values(block, dt, notes)
    values = printed.Values(samples, step, rows, stated)
    printed.check_print(values, file.ended, notes)
    return values


def _read_values(
    block: Block, dt: float | None, notes: list[str]
) -> tuple[NDArray[np.float64], float]:
    rows, first, width = block.rows, block.rows[0], len(block.rows[0].numbers)
    if dt is None:
        rule = "pass dt, the time step in s"
        raise MisreadError(first.line, f"{width} value(s) a row and no times: {rule}")
    full = rows[:-1] if len(rows[-1].numbers) < width else rows
    printed.require_width(full, width)
    if width > 1 and (names := _names_columns(block, width)):
        rule = "there must be one of accelerations, and of times"
        raise MisreadError(names, f"the header names {width} columns: {rule}")
    for k in range(width):
        if _rises_evenly([float(row.numbers[k]) for row in full], dt, alone=width == 1):
            place, rule = "the only column", "it must hold accelerations"
            if width > 1:
                place = f"column {k + 1}"
                rule = f"times must come with one column of values, not {width - 1}"
            message = f"{place} rises evenly from row to row, as times or an index do: {rule}"
            raise MisreadError(first.line, message)
    if width > 1 and len(full) >= 2 * FEW:
        table = flatten(full).reshape(-1, width)
        along, down = (np.abs(np.diff(table, axis=axis)).mean() for axis in (1, 0))
        if along > 2 * down:
            seem = f"rows of {width} values seem to be columns side by side"
            notes.append(f"{seem}: they are read along the rows, as one history")
    samples = flatten(rows)
    if len(samples) >= FEW and len(samples) - samples[0] in {1, 2}:
        rule = "must be a value, and not the number of those that follow"
        raise MisreadError(first.line, f"{first.numbers[0]} {rule}")
    return samples, float(dt)


def _rises_evenly(column: list[float], dt: float, *, alone: bool) -> bool:
    """Whether a column is times or an index; with many rows, coarse printing is allowed for."""
    n, steps = len(column), np.diff(column)
    if n > 2 and any(np.allclose(steps, step, rtol=1e-3, atol=0) for step in (dt, 1000 * dt)):
        return True
    if n < (FEW if alone else 4) or not column[-1] > column[0]:
        return False
    off = column - np.linspace(column[0], column[-1], n)
    return bool(np.abs(off).max() <= (2.1 if n >= 4 * FEW else 0.01) * steps.mean())


def _read_two_columns(rows: list[ValueRow]) -> tuple[NDArray[np.float64], float]:
    printed.require_width(rows, 2)
    if len(rows) < 2:
        raise MisreadError(rows[0].line, "a record must have at least two samples, this has one")
    times, samples = flatten(rows).reshape(-1, 2).T
    dt = (times[-1] - times[0]) / (len(times) - 1)
    rounding = printed.print_rounding([row.numbers[0] for row in rows])
    slack = rounding + max(rounding[0], rounding[-1])
    if slack.max() > 0.4 * dt:  # a lost sample shows as dt / 2
        slack = np.zeros_like(slack)
    off = np.abs(times - times[0] - dt * np.arange(len(times)))
    # 1e-5 allows for times that were summed up step by step and printed with all their digits.
    if not (dt > 0 and np.all(off <= slack + 1e-5 * dt)):
        steps, usual = np.diff(times), np.median(np.diff(times))
        worst = int(np.argmax(np.abs(steps - usual)))
        rule = "uniform and positive within the rounding of the printed times"
        message = f"time step = {steps[worst]:.6g} must be {rule}; the usual one is {usual:.6g}"
        raise MisreadError(rows[worst + 1].line, message)
    return samples, float(dt)


def _names_in(header: Sequence[TextLine]) -> list[tuple[int, str, list[str]]]:
    """The last two lines with words of a header: number, text, and the names of columns in it."""
    lines = [line for line in header if units.WORD.search(line.text)][-2:]
    return [(number, raw, _column_names(raw)) for number, raw in lines]


def _read_column_names(header: Sequence[TextLine], stated: dict[str, int]) -> None:
    """Check that the names of two columns are time and acceleration, and add their units."""
    for number, _, cells in _names_in(header):
        first, second = map(units.words_of, cells) if len(cells) == 2 else ([], [])
        if not (first and second):
            continue
        if first[0] in _NO_TIMES:
            rule = "the first column must be times"
            raise MisreadError(number, f"{rule}, but the header says {first[0]}")
        if first[0] not in units.TIMES:
            continue
        if others := [word for word in second if word in units.OTHER_QUANTITIES]:
            message = f"must be an acceleration history, but the header says {others[0]}"
            raise MisreadError(number, message)
        for cell, is_time in zip(cells, (True, False), strict=True):
            if unit := _unit_of_cell(number, cell, is_time=is_time):
                units.state(stated, unit, number)


def _names_columns(block: Block, width: int) -> int | None:
    """Number of the line that names the columns, one of the last two with words; None if neither.

    It has as many names as a row has values, with the separators of the rows, or consists only of
    names of directions and channels.
    """
    for number, raw, cells in _names_in(block.header):
        if len(cells) == width and all(units.WORD.search(cell) for cell in cells):
            separated = any(mark in block.first and mark in raw for mark in ",;\t")
            if separated or all(set(units.words_of(cell)) <= _COMPONENTS for cell in cells):
                return number
    return None


def _column_names(raw: str) -> list[str]:
    text = raw.lstrip("#%/ \t").rstrip(",; \t")
    for separator in ";,\t":
        if separator in text:
            return [plain(cell) for cell in text.split(separator)]
    return _CELL.findall(plain(text))


def _unit_of_cell(number: int, cell: str, *, is_time: bool) -> str | None:
    """The unit of a column: in brackets, after an underscore or a slash, or the whole name."""
    pattern = units.TIME_UNIT if is_time else units.UNIT
    if unit := units.whole_unit(cell, pattern):
        return unit
    if bracket := units.BRACKET.search(cell):
        inside = units.inside_of(bracket)
        unit = units.whole_unit(inside, pattern)
        if unit or set(units.words_of(inside)) <= units.NO_UNITS - {"h"}:
            return unit
    else:
        inside = re.split("_|/| in ", cell, maxsplit=1, flags=re.I)[-1]
        begins = units.words_of(cell)[0] in units.UNIT_WORDS | {"m"} or units.goes_on(cell)
        begins = begins or units.is_value_of_unit(cell)
        if not begins and (unit := units.whole_unit(inside, pattern)):
            return unit
        if begins or inside == cell or (not is_time and units.RATIO.search(cell)):
            inside = cell
        if not (begins or units.looks_like_unit(inside) or units.words_of(inside)[:1] == ["min"]):
            return None
    rule = f"must be one of the known ones: {', '.join(units.SECONDS if is_time else units.UNITS)}"
    raise MisreadError(number, f"the column's units = {shown(inside)} {rule}")
