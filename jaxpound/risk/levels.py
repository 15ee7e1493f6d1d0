"""Levels of subset simulation: samples of ever rarer events on the way to one.

The event value(z) ≥ 0 is reached through levels value(z) ≥ v, each of which holds a share p0 of the
samples of the one before (Au and Beck 2001). Chains go on from that share: adaptive conditional
sampling (Papaioannou, Betz, Zwirglmaier and Straub 2015) moves every number of z by a normal step
that leaves the normal distribution as it is, and keeps what stays in the level.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from typing import NamedTuple

import numpy as np

ACCEPTANCE = 0.44
"""Share of moves kept to which the steps' scale is adapted."""

FLOOR = 1e-12
"""Probability below which no further level is begun."""

_FIRST_SCALE = 0.6


class Level(NamedTuple):
    """Samples of z, given that value(z) is at least a threshold; of one repeat."""

    threshold: float
    """−∞ for the first level, whose samples are independent."""
    probability: float
    """Estimated probability that the value is at least the threshold."""
    points: np.ndarray
    """Shape (n, d)."""
    values: np.ndarray
    """Shape (n,)."""
    acceptance: float = math.nan
    """Share of the chains' moves that stayed in the level; NaN for the first."""
    scale: float = _FIRST_SCALE
    """Size of the chains' steps at the end, by the spread of the seeds: 1 moves them freely."""

    @property
    def estimate(self) -> float:
        """Probability of value ≥ 0 by this level's samples."""
        return self.probability * float(np.mean(self.values >= 0))


class Request(NamedTuple):
    """Points whose values are wanted next, on the way from a level of this probability."""

    points: np.ndarray
    probability: float


Descent = Generator[Request, np.ndarray, list[Level]]
"""One repeat: asks for values, is sent them, and returns its levels."""


def descent(dimension: int, n: int, p0: float, rng: np.random.Generator) -> Descent:
    """One subset simulation of n samples a level, which asks for the values that it needs."""
    z = rng.standard_normal((n, dimension))
    found = [Level(-math.inf, 1.0, z, (yield Request(z, 1.0)))]
    while True:
        last = found[-1]
        threshold = _next_threshold(last.values, p0)
        probability = last.probability * float(np.mean(last.values >= threshold))
        if threshold >= 0 or probability < FLOOR:
            return found
        found.append((yield from _conditional(last, threshold, probability, rng)))


def _next_threshold(values: np.ndarray, p0: float) -> float:
    """What a share p0 exceeds, or more where values are equal; ∞ where all are."""
    above = values[values > values.min()]
    if not above.size:
        return math.inf
    seeds = round(p0 * len(values))
    between = np.sort(values)[-seeds - 1 : len(values) - seeds + 1].mean()
    return float(max(between, above.min()))


def _conditional(
    before: Level, threshold: float, probability: float, rng: np.random.Generator
) -> Generator[Request, np.ndarray, Level]:
    """Samples of the next level by chains from those of the level before that lie in it."""
    n, seeds = len(before.values), rng.permutation(np.flatnonzero(before.values >= threshold))
    z, values = before.points[seeds], before.values[seeds]
    spread, scale = z.std(axis=0), before.scale
    points, kept, accepted, done = [z.copy()], [values.copy()], 0, len(seeds)
    step = 0
    while done < n:
        step += 1
        live = min(len(seeds), n - done)
        sigma = np.minimum(1.0, scale * spread)
        moved = np.sqrt(1 - sigma**2) * z[:live] + sigma * rng.standard_normal((live, z.shape[1]))
        value = yield Request(moved, probability)
        stays = value >= threshold
        z[:live] = np.where(stays[:, None], moved, z[:live])
        values[:live] = np.where(stays, value, values[:live])
        points.append(z[:live].copy())
        kept.append(values[:live].copy())
        accepted, done = accepted + int(stays.sum()), done + live
        scale *= math.exp((float(stays.mean()) - ACCEPTANCE) / math.sqrt(step))
    acceptance = accepted / (n - len(seeds))
    every = np.concatenate(points), np.concatenate(kept)
    return Level(threshold, probability, *every, acceptance, scale)


def side_by_side(
    values: Callable[[np.ndarray], np.ndarray],
    descents: Sequence[Descent],
    told: Callable[[int, list[float]], None] = lambda runs, reached: None,
) -> list[list[Level]]:
    """The levels of several repeats, whose requests are run together in one batch after another.

    ``told`` is called after each batch with its size and the probability that each repeat has
    reached.
    """
    levels: list[list[Level]] = [[] for _ in descents]
    reached = [1.0] * len(descents)
    asked = {i: next(repeat) for i, repeat in enumerate(descents)}
    while asked:
        batch = np.concatenate([request.points for request in asked.values()])
        found = values(batch)
        told(len(batch), reached)
        ends = np.cumsum([len(request.points) for request in asked.values()])
        parts = zip([*asked], np.split(found, ends[:-1]), strict=True)
        asked = {}
        for i, part in parts:
            try:
                asked[i] = descents[i].send(part)
                reached[i] = asked[i].probability
            except StopIteration as end:
                levels[i] = end.value
                reached[i] = levels[i][-1].estimate
    return levels
