"""Lines of spreadsheets and loggers in plain form: quotes, decimal commas, dates and times."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from decimal import Decimal
from itertools import islice

import numpy as np

from jaxpound.ground.formats.text import NUMBER, MisreadError, TextLine, shown

_LOOKED_AT = 200  # rows that decide whether a file has decimal commas
_SEPARATOR_LINE = re.compile(r"\W?sep=(.)\s*", re.I)
_QUOTED = re.compile(r'(?:^|[,;\t])\s*"')
_INSTANT = re.compile(
    r"\s*(?:((?:[0-9]{4}|[0-9]{1,2})[-/.][0-9]{1,2}[-/.](?:[0-9]{4}|[0-9]{1,2}))[ T,;\t]\s*)?"
    r"([0-9]{1,2}):([0-9]{2}):([0-9]{2}(?:[.,][0-9]{1,9})?)"
    r"(?:Z|[-+][0-9]{2}:?[0-9]{2})?(?=[\s,;]|$)"
)
_VALUES = re.compile(rf"(?:[\s,;]+{NUMBER})+[\s,;]*")
_OF_NUMBERS = re.compile(r"(?=[-+.,;eE \t]*+[0-9])[-+0-9.,;eE \t]++")
_WITH_COMMA = re.compile(r"[-+]?(?:[0-9]{1,3}(?:\.[0-9]{3})+|[0-9]*),[0-9]+(?:[eE][-+]?[0-9]+)?")
_THOUSANDS = r"[-+]?[0-9]{1,3}(?:,[0-9]{3})+\.[0-9]*"
_QUOTED_THOUSANDS = re.compile(rf"\s*{_THOUSANDS}(?:[eE][-+]?[0-9]+)?\s*")
_GROUPED = re.compile(rf"(?<![^\s;]){_THOUSANDS}(?![^\s;])")
_CELL = re.compile(r"[^;\s]+")


def in_plain_form(lines: Sequence[TextLine]) -> list[TextLine]:
    """The lines with decimal points, without quotes and with times in s."""
    separator = _SEPARATOR_LINE.fullmatch(lines[0].text)
    lines = list(lines[1:] if separator else lines)
    if any(_QUOTED.search(line.text) for line in lines):
        lines = _without_quotes(lines, separator[1] if separator else None)
    lines = _with_seconds(list(map(_with_plain_signs, lines)))
    return list(map(_with_point, lines)) if _has_decimal_commas(lines) else lines


def _with_plain_signs(line: TextLine) -> TextLine:
    """A line with a plain minus, and without the thousands marks that separate no cells."""
    text = line.text
    if not text.isascii() or "'" in text:
        text = re.sub(r"(?<=[0-9])[\u00a0\u202f\u2009'’](?=[0-9]{3})", "", text.replace("−", "-"))
    if "," in text and (";" in text or "\t" in text):
        text = _GROUPED.sub(lambda x: x[0].replace(",", ""), text)
    return line if text == line.text else TextLine(line.number, text)


def _without_quotes(lines: list[TextLine], delimiter: str | None) -> list[TextLine]:
    """Lines with quoted cells as cells between tabs, or commas if these separated them."""
    if delimiter is None:
        bare = [re.sub(r'"[^"]*"', "", line.text) for line in lines if _QUOTED.search(line.text)]
        delimiter = next((x for x in ";\t," if any(x in text for text in bare)), ",")
    plain = []
    for line in lines:
        if _QUOTED.search(line.text):
            cells = next(csv.reader([line.text.strip()], delimiter=delimiter))
            cells = [x.replace(",", "") if _QUOTED_THOUSANDS.fullmatch(x) else x for x in cells]
            comma = delimiter == "," and not any("," in cell for cell in cells)
            line = TextLine(line.number, ("," if comma else "\t").join(cells))
        plain.append(line)
    return plain


def _with_seconds(lines: list[TextLine]) -> list[TextLine]:
    """Lines whose rows begin with a date and a time, with seconds from the first row instead."""
    first: Decimal | None = None
    days: list[str] = []
    plain = []
    for line in lines:
        instant = _INSTANT.match(line.text)
        if instant and (days or _VALUES.fullmatch(line.text, instant.end())):
            days += [instant[1]] if instant[1] not in days[-1:] else []
            hours, minutes, seconds = (Decimal(x.replace(",", ".")) for x in instant.groups()[1:])
            elapsed = 86400 * len(days) + 3600 * hours + 60 * minutes + seconds
            first = elapsed if first is None else first
            since_first, behind = f"{elapsed - first:f}", line.text[instant.end() :]
            if _are_with_commas(_CELL.findall(behind)):
                since_first = since_first.replace(".", ",")
            line = TextLine(line.number, since_first + behind)
        plain.append(line)
    return plain


def _has_decimal_commas(lines: list[TextLine]) -> bool:
    """Whether the commas of nearly all rows are those of decimals."""
    if not any("," in line.text for line in lines):
        return False
    rows = list(islice((x for x in lines if _OF_NUMBERS.fullmatch(x.text)), _LOOKED_AT))
    cells = [_CELL.findall(line.text) for line in rows]
    if rows and all(len(row) == 1 for row in cells) and not _is_one_column(rows):
        return False
    return 0 < 0.9 * len(rows) <= sum(map(_are_with_commas, cells))


def _are_with_commas(cells: list[str]) -> bool:
    with_comma = [cell for cell in cells if "," in cell]
    return bool(with_comma) and all(map(_WITH_COMMA.fullmatch, with_comma))


def _with_point(line: TextLine) -> TextLine:
    has_others = "," in line.text and not _are_with_commas(_CELL.findall(line.text))
    if has_others or not _OF_NUMBERS.fullmatch(line.text):
        return line
    without_thousands = re.sub(r"(?<=[0-9])\.(?=[0-9]{3}(?![0-9]))", "", line.text)
    return TextLine(line.number, without_thousands.replace(",", "."))


def _is_one_column(rows: list[TextLine]) -> bool:
    """Whether the only commas of rows are decimal ones, and do not separate columns."""
    fields = [line.text.strip().split(",") for line in rows]
    width = len(fields[0])
    if any("." in line.text for line in rows) or any(len(row) != width for row in fields):
        return False
    columns = list(zip(*fields, strict=True))
    equal = all(len(set(map(len, column))) == 1 for column in columns[1::2])
    if width == 2 and len(rows) > 1:
        steps = np.diff([float(whole or "0") for whole in columns[0]])
        return equal and not (steps[0] and np.allclose(steps, steps[0]))
    zeros = any(x[:1] == "0" and len(x) > 1 for column in columns[1::2] for x in column)
    if width % 2 == 0 and equal and zeros:
        seem = f"{shown(rows[0].text)}: commas seem to separate columns and to mark decimals"
        rule = "export it with semicolons or tabs, or with decimal points"
        raise MisreadError(rows[0].number, f"{seem}: {rule}")
    return False
