"""Tables for people: the same rows as text, as HTML for notebooks, as Markdown for pages."""

from __future__ import annotations

import re
from collections.abc import Sequence
from html import escape
from typing import NamedTuple

_NUMBER = re.compile(r"[-+]?(\d[\d,]*(\.\d+)?(e[-+]?\d+)?|inf|nan)( %)?|-")

_BAR = r"\|"

Cell = str | int | float


class Table(NamedTuple):
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
    def of(cls, columns: Sequence[str], rows: Sequence[Sequence[str | float | None]]) -> Table:
        """A table without a title, its numbers rounded to four digits; a dash for None.

        Raises
        ------
        ValueError
            If a row has more or fewer cells than there are columns.
        """
        for row in rows:
            if len(row) != len(columns):
                raise ValueError(f"table: the cells of a row, {row}, must be {', '.join(columns)}")
        return cls("", columns, [[rounded(x) for x in row] for row in rows])

    def text(self) -> str:
        """The table for a terminal."""
        cells = self._cells()
        if cells and any(self.columns):
            cells.insert(0, list(self.columns))
        width = [max(map(len, column)) for column in zip(*cells, strict=True)]
        right = self._right()
        lines = [
            "  ".join(
                cell.rjust(w) if at_right else cell.ljust(w)
                for cell, w, at_right in zip(row, width, right, strict=True)
            )
            for row in cells
        ]
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
        parts = [f"<div>{escape(self.title)}</div>"] if self.title else []
        rows = []
        if self.rows and any(self.columns):
            names = [_cell("th", x, r, "col") for x, r in zip(self.columns, right, strict=True)]
            rows.append(f"<thead><tr>{''.join(names)}</tr></thead>")
        body = []
        for name, *others in self._cells():
            cells = [_cell("td", x, r) for x, r in zip(others, right[1:], strict=True)]
            body.append(f"<tr>{_cell('th', name, right[0], 'row')}{''.join(cells)}</tr>")
        if body:
            rows.append(f"<tbody>{''.join(body)}</tbody>")
            parts.append(f"<table>{''.join(rows)}</table>")
        parts += [f"<div>{escape(note)}</div>" for note in self.notes]
        return f"<div>{''.join(parts)}</div>"

    def _cells(self) -> list[list[str]]:
        return [[_shown(cell, self.digits) for cell in row] for row in self.rows]

    def _right(self) -> list[bool]:
        """Whether each column is aligned to the right."""
        columns = list(zip(*self._cells(), strict=True))
        return [
            any(column) and all(_NUMBER.fullmatch(cell) for cell in column if cell)
            for column in columns
        ]


class Shown:
    """A base class that prints the same tables in a terminal and in a notebook."""

    def _tables(self) -> Sequence[Table]:
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
    return f"{float(f'{x:.4g}'):,.0f}" if 1e4 <= abs(x) < 1e10 else f"{x:.4g}"


def _shown(cell: Cell, digits: int) -> str:
    if isinstance(cell, str):
        return cell
    return f"{cell:,}" if isinstance(cell, int) else f"{cell:.{digits}g}"


def _cell(tag: str, words: str, at_right: bool, scope: str = "") -> str:
    of = f' scope="{scope}"' if scope else ""
    side = "right" if at_right else "left"
    return f'<{tag}{of} style="text-align: {side}">{escape(words)}</{tag}>'
