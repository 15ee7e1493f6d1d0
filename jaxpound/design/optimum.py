"""First-order conditions and multipliers at a design, and polishing of the best one."""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import minimize, nnls

from jaxpound.design.lagrangian import AugmentedLagrangian, at_active_bound
from jaxpound.design.problem import Point, ProblemData

AT_BOUND = 0.005
"""Scaled distance from a bound within which a variable counts as at that bound."""

_NEAR_LIMIT = 0.01  # of the limit
_STEPS = 30  # of polishing, at most
_FAR = 1e6  # in the place of what is not finite, in units of size
_EXACT = 1e-9  # a violation that is rounding only


class FirstOrder(NamedTuple):
    """A design with derivatives by its scaled variables."""

    point: Point
    goal: np.ndarray  # gradient of minus the objective over its size, (d,)
    slopes: np.ndarray  # gradients of limited demands over their limits, (m, d)


@dataclasses.dataclass(frozen=True)
class FirstOrderConditions:
    """First-order conditions of a problem, kept for every design that was asked for.

    ``starts`` is the number of designs that the search's program has been compiled for.
    """

    lagrangian: AugmentedLagrangian
    data: ProblemData
    starts: int
    _known: dict[bytes, FirstOrder] = dataclasses.field(default_factory=dict)

    def at(self, scaled: np.ndarray) -> FirstOrder:
        """A design with its derivatives; they are computed once for each design."""
        key = scaled.tobytes()
        if key not in self._known:
            here, rows = self.lagrangian.jacobian(scaled, self.starts, self.data)
            self._known[key] = FirstOrder(here, goal=rows[0], slopes=rows[1:])
        return self._known[key]

    def polished(self, own: Point) -> tuple[Point, int]:
        """The best design found by SciPy's sequential quadratic programming, and the runs it took.

        Counted are all runs with a gradient, also of the copies that fill the search's program.
        """
        limits, size = np.asarray(self.data.limits, np.float64), float(self.data.size)
        low, high = np.asarray(self.data.box, np.float64)

        def at(scaled: np.ndarray) -> FirstOrder:
            return self.at(np.clip(scaled, low, high).astype(own.scaled.dtype))

        def double(x: Any, otherwise: float = 0.0) -> np.ndarray:  # SciPy needs float64
            return np.nan_to_num(np.asarray(x, np.float64), nan=otherwise)

        constraint = {
            "type": "ineq",
            "fun": lambda x: double(1 - at(x).point.limited / limits, -1.0),
            "jac": lambda x: -double(at(x).slopes),
        }
        minimize(
            lambda x: float(double(-at(x).point.objective / size, _FAR)),
            double(own.scaled),
            jac=lambda x: double(at(x).goal),
            bounds=[*zip(low, high, strict=True)],
            constraints=[constraint] if limits.size else (),
            method="SLSQP",
            options={"maxiter": _STEPS, "ftol": 1e-10},
        )
        met = [own, *(one.point for one in self._known.values() if np.isfinite(one.point.merit))]
        runs = len(self._known) * -(-(limits.size + 1) // self.starts) * self.starts
        tolerance = float(self.data.tolerance)

        def least(excess: float) -> Point | None:
            within = [point for point in met if point.violation <= excess]
            return min(within, key=lambda point: point.merit, default=None)

        # Prefer a design within the limits to one slightly above them with a slightly lower merit.
        exact, near = least(_EXACT), least(tolerance)
        if exact is not None and near is not None and exact.merit <= near.merit + 5 * tolerance:
            return exact, runs
        return own if near is None else near, runs

    def multipliers(self, point: Point) -> tuple[np.ndarray, np.ndarray]:
        """Multipliers ≥ 0 of the active limits at a design, and the Lagrangian's gradient there.

        The multipliers are those with the smallest gradient over variables at no active bound.
        """
        _, goal, slopes = self.at(point.scaled)
        holding = point.limited / np.asarray(self.data.limits) - 1 > -_NEAR_LIMIT
        multipliers, gradient = np.zeros(holding.size), goal
        box = np.asarray(self.data.box)
        for _ in range(3):  # which bounds are active depends on the multipliers
            free = ~at_active_bound(point.scaled, gradient, box, AT_BOUND)
            if holding.any():
                multipliers[holding] = nnls(slopes[holding][:, free].T, -goal[free])[0]
            gradient = goal + multipliers @ slopes
        return multipliers, gradient
