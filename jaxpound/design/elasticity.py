"""Elasticities: the relative change of a demand per percent of each parameter."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import numpy as np

from jaxpound._checks import instance
from jaxpound._tables import Shown, Table
from jaxpound.design.ensemble import Ensemble
from jaxpound.design.prices import gathered, require_over
from jaxpound.grid import TimeGrid
from jaxpound.ground.intensity import pga
from jaxpound.ground.motion import GroundLike
from jaxpound.ground.plausibility import excessive, first_of, of_many, tell, unseen
from jaxpound.model.parameters import get, paths, put
from jaxpound.model.system import Structures
from jaxpound.results.demand import unit_of
from jaxpound.simulation.scheme import Scheme
from jaxpound.study.demands import demands_of


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Elasticities(Shown):
    """Relative changes of a demand over relative changes of each parameter, at one design."""

    demand: str
    value: float
    """The demand, dimensionless."""
    parameters: dict[str, float]
    """The parameters, by path."""
    values: dict[str, float]
    """(θ / |y|) dy/dθ: percent of the demand y per percent of the parameter θ; 0 where θ = 0.

    Parameters that are uncertain or infinite have none.
    """

    def _tables(self) -> list[Table]:
        y = f"{self.demand} = {self.value:.6g} {unit_of(self.demand, False)}".rstrip()
        ranked = sorted(self.values, key=lambda path: -abs(self.values[path]))
        rows = [(path, self.parameters[path], f"{self.values[path]:+.4f}") for path in ranked]
        return [Table(f"{y}; percent of it per percent of a parameter", (), rows)]


def elasticities(
    structures: Structures,
    ground: GroundLike | Ensemble,
    grid: TimeGrid,
    scheme: Scheme = Scheme(),
    *,
    demand: str = "min_gap",
    over: str | float = "mean",
    strict: bool = False,
) -> Elasticities:
    """Elasticities of a demand by every parameter of the structures.

    Parameters
    ----------
    structures
        The design.
    ground
        A ground motion, or an ensemble of them.
    grid, scheme
        See ``simulate``.
    demand
        A column of ``Study``: a scalar of ``Demand``, a required gap, or a demand over all floors.
    over
        For an ensemble: "mean", "worst" (the largest) or a share, for the mean of the largest.
    strict
        Whether a ``PlausibilityWarning`` is raised as a ``ValueError``.

    Raises
    ------
    ValueError
        If an argument breaks its rule, or the demand is zero or not finite. If ``strict``, also
        where there would be a warning.

    Warns
    -----
    PlausibilityWarning
        If the grid does not resolve the ground motion, or more than 1 % of the ensemble's (see
        ``simulate``), or records have a PGA above 5 g.

    Examples
    --------
    >>> grid = jp.TimeGrid.until(20.0, dt=0.05)
    >>> found = jp.elasticities(jp.paper.structures(), jp.paper.ground(), grid)
    >>> round(found.values["friction"], 2)  # percent of min gap by a percent of friction
    0.72
    """
    owner = "elasticities"
    instance(owner, "structures", structures, Structures)
    instance(owner, "grid", grid, TimeGrid)
    instance(owner, "scheme", scheme, Scheme)
    require_over(owner, over)
    if isinstance(ground, Ensemble):
        ensemble, first = ground, first_of(len(ground), grid)
        findings = of_many(jax.tree.map(lambda x: x[:first], ground.grounds), grid, in_g=False)
    else:
        ensemble = Ensemble.of([ground], grid)
        findings = unseen(ground, grid) + excessive(ground, pga(ground, grid))
    tell(owner, findings, strict)
    parameters = {path: float(get(structures, path)) for path in paths(structures)}
    chosen = {
        path: x
        for path, x in parameters.items()
        if path not in ensemble.uncertain and np.isfinite(x)  # a gap may be infinite
    }

    @jax.jit
    @jax.value_and_grad
    def value(chosen: dict[str, Any], grounds: Any, uncertain: Any) -> Any:
        def one(ground: Any, others: Any) -> jax.Array:
            scalars = demands_of(put(structures, {**chosen, **others}), ground, grid, scheme)
            if demand not in scalars:
                listed = ", ".join(scalars)
                raise ValueError(f"{owner}: demand = {demand!r} must be one of {listed}")
            return scalars[demand]

        return gathered(jax.vmap(one)(grounds, uncertain), over)

    y, slopes = value(chosen, ensemble.grounds, dict(ensemble.uncertain))
    if not np.isfinite(y) or not y:
        raise ValueError(f"{owner}: {demand} = {float(y):.6g} must be finite and not zero")
    relative = {path: float(x * slopes[path] / abs(y)) for path, x in chosen.items()}
    return Elasticities(demand, float(y), parameters, relative)
