"""Analyses of buildings under the records of a suite, each record times a factor, and their runs.

A finished run is identified by record and factor, and kept in a store if there is one: an analysis
that was stopped requests the same runs again, and only the missing ones are run.
"""

from __future__ import annotations

import dataclasses
from functools import cached_property, partial
from os import PathLike
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from tqdm.auto import tqdm

from jaxpound._checks import Rule, array, enforce, instance, number, positive, require_memory
from jaxpound._errors import InvalidInput, caller, warn
from jaxpound._xla.batches import in_chunks, runs_at_a_time
from jaxpound.buildings import Buildings
from jaxpound.grid import TimeGrid
from jaxpound.ground.measure import Measure
from jaxpound.ground.plausibility import LARGE_PGA, unseen
from jaxpound.ground.record import Record, stacked
from jaxpound.ground.run_input import require_time_unit
from jaxpound.ground.suite import RecordSuite
from jaxpound.model.system import common_gap, without_contact
from jaxpound.results import named
from jaxpound.results.named import OVERLAP, REQUIRED_GAP, DemandSpec
from jaxpound.simulation.run import demand
from jaxpound.simulation.scheme import Scheme, imprecise, require_stable, single_system
from jaxpound.simulation.time_steps import record_grid
from jaxpound.store.store import RunLog, identity, program_digest

_COLUMNS = ("record", "factor", "has_slope", "demand", "slope")  # the first three name a run
_ROWS = 256  # of a file


def rising_intensities(intensities: Any) -> Float[np.ndarray, " k"]:
    """Rising intensities > 0 as an array; an ``InvalidInput`` for anything else."""
    levels = array("intensities", intensities, (-1,))
    positive(intensities=levels)
    enforce([Rule("intensities", levels, np.append(True, np.diff(levels) > 0), "rising")])
    return levels


class Intensity(NamedTuple):
    """A measure of intensity that is proportional to a record's factor."""

    words: str  # its name with its unit
    unscaled: Float[np.ndarray, " n"]  # the intensity of each unscaled record


@dataclasses.dataclass(frozen=True, eq=False)
class Analysis:
    """Buildings, records that are scaled, intensity and demand: what is run for any fragility.

    Arguments are as of ``incremental_dynamic_analysis``; ``highest`` is the largest intensity of
    each record, or of all; None: unscaled records. Where pounding is sought, ``structures`` are
    without laws of contact.
    """

    structures: Buildings
    records: RecordSuite
    grid: TimeGrid | None
    measure: Any
    demand: DemandSpec
    threshold: float | None
    scheme: Scheme
    strict: bool
    highest: Any = None

    def __post_init__(self) -> None:
        n = len(self.records)
        if not isinstance(self.structures, Buildings):
            rule = "must be jp.Buildings, as records are in g and s"
            raise InvalidInput("structures", type(self.structures).__name__, rule)
        single_system(self.structures)
        instance("scheme", self.scheme, Scheme)
        if self.event[0] in (REQUIRED_GAP, OVERLAP):
            object.__setattr__(self, "structures", without_contact(self.structures))
        for record in self.records:
            require_time_unit("records", record, si=True)
        require_stable(self.structures, self.scheme, self.time_grid.dt)
        warn(self._doubts(), self.strict)
        require_memory("records", n, n * self.time_grid.n_steps * 16)
        jax.eval_shape(self.value, 0, 1.0)

    @cached_property
    def time_grid(self) -> TimeGrid:
        """The requested grid, or one as long as the longest record, for the finest samples."""
        if self.grid is not None:
            instance("grid", self.grid, TimeGrid)
            return self.grid
        finest = min(self.records, key=lambda record: float(record.dt))
        longest = max(self.records, key=lambda record: float(record.duration))
        names = f"with {finest.name!r}, the finest, and {longest.name!r}, the longest,"
        options: Any = {"strict": self.strict, "place": f"records: {names}"}
        return record_grid(self.structures, self.scheme, [*self.records], **options)

    @cached_property
    def intensity(self) -> Intensity:
        """By ``measure``: "pga", a natural period, or the intensity of each record itself."""
        if isinstance(self.measure, str):
            if self.measure != "pga":
                rule = "must be 'pga', a natural period or a number for each record"
                raise InvalidInput("measure", repr(self.measure), rule)
            return Intensity("PGA (g)", self.records.pgas)
        measure = array("measure", self.measure, (), (len(self.records),))
        positive(measure=measure)
        if np.ndim(measure):
            return Intensity("intensity", measure)
        words = Measure.spectral_acceleration(float(measure), self.records.time_unit)
        return Intensity(str(words), self.records.spectra(measure[None])[:, 0])

    @cached_property
    def event(self) -> tuple[str, float]:
        """The demand's name and threshold; those of pounding follow from the gaps at rest."""
        name, threshold = self.demand, self.threshold
        if not isinstance(name, str):
            name = getattr(name, "__name__", "demand").replace("<lambda>", "demand")
            # It may be called as a demand of this package that it is not.
            name = "demand" if named.quantity_named(name) else name
        if threshold is None:
            if name != REQUIRED_GAP:
                named.require_threshold(self.demand)
            gap = common_gap(self.structures)
            return (OVERLAP, 0.0) if gap is None else (REQUIRED_GAP, float(gap))
        limit = float(number("threshold", threshold))
        enforce([Rule("threshold", limit, np.isfinite(limit), "finite")])
        return name, limit

    @property
    def about(self) -> tuple[Any, ...]:
        """What results say of it: threshold, demand, measure and topology."""
        name, threshold = self.event
        return threshold, name, self.intensity.words, self.structures.system().topology

    def _doubts(self) -> list[str]:
        """Findings of what is implausible, or not resolved."""
        suite, highest, unscaled = self.records, self.highest, self.intensity.unscaled
        factors = np.ones(len(suite)) if highest is None else highest / unscaled
        findings = imprecise(self.structures.system(), self.time_grid, factors)
        for record in suite:
            findings += unseen(record, self.time_grid, strict=self.strict)
        if (peaks := suite.pgas * factors).max() > LARGE_PGA:
            i = int(np.argmax(peaks))
            scaled_up = f"records: {suite.names[i]!r} times {factors[i]:.4g} has a PGA of"
            findings.append(f"{scaled_up} {peaks[i]:.4g} g; it should be at most {LARGE_PGA:.0f} g")
        return findings

    def value(self, record: Any, factor: Any) -> Any:
        """The demand of a record, by its number, times a factor; traceable."""
        # Padded with zeros: the ground is at rest after a record.
        samples, interval = (jnp.asarray(x)[record] for x in stacked([*self.records]))
        ground = factor * Record(samples, interval)
        result = demand(self.structures, ground, self.time_grid, self.scheme)
        spec = self.event[0] if isinstance(self.demand, str) else self.demand
        return named.value_of(self.structures.system(), result, spec)

    def value_and_slope(self, record: Any, factor: Any) -> Any:
        """``value`` and its derivative by the factor."""
        return jax.jvp(partial(self.value, record), (factor,), (jnp.ones_like(factor),))

    def description(self) -> dict[str, Any]:
        """What determines the results of its runs, for a store."""
        search = "runs of a suite", _COLUMNS, _ROWS, program_digest(self.value, 0, 1.0)
        inputs: dict[str, Any] = {"demand": self.event[0], "records": stacked([*self.records])}
        inputs |= {"structures": self.structures, "grid": self.time_grid, "scheme": self.scheme}
        return identity(*search, **inputs)


class SuiteRuns:
    """The runs of an analysis in batches of any size, kept in a store, with a progress bar."""

    def __init__(
        self, analysis: Analysis, store: str | PathLike[str] | None, progress: bool
    ) -> None:
        self.analysis, self.threshold = analysis, analysis.event[1]
        self._log = None if store is None else RunLog(store, analysis.description())
        stored = self._log.rows if self._log else dict.fromkeys(_COLUMNS, np.empty(0))
        self._finished = _by_run(np.column_stack([stored[name] for name in _COLUMNS]))
        self._part = part = runs_at_a_time() // 4  # runs after which a file is written
        programs = lambda *run: (analysis.value(*run), jnp.nan), analysis.value_and_slope
        self._programs = [in_chunks(program, part) for program in programs]
        self.bar = tqdm(unit=" runs", disable=not progress)

    def run(self, records: Any, intensities: Any, *, slopes: bool = False) -> np.ndarray:
        """Demands of m records, by number, and derivatives by the intensity or NaN, shape (2, m).

        ``intensities``, shape (m,), are those to which the records are scaled.
        """
        unscaled = self.analysis.intensity.unscaled[records]
        factors = np.asarray(intensities / unscaled, jnp.zeros(()).dtype)
        runs = [(*run, slopes) for run in zip(records.tolist(), factors.tolist(), strict=True)]
        missing, size = [x for x in runs if x not in self._finished], min(len(runs), self._part)
        self.bar.total = (self.bar.total or 0) + len(runs)
        self.bar.update(len(runs) - len(missing))
        for start in range(0, len(missing), size):
            part = missing[start : start + size]
            # As large as if no run were finished: the same program, and the same rounding.
            record, factor, _ = np.array(part + part[-1:] * (size - len(part))).T
            results = self._programs[slopes](record.astype(int), factor.astype(factors.dtype))
            rows = np.column_stack([part, *(x[: len(part)] for x in results)])
            if self._log is not None:
                self._log.add(dict(zip(_COLUMNS, rows.T, strict=True)))
            self._finished |= _by_run(rows)
            self.bar.update(len(part))
        demands, by_factor = np.array([self._finished[run] for run in runs]).T
        if not (finite := np.isfinite(demands)).all():
            i, name = int(np.argmin(finite)), self.analysis.event[0]
            record = self.analysis.records.names[records[i]]
            place = f"{caller()}: {record!r} at {intensities[i]:.6g}"
            raise FloatingPointError(f"{place}: {name} must be finite, but is {demands[i]}")
        return np.stack([demands, by_factor / unscaled])


def _by_run(rows: np.ndarray) -> dict[tuple[float, ...], list[float]]:
    """Demand and slope by the number of the record, its factor and whether the run has a slope."""
    return {tuple(row[:3]): row[3:] for row in rows.tolist()}
