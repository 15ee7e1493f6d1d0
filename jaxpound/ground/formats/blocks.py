"""Formats of blocks: each component has text, numbers of a header, then values in fixed columns."""

from __future__ import annotations

import re
from collections.abc import Sequence

from jaxpound.ground.formats import rows as printed
from jaxpound.ground.formats.header import require_acceleration, stated_units
from jaxpound.ground.formats.layout import Channel, Layout
from jaxpound.ground.formats.rows import ValueRow
from jaxpound.ground.formats.statements import Stated, state_numbers
from jaxpound.ground.formats.text import MisreadError, OtherKindError, TextLine, shown

_FORM = re.compile(r"\((?:[0-9]P,? ?)?([0-9]{0,3})[FEGDI]([0-9]{1,2})(?:\.[0-9]{1,2})?\)", re.I)
_NUMBERS_ONLY = re.compile(r"[-+.0-9EeDd \t]+")
_OTHER_VALUES = re.compile(r"\b(?:vel|disp|response|fourier|spectr)", re.I)


def read(layout: Layout, lines: Sequence[TextLine]) -> list[Channel]:
    """The components of a file, in their order."""
    begin = re.compile(layout.begin, re.I)
    starts = [i for i, line in enumerate(lines) if begin.match(line.text)]
    for number, text in lines[: starts[0]]:
        if _OTHER_VALUES.search(text):
            raise OtherKindError(number, f"{shown(text.strip())}: must be accelerations")
        if _NUMBERS_ONLY.fullmatch(text):
            raise MisreadError(number, f"{shown(text.strip())}: numbers must follow a header")
    ends = [*starts[1:], len(lines)]
    return [_channel(layout, lines[i:end]) for i, end in zip(starts, ends, strict=True)]


def _channel(layout: Layout, lines: Sequence[TextLine]) -> Channel:
    at, form, pairs = _first_value(layout, lines)
    header, stated = lines[:at], Stated()
    text = [line for line in header if not _NUMBERS_ONLY.fullmatch(line.text)]
    require_acceleration(text)
    stated.units |= {layout.unit: text[0].number} if layout.unit else stated_units(text)
    state_numbers(text, stated)
    if layout.state:
        layout.state(header, stated)
    if not stated.counts:
        rule = f"{layout.name} must state the number of values"
        raise MisreadError(lines[0].number, f"the header of a component of a file of {rule}")
    count = stated.counts[-1]
    n = int(count.value) * (1 + pairs)
    rows, end = _rows(lines, at, n, form)
    n_read = sum(len(row.numbers) for row in rows)
    _require_whole(layout, lines[end:], n, n_read, form)
    names = tuple(layout.components(header))
    if not pairs:
        return Channel(names, stated, rows, printed.flatten(rows))
    samples, times, rows = printed.split_pairs(rows)
    return Channel(names, stated, rows, samples, times)


def _first_value(
    layout: Layout, lines: Sequence[TextLine]
) -> tuple[int, tuple[int, int] | None, bool]:
    """The index of the first row of values, their form, and whether they are pairs with times."""
    if layout.title:
        title = re.compile(layout.title, re.I)
        for index, line in enumerate(lines[:-1]):
            if title.match(line.text) and _NUMBERS_ONLY.fullmatch(lines[index + 1].text):
                if _OTHER_VALUES.search(line.text):
                    rule = "must be accelerations first"
                    raise OtherKindError(line.number, f"{shown(line.text.strip())}: {rule}")
                form = _FORM.search(line.text)
                titled = (int(form[1] or 1), int(form[2])) if form else layout.form
                return index + 1, titled, False
    at = 1
    for n_rows, per_row, width in layout.numbers:
        while at < len(lines) and not _is_full(lines[at].text, per_row, width):
            at += 1
        at += n_rows
    while at < len(lines) and not _NUMBERS_ONLY.fullmatch(lines[at].text):
        at += 1
    if at >= len(lines):
        rule = "there are no values where they should be"
        raise MisreadError(lines[0].number, f"no data: in this file of {layout.name} {rule}")
    return at, layout.pairs or layout.form, layout.pairs is not None


def _is_full(text: str, per_row: int, width: int) -> bool:
    text = text.rstrip()
    return len(text) == per_row * width and _NUMBERS_ONLY.fullmatch(text) is not None


def _rows(
    lines: Sequence[TextLine], at: int, n: int, form: tuple[int, int] | None
) -> tuple[list[ValueRow], int]:
    """Rows of ``n`` numbers or fewer from an index on, and the index behind them."""
    rows: list[ValueRow] = []
    left = n
    while left > 0 and at < len(lines) and _begins_number(lines[at].text):
        rows.append(printed.row_of(lines[at], form, min(left, form[0]) if form else None))
        left, at = left - len(rows[-1].numbers), at + 1
    if left > 0 and at < len(lines) and (bad := _damaged(lines[at], lines[at + 1 : at + 2])):
        raise MisreadError(lines[at].number, bad)
    return rows, at


def _begins_number(text: str) -> bool:
    return text.lstrip()[:1] in set("+-.0123456789")


def _damaged(line: TextLine, behind: Sequence[TextLine]) -> str:
    """What is wrong with a line where values should go on; empty if it is no row of values."""
    if behind and _NUMBERS_ONLY.fullmatch(behind[0].text):
        return f"{shown(line.text.strip())} must be a row of numbers"
    return ""


def _require_whole(
    layout: Layout,
    behind: Sequence[TextLine],
    n: int,
    n_read: int,
    form: tuple[int, int] | None,
) -> None:
    """Refuse numbers behind the values, but for as many velocities and displacements."""
    if n_read < n:
        return  # the count is checked by the reader
    more = 0
    for line in behind:
        if not _begins_number(line.text) or (
            layout.title and not _NUMBERS_ONLY.fullmatch(line.text)
        ):
            break
        row = printed.row_of(line, form, None)
        more += len(row.numbers) if any(map(float, row.numbers)) or layout.integrals else 0
    if more and not (layout.integrals and more in (n, 2 * n)):
        rule = "velocities and displacements, as many each" if layout.integrals else "none"
        message = f"{more} numbers follow the {n} that the header states: they must be {rule}"
        raise MisreadError(behind[0].number, message)
