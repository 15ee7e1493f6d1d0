"""Parameters of the structures from measured motion: least squares through the simulator."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound import _checks
from jaxpound._checks import Rule, enforce, instance
from jaxpound._errors import InvalidInput
from jaxpound._fields import quantities
from jaxpound._tables import Shown, TextTable
from jaxpound.design.least_squares import estimates_table, fitted, spread
from jaxpound.design.space import DesignSpace
from jaxpound.grid import TimeGrid
from jaxpound.ground.motion import GroundLike
from jaxpound.ground.plausibility import unseen, warn
from jaxpound.ground.run_input import as_pytree, require_time_unit
from jaxpound.model.system import Structures, System, gravity_of, is_closable
from jaxpound.quantities import unit
from jaxpound.results.elements import of_link
from jaxpound.results.impacts import MOST, ImpactSeries
from jaxpound.results.response import Response
from jaxpound.simulation.run import simulate
from jaxpound.simulation.scheme import Scheme, imprecise, single_system
from jaxpound.study.statistics import Estimate
from jaxpound.units import Scales, scales_for


def measurables(system: System) -> dict[str, str | None]:
    """Kinds of quantity of a system's measurable series, by name (see ``calibrate``)."""
    masses, n = range(1, len(system.masses) + 1), len(system.links)
    of_masses = (("x", "length"), ("v", "velocity"), ("a", "acceleration"))
    kinds: dict[str, str | None] = {f"{x}{i}": kind for x, kind in of_masses for i in masses}
    for k, link in enumerate(system.links):
        if is_closable(link.gap):
            kinds[of_link("gap", k, n)] = "length"
        if link.contact is not None:
            impacts, fields = of_link("impacts", k, n), quantities(ImpactSeries)
            kinds |= {f"{impacts}.{field}": quantity.kind for field, quantity in fields.items()}
    return kinds


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Calibration(Shown):
    """Calibrated structures, with confidence intervals of the parameters."""

    structures: Any
    """Of the kind of the space's nominal structures."""
    parameters: dict[str, Estimate]
    """Value and interval by path, from the linearised least squares (Student's t)."""
    correlation: np.ndarray
    """Correlation matrix of the estimates, shape (d, d)."""
    noise: dict[str, float]
    """Standard deviation of the residuals, by series, in the series' unit."""
    response: Response
    """The run of the calibrated structures."""
    residuals: dict[str, np.ndarray]
    """Measured − simulated, of the measured shapes; NaN where nothing was measured."""
    at_bounds: tuple[str, ...]
    """Parameters at a bound of the space: their intervals mean nothing."""
    simulations: int
    """Runs of the simulator, each with its derivatives."""

    def _tables(self) -> list[TextTable]:
        si, kinds = self.response.si, measurables(self.structures.system())
        units = "dimensionless" if gravity_of(self.structures) is None else "SI"
        heading = f"parameter ({units})"
        return [
            estimates_table(heading, self.parameters, self.at_bounds, self.simulations),
            TextTable(
                "Noise, what is left of the measured series",
                ("series", "standard deviation", "unit"),
                [(name, std, unit(kinds[name], si)) for name, std in self.noise.items()],
                digits=4,
            ),
        ]


def calibrate(
    space: DesignSpace,
    measured: Mapping[str, Any],
    ground: GroundLike,
    grid: TimeGrid,
    scheme: Scheme = Scheme(),
    *,
    noise: Mapping[str, float] | None = None,
    start: Structures | Mapping[str, float] | None = None,
    starts: int = 4,
    key: int = 0,
    confidence: float = 0.95,
    scales: Scales | None = None,
    strict: bool = False,
) -> Calibration:
    """The parameters that fit measured series best (``scipy.optimize.least_squares``).

    The fit's derivatives by μ are right with event-resolved friction, the default.

    Raises ``ValueError`` if an argument breaks its rule; if the measured numbers are not more than
    the parameters or do not determine them, or no start gives a finite response. Warns as
    ``simulate``, for the run of the calibrated structures.

    Parameters
    ----------
    space
        The parameters to be found, and their bounds.
    measured
        Series by name, shape (n_steps+1,) each, at the instants of the grid; NaN where nothing was
        measured: displacement x1, velocity v1 and absolute acceleration a1 of every mass, or floor,
        numbered from 1, and the gap (of several links gap_1 and so on). With a law of contact also
        the first m impacts in order, shape (m,) each: ``impacts.time``, ``impacts.impulse`` and the
        others of ``ImpactSeries`` (of several links ``impacts_1.time`` and so on). Where a run has
        fewer, an impact of speed, impulse and force 0 at its end is compared.
    ground, grid, scheme, strict
        See ``simulate``.
    noise
        Standard deviation > 0 of the errors of each series, which weights it; by default that of
        the residuals of a first fit with equal weights.
    start, starts, key
        See ``design_damper``; the fit with the smallest sum of squares is returned.
    confidence
        Confidence level of the intervals.
    scales
        For measurements in SI units.
    """
    owner = "calibrate"
    instance(owner, "space", space, DesignSpace)
    instance(owner, "grid", grid, TimeGrid)
    instance(owner, "scheme", scheme, Scheme)
    system = single_system(owner, space.nominal)
    data = _data(owner, measured, grid, measurables(system))
    scales = scales_for(owner, space.nominal, scales)
    require_time_unit("ground", ground, si=gravity_of(space.nominal) is not None)
    shaking = as_pytree(ground, grid)
    if strict:  # before the time for the fit is spent
        warn(owner, unseen(ground, grid) + imprecise(system, shaking), strict)

    def run(structures: Any, strict: bool = False) -> Response:
        response = simulate(structures, shaking, grid, scheme, strict=strict)
        return response if scales is None else scales.to_si(response)

    def series(shares: Any) -> dict[str, jax.Array]:
        return _series(run(space.structures(shares)), data)

    fit = fitted(
        owner,
        space,
        series,
        data,
        noise=noise,
        start=start,
        starts=starts,
        key=key,
        confidence=confidence,
    )
    structures = jax.tree.map(float, space.structures(jnp.asarray(fit.shares)))
    response = run(structures, strict)
    simulated = _series(response, data)
    residuals = {name: x - np.asarray(simulated[name]) for name, x in data.items()}
    spreads = {name: spread(r[np.isfinite(data[name])]) for name, r in residuals.items()}
    results = fit.parameters, fit.correlation, spreads, response, residuals
    return Calibration(structures, *results, fit.at_bounds, fit.runs)


def _series(response: Response, data: Mapping[str, np.ndarray]) -> dict[str, jax.Array]:
    """The series of a run that were measured, of the measured shapes."""
    series = {}
    for name, x in data.items():
        place, _, field = name.partition(".")
        if field:  # of impacts
            link = response.links[int(place.partition("_")[2] or 1) - 1]
            first = getattr(link.impacts, field)[: x.size]
            lacking = 0.0 * response.demand.pga  # NaN in an invalid run
            if quantities(ImpactSeries)[field].kind == "time":
                lacking = lacking + response.time[-1]
            series[name] = jnp.where(jnp.isnan(first), lacking, first)
        elif name[0] == "a":
            series[name] = response.absolute_accelerations[int(name[1:]) - 1]
        else:
            series[name] = getattr(response, name)
    return series


def _data(
    owner: str, measured: Any, grid: TimeGrid, measurable: Collection[str]
) -> dict[str, np.ndarray]:
    instance(owner, "measured", measured, Mapping)
    if not measured:
        raise InvalidInput(owner, "measured", "{}", "must hold a series")
    data = {}
    for name, values in measured.items():
        place = f"measured[{name!r}]"
        if name not in measurable:
            rule = f"must be one of {', '.join(measurable)}"
            if str(name).startswith("impacts") and not any("." in x for x in measurable):
                rule = "must not be given for structures without a law of contact"
            raise InvalidInput(owner, place, "", rule)
        x = np.asarray(_checks.real(owner, place, values), float)
        most, n = min(MOST, grid.n_steps), grid.n_steps + 1
        if "." in name:
            right, rule = x.ndim == 1 and 1 <= x.size <= most, f"(m,), m impacts from 1 to {most}"
        else:
            right, rule = x.shape == (n,), f"({n},), a number for every instant of the grid"
        if not right:
            raise InvalidInput(owner, place, "", f"of shape {x.shape} must be {rule}")
        enforce(owner, [Rule(place, x, ~np.isinf(x), "finite, or NaN for no number")])
        data[name] = x
    return data
