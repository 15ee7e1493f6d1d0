"""Recorded accelerograms from files."""

from __future__ import annotations

import codecs
import dataclasses
import os
import re
import stat
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from textwrap import shorten

import numpy as np

from jaxpound._checks import positive_number, require_folder
from jaxpound._errors import InvalidInput, warn
from jaxpound.ground.formats import rows as printed
from jaxpound.ground.formats.columns import COLUMNS, HISTORY
from jaxpound.ground.formats.layout import Channel
from jaxpound.ground.formats.table import channels_of
from jaxpound.ground.formats.text import MisreadError, OtherKindError, TextFile, text_of
from jaxpound.ground.formats.units import UNITS, stated_among
from jaxpound.ground.plausibility import MANY, missing_code, of_samples
from jaxpound.ground.record import Record, derived, stated_unit
from jaxpound.ground.stations import is_other, is_vertical, is_vertical_file
from jaxpound.quantities import MOST_PGA, STANDARD_GRAVITY

_ROUGH = 0.025  # most that a time step may differ from a printed one, as 1/204.8 s from .005 s
_APART = 0.12  # most of two that a file states, as .003 s and 300 Hz
_SAME = 1e-6  # relative difference of equal time steps
_SLOWEST_STEP = 0.5  # in s: nothing above 1 Hz would be left of an earthquake
_FEW = 10  # samples of an example
_SHAPE = str.maketrans("123456789", "000000000")  # the shape of a number: all digits 0
_MOST_BYTES = 32_000_000  # of the longest run, a million steps in two columns, and a header

_OBSPY = (
    "ObsPy reads it: trace = obspy.read({name!r})[0]; "
    'record = jp.Record(trace.data, trace.stats.delta, units="m/s2") if its data are in m/s²'
)
_RECORD = "record = jp.Record(samples, dt, units=...) takes its samples, which {} reads"
_UNPACK = "unpack it and read a file that it holds"
_BY_BEGINNING = (
    (rb"\x89HDF\r\n", "an HDF5 file", _RECORD.format("h5py (of ASDF: pyasdf)")),
    (rb"[0-9 ]{6}[DRQMV][ \0]|MS\x03", "a miniSEED or SEED file", _OBSPY),
    (rb".{304}(?:[\6\7]\0\0\0|\0\0\0[\6\7]).{324}", "a SAC file", _OBSPY),
    (rb"(?:\s*+[-+0-9.e]++){4,12}?\s++-12345(?:\.0*)?\s", "a SAC file of text", _OBSPY),
    (rb"WID[12] ", "a GSE file", _OBSPY),
    (rb"\x1f\x8b|BZh[1-9]|\xfd7zXZ|.{257}ustar|7z\xbc\xaf|Rar!", "a compressed file", _UNPACK),
    (
        rb"\x93NUMPY|MATLAB 5",
        "a NumPy or MATLAB file",
        _RECORD.format("numpy.load or scipy.io.loadmat"),
    ),
    (rb"\xd0\xcf\x11\xe0", "an Excel workbook", "save its sheet as CSV"),
    (rb"%PDF-|\x89PNG|\xff\xd8\xff", "a picture or a PDF", "a record is a file of numbers"),
    (rb"\s*<(?:!doctype|html)", "a web page", "download the file that it links to"),
    (rb".*Record Sequence Number", "a table of a search", "read the records beside it"),
    (
        rb"[3-6] +(?:veloc|displ|resp|four)",
        "an SMC file of another quantity",
        "read that of accelerations",
    ),
    (rb"\s*<\?xml", "an XML file", "read the file of the accelerations"),
)


def read_record(
    path: str | os.PathLike[str],
    *,
    dt: float | None = None,
    units: str | None = None,
    column: int | str | None = None,
    vertical: bool = False,
    rows: str | None = None,
    strict: bool = False,
) -> Record:
    """Read a recorded accelerogram from a file of one of the formats of the networks.

    The content, not the extension, decides the format: PEER AT2, CSMIP and RENADIC (V1, V2), COSMOS
    V1.20, SMC, GeoNet (V1A, V2A), K-NET and KiK-net (without the mean of their counts), ESM (DYNA),
    AFAD, UNAM, CWB, SLIST, TSPAIR, GeoCSV, JSON of SimCenter, columns of spreadsheets and texts
    with or without times, and values one or 5, 8 or 10 a row. The guide "Your record" shows each.
    The record has samples in g (float64, standard gravity 9.80665 m/s²), dt in seconds, and the
    name of the file, with that of the component if the file has several. Number of samples,
    sampling interval and units that a header states must be understood and agree with the data and
    the arguments, within half of the last printed digit. Lines with ``#``, ``%`` or ``//`` ahead of
    them hold no data.

    Warns (``PlausibilityWarning``) of signs of damage, such as values printed unlike nearly all
    others; of rows that look like columns; of a time step of half a second or more, or one taken
    for the file's; if all of at least a hundred samples are 0; and as ``Record`` warns.

    Parameters
    ----------
    path
        The file: a regular one of at most 32 MB, 1.05 million lines and 2.1 million numbers, with a
        header of at most 10 000 lines of as many characters.
    dt
        Time step > 0, s, for a file that states none; else it must agree with the file's.
    units
        Unit of the acceleration: "g", "m/s2", "cm/s2", "gal", "ft/s2", "in/s2", "mm/s2", "mg" (a
        thousandth of g) or "g/10", also as "m/s^2" or "m/s²". None means that of the header, or "g"
        if it states none; otherwise the header must not state another unit.
    column
        Component of a file of several: its number from 1, columns of times not counted, or its name
        in the header, such as "N-S" or "HNE".
    vertical
        Whether a vertical component is meant; without it, or its ``column``, it is refused.
    rows
        "history" reads rows of any width as one history, "columns" as components side by side; by
        default two, three, four and six numbers a row are components.
    strict
        Whether a warning is raised as a ``ValueError``.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If an argument breaks its rule or contradicts the file; the file is of another kind, which
        the message names, or states what its data are not; several components have no ``column``; a
        value is no finite number, above 20 g or a code of missing values; rows are of unequal
        length, times not uniform; or data are cut. The message is one line.
    """
    file = _Source.of(path, dt, units, rows)
    with _located(file.path):
        return file.record(file.chosen(column, vertical), strict)


def read_components(
    path: str | os.PathLike[str],
    *,
    dt: float | None = None,
    units: str | None = None,
    rows: str | None = None,
    strict: bool = False,
) -> tuple[list[Record], list[str]]:
    """All horizontal components of a file, each as ``read_record`` reads it; and other names.

    Raises ``OtherKindError`` if the file holds no horizontal acceleration, else as ``read_record``.
    """
    file = _Source.of(path, dt, units, rows)
    with _located(file.path):
        channels = file.horizontal()
        others = [" ".join(x.names) for x in file.channels if not any(x is y for y in channels)]
        return [file.record(channel, strict) for channel in channels], others


@dataclasses.dataclass(frozen=True)
class _Source:
    """A file with its components, and what a user says of it."""

    path: Path
    text: TextFile
    channels: list[Channel]
    dt: float | None
    units: str | None
    notes: tuple[str, ...]

    @staticmethod
    def of(path: object, dt: float | None, units: str | None, rows: str | None) -> _Source:
        """A file that has been split into components; an error for one that cannot be."""
        if units is not None:
            units = stated_unit(units)
        if dt is not None:
            (dt,) = positive_number(dt=dt)
        if rows not in (None, HISTORY, COLUMNS):
            rule = f"must be {HISTORY!r}, one row after the other, or {COLUMNS!r}, side by side"
            raise InvalidInput("rows", repr(rows), rule)
        if not isinstance(path, str | os.PathLike):
            raise InvalidInput("path", repr(path), "must be the path of a file")
        file, notes = Path(path), list[str]()
        with _located(file), np.errstate(over="ignore", invalid="ignore"):  # refused below
            text = text_of(_bytes_of(file))
            channels = channels_of(text, dt, rows, notes)
        return _Source(file, text, channels, dt, units, tuple(notes))

    def chosen(self, column: int | str | None, vertical: bool) -> Channel:
        """The component that is asked for, or the only one."""
        channels, names = self._accelerations(), [" ".join(x.names) for x in self.channels]
        words = (f"{i}: {name}".removesuffix(": ") for i, name in enumerate(names, 1))
        listed = f"{len(names)} columns or blocks ({shorten(', '.join(words), 200)})"
        line = self.channels[0].rows[0].line
        if column is not None:
            spelled = _plain(column) if isinstance(column, str) else "?"  # of no name
            by_name = [
                x for x in self.channels if spelled in map(_plain, (*x.names, "".join(x.names)))
            ]
            number = int(column) if str(column).isdigit() else 0
            asked = by_name or self.channels[max(number - 1, 0) : number]
            if len(asked) != 1 or not any(asked[0] is x for x in channels):
                rule = f"must be a number from 1, or a name, of an acceleration among {listed}"
                raise MisreadError(line, f"column = {column!r} {rule}")
            return asked[0]
        if vertical and len(channels) > 1:
            channels = [channel for channel in channels if any(map(is_vertical, channel.names))]
        if len(channels) != 1:
            rule = "choose one by its number or name, as column=1"
            if not any(channel.names or channel.times for channel in channels):
                rule += ', or rows="history" if each row continues the one above'
            raise MisreadError(line, f"{listed}: {rule}")
        return channels[0] if vertical else self.horizontal()[0]

    def _accelerations(self) -> list[Channel]:
        """The components that are not said to be another quantity."""
        channels = [x for x in self.channels if not any(map(is_other, x.names))]
        if not channels:
            names = ", ".join(name for channel in self.channels for name in channel.names)
            raise OtherKindError(None, f"must be an acceleration history, but has {names}")
        return channels

    def horizontal(self) -> list[Channel]:
        """The components that are not said to be vertical; an ``OtherKindError`` if none is."""
        channels = self._accelerations()
        horizontal = [x for x in channels if not any(map(is_vertical, x.names))]
        silent = not any(channel.names for channel in channels)
        named = [" ".join(channel.names) for channel in channels if channel.names]
        if repeated := next((name for name in named if named.count(name) > 1), None):
            raise MisreadError(None, f"several blocks are {repeated}: is there a gap between them?")
        if not horizontal or (silent and is_vertical_file(self.path.name)):
            says = "the file's name" if silent else " ".join(channels[0].names)
            rule = "pass vertical=True if it is to shake buildings sideways"
            raise OtherKindError(None, f"is a vertical component ({says}): {rule}")
        return horizontal

    def record(self, channel: Channel, strict: bool) -> Record:
        """The record of a component, whose count, interval, unit and values are checked."""
        name, own = self.path.stem, " ".join(channel.names[:1])
        if len(self.channels) > 1:
            unique = own and [x.names[:1] for x in self.channels].count(channel.names[:1]) == 1
            number = 1 + [x is channel for x in self.channels].index(True)
            name += f" {own if unique else number}"
        channel, notes = _within_count(channel), [*self.notes]
        rows, stated, samples = channel.rows, channel.stated, channel.samples
        printed.require_count(stated, len(samples))
        _check_digits(rows, self.text.ended, notes)
        peak = np.abs(samples)
        if len(peak) >= MANY and not self.text.ended and peak[-1] > peak[:-1].max():
            notes.append("the last line has no end and its value is the largest: is the file cut?")
        step = _interval(channel, self.dt, notes)
        unit = stated_among(stated.units, UNITS)
        if unit and self.units and UNITS[unit] != UNITS[self.units]:
            rule = f"must be the header's own, {unit!r}"
            raise MisreadError(stated.units[unit], f"units = {self.units!r} {rule}")
        if code := missing_code(channel.samples):
            line = printed.line_of(rows, code[1])
            rule = f"stands {code[2]} times as for missing values: fill the gaps, or take a part"
            raise MisreadError(line, f"{code[0]:g} {rule}")
        if len(samples) < 2:
            rule = "a record must have at least two samples, this has one"
            raise MisreadError(rows[0].line, rule)
        samples = samples * (UNITS[unit or self.units or "g"] / STANDARD_GRAVITY)
        largest = int(np.argmax(np.abs(samples)))
        hint = "are the units right, or is a decimal point lost?"
        line = printed.line_of(rows, largest)
        require_possible(f"{self.path}:{line}", "acceleration", samples[largest], hint)
        if len(samples) >= MANY and not samples.any():
            notes.append("the acceleration is 0 throughout: is this the right file or column?")
        known = self.units is not None or unit is not None
        doubts = *notes, *of_samples(samples, step, stated=known)
        warn([f"{self.path}: {doubt}" for doubt in doubts], strict)
        return derived(samples, step, name, doubts=doubts)


def _other_kind(file: Path, data: bytes) -> str | None:
    """What a file of a known format that is not read is, and what reads it; None for others."""
    if data.startswith(b"PK\x03\x04"):
        try:
            with zipfile.ZipFile(file) as archive:
                members = [member for member in archive.namelist() if not member.endswith("/")]
        except zipfile.BadZipFile:
            return f"is a damaged zip archive: {_UNPACK}"
        if "[Content_Types].xml" in members:
            return "is an Excel workbook: save its sheet as CSV"
        listed = ", ".join(members[:6]) + (", ..." if len(members) > 6 else "")
        return f"is a zip archive: {_UNPACK}: {listed}"
    for pattern, kind, advice in _BY_BEGINNING:
        if re.match(pattern, data[:8192], re.S | re.I):
            return f"is {kind}: {advice.format(name=file.name)}"
    return None


def _bytes_of(file: Path) -> bytes:
    """The bytes of a file: a regular one, of no other kind, and not too large."""
    try:
        status = file.stat()
    except FileNotFoundError:
        require_folder(file)
        raise FileNotFoundError(f"{file}: no such file") from None
    if not stat.S_ISREG(status.st_mode):
        kind = "directory" if stat.S_ISDIR(status.st_mode) else "device, pipe or socket"
        raise MisreadError(None, f"must be a file, not a {kind}")
    with file.open("rb") as opened:
        data = opened.read(_MOST_BYTES + 1)
    if other_kind := _other_kind(file, data):
        raise OtherKindError(None, other_kind)
    if len(data) > _MOST_BYTES:
        most, size = _MOST_BYTES / 1e6, max(len(data), status.st_size) / 1e6
        raise MisreadError(None, f"must have at most {most:.0f} MB of text, not {size:.4g} MB")
    utf_16 = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))  # of spreadsheets
    return data.decode("utf-16", "replace").encode() if utf_16 else data


@contextmanager
def _located(file: Path) -> Iterator[None]:
    """A context in which an error in a file names its path and line."""
    try:
        yield
    except MisreadError as error:
        line = "" if error.line is None else f":{error.line}"
        raise type(error)(None, error.message, f"{file}{line}: ") from None


def _plain(name: str) -> str:
    """A name of a component without regard to case, blanks and signs."""
    return re.sub(r"(?<=\S) ?[(\[].*|[\W_]", "", name).lower()


def _within_count(channel: Channel) -> Channel:
    """The component without the zeros that fill its last row behind the number of its values."""
    rows, counts = channel.rows, channel.stated.counts
    if not counts or not rows:
        return channel
    surplus, last = len(channel.samples) - int(counts[-1].value), rows[-1]
    if not 0 < surplus < len(last.numbers) or any(map(float, last.numbers[-surplus:])):
        return channel
    rows = [*rows[:-1], last._replace(numbers=last.numbers[:-surplus])]
    return channel._replace(rows=rows, samples=channel.samples[:-surplus])


def _interval(channel: Channel, dt: float | None, notes: list[str]) -> float:
    """The sampling interval, in s: all that state it must agree within their last digits."""
    stated = [*([channel.times] if channel.times else []), *channel.stated.intervals]
    if not stated:
        if dt is None:
            rule, n = "pass dt, the time step in s", len(channel.rows[0].numbers)
            raise MisreadError(channel.rows[0].line, f"{n} value(s) a row and no times: {rule}")
        return float(dt)
    finest = min(stated, key=lambda statement: statement.slack / statement.value)
    step = finest.value
    for other in stated:
        slack = min(other.slack + finest.slack, _APART * step) + _SAME * step
        if abs(other.value - step) > slack:
            rule = f"must agree with {finest.text!r}, {step:.6g} s"
            raise MisreadError(other.line, f"{other.text!r}, {other.value:.6g} s, {rule}")
    if step >= _SLOWEST_STEP and len(channel.samples) >= _FEW:
        notes.append(f"the time step is {step:g} s: are the times in seconds?")
    if dt is None:
        return step
    if abs(dt - step) > min(finest.slack, _ROUGH * step) + _SAME * step:
        raise MisreadError(finest.line, f"dt = {dt!r} must agree with the file's own, {step!r}")
    if abs(dt - step) > _SAME * step:
        notes.append(f"dt = {dt:g} s is taken for {finest.text!r}, {step:g} s")
        return float(dt)
    return step


def _check_digits(rows: list[printed.ValueRow], ended: bool, notes: list[str]) -> None:
    """Refuse a file that is cut inside its last value, which then has fewer digits than others.

    A zero at the end, such as -0 or 0.0, may be the rest of a small value with more digits, unless
    zeros are printed so elsewhere. A value elsewhere with other digits than nearly all is noted: it
    may be damaged.
    """
    numbers = [number for row in rows for number in row.numbers]
    first, behind = numbers[: (n := len(rows[0].numbers))], numbers[n:]
    whole = not any("." in number for number in first) and any(map(float, first))
    if whole and len(behind) > MANY and all("." in number for number in behind):
        rule = "stands ahead of values with decimals: is it of a header, or a count?"
        raise MisreadError(rows[0].line, f"a row of whole numbers {rule}")
    if len(numbers) <= _FEW // 2:
        return
    digits = np.array([_digits(number.translate(_SHAPE)) for number in numbers])
    _, decimals, exponents = digits.T
    exponents_before = exponents[:-1][exponents[:-1] > 0]
    uniform = np.ptp(decimals[:-1]) == np.ptp(exponents[:-1]) == 0
    nonzero = float(numbers[-1]) != 0
    shorter = decimals[-1] < decimals[:-1].max() or exponents[-1] < exponents[:-1].max()
    if (
        ((uniform or (len(numbers) > MANY and nonzero)) and decimals[-1] < decimals[:-1].min())
        or (exponents[-1] == 0 and len(exponents_before) == len(numbers) - 1)
        or (exponents[-1] > 0 and len(exponents_before) and exponents[-1] < exponents_before.min())
        or (not ended and not nonzero and shorter and numbers[-1] not in numbers[:-1])
    ):
        message = f"{numbers[-1]} must have the digits of the values ahead of it: the file is cut"
        raise MisreadError(rows[-1].line, message)
    codes = digits @ np.array([10**6, 10**3, 1])  # three numbers, of at most 100 each, as one
    _, form, times = np.unique(codes, return_inverse=True, return_counts=True)
    odd = len(numbers) - times.max()
    if len(numbers) >= MANY and 0 < odd <= max(1, len(numbers) // (10 * MANY)):
        index = int(np.argmax(form != np.argmax(times)))
        place = f"{numbers[index]} in line {printed.line_of(rows, index)}"
        notes.append(f"{place} is printed with other digits than nearly all values: is it damaged?")


@lru_cache(1000)  # numbers have few shapes
def _digits(number: str) -> tuple[int, int, int]:
    """Numbers of digits before the decimal point, after it (-1 without one), in the exponent."""
    mantissa, _, exponent = number.lstrip("+-").partition("E")
    whole, point, decimals = mantissa.partition(".")
    places = len(decimals) if point else -1
    # Without an exponent the digits before the point vary in a file.
    return len(whole) if exponent else 0, places, len(exponent.lstrip("+-"))


def require_possible(place: str, name: str, peak: float, hint: str) -> None:
    """A ``ValueError`` for an acceleration, in g, far above those of all earthquakes."""
    if not abs(peak) <= MOST_PGA:
        rule = f"must be at most {MOST_PGA:g} g: {hint}"
        raise InvalidInput(f"{place}: {name}", f"{peak:.4g} g", rule, owner="")
