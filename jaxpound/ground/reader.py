"""Recorded accelerograms from text files."""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np

from jaxpound._checks import positive_number
from jaxpound._errors import InvalidInput, warn
from jaxpound.ground.formats import at2, columns, knet
from jaxpound.ground.formats.rows import line_of
from jaxpound.ground.formats.text import MisreadError, read_file
from jaxpound.ground.formats.units import UNITS, stated_among, stated_unit
from jaxpound.ground.plausibility import MANY, of_samples
from jaxpound.ground.record import Record, derived
from jaxpound.quantities import MOST_PGA, STANDARD_GRAVITY


def read_record(
    path: str | os.PathLike[str], *, dt: float | None = None, units: str | None = None
) -> Record:
    """Read a recorded accelerogram from a text file.

    The record is named after the file and has samples in g (float64, standard gravity 9.80665 m/s²)
    and dt in seconds. The content, not the extension, decides the layout:

    - PEER AT2: a header with a line such as ``NPTS=  4000, DT= .01000 SEC`` or
      ``7997 0.0050 NPTS, DT``, then the values, any number a row, also without a blank before a
      sign (``.12E-02-.31E-02``).
    - K-NET and KiK-net (NIED's ASCII format, www.kyoshin.bosai.go.jp): 17 lines of header, which
      state scale factor, sampling frequency and duration, then whole counts. The mean of all
      counts, the instrument's offset, is subtracted; the maximum must then be that of the header.
    - Two columns, time and acceleration, separated by commas, semicolons, tabs or blanks. The time
      step must be uniform within the rounding of the printed times; where that rounding could hide
      a lost sample, it must be uniform as printed. The first sample is at t = 0 of the record.
    - Values without times, one or at least three a row, with ``dt`` given.

    Text ahead of the first row is a header; blank lines and those that start with ``#``, ``%`` or
    ``//`` are skipped. Files are UTF-8 or else Latin-1. Units in a header are understood as a whole
    (``UNITS OF CM/SEC/SEC``, ``acc [mg]``, ``acc_ms2``, ``time (ms)``, ``DT= 10 MSEC``) or refused
    by name (``G/10``, ``counts``).

    Warns (``PlausibilityWarning``) if data follow a comment inside the block of data, or a mark of
    its end; if rows of values look like columns side by side; if a value has other digits than
    nearly all others (of at least a thousand); if the time step is half a second or more; if the
    last line has no line end and its value is the largest; if all of at least a hundred samples are
    0; and as ``Record`` warns.

    Parameters
    ----------
    path
        The file: a regular one of at most 32 MB, 1.05 million lines and 2.1 million numbers (a
        million steps in two columns), with a header of at most 10 000 lines.
    dt
        Time step > 0, s, for a file that states none; else it must agree to 1e-6.
    units
        Unit of the acceleration: "g", "m/s2", "cm/s2", "gal", "ft/s2", "in/s2", "mm/s2" or "mg" (a
        thousandth of g), also as "m/s^2" or "m/s²". None means that of the header, or "g" if it
        states none; otherwise the header must not state another unit.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If an argument breaks its rule, or the file is no regular file, too large, binary, empty or
        without data; holds anything but finite numbers, a sample above 20 g, rows of unequal
        length, non-uniform times, several columns of values, or only times; states no time step, a
        dt or units that differ from the arguments, unknown units, or an unknown scale; is a history
        of velocity or another quantity, or a spectrum; states no positive NPTS and DT; holds fewer
        or more values than it states, which means damage; or ends inside its last value.

    Examples
    --------
    ``read_record("quake.at2")`` reads a file such as::

        ACCELERATION TIME HISTORY IN UNITS OF G
        NPTS=  4, DT= .01000 SEC
          -.6403182E-02  -.6028715E-02   .5304162E-03   .7743260E-02
    """
    if units is not None:
        units = stated_unit("read_record", units)
    if dt is not None:
        (dt,) = positive_number("read_record", dt=dt)
    if not isinstance(path, str | os.PathLike):
        raise InvalidInput("read_record", "path", repr(path), "must be the path of a file")
    file = Path(path)
    notes: list[str] = []
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # such values are refused below
            file_text = read_file(file)
            layout = next((f for f in (knet, at2) if f.fits(file_text.lines)), columns)
            values = layout.read(file_text, dt, notes)
        header_unit = stated_among(values.stated, UNITS)
        if header_unit and units is not None and UNITS[header_unit] != UNITS[units]:
            rule = f"must be the header's own, {header_unit!r}"
            raise MisreadError(values.stated[header_unit], f"units = {units!r} {rule}")
        samples = values.samples * (UNITS[header_unit or units or "g"] / STANDARD_GRAVITY)
        if dt is not None and not math.isclose(dt, values.dt, rel_tol=1e-6):
            raise MisreadError(None, f"dt = {dt!r} must agree with the file's own, {values.dt!r}")
        if len(samples) < 2:
            raise MisreadError(None, "a record must have at least two samples, this has one")
    except MisreadError as error:
        place = file if error.line is None else f"{file}:{error.line}"
        raise ValueError(f"{place}: {error}") from None
    largest = int(np.argmax(np.abs(samples)))
    line, hint = line_of(values.rows, largest), "are the units right, or is a decimal point lost?"
    require_possible(f"{file}:{line}", "acceleration", samples[largest], hint)
    if len(samples) >= MANY and not samples.any():
        notes.append("the acceleration is 0 throughout: is this the right file or column?")
    stated = units is not None or header_unit is not None
    doubts = *notes, *of_samples(samples, values.dt, stated=stated)
    warn(str(file), [*doubts])
    return derived(samples, values.dt, file.stem, doubts=doubts)


def require_possible(place: str, name: str, peak: float, hint: str) -> None:
    """A ``ValueError`` for an acceleration, in g, far above those of all earthquakes."""
    if not abs(peak) <= MOST_PGA:
        raise InvalidInput(place, name, f"{peak:.4g} g", f"must be at most {MOST_PGA:g} g: {hint}")
