"""Errors of a run with impacts, and of its derivatives, by step: python benchmarks/contact.py.

The paper's structures and ground at a gap of 0.5 with a restitution of 0.65: x1 at t = 8, and its
derivatives by gap, friction, restitution, mass ratio, τx of rod 1 and τf of rod 2 (and by the
contact's stiffness), against the finest run.
"""

from dataclasses import replace

import jax
import numpy as np

import jaxpound as jp
from jaxpound.model import parameters

jax.config.update("jax_enable_x64", True)

LAWS = {"Newton": jp.Newton(0.65), "KelvinVoigt, k = 1000": jp.KelvinVoigt(1000.0, 0.65)}
PATHS = ("initial_gap", "friction", "mass_ratio", "rod_1.tau_x", "rod_2.tau_f")
OF_LAW = ("contact.restitution", "contact.stiffness")
STEPS, FINEST = (0.04, 0.02, 0.01, 0.005, 0.0025), 0.00125


def value_and_derivatives(structures: jp.AdjacentStructures, dt: float) -> np.ndarray:
    """x1 at the end, and its derivatives in the order of the paths."""
    paths = [*PATHS, *(path for path in OF_LAW if path in parameters.paths(structures))]
    grid, ground = jp.TimeGrid.until(8.0, dt), jp.paper.ground()

    def end(values: list[jax.Array]) -> tuple[jax.Array, jax.Array]:
        changed = parameters.put(structures, dict(zip(paths, values, strict=True)))
        x = jp.simulate(changed, ground, grid).masses[0].x[-1]
        return x, x

    slopes, x = jax.jacfwd(end, has_aux=True)([parameters.get(structures, p) for p in paths])
    return np.array([x, *slopes])


def main() -> None:
    """Print a line for each law and step."""
    for name, law in LAWS.items():
        structures = replace(jp.paper.structures(), initial_gap=0.5, contact=law)
        truth = value_and_derivatives(structures, FINEST)
        size = np.abs(truth[1:]).max()
        print(f"{name}: x1 = {truth[0]:.6f}, largest derivative {size:.2f}", flush=True)
        for dt in STEPS:
            errors = np.abs(value_and_derivatives(structures, dt) - truth)
            print(
                f"  h = {dt:<6} value {errors[0]:.1e}  gradient {errors[1:].max():.1e}", flush=True
            )


if __name__ == "__main__":
    main()
