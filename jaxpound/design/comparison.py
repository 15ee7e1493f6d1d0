"""A design beside the one before it, earthquake by earthquake."""

from __future__ import annotations

import dataclasses
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

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
        from scipy import stats  # only here: it takes a second to import

        require_share("difference", "confidence", confidence)
        if name not in self.before:
            raise ValueError(f"difference: {name!r} must be one of {', '.join(self.before)}")
        d = self.after[name] - self.before[name]
        if len(d) < 2:
            return Estimate(float(np.mean(d)), np.nan, np.nan, confidence)
        low, high = stats.ttest_1samp(d, 0.0).confidence_interval(confidence)
        return Estimate(float(np.mean(d)), float(low), float(high), confidence)

    @cached_property
    def objective(self) -> dict[str, Estimate]:
        """Objective before, after, and after less before, with bootstrap intervals.

        Of what a single earthquake decides (``WorstGap``) they say nothing reliable.
        """
        from scipy import stats  # only here: it takes a second to import

        @jax.jit
        def both(columns: Any, rows: Any) -> Any:
            drawn = [{name: x[rows] for name, x in one.items()} for one in columns]
            before, after = map(self.objective_function.value, drawn)
            return jnp.stack([before, after, after - before])

        columns = (self.before, self.after)
        every = np.arange(len(self))
        ends = np.full((2, 3), np.nan)
        if len(self) > 1:  # draws of one earthquake are all the same
            ends = stats.bootstrap(
                (every,),
                lambda rows: np.asarray(both(columns, rows)),
                vectorized=False,
                n_resamples=_REPLICATES,
                method="percentile",
                rng=np.random.default_rng(0),
            ).confidence_interval
        names = ("before", "after", "difference")
        found = zip(names, np.asarray(both(columns, every)), *ends, strict=True)
        return {name: Estimate(*map(float, three)) for name, *three in found}

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
