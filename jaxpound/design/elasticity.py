"""Elasticities: the relative change of a demand per percent of each parameter."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import numpy as np

from jaxpound._checks import instance, require_one_of
from jaxpound._errors import InvalidInput, warn
from jaxpound._tables import Shown, TextTable
from jaxpound.design.ensemble import Ensemble
from jaxpound.design.goals import gathered, require_over
from jaxpound.grid import TimeGrid
from jaxpound.ground.intensity import pga
from jaxpound.ground.motion import GroundLike
from jaxpound.ground.plausibility import excessive, of_many, unseen
from jaxpound.ground.run_input import as_run
from jaxpound.model.parameters import get, paths, put
from jaxpound.model.system import Structures, gravity_of, in_si
from jaxpound.model.topology import Topology
from jaxpound.results.named import in_words, unit_of
from jaxpound.simulation.scheme import Scheme, imprecise, single_system
from jaxpound.study.demands import demands_of


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Elasticities(Shown):
    """Relative changes of a demand over relative changes of each parameter, at one design."""

    demand: str
    value: float
    """The demand, dimensionless or in SI units."""
    parameters: dict[str, float]
    """The parameters, by path."""
    values: dict[str, float]
    """(θ / |y|) dy/dθ: percent of the demand y per percent of the parameter θ; 0 where θ = 0.

    Parameters that are uncertain or infinite have none.
    """
    si: bool = False
    """Whether the demand is in SI units, as of ``Buildings``."""
    topology: Topology | None = None

    def _tables(self) -> list[TextTable]:
        words, of_unit = in_words(self.demand, self.topology), unit_of(self.demand, self.si)
        y = f"{words} = {self.value:.6g} {of_unit}".rstrip()
        ranked = sorted(self.values, key=lambda path: -abs(self.values[path]))
        rows = [(path, self.parameters[path], f"{self.values[path]:+.4f}") for path in ranked]
        return [TextTable(f"{y}; percent of it per percent of a parameter", (), rows)]


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

    Raises ``ValueError`` if the demand is zero or not finite. Warns before the run as ``simulate``,
    and of an ensemble as ``design_damper``.

    Parameters
    ----------
    structures
        The design.
    ground
        A ground motion, or an ensemble of them.
    grid, scheme, strict
        See ``simulate``.
    demand
        A column of ``Study``: a scalar of ``Demand``, a required gap, or a demand over all floors.
    over
        For an ensemble: "mean", "worst" (the largest) or a share, for the mean of the largest.

    Examples
    --------
    >>> grid = jp.TimeGrid.until(20.0, dt=0.05)
    >>> result = jp.design.elasticities(jp.paper.structures(), jp.paper.ground(), grid)
    >>> round(result.values["friction"], 2)  # percent of min gap by a percent of friction
    0.72
    """
    system = single_system(structures)
    instance("grid", grid, TimeGrid)
    instance("scheme", scheme, Scheme)
    require_over(over)
    gravity = gravity_of(structures)
    if isinstance(ground, Ensemble):
        ensemble, several = ground, ground.first_in_g(grid, gravity)
        findings = of_many(several, grid, in_g=gravity is not None)
    else:
        ensemble = Ensemble.of([ground], grid)
        peak = pga(as_run(ground, grid, gravity), grid) / (gravity or 1.0)
        findings = unseen(ground, grid, strict=strict)
        findings += excessive(ground, peak, si=gravity is not None)
    warn(imprecise(system, grid, ensemble.grounds) + findings, strict)
    parameters = {path: float(get(structures, path)) for path in paths(structures)}
    certain = parameters.keys() - ensemble.uncertain.keys()  # and a gap may be infinite
    variables = {path: x for path, x in parameters.items() if path in certain and np.isfinite(x)}

    @jax.jit
    @jax.value_and_grad
    def value(variables: dict[str, Any], grounds: Any, uncertain: Any) -> Any:
        def demand_in(ground: Any, others: Any) -> jax.Array:
            scalars = demands_of(put(structures, {**variables, **others}), ground, grid, scheme)
            require_one_of(demand, scalars, "demand")
            return scalars[demand]

        return gathered(jax.vmap(demand_in)(grounds, uncertain), over)

    y, slopes = value(variables, ensemble.grounds, dict(ensemble.uncertain))
    if not np.isfinite(y) or not y:
        raise InvalidInput(demand, f"{float(y):.6g}", "must be finite and not zero")
    for path, slope in slopes.items():
        if not np.isfinite(slope):
            rule = "must be finite, which single precision and very strong motions may prevent"
            raise InvalidInput(f"derivative of {demand} by {path}", f"{slope:.6g}", rule)
    relative = {path: float(x * slopes[path] / abs(y)) for path, x in variables.items()}
    about = in_si(structures), structures.system().topology
    return Elasticities(demand, float(y), parameters, relative, *about)
