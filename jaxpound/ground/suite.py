"""Suites: several recorded accelerograms of one site or one hazard."""

from __future__ import annotations

import dataclasses
import os
import reprlib
from collections.abc import Iterator, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import ArrayLike

from jaxpound import _checks
from jaxpound._checks import count, instance, is_traced, positive, positive_number, require_one_of
from jaxpound._errors import InvalidInput, renamed, warn
from jaxpound._tables import Shown, TextTable
from jaxpound.ground.intensity import spectra
from jaxpound.ground.reader import read_record
from jaxpound.ground.record import Record
from jaxpound.ground.target import SCALED_TO, FactorBounds, PeriodRange, ScaledSuite, TargetSpectrum

PERIODS = 100  # number of those at which spectra are compared with a target


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class RecordSuite(Shown):
    """Recorded accelerograms that are used together, of any lengths and sample intervals.

    A record without a name gets its number: "record 3". Raises ``ValueError`` if there is no
    record, or one is no ``Record``, a batch, traced or zero throughout; if names are equal, or
    units of time differ.

    Examples
    --------
    >>> t = 0.02 * np.arange(500)
    >>> burst = [0.2 * np.sin(w * t) * np.exp(-((t - 4) ** 2)) for w in (4.0, 7.0, 11.0)]
    >>> names = ("slow", "medium", "fast")
    >>> suite = jp.RecordSuite([jp.Record(a, 0.02, name) for a, name in zip(burst, names)])
    >>> len(suite), suite.names, round(float(suite["fast"].dt), 3)
    (3, ('slow', 'medium', 'fast'), 0.02)
    >>> suite.spectra([0.5, 1.0]).shape
    (3, 2)
    """

    records: tuple[Record, ...]

    def __post_init__(self) -> None:
        owner, members = "RecordSuite", self.records
        if not isinstance(members, Sequence) or not members:
            rule = "must hold at least one record, in a list"
            raise InvalidInput(owner, "records", reprlib.repr(members), rule)
        for i, record in enumerate(members):
            name = f"records[{i}]"
            instance(owner, name, record, Record)
            if is_traced(record) or np.ndim(record.samples) != 1:
                raise InvalidInput(owner, name, repr(record), "must be known, and one alone")
            if not np.any(record.samples):
                raise InvalidInput(owner, name, repr(record), "must move: all are zero")
            if record.time_unit != members[0].time_unit:
                rule = f"must be in the same unit of time as {members[0]!r}"
                raise InvalidInput(owner, repr(record), "", rule)
        records = tuple(
            record if record.name else record._with(record.samples, name=f"record {i}")
            for i, record in enumerate(members, 1)
        )
        object.__setattr__(self, "records", records)
        if repeated := [name for name in self.names if self.names.count(name) > 1]:
            raise InvalidInput(owner, "name", repr(repeated[0]), "must be that of one record only")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the records."""
        return tuple(record.name for record in self.records)

    @property
    def time_unit(self) -> str:
        """Unit of time of the records: "s" or "1/ω1"."""
        return self.records[0].time_unit

    @property
    def pgas(self) -> np.ndarray:
        """Peak ground acceleration of each record, g, shape (n,)."""
        return np.array([float(np.abs(record.samples).max()) for record in self.records])

    def __len__(self) -> int:
        return len(self.records)

    def __iter__(self) -> Iterator[Record]:
        return iter(self.records)

    def __getitem__(self, key: int | str) -> Record:
        """A record by its number, from 0, or by its name."""
        if isinstance(key, str):
            require_one_of("RecordSuite", key, self.names, "name")
            return self.records[self.names.index(key)]
        return self.records[key]

    def chosen(self, which: Sequence[int | str] | np.ndarray) -> RecordSuite:
        """The suite of some of the records, by their numbers from 0 or their names.

        Raises ``ValueError`` if there is no such record, none is chosen, or one is chosen twice.
        """
        n, records = len(self), []
        for key in which:
            if not isinstance(key, str) and not (_checks.is_whole(key) and -n <= key < n):
                rule = f"must be a record's number, from 0 to {n - 1}, or its name"
                raise InvalidInput("RecordSuite.chosen", repr(key), "", rule)
            records.append(self[key])
        return RecordSuite(tuple(records))

    def spectra(self, periods: ArrayLike, damping: float = 0.05) -> np.ndarray:
        """``spectral_acceleration`` of each record at each period, g, shape (n, m).

        ``periods`` > 0 have the shape (m,) and the records' unit of time; ``damping`` is at least 0
        and below 1. Raises ``ValueError`` for others.
        """
        return spectra("RecordSuite.spectra", self.records, periods, damping)

    def scaled(self, factors: ArrayLike) -> RecordSuite:
        """Each record times its factor > 0, shape (n,), or times one number."""
        owner = "RecordSuite.scaled"
        (valid,) = positive(owner, factors=factors)
        if np.shape(valid) not in ((), (len(self),)):
            name = f"factors of shape {np.shape(valid)}"
            raise InvalidInput(owner, name, "", f"must be ({len(self)},)")
        each = zip(self.records, np.broadcast_to(valid, len(self)), strict=True)
        return RecordSuite(tuple(x._with(x.samples * factor) for x, factor in each))

    def scaled_to(
        self,
        target: TargetSpectrum,
        periods: PeriodRange | tuple[float, float],
        factors: tuple[float, float] = (0.25, 4.0),
        *,
        best: int | None = None,
        least: float | None = None,
        strict: bool = False,
    ) -> ScaledSuite:
        """Each record times the factor with which its spectrum fits a target best.

        The factor minimises the squares of ln(record / target) at 100 periods, evenly spaced in
        the logarithm. Records are single horizontal components; codes compare the combined
        spectrum of both.

        Raises ``ValueError`` if an argument breaks its rule, the range exceeds the target's periods
        or those of a record, from two sample intervals to its duration, or the bounds prevent
        ``least``.

        Parameters
        ----------
        target, periods
            The spectrum to be met, of the damping at which the records' spectra are taken, and the
            range in which it is to be met, in the records' unit of time, (low, high), or
            ``PeriodRange.asce_7(...)``, ``PeriodRange.en_1998(...)``.
        factors
            Bounds of the factors, 0 < low ≤ high; a ``PlausibilityWarning`` names records whose
            factor is a bound.
        best
            The number of records to keep, those whose scaled spectra fit best.
        least
            Smallest admissible ratio of the mean of the scaled spectra to the target, 0.9 in both
            codes; a common factor raises all records to it.
        strict
            Whether a warning is raised as a ``ValueError``.

        Examples
        --------
        >>> waves = [0.2 * np.sin(w * 0.02 * np.arange(500)) for w in (4.0, 7.0, 11.0)]
        >>> suite = jp.RecordSuite([jp.Record(wave, 0.02) for wave in waves])
        >>> target = jp.TargetSpectrum([0.1, 0.5, 2.0], [0.5, 0.5, 0.125])
        >>> scaled = suite.scaled_to(target, (0.3, 1.5), best=2, least=0.9)
        >>> scaled.suite.names, round(scaled.least_ratio, 3)
        (('record 2', 'record 3'), 0.9)
        """
        instance(SCALED_TO, "target", target, TargetSpectrum)
        span, bounds = PeriodRange.of(SCALED_TO, periods), FactorBounds.of(factors)
        if best is not None and count(SCALED_TO, "best", best) > len(self):
            rule = f"must be at most {len(self)}, all records"
            raise InvalidInput(SCALED_TO, "best", str(best), rule)
        if least is not None:
            positive_number(SCALED_TO, least=least)
        for record in self.records:
            low, high = 2 * float(record.dt), float(record.duration)
            if span.low < low * (1 - 1e-9) or span.high > high * (1 + 1e-9):
                stated = f"{span.low:.4g} to {span.high:.4g} {self.time_unit}"
                limits = f"{low:.4g} to {high:.4g} (two sample intervals, its duration)"
                rule = f"must be within what {record.name!r} holds, {limits}"
                raise InvalidInput(SCALED_TO, "periods", stated, rule)
        periods_at = np.geomspace(*span, PERIODS)
        with renamed(SCALED_TO):
            ordinates = target.at(periods_at)
        unscaled = self.spectra(periods_at, target.damping)
        selected, fitted = bounds.fit(ordinates / unscaled, best, least)
        suite, at = self.chosen(selected).scaled(fitted), fitted[:, None] * unscaled[selected]
        scaled = ScaledSuite(suite, fitted, target, span, periods_at, at, bounds)
        warn(SCALED_TO, scaled.findings(), strict)
        return scaled

    def _tables(self) -> list[TextTable]:
        unit = self.time_unit
        rows = [
            (record.name, record.n_samples, float(record.dt), float(record.duration), float(peak))
            for record, peak in zip(self.records, self.pgas, strict=True)
        ]
        columns = ("record", "samples", f"interval ({unit})", f"duration ({unit})", "PGA (g)")
        return [TextTable(f"{len(self)} records", columns, rows, digits=4)]


def read_suite(
    folder: str | os.PathLike[str],
    pattern: str = "*.AT2",
    *,
    dt: float | None = None,
    units: str | None = None,
) -> RecordSuite:
    """Read the accelerograms of a folder, in the order of their names, which the records have.

    ``jp.read_suite("records", "*.csv")`` reads all CSV files of a folder, without its subfolders;
    ``pattern`` is regardless of case, and ``dt`` and ``units`` are as in ``read_record``. Raises
    ``ValueError`` if there is no such folder, no file matches the pattern, ``read_record`` refuses
    a file, which the message names, or two files differ only in their extensions. Warns as
    ``read_record``.
    """
    owner, place = "read_suite", Path(folder)
    if not place.is_dir():
        raise InvalidInput(owner, "folder", repr(str(folder)), "must be a folder")
    if not isinstance(pattern, str) or not pattern:
        raise InvalidInput(owner, "pattern", repr(pattern), "must be a pattern such as '*.AT2'")
    files = sorted(path for path in place.iterdir() if path.is_file())
    matching = [path for path in files if fnmatchcase(path.name.lower(), pattern.lower())]
    if not matching:
        kinds = ", ".join(sorted({f"*{path.suffix}" for path in files if path.suffix})[:8])
        content = f"it has {kinds}" if kinds else "it is empty"
        rule = f"must fit a file in {place}: {content}"
        raise InvalidInput(owner, "pattern", repr(pattern), rule)
    try:
        return RecordSuite(tuple(read_record(path, dt=dt, units=units) for path in matching))
    except InvalidInput as error:
        places = {"read_record": owner, "RecordSuite": f"{owner}: {place}"}
        raise error.replaced(owner=places.get(error.owner, f"{owner}: {error.owner}")) from error
    except ValueError as error:  # a file that could not be read
        raise ValueError(f"{owner}: {error}") from error


def as_suite(owner: str, records: Any) -> RecordSuite:
    """A suite, or several records as a suite."""
    if isinstance(records, RecordSuite):
        return records
    if not isinstance(records, Sequence):
        rule = "must be a RecordSuite or a list of records"
        raise InvalidInput(owner, "records", reprlib.repr(records), rule)
    return RecordSuite(tuple(records))
