"""Decks on supports that move apart, against an event-driven solver."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.verification.case import Case, with_derivative
from tests.simulation.test_supports import CASES, errors_of

STEPS = (0.04, 0.02, 0.01)
NAMES = {"kelvin": "Kelvin and Voigt", "newton": "Newton"}


def case(steps: Sequence[float] = STEPS, number: int = len(CASES)) -> Case:
    """Displacements and derivatives of the first systems."""
    steps, parts = tuple(steps), []
    for law, sliding in CASES[:number]:
        errors = errors_of(law, sliding, steps=steps)
        title = f"{NAMES[law]}, {'friction in both' if sliding else 'three'} joints"
        parts += with_derivative(title, "displacements", steps, errors, (4.0, 30.0))
    return Case(
        "Decks on supports that move apart",
        "Two decks on rods of order 1, one of them on both supports, under three wavelets up to "
        "t = 6; support 1 moves by −0.7 of the motion of support 0. There are joints with gaps "
        "between the decks and at the abutment of support 1, with friction or, without, at that "
        "of support 0, too, so that joints close a ring. The error is the norm over instants and "
        "decks, relative to that of the solution. The derivative is along a way on which all "
        "numbers change, masses, rods, friction, gaps and contact; by Newton's law it jumps at "
        "impacts, and its error is the median.",
        "An event-driven solver that restarts a Runge–Kutta method of order 8 at each touch, "
        "release and turn of the friction, of a system with a mass of 10¹⁰ in the place of support "
        "1; derivatives by its central differences.",
        errors=tuple(parts),
    )
