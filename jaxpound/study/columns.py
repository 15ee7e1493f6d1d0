"""Columns of demands of many runs, read in parts, with weights: their moments and statistics."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, Self

import numpy as np
from jaxtyping import ArrayLike

from jaxpound._checks import array, number
from jaxpound._errors import InvalidInput
from jaxpound._tables import Shown
from jaxpound.ground.measure import Measure
from jaxpound.model.topology import Topology
from jaxpound.quantities import unit
from jaxpound.results.demand import Demand
from jaxpound.results.elements import Columnar
from jaxpound.results.named import in_words, is_demand, kind_of
from jaxpound.study import weighting
from jaxpound.study.statistics import Estimate, Moments, quantile
from jaxpound.study.weighting import Hits, Weighting, require_weights
from jaxpound.units import Scales


def in_rows(columns: Mapping[str, np.ndarray], *names: str) -> np.ndarray:
    """A column by its name, or several as the rows of an array: an archive is opened once."""
    return columns[names[0]] if len(names) == 1 else np.stack([columns[name] for name in names])


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class DemandColumns(Columnar, Shown):
    """The columns of a ``Study``, their units and weights, and statistics of single columns."""

    rows: Sequence[range]
    """Indices of the samples, range by range."""
    about: dict[str, Any]
    """The study's origin: versions, key, scenarios, grid, scheme, notes."""
    _moments: Mapping[str, Moments]
    _parts: Callable[..., Iterable[np.ndarray]]
    scales: Scales | None = None
    """What converts the stored numbers to SI units; None of dimensionless columns."""
    weighting: Weighting | None = None
    """The weights of the samples; None if all count the same."""

    def __len__(self) -> int:
        return sum(map(len, self.rows))

    @property
    def si(self) -> bool:
        """Whether columns are in SI units."""
        return self.scales is not None

    @property
    def indices(self) -> np.ndarray:
        """Indices of the samples, shape (n,)."""
        return np.concatenate(self.rows)

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(self._moments)

    @property
    def failed(self) -> int:
        """Number of runs that failed."""
        return len(self) - self._moments["pga"].n

    def __getitem__(self, name: str) -> np.ndarray:
        return self._read(self._column(name)) * self._factor(name)

    def finite(self, name: str) -> np.ndarray:
        """The finite numbers of a column: without the runs that failed or have no such number."""
        column = self[name]
        return column[np.isfinite(column)]

    @property
    def demand(self) -> Demand:
        """All demands as a batch."""
        demand = Demand.of_columns({name: self[name] for name in self.columns}, si=self.si)
        return dataclasses.replace(demand, topology=self.stored_topology)

    @property
    def stored_topology(self) -> Topology | None:
        """``topology``, by which columns are named; None of a store of an earlier version."""
        return self.topology if "topology" in self.about else None

    @property
    def topology(self) -> Topology:
        """Number of masses, and the ends of rods and links."""
        if "topology" not in self.about:  # a store of an earlier version
            raise ValueError("Study.topology: the store must be of this version; it lacks links")
        # Lists if they were read from a file.
        n_masses, rods, links, *tuned = self.about["topology"]
        rods, links = (tuple((i, j) for i, j in ends) for ends in (rods, links))
        return Topology(n_masses, rods, links, *map(tuple, tuned))

    def unit(self, name: str) -> str:
        """Unit of a column; empty for pure numbers and for user-defined columns."""
        return unit(self._quantity(self._column(name)), self.si)

    def measure(self, name: str) -> Measure:
        """The measure of intensity that a column holds, as far as it is known.

        A function of ``monte_carlo``'s ``measures`` may state it in a field ``measure``.
        """
        function = self.about["identity"]["measures"].get(name)
        if isinstance(function, dict) and isinstance(function.get("measure"), str):
            return Measure.of_text(function["measure"])
        return Measure(in_words(name, self.stored_topology), self.unit(name))

    def _column(self, name: str) -> str:
        """The name of an existing column; an ``InvalidInput`` for any other name."""
        if name not in self._moments:
            rule = f"must be one of {', '.join(self._moments)}"
            raise InvalidInput(f"column {name!r}", "", rule)
        return name

    def _read(self, *names: str) -> np.ndarray:
        return np.concatenate([*self._parts(*names)], axis=-1)

    def _quantity(self, name: str) -> str | None:
        """Kind of quantity of a column; None for pure numbers and for user-defined columns."""
        return kind_of(name) if is_demand(name) else None

    def _factor(self, name: str) -> float:
        """Factor from a column to SI units."""
        return 1.0 if self.scales is None else float(self.scales.unit_of(self._quantity(name)))

    def weighted(self, weights: str | ArrayLike, *, normalised: bool = True) -> Self:
        """The same study with weights: importance samples, or stripes weighted by their hazard.

        All its statistics then count every sample by its weight; ``study[name]`` and tables remain
        unweighted. Intervals are those of as many samples of equal weight as have the estimate's
        variance: Clopper and Pearson's with the effective size of Korn and Graubard (1998) for a
        probability, that of Woodruff (1952) for a quantile; a fragility has the covariance of White
        (1982).

        Parameters
        ----------
        weights
            The name of a column, such as that of one of ``monte_carlo``'s ``measures``, or the
            weights, shape (n,), in the order of ``indices``. Not negative, with a positive sum; for
            runs that failed any number or NaN.
        normalised
            Whether probabilities are divided by the sum of the weights, which then may have any
            scale; or, if False, by the number of samples that did not fail. The weights are then
            ratios of densities: probabilities are unbiased, and small ones far more accurate where
            the samples are concentrated on the event. Moments and fragilities are always
            normalised.
        """
        if isinstance(weights, str):
            column = self._moments[self._column(weights)]
            if column.n != len(self) - self.failed:
                rule = "must be finite in every run that did not fail"
                raise InvalidInput("weights", "", rule)
            require_weights(np.array([column.smallest, column.largest]))
        else:
            weights = array("weights", weights, (len(self),))
            if self.failed:
                weights = np.where(np.isnan(self._read("pga")), 0.0, weights)
            require_weights(weights)
        return dataclasses.replace(self, weighting=Weighting(weights, bool(normalised)))

    @property
    def weights(self) -> np.ndarray:
        """Weights of the samples, shape (n,): 1 without weights; NaN for runs that failed."""
        pairs = self._weighed(self._parts("pga"))
        return np.concatenate([np.where(np.isnan(x), np.nan, w) for x, w in pairs])

    @property
    def normalised(self) -> bool:
        """Whether probabilities are divided by the sum of the weights (``weighted``)."""
        return self.weighting is None or self.weighting.normalised

    def _weighed(self, parts: Iterable[np.ndarray]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Every part of a column with the weights of its samples."""
        by = None if self.weighting is None else self.weighting.by
        if isinstance(by, str):
            yield from zip(parts, self._parts(by), strict=True)
            return
        start = 0
        for part in parts:
            yield part, np.ones(len(part)) if by is None else by[start : start + len(part)]
            start += len(part)

    def moments(self, name: str) -> Moments:
        """Number, mean, standard deviation and extremes of a column, normalised with weights."""
        moments = self._moments[self._column(name)]
        if self.weighting is not None:
            pairs = ((x, w, np.isfinite(x)) for x, w in self._weighed(self._parts(name)))
            moments = sum((Moments.of(x[valid], w[valid]) for x, w, valid in pairs), Moments())
        return moments.times(self._factor(name))

    def quantile(self, name: str, share: float, confidence: float = 0.95) -> Estimate:
        """Quantile of a column by ``statistics.quantile``, or by ``weighting.quantile``."""
        if self.weighting is None:
            return quantile(self.finite(name), share, confidence)
        column = self[name]
        valid = np.isfinite(column)
        weights = self.weights[valid]
        return weighting.quantile(column[valid], weights, share, self.normalised, confidence)

    def exceedance(self, name: str, value: float, confidence: float = 0.95) -> Estimate:
        """Probability that a column exceeds a value, with Clopper and Pearson's interval.

        The infinite time of the first impact, of a run without impact, exceeds any value.
        """
        parts, factor = self._parts(self._column(name)), self._factor(name)
        value = float(number("value", value))
        over = (np.where(np.isnan(x), np.nan, x * factor > value) for x in parts)
        return self._hits(over).estimate(self.normalised, confidence)

    def counts(self, name: str = "n_impacts", confidence: float = 0.95) -> dict[int, Estimate]:
        """Probability of every number that occurred in a column, with Clopper-Pearson intervals.

        The column must have whole numbers, such as ``n_impacts`` (with several links
        ``n_impacts_1`` and so on).
        """
        column = self.finite(name)
        if (column % 1).any():
            raise InvalidInput(f"the numbers of {name!r}", "", "must be whole")
        w = self.weights[np.isfinite(self[name])]
        hits = {int(number): Hits.of(column == number, w) for number in np.unique(column)}
        return {n: sums.estimate(self.normalised, confidence) for n, sums in hits.items()}

    def _hits(self, parts: Iterable[np.ndarray]) -> Hits:
        """Sums over the parts of a column that is 1, 0 or, where it is unknown, NaN."""
        pairs = ((x, w, ~np.isnan(x)) for x, w in self._weighed(parts))
        return sum((Hits.of(x[valid] == 1, w[valid]) for x, w, valid in pairs), Hits())
