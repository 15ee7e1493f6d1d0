"""Incremental dynamic analysis: records that are scaled until a demand is reached."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from os import PathLike
from typing import Any

import numpy as np
from jaxtyping import ArrayLike

from jaxpound._checks import Rule, enforce, hint, number
from jaxpound._tables import Shown, Table
from jaxpound.grid import TimeGrid
from jaxpound.model.system import Structures
from jaxpound.risk.capacities import CapacityFragility, fit_capacities
from jaxpound.risk.crossings import REFINEMENTS, Brackets
from jaxpound.risk.demanded import REQUIRED_GAP, Demanded
from jaxpound.risk.shaking import levels
from jaxpound.risk.stripes import Stripes
from jaxpound.risk.suite_runs import Asked, SuiteRuns, demand_in_words
from jaxpound.simulation.scheme import Scheme
from jaxpound.units import Scales

FRACTILES = (0.16, 0.5, 0.84)
"""Shares of the records by which practice sums up the curves: the median and about ±β."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class IncrementalDynamicAnalysis(Shown):
    """Demands of each record over intensity, and the intensity at which each reaches a threshold.

    ``incremental_dynamic_analysis`` makes it.
    """

    names: tuple[str, ...]
    """Of the records."""
    unscaled: np.ndarray
    """Intensity of each record as it is, shape (n,)."""
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
    si: bool
    """Whether demands are in SI units."""

    @property
    def factors(self) -> np.ndarray:
        """Factor of each record, as it is, at which it first reaches the threshold, shape (n,)."""
        return self.capacities / self.unscaled

    @property
    def stripes(self) -> Stripes:
        """The demands by intensity, for ``fit_fragility``."""
        demands = tuple(self.demands.T)
        return Stripes(
            self.intensities, demands, self.threshold, self.demand, self.measure, self.si
        )

    @property
    def returning(self) -> tuple[str, ...]:
        """Names of the records that fall below the threshold again as they are scaled up."""
        reached = self.demands >= self.threshold
        after = np.maximum.accumulate(reached, axis=1)
        back = np.flatnonzero((after & ~reached).any(axis=1))
        return tuple(self.names[i] for i in back)

    def fractiles(self, shares: Sequence[float] = FRACTILES) -> np.ndarray:
        """Demands that so many of the records do not exceed at each intensity, shape (m, k).

        ``shares`` are m numbers from 0 to 1.
        """
        return np.quantile(self.demands, shares, axis=0)

    def fragility(self) -> CapacityFragility:
        """Lognormal fragility from the capacities, ``fit_capacities``.

        Raises
        ------
        ValueError
            If fewer than two records reach the threshold, or all at one intensity.
        """
        return fit_capacities(self.capacities, self.intensities[-1], measure=self.measure)

    def _tables(self) -> list[Table]:
        above = f"above {self.intensities[-1]:.4g}"
        rows = [
            (name, float(im), *((float(c), float(f)) if np.isfinite(c) else (above, "-")))
            for name, im, c, f in zip(
                self.names, self.unscaled, self.capacities, self.factors, strict=True
            )
        ]
        words = demand_in_words(self.demand, self.si)
        n, known = len(rows), int(np.isfinite(self.capacities).sum())
        notes = [
            f"intensity: {self.measure}; demand: {words}, threshold {self.threshold:.4g}",
            f"{known} of {n} records reach it; a capacity is the first crossing on the ladder of "
            f"{len(self.intensities)} intensities, refined",
        ]
        if self.returning:
            notes.append(f"below it again at higher intensities: {', '.join(self.returning)}")
        columns = ("record", "intensity as it is", "capacity", "factor")
        return [Table("Incremental dynamic analysis", columns, rows, notes, digits=4)]


def incremental_dynamic_analysis(
    structures: Structures,
    records: Any,
    grid: TimeGrid | None = None,
    *,
    intensities: ArrayLike,
    measure: Any = "pga",
    demand: Demanded = REQUIRED_GAP,
    threshold: float | None = None,
    refine: str = "bisection",
    tolerance: float = 1e-3,
    scales: Scales | None = None,
    scheme: Scheme = Scheme(),
    strict: bool = False,
    store: str | PathLike[str] | None = None,
    progress: bool = True,
) -> IncrementalDynamicAnalysis:
    """Demands of records that are scaled up step by step (Vamvatsikos and Cornell 2002).

    All records are run at all intensities in one batch. For each record the first pair of
    neighbouring intensities between which the demand reaches the threshold is then narrowed down.
    A demand need not grow with the intensity: what is found is this first crossing on the ladder of
    intensities, and one between two rungs, from which the demand returns before the next, is
    missed. ``returning`` names the records that are below the threshold again further up.

    Parameters
    ----------
    structures
        Dimensionless structures, as ``simulate`` takes them; buildings in SI units through
        ``dimensionless`` or ``dimensionless_row``, which also give the scales.
    records
        A ``RecordSuite`` or several records: in seconds with ``scales``, else in units of 1/ω1.
    grid
        The instants of all runs; by default, for buildings with scales, as long as the longest
        record, its step chosen for the one with the shortest interval.
    intensities
        The ladder, rising, > 0, shape (k,).
    measure
        What intensity is: "pga" (in g); a natural period, in s with scales or else in 1/ω1, for the
        spectral acceleration at 5 % of damping (in g); or the intensity of each record as it is,
        shape (n,) (ones make it the factor). It must be proportional to the record's factor.
    demand
        The flat name of a scalar of ``Demand`` (``"peak_contact"``, ``"peak_drift_2"``), of one
        over all storeys (``"peak_drift"``), ``"required_gap"``, the largest closing of any link, or
        a function of a run's ``Demand`` that JAX can trace. For gaps, runs leave laws of contact
        out: whether blocks meet is the same with and without one.
    threshold
        The demand is reached if it is at least that; in SI units with scales. None, for the
        required gap only, is pounding: the gap at rest of all links. Where they differ, the demand
        is the overlap, the largest −ξ of any link, and the threshold 0.
    refine
        "bisection", with as many points in each bracket as fill the batch, or "newton", with the
        derivative by the intensity: fewer runs, and another program to compile.
    tolerance
        Width of the last bracket, or size of the last step of Newton's method, over the capacity.
    scales
        Units of the structures, if results are to be in SI units.
    scheme
        The discretisation.
    strict
        Whether a ``PlausibilityWarning`` is raised as a ``ValueError``.
    store
        A folder that keeps finished runs, by record and factor: the same call goes on from there
        after it was stopped, and ends as if it had not been interrupted. So does one with other
        intensities, another measure, threshold, ``refine`` or ``tolerance``, which runs only what
        is missing. Damaged files are named in a warning, and their runs made anew.
    progress
        Whether to show a progress bar with the runs done, and in the refinement with the number of
        records done and the widest bracket.

    Returns
    -------
    IncrementalDynamicAnalysis
        Its ``fragility()`` has the median and dispersion of the capacities.

    Raises
    ------
    ValueError
        If an argument breaks its rule; if records are not in the structures' unit of time, or
        together need too many steps; if the demand is unknown, or a record reaches the threshold
        without shaking. If the store holds another analysis, with what differs.
    FloatingPointError
        If a run ends in numbers that are not finite; the message names record and intensity.
    OSError
        If the store cannot be written to.

    Warns
    -----
    PlausibilityWarning
        If the grid does not resolve a record, or a scaled record has a PGA above 5 g.

    Examples
    --------
    >>> left = jp.Building.from_period(mass=500e3, period=0.9, damping_ratio=0.05)
    >>> right = jp.Building.from_period(mass=400e3, period=0.6, damping_ratio=0.05)
    >>> pair, scales = jp.dimensionless(left, right, friction_force=0.0, gap=0.05)
    >>> t = 0.02 * np.arange(300)
    >>> burst = [0.1 * np.sin(w * t) * np.exp(-((t - 3) ** 2)) for w in (7.0, 9.0, 11.0)]
    >>> suite = jp.RecordSuite([jp.Record(a, dt=0.02) for a in burst])
    >>> found = jp.incremental_dynamic_analysis(
    ...     pair, suite, scales=scales, intensities=[0.1, 0.2, 0.4, 0.8], progress=False
    ... )
    >>> [round(float(x), 3) for x in found.capacities]  # g
    [0.061, 0.066, 0.108]
    >>> curve = found.fragility()
    >>> round(curve.median, 3), round(curve.dispersion, 3)
    (0.076, 0.308)
    """
    owner = "incremental_dynamic_analysis"
    ladder = levels(owner, intensities)
    if refine not in REFINEMENTS:
        raise ValueError(f"{owner}: unknown refine = {refine!r}; {hint(refine, REFINEMENTS)}")
    tolerance = float(number(owner, "tolerance", tolerance))
    rule = "from 1e-9 to below 1"
    enforce(owner, [Rule("tolerance", tolerance, 1e-9 <= tolerance < 1, rule)])
    asked = Asked(
        *(structures, records, grid, measure, demand, threshold, scales, scheme, strict),
        *(store, progress),
    )
    runs = SuiteRuns.of(owner, asked, ladder[-1])
    n, rungs = len(runs.suite), np.append(0.0, ladder)
    with runs.bar:
        found = runs.demands(np.repeat(np.arange(n), rungs.size), np.tile(rungs, n)).reshape(n, -1)
        excess = found - runs.threshold
        if (excess[:, 0] >= 0).any():
            rule = f"above {found[:, 0].max():.6g}, what the demand is without shaking"
            raise ValueError(f"{owner}: threshold = {runs.threshold:.6g} must be {rule}")
        brackets = Brackets.of(rungs, excess)

        def told(which: np.ndarray) -> None:
            done, widest = n - np.unique(which).size, brackets.width()[which].max()
            runs.bar.set_postfix_str(f"{done} of {n} records, brackets within {widest:.2g}")

        telling = dataclasses.replace(runs, told=told)
        capacities = REFINEMENTS[refine](telling, brackets, tolerance, found.size)
        runs.bar.set_postfix_str(f"{n} of {n} records")
    return IncrementalDynamicAnalysis(
        runs.suite.names,
        runs.intensity.unscaled,
        ladder,
        found[:, 1:],
        capacities,
        runs.threshold,
        runs.demand,
        runs.intensity.words,
        runs.si,
    )
