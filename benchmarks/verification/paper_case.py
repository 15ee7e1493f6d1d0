"""The paper's case against an event-driven solver, by the default scheme and by the paper's."""

from __future__ import annotations

from collections.abc import Sequence

import jax
import numpy as np
from scipy.interpolate import CubicHermiteSpline

import jaxpound as jp
from benchmarks.verification.case import Case, Curve, Errors, timed
from tests.reference import load

STEPS = (0.04, 0.02, 0.01, 0.005, 0.0025)
END = 20.0


def responses(steps: Sequence[float], scheme: jp.Scheme) -> tuple[list[jp.Response], list[float]]:
    """Whole responses, and the wall time of ``demand`` alone."""
    structures, ground = jp.paper.structures(), jp.paper.ground()
    runs, seconds = [], []
    for h in steps:
        grid = jp.TimeGrid.until(END, h)
        runs.append(jp.simulate(structures, ground, grid, scheme))
        scalars = jax.jit(lambda s, g, grid=grid: jp.demand(s, g, grid, scheme).min_gap)
        seconds.append(timed(lambda scalars=scalars: scalars(structures, ground))[1])
    return runs, seconds


def displacement_error(run: jp.Response, known: dict) -> float:
    """Largest error of x1 and x2 at the reference's instants, between those of the grid."""
    t, late = np.asarray(run.time), 0.0
    for mass, exact in zip(run.masses, (known["x1"], known["x2"]), strict=True):
        x = CubicHermiteSpline(t, np.asarray(mass.x), np.asarray(mass.v))(known["t"])
        late = max(late, float(np.abs(x - exact).max()))
    return late


def phase_error(run: jp.Response, known: dict) -> float:
    """Error of the worst of all instants at which the damper stops, breaks away or turns."""
    names = {0: "stick", 1: "slip right", -1: "slip left"}
    changes = run.phases()[1:]
    if [phase.kind for phase in changes] != [names[kind] for _, kind in known["events"]]:
        return float("inf")
    both = zip(changes, known["events"], strict=True)
    return max(abs(phase.start - time) for phase, (time, _) in both)


def case(steps: Sequence[float] = STEPS, schemes: Sequence[str] = ("default", "paper's")) -> Case:
    """Smallest gap, displacements and phase changes, by step and scheme."""
    known = load("paper_case")
    errors, curves = [], []
    for name, scheme, order, constants in (
        ("default", jp.Scheme(), 2.0, (0.3, 4.0, 3.0)),
        ("paper's", jp.PAPER_SCHEME, 1.0, (1.0, 6.0, None)),
    ):
        if name not in schemes:
            continue
        runs, seconds = responses(steps, scheme)
        rest = float(jp.paper.structures().initial_gap)
        of_gap = [abs(float(run.min_gap) - rest - known["min_gap"]) for run in runs]
        of_x = [displacement_error(run, known) for run in runs]
        of_phases = [phase_error(run, known) for run in runs]
        for quantity, found, constant in zip(
            ("smallest gap", "x1 and x2", "11 phase changes"),
            (of_gap, of_x, of_phases),
            constants,
            strict=True,
        ):
            if constant:
                what = f"{quantity}, {name} scheme"
                errors.append(
                    Errors(what, tuple(steps), tuple(found), constant, order, tuple(seconds))
                )
        curves.append(Curve(PANEL, f"{name} scheme", tuple(of_gap), tuple(seconds)))
    return Case(
        "The paper's case",
        "Two blocks on fractional rods (orders 0.23 and 0.53) with a friction damper between them, "
        f"under five wavelets. The damper has twelve phases of slip and stick up to t = {END:g}.",
        "An independent event-driven solver (`jp.paper.reference()`). It represents each rod by "
        "its relaxation spectrum and integrates by a five-stage Radau method between located "
        "events; its error is below 1e-7.",
        errors=tuple(errors),
        curves=tuple(curves),
    )


PANEL = "The paper's case: smallest gap"
