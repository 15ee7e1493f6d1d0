"""Buildings under recorded earthquakes, the demand that is sought, and the runs.

A run is a record times a factor, which identify it. It is kept in a store if there is one: an
analysis that was stopped requests the same runs again, and only the missing ones are run.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from functools import cached_property
from os import PathLike
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from tqdm.auto import tqdm

from jaxpound._checks import (
    Rule,
    array,
    enforce,
    instance,
    is_traced,
    number,
    positive,
    require_memory,
)
from jaxpound._errors import InvalidInput, caller, renamed, warn
from jaxpound._xla.batches import in_chunks, runs_at_a_time
from jaxpound.buildings import Buildings
from jaxpound.grid import TimeGrid
from jaxpound.ground.measure import Measure
from jaxpound.ground.motion import GroundLike, GroundMotion, Scaled, require_ground
from jaxpound.ground.plausibility import LARGE_PGA, unseen
from jaxpound.ground.record import Record, derived, stacked
from jaxpound.ground.run_input import require_time_unit
from jaxpound.ground.sequences import sequence
from jaxpound.ground.suite import RecordSuite, as_suite
from jaxpound.ground.supports import require_plausible_wave, travelling
from jaxpound.model.system import common_gap, without_contact
from jaxpound.results import named
from jaxpound.results.named import OVERLAP, REQUIRED_GAP, DemandSpec
from jaxpound.simulation.run import demand
from jaxpound.simulation.scheme import Scheme, imprecise, require_stable, single_system
from jaxpound.simulation.time_steps import record_grid
from jaxpound.store.store import RunLog, identity, program_digest

_COLUMNS = ("record", "factor", "demand")  # the first two name a run
_ROWS = 256  # of a file


@dataclasses.dataclass(frozen=True, eq=False)
class Analysis:
    """Buildings under recorded earthquakes, and the demand that a fragility is of.

    ``incremental_dynamic_analysis``, which has an example, scales the records until the demand
    reaches the threshold, ``multiple_stripes`` to chosen intensities; ``cloud_analysis`` takes them
    as they are.

    Raises ``ValueError`` if an argument breaks its rule; if records are not in s, or together need
    too many steps. Warns (``PlausibilityWarning``) if the grid does not resolve a record, or if
    contact is run in single precision; when the records are run, if one, scaled, has a PGA above
    5 g.

    Parameters
    ----------
    structures
        ``Buildings``. Where pounding is sought they are run without laws of contact.
    records
        A ``RecordSuite`` or several records, in g and s; for ``multiple_stripes`` also a list of
        suites, one for each intensity.
    grid
        The instants of all runs; by default as long as the longest record, its step chosen for the
        record with the shortest interval.
    measure
        The measure of intensity: "pga" (in g); a natural period, s, for the spectral acceleration
        at 5 % of damping (in g); or the intensity of each unscaled record, shape (n,) (ones make it
        the factor), which must be proportional to its factor.
    demand
        See ``LimitState``.
    mainshock, rest
        A ground motion before each record, which is then its aftershock, and the quiet time between
        them, s, as of ``jp.sequence``. The factor and the intensity are those of the
        aftershock alone; the demand is that of both, and the threshold one that the mainshock alone
        does not reach. By default there is no mainshock.
    velocity, distances
        Of the wave as which each record travels along the supports of ``structures``, as of
        ``jp.travelling``: apparent velocity, m/s, and the distance of each support, m. The
        intensity is that of the record itself. A mainshock travels if ``jp.travelling`` makes it
        so; else it moves all supports alike, as by default records do.
    threshold
        A record reaches it if the demand is at least as large; in SI units. None, for the required
        gap only, is pounding: the gap at rest of all links. Where they differ, the demand is the
        overlap, the largest −ξ of any link, and the threshold 0.
    scheme, strict
        See ``simulate``; ``strict`` also refuses scaled records that are implausible.
    """

    structures: Buildings
    records: Any
    grid: TimeGrid | None = None
    _: dataclasses.KW_ONLY
    measure: Any = "pga"
    demand: DemandSpec = REQUIRED_GAP
    threshold: float | None = None
    mainshock: GroundLike | None = None
    rest: float | None = None
    velocity: float | None = None
    distances: Sequence[float] | None = None
    scheme: Scheme = Scheme()
    strict: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.structures, Buildings):
            rule = "must be jp.Buildings, as records are in g and s"
            raise InvalidInput("structures", type(self.structures).__name__, rule)
        single_system(self.structures)
        instance("scheme", self.scheme, Scheme)
        for record in self.suite:
            require_time_unit("records", record, si=True)
        if self.mainshock is None and self.rest is not None:
            raise InvalidInput("rest", repr(self.rest), "must be None, as there is no mainshock")
        if self.mainshock is not None:
            require_ground("mainshock", self.mainshock)
            require_time_unit("mainshock", self.mainshock, si=True)
        if self._wave:
            require_plausible_wave(**self._wave)
        grid, n = self.time_grid, len(self.suite)
        structures = self.run_structures
        require_stable(structures, self.scheme, grid.dt)
        doubts = imprecise(structures.system(), grid, self.unscaled)
        if self.mainshock is not None:
            doubts += unseen(self.mainshock, grid, strict=self.strict)
        for record in self.suite:
            doubts += unseen(self.shaking(record, 0.0), grid, strict=self.strict)
        warn(doubts, self.strict)
        require_memory("records", n, n * grid.n_steps * 16)
        jax.eval_shape(self.value, 0, 1.0)

    @property
    def suite(self) -> RecordSuite:
        """Every record once."""
        return self._joined[0]

    @property
    def numbers(self) -> list[np.ndarray]:
        """The numbers in ``suite`` of the records of the suite, or of each of several suites."""
        return self._joined[1]

    @cached_property
    def _joined(self) -> tuple[RecordSuite, list[np.ndarray]]:
        several = isinstance(self.records, Sequence) and len(self.records) > 0
        if several and all(isinstance(suite, RecordSuite) for suite in self.records):
            return joined(self.records)
        return joined([as_suite(self.records)])

    @cached_property
    def time_grid(self) -> TimeGrid:
        """The requested grid, or one as long as the longest record, for the finest samples."""
        if self.grid is not None:
            instance("grid", self.grid, TimeGrid)
            return self.grid
        if is_traced((self.velocity, self.distances)):
            rule = "must be a TimeGrid where velocity or distances are traced"
            raise InvalidInput("grid", "None", rule)
        finest = min(self.suite, key=lambda record: float(record.dt))
        longest = max(self.suite, key=lambda record: float(record.duration))
        names = f"with {finest.name!r}, the finest, and {longest.name!r}, the longest,"
        options: Any = {"strict": self.strict, "place": f"records: {names}"}
        records = [*self.suite]
        whole: Any = self.shaking(longest)
        if whole is not longest:
            options["duration"] = whole.duration
            records += [part for part in whole.parts() if isinstance(part, Record)]
        return record_grid(self.run_structures, self.scheme, records, **options)

    @property
    def unscaled(self) -> np.ndarray:
        """The intensity of each unscaled record, shape (n,)."""
        return self._intensity[1]

    @cached_property
    def _intensity(self) -> tuple[str, np.ndarray]:
        """The measure in words, with its unit, and the intensity of each unscaled record."""
        if isinstance(self.measure, str):
            if self.measure != "pga":
                numbers = "a natural period (0.9 is Sa(0.9 s)) or a number for each record"
                raise InvalidInput("measure", repr(self.measure), f"must be 'pga', {numbers}")
            return "PGA (g)", self.suite.pgas
        measure = array("measure", self.measure, (), (len(self.suite),))
        positive(measure=measure)
        if np.ndim(measure):
            return "intensity", measure
        words = Measure.spectral_acceleration(float(measure), self.suite.time_unit)
        return str(words), self.suite.spectra(measure[None])[:, 0]

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
        return threshold, name, self._intensity[0], self.structures.system().topology

    def excessive(self, highest: Any) -> list[str]:
        """A finding if a record at the highest intensity, of each or of all, has a large PGA."""
        factors = highest / self.unscaled
        peaks = self.suite.pgas * factors
        i = int(np.argmax(peaks))
        if peaks[i] <= LARGE_PGA:
            return []
        scaled_up = f"records: {self.suite.names[i]!r} times {factors[i]:.4g} has a PGA of"
        return [f"{scaled_up} {peaks[i]:.4g} g; it should be at most {LARGE_PGA:.0f} g"]

    def shaking(self, ground: GroundMotion, scale: float = 1.0) -> GroundMotion:
        """A ground motion as it reaches the supports, after the mainshock, if any, times a factor.

        Of a wave it is the motion of each support.
        """
        if self._wave:
            ground = travelling(ground, **self._wave)
        if self.mainshock is None:
            return ground
        with renamed(names={"grounds[0]": "mainshock"}):
            return sequence((Scaled(self.mainshock, scale), ground), self.rest)

    @property
    def _wave(self) -> dict[str, Any]:
        """Velocity and distances of a wave; empty if there is none."""
        wave = {"velocity": self.velocity, "distances": self.distances}
        return {} if self.velocity is None and self.distances is None else wave

    @cached_property
    def run_structures(self) -> Any:
        """The structures; where pounding is sought, without laws of contact."""
        pounding = self.event[0] in (REQUIRED_GAP, OVERLAP)
        return without_contact(self.structures) if pounding else self.structures

    def value(self, record: Any, factor: Any) -> Any:
        """The demand of a record, by its number, times a factor; traceable."""
        # Padded with zeros: the ground is at rest after a record.
        samples, interval = (jnp.asarray(x)[record] for x in stacked([*self.suite]))
        ground = self.shaking(factor * Record(samples, interval))
        result = demand(self.run_structures, ground, self.time_grid, self.scheme)
        spec = self.event[0] if isinstance(self.demand, str) else self.demand
        return named.value_of(self.run_structures.system(), result, spec)


def joined(suites: Sequence[RecordSuite]) -> tuple[RecordSuite, list[np.ndarray]]:
    """Every record of several suites once, and the numbers in it of the records of each.

    Different records of one name get names of their own.
    """
    numbers: dict[int, int] = {}
    different: dict[str, Record] = {}
    for record in itertools.chain(*suites):
        if id(record) not in numbers:
            numbers[id(record)], name = len(different), record.name
            while name in different:
                name += ", another"
            kept = {"doubts": record.doubts, "measured": record.measured}
            different[name] = derived(record.samples, record.dt, name, record.time_unit, **kept)
    by_suite = [np.array([numbers[id(record)] for record in suite]) for suite in suites]
    return RecordSuite(tuple(different.values())), by_suite


def single_suite(analysis: Any) -> Analysis:
    """An analysis of one suite of records; an ``InvalidInput`` for anything else."""
    instance("analysis", analysis, Analysis)
    if (n := len(analysis.numbers)) > 1:
        raise InvalidInput("records", f"{n} suites", "must be one: multiple_stripes takes several")
    return analysis


def rising_intensities(intensities: Any) -> Float[np.ndarray, " k"]:
    """Rising intensities > 0 as an array; an ``InvalidInput`` for anything else."""
    levels = array("intensities", intensities, (-1,))
    positive(intensities=levels)
    enforce([Rule("intensities", levels, np.append(True, np.diff(levels) > 0), "rising")])
    return levels


class SuiteRuns:
    """The runs of an analysis in batches of any size, kept in a store, with a progress bar.

    ``highest`` is the largest intensity of each record, or of all. Warns of what is implausible.
    """

    def __init__(
        self, analysis: Analysis, highest: Any, store: str | PathLike[str] | None, progress: bool
    ) -> None:
        warn(analysis.excessive(highest), analysis.strict)
        self.analysis, self.threshold = analysis, analysis.event[1]
        self._log = None
        if store is not None:  # described by what determines the results
            search = "runs of a suite", _COLUMNS, _ROWS, program_digest(analysis.value, 0, 1.0)
            inputs: Any = {"demand": analysis.event[0], "records": stacked([*analysis.suite])}
            inputs |= {"structures": analysis.run_structures, "grid": analysis.time_grid}
            inputs |= {name: np.asarray(x, float) for name, x in analysis._wave.items()}
            if analysis.mainshock is not None:
                inputs |= {"mainshock": analysis.mainshock, "rest": analysis.rest}
            self._log = RunLog(store, identity(*search, **inputs, scheme=analysis.scheme))
        stored = self._log.rows if self._log else dict.fromkeys(_COLUMNS, np.empty(0))
        *runs, demands = (stored[name].tolist() for name in _COLUMNS)
        self._finished = dict(zip(zip(*runs, strict=True), demands, strict=True))
        self._part = part = runs_at_a_time() // 4  # runs after which a file is written
        self._program = in_chunks(analysis.value, part)
        self.bar = tqdm(unit=" runs", disable=not progress)

    def run(self, records: Any, intensities: Any) -> np.ndarray:
        """Demands of m records, by number, scaled to ``intensities``, shape (m,) all."""
        unscaled = self.analysis.unscaled[records]
        factors = np.asarray(intensities / unscaled, jnp.zeros(()).dtype)
        runs = [*zip(records.tolist(), factors.tolist(), strict=True)]
        missing, size = [x for x in runs if x not in self._finished], min(len(runs), self._part)
        self.bar.total = (self.bar.total or 0) + len(runs)
        self.bar.update(len(runs) - len(missing))
        for start in range(0, len(missing), size):
            part = missing[start : start + size]
            # As large as if no run were finished: the same program, and the same rounding.
            record, factor = np.array(part + part[-1:] * (size - len(part))).T
            demands = self._program(record.astype(int), factor.astype(factors.dtype))[: len(part)]
            if self._log is not None:
                columns = *np.transpose(part), demands
                self._log.add(dict(zip(_COLUMNS, columns, strict=True)))
            self._finished |= zip(part, demands.tolist(), strict=True)
            self.bar.update(len(part))
        demands = np.array([self._finished[run] for run in runs])
        if not (finite := np.isfinite(demands)).all():
            i, name = int(np.argmin(finite)), self.analysis.event[0]
            place = f"{self.analysis.suite.names[records[i]]!r} at {intensities[i]:.6g}"
            rule = f"{name} must be finite, but is {demands[i]}"
            raise FloatingPointError(f"{caller()}: {place}: {rule}")
        return demands
