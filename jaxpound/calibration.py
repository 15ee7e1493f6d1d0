"""Parameters of the structures from measured motion: least squares through the simulator."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy import optimize, stats

from jaxpound._checks import Rule, count, enforce, finite, instance, real, require_share
from jaxpound.design_space import DesignSpace, spread_shares
from jaxpound.estimates import Estimate
from jaxpound.ground import GroundLike, as_pytree
from jaxpound.response import Response
from jaxpound.scheme import Scheme, TimeGrid
from jaxpound.simulation import simulate
from jaxpound.structures import AdjacentStructures
from jaxpound.units import Scales

SERIES = ("x1", "x2", "v1", "v2", "a1", "a2", "gap")
"""What may be measured: series of ``Response``, with a1 and a2 the absolute accelerations."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Calibration:
    """Structures that explain what was measured, and how well the parameters are known."""

    structures: AdjacentStructures
    parameters: dict[str, Estimate]
    """By path: value and interval, from the linearised least squares (Student's t)."""
    correlation: np.ndarray
    """Of the estimates, shape (d, d)."""
    noise: dict[str, float]
    """Standard deviation of what is left, by series, in the series' unit."""
    response: Response
    """Of the calibrated structures."""
    residuals: dict[str, np.ndarray]
    """Measured − simulated, shape (n_steps+1,) each; NaN where nothing was measured."""
    simulations: int
    """Runs of the simulator, each with its derivatives."""

    def __repr__(self) -> str:
        lines = [f"Calibration ({self.simulations} runs)"]
        lines += [f"    {path:18} {estimate}" for path, estimate in self.parameters.items()]
        lines += [f"    noise of {name:9} {std:.4g}" for name, std in self.noise.items()]
        return "\n".join(lines)


def calibrate(
    space: DesignSpace,
    measured: Mapping[str, Any],
    ground: GroundLike,
    grid: TimeGrid,
    scheme: Scheme = Scheme(),
    *,
    noise: Mapping[str, float] | None = None,
    start: AdjacentStructures | Mapping[str, float] | None = None,
    starts: int = 4,
    key: int = 0,
    confidence: float = 0.95,
    scales: Scales | None = None,
) -> Calibration:
    """The parameters that fit measured series best (``scipy.optimize.least_squares``).

    Friction's stops are found within the steps, so that the fit's derivatives by μ are right.

    Parameters
    ----------
    space
        What is to be found, between which bounds.
    measured
        Series by name (x1, x2, v1, v2, a1, a2: absolute accelerations, gap), shape (n_steps+1,)
        each, at the instants of the grid; NaN where nothing was measured.
    ground, grid, scheme
        As of ``simulate``.
    noise
        Standard deviation > 0 of each series' errors, its weight; by default all weigh alike in
        units of their own root mean square, and the noise is estimated from what is left.
    start, starts, key
        As of ``design_damper``; the fit of the smallest sum of squares is returned.
    confidence
        Of the intervals.
    scales
        For measurements in SI units.

    Returns
    -------
    Calibration

    Raises
    ------
    ValueError
        If an argument breaks its rule; if there are not more numbers than parameters, they do not
        determine the parameters, or no start gives a finite response.
    """
    owner = "calibrate"
    instance(owner, "space", space, DesignSpace)
    instance(owner, "grid", grid, TimeGrid)
    instance(owner, "scheme", scheme, Scheme)
    require_share(owner, "confidence", confidence)
    data = _data(owner, measured, grid)
    weights = _weights(owner, data, noise)
    shaking = as_pytree(ground, grid)
    known = {name: np.isfinite(x) for name, x in data.items()}
    n, d = sum(int(mask.sum()) for mask in known.values()), space.dimension
    enforce(owner, [Rule("measured", n, n > d, f"more numbers than the {d} parameters")])

    def series(shares: Any) -> dict[str, jax.Array]:
        response = simulate(space.structures(shares), shaking, grid, scheme)
        return _series(response if scales is None else scales.to_si(response))

    @jax.jit
    def residual(shares: Any) -> Any:
        found = series(shares)
        parts = [
            jnp.where(known[name], (found[name] - np.nan_to_num(x)) / weights[name], 0.0)
            for name, x in data.items()
        ]
        return jnp.concatenate(parts)

    slope = jax.jit(jax.jacfwd(residual))
    first = space.shares(space.nominal if start is None else start)
    fits, runs = [], 0
    for begun in spread_shares(first, count(owner, "starts", starts), key):
        if not np.isfinite(residual(begun)).all():
            continue
        inside = np.clip(begun, 1e-6, 1 - 1e-6)
        fit = optimize.least_squares(
            residual,
            inside,
            jac=lambda shares: np.asarray(slope(shares)),
            bounds=(0.0, 1.0),
            x_scale="jac",
            xtol=1e-10,
            ftol=1e-12,
            gtol=1e-12,
        )
        runs += fit.nfev
        fits.append(fit)
    if not fits:
        raise ValueError(f"{owner}: no start of {starts} gives a finite response")
    best = min(fits, key=lambda fit: fit.cost)
    shares = np.asarray(best.x)
    estimates, correlation = _estimates(owner, space, best, n, noise is not None, confidence)
    structures = jax.tree.map(float, space.structures(jnp.asarray(shares)))
    response = simulate(structures, shaking, grid, scheme)
    response = response if scales is None else scales.to_si(response)
    found = _series(response)
    residuals = {name: x - np.asarray(found[name]) for name, x in data.items()}
    left = {name: float(np.sqrt(np.nanmean(r**2))) for name, r in residuals.items()}
    return Calibration(structures, estimates, correlation, left, response, residuals, runs)


def _series(response: Response) -> dict[str, jax.Array]:
    a1, a2 = response.absolute_accelerations
    own = {name: getattr(response, name) for name in ("x1", "x2", "v1", "v2", "gap")}
    return own | {"a1": a1, "a2": a2}


def _data(owner: str, measured: Any, grid: TimeGrid) -> dict[str, np.ndarray]:
    instance(owner, "measured", measured, Mapping)
    if not measured:
        raise ValueError(f"{owner}: measured = {{}} must hold a series")
    data = {}
    for name, values in measured.items():
        if name not in SERIES:
            raise ValueError(f"{owner}: measured[{name!r}] must be one of {', '.join(SERIES)}")
        x = np.asarray(real(owner, f"measured[{name!r}]", values), float)
        if x.shape != (grid.n_steps + 1,):
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
        std = noise[name]
        right = (std > 0) & finite(std)
        enforce(owner, [Rule(f"noise[{name!r}]", std, right, "positive and finite")])
    return {name: float(noise[name]) for name in data}


def _estimates(
    owner: str, space: DesignSpace, fit: Any, n: int, noise_known: bool, confidence: float
) -> tuple[dict[str, Estimate], np.ndarray]:
    """Values with intervals, and their correlation, from the Jacobian at the fit."""
    d = space.dimension
    information = fit.jac.T @ fit.jac
    if np.linalg.matrix_rank(information) < d:
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
