"""Derivatives of a small probability by parameters of the structures, from samples near the limit.

P(θ) = E[w 1{V ≥ 0}], so dP/dθ = E[w δ(V) ∂V/∂θ] with the limit state's value V. The delta function
is a normal density of width h. Since a tail falls as e^(−λ v), a width makes the slope too steep by
e^((λ h)²/2): h is chosen by the tail's own λ, and the slope divided by that factor.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxpound.risk.limit_state import LimitState

_WIDTH = 0.3  # λ h
_REACH = 4.0  # widths from the limit beyond which a sample has no weight
_FEWEST = 20


class Slope(NamedTuple):
    """Derivative of ln P by a parameter, with its standard error."""

    value: float
    error: float

    def __str__(self) -> str:
        return f"{self.value:.4g} ± {self.error:.2g}"


class Tail(NamedTuple):
    """How a probability falls with the threshold, from weighted samples."""

    decay: float
    """λ = −d ln P/db."""
    error: float
    """Its standard error."""
    density: Float[np.ndarray, " n"]
    """Each sample's weight at the limit: w times the normal density of its value, corrected."""


def tail_of(weights: np.ndarray, values: np.ndarray, repeats: np.ndarray) -> Tail:
    """The tail at the limit of samples of a rare event.

    Parameters
    ----------
    weights, values, repeats
        See ``RareEvent``.

    Raises
    ------
    ValueError
        If fewer than 20 samples are near the limit state.
    """
    hit = np.where(values >= 0, weights, 0.0)
    excess = hit @ np.where(values >= 0, values, 0.0)
    if not (np.count_nonzero(hit) >= _FEWEST and excess > 0):
        rule = f"have at least {_FEWEST} samples that reach the limit state"
        raise ValueError(f"RareEvent.slope: the event must {rule}")
    decay = hit.sum() / excess  # of an exponential tail
    width = _WIDTH / decay
    share = np.exp(-0.5 * (values / width) ** 2) / (width * math.sqrt(2 * math.pi))
    near = np.abs(values) < _REACH * width
    density = np.where(near, weights * share, 0.0) * math.exp(-0.5 * _WIDTH**2)
    value, error = _ratio(density, hit, repeats)
    return Tail(value, error, density)


def slopes_of(
    state: LimitState,
    points: np.ndarray,
    weights: np.ndarray,
    values: np.ndarray,
    repeats: np.ndarray,
) -> dict[str, Slope]:
    """Derivatives of ln P by all parameters of the structures, from one reverse pass a sample.

    Only samples near the limit state are run again.
    """
    tail = tail_of(weights, values, repeats)
    near = np.flatnonzero(tail.density)
    hit = np.where(values >= 0, weights, 0.0)
    found = state.sensitivities(points[near])
    slopes = {}
    for path, slope in found.items():
        parts = np.zeros(len(values))
        parts[near] = tail.density[near] * slope
        slopes[path] = Slope(*_ratio(parts, hit, repeats))
    return slopes


def _ratio(above: np.ndarray, below: np.ndarray, repeats: np.ndarray) -> tuple[float, float]:
    """The ratio of two sums over the same samples, and its standard error.

    Where samples belong to repeats, only the sums over a repeat are independent.
    """
    if repeats.size:
        above, below = np.bincount(repeats, above), np.bincount(repeats, below)
    ratio = above.sum() / below.sum()
    error = np.std(above - ratio * below, ddof=1) / np.sqrt(len(below)) / below.mean()
    return float(ratio), float(error)
