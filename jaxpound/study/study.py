"""The result of a Monte Carlo study: columns of demands, and statistics of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from os import PathLike
from typing import Any

import jax
import numpy as np
from jaxtyping import ArrayLike

from jaxpound._checks import instance, is_whole, not_negative, number, real, require_share
from jaxpound._tables import Shown, Table
from jaxpound.ground.measure import Measure
from jaxpound.model.places import link_places
from jaxpound.model.system import Topology
from jaxpound.quantities import column, unit
from jaxpound.results.columns import Columnar
from jaxpound.results.demand import Demand, in_words, kind_of
from jaxpound.results.elements import of_link, without_idle_dampers
from jaxpound.study import weighting
from jaxpound.study.archives import DamagedError
from jaxpound.study.chunk import finished, total
from jaxpound.study.demands import is_ours
from jaxpound.study.fragility import Fragility, fit_fragility
from jaxpound.study.gaps import RequiredGaps, Separation, double_difference_correlation, srss
from jaxpound.study.scenarios import ScenarioSet, parameter_names, parameters
from jaxpound.study.statistics import (
    Estimate,
    Moments,
    probability,
    quantile,
)
from jaxpound.study.store import Store
from jaxpound.study.weighting import Hits, Weighting, correlation
from jaxpound.units import Scales


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Study(Columnar, Shown):
    """Demands of many random scenarios, column by column; ``monte_carlo`` makes it.

    ``study[name]`` is a column, shape (n,): every scalar of ``Demand``; ``required_gap``, the
    smallest gap at rest without pounding, initial gap − min gap, which does not depend on the gap
    at rest, if no link has a law of contact (after a contact nobody knows how far the blocks would
    have moved); measures and parameters that were asked for. Of several links each has its own,
    ``required_gap_1`` and so on, if it has a finite gap and no law of contact, and ``required_gap``
    is the largest: the gap that is enough for all. Structures with storeys also have ``peak_drift``
    and ``peak_acceleration``, the largest of all storeys and floors, and several links some of
    which have a law of contact ``peak_contact``, ``peak_impulse`` and ``peak_penetration``, the
    largest of all links.

    Columns of a store are read one by one when they are used, so that n may exceed the memory. Runs
    that failed are NaN and left out of all statistics. Dimensionless as in eq. (9), or in SI units
    if there are ``scales``, which do not convert measures and the scenarios' parameters. As a table
    (``to_pandas``, ``to_csv``, ``to_parquet``) it has a row for each sample.

    ``first_impact_time`` is infinite in runs without an impact. Its moments, quantiles and
    correlations are those of the runs with one; how many these are, ``exceedance("n_impacts", 0)``
    says.

    Sobol points are not independent, but intervals are those of independent samples: usually too
    wide.
    """

    rows: Sequence[range]
    """Indices of the samples, range by range."""
    about: dict[str, Any]
    """How it was made: versions, key, scenarios, grid, scheme, notes."""
    _moments: Mapping[str, Moments]
    _parts: Callable[[str], Iterable[np.ndarray]]
    scenarios: ScenarioSet | None = None
    points: Callable[[], np.ndarray] | None = None
    """Function that computes the points z of the samples, shape (n, d), if scenarios are known."""
    scales: Scales | None = None
    weighting: Weighting | None = None
    """The weights of the samples; None if all count the same."""

    @staticmethod
    def open(folder: str | PathLike[str]) -> Study:
        """The study in a store: its finished chunks, in the units in which it was made.

        Chunks that are damaged are left out with a warning that names them.

        Raises
        ------
        ValueError
            If the folder holds no study, or no chunk of it is finished.
        """
        store = Store(folder)
        if other := store.manifest["identity"].get("search"):
            raise ValueError(f"store {folder} must hold a study, but holds {other}")
        found = dict(finished(store, store.held()))
        if not found:
            raise ValueError(f"store {folder} must hold at least one finished chunk")
        scales = store.manifest["identity"]["scales"]
        return Study.of_store(
            store,
            found,
            scales=Scales(scales["mass"], scales["frequency"], scales["gravity"])
            if scales
            else None,
        )

    @staticmethod
    def of_store(store: Store, found: Mapping[int, Mapping[str, Moments]], **more: Any) -> Study:
        """The study of the chunks found in a store."""

        def parts(name: str) -> Iterator[np.ndarray]:
            for chunk in found:
                why = f"chunk {chunk} is not there any more"
                try:
                    part = store.read(chunk, [name])
                except DamagedError as error:
                    part, why = None, str(error)
                if part is None:
                    raise ValueError(f"store {store.folder}: {why}; run monte_carlo again")
                yield part[name]

        rows = [store.rows(chunk) for chunk in found]
        return Study(rows, store.about(), total(found.values()), parts, **more)

    def __len__(self) -> int:
        return sum(map(len, self.rows))

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
        return self._read(self._known(name)) * self._factor(name)

    def _read(self, name: str) -> np.ndarray:
        return np.concatenate([*self._parts(name)])

    def finite(self, name: str) -> np.ndarray:
        """The finite numbers of a column: without the runs that failed or have no such number."""
        column = self[name]
        return column[np.isfinite(column)]

    def moments(self, name: str) -> Moments:
        """Number, mean, standard deviation and extremes of a column.

        With weights these are normalised (``weighting.moments``).
        """
        found = self._moments[self._known(name)]
        if self.weighting is not None:
            found = weighting.moments(
                (x[good], w[good])
                for x, w in self._weighed(self._parts(name))
                for good in [np.isfinite(x)]
            )
        return found.times(self._factor(name))

    def weighted(self, weights: str | ArrayLike, *, normalised: bool = True) -> Study:
        """The same study with weights: importance samples, or stripes weighted by their hazard.

        All its statistics, and what is made of them, then count every sample by its weight:
        moments, quantiles, probabilities, required gaps, ``separation``, ``correlations``,
        ``fragility``. ``study[name]`` and tables remain those of the samples. Intervals are those
        of as many samples of one weight as would have the estimate's variance: Clopper and
        Pearson's with the effective size of Korn and Graubard (1998) for a probability, that of
        Woodruff (1952) for a quantile; a fragility has the covariance of White (1982).

        Parameters
        ----------
        weights
            The name of a column, read with the others chunk by chunk, such as that of a measure:
            ``monte_carlo(..., measures={"weight": f})``. Or the weights, shape (n,), in the order
            of ``indices``. Not negative; of runs that failed any number or NaN.
        normalised
            Whether probabilities are divided by the sum of the weights, which then may have any
            scale; or, if False, by the number of samples that did not fail. The weights are then
            ratios of densities, and the samples may be crowded where the event is: probabilities
            are unbiased, and small ones far more accurate. Moments and fragilities are always
            normalised.

        Raises
        ------
        ValueError
            If there is no such column, the weights are not (n,), one is negative or not finite, or
            their sum is 0.
        """
        known = self._moments[self._known(weights)] if isinstance(weights, str) else None
        curve = getattr(weights, "curve", None)
        runs = len(self) if known is None else len(self) - self.failed
        if known is None and self.failed:
            weights = np.asarray(real("Study.weighted", "weights", weights))
            if weights.shape == (runs,):
                weights = np.where(np.isnan(self._read("pga")), 0.0, weights)
        by = weighting.checked("Study.weighted", weights, runs, known)
        return dataclasses.replace(self, weighting=Weighting(by, bool(normalised), curve))

    @property
    def weights(self) -> np.ndarray:
        """Weights of the samples, shape (n,): ones if there are none; NaN of a run that failed."""
        pairs = self._weighed(self._parts("pga"))
        return np.concatenate([np.where(np.isnan(x), np.nan, w) for x, w in pairs])

    def _weighed(self, parts: Iterable[np.ndarray]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Every part of a column with the weights of its samples."""
        if self.weighting is None:
            return ((part, np.ones(len(part))) for part in parts)
        return self.weighting.of(parts, self._parts)

    @property
    def normalised(self) -> bool:
        """Whether probabilities are divided by the sum of the weights (``weighted``)."""
        return self.weighting is None or self.weighting.normalised

    def _sums(self, hits: Iterable[np.ndarray]) -> Hits:
        """Of the parts of a column that is 1 or 0, NaN where it is not known."""
        found = Hits()
        for x, w in self._weighed(hits):
            good = ~np.isnan(x)
            found += Hits.of(x[good] == 1, w[good])
        return found

    def _share(self, hits: Iterable[np.ndarray], confidence: float) -> Estimate:
        """Probability by the parts of a column that is 1 or 0, NaN where it is not known."""
        found = self._sums(hits)
        if self.weighting is None:
            return probability(int(found.hit), found.n, confidence)
        return found.estimate(self.normalised, confidence)

    def in_si(self, scales: Scales) -> Study:
        """The same study in SI units."""
        instance("Study.in_si", "scales", scales, Scales)
        return dataclasses.replace(self, scales=scales)

    @property
    def demand(self) -> Demand:
        """All demands as a batch."""
        return Demand.of_columns(
            {name: self[name] for name in self.columns}, si=self.scales is not None
        )

    def parameters(self) -> dict[str, np.ndarray]:
        """The scenarios' parameters by name, shape (n,) each, from the columns or recomputed.

        Raises
        ------
        ValueError
            If they were not kept, and the scenarios are not known because the study was opened.
        """
        kept = self.about["identity"]["parameters"]
        if kept:
            return {name: self._read(name) for name in kept}
        if self.scenarios is None or self.points is None:
            raise ValueError(
                "Study.parameters: not kept (keep_parameters=True keeps them), and the scenarios "
                "are not known; call monte_carlo with the same arguments and store"
            )
        scenarios = self.scenarios
        made = jax.jit(jax.vmap(lambda z: parameters(scenarios, z)))(self.points())
        return {name: np.asarray(made[name]) for name in parameter_names(scenarios)}

    # Statistics.

    def quantile(self, name: str, share: float, confidence: float = 0.95) -> Estimate:
        """Quantile of a column, with its distribution-free interval (``statistics.quantile``).

        With weights, ``weighting.quantile``.
        """
        if self.weighting is None:
            return quantile(self.finite(name), share, confidence)
        column = self[name]
        good = np.isfinite(column)
        weights = self.weights[good]
        return weighting.quantile(column[good], weights, share, self.normalised, confidence)

    def exceedance(self, name: str, value: float, confidence: float = 0.95) -> Estimate:
        """Probability that a column exceeds a value, with Clopper and Pearson's interval.

        An infinite time of the first impact, of a run without an impact, exceeds any value.

        Raises
        ------
        ValueError
            If there is no such column, or an argument breaks its rule.
        """
        parts, factor = self._parts(self._known(name)), self._factor(name)
        value = float(number("exceedance", "value", value))
        over = (np.where(np.isnan(x), np.nan, x * factor > value) for x in parts)
        return self._share(over, confidence)

    def counts(self, name: str = "n_impacts", confidence: float = 0.95) -> dict[int, Estimate]:
        """Distribution of a column of whole numbers, such as the number of impacts.

        Parameters
        ----------
        name
            The column; of several links ``n_impacts_1`` and so on.
        confidence
            Confidence level of each interval (Clopper and Pearson's).

        Returns
        -------
        The probability of every number that occurred, by number.

        Raises
        ------
        ValueError
            If there is no such column, its numbers are not whole, or an argument breaks its rule.
        """
        column = self.finite(name)
        if (column % 1).any():
            raise ValueError(f"counts: the numbers of {name!r} must be whole")
        found, which, often = np.unique(column, return_inverse=True, return_counts=True)
        if self.weighting is None:
            sums = [probability(int(m), column.size, confidence) for m in often]
        else:
            w = self.weights[np.isfinite(self[name])]
            hit, square = np.bincount(which, w), np.bincount(which, w**2)
            sums = [
                Hits(w.size, w.sum(), (w**2).sum(), *x).estimate(self.normalised, confidence)
                for x in zip(hit, square, strict=True)
            ]
        return {int(k): estimate for k, estimate in zip(found, sums, strict=True)}

    @property
    def topology(self) -> Topology:
        """Number of masses, and the ends of rods and links.

        Raises
        ------
        ValueError
            If the store was made by a version that did not keep it.
        """
        if "topology" not in self.about:
            raise ValueError("Study.topology: the store must be of this version; it lacks links")
        n_masses, rods, links = self.about["topology"]  # lists, if they were read from a file
        return Topology(n_masses, *(tuple((i, j) for i, j in ends) for ends in (rods, links)))

    @property
    def n_links(self) -> int:
        """Number of links."""
        return len(self.topology.links)

    def pounding(self, gap: float | None = None, *, link: int | None = None) -> np.ndarray:
        """Whether there was pounding in each run, shape (n,): 1 or 0, NaN where the run failed.

        Parameters
        ----------
        gap
            Any gap at rest ≥ 0, of all links or of the one; by default that of the scenarios.
        link
            A link by number, from 0; by default any of them.

        Raises
        ------
        ValueError
            If an argument breaks its rule, or a gap is given and the required gap is not known.
        """
        return np.concatenate([*self._pounding("pounding", gap, link)])

    def pounding_probability(
        self, gap: float | None = None, confidence: float = 0.95, *, link: int | None = None
    ) -> Estimate:
        """Probability of pounding at a gap, with Clopper and Pearson's interval.

        Parameters
        ----------
        gap
            Any gap at rest ≥ 0, of all links or of the one; by default that of the scenarios.
        confidence
            Confidence level of the interval.
        link
            A link by number, from 0; by default any of them.

        Raises
        ------
        ValueError
            As ``pounding``, or if confidence is not between 0 and 1.
        """
        require_share("pounding_probability", "confidence", confidence)
        return self._share(self._pounding("pounding_probability", gap, link), confidence)

    def pounding_cov(self, gap: float | None = None, *, link: int | None = None) -> float:
        """Coefficient of variation of ``pounding_probability``, to first order; NaN if it is 0.

        Raises
        ------
        ValueError
            As ``pounding``.
        """
        sums = self._sums(self._pounding("pounding_cov", gap, link))
        p = sums.share(self.normalised)
        return float(sums.variance(p, self.normalised) ** 0.5 / p) if p else float("nan")

    def fragility(
        self, intensity: str = "pga", gap: float | None = None, *, link: int | None = None
    ) -> Fragility:
        """Fragility by a column that measures the shaking (``fit_fragility``).

        Runs that failed are left out. For ``gap`` and ``link`` see ``pounding``: of any link by
        default, of which a curve lies above that of each.

        Raises
        ------
        ValueError
            As ``pounding`` and ``fit_fragility``.
        """
        im, pounding = self[intensity], self.pounding(gap, link=link)
        good = ~np.isnan(pounding)
        weights = None if self.weighting is None else self.weights[good]
        fitted = fit_fragility(im[good], pounding[good] == 1, weights=weights)
        return dataclasses.replace(fitted, measure=str(self.measure(intensity)))

    def measure(self, name: str) -> Measure:
        """What a column that measures the shaking is, and its unit as far as it is known."""
        return Measure(in_words(name), self.unit(name))

    def _pounding(self, owner: str, gap: Any, link: Any) -> Iterator[np.ndarray]:
        """``pounding``, part by part."""
        if gap is None:
            name = "pounds" if link is None else self._of_link(owner, "min_gap", link)
            limit, sign = (1.0, 1.0) if link is None else (0.0, -1.0)
        else:
            (limit,) = not_negative(owner, gap=number(owner, "gap", gap))
            name = "required_gap" if link is None else self._of_link(owner, "required_gap", link)
            sign = self._factor(name)
        for part in self._parts(self._known(name)):
            yield np.where(np.isnan(part), np.nan, part * sign >= limit)

    def _of_link(self, owner: str, name: str, link: Any) -> str:
        """The column of a link; a ``ValueError`` for one that has none or is not there."""
        if not (is_whole(link) and 0 <= link < self.n_links):
            rule = f"the number of one of the {self.n_links} links, from 0"
            raise ValueError(f"{owner}: link = {link!r} must be {rule}")
        column = of_link(name, int(link), self.n_links)
        if column not in self._moments:
            rule = "have a finite gap and no law of contact, for its required gap to be known"
            raise ValueError(f"{owner}: link = {link} must {rule}")
        if name == "min_gap" and not self._moments[column].n and self.failed < len(self):
            raise ValueError(f"{owner}: link = {link} must have a finite gap, or it never pounds")
        return column

    def required_gap(
        self, probability: float, confidence: float = 0.95, *, link: int | None = None
    ) -> Estimate:
        """The gap at rest at which pounding has this probability.

        Of one link by number, from 0; by default the gap that all links have, so that any of them
        pounds with this probability.

        Raises
        ------
        ValueError
            If an argument breaks its rule, or the required gap is not known.
        """
        owner = "required_gap"
        require_share(owner, "probability", probability)
        require_share(owner, "confidence", confidence)
        name = owner if link is None else self._of_link(owner, owner, link)
        return self.quantile(name, 1 - probability, confidence)

    def required_gaps(self, probability: float, confidence: float = 0.95) -> RequiredGaps:
        """``required_gap`` of each link that has one, as a table.

        Raises
        ------
        ValueError
            If an argument breaks its rule, or no link's required gap is known.
        """
        n = self.n_links
        known = [k for k in range(n) if of_link("required_gap", k, n) in self.columns]
        if not known:
            self._known("required_gap")
        gaps = {k: self.required_gap(probability, confidence, link=k) for k in known}
        places = link_places(self.topology)
        return RequiredGaps(float(probability), gaps, places, self.scales is not None)

    def separation(self, probability: float, confidence: float = 0.95) -> Separation:
        """The required gap beside those of code rules: absolute sum, SRSS, double difference.

        The rules were made for buildings without a damper between them: compare them in a study
        with friction 0. Here they are applied to the peaks of this study, with its damper.

        Raises
        ------
        ValueError
            If probability is not between 0 and 1, or the structures are not a pair
            (``AdjacentStructures``).
        """
        require_share("separation", "probability", probability)
        oscillators = self.about["oscillators"]
        if oscillators is None:
            raise ValueError("Study.separation: structures must be a pair, AdjacentStructures")
        u1, u2 = (self.quantile(f"peak_x{i}", 1 - probability).value for i in (1, 2))
        rho = double_difference_correlation(*oscillators)
        return Separation(
            self.required_gap(probability, confidence),
            absolute_sum=u1 + u2,
            srss=srss(u1, u2),
            double_difference=max(u1**2 + u2**2 - 2 * rho * u1 * u2, 0.0) ** 0.5,
            correlation=rho,
        )

    def correlations(self, name: str = "required_gap", kind: str = "rank") -> dict[str, float]:
        """Correlation of a column with every parameter, "rank" (Spearman) or "linear" (Pearson).

        NaN where one of the two does not vary. Runs in which the column is infinite are left out.
        """
        if kind not in ("rank", "linear"):
            raise ValueError(f"correlations: kind = {kind!r} must be 'rank' or 'linear'")
        column = self._read(self._known(name))
        good = np.isfinite(column)

        y = column[good]
        weights = None if self.weighting is None else self.weights[good]
        return {
            name: correlation(x[good], y, weights, ranks=kind == "rank")
            for name, x in self.parameters().items()
        }

    # Tables.

    def told(self) -> list[str]:
        """Names of the columns that tables tell of.

        All but the scenarios' parameters, and the slip of links without friction.
        """
        drawn = self.about["identity"]["parameters"]
        names = [name for name in self.columns if name not in drawn]
        return without_idle_dampers(names, lambda name: self._moments[name].largest)

    def _index_and_columns(self) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        si, columns = self.scales is not None, {"sample": self.indices}
        for name in self.columns:
            named = column(name, self._quantity(name), si)
            if named in columns:
                rule = "must be told from another column of the table: rename it in the study"
                raise ValueError(f"Study: column {named!r} {rule}")
            columns[named] = self[name]
        return {"sample": columns.pop("sample")}, columns

    def _tables(self) -> list[Table]:
        units = "dimensionless" if self.scales is None else "SI"
        rows = []
        for name in self.told():
            m = self.moments(name)
            numbers = (m.mean, m.std, m.smallest, m.largest)
            rows.append((name, *numbers, self.unit(name)))
        units += ", weighted" * (self.weighting is not None)
        title = f"Study of {len(self):,} scenarios, {self.failed:,} failed ({units})"
        columns = ("", "mean", "standard deviation", "smallest", "largest", "unit")
        return [Table(title, columns, rows, digits=4)]

    def _known(self, name: str) -> str:
        if name not in self._moments:
            raise ValueError(f"Study: column {name!r} must be one of {', '.join(self._moments)}")
        return name

    def unit(self, name: str) -> str:
        """Unit of a column; empty for pure numbers and for users' columns."""
        return unit(self._quantity(self._known(name)), self.scales is not None)

    def _quantity(self, name: str) -> str | None:
        """Kind of quantity of a column; None for pure numbers and for users' columns."""
        return kind_of(name) if is_ours(name) else None

    def _factor(self, name: str) -> float:
        """Factor from a column to SI units; 1 for pure numbers and for users' columns."""
        return 1.0 if self.scales is None else float(self.scales.unit_of(self._quantity(name)))
