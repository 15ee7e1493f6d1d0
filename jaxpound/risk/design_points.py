"""Design points: where a limit state comes nearest to the origin, one for every instant.

The search is the improved HLRF iteration (Hasofer and Lind 1974; Rackwitz and Fiessler 1978; Zhang
and Der Kiureghian 1995), of all instants in one batch. Its points are where earthquakes that reach
the limit state at that instant are likeliest (Koo, Der Kiureghian and Fujimura 2005).

A demand that is not of an instant has one limit state, which may have many such points. Starts are
added until nearly all of them end in a point that another start has found too: the share of those
that do not estimates the share of further starts that would end in a new point (Good 1953,
Biometrika 40:237, after Turing).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.special import ndtr, ndtri

from jaxpound.risk.instants import chosen_instants
from jaxpound.risk.limit_state import LimitState

FARTHEST = 12.0
"""Distance beyond which no design point is sought: Φ(−12) is 2e-33."""
FAR = 2.5
"""Design points that are farther than the nearest by more than this are left out."""
NEAR = 1.2
"""Design points that are farther than the nearest by more than this are not sampled around."""
COVERED = 0.9
"""Share of the starts whose points others have found, from which the points count as all."""
_ITERATIONS = 25
_PATIENT = 3  # iterations before a start is given up
_RESCUED = 10  # iterations from the point of a neighbour
_SPREAD = 0.7  # standard deviation of the starts
_STARTS = 32  # where the demand is not of instants, at first
_MOST_STARTS = 512
_SHORTER = 0.4  # factor of a step that did not help
_SHORTEST = 0.05  # below this a step is taken whether it helps or not
_ON = 2e-3  # distance from the limit state and, next,
_ALONG = 0.06  # from the line along the gradient at which a point is found, as shares of |z|
_STEEPER = 5.0  # slope, as a multiple of the usual one, that is told from a jump
_HOPELESS = 1.0  # beyond FAR: too far for a point on its way
_STILL = 20.0  # times FARTHEST: too far for one that has no gradient yet
_ALIKE = 0.98  # cosine above which the points of two starts are one
_FOUND_AGAIN = 0.9  # the same, for samples around the one to be drawn around the other, too
_NEARLY = 0.75  # share of the way to a linearised limit state


class DesignPoints(NamedTuple):
    """Design points, the nearest first."""

    z: Float[np.ndarray, "k d"]
    directions: Float[np.ndarray, "k d"]
    """Unit vectors along the gradients of the limit state."""
    betas: Float[np.ndarray, " k"]
    """Distances of the linearised limit states from the origin."""
    instants: Int[np.ndarray, " k"]
    """Numbers of the instants; −1 where the demand is not of one."""
    series: Int[np.ndarray, " k"]
    gradients: int
    """Runs with a gradient that the search took."""
    failed: int
    """Starts that did not converge within the distance that matters; all, if none did."""
    covered: float = 1.0
    """Estimated share of random starts that end in one of these points, of a demand that is not of
    an instant."""

    def __len__(self) -> int:
        return len(self.z)

    def within(self, distance: float) -> DesignPoints:
        """Those that are farther than the nearest by no more than a distance."""
        if not len(self):
            return self
        near = self.betas <= self.betas[0] + distance
        z, directions, betas, instants, series = (x[near] for x in self[:5])
        return DesignPoints(z, directions, betas, instants, series, *self[5:])

    def stand_for(self, z: Float[np.ndarray, "n d"]) -> np.ndarray:
        """Which of some points lie beyond or nearly at a linearised limit state, shape (n,)."""
        return (z @ self.directions.T >= _NEARLY * self.betas).any(axis=1)

    def form(self, draws: int = 20_000) -> float:
        """Probability that any linearised limit state is reached, without a run.

        The union of half-spaces is sampled as by Owen, Maximov and Chertkov (2019): one of them by
        its probability, a point in it, and in how many others that is.
        """
        if not len(self):
            return float("nan")
        own = ndtr(-self.betas)
        if not own.sum() > 0:
            return 0.0
        rng = np.random.default_rng(0)
        # Within the span of the directions, where nothing else matters.
        basis = np.linalg.svd(self.directions, full_matrices=False)[2]
        a = self.directions @ basis.T
        which = rng.choice(len(own), draws, p=own / own.sum())
        y = rng.standard_normal((draws, len(basis)))
        beyond = -ndtri(rng.random(draws) * own[which])
        chosen = a[which]
        y += chosen * (beyond - _dots(y, chosen))[:, None]
        inside = (y @ a.T >= self.betas - 1e-9).sum(axis=1)
        return float(own.sum() * np.mean(1 / np.maximum(inside, 1)))


@dataclasses.dataclass
class _Search:
    """The state of the iteration, for each start: arrays of the same length."""

    z: np.ndarray
    value: np.ndarray
    slope: np.ndarray
    direction: np.ndarray  # of the step from z
    step: np.ndarray
    price: np.ndarray  # of |value| in the merit
    fresh: np.ndarray  # not evaluated yet
    done: np.ndarray
    lost: np.ndarray

    @staticmethod
    def of(z: np.ndarray) -> _Search:
        """The search from given starts."""
        n = len(z)
        zeros, no = np.zeros(n), np.zeros(n, bool)
        return _Search(
            z=z,
            value=zeros.copy(),
            slope=np.zeros_like(z),
            direction=np.zeros_like(z),
            step=zeros.copy(),
            price=zeros.copy(),
            fresh=~no,
            done=no.copy(),
            lost=no.copy(),
        )

    def joined(self, other: _Search) -> _Search:
        """The search of the starts of both."""
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return _Search(*(np.concatenate(pair) for pair in pairs))

    @property
    def active(self) -> np.ndarray:
        """Which are still under way."""
        return np.flatnonzero(~(self.done | self.lost))

    @property
    def steepness(self) -> np.ndarray:
        """Lengths of the gradients, 1 where there is none."""
        size = np.linalg.norm(self.slope, axis=1)
        return np.where(size == 0, 1.0, size)

    def usual_steepness(self) -> float:
        """The median length of the gradients that are not 0."""
        moved = self.slope.any(axis=1)
        return float(np.median(self.steepness[moved])) if moved.any() else np.inf

    def planes(self) -> tuple[np.ndarray, np.ndarray]:
        """Normals of the linearised limit states, and their distances from the origin."""
        steep = self.steepness
        along = self.slope / steep[:, None]
        return along, _dots(along, self.z) - self.value / steep

    def nearest(self) -> float:
        """The smallest distance of those that are done."""
        return float(self.planes()[1][self.done].min(initial=np.inf))

    def reached(self, distance: float) -> np.ndarray:
        """Those done that are farther than the nearest by no more than a distance, in order."""
        betas = self.planes()[1]
        rows = np.flatnonzero(self.done & (betas > 0) & (betas < FARTHEST))
        rows = rows[np.argsort(betas[rows], kind="stable")]
        return rows[betas[rows] <= betas[rows[:1]].sum() + distance]

    def advance(self, rows: np.ndarray, state: LimitState, *places: np.ndarray) -> None:
        """Evaluate the next point of some starts; take those that help, and choose their steps."""
        trial = self.z[rows] + self.step[rows, None] * self.direction[rows]
        value, slope = state.gradients(trial, *(x[rows] for x in places))
        good = np.isfinite(value) & np.isfinite(slope).all(axis=1)
        before = _merit(self.z[rows], self.value[rows], self.price[rows])
        after = _merit(trial, value, self.price[rows])
        still = (self.slope[rows] == 0).all(axis=1)
        helps = self.fresh[rows] | still | (after < before) | (self.step[rows] < _SHORTEST)
        taken = good & helps
        self.step[rows[~taken]] *= _SHORTER
        own = rows[taken]
        self.z[own], self.value[own], self.slope[own] = trial[taken], value[taken], slope[taken]
        self.fresh[own], self.step[own] = False, 1.0
        along, betas = (x[own] for x in self.planes())
        z, length = self.z[own], np.linalg.norm(self.z[own], axis=1)
        # Where the damper sticks throughout, say, only a stronger motion can tell.
        still = (self.slope[own] == 0).all(axis=1)
        # Behind the origin of a motion that is safe: the opposite one is nearer to the limit.
        betas = np.where(self.value[own] < 0, np.abs(betas), betas)
        target = np.where(still[:, None], 2 * z, along * betas[:, None])
        self.direction[own] = target - z
        self.price[own] = 2 * np.maximum(length, np.abs(betas)) / self.steepness[own]
        size = np.maximum(length, 1)
        off = np.linalg.norm(z - along * _dots(along, z)[:, None], axis=1) <= _ALONG * size
        on = np.abs(self.value[own]) <= _ON * size * self.steepness[own]
        # Where it is steep in passing, a point may be near the plane and far from the limit state.
        on &= np.abs(self.value[own]) <= _STEEPER * _ON * size * self.usual_steepness()
        self.done[own] = on & off & ~still

    def give_up(self) -> None:
        """Leave those that head for points too far to matter."""
        far = min(self.nearest() + FAR + _HOPELESS, FARTHEST)
        heads = np.linalg.norm(self.z + self.direction, axis=1)
        least = np.minimum(heads, np.linalg.norm(self.z, axis=1))
        # What makes the damper slip in a random direction is farther than the design point.
        still = (self.slope == 0).all(axis=1)
        self.lost |= ~self.done & (least > np.where(still, _STILL * FARTHEST, far))

    def rescue(self, instants: np.ndarray, series: np.ndarray) -> None:
        """Start those without a point again from the point of an instant next to theirs."""
        missing = np.flatnonzero(~self.done)
        near = self.done & (self.planes()[1] <= self.nearest() + FAR)
        z = self.z.copy()
        self.lost |= ~self.done
        for one in missing:
            others = np.flatnonzero(near & (series == series[one]))
            if not others.size:
                continue
            closest = others[np.argmin(np.abs(instants[others] - instants[one]))]
            between = np.sort(instants[[one, closest]])
            ours = instants[series == series[one]]
            if np.count_nonzero((ours > between[0]) & (ours < between[1])) <= 1:
                self.z[one], self.step[one], self.direction[one] = z[closest], 0.0, 0.0
                self.fresh[one], self.lost[one] = True, False


def find_design_points(
    state: LimitState,
    key: Any,
    start: DesignPoints | None = None,
    told: Callable[[int, float], None] = lambda gradients, beta: None,
) -> DesignPoints:
    """The design points of a limit state.

    Parameters
    ----------
    state
        The limit state.
    key
        Seed of the starts, as NumPy takes it.
    start
        Design points of another threshold or other structures from which to start, each at its own
        instant; the instants next to theirs start from what these lead to. By default instants all
        over the run start from random points.
    told
        Called with the number of gradients so far and the smallest distance found.
    """
    instants, series = _places(state)
    rng = np.random.default_rng(key)

    def at_random(n: int) -> _Search:
        return _Search.of(_SPREAD * rng.standard_normal((n, state.dimension)))

    if start is None:
        search = at_random(len(instants))
    elif state.series:
        search = _from_points(start, instants, series)
    else:
        search, instants, series = _Search.of(np.array(start.z)), start.instants, start.series
    gradients = 0

    def go_on(iterations: int) -> None:
        nonlocal gradients
        for iteration in range(iterations):
            rows = search.active
            if not rows.size:
                return
            search.advance(rows, state, instants, series)
            gradients += len(rows)
            if iteration >= _PATIENT:
                search.give_up()
            told(gradients, search.nearest())

    go_on(_ITERATIONS)
    if state.series and search.done.any():
        search.rescue(instants, series)
        go_on(_RESCUED)
    anywhere = start is None and not state.series
    while anywhere and len(search.z) < _MOST_STARTS and _covered(search) < COVERED:
        search = search.joined(at_random(len(search.z)))
        instants, series = np.tile(instants, 2), np.tile(series, 2)
        go_on(_ITERATIONS)
    covered = _covered(search) if anywhere else 1.0 if start is None else start.covered
    return _kept(search, instants, series, gradients, covered)


def _places(state: LimitState) -> tuple[np.ndarray, np.ndarray]:
    """Instants and series of the starts."""
    n_series = len(state.series)
    if not n_series:
        return np.full(_STARTS, -1), np.zeros(_STARTS, int)
    instants = chosen_instants(state.grid.n_steps, state.grid.dt, n_series)
    return np.tile(instants, n_series), np.repeat(np.arange(n_series), len(instants))


def _from_points(start: DesignPoints, instants: np.ndarray, series: np.ndarray) -> _Search:
    """The search from design points, each at the place of its series that is nearest to it."""
    apart = np.abs(np.subtract.outer(start.instants, instants)).astype(float)
    apart[start.series[:, None] != series] = np.inf
    rows = apart.argmin(axis=1)
    z = np.zeros((len(instants), start.z.shape[1]))
    z[rows[::-1]] = start.z[::-1]  # of two at one place the nearer
    search = _Search.of(z)
    search.lost[np.setdiff1d(np.arange(len(z)), rows)] = True
    return search


def _kept(
    search: _Search, instants: np.ndarray, series: np.ndarray, gradients: int, covered: float
) -> DesignPoints:
    """The points that matter, moved onto the linearised limit states' nearest points."""
    along, betas = search.planes()
    rows = search.reached(FAR)
    if (instants[rows] < 0).any():
        rows = _different(along, rows)
    # Without a point nothing is known of how far the others were from one.
    failed = int(search.active.size) if rows.size else len(search.z)
    return DesignPoints(
        along[rows] * betas[rows, None],
        along[rows],
        betas[rows],
        instants[rows],
        series[rows],
        gradients,
        failed,
        covered,
    )


def _covered(search: _Search) -> float:
    """Estimated share of random starts that end in a point that is known, of those nearby.

    One less the share of the starts whose point no other start has found (Good 1953).
    """
    along = search.planes()[0][search.reached(NEAR)]
    if not len(along):
        return 1.0
    cosines = along @ along.T - 2 * np.eye(len(along))
    return 1 - float(np.mean(cosines.max(axis=1) < _FOUND_AGAIN))


def _different(along: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Those among rows, in order, that no other start has found before."""
    chosen: list[int] = []
    for row in rows:
        if not chosen or (along[chosen] @ along[row]).max() < _ALIKE:
            chosen.append(int(row))
    return np.array(chosen, int)


def _merit(z: np.ndarray, value: np.ndarray, price: np.ndarray) -> np.ndarray:
    return 0.5 * _dots(z, z) + price * np.abs(value)


def _dots(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.einsum("ij,ij->i", x, y)
