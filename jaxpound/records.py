"""Recorded accelerograms from text files: PEER AT2, time-acceleration columns, plain values."""

from __future__ import annotations

import math
import os
import re
from decimal import Decimal
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jaxpound.ground import Record

_GRAVITY = 9.80665
_UNITS = {  # in m/s2
    "g": _GRAVITY,
    "m/s2": 1.0,
    "cm/s2": 0.01,
    "gal": 0.01,
    "ft/s2": 0.3048,
    "in/s2": 0.0254,
}
_FLOAT = r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[ED][-+]?[0-9]+)?"
_NUMBER = re.compile(_FLOAT, re.I)
_NOT_FINITE = re.compile(r"[-+]?(?:nan|inf(?:inity)?|[0-9]\.#\w+)", re.I)
_SIGN_AFTER_NUMBER = re.compile(r"(?<=[0-9.])(?=[-+])")
_SEPARATOR = re.compile(r"\s*[,;]\s*|\s+")
_NPTS = re.compile(r"\bNPTS\b", re.I)
_NPTS_AND_DT = (
    re.compile(
        rf"\bNPTS\s*[=:]?\s*({_FLOAT})(?![\w.]).*?\bDT\s*[=:]?\s*({_FLOAT})(?=[\s,;s]|$)", re.I
    ),
    re.compile(rf"^({_FLOAT})[\s,]+({_FLOAT})[\s,]+NPTS\b", re.I),
)
_END_OF_DATA = re.compile(r"\*+\s*end\b", re.I)
_OTHER_HISTORY = re.compile(
    r"^(?!.*\b(?:acc|peak|max)).*\b(vel|velocity|disp|displacement)\b"
    r"\s*(?:time\b|history|series|in\b|[(\[]|$)",
    re.I,
)
_STATED_UNIT = re.compile(
    r"(?:\bunits?(?:\s+(?:of|are|is|in))?|\bacc[a-z]*(?:\s+in|_)?|\bag?(?=\s*[(\[]))"
    r"\s*[:=]?\s*[(\[]?\s*"
    r"(?:(cm|m|ft|in)/s(?:ec)?(?:/s(?:ec)?|\^?2|\*\*2|²)|(gal)s?|(g))(?![\w/^*])",
    re.I,
)


class _Line(NamedTuple):
    where: str  # "path:number", the start of every message about the line
    text: str


class _Row(NamedTuple):
    where: str
    numbers: list[str]  # as printed, but for Fortran's D exponents


def read_record(
    path: str | os.PathLike[str], *, dt: float | None = None, units: str = "g"
) -> Record:
    """Read a recorded accelerogram from a text file.

    Its layout is told by its content, not by its extension:

    - PEER AT2: a header with a line such as ``NPTS=  4000, DT= .01000 SEC`` or
      ``7997 0.0050 NPTS, DT``, then the values, any number a row, also stuck together by a sign
      (``.12E-02-.31E-02``).
    - Two columns, time (s) and acceleration, between commas, semicolons, tabs or blanks. The time
      step must be uniform within the rounding of the printed times; where that rounding could hide
      a lost sample, it must be uniform as printed. The record starts at the first sample: a first
      time other than zero is dropped.
    - Values without times, one or at least three a row, with ``dt`` given.

    Text ahead of the first row is a header; blank lines and those that start with ``#``, ``%`` or
    ``//`` are skipped. Files are read as UTF-8 or else as Latin-1.

    Parameters
    ----------
    path
        The file.
    dt
        Time step > 0, in seconds, for a file that states none; else it must agree to 1e-6.
    units
        What the file's acceleration is in: "g", "m/s2", "cm/s2", "gal", "ft/s2" or "in/s2".

    Returns
    -------
    Record
        Samples in g (float64, standard gravity 9.80665 m/s²), dt in seconds, named as the file.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If an argument breaks its rule, or the file is a directory, binary, empty or without data;
        holds anything but finite numbers, rows of unequal length or non-uniform times; states no
        time step, or another dt or other units than given; says that it is a velocity or
        displacement history; states no positive NPTS and DT; or holds fewer or more values than
        NPTS. More are not cut off: PEER's files have none, so a surplus means a damaged file.

    Examples
    --------
    ``read_record("quake.at2")`` reads a file such as::

        PEER STRONG MOTION DATABASE RECORD
        SOME EARTHQUAKE 01/02/03, SOME STATION, 180
        ACCELERATION TIME HISTORY IN UNITS OF G
        NPTS=  7, DT= .01000 SEC
          -.6403182E-02  -.6028715E-02   .5304162E-03   .7743260E-02   .6890377E-02
           .6876502E-02   .6705057E-02
    """
    if units not in _UNITS:
        raise ValueError(f"read_record: units = {units!r} must be one of {', '.join(_UNITS)}")
    if dt is not None and not 0 < dt < math.inf:
        raise ValueError(f"read_record: dt = {dt!r} must be positive and finite")
    file = Path(path)
    lines = _read_lines(file)
    npts_at = next((i for i, line in enumerate(lines) if _is_npts_line(line.text)), None)
    start = _first_row(lines, 0 if npts_at is None else npts_at + 1)
    _check_header(lines[:start], units)
    rows = _parse_rows(lines[start:])
    if npts_at is not None:
        samples, file_dt = _read_at2(lines[npts_at], rows)
    elif not rows:
        raise ValueError(f"{file}: no data: it must hold rows of numbers")
    elif len(rows[0].numbers) == 2:
        samples, file_dt = _read_two_columns(rows)
    else:
        samples, file_dt = _read_values(rows, dt)
    if dt is not None and not math.isclose(dt, file_dt, rel_tol=1e-6):
        raise ValueError(f"{file}: dt = {dt!r} must agree with the file's own, {file_dt!r}")
    if len(samples) < 2:
        raise ValueError(f"{file}: a record must have at least two samples, this has one")
    return Record(samples * (_UNITS[units] / _GRAVITY), file_dt, name=file.stem)


def _read_lines(file: Path) -> list[_Line]:
    if file.is_dir():
        raise ValueError(f"{file}: must be a file, not a directory")
    try:
        data = file.read_bytes()
    except FileNotFoundError:
        raise FileNotFoundError(f"{file}: no such file") from None
    data = data.rstrip(b"\x1a")  # the end-of-file mark of DOS
    if re.search(rb"[\x00-\x08\x0e-\x1f]", data):
        raise ValueError(f"{file}: must be plain text, not a binary or UTF-16 file")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    if not text.strip():
        raise ValueError(f"{file}: is empty: it must hold rows of numbers")
    # Some PEER files end their lines in CR CR LF, which str.splitlines counts as two.
    return [
        _Line(f"{file}:{number}", line.strip().rstrip(",; \t"))
        for number, line in enumerate(re.split(r"\r*\n|\r", text), start=1)
    ]


def _is_skipped(text: str) -> bool:
    return not text or text.startswith(("#", "%", "//"))


def _is_npts_line(text: str) -> bool:
    return not _is_skipped(text) and _NPTS.search(text) is not None


def _first_row(lines: list[_Line], begin: int) -> int:
    for index in range(begin, len(lines)):
        text = lines[index].text
        if not (_is_skipped(text) or _is_header_text(text)):
            return index
    return len(lines)


def _is_header_text(text: str) -> bool:
    """Whether a line is mostly words; one bad token alone is for the row's reader to report."""
    tokens = _SEPARATOR.split(text)
    numeric = [bool(_numbers(token) or _NOT_FINITE.fullmatch(token)) for token in tokens]
    return (tokens[0][:1].isalpha() and not numeric[0]) or 2 * sum(numeric) < len(tokens)


def _check_header(header: list[_Line], units: str) -> None:
    for where, text in header:
        if other := _OTHER_HISTORY.search(text):
            raise ValueError(
                f"{where}: must be an acceleration history, but the header says {other[1].lower()}"
            )
        if stated := _STATED_UNIT.search(text):
            length, gal, _ = stated.groups()
            unit = f"{length.lower()}/s2" if length else "gal" if gal else "g"
            if _UNITS[unit] != _UNITS[units]:
                raise ValueError(f"{where}: units = {units!r} must be the header's own, {unit!r}")


def _parse_rows(lines: list[_Line]) -> list[_Row]:
    rows = []
    for line in lines:
        if _END_OF_DATA.match(line.text):
            break
        if not _is_skipped(line.text):
            rows.append(_parse_row(line))
    return rows


def _parse_row(line: _Line) -> _Row:
    row = _Row(line.where, [])
    for token in _SEPARATOR.split(line.text):
        numbers = _numbers(token)
        if not numbers or not all(math.isfinite(float(number)) for number in numbers):
            raise ValueError(f"{line.where}: {token!r} must be a finite number")
        row.numbers.extend(numbers)
    if len({separator.strip() for separator in _SEPARATOR.findall(line.text)}) > 1:
        raise ValueError(f"{line.where}: must have one kind of separator, and no decimal commas")
    return row


def _numbers(token: str) -> list[str]:
    """Take apart the numbers of a token, none if it is not numeric."""
    parts = _SIGN_AFTER_NUMBER.split(token)
    # Numbers stuck together need their decimal points: 1940-05-18 is a date.
    if len(parts) > 1 and not all("." in part for part in parts):
        return []
    numeric = all(_NUMBER.fullmatch(part) for part in parts)
    return [part.upper().replace("D", "E") for part in parts] if numeric else []


def _read_at2(npts_line: _Line, rows: list[_Row]) -> tuple[NDArray[np.float64], float]:
    where, text = npts_line
    match = next((m for form in _NPTS_AND_DT if (m := form.search(text))), None)
    if match is None:
        raise ValueError(f"{where}: {text!r} must state numbers for NPTS and DT")
    npts, dt = (float(_numbers(number)[0]) for number in match.groups())
    if not (npts > 0 and npts.is_integer()):
        raise ValueError(f"{where}: NPTS = {match[1]} must be a positive whole number")
    if not 0 < dt < math.inf:
        raise ValueError(f"{where}: DT = {match[2]} must be positive and finite")
    samples = _flatten(rows)
    if len(samples) != npts:
        fault = "no data" if not rows else "truncated" if len(samples) < npts else "surplus values"
        raise ValueError(
            f"{where}: {fault}: NPTS = {npts:.0f} must be the number of values, {len(samples)}"
        )
    return samples, dt


def _read_values(rows: list[_Row], dt: float | None) -> tuple[NDArray[np.float64], float]:
    where, first = rows[0]
    width = len(first)
    if dt is None:
        raise ValueError(
            f"{where}: {width} value(s) a row and no times: pass dt, the time step in s"
        )
    full = rows[:-1] if len(rows[-1].numbers) < width else rows
    _check_widths(full, width)
    steps = np.diff([float(row.numbers[0]) for row in full])
    if len(steps) > 1 and np.allclose(steps, dt, rtol=1e-3, atol=0) and width > 1:
        raise ValueError(f"{where}: times must come with one column of values, not {width - 1}")
    return _flatten(rows), float(dt)


def _read_two_columns(rows: list[_Row]) -> tuple[NDArray[np.float64], float]:
    _check_widths(rows, 2)
    if len(rows) < 2:
        raise ValueError(f"{rows[0].where}: a record must have at least two samples, this has one")
    times, samples = _flatten(rows).reshape(-1, 2).T
    dt = (times[-1] - times[0]) / (len(times) - 1)
    rounding = _print_rounding([row.numbers[0] for row in rows])
    slack = rounding + max(rounding[0], rounding[-1])
    if slack.max() > 0.4 * dt:  # a lost sample shows as dt / 2
        slack = np.zeros_like(slack)
    off = np.abs(times - times[0] - dt * np.arange(len(times)))
    # 1e-5: times summed up step by step in floating point, printed with all their digits.
    if not (dt > 0 and np.all(off <= slack + 1e-5 * dt)):
        steps = np.diff(times)
        usual = np.median(steps)
        worst = int(np.argmax(np.abs(steps - usual)))
        raise ValueError(
            f"{rows[worst + 1].where}: time step = {steps[worst]:.6g} must be uniform and positive "
            f"within the rounding of the printed times; the usual one is {usual:.6g}"
        )
    return samples, float(f"{dt:.12g}")  # 0.02, not 0.019999999999999997


def _print_rounding(numbers: list[str]) -> NDArray[np.float64]:
    """Half a unit in the last printed place of each number.

    Trailing zeros may be missing (0.1 among 0.08 and 0.12): the longest number tells the places.
    """
    decimals = [Decimal(number) for number in numbers]
    last_place = min(int(d.as_tuple().exponent) for d in decimals)
    digits = max(len(d.as_tuple().digits) for d in decimals)
    places = [max(last_place, d.adjusted() - digits + 1) for d in decimals]
    return 0.5 * 10.0 ** np.array(places, dtype=np.float64)


def _check_widths(rows: list[_Row], width: int) -> None:
    for where, numbers in rows:
        if len(numbers) != width:
            raise ValueError(f"{where}: a row of {len(numbers)} value(s) must have {width}")


def _flatten(rows: list[_Row]) -> NDArray[np.float64]:
    return np.array([float(number) for _, numbers in rows for number in numbers], dtype=np.float64)
