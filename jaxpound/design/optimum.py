"""First-order conditions of a design: derivatives at one place, polishing, multipliers."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import minimize, nnls

from jaxpound.design.search import Given, Point, Search, held

AT_BOUND = 0.005
"""Share of the way between bounds from which on a variable stands at a bound."""

_NEAR_LIMIT = 0.01  # of the limit
_POLISHING = 30  # steps at most
_NO_WEIGHT = 1e-6  # with which the Lagrangian's gradient is linear in the multipliers
_FAR = 1e6  # what is not finite, in units of size
_EXACT = 1e-9  # violation by rounding


class FirstOrder(NamedTuple):
    """A place, with the gradient of what is to be made small and of prices over limits."""

    point: Point
    goal: np.ndarray  # (d,)
    slopes: np.ndarray  # (m, d)


@dataclasses.dataclass(frozen=True)
class FirstOrderProgram:
    """The compiled step of a search, put to use at one design."""

    move: Search
    run: Callable[..., Any]
    starts: int
    given: Given
    _seen: dict[bytes, FirstOrder] = dataclasses.field(default_factory=dict)

    def at(self, shares: np.ndarray) -> FirstOrder:
        """Objective and prices with their derivatives, by the program of the search.

        Its gradient is linear in the multipliers where their weight is as good as nothing: one
        place for the objective, and one with a multiplier of 1 for each limit.
        """
        if (key := shares.tobytes()) not in self._seen:
            self._seen[key] = self._at(shares)
        return self._seen[key]

    def _at(self, shares: np.ndarray) -> FirstOrder:
        starts, m = self.starts, len(self.move.objective.limits)
        blocks = np.zeros((-(-(m + 1) // starts) * starts, m))
        blocks[1 : m + 1] = np.eye(m)
        gradients, here = [], None
        for block in np.split(blocks, len(blocks) // starts):
            state = self.move.begin(np.tile(shares, (starts, 1)))
            state = state._replace(
                multipliers=jnp.asarray(block), weight=jnp.full(starts, _NO_WEIGHT)
            )
            seen = []
            for i in range(self.move.per_epoch):
                _, here, slope = self.run(state._replace(iteration=jnp.asarray(i)), self.given)
                seen.append(np.asarray(slope))
            gradients.append(np.mean(seen, axis=0))
        goal, *with_one = np.concatenate(gradients)[: m + 1]
        slopes = np.reshape([one - goal for one in with_one], (m, shares.size))
        first = jax.device_get(jax.tree.map(lambda x: x[0], here))
        return FirstOrder(first, goal, slopes)

    def polished(self, own: Point) -> tuple[Point, int]:
        """A design after SciPy's sequential quadratic programming, and how many runs it took."""
        given = self.given
        limits = np.asarray(given.limits, np.float64)

        def at(shares: np.ndarray) -> FirstOrder:
            return self.at(np.clip(shares, 0.0, 1.0).astype(own.shares.dtype))

        def double(x: Any, otherwise: float = 0.0) -> np.ndarray:  # SciPy takes no other
            return np.nan_to_num(np.asarray(x, np.float64), nan=otherwise)

        constraint = {
            "type": "ineq",
            "fun": lambda x: double(1 - at(x).point.prices / limits, -1.0),
            "jac": lambda x: -double(at(x).slopes),
        }
        size = float(given.size)
        minimize(
            lambda x: float(double(-at(x).point.objective / size, _FAR)),
            double(own.shares),
            jac=lambda x: double(at(x).goal),
            bounds=[(0.0, 1.0)] * self.move.space.dimension,
            constraints=[constraint] if limits.size else (),
            method="SLSQP",
            options={"maxiter": _POLISHING, "ftol": 1e-10},
        )
        points = [one.point for one in self._seen.values() if np.isfinite(one.point.merit)]
        runs = len(self._seen) * -(-(limits.size + 1) // self.starts) * self.starts
        tolerance = float(given.tolerance)

        def least(excess: float) -> Point | None:
            found = [point for point in (own, *points) if point.violation <= excess]
            return min(found, key=lambda point: point.merit, default=None)

        # Within the limits to rounding is better than a little above and a little better.
        exact, near = least(_EXACT), least(tolerance)
        if near is None:
            return own, runs
        if exact is not None and exact.merit <= near.merit + 5 * tolerance:
            return exact, runs
        return near, runs

    def multipliers(self, there: FirstOrder) -> tuple[np.ndarray, np.ndarray]:
        """Multipliers ≥ 0 of the limits that hold at a design, and the Lagrangian's gradient there.

        Those that leave the smallest gradient within the bounds (first-order conditions).
        """
        shares, goal, slopes = there.point.shares, there.goal, there.slopes.T
        holding = there.point.prices / np.asarray(self.given.limits) - 1 > -_NEAR_LIMIT
        free = ~held(shares, goal, AT_BOUND)
        multipliers = np.zeros(holding.size)
        if holding.any():
            for _ in range(3):  # which bounds hold depends on the multipliers
                multipliers[holding] = nnls(slopes[free][:, holding], -goal[free])[0]
                free = ~held(shares, goal + slopes @ multipliers, AT_BOUND)
        return multipliers, goal + slopes @ multipliers
