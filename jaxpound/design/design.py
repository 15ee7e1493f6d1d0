"""The result of a search: its design, its history, and demands before and after."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound._checks import Rule, count, enforce, instance, require_one_of, require_share
from jaxpound._errors import InvalidInput
from jaxpound._tables import Shown, TextTable
from jaxpound.design.ensemble import Ensemble
from jaxpound.design.objective import Limit, Objective
from jaxpound.design.problem import DesignProblem, LogRatios
from jaxpound.design.search import Iterate
from jaxpound.design.space import DesignSpace
from jaxpound.model.places import link_places
from jaxpound.model.row import checked_floors
from jaxpound.model.system import in_si
from jaxpound.model.topology import Topology, WeightedMasses, masses_of
from jaxpound.quantities import unit
from jaxpound.reliability.result import RareEvent
from jaxpound.results.elements import of_link, without_idle_dampers
from jaxpound.results.named import in_words, unit_of
from jaxpound.study.statistics import Estimate

_STATISTICS = ("mean_before", "mean_after", "tail_before", "tail_after")
_RESAMPLES = 500  # of the bootstrap
_STUCK = 0.5  # distance slid over the peak displacement below which a damper hardly slips


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Comparison(Shown):
    """Demands before and after the design, in the same earthquakes.

    ``before[name]`` and ``after[name]`` are columns, shape (n,): smallest gap (of several links
    also of each, ``min_gap_1``) and gap at rest (the mean of the finite ones), where there is one,
    and every demand that an ``Objective`` can limit. Intervals are of 95 %; with fewer than two
    earthquakes their ends are NaN.
    """

    before: dict[str, np.ndarray]
    after: dict[str, np.ndarray]
    objective_function: Objective
    si: bool
    topology: Topology | None = None
    """Of the structures; it says where masses and rods are."""

    def __len__(self) -> int:
        return len(next(iter(self.before.values())))

    @property
    def has_gaps(self) -> bool:
        """Whether the structures have a gap that can close."""
        return "min_gap" in self.before

    def difference(self, name: str | None = None, confidence: float = 0.95) -> Estimate:
        """Mean of after − before of a column, by default the goal's, with Student's interval."""
        from scipy import stats  # only here: it takes a second to import

        require_share("confidence", confidence)
        name = self.objective_function.demand if name is None else name
        require_one_of(name, self.before)
        d = self.after[name] - self.before[name]
        mean, half_width = float(np.mean(d)), np.nan
        if len(d) > 1:  # ttest_1samp gives no interval where all differences are the same
            half_width = float(stats.sem(d) * stats.t.isf((1 - confidence) / 2, len(d) - 1))
        return Estimate(mean, mean - half_width, mean + half_width, confidence)

    @cached_property
    def objective(self) -> dict[str, Estimate]:
        """Objective before, after, and after less before, with bootstrap intervals.

        They are not reliable for a goal that one earthquake decides (``SmallestGap("worst")``).
        """
        from scipy import stats  # only here: it takes a second to import

        function = self.objective_function
        value = jax.jit(lambda columns, i: function.value({k: x[i] for k, x in columns.items()}))

        def values(rows: np.ndarray, axis: int = -1) -> np.ndarray:  # rows: shape (1, n)
            before, after = (float(value(x, rows[0])) for x in (self.before, self.after))
            return np.array([[before], [after], [after - before]])

        indices, ends = np.arange(len(self)), np.full((2, 3), np.nan)
        if len(self) > 1:
            options: dict[str, Any] = {"method": "percentile", "batch": 1, "rng": 0}
            resampled = stats.bootstrap((indices,), values, n_resamples=_RESAMPLES, **options)
            ends = resampled.confidence_interval
        names = ("before", "after", "difference")
        rows = zip(names, values(indices[None])[:, 0], *ends, strict=True)
        return {name: Estimate(*map(float, numbers)) for name, *numbers in rows}

    @property
    def pounding(self) -> tuple[float, float]:
        """Share of earthquakes in which the gap closes, before and after; 0 without a gap."""
        both = self.before, self.after
        return tuple(float(np.mean(x.get("min_gap", np.inf) <= 0)) for x in both)  # type: ignore[return-value]

    def rows(self) -> dict[str, dict[str, float]]:
        """Mean and 95 % quantile (5 % of gaps) before and after; no slip without friction."""
        names = [name for name in self.before if name != "initial_gap"]
        both, table = (self.before, self.after), {}
        for name in without_idle_dampers(names, lambda x: max(float(y[x].max()) for y in both)):
            q = 0.05 if name.startswith("min_gap") else 0.95
            means = [float(np.mean(x[name])) for x in both]
            tails = [float(np.quantile(x[name], q)) for x in both]
            table[name] = dict(zip(_STATISTICS, means + tails, strict=True))
        return table

    @property
    def hardly_slipping(self) -> tuple[str, ...]:
        """Dampers that practically never slip after the design, each with its place if of several.

        Such a damper slides less than half the larger peak displacement of its ends, in the mean.
        """
        topology, dampers = self.topology or Topology(0, (), ()), []
        places, n = link_places(topology), len(topology.links)
        for k, ends in enumerate(topology.links):
            names = [of_link(name, k, n) for name in ("damper_force", "slip_distance")]
            force, slip = (float(self.after[name].mean()) for name in names)
            if isinstance(ends, WeightedMasses):
                continue
            moving = [f"peak_x{mass + 1}" for mass in masses_of(ends)]
            if force > 0 and slip < _STUCK * max(float(self.after[x].mean()) for x in moving):
                dampers.append(f"damper {places[k]}" if n > 1 else "damper")
        return tuple(dampers)

    def _tables(self) -> list[TextTable]:
        title = f"{len(self):,} earthquakes ({'SI' if self.si else 'dimensionless'})"
        columns = ("", "mean before", "mean after", "quantile before", "quantile after", "unit")
        rows: list[tuple[str | float, ...]] = [
            (in_words(name, self.topology), *row.values(), unit_of(name, self.si))
            for name, row in self.rows().items()
        ]
        notes = ["quantiles are of 95 %" + self.has_gaps * ", of the smallest gap of 5 %"]
        if self.has_gaps:
            shares = (100 * share for share in self.pounding)
            words = "pounding in {:.4g} % of them before, {:.4g} % after".format(*shares)
            n = len(self.topology.links) if self.topology else 0
            gaps = [self.before.get(of_link("min_gap", k, n), np.inf) for k in range(n)]
            notes.append(words + checked_floors(self.topology, gaps))
            wider = self.difference("min_gap")
            notes.append(f"min gap wider by {wider} {unit('length', self.si)} on average")
        if (name := self.objective_function.demand) != "min_gap":
            change = f"{self.difference(name)} {unit_of(name, self.si)}"
            notes.append(f"{in_words(name, self.topology)} changed by {change} on average")
        notes += [f"the {damper} practically never slips" for damper in self.hardly_slipping]
        symbol = unit(self.objective_function.quantity, self.si)
        notes.append(f"objective {self.objective['after']} {symbol}".rstrip())
        return [TextTable(title, columns, rows, notes, digits=4)]


class Landscape(NamedTuple):
    """Objective and violation (largest relative excess over a limit) over two variables, (n, n).

    Limited probabilities are by value and slopes of their logarithms at the design.
    """

    x: str
    y: str
    x_values: np.ndarray
    y_values: np.ndarray
    objective: np.ndarray
    violation: np.ndarray


class SearchHistory(NamedTuple):
    """All iterates of a search; a start that was dropped keeps its last design."""

    objective: np.ndarray
    """Goal less penalties, shape (k, s): iterations and starts."""
    violation: np.ndarray
    """Largest relative excess over a limit, shape (k, s)."""
    limited_demands: np.ndarray
    """Limited demands, shape (k, s, m); probabilities as the search approximates them."""
    shares: np.ndarray
    """Scaled variables (0 to 1 between the bounds), shape (k, s, d)."""
    alive: np.ndarray
    """Whether all values of a start have been finite, shape (k, s)."""

    @classmethod
    def of(cls, iterates: Sequence[Iterate], limits: Sequence[Limit]) -> SearchHistory:
        """The iterates of a search, stacked."""
        points = jax.tree.map(lambda *rows: np.array(rows), *[x.here for x in iterates])
        reached = [limit.reached(points.limited[..., i]) for i, limit in enumerate(limits)]
        limited_demands = np.stack(reached, axis=-1) if limits else points.limited
        alive = np.array([iterate.alive for iterate in iterates])
        return cls(points.objective, points.violation, limited_demands, points.scaled, alive)


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Design(Shown):
    """The best structures of a search, and how they were found."""

    objective_function: Objective
    history: SearchHistory
    limited_demands: dict[str, float]
    """Limited demands, by name; of a limit with a probability the estimated probability."""
    active_bounds: dict[str, str]
    """Variables at an active bound, "low" or "high": the objective would be better beyond it."""
    gradient: dict[str, float]
    """Gradient of the Lagrangian (objective less multipliers × excesses), by scaled variable."""
    multipliers: dict[str, float]
    """Gain of the objective per relative change of each limit, in the objective's unit."""
    limit_tolerance: float
    """Relative excess over a limit that is tolerated."""
    simulations: int
    """Runs with gradients in iterations and polishing; those of line searches are not counted."""
    trained: Comparison
    """Before (at the first start) and after, on the ensemble of the search."""
    fresh: Comparison | None
    """The same on earthquakes that the search did not use."""
    shares: np.ndarray
    """Its scaled variables (0 to 1 between the bounds), shape (d,)."""
    objective: float
    """Goal less penalties on the ensemble of the search."""
    winner: int
    """The start of the best design, from 0."""
    stopped: str
    """Why the search ended."""
    events: dict[str, RareEvent]
    """The rare events whose probabilities are limited, at the design, by the demand's name."""
    _log_ratios: LogRatios  # of these probabilities
    _first: np.ndarray
    _problem: DesignProblem

    @cached_property
    def structures(self) -> Any:
        """The design, of the kind and in the units of the space's nominal structures."""
        return jax.tree.map(float, self.space.structures(jnp.asarray(self.shares)))

    @property
    def space(self) -> DesignSpace:
        """The design space."""
        return self._problem.space

    @property
    def dropped(self) -> dict[int, int]:
        """Starts that were dropped because a value was not finite, and their last iterations."""
        alive = self.history.alive
        return {i: int(np.argmin(alive[:, i])) for i in np.flatnonzero(~alive[-1]).tolist()}

    @property
    def active_limits(self) -> tuple[str, ...]:
        """The limits that the design reaches, to their tolerance."""
        return tuple(
            demand
            for demand, limit in self.objective_function.limits.items()
            if limit.limited(self.limited_demands[demand]) / limit.bound
            > 1 - 2 * self.limit_tolerance
        )

    @property
    def gradient_norm(self) -> float:
        """Norm of the gradient's components that are not at an active bound."""
        free = [x for path, x in self.gradient.items() if path not in self.active_bounds]
        return float(np.linalg.norm(free))

    @property
    def values(self) -> dict[str, float]:
        """The variables by path."""
        return {path: float(x) for path, x in self.space.values(self.shares).items()}

    @property
    def start(self) -> dict[str, float]:
        """The variables by path, before (at the first start)."""
        return {path: float(x) for path, x in self.space.values(self._first).items()}

    def compare(self, ensemble: Ensemble) -> Comparison:
        """Before and after on other earthquakes."""
        instance("ensemble", ensemble, Ensemble)
        self.space.require_certain(ensemble.uncertain)
        before, after = (self._problem.evaluate(x, ensemble) for x in (self._first, self.shares))
        return dataclasses.replace(self.trained, before=before, after=after)

    def landscape(self, x: str, y: str, n: int = 15) -> Landscape:
        """Objective and violation over two variables, all others as designed.

        ``x`` and ``y`` are the paths of two variables; of each there are n ≥ 2 values, evenly
        spaced between the bounds on their scale.
        """
        names = self.space.names
        for name, path in (("x", x), ("y", y)):
            require_one_of(path, names, name)
        if x == y:
            raise InvalidInput("x = y", repr(x), "must be two variables")
        enforce([Rule("n", n, count("n", n) >= 2, "at least 2")])
        i, j = names.index(x), names.index(y)
        shares = np.tile(self.shares, (n, n, 1))
        shares[..., i], shares[..., j] = np.meshgrid(*[np.linspace(0, 1, n)] * 2)
        problem, function = self._problem, self.objective_function
        limits = np.array([limit.bound for limit in function.limits.values()])
        objective, violation = np.empty((n, n)), np.empty((n, n))
        for place in np.ndindex(n, n):
            columns = problem.evaluate(shares[place], problem.ensemble)
            limited = problem.limited(shares[place], columns, self._log_ratios)
            objective[place] = float(function.value(columns))
            violation[place] = (np.asarray(limited) / limits - 1).max(initial=-1.0)
        values = jax.device_get(self.space.values(shares))
        return Landscape(x, y, values[x], values[y], objective, violation)

    def _tables(self) -> list[TextTable]:
        si, symbol = self.trained.si, unit(self.objective_function.quantity, self.trained.si)
        variables = []
        for (path, x), before in zip(self.values.items(), self.start.values(), strict=True):
            change = f"{100 * (x / before - 1):+.3g} %" if before else ""
            end = self.active_bounds.get(path)
            variables.append((path, before, x, change, f"at its {end} bound" if end else ""))
        notes = [f"gradient within the bounds {self.gradient_norm:.2g}"]
        for start, iteration in self.dropped.items():
            notes.append(f"start {start + 1} dropped at iteration {iteration}: not finite")
        title = f"Design by start {self.winner + 1} of {self.history.objective.shape[1]}"
        title += f": objective {self.objective:.6g}{symbol and f' {symbol}'}"
        title += f" ({self.stopped}, {self.simulations:,} runs with gradient)"
        units = "SI" if in_si(self.space.nominal) else "dimensionless"
        columns = (f"variable ({units})", "before", "after", "change", "")
        tables = [TextTable(title, columns, variables, notes)]
        limits = []
        for demand, limit in self.objective_function.limits.items():
            is_rare = demand in self.events
            name = limit.event(demand) if is_rare else demand
            demand_unit = "" if is_rare else unit_of(demand, si)
            active = "active limit" if demand in self.active_limits else ""
            reached = self.limited_demands[demand]
            limits.append((name, reached, limit.most, demand_unit, limit.statistic, active))
        if limits:
            headings = ("", "reached", "at most", "unit", "statistic", "")
            tables.append(TextTable("limits", headings, limits))
        for words, comparison in (("trained on", self.trained), ("fresh:", self.fresh)):
            if comparison is not None:
                (table,) = comparison._tables()
                tables.append(table._replace(title=f"{words} {table.title}"))
        return tables
