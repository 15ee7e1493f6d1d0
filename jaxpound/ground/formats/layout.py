"""A format of files as one entry of a table, and the components that are read by such an entry."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jaxpound.ground.formats.rows import ValueRow
from jaxpound.ground.formats.statements import Stated, Statement
from jaxpound.ground.formats.text import TextLine

_FIRST_LINES = 25  # of these one has the signature of a format


@dataclasses.dataclass(frozen=True, kw_only=True)
class Layout:
    """Where the files of a format state what a record needs, and where their values stand.

    ``signature``, ``component``, ``behind``, ``begin`` and ``title`` are patterns of the beginning
    of lines. In a format of blocks, which have a ``begin``, each component has its own header.
    """

    name: str
    signature: str = ""  # of one of the first lines of a file; by default that of a block
    component: str = ""  # of a line of the header; its groups are names of components, in order
    unit: str = ""  # that of all files of the format; else the header states it
    state: Callable[[Sequence[TextLine], Stated], None] | None = None  # what no prose states
    behind: str = ""  # of the line behind which rows begin
    history: bool = False  # rows of several values are one history, else a row of components
    begin: str = ""  # of the first line of a block
    numbers: tuple[tuple[int, int, int], ...] = ()  # of a header: rows, values a row, characters
    title: str = ""  # of the line ahead of the accelerations of a block
    form: tuple[int, int] | None = None  # values a row and characters of each, unless the title's
    pairs: tuple[int, int] | None = None  # the form of pairs of time and acceleration, untitled
    integrals: bool = False  # velocities and displacements follow the accelerations

    def matches(self, field: str, line: TextLine) -> re.Match[str] | None:
        """A match of the pattern of a field with a line."""
        return re.match(getattr(self, field), line.text, re.I)

    def fits(self, lines: Sequence[TextLine]) -> bool:
        """Whether one of the first lines has the signature."""
        field = "signature" if self.signature else "begin"
        return any(self.matches(field, line) for line in lines[:_FIRST_LINES])

    def components(self, header: Sequence[TextLine]) -> list[str]:
        """Names of the components that a header states."""
        matches = (self.matches("component", line) for line in header if self.component)
        names = (name for match in matches if match for name in match.groups() if name)
        return list(dict.fromkeys(map(str.strip, names)))


class Channel(NamedTuple):
    """A component in a file: its names, what the header states, and its values as printed."""

    names: tuple[str, ...]
    stated: Stated
    rows: list[ValueRow]  # of accelerations only
    samples: NDArray[np.float64]  # in the unit of the file
    times: Statement | None = None  # the interval of its column of times
