"""A format of files as one entry of a table, and the components that are read by such an entry."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jaxpound.ground.formats.rows import ValueRow
from jaxpound.ground.formats.statements import Stated, Statement
from jaxpound.ground.formats.text import TextLine

_FIRST_LINES = 25  # of these one has the signature of a format
_VERTICAL = re.compile(
    r"(?:up|dwn|down|vrt|vert?(?:ical)?\.?|[uv]-?d)[0-9]?(?:[ ,(].*)?"
    r"|[uz][0-9]?(?: ?\(.*)?|(?:[vd]|[a-z]_?[a-z]_?z)[0-9]?",
    re.I,
)
_VERTICAL_FILE = re.compile(r".*(?:UP|DWN|VRT|VERT?|[-_.](?:[UVZ]|UD[12]?)|[BEHLS][HNLG]Z)", re.S)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Layout:
    """Where the files of a format state what a record needs, and where their values stand.

    All text fields but ``name`` and ``unit`` are patterns of lines, without regard to case. A
    format of blocks has a component behind the other, each with a header of its own; that of others
    ends ahead of the first row of numbers.
    """

    name: str
    signature: str  # how one of the first lines of a file begins
    component: str = ""  # in a line of the header; its groups are names of the components, in order
    unit: str = ""  # that of all files of the format; else the header states it
    state: Callable[[Sequence[TextLine], Stated], None] | None = None  # what no prose states
    behind: str = ""  # the line behind which rows begin
    history: bool = False  # rows of several values are one history, else a row of components
    begin: str = ""  # the first line of a block
    numbers: tuple[
        tuple[int, int, int], ...
    ] = ()  # rows, values a row, characters each: of a header
    title: str = ""  # the line ahead of the accelerations of a block
    form: tuple[int, int] | None = None  # values a row and characters of each, unless the title's
    pairs: tuple[int, int] | None = None  # the form of pairs of time and acceleration, untitled
    integrals: bool = False  # velocities and displacements follow the accelerations

    def fits(self, lines: Sequence[TextLine]) -> bool:
        """Whether one of the first lines has the signature."""
        signature = re.compile(self.signature, re.I)
        return any(signature.match(line.text) for line in lines[:_FIRST_LINES])

    def components(self, header: Sequence[TextLine]) -> list[str]:
        """Names of the components that a header states."""
        if not self.component:
            return []
        component = re.compile(self.component, re.I)
        matches = filter(None, (component.match(line.text) for line in header))
        return list(dict.fromkeys(name.strip() for match in matches for name in match.groups()))


class Channel(NamedTuple):
    """A component in a file: its names, what the header states, and its values as printed."""

    names: tuple[str, ...]
    stated: Stated
    rows: list[ValueRow]  # of accelerations only
    samples: NDArray[np.float64]  # in the unit of the file
    times: Statement | None = None  # the interval of its column of times

    @property
    def vertical(self) -> bool:
        """Whether its names say that it is vertical."""
        return any(map(is_vertical, self.names))


def is_vertical(name: str) -> bool:
    """Whether the name of a component says that it is vertical."""
    return _VERTICAL.fullmatch(name.strip(" .'\"")) is not None


def is_vertical_file(stem: str, extension: str) -> bool:
    """Whether the name of a file says that it is of a vertical component."""
    return bool(_VERTICAL_FILE.fullmatch(stem) or re.fullmatch(r"\.UD[12]?", extension, re.I))


def named(channels: Sequence[Channel]) -> Iterator[str]:
    """The columns or blocks of a file in words: ``1: N-S``."""
    for number, channel in enumerate(channels, 1):
        yield f"{number}: {' '.join(channel.names)}" if channel.names else f"{number}"
