"""Eccentric floors that meet at two corners of a face, against an event-driven solver."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.verification.case import Case, with_derivative
from tests.simulation.test_torsion import CASES, errors_of

STEPS = (0.04, 0.02, 0.01)
NAMES = {"kelvin": "Kelvin and Voigt", "newton": "Newton"}


def case(steps: Sequence[float] = STEPS, number: int = len(CASES)) -> Case:
    """Displacements, rotations and derivatives of the first systems."""
    steps, parts = tuple(steps), []
    for law, *eccentricities in CASES[:number]:
        errors = errors_of(law, *eccentricities, steps=steps)
        left, right = eccentricities
        title = f"{NAMES[law]}, eccentricities {left:g} and {right:g}"
        parts += with_derivative(title, "x and rotation", steps, errors, (4.0, 30.0))
    return Case(
        "Eccentric floors that meet at two corners",
        "Two floors side by side, each with a displacement and a rotation about the vertical axis, "
        "on two frames of order 1 at y = ±0.8, under three wavelets up to t = 6. The centre of "
        "stiffness is at the eccentricity, that of mass at y = 0. The floors meet at the corners, "
        "y = ±1, where friction differs, too. The error is the norm over instants, displacements "
        "and rotations, relative to that of the solution. The derivative is along a way on which "
        "all numbers change, masses, inertias, arms, rods, friction, gaps and contact; by Newton's "
        "law it jumps at impacts, and its error is the median.",
        "An event-driven solver that restarts a Runge–Kutta method of order 8 at each touch, "
        "release and turn of the friction; derivatives by its central differences.",
        errors=tuple(parts),
    )
