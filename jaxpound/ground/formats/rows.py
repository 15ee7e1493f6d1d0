"""Rows of printed numbers: reading and checking them."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from decimal import Decimal
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jaxpound.ground.formats.header import require_acceleration, stated_units
from jaxpound.ground.formats.statements import Stated, Statement, state_numbers
from jaxpound.ground.formats.text import (
    EXCEL_ERROR,
    NUMBER,
    MisreadError,
    TextLine,
    is_comment,
    shown,
    trimmed,
    with_e,
)

_LONGEST_HEADER = 10_000  # lines, and characters in a line
FEW, MANY = 10, 100  # values that suggest a pattern, and that exclude coincidence
_NUMBER = re.compile(NUMBER)
_NOT_FINITE = re.compile(r"[-+]?(?:nan|inf(?:inity)?|[0-9]\.#\w{1,9})", re.I)
_LIKE_NUMBER = re.compile(r"[-+.]?[0-9]|(?:nan?|null|n/a|none)(?!\w)|-$", re.I)
_WORD = re.compile(r"(?<![\w.])(?!(?:nan|null|na|none)\b)[^\W\d_]{2,}", re.I)
_END_MARK = re.compile(r"\*++\s*+end(?![^\W_])", re.I)
_SIGN_AFTER_NUMBER = re.compile(r"(?<=[0-9.])(?=[-+])")
_LONGEST_NUMBER = 100
# Nearly all rows: numbers between blanks or between commas.
_PLAIN_ROW = re.compile(rf"{NUMBER}(?:(?:[ \t]++{NUMBER})*+|(?:[ \t]*+,[ \t]*+{NUMBER})*+)")


class ValueRow(NamedTuple):
    """The numbers of a line."""

    line: int
    numbers: list[str]  # as printed, but for Fortran's D exponents


class Block(NamedTuple):
    """The header of a file, what it states, the text of the first row, and all rows."""

    header: Sequence[TextLine]
    stated: Stated
    first: str
    rows: list[ValueRow]


def read_block(lines: Sequence[TextLine], begin: int, notes: list[str]) -> Block:
    """The header and the rows of a file whose rows begin at or after the line of an index."""
    start = _first_row(lines, begin)
    header = lines[:start]
    first = lines[start].text if start < len(lines) else ""
    return Block(header, stated_in(header), first, parse_rows(lines[start:], notes))


def stated_in(header: Sequence[TextLine], unit: str = "") -> Stated:
    """What a header, of accelerations, states in prose; ``unit`` is known if it is not empty."""
    for index, line in enumerate(header):
        if max(index, len(line.text)) > _LONGEST_HEADER:
            rule = f"at most {_LONGEST_HEADER:,} lines of as many characters"
            raise MisreadError(line.number, f"the header must have {rule}")
    require_acceleration(header)
    stated = Stated(units={unit: header[0].number} if unit else stated_units(header))
    state_numbers(header, stated)
    return stated


def _first_row(lines: Sequence[TextLine], begin: int) -> int:
    for index in range(begin, len(lines)):
        text = trimmed(lines[index].text)
        if not (is_comment(text) or _is_header_text(text) or _states_numbers(lines[index])):
            return index
    return len(lines)


def _states_numbers(line: TextLine) -> bool:
    """Whether a line such as "800 points" states a number of samples or an interval."""
    state_numbers([line], stated := Stated())
    return bool(stated.counts or stated.intervals)


def _is_header_text(text: str) -> bool:
    """Whether a line is mostly words; the reader of rows reports a single bad token."""
    if EXCEL_ERROR.match(text):
        return False
    tokens = _tokens_of(text)[:MANY]
    numeric = [bool(_numbers(token) or _NOT_FINITE.fullmatch(token)) for token in tokens]
    if not _WORD.search(text) and (_LIKE_NUMBER.match(text) or 2 * sum(numeric) > len(tokens)):
        return False  # of a damaged number, such as 0.OO1, or a missing one
    return (tokens[0][:1].isalpha() and not numeric[0]) or 2 * sum(numeric) < len(tokens)


def parse_rows(lines: Sequence[TextLine], notes: list[str]) -> list[ValueRow]:
    """The rows of a block of data, up to a mark of its end, without comments."""
    rows: list[ValueRow] = []
    comment_line, noted = None, False  # the line of a comment behind some row
    for index, (number, raw) in enumerate(lines):
        text = trimmed(raw)
        if _END_MARK.match(text):
            if (after := _first_row(lines, index + 1)) < len(lines):
                unread = f"data of line {lines[after].number} are not read"
                notes.append(f"behind the end mark of line {number} the {unread}")
            break
        if is_comment(text):
            comment_line = number if rows and comment_line is None else comment_line
            continue
        if comment_line is not None and not noted:
            noted, place = True, f"the comment of line {comment_line}"
            notes.append(f"data follow {place}: is that one a value, too?")
        rows.append(_row(number, text))
    return rows


def _row(line: int, text: str) -> ValueRow:
    """The row of a trimmed line of finite numbers between separators of one kind."""
    if len(text) <= _LONGEST_NUMBER and _PLAIN_ROW.fullmatch(text):
        numbers = with_e(text).replace(",", " ").split()
        if not any(map(math.isinf, map(float, numbers))):
            return ValueRow(line, numbers)
    row = ValueRow(line, [])
    for token in _tokens_of(text):
        numbers = _numbers(token)
        if not numbers or any(math.isinf(float(number)) for number in numbers):
            raise MisreadError(line, f"{shown(token)} must be a finite number")
        row.numbers.extend(numbers)
    cells = text.replace(";", ",").split(",")
    separators = ("," in text) + (";" in text) + any(len(cell.split()) > 1 for cell in cells)
    if separators > 1:
        raise MisreadError(line, "must have one kind of separator, and no decimal commas")
    return row


def _tokens_of(text: str) -> list[str]:
    """The tokens between blanks, commas and semicolons; empty between two commas or semicolons."""
    cells = text.replace(";", ",").split(",")
    return [token for cell in cells for token in (cell.split() or [""])]


def _numbers(token: str) -> list[str]:
    """The numbers of a token; none if it is not numeric."""
    if _is_number(token):
        return [with_e(token)]
    parts = _SIGN_AFTER_NUMBER.split(token)
    # Numbers without a blank between them need decimal points: 1940-05-18 is a date.
    if not all("." in part and _is_number(part) for part in parts):
        return []
    return list(map(with_e, parts))


def _is_number(text: str) -> bool:
    return len(text) <= _LONGEST_NUMBER and _NUMBER.fullmatch(text) is not None


def row_of(line: TextLine, form: tuple[int, int] | None, n: int | None) -> ValueRow:
    """The row of a line of ``n`` values or more; ``form``: most, characters of each (0: any)."""
    number, text = line.number, line.text.rstrip()
    if form is None or not form[1]:
        return _row(number, trimmed(text))
    per_row, width = form
    text = text[1:] if len(text) % width == 1 and text[0] == " " else text
    cells = [text[at : at + width] for at in range(0, len(text), width)]
    numbers = [cell.lstrip() for cell in cells]
    right = len(text) % width == 0 and all(map(_is_number, numbers))
    if not right or not (n or 1) <= len(cells) <= per_row:
        rule = f"must be {n or per_row} numbers of {width} characters each"
        raise MisreadError(number, f"{shown(text.strip())} {rule}")
    return ValueRow(number, [with_e(cell) for cell in numbers])


def numbers_of(lines: Sequence[TextLine], form: tuple[int, int]) -> list[str]:
    """The numbers of some lines, as printed."""
    return [number for line in lines for number in row_of(line, form, None).numbers]


def split_pairs(rows: list[ValueRow]) -> tuple[NDArray[np.float64], Statement, list[ValueRow]]:
    """Accelerations of rows of pairs of time and acceleration, the interval, and their rows."""
    for line, numbers in rows:
        if len(numbers) % 2:
            raise MisreadError(line, f"a row of {len(numbers)} values must be pairs of two")
    times = [ValueRow(row.line, row.numbers[0::2]) for row in rows]
    values = [ValueRow(row.line, row.numbers[1::2]) for row in rows]
    return flatten(values), even_interval(times), values


def even_interval(rows: list[ValueRow]) -> Statement:
    """The interval of times, which must be uniform within the rounding of their print."""
    times, numbers = flatten(rows), [number for row in rows for number in row.numbers]
    if len(times) < 2:
        raise MisreadError(rows[0].line, "a record must have at least two samples, this has one")
    dt = float((Decimal(numbers[-1]) - Decimal(numbers[0])) / (len(times) - 1))
    rounding = print_rounding(numbers)
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
        raise MisreadError(line_of(rows, worst + 1), message)
    printed = (rounding[0] + rounding[-1]) / (len(times) - 1)
    return Statement(rows[0].line, "the column of times", float(f"{dt:.12g}"), float(printed))


def odd_row(lines: Sequence[TextLine], rows: list[ValueRow]) -> TextLine | None:
    """The first line whose numbers do not end below those of nearly all rows, flush right."""
    texts = {line.number: line.text for line in lines}
    ends = [[match.end() for match in re.finditer(r"\S++", texts[row.line])] for row in rows]
    usual = max(ends[:1000], key=ends[:1000].count)
    odd = [row.line for row, at in zip(rows, ends, strict=True) if at != usual[: len(at)]]
    if len(rows) > 2 and 0 < len(odd) <= max(1, len(rows) // 100):
        return TextLine(odd[0], texts[odd[0]])
    return None


def require_count(stated: Stated, n: int) -> None:
    """Refuse a file whose number of values is none of those that its header states."""
    if stated.counts and not any(n == statement.value for statement in stated.counts):
        count = stated.counts[-1]
        fault = "truncated" if n < count.value else "surplus values"
        rule = f"must be the number of values, {n}"
        raise MisreadError(count.line, f"{fault if n else 'no data'}: {count.text} {rule}")


def print_rounding(numbers: list[str]) -> NDArray[np.float64]:
    """Half a unit in the last printed place of each number."""
    # Trailing zeros may be missing (0.1 among 0.08 and 0.12): the longest number has all places.
    decimals = [Decimal(number) for number in numbers]
    last_place = min(int(d.as_tuple().exponent) for d in decimals)
    digits = max(len(d.as_tuple().digits) for d in decimals)
    places = [max(last_place, d.adjusted() - digits + 1) for d in decimals]
    return 0.5 * 10.0 ** np.array(places, dtype=np.float64)


def require_width(rows: list[ValueRow], width: int) -> None:
    """Refuse a row of more or fewer values than ``width``."""
    for line, numbers in rows:
        if len(numbers) != width:
            raise MisreadError(line, f"a row of {len(numbers)} value(s) must have {width}")


def flatten(rows: list[ValueRow]) -> NDArray[np.float64]:
    """All numbers, one row after the other."""
    return np.array([float(number) for _, numbers in rows for number in numbers], dtype=np.float64)


def line_of(rows: list[ValueRow], sample: int) -> int:
    """The line that holds the sample of an index."""
    ends = np.cumsum([len(row.numbers) for row in rows])
    return rows[int(np.searchsorted(ends, sample, side="right"))].line
