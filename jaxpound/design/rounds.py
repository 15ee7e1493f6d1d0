"""The best design: of one search or, with limits on probabilities, of a round of searches each.

In a round the logarithm of every limited probability is what its value and slopes at the last
design say (``rare_limits``), with curvatures from the slopes of the rounds before, so that a search
takes no rare event. A box around the last design shrinks where they mislead (move limits). Rounds
end where its probabilities are within their limits and it meets first-order conditions, or stays.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound.design.lagrangian import AugmentedLagrangian, at_active_bound
from jaxpound.design.optimum import AT_BOUND, FirstOrderConditions
from jaxpound.design.problem import LogRatios, Point, ProblemData, best_start
from jaxpound.design.rare_limits import TOLERANCE, Estimated, RareLimits
from jaxpound.design.search import STOPPED_BY_CALLBACK, Descent, Iterate, SearchOptions
from jaxpound.design.space import spread_shares
from jaxpound.risk.limit_state import LimitState

_MOST = 15  # rounds
_FARTHEST = 3.0  # ln P that a round may aim to lower: beyond it the slope changes
_MISLED = 1.0  # excess of ln P over what was expected at which a step is taken back
_CURVED = 0.02  # change of a scaled variable from which slopes tell a curvature
_SETTLED = 0.002  # change of a scaled variable
_OPTIMAL = 0.05  # gradient of the Lagrangian over that of the objective
_FADING = 0.5  # of curvatures, from round to round


class Found(NamedTuple):
    """The best design that was found, and how."""

    own: Point
    history: list[Iterate]
    winner: int
    stopped: str
    polishing: int  # runs with a gradient
    conditions: FirstOrderConditions
    rare: Estimated  # at the design; no events without limited probabilities


def searched(
    lagrangian: AugmentedLagrangian, options: SearchOptions, data: ProblemData, first: np.ndarray
) -> Found:
    """The best design of one search, from a design and others spread over the box.

    Raises
    ------
    ValueError, OSError
        See ``Descent``.
    """
    low, high = np.asarray(data.box)
    begun = spread_shares(first, options.starts, options.key)
    begun[1:] = low + (high - low) * begun[1:]
    best, history, stopped = Descent(lagrangian, options, data).run(begun)
    winner = best_start(best, history[-1].alive)
    own = jax.tree.map(lambda x: x[winner], best)
    conditions, runs = FirstOrderConditions(lagrangian, data, options.starts), 0
    if options.polish and lagrangian.per_epoch == 1 and stopped != STOPPED_BY_CALLBACK:
        own, runs = conditions.polished(own)
    return Found(own, history, winner, stopped, runs, conditions, Estimated({}, data.rare))


def searched_in_rounds(
    lagrangian: AugmentedLagrangian,
    options: SearchOptions,
    data: ProblemData,
    first: np.ndarray,
    states: Mapping[str, LimitState],
) -> Found:
    """The best design within limits on probabilities too; ``states`` are ``limit_states``.

    Raises
    ------
    ValueError
        See ``RareLimits`` and ``searched``.
    OSError
        See ``searched``.
    """
    rare = RareLimits(lagrangian.problem, states, options.key, options.save, options.progress)
    at, here, reach = first, rare.at(first), 1.0
    history: list[Iterate] = []
    polishing, moved, best = 0, np.zeros(first.size), None
    for number in range(_MOST):
        nearby = np.stack([np.maximum(at - reach, 0.0), np.minimum(at + reach, 1.0)])
        box = jnp.asarray(nearby, data.box.dtype)
        given = data._replace(rare=_aimed(here.log_ratios), box=box)
        found = searched(lagrangian, _of_round(options, number), given, at)
        history, polishing = history + found.history, polishing + found.polishing
        new = found.own.scaled
        there, step = rare.at(new), new - at
        size = float(np.abs(step).max())
        conditions = _conditions(lagrangian, data, there.log_ratios, options.starts)
        found = found._replace(rare=there, conditions=conditions)
        kept = _kept(found)
        if kept and (best is None or found.own.objective > best.own.objective):
            best = found
        curvatures = _curved(here.log_ratios, there.log_ratios)
        expected = np.maximum(here.log_ratios.at(new), 0.0)
        if size > _SETTLED and (there.log_ratios.values > expected + _MISLED).any():
            here, reach = _with(here, curvatures), size / 2
            continue
        if (step * moved < 0).any():  # to and fro
            reach = max(size / 2, _SETTLED)
        elif size > 0.8 * reach:
            reach = min(2 * reach, 1.0)
        at, here, moved = new, _with(there, curvatures), step
        if found.stopped == STOPPED_BY_CALLBACK or (size <= _SETTLED and found.own.infeasible):
            break
        if kept and (size <= _SETTLED or _is_optimal(conditions, new)):
            best = found
            break
    final = found if best is None else best
    return final._replace(
        own=final.own._replace(infeasible=np.asarray(best is None)),
        history=history,
        polishing=polishing,
        stopped=f"{found.stopped} of round {number + 1}",
    )


def _conditions(
    lagrangian: AugmentedLagrangian, data: ProblemData, rare: LogRatios, starts: int
) -> FirstOrderConditions:
    """First-order conditions by the slopes of probabilities at a design.

    A probability within half of the tolerance of its limit is at its limit.
    """
    near = np.abs(rare.values) <= TOLERANCE / 2
    active = rare._replace(values=np.where(near, 0.0, rare.values))
    return FirstOrderConditions(lagrangian, data._replace(rare=active), starts)


def _is_optimal(conditions: FirstOrderConditions, scaled: np.ndarray) -> bool:
    here, box = conditions.at(scaled), np.asarray(conditions.data.box)
    _, slope = conditions.multipliers(here.point)
    free = ~at_active_bound(scaled, slope, box, AT_BOUND)
    return bool(np.linalg.norm(slope[free]) <= _OPTIMAL * np.linalg.norm(here.goal))


def _curved(here: LogRatios, there: LogRatios) -> np.ndarray:
    """Curvatures that explain the slopes at another design too: a symmetric rank-one update.

    Only upward curvature is taken, so that every approximation is convex.
    """
    found, step = _FADING * here.curvatures, there.scaled - here.scaled
    if np.abs(step).max() < _CURVED:
        return found
    for curvature, change in zip(found, there.slopes - here.slopes, strict=True):
        missing = change - curvature @ step
        along = missing @ step
        if along > 1e-3 * np.linalg.norm(missing) * np.linalg.norm(step):
            curvature += np.outer(missing, missing) / along
    return found


def _with(rare: Estimated, curvatures: np.ndarray) -> Estimated:
    return rare._replace(log_ratios=rare.log_ratios._replace(curvatures=curvatures))


def _kept(found: Found) -> bool:
    """Whether a design keeps all limits."""
    excess = found.rare.log_ratios.values
    return not found.own.infeasible and bool((excess <= math.log1p(TOLERANCE)).all())


def _aimed(rare: LogRatios) -> LogRatios:
    """As if no probability were too far above its limit for one step."""
    return rare._replace(values=np.minimum(rare.values, _FARTHEST))


def _of_round(options: SearchOptions, number: int) -> SearchOptions:
    """The options of a round, whose search has a file of its own."""
    if options.save is None or not number:
        return options
    path = Path(options.save)
    return dataclasses.replace(options, save=path.with_stem(f"{path.stem}.{number + 1}"))
