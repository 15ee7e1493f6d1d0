"""Free collisions of two blocks under every contact law."""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from scipy.special import gamma

import jaxpound as jp
from benchmarks.verification.case import Case, Errors, Number, refine
from tests.reference import load
from tests.simulation.contact.test_flows import LAWS
from tests.simulation.pairs import OneOf

STEPS = (0.05, 0.025)
END = 0.8
NAMES = {
    "newton": "Newton",
    "kelvin": "Kelvin and Voigt, with tension",
    "kelvin_clip": "Kelvin and Voigt",
    "hertz": "Hertz",
    "hertzdamp": "Hertz, damped: Muthukumar",
    "hertzdamp_hc": "Hertz, damped: Hunt and Crossley",
    "hertzdamp_flores": "Hertz, damped: Ye",
    "hertzdamp_exact": "Hertz, damped: exact",
    "jankowski": "Jankowski",
}
TOGETHER = (
    ("newton",),
    ("kelvin",),
    ("kelvin_clip",),
    tuple(name for name in LAWS if name not in ("newton", "kelvin", "kelvin_clip")),
)
"""Laws that share a program."""
SOFT = 1e-9
"""Stiffness of the rods, which hold the blocks in name only."""


def program(names: Sequence[str], step: float):
    """Impacts of laws by number, stiffness and restitution; those with a force share it."""
    grid = jp.TimeGrid.until(END, step)
    elastic = jp.ZenerRod(1.0, 0.1, 0.1)
    still = jp.Ricker(0.0, [1.0], [0.0])

    @jax.jit
    @jax.vmap
    def collide(which, stiffness, restitution, masses, speeds, gap):
        laws = tuple(LAWS[name](stiffness, restitution) for name in names)
        law = OneOf(which, laws) if len(laws) > 1 else laws[0]
        rods = tuple(jp.Rod(elastic, SOFT, (i, jp.GROUND)) for i in (0, 1))
        system = jp.System(tuple(masses), rods, (jp.Link((0, 1), 0.0, gap, law),))
        start = jp.InitialState(velocities=tuple(speeds))
        found = jp.simulate(system, still, grid, initial=start)
        impacts = found.links[0].impacts
        link = found.demand.links[0]
        first = impacts.rebound_velocity[0], impacts.end[0] - impacts.time[0]
        return jnp.stack([*first, link.peak_contact, found.masses[0].v[-1], found.masses[1].v[-1]])

    return collide


def hertz_duration(stiffness: float, mass: float, speed: float) -> float:
    """How long Hertz's contact lasts, by his theory."""
    depth = (5 * mass * speed**2 / (4 * stiffness)) ** 0.4
    return float(0.8 * np.sqrt(np.pi) * gamma(0.4) / gamma(0.9) * depth / speed)


def kelvin_duration(law: jp.KelvinVoigt, mass: float) -> float:
    """How long contact with a spring and a dashpot lasts that may pull: half a damped period."""
    omega, xi = np.sqrt(law.stiffness / mass), float(law.damping_ratio)
    return float(np.pi / (omega * np.sqrt(1 - xi**2)))


def case(steps: Sequence[float] = STEPS, groups: Sequence[tuple[str, ...]] = TOGETHER) -> Case:
    """The laws of the groups, with the largest error of four restitutions each."""
    known = load("contact")["collisions"]
    errors, numbers = [], []
    for names in groups:
        cases = [one for one in known if one["law"] in names]
        arguments = (
            np.array([float(names.index(one["law"])) for one in cases]),
            np.array([one["k"] or 1.0 for one in cases]),
            *(np.array([one[key] for one in cases]) for key in ("e", "m", "v0", "gap0")),
        )
        found, seconds = refine(steps, lambda h, n=names, a=arguments: _call(program(n, h), a))
        found = [np.asarray(one) for one in found]
        for name in names:
            own = [i for i, one in enumerate(cases) if one["law"] == name]
            after = np.array([cases[i]["v_end"] for i in own])
            speeds = tuple(float(np.abs(one[own, 3:] - after).max()) for one in found)
            errors.append(
                Errors(f"{NAMES[name]}: final velocities", tuple(steps), speeds, 2e-6, 0, seconds)
            )
            if name == "newton":
                continue
            peaks = np.array([cases[i]["peak_force"] for i in own])
            shares = tuple(float(np.abs(one[own, 2] / peaks - 1).max()) for one in found)
            errors.append(
                Errors(f"{NAMES[name]}: peak force, relative", tuple(steps), shares, 2e-6, 0)
            )
            numbers += _durations(name, [(cases[i], found[-1][i]) for i in own])
    return Case(
        "Free collisions",
        "Two blocks of mass 1 and 0.6 approach each other at a speed of 1 across a gap of 0.1 and "
        "collide, without rods and ground motion. There are nine contact laws; the table has the "
        "largest error of four restitutions, 0.2, 0.4, 0.65 and 0.9. The motion in contact is "
        "resolved within a step, so that the errors do not depend on the step.",
        "An independent integration of the collision with the formula of each law (five-stage "
        "Radau). The duration of contact has closed forms for Hertz's theory and for a spring with "
        "a dashpot.",
        errors=tuple(errors),
        numbers=tuple(numbers),
    )


def _call(collide, arguments):
    return lambda: collide(*arguments)


def _durations(name: str, runs: list) -> list[Number]:
    """How long contact lasts where there is a closed form."""
    one, found = runs[2]
    speed, mass = one["v0"][0] - one["v0"][1], 1 / sum(1 / m for m in one["m"])
    if name == "hertz":
        exact = hertz_duration(one["k"], mass, speed)
    elif name == "kelvin":
        exact = kelvin_duration(jp.KelvinVoigt(one["k"], one["e"], tension=True), mass)
    else:
        return []
    return [Number(f"{NAMES[name]}: duration of contact", float(found[1]), exact, 1e-6)]
