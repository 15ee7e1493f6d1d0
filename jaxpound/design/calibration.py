"""Parameters of the structures from measured motion: least squares through the simulator."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Mapping
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound import _checks
from jaxpound._checks import Rule, enforce, instance
from jaxpound._errors import InvalidInput, warn
from jaxpound._fields import quantities
from jaxpound._tables import Shown, TextTable
from jaxpound.design.space import DesignSpace, spread_shares, start_shares
from jaxpound.grid import TimeGrid
from jaxpound.ground.motion import GroundLike
from jaxpound.ground.plausibility import unseen
from jaxpound.ground.run_input import as_pytree, require_time_unit
from jaxpound.model.hysteresis import hysteresis_of
from jaxpound.model.system import Structures, System, in_si, is_closable
from jaxpound.quantities import unit
from jaxpound.results.elements import of_link
from jaxpound.results.impacts import MOST, ImpactSeries
from jaxpound.results.response import Response
from jaxpound.simulation.run import simulate
from jaxpound.simulation.scheme import Scheme, imprecise, single_system
from jaxpound.study.rod_tests import CyclicTest, cyclic_test
from jaxpound.study.statistics import Estimate

_AT_BOUND = 1e-4  # of the way between the bounds
_TOLERANCES: dict[str, Any] = {"xtol": 1e-10, "ftol": 1e-12, "gtol": 1e-12}  # of a fit


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
    response: Any
    """The ``Response`` of the calibrated structures, or the ``CyclicTest`` of their rod."""
    residuals: dict[str, np.ndarray]
    """Measured − simulated, of the measured shapes; NaN where nothing was measured."""
    at_bounds: tuple[str, ...]
    """Parameters at a bound of the space: their intervals mean nothing."""
    simulations: int
    """Runs of the simulator, each with its derivatives."""

    def _tables(self) -> list[TextTable]:
        kinds = measurables(self.structures.system()) | {"force": "force"}
        si = in_si(self.structures)
        units = "SI" if si else "dimensionless"
        noise_units = {x: unit(kinds[x], si) for x in self.noise}
        if isinstance(self.response, CyclicTest) and not si:
            units, noise_units = "units of the test", {"force": "of the test"}
        columns = (f"parameter ({units})", "estimate")
        values = [(path, str(estimate)) for path, estimate in self.parameters.items()]
        notes = [f"{path} is at a bound: its interval means nothing" for path in self.at_bounds]
        estimates = TextTable(f"Calibration ({self.simulations} runs)", columns, values, notes)
        title = "Noise, what is left of the measured series"
        noise = [(name, std, noise_units[name]) for name, std in self.noise.items()]
        headings = ("series", "standard deviation", "unit")
        return [estimates, TextTable(title, headings, noise, digits=4)]


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
    confidence: float = 0.95,
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
    start, starts
        The structures of the first start, by default the space's nominal ones, and the number of
        starts: the others are spread over the space (scrambled Sobol points, of which more begin
        with the same). The fit with the smallest sum of squares is returned.
    confidence
        Confidence level of the intervals.
    """
    instance("space", space, DesignSpace)
    instance("grid", grid, TimeGrid)
    instance("scheme", scheme, Scheme)
    system = single_system(space.nominal)
    data = _data(measured, grid, measurables(system))
    require_time_unit("ground", ground, si=in_si(space.nominal))
    shaking = as_pytree(ground, grid)
    if strict:  # before the time for the fit is spent
        warn(unseen(ground, grid, strict=strict) + imprecise(system, grid, shaking), strict)

    def run(structures: Any, last: bool = False) -> Response:
        return simulate(structures, shaking, grid, scheme, strict=strict and last)

    options = data, noise, start, starts, confidence
    return _calibrated(space, run, partial(_series, data=data), *options)


def calibrate_cyclic(
    space: DesignSpace,
    displacements: Any,
    forces: Any,
    rod: int = 0,
    steps: int = 8,
    *,
    noise: Mapping[str, float] | None = None,
    start: Structures | Mapping[str, float] | None = None,
    starts: int = 4,
    confidence: float = 0.95,
) -> Calibration:
    """The parameters of a rod that yields that fit a measured cyclic test best.

    ``displacements`` and ``forces`` were measured, shape (n,) each; forces are NaN where nothing
    was. Between two displacements the law takes ``steps`` steps, as in ``cyclic_test``. ``space``
    has parameters of one rod of its structures, by number from 0: its stiffness, and its law, which
    alone is tested of a ``YieldingZener``. See ``calibrate`` for ``noise``, which is by the name
    "force", ``start``, ``starts`` and ``confidence``. Raises ``ValueError`` as ``calibrate`` does,
    or if the rod has no law of hysteresis.

    Examples
    --------
    >>> rod = jp.Rod(jp.Bilinear(0.1, hardening=0.05), 2.0, (0, jp.GROUND))
    >>> history = 0.3 * np.sin(np.linspace(0, 9, 60))
    >>> measured = jp.study.cyclic_test(rod.material, history, stiffness=5.0, steps=1).force
    >>> space = jp.DesignSpace(jp.System((1,), (rod,)), {"rods.0.stiffness": (1, 20)})
    >>> round(jp.design.calibrate_cyclic(space, history, measured).structures.rods[0].stiffness, 4)
    5.0
    """
    instance("space", space, DesignSpace)
    if not (_checks.is_whole(rod) and 0 <= rod < len(space.nominal.system().rods)):
        raise InvalidInput("rod", repr(rod), "must be the number of a rod")
    x, force = np.asarray(displacements), _measured("forces", forces)
    if force.shape != x.shape:
        rule = f"of shape {force.shape} must be {x.shape}, as displacements"
        raise InvalidInput("forces", "", rule)

    def run(structures: Any, last: bool = False) -> CyclicTest:
        tested = structures.system().rods[rod]
        test = cyclic_test(hysteresis_of(tested.material), x, tested.stiffness, steps)
        return jax.tree.map(lambda series: series[::steps], test)

    run(space.nominal)  # refuses what is wrong
    options = {"force": force}, noise, start, starts, confidence
    return _calibrated(space, run, lambda x: {"force": x.force}, *options)


def _calibrated(
    space: DesignSpace,
    run: Callable[..., Any],
    series: Callable[[Any], dict[str, jax.Array]],
    data: Mapping[str, np.ndarray],
    noise: Mapping[str, float] | None,
    start: Any,
    starts: int,
    confidence: float,
) -> Calibration:
    """The parameters of a space by whose runs the series fit the data best."""
    _checks.require_share("confidence", confidence)
    weights = _weights(data, noise)
    n, d = sum(int(np.isfinite(x).sum()) for x in data.values()), space.dimension
    enforce([Rule("measured", n, n > d, f"more numbers than the {d} parameters")])
    residual, fit = _least_squares(lambda shares: series(run(space.structures(shares))), data)
    first = start_shares(space, start)
    spread = spread_shares(first, _checks.count("starts", starts), key=0)
    fits = [fit(x, weights) for x in spread if np.isfinite(residual(x, weights)).all()]
    if not fits:
        raise InvalidInput("", "", f"no start of {starts} gives a finite response")
    best = min(fits, key=lambda x: x.cost)
    if noise is None:  # by the standard deviations of each series' residuals
        ends = np.cumsum([x.size for x in data.values()])[:-1]
        for (name, x), over_weight in zip(data.items(), np.split(best.fun, ends), strict=True):
            weights[name] *= _spread(over_weight[np.isfinite(x)]) or 1.0
        best = fit(best.x, weights)
        fits.append(best)
    shares = np.asarray(best.x)
    estimates = _estimates(space, best, n, noise is not None, confidence)
    structures = jax.tree.map(float, space.structures(jnp.asarray(shares)))
    response = run(structures, True)
    simulated = series(response)
    residuals = {name: x - np.asarray(simulated[name]) for name, x in data.items()}
    spreads = {name: _spread(r[np.isfinite(data[name])]) for name, r in residuals.items()}
    edges = np.flatnonzero((shares < _AT_BOUND) | (shares > 1 - _AT_BOUND))
    at_bounds, runs = tuple(space.names[i] for i in edges), sum(x.nfev for x in fits)
    return Calibration(structures, *estimates, spreads, response, residuals, at_bounds, runs)


def _least_squares(
    series: Callable[[Any], dict[str, jax.Array]], data: Mapping[str, np.ndarray]
) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Weighted residuals by scaled variables and weights, and the fit from a start."""
    from scipy import optimize  # only here: it takes a second to import

    def difference(shares: Any, weights: Mapping[str, Any]) -> Any:
        simulated = series(shares)
        parts = [
            jnp.where(np.isfinite(x), (simulated[name] - np.nan_to_num(x)) / weights[name], 0.0)
            for name, x in data.items()
        ]
        return jnp.concatenate(parts)

    residual, slope = jax.jit(difference), jax.jit(jax.jacfwd(difference))

    def fit(start: np.ndarray, weights: Mapping[str, float]) -> Any:
        return optimize.least_squares(
            lambda shares: np.asarray(residual(shares, weights), np.float64),
            np.clip(np.asarray(start, np.float64), 1e-6, 1 - 1e-6),
            jac=lambda shares: np.asarray(slope(shares, weights), np.float64),
            bounds=(0.0, 1.0),
            x_scale="jac",
            **_TOLERANCES,
        )

    return residual, fit


def _spread(residual: np.ndarray) -> float:
    """Root mean square; 0 if there is no number."""
    return float(np.sqrt(np.mean(residual**2))) if residual.size else 0.0


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


def _data(measured: Any, grid: TimeGrid, measurable: Collection[str]) -> dict[str, np.ndarray]:
    instance("measured", measured, Mapping)
    if not measured:
        raise InvalidInput("measured", "{}", "must hold a series")
    data = {}
    for name, values in measured.items():
        place = f"measured[{name!r}]"
        if name not in measurable:
            rule = f"must be one of {', '.join(measurable)}"
            if str(name).startswith("impacts") and not any("." in x for x in measurable):
                rule = "must not be given for structures without a law of contact"
            raise InvalidInput(place, "", rule)
        x = _measured(place, values)
        most, n = min(MOST, grid.n_steps), grid.n_steps + 1
        if "." in name:
            right, rule = x.ndim == 1 and 1 <= x.size <= most, f"(m,), m impacts from 1 to {most}"
        else:
            right, rule = x.shape == (n,), f"({n},), a number for every instant of the grid"
        if not right:
            raise InvalidInput(place, "", f"of shape {x.shape} must be {rule}")
        data[name] = x
    return data


def _measured(place: str, values: Any) -> np.ndarray:
    x = np.asarray(_checks.real(place, values), float)
    enforce([Rule(place, x, ~np.isinf(x), "finite, or NaN for no number")])
    return x


def _weights(data: Mapping[str, np.ndarray], noise: Any) -> dict[str, float]:
    if noise is None:
        sizes = {name: float(np.sqrt(np.nanmean(x**2))) for name, x in data.items()}
        return {name: size if size > 0 else 1.0 for name, size in sizes.items()}
    instance("noise", noise, Mapping)
    for name in data:
        if name not in noise:
            raise InvalidInput("noise", "", f"lacks {name!r}, which was measured")
        _checks.positive_number(**{f"noise[{name!r}]": noise[name]})
    return {name: float(noise[name]) for name in data}


def _estimates(
    space: DesignSpace, fit: Any, n: int, noise_is_set: bool, confidence: float
) -> tuple[dict[str, Estimate], np.ndarray]:
    """Values with intervals, and their correlation, from the Jacobian at the fit."""
    from scipy import stats

    d, shares = space.dimension, jnp.asarray(fit.x)
    if np.linalg.matrix_rank(fit.jac) < d:
        raise InvalidInput("measured", "", f"must determine all of {', '.join(space.names)}")
    spread = 1.0 if noise_is_set else 2 * fit.cost / (n - d)
    by_shares = jax.jacfwd(space.values)(shares)
    slopes = np.array([by_shares[name] for name in space.names])
    covariance = slopes @ np.linalg.inv(fit.jac.T @ fit.jac) @ slopes.T  # for a spread of 1
    std = np.sqrt(np.diag(covariance))
    half_widths = np.sqrt(spread) * std * stats.t.isf((1 - confidence) / 2, n - d)
    estimates = {
        name: Estimate(float(x), float(x - half), float(x + half), confidence)
        for (name, x), half in zip(space.values(shares).items(), half_widths, strict=True)
    }
    return estimates, covariance / np.outer(std, std)
