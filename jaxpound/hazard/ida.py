"""Incremental dynamic analysis: records that are scaled until a demand reaches its threshold."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from os import PathLike
from typing import Any

import numpy as np
from jaxtyping import ArrayLike, Float

from jaxpound._checks import Rule, enforce, number
from jaxpound._errors import InvalidInput, resumable
from jaxpound._tables import Shown, TextTable
from jaxpound.hazard.analysis import Analysis, SuiteRuns, rising_intensities, single_suite
from jaxpound.hazard.capacities import fit_capacities
from jaxpound.hazard.stripes import Stripes
from jaxpound.model.topology import Topology
from jaxpound.results.named import demand_in_words, event_in_words
from jaxpound.study.fragility import Fragility

FRACTILES = (0.16, 0.5, 0.84)  # shares of the records: the median and about ±β


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class IncrementalDynamicAnalysis(Shown):
    """Demands of records over intensity, and capacities, by ``incremental_dynamic_analysis``."""

    names: tuple[str, ...]
    """Of the records."""
    unscaled: np.ndarray
    """Intensity of each unscaled record, shape (n,)."""
    intensities: np.ndarray
    """To which all records were scaled, shape (k,)."""
    demands: np.ndarray
    """Demand of each record at each intensity, shape (n, k)."""
    capacities: np.ndarray
    """Intensity at which each record first reaches the threshold, shape (n,); infinite where none
    does."""
    threshold: float
    """In the unit of the demand."""
    demand: str
    """Name of the demand."""
    measure: str
    """The measure of intensity, with its unit."""
    topology: Topology | None = None

    @property
    def factors(self) -> np.ndarray:
        """Factor at which each unscaled record first reaches the threshold, shape (n,)."""
        return self.capacities / self.unscaled

    @property
    def stripes(self) -> Stripes:
        """The demands by intensity, for ``fit_fragility``."""
        about = self.threshold, self.demand, self.measure, self.topology
        return Stripes(self.intensities, tuple(self.demands.T), *about)

    @property
    def returning(self) -> tuple[str, ...]:
        """Names of the records that fall below the threshold again as they are scaled up."""
        reached = self.demands >= self.threshold
        back = (np.maximum.accumulate(reached, axis=1) & ~reached).any(axis=1)
        return tuple(np.array(self.names, object)[back])

    def fractiles(self) -> np.ndarray:
        """16, 50 and 84 % quantiles of the demands at each intensity, shape (3, k)."""
        return np.quantile(self.demands, FRACTILES, axis=0)

    def fragility(self) -> Fragility:
        """Lognormal fragility from the capacities, by ``fit_capacities``, with its errors."""
        curve = fit_capacities(self.capacities, self.intensities[-1], measure=self.measure)
        event = event_in_words(self.demand, self.threshold, True, self.topology)
        return dataclasses.replace(curve, event=event)

    def _tables(self) -> list[TextTable]:
        above = f"above {self.intensities[-1]:.4g}"
        numbers = np.stack([self.unscaled, self.capacities, self.factors], axis=1).tolist()
        rows = [
            (name, im, *((c, factor) if np.isfinite(c) else (above, "-")))
            for name, (im, c, factor) in zip(self.names, numbers, strict=True)
        ]
        words = demand_in_words(self.demand, self.topology)
        n, reached = len(rows), int(np.isfinite(self.capacities).sum())
        capacity = f"first crossing on the ladder of {len(self.intensities)} intensities, refined"
        notes = [f"intensity: {self.measure}; demand: {words}, threshold {self.threshold:.4g}"]
        notes.append(f"{reached} of {n} records reach it; a capacity is the {capacity}")
        if self.returning:
            notes.append(f"below it again at higher intensities: {', '.join(self.returning)}")
        columns = ("record", "intensity as it is", "capacity", "factor")
        return [TextTable("Incremental dynamic analysis", columns, rows, notes, digits=4)]


@resumable("store")
def incremental_dynamic_analysis(
    analysis: Analysis,
    intensities: ArrayLike | Sequence[float],
    *,
    tolerance: float = 1e-3,
    store: str | PathLike[str] | None = None,
    progress: bool = True,
) -> IncrementalDynamicAnalysis:
    """Demands of records that are scaled up step by step (Vamvatsikos and Cornell 2002).

    All records are run at all intensities in one batch. For each record the first pair of
    neighbouring intensities between which the demand reaches the threshold is then narrowed down,
    by bisection with as many points in each bracket as fill the batch.
    A demand need not grow with the intensity: a crossing between two neighbouring intensities from
    which the demand returns is missed. ``returning`` names the records whose demands are below the
    threshold again at higher intensities; ``fragility()`` is that of the capacities.

    Parameters
    ----------
    analysis
        Buildings, records of one suite, and the demand with its threshold.
    intensities
        Intensities > 0, rising, shape (k,).
    tolerance
        Width of the last bracket over the capacity.
    store
        A folder that keeps finished runs, by record and factor: after an interruption the same call
        continues from them, and its result is the same. A call with other intensities, or another
        measure, threshold or ``tolerance``, runs only what is missing. It is for one process at a
        time. Damaged files are named in a warning, and their runs are repeated.
    progress
        Whether to show a progress bar.

    Raises
    ------
    ValueError
        If an argument breaks its rule; if the threshold is reached without shaking, or by the
        mainshock alone; if the store holds another analysis, with what differs.
    FloatingPointError
        If a run ends in numbers that are not finite; the message names record and intensity.
    OSError
        If the store cannot be written to.

    Examples
    --------
    >>> left = jp.Building.from_period(mass=500e3, period=0.9, damping_ratio=0.05)
    >>> right = jp.Building.from_period(mass=400e3, period=0.6, damping_ratio=0.05)
    >>> pair = jp.Buildings((left, right), (jp.FloorLink(0, 0, gap=0.05),))
    >>> t = 0.02 * np.arange(300)
    >>> burst = [0.1 * np.sin(w * t) * np.exp(-((t - 3) ** 2)) for w in (7.0, 9.0, 11.0)]
    >>> analysis = jp.Analysis(pair, [jp.Record(a, dt=0.02) for a in burst])
    >>> ida = jp.incremental_dynamic_analysis(analysis, [0.1, 0.2, 0.4, 0.8], progress=False)
    >>> [round(float(x), 3) for x in ida.capacities]  # g
    [0.061, 0.066, 0.108]
    >>> curve = ida.fragility()
    >>> round(curve.median, 3), round(curve.dispersion, 3)
    (0.076, 0.308)
    """
    levels = rising_intensities(intensities)
    tolerance = float(number("tolerance", tolerance))
    enforce([Rule("tolerance", tolerance, 1e-9 <= tolerance < 1, "from 1e-9 to below 1")])
    runs = SuiteRuns(single_suite(analysis), levels[-1], store, progress)
    n, with_zero = len(analysis.suite), np.append(0.0, levels)
    with runs.bar:
        demands = runs.run(np.repeat(np.arange(n), with_zero.size), np.tile(with_zero, n))
        demands = demands.reshape(n, -1)
        excess = demands - runs.threshold
        if (excess[:, 0] >= 0).any():
            without = "without shaking" if analysis.mainshock is None else "after the mainshock"
            rule = f"must be above {demands[:, 0].max():.6g}, what the demand is {without}"
            raise InvalidInput("threshold", f"{runs.threshold:.6g}", rule)
        capacities = by_sections(runs, Brackets.of(with_zero, excess), tolerance, demands.size)
        runs.bar.set_postfix_str(f"{n} of {n} records")
    numbers = analysis.unscaled, levels, demands[:, 1:], capacities
    return IncrementalDynamicAnalysis(analysis.suite.names, *numbers, *analysis.about)


@dataclasses.dataclass
class Brackets:
    """For each record the intensities between which its demand crosses the threshold.

    ``excess`` is the demand at both, less the threshold. A record whose demand never reaches it has
    no bracket: its upper end is infinite.
    """

    ends: Float[np.ndarray, "n 2"]
    excess: Float[np.ndarray, "n 2"]

    @classmethod
    def of(cls, levels: Any, excess: Float[np.ndarray, "n k"]) -> Brackets:
        """Around the first level at which the demand reaches the threshold, but level 0.

        ``levels`` are those of all records, shape (k,), or of each, shape (n, k).
        """
        first = np.maximum((excess >= 0).argmax(axis=1), 1)
        both = first[:, None] + [-1, 0]
        ends = np.take_along_axis(np.broadcast_to(levels, excess.shape), both, axis=1)
        at_ends = np.take_along_axis(excess, both, axis=1)
        ends[at_ends[:, 1] < 0, 1] = np.inf
        return cls(ends, at_ends)

    def chord(self) -> Float[np.ndarray, " n"]:
        """Where the straight line between both ends of a bracket crosses; infinite without one."""
        (low, high), (below, above) = self.ends.T, self.excess.T
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = low - below / (above - below) * (high - low)
        return np.where(np.isfinite(high), crossing, np.inf)

    def width(self) -> Float[np.ndarray, " n"]:
        """Width of each bracket over its upper end; 0 where there is none."""
        low, high = self.ends.T
        return np.where(np.isfinite(high), 1 - low / high, 0.0)


def by_sections(runs: SuiteRuns, brackets: Brackets, tolerance: float, batch: int) -> np.ndarray:
    """Bisection by many points: ``batch`` runs a round, as many as fill a batch of runs."""
    while (wide := np.flatnonzero((width := brackets.width()) > tolerance)).size:
        done = f"{width.size - wide.size} of {width.size} records"
        runs.bar.set_postfix_str(f"{done}, brackets within {width.max():.2g}")
        n = max(1, batch // wide.size)
        low, high = brackets.ends[wide].T[..., None]
        points = low + np.arange(n + 2) / (n + 1) * (high - low)
        inner = runs.run(np.repeat(wide, n), points[:, 1:-1].ravel())
        below, above = brackets.excess[wide].T
        excess = np.column_stack([below, inner.reshape(-1, n) - runs.threshold, above])
        narrower = Brackets.of(points, excess)
        brackets.ends[wide], brackets.excess[wide] = narrower.ends, narrower.excess
    return brackets.chord()
