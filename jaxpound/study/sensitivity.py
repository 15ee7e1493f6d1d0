"""Sobol indices of a demand: the shares of its variance by uncertain parameter."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import numpy as np

from jaxpound._checks import Rule, count, enforce, require_share, seed
from jaxpound._errors import InvalidInput, warn
from jaxpound._tables import Shown, TextTable
from jaxpound._xla.batches import in_chunks
from jaxpound.grid import TimeGrid
from jaxpound.ground.plausibility import first_of, of_many
from jaxpound.model.system import in_si
from jaxpound.model.topology import Topology
from jaxpound.results.named import in_words
from jaxpound.scenarios import scenarios as sets
from jaxpound.scenarios.sampling import points
from jaxpound.simulation.scheme import Scheme
from jaxpound.study.demands import demands_of, doubts
from jaxpound.study.statistics import Estimate

_REPLICATES = 500  # of the bootstrap


@dataclasses.dataclass(frozen=True, repr=False)
class Sensitivity(Shown):
    """Sobol indices of a demand, by parameter, with bootstrap intervals.

    ``first`` is the share of the demand's variance that vanishes if the parameter is known,
    ``total`` the share that remains if all others are known. Each of several correlated parameters
    (``UncertainStructures``) stands for the part of it that does not follow from those before it.
    """

    demand: str
    runs: int
    first: dict[str, Estimate]
    total: dict[str, Estimate]
    topology: Topology | None = None

    def _tables(self) -> list[TextTable]:
        rows = [(name, str(x), str(self.total[name])) for name, x in self.first.items()]
        title = f"Sobol indices of {in_words(self.demand, self.topology)} ({self.runs:,} runs)"
        return [TextTable(title, ("parameter", "first order", "total"), rows)]


def sobol_sensitivity(
    scenarios: sets.ScenarioSet,
    grid: TimeGrid,
    scheme: Scheme = Scheme(),
    demand: str = "required_gap",
    *,
    n: int = 1024,
    key: int = 0,
    confidence: float = 0.95,
    strict: bool = False,
) -> Sensitivity:
    """Sobol indices of a demand to a scenario set's parameters, as ``scipy.stats`` estimates them.

    Raises ``ValueError`` if an argument breaks its rule, a scenario fails, or the demand does not
    vary, and warns before the runs as ``monte_carlo``; without units only records have a PGA in g.

    Parameters
    ----------
    scenarios, grid, scheme, strict
        See ``monte_carlo``.
    demand
        A column of ``Study``: a scalar of ``Demand``, or "required_gap" (gap at rest − smallest
        gap), if a gap is finite and no link has a law of contact.
    n
        Size of the base sample, a power of 2; n (d + 2) scenarios are run for d parameters.
    key
        A seed.
    confidence
        Confidence level of the bootstrap intervals.
    """
    findings = doubts(scenarios, grid, scheme)
    n, key = count("n", n), seed("key", key)
    enforce([Rule("n", n, n >= 2 and n & (n - 1) == 0, "a power of 2, at least 2")])
    require_share("confidence", confidence)

    def run(z: Any) -> jax.Array:
        structures, ground = scenarios.realize(z)
        values = demands_of(structures, ground, grid, scheme)
        if demand not in values:
            rule = f"must be one of {', '.join(values)}"
            if demand == "required_gap":
                rule += ": there is no required gap unless a gap at rest is finite and no link has"
                rule += " a law of contact"
            raise InvalidInput("demand", repr(demand), rule)
        return values[demand]

    names = sets.parameter_names(scenarios)
    d, rule = len(names), "at least 2: one has all the variance"
    enforce([Rule("scenarios.dimension", d, d >= 2, rule)])
    z = points("sobol", jax.random.key(key, impl="threefry2x32"), 2 * d)(0, n)
    a, b = z[:, :d], z[:, d:]
    grounds = sets.grounds_at(scenarios, grid)(a[: first_of(n, grid)])
    si = in_si(sets.structures_of(scenarios))
    warn(findings + of_many(grounds, grid, in_g=si), strict)
    mixed = [np.where(np.arange(d) == i, b, a) for i in range(d)]
    demands = in_chunks(run)(np.concatenate([a, b, *mixed])).astype(float)
    if np.isposinf(demands).any():
        missing = "impact in some scenarios" if demand.startswith("first_impact") else "gap"
        raise InvalidInput(demand, "", f"must be finite, but there is no {missing}")
    if failed := np.count_nonzero(~np.isfinite(demands)):
        fault = f"{failed} of {demands.size} scenarios fail; monte_carlo gives the reason"
        raise InvalidInput("", "", fault)
    if not np.ptp(demands):
        raise InvalidInput(demand, f"{demands[0]:.8g}", "must vary, but does not")

    from scipy import stats  # only here: it takes a second to import

    def indices(rows: Any) -> np.ndarray:
        f = demands.reshape(d + 2, n)[:, rows]
        shares = stats.sobol_indices(func={"f_A": f[:1], "f_B": f[1:2], "f_AB": f[2:, None]}, n=n)
        return np.stack([shares.first_order, shares.total_order]).reshape(2, d)

    rows, random = np.arange(n), np.random.default_rng(key)
    resampling = {"n_resamples": _REPLICATES, "vectorized": False, "method": "percentile"}
    resampling |= {"confidence_level": confidence, "rng": random}
    low, high = stats.bootstrap((rows,), indices, **resampling).confidence_interval
    values = [indices(rows), low, high, np.full_like(low, confidence)]
    first, total = (
        {name: Estimate(*map(float, x)) for name, x in zip(names, of_order, strict=True)}
        for of_order in np.stack(values, axis=-1)
    )
    return Sensitivity(demand, demands.size, first, total, sets.topology_of(scenarios))
