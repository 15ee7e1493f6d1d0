"""Siconos side by side: the paper's pair and one of order 1, with accuracy against wall time."""

from __future__ import annotations

import dataclasses
import functools
import os
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline, CubicSpline

import jaxpound as jp
from benchmarks.verification import opensees_peer
from benchmarks.verification.batch import BATCH, BEST_OF, OURS, seconds_a_run
from benchmarks.verification.case import ROUNDS, Case, Curve, Errors, Number, timed
from benchmarks.verification.interpreters import interpreter
from benchmarks.verification.maxwell import BAND, BRANCHES, pair
from benchmarks.verification.phases import Motion, motion
from tests.reference import load

TITLE = "Siconos side by side"
PROBLEM = (
    "Two blocks with a friction damper between them, under the paper's five wavelets, up to "
    "t = 20. There are three systems: the paper's fractional rods; the same rods with a gap of 0.5 "
    "that closes twice, and impacts by Newton's law with a restitution of 0.65; and rods of order "
    "1. Siconos steps by the scheme of Moreau and Jean (θ = 1/2), with friction and impacts as "
    "set-valued laws. It has no fractional rod: each rod is a spring, a dashpot and "
    f"{BRANCHES} Maxwell branches, fitted by non-negative least squares to the complex modulus at "
    f"frequencies of {10 ** BAND[0]:g} to {10 ** BAND[1]:g}. For rods of order 1 one branch is "
    "exact. OpenSees, if it is installed, runs the system with rods of order 1; its friction is an "
    "ElasticPP spring 1/h² times as stiff as the first rod, half of the stability limit of its "
    "explicit rule. The errors are those of the damper's displacement x1 − x2 (largest of 40 "
    "instants) and of the smallest gap, which Siconos has at the instants of its steps."
)
SOURCE = (
    "Event-driven solvers: for the fractional rods those of the paper's case and of the impacts, "
    "which have the exact spectra of the rods; for order 1 a five-stage Radau method from phase to "
    "phase. The same method with the fitted branches gives the error of the fit alone (last table)."
)
THEIRS = "Siconos, one run"
STEPS = {
    OURS: (0.04, 0.02, 0.01, 0.005),
    THEIRS: (0.01, 0.005, 0.002, 0.001, 0.0005, 0.0002),
    opensees_peer.THEIRS: (0.01, 0.005, 0.002, 0.001, 0.0005, 0.0002),
}
END = 20.0
FAR = 1000.0
"""A gap that stays open."""
MODULE, PYTHON = "siconos.kernel", "JAXPOUND_SICONOS_PYTHON"
"""What it imports, and the variable of the environment that names its interpreter."""
SMOOTH = dataclasses.replace(
    jp.paper.structures(),
    rod_1=jp.ZenerRod(order=1.0, tau_f=0.1, tau_x=0.4),
    rod_2=jp.ZenerRod(order=1.0, tau_f=0.2, tau_x=0.6),
)
"""The pair on rods of order 1."""


class Problem(NamedTuple):
    """A pair, x1 − x2 at some instants, its smallest gap, and what errors must not exceed."""

    name: str
    structures: jp.AdjacentStructures
    times: NDArray
    closing: NDArray
    min_gap: float | None
    ours: float
    theirs: float
    """Bounds of the errors of x1 − x2, jaxpound's over step², the peers' over step."""


def problems() -> tuple[Problem, ...]:
    """The three pairs."""
    paper, known = jp.paper.structures(), load("paper_case")
    touching = dataclasses.replace(paper, initial_gap=0.5, contact=jp.Newton(0.65))
    impacts = load("contact")["cases"]["paper_gap0.5_newton_e0.65"]
    times = np.linspace(0.5, END, 40)
    smooth = phased(SMOOTH, times)
    t, of_paper = np.array(known["t"]), np.subtract(known["x1"], known["x2"])
    least = float(paper.initial_gap) + known["min_gap"], float(SMOOTH.initial_gap) - smooth.closing
    of_impacts, of_smooth = np.subtract(*impacts["x"]), smooth.x[:, 0] - smooth.x[:, 1]
    return (
        Problem("the paper's pair", paper, t, of_paper, least[0], 4.0, 1.0),
        Problem("the pair with impacts", touching, times, of_impacts, None, 12.0, 10.0),
        Problem("rods of order 1", SMOOTH, times, of_smooth, least[1], 1.0, 1.0),
    )


def phased(structures: jp.AdjacentStructures, times: NDArray) -> Motion:
    """The motion of a pair's Maxwell branches from phase to phase."""
    samples = np.linspace(0, END, 40_001)  # the spline is right to 1e-10, and quick to call
    shaking = CubicSpline(samples, np.asarray(jp.paper.ground().acceleration(samples)))
    return motion(pair(structures), shaking, times)


def missing() -> str:
    """Why there can be no comparison, or nothing."""
    if interpreter(MODULE, PYTHON):
        return ""
    return f"no Python with Siconos: apt install python3-siconos, or name one by {PYTHON}"


def peer(
    structures: jp.AdjacentStructures, steps: Sequence[float], rounds: int = ROUNDS
) -> tuple[list[NDArray], tuple[float, ...], str]:
    """Motions by Siconos (x1, x2, v1, v2 by instant), wall times of the loop, and its version."""
    ground, inputs = jp.paper.ground(), pair(structures)._asdict()
    contact = structures.contact
    for i, h in enumerate(steps):
        velocity = np.asarray(ground.velocity(h * np.arange(round(END / h) + 1)))
        inputs[f"acceleration_{i}"] = np.diff(velocity) / h
    inputs |= {
        "steps": np.array(steps),
        "rounds": rounds,
        "gap": float(structures.initial_gap),
        "restitution": float(contact.restitution) if contact else np.nan,
    }
    script = Path(__file__).parent / "siconos_run.py"
    one_core = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    with tempfile.TemporaryDirectory() as folder:
        problem, motions_file = Path(folder) / "problem.npz", Path(folder) / "found.npz"
        np.savez(problem, **inputs)
        call = [interpreter(MODULE, PYTHON), script, problem, motions_file]
        subprocess.run(call, check=True, capture_output=True, env={**os.environ, **one_core})
        with np.load(motions_file) as motions:
            runs = [motions[f"motion_{i}"] for i in range(len(steps))]
            return runs, tuple(motions["seconds"].tolist()), str(motions["version"])


def closing_error(problem: Problem, h: float, moved: NDArray) -> float:
    """The largest of x1 − x2 at the instants known, between those of the grid by their speeds."""
    x1, x2, v1, v2 = moved.T
    found = CubicHermiteSpline(h * np.arange(len(moved)), x1 - x2, v1 - v2)(problem.times)
    return float(np.abs(found - problem.closing).max())


class Runs(NamedTuple):
    """Errors and wall times by step of a program."""

    closing: tuple[float, ...]
    min_gap: tuple[float, ...]
    seconds: tuple[float, ...]
    crowd: tuple[float, ...] = ()
    """Of a run of a batch."""
    version: str = ""
    """Of the program."""


def by_jaxpound(problem: Problem) -> Runs:
    """The default scheme of jaxpound."""
    ground, structures, rows = jp.paper.ground(), problem.structures, []
    for h in STEPS[OURS]:
        grid = jp.TimeGrid.until(END, h)

        @jax.jit
        def run(structures, grid=grid):
            response = jp.simulate(structures, ground, grid)
            left, right = response.masses
            return jnp.stack([left.x, right.x, left.v, right.v], axis=1), response.min_gap

        (moved, least), seconds = timed(lambda run=run: run(structures), BEST_OF)
        of_gap = abs(float(least) - (problem.min_gap or 0.0))
        of_closing = closing_error(problem, h, np.asarray(moved))
        crowd = seconds_a_run(structures, ground, grid, one_core=True)
        rows.append((of_closing, of_gap, seconds, crowd))
    return Runs(*zip(*rows, strict=True))


def by_siconos(problem: Problem) -> Runs:
    """Siconos on the Maxwell branches; the smallest gap is that of its instants."""
    found, seconds, version = peer(problem.structures, STEPS[THEIRS])
    rest, least = float(problem.structures.initial_gap), problem.min_gap or 0.0
    of_gap = (abs(rest + float((x[:, 1] - x[:, 0]).min()) - least) for x in found)
    both = zip(STEPS[THEIRS], found, strict=True)
    of_closing = tuple(closing_error(problem, h, x) for h, x in both)
    return Runs(of_closing, tuple(of_gap), seconds, version=version)


def by_opensees(problem: Problem) -> Runs:
    """OpenSees on rods of order 1, as it takes rows: the buildings are of one storey, in SI.

    Its friction spring has a stiffness of 1/h², in those of the first rod: half of what is stable.
    Softer ones make larger errors, in proportion to the root of their compliance.
    """
    _, module, ops = opensees_peer.scripts()
    pairs, ground = problem.structures, jp.paper.ground()
    masses, moduli = (1.0, 1 / pairs.mass_ratio), (1.0, pairs.stiffness_ratio)
    buildings = tuple(
        jp.ShearBuilding.of_storeys([m], k, 1.0, rod.tau_f, rod.tau_x)
        for m, k, rod in zip(masses, moduli, (pairs.rod_1, pairs.rod_2), strict=True)
    )
    row = buildings, jp.floor_links(buildings, friction=pairs.friction, gap=FAR)
    off, times = [], []
    for h in STEPS[opensees_peer.THEIRS]:
        samples = ground.acceleration(h * np.arange(round(END / h) + 1)) / jp.STANDARD_GRAVITY
        call = functools.partial(
            module.peer, ops, row, jp.Record(samples, h), "explicit", h**-2, h, problem.times
        )
        x, seconds = timed(call)
        off.append(float(np.abs(x[:, 0] - x[:, 1] - problem.closing).max()))
        times.append(seconds)
    return Runs(tuple(off), (), tuple(times), version=ops.version())


def compared(problem: Problem) -> tuple[list[Errors], list[Curve]]:
    """Errors and curves of all programs that there are for a pair."""
    programs = {OURS: by_jaxpound, THEIRS: by_siconos}
    if problem.structures is SMOOTH and not opensees_peer.missing():
        programs[opensees_peer.THEIRS] = by_opensees
    errors, curves, panel = [], [], f"{problem.name.capitalize()}: x1 − x2"
    for program, run in programs.items():
        runs, steps = run(problem), STEPS[program]
        order, bound = (2, problem.ours) if program == OURS else (1, problem.theirs)
        who = program.partition(",")[0]
        quantity = f"{problem.name}: x1 − x2, {who}"
        errors.append(Errors(quantity, steps, runs.closing, bound, order, runs.seconds))
        if problem.min_gap is not None and runs.min_gap:
            quantity = f"{problem.name}: smallest gap, {who}"
            errors.append(Errors(quantity, steps, runs.min_gap, bound, order, runs.seconds))
        curves.append(Curve(panel, program, runs.closing, runs.seconds, runs.version))
        if runs.crowd:
            curves.append(Curve(panel, BATCH, runs.closing, runs.crowd))
    return errors, curves


def fit(problem: Problem) -> Number:
    """What the fit of the fractional rods costs, without any error of a step."""
    found = phased(problem.structures, problem.times).x
    off = np.abs(found[:, 0] - found[:, 1] - problem.closing).max()
    return Number("largest error of x1 − x2 due to the fit alone", float(off), 0.0, 5e-6)


def case() -> Case:
    """The three pairs."""
    reason = missing()
    if reason:
        return Case(TITLE, PROBLEM, SOURCE, skipped=reason)
    known = problems()
    found = [compared(problem) for problem in known]
    errors = sorted((one for part, _ in found for one in part), key=lambda one: -one.order)
    curves = tuple(one for _, part in found for one in part)
    return Case(TITLE, PROBLEM, SOURCE, tuple(errors), (fit(known[0]),), curves)
