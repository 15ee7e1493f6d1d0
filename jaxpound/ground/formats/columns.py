"""Rows of numbers behind one header: a history, columns of components, times and accelerations."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from jaxpound.ground.formats import rows as printed
from jaxpound.ground.formats import units
from jaxpound.ground.formats.layout import Channel, Layout
from jaxpound.ground.formats.rows import FEW, Block, ValueRow, flatten
from jaxpound.ground.formats.statements import Stated, Statement, interval
from jaxpound.ground.formats.text import (
    MisreadError,
    OtherKindError,
    TextLine,
    plain,
    set_of,
    shown,
)

HISTORY, COLUMNS = "history", "columns"  # what rows of numbers are, in the words of users
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
_SIDE_BY_SIDE = {2, 3, 4, 6}  # numbers a row that are components: real histories have 5, 8 or 10
_ALIKE = 0.9  # correlation of accelerations with the differences of velocities behind them


def read(
    layout: Layout, lines: Sequence[TextLine], dt: float | None, form: str | None, notes: list[str]
) -> list[Channel]:
    """The components of a file; ``dt`` and ``form``, what its rows are, are those of the user."""
    begin = 0
    if layout.behind:
        behind = re.compile(layout.behind, re.I)
        begin = 1 + next((i for i, x in enumerate(lines) if behind.match(x.text)), -1)
    block = printed.read_block(lines, begin, notes)
    if layout.state:
        layout.state(block.header, block.stated)
    if layout.unit:
        block.stated.units[layout.unit] = lines[0].number
    if not block.rows:
        counts = block.stated.counts
        rule = (
            f"{counts[-1].text} must be followed by them"
            if counts
            else "it must hold rows of numbers"
        )
        raise MisreadError(counts[-1].line if counts else None, f"no data: {rule}")
    block = _without_first_numbers(block, dt)
    stated, rows = block.stated, block.rows
    if layout.history or form == HISTORY:
        width = len(rows[0].numbers)
        if not layout.behind:
            printed.require_width(_full(rows, width), width)
        names = tuple(layout.components(block.header))
        return [Channel(names, stated, rows, flatten(rows))]
    return _channels(layout, block, dt, form == COLUMNS, notes)


def _channels(
    layout: Layout, block: Block, dt: float | None, in_columns: bool, notes: list[str]
) -> list[Channel]:
    rows, stated, width = block.rows, block.stated, len(block.rows[0].numbers)
    names = _names(layout, block, width)
    if width > 2 and width % 2 == 0 and _are_pairs(rows):
        printed.require_width(_full(rows, width), width)
        samples, times, rows = printed.split_pairs(rows)
        return [Channel((), stated, rows, samples, times)]
    if width == 2 and _names_times(names) is None and not _are_components(block, rows, dt):
        names = names or [(), ()]
        return _timed(block, rows, names)
    if (first := _names_times(names)) is not None or (width > 2 and _first_are_times(rows, dt)):
        printed.require_width(rows, width)
        first = first or int(_is_index(rows) and _first_are_times(_columns_from(rows, 1), dt))
        names = names[first:] if names else [()] * (width - first)
        return _timed(block, _columns_from(rows, first), names)
    if width in _SIDE_BY_SIDE or names or (in_columns and width > 1):
        printed.require_width(rows, width)
        _require_no_times(rows, width, dt)
        return [
            Channel(tuple(names[k]) if names else (), stated, *_column(rows, k))
            for k in range(width)
        ]
    return [
        Channel(tuple(layout.components(block.header)), stated, rows, _history(block, dt, notes))
    ]


def _column(rows: list[ValueRow], k: int) -> tuple[list[ValueRow], NDArray[np.float64]]:
    column = [ValueRow(row.line, [row.numbers[k]]) for row in rows]
    return column, flatten(column)


def _columns_from(rows: list[ValueRow], first: int) -> list[ValueRow]:
    return [ValueRow(row.line, row.numbers[first:]) for row in rows] if first else rows


def _timed(block: Block, rows: list[ValueRow], names: list[tuple[str, ...]]) -> list[Channel]:
    """The components behind a column of times."""
    width = len(rows[0].numbers)
    printed.require_width(rows, width)
    if width == 2:
        _read_column_names(block.header, block.stated)
    times = printed.even_interval([ValueRow(row.line, row.numbers[:1]) for row in rows])
    unit = units.stated_among(block.stated.units, units.SECONDS) or "s"
    size = units.SECONDS[unit]
    times = times._replace(value=float(f"{times.value * size:.12g}"), slack=times.slack * size)
    return [
        Channel(tuple(names[k]), block.stated, *_column(rows, k), times) for k in range(1, width)
    ]


def _full(rows: list[ValueRow], width: int) -> list[ValueRow]:
    return rows[:-1] if len(rows[-1].numbers) < width else rows


def _history(block: Block, dt: float | None, notes: list[str]) -> NDArray[np.float64]:
    rows, width = block.rows, len(block.rows[0].numbers)
    full = _full(rows, width)
    printed.require_width(full, width)
    _require_no_times(full, width, dt)
    if width > 1 and len(full) >= 2 * FEW:
        table = flatten(full).reshape(-1, width)
        along, down = (np.abs(np.diff(table, axis=axis)).mean() for axis in (1, 0))
        if along > 2 * down:
            seem = f"rows of {width} values seem to be columns side by side"
            notes.append(f"{seem}: they are read along the rows, as one history")
    return _without_integrals(rows, flatten(rows))


def _without_integrals(rows: list[ValueRow], samples: NDArray[np.float64]) -> NDArray[np.float64]:
    """The samples; a ``MisreadError`` if velocities follow the accelerations, in equal number."""
    for parts in (2, 3):
        n = len(samples) // parts
        if len(samples) % parts or n < 10 * FEW:
            continue
        mean, step = (samples[: n - 1] + samples[1:n]) / 2, np.diff(samples[n : 2 * n])
        size = np.linalg.norm(mean) * np.linalg.norm(step)
        if size > 0 and mean @ step > _ALIKE * size:
            rule = f"only the {n} accelerations must stay in the file"
            message = f"velocities seem to follow {n} accelerations of a file without its header"
            raise MisreadError(printed.line_of(rows, n), f"{message}: {rule}")
    return samples


def _require_no_times(rows: list[ValueRow], width: int, dt: float | None) -> None:
    for k in range(width):
        if _rises_evenly([float(row.numbers[k]) for row in rows], dt, alone=width == 1):
            place, rule = "the only column", "it must hold accelerations"
            if width > 1:
                place, rule = f"column {k + 1}", "times must be the first column"
            message = f"{place} rises evenly from row to row, as times or an index do: {rule}"
            raise MisreadError(rows[0].line, message)


def _rises_evenly(column: list[float], dt: float | None, *, alone: bool) -> bool:
    """Whether a column is times or an index; with many rows, coarse printing is allowed for."""
    n, steps = len(column), np.diff(column)
    likely = (dt, 1000 * dt) if dt else ()
    if n > 2 and any(np.allclose(steps, step, rtol=1e-3, atol=0) for step in likely):
        return True
    if n < (FEW if alone else 4) or not column[-1] > column[0]:
        return False
    off = column - np.linspace(column[0], column[-1], n)
    return bool(np.abs(off).max() <= (2.1 if n >= 4 * FEW else 0.01) * steps.mean())


def _first_are_times(rows: list[ValueRow], dt: float | None) -> bool:
    return len(rows[0].numbers) > 1 and _rises_evenly(
        [float(row.numbers[0]) for row in rows if row.numbers], dt, alone=False
    )


def _is_index(rows: list[ValueRow]) -> bool:
    """Whether the first column counts the rows."""
    numbers = [row.numbers[0] for row in rows]
    return all(x.isdigit() for x in numbers) and set(np.diff(list(map(int, numbers)))) == {1}


def _are_pairs(rows: list[ValueRow]) -> bool:
    """Whether rows are pairs of time and acceleration: every other number rises evenly."""
    times = [float(number) for row in rows for number in row.numbers[::2]]
    return len(rows) > 1 and _rises_evenly(times, None, alone=True)


def _are_components(block: Block, rows: list[ValueRow], dt: float | None) -> bool:
    """Whether two columns are components: the first goes up and down, and an interval is known."""
    if len(rows) < 2 * FEW or not (dt or block.stated.intervals):
        return False
    rising = np.diff(flatten(_columns_from(rows, 0))[::2]) > 0
    return bool(0.2 < rising.mean() < 0.8)


def _without_first_numbers(block: Block, dt: float | None) -> Block:
    """A block without the number of values and the interval that may stand ahead of them."""
    rows, stated = block.rows, block.stated
    widths = [len(row.numbers) for row in rows[:3]]
    if len(rows) > FEW and widths[:2] == [2, 1]:
        (line, (count, step)), rows = rows[0], rows[1:]
        _state_first(stated, line, count)
        if not float(step) > 0:
            raise MisreadError(line, f"{step} must be the time step, in s, and positive")
        stated.intervals.append(interval(line, "the first line", step))
    elif len(rows) > FEW and widths == [1, 1, 1]:
        first, behind = rows[0].numbers[0], [row.numbers[0] for row in rows[1:]]
        n_stated = int(first) if first.isdigit() else 0
        if counted := _is_count(first, behind):
            _state_first(stated, rows[0].line, first)
            rows, behind = rows[1:], behind[1:]
            first = rows[0].numbers[0]
        sure = float(first) == dt or (counted and n_stated == len(behind))
        if _is_step(first, behind, sure=sure):
            line = rows[0].line
            if dt is None and not counted:
                rule = f"pass dt={float(first):g} if it is one, in s"
                message = f"{first} stands apart from the values behind it, as a time step does"
                raise MisreadError(line, f"{message}: {rule}")
            stated.intervals.append(interval(line, "the first line", first))
            rows = rows[1:]
    return block._replace(rows=rows)


def _is_count(first: str, behind: list[str]) -> bool:
    """Whether the first of some values is their number: whole as no other, or right."""
    if not first.isdigit() or int(first) < 2:
        return False
    n_behind = {len(behind), len(behind) - 1}
    return int(first) in n_behind or all("." in number for number in behind[1:])


def _state_first(stated: Stated, line: int, count: str) -> None:
    if not (float(count).is_integer() and float(count) > 0):
        raise MisreadError(line, f"{count} must be the number of values, in a row ahead of them")
    stated.counts.append(Statement(line, "the first line", float(count), 0.0))


def _is_step(first: str, behind: list[str], *, sure: bool) -> bool:
    """Whether the first of some values is like a time step and, unless ``sure``, stands apart."""
    value, early = float(first), np.array([float(number) for number in behind[: 2 * FEW]])
    if not 0 < value <= 0.1 or abs(1 / value - round(1 / value)) > 1e-6 / value:
        return False
    return sure or bool(abs(value - early[0]) > 20 * np.abs(np.diff(early)).max())


def _names_in(header: Sequence[TextLine]) -> list[tuple[int, str, list[str]]]:
    """The last two lines with words of a header: number, text, and the names of columns in it."""
    lines = [line for line in header if units.WORD.search(line.text)][-2:]
    return [(number, raw, _column_names(raw)) for number, raw in lines]


def _read_column_names(header: Sequence[TextLine], stated: Stated) -> None:
    """Check that the names of two columns are time and acceleration, and add their units."""
    for number, _, cells in _names_in(header):
        first, second = map(units.words_of, cells[-2:]) if len(cells) in (2, 3) else ([], [])
        if not (first and second):
            continue
        if first[0] in _NO_TIMES:
            rule = "the first column must be times"
            raise MisreadError(number, f"{rule}, but the header says {first[0]}")
        if first[0] not in units.TIMES:
            continue
        if others := [word for word in second if word in units.OTHER_QUANTITIES]:
            message = f"must be an acceleration history, but the header says {others[0]}"
            raise OtherKindError(number, message)
        for cell, is_time in zip(cells[-2:], (True, False), strict=True):
            if unit := _unit_of_cell(number, cell, is_time=is_time):
                units.state(stated.units, unit, number)


def _names_times(names: list[tuple[str, ...]]) -> int | None:
    """The index of the column that is named times, the first or, behind an index, the second."""
    for index, name in enumerate(names[:2]):
        if any(words and words[0] in units.TIMES for words in map(units.words_of, name)):
            return index
    return None


def _names(layout: Layout, block: Block, width: int) -> list[tuple[str, ...]]:
    """Names of the columns: of a pattern of the format, or of the last lines of the header."""
    patterned = layout.components(block.header)
    if patterned and len(patterned) in (width, width - 1):
        return [("time",)] * (width - len(patterned)) + [(name,) for name in patterned]
    lines = [
        [cell if units.WORD.search(cell) else "" for cell in cells]
        for _, raw, cells in _names_in(block.header)
        if len(cells) == width and _are_names(block, raw, cells)
    ]
    return [tuple(filter(None, names)) for names in zip(*lines, strict=True)]


def _are_names(block: Block, raw: str, cells: list[str]) -> bool:
    """Whether cells have the separators of the rows, or are names of directions and channels."""
    separated = any(mark in block.first and mark in raw for mark in ",;\t")
    words = [set(units.words_of(cell)) for cell in cells]
    return all(words[1:]) and (separated or all(x <= _COMPONENTS for x in words))


def _column_names(raw: str) -> list[str]:
    text = raw.lstrip("#%/ ").rstrip(",; \t")
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
