"""Free vibration with Coulomb friction, from an initial displacement or velocity until it stops."""

from __future__ import annotations

from collections.abc import Sequence

import jax
import numpy as np

import jaxpound as jp
from benchmarks.verification.case import Case, Errors, refine
from tests.simulation.test_initial import ONE, STILL, coulomb

STEPS = (0.05, 0.025, 0.0125, 0.00625)
END, FRICTION = 18.0, 0.1
STARTS = np.array([(1.05, 0.0), (1.0, -0.3), (0.45, 0.2), (0.05, 0.3)])


def case(steps: Sequence[float] = STEPS) -> Case:
    """Four starts at once."""

    def run(step: float):
        grid = jp.TimeGrid.until(END, step)
        bearing = jp.System(ONE.masses, ONE.rods, (jp.Link((0, jp.GROUND), FRICTION),))

        @jax.jit
        @jax.vmap
        def moved(x, v):
            start = jp.InitialState((x,), (v,))
            return jp.simulate(bearing, STILL, grid, initial=start).masses[0].x

        return lambda: moved(*STARTS.T)

    found, seconds = refine(steps, run)
    errors, ends = [], []
    for x, h in zip(found, steps, strict=True):
        t = h * np.arange(x.shape[1])
        exact = np.array([coulomb(t, *start, FRICTION)[0] for start in STARTS])
        errors.append(float(np.sqrt(np.mean((np.asarray(x) - exact) ** 2))))
        ends.append(float(np.abs(np.asarray(x)[:, -1] - exact[:, -1]).max()))
    return Case(
        "Coulomb decay",
        "A block on an elastic rod and a sliding bearing, x″ + x + 0.1 sgn(x′) = 0, starts from "
        "four initial displacements and velocities and moves until it stops. The rod starts "
        "relaxed.",
        "Between turning points the motion is a cosine about ∓0.1; the amplitude decreases by 0.4 "
        "in each cycle.",
        errors=(
            Errors("x, root mean square", tuple(steps), tuple(errors), 0.2, 2, seconds),
            Errors("x at rest, worst of four", tuple(steps), tuple(ends), 0.5, 2),
        ),
    )
