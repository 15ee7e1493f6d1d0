"""Importance sampling around design points: the density and its samples.

The density is normal around every design point. A share of the samples is drawn from a guard that
does not rely on the design points being all: the standard normal widened along the directions that
they span. It bounds the weights, and where its samples reach the limit state away from the design
points, the estimate has a warning.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import log_ndtr, logsumexp, ndtr

from jaxpound.reliability.design_points import NEAR, DesignPoints
from jaxpound.scenarios.sampling import Points

BATCH = 256  # runs: sample i is in batch i // 256 on every machine
_GUARD = 0.1  # share of the samples from the guard
_THIN = 0.1  # share of the guard's density below which that around the design points is thin
_SPANNED = 0.9  # share of the squared singular values of the directions that the guard widens


class Mixture(NamedTuple):
    """A normal mixture: q(z) = (1 − g) Σ w_k φ(z − z_k) + g φ(z) widened in the span of a basis."""

    centres: Float[np.ndarray, "k d"]
    log_weights: Float[np.ndarray, " k"]
    basis: Float[np.ndarray, "r d"]
    wide: float  # standard deviation of the guard along the basis

    @staticmethod
    def of(points: DesignPoints) -> Mixture:
        """The mixture of design points, each weighted by the probability beyond its plane."""
        near = points.within(NEAR)
        logs = log_ndtr(-near.betas)
        _, sizes, rows = np.linalg.svd(near.directions, full_matrices=False)
        share = np.cumsum(sizes**2) / np.sum(sizes**2)
        rank = int(np.searchsorted(share, _SPANNED)) + 1
        return Mixture(near.z, logs - logsumexp(logs), rows[:rank], max(1.5, near.betas[0] / 2))

    def draw(self, points: Points, start: int, stop: int) -> Float[np.ndarray, "n d"]:
        """Samples start to stop − 1, each by its number alone, from points of d + 1 numbers."""
        normal = points(start, stop)
        y, chance = normal[:, :-1], ndtr(normal[:, -1])
        ends = np.cumsum((1 - _GUARD) * np.exp(self.log_weights))
        part = np.searchsorted(ends, chance)
        guard = part == len(ends)
        centred = y + self.centres[np.minimum(part, len(ends) - 1)]
        widened = y + (self.wide - 1) * (y @ self.basis.T) @ self.basis
        return np.where(guard[:, None], widened, centred)

    def log_ratios(self, z: Float[np.ndarray, "n d"]) -> tuple[np.ndarray, np.ndarray]:
        """Logarithms of q/φ and of the guard's density over that around the design points."""
        constants = self.log_weights - 0.5 * np.sum(self.centres**2, axis=1)
        around = logsumexp(z @ self.centres.T + constants, axis=1)
        along = np.sum((z @ self.basis.T) ** 2, axis=1)
        guard = 0.5 * along * (1 - self.wide**-2) - len(self.basis) * np.log(self.wide)
        whole = np.logaddexp(np.log1p(-_GUARD) + around, np.log(_GUARD) + guard)
        return whole, guard - around

    def thin(self, z: Float[np.ndarray, "n d"]) -> np.ndarray:
        """Where the density around the design points is thin, shape (n,)."""
        return self.log_ratios(z)[1] > -np.log(_THIN)


class Samples(NamedTuple):
    """Samples of a limit state, with weights φ/q."""

    points: Float[np.ndarray, "n d"]
    weights: Float[np.ndarray, " n"]
    values: Float[np.ndarray, " n"]
    times: Float[np.ndarray, " n"]

    def __len__(self) -> int:
        return len(self.points)

    @property
    def parts(self) -> np.ndarray:
        """Each sample's part of n times the estimate."""
        return np.where(self.values >= 0, self.weights, 0.0)

    @property
    def probability(self) -> float:
        """The estimate."""
        return float(self.parts.mean())

    @property
    def cov(self) -> float:
        """Its coefficient of variation; infinite where no sample reaches the limit state."""
        parts, mean = self.parts, self.parts.mean()
        error = parts.std(ddof=1) / math.sqrt(len(parts))
        return float(error / mean) if mean > 0 else math.inf

    def joined(self, other: Samples) -> Samples:
        """Both samples together."""
        return Samples(*(np.concatenate(pair) for pair in zip(self, other, strict=True)))
