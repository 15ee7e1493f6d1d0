"""Derivatives through stick, slip and impacts against those of event-driven solutions."""

from __future__ import annotations

from collections.abc import Sequence

import jax
import numpy as np

import jaxpound as jp
from benchmarks.verification.case import Case, Errors, refine
from tests.reference import paper_gradient
from tests.simulation import test_contact

STEPS = (0.04, 0.02, 0.01, 0.005)


def case(steps: Sequence[float] = STEPS, contact: bool = True) -> Case:
    """Nine derivatives of the paper's smallest gap; with ``contact``, of a pair that collides."""
    structures, ground = jp.paper.structures(), jp.paper.ground()
    structures = jax.tree.map(lambda x: jax.numpy.asarray(x, float), structures)

    def run(step: float):
        grid = jp.TimeGrid.until(20.0, step)
        slopes = jax.jit(jax.grad(lambda s: jp.demand(s, ground, grid).min_gap))
        return lambda: slopes(structures)

    found, seconds = refine(steps, run)
    worst = []
    for slopes in found:
        pairs = paper_gradient(slopes).values()
        worst.append(max(abs(ours - exact) for ours, exact in pairs))
    errors = [
        Errors(
            "9 derivatives of the smallest gap, largest error",
            tuple(steps),
            tuple(worst),
            5.0,
            2.0,
            seconds,
        )
    ]
    if contact:
        ours, exact = test_contact.derivatives()
        rms = np.sqrt(((ours - exact) ** 2).mean((1, 2)))
        errors.append(
            Errors(
                "with two impacts: 9 derivatives of the peak force and of the final x1 and x2, "
                "relative to their largest, root mean square",
                test_contact.STEPS,
                tuple(rms.tolist()),
                60.0,
            )
        )
    return Case(
        "Derivatives",
        "The paper's case: derivatives of the smallest gap with respect to friction, four "
        "relaxation times, two orders and the ratios of stiffness and mass, in reverse mode "
        "through all changes between stick and slip. With contact by the law of Kelvin and Voigt "
        "at a gap of 0.5: derivatives of the peak contact force and of the final x1 and x2 with "
        "respect to gap, friction, restitution, contact stiffness and five more parameters.",
        "Central differences of the event-driven reference solutions, with errors of about 1e-5.",
        errors=tuple(errors),
    )
