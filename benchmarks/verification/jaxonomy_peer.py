"""jaxonomy side by side: a pair on rods of order 1, with accuracy against wall time."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import jax
import numpy as np

import jaxpound as jp
from benchmarks.verification.batch import BATCH, BEST_OF, LANES, OURS
from benchmarks.verification.case import Case, Curve, Errors, timed
from benchmarks.verification.interpreters import interpreter
from benchmarks.verification.siconos_peer import END, SMOOTH, phased

TITLE = "jaxonomy side by side"
PROBLEM = (
    "Two blocks on rods of order 1, which have no memory, with a friction damper between them, "
    "under the paper's five wavelets, up to t = 20. jaxonomy integrates them from event to event, "
    "by Dormand and Prince's method of order 5 with adaptive steps, and finds the ends of stick "
    "and slip by bisection; its steps below are tolerances. jaxpound extrapolates, which makes "
    "errors as small as those of the other program. A run of a batch is one of "
    f"{LANES} slip forces by jax.vmap in both. The errors are those of the smallest gap."
)
SOURCE = "A five-stage Radau method from phase to phase."
THEIRS, THEIR_BATCH = "jaxonomy, one run", "jaxonomy, a run of a batch"
TOLERANCES = 1e-4, 1e-5, 1e-6, 1e-7, 1e-8
STEPS = 0.04, 0.02, 0.01, 0.005
FRICTIONS = 0.1, 0.4
"""Ends of the slip forces of the batch."""
PYTHON = "JAXPOUND_JAXONOMY_PYTHON"
"""Variable of the environment: the interpreter that has jaxonomy."""


def missing() -> str:
    """Why there can be no comparison, or nothing."""
    if interpreter("jaxonomy", PYTHON):
        return ""
    remedy = "pip install jaxonomy in an environment of its own, and name one by"
    return f"no Python with jaxonomy: {remedy} {PYTHON}"


def by_jaxonomy() -> tuple[list[tuple[float, ...]], str]:
    """For each tolerance the largest closing, the times of one run and of one of the batch."""
    ground = jp.paper.ground()
    problem: dict[str, Any] = {
        "periods": np.asarray(ground.periods).tolist(),
        "arrivals": np.asarray(ground.arrivals).tolist(),
        "amplitude": float(ground.amplitude),
        "rods": [[float(rod.tau_f), float(rod.tau_x)] for rod in (SMOOTH.rod_1, SMOOTH.rod_2)],
        "mass_ratio": float(SMOOTH.mass_ratio),
        "stiffness_ratio": float(SMOOTH.stiffness_ratio),
        "friction": float(SMOOTH.friction),
        "frictions": np.linspace(*FRICTIONS, LANES).tolist(),
        "end": END,
        "tolerances": TOLERANCES,
        "rounds": BEST_OF,
    }
    script = Path(__file__).parent / "jaxonomy_run.py"
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "problem.json"
        file.write_text(json.dumps(problem), encoding="utf-8")
        call = [str(interpreter("jaxonomy", PYTHON)), script, file]
        output = subprocess.run(call, check=True, capture_output=True, text=True).stdout
    answer = json.loads(output.splitlines()[-1])
    return answer["rows"], answer["version"]


def by_jaxpound() -> list[tuple[float, ...]]:
    """The same for each step."""
    ground, scheme, rows = jp.paper.ground(), jp.Scheme(extrapolated=True), []
    frictions = np.linspace(*FRICTIONS, LANES)
    for h in STEPS:
        grid = jp.TimeGrid.until(END, h)

        def closing(friction, grid=grid):
            pair = dataclasses.replace(SMOOTH, friction=friction)
            least = jp.demand(pair, ground, grid, scheme, only=("min_gap",)).min_gap
            return SMOOTH.initial_gap - least

        single, many = jax.jit(closing), jax.jit(jax.vmap(closing))
        with jax.default_device(jax.devices()[0]):
            reached, seconds = timed(lambda run=single: run(SMOOTH.friction), BEST_OF)
            crowd = timed(lambda run=many: run(frictions), BEST_OF)[1] / LANES
        rows.append((float(reached), seconds, crowd))
    return rows


def case() -> Case:
    """The pair on rods of order 1."""
    if reason := missing():
        return Case(TITLE, PROBLEM, SOURCE, skipped=reason)
    exact = phased(SMOOTH, np.array([END])).closing
    theirs, version = by_jaxonomy()
    errors, curves, panel = [], [], "Rods of order 1: smallest gap"
    for names, rows, steps, bound, order, release in (
        ((OURS, BATCH), by_jaxpound(), STEPS, 2e-3, 2, ""),
        ((THEIRS, THEIR_BATCH), theirs, TOLERANCES, 1e-4, 0, version),
    ):
        closings, seconds, crowd = zip(*rows, strict=True)
        off = tuple(abs(x - exact) for x in closings)
        quantity = f"smallest gap, {names[0].partition(',')[0]}"
        quantity += " (h: its tolerance)" if release else ""
        errors.append(Errors(quantity, steps, off, bound, order, seconds))
        for name, times in zip(names, (seconds, crowd), strict=True):
            curves.append(Curve(panel, name, off, times, release))
    return Case(TITLE, PROBLEM, SOURCE, tuple(errors), (), tuple(curves))
