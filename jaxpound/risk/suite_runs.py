"""Runs of structures under the records of a suite, each record times a factor."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from jaxpound._checks import instance, number, require_memory
from jaxpound.grid import TimeGrid
from jaxpound.ground.motion import DIMENSIONLESS, unresolved
from jaxpound.ground.plausibility import MOST_PGA, tell
from jaxpound.ground.record import Record, stacked
from jaxpound.ground.suite import RecordSuite, as_suite
from jaxpound.model.system import Structures, is_closable
from jaxpound.quantities import unit
from jaxpound.results.demand import in_words, kind_of
from jaxpound.risk.demanded import OVERLAP, REQUIRED_GAP, Demanded, demand_named, passing_through
from jaxpound.risk.shaking import Intensity, dimensionless_suite, grid_for
from jaxpound.simulation.batches import in_chunks
from jaxpound.simulation.run import demand
from jaxpound.simulation.scheme import Scheme, require_stable, system_of
from jaxpound.study.demands import rest_gap
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


@dataclasses.dataclass(frozen=True, eq=False)
class SuiteRuns:
    """Compiled runs for batches of records and factors of any size.

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
    _values: Callable[..., Any] = dataclasses.field(repr=False)
    _with_slopes: Callable[..., Any] = dataclasses.field(repr=False)

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
        findings = [said for record in shaking for said in unresolved(record, grid.dt)]
        tell(owner, findings + _too_strong(suite, factors), asked.strict)
        require_memory(owner, "records", len(suite), len(suite) * grid.n_steps * 16)
        wanted = asked.demand if callable(asked.demand) else name
        value = _demanded(owner, structures, _Shaking.of(shaking), grid, scheme, wanted, scales)
        jax.eval_shape(value, 0, 1.0)

        def with_slope(which: Any, factor: Any) -> Any:
            return jax.jvp(lambda f: value(which, f), (factor,), (jnp.ones_like(factor),))

        runs = in_chunks(value), in_chunks(with_slope)
        return cls(owner, suite, intensity, name, limit, scales is not None, *runs)

    def demands(
        self, which: Int[np.ndarray, " m"], intensities: Float[np.ndarray, " m"]
    ) -> Float[np.ndarray, " m"]:
        """Demands of records, by number, scaled to intensities.

        Raises
        ------
        FloatingPointError
            If a run ends in numbers that are not finite.
        """
        found = self._values(which, intensities / self.intensity.unscaled[which])
        return self._finite(which, intensities, found)

    def slopes(
        self, which: Int[np.ndarray, " m"], intensities: Float[np.ndarray, " m"]
    ) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
        """``demands``, and their derivatives by the intensity."""
        unit = self.intensity.unscaled[which]
        found, slope = self._with_slopes(which, intensities / unit)
        return self._finite(which, intensities, found), slope / unit

    def _finite(self, which: Any, intensities: Any, found: Any) -> Any:
        if not (good := np.isfinite(found)).all():
            i = int(np.argmin(good))
            place = f"{self.owner}: {self.suite.names[which[i]]!r} at {intensities[i]:.6g}"
            raise FloatingPointError(f"{place}: {self.demand} must be finite, but is {found[i]}")
        return found


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
        raise ValueError(f"{owner}: threshold = None must be a number: demand is {demand!r}")
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
    kind = demand_kind(name)
    return scales.units[kind] if scales and kind else 1.0


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
