"""Which uncertain parameter matters: Sobol indices of a demand."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import numpy as np

from jaxpound._checks import Rule, count, enforce, instance, require_share, seed
from jaxpound._tables import Shown, Table
from jaxpound.grid import TimeGrid
from jaxpound.ground.motion import as_pytree
from jaxpound.ground.plausibility import first_of, of_many, tell
from jaxpound.simulation.batches import in_chunks
from jaxpound.simulation.scheme import Scheme
from jaxpound.study.demands import demands_of
from jaxpound.study.sampling import points
from jaxpound.study.scenarios import ScenarioSet, parameter_names
from jaxpound.study.statistics import Estimate

_REPLICATES = 500  # of the bootstrap


@dataclasses.dataclass(frozen=True, repr=False)
class Sensitivity(Shown):
    """Sobol indices of one demand, by parameter, with bootstrap intervals.

    ``first`` is the share of the demand's variance that vanishes if the parameter is known,
    ``total`` the share that remains if all others are known. Of correlated parameters
    (``UncertainStructures``) each stands for what those before it do not tell of it: ``first`` of
    the first of them is the share that vanishes if it is known, with all that it tells of the
    others.
    """

    demand: str
    runs: int
    first: dict[str, Estimate]
    total: dict[str, Estimate]

    def _tables(self) -> list[Table]:
        rows = [(name, str(x), str(self.total[name])) for name, x in self.first.items()]
        title = f"Sobol indices of {self.demand} ({self.runs:,} runs)"
        return [Table(title, ("parameter", "first order", "total"), rows)]


def sobol_sensitivity(
    scenarios: ScenarioSet,
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

    Parameters
    ----------
    scenarios, grid, scheme
        See ``monte_carlo``.
    demand
        A column of ``Study``: a scalar of ``Demand``, or "required_gap" (gap at rest − smallest
        gap), which there is where a gap is finite and no link has a law of contact.
    n
        Base sample, a power of 2; n (d + 2) scenarios are run for d parameters.
    key
        A seed.
    confidence
        Confidence level of the bootstrap intervals.
    strict
        Whether a ``PlausibilityWarning`` is raised as a ``ValueError``.

    Raises
    ------
    ValueError
        If an argument breaks its rule, a scenario fails, or the demand does not vary. If
        ``strict``, also where there would be a warning.

    Warns
    -----
    PlausibilityWarning
        If, of the first 256 scenarios, more than 1 % have a ground motion that the grid does not
        resolve (see ``simulate``), or a record with a PGA above 5 g.
    """
    from scipy import stats  # only here: it takes a second to import

    owner = "sobol_sensitivity"
    instance(owner, "scenarios", scenarios, ScenarioSet)
    instance(owner, "grid", grid, TimeGrid)
    instance(owner, "scheme", scheme, Scheme)
    n = count(owner, "n", n)
    key = seed(owner, "key", key)
    enforce(owner, [Rule("n", n, n >= 2 and n & (n - 1) == 0, "a power of 2, at least 2")])
    require_share(owner, "confidence", confidence)

    def run(z: Any) -> jax.Array:
        structures, ground = scenarios.realize(z)
        values = demands_of(structures, ground, grid, scheme)
        if demand not in values:
            rule = f"must be one of {', '.join(values)}"
            if demand == "required_gap":
                rule += ": there is no required gap unless a gap at rest is finite and no link has"
                rule += " a law of contact"
            raise ValueError(f"{owner}: demand = {demand!r} {rule}")
        return values[demand]

    run_all: Any = in_chunks(run)

    names = parameter_names(scenarios)
    d = len(names)
    enforce(owner, [Rule("scenarios.dimension", d, d >= 2, "at least 2: one has all the variance")])
    z = points("sobol", jax.random.key(key, impl="threefry2x32"), 2 * d)(0, n)
    one, other = z[:, :d], z[:, d:]
    grounds = jax.jit(jax.vmap(lambda z: as_pytree(scenarios.realize(z)[1], grid)))
    tell(owner, of_many(grounds(one[: first_of(n, grid)]), grid, in_g=False), strict)
    mixed = [np.where(np.arange(d) == i, other, one) for i in range(d)]
    found = run_all(np.concatenate([one, other, *mixed])).astype(float)
    if np.isposinf(found).any():
        lacking = "impact in some scenarios" if demand.startswith("first_impact") else "gap"
        raise ValueError(f"{owner}: {demand} must be finite, but there is no {lacking}")
    if bad := np.count_nonzero(~np.isfinite(found)):
        raise ValueError(f"{owner}: {bad} of {found.size} scenarios fail; monte_carlo says why")
    if not np.ptp(found):
        raise ValueError(f"{owner}: {demand} = {found[0]:.8g} must vary, but does not")
    runs = found.reshape(d + 2, n)

    def indices(rows: Any) -> np.ndarray:
        f = runs[:, rows]
        given = {"f_A": f[:1], "f_B": f[1:2], "f_AB": f[2:, None]}
        shares = stats.sobol_indices(func=given, n=n)
        return np.stack([shares.first_order, shares.total_order]).reshape(2, d)

    every = np.arange(n)
    low, high = stats.bootstrap(
        (every,),
        indices,
        vectorized=False,
        n_resamples=_REPLICATES,
        confidence_level=confidence,
        method="percentile",
        rng=np.random.default_rng(key),
    ).confidence_interval
    first, total = (
        {
            name: Estimate(float(value), float(low), float(high), confidence)
            for name, value, low, high in zip(names, *of_order, strict=True)
        }
        for of_order in zip(indices(every), low, high, strict=True)
    )
    return Sensitivity(demand, found.size, first, total)
