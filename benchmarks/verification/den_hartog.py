"""Den Hartog's oscillator: forced vibration with Coulomb friction, in closed form."""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

import jaxpound as jp
from benchmarks.verification.case import Case, Errors, Number, refine
from tests.reference import load

STEPS = (0.04, 0.02, 0.01, 0.005)
END = 24.0


def steady(r: float, b: float) -> tuple[float, float]:
    """Amplitude X of the steady motion, and the phase φ of the force cos(r t + φ) at its turn."""
    v, u = 1 / (1 - r**2), np.sin(np.pi / r) / (r * (1 + np.cos(np.pi / r)))
    amplitude = np.sqrt(v**2 - (b * u) ** 2)
    return amplitude, np.arctan2(-b * u / v, amplitude / v)


def motion(t: np.ndarray, r: float, b: float) -> np.ndarray:
    """y(t) from its turn at t = 0 on: half a cycle in closed form, and its mirror image."""
    _, phase = steady(r, b)
    half = np.pi / r
    since, sign = t % half, (-1.0) ** (t // half)
    free = -b * np.cos(since) - b * np.tan(half / 2) * np.sin(since)
    return sign * (b + free + np.cos(r * since + phase) / (1 - r**2))


def case(steps: Sequence[float] = STEPS) -> Case:
    """All five cases of the reference at once, from a turn of their steady motion on."""
    cases = load("den_hartog")["cases"]
    rs, bs = (np.array([one[k] for one in cases]) for k in "rb")
    starts = np.array([steady(r, b) for r, b in zip(rs, bs, strict=True)])
    elastic = jp.Rod(jp.ZenerRod(1.0, 0.1, 0.1), 1.0, (0, jp.GROUND))

    def run(step: float):
        grid = jp.TimeGrid.until(END, step)

        @jax.jit
        @jax.vmap
        def moved(r, b, amplitude, phase):
            system = jp.System((1.0,), (elastic,), (jp.Link((0, jp.GROUND), b),))
            start = jp.InitialState((amplitude,))
            shaken = jp.simulate(system, lambda t: -jnp.cos(r * t + phase), grid, initial=start)
            return shaken.masses[0].x

        return lambda: moved(rs, bs, *starts.T)

    found, seconds = refine(steps, run)
    errors = []
    for x, h in zip(found, steps, strict=True):
        t = h * np.arange(x.shape[1])
        exact = np.array([motion(t, r, b) for r, b in zip(rs, bs, strict=True)])
        errors.append(float(np.abs(np.asarray(x) - exact).max()))
    late = np.asarray(found[-1])[:, -round(2 * np.pi / rs.min() / steps[-1]) :]
    return Case(
        "Den Hartog's oscillator",
        "The steady motion without stops of y″ + y + b sgn(y′) = cos(r t + φ), up to "
        f"t = {END:g}. It starts from an initial displacement at a turning point.",
        "Den Hartog (1931): closed forms of the motion between turning points and of its "
        "amplitude X.",
        errors=(Errors("y, worst of five r and b", tuple(steps), tuple(errors), 2.0, 2, seconds),),
        numbers=tuple(
            Number(f"X at r = {r:g}, b = {b:g}", float(np.ptp(x) / 2), one["X"], 2 * steps[-1] ** 2)
            for x, one, r, b in zip(late, cases, rs, bs, strict=True)
        ),
    )
