"""What objects print: tables as text, HTML and Markdown, and representations of dataclasses."""

from __future__ import annotations

import dataclasses
import re
import reprlib
from collections.abc import Callable, Sequence
from html import escape
from typing import Any, NamedTuple

import numpy as np

_NUMBER = re.compile(r"[-+]?(\d[\d,]*(\.\d+)?(e[-+]?\d+)?|inf|nan)( %)?|-")
_BAR = r"\|"

Cell = str | int | float


class TextTable(NamedTuple):
    """A title, rows of cells below the names of their columns, and notes below them.

    The first cell of a row is its name. Cells that are numbers are rounded; a column of numbers
    alone is aligned to the right.
    """

    title: str
    columns: Sequence[str] = ()
    rows: Sequence[Sequence[Cell]] = ()
    notes: Sequence[str] = ()
    digits: int = 5
    """Significant digits of a number that is not whole."""

    @classmethod
    def of(cls, columns: Sequence[str], rows: Sequence[Sequence[str | float | None]]) -> TextTable:
        """A table without a title, its numbers rounded to four digits; a dash for None."""
        for row in rows:
            if len(row) != len(columns):
                raise ValueError(f"table: the cells of a row, {row}, must be {', '.join(columns)}")
        return cls("", columns, [[rounded(x) for x in row] for row in rows])

    def text(self) -> str:
        """The table for a terminal."""
        if (cells := self._cells()) and any(self.columns):
            cells.insert(0, list(self.columns))
        width = [max(map(len, column)) for column in zip(*cells, strict=True)]
        aligned = zip(self._right(), width, strict=True)
        sides = [f"{'>' if right else '<'}{w}" for right, w in aligned]
        lines = ["  ".join(map(format, row, sides)) for row in cells]
        below = "    " if self.title else ""
        title = [self.title] if self.title else []
        return "\n".join([*title, *(f"{below}{x}".rstrip() for x in (*lines, *self.notes))])

    def markdown(self) -> str:
        """The table for a page, without title and notes: these belong to the page's text."""
        lines = [self.columns, ["---"] * len(self.columns), *self._cells()]
        return "\n".join(f"| {' | '.join(x.replace('|', _BAR) for x in line)} |" for line in lines)

    def html(self) -> str:
        """The table for a notebook, whose own style gives it its colours."""
        right = self._right()
        tags = [("th", "row"), *[("td", "")] * (len(right) - 1)]
        rows = [_html_row(row, right, tags) for row in self._cells()]
        head = ""
        if rows and any(self.columns):
            head = f"<thead>{_html_row(self.columns, right, [('th', 'col')] * len(right))}</thead>"
        parts = [f"<table>{head}<tbody>{''.join(rows)}</tbody></table>"] if rows else []
        title, *notes = (f"<div>{escape(x)}</div>" for x in (self.title, *self.notes))
        return f"<div>{''.join([title if self.title else '', *parts, *notes])}</div>"

    def _cells(self) -> list[list[str]]:
        return [[_cell_text(cell, self.digits) for cell in row] for row in self.rows]

    def _right(self) -> list[bool]:
        """Whether each column is aligned to the right."""
        columns = zip(*self._cells(), strict=True)
        return [any(x) and all(_NUMBER.fullmatch(cell) for cell in x if cell) for x in columns]


class Shown:
    """A base class that prints the same tables in a terminal and in a notebook."""

    def _tables(self) -> Sequence[TextTable]:
        raise NotImplementedError

    def __repr__(self) -> str:
        return "\n".join(table.text() for table in self._tables())

    def _repr_html_(self) -> str:
        return "".join(table.html() for table in self._tables())


def rounded(x: str | float | None) -> str:
    """A number to four digits, with separators where it is large; a dash for none."""
    if x is None:
        return "-"
    if isinstance(x, str):
        return x
    return f"{float(f'{x:.4g}'):,.0f}" if 1e4 <= abs(x) < 1e10 else f"{x:z.4g}"


def _cell_text(cell: Cell, digits: int) -> str:
    if isinstance(cell, str):
        return cell
    return f"{cell:,}" if isinstance(cell, int) else f"{cell:z.{digits}g}"


def _html_row(row: Sequence[str], right: Sequence[bool], tags: Sequence[tuple[str, str]]) -> str:
    """A row of cells, each with its tag and scope."""
    cells = []
    for words, at_right, (tag, scope) in zip(row, right, tags, strict=True):
        of, side = f' scope="{scope}"' if scope else "", "right" if at_right else "left"
        cells.append(f'<{tag}{of} style="text-align: {side}">{escape(words)}</{tag}>')
    return f"<tr>{''.join(cells)}</tr>"


_LONGEST = 800  # characters of a dataclass's representation: about ten lines of a terminal


def dataclass_repr(obj: Any) -> str:
    """``__repr__`` of a dataclass, without tuples that are empty by default.

    A long one leaves out entries of tuples and digits.
    """
    text = _repr_by(_in_full, obj)
    return text if len(text) <= _LONGEST else _in_short(obj)


def _repr_by(show: Callable[[Any], str], obj: Any) -> str:
    fields = [(x, getattr(obj, x.name)) for x in dataclasses.fields(obj)]
    values = (
        f"{x.name}={show(y)}"
        for x, y in fields
        if not (isinstance(y, tuple) and not y and x.default == ())
    )
    return f"{type(obj).__qualname__}({', '.join(values)})"


def _in_full(value: Any) -> str:
    """``repr`` of a value, where NumPy's numbers are written as Python's are."""
    if type(value) is tuple:
        return f"({', '.join(map(_in_full, value))}{',' if len(value) == 1 else ''})"
    return str(value) if isinstance(value, np.number) else repr(value)


def _in_short(value: Any) -> str:
    """A value with the first and last entries of its tuples, and six digits of its numbers."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return _repr_by(_in_short, value)
    if isinstance(value, tuple) and value:
        first, *others = map(_in_short, (value[0], *value[1:][-1:]))
        between = [f"<{len(value) - 2} more>"] if len(value) > 2 else []
        return f"({', '.join([first, *between, *others])}{'' if others else ','})"
    return f"{float(value):.6g}" if isinstance(value, float | np.floating) else reprlib.repr(value)
