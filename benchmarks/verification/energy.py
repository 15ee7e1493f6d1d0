"""Energy balance: input, kinetic, stored, dissipated and what impacts took."""

from __future__ import annotations

from collections.abc import Sequence

import jaxpound as jp
from benchmarks.verification.case import Case, Errors
from benchmarks.verification.rows import NAMES
from tests.simulation.test_contact import CASES, run

STEPS = (0.02, 0.01, 0.005)
IMPACTS = ("paper_gap0.2_kelvin_clip_k1000", "row3_kelvin", "row3_newton")


def case(steps: Sequence[float] = STEPS, names: Sequence[str] = IMPACTS) -> Case:
    """Largest residual of the balance, as a share of the largest input."""
    errors = []

    def add(quantity, responses):
        shares = tuple(float(response.energy.relative_residual) for response in responses)
        errors.append(Errors(quantity, tuple(steps), shares, 20.0))

    pair, ground = jp.paper.structures(), jp.paper.ground()
    add(
        "the paper's case",
        (jp.simulate(pair, ground, jp.TimeGrid.until(20.0, h)) for h in steps),
    )
    for name in names:
        add(NAMES[name], (run(CASES[name], h) for h in steps))
    return Case(
        "Energy balance",
        "The largest residual of the energy balance during the run (kinetic energy, work of rods, "
        "friction and contact), relative to the largest energy input.",
        "The balance itself, which the exact motion satisfies.",
        errors=tuple(errors),
    )
