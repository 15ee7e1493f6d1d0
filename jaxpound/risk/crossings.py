"""Where the demand of each record first reaches a threshold, within a bracket of intensities."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float

from jaxpound.risk.suite_runs import SuiteRuns

_MOST_ROUNDS = 60


@dataclasses.dataclass
class Brackets:
    """For each record the intensities between which it crosses, and the demands less the threshold.

    A record whose demand never reaches the threshold has no bracket: ``high`` is infinite.
    """

    low: Float[np.ndarray, " n"]
    high: Float[np.ndarray, " n"]
    below: Float[np.ndarray, " n"]
    above: Float[np.ndarray, " n"]

    @classmethod
    def of(cls, levels: Any, excess: Float[np.ndarray, "n k"]) -> Brackets:
        """Around the first level at which the demand reaches the threshold; the first is below."""
        reached = excess >= 0
        rows, first = np.arange(len(excess)), np.maximum(reached.argmax(axis=1), 1)
        crosses = reached.any(axis=1)
        high = np.where(crosses, levels[first], np.inf)
        return cls(levels[first - 1], high, excess[rows, first - 1], excess[rows, first])

    @property
    def crossing(self) -> np.ndarray:
        """Numbers of the records that have a bracket."""
        return np.flatnonzero(np.isfinite(self.high))

    def chord(self) -> Float[np.ndarray, " n"]:
        """Where the straight line between both ends of a bracket crosses; infinite without one."""
        found = np.full(len(self.low), np.inf)
        i = self.crossing
        share = -self.below[i] / (self.above[i] - self.below[i])
        found[i] = self.low[i] + share * (self.high[i] - self.low[i])
        return found

    def width(self) -> Float[np.ndarray, " n"]:
        """Width of each bracket over its upper end; 0 where there is none."""
        found = np.zeros(len(self.low))
        i = self.crossing
        found[i] = 1 - self.low[i] / self.high[i]
        return found

    def narrow(self, i: Any, at: Any, excess: Any) -> None:
        """Put one point into each bracket i."""
        beyond = excess >= 0
        for end, value, where in (
            (self.high, self.above, beyond),
            (self.low, self.below, ~beyond),
        ):
            end[i[where]], value[i[where]] = at[where], excess[where]


def by_sections(
    runs: SuiteRuns, brackets: Brackets, tolerance: float, batch: int
) -> Float[np.ndarray, " n"]:
    """Bisection with many points instead of one: ``batch`` runs a round, as many as fill a batch.

    Each round keeps the section in which the demand first reaches the threshold. The answer is
    where the chord of the last one crosses.
    """
    while (wide := np.flatnonzero(brackets.width() > tolerance)).size:
        n = max(1, batch // wide.size)
        shares = np.arange(n + 2) / (n + 1)
        low, high = brackets.low[wide, None], brackets.high[wide, None]
        at = low + shares * (high - low)
        inner = runs.demands(np.repeat(wide, n), at[:, 1:-1].ravel()).reshape(-1, n)
        ends = brackets.below[wide, None], brackets.above[wide, None]
        excess = np.concatenate([ends[0], inner - runs.threshold, ends[1]], axis=1)
        rows, first = np.arange(wide.size), (excess[:, 1:] >= 0).argmax(axis=1) + 1
        brackets.low[wide], brackets.high[wide] = at[rows, first - 1], at[rows, first]
        brackets.below[wide], brackets.above[wide] = excess[rows, first - 1], excess[rows, first]
    return brackets.chord()


def by_newton(
    runs: SuiteRuns, brackets: Brackets, tolerance: float, batch: int
) -> Float[np.ndarray, " n"]:
    """Newton's method with the derivative by the intensity, kept within the bracket.

    A step that would leave the bracket, as it may where the demand has a kink, halves it.
    """
    found = brackets.chord()
    open_ = brackets.crossing
    for _ in range(_MOST_ROUNDS):
        if not open_.size:
            break
        demands, slopes = runs.slopes(open_, found[open_])
        excess = demands - runs.threshold
        brackets.narrow(open_, found[open_], excess)
        step = -excess / np.where(slopes == 0, np.nan, slopes)
        after = found[open_] + step
        low, high = brackets.low[open_], brackets.high[open_]
        inside = (after >= low) & (after <= high)
        after = np.where(inside, after, (low + high) / 2)
        done = (np.abs(after - found[open_]) <= tolerance * after) & inside
        done |= high - low <= tolerance * high
        found[open_] = after
        open_ = open_[~done]
    return found


REFINEMENTS: dict[str, Callable[[SuiteRuns, Brackets, float, int], Any]] = {
    "bisection": by_sections,
    "newton": by_newton,
}
