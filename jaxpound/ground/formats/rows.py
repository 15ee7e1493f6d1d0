"""Rows of printed numbers: reading and checking them."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from decimal import Decimal
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jaxpound.ground.formats.header import require_acceleration, stated_units
from jaxpound.ground.formats.text import NUMBER, MisreadError, TextLine, is_comment, shown, trimmed

_LONGEST_HEADER = 10_000  # lines, and characters in a line
_SLOWEST_STEP = 0.5  # in s: nothing above 1 Hz would be left of an earthquake
FEW, _MANY = 10, 100  # values that suggest a pattern, and that exclude coincidence
_NUMBER = re.compile(NUMBER)
_NOT_FINITE = re.compile(r"[-+]?(?:nan|inf(?:inity)?|[0-9]\.#\w{1,9})", re.I)
_END_MARK = re.compile(r"\*++\s*+end(?![^\W_])", re.I)
_SIGN_AFTER_NUMBER = re.compile(r"(?<=[0-9.])(?=[-+])")
_LONGEST_NUMBER = 100
# Nearly all rows: numbers between blanks or between commas.
_PLAIN_ROW = re.compile(rf"{NUMBER}(?:(?:[ \t]++{NUMBER})*+|(?:[ \t]*+,[ \t]*+{NUMBER})*+)")
_SHAPE = str.maketrans("123456789", "000000000")  # the shape of a number: all digits 0


class ValueRow(NamedTuple):
    """The numbers of a line."""

    line: int
    numbers: list[str]  # as printed, but for Fortran's D exponents


class Block(NamedTuple):
    """The header and the rows of a file."""

    header: Sequence[TextLine]
    stated: dict[str, int]  # units, and the lines that state them
    first: str  # the line of the first row
    rows: list[ValueRow]


class Values(NamedTuple):
    """The values of a file; ``rows`` hold only the accelerations."""

    samples: NDArray[np.float64]
    dt: float
    rows: list[ValueRow]
    stated: dict[str, int]  # as in ``Block``


def read_block(lines: Sequence[TextLine], begin: int, notes: list[str]) -> Block:
    """The header and the rows of a file whose rows begin at or after the line of an index."""
    start = _first_row(lines, begin)
    header = lines[:start]
    for index, line in enumerate(header):
        if max(index, len(line.text)) > _LONGEST_HEADER:
            rule = f"at most {_LONGEST_HEADER:,} lines of as many characters"
            raise MisreadError(line.number, f"the header must have {rule}")
    require_acceleration(header)
    first = lines[start].text if start < len(lines) else ""
    return Block(header, stated_units(header), first, parse_rows(lines[start:], notes))


def _first_row(lines: Sequence[TextLine], begin: int) -> int:
    for index in range(begin, len(lines)):
        text = trimmed(lines[index].text)
        if not (is_comment(text) or _is_header_text(text)):
            return index
    return len(lines)


def _is_header_text(text: str) -> bool:
    """Whether a line is mostly words; the reader of rows reports a single bad token."""
    tokens = _tokens_of(text)[:_MANY]
    numeric = [bool(_numbers(token) or _NOT_FINITE.fullmatch(token)) for token in tokens]
    return (tokens[0][:1].isalpha() and not numeric[0]) or 2 * sum(numeric) < len(tokens)


def parse_rows(lines: Sequence[TextLine], notes: list[str]) -> list[ValueRow]:
    """The rows of a block of data, up to a mark of its end, without comments."""
    rows: list[ValueRow] = []
    comment_line, noted = None, False  # the line of a comment behind some row
    for index, (number, raw) in enumerate(lines):
        text = trimmed(raw)
        row = _plain_row(number, text)
        if row is None and _END_MARK.match(text):
            if (after := _first_row(lines, index + 1)) < len(lines):
                unread = f"data of line {lines[after].number} are not read"
                notes.append(f"behind the end mark of line {number} the {unread}")
            break
        if row is None and is_comment(text):
            comment_line = number if rows and comment_line is None else comment_line
            continue
        if comment_line is not None and not noted:
            noted, place = True, f"the comment of line {comment_line}"
            notes.append(f"data follow {place}: is that one a value, too?")
        rows.append(row or _parse_row(number, text))
    return rows


def _plain_row(line: int, text: str) -> ValueRow | None:
    """The row of a line that is only finite numbers with separators; None for other lines."""
    if len(text) > _LONGEST_NUMBER or not _PLAIN_ROW.fullmatch(text):
        return None
    numbers = text.upper().replace("D", "E").replace(",", " ").split()
    return None if any(map(math.isinf, map(float, numbers))) else ValueRow(line, numbers)


def _parse_row(line: int, text: str) -> ValueRow:
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
        return [token.upper().replace("D", "E")]
    parts = _SIGN_AFTER_NUMBER.split(token)
    # Numbers without a blank between them need decimal points: 1940-05-18 is a date.
    if not all("." in part and _is_number(part) for part in parts):
        return []
    return [part.upper().replace("D", "E") for part in parts]


def _is_number(text: str) -> bool:
    return len(text) <= _LONGEST_NUMBER and _NUMBER.fullmatch(text) is not None


def require_count(line: int, stated: str, expected: int, actual: int) -> None:
    """Refuse a file whose number of values differs from that stated in its header."""
    if actual != expected:
        fault = "truncated" if actual < expected else "surplus values"
        rule = f"must be the number of values, {actual}"
        raise MisreadError(line, f"{fault if actual else 'no data'}: {stated} {rule}")


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


def check_print(values: Values, ended: bool, notes: list[str]) -> None:
    """Refuse or note signs of damage: digits of printed values, a last line without a line end."""
    _check_digits(values.rows, ended, notes)
    peak = np.abs(values.samples)
    if len(peak) >= _MANY and not ended and peak[-1] > peak[:-1].max():
        notes.append("the last line has no end and its value is the largest: is the file cut?")
    if values.dt >= _SLOWEST_STEP and len(peak) >= FEW:
        notes.append(f"the time step is {values.dt:g} s: are the times in seconds?")


def _check_digits(rows: list[ValueRow], ended: bool, notes: list[str]) -> None:
    """Refuse a file that is cut inside its last value, which then has fewer digits than others.

    A zero at the end, such as -0 or 0.0, may be the rest of a small value with more digits, unless
    zeros are printed so elsewhere. A value elsewhere with other digits than nearly all is noted: it
    may be damaged.
    """
    numbers = [number for row in rows for number in row.numbers]
    if len(numbers) <= FEW // 2:
        return
    digits = np.array([_digits(number.translate(_SHAPE)) for number in numbers])
    _, decimals, exponents = digits.T
    exponents_before = exponents[:-1][exponents[:-1] > 0]
    uniform = np.ptp(decimals[:-1]) == np.ptp(exponents[:-1]) == 0
    nonzero = float(numbers[-1]) != 0
    shorter = decimals[-1] < decimals[:-1].max() or exponents[-1] < exponents[:-1].max()
    if (
        ((uniform or (len(numbers) > _MANY and nonzero)) and decimals[-1] < decimals[:-1].min())
        or (exponents[-1] == 0 and len(exponents_before) == len(numbers) - 1)
        or (exponents[-1] > 0 and len(exponents_before) and exponents[-1] < exponents_before.min())
        or (not ended and not nonzero and shorter and numbers[-1] not in numbers[:-1])
    ):
        message = f"{numbers[-1]} must have the digits of the values ahead of it: the file is cut"
        raise MisreadError(rows[-1].line, message)
    codes = digits @ np.array([10**6, 10**3, 1])  # three numbers, of at most 100 each, as one
    forms, form, times = np.unique(codes, return_inverse=True, return_counts=True)
    if len(forms) > 1 and len(numbers) - times.max() <= len(numbers) // (10 * _MANY):
        index = int(np.argmax(form != np.argmax(times)))
        place = f"{numbers[index]} in line {line_of(rows, index)}"
        notes.append(f"{place} is printed with other digits than nearly all values: is it damaged?")


@lru_cache(1000)  # numbers have few shapes
def _digits(number: str) -> tuple[int, int, int]:
    """Numbers of digits before the decimal point, after it (-1 without one), in the exponent."""
    mantissa, _, exponent = number.lstrip("+-").partition("E")
    whole, point, decimals = mantissa.partition(".")
    places = len(decimals) if point else -1
    # Without an exponent the digits before the point vary in a file.
    return len(whole) if exponent else 0, places, len(exponent.lstrip("+-"))


def flatten(rows: list[ValueRow]) -> NDArray[np.float64]:
    """All numbers, one row after the other."""
    return np.array([float(number) for _, numbers in rows for number in numbers], dtype=np.float64)


def line_of(rows: list[ValueRow], sample: int) -> int:
    """The line that holds the sample of an index."""
    ends = np.cumsum([len(row.numbers) for row in rows])
    return rows[int(np.searchsorted(ends, sample, side="right"))].line
