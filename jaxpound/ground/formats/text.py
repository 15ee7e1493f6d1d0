"""A file as lines of text, and the error that names one of them."""

from __future__ import annotations

import codecs
import io
import re
import unicodedata
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

NUMBER = r"[-+]?(?:[0-9]++(?:\.[0-9]*+)?+|\.[0-9]++)(?:[EeDd][-+]?[0-9]{1,4}+(?![0-9]))?+"
"""A pattern of a decimal number, also with Fortran's D for its exponent, of at most four digits."""


class MisreadError(ValueError):
    """An error in a file, or in one of its lines."""

    def __init__(self, line: int | None, message: str, place: str = "") -> None:
        super().__init__(place + message)
        self.line, self.message = line, message


class OtherKindError(MisreadError):
    """A file that holds something else than horizontal acceleration: suites leave it out."""


class TextLine(NamedTuple):
    """A line that is not blank, and its number from 1."""

    number: int
    text: str


class TextFile(NamedTuple):
    """A file that has been read."""

    lines: list[TextLine]  # without the blank ones
    ended: bool  # whether the last line has its end


def set_of(words: str) -> frozenset[str]:
    """The words of a text, as a set."""
    return frozenset(words.split())


EXCEL_ERROR = re.compile(r"#(?:N/[AVD]|NV|YOK|¿?[^\W\d_a-z][^\W_a-z/]*[!?])")
_SAME_SIGN = str.maketrans({"−": "-", "∕": "/", "⁄": "/", "·": ".", "⋅": ".", "’": "'"})


def plain(text: str) -> str:
    """A line with single blanks between its words and simple signs: ² is 2."""
    return " ".join(unicodedata.normalize("NFKC", text).translate(_SAME_SIGN).split())


def shown(text: str) -> str:
    """A text as quoted in a message: only its beginning, if it is long."""
    return repr(text if len(text) <= 60 else text[:57] + "...")


def with_e(text: str) -> str:
    """A printed number, or several, with an E for the exponent."""
    return text.upper().replace("D", "E")


def to_float(number: str) -> float:
    """The value of a number as printed."""
    return float(with_e(number))


# The longest run, a million steps in two columns, and a header; more would fill the memory.
_MOST_LINES = 1_050_000
_MOST_NUMBERS = 2_100_000


def text_of(data: bytes) -> TextFile:
    """The lines of the bytes of a file: of text, not empty and not too many."""
    # Before the text is split: a number begins behind a separator, or with its sign behind a digit
    # or point of another one.
    n_lines = np.count_nonzero(_among(data[1:], b"\r\n") & ~_among(data[:-1], b"\r\n"))
    between = _among(data, b" \t\r\n,;")
    numbers = np.count_nonzero(between[:-1] & ~between[1:])
    numbers += np.count_nonzero(_among(data[:-1], b"0123456789.") & _among(data[1:], b"+-"))
    for name, n, limit in (("lines", n_lines, _MOST_LINES), ("numbers", numbers, _MOST_NUMBERS)):
        if n > limit:
            raise MisreadError(None, f"must have at most {limit:,} {name}, not {n:,}")
    data = data.removeprefix(codecs.BOM_UTF8).rstrip(b"\x1a")  # the end-of-file mark of DOS
    if re.search(rb"[\x00-\x08\x0e-\x1f]", data):
        raise MisreadError(None, "must be plain text, not a binary file")
    try:
        data.decode("utf-8")
        encoding = "utf-8"
    except UnicodeDecodeError:
        encoding = "latin-1"
    if not (lines := list(_lines(data, encoding))):
        raise MisreadError(None, "is empty: it must hold rows of numbers")
    return TextFile(lines, data.endswith((b"\n", b"\r")))


def _among(data: bytes, signs: bytes) -> NDArray[np.bool_]:
    """Whether each byte is one of the signs."""
    table = np.zeros(256, np.bool_)
    table[[*signs]] = True
    return table[np.frombuffer(data, np.uint8)]


def _lines(data: bytes, encoding: str) -> Iterator[TextLine]:
    """Lines that are not blank. Some PEER files end them in CR CR LF, which counts as one end."""
    lines = (x for chunk in io.BytesIO(data) for x in chunk.rstrip(b"\r\n").split(b"\r"))
    for number, line in enumerate(lines, 1):
        if line and trimmed(text := line.decode(encoding)):
            yield TextLine(number, text)


def trimmed(text: str) -> str:
    """A line without blanks around it and separators at its end."""
    return text.strip().rstrip(",; \t")


def is_comment(text: str) -> bool:
    """Whether a trimmed line is a comment, and no error of a spreadsheet such as #N/A or #REF!."""
    return text.startswith(("#", "%", "//")) and not EXCEL_ERROR.match(text)
