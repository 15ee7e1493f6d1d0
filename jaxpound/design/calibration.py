"""Parameters of the structures from measured motion: least squares through the simulator."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound._checks import (
    Rule,
    count,
    enforce,
    finite,
    instance,
    number,
    real,
    require_share,
    seed,
)
from jaxpound._fields import quantities
from jaxpound._tables import Shown, Table
from jaxpound.design.space import DesignSpace, spread_shares, start_shares
from jaxpound.grid import TimeGrid
from jaxpound.ground.motion import GroundLike, as_pytree
from jaxpound.ground.plausibility import tell, unseen
from jaxpound.model.system import Structures, System, is_closable
from jaxpound.quantities import unit
from jaxpound.results.elements import of_link
from jaxpound.results.impacts import MOST, ImpactSeries
from jaxpound.results.response import Response
from jaxpound.simulation.run import simulate
from jaxpound.simulation.scheme import Scheme
from jaxpound.study.statistics import Estimate
from jaxpound.units import Scales

_AT_BOUND = 1e-4  # of the way between the bounds


class Measurable(NamedTuple):
    """What may be measured: its kind of quantity, and where a response has it."""

    kind: str | None
    group: str
    """masses, accelerations, links or impacts."""
    element: int
    """The number of the mass or link, from 0."""
    field: str = ""

    @property
    def of_impacts(self) -> bool:
        """Whether it has a number for each impact, and not for each instant."""
        return self.group == "impacts"

    def of(self, response: Response) -> Any:
        """The series of a response."""
        if self.group == "accelerations":
            return response.absolute_accelerations[self.element]
        if self.of_impacts:
            return getattr(response.links[self.element].impacts, self.field)
        return getattr(getattr(response, self.group)[self.element], self.field)


def measurables(system: System) -> dict[str, Measurable]:
    """What may be measured of a system, by name.

    Displacement, velocity and absolute acceleration of each mass, and the gap of each link that has
    one, as series; of links with a law of contact the times, speeds, impulses and peak forces of
    impacts, in order.
    """
    masses, n = range(len(system.masses)), len(system.links)
    found = {f"x{i + 1}": Measurable("length", "masses", i, "x") for i in masses}
    found |= {f"v{i + 1}": Measurable("velocity", "masses", i, "v") for i in masses}
    found |= {f"a{i + 1}": Measurable("acceleration", "accelerations", i) for i in masses}
    for k, link in enumerate(system.links):
        if is_closable(link.gap):
            found[of_link("gap", k, n)] = Measurable("length", "links", k, "gap")
        if link.contact is not None:
            for field, known in quantities(ImpactSeries).items():
                name = f"{of_link('impacts', k, n)}.{field}"
                found[name] = Measurable(known.kind, "impacts", k, field)
    return found


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Calibration(Shown):
    """Structures that explain what was measured, and how well the parameters are known."""

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

    def _tables(self) -> list[Table]:
        si, kinds = self.response.si, measurables(self.structures.system())
        return [
            Table(
                f"Calibration ({self.simulations} runs)",
                ("parameter (dimensionless)", "estimate"),
                [(path, str(estimate)) for path, estimate in self.parameters.items()],
                [f"{path} is at a bound: its interval means nothing" for path in self.at_bounds],
            ),
            Table(
                "Noise, what is left of the measured series",
                ("series", "standard deviation", "unit"),
                [(name, std, unit(kinds[name].kind, si)) for name, std in self.noise.items()],
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

    Parameters
    ----------
    space
        The parameters to be found, and their bounds.
    measured
        Series by name, shape (n_steps+1,) each, at the instants of the grid; NaN where nothing was
        measured: displacement x1, velocity v1 and absolute acceleration a1 of every mass, or floor,
        numbered from 1, and the gap (of several links gap_1 and so on). With a law of contact also
        the first m impacts in order, shape (m,) each: ``impacts.time``, ``impacts.end``,
        ``impacts.approach_velocity``, ``impacts.rebound_velocity``, ``impacts.impulse`` and
        ``impacts.peak_force`` (``ImpactSeries``; of several links ``impacts_1.time`` and so on).
        Where a run has fewer, an impact of speed, impulse and force 0 at its end is compared.
    ground, grid, scheme
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
    strict
        Whether a ``PlausibilityWarning`` is raised as a ``ValueError``.

    Returns
    -------
    Calibration

    Raises
    ------
    ValueError
        If an argument breaks its rule; if the measured numbers are not more than the parameters or
        do not determine them, or no start gives a finite response. If ``strict``, also where there
        would be a warning.

    Warns
    -----
    PlausibilityWarning
        As in ``simulate``, for the run of the calibrated structures.
    """
    from scipy import optimize  # only here: it takes a second to import

    owner = "calibrate"
    instance(owner, "space", space, DesignSpace)
    instance(owner, "grid", grid, TimeGrid)
    instance(owner, "scheme", scheme, Scheme)
    require_share(owner, "confidence", confidence)
    sources = measurables(space.nominal.system())
    data = _data(owner, measured, grid, sources)
    weights = _weights(owner, data, noise)
    shaking = as_pytree(ground, grid)
    if strict:  # before the time for the fit is spent
        tell(owner, unseen(ground, grid), strict)
    known = {name: np.isfinite(x) for name, x in data.items()}
    n, d = sum(int(mask.sum()) for mask in known.values()), space.dimension
    enforce(owner, [Rule("measured", n, n > d, f"more numbers than the {d} parameters")])

    def series(shares: Any) -> dict[str, jax.Array]:
        response = simulate(space.structures(shares), shaking, grid, scheme)
        return _series(response if scales is None else scales.to_si(response), data, sources)

    def difference(shares: Any, weights: Mapping[str, Any]) -> Any:
        found = series(shares)
        parts = [
            jnp.where(known[name], (found[name] - np.nan_to_num(x)) / weights[name], 0.0)
            for name, x in data.items()
        ]
        return jnp.concatenate(parts)

    residual, slope = jax.jit(difference), jax.jit(jax.jacfwd(difference))

    def fitted(begun: np.ndarray, weights: Mapping[str, float]) -> Any:
        return optimize.least_squares(
            lambda shares: np.asarray(residual(shares, weights), np.float64),
            np.clip(np.asarray(begun, np.float64), 1e-6, 1 - 1e-6),
            jac=lambda shares: np.asarray(slope(shares, weights), np.float64),
            bounds=(0.0, 1.0),
            x_scale="jac",
            xtol=1e-10,
            ftol=1e-12,
            gtol=1e-12,
        )

    first = start_shares(owner, space, start)
    fits: list[Any] = []
    for begun in spread_shares(first, count(owner, "starts", starts), seed(owner, "key", key)):
        if np.isfinite(residual(begun, weights)).all():
            fits.append(fitted(begun, weights))
    if not fits:
        raise ValueError(f"{owner}: no start of {starts} gives a finite response")
    best = min(fits, key=lambda fit: fit.cost)
    if noise is None:
        # Each series weighted by the standard deviation of its residuals.
        ends = np.cumsum([x.size for x in data.values()])[:-1]
        parts = dict(zip(data, np.split(np.asarray(best.fun), ends), strict=True))
        left = {name: _spread(r[known[name]]) * weights[name] for name, r in parts.items()}
        weights = {name: std or weights[name] for name, std in left.items()}
        best = fitted(best.x, weights)
        fits.append(best)
    shares = np.asarray(best.x)
    estimates, correlation = _estimates(owner, space, best, n, noise is not None, confidence)
    structures = jax.tree.map(float, space.structures(jnp.asarray(shares)))
    response = simulate(structures, shaking, grid, scheme, strict=strict)
    response = response if scales is None else scales.to_si(response)
    found = _series(response, data, sources)
    residuals = {name: x - np.asarray(found[name]) for name, x in data.items()}
    edges = (shares < _AT_BOUND) | (shares > 1 - _AT_BOUND)
    return Calibration(
        structures,
        estimates,
        correlation,
        {name: _spread(r[known[name]]) for name, r in residuals.items()},
        response,
        residuals,
        tuple(name for name, at in zip(space.names, edges, strict=True) if at),
        sum(fit.nfev for fit in fits),
    )


def _spread(residual: np.ndarray) -> float:
    """Root mean square; 0 if there is no number."""
    return float(np.sqrt(np.mean(residual**2))) if residual.size else 0.0


def _series(
    response: Response, data: Mapping[str, np.ndarray], sources: Mapping[str, Measurable]
) -> dict[str, jax.Array]:
    """The series of a run that were measured, of the measured shapes."""
    found = {}
    for name, x in data.items():
        source = sources[name]
        found[name] = source.of(response)
        if source.of_impacts:
            lacking = 0.0 * response.demand.pga  # NaN in an invalid run
            if source.kind == "time":
                lacking = lacking + response.time[-1]
            first = found[name][: x.size]
            found[name] = jnp.where(jnp.isnan(first), lacking, first)
    return found


def _data(
    owner: str, measured: Any, grid: TimeGrid, sources: Mapping[str, Measurable]
) -> dict[str, np.ndarray]:
    instance(owner, "measured", measured, Mapping)
    if not measured:
        raise ValueError(f"{owner}: measured = {{}} must hold a series")
    data = {}
    for name, values in measured.items():
        if name not in sources:
            rule = f"must be one of {', '.join(sources)}"
            if str(name).startswith("impacts") and not any(x.of_impacts for x in sources.values()):
                rule = "must not be given for structures without a law of contact"
            raise ValueError(f"{owner}: measured[{name!r}] {rule}")
        x = np.asarray(real(owner, f"measured[{name!r}]", values), float)
        most = min(MOST, grid.n_steps)
        if sources[name].of_impacts:
            if not (x.ndim == 1 and 1 <= x.size <= most):
                rule = f"(m,), m impacts from 1 to {most}"
                raise ValueError(f"{owner}: measured[{name!r}] of shape {x.shape} must be {rule}")
        elif x.shape != (grid.n_steps + 1,):
            raise ValueError(
                f"{owner}: measured[{name!r}] of shape {x.shape} must be ({grid.n_steps + 1},), "
                "a number for every instant of the grid"
            )
        inside = ~np.isinf(x)
        enforce(owner, [Rule(f"measured[{name!r}]", x, inside, "finite, or NaN for no number")])
        data[name] = x
    return data


def _weights(owner: str, data: Mapping[str, np.ndarray], noise: Any) -> dict[str, float]:
    if noise is None:
        sizes = {name: float(np.sqrt(np.nanmean(x**2))) for name, x in data.items()}
        return {name: size if size > 0 else 1.0 for name, size in sizes.items()}
    instance(owner, "noise", noise, Mapping)
    for name in data:
        if name not in noise:
            raise ValueError(f"{owner}: noise lacks {name!r}, which was measured")
        std = number(owner, f"noise[{name!r}]", noise[name])
        right = (std > 0) & finite(std)
        enforce(owner, [Rule(f"noise[{name!r}]", std, right, "positive and finite")])
    return {name: float(noise[name]) for name in data}


def _estimates(
    owner: str, space: DesignSpace, fit: Any, n: int, noise_known: bool, confidence: float
) -> tuple[dict[str, Estimate], np.ndarray]:
    """Values with intervals, and their correlation, from the Jacobian at the fit."""
    from scipy import stats

    d = space.dimension
    information = fit.jac.T @ fit.jac
    if np.linalg.matrix_rank(fit.jac) < d:
        raise ValueError(f"{owner}: measured must determine all of {', '.join(space.names)}")
    spread = 1.0 if noise_known else 2 * fit.cost / (n - d)
    shares = jnp.asarray(fit.x)

    def values(shares: Any) -> Any:
        return jnp.stack(list(space.values(shares).values()))

    to = np.asarray(jax.jacfwd(values)(shares))
    covariance = to @ (spread * np.linalg.inv(information)) @ to.T
    std = np.sqrt(np.diag(covariance))
    half = std * stats.t.isf((1 - confidence) / 2, n - d)
    found = {
        name: Estimate(float(x), float(x - h), float(x + h), confidence)
        for name, x, h in zip(space.names, values(shares), half, strict=True)
    }
    return found, covariance / np.outer(std, std)
