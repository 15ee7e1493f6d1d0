"""A linear pair with a friction link from phase to phase of stick and slip, by SciPy."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from benchmarks.verification.maxwell import Pair


class Motion(NamedTuple):
    """What happens from rest on."""

    x: NDArray
    """x1 and x2 at the instants asked for, shape (instants, 2)."""
    closing: float
    """The largest x1 − x2."""
    changes: list[tuple[float, int]]
    """Instants of all changes of phase, and the sign of x1′ − x2′ after them (0: stick)."""


def motion(
    pair: Pair,
    acceleration: Callable[[float], float],
    times: NDArray,
    tolerance: float = 1e-9,
) -> Motion:
    """Integrate by five-stage Radau, each phase to its end, up to the last of the instants."""
    free, both = pair.first_order(), np.diag(pair.mass)[:2]
    push = np.zeros(len(free))  # of friction of 1
    push[2:4] = -1 / both[0], 1 / both[1]
    shaken = np.zeros(len(free))
    shaken[2:4] = -1.0
    hold = (free[2] - free[3]) / (push[3] - push[2])  # times y: the friction that keeps the speeds
    stuck = free + np.outer(push, hold)
    limit, end = pair.friction, float(times[-1])

    def exceeded(way: int):
        def event(t, y):
            return way * (hold @ y) - limit

        event.terminal, event.direction = True, 1
        return event

    def stopped(way: int):
        def event(t, y):
            return way * (y[2] - y[3])

        event.terminal, event.direction = True, -1
        return event

    t, y, phase, changes = 0.0, np.zeros(len(free)), 0, []
    x, closing = np.zeros((len(times), 2)), 0.0
    while True:
        matrix = free if phase else stuck
        run = solve_ivp(
            lambda t, y, a=matrix, q=phase * limit: a @ y + q * push + shaken * acceleration(t),
            (t, end),
            y,
            "Radau",
            jac=matrix,
            events=[stopped(phase)] if phase else [exceeded(1), exceeded(-1)],
            dense_output=True,
            rtol=tolerance,
            atol=tolerance / 100,
        )
        for i in np.flatnonzero((times > t) & (times <= run.t[-1])):
            x[i] = run.sol(times[i])[:2]
        t, y = run.t[-1], run.y[:, -1]
        closing = max(closing, float(y[0] - y[1]))  # largest where slip ends
        if run.status != 1:
            return Motion(x, closing, changes)
        if phase:
            y[2:4] = both @ y[2:4] / both.sum()
        force = hold @ y
        phase = int(np.sign(force)) if not phase or abs(force) > limit else 0
        changes.append((float(t), phase))
