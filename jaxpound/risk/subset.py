"""Subset simulation: a rare event reached through a chain of likelier ones, without derivatives."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from tqdm.auto import tqdm

from jaxpound._checks import (
    Rule,
    count,
    enforce,
    positive,
    refusal,
    require_memory,
    require_share,
)
from jaxpound.grid import TimeGrid
from jaxpound.results.demand import Demand
from jaxpound.risk.levels import FLOOR, Level, descent, side_by_side
from jaxpound.risk.limit_state import REQUIRED_GAP, LimitState
from jaxpound.risk.rare_event import RareEvent
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
_LARGE_SHARE = 0.5


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
    simulation leave out that its levels, and its chains, are correlated.) The estimate has a bias
    of the order of 1/n: of 1e-4 by a plane in ten dimensions it is +1 % with the default, +5 % with
    n = 400.

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
    progress
        Whether to show a progress bar with the current estimate.

    Returns
    -------
    RareEvent
        Its points are those of all levels, each level without what lies in the next. Their weights
        make them a sample of the whole distribution: mean(weights · (values ≥ −x)) estimates the
        probability of a threshold lower by x. Its warnings say in words why not to trust it.

    Raises
    ------
    ValueError
        If an argument breaks its rule, memory has no room for ``max_runs`` points, or a run fails,
        with the point.

    Examples
    --------
    >>> ground = jp.RandomRicker(2, jp.LogNormal(0.1, 0.5), jp.Uniform(1, 3.8), jp.Uniform(1, 7))
    >>> scenarios = jp.Scenarios(jp.paper.structures(), ground)
    >>> grid = jp.TimeGrid.until(10.0, dt=0.05)
    >>> event = jp.subset_simulation(scenarios, grid, 0.6, n=200, repeats=4, progress=False)
    >>> 1e-4 < event.probability < 1e-2
    True
    """
    if gap is not None:
        if demand != REQUIRED_GAP or threshold is not None:
            raise ValueError(f"{OWNER}: gap = {gap!r} must be None where another demand is given")
        (threshold,) = positive(OWNER, gap=gap)
    state = LimitState(scenarios, grid, scheme, demand, threshold)
    return simulated(
        state,
        n=n,
        p0=p0,
        repeats=repeats,
        cov=cov,
        max_runs=max_runs,
        key=key,
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
    progress: bool = True,
    why: str = "",
) -> RareEvent:
    """``subset_simulation`` of a limit state; ``why`` begins the sentence on the method."""
    n, repeats, max_runs = _checked(state, n, p0, repeats, cov, max_runs)
    _, numbers = key_numbers(OWNER, key)
    found: list[list[Level]] = []
    runs = 0
    with tqdm(unit=" runs", unit_scale=True, disable=not progress) as bar:

        def told(more: int, reached: list[float]) -> None:
            nonlocal runs
            runs += more
            bar.set_postfix_str(_estimate_so_far(found, reached), refresh=False)
            bar.update(more)

        wanted = repeats
        while wanted > 0:
            random = [
                np.random.default_rng([*numbers, r]) for r in range(len(found), len(found) + wanted)
            ]
            new = [descent(state.dimension, n, p0, rng) for rng in random]
            found = found + side_by_side(lambda z: _values(state, z), new, told)
            bar.set_postfix_str(_estimate_so_far(found))
            room = (max_runs - runs) * len(found) // runs
            wanted = min(_more_repeats(found, cov), room)
    depths = sorted(map(len, found))
    levels = str(depths[0]) if depths[0] == depths[-1] else f"{depths[0]} to {depths[-1]}"
    method = (
        f"subset simulation by adaptive conditional sampling, {len(found)} repeats of {n:,} "
        f"samples a level, p0 = {p0:.3g}, {levels} levels; c.o.v. by repeats"
    )
    points, weights, values = _sample(found)
    return RareEvent(
        probability=_probability(found),
        cov=_cov(found),
        runs=runs,
        gradients=0,
        method=f"{why}{method}",
        limit_state=state,
        points=points,
        weights=weights,
        values=values,
        design_points=np.empty((0, state.dimension)),
        instants=np.empty(0),
        warnings=tuple(_warnings(found, cov, max_runs)),
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


def _values(state: LimitState, z: np.ndarray) -> np.ndarray:
    """The limit state's values; a ``ValueError`` where a run fails."""
    values = np.asarray(state.values(z), float)
    failed = np.flatnonzero(np.isnan(values))
    if failed.size:
        at = z[failed[0]]
        reason = refusal(lambda: state.value(jnp.asarray(at))) or "its demand is not a number"
        shown = np.array2string(at, precision=4, threshold=20, max_line_width=10_000)
        raise ValueError(f"{OWNER}: the run of z = {shown} fails: {reason}")
    return values


def _estimates(found: Sequence[list[Level]]) -> np.ndarray:
    return np.array([levels[-1].estimate for levels in found])


def _probability(found: Sequence[list[Level]]) -> float:
    return float(_estimates(found).mean())


def _cov(found: Sequence[list[Level]]) -> float:
    """Coefficient of variation of the mean of the repeats; infinite if the event was not seen."""
    p = _estimates(found)
    return float(p.std(ddof=1) / math.sqrt(len(p)) / p.mean()) if p.any() else math.inf


def _more_repeats(found: Sequence[list[Level]], cov: float | None) -> int:
    """How many to add: what the wanted c.o.v. seems to need, at most as many as there are."""
    now = _cov(found)
    if cov is None or now <= cov or not math.isfinite(now):
        return 0
    return min(len(found), math.ceil(len(found) * (_MARGIN * (now / cov) ** 2 - 1)))


def _estimate_so_far(found: Sequence[list[Level]], reached: Sequence[float] = ()) -> str:
    if found:
        return f"P = {_probability(found):.3g}, c.o.v. {_cov(found):.2g}"
    return f"P < {np.mean(reached):.1e}"


def _sample(found: Sequence[list[Level]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, weights and values of every level without what lies in the next."""
    points, weights, values = [], [], []
    for levels in found:
        ends = [level.threshold for level in levels[1:]] + [math.inf]
        for level, end in zip(levels, ends, strict=True):
            own = level.values < end
            points.append(level.points[own])
            values.append(level.values[own])
            weights.append(np.full(own.sum(), level.probability / len(level.values)))
    every = np.concatenate(weights)
    return np.concatenate(points), every * len(every) / len(found), np.concatenate(values)


def _warnings(found: Sequence[list[Level]], cov: float | None, max_runs: int) -> Iterator[str]:
    """Why not to trust the estimate, in sentences."""
    p = _estimates(found)
    first = np.concatenate([levels[0].values for levels in found])
    if (first == first[0]).all():
        yield (
            f"The demand is the same in {len(first):,} random runs: it may not depend on the "
            "random variables."
        )
    if not p.any():
        yield _not_seen(found)
        return
    if (first >= 0).all():
        bound = 3 / len(first)
        yield (
            f"The event occurs in each of {len(first):,} random runs: its probability is above "
            f"1 - {bound:.2g} (95 %), and nothing more is known of it."
        )
        return
    if p.mean() < FLOOR:
        yield f"A probability below {FLOOR:.0e} is a bound: no rarer level is sought."
    none = int((p == 0).sum())
    if none:
        yield f"{none} of {len(p)} repeats never reach the event: take more samples a level (n)."
    elif p.max() > _LARGE_SHARE * p.sum() and len(p) > 1 / _LARGE_SHARE:
        share = p.max() / p.sum()
        yield (
            f"One of {len(p)} repeats makes {share:.0%} of the estimate: it has found what the "
            "others miss; take more samples a level (n)."
        )
    spread = _cov(found)
    if spread > _LARGE_COV:
        yield (
            f"A coefficient of variation of {spread:.2g} leaves the order of magnitude at best: "
            "take more repeats, or more samples a level (n)."
        )
    elif cov is not None and spread > cov:
        yield (
            f"The coefficient of variation is {spread:.2g}, not {cov:.2g}: {max_runs:,} runs "
            "(max_runs) leave no room for more repeats."
        )
    yield from _on_chains(found)


def _not_seen(found: Sequence[list[Level]]) -> str:
    """The bound on the probability of an event that no run has reached, and how near they came."""
    last = [levels[-1] for levels in found]
    nearest = max(float(level.values.max()) for level in last)
    seen = f"No run reaches the event; the nearest demand is {-nearest:.4g} short of it"
    reached = float(np.mean([level.probability for level in last]))
    if any(level.values.min() == level.values.max() for level in last):
        samples = sum(len(level.values) for level in last)
        return (
            f"{seen}. The demand is the same in all runs of a level, so that no level leads on: "
            f"the probability is below {3 * reached / samples:.2g} (95 %)."
        )
    return f"{seen}, at levels of a probability of {reached:.2g}: its own is below {FLOOR:.0e}."


def _on_chains(found: Sequence[list[Level]]) -> Iterator[str]:
    """Findings on levels whose chains do not explore them."""
    for number in range(1, max(map(len, found))):
        same = [levels[number] for levels in found if len(levels) > number]
        kept = np.mean([level.acceptance for level in same])
        scale = np.mean([level.scale for level in same])
        if kept < _LOW_ACCEPTANCE:
            yield (
                f"At level {number + 1} only {kept:.0%} of the chains' moves stay in the level: "
                "its samples are few points, many times over; take more samples a level (n)."
            )
        elif scale < _SMALL_SCALE:
            yield (
                f"At level {number + 1} the chains move by {scale:.2g} of the spread of their "
                "starts only: they stay near these; take more samples a level (n)."
            )
