"""Probabilities of rare events against independent Monte Carlo and importance sampling."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import jaxpound as jp
from benchmarks.verification.case import Case, Number
from tests.reliability import case_w


def case(gaps: Sequence[float] = tuple(case_w.REFERENCE)) -> Case:
    """Each probability by ``rare_event``; it may be off by three standard deviations."""
    numbers = []
    for gap in gaps:
        known, cov = case_w.REFERENCE[gap]
        event = jp.rare_event(case_w.state(gap), key=1, progress=False)
        within = 3 * known * float(np.hypot(event.cov, cov))
        name = f"P(required gap > {gap:g}), {event.runs:,} runs, {event.gradients:,} gradients"
        numbers.append(Number(name, float(event.probability), known, within))
    return Case(
        "Probabilities of rare events",
        "The paper's structures under filtered white noise of 500 random numbers: the probability "
        "that the required gap exceeds a given gap, with a coefficient of variation of 10 %.",
        "Separate programs: plain Monte Carlo with a million runs (the first two) and importance "
        "sampling with up to 40,000 runs, with errors of 0.7 to 2 %.",
        numbers=tuple(numbers),
    )
