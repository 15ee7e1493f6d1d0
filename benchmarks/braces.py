"""Errors of a viscous damper on its brace, by step and brace: python benchmarks/braces.py.

A mass of 10 t on a spring, with a period of 0.5 s, and a linear dashpot c of 10 % damping on braces
of 10, 100 and 1000 times the spring's stiffness, under a wavelet: the largest error of the
displacement, as a share of the largest displacement, against the exact solution.
"""

import jax
import jax.numpy as jnp
import numpy as np
from scipy.signal import lsim

import jaxpound as jp

jax.config.update("jax_enable_x64", True)

MASS, PERIOD, DAMPING, DURATION = 1e4, 0.5, 0.1, 4.0
SPRING = MASS * (2 * np.pi / PERIOD) ** 2
DASHPOT = 2 * DAMPING * (SPRING * MASS) ** 0.5
GROUND = jp.Ricker(0.3 * jp.STANDARD_GRAVITY, 0.9, 2.0)
RATIOS, STEPS, FINEST = np.array([10.0, 100.0, 1000.0]), (4e-3, 2e-3, 1e-3, 5e-4), 2.0**-15


def displacement(brace: jax.Array, dt: float) -> jax.Array:
    """Of the mass at the instants."""
    base, elastic = (0, jp.GROUND), jp.ZenerRod(order=1.0, tau_f=1e-9, tau_x=1e-9)
    damper = jp.Rod(jp.PowerLaw(DASHPOT, exponent=1.0), brace, base)
    system = jp.System((MASS,), (jp.Rod(elastic, SPRING, base), damper))
    return jp.simulate(system, GROUND, jp.TimeGrid.until(DURATION, dt)).masses[0].x


def exact(brace: float) -> tuple[np.ndarray, np.ndarray]:
    """Fine instants and displacements, for ground accelerations that are linear between them."""
    rates = [[0, 1, 0], [-SPRING / MASS, 0, -1 / MASS], [0, brace, -brace / DASHPOT]]
    system = rates, [[0], [-1], [0]], [[1, 0, 0]], [[0]]
    times = np.arange(0, DURATION + FINEST, FINEST)
    shaking = jax.vmap(GROUND.acceleration)(jnp.asarray(times))
    return times, lsim(system, np.asarray(shaking), times)[1]


def main() -> None:
    """Print a line for each brace."""
    errors, truths = {}, [exact(ratio * SPRING) for ratio in RATIOS]
    for dt in STEPS:
        x = jax.vmap(lambda brace, dt=dt: displacement(brace, dt))(jnp.asarray(RATIOS * SPRING))
        times = dt * np.arange(x.shape[-1])
        for ratio, of_brace, truth in zip(RATIOS, x, truths, strict=True):
            error = np.abs(of_brace - np.interp(times, *truth)).max() / np.abs(truth[1]).max()
            steps = dt * ratio * SPRING / DASHPOT
            errors.setdefault(ratio, []).append(f"{error:.1e} (h K/c = {steps:.3g})")
    for ratio, cells in errors.items():
        print(f"K/k = {ratio:g}:", ", ".join(cells))


if __name__ == "__main__":
    main()
