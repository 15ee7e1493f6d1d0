"""The result of a Monte Carlo study: pounding, required gaps, fragilities, correlations."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from os import PathLike
from typing import Any

import jax
import numpy as np

from jaxpound._checks import is_whole, not_negative, number, require_one_of, require_share
from jaxpound._errors import InvalidInput
from jaxpound._tables import TextTable
from jaxpound.model.places import link_places
from jaxpound.model.row import checked_floors
from jaxpound.quantities import column
from jaxpound.results.elements import of_link, without_idle_dampers
from jaxpound.results.named import event_in_words, in_words
from jaxpound.scenarios.scenarios import ScenarioSet, parameter_names, parameters
from jaxpound.store.archive import DamagedError
from jaxpound.store.store import Store
from jaxpound.study.chunk import finished, total
from jaxpound.study.columns import DemandColumns, in_rows
from jaxpound.study.fragility import Fragility, fit_fragility
from jaxpound.study.gaps import RequiredGaps, Separation, double_difference_correlation, srss
from jaxpound.study.statistics import Estimate, Moments
from jaxpound.study.weighting import correlation
from jaxpound.units import Scales


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
class Study(DemandColumns):
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
        require_share("confidence", confidence)
        hits = self._hits(self._pounding(gap, link))
        return hits.estimate(self.normalised, confidence)

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
            rule = "must have a finite gap, or it never pounds"
            raise InvalidInput("link", str(link), rule)
        return column

    def required_gap(
        self, probability: float, confidence: float = 0.95, *, link: int | None = None
    ) -> Estimate:
        """The gap at rest at which pounding has this probability.

        Of a link by number, from 0; by default the common gap of all links at which any of them
        pounds with this probability. Raises ``ValueError`` if the required gap is unknown.
        """
        require_share("probability", probability)
        require_share("confidence", confidence)
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
        u1, u2 = (self.quantile(f"peak_x{i}", 1 - probability).value for i in (1, 2))
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
