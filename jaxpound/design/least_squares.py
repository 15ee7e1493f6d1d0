"""Parameters in a design space from measured series: the least squares of every calibration."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound import _checks
from jaxpound._checks import Rule, enforce, instance
from jaxpound._errors import InvalidInput
from jaxpound._tables import TextTable
from jaxpound.design.space import DesignSpace, spread_shares, start_shares
from jaxpound.study.statistics import Estimate

Series = Mapping[str, np.ndarray]

_AT_BOUND = 1e-4  # of the way between the bounds


class Fit(NamedTuple):
    """The best of several fits, and what it says of the parameters."""

    shares: np.ndarray
    """Scaled variables."""
    parameters: dict[str, Estimate]
    correlation: np.ndarray
    at_bounds: tuple[str, ...]
    runs: int
    """Of the model, each with its derivatives."""


def fitted(
    owner: str,
    space: DesignSpace,
    series: Callable[[Any], dict[str, jax.Array]],
    data: Series,
    *,
    noise: Mapping[str, float] | None,
    start: Any,
    starts: int,
    key: int,
    confidence: float,
) -> Fit:
    """The parameters that fit the series best; arguments are those of ``calibrate``.

    ``series`` gives the model's series from scaled variables, ``data`` those measured, NaN where
    nothing was.
    """
    _checks.require_share(owner, "confidence", confidence)
    weights = _weights(owner, data, noise)
    n, d = sum(int(np.isfinite(x).sum()) for x in data.values()), space.dimension
    enforce(owner, [Rule("measured", n, n > d, f"more numbers than the {d} parameters")])
    residual, fit = _least_squares(series, data)
    first = start_shares(owner, space, start)
    starts, key = _checks.count(owner, "starts", starts), _checks.seed(owner, "key", key)
    tried = spread_shares(first, starts, key)
    fits = [fit(x, weights) for x in tried if np.isfinite(residual(x, weights)).all()]
    if not fits:
        raise InvalidInput(owner, "", "", f"no start of {starts} gives a finite response")
    best = min(fits, key=lambda x: x.cost)
    if noise is None:
        best = fit(best.x, _weights_by_residuals(weights, best.fun, data))
        fits.append(best)
    shares = np.asarray(best.x)
    estimates, correlation = _estimates(owner, space, best, n, noise is not None, confidence)
    edges = np.flatnonzero((shares < _AT_BOUND) | (shares > 1 - _AT_BOUND))
    at_bounds = tuple(space.names[i] for i in edges)
    return Fit(shares, estimates, correlation, at_bounds, sum(x.nfev for x in fits))


def estimates_table(
    heading: str, parameters: Mapping[str, Estimate], at_bounds: Any, runs: int
) -> TextTable:
    """Estimates by name below a heading, and which of them are at a bound."""
    return TextTable(
        f"Calibration ({runs} runs)",
        (heading, "estimate"),
        [(path, str(estimate)) for path, estimate in parameters.items()],
        [f"{path} is at a bound: its interval means nothing" for path in at_bounds],
    )


def _least_squares(
    series: Callable[[Any], dict[str, jax.Array]], data: Series
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
            xtol=1e-10,
            ftol=1e-12,
            gtol=1e-12,
        )

    return residual, fit


def spread(residual: np.ndarray) -> float:
    """Root mean square; 0 if there is no number."""
    return float(np.sqrt(np.mean(residual**2))) if residual.size else 0.0


def _weights(owner: str, data: Series, noise: Any) -> dict[str, float]:
    if noise is None:
        sizes = {name: float(np.sqrt(np.nanmean(x**2))) for name, x in data.items()}
        return {name: size if size > 0 else 1.0 for name, size in sizes.items()}
    instance(owner, "noise", noise, Mapping)
    for name in data:
        if name not in noise:
            raise InvalidInput(owner, "noise", "", f"lacks {name!r}, which was measured")
        _checks.positive_number(owner, **{f"noise[{name!r}]": noise[name]})
    return {name: float(noise[name]) for name in data}


def _weights_by_residuals(
    weights: Mapping[str, float], residuals: Any, data: Series
) -> dict[str, float]:
    """The standard deviations of each series' residuals, which are given over the weights."""
    ends = np.cumsum([x.size for x in data.values()])[:-1]
    parts = zip(data.items(), np.split(np.asarray(residuals), ends), strict=True)
    return {name: weights[name] * (spread(r[np.isfinite(x)]) or 1.0) for (name, x), r in parts}


def _estimates(
    owner: str, space: DesignSpace, fit: Any, n: int, noise_is_set: bool, confidence: float
) -> tuple[dict[str, Estimate], np.ndarray]:
    """Values with intervals, and their correlation, from the Jacobian at the fit."""
    from scipy import stats

    d, shares = space.dimension, jnp.asarray(fit.x)
    if np.linalg.matrix_rank(fit.jac) < d:
        raise InvalidInput(owner, "measured", "", f"must determine all of {', '.join(space.names)}")
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
