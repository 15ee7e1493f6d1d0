"""A design beside the one before it, earthquake by earthquake."""

from __future__ import annotations

import dataclasses
from functools import cached_property
from typing import Any

import jax
import numpy as np
from scipy import stats

from jaxpound._checks import require_share
from jaxpound._tables import Shown, Table
from jaxpound.design.objective import Objective
from jaxpound.quantities import unit
from jaxpound.results.demand import in_words, unit_of
from jaxpound.study.statistics import Estimate

_REPLICATES = 500  # of the bootstrap


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Comparison(Shown):
    """Demands before and after, of the same earthquakes.

    ``before[name]`` and ``after[name]`` are columns, shape (n,): the smallest gap, the gap at rest
    and every price of ``Objective``. Intervals are of 95 %; of fewer than two earthquakes there are
    none, and their ends are NaN.
    """

    before: dict[str, np.ndarray]
    after: dict[str, np.ndarray]
    objective_function: Objective
    si: bool

    def __len__(self) -> int:
        return len(self.before["min_gap"])

    def difference(self, name: str = "min_gap", confidence: float = 0.95) -> Estimate:
        """Mean of after − before, earthquake by earthquake, with Student's interval."""
        require_share("difference", "confidence", confidence)
        if name not in self.before:
            raise ValueError(f"difference: {name!r} must be one of {', '.join(self.before)}")
        d = self.after[name] - self.before[name]
        mean = float(np.mean(d))
        if len(d) < 2:
            return Estimate(mean, np.nan, np.nan, confidence)
        half = np.std(d, ddof=1) / len(d) ** 0.5
        half = float(half * stats.t.isf((1 - confidence) / 2, len(d) - 1))
        return Estimate(mean, mean - half, mean + half, confidence)

    @cached_property
    def objective(self) -> dict[str, Estimate]:
        """Objective before, after, and after less before, with bootstrap intervals.

        Of what a single earthquake decides (``WorstGap``) they say nothing reliable.
        """
        n, rng = len(self), np.random.default_rng(0)

        @jax.jit
        def value(columns: dict[str, Any], rows: Any) -> Any:
            return self.objective_function.value({k: x[rows] for k, x in columns.items()})

        replicates = _REPLICATES if n > 1 else 0  # draws of one earthquake are all the same
        draws = np.concatenate([[np.arange(n)], rng.integers(0, n, (replicates, n))])
        values = [
            np.array([float(value(columns, rows)) for rows in draws])
            for columns in (self.before, self.after)
        ]
        found = {"before": values[0], "after": values[1], "difference": values[1] - values[0]}
        ends = {
            name: np.quantile(x[1:], [0.025, 0.975]) if n > 1 else [np.nan, np.nan]
            for name, x in found.items()
        }
        return {name: Estimate(float(x[0]), *map(float, ends[name])) for name, x in found.items()}

    @property
    def pounding(self) -> tuple[float, float]:
        """Share of earthquakes in which the gap closes, before and after."""
        return tuple(float(np.mean(x["min_gap"] <= 0)) for x in (self.before, self.after))  # type: ignore[return-value]

    def rows(self) -> dict[str, dict[str, float]]:
        """Mean and 95 % quantile (5 % of the smallest gap) of every demand, before and after."""
        table = {}
        for name in self.before:
            if name == "initial_gap":
                continue
            q = 0.05 if name == "min_gap" else 0.95
            columns = (("before", self.before), ("after", self.after))
            table[name] = {
                f"{what}_{when}": float(f(x[name]))
                for what, f in (("mean", np.mean), ("tail", lambda y, q=q: np.quantile(y, q)))
                for when, x in columns
            }
        return table

    def _tables(self) -> list[Table]:
        return [
            Table(
                f"{len(self):,} earthquakes ({'SI' if self.si else 'dimensionless'})",
                ("", "mean before", "mean after", "quantile before", "quantile after", "unit"),
                [
                    (in_words(name), *row.values(), unit_of(name, self.si))
                    for name, row in self.rows().items()
                ],
                [
                    "quantiles are of 95 %, of the smallest gap of 5 %",
                    "pounding in {:.4g} % of them before, {:.4g} % after".format(
                        *(100 * share for share in self.pounding)
                    ),
                    f"min gap wider by {self.difference()} {unit('length', self.si)} on average",
                    f"objective {self.objective['after']} "
                    f"{unit(self.objective_function.quantity, self.si)}".rstrip(),
                ],
                digits=4,
            )
        ]
