"""Probabilities of rare events against independent Monte Carlo and importance sampling."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.verification.case import Case, Number
from jaxpound.risk.run import event_of
from tests.risk import case_w


def case(gaps: Sequence[float] = tuple(case_w.REFERENCE)) -> Case:
    """Each probability by ``rare_event``; it may be off by three standard deviations."""
    numbers = []
    for gap in gaps:
        known, cov = case_w.REFERENCE[gap]
        event = event_of(case_w.state(gap), key=1, progress=False)
        within = 3 * known * float(np.hypot(event.cov, cov))
        name = f"P(required gap > {gap:g}), {event.runs:,} runs, {event.gradients:,} gradients"
        numbers.append(Number(name, float(event.probability), known, within))
    return Case(
        "Probabilities of rare events",
        "The paper's structures in filtered white noise of 500 random numbers: the probability "
        "that they would need more than a given gap, to a coefficient of variation of 10 %.",
        "Plain Monte Carlo of a million runs (the first two) and importance sampling of up to "
        "40,000 runs by separate programs, to 0.7 to 2 %.",
        numbers=tuple(numbers),
    )
