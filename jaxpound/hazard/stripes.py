"""Multiple stripes: how often a demand is reached at each of several intensities."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from os import PathLike

import numpy as np
from jaxtyping import ArrayLike

from jaxpound._checks import instance
from jaxpound._errors import InvalidInput, resumable
from jaxpound._tables import Shown, TextTable
from jaxpound.hazard.analysis import Analysis, SuiteRuns, rising_intensities
from jaxpound.model.topology import Topology
from jaxpound.results.named import demand_in_words, event_in_words
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
    analysis: Analysis,
    intensities: ArrayLike | Sequence[float],
    *,
    store: str | PathLike[str] | None = None,
    progress: bool = True,
) -> Stripes:
    """The demands of records scaled to each of several intensities, > 0, rising, shape (k,).

    The analysis has one suite of records for all intensities, or a list with one for each. The
    result's ``fragility()`` is fitted to the counts. ``store`` and ``progress`` are as of
    ``incremental_dynamic_analysis``, and so are errors; it also raises ``ValueError`` if the
    numbers of suites and intensities differ.
    """
    instance("analysis", analysis, Analysis)
    levels = rising_intensities(intensities)
    numbers = analysis.numbers * levels.size if len(analysis.numbers) == 1 else analysis.numbers
    if len(numbers) != levels.size:
        raise InvalidInput(f"{len(numbers)} suites", "", f"must be {levels.size}, one an intensity")
    sizes = [len(suite) for suite in numbers]
    rows, at = np.concatenate(numbers), np.repeat(levels, sizes)
    highest = np.zeros(len(analysis.suite))
    np.maximum.at(highest, rows, at)
    runs = SuiteRuns(analysis, highest, store, progress)
    with runs.bar:
        demands = runs.run(rows, at)
    return Stripes(levels, tuple(np.split(demands, np.cumsum(sizes)[:-1])), *analysis.about)
