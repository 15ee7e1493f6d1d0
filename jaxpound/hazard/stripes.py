"""Multiple stripes: how often a demand is reached at each of several intensities."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from os import PathLike
from typing import Any

import numpy as np
from jaxtyping import ArrayLike

from jaxpound._errors import InvalidInput, resumable
from jaxpound._tables import Shown, TextTable
from jaxpound.buildings import Buildings
from jaxpound.grid import TimeGrid
from jaxpound.ground.record import Record, derived
from jaxpound.ground.suite import RecordSuite, as_suite
from jaxpound.hazard.suite_runs import Analysis, SuiteRuns, rising_intensities
from jaxpound.model.topology import Topology
from jaxpound.results.named import REQUIRED_GAP, DemandSpec, demand_in_words, event_in_words
from jaxpound.simulation.scheme import Scheme
from jaxpound.study.fragility import Fragility, falls, fit_fragility


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
    topology: Topology | None = None

    @property
    def pounding(self) -> np.ndarray:
        """How many records reach the threshold at each intensity, shape (k,)."""
        return np.array([np.count_nonzero(stripe >= self.threshold) for stripe in self.demands])

    @property
    def trials(self) -> np.ndarray:
        """Number of records at each intensity, shape (k,)."""
        return np.array([stripe.size for stripe in self.demands])

    def fragility(self) -> Fragility:
        """``fit_fragility`` of the counts (Baker 2015, eq. 11), with its errors and warning."""
        curve = fit_fragility(self.intensities, self.pounding, self.trials, measure=self.measure)
        event = event_in_words(self.demand, self.threshold, True, self.topology)
        return dataclasses.replace(curve, event=event)

    def _tables(self) -> list[TextTable]:
        data = zip(self.intensities, self.trials, self.pounding, self.demands, strict=True)
        rows = [(f"{im:.4g}", int(n), int(k), float(np.median(x))) for im, n, k, x in data]
        words = demand_in_words(self.demand, self.topology)
        columns = (self.measure, "records", "reach the threshold", f"median {words}")
        notes = [f"threshold {self.threshold:.4g}"]
        if fall := falls(self.intensities, self.pounding, self.trials):
            notes.append(f"demands return below it: {fall}")
        return [TextTable("Multiple stripes", columns, rows, notes, digits=4)]


@resumable("store")
def multiple_stripes(
    structures: Buildings,
    records: Any,
    grid: TimeGrid | None = None,
    *,
    intensities: ArrayLike,
    measure: Any = "pga",
    demand: DemandSpec = REQUIRED_GAP,
    threshold: float | None = None,
    scheme: Scheme = Scheme(),
    strict: bool = False,
    store: str | PathLike[str] | None = None,
    progress: bool = True,
) -> Stripes:
    """The demands of records scaled to each of several intensities.

    Its ``fragility()`` is fitted to the counts. Raises ``ValueError`` as
    ``incremental_dynamic_analysis``; if the numbers of suites and intensities differ.

    Parameters
    ----------
    records, intensities
        A suite for all intensities > 0, rising, shape (k,), or a list with one for each of them.
    structures, grid, measure, demand, threshold, scheme, strict, store, progress
        As of ``incremental_dynamic_analysis``; ``measure`` of several suites is "pga" or a period.
    """
    levels = rising_intensities(intensities)
    several = isinstance(records, Sequence) and all(isinstance(x, RecordSuite) for x in records)
    suites = [*records] if several else [as_suite(records)] * levels.size
    if len(suites) != levels.size:
        rule = f"must be {levels.size}, one an intensity"
        raise InvalidInput(f"{len(suites)} suites", "", rule)
    sizes = [len(suite) for suite in suites]
    numbers: dict[int, int] = {}
    different: dict[str, Record] = {}  # each with a name of its own
    for record in itertools.chain(*suites):
        if id(record) not in numbers:
            numbers[id(record)], name = len(different), record.name
            while name in different:
                name += ", another"
            same = {"doubts": record.doubts, "measured": record.measured}
            different[name] = derived(record.samples, record.dt, name, record.time_unit, **same)
    rows = np.array([numbers[id(record)] for record in itertools.chain(*suites)])
    at, highest = np.repeat(levels, sizes), np.zeros(len(different))
    np.maximum.at(highest, rows, at)
    options = grid, measure, demand, threshold, scheme, strict, highest
    analysis = Analysis(structures, RecordSuite(tuple(different.values())), *options)
    runs = SuiteRuns(analysis, store, progress)
    with runs.bar:
        demands, _ = runs.run(rows, at)
    return Stripes(levels, tuple(np.split(demands, np.cumsum(sizes)[:-1])), *analysis.about)
