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

from jaxpound._checks import (
    Rule,
    count,
    enforce,
    instance,
    is_traced,
    is_whole,
    number,
    positive,
)
from jaxpound._tables import Shown, Table
from jaxpound.ground.intensity import spectra
from jaxpound.ground.plausibility import tell
from jaxpound.ground.reader import read_record
from jaxpound.ground.record import Record, derived
from jaxpound.ground.scaling import OWNER, Bounds, fitted_factors, misfit, raised
from jaxpound.ground.target import PeriodRange, TargetSpectrum

PERIODS = 100
"""Number of periods at which spectra are compared with a target."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class RecordSuite(Shown):
    """Recorded accelerograms that are used together, of any lengths and sample intervals.

    Parameters
    ----------
    records
        The records, at least one, with names that differ; one without a name is called by its
        number, "record 3".

    Raises
    ------
    ValueError
        If there is no record, or one is no ``Record``, a batch, traced, or without any motion; if
        two have one name, or their units of time differ.

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
        owner = "RecordSuite"
        given = self.records
        if not isinstance(given, Sequence) or not given:
            shown = reprlib.repr(given)
            raise ValueError(f"{owner}: records = {shown} must hold at least one record, in a list")
        for i, record in enumerate(given):
            instance(owner, f"records[{i}]", record, Record)
            if is_traced(record) or np.ndim(record.samples) != 1:
                raise ValueError(f"{owner}: records[{i}] = {record!r} must be known, and one alone")
            if not np.any(record.samples):
                raise ValueError(f"{owner}: records[{i}] = {record!r} must move: all are zero")
            if record.time_unit != given[0].time_unit:
                rule = f"must be in the same unit of time as {given[0]!r}"
                raise ValueError(f"{owner}: {record!r} {rule}")
        records = tuple(
            record
            if record.name
            else derived(record.samples, record.dt, f"record {i}", record.time_unit)
            for i, record in enumerate(given, 1)
        )
        object.__setattr__(self, "records", records)
        if twice := [name for name in self.names if self.names.count(name) > 1]:
            raise ValueError(f"{owner}: name = {twice[0]!r} must be that of one record only")

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

    def __getitem__(self, which: int | str) -> Record:
        """A record by its number, from 0, or by its name."""
        if isinstance(which, str):
            if which not in self.names:
                listed = ", ".join(self.names)
                raise ValueError(f"RecordSuite: name = {which!r} must be one of {listed}")
            return self.records[self.names.index(which)]
        return self.records[which]

    def chosen(self, which: Sequence[int | str] | np.ndarray) -> RecordSuite:
        """The suite of some of the records, by their numbers from 0 or their names.

        Raises
        ------
        ValueError
            If there is no such record, none is chosen, or one twice.
        """
        n, records = len(self), []
        for one in which:
            if not isinstance(one, str) and not (is_whole(one) and -n <= one < n):
                rule = f"a record's number, from 0 to {n - 1}, or its name"
                raise ValueError(f"RecordSuite.chosen: {one!r} must be {rule}")
            records.append(self[one])
        return RecordSuite(tuple(records))

    def spectra(self, periods: ArrayLike, damping: float = 0.05) -> np.ndarray:
        """``spectral_acceleration`` of each record at each period, g, shape (n, m).

        Parameters
        ----------
        periods
            Natural periods > 0, shape (m,), in the records' unit of time.
        damping
            Damping ratio, at least 0 and below 1.

        Raises
        ------
        ValueError
            If an argument breaks its rule.
        """
        owner = "RecordSuite.spectra"
        (known,) = positive(owner, periods=periods)
        at, zeta = np.asarray(known, float), np.asarray(number(owner, "damping", damping))
        if at.ndim != 1 or not at.size:
            raise ValueError(f"{owner}: periods of shape {at.shape} must be (m,) with m ≥ 1")
        enforce(owner, [Rule("damping", zeta, (zeta >= 0) & (zeta < 1), "at least 0 and below 1")])
        return spectra(self.records, at, float(zeta))

    def scaled(self, factors: ArrayLike) -> RecordSuite:
        """Each record times its factor > 0, shape (n,), or all times one."""
        owner = "RecordSuite.scaled"
        (known,) = positive(owner, factors=factors)
        if np.shape(known) not in ((), (len(self),)):
            raise ValueError(f"{owner}: factors of shape {np.shape(known)} must be ({len(self)},)")
        each = np.broadcast_to(known, len(self))
        return RecordSuite(
            tuple(
                derived(record.samples * factor, record.dt, record.name, record.time_unit)
                for record, factor in zip(self.records, each, strict=True)
            )
        )

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
        """Each record times the factor with which its spectrum is nearest to a target.

        The factor minimises the squares of ln(record / target) at 100 periods, evenly spaced in
        the logarithm. It applies to single horizontal components; codes compare the two
        components' combined spectrum.

        Parameters
        ----------
        target
            The spectrum to be met, of the damping at which the records' spectra are taken.
        periods
            The range in which it is to be met, in the records' unit of time, (low, high), or
            ``PeriodRange.asce_7(...)``, ``PeriodRange.en_1998(...)``.
        factors
            Bounds of the factors, 0 < low ≤ high; a record that would need another one gets the
            bound, and a warning says so.
        best
            Keep only so many records, those whose scaled spectra fit best.
        least
            All factors of the suite are raised by a common one, as far as it takes for the mean of
            the scaled spectra to be nowhere below this share of the target: 0.9 in both codes.
        strict
            Whether a warning is raised as a ``ValueError``.

        Raises
        ------
        ValueError
            If an argument breaks its rule; if the range is not within the target's periods, or not
            within those of every record, from two of its sample intervals to its duration; if
            ``least`` cannot be reached within the bounds.

        Warns
        -----
        PlausibilityWarning
            If a factor is at a bound.

        Examples
        --------
        >>> t = 0.02 * np.arange(500)
        >>> burst = [0.2 * np.sin(w * t) * np.exp(-((t - 4) ** 2)) for w in (4.0, 7.0, 11.0)]
        >>> suite = jp.RecordSuite([jp.Record(a, 0.02) for a in burst])
        >>> target = jp.TargetSpectrum([0.1, 0.5, 2.0], [0.5, 0.5, 0.125])
        >>> scaled = suite.scaled_to(target, (0.3, 1.5), best=2, least=0.9)
        >>> scaled.suite.names, round(scaled.least_ratio, 3)
        (('record 2', 'record 3'), 0.9)
        """
        instance(OWNER, "target", target, TargetSpectrum)
        span, bounds = PeriodRange.of(OWNER, periods), Bounds.of(factors)
        if best is not None and count(OWNER, "best", best) > len(self):
            raise ValueError(f"{OWNER}: best = {best} must be at most {len(self)}, all records")
        if least is not None:
            positive(OWNER, least=number(OWNER, "least", least))
        self._require_usable(span)
        at = np.geomspace(*span, PERIODS)
        try:
            wanted = target.at(at)
        except ValueError as error:
            raise ValueError(f"{OWNER}: {str(error).partition(': ')[2]}") from None
        found = self.spectra(at, target.damping)
        ratios = wanted / found
        fitted = fitted_factors(ratios, bounds)
        kept = np.arange(len(self))
        if best is not None:
            off = misfit(np.log(fitted[:, None] / ratios))
            kept = np.sort(np.argsort(off, kind="stable")[:best])
        ratios, fitted = ratios[kept], fitted[kept]
        if least is not None:
            fitted = raised(fitted, ratios, bounds, least)
        scaled = ScaledSuite(
            self.chosen(kept).scaled(fitted),
            fitted,
            target,
            span,
            at,
            fitted[:, None] * found[kept],
            bounds,
        )
        tell(OWNER, scaled.findings(), strict)
        return scaled

    def _require_usable(self, span: PeriodRange) -> None:
        """A ``ValueError`` for a range of periods that a record knows nothing of."""
        for record in self.records:
            low, high = 2 * float(record.dt), float(record.duration)
            if span.low < low * (1 - 1e-9) or span.high > high * (1 + 1e-9):
                told = f"{span.low:.4g} to {span.high:.4g} {self.time_unit}"
                rule = f"within what {record.name!r} holds, {low:.4g} to {high:.4g}"
                why = "(two sample intervals, its duration)"
                raise ValueError(f"{OWNER}: periods = {told} must be {rule} {why}")

    def _tables(self) -> list[Table]:
        unit = self.time_unit
        rows = [
            (one.name, one.n_samples, float(one.dt), float(one.duration), float(peak))
            for one, peak in zip(self.records, self.pgas, strict=True)
        ]
        columns = ("record", "samples", f"interval ({unit})", f"duration ({unit})", "PGA (g)")
        return [Table(f"{len(self)} records", columns, rows, digits=4)]


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class ScaledSuite(Shown):
    """Records scaled to a target spectrum; ``RecordSuite.scaled_to`` makes it."""

    suite: RecordSuite
    """The scaled records."""
    factors: np.ndarray
    """Factor of each record, shape (n,)."""
    target: TargetSpectrum
    range: PeriodRange
    """In which the spectra were to meet."""
    periods: np.ndarray
    """Periods at which they were compared, evenly spaced in the logarithm, shape (m,)."""
    accelerations: np.ndarray
    """Spectral acceleration of each scaled record at them, g, shape (n, m)."""
    bounds: tuple[float, float]
    """Of the factors."""

    @property
    def mean(self) -> np.ndarray:
        """Arithmetic mean of the scaled records' spectra, g, shape (m,): that of the codes."""
        return np.asarray(self.accelerations.mean(axis=0))

    @property
    def misfits(self) -> np.ndarray:
        """Root mean square of ln(record / target) over the periods, of each record, shape (n,)."""
        return misfit(np.log(self.accelerations / self.target.at(self.periods)))

    @property
    def misfit(self) -> float:
        """Root mean square of ln(mean spectrum / target) over the periods."""
        return float(misfit(np.log(self.mean / self.target.at(self.periods))))

    @property
    def least_ratio(self) -> float:
        """Smallest ratio of the mean spectrum to the target; codes ask for at least 0.9."""
        return float((self.mean / self.target.at(self.periods)).min())

    @property
    def at_bound(self) -> tuple[str, ...]:
        """Names of the records whose factor is at one of the bounds."""
        low, high = self.bounds
        at = (self.factors <= low * (1 + 1e-12)) | (self.factors >= high * (1 - 1e-12))
        return tuple(name for name, held in zip(self.suite.names, at, strict=True) if held)

    def findings(self) -> list[str]:
        """That factors are at a bound, in words; none if all are within."""
        if not self.at_bound:
            return []
        listed = ", ".join(self.at_bound)
        low, high = self.bounds
        return [f"factors of {listed} are at a bound, {low:g} or {high:g}: they fit less well"]

    def _tables(self) -> list[Table]:
        low, high = self.range
        rows = [
            (name, factor, off, "at a bound" if name in self.at_bound else "")
            for name, factor, off in zip(self.suite.names, self.factors, self.misfits, strict=True)
        ]
        name = f" {self.target.name!r}" if self.target.name else ""
        notes = [
            f"misfit: root mean square of ln(spectrum / target), periods {low:.4g} to {high:.4g}",
            f"mean of the suite: misfit {self.misfit:.4g}, at least {self.least_ratio:.4g} of the "
            "target",
            *self.findings(),
        ]
        columns = ("record", "factor", "misfit", "")
        return [Table(f"Scaled to the target spectrum{name}", columns, rows, notes, digits=4)]


def read_suite(
    folder: str | os.PathLike[str],
    pattern: str = "*.AT2",
    *,
    dt: float | None = None,
    units: str | None = None,
) -> RecordSuite:
    """Read the accelerograms of a folder, in the order of their names.

    Parameters
    ----------
    folder
        The folder; those in it are not searched.
    pattern
        Which files, such as ``"*.csv"`` or ``"RSN*"``; capitals do not matter.
    dt, units
        Of files that do not state theirs, see ``read_record``.

    Returns
    -------
    RecordSuite
        Its records are named after the files.

    Raises
    ------
    ValueError
        If the folder is none, no file fits the pattern, or a file cannot be read as ``read_record``
        says; the message names the file. If two files have one name but for their endings.

    Warns
    -----
    PlausibilityWarning
        As ``read_record``.

    Examples
    --------
    ``jp.read_suite("records")`` reads all AT2 files of a folder,
    ``jp.read_suite("records", "*.csv")`` all CSV files.
    """
    owner, place = "read_suite", Path(folder)
    if not place.is_dir():
        raise ValueError(f"{owner}: folder = {str(folder)!r} must be a folder")
    if not isinstance(pattern, str) or not pattern:
        raise ValueError(f"{owner}: pattern = {pattern!r} must be a pattern such as '*.AT2'")
    files = sorted(path for path in place.iterdir() if path.is_file())
    wanted = [path for path in files if fnmatchcase(path.name.lower(), pattern.lower())]
    if not wanted:
        kinds = ", ".join(sorted({f"*{path.suffix}" for path in files if path.suffix})[:8])
        there = f"it has {kinds}" if kinds else "it is empty"
        raise ValueError(f"{owner}: pattern = {pattern!r} must fit a file in {place}: {there}")
    try:
        return RecordSuite(tuple(read_record(path, dt=dt, units=units) for path in wanted))
    except ValueError as error:
        words = str(error).removeprefix("read_record: ")
        raise ValueError(f"{owner}: {words.replace('RecordSuite: ', f'{place}: ')}") from error


def as_suite(owner: str, records: Any) -> RecordSuite:
    """A suite, or several records as one."""
    if isinstance(records, RecordSuite):
        return records
    if not isinstance(records, Sequence):
        shown = reprlib.repr(records)
        raise ValueError(f"{owner}: records = {shown} must be a RecordSuite or a list of records")
    return RecordSuite(tuple(records))
