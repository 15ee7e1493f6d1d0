"""A design: the structures that a search ended with, and how it came there."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from jaxpound._checks import Rule, count, enforce, instance
from jaxpound._tables import Shown, Table
from jaxpound.design.comparison import Comparison
from jaxpound.design.ensemble import Ensemble
from jaxpound.design.objective import Objective
from jaxpound.design.space import DesignSpace
from jaxpound.model.structures import AdjacentStructures
from jaxpound.quantities import unit
from jaxpound.results.demand import unit_of


class Landscape(NamedTuple):
    """Objective and violation over two variables, shape (n, n) each.

    The violation is the largest share by which a limit is exceeded, negative within all limits.
    """

    x: str
    y: str
    x_values: np.ndarray
    y_values: np.ndarray
    objective: np.ndarray
    violation: np.ndarray


class History(NamedTuple):
    """All that was met on the way; a start that was dropped stays where it was."""

    objective: np.ndarray
    """Shape (k, s): iterations and starts."""
    violation: np.ndarray
    """Shape (k, s)."""
    prices: np.ndarray
    """What is limited, shape (k, s, m)."""
    shares: np.ndarray
    """Where every start was between the bounds, shape (k, s, d)."""
    alive: np.ndarray
    """Whether a start was still finite, shape (k, s)."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Design(Shown):
    """The structures that a search ended with, and how it came there."""

    space: DesignSpace
    structures: AdjacentStructures
    """The design; dimensionless."""
    shares: np.ndarray
    """Where it is between the bounds, shape (d,)."""
    objective: float
    """Goal less penalties on the ensemble that it was made for."""
    prices: dict[str, float]
    """What is limited, by price."""
    objective_function: Objective
    history: History
    winner: int
    """The start that found it, from 0."""
    dropped: dict[int, int]
    """Starts that were dropped because something was not finite, and their last iterations."""
    active_bounds: dict[str, str]
    """Variables that stand at a bound, "low" or "high", because the objective would leave it."""
    gradient: dict[str, float]
    """Of the objective, with multipliers for the limits, by shares of the way between bounds."""
    gradient_norm: float
    """Of the gradient's components that no bound holds."""
    multipliers: dict[str, float]
    """What a relative change of each limit is worth, in the objective's unit."""
    limit_tolerance: float
    """By which share a limit may be exceeded."""
    stopped: str
    """Why the search ended."""
    simulations: int
    """Runs with their gradients, of iterations and polishing; line searches are not counted."""
    trained: Comparison
    """Before (the first start) and after, on the ensemble that it was made for."""
    fresh: Comparison | None
    """The same on earthquakes that it was not made for."""
    _evaluate: Callable[[np.ndarray, Ensemble], dict[str, np.ndarray]]
    _first: np.ndarray
    _ensemble: Ensemble

    @property
    def values(self) -> dict[str, float]:
        """The variables by path."""
        return {path: float(x) for path, x in self.space.numbers(self.shares).items()}

    @property
    def start(self) -> dict[str, float]:
        """The variables before."""
        return {path: float(x) for path, x in self.space.numbers(self._first).items()}

    def compare(self, ensemble: Ensemble) -> Comparison:
        """Before and after on other earthquakes."""
        instance("Design.compare", "ensemble", ensemble, Ensemble)
        self.space.require_certain("Design.compare", ensemble.uncertain)
        return Comparison(
            self._evaluate(self._first, ensemble),
            self._evaluate(self.shares, ensemble),
            self.objective_function,
            self.trained.si,
        )

    def landscape(self, x: str, y: str, n: int = 15) -> Landscape:
        """Objective and violation over two variables, all others as designed.

        Parameters
        ----------
        x, y
            Paths of the variables.
        n
            Points along each, evenly spaced between the bounds as these are scaled.

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
        ticks, rows = np.linspace(0, 1, n), []
        for share in ticks:
            row = np.tile(self.shares, (n, 1))
            row[:, i], row[:, j] = ticks, share
            rows.append(row)
        at = np.concatenate(rows)
        found = [self._evaluate(shares, self._ensemble) for shares in at]
        function = self.objective_function
        objective = np.array([float(function.value(columns)) for columns in found])
        limits = np.array([limit.at_most for limit in function.limits.values()])
        prices = np.array([function.prices(columns) for columns in found])
        violation = (prices / limits - 1).max(axis=1, initial=-1.0)
        values, shape = self.space.numbers(at), (n, n)
        return Landscape(
            x,
            y,
            values[x].reshape(shape),
            values[y].reshape(shape),
            objective.reshape(shape),
            violation.reshape(shape),
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
                (price, self.prices[price], limit.at_most, unit_of(price, si))
                for price, limit in limits.items()
            ]
            tables.append(Table("limits", ("", "reached", "at most", "unit"), rows))
        for words, comparison in (("trained on", self.trained), ("fresh:", self.fresh)):
            if comparison is not None:
                (table,) = comparison._tables()
                tables.append(table._replace(title=f"{words} {table.title}"))
        return tables
