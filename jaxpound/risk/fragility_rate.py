"""The annual rate of pounding by a fragility: its integral over a hazard curve, band by band."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import log_ndtr, ndtr

from jaxpound.risk.annual_rate import LEFT_OUT
from jaxpound.study.fragility import Fragility

if TYPE_CHECKING:
    from jaxpound.risk.hazard import HazardCurve

_FINE = 2000  # bands from which those that hold the rate are sought
_FAR = 1e3  # ratio beyond median and curve up to which they are, at least
_ENDS = (1e-300, 1e300)  # intensities within which they are, whatever the median


@dataclasses.dataclass(frozen=True, eq=False)
class FragilityRate:
    """∫ P(pounding | im) |dλ(im)| over bands of intensity."""

    hazard: HazardCurve
    fragility: Fragility

    def __call__(self, owner: str, intensity: Any) -> FragilityRate:
        """Itself: the intensity is that of the fragility."""
        if intensity is not None:
            raise ValueError(f"{owner}: intensity must be None: a fragility has its own")
        return self

    @property
    def measure(self) -> str:
        """That of the hazard curve."""
        return self.hazard.measure

    def edges(self, bands: int) -> np.ndarray:
        """Edges of bands that hold all but ``LEFT_OUT`` of the rate at either end."""
        hazard, curve = self.hazard, self.fragility
        ends = np.array([hazard.intensity[0], hazard.intensity[-1]])
        # The intensities at pounding are lognormal about θ e^(−k β²) where k is the slope, and
        # beyond θ fall as im^−k.
        steepest, last = hazard.slope.max(), hazard.slope[-1]
        low = min(ends[0], curve.median * np.exp(-steepest * curve.dispersion**2)) / _FAR
        high = max(ends[1], curve.median) * _FAR ** max(1.0, 1 / max(last, 0.1))
        low, high = np.clip([low, high], *_ENDS).tolist()
        fine = np.r_[0.0, np.geomspace(low, high, _FINE), np.inf]
        rates, _ = self.parts(fine)
        share = np.cumsum(rates) / rates.sum()
        first, last_of = np.searchsorted(share, [LEFT_OUT, 1 - LEFT_OUT])
        first = int(np.clip(first, 1, _FINE - 1))
        return np.geomspace(
            fine[first], fine[int(np.clip(last_of + 1, first + 1, _FINE))], bands + 1
        )

    def parts(self, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The integral over each band, and its c.o.v. by the covariance, to first order."""
        rate, slope = integral(self.hazard, self.fragility, edges)
        variance = np.einsum("bi,ij,bj->b", slope, self.fragility.covariance, slope)
        with np.errstate(divide="ignore", invalid="ignore"):
            return rate, np.where(rate > 0, np.sqrt(variance) / rate, np.nan)


def integral(
    hazard: HazardCurve, fragility: Fragility, edges: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """∫ P(pounding | im) |dλ(im)| over bands of intensity, exactly.

    Parameters
    ----------
    hazard
        The curve λ.
    fragility
        The lognormal P.
    edges
        Of the bands, shape (n,), rising; 0 and ∞ are allowed.

    Returns
    -------
    The integral over each band, shape (n − 1,), and its derivatives by ln θ and β, shape
    (n − 1, 2).
    """
    # Pieces between edges and points of the curve: on each, λ is one power law.
    inner = hazard.intensity[(hazard.intensity > edges[0]) & (hazard.intensity < edges[-1])]
    at = np.unique(np.concatenate([edges, inner]))
    piece = hazard.piece(at[:-1])
    k, theta, beta = hazard.slope[piece], fragility.median, fragility.dispersion
    with np.errstate(divide="ignore"):
        u = np.log(at) - np.log(theta)
    z = np.stack([u[:-1], u[1:]]) / beta
    start = np.log(hazard.annual_rate[piece]) + k * (
        np.log(hazard.intensity[piece]) - np.log(theta)
    )
    # ∫ λ dP = e^(start + k²β²/2) [Φ(z + kβ)], by completing the square.
    under = np.exp(start + (k * beta) ** 2 / 2 + _log_between(*(z + k * beta)))
    # At intensity 0 there is no pounding, and no earthquake exceeds ∞.
    inside = np.isfinite(z)
    rate = np.where(inside, np.exp(start - k * beta * np.where(inside, z, 0.0)), 0.0)
    of_ends, density = ndtr(z) * rate, np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi) * rate
    parts = np.maximum(under + of_ends[0] - of_ends[1], 0.0)
    slopes = -k * under, k * (k * beta * under - density[0] + density[1])
    band = np.searchsorted(at, edges[:-1])
    value, *by = (np.add.reduceat(x, band) for x in (parts, *slopes))
    return value, np.stack(by, axis=-1)


def _log_between(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """ln(Φ(high) − Φ(low)), counted from the nearer tail."""
    above = low > 0
    low, high = np.where(above, -high, low), np.where(above, -low, high)
    with np.errstate(divide="ignore"):
        return log_ndtr(high) + np.log1p(-np.exp(log_ndtr(low) - log_ndtr(high)))
