"""Buildings that sway and rock on soil: periods and damping of the cone model, and a pair."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.verification.case import Case, Number, with_derivative
from tests.model.test_soil import DAMPING, PERIOD, RATIOS, on_disk
from tests.simulation.test_soil import SHARES, errors_of

STEPS = (0.04, 0.02, 0.01)


def first_modes() -> tuple[Number, ...]:
    """Ratios of periods on a light footing, and the first mode on one of 200 t."""
    numbers = []
    for velocity, ratio in RATIOS.items():
        effect = on_disk(velocity, mass=500.0).soil_effect()
        title = f"V_s = {velocity} m/s: period over that on rigid ground"
        numbers.append(Number(title, effect.period_ratio, ratio, 1e-4))
    modes = on_disk().modes()
    numbers.append(Number("footing of 200 t: period, s", float(modes.periods[0]), PERIOD, 1e-5))
    ratio = float(modes.damping_ratios[0])
    return (*numbers, Number("footing of 200 t: damping ratio", ratio, DAMPING, 1e-6))


def case(steps: Sequence[float] = STEPS, shares: Sequence[float] = SHARES) -> Case:
    """First modes, and displacements and derivatives of the pair."""
    steps, parts = tuple(steps), []
    for share in shares:
        errors = errors_of(share, steps)
        title = "footings joined by the soil" if share else "footings apart"
        parts += with_derivative(title, "x", steps, errors, (6.0, 40.0))
    return Case(
        "Buildings on soil",
        "A storey of 500 t, 1 s and 5 % on a disk of radius 6 m on soil of 1,800 kg/m³ and ν = "
        "1/3, its floor 10 m high: the first mode on a footing of 0.5 t, and of 200 t, with sway, "
        "rocking and radiation. Then two storeys on footings that sway and rock, whose floors "
        "touch several times under three wavelets up to t = 6. The error of x is the norm over "
        "instants and masses, relative to that of x. The derivative is along a way on which all "
        "numbers change, masses, rods, dashpots, gap, contact and those of the soil.",
        "Ratios of periods after Veletsos and Meek, √(1 + k/K_h + k h²/K_r), without a mass of the "
        "footing; the eigenvalue of the equations of floor, footing and rotation. For the pair an "
        "event-driven solver with equations of its own, which restarts a Runge–Kutta method of "
        "order 8 at each touch and release; derivatives by its central differences.",
        errors=tuple(parts),
        numbers=first_modes(),
    )
