"""The result of a search: its design, its history, and demands before and after."""

from __future__ import annotations

import dataclasses
from functools import cached_property
from typing import Any, NamedTuple

import jax
import numpy as np

from jaxpound._checks import Rule, count, enforce, instance, require_share
from jaxpound._tables import Shown, Table
from jaxpound.design.ensemble import Ensemble
from jaxpound.design.objective import Objective
from jaxpound.design.problem import DesignProblem, LogRatios
from jaxpound.design.space import DesignSpace
from jaxpound.model.places import link_places
from jaxpound.model.system import GROUND, Topology
from jaxpound.quantities import unit
from jaxpound.results.demand import in_words, unit_of
from jaxpound.results.elements import of_link, without_idle_dampers
from jaxpound.risk.rare_event import RareEvent
from jaxpound.study.statistics import Estimate

_REPLICATES = 500  # of the bootstrap
_HARDLY = 0.5  # distance slid over the peak displacement below which a damper hardly slips


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Comparison(Shown):
    """Demands before and after the design, in the same earthquakes.

    ``before[name]`` and ``after[name]`` are columns, shape (n,): the smallest gap (of several links
    also of each, ``min_gap_1`` and so on) and the gap at rest (the mean of those that are finite),
    where there is one, and every demand that an ``Objective`` can limit. Intervals are of 95 %;
    with fewer than two earthquakes their ends are NaN.
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
        """Mean of after − before, earthquake by earthquake, with Student's interval.

        Of a column by name; by default the one that the goal is of (``Objective.demand``).
        """
        from scipy import stats  # only here: it takes a second to import

        require_share("difference", "confidence", confidence)
        name = self.objective_function.demand if name is None else name
        if name not in self.before:
            raise ValueError(f"difference: {name!r} must be one of {', '.join(self.before)}")
        d = self.after[name] - self.before[name]
        mean, half = float(np.mean(d)), np.nan
        if len(d) > 1:  # ttest_1samp gives no interval where all differences are the same
            half = float(stats.sem(d) * stats.t.isf((1 - confidence) / 2, len(d) - 1))
        return Estimate(mean, mean - half, mean + half, confidence)

    @cached_property
    def objective(self) -> dict[str, Estimate]:
        """Objective before, after, and after less before, with bootstrap intervals.

        The intervals are not reliable for a goal that one earthquake decides (``WorstGap``).
        """
        from scipy import stats  # only here: it takes a second to import

        function = self.objective_function
        value = jax.jit(
            lambda columns, rows: function.value(jax.tree.map(lambda x: x[rows], columns))
        )

        def values(rows: np.ndarray, axis: int = -1) -> np.ndarray:  # rows: shape (1, n)
            before, after = (float(value(x, rows[0])) for x in (self.before, self.after))
            return np.array([[before], [after], [after - before]])

        every, ends = np.arange(len(self)), np.full((2, 3), np.nan)
        if len(self) > 1:
            how: dict[str, Any] = {"method": "percentile", "batch": 1, "rng": 0}
            resampled = stats.bootstrap((every,), values, n_resamples=_REPLICATES, **how)
            ends = resampled.confidence_interval
        rows = zip(("before", "after", "difference"), values(every[None])[:, 0], *ends, strict=True)
        return {name: Estimate(*map(float, numbers)) for name, *numbers in rows}

    @property
    def pounding(self) -> tuple[float, float]:
        """Share of earthquakes in which the gap closes, before and after; 0 without a gap."""
        both = self.before, self.after
        return tuple(float(np.mean(x.get("min_gap", np.inf) <= 0)) for x in both)  # type: ignore[return-value]

    def rows(self) -> dict[str, dict[str, float]]:
        """Mean and 95 % quantile (5 % of the smallest gap) of every demand, before and after.

        The slip of links whose friction is 0 before and after is left out.
        """
        table = {}
        for name in self._told():
            q = 0.05 if name.startswith("min_gap") else 0.95
            columns = (("before", self.before), ("after", self.after))
            table[name] = {
                f"{what}_{when}": float(f(x[name]))
                for what, f in (("mean", np.mean), ("tail", lambda y, q=q: np.quantile(y, q)))
                for when, x in columns
            }
        return table

    @property
    def hardly_slipping(self) -> tuple[str, ...]:
        """Dampers that practically never slip after the design, each with its place if of several.

        Such a damper slides less in a whole earthquake than half the larger of the peak
        displacements that its ends have, all in the mean: it joins them as a rigid link would.
        """
        topology, found = self.topology or Topology(0, (), ()), []
        places, n = link_places(topology), len(topology.links)
        for k, ends in enumerate(topology.links):
            force, slid = (
                float(self.after[of_link(name, k, n)].mean())
                for name in ("damper_force", "slip_distance")
            )
            sways = (float(self.after[f"peak_x{i + 1}"].mean()) for i in ends if i != GROUND)
            if force > 0 and slid < _HARDLY * max(sways):
                found.append(f"damper {places[k]}" if n > 1 else "damper")
        return tuple(found)

    def _told(self) -> list[str]:
        """Names of the columns that tables tell of."""
        names = [name for name in self.before if name != "initial_gap"]
        both = self.before, self.after
        return without_idle_dampers(names, lambda name: max(float(x[name].max()) for x in both))

    def _tables(self) -> list[Table]:
        return [
            Table(
                f"{len(self):,} earthquakes ({'SI' if self.si else 'dimensionless'})",
                ("", "mean before", "mean after", "quantile before", "quantile after", "unit"),
                [
                    (in_words(name, self.topology), *row.values(), unit_of(name, self.si))
                    for name, row in self.rows().items()
                ],
                self._notes(),
                digits=4,
            )
        ]

    def _notes(self) -> list[str]:
        found = ["quantiles are of 95 %" + self.has_gaps * ", of the smallest gap of 5 %"]
        if self.has_gaps:
            shares = (100 * share for share in self.pounding)
            found.append("pounding in {:.4g} % of them before, {:.4g} % after".format(*shares))
            wider = self.difference("min_gap")
            found.append(f"min gap wider by {wider} {unit('length', self.si)} on average")
        if (name := self.objective_function.demand) != "min_gap":
            of = unit_of(name, self.si)
            words = in_words(name, self.topology)
            found.append(f"{words} changed by {self.difference(name)} {of} on average")
        found += [f"the {damper} practically never slips" for damper in self.hardly_slipping]
        of = unit(self.objective_function.quantity, self.si)
        return [*found, f"objective {self.objective['after']} {of}".rstrip()]


class Landscape(NamedTuple):
    """Objective and violation over two variables, shape (n, n) each.

    The violation is the largest relative excess over a limit, negative within all limits. Limited
    probabilities are by value and slopes of their logarithms at the design.
    """

    x: str
    y: str
    x_values: np.ndarray
    y_values: np.ndarray
    objective: np.ndarray
    violation: np.ndarray


class History(NamedTuple):
    """All iterates of a search; a start that was dropped keeps its last design."""

    objective: np.ndarray
    """Goal less penalties, shape (k, s): iterations and starts."""
    violation: np.ndarray
    """Largest relative excess over a limit, shape (k, s)."""
    prices: np.ndarray
    """Limited demands, shape (k, s, m); probabilities as the search approximates them."""
    shares: np.ndarray
    """Scaled variables (0 to 1 between the bounds), shape (k, s, d)."""
    alive: np.ndarray
    """Whether a start was still finite, shape (k, s)."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Design(Shown):
    """The best structures of a search, and how they were found."""

    structures: Any
    """The design, of the kind of the space's nominal structures; dimensionless."""
    shares: np.ndarray
    """Its scaled variables (0 to 1 between the bounds), shape (d,)."""
    objective: float
    """Goal less penalties on the ensemble that it was made for."""
    prices: dict[str, float]
    """Limited demands, by name; of a limit with a probability that which was estimated."""
    events: dict[str, RareEvent]
    """The rare events whose probabilities are limited, at the design, by the demand's name."""
    objective_function: Objective
    history: History
    winner: int
    """The start that found it, from 0."""
    active_bounds: dict[str, str]
    """Variables at an active bound, "low" or "high": the objective would be better beyond it."""
    gradient: dict[str, float]
    """Gradient of the Lagrangian (objective less multipliers × excesses), by scaled variable."""
    multipliers: dict[str, float]
    """Gain of the objective per relative change of each limit, in the objective's unit."""
    limit_tolerance: float
    """Relative excess over a limit that is tolerated."""
    stopped: str
    """Why the search ended."""
    simulations: int
    """Runs with gradients in iterations and polishing; those of line searches are not counted."""
    trained: Comparison
    """Before (at the first start) and after, on the ensemble that it was made for."""
    fresh: Comparison | None
    """The same on earthquakes that it was not made for."""
    _first: np.ndarray
    _problem: DesignProblem
    _log_ratios: LogRatios

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
            price
            for price, limit in self.objective_function.limits.items()
            if limit.limited(self.prices[price]) / limit.bound > 1 - 2 * self.limit_tolerance
        )

    @property
    def gradient_norm(self) -> float:
        """Norm of the gradient's components that are not at an active bound."""
        free = [x for path, x in self.gradient.items() if path not in self.active_bounds]
        return float(np.linalg.norm(free))

    @property
    def values(self) -> dict[str, float]:
        """The variables by path."""
        return {path: float(x) for path, x in self.space.numbers(self.shares).items()}

    @property
    def start(self) -> dict[str, float]:
        """The variables by path, before (at the first start)."""
        return {path: float(x) for path, x in self.space.numbers(self._first).items()}

    def compare(self, ensemble: Ensemble) -> Comparison:
        """Before and after on other earthquakes."""
        instance("Design.compare", "ensemble", ensemble, Ensemble)
        self.space.require_certain("Design.compare", ensemble.uncertain)
        return Comparison(
            self._problem.evaluate(self._first, ensemble),
            self._problem.evaluate(self.shares, ensemble),
            self.objective_function,
            self.trained.si,
            self.trained.topology,
        )

    def landscape(self, x: str, y: str, n: int = 15) -> Landscape:
        """Objective and violation over two variables, all others as designed.

        Parameters
        ----------
        x, y
            Paths of the variables.
        n
            Points along each, evenly spaced between the bounds on their scale.

        Raises
        ------
        ValueError
            If x or y is no variable, both are the same, or n < 2.
        """
        names = self.space.names
        for name, path in (("x", x), ("y", y)):
            if path not in names:
                raise ValueError(f"landscape: {name} = {path!r} must be one of {', '.join(names)}")
        if x == y:
            raise ValueError(f"landscape: x = y = {x!r} must be two variables")
        enforce("landscape", [Rule("n", n, count("landscape", "n", n) >= 2, "at least 2")])
        i, j = names.index(x), names.index(y)
        at = np.tile(self.shares, (n, n, 1))
        at[..., i], at[..., j] = np.meshgrid(*[np.linspace(0, 1, n)] * 2)
        problem = self._problem
        found = [problem.evaluate(scaled, problem.ensemble) for scaled in at.reshape(n * n, -1)]
        function = self.objective_function
        objective = np.array([float(function.value(columns)) for columns in found])
        limits = np.array([limit.bound for limit in function.limits.values()])
        flat = zip(at.reshape(n * n, -1), found, strict=True)
        prices = np.array([problem.limited(*one, self._log_ratios) for one in flat])
        violation = (prices / limits - 1).max(axis=1, initial=-1.0)
        values = self.space.numbers(at)
        return Landscape(
            x=x,
            y=y,
            x_values=values[x],
            y_values=values[y],
            objective=objective.reshape(n, n),
            violation=violation.reshape(n, n),
        )

    def _tables(self) -> list[Table]:
        before, si = self.start, self.trained.si
        own = unit(self.objective_function.quantity, si)
        tables = [
            Table(
                f"Design by start {self.winner + 1} of {self.history.objective.shape[1]}: "
                f"objective {self.objective:.6g}{own and f' {own}'} "
                f"({self.stopped}, {self.simulations:,} runs with gradient)",
                ("variable (dimensionless)", "before", "after", "change", ""),
                [
                    (
                        path,
                        before[path],
                        value,
                        f"{100 * (value / before[path] - 1):+.3g} %" if before[path] else "",
                        f"at its {self.active_bounds[path]} bound"
                        if path in self.active_bounds
                        else "",
                    )
                    for path, value in self.values.items()
                ],
                [
                    f"gradient within the bounds {self.gradient_norm:.2g}",
                    *(
                        f"start {start + 1} dropped at iteration {iteration}: not finite"
                        for start, iteration in self.dropped.items()
                    ),
                ],
            )
        ]
        if limits := self.objective_function.limits:
            rows = [
                (
                    limit.event(price) if price in self.events else price,
                    self.prices[price],
                    limit.most,
                    "" if price in self.events else unit_of(price, si),
                    "active limit" if price in self.active_limits else "",
                )
                for price, limit in limits.items()
            ]
            tables.append(Table("limits", ("", "reached", "at most", "unit", ""), rows))
        for words, comparison in (("trained on", self.trained), ("fresh:", self.fresh)):
            if comparison is not None:
                (table,) = comparison._tables()
                tables.append(table._replace(title=f"{words} {table.title}"))
        return tables
