"""Recorded accelerograms from text files: PEER AT2, K-NET, time-acceleration columns, values."""

from __future__ import annotations

import io
import math
import os
import re
import stat
import warnings
from collections.abc import Iterator, Sequence
from decimal import Decimal
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jaxpound.ground.headers import (
    NUMBER,
    SECONDS,
    UNITS,
    Line,
    MisreadError,
    acceleration_unit,
    names_columns,
    npts_and_dt,
    read_column_names,
    require_acceleration,
    shown,
    stated_units,
    states_npts,
    time_unit,
    to_float,
)
from jaxpound.ground.plausibility import PlausibilityWarning
from jaxpound.ground.record import Record
from jaxpound.quantities import RANGES, STANDARD_GRAVITY

_MOST_BYTES = 32_000_000  # a million steps, the longest run, in two columns
_LONGEST_HEADER = 10_000  # lines, and characters in a line
_MOST_PEAK = RANGES["pga"].high  # in g
_SLOWEST_STEP = 0.5  # in s: nothing above 1 Hz would be left of an earthquake
_FEW, _MANY = 10, 100  # values from which on something is taken for a rule, or for no accident
_NUMBER = re.compile(NUMBER)
_NOT_FINITE = re.compile(r"[-+]?(?:nan|inf(?:inity)?|[0-9]\.#\w{1,9})", re.I)
_SIGN_AFTER_NUMBER = re.compile(r"(?<=[0-9.])(?=[-+])")
_LONGEST_NUMBER = 100


class _Row(NamedTuple):
    line: int
    numbers: list[str]  # as printed, but for Fortran's D exponents


class _File(NamedTuple):
    lines: list[Line]  # without the blank ones
    ended: bool  # whether the last line has its end


class _Values(NamedTuple):
    """What a layout makes of the rows; ``rows`` hold the accelerations alone."""

    samples: NDArray[np.float64]
    dt: float
    rows: list[_Row]
    stated: dict[str, int]  # units, and the lines that state them


def read_record(
    path: str | os.PathLike[str], *, dt: float | None = None, units: str | None = None
) -> Record:
    """Read a recorded accelerogram from a text file.

    Its layout is told by its content, not by its extension:

    - PEER AT2: a header with a line such as ``NPTS=  4000, DT= .01000 SEC`` or
      ``7997 0.0050 NPTS, DT``, then the values, any number a row, also stuck together by a sign
      (``.12E-02-.31E-02``).
    - K-NET and KiK-net (NIED's ASCII format): 17 lines of header, then whole counts. The scale
      factor, the sampling frequency and the duration are the header's. The mean of all counts is
      the instrument's offset and is taken off, as it is from the maximum that the header states,
      with which the record must agree.
    - Two columns, time and acceleration, between commas, semicolons, tabs or blanks. The time
      step must be uniform within the rounding of the printed times; where that rounding could hide
      a lost sample, it must be uniform as printed. The record starts at the first sample: a first
      time other than zero is dropped.
    - Values without times, one or at least three a row, with ``dt`` given.

    Text ahead of the first row is a header; blank lines and those that start with ``#``, ``%`` or
    ``//`` are skipped. Files are read as UTF-8 or else as Latin-1. Units that a header states are
    understood as a whole (``UNITS OF CM/SEC/SEC``, ``acc [mg]``, ``acc_ms2``, ``time (ms)``,
    ``DT= 10 MSEC``) or refused by name (``G/10``, ``counts``).

    Parameters
    ----------
    path
        The file: a regular one of at most 32 MB, with a header of at most 10 000 lines.
    dt
        Time step > 0, in seconds, for a file that states none; else it must agree to 1e-6.
    units
        What the file's acceleration is in: "g", "m/s2", "cm/s2", "gal", "ft/s2", "in/s2", "mm/s2"
        or "mg" (a thousandth of g). If it is None, what the header states, or "g" where it states
        nothing; else the header must not state another.

    Returns
    -------
    Record
        Samples in g (float64, standard gravity 9.80665 m/s²), dt in seconds, named as the file.

    Warns
    -----
    PlausibilityWarning
        If data follow a comment inside the block of data, or a mark of its end; if rows of values
        look like columns side by side; if a value is printed otherwise than nearly all (of a
        thousand and more); if the time step is half a second or more; or if the last line has no
        end and its value is the largest.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If an argument breaks its rule, or the file is no regular file, too large, binary, empty or
        without data; holds anything but finite numbers, a sample above 20 g, rows of unequal
        length, non-uniform times, several columns of values, or times alone; states no time step,
        another dt or other units than given, units that are not known, or a scale that is not
        understood; says that it is a history of velocity or another quantity, or a spectrum;
        states no positive NPTS and DT; holds fewer or more values than it says (more are not cut
        off: a surplus means a damaged file); or ends inside its last value.

    Notes
    -----
    K-NET's format, and that its maximum is the one about the mean, are described by the National
    Research Institute for Earth Science and Disaster Resilience, Japan (www.kyoshin.bosai.go.jp).

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
    if units is not None and units not in UNITS:
        raise ValueError(f"read_record: units = {units!r} must be one of {', '.join(UNITS)}")
    if dt is not None and not 0 < dt < math.inf:
        raise ValueError(f"read_record: dt = {dt!r} must be positive and finite")
    file = Path(path)
    notes: list[str] = []
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # for what is refused right after
            read = _read(_read_file(file), dt, notes)
        samples = read.samples * (_factor(read.stated, units) / STANDARD_GRAVITY)
        if dt is not None and not math.isclose(dt, read.dt, rel_tol=1e-6):
            raise MisreadError(None, f"dt = {dt!r} must agree with the file's own, {read.dt!r}")
        if len(samples) < 2:
            raise MisreadError(None, "a record must have at least two samples, this has one")
    except MisreadError as error:
        raise ValueError(f"{_place(file, error.line)}: {error}") from None
    largest = int(np.argmax(np.abs(samples)))
    place = _place(file, _line_of(read.rows, largest))
    hint = "are the units right, or is a decimal point lost?"
    require_possible(place, "acceleration", samples[largest], hint)
    for note in notes:
        warnings.warn(f"{file}: {note}", PlausibilityWarning, stacklevel=2)
    return Record(samples, read.dt, name=file.stem)


def _factor(stated: dict[str, int], units: str | None) -> float:
    """The size of the file's units, in m/s2."""
    own = acceleration_unit(stated)
    if own and units is not None and UNITS[own] != UNITS[units]:
        raise MisreadError(stated[own], f"units = {units!r} must be the header's own, {own!r}")
    return UNITS[own or units or "g"]


def require_possible(place: str, name: str, peak: float, hint: str) -> None:
    """A ``ValueError`` for an acceleration, in g, that no earthquake comes near."""
    if not abs(peak) <= _MOST_PEAK:
        rule = f"at most {_MOST_PEAK:g} g: {hint}"
        raise ValueError(f"{place}: {name} = {peak:.4g} g must be {rule}")


def _place(file: Path, line: int | None) -> str:
    return str(file) if line is None else f"{file}:{line}"


# --- lines and numbers --------------------------------------------------------------------------


def _read_file(file: Path) -> _File:
    try:
        status = file.stat()
    except FileNotFoundError:
        raise FileNotFoundError(f"{file}: no such file") from None
    if not stat.S_ISREG(status.st_mode):
        kind = "directory" if stat.S_ISDIR(status.st_mode) else "device, pipe or socket"
        raise MisreadError(None, f"must be a file, not a {kind}")
    with file.open("rb") as opened:
        data = opened.read(_MOST_BYTES + 1)
    if len(data) > _MOST_BYTES:
        size = max(len(data), status.st_size) / 1e6
        rule = f"at most {_MOST_BYTES / 1e6:.0f} MB of text, not {size:.4g} MB"
        raise MisreadError(None, f"must have {rule}")
    data = data.removeprefix(b"\xef\xbb\xbf").rstrip(b"\x1a")  # the end-of-file mark of DOS
    if re.search(rb"[\x00-\x08\x0e-\x1f]", data):
        raise MisreadError(None, "must be plain text, not a binary or UTF-16 file")
    try:
        data.decode("utf-8")
        encoding = "utf-8"
    except UnicodeDecodeError:
        encoding = "latin-1"
    lines = list(_lines(data, encoding))
    if not lines:
        raise MisreadError(None, "is empty: it must hold rows of numbers")
    return _File(lines, data.endswith((b"\n", b"\r")))


def _lines(data: bytes, encoding: str) -> Iterator[Line]:
    """Lines that are not blank. Some PEER files end them in CR CR LF, which counts as one end."""
    number = 0
    for chunk in io.BytesIO(data):
        for line in chunk.rstrip(b"\r\n").split(b"\r"):
            number += 1
            if line and _trimmed(text := line.decode(encoding)):
                yield Line(number, text)


def _trimmed(text: str) -> str:
    return text.strip().rstrip(",; \t")


def _is_comment(text: str) -> bool:
    return text.startswith(("#", "%", "//"))


def _tokens(text: str) -> list[str]:
    """What stands between blanks, commas and semicolons; empty between two of the latter."""
    cells = text.replace(";", ",").split(",") if ";" in text or "," in text else [text]
    return [token for cell in cells for token in (cell.split() or [""])]


def _first_row(lines: Sequence[Line], begin: int) -> int:
    for index in range(begin, len(lines)):
        text = _trimmed(lines[index].text)
        if not (_is_comment(text) or _is_header_text(text)):
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
    tokens = _tokens(text)[:_MANY]
    numeric = [bool(_numbers(token) or _NOT_FINITE.fullmatch(token)) for token in tokens]
    return (tokens[0][:1].isalpha() and not numeric[0]) or 2 * sum(numeric) < len(tokens)


def _is_end_mark(text: str) -> bool:
    word = text.lstrip("*").lstrip()[:4].lower()
    return text.startswith("*") and word[:3] == "end" and not word[3:].isalnum()


def _parse_rows(lines: Sequence[Line], notes: list[str]) -> list[_Row]:
    rows: list[_Row] = []
    inside, told = None, False  # the line of a comment behind some row
    for index, (number, raw) in enumerate(lines):
        text = _trimmed(raw)
        if _is_end_mark(text):
            after = _first_row(lines, index + 1)
            if after < len(lines):
                rest = f"data of line {lines[after].number} are not read"
                notes.append(f"behind the end mark of line {number} the {rest}")
            break
        if _is_comment(text):
            inside = number if rows and inside is None else inside
            continue
        if inside is not None and not told:
            notes.append(f"data follow the comment of line {inside}: is that one a value, too?")
            told = True
        rows.append(_parse_row(number, text))
    return rows


def _parse_row(line: int, text: str) -> _Row:
    row = _Row(line, [])
    for token in _tokens(text):
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


# --- layouts ------------------------------------------------------------------------------------


def _read(file: _File, dt: float | None, notes: list[str]) -> _Values:
    lines = file.lines
    if any(_KNET.match(line.text) for line in lines[:_KNET_LINES]):
        return _read_knet(lines, notes)
    npts_at = next((i for i, line in enumerate(lines) if _is_npts(line)), None)
    start = _first_row(lines, 0 if npts_at is None else npts_at + 1)
    header = _header(lines, start)
    require_acceleration(header)
    stated = stated_units(header)
    rows = _parse_rows(lines[start:], notes)
    if npts_at is not None:
        samples, step = _read_at2(lines[npts_at], rows)
    elif not rows:
        raise MisreadError(None, "no data: it must hold rows of numbers")
    elif len(rows[0].numbers) == 2:
        read_column_names(header, stated)
        samples, step = _read_two_columns(rows)
        # 0.02, not 0.019999999999999997
        step = float(f"{step * SECONDS[time_unit(stated) or 's']:.12g}")
        rows = [_Row(row.line, row.numbers[1:]) for row in rows]
    else:
        samples, step = _read_values(header, rows, lines[start].text, dt, notes)
    _check_digits(rows, notes)
    peak = np.abs(samples)
    if len(samples) >= _MANY and not file.ended and peak[-1] > peak[:-1].max():
        notes.append("the last line has no end and its value is the largest: is the file cut?")
    if step >= _SLOWEST_STEP and len(samples) >= _FEW:
        notes.append(f"the time step is {step:g} s: are the times in seconds?")
    return _Values(samples, step, rows, stated)


def _is_npts(line: Line) -> bool:
    return states_npts(line.text) and not _is_comment(_trimmed(line.text))


def _read_at2(line: Line, rows: list[_Row]) -> tuple[NDArray[np.float64], float]:
    npts, dt = npts_and_dt(line)
    samples = _flatten(rows)
    _require_count(line.number, f"NPTS = {npts}", npts, len(samples))
    return samples, dt


def _require_count(line: int, stated: str, wanted: int, found: int) -> None:
    if found != wanted:
        fault = "truncated" if found < wanted else "surplus values"
        rule = f"must be the number of values, {found}"
        raise MisreadError(line, f"{fault if found else 'no data'}: {stated} {rule}")


def _read_values(
    header: Sequence[Line], rows: list[_Row], first: str, dt: float | None, notes: list[str]
) -> tuple[NDArray[np.float64], float]:
    width = len(rows[0].numbers)
    if dt is None:
        says = f"{width} value(s) a row and no times: pass dt, the time step in s"
        raise MisreadError(rows[0].line, says)
    full = rows[:-1] if len(rows[-1].numbers) < width else rows
    _require_width(full, width)
    if width > 1 and (names := names_columns(header, first, width)):
        says = f"the header names {width} columns: there must be one of accelerations, and of times"
        raise MisreadError(names, says)
    for k in range(width):
        if _rises_evenly([float(row.numbers[k]) for row in full], dt, alone=width == 1):
            if width == 1:
                what, rule = "the only column", "it must hold accelerations"
            else:
                what = f"column {k + 1}"
                rule = f"times must come with one column of values, not {width - 1}"
            says = f"{what} rises evenly from row to row, as times or an index do: {rule}"
            raise MisreadError(rows[0].line, says)
    table = _flatten(full).reshape(-1, width)
    if width > 1 and len(full) >= 2 * _FEW:
        along, down = (np.abs(np.diff(table, axis=axis)).mean() for axis in (1, 0))
        if along > 2 * down:
            seem = f"rows of {width} values seem to be columns side by side"
            notes.append(f"{seem}: they are read along the rows, as one history")
    samples = _flatten(rows)
    if len(samples) >= _FEW and len(samples) - samples[0] in {1, 2}:
        says = f"{rows[0].numbers[0]} must be a value, and not the number of those that follow"
        raise MisreadError(rows[0].line, says)
    return samples, float(dt)


def _rises_evenly(column: list[float], dt: float, *, alone: bool) -> bool:
    """Whether a column is one of times or an index; of many rows also if coarsely printed."""
    n = len(column)
    steps = np.diff(column)
    if n > 2 and any(np.allclose(steps, step, rtol=1e-3, atol=0) for step in (dt, 1000 * dt)):
        return True
    if n < (_FEW if alone else 4) or not column[-1] > column[0]:
        return False
    off = column - np.linspace(column[0], column[-1], n)
    return bool(np.abs(off).max() <= (2.1 if n >= 4 * _FEW else 0.01) * steps.mean())


def _read_two_columns(rows: list[_Row]) -> tuple[NDArray[np.float64], float]:
    _require_width(rows, 2)
    if len(rows) < 2:
        raise MisreadError(rows[0].line, "a record must have at least two samples, this has one")
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
        rule = "uniform and positive within the rounding of the printed times"
        says = f"time step = {steps[worst]:.6g} must be {rule}; the usual one is {usual:.6g}"
        raise MisreadError(rows[worst + 1].line, says)
    return samples, float(dt)


def _print_rounding(numbers: list[str]) -> NDArray[np.float64]:
    """Half a unit in the last printed place of each number.

    Trailing zeros may be missing (0.1 among 0.08 and 0.12): the longest number tells the places.
    """
    decimals = [Decimal(number) for number in numbers]
    last_place = min(int(d.as_tuple().exponent) for d in decimals)
    digits = max(len(d.as_tuple().digits) for d in decimals)
    places = [max(last_place, d.adjusted() - digits + 1) for d in decimals]
    return 0.5 * 10.0 ** np.array(places, dtype=np.float64)


def _require_width(rows: list[_Row], width: int) -> None:
    for line, numbers in rows:
        if len(numbers) != width:
            raise MisreadError(line, f"a row of {len(numbers)} value(s) must have {width}")


def _check_digits(rows: list[_Row], notes: list[str]) -> None:
    """Refuse a file that is cut inside its last value, which then has fewer digits than others.

    A value inside that alone has other digits than all others is noted: it may be damaged.
    """
    numbers = [number for row in rows for number in row.numbers]
    if len(numbers) <= _FEW // 2:
        return
    digits = np.array([_digits(number) for number in numbers])
    _, decimals, exponents = digits.T
    others = exponents[:-1][exponents[:-1] > 0]
    alike = np.ptp(decimals[:-1]) == np.ptp(exponents[:-1]) == 0
    nonzero = float(numbers[-1]) != 0
    if (
        ((alike or (len(numbers) > _MANY and nonzero)) and decimals[-1] < decimals[:-1].min())
        or (exponents[-1] == 0 and len(others) == len(numbers) - 1)
        or (exponents[-1] > 0 and len(others) and exponents[-1] < others.min())
    ):
        says = f"{numbers[-1]} must have the digits of the values ahead of it: the file is cut"
        raise MisreadError(rows[-1].line, says)
    forms, form, times = np.unique(digits, axis=0, return_inverse=True, return_counts=True)
    if len(forms) > 1 and len(numbers) - times.max() <= len(numbers) // (10 * _MANY):
        odd = int(np.argmax(form != np.argmax(times)))
        place = f"{numbers[odd]} in line {_line_of(rows, odd)}"
        notes.append(f"{place} is printed with other digits than nearly all values: is it damaged?")


def _digits(number: str) -> tuple[int, int, int]:
    """How many digits stand ahead of the decimal point, behind it (-1 without), in the exponent.

    Those ahead count only with an exponent, where they are the same throughout.
    """
    mantissa, _, exponent = number.lstrip("+-").partition("E")
    whole, point, decimals = mantissa.partition(".")
    places = len(decimals) if point else -1
    return len(whole) if exponent else 0, places, len(exponent.lstrip("+-"))


def _flatten(rows: list[_Row]) -> NDArray[np.float64]:
    return np.array([float(number) for _, numbers in rows for number in numbers], dtype=np.float64)


def _line_of(rows: list[_Row], sample: int) -> int:
    ends = np.cumsum([len(row.numbers) for row in rows])
    return rows[int(np.searchsorted(ends, sample, side="right"))].line


# --- K-NET --------------------------------------------------------------------------------------

_KNET_LINES = 20
_KNET = re.compile(r"Sampling Freq\(Hz\)|Scale Factor\s++[^\s(]++\(gal\)/")


def _read_knet(lines: Sequence[Line], notes: list[str]) -> _Values:
    end = next((i for i, x in enumerate(lines[:_KNET_LINES]) if x.text.startswith("Memo")), None)
    if end is None:
        raise MisreadError(None, "a K-NET header must end with its line 'Memo.'")
    header = lines[:end]
    _, _, (rate,) = _knet_field(header, "Sampling Freq(Hz)", rf"({NUMBER}) ?Hz", "100Hz")
    at_time, _, (duration,) = _knet_field(header, "Duration Time(s)", f"({NUMBER})", "108")
    form = rf"({NUMBER}) ?\(gal\) ?/ ?({NUMBER})"
    at_scale, _, (gal, per_counts) = _knet_field(header, "Scale Factor", form, "3920(gal)/6182761")
    at_peak, printed, (peak,) = _knet_field(header, "Max. Acc. (gal)", f"({NUMBER})", "48.060")
    rows = _parse_rows(lines[end + 1 :], notes)
    for line, numbers in rows:
        for number in numbers:
            if not number.lstrip("+-").isdigit():
                raise MisreadError(line, f"{number} must be a whole number of counts")
    counts = _flatten(rows)
    stated = f"{rate:g} Hz for {duration:g} s, {rate * duration:.12g},"
    _require_count(at_time, stated, round(rate * duration), len(counts))
    _require_aligned_end(rows, lines)
    samples = (counts - counts.mean()) * (gal / per_counts)
    found = float(np.abs(samples).max())
    if abs(found - peak) > float(_print_rounding([printed])[0]) + gal / per_counts:
        rule = f"that of the counts about their mean, {found:.6g}: the file is damaged"
        raise MisreadError(at_peak, f"Max. Acc. = {printed} gal must be {rule}")
    return _Values(samples, float(f"{1 / rate:.12g}"), rows, {"gal": at_scale})


def _knet_field(
    header: Sequence[Line], name: str, form: str, example: str
) -> tuple[int, str, list[float]]:
    """The line of a field, its text and its positive numbers."""
    for line, text in header:
        text = text.replace("Max Acc.", "Max. Acc.")  # as in NIED's own description
        if text.startswith(name):
            value = text[len(name) :].strip()
            match = re.fullmatch(form, value)
            numbers = [to_float(number) for number in match.groups()] if match else []
            if not numbers or not all(0 < number < 1e12 for number in numbers):
                rule = f"must be positive, as in {example}"
                raise MisreadError(line, f"{name} = {shown(value)} {rule}")
            return line, value, numbers
    raise MisreadError(None, f"a K-NET header must state {name}")


def _require_aligned_end(rows: list[_Row], lines: Sequence[Line]) -> None:
    """Refuse a cut inside the last count, which then ends ahead of the column above it."""
    texts = {line.number: line.text for line in lines}
    ends = [[match.end() for match in re.finditer(r"\S++", texts[row.line])] for row in rows]
    last = len(ends[-1]) - 1
    column = {row[last] for row in ends[:-1] if len(row) > last}
    if len(column) == 1 and len(ends) > 2 and ends[-1][last] not in column:
        says = f"{rows[-1].numbers[-1]} must end below the counts ahead of it: the file is cut"
        raise MisreadError(rows[-1].line, says)
