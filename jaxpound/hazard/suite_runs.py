"""Runs of structures under the records of a suite, each record times a factor.

A finished run is identified by record and factor, and kept in a store if there is one: an analysis
that was stopped requests the same runs again, and only the missing ones are run.
"""

from __future__ import annotations

from collections.abc import Callable
from os import PathLike
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int
from tqdm.auto import tqdm

from jaxpound._checks import Rule, array, enforce, instance, number, positive, require_memory
from jaxpound._errors import InvalidInput, warn
from jaxpound._xla.batches import in_chunks, runs_at_a_time
from jaxpound.buildings import Buildings
from jaxpound.grid import TimeGrid
from jaxpound.ground.measure import Measure
from jaxpound.ground.plausibility import LARGE_PGA, unseen
from jaxpound.ground.record import Record, stacked
from jaxpound.ground.run_input import require_time_unit
from jaxpound.ground.suite import RecordSuite, as_suite
from jaxpound.model.system import Structures, common_gap, is_closable, without_contact
from jaxpound.results import named
from jaxpound.results.named import OVERLAP, REQUIRED_GAP, DemandSpec
from jaxpound.simulation.run import demand
from jaxpound.simulation.scheme import Scheme, imprecise, require_stable, single_system
from jaxpound.simulation.time_steps import record_grid
from jaxpound.store.store import RunLog, identity, program_digest

_COLUMNS = ("record", "factor", "demand", "slope", "has_slope")
_ROWS = 256  # of a file

_RunId = tuple[int, float]  # number of a record, and its factor


class AnalysisOptions(NamedTuple):
    """The arguments that determine an analysis, in the order of all analyses."""

    structures: Buildings
    records: Any
    grid: TimeGrid | None
    measure: Any
    demand: DemandSpec
    threshold: float | None
    scheme: Scheme
    strict: bool

    def limit(self, owner: str) -> tuple[str, float]:
        """The demand's name and threshold; those of pounding follow from the gaps at rest."""
        name, threshold = self.demand, self.threshold
        if not isinstance(name, str):
            name = getattr(name, "__name__", "demand").replace("<lambda>", "demand")
        if name == REQUIRED_GAP:
            if not any(is_closable(link.gap) for link in self.structures.system().links):
                raise InvalidInput(owner, "structures", "", "must have a link whose gap is finite")
            if threshold is None:
                if (gap := common_gap(self.structures)) is None:
                    return OVERLAP, 0.0
                return REQUIRED_GAP, float(gap)
        elif threshold is None:
            named.require_threshold(owner, self.demand)
        limit = float(number(owner, "threshold", threshold))
        enforce(owner, [Rule("threshold", limit, np.isfinite(limit), "finite")])
        return name, limit

    def time_grid(self, owner: str, suite: RecordSuite) -> TimeGrid:
        """The requested grid, or one as long as the longest record, for the finest samples."""
        if self.grid is not None:
            instance(owner, "grid", self.grid, TimeGrid)
            return self.grid
        finest = min(suite, key=lambda record: float(record.dt))
        longest = max(suite, key=lambda record: float(record.duration))
        names = f"with {finest.name!r}, the finest, and {longest.name!r}, the longest,"
        place, options = f"{owner}: records: {names}", (self.scheme, [*suite])
        return record_grid(place, self.structures, *options, strict=self.strict)


class Intensity(NamedTuple):
    """A measure of intensity that is proportional to a record's factor."""

    words: str  # its name with its unit
    unscaled: Float[np.ndarray, " n"]  # the intensity of each unscaled record

    @classmethod
    def of(cls, owner: str, suite: RecordSuite, measure: Any) -> Intensity:
        """By ``measure``: "pga", a natural period, or the intensity of each record itself."""
        if isinstance(measure, str):
            if measure != "pga":
                rule = "must be 'pga', a natural period or a number for each record"
                raise InvalidInput(owner, "measure", repr(measure), rule)
            return cls("PGA (g)", suite.pgas)
        measure = array(owner, "measure", measure, (), (len(suite),))
        positive(owner, measure=measure)
        if np.ndim(measure) == 0:
            period = float(measure)
            words = str(Measure.spectral_acceleration(period, suite.time_unit))
            return cls(words, suite.spectra(np.array([period]))[:, 0])
        return cls("intensity", measure)


def rising_intensities(owner: str, intensities: Any) -> Float[np.ndarray, " k"]:
    """Rising intensities > 0 as an array; an ``InvalidInput`` for anything else."""
    levels = array(owner, "intensities", intensities, (-1,))
    positive(owner, intensities=levels)
    enforce(owner, [Rule("intensities", levels, np.append(True, np.diff(levels) > 0), "rising")])
    return levels


class SuiteRuns:
    """Compiled runs for batches of records and factors of any size, with a progress bar.

    ``highest`` is the largest intensity of each record, or of all; None: unscaled records.
    ``demands`` and ``slopes`` take the number of a record and the intensity to which it is scaled.
    """

    def __init__(
        self,
        owner: str,
        options: AnalysisOptions,
        store: str | PathLike[str] | None,
        progress: bool,
        highest: Any = None,
    ) -> None:
        structures: Structures = options.structures
        scheme = options.scheme
        self.suite = suite = as_suite(owner, options.records)
        if not isinstance(structures, Buildings):
            rule = "must be jp.Buildings, as records are in g and s"
            raise InvalidInput(owner, "structures", type(structures).__name__, rule)
        system = single_system(owner, structures)
        instance(owner, "scheme", scheme, Scheme)
        for record in suite:
            require_time_unit(f"{owner}: records", record, si=True)
        grid = options.time_grid(owner, suite)
        require_stable(structures, scheme, grid.dt)
        self.demand, self.threshold = options.limit(owner)
        if self.demand in (REQUIRED_GAP, OVERLAP):
            structures = without_contact(structures)
        self.intensity = Intensity.of(owner, suite, options.measure)
        factors = np.ones(len(suite)) if highest is None else highest / self.intensity.unscaled
        findings = imprecise(structures.system(), grid, factors)
        for record in suite:
            findings += unseen(record, grid, strict=options.strict)
        if (peaks := suite.pgas * factors).max() > LARGE_PGA:
            i = int(np.argmax(peaks))
            scaled_up = f"records: {suite.names[i]!r} times {factors[i]:.4g} has a PGA of"
            findings.append(f"{scaled_up} {peaks[i]:.4g} g; it should be at most {LARGE_PGA:.0f} g")
        warn(owner, findings, options.strict)
        require_memory(owner, "records", len(suite), len(suite) * grid.n_steps * 16)
        # Padded with zeros: the ground is at rest after a record.
        records = stacked([*suite])
        system = structures.system()
        spec = self.demand if isinstance(options.demand, str) else options.demand

        def value(number: Any, factor: Any) -> Any:
            """The demand of a record, by number, times a factor."""
            samples, interval = (jnp.asarray(x)[number] for x in records)
            result = demand(structures, factor * Record(samples, interval), grid, scheme)
            return named.value_of(owner, system, result, spec)

        jax.eval_shape(value, 0, 1.0)

        def with_slope(record: Any, factor: Any) -> Any:
            return jax.jvp(lambda f: value(record, f), (factor,), (jnp.ones_like(factor),))

        self._log: RunLog | None = None
        # Demand and slope by record and factor, of runs without and with slopes.
        self._finished: tuple[dict[_RunId, Any], dict[_RunId, Any]] = {}, {}
        if store is not None:
            inputs: dict[str, Any] = {"demand": self.demand, "records": records}
            inputs |= {"structures": structures, "grid": grid, "scheme": scheme}
            search = "runs of a suite", _COLUMNS, _ROWS, program_digest(value, 0, 1.0)
            self._log = RunLog(store, identity(*search, **inputs))
            columns = (self._log.rows[name].tolist() for name in _COLUMNS)
            for record, factor, *results, has_slope in zip(*columns, strict=True):
                self._finished[int(has_slope)][int(record), factor] = results
        self._part = part = runs_at_a_time() // 4  # runs after which a file is written
        self._programs = in_chunks(value, part), in_chunks(with_slope, part)
        self._owner, self.topology = owner, system.topology
        self.bar = tqdm(unit=" runs", disable=not progress)
        # Called with the numbers of the records before each batch.
        self.before_batch: Callable[[Int[np.ndarray, " m"]], None] = lambda rows: None

    def demands(
        self, records: Int[np.ndarray, " m"], intensities: Float[np.ndarray, " m"]
    ) -> Float[np.ndarray, " m"]:
        """Demands of records, by number, scaled to intensities."""
        return self._results(records, intensities, slopes=False)[:, 0]

    def slopes(
        self, records: Int[np.ndarray, " m"], intensities: Float[np.ndarray, " m"]
    ) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
        """``demands``, and their derivatives by the intensity."""
        demands, slopes = self._results(records, intensities, slopes=True).T
        return demands, slopes / self.intensity.unscaled[records]

    def _results(self, records: Any, intensities: Any, slopes: bool) -> Float[np.ndarray, "m 2"]:
        """Demands and, with ``slopes``, derivatives by the factor, else NaN."""
        self.before_batch(records)
        factors = np.asarray(intensities / self.intensity.unscaled[records], jnp.zeros(()).dtype)
        self.bar.total = (self.bar.total or 0) + len(records)
        runs = [*zip(records.tolist(), factors.tolist(), strict=True)]
        finished, size = self._finished[slopes], min(len(runs), self._part)
        for start in range(0, len(runs), size):
            part = runs[start : start + size]
            missing = np.array([i for i, run in enumerate(part, start) if run not in finished], int)
            if missing.size:
                # As large as if no run were finished: the same program, and the same rounding.
                padded = np.pad(missing, (0, size - missing.size), mode="edge")
                results = self._programs[slopes](records[padded], factors[padded])
                both = np.stack(results if slopes else (results, np.full(size, np.nan)))
                names, both = [runs[i] for i in missing], both[:, : missing.size]
                if self._log is not None:
                    rows = (*np.transpose(names), *both, np.full(missing.size, float(slopes)))
                    self._log.add(dict(zip(_COLUMNS, rows, strict=True)))
                finished.update(zip(names, both.T, strict=True))
            self.bar.update(len(part))
        results = np.array([finished[run] for run in runs], float)
        if not (finite := np.isfinite(results[:, 0])).all():
            i = int(np.argmin(finite))
            place = f"{self._owner}: {self.suite.names[records[i]]!r} at {intensities[i]:.6g}"
            rule = f"must be finite, but is {results[i, 0]}"
            raise FloatingPointError(f"{place}: {self.demand} {rule}")
        return results
