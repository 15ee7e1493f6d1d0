"""Levels of subset simulation: samples of ever rarer events on the way to the rare event.

The event value(z) ≥ 0 is reached through levels value(z) > v, each of which holds a share p0 of the
samples of the level before (Au and Beck 2001). Chains start from that share: adaptive conditional
sampling (Papaioannou, Betz, Zwirglmaier and Straub 2015) moves every number of z by a normal step
that preserves the normal distribution, and accepts moves that stay in the level.

Each v is the value of a sample, and the samples strictly above it are the seeds of the next level:
the product of the shares is then unbiased, also with equal values (Bréhier, Gazeau, Goudenège,
Lelièvre and Rousset 2016). With a v between two samples and n = 400 it is 5 % too high at 2e-4.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from jaxpound.reliability.limit_state import LimitState
from jaxpound.reliability.result import RAREST
from jaxpound.reliability.search_runs import SearchRuns

_ACCEPTANCE = 0.44  # share of accepted moves to which the steps' scale is adapted
_FIRST_SCALE = 0.6


class Level(NamedTuple):
    """Samples of z in one repeat, given that value(z) is above a threshold."""

    threshold: float  # −∞ for the first level, whose samples are independent
    probability: float  # estimated probability that the value is above the threshold
    points: np.ndarray  # shape (n, d)
    values: np.ndarray  # shape (n,)
    acceptance: float = math.nan  # share of accepted moves of chains; NaN for the first level
    scale: float = _FIRST_SCALE  # final size of the chains' steps: with 1, points are independent

    @property
    def estimate(self) -> float:
        """Probability of value ≥ 0 by this level's samples."""
        return self.probability * float(np.mean(self.values >= 0))


class Query(NamedTuple):
    """Points whose values the next level needs, and the probability of the level before."""

    points: np.ndarray
    probability: float


Levels = Generator[Query, np.ndarray, list[Level]]
"""One repeat: yields queries, is sent the values of their points, and returns its levels."""


def levels_of_samples(dimension: int, n: int, p0: float, rng: np.random.Generator) -> Levels:
    """One repeat of subset simulation with n samples a level; it yields its queries for values."""
    z = rng.standard_normal((n, dimension))
    levels = [Level(-math.inf, 1.0, z, (yield Query(z, 1.0)))]
    while True:
        last = levels[-1]
        threshold = float(np.sort(last.values)[-round(p0 * n) - 1])
        probability = last.probability * float(np.mean(last.values > threshold))
        if threshold >= 0 or probability < RAREST:
            return levels
        levels.append((yield from _conditional(last, threshold, probability, rng)))


def _conditional(
    before: Level, threshold: float, probability: float, rng: np.random.Generator
) -> Generator[Query, np.ndarray, Level]:
    """Samples of the next level, by chains from the samples of the level before that lie in it."""
    n, seeds = len(before.values), rng.permutation(np.flatnonzero(before.values > threshold))
    z, values, scale = before.points[seeds], before.values[seeds], before.scale
    chains, chain_values, accepted, done, step = [z.copy()], [values.copy()], 0, len(seeds), 0
    while done < n:
        step += 1
        m = min(len(seeds), n - done)
        # The same step size for all numbers. Steps by the spread of the seeds, which descend from
        # few samples after some levels, are too short (40 % too low at 8e-7, with 500 numbers).
        moved = math.sqrt(1 - scale**2) * z[:m] + scale * rng.standard_normal(z[:m].shape)
        value = yield Query(moved, probability)
        stays = value > threshold
        z[:m] = np.where(stays[:, None], moved, z[:m])
        values[:m] = np.where(stays, value, values[:m])
        chains.append(z[:m].copy())
        chain_values.append(values[:m].copy())
        accepted, done = accepted + int(stays.sum()), done + m
        change = math.exp((float(stays.mean()) - _ACCEPTANCE) / math.sqrt(step))
        scale = min(1.0, scale * change)
    acceptance = accepted / (n - len(seeds))
    samples = np.concatenate(chains), np.concatenate(chain_values)
    return Level(threshold, probability, *samples, acceptance, scale)


QueryId = tuple[int, int]  # number of a repeat, and that of one of its queries


def run_in_lockstep(
    values: Callable[[Mapping[QueryId, np.ndarray]], Mapping[QueryId, np.ndarray]],
    repeats: Mapping[int, Levels],
    report: Callable[[list[float]], None] = lambda reached: None,
) -> list[list[Level]]:
    """The levels of several repeats; queries of all are run together, then reported on."""
    levels: dict[int, list[Level]] = {}
    reached = dict.fromkeys(repeats, 1.0)
    queries = {(repeat, 0): next(steps) for repeat, steps in repeats.items()}
    while queries:
        answers = values({name: query.points for name, query in queries.items()})
        report([*reached.values()])
        before, queries = queries, {}
        for repeat, number in before:
            try:
                query = repeats[repeat].send(answers[repeat, number])
                queries[repeat, number + 1] = query
                reached[repeat] = query.probability
            except StopIteration as end:
                levels[repeat] = end.value
                reached[repeat] = end.value[-1].estimate
    return [levels[repeat] for repeat in repeats]


class SubsetRuns:
    """Values of a limit state for ``run_in_lockstep``, counted."""

    def __init__(self, state: LimitState, bar: Any, runs: SearchRuns, part: int) -> None:
        self.count = 0  # runs, including those from the folder
        self.failed = 0  # runs without a result
        self._state, self._bar, self._runs, self._part = state, bar, runs, part

    def __call__(self, queries: Mapping[QueryId, np.ndarray]) -> dict[QueryId, np.ndarray]:
        """Values of points by query; −∞ of runs that fail."""
        answers = {}
        for part in self._parts(queries):
            results = self._runs.results(part, lambda z: [self._state.values(z)])
            for name, (values,) in results.items():
                answers[name] = np.where(np.isnan(values), -np.inf, values).astype(float)
                self.failed += int(np.isnan(values).sum())
            size = sum(map(len, part.values()))
            self.count += size
            self._bar.update(size)
        return answers

    def _parts(self, queries: Mapping[QueryId, np.ndarray]) -> Iterator[dict[QueryId, np.ndarray]]:
        """Queries that are run and written together: the same ones, and rounding, after a stop."""
        part: dict[QueryId, np.ndarray] = {}
        for name, points in queries.items():
            if part and sum(map(len, part.values())) + len(points) > self._part:
                yield part
                part = {}
            part[name] = points
        yield part
