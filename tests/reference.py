"""Independent references: numbers from other solvers, and the paper's algorithm in plain NumPy."""

import functools
import json
from pathlib import Path

import numpy as np

import jaxpound as jp

_FOLDER = Path(__file__).parent / "oracles"
LAWS = {"kelvin": lambda k, e: jp.KelvinVoigt(k, e, tension=True), "kelvin_clip": jp.KelvinVoigt}
LAWS |= {"hertz": lambda k, _: jp.Hertz(k), "hertzdamp_exact": jp.HertzDamped}
for suffix, damping in {"": "muthukumar", "_hc": "hunt-crossley", "_flores": "ye"}.items():
    LAWS[f"hertzdamp{suffix}"] = functools.partial(jp.HertzDamped, damping=damping)
LAWS |= {"jankowski": jp.Jankowski, "newton": lambda _, e: jp.Newton(e)}
"""Laws of contact of a stiffness and a restitution, by their names in ``contact.json``."""


def load(name):
    """One of the reference files; each says in its note how it was made and how far to trust it."""
    return json.loads((_FOLDER / f"{name}.json").read_text())


def convergence_order(steps, errors):
    """Slope of log(error) over log(step), by least squares."""
    return np.polyfit(np.log(steps), np.log(errors), 1)[0]


def paper_gradient(derivative):
    """The nine reference derivatives of min gap next to those in an ``AdjacentStructures``."""
    reference, rods = load("paper_case")["grad_min_gap"], (derivative.rod_1, derivative.rod_2)
    ours = {"mu": derivative.friction, "al": rods[0].order, "be": rods[1].order}
    ours |= {"txa": rods[0].tau_x, "tfa": rods[0].tau_f, "txb": rods[1].tau_x, "tfb": rods[1].tau_f}
    ours |= {"eps": derivative.stiffness_ratio, "rho": derivative.mass_ratio}
    return {name: (float(ours[name]), reference[name]) for name in reference}


def paper_algorithm(structures, acceleration, dt, n_steps):
    """Eqs. (10)–(12) as the paper steps them, with h^−β in eq. (10)'s second line.

    Central differences in positions, Grünwald–Letnikov sums by a double loop, and a phase that is
    stick or slip for whole steps. Returns x1, x2 and q at every instant.
    """
    s, h, n = structures, dt, n_steps
    rods = [(s.rod_1, 1.0), (s.rod_2, s.stiffness_ratio)]
    factors = (1 - (rod.order + 1) / np.arange(1, n + 1) for rod, _ in rods)
    weights = [np.cumprod(np.append(1.0, factor)) for factor in factors]
    x, f = np.zeros((2, n + 2)), np.zeros((2, n + 1))
    q, phase, rho, mu = np.zeros(n + 1), 0, s.mass_ratio, s.friction
    for m in range(n + 1):
        for i, (rod, k) in enumerate(rods):
            past = k * rod.tau_x * x[i, :m] - rod.tau_f * f[i, :m]
            memory = np.dot(weights[i][1 : m + 1], past[::-1])
            speed = h**-rod.order
            elastic = k * x[i, m] * (1 + rod.tau_x * speed)
            f[i, m] = (elastic + speed * memory) / (1 + rod.tau_f * speed)
        if m == 0:
            continue  # x_0 = x_1 = 0
        hold = (-f[0, m] + rho * f[1, m]) / (1 + rho)
        slip = (x[0, m] - x[0, m - 1]) - (x[1, m] - x[1, m - 1])
        if phase == 0 and abs(hold) > mu:
            phase = np.sign(hold)
        elif phase != 0 and slip * phase <= 0:
            phase = 0 if abs(hold) <= mu else -phase
        q[m] = hold if phase == 0 else mu * phase
        shaking = acceleration(m * h)
        x[0, m + 1] = 2 * x[0, m] - x[0, m - 1] + h**2 * (-f[0, m] - q[m] - shaking)
        if phase == 0:
            x[1, m + 1] = x[0, m + 1] - (x[0, m] - x[1, m])
        else:
            x[1, m + 1] = 2 * x[1, m] - x[1, m - 1] + h**2 * (rho * (q[m] - f[1, m]) - shaking)
    return x[0, : n + 1], x[1, : n + 1], q
