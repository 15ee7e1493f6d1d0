"""The random intensity of an earthquake, as a hazard curve has it, and weights that give it."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax.scipy.special import log_ndtr, ndtri

CurvePoints = tuple[np.ndarray, np.ndarray]
"""Intensities and annual rates of a hazard curve."""


@dataclasses.dataclass(frozen=True)
class HazardIntensity:
    """Intensity of an earthquake that exceeds the lowest of a hazard curve, as a distribution.

    ``HazardCurve.distribution`` makes it. P(intensity > im) = λ(im) / λ(lowest), with ln λ linear
    in ln im between the points and continued above the last.
    """

    intensity: tuple[float, ...]
    annual_rate: tuple[float, ...]

    def __post_init__(self) -> None:
        before, last = self.annual_rate[-2:]
        if not before > last:
            raise ValueError(
                f"HazardIntensity: annual_rate = {last:.8g} of the highest intensity must be "
                f"smaller than that of the one before, {before:.8g}"
            )

    def from_normal(self, z: Any) -> Any:
        """The intensity that is exceeded with probability Φ(−z)."""
        z = jnp.asarray(z, float)
        start, below, slope = (jnp.asarray(x, z.dtype) for x in self._falling())
        # Minus ln of the share of earthquakes that are stronger.
        depth = -log_ndtr(-z)
        piece = jnp.clip(jnp.searchsorted(below, depth, side="right") - 1, 0, below.size - 1)
        return jnp.exp(start[piece] + (depth - below[piece]) / slope[piece])

    def to_normal(self, x: Any) -> Any:
        """Inverse of ``from_normal``: −∞ below the lowest intensity."""
        x = jnp.asarray(x, float)
        inside = x > self.intensity[0]
        u = jnp.log(jnp.where(inside, x, 2 * self.intensity[0]))
        points = np.log(self.intensity), np.log(self.annual_rate)
        steepness = np.diff(points[1]) / np.diff(points[0])
        at, rate, slope = (jnp.asarray(x, u.dtype) for x in (*points, steepness))
        piece = jnp.clip(jnp.searchsorted(at, u, side="right") - 1, 0, slope.size - 1)
        stronger = jnp.exp(rate[piece] + slope[piece] * (u - at[piece]) - rate[0])
        known = inside & (stronger < 1)
        return jnp.where(known, -ndtri(jnp.where(known, stronger, 0.5)), -jnp.inf)

    def _falling(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of the pieces on which the rate falls: ln im and −ln share at the start, the exponent."""
        at, rate = np.log(self.intensity), np.log(self.annual_rate)
        falls = np.diff(rate) < 0
        slope = (-np.diff(rate) / np.diff(at))[falls]
        return at[:-1][falls], (rate[0] - rate[:-1])[falls], slope


class HazardWeights(np.ndarray):
    """Weights that ``HazardCurve.weights`` makes: an array that knows the points of its curve.

    What is computed from them is no longer such weights, and does not know the curve.
    """

    curve: CurvePoints | None = None

    @staticmethod
    def of(weights: np.ndarray, curve: CurvePoints) -> HazardWeights:
        """Weights by the points of a curve."""
        made = weights.view(HazardWeights)
        made.curve = curve
        return made

    def __array_wrap__(self, array: Any, *context: Any) -> Any:
        """What NumPy makes of them: a sum is a plain number."""
        made = super().__array_wrap__(array, *context)
        return made[()] if made.ndim == 0 else made
