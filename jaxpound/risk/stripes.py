"""Multiple stripes: how often a demand is reached at each of several intensities."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from os import PathLike
from typing import Any

import numpy as np
from jaxtyping import ArrayLike

from jaxpound._tables import Shown, Table
from jaxpound.grid import TimeGrid
from jaxpound.ground.record import Record, derived
from jaxpound.ground.suite import RecordSuite, as_suite
from jaxpound.model.system import Structures
from jaxpound.risk.demanded import REQUIRED_GAP, Demanded
from jaxpound.risk.shaking import levels
from jaxpound.risk.suite_runs import Asked, SuiteRuns, demand_in_words
from jaxpound.simulation.scheme import Scheme
from jaxpound.study.fragility import Fragility, falls, fit_fragility
from jaxpound.units import Scales


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Stripes(Shown):
    """Demands of records at several intensities; ``multiple_stripes`` makes it."""

    intensities: np.ndarray
    """Rising, shape (k,)."""
    demands: tuple[np.ndarray, ...]
    """Demands of the records at each intensity, k arrays of shape (n,)."""
    threshold: float
    demand: str = "demand"
    """Name of the demand."""
    measure: str = "intensity"
    """The measure of intensity, with its unit."""
    si: bool = False
    """Whether demands are in SI units."""

    @property
    def pounding(self) -> np.ndarray:
        """How many records reach the threshold at each intensity, shape (k,)."""
        return np.array([np.count_nonzero(one >= self.threshold) for one in self.demands])

    @property
    def trials(self) -> np.ndarray:
        """Number of records at each intensity, shape (k,)."""
        return np.array([one.size for one in self.demands])

    def fragility(self) -> Fragility:
        """``fit_fragility`` of the counts (Baker 2015, eq. 11).

        Raises
        ------
        ValueError
            If the likelihood has no maximum, as ``fit_fragility`` says.

        Warns
        -----
        PlausibilityWarning
            If demands return: fewer records reach the threshold at an intensity than at a lower one
            by more than chance.
        """
        counts = self.pounding, self.trials
        return fit_fragility(self.intensities, *counts, measure=self.measure)

    def _tables(self) -> list[Table]:
        rows = [
            (f"{im:.4g}", int(n), int(k), float(np.median(one)))
            for im, n, k, one in zip(
                self.intensities, self.trials, self.pounding, self.demands, strict=True
            )
        ]
        words = demand_in_words(self.demand, self.si)
        columns = (self.measure, "records", "reach the threshold", f"median {words}")
        notes = [f"threshold {self.threshold:.4g}"]
        if fall := falls(self.intensities, self.pounding, self.trials):
            notes.append(f"demands return below it: {fall}")
        return [Table("Multiple stripes", columns, rows, notes, digits=4)]


def _together(
    suites: Sequence[RecordSuite], at: np.ndarray
) -> tuple[tuple[Record, ...], list[np.ndarray]]:
    """All records of several suites, those that they share once, and the numbers of each suite's.

    A record may have the name of another one, as one that is scaled to several targets has.
    """
    numbers: dict[int, int] = {}
    every: dict[str, Record] = {}
    for suite, level in zip(suites, at, strict=True):
        for record in suite:
            if id(record) not in numbers:
                numbers[id(record)] = len(every)
                name = f"{record.name} at {level:g}" if record.name in every else record.name
                while name in every:
                    name += ", another"
                every[name] = derived(record.samples, record.dt, name, record.time_unit)
    return tuple(every.values()), [np.array([numbers[id(one)] for one in x]) for x in suites]


def multiple_stripes(
    structures: Structures,
    records: Any,
    grid: TimeGrid | None = None,
    *,
    intensities: ArrayLike,
    measure: Any = "pga",
    demand: Demanded = REQUIRED_GAP,
    threshold: float | None = None,
    scales: Scales | None = None,
    scheme: Scheme = Scheme(),
    strict: bool = False,
    store: str | PathLike[str] | None = None,
    progress: bool = True,
) -> Stripes:
    """The demands of records scaled to each of several intensities.

    Parameters
    ----------
    records
        A suite for all intensities, or a list with a suite for each of them: stronger shaking may
        have other records.
    intensities
        Intensities > 0, rising, shape (k,).
    structures, grid, measure, demand, threshold, scales, scheme, strict, store, progress
        As of ``incremental_dynamic_analysis``; ``measure`` is "pga" or a period where there are
        several suites.

    Returns
    -------
    Stripes
        Its ``fragility()`` is fitted to the counts.

    Raises
    ------
    ValueError
        As ``incremental_dynamic_analysis``; if there is another number of suites than of
        intensities.
    """
    owner = "multiple_stripes"
    at = levels(owner, intensities)
    several = isinstance(records, Sequence) and all(isinstance(x, RecordSuite) for x in records)
    suites = [*records] if several else [as_suite(owner, records)] * at.size
    if len(suites) != at.size:
        raise ValueError(f"{owner}: {len(suites)} suites must be {at.size}, one an intensity")
    every, which = _together(suites, at)
    highest = np.zeros(len(every))
    for rows, level in zip(which, at, strict=True):
        highest[rows] = level
    asked = Asked(
        *(structures, every, grid, measure, demand, threshold, scales, scheme, strict),
        *(store, progress),
    )
    runs = SuiteRuns.of(owner, asked, highest)
    sizes = [rows.size for rows in which]
    with runs.bar:
        found = runs.demands(np.concatenate(which), np.repeat(at, sizes))
    parts = np.split(found, np.cumsum(sizes)[:-1])
    return Stripes(at, tuple(parts), runs.threshold, runs.demand, runs.intensity.words, runs.si)
