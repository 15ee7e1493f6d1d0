"""Fractional rods against the inverse Laplace transform."""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

import jaxpound as jp
from benchmarks.verification.case import Case, Errors, refine
from tests.reference import load

STEPS = (0.05, 0.025, 0.0125, 0.00625)
END = 20.0


def case(steps: Sequence[float] = STEPS) -> Case:
    """One mass on either rod of the paper, under a constant ground acceleration from t = 0."""
    known = [load("rods")[name] for name in ("rod_1", "rod_2")]
    times = np.array([float(t) for t in known[0]["step_response"]])
    exact = np.array([[*one["step_response"].values()] for one in known])
    materials = jp.ZenerRod(*(jnp.array([one[k] for one in known]) for k in _LAW))
    stiffness = jnp.array([float(one["stiffness"]) for one in known])

    def run(step: float):
        grid = jp.TimeGrid.until(END, step)

        @jax.jit
        @jax.vmap
        def moved(material, k):
            system = jp.System((1.0,), (jp.Rod(material, k, (0, jp.GROUND)),))
            return jp.simulate(system, lambda t: 1.0, grid).masses[0].x

        return lambda: moved(materials, stiffness)

    found, seconds = refine(steps, run)
    errors = [
        np.abs(np.asarray(x)[:, np.round(times / h).astype(int)] - exact).max(1)
        for x, h in zip(found, steps, strict=True)
    ]
    return Case(
        "Fractional rods",
        "A mass on a fractional Zener rod is at rest until t = 0; from then on a constant ground "
        "acceleration of 1 acts on it. The rods are rods 1 and 2 of the paper (orders 0.23 and "
        f"0.53). The displacement is compared at {times.size} instants up to t = {END:g}.",
        "The exact Laplace transform of the equation of motion, inverted numerically by two "
        "methods that agree.",
        errors=tuple(
            Errors(f"x of rod {i + 1}", tuple(steps), tuple(map(float, of_one)), 0.3, 2.0, seconds)
            for i, of_one in enumerate(np.array(errors).T)
        ),
    )


_LAW = ("order", "tau_f", "tau_x")
