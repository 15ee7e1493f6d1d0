"""Subset simulation: a rare event reached through a chain of likelier ones, without derivatives."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from os import PathLike
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Array
from tqdm.auto import tqdm

from jaxpound._checks import (
    Rule,
    count,
    enforce,
    positive,
    require_memory,
    require_share,
)
from jaxpound.grid import TimeGrid
from jaxpound.results.demand import Demand
from jaxpound.risk.demanded import REQUIRED_GAP
from jaxpound.risk.levels import Level, descent, side_by_side
from jaxpound.risk.limit_state import LimitState, require_dependence, threshold_of
from jaxpound.risk.rare_event import RAREST, RareEvent, always
from jaxpound.risk.sampling import COMPILING
from jaxpound.risk.subset_runs import SubsetRuns
from jaxpound.simulation.scheme import Scheme
from jaxpound.study.sampling import key_numbers
from jaxpound.study.scenarios import ScenarioSet

OWNER = "subset_simulation"

_N = 1000
_P0 = 0.1
_REPEATS = 20
_MAX_RUNS = 1_000_000

_FEWEST_SEEDS = 10
_MARGIN = 1.1  # repeats asked for over those that would just reach the wanted c.o.v.
_LOW_ACCEPTANCE = 0.2
_SMALL_SCALE = 0.05
_LARGE_COV = 0.5
_LARGE_SHARE = 0.3
_SURE = 0.05  # probability that a bound from samples is wrong


def subset_simulation(
    scenarios: ScenarioSet,
    grid: TimeGrid,
    gap: float | None = None,
    *,
    demand: str | Callable[[Demand], Array] = REQUIRED_GAP,
    threshold: float | None = None,
    scheme: Scheme = Scheme(),
    n: int = _N,
    p0: float = _P0,
    repeats: int = _REPEATS,
    cov: float | None = None,
    max_runs: int = _MAX_RUNS,
    key: int | jax.Array = 0,
    store: str | PathLike[str] | None = None,
    progress: bool = True,
) -> RareEvent:
    """Probability of a rare event by subset simulation with adaptive conditional sampling.

    The event is approached through levels of the demand, each exceeded by a share p0 of the runs of
    the one before (Au and Beck 2001, Probabilistic Engineering Mechanics 16:263); chains of runs
    explore each level (Papaioannou et al. 2015, the same journal, 41:89). It needs no derivatives
    and is indifferent to discrete numbers and to many ways to fail: where these are absent,
    ``rare_event`` needs far fewer runs. A level takes (1 − p0) n runs a repeat: 3,700 in all for a
    probability of 1e-4, 5,500 for 1e-6, by default in each of 20 repeats.

    The coefficient of variation is that of the mean of independent repeats. (Formulas for a single
    simulation leave out that its levels, and its chains, are correlated.)

    Parameters
    ----------
    scenarios
        What is random: ``Scenarios``, or any object with ``dimension`` and ``realize``.
    grid, scheme
        See ``simulate``.
    gap
        The event is that any link closes by this much or more, in g/ω1². None, without another
        demand: that any link closes its own gap at rest.
    demand, threshold
        Another event, demand ≥ threshold; see ``LimitState``.
    n
        Samples of a level in one repeat. More find rarer ways to fail.
    p0
        Share of a level's samples that lie in the next; at least 10 samples, at most half of n.
    repeats
        Number of independent repeats, at least 2; all run side by side, in the same batches.
        Repeat r depends on key and r alone.
    cov
        The coefficient of variation wanted: as many repeats are added, several times if need be, as
        reach it. None: no more than ``repeats``.
    max_runs
        Number of runs beyond which no repeats are added.
    key
        A seed, or a key of ``jax.random``.
    store
        A folder that keeps the values of finished runs: the same call goes on from there after it
        was stopped, or to a smaller ``cov`` or more ``repeats``, and ends as if it had not been
        interrupted. At most some 2,000 runs (n, if that is more) are lost. Damaged files are named
        in a warning, and their runs made anew.
    progress
        Whether to show a progress bar with the current estimate.

    Returns
    -------
    RareEvent
        Its points are those of all levels, each level without what lies in the next. Their weights
        make them a sample of the whole distribution: mean(weights · (values ≥ −x)) estimates the
        probability of a threshold lower by x. Its warnings say in words why not to trust it.
        Failed runs count as safe, and are counted there. A probability below 1e-12 is out of reach;
        it is a bound then, with a c.o.v. of NaN.

    Raises
    ------
    ValueError
        If an argument breaks its rule, memory has no room for ``max_runs`` points, or the demand
        does not depend on the scenarios' numbers. If the store holds another search, with what
        differs.
    OSError
        If the store cannot be written to.

    Examples
    --------
    >>> ground = jp.RandomRicker(2, jp.LogNormal(0.1, 0.5), jp.Uniform(1, 3.8), jp.Uniform(1, 7))
    >>> scenarios = jp.Scenarios(jp.paper.structures(), ground)
    >>> grid = jp.TimeGrid.until(10.0, dt=0.05)
    >>> event = jp.subset_simulation(scenarios, grid, 0.6, n=200, repeats=4, progress=False)
    >>> 1e-3 < event.probability < 3e-2
    True
    """
    threshold = threshold_of(OWNER, gap, demand, threshold)
    state = LimitState(scenarios, grid, scheme, demand, threshold)
    return simulated(
        state,
        n=n,
        p0=p0,
        repeats=repeats,
        cov=cov,
        max_runs=max_runs,
        key=key,
        store=store,
        progress=progress,
    )


def simulated(
    state: LimitState,
    *,
    n: int = _N,
    p0: float = _P0,
    repeats: int = _REPEATS,
    cov: float | None = None,
    max_runs: int = _MAX_RUNS,
    key: int | jax.Array = 0,
    store: str | PathLike[str] | None = None,
    progress: bool = True,
    why: str = "",
) -> RareEvent:
    """``subset_simulation`` of a limit state; ``why`` begins the sentence on the method."""
    n, repeats, max_runs = _checked(state, n, p0, repeats, cov, max_runs)
    _, numbers = key_numbers(OWNER, key)
    found: list[list[Level]] = []
    with tqdm(unit=" runs", unit_scale=True, disable=not progress) as bar:
        bar.set_postfix_str(COMPILING)
        runs = SubsetRuns(state, bar, store, key=key, n=n, p0=p0)

        def told(reached: list[float]) -> None:
            bar.set_postfix_str(_so_far(found) if found else f"P < {np.mean(reached):.2g}")

        wanted = repeats
        while wanted > 0:
            numbered = range(len(found), len(found) + wanted)
            random = {r: np.random.default_rng([*numbers, r]) for r in numbered}
            new = {r: descent(state.dimension, n, p0, rng) for r, rng in random.items()}
            found = found + side_by_side(runs, new, told)
            if all(len(levels) == 1 for levels in found):
                require_dependence(OWNER, state, found[0][0].points, found[0][0].values)
            bar.set_postfix_str(_so_far(found))
            room = (max_runs - runs.count) * len(found) // runs.count
            wanted = min(_more_repeats(found, cov), room)
    depths = sorted(map(len, found))
    levels = f"{depths[0]} to {depths[-1]} levels"
    if depths[0] == depths[-1]:
        levels = "1 level" if depths[0] == 1 else f"{depths[0]} levels"
    method = (
        f"subset simulation by adaptive conditional sampling, {len(found)} repeats of {n:,} "
        f"samples a level, p0 = {p0:.3g}, {levels}; c.o.v. by repeats"
    )
    bound, warnings = _bound(found, round(p0 * n))
    if runs.failed:
        warnings.append(f"{runs.failed:,} of {runs.count:,} runs failed and count as safe")
    sample = _sample(found)
    return RareEvent(
        probability=_probability(found) if bound is None else bound,
        cov=_cov(found),
        runs=runs.count,
        gradients=0,
        method=f"{why}{method}",
        limit_state=state,
        points=sample.points,
        weights=sample.weights,
        values=sample.values,
        design_points=np.empty((0, state.dimension)),
        instants=np.empty(0),
        repeats=sample.repeats,
        warnings=(*warnings, *_warnings(found, cov, max_runs)),
    )


def _checked(
    state: LimitState, n: Any, p0: Any, repeats: Any, cov: Any, max_runs: Any
) -> tuple[int, int, int]:
    """The whole numbers; a ``ValueError`` for an argument that breaks its rule."""
    n, repeats = count(OWNER, "n", n), count(OWNER, "repeats", repeats)
    max_runs = count(OWNER, "max_runs", max_runs)
    require_share(OWNER, "p0", p0)
    if cov is not None:
        positive(OWNER, cov=cov)
    seeds = round(p0 * n)
    few = f"at least {_FEWEST_SEEDS} for chains to start from, {_FEWEST_SEEDS / p0:.0f} samples"
    rules = [
        Rule("p0", p0, p0 <= 0.5, "at most 0.5"),
        Rule("p0 n", seeds, seeds >= _FEWEST_SEEDS, few),
        Rule("repeats", repeats, repeats >= 2, "at least 2, which tell the spread"),
    ]
    enforce(OWNER, rules)
    most = max(max_runs, n * repeats)
    require_memory(OWNER, "max_runs", most, most * (state.dimension + 2) * 8)
    return n, repeats, max_runs


def _estimates(found: Sequence[list[Level]]) -> np.ndarray:
    return np.array([levels[-1].estimate for levels in found])


def _probability(found: Sequence[list[Level]]) -> float:
    return float(_estimates(found).mean())


def _cov(found: Sequence[list[Level]]) -> float:
    """Coefficient of variation of the mean of the repeats; NaN if none has reached the event."""
    p = _estimates(found)
    return float(p.std(ddof=1) / math.sqrt(len(p)) / p.mean()) if p.any() else math.nan


def _more_repeats(found: Sequence[list[Level]], cov: float | None) -> int:
    """How many to add: what the wanted c.o.v. seems to need, at most as many as there are."""
    now = _cov(found)
    if cov is None or not now > cov:
        return 0
    return min(len(found), math.ceil(len(found) * (_MARGIN * (now / cov) ** 2 - 1)))


def _so_far(found: Sequence[list[Level]]) -> str:
    p = _probability(found)
    return f"P = {p:.3g}, c.o.v. {_cov(found):.2g}" if p > 0 else "P out of reach"


class _Sample(NamedTuple):
    """Samples of all levels, and what ``RareEvent`` says of them."""

    points: np.ndarray
    weights: np.ndarray
    values: np.ndarray
    repeats: np.ndarray


def _sample(found: Sequence[list[Level]]) -> _Sample:
    """Every level without what lies in the next."""
    parts = []
    for number, levels in enumerate(found):
        ends = [level.threshold for level in levels[1:]] + [math.inf]
        for level, end in zip(levels, ends, strict=True):
            own = level.values <= end
            share = np.full(own.sum(), level.probability / len(level.values) / len(found))
            of = np.full(own.sum(), number)
            parts.append((level.points[own], share, level.values[own], of))
    points, shares, values, repeats = (np.concatenate(x) for x in zip(*parts, strict=True))
    return _Sample(points, shares * len(shares), values, repeats)


def _bound(found: Sequence[list[Level]], seeds: int) -> tuple[float | None, list[str]]:
    """A bound on a probability that no sample or every sample tells of, and what it means."""
    n = sum(len(levels[0].values) for levels in found)
    if all((levels[0].values >= 0).all() for levels in found):
        return None, [always(n)]
    if _probability(found) >= RAREST:
        return None, []
    last = [levels[-1] for levels in found]
    reached = float(np.mean([level.probability for level in last]))
    nearest = max(float(level.values.max()) for level in last)
    bound, why = RAREST, "rarer levels are not sought"
    if any((level.values == level.values.max()).sum() > seeds for level in last):
        n = sum(len(level.values) for level in last)
        bound = -math.log(_SURE) * reached / n
        why = "no rarer level lies beyond one in which the largest demands are all the same"
    short = f"; the demand stays {-nearest:.4g} below the threshold" if nearest < 0 else ""
    return bound, [
        f"out of reach: the probability is below {bound:.2g}, since {why}{short}; the number is a "
        "bound and no estimate"
    ]


def _warnings(found: Sequence[list[Level]], cov: float | None, max_runs: int) -> Iterator[str]:
    """Why not to trust the estimate, in sentences."""
    p, spread = _estimates(found), _cov(found)
    if p.mean() < RAREST:
        return
    none, share = int((p == 0).sum()), float(p.max() / p.sum())
    if none:
        yield f"{none} of {len(p)} repeats never reach the event: take more samples a level (n)"
    elif share > max(_LARGE_SHARE, 2 / len(p)):
        yield (
            f"one of {len(p)} repeats makes {share:.0%} of the estimate, which has found what the "
            "others miss: take more samples a level (n)"
        )
    if spread > _LARGE_COV:
        yield (
            f"a coefficient of variation of {spread:.2g} tells the order of magnitude at best: "
            "take more repeats, or more samples a level (n)"
        )
    if cov is not None and spread > cov:
        yield (
            f"the coefficient of variation is {spread:.2g}, above {cov:.2g}: raise max_runs = "
            f"{max_runs:,}"
        )
    for number in range(1, max(map(len, found))):
        same = [levels[number] for levels in found if len(levels) > number]
        kept = np.mean([level.acceptance for level in same])
        scale = np.mean([level.scale for level in same])
        if kept < _LOW_ACCEPTANCE:
            yield (
                f"at level {number + 1} only {kept:.0%} of the chains' moves stay in the level, "
                "whose samples are few points many times over: take more samples a level (n)"
            )
        elif scale < _SMALL_SCALE:
            yield (
                f"at level {number + 1} the chains move by {scale:.2g} standard deviations a step, "
                "and stay near their starts: take more samples a level (n)"
            )
