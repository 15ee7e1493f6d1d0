"""Floors that hit columns of the neighbour, against an event-driven solver and a massless node."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.verification.case import Case, Number, with_derivative
from tests.simulation.test_columns import CASES, WITHIN, collision, errors_of

STEPS = (0.04, 0.02, 0.01)


def impacts() -> tuple[Number, ...]:
    """Largest force and speed after an impact on contact and column, by one law for both."""
    numbers = []
    for (restitution, share), within in WITHIN.items():
        by_law, by_node = (collision(share, restitution, node) for node in (False, True))
        for quantity, x, y in zip(("force", "speed after"), by_law, by_node, strict=True):
            title = f"impact, e = {restitution:g}, s = {share:g}: {quantity}"
            numbers.append(Number(title, x, y, within * y))
    return tuple(numbers)


def case(steps: Sequence[float] = STEPS, number: int = len(CASES)) -> Case:
    """Displacements and derivatives of the first systems, and single impacts."""
    steps, parts = tuple(steps), []
    for ends, side, ground in CASES[:number]:
        errors = errors_of(ends, side, ground, steps)
        storey = "first storey" if ground else "second storey"
        title = f"{ends} columns of the {side} building, {storey}"
        parts += with_derivative(title, "x", steps, errors, (4.0, 40.0))
    return Case(
        "Floors that hit columns",
        "Two storeys beside one, on rods of order 1, under three wavelets up to t = 6. A floor of "
        "one building hits a column of the other at 0.4 of the height of its storey, several "
        "times. The error of x is the norm over instants and masses, relative to that of x. The "
        "derivative is along a way on which all numbers change, masses, rods, gap, contact, E I, "
        "height and position of the impact. Single impacts are of a mass on contact and column in "
        "series, with the column's share s of the stiffness: the one law of a run beside a node "
        "without mass between the contact's spring and dashpot and the column, of which it is the "
        "limit of slow impacts.",
        "An event-driven solver with formulas of its own for the column, which restarts a "
        "Runge–Kutta method of order 8 at each touch and release; derivatives by its central "
        "differences. For impacts, the equations of the node by another method of order 5.",
        errors=tuple(parts),
        numbers=impacts(),
    )
