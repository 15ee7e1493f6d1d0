"""Derivatives through stick, slip and impacts against those of event-driven solutions."""

from __future__ import annotations

from collections.abc import Sequence

import jax
import numpy as np

import jaxpound as jp
from benchmarks.verification.case import Case, Errors, refine
from tests.reference import paper_gradient
from tests.simulation import test_contact
from tests.simulation.pairs import in_unit_of_time

STEPS = (0.04, 0.02, 0.01, 0.005)


def of_pair_that_collides() -> tuple[np.ndarray, np.ndarray]:
    """Of peak force and end by the pair's parameters at these steps, and those of the reference.

    As shares of the largest for each of the three, by step, parameter and result.
    """
    case = test_contact.CASES["paper_gap0.5_kelvin_k1000"]
    grid, ground = jp.TimeGrid(test_contact.STEPS[0], 4000), test_contact.ground_of(case)

    def outputs(structures, unit):
        system, shaking = in_unit_of_time(unit, structures.system(), ground)
        response = jp.simulate(system, shaking, grid)
        end = jax.numpy.round(case["T"] / (grid.dt * unit)).astype(int)
        x1, x2 = (mass.x[end] for mass in response.masses)
        return jax.numpy.stack([response.demand.links[0].peak_contact / unit**2, x1, x2])

    slopes = jax.jit(jax.vmap(jax.jacfwd(outputs), (None, 0)))
    ours = slopes(
        test_contact.floats(test_contact.system_of(case)),
        jax.numpy.array(test_contact.STEPS) / grid.dt,
    )
    by_name = {
        "gap0": ours.initial_gap,
        "mu": ours.friction,
        "e": ours.contact.restitution,
        "k": ours.contact.stiffness,
        "rho": ours.mass_ratio,
        "eps": ours.stiffness_ratio,
        "tfa": ours.rod_1.tau_f,
        "txa": ours.rod_1.tau_x,
        "al": ours.rod_1.order,
    }
    which = [case["derivatives_of"].index(x) for x in ("peak_force[0]", "x_end[0]", "x_end[1]")]
    for name in by_name:
        assert np.array(case["derivatives"][name]["smooth"])[which].all()
    exact = np.array([np.array(case["derivatives"][name]["value"])[which] for name in by_name])
    largest = np.abs(exact).max(0)
    return np.stack([*by_name.values()], 1) / largest, exact / largest


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
        ours, exact = of_pair_that_collides()
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
