"""Rows of printed numbers: how they are read and checked."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from decimal import Decimal
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jaxpound.ground.formats.header import require_acceleration, stated_units
from jaxpound.ground.formats.text import (
    NUMBER,
    Line,
    MisreadError,
    TextFile,
    is_comment,
    shown,
    tokens_of,
    trimmed,
)

_LONGEST_HEADER = 10_000  # lines, and characters in a line
_SLOWEST_STEP = 0.5  # in s: nothing above 1 Hz would be left of an earthquake
FEW, _MANY = 10, 100  # values that show a rule, and that exclude coincidence
_NUMBER = re.compile(NUMBER)
_NOT_FINITE = re.compile(r"[-+]?(?:nan|inf(?:inity)?|[0-9]\.#\w{1,9})", re.I)
_SIGN_AFTER_NUMBER = re.compile(r"(?<=[0-9.])(?=[-+])")
_LONGEST_NUMBER = 100
# What nearly all rows are: numbers apart, between blanks or between commas.
_PLAIN_ROW = re.compile(rf"{NUMBER}(?:(?:[ \t]++{NUMBER})*+|(?:[ \t]*+,[ \t]*+{NUMBER})*+)")
_SHAPE = str.maketrans("123456789", "000000000")  # the shape of a number: all digits are 0
_CODE = np.array([10**6, 10**3, 1])  # one number for three, of at most 100 each


class Row(NamedTuple):
    """The numbers of a line."""

    line: int
    numbers: list[str]  # as printed, but for Fortran's D exponents


class Block(NamedTuple):
    """The header and the rows of a file."""

    header: Sequence[Line]
    stated: dict[str, int]  # units, and the lines that state them
    first: str  # the line of the first row
    rows: list[Row]


class Values(NamedTuple):
    """The values of a file as read by its layout; ``rows`` hold the accelerations alone."""

    samples: NDArray[np.float64]
    dt: float
    rows: list[Row]
    stated: dict[str, int]  # as in ``Block``


class Format(NamedTuple):
    """A layout of files: whether a file's lines fit it, and how such a file is read.

    ``read`` takes the time step given by the user for files that state none, and a list to which it
    adds the warnings that the reader gives.
    """

    fits: Callable[[Sequence[Line]], bool]
    read: Callable[[TextFile, float | None, list[str]], Values]


def read_block(lines: Sequence[Line], begin: int, notes: list[str]) -> Block:
    """The header and the rows of a file whose rows begin at or after the line of an index.

    Raises
    ------
    MisreadError
        If the header is too long, is of another quantity than acceleration or states units that
        are not known, or a row holds anything but numbers.
    """
    start = _first_row(lines, begin)
    header = _header(lines, start)
    require_acceleration(header)
    stated = stated_units(header)
    first = lines[start].text if start < len(lines) else ""
    return Block(header, stated, first, parse_rows(lines[start:], notes))


def _first_row(lines: Sequence[Line], begin: int) -> int:
    for index in range(begin, len(lines)):
        text = trimmed(lines[index].text)
        if not (is_comment(text) or _is_header_text(text)):
            return index
    return len(lines)


def _header(lines: Sequence[Line], end: int) -> Sequence[Line]:
    for index, line in enumerate(lines[:end]):
        if max(index, len(line.text)) > _LONGEST_HEADER:
            rule = f"at most {_LONGEST_HEADER:,} lines of as many characters"
            raise MisreadError(line.number, f"the header must have {rule}")
    return lines[:end]


def _is_header_text(text: str) -> bool:
    """Whether a line is mostly words; one bad token alone is for the row's reader to report."""
    tokens = tokens_of(text)[:_MANY]
    numeric = [bool(_numbers(token) or _NOT_FINITE.fullmatch(token)) for token in tokens]
    return (tokens[0][:1].isalpha() and not numeric[0]) or 2 * sum(numeric) < len(tokens)


def _is_end_mark(text: str) -> bool:
    word = text.lstrip("*").lstrip()[:4].lower()
    return text.startswith("*") and word[:3] == "end" and not word[3:].isalnum()


def parse_rows(lines: Sequence[Line], notes: list[str]) -> list[Row]:
    """The rows of a block of data, up to a mark of its end, without comments.

    Raises
    ------
    MisreadError
        If a line holds anything but finite numbers, or several kinds of separators.
    """
    rows: list[Row] = []
    inside, told = None, False  # the line of a comment behind some row
    for index, (number, raw) in enumerate(lines):
        text = trimmed(raw)
        row = _plain_row(number, text)
        if row is None and _is_end_mark(text):
            after = _first_row(lines, index + 1)
            if after < len(lines):
                rest = f"data of line {lines[after].number} are not read"
                notes.append(f"behind the end mark of line {number} the {rest}")
            break
        if row is None and is_comment(text):
            inside = number if rows and inside is None else inside
            continue
        if inside is not None and not told:
            notes.append(f"data follow the comment of line {inside}: is that one a value, too?")
            told = True
        rows.append(row or _parse_row(number, text))
    return rows


def _plain_row(line: int, text: str) -> Row | None:
    """The row of a line that is nothing but finite numbers apart; None if it is another."""
    if len(text) > _LONGEST_NUMBER or not _PLAIN_ROW.fullmatch(text):
        return None
    numbers = text.upper().replace("D", "E").replace(",", " ").split()
    return None if any(map(math.isinf, map(float, numbers))) else Row(line, numbers)


def _parse_row(line: int, text: str) -> Row:
    row = Row(line, [])
    for token in tokens_of(text):
        numbers = _numbers(token)
        if not numbers or any(math.isinf(float(number)) for number in numbers):
            raise MisreadError(line, f"{shown(token)} must be a finite number")
        row.numbers.extend(numbers)
    cells = text.replace(";", ",").split(",")
    kinds = ("," in text) + (";" in text) + any(len(cell.split()) > 1 for cell in cells)
    if kinds > 1:
        raise MisreadError(line, "must have one kind of separator, and no decimal commas")
    return row


def _numbers(token: str) -> list[str]:
    """Take apart the numbers of a token, none if it is not numeric."""
    if _is_number(token):
        return [token.upper().replace("D", "E")]
    parts = _SIGN_AFTER_NUMBER.split(token)
    # Numbers stuck together need their decimal points: 1940-05-18 is a date.
    if not all("." in part and _is_number(part) for part in parts):
        return []
    return [part.upper().replace("D", "E") for part in parts]


def _is_number(text: str) -> bool:
    return len(text) <= _LONGEST_NUMBER and _NUMBER.fullmatch(text) is not None


def require_count(line: int, stated: str, wanted: int, found: int) -> None:
    """Refuse a file whose number of values is not the one stated in its header."""
    if found != wanted:
        fault = "truncated" if found < wanted else "surplus values"
        rule = f"must be the number of values, {found}"
        raise MisreadError(line, f"{fault if found else 'no data'}: {stated} {rule}")


def print_rounding(numbers: list[str]) -> NDArray[np.float64]:
    """Half a unit in the last printed place of each number.

    Trailing zeros may be missing (0.1 among 0.08 and 0.12): the longest number tells the places.
    """
    decimals = [Decimal(number) for number in numbers]
    last_place = min(int(d.as_tuple().exponent) for d in decimals)
    digits = max(len(d.as_tuple().digits) for d in decimals)
    places = [max(last_place, d.adjusted() - digits + 1) for d in decimals]
    return 0.5 * 10.0 ** np.array(places, dtype=np.float64)


def require_width(rows: list[Row], width: int) -> None:
    """Refuse a row of more or fewer values than others."""
    for line, numbers in rows:
        if len(numbers) != width:
            raise MisreadError(line, f"a row of {len(numbers)} value(s) must have {width}")


def check_print(values: Values, ended: bool, notes: list[str]) -> None:
    """Refuse or note signs of damage: digits of printed values, a last line without its end.

    Raises
    ------
    MisreadError
        If the last value has fewer digits than those ahead of it: the file is cut.
    """
    _check_digits(values.rows, ended, notes)
    peak = np.abs(values.samples)
    if len(peak) >= _MANY and not ended and peak[-1] > peak[:-1].max():
        notes.append("the last line has no end and its value is the largest: is the file cut?")
    if values.dt >= _SLOWEST_STEP and len(peak) >= FEW:
        notes.append(f"the time step is {values.dt:g} s: are the times in seconds?")


def _check_digits(rows: list[Row], ended: bool, notes: list[str]) -> None:
    """Refuse a file that is cut inside its last value, which then has fewer digits than others.

    A zero at the very end, such as -0 or 0.0, is what a cut may leave of any small value that has
    more digits, unless zeros are printed so elsewhere.
    A single value elsewhere with other digits than all others is noted: it may be damaged.
    """
    numbers = [number for row in rows for number in row.numbers]
    if len(numbers) <= FEW // 2:
        return
    digits = np.array([_digits(number.translate(_SHAPE)) for number in numbers])
    _, decimals, exponents = digits.T
    others = exponents[:-1][exponents[:-1] > 0]
    alike = np.ptp(decimals[:-1]) == np.ptp(exponents[:-1]) == 0
    nonzero = float(numbers[-1]) != 0
    shorter = decimals[-1] < decimals[:-1].max() or exponents[-1] < exponents[:-1].max()
    if (
        ((alike or (len(numbers) > _MANY and nonzero)) and decimals[-1] < decimals[:-1].min())
        or (exponents[-1] == 0 and len(others) == len(numbers) - 1)
        or (exponents[-1] > 0 and len(others) and exponents[-1] < others.min())
        or (not ended and not nonzero and shorter and numbers[-1] not in numbers[:-1])
    ):
        says = f"{numbers[-1]} must have the digits of the values ahead of it: the file is cut"
        raise MisreadError(rows[-1].line, says)
    codes = digits @ _CODE
    forms, form, times = np.unique(codes, return_inverse=True, return_counts=True)
    if len(forms) > 1 and len(numbers) - times.max() <= len(numbers) // (10 * _MANY):
        odd = int(np.argmax(form != np.argmax(times)))
        place = f"{numbers[odd]} in line {line_of(rows, odd)}"
        notes.append(f"{place} is printed with other digits than nearly all values: is it damaged?")


@lru_cache(1000)  # there are few shapes of numbers
def _digits(number: str) -> tuple[int, int, int]:
    """Numbers of digits before the decimal point, after it (-1 without one), in the exponent.

    Those before count only with an exponent: only then are they the same throughout a file.
    """
    mantissa, _, exponent = number.lstrip("+-").partition("E")
    whole, point, decimals = mantissa.partition(".")
    places = len(decimals) if point else -1
    return len(whole) if exponent else 0, places, len(exponent.lstrip("+-"))


def flatten(rows: list[Row]) -> NDArray[np.float64]:
    """All numbers, one row after the other."""
    return np.array([float(number) for _, numbers in rows for number in numbers], dtype=np.float64)


def line_of(rows: list[Row], sample: int) -> int:
    """The line that holds the sample of an index."""
    ends = np.cumsum([len(row.numbers) for row in rows])
    return rows[int(np.searchsorted(ends, sample, side="right"))].line
