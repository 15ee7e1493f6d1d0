"""Subset simulation: a rare event reached through a chain of likelier ones, without derivatives.

Chains in a level, value(z) > v, start from the samples of the level before that lie in it: adaptive
conditional sampling (Papaioannou, Betz, Zwirglmaier and Straub 2015) moves every number of z by a
normal step that preserves the normal distribution, and accepts moves that stay in the level. Each v
is the value of a sample, and the samples strictly above it are the seeds: the product of the shares
is then unbiased, also with equal values (Bréhier, Gazeau, Goudenège, Lelièvre and Rousset 2016).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from os import PathLike
from typing import Any, NamedTuple

import jax
import numpy as np
from tqdm.auto import tqdm

from jaxpound._checks import Rule, enforce, instance, positive, require_memory
from jaxpound._errors import resumable
from jaxpound._fields import Checked, parameter
from jaxpound.grid import TimeGrid
from jaxpound.reliability import limit_state
from jaxpound.reliability.design_points import DesignPoints
from jaxpound.reliability.limit_state import BatchId, LimitState, require_dependence
from jaxpound.reliability.result import NO_ESTIMATE, RAREST, RareEvent, Samples, always, cov_of_mean
from jaxpound.results.named import REQUIRED_GAP, DemandSpec
from jaxpound.scenarios.sampling import key_numbers
from jaxpound.scenarios.scenarios import ScenarioSet

_PART = 2048  # runs after which a file is written, but for queries of more
_COLUMNS = ("repeat", "request", "value")
_ACCEPTANCE = 0.44  # share of accepted moves to which the steps' scale is adapted
_FIRST_SCALE = 0.6
_FEWEST_SEEDS = 10
_MARGIN = 1.1  # repeats that are added over those that would just reach the target c.o.v.
_LOW_ACCEPTANCE, _SMALL_SCALE = 0.2, 0.05
_LARGE_COV, _LARGE_SHARE = 0.5, 0.3
_SURE = 0.05  # probability that a bound from samples is wrong


@dataclasses.dataclass(frozen=True)
class SubsetSearch(Checked):
    """The samples of a subset simulation.

    Parameters
    ----------
    n
        Samples of a level in one repeat. More find rarer ways to fail.
    p0
        Share of a level's samples that lie in the next; at least 10 samples, at most half of n.
    repeats
        Number of independent repeats, at least 2; all run in the same batches. Repeat r depends on
        the key and r alone.
    max_runs
        Number of runs beyond which no repeats are added.
    """

    n: int = parameter(whole=True, default=1000)
    p0: float = parameter(above=0, most=0.5, single=True, default=0.1)
    repeats: int = parameter(whole=True, least=2, why="for the spread of the estimate", default=20)
    max_runs: int = parameter(whole=True, default=1_000_000)

    def __post_init__(self) -> None:
        super().__post_init__()
        few = f"at least {_FEWEST_SEEDS} for chains to start from"
        few += f", {_FEWEST_SEEDS / self.p0:.0f} samples"
        enforce([Rule("p0 n", self.seeds, self.seeds >= _FEWEST_SEEDS, few)])

    @property
    def seeds(self) -> int:
        """Samples of a level that lie in the next."""
        return round(self.p0 * self.n)


@resumable("store")
def subset_simulation(
    scenarios: ScenarioSet | LimitState,
    grid: TimeGrid | None = None,
    gap: float | None = None,
    *,
    demand: DemandSpec = REQUIRED_GAP,
    threshold: float | None = None,
    cov: float | None = None,
    search: SubsetSearch = SubsetSearch(),
    key: int | jax.Array = 0,
    store: str | PathLike[str] | None = None,
    progress: bool = True,
) -> RareEvent:
    """Probability of a rare event by subset simulation with adaptive conditional sampling.

    The event is approached through levels of the demand, each exceeded by a share p0 of the runs of
    the level before (Au and Beck 2001, Probabilistic Engineering Mechanics 16:263); chains of runs
    explore each level (Papaioannou et al. 2015, the same journal, 41:89). The method needs no
    derivatives, and takes discrete numbers and many ways to fail; without these ``rare_event``
    needs far fewer runs. A level takes (1 − p0) n runs a repeat: 3,700 in all for a probability of
    1e-4, 5,500 for 1e-6, by default in each of 20 repeats.

    The coefficient of variation is that of the mean of independent repeats. Raises ``ValueError``
    as ``rare_event``; if memory has no room for ``max_runs`` points.

    The event's points are those of all levels, each level without those in the next. Their weights
    make them a sample of the whole distribution: mean(weights · (values ≥ −x)) estimates the
    probability of a threshold lower by x. Failed runs count as safe; a warning states their number.
    A probability below 1e-12 is out of reach; it is then a bound, with a c.o.v. of NaN.

    Parameters
    ----------
    scenarios, grid, gap, demand, threshold, key
        See ``rare_event``. Scenarios may be any object with ``dimension`` and ``realize``.
    cov
        The target coefficient of variation: repeats are added until it is reached. None: no more
        than those of ``search``.
    search
        The samples of a level, and the repeats.
    store, progress
        See ``rare_event``. The same call may also continue to more repeats. An interruption loses
        at most some 2,000 runs (or n, if that is more).

    Examples
    --------
    >>> ground = jp.RandomRicker(2, jp.LogNormal(0.1, 0.5), jp.Uniform(1, 3.8), jp.Uniform(1, 7))
    >>> scenarios = jp.Scenarios(jp.paper.structures(), ground)
    >>> grid = jp.TimeGrid.until(10.0, dt=0.05)
    >>> few = jp.reliability.SubsetSearch(n=200, repeats=4)
    >>> event = jp.subset_simulation(scenarios, grid, 0.6, search=few, progress=False)
    >>> 1e-3 < event.probability < 3e-2
    True
    """
    state = limit_state.state_of(scenarios, grid, gap, demand, threshold)
    instance("search", search, SubsetSearch)
    return simulated(state, cov, search, key, store, progress)


def simulated(
    state: LimitState,
    cov: float | None,
    options: SubsetSearch,
    key: int | jax.Array,
    store: str | PathLike[str] | None,
    progress: bool,
) -> RareEvent:
    """``subset_simulation`` of a limit state."""
    if cov is not None:
        positive(cov=cov)
    n, p0, max_runs = options.n, options.p0, options.max_runs
    most = max(max_runs, n * options.repeats)
    require_memory("max_runs", most, most * (state.dimension + 2) * 8)
    _, numbers = key_numbers(key)
    described = {"n": n, "p0": float(p0), "numpy": np.__version__}  # NumPy draws
    search, part = "a subset simulation", max(n, _PART)
    levels: list[list[Level]] = []  # of each repeat
    with tqdm(unit=" runs", unit_scale=True, disable=not progress) as bar:
        bar.set_postfix_str(limit_state.COMPILING)
        stored = limit_state.SearchRuns(store, search, state, key, _COLUMNS, part, **described)
        runs = limit_state.SubsetRuns(state, bar, stored, part)

        def report(reached: list[float]) -> None:
            bar.set_postfix_str(_so_far(levels) if levels else f"P < {np.mean(reached):.2g}")

        more = options.repeats
        while more > 0:
            steps = {}
            for r in range(len(levels), len(levels) + more):
                random = np.random.default_rng([*numbers, r])
                steps[r] = levels_of_samples(state.dimension, n, p0, random)
            levels = levels + run_in_lockstep(runs, steps, report)
            if all(len(x) == 1 for x in levels):
                require_dependence(state, levels[0][0].points, levels[0][0].values)
            bar.set_postfix_str(_so_far(levels))
            (estimates, spread), room = _estimate(levels), max_runs - runs.count
            more = 0
            if cov is not None and spread > cov:  # as many as it seems to need, at most doubling
                needed = math.ceil(len(levels) * (_MARGIN * (spread / cov) ** 2 - 1))
                more = min(len(levels), needed, room * len(levels) // runs.count)
    least, most = min(map(len, levels)), max(map(len, levels))
    depths = f"{most} level{'s' * (most > 1)}" if least == most else f"{least} to {most} levels"
    method = f"subset simulation by adaptive conditional sampling, {len(levels)} repeats of"
    method += f" {n:,} samples a level, p0 = {p0:.3g}, {depths}; c.o.v. by repeats"
    bound, warnings = _bound(levels, options.seeds)
    if runs.failed:
        warnings.append(f"{runs.failed:,} of {runs.count:,} runs failed and count as safe")
    parts = []  # every level's samples that are not in the next
    for r, of_repeat in enumerate(levels):
        ends = [*(level.threshold for level in of_repeat[1:]), math.inf]
        for level, end in zip(of_repeat, ends, strict=True):
            inside = level.values <= end
            share = level.probability / len(level.values) / len(levels)
            shares_and_repeats = (np.full(inside.sum(), x) for x in (share, r))
            parts.append((level.points[inside], level.values[inside], *shares_and_repeats))
    points, values, shares, repeat_of = map(np.concatenate, zip(*parts, strict=True))
    samples = Samples(points, shares * len(shares), values, repeats=repeat_of)
    warnings += _warnings(levels, cov, max_runs)
    estimate = (float(estimates.mean()), spread) if bound is None else (bound, math.nan)
    none = DesignPoints.none(state.dimension)
    about: Any = {"runs": runs.count, "gradients": 0, "method": method}
    return RareEvent(state, samples, *estimate, none, **about, warnings=tuple(warnings))


def _estimate(by_repeat: Sequence[list[Level]]) -> tuple[np.ndarray, float]:
    """The estimate of each repeat, and the c.o.v. of their mean; NaN if all are 0."""
    p = np.array([levels[-1].estimate for levels in by_repeat])
    return p, cov_of_mean(p) if p.any() else math.nan


def _so_far(by_repeat: Sequence[list[Level]]) -> str:
    p, spread = _estimate(by_repeat)
    return f"P = {p.mean():.3g}, c.o.v. {spread:.2g}" if p.any() else "P out of reach"


def _bound(by_repeat: Sequence[list[Level]], seeds: int) -> tuple[float | None, list[str]]:
    """A bound on a probability that no or every sample reaches, and what it means in words."""
    n = sum(len(levels[0].values) for levels in by_repeat)
    if all((levels[0].values >= 0).all() for levels in by_repeat):
        return None, [always(n)]
    if _estimate(by_repeat)[0].mean() >= RAREST:
        return None, []
    last = [levels[-1] for levels in by_repeat]
    nearest = max(float(level.values.max()) for level in last)
    bound, why = RAREST, "rarer levels are not sought"
    if any((level.values == level.values.max()).sum() > seeds for level in last):
        n = sum(len(level.values) for level in last)
        bound = -math.log(_SURE) * float(np.mean([level.probability for level in last])) / n
        why = "no rarer level lies beyond one in which the largest demands are all the same"
    short = f"; the demand stays {-nearest:.4g} below the threshold" if nearest < 0 else ""
    below = f"the probability is below {bound:.2g}, since {why}{short}"
    return bound, [f"out of reach: {below}; {NO_ESTIMATE}"]


def _warnings(by_repeat: Sequence[list[Level]], cov: float | None, max_runs: int) -> Iterator[str]:
    """Why not to trust the estimate, in sentences."""
    p, spread = _estimate(by_repeat)
    if p.mean() < RAREST:
        return
    advice = "take more samples a level (n)"
    none, share = int((p == 0).sum()), float(p.max() / p.sum())
    if none:
        yield f"{none} of {len(p)} repeats never reach the event: {advice}"
    elif share > max(_LARGE_SHARE, 2 / len(p)):
        part = f"one of {len(p)} repeats makes {share:.0%} of the estimate"
        yield f"{part}, which has found what the others miss: {advice}"
    if spread > _LARGE_COV:
        precision = f"a coefficient of variation of {spread:.2g} tells the order of magnitude"
        yield f"{precision} at best: take more repeats, or more samples a level (n)"
    if cov is not None and spread > cov:
        above = f"the coefficient of variation is {spread:.2g}, above {cov:.2g}"
        yield f"{above}: raise max_runs = {max_runs:,}"
    for number in range(1, max(map(len, by_repeat))):
        same = [levels[number] for levels in by_repeat if len(levels) > number]
        acceptance = np.mean([level.acceptance for level in same])
        scale = np.mean([level.scale for level in same])
        if acceptance < _LOW_ACCEPTANCE:
            stay = f"only {acceptance:.0%} of the chains' moves stay in the level"
            few = "whose samples are few points many times over"
            yield f"at level {number + 1} {stay}, {few}: {advice}"
        elif scale < _SMALL_SCALE:
            move = f"the chains move by {scale:.2g} standard deviations a step"
            yield f"at level {number + 1} {move}, and stay near their starts: {advice}"


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


Query = tuple[np.ndarray, float]  # points, and the probability of the level before
Levels = Generator[Query, np.ndarray, list[Level]]
"""One repeat: yields queries, is sent the values of their points, and returns its levels."""


def levels_of_samples(dimension: int, n: int, p0: float, rng: np.random.Generator) -> Levels:
    """One repeat of subset simulation with n samples a level; it yields its queries for values."""
    z = rng.standard_normal((n, dimension))
    levels = [Level(-math.inf, 1.0, z, (yield (z, 1.0)))]
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
        value = yield moved, probability
        stays = value > threshold
        z[:m] = np.where(stays[:, None], moved, z[:m])
        values[:m] = np.where(stays, value, values[:m])
        chains.append(z[:m].copy())
        chain_values.append(values[:m].copy())
        accepted, done = accepted + int(stays.sum()), done + m
        scale = min(1.0, scale * math.exp((float(stays.mean()) - _ACCEPTANCE) / math.sqrt(step)))
    samples = np.concatenate(chains), np.concatenate(chain_values)
    return Level(threshold, probability, *samples, accepted / (n - len(seeds)), scale)


def run_in_lockstep(
    values: Callable[[Mapping[BatchId, np.ndarray]], Mapping[BatchId, np.ndarray]],
    repeats: Mapping[int, Levels],
    report: Callable[[list[float]], None] = lambda reached: None,
) -> list[list[Level]]:
    """The levels of several repeats; queries of all are run together, then reported on."""
    levels: dict[int, list[Level]] = {}
    reached = dict.fromkeys(repeats, 1.0)
    queries = {(repeat, 0): next(steps) for repeat, steps in repeats.items()}
    while queries:
        answers = values({name: points for name, (points, _) in queries.items()})
        report([*reached.values()])
        before, queries = queries, {}
        for repeat, number in before:
            try:
                query = queries[repeat, number + 1] = repeats[repeat].send(answers[repeat, number])
                reached[repeat] = query[1]
            except StopIteration as end:
                levels[repeat] = end.value
                reached[repeat] = end.value[-1].estimate
    return [levels[repeat] for repeat in repeats]
