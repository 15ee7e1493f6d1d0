"""Runs of structures under the records of a suite, each record times a factor.

What has been run is known by record and factor, and kept in a store if there is one: an analysis
that was stopped asks again for what it needs, and only what it has not had yet is run.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from os import PathLike
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int
from tqdm.auto import tqdm

from jaxpound._checks import instance, number, require_memory
from jaxpound.grid import TimeGrid
from jaxpound.ground.motion import DIMENSIONLESS
from jaxpound.ground.plausibility import MOST_PGA, tell, unseen
from jaxpound.ground.record import Record, stacked
from jaxpound.ground.suite import RecordSuite, as_suite
from jaxpound.model.system import Structures, is_closable
from jaxpound.quantities import unit
from jaxpound.results.demand import in_words, kind_of
from jaxpound.risk.demanded import (
    OVERLAP,
    REQUIRED_GAP,
    Demanded,
    demand_named,
    passing_through,
    require_threshold,
)
from jaxpound.risk.ledger import Ledger, identity
from jaxpound.risk.shaking import Intensity, dimensionless_suite, grid_for
from jaxpound.simulation.batches import in_chunks, runs_at_a_time
from jaxpound.simulation.run import demand
from jaxpound.simulation.scheme import Scheme, require_stable, system_of
from jaxpound.study.demands import rest_gap
from jaxpound.study.store import describe
from jaxpound.units import Scales


class Asked(NamedTuple):
    """What an analysis is asked: the arguments of ``incremental_dynamic_analysis``."""

    structures: Structures
    records: Any
    grid: TimeGrid | None
    measure: Any
    demand: Demanded
    threshold: float | None
    scales: Scales | None
    scheme: Scheme
    strict: bool
    store: str | PathLike[str] | None = None
    progress: bool = True


_COLUMNS = ("record", "factor", "demand", "slope", "has_slope")
_ROWS = 256  # of a file

_Pair = tuple[int, float]
"""Number of a record, and its factor."""


@dataclasses.dataclass(frozen=True, eq=False)
class SuiteRuns:
    """Compiled runs for batches of records and factors of any size, with a progress bar.

    ``demands`` and ``slopes`` take the number of a record and the intensity to which it is scaled.
    """

    owner: str
    suite: RecordSuite
    """As it was given."""
    intensity: Intensity
    demand: str
    """Name of the demand."""
    threshold: float
    """In SI units if there are scales."""
    si: bool
    bar: Any = dataclasses.field(repr=False)
    """A context manager."""
    _programs: tuple[Callable[..., Any], Callable[..., Any]] = dataclasses.field(repr=False)
    _held: tuple[dict[_Pair, Any], dict[_Pair, Any]] = dataclasses.field(repr=False)
    _ledger: Ledger | None = dataclasses.field(repr=False)
    told: Callable[[Int[np.ndarray, " m"]], None] = lambda which: None
    """Called with the numbers of the records before each batch."""

    @classmethod
    def of(cls, owner: str, asked: Asked, highest: Any = None) -> SuiteRuns:
        """The runs of an analysis, after what is asked has been checked.

        ``highest`` is the largest intensity of each record, or of all; None: records as they are.
        """
        structures, scales, scheme = asked.structures, asked.scales, asked.scheme
        suite = as_suite(owner, asked.records)
        system = system_of(owner, structures)
        instance(owner, "scheme", scheme, Scheme)
        shaking = dimensionless_suite(owner, suite, scales)
        grid = asked.grid
        if grid is None:
            grid = grid_for(owner, structures, suite, scales, scheme)
        instance(owner, "grid", grid, TimeGrid)
        require_stable(system, grid, scheme)
        name, limit = _limit(owner, structures, asked)
        if name in (REQUIRED_GAP, OVERLAP):
            structures = passing_through(structures)
        intensity = Intensity.of(owner, suite, asked.measure)
        factors = np.ones(len(suite)) if highest is None else highest / intensity.unscaled
        findings = [said for record in shaking for said in unseen(record, grid)]
        tell(owner, findings + _too_strong(suite, factors), asked.strict)
        require_memory(owner, "records", len(suite), len(suite) * grid.n_steps * 16)
        wanted = asked.demand if callable(asked.demand) else name
        records = _Shaking.of(shaking)
        value = _demanded(owner, structures, records, grid, scheme, wanted, scales)
        jax.eval_shape(value, 0, 1.0)

        def with_slope(which: Any, factor: Any) -> Any:
            return jax.jvp(lambda f: value(which, f), (factor,), (jnp.ones_like(factor),))

        ledger: Ledger | None = None
        held: tuple[dict[_Pair, Any], dict[_Pair, Any]] = {}, {}
        if asked.store is not None:
            what = {
                "demand": name,
                "records": describe(records),
                "structures": describe(structures),
                "scales": describe(scales),
                "grid": describe(grid),
                "scheme": describe(scheme),
            }
            known = identity("runs of a suite", _COLUMNS, _ROWS, (value, (0, 1.0)), **what)
            ledger = Ledger(asked.store, known)
            held = _by_pair(ledger.rows)
        programs = in_chunks(value, _part()), in_chunks(with_slope, _part())
        bar = tqdm(unit=" runs", disable=not asked.progress)
        si = scales is not None
        return cls(owner, suite, intensity, name, limit, si, bar, programs, held, ledger)

    def demands(
        self, which: Int[np.ndarray, " m"], intensities: Float[np.ndarray, " m"]
    ) -> Float[np.ndarray, " m"]:
        """Demands of records, by number, scaled to intensities.

        Raises
        ------
        FloatingPointError
            If a run ends in numbers that are not finite.
        """
        found = self._known(which, intensities, slopes=False)[:, 0]
        return self._finite(which, intensities, found)

    def slopes(
        self, which: Int[np.ndarray, " m"], intensities: Float[np.ndarray, " m"]
    ) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
        """``demands``, and their derivatives by the intensity."""
        found, slope = self._known(which, intensities, slopes=True).T
        return self._finite(which, intensities, found), slope / self.intensity.unscaled[which]

    def _known(self, which: Any, intensities: Any, slopes: bool) -> Float[np.ndarray, "m 2"]:
        """Demands and, if asked for, derivatives by the factor, NaN else; run if need be.

        What is run at once is the same whatever is held: then so are the programs, and their
        rounding.
        """
        self.told(which)
        factors = np.asarray(intensities / self.intensity.unscaled[which], jnp.zeros(()).dtype)
        self.bar.total = (self.bar.total or 0) + len(which)
        pairs = [*zip(which.tolist(), factors.tolist(), strict=True)]
        held, size = self._held[slopes], min(len(pairs), _part())
        for start in range(0, len(pairs), size):
            part = pairs[start : start + size]
            missing = np.array([i for i, pair in enumerate(part, start) if pair not in held], int)
            if missing.size:
                filled = np.pad(missing, (0, size - missing.size), mode="edge")
                found = self._programs[slopes](which[filled], factors[filled])
                both = np.transpose(found if slopes else (found, np.full(size, np.nan)))
                self._keep([pairs[i] for i in missing], both[: missing.size], slopes)
            self.bar.update(len(part))
        return np.array([held[pair] for pair in pairs], float)

    def _keep(self, pairs: list[_Pair], found: Float[np.ndarray, "m 2"], slopes: bool) -> None:
        if self._ledger is not None:
            rows = (*np.transpose(pairs), *found.T, np.full(len(pairs), float(slopes)))
            self._ledger.add(dict(zip(_COLUMNS, rows, strict=True)))
        self._held[slopes].update(zip(pairs, found, strict=True))

    def _finite(self, which: Any, intensities: Any, found: Any) -> Any:
        if not (good := np.isfinite(found)).all():
            i = int(np.argmin(good))
            place = f"{self.owner}: {self.suite.names[which[i]]!r} at {intensities[i]:.6g}"
            raise FloatingPointError(f"{place}: {self.demand} must be finite, but is {found[i]}")
        return found


def _part() -> int:
    """Runs after which a file is written."""
    return runs_at_a_time() // 4


def _by_pair(rows: Mapping[str, np.ndarray]) -> tuple[dict[_Pair, Any], dict[_Pair, Any]]:
    """Demand and slope by record and factor, of runs without and with slopes."""
    held: tuple[dict[_Pair, Any], dict[_Pair, Any]] = {}, {}
    records, factors, *found, slopes = (rows[name].tolist() for name in _COLUMNS)
    for record, factor, *both, has_slope in zip(records, factors, *found, slopes, strict=True):
        held[int(has_slope)][int(record), factor] = both
    return held


def _limit(owner: str, structures: Structures, asked: Asked) -> tuple[str, float]:
    """Name of the demand, and its threshold; of pounding that of the gaps at rest."""
    demand, threshold, scales = asked.demand, asked.threshold, asked.scales
    if not isinstance(demand, str):
        name = getattr(demand, "__name__", "demand")
        demand = "demand" if name == "<lambda>" else name
    if demand == REQUIRED_GAP:
        links = structures.system().links
        if not any(is_closable(link.gap) for link in links):
            raise ValueError(f"{owner}: structures must have a link whose gap is finite")
        if threshold is None:
            gap = rest_gap(structures)
            if gap is None:
                return OVERLAP, 0.0
            return REQUIRED_GAP, float(gap) * (float(scales.length) if scales else 1.0)
    elif threshold is None:
        require_threshold(owner, asked.demand)
    limit = float(number(owner, "threshold", threshold))
    if not np.isfinite(limit):
        raise ValueError(f"{owner}: threshold = {limit} must be finite")
    return demand, limit


class _Shaking(NamedTuple):
    """All records as arrays, filled up with the rest that follows a record."""

    samples: Float[np.ndarray, "n m"]
    intervals: Float[np.ndarray, " n"]

    @classmethod
    def of(cls, suite: RecordSuite) -> _Shaking:
        """Of dimensionless records."""
        return cls(*stacked([*suite]))

    def record(self, which: Any) -> Record:
        """A record by its number, which may be traced."""
        samples, interval = jnp.asarray(self.samples)[which], jnp.asarray(self.intervals)[which]
        return Record(samples, interval, time_unit=DIMENSIONLESS)


def _demanded(
    owner: str,
    structures: Structures,
    shaking: _Shaking,
    grid: TimeGrid,
    scheme: Scheme,
    wanted: Demanded,
    scales: Scales | None,
) -> Callable[[Any, Any], Any]:
    """The demand of a record, by number, times a factor; traceable."""
    system = structures.system()

    def value(which: Any, factor: Any) -> Any:
        found = demand(structures, factor * shaking.record(which), grid, scheme)
        if callable(wanted):
            return jnp.asarray(wanted(scales.to_si(found) if scales else found))
        return demand_named(owner, system, found, wanted) * _unit(wanted, scales)

    return value


def demand_kind(name: str) -> str | None:
    """Kind of quantity of an analysis's demand; None for a pure number or a function's own."""
    return "length" if name == OVERLAP else kind_of(name)


def demand_in_words(name: str, si: bool) -> str:
    """An analysis's demand in words, with its unit."""
    kind = demand_kind(name)
    return f"{in_words(name)} ({unit(kind, si)})" if kind else in_words(name)


def _unit(name: str, scales: Scales | None) -> Any:
    return scales.unit_of(demand_kind(name)) if scales else 1.0


def _too_strong(suite: RecordSuite, factors: Any) -> list[str]:
    """A finding if scaled records exceed the plausible PGA."""
    peaks = suite.pgas * factors
    if not (peaks > MOST_PGA).any():
        return []
    i = int(np.argmax(peaks))
    return [
        f"records: {suite.names[i]!r} times {np.broadcast_to(factors, len(suite))[i]:.4g} has a "
        f"PGA of {peaks[i]:.4g} g; it should be at most {MOST_PGA:.0f} g"
    ]
