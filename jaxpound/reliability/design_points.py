"""Design points: where a limit state is nearest to the origin, one for every instant.

There the earthquakes that reach the limit state at an instant are likeliest (Koo, Der Kiureghian
and Fujimura 2005). All instants are searched in one batch by the improved HLRF iteration (Hasofer
and Lind 1974, Rackwitz and Fiessler 1978, Zhang and Der Kiureghian 1995): each step goes to the
nearest point of the linearised limit state, and is shortened where a merit function says so.

A demand without instants has one limit state, which may have many such points: starts are added
until nearly all of them end in a point that another start has reached too (Good 1953, Biometrika
40:237, after Turing). A demand that impacts make is sought on the ways from the origin to design
points of overlaps, those of blocks that pass through each other.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.special import ndtr, ndtri

from jaxpound.reliability.instants import chosen_instants
from jaxpound.reliability.limit_state import LimitState

NEAR = 1.2  # design points farther than the nearest by more than this are not sampled around
COVERED = 0.9  # share of starts whose points others have reached too, from which they are all
_ITERATIONS = 25
_RESCUED = 10  # iterations from the point of a neighbour
_SPREAD = 0.7  # standard deviation of the starts
_STARTS = 32  # where the demand has no instants, at first
_MOST_STARTS = 512
_SAME_POINT = 0.98  # cosine above which the points of two starts are the same
_REACHED_TOO = 0.9  # the same, for samples around a point to be drawn around the other, too
_PARTS, _DIVISIONS = 8, 3  # a line is divided; its first part that reaches the demand again
_FARTHEST = 12.0  # distance beyond which no design point is sought: Φ(−12) is 2e-33
_FAR = 2.5  # design points that are farther than the nearest by more than this are left out
_PATIENT = 3  # iterations before a start is given up
_SHORTER = 0.4  # factor of a step that did not help
_SHORTEST = 0.05  # below this a step is taken whether it helps or not
_ON = 2e-3  # distance from the limit state and, next,
_ALONG = 0.06  # from the line along the gradient at which a point has converged, as shares of |z|
_STEEPER = 5.0  # slope, as a multiple of the usual one, from which it counts as a jump
_HOPELESS = 1.0  # beyond _FAR: too far for a point on its way
_STILL = 20.0  # times _FARTHEST: too far for a point that has no gradient yet


@dataclasses.dataclass
class HlrfIteration:
    """The state of the iteration, for each start: arrays of the same length."""

    z: np.ndarray
    instants: np.ndarray  # numbers of the instants, −1 for a demand without instants
    series: np.ndarray  # numbers of the series
    value: np.ndarray
    slope: np.ndarray
    direction: np.ndarray  # of the step from z
    step: np.ndarray
    penalty: np.ndarray  # of |value| in the merit
    fresh: np.ndarray  # not evaluated yet
    done: np.ndarray
    lost: np.ndarray

    @staticmethod
    def of(z: np.ndarray, instants: Any = -1, series: Any = 0) -> HlrfIteration:
        """The iteration before its first step; by default of a demand without instants."""
        instants, series = (np.full(len(z), numbers) for numbers in (instants, series))
        value, step, penalty = np.zeros((3, len(z)))
        slope, direction = np.zeros((2, *z.shape))
        done, lost = np.zeros((2, len(z)), bool)
        state = value, slope, direction, step, penalty, ~done, done, lost
        return HlrfIteration(z, instants, series, *state)

    def joined(self, other: HlrfIteration) -> HlrfIteration:
        """The iteration of the starts of both."""
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return HlrfIteration(*(np.concatenate(pair) for pair in pairs))

    @property
    def active(self) -> np.ndarray:
        """Numbers of the starts that are neither done nor lost."""
        return np.flatnonzero(~(self.done | self.lost))

    @property
    def steepness(self) -> np.ndarray:
        """Lengths of the gradients, 1 where there is none."""
        size = np.linalg.norm(self.slope, axis=1)
        return np.where(size == 0, 1.0, size)

    def planes(self) -> tuple[np.ndarray, np.ndarray]:
        """Normals of the linearised limit states, and their distances from the origin."""
        steep = self.steepness
        along = self.slope / steep[:, None]
        return along, _dots(along, self.z) - self.value / steep

    def nearest(self) -> float:
        """The smallest distance of the points that are done."""
        return float(self.planes()[1][self.done].min(initial=np.inf))

    def reached(self, distance: float) -> np.ndarray:
        """Numbers of the points that are done, up to a distance beyond the nearest, in order."""
        betas = self.planes()[1]
        rows = np.flatnonzero(self.done & (betas > 0) & (betas < _FARTHEST))
        rows = rows[np.argsort(betas[rows], kind="stable")]
        return rows[betas[rows] <= betas[rows[:1]].sum() + distance]

    def run(self, state: LimitState, iterations: int, report: Callable[[int], None]) -> None:
        """Advance all active starts; ``report`` takes the number of gradients of an iteration."""
        for iteration in range(iterations):
            if not (rows := self.active).size:
                return
            self._advance(rows, state)
            if iteration >= _PATIENT:  # leave the starts that head for points too far to matter
                far = min(self.nearest() + _FAR + _HOPELESS, _FARTHEST)
                heads = np.linalg.norm(self.z + self.direction, axis=1)
                least = np.minimum(heads, np.linalg.norm(self.z, axis=1))
                # Points without a gradient may be farther: a random direction needs more for a slip
                still = (self.slope == 0).all(axis=1)
                self.lost |= ~self.done & (least > np.where(still, _STILL * _FARTHEST, far))
            report(len(rows))

    def _advance(self, rows: np.ndarray, state: LimitState) -> None:
        """Evaluate the next point of some starts; take those that help, and choose their steps."""
        trial = self.z[rows] + self.step[rows, None] * self.direction[rows]
        value, slope = state.gradients(trial, self.instants[rows], self.series[rows])
        finite = np.isfinite(value) & np.isfinite(slope).all(axis=1)
        before = _merit(self.z[rows], self.value[rows], self.penalty[rows])
        after = _merit(trial, value, self.penalty[rows])
        still = (self.slope[rows] == 0).all(axis=1)
        helps = self.fresh[rows] | still | (after < before) | (self.step[rows] < _SHORTEST)
        taken = finite & helps
        self.step[rows[~taken]] *= _SHORTER
        moved = rows[taken]
        self.z[moved], self.value[moved] = trial[taken], value[taken]
        self.slope[moved] = slope[taken]
        self.fresh[moved], self.step[moved] = False, 1.0
        along, betas = (x[moved] for x in self.planes())
        z, length = self.z[moved], np.linalg.norm(self.z[moved], axis=1)
        # No gradient where the damper sticks throughout, say: double the motion.
        still = (self.slope[moved] == 0).all(axis=1)
        # A safe point with a negative distance: the limit state is nearer in the other direction.
        betas = np.where(self.value[moved] < 0, np.abs(betas), betas)
        self.direction[moved] = np.where(still[:, None], 2 * z, along * betas[:, None]) - z
        self.penalty[moved] = 2 * np.maximum(length, np.abs(betas)) / self.steepness[moved]
        size = np.maximum(length, 1)
        aligned = np.linalg.norm(z - along * _dots(along, z)[:, None], axis=1) <= _ALONG * size
        on = np.abs(self.value[moved]) <= _ON * size * self.steepness[moved]
        # At a jump a point may be near the plane and far from the limit state.
        sloping = self.slope.any(axis=1)
        usual = float(np.median(self.steepness[sloping])) if sloping.any() else np.inf
        on &= np.abs(self.value[moved]) <= _STEEPER * _ON * size * usual
        self.done[moved] = on & aligned & ~still

    def rescue(self) -> None:
        """Start those without a point again from the point of a neighbouring instant."""
        near, z = self.done & (self.planes()[1] <= self.nearest() + _FAR), self.z.copy()
        self.lost |= ~self.done
        for row in np.flatnonzero(~self.done):
            same = self.series == self.series[row]
            if not (others := np.flatnonzero(near & same)).size:
                continue
            closest = others[np.argmin(np.abs(self.instants[others] - self.instants[row]))]
            first, last = np.sort(self.instants[[row, closest]])
            between = (self.instants[same] > first) & (self.instants[same] < last)
            if np.count_nonzero(between) <= 1:
                self.z[row], self.step[row], self.direction[row] = z[closest], 0.0, 0.0
                self.fresh[row], self.lost[row] = True, False


def _merit(z: np.ndarray, value: np.ndarray, penalty: np.ndarray) -> np.ndarray:
    return 0.5 * _dots(z, z) + penalty * np.abs(value)


def _dots(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Scalar products of the rows of two matrices."""
    return np.einsum("ij,ij->i", x, y)


@dataclasses.dataclass(frozen=True, eq=False)
class DesignPoints:
    """Design points, the nearest first."""

    z: Float[np.ndarray, "k d"]
    directions: Float[np.ndarray, "k d"]  # unit vectors along the gradients of the limit state
    betas: Float[np.ndarray, " k"]  # distances of the linearised limit states from the origin
    instants: Int[np.ndarray, " k"]  # their numbers in the grid; −1 where the demand has none
    series: Int[np.ndarray, " k"]
    gradients: int = 0  # number of runs with a gradient
    failed: int = 0  # starts that did not converge near enough to matter; all, if none did
    covered: float = 1.0  # estimated share of random starts that end in these, without instants
    runs: int = 0  # number of runs without a gradient

    def __len__(self) -> int:
        return len(self.z)

    @property
    def near(self) -> DesignPoints:
        """Those near enough to the nearest for samples to be drawn around them."""
        return self.rows(self.betas <= self.betas[:1].sum() + NEAR)

    @staticmethod
    def none(dimension: int) -> DesignPoints:
        """No points, of so many standard normal numbers."""
        numbers = np.zeros(0, int)
        z = np.zeros((0, dimension))
        return DesignPoints(z, z, np.zeros(0), numbers, numbers)

    def start(self, steps: float) -> DesignPoints:
        """The points where another search begins, which has ``steps`` time steps in one of these.

        Runs, gradients and the covered share are counted anew.
        """
        instants = np.where(self.instants < 0, -1, np.round(self.instants * steps)).astype(int)
        return DesignPoints(self.z, self.directions, self.betas, instants, self.series)

    def rows(self, rows: np.ndarray) -> DesignPoints:
        """Some of the points."""
        names = ("z", "directions", "betas", "instants", "series")
        return dataclasses.replace(self, **{name: getattr(self, name)[rows] for name in names})

    def form(self, draws: int = 20_000) -> float:
        """Probability that any linearised limit state is reached, without a run.

        The union of half-spaces is sampled as by Owen, Maximov and Chertkov (2019): draw a
        half-space by its probability, draw a point in it, and count the half-spaces with the point.
        """
        if not len(self):
            return float("nan")
        beyond_each = ndtr(-self.betas)
        if not beyond_each.sum() > 0:
            return 0.0
        rng = np.random.default_rng(0)
        basis = np.linalg.svd(self.directions, full_matrices=False)[2]  # only their span matters
        a = self.directions @ basis.T
        rows = rng.choice(len(self), draws, p=beyond_each / beyond_each.sum())
        y = rng.standard_normal((draws, len(basis)))
        beyond = -ndtri(rng.random(draws) * beyond_each[rows])
        y += a[rows] * (beyond - _dots(y, a[rows]))[:, None]
        inside = (y @ a.T >= self.betas - 1e-9).sum(axis=1)
        return float(beyond_each.sum() * np.mean(1 / np.maximum(inside, 1)))


def find_design_points(
    state: LimitState,
    key: Any,
    start: DesignPoints | None = None,
    report: Callable[[int, float], None] = lambda gradients, beta: None,
) -> DesignPoints:
    """The design points of a limit state; ``key`` seeds the random starts as NumPy takes it.

    ``start`` are design points of another threshold or other structures, from which neighbouring
    instants start, too; by default all start from random points. A demand without instants has
    random starts besides, by which its points are counted anew. ``report`` takes the number of
    gradients so far and the smallest distance.
    """
    if not state.searches_overlaps:
        return _by_gradients(state, key, start, report)
    touching = dataclasses.replace(state, threshold=0.0)
    first = _on_lines(state, _by_gradients(touching, key, None, report) if start is None else start)
    if not len(first):
        return first
    overlaps, _ = touching.gradients(first.z[:1], first.instants[:1], first.series[:1])
    deep = dataclasses.replace(state, threshold=max(float(overlaps[0]), 0.0))
    second = _on_lines(state, _by_gradients(deep, key, first, report))
    gradients, runs = first.gradients + 1 + second.gradients, first.runs + second.runs
    return dataclasses.replace(second, gradients=gradients, runs=runs)


def _on_lines(state: LimitState, points: DesignPoints) -> DesignPoints:
    """Where a demand is reached first on the straight lines from the origin through points."""
    if not (count := len(points)):
        return points
    columns, directions = np.arange(count), points.z / points.betas[:, None]
    low, high = np.zeros(count), np.full(count, _FARTHEST)
    for _ in range(_DIVISIONS):
        ends = np.linspace(low, high, _PARTS + 1)
        z = (ends[1:-1, :, None] * directions).reshape(-1, state.dimension)
        reached = state.values(z).reshape(_PARTS - 1, count) >= 0
        first = np.vstack([reached, np.ones(count, bool)]).argmax(axis=0)
        low, high = ends[first, columns], ends[first + 1, columns]
    rows = np.argsort(high, kind="stable")
    rows = rows[high[rows] < min(high[rows[0]] + _FAR, _FARTHEST)]
    failed = points.failed + int(np.count_nonzero(high == _FARTHEST))
    runs = points.runs + _DIVISIONS * (_PARTS - 1) * count
    arrays: Any = {"z": directions * high[:, None], "directions": directions, "betas": high}
    return dataclasses.replace(points, **arrays, failed=failed, runs=runs).rows(rows)


def _by_gradients(
    state: LimitState, key: Any, start: DesignPoints | None, report: Callable[[int, float], None]
) -> DesignPoints:
    """The points to which gradients lead: of the demand, or of the series that lead to it."""
    rng, before = np.random.default_rng(key), 0 if start is None else len(start)
    gradients = 0

    def random_starts(n: int) -> np.ndarray:
        return _SPREAD * rng.standard_normal((n, state.dimension))

    def count(more: int) -> None:
        nonlocal gradients
        gradients += more
        report(gradients, search.nearest())

    if state.series:
        search = _at_instants(state, start, random_starts)
        search.run(state, _ITERATIONS, count)
        if search.done.any():
            search.rescue()
            search.run(state, _RESCUED, count)
        return _nearest_points(search, gradients, 1.0)
    search = HlrfIteration.of(random_starts(_STARTS))
    if start is not None:
        search = HlrfIteration.of(np.array(start.z)).joined(search)
    search.run(state, _ITERATIONS, count)
    while (number := len(search.z) - before) < _MOST_STARTS and _covered(search, before) < COVERED:
        search = search.joined(HlrfIteration.of(random_starts(number)))
        search.run(state, _ITERATIONS, count)
    return _nearest_points(search, gradients, _covered(search, before))


def _at_instants(
    state: LimitState, start: DesignPoints | None, random_starts: Callable[[int], np.ndarray]
) -> HlrfIteration:
    """The search of series at instants, each design point at the nearest instant of its series."""
    instants = chosen_instants(state.grid.n_steps, state.time_step, len(state.series))
    series = np.repeat(np.arange(len(state.series)), len(instants))
    instants = np.tile(instants, len(state.series))
    if start is None:
        return HlrfIteration.of(random_starts(len(instants)), instants, series)
    distance = np.abs(np.subtract.outer(start.instants, instants)).astype(float)
    distance[start.series[:, None] != series] = np.inf
    rows = distance.argmin(axis=1)
    z = np.zeros((len(instants), start.z.shape[1]))
    z[rows[::-1]] = start.z[::-1]  # the nearer of two points at the same instant
    search = HlrfIteration.of(z, instants, series)
    search.lost[np.setdiff1d(np.arange(len(z)), rows)] = True
    return search


def _nearest_points(search: HlrfIteration, gradients: int, covered: float) -> DesignPoints:
    """The points that matter: the nearest points of the linearised limit states."""
    along, betas = search.planes()
    rows = search.reached(_FAR)
    if (search.instants[rows] < 0).any():
        different: list[int] = []  # those, in order, whose points no earlier row has
        for row in rows:
            if not different or (along[different] @ along[row]).max() < _SAME_POINT:
                different.append(int(row))
        rows = np.array(different, int)
    # Without a point the distance that matters is unknown.
    failed = int(search.active.size) if rows.size else len(search.z)
    arrays = along * betas[:, None], along, betas, search.instants, search.series
    return DesignPoints(*arrays, gradients, failed, covered).rows(rows)


def _covered(search: HlrfIteration, before: int) -> float:
    """Share of random starts, from number ``before``, that end nearby in the point of another."""
    rows = search.reached(NEAR)
    along, random = search.planes()[0][rows], rows >= before
    if not random.any():
        return 1.0
    cosines = along @ along.T - 2 * np.eye(len(along))
    return 1 - float(np.mean(cosines.max(axis=1)[random] < _REACHED_TOO))
