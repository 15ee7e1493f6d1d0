"""Suites: several recorded accelerograms of one site or one hazard."""

from __future__ import annotations

import dataclasses
import os
import re
import reprlib
from collections.abc import Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import ArrayLike

from jaxpound import _checks
from jaxpound._checks import count, instance, is_traced, positive, positive_number, require_one_of
from jaxpound._errors import InvalidInput, renamed, warn
from jaxpound._tables import Shown, TextTable
from jaxpound.ground.formats.text import MisreadError, OtherKindError
from jaxpound.ground.intensity import spectra
from jaxpound.ground.reader import read_components
from jaxpound.ground.record import Record, require_records
from jaxpound.ground.stations import pairs_of
from jaxpound.ground.target import (
    PeriodRange,
    ScaledSuite,
    TargetSpectrum,
    fitted_factors,
    positive_pair,
)

PERIODS = 100  # number of those at which spectra are compared with a target
_NO_RECORD = re.compile(  # names of files beside the records
    r"(readme|licen[cs]e|copying|thumbs\.db|_searchres).*|.*\.(md|rst|py|m|ipynb|toml|ya?ml|log)",
    re.I,
)


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class RecordSuite(Shown):
    """Recorded accelerograms that are used together, of any lengths and sample intervals.

    A record without a name gets its number: "record 3". ``stations`` has the names of the records
    by the name of their station, in order; without it, each record is a station of its own.
    Raises ``ValueError`` if there is no record, or one is no ``Record``, a batch, traced or zero
    throughout; if names are equal, units of time differ, or stations do not have each record once.

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
    stations: Mapping[str, Sequence[str]] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        members = self.records
        require_records(members, Sequence)
        for i, record in enumerate(members):
            name = f"records[{i}]"
            if is_traced(record) or np.ndim(record.samples) != 1:
                raise InvalidInput(name, repr(record), "must be known, and one alone")
            if not np.any(record.samples):
                raise InvalidInput(name, repr(record), "must move: all are zero")
        records = tuple(
            record if record.name else record._with(record.samples, name=f"record {i}")
            for i, record in enumerate(members, 1)
        )
        object.__setattr__(self, "records", records)
        if repeated := [name for name in self.names if self.names.count(name) > 1]:
            raise InvalidInput("name", repr(repeated[0]), "must be that of one record only")
        stations = self.stations or {name: (name,) for name in self.names}
        stations = {station: tuple(names) for station, names in stations.items()}
        if sorted(x for names in stations.values() for x in names) != sorted(self.names):
            rule = f"must have each of the records once: {', '.join(self.names)}"
            raise InvalidInput("stations", reprlib.repr(stations), rule)
        object.__setattr__(self, "stations", stations)

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
            require_one_of(key, self.names, "name")
            return self.records[self.names.index(key)]
        return self.records[key]

    def chosen(self, which: Sequence[int | str] | np.ndarray) -> RecordSuite:
        """The suite of some of the records and their stations, by numbers from 0 or by names.

        Raises ``ValueError`` if there is no such record, none is chosen, or one is chosen twice.
        """
        n, records = len(self), []
        for key in which:
            if not isinstance(key, str) and not (_checks.is_whole(key) and -n <= key < n):
                rule = f"must be a record's number, from 0 to {n - 1}, or its name"
                raise InvalidInput(repr(key), "", rule)
            records.append(self[key])
        left = {record.name for record in records}
        stations = {x: [*filter(left.__contains__, names)] for x, names in self.stations.items()}
        return RecordSuite(tuple(records), {x: names for x, names in stations.items() if names})

    def spectra(self, periods: ArrayLike, damping: float = 0.05) -> np.ndarray:
        """``spectral_acceleration`` of each record at each period, g, shape (n, m).

        ``periods`` > 0 have the shape (m,) and the records' unit of time; ``damping`` is at least 0
        and below 1. Raises ``ValueError`` for others.
        """
        return spectra(self.records, periods, damping)

    def scaled(self, factors: ArrayLike) -> RecordSuite:
        """Each record times its factor > 0, shape (n,), or times one number."""
        factors = _checks.array("factors", factors, (), (len(self),))
        (valid,) = positive(factors=factors)
        each = zip(self.records, np.broadcast_to(valid, len(self)), strict=True)
        return RecordSuite(tuple(x._with(x.samples * k) for x, k in each), self.stations)

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
        >>> waves = [0.2 * np.sin(w * 0.02 * np.arange(628)) for w in (4.0, 7.0, 11.0)]
        >>> suite = jp.RecordSuite([jp.Record(wave, 0.02) for wave in waves])
        >>> target = jp.ground.TargetSpectrum([0.1, 0.5, 2.0], [0.5, 0.5, 0.125])
        >>> scaled = suite.scaled_to(target, (0.3, 1.5), best=2, least=0.9)
        >>> scaled.suite.names, round(scaled.least_ratio, 3)
        (('record 2', 'record 3'), 0.9)
        """
        instance("target", target, TargetSpectrum)
        span, bounds = PeriodRange.of(periods), positive_pair("factors", factors, "bounds")
        if best is not None and count("best", best) > len(self):
            raise InvalidInput("best", str(best), f"must be at most {len(self)}, all records")
        if least is not None:
            positive_number(least=least)
        for record in self.records:
            low, high = 2 * float(record.dt), float(record.duration)
            if span.low < low * (1 - 1e-9) or span.high > high * (1 + 1e-9):
                stated = f"{span.low:.4g} to {span.high:.4g} {self.time_unit}"
                limits = f"{low:.4g} to {high:.4g} (two sample intervals, its duration)"
                rule = f"must be within what {record.name!r} holds, {limits}"
                raise InvalidInput("periods", stated, rule)
        periods_at = np.geomspace(*span, PERIODS)
        with renamed():
            ordinates = target.at(periods_at)
        unscaled = self.spectra(periods_at, target.damping)
        selected, fitted = fitted_factors(ordinates / unscaled, bounds, best, least)
        suite, at = self.chosen(selected).scaled(fitted), fitted[:, None] * unscaled[selected]
        scaled = ScaledSuite(suite, fitted, target, span, periods_at, at, bounds)
        warn(scaled.findings(), strict)
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
    pattern: str = "*",
    *,
    dt: float | None = None,
    units: str | None = None,
    component: Literal["both", "larger", 1, 2] = "both",
    rows: str | None = None,
    strict: bool = False,
) -> RecordSuite:
    """Read the horizontal accelerograms of a folder, in any format that ``read_record`` reads.

    Records are in the order of the files and have their names, with the extension where two files
    have the same name, and with that of the component where a file has several. Folders in it,
    hidden files, vertical components, velocities, spectra, tables of a search, texts, pictures and
    archives are left out. A station is the two components of a file, or two files whose names
    differ in directions at right angles: azimuths (``ELC180``, ``ELC270``), axes (``_N``, ``_E``;
    ``FN``, ``FP``; ``_H1``, ``_H2``), SEED channels (``HNE``, ``HNN``) or K-NET's extensions. All
    others are stations of their own, also where more than two go together.

    Raises ``ValueError`` if there is no such folder, no file fits the pattern or has horizontal
    accelerations, an argument breaks its rule, or ``read_record`` refuses a file, which the message
    names. Warns (``PlausibilityWarning``) of what is left out and why, of files with more than two
    components, and as ``read_record``.

    Parameters
    ----------
    folder, pattern
        The folder, and which of its files are read, such as ``"*.csv"``, regardless of case.
    dt, units, rows, strict
        As in ``read_record``, for all files.
    component
        "both"; "larger", that of larger PGA of each station; or 1 or 2, the first or second of each
        station in the order of the records: an error if a station has one alone.
    """
    if component not in ("both", "larger", 1, 2) or isinstance(component, bool | float):
        raise InvalidInput("component", repr(component), "must be 'both', 'larger', 1 or 2")
    if not (place := Path(folder)).is_dir():
        raise InvalidInput("folder", repr(str(folder)), "must be a folder")
    if not isinstance(pattern, str) or not pattern:
        raise InvalidInput("pattern", repr(pattern), "must be a pattern such as '*.AT2'")
    paths = sorted(x for x in place.iterdir() if x.is_file() and not x.name.startswith("."))
    matching = [path for path in paths if fnmatchcase(path.name.lower(), pattern.lower())]
    if not matching:
        kinds = ", ".join(sorted({f"*{path.suffix}" for path in paths if path.suffix})[:8])
        content = f"it has {kinds}" if kinds else "it is empty"
        raise InvalidInput("pattern", repr(pattern), f"must fit a file in {place}: {content}")
    options = {"dt": dt, "units": units, "rows": rows, "strict": strict}
    files, left_out = _read_files(matching, **options)
    if not files:
        rule = f"must hold a horizontal acceleration, but has {left_out} only"
        raise InvalidInput("folder", repr(str(folder)), rule)
    findings = [f"{place}: left out are {left_out}"] if left_out else []
    for name, records in files.items():
        if len(records) > 2:
            words = f"none of its {len(records)} components, each a station, is said to be vertical"
            findings.append(f"{place / name}: {words}")
    warn(findings, strict)
    with renamed(str(place)):
        suite = _suite_of(files)
    return suite if component == "both" else _of_component(suite, component)


def _read_files(paths: Sequence[Path], **options: Any) -> tuple[dict[str, list[Record]], str]:
    """Horizontal components by the names of their files, and which files have none, and why."""
    files: dict[str, list[Record]] = {}
    others: dict[str, list[str]] = {}
    for path in paths:
        try:
            if _NO_RECORD.fullmatch(path.name):
                raise OtherKindError(None, "by the name no record")
            with renamed():
                files[path.name], names = read_components(path, **options)
            for name in names:
                others.setdefault(f"components {name}", []).append(path.name)
        except OtherKindError as error:
            words = error.message.rpartition(", but ")[2]
            reason = words.removeprefix("is ").partition(": ")[0]
            others.setdefault(reason, []).append(path.name)
        except MisreadError as error:
            raise InvalidInput("", "", str(error)) from error
    for names in others.values():
        names[3:] = [f"{len(names) - 3} more"] if names[3:] else []
    return files, "; ".join(f"{', '.join(names)}: {why}" for why, names in others.items())


def _suite_of(files: Mapping[str, list[Record]]) -> RecordSuite:
    """The suite of the records of files, with their stations and with names that differ."""
    stems = [Path(file).stem for file in files]
    pairs = pairs_of([file for file, records in files.items() if len(records) == 1])
    collected, stations = list[Record](), dict[str, list[str]]()
    for (file, records), stem in zip(files.items(), stems, strict=True):
        label = stem if stems.count(stem) == 1 else f"{stem} {Path(file).suffix[1:]}".rstrip()
        for record in records:
            name = label + record.name.removeprefix(stem)
            station = pairs.get(file, label if len(records) == 2 else name)
            stations.setdefault(station, []).append(name)
            collected.append(record._with(record.samples, name=name))
    return RecordSuite(tuple(collected), stations)


def _of_component(suite: RecordSuite, component: Literal["larger", 1, 2]) -> RecordSuite:
    """The suite of one component of each station."""
    if component == "larger":
        peak = dict(zip(suite.names, suite.pgas, strict=True)).__getitem__
        return suite.chosen([max(names, key=peak) for names in suite.stations.values()])
    for station, names in suite.stations.items():
        if len(names) < component:
            rule = f"must be there in each station: {station!r} has {names[0]!r} alone"
            raise InvalidInput("component", str(component), rule)
    return suite.chosen([names[component - 1] for names in suite.stations.values()])


def as_suite(records: Any) -> RecordSuite:
    """A suite, or several records as a suite."""
    if isinstance(records, RecordSuite):
        return records
    if not isinstance(records, Sequence) or isinstance(records, str):
        rule = "must be a RecordSuite or a list of records; read_suite reads those of a folder"
        raise InvalidInput("records", reprlib.repr(records), rule)
    return RecordSuite(tuple(records))
