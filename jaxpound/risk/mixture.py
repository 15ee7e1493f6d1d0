"""The density from which importance samples are drawn: normal around every design point.

A share is drawn from a guard that does not rely on the design points being all: the standard normal
widened along the directions that they span. It bounds the weights, and where the guard finds what
the others do not, the estimate says so.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import log_ndtr, logsumexp, ndtr

from jaxpound.risk.design_points import NEAR, DesignPoints
from jaxpound.study.sampling import Points

GUARD = 0.1
"""Share of the samples from the guard."""
THIN = 0.1
"""The density around the design points is thin where it is below this share of the guard's."""
_SPANNED = 0.9  # share of the squared singular values of the directions that the guard widens


class Mixture(NamedTuple):
    """A normal mixture: q(z) = (1 − g) Σ w_k φ(z − z_k) + g φ(z) widened in the span of a basis."""

    centres: Float[np.ndarray, "k d"]
    log_weights: Float[np.ndarray, " k"]
    basis: Float[np.ndarray, "r d"]
    wide: float
    """Standard deviation of the guard along the basis."""

    @staticmethod
    def of(found: DesignPoints) -> Mixture:
        """The mixture of design points, each weighted by the probability beyond its plane."""
        near = found.within(NEAR)
        logs = log_ndtr(-near.betas)
        _, sizes, rows = np.linalg.svd(near.directions, full_matrices=False)
        share = np.cumsum(sizes**2) / np.sum(sizes**2)
        rank = int(np.searchsorted(share, _SPANNED)) + 1
        return Mixture(near.z, logs - logsumexp(logs), rows[:rank], max(1.5, near.betas[0] / 2))

    def draw(self, points: Points, start: int, stop: int) -> Float[np.ndarray, "n d"]:
        """Samples start to stop − 1, which depend on their numbers alone.

        ``points`` are standard normal ones of d + 1 numbers.
        """
        normal = points(start, stop)
        y, chance = normal[:, :-1], ndtr(normal[:, -1])
        ends = np.cumsum((1 - GUARD) * np.exp(self.log_weights))
        which = np.searchsorted(ends, chance)
        guard = which == len(ends)
        centred = y + self.centres[np.minimum(which, len(ends) - 1)]
        widened = y + (self.wide - 1) * (y @ self.basis.T) @ self.basis
        return np.where(guard[:, None], widened, centred)

    def log_ratios(self, z: Float[np.ndarray, "n d"]) -> tuple[np.ndarray, np.ndarray]:
        """Logarithms of q/φ and of the guard's density over that around the design points."""
        own = self.log_weights - 0.5 * np.sum(self.centres**2, axis=1)
        around = logsumexp(z @ self.centres.T + own, axis=1)
        along = np.sum((z @ self.basis.T) ** 2, axis=1)
        guard = 0.5 * along * (1 - self.wide**-2) - len(self.basis) * np.log(self.wide)
        whole = np.logaddexp(np.log1p(-GUARD) + around, np.log(GUARD) + guard)
        return whole, guard - around

    def weights(self, z: Float[np.ndarray, "n d"]) -> Float[np.ndarray, " n"]:
        """φ/q of samples."""
        return np.exp(-self.log_ratios(z)[0])

    def thin(self, z: Float[np.ndarray, "n d"]) -> np.ndarray:
        """Where the density around the design points is thin, shape (n,)."""
        return self.log_ratios(z)[1] > -np.log(THIN)
