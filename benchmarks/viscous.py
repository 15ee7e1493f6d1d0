"""Springs and dashpots by rods of order 1, and what tau_f changes: python -m benchmarks.viscous.

Uniform buildings with 5 % damping in the first mode under El Centro, scaled to a PGA of 0.35 g,
against the exact solution of Kelvin and Voigt's storeys, whose damping is proportional to their
stiffness. ``tau_f`` is 0.01 of 1/ω of the first mode, which is the default, or a time in s.
"""

import jax
import numpy as np
from scipy.linalg import eigh
from scipy.signal import lsim

import jaxpound as jp
from benchmarks.verification.el_centro import record
from jaxpound.simulation.time_steps import chosen_step

jax.config.update("jax_enable_x64", True)
jp.runtime.use_loop_kernels()

DAMPING, FINER = 0.05, 16  # steps of the exact solution in a sample
NUMBERS, PERIODS, TAUS = (1, 5, 8), (0.5, 0.8, 1.1), (None, 1e-3, 1e-4, 1e-6)
MOST = 50_000  # steps of a run


def exact(n: int, period: float, ground: jp.Record) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies of the modes, and the peak displacement of each floor, by modal analysis."""
    storeys = np.eye(n) - np.eye(n, k=-1)  # drifts of displacements
    squares, shapes = eigh(storeys.T @ storeys)
    omega = 2 * np.pi / period * np.sqrt(squares / squares[0])
    at = float(ground.dt) * np.arange(ground.samples.size)
    times = np.linspace(0, at[-1], FINER * (at.size - 1) + 1)
    shaking = np.interp(times, at, np.asarray(ground.samples)) * jp.STANDARD_GRAVITY
    x = np.zeros((times.size, n))
    for w, shape in zip(omega, shapes.T, strict=True):
        mode = (
            [[0, 1], [-(w**2), -2 * DAMPING * w**2 / omega[0]]],
            [[0], [-shape.sum()]],
            [[1, 0]],
            0,
        )
        x += np.outer(lsim(mode, shaking, times)[1], shape)
    return omega, np.abs(x).max(axis=0)


def main() -> None:
    """Print a line for each building and relaxation time."""
    ground = record().scaled_to_pga(0.35)
    for n in NUMBERS:
        for period in PERIODS:
            omega, peaks = exact(n, period, ground)
            for tau_f in TAUS:
                frame = jp.ShearBuilding.from_period(n, 3e5, period, DAMPING, 1, tau_f)
                building, modes, k = jp.Buildings((frame,)), frame.modes(), min(n, 2) - 1
                limit, duration = jp.stability_limit(building), float(ground.duration)
                dt = chosen_step(building, jp.Scheme(), duration, ground.dt)
                of_mode = modes.periods[k] * omega[k] / 2 / np.pi - 1
                damping = modes.damping_ratios[k] / (DAMPING * omega[k] / omega[0]) - 1
                line = f"{n} storeys, {period} s, tau_f = {tau_f}: limit {1e3 * limit:.2f} ms, "
                line += f"{duration / dt:,.0f} steps; mode {k + 1}: {of_mode:+.1e}, {damping:+.1e}"
                if duration / dt < MOST:  # with steps that make no error of their own
                    grid = jp.TimeGrid.until(duration, dt / 8)
                    demand = jp.demand(building, ground, grid)
                    moved = np.array([float(mass.peak_x) for mass in demand.masses])
                    line += f"; peaks {np.abs(moved / peaks - 1).max():.1e}"
                print(line, flush=True)


if __name__ == "__main__":
    main()
