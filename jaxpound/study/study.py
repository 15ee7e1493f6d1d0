"""The result of a Monte Carlo study: pounding, required gaps, fragilities, correlations."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from os import PathLike
from typing import TYPE_CHECKING, Any

import jax
import numpy as np
from jaxtyping import ArrayLike

from jaxpound._checks import array, is_whole, not_negative, number, require_one_of, require_share
from jaxpound._errors import InvalidInput
from jaxpound._extras import require
from jaxpound._tables import Shown, TextTable
from jaxpound.ground.measure import Measure
from jaxpound.model.places import link_places
from jaxpound.model.row import checked_floors
from jaxpound.model.topology import Topology, floors, stored_ends
from jaxpound.quantities import column, unit
from jaxpound.results.elements import Columnar, described, of_link, without_idle_dampers
from jaxpound.results.named import event_in_words, in_words, is_demand, kind_of
from jaxpound.scenarios.scenarios import ScenarioSet, parameter_names, parameters
from jaxpound.store.archive import DamagedError
from jaxpound.store.store import Store
from jaxpound.study import weighting
from jaxpound.study.chunk import finished, total
from jaxpound.study.fragility import Fragility, fit_fragility
from jaxpound.study.gaps import RequiredGaps, Separation, double_difference_correlation, srss
from jaxpound.study.sources import citation_of
from jaxpound.study.statistics import Estimate, Moments, quantile
from jaxpound.study.weighting import Hits, Weighting, correlation, require_weights
from jaxpound.units import Scales

if TYPE_CHECKING:
    from xarray import Dataset


def in_rows(columns: Mapping[str, np.ndarray], *names: str) -> np.ndarray:
    """A column by its name, or several as the rows of an array: an archive is opened once."""
    return columns[names[0]] if len(names) == 1 else np.stack([columns[name] for name in names])


def _parts_of_store(store: Store, chunks: Sequence[int], *names: str) -> Iterator[np.ndarray]:
    """A column of a store, or several as rows, chunk by chunk."""
    for chunk in chunks:
        reason = f"chunk {chunk} is missing"
        try:
            part = store.read(chunk, names)
        except DamagedError as error:
            part, reason = None, str(error)
        if part is None:
            raise ValueError(f"store {store.folder}: {reason}; run monte_carlo again")
        yield in_rows(part, *names)


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Study(Columnar, Shown):
    """Demands of many random scenarios, column by column; ``monte_carlo`` makes it.

    ``study[name]`` is a column, shape (n,): every scalar of ``Demand``; ``required_gap``, the
    smallest gap at rest without pounding, initial gap − min gap, if no link has a law of contact
    (after a contact the blocks' motion without it is unknown); the requested measures and
    parameters. Each of several links has its own, ``required_gap_1`` and so on; ``required_gap`` is
    then the largest, which is enough for all links. Structures with storeys also have
    ``peak_drift`` and ``peak_acceleration``, the largest of all storeys and floors; several links,
    some with a law of contact, ``peak_contact``, ``peak_impulse`` and ``peak_penetration``.

    Columns of a store are read one by one, so that n may exceed the memory. Runs that failed are
    NaN and left out of all statistics. Columns of ``Buildings`` are in SI units, else dimensionless
    as in eq. (9). As a table (``to_pandas``, ``to_csv``, ``to_parquet``) it has a row for each
    sample.

    ``first_impact_time`` is infinite in runs without an impact, ``first_yield_time_1`` in those
    without a yield. Their moments, quantiles and correlations are those of the runs with one, of
    which ``exceedance("n_impacts", 0)`` is the probability. Intervals of Sobol points, which are
    not independent, are usually too wide.
    """

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
    scenarios: ScenarioSet | None = None
    points: Callable[[], np.ndarray] | None = None
    """Function that computes the points z of the samples, shape (n, d); None without scenarios."""

    @staticmethod
    def open(folder: str | PathLike[str]) -> Study:
        """The study in a store: its finished chunks, in the units in which it was made.

        A warning names damaged chunks, which are left out. Raises ``ValueError`` if the folder
        holds no study, or no finished chunk.
        """
        store = Store(folder)
        identity = store.manifest["identity"]
        if other := identity.get("search"):
            raise ValueError(f"store {folder} must hold a study, but holds {other}")
        if not (moments := dict(finished(store, store.held()))):
            raise ValueError(f"store {folder} must hold at least one finished chunk")
        if scales := identity["scales"]:
            scales = Scales(scales["mass"], scales["frequency"], scales["gravity"])
        return Study.of_store(store, moments, scales=scales or None)

    @staticmethod
    def of_store(store: Store, moments: Mapping[int, Mapping[str, Moments]], **more: Any) -> Study:
        """The study of some chunks of a store, whose columns have these moments."""
        parts = partial(_parts_of_store, store, [*moments])
        rows = [store.rows(chunk) for chunk in moments]
        about = {"n": store.requested(), **store.manifest}
        return Study(rows, about, total(moments.values()), parts, **more)

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
        rods, links = (tuple(map(stored_ends, ends)) for ends in (rods, links))
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
            raise InvalidInput(f"column {name!r}", "", f"must be one of {', '.join(self._moments)}")
        return name

    def _read(self, *names: str) -> np.ndarray:
        return np.concatenate([*self._parts(*names)], axis=-1)

    def _quantity(self, name: str) -> str | None:
        """Kind of quantity of a column; None for pure numbers and for user-defined columns."""
        return kind_of(name) if is_demand(name) else None

    def _factor(self, name: str) -> float:
        """Factor from a column to SI units."""
        return 1.0 if self.scales is None else float(self.scales.unit_of(self._quantity(name)))

    def weighted(self, weights: str | ArrayLike, *, normalised: bool = True) -> Study:
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
                raise InvalidInput("weights", "", "must be finite in every run that did not fail")
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

    @property
    def n_links(self) -> int:
        """Number of links."""
        return len(self.topology.links)

    @property
    def closable_links(self) -> tuple[int, ...]:
        """The links that have a gap, by number from 0."""
        n = self.n_links
        return tuple(k for k in range(n) if self.finite(of_link("min_gap", k, n)).size)

    @property
    def checked_floors(self) -> str:
        """Of how many floors ``pounding`` tells, in words; empty if it is of all."""
        topology = self.stored_topology
        n = len(topology.links) if topology else 0
        names = (of_link("min_gap", k, n) for k in range(n))
        smallest = [self._moments[x].smallest for x in names if x in self._moments]
        return checked_floors(topology, smallest)

    def pounding(self, gap: float | None = None, *, link: int | None = None) -> np.ndarray:
        """Whether there was pounding in each run, shape (n,): 1 or 0, NaN where the run failed.

        ``gap`` is any gap at rest ≥ 0, of all links or of ``link``, by default that of the
        scenarios; ``link`` the number of a link, from 0, by default any of them. Raises
        ``ValueError`` if a gap's required gap is unknown.
        """
        return np.concatenate([*self._pounding(gap, link)])

    def pounding_probability(
        self, gap: float | None = None, confidence: float = 0.95, *, link: int | None = None
    ) -> Estimate:
        """Probability of ``pounding``, with Clopper and Pearson's interval."""
        return self._hits(self._pounding(gap, link)).estimate(self.normalised, confidence)

    def pounding_cov(self, gap: float | None = None, *, link: int | None = None) -> float:
        """Coefficient of variation of ``pounding_probability``, to first order; NaN if it is 0."""
        hits = self._hits(self._pounding(gap, link))
        p = hits.share(self.normalised)
        return float(hits.variance(p, self.normalised) ** 0.5 / p) if p else float("nan")

    def fragility(
        self,
        intensity: str = "pga",
        gap: float | None = None,
        *,
        link: int | None = None,
        demand: str | None = None,
        threshold: float | None = None,
    ) -> Fragility:
        """Fragility of ``pounding`` by a column that measures the shaking (``fit_fragility``).

        Runs that failed are left out. By default it is the fragility of pounding at any link, which
        lies above that of each link; with a ``demand``, such as "ductility", that of a column which
        reaches the ``threshold``. Raises ``ValueError`` as both functions, and for a demand without
        a threshold or beside a gap or link.
        """
        im = self[intensity]
        if demand is None:
            pounding, event = self.pounding(gap, link=link), Fragility.event
            event += self.checked_floors if link is None else ""
        else:
            if threshold is None or gap is not None or link is not None:
                rule = "must have a threshold, and no gap or link"
                raise InvalidInput("demand", repr(demand), rule)
            column = self[demand]
            pounding = np.where(np.isnan(column), np.nan, column >= threshold)
            event = event_in_words(demand, threshold, self.si, self.stored_topology)
        valid = ~np.isnan(pounding)
        weights = None if self.weighting is None else self.weights[valid]
        curve = fit_fragility(im[valid], pounding[valid] == 1, weights=weights)
        return dataclasses.replace(curve, measure=str(self.measure(intensity)), event=event)

    def _pounding(self, gap: Any, link: Any) -> Iterator[np.ndarray]:
        """``pounding``, part by part."""
        if gap is None:
            name = "pounds" if link is None else self._column_of_link("min_gap", link)
            limit, factor = (1.0, 1.0) if link is None else (0.0, -1.0)
        else:
            (limit,) = not_negative(gap=number("gap", gap))
            name = self._column_of_link("required_gap", link)
            factor = self._factor(name)
        for part in self._parts(self._column(name)):
            yield np.where(np.isnan(part), np.nan, part * factor >= limit)

    def _column_of_link(self, name: str, link: Any) -> str:
        """Name of an existing link's column; for no link ``name`` itself, of all links."""
        if link is None:
            return name
        if not (is_whole(link) and 0 <= link < self.n_links):
            rule = f"must be the number of one of the {self.n_links} links, from 0"
            raise InvalidInput("link", repr(link), rule)
        if (column := of_link(name, int(link), self.n_links)) not in self._moments:
            rule = "must have a finite gap and no law of contact, for its required gap to be known"
            raise InvalidInput("link", str(link), rule)
        if name == "min_gap" and not self._moments[column].n and self.failed < len(self):
            raise InvalidInput("link", str(link), "must have a finite gap, or it never pounds")
        return column

    def required_gap(
        self, probability: float, confidence: float = 0.95, *, link: int | None = None
    ) -> Estimate:
        """The gap at rest at which pounding has this probability.

        Of a link by number, from 0; by default the common gap of all links at which any of them
        pounds with this probability. Raises ``ValueError`` if the required gap is unknown.
        """
        require_share("probability", probability)
        name = self._column_of_link("required_gap", link)
        return self.quantile(name, 1 - probability, confidence)

    def required_gaps(self, probability: float, confidence: float = 0.95) -> RequiredGaps:
        """``required_gap`` of each link that has one, as a table; ``ValueError`` if none has."""
        n = self.n_links
        if not (links := [k for k in range(n) if of_link("required_gap", k, n) in self.columns]):
            self._column("required_gap")
        gaps = {k: self.required_gap(probability, confidence, link=k) for k in links}
        places = link_places(self.topology)
        return RequiredGaps(float(probability), gaps, places, self.si)

    def separation(self, probability: float, confidence: float = 0.95) -> Separation:
        """The required gap beside those of code rules: absolute sum, SRSS, double difference.

        The rules assume buildings without a damper between them: compare them in a study with
        friction 0. They are applied to the peaks of this study, with its damper. The structures
        must be a pair: two buildings of one storey and one link, which has a gap.
        """
        require_share("probability", probability)
        if (oscillators := self.about["oscillators"]) is None:
            rule = "must be a pair: two buildings of one storey and one link, which has a gap; for "
            rule += "a row, en_1998_gap takes the quantiles of peak_x of both floors of a link"
            raise InvalidInput("structures", "", rule)
        masses = [building[0][0] + 1 for building in floors(self.topology)]
        u1, u2 = (self.quantile(f"peak_x{i}", 1 - probability).value for i in masses)
        rho = double_difference_correlation(*oscillators)
        rules = u1 + u2, srss(u1, u2), max(u1**2 + u2**2 - 2 * rho * u1 * u2, 0.0) ** 0.5
        return Separation(self.required_gap(probability, confidence), *rules, correlation=rho)

    def parameters(self) -> dict[str, np.ndarray]:
        """The scenarios' parameters by name, shape (n,) each, from the columns or recomputed.

        Raises ``ValueError`` if they were not kept and the study was opened, without scenarios.
        """
        if kept := self.about["identity"]["parameters"]:
            return dict(zip(kept, np.atleast_2d(self._read(*kept)), strict=True))
        scenarios = self.scenarios
        if scenarios is None or self.points is None:
            reason = "not kept (keep_parameters=True keeps them), and the scenarios are not known"
            remedy = "call monte_carlo with the same arguments and store"
            raise ValueError(f"Study.parameters: {reason}; {remedy}")
        values = jax.jit(jax.vmap(lambda z: parameters(scenarios, z)))(self.points())
        return {name: np.asarray(values[name]) for name in parameter_names(scenarios)}

    def correlations(self, name: str = "required_gap", kind: str = "rank") -> dict[str, float]:
        """Correlation of a column with every parameter, "rank" (Spearman) or "linear" (Pearson).

        NaN where one of the two does not vary. Runs in which the column is infinite are left out.
        """
        require_one_of(kind, ("rank", "linear"), "kind")
        y = self._read(self._column(name))
        valid, weights = np.isfinite(y), self.weights
        return {
            name: correlation(x[valid], y[valid], weights[valid], ranks=kind == "rank")
            for name, x in self.parameters().items()
        }

    def shown_columns(self) -> list[str]:
        """Columns that tables show: no parameters of scenarios, no slip without friction."""
        names = [name for name in self.columns if name not in self.about["identity"]["parameters"]]
        return without_idle_dampers(names, lambda name: self._moments[name].largest)

    def citation(self) -> str:
        """What to cite for the study, as ``jp.study.citation`` has it, by the version that ran."""
        identity = self.about["identity"]
        return citation_of(identity, identity["versions"]["jaxpound"])

    def to_xarray(self) -> Dataset:
        """All columns as an ``xarray.Dataset`` along ``sample``, with units as attributes.

        An ``ImportError`` without xarray (extra ``xarray``).
        """
        measures = {name: self.measure(name) for name in self.columns}
        variables = {
            name: ("sample", self[name], described(measure.unit, measure.words))
            for name, measure in measures.items()
        }
        return require("xarray").Dataset(variables, {"sample": self.indices})

    def _index_and_columns(self) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        index, columns = {"sample": self.indices}, dict[str, np.ndarray]()
        for name in self.columns:
            heading = column(name, self._quantity(name), self.si)
            if heading in index | columns:
                rule = "must differ from every other column of the table: rename it in the study"
                raise InvalidInput(f"column {heading!r}", "", rule)
            columns[heading] = self[name]
        return index, columns

    def _tables(self) -> list[TextTable]:
        rows: list[Any] = []
        for name in self.shown_columns():
            m, words = self.moments(name), in_words(name, self.stored_topology)
            rows.append((name, m.mean, m.std, m.smallest, m.largest, self.unit(name), words))
        units = "SI" if self.si else "dimensionless"
        units += ", weighted" * (self.weighting is not None)
        title = f"Study of {len(self):,} scenarios, {self.failed:,} failed ({units})"
        columns = ("", "mean", "standard deviation", "smallest", "largest", "unit", "in words")
        return [TextTable(title, columns, rows, digits=4)]
