"""Rods that yield against an event-driven solver, and Chopra's elastoplastic oscillators."""

from __future__ import annotations

from collections.abc import Sequence

import jax
import numpy as np

import jaxpound as jp
from benchmarks.verification import el_centro
from benchmarks.verification.case import Case, Errors, Number
from tests.simulation.rods.test_yielding import CASES, errors

STEPS = (0.02, 0.01, 0.005, 0.0025)
NAMES = {
    "one_bilinear": "a bilinear rod",
    "three_bilinear": "3 bilinear storeys",
    "two_boucwen": "2 Bouc–Wen storeys",
    "pounding_bilinear": "2 bilinear storeys beside 1, 4 impacts",
    "pounding_towers": "3 bilinear storeys beside 2, 3 impacts",
    "pounding_boucwen": "2 masses on Bouc–Wen rods, 2 impacts",
}
CONSTANT, CONSTANT_OF_LIGHT_TOUCH = 40.0, 80.0
"""Bounds of the errors of derivatives by the square of the step."""
PERIOD, STEP = 0.5, 0.005
EXACT = {2: (1.6244, 1.4463), 4: (1.7455, 3.1083), 8: (2.0639, 7.3506)}
"""Peak in in and ductility, by the elastic strength over the strength."""


def oscillators() -> tuple[Number, ...]:
    """Peaks and ductilities of elastoplastic oscillators; none without the record."""
    record = el_centro.record()
    if record is None:
        return ()
    elastic = jax.jit(lambda period: jp.spectral_acceleration(record, period=period))(PERIOD)
    strengths = float(elastic) / np.array([*EXACT])
    spectrum = jp.inelastic_spectrum(record, PERIOD, strength=strengths, dt=STEP)
    numbers = []
    results = zip(spectrum.displacement / 0.0254, spectrum.ductility, strict=True)
    for (reduction, exact), computed in zip(EXACT.items(), results, strict=True):
        quantities = zip(("peak of x, in", "ductility"), computed, exact, strict=True)
        title = f"elastoplastic, 1/{reduction} of the elastic strength"
        numbers += [Number(f"{title}: {q}", float(x), y, 2e-4 * y) for q, x, y in quantities]
    return tuple(numbers)


def case(steps: Sequence[float] = STEPS, names: Sequence[str] = tuple(NAMES)) -> Case:
    """Displacements and gradients of each system, and the oscillators."""
    steps, parts = tuple(steps), []
    for name in names:
        values, slopes, _ = errors(CASES[name], steps)
        constant = CONSTANT_OF_LIGHT_TOUCH if name == "pounding_bilinear" else CONSTANT
        parts += [
            Errors(f"{NAMES[name]}: x", steps, tuple(values.tolist()), 4.0),
            Errors(f"{NAMES[name]}: derivatives", steps, tuple(slopes.tolist()), constant),
        ]
    return Case(
        "Rods that yield",
        "Bilinear rods and rods by the law of Bouc and Wen, each with a rod of order 1 beside it, "
        "under three wavelets up to t = 16; in three of the six systems masses collide by the law "
        "of Kelvin and Voigt. The error of x is the largest of all masses at t = 0, 1, … 16, "
        "relative to the largest displacement. Derivatives are those of the final displacements "
        "and velocities and of the largest elongations of the rods that yield, with respect to a "
        "mass, stiffnesses, yield displacements, hardening, β of Bouc and Wen's law, gap and "
        "contact stiffness: the norm of the error over that of the exact derivatives, the largest "
        "of all parameters. The first impact of 2 bilinear storeys beside 1 is a light touch, with "
        "a relative velocity of 0.01 and a penetration of 1.2e-4. A gap wider by 7e-7, the error "
        "of the motion before it at h = 0.005, changes its derivatives with respect to the gap by "
        "2e-3 of their norm, so their bound is twice that of the others. The oscillators are "
        f"elastoplastic, with a natural period of {PERIOD:g} s and a damping ratio of 5 %, under "
        f"El Centro, at a step of {STEP:g} s.",
        "An event-driven solver that restarts a Runge–Kutta method of order 8 at each yield, "
        "unloading, touch and release; derivatives by its central differences, which agree to 1e-5 "
        "between different widths. For the oscillators, exact solutions by matrix exponentials "
        "between the samples of the record; chapter 7 of Chopra (2012) has peaks of 1.62, 1.75 "
        "and 2.07 in and ductilities of 1.44, 3.11 and 7.36.",
        errors=tuple(parts),
        numbers=oscillators(),
    )
