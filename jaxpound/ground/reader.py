"""Recorded accelerograms from text files."""

from __future__ import annotations

import math
import os
import warnings
from pathlib import Path

import numpy as np

from jaxpound._checks import number, positive
from jaxpound.ground.formats import FORMATS
from jaxpound.ground.formats.rows import line_of
from jaxpound.ground.formats.text import MisreadError, read_file
from jaxpound.ground.formats.units import UNITS, acceleration_unit, stated_unit
from jaxpound.ground.plausibility import MANY, PlausibilityWarning, of_samples
from jaxpound.ground.record import Record, derived
from jaxpound.quantities import MOST_PGA, STANDARD_GRAVITY


def read_record(
    path: str | os.PathLike[str], *, dt: float | None = None, units: str | None = None
) -> Record:
    """Read a recorded accelerogram from a text file.

    Its layout is recognised by its content, not by its extension:

    - PEER AT2: a header with a line such as ``NPTS=  4000, DT= .01000 SEC`` or
      ``7997 0.0050 NPTS, DT``, then the values, any number a row, also without a blank before a
      sign (``.12E-02-.31E-02``).
    - K-NET and KiK-net (NIED's ASCII format): 17 lines of header, then whole counts. Scale
      factor, sampling frequency and duration are read from the header. The mean of all counts, the
      instrument's offset, is subtracted; the record must then have the maximum that the header
      states, which is about that mean.
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
        The file: a regular one of at most 32 MB, 1.05 million lines and 2.1 million numbers (a
        million steps in two columns), with a header of at most 10 000 lines.
    dt
        Time step > 0, in seconds, for a file that states none; else it must agree to 1e-6.
    units
        What the file's acceleration is in: "g", "m/s2", "cm/s2", "gal", "ft/s2", "in/s2", "mm/s2"
        or "mg" (a thousandth of g), also as "m/s^2" or "m/s²". If it is None, what the header
        states, or "g" where it states nothing; else the header must not state another.

    Returns
    -------
    Record
        Samples in g (float64, standard gravity 9.80665 m/s²), dt in seconds, named after the file.

    Warns
    -----
    PlausibilityWarning
        If data follow a comment inside the block of data, or a mark of its end; if rows of values
        look like columns side by side; if a value has other digits than nearly all others (of a
        thousand and more); if the time step is half a second or more; if the last line has no
        line end and its value is the largest; or, of a hundred samples and more, if all are 0, one
        is more than three times all others, or no unit is stated and the peak would be above 1.5 g,
        which few records in g reach and many in m/s² do.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If an argument breaks its rule, or the file is no regular file, too large, binary, empty or
        without data; holds anything but finite numbers, a sample above 20 g, rows of unequal
        length, non-uniform times, several columns of values, or times alone; states no time step,
        another dt or other units than given, units that are not known, or a scale that is not
        understood; says that it is a history of velocity or another quantity, or a spectrum; states
        no positive NPTS and DT; holds fewer or more values than it says (a surplus is not ignored:
        it means a damaged file); or ends inside its last value.

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
    if units is not None:
        units = stated_unit("read_record", units)
    if dt is not None:
        (dt,) = positive("read_record", dt=number("read_record", "dt", dt))
    if not isinstance(path, str | os.PathLike):
        raise ValueError(f"read_record: path = {path!r} must be the path of a file")
    file = Path(path)
    notes: list[str] = []
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # for what is refused right after
            text = read_file(file)
            read = next(f for f in FORMATS if f.fits(text.lines)).read(text, dt, notes)
        samples = read.samples * (_factor(read.stated, units) / STANDARD_GRAVITY)
        if dt is not None and not math.isclose(dt, read.dt, rel_tol=1e-6):
            raise MisreadError(None, f"dt = {dt!r} must agree with the file's own, {read.dt!r}")
        if len(samples) < 2:
            raise MisreadError(None, "a record must have at least two samples, this has one")
    except MisreadError as error:
        raise ValueError(f"{_place(file, error.line)}: {error}") from None
    largest = int(np.argmax(np.abs(samples)))
    place = _place(file, line_of(read.rows, largest))
    hint = "are the units right, or is a decimal point lost?"
    require_possible(place, "acceleration", samples[largest], hint)
    if len(samples) >= MANY and not samples.any():
        notes.append("the acceleration is 0 throughout: is this the right file or column?")
    stated = units is not None or acceleration_unit(read.stated) is not None
    for note in [*notes, *of_samples(samples, read.dt, stated=stated)]:
        warnings.warn(f"{file}: {note}", PlausibilityWarning, stacklevel=2)
    return derived(samples, read.dt, file.stem)


def _factor(stated: dict[str, int], units: str | None) -> float:
    """The size of the file's units, in m/s2."""
    own = acceleration_unit(stated)
    if own and units is not None and UNITS[own] != UNITS[units]:
        raise MisreadError(stated[own], f"units = {units!r} must be the header's own, {own!r}")
    return UNITS[own or units or "g"]


def require_possible(place: str, name: str, peak: float, hint: str) -> None:
    """A ``ValueError`` for an acceleration, in g, that no earthquake comes near."""
    if not abs(peak) <= MOST_PGA:
        rule = f"at most {MOST_PGA:g} g: {hint}"
        raise ValueError(f"{place}: {name} = {peak:.4g} g must be {rule}")


def _place(file: Path, line: int | None) -> str:
    return str(file) if line is None else f"{file}:{line}"
