"""Formats of blocks: each component has text, numbers of a header, then values in fixed columns."""

from __future__ import annotations

import re
from collections.abc import Sequence

from jaxpound.ground.formats import rows as printed
from jaxpound.ground.formats.header import stated_units
from jaxpound.ground.formats.layout import Channel, Layout
from jaxpound.ground.formats.rows import ValueRow
from jaxpound.ground.formats.text import MisreadError, OtherKindError, TextLine, shown
from jaxpound.ground.formats.units import UNITS, stated_among

_FORM = re.compile(r"\((?:[0-9]P,? ?)?([0-9]{0,3})[FEGDI]([0-9]{1,2})(?:\.[0-9]{1,2})?\)", re.I)
_NUMBERS = re.compile(r"[-+.0-9EeDd \t]+")
_OTHER_VALUES = re.compile(r"\b(?:vel|disp|response|fourier|spectr)", re.I)


def read(layout: Layout, lines: Sequence[TextLine]) -> list[Channel]:
    """The components of a file, in their order."""
    starts = [i for i, line in enumerate(lines) if layout.matches("begin", line)]
    _require_accelerations(lines[: starts[0]])
    if early := next((line for line in lines[: starts[0]] if _is_row(line)), None):
        raise MisreadError(early.number, f"{shown(early.text.strip())}: must be behind a header")
    channels, other = list[Channel](), None
    for i, end in zip(starts, [*starts[1:], len(lines)], strict=True):
        try:
            channels.append(_channel(layout, lines[i:end]))
        except OtherKindError as error:  # velocity or displacement, with a header of its own
            other = error
    if other and not channels:
        raise other
    return channels


def _channel(layout: Layout, lines: Sequence[TextLine]) -> Channel:
    at, form, pairs = _first_value(layout, lines)
    header = lines[:at]
    text = [line for line in header if not _NUMBERS.fullmatch(line.text)]
    titled = stated_units(text[-1:]) if layout.title else {}
    unit = "" if stated_among(titled, UNITS) else layout.unit
    stated = printed.stated_in(text, unit)
    if layout.state:
        layout.state(header, stated)
    if not stated.counts:
        rule = f"the header of a component of a file of {layout.name} must state it"
        raise MisreadError(lines[0].number, f"no number of values: {rule}")
    n = int(stated.counts[-1].value) * (1 + pairs)
    rows, end = _rows(lines, at, n, form)
    if end < len(lines) and sum(len(row.numbers) for row in rows) == n:
        _require_whole(layout, lines[end:], n, form)
    names = tuple(layout.components(header))
    if not pairs:
        return Channel(names, stated, rows, printed.flatten(rows))
    samples, times, rows = printed.split_pairs(rows)
    return Channel(names, stated, rows, samples, times)


def _first_value(
    layout: Layout, lines: Sequence[TextLine]
) -> tuple[int, tuple[int, int] | None, bool]:
    """The index of the first row of values, their form, and whether they are pairs with times."""
    for at, line in enumerate(lines[:-1], 1):
        if layout.title and layout.matches("title", line) and _is_row(lines[at]):
            _require_accelerations([line])
            form = _FORM.search(line.text)
            return at, (int(form[1] or 1), int(form[2])) if form else layout.form, False
    at = 1
    for n_rows, per_row, width in layout.numbers:
        full = (i for i in range(at, len(lines)) if _is_row(lines[i], per_row * width))
        at = next(full, len(lines)) + n_rows
    if (first := next((i for i in range(at, len(lines)) if _is_row(lines[i])), None)) is None:
        raise MisreadError(lines[0].number, f"no data: no values in this file of {layout.name}")
    return first, layout.pairs or layout.form, layout.pairs is not None


def _require_accelerations(lines: Sequence[TextLine]) -> None:
    for number, text in lines:
        if _OTHER_VALUES.search(text):
            raise OtherKindError(number, f"{shown(text.strip())}: must be accelerations")


def _is_row(line: TextLine, length: int | None = None) -> bool:
    """Whether a line has numbers only, and is as long as it should be."""
    return length in (None, len(line.text.rstrip())) and bool(_NUMBERS.fullmatch(line.text))


def _rows(
    lines: Sequence[TextLine], at: int, n: int, form: tuple[int, int] | None
) -> tuple[list[ValueRow], int]:
    """Rows of ``n`` numbers or fewer from an index on, and the index behind them."""
    rows: list[ValueRow] = []
    while n > 0 and at < len(lines) and lines[at].text.lstrip()[:1] in set("+-.0123456789"):
        rows.append(printed.row_of(lines[at], form, min(n, form[0]) if form else None))
        n, at = n - len(rows[-1].numbers), at + 1
    return rows, at


def _require_whole(
    layout: Layout, behind: Sequence[TextLine], n: int, form: tuple[int, int] | None
) -> None:
    """Refuse numbers behind the values, but for as many velocities and displacements, and zeros."""
    more = 0
    for line in behind:
        if not _is_row(line):
            break
        row = printed.row_of(line, form, None)
        more += len(row.numbers) if layout.integrals or any(map(float, row.numbers)) else 0
    if more and not (layout.integrals and more in (n, 2 * n)):
        rule = "velocities and displacements, as many each" if layout.integrals else "none"
        message = f"{more} numbers follow the {n} that the header states: they must be {rule}"
        raise MisreadError(behind[0].number, message)
