"""Pairs, rows and storeys with impacts and friction against an event-driven solver."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.verification.case import Case, Errors, timed
from tests.simulation.test_contact import CASES, errors, run

STEPS = (0.02, 0.01, 0.005)
NAMES = {
    "paper_gap0.2_kelvin_clip_k1000": "the paper's pair, Kelvin and Voigt, 3 impacts",
    "row3_kelvin": "a row of three, Kelvin and Voigt, 8 impacts",
    "row3_newton": "a row of three, Newton, 15 impacts",
    "storeys_2_3_kelvin": "2 beside 3 storeys, Kelvin and Voigt, 11 impacts",
}


def case(steps: Sequence[float] = STEPS, names: Sequence[str] = tuple(NAMES)) -> Case:
    """Displacements of all masses, root mean square over them and 40 instants."""
    found = []
    for name in names:
        known = CASES[name]
        off, seconds = [], []
        for h in steps:
            response, shortest = timed(lambda h=h, known=known: run(known, h))
            off.append(float(np.sqrt((errors(known, response, h) ** 2).mean())))
            seconds.append(shortest)
        found.append(Errors(NAMES[name], tuple(steps), tuple(off), 2.5, 2, tuple(seconds)))
    return Case(
        "Pairs, rows and storeys with impacts",
        "Fractional rods, friction dampers and contact together, under five wavelets up to t = 20. "
        "The error is the root mean square of the displacements of all masses at 40 instants.",
        "An independent event-driven solver, which represents rods by their relaxation spectra and "
        "integrates by a five-stage Radau method between located events of slip and contact. Its "
        "runs with other tolerances differ by less than 1e-6.",
        errors=tuple(found),
    )
