"""Lines of spreadsheets and loggers in plain form: quotes, decimal commas, dates and times.

Quoted cells are read by ``csv``, and dates by ``datetime``; behind this module a number has a
decimal point, and a time is in seconds.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from datetime import datetime
from itertools import islice

import numpy as np

from jaxpound.ground.formats.text import NUMBER, MisreadError, TextLine, shown

_LOOKED_AT = 200  # rows that decide whether a file has decimal commas
_SEPARATOR_LINE = re.compile(r"\W?sep=(.)\s*", re.I)
_QUOTED = re.compile(r'(?:^|[,;\t])\s*"')
_STAMP = re.compile(
    r"\s*([0-9]{4}[-/][0-9]{2}[-/][0-9]{2}|[0-9]{1,2}[-/.][0-9]{1,2}[-/.][0-9]{4})"
    r"[ T,;\t]\s*([0-9]{1,2}:[0-9]{2}:[0-9]{2}(?:[.,]([0-9]{1,9}))?)Z?(?=[\s,;]|$)"
)
_OF_NUMBERS = re.compile(r"[-+0-9.,;eE \t]*[0-9][-+0-9.,;eE \t]*")
_WITH_COMMA = re.compile(r"[-+]?(?:[0-9]{1,3}(?:\.[0-9]{3})+|[0-9]*),[0-9]+(?:[eE][-+]?[0-9]+)?")
_THOUSANDS = re.compile(r"[-+]?[0-9]{1,3}(?:,[0-9]{3})+\.[0-9]*(?:[eE][-+]?[0-9]+)?")
_CELLS = re.compile(r"[^;\s]+")


def in_plain_form(lines: Sequence[TextLine]) -> list[TextLine]:
    """The lines with decimal points, without quotes and with times in s."""
    separator = _SEPARATOR_LINE.fullmatch(lines[0].text)
    lines = list(lines[1:] if separator else lines)
    if any(_QUOTED.search(line.text) for line in lines):
        lines = _without_quotes(lines, separator[1] if separator else None)
    return _with_points(_with_times(lines))


def _without_quotes(lines: list[TextLine], delimiter: str | None) -> list[TextLine]:
    """Lines with quoted cells as cells between tabs, or with those of the other lines' separator."""
    if delimiter is None:
        bare = [re.sub(r'"[^"]*"', "", line.text) for line in lines if _QUOTED.search(line.text)]
        delimiter = next((x for x in ";\t," if any(x in text for text in bare)), ",")
    plain = []
    for line in lines:
        if not _QUOTED.search(line.text):
            plain.append(line)
            continue
        cells = next(csv.reader([line.text.strip()], delimiter=delimiter))
        cells = [x.replace(",", "") if _THOUSANDS.fullmatch(x.strip()) else x for x in cells]
        comma = delimiter == "," and not any("," in cell for cell in cells)
        plain.append(TextLine(line.number, ("," if comma else "\t").join(cells)))
    return plain


def _with_times(lines: list[TextLine]) -> list[TextLine]:
    """Lines whose rows begin with a date and a time, with seconds from the first row instead."""
    first, plain = None, []
    for line in lines:
        stamp = _STAMP.match(line.text)
        if not stamp or (first is None and not _is_row(line.text[stamp.end() :])):
            plain.append(line)
            continue
        places = min(len(stamp[3] or ""), 6)
        instant = _instant(line, stamp)
        first = instant if first is None else first
        seconds = f"{(instant - first).total_seconds():.{places}f}"
        plain.append(TextLine(line.number, seconds + line.text[stamp.end() :]))
    return plain


def _is_row(text: str) -> bool:
    return re.fullmatch(rf"(?:[\s,;]+{NUMBER})+[\s,;]*", text) is not None


def _instant(line: TextLine, stamp: re.Match[str]) -> datetime:
    day, time = re.sub("[/.]", "-", stamp[1]), stamp[2].replace(",", ".")
    time = re.sub(r"(\.[0-9]{6})[0-9]+", r"\1", time)
    try:
        if len(day.split("-")[0]) == 4:
            return datetime.fromisoformat(f"{day} {time.zfill(8)}")
        form = "%d-%m-%Y %H:%M:%S" + (".%f" if "." in time else "")
        return datetime.strptime(f"{day} {time}", form)
    except ValueError:
        rule = "must be a date and a time, as 2030-01-31 00:00:00.02"
        raise MisreadError(line.number, f"{shown(stamp[0].strip())} {rule}") from None


def _with_points(lines: list[TextLine]) -> list[TextLine]:
    """Lines of numbers with decimal points for commas, if the file has decimal commas."""
    rows = [line.text.strip() for line in islice(_number_lines(lines), _LOOKED_AT)]
    if not any("," in row for row in rows):
        return lines
    cells = [_CELLS.findall(row) for row in rows]
    if all(len(row) == 1 for row in cells) and not _is_one_column(lines, rows):
        return lines
    commas = [_has_decimal_commas(row) for row in cells]
    if sum(commas) < 0.9 * len(commas):
        return lines
    return [_with_point(line) for line in lines]


def _number_lines(lines: list[TextLine]) -> list[TextLine]:
    return [line for line in lines if _OF_NUMBERS.fullmatch(line.text)]


def _has_decimal_commas(cells: list[str]) -> bool:
    with_comma = [cell for cell in cells if "," in cell]
    return bool(with_comma) and all(map(_WITH_COMMA.fullmatch, with_comma))


def _with_point(line: TextLine) -> TextLine:
    text = line.text
    if not _OF_NUMBERS.fullmatch(text) or not _has_decimal_commas(_CELLS.findall(text)):
        return line
    return TextLine(line.number, _CELLS.sub(_cell_with_point, text))


def _cell_with_point(cell: re.Match[str]) -> str:
    return cell[0].replace(".", "").replace(",", ".") if "," in cell[0] else cell[0]


def _is_one_column(lines: list[TextLine], rows: list[str]) -> bool:
    """Whether commas between whole numbers are decimal ones, and do not separate columns."""
    fields = [row.split(",") for row in rows]
    if any("." in row for row in rows) or len({len(row) for row in fields}) > 1:
        return False
    if len(fields[0]) == 2 and len(rows) > 1:
        first = np.array([float(whole or "0") for whole, _ in fields])
        steps = np.diff(first)
        even = bool(steps[0]) and np.allclose(steps, steps[0])
        return not even and len({len(decimals) for _, decimals in fields}) == 1
    decimals = list(zip(*fields, strict=True))[1::2]
    equal = all(len(set(map(len, column))) == 1 for column in decimals)
    zeros = any(x[0] == "0" and len(x) > 1 for column in decimals for x in column)
    if len(fields[0]) % 2 == 0 and equal and zeros:
        rule = "they cannot do both: export it with semicolons or tabs, or with decimal points"
        number = _number_lines(lines)[0].number
        message = f"{shown(rows[0])}: commas seem to separate columns and to mark decimals"
        raise MisreadError(number, f"{message}: {rule}")
    return False
