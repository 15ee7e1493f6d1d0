"""Rows of numbers behind one header: a history, columns of components, times and accelerations."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from jaxpound.ground.formats import rows as printed
from jaxpound.ground.formats import units
from jaxpound.ground.formats.layout import Channel, Layout
from jaxpound.ground.formats.rows import FEW, MANY, Block, ValueRow, flatten
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
_OF_SPECTRA = set_of("period periods periode periodo période tn frequency frequencies freq f hz")
_NO_TIMES = _OF_SPECTRA | set_of(
    "distance index no number n i k id point points sample samples count step steps"
)
_COMPONENTS = (
    units.NO_UNITS
    | units.TIMES
    | units.OTHER_QUANTITIES
    | set_of("v u d acc accel acceleration hor ver comp ch chan channel canal long lat tran trans")
)
_SIDE_BY_SIDE = {2, 3, 4, 6}  # numbers a row that are components: real histories have 5, 8 or 10
_ALIKE = 0.9  # correlation of accelerations with the differences of velocities behind them


def read(
    layout: Layout, lines: Sequence[TextLine], dt: float | None, form: str | None, notes: list[str]
) -> list[Channel]:
    """The components of a file; ``dt`` and ``form``, what its rows are, are those of the user."""
    behind = (i for i, x in enumerate(lines) if layout.behind and layout.matches("behind", x))
    block = printed.read_block(lines, 1 + next(behind, -1), notes)
    header, stated = block.header, block.stated
    if layout.state:
        layout.state(header, stated)
    if layout.unit:
        units.state(stated.units, layout.unit, lines[0].number)
    if not block.rows:
        if not (counts := stated.counts):
            raise OtherKindError(None, "no data: it must hold rows of numbers")
        raise MisreadError(counts[-1].line, f"no data: {counts[-1].text} must be followed by them")
    block = _without_first_numbers(block, dt)
    flush_right = all(line.text[:1] == " " for line in lines[len(header) :][:MANY])
    if flush_right and not layout.history and (odd := printed.odd_row(lines, block.rows)):
        seem = f"{shown(odd.text.strip())}, do not end below those of other rows"
        notes.append(f"the numbers of line {odd.number}, {seem}: are digits lost?")
    own_names = tuple(layout.components(header))
    counted = [statement.value for statement in stated.counts]
    if layout.history and (len(block.rows[0].numbers) == 1 or len(block.rows) not in counted):
        return [Channel(own_names, stated, block.rows, flatten(block.rows))]
    return _channels(block, own_names, dt, form, notes)


def _channels(
    block: Block, own_names: tuple[str, ...], dt: float | None, form: str | None, notes: list[str]
) -> list[Channel]:
    stated, rows, width = block.stated, block.rows, len(block.rows[0].numbers)
    if form == HISTORY:
        return [Channel(own_names, stated, rows, _history(rows, width, dt, []))]
    names = _names(own_names, block, width)
    if width > 2 and width % 2 == 0 and _rise(rows, slice(0, None, 2)):
        samples, times, rows = printed.split_pairs(rows)
        return [Channel((), stated, rows, samples, times)]
    first_words = [{w for x in column for w in units.words_of(x)[:1]} for column in names]
    first = next((k for k, words in enumerate(first_words) if words & units.TIMES), None)
    if first is None and width > 2 and _rise(rows, 0, dt):
        first = int(_is_index(rows) and _rise(rows, 1, dt))
    if first is None and width == 2 and not _are_components(block, dt):
        first = 0
    if first is not None:
        printed.require_width(rows, width)
        return _timed(block, first, names)
    gaps = [x.line for x, before in zip(rows[1:], rows, strict=False) if x.line > before.line + 1]
    if not stated.counts and 0 < len(gaps) <= 1 + len(rows) // MANY:
        notes.append(f"there is a blank line ahead of line {gaps[0]}: is a value missing?")
    if width in _SIDE_BY_SIDE or names or (form == COLUMNS and width > 1):
        printed.require_width(rows, width)
        _require_no_times(rows, width, dt)
        return [_column(block, k, names) for k in range(width)]
    return [Channel(own_names, stated, rows, _history(rows, width, dt, notes))]


def _column(
    block: Block, k: int, names: list[tuple[str, ...]], times: Statement | None = None
) -> Channel:
    rows = [ValueRow(row.line, [row.numbers[k]]) for row in block.rows]
    return Channel(names[k] if names else (), block.stated, rows, flatten(rows), times)


def _is_index(rows: list[ValueRow]) -> bool:
    """Whether the first column counts the rows."""
    counts = [row.numbers[0] for row in rows]
    return all(map(str.isdigit, counts)) and set(np.diff(list(map(int, counts)))) == {1}


def _timed(block: Block, first: int, names: list[tuple[str, ...]]) -> list[Channel]:
    """The components beside a column of times."""
    width = len(block.rows[0].numbers)
    if width == first + 2:
        _read_column_names(block.header, block.stated)
    times = printed.even_interval([ValueRow(x.line, x.numbers[first:][:1]) for x in block.rows])
    size = units.SECONDS[units.stated_among(block.stated.units, units.SECONDS) or "s"]
    times = times._replace(value=float(f"{times.value * size:.12g}"), slack=times.slack * size)
    no_component = {first, 0} if first and _is_index(block.rows) else {first}
    return [_column(block, k, names, times) for k in range(width) if k not in no_component]


def _history(
    rows: list[ValueRow], width: int, dt: float | None, notes: list[str]
) -> NDArray[np.float64]:
    """The samples of rows of any width; an error if velocities follow them in equal number."""
    full, samples = rows[:-1] if len(rows[-1].numbers) < width else rows, flatten(rows)
    printed.require_width(full, width)
    _require_no_times(full, width, dt)
    if width > 1 and len(full) >= 2 * FEW:
        table = flatten(full).reshape(-1, width)
        along, down = (np.abs(np.diff(table, axis=axis)).mean() for axis in (1, 0))
        if along > 2 * down:
            seem = f"rows of {width} values seem to be columns side by side"
            notes.append(f"{seem}: they are read along the rows, as one history")
    for n, left in (divmod(len(samples), parts) for parts in (2, 3)):
        if left == 0 and n >= 10 * FEW:
            mean, step = (samples[: n - 1] + samples[1:n]) / 2, np.diff(samples[n : 2 * n])
            if mean @ step > _ALIKE * np.linalg.norm(mean) * np.linalg.norm(step) > 0:
                seem = f"velocities seem to follow {n} accelerations of a file without its header"
                rule = "only the accelerations must stay in the file"
                raise MisreadError(printed.line_of(rows, n), f"{seem}: {rule}")
    return samples


def _require_no_times(rows: list[ValueRow], width: int, dt: float | None) -> None:
    for k in range(width):
        if _rise(rows, k, dt, FEW if width == 1 else 4):
            which = f"column {k + 1}" if width > 1 else "the only column"
            rule = "times must be the first column" if width > 1 else "it must hold accelerations"
            message = f"{which} rises evenly from row to row, as times or an index do: {rule}"
            raise MisreadError(rows[0].line, message)


def _rise(
    rows: list[ValueRow], which: int | slice, dt: float | None = None, least: int = 4
) -> bool:
    """Whether a column, or some of the numbers a row, rise evenly, as times and an index do."""
    if isinstance(which, int):
        which = slice(which, which + 1)
    column = np.array([float(number) for row in rows for number in row.numbers[which]])
    n, steps = len(column), np.diff(column)
    likely = (dt, 1000 * dt) if dt else ()
    if n > 2 and any(np.allclose(steps, step, rtol=1e-3, atol=0) for step in likely):
        return True
    if n < least or not column[-1] > column[0]:
        return False
    off = column - np.linspace(column[0], column[-1], n)
    return bool(np.abs(off).max() <= (2.1 if n >= 4 * FEW else 0.01) * steps.mean())


def _are_components(block: Block, dt: float | None) -> bool:
    """Whether two columns are components: the first goes up and down, and an interval is known."""
    rows = block.rows
    if len(rows) < 2 * FEW or not (dt or block.stated.intervals):
        return False
    return bool(0.2 < (np.diff([float(row.numbers[0]) for row in rows]) > 0).mean() < 0.8)


def _without_first_numbers(block: Block, dt: float | None) -> Block:
    """A block without the number of values and the time step that may stand ahead of them."""
    rows, stated = block.rows, block.stated
    head, *widths = [len(row.numbers) for row in rows[:3]]
    allowed = (1, 5, 8, 10) if head == 2 else (1,)
    if len(rows) <= FEW or widths[0] not in allowed or widths[0] != widths[1]:
        return block
    line, first = rows[0]
    step_line, text = line, f"the first line, {first[0]},"
    count = step = None
    if len(first) == 2:
        (count, step), rows = first, rows[1:]
    elif len(first) == 1:
        behind = [row.numbers[0] for row in rows[1:]]
        right = first[0] in (f"{len(behind)}", f"{len(behind) - 1}")
        if right or (first[0].isdigit() and all("." in number for number in behind[1:])):
            count, rows = first[0], rows[1:]
        sure = float(rows[0].numbers[0]) == dt or count == f"{len(rows) - 1}"
        if _is_step(rows, sure):
            (step_line, (step,)), rows = rows[0], rows[1:]
    if count is not None:
        if not (float(count).is_integer() and float(count) > 1):
            raise MisreadError(line, f"{count} must be the number of values, which follow it")
        stated.counts.append(Statement(line, text, float(count)))
    elif step is not None and dt is None:
        rule = f"pass dt={float(step):g} if it is one, in s"
        seem = f"{step} stands apart from the values behind it, as a time step does"
        raise MisreadError(step_line, f"{seem}: {rule}")
    if step is not None:
        stated.intervals.append(interval(step_line, text, step))
    return block._replace(rows=rows)


def _is_step(rows: list[ValueRow], sure: bool) -> bool:
    """Whether the first of some values is like a time step and, unless ``sure``, stands apart."""
    value, *early = (float(row.numbers[0]) for row in rows[: 2 * FEW])
    if not 0 < value <= 0.1 or abs(1 / value - round(1 / value)) > 1e-6 / value:
        return False
    return sure or bool(abs(value - early[0]) > 20 * np.abs(np.diff(early)).max())


def _names_in(header: Sequence[TextLine]) -> list[tuple[int, str, list[str]]]:
    """The last two lines with words of a header: number, text, and the names of columns in it."""
    names = []
    for number, raw in [line for line in header if units.WORD.search(line.text)][-2:]:
        text = raw.lstrip("#%/ ").rstrip(",; \t")
        separator = next((x for x in ";,\t" if x in text), None)
        cells = text.split(separator) if separator else _CELL.findall(plain(text))
        names.append((number, raw, list(map(plain, cells))))
    return names


def _read_column_names(header: Sequence[TextLine], stated: Stated) -> None:
    """Check that the names of two columns are time and acceleration, and add their units."""
    for number, _, cells in _names_in(header):
        first, second = map(units.words_of, cells[-2:]) if len(cells) in (2, 3) else ([], [])
        if not (first and second):
            continue
        if first[0] in _NO_TIMES:
            kind = OtherKindError if first[0] in _OF_SPECTRA else MisreadError
            rule = "the first column must be times"
            raise kind(number, f"{rule}, but the header says {first[0]}")
        if first[0] not in units.TIMES:
            continue
        if others := [word for word in second if word in units.OTHER_QUANTITIES]:
            message = f"must be an acceleration history, but the header says {others[0]}"
            raise OtherKindError(number, message)
        for cell, is_time in zip(cells[-2:], (True, False), strict=True):
            if unit := _unit_of_cell(number, cell, is_time=is_time):
                units.state(stated.units, unit, number)


def _names(own: tuple[str, ...], block: Block, width: int) -> list[tuple[str, ...]]:
    """Names of the columns: those that the format states, and of the last lines of the header."""
    lines: list[list[str]] = []
    for _, raw, cells in _names_in(block.header):
        bare = [re.sub(r"(?<=\S) ?[(\[].*", "", cell) for cell in cells]
        words = [set(units.words_of(cell)) for cell in bare]
        separated = any(mark in block.first and mark in raw for mark in ",;\t")
        are_names = len(cells) == width and all(words[1:])
        if are_names and (separated or all(x <= _COMPONENTS for x in words)):
            lines.append([cell if units.WORD.search(cell) else "" for cell in bare])
    if own and len(own) in (width, width - 1) and not any(name in own for x in lines for name in x):
        lines.append([*("time",) * (width - len(own)), *own])
    return [tuple(filter(None, names)) for names in list[tuple[str, ...]](zip(*lines, strict=True))]


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
