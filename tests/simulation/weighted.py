"""Systems whose ends have weights, as numbers: for the library and for a reference of their own.

``python -m tests.simulation.weighted`` solves them anew by ``contact/rods_without_memory.py`` and
writes ``oracles/weights.json``, in some minutes: displacements of the masses at ``INSTANTS`` and
derivatives of them by numbers of the case, which are central differences.
"""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tests.simulation.contact.rods_without_memory import (
    Face,
    Frame,
    Run,
    Slider,
    Spring,
    effective_mass,
    kelvin_voigt,
    ricker,
)

FILE = Path(__file__).parents[1] / "oracles" / "weights.json"
END, EVERY = 12.0, 0.4
INSTANTS = EVERY * np.arange(1, round(END / EVERY) + 1)
FAR = 50.0  # a gap that does not close


class Joint(NamedTuple):
    """A link: its friction, ends, gaps (left, right), and the law of both."""

    friction: Any
    ends: tuple[tuple[int, Any], ...]
    gap: tuple[Any, Any] | None = None
    law: tuple[Any, ...] = ()  # stiffness and restitution of Kelvin and Voigt's, or Newton's e


class Parts(NamedTuple):
    masses: tuple[Any, ...]
    rods: tuple[Spring, ...]
    joints: tuple[Joint, ...]
    influence: tuple[float, ...]


class Case(NamedTuple):
    build: Callable[[dict[str, Any]], Parts]
    numbers: dict[str, float]
    by: tuple[str, ...]  # numbers of which there are derivatives
    ground: tuple[Any, Any, Any]  # amplitude, periods, arrivals of Ricker's wavelets
    start: tuple[tuple[float, ...], tuple[float, ...]] | None = None


# A storey on a footing that sways and rocks, beside another storey if there is one. The storey's
# displacement is a whole one, x = sway + height × rotation + drift.
FOOTING = {"storey": 1.0, "footing": 0.4, "inertia": 0.036, "height": 1.0, "stiffness": 1.0}
FOOTING |= {"sway": 59.1, "rock": 17.7, "tau_f": 0.05, "tau_x": 0.08, "width": 0.3, "unit": 1.0}


def footing(by, joints=(), neighbour=()):
    """The masses 0 storey, 1 sway, 2 rotation in a unit of angle, and of what stands beside."""
    times, unit = (by["tau_f"], by["tau_x"]), by["unit"]
    ends = ((0, 1.0), (1, -1.0), (2, -by["height"] * unit)), ((1, 1.0),), ((2, unit),)
    stiffnesses = by["stiffness"], by["sway"], by["rock"]
    rods = [Spring(k, *times, e) for k, e in zip(stiffnesses, ends, strict=True)]
    rods += [Spring(k, *times, ((3, 1.0),)) for _, k in neighbour]
    masses = by["storey"], by["footing"], by["inertia"] * unit**2, *(m for m, _ in neighbour)
    return Parts(masses, tuple(rods), tuple(joints), (1.0, 1.0, 0.0, *(1.0 for _ in neighbour)))


def edge(by, side):
    """Of the footing, the upper one with 1 and the lower one with -1."""
    return (1, 1.0), (2, side * by["width"] * by["unit"])


def dampers(by):
    """Friction between the storey and the ground, and at an edge of the footing."""
    return footing(by, (Joint(by["mu"], ((0, 1.0),)), Joint(by["mu_edge"], edge(by, 1))))


def walls(by):
    """The storey and both edges of the footing, beside walls, of which two have friction."""
    law = (by["k"], by["e"]) if "k" in by else (by["e"],)
    storey = Joint(by["mu"], ((0, 1.0),), (FAR, by["gap"]), law)
    upper = Joint(by["mu_edge"], edge(by, 1), (FAR, by["gap_up"]), law)
    lower = Joint(0.0, edge(by, -1), (by["gap_down"], FAR), law)
    return footing(by, (storey, upper, lower))


def neighbours(by):
    """A damper, and a gap, between the storey and another one, which stands on the ground."""
    between = Joint(by["mu"], ((0, 1.0), (3, -1.0)), (FAR, by["gap"]), (by["k"], by["e"]))
    return footing(by, (between,), ((by["m"], by["k_2"]),))


def drawn(n, seed):
    """A system of n unknowns, of which the last is a rotation that all see; two joints see it."""
    draw = np.random.default_rng([n, seed]).uniform
    numbers = {f"m{i}": draw(0.6, 1.4) for i in range(n - 1)} | {"inertia": draw(0.15, 0.4)}
    numbers |= {f"k{i}": draw(1.5, 6.0) for i in range(n)}
    numbers |= {f"arm{i}": draw(-0.6, 0.6) for i in range(n - 1)}
    numbers |= {"arm_joint": draw(0.2, 0.6), "arm_gap": draw(-0.6, -0.2)}
    numbers |= {"mu": draw(0.02, 0.08), "mu_gap": draw(0.02, 0.08)}
    numbers |= {"gap_left": draw(0.04, 0.1), "gap_right": draw(0.04, 0.1), "k": 200.0, "e": 0.65}
    by = ("mu", "arm_gap", "inertia", "gap_right")
    ground = (draw(0.1, 0.2), [draw(2.0, 3.0), draw(1.5, 2.5)], [draw(2.0, 3.0), draw(4.0, 5.0)])
    return Case({3: random_3, 4: random_4, 5: random_5}[n], numbers, by, ground)


def random_parts(by, n):
    """Storeys one above the other; a joint of the lowest, and a gap of the highest below it."""
    turn, times = n - 1, (0.05, 0.15)
    rods = []
    for i in range(n - 1):
        below = ((i - 1, -1.0),) if i else ()
        rods.append(Spring(by[f"k{i}"], *times, ((i, 1.0), *below, (turn, by[f"arm{i}"]))))
    rods.append(Spring(by[f"k{turn}"], *times, ((turn, 1.0),)))
    joints = (
        Joint(by["mu"], ((0, 1.0), (turn, by["arm_joint"]))),
        Joint(
            by["mu_gap"],
            ((n - 2, 1.0), (turn, by["arm_gap"]), *(((n - 3, -0.5),) if n > 3 else ())),
            (by["gap_left"], by["gap_right"]),
            (by["k"], by["e"]),
        ),
    )
    masses = *(by[f"m{i}"] for i in range(n - 1)), by["inertia"]
    return Parts(masses, tuple(rods), joints, (*(1.0,) * (n - 1), 0.0))


def random_3(by):
    return random_parts(by, 3)


def random_4(by):
    return random_parts(by, 4)


def random_5(by):
    return random_parts(by, 5)


WAVE = (0.3, [2.5, 1.8], [3.0, 5.0])
STILL = (0.0, [1.0, 1.0], [0.0, 0.0])
RIGID = FOOTING | {"mu": 0.0, "mu_edge": 0.0, "e": 0.65}
RIGID |= {"gap": FAR, "gap_up": FAR, "gap_down": FAR}
WALLS = RIGID | {"k": 1000.0}
TOUCHED, EDGES = {"gap": 0.2, "mu": 0.05}, {"gap_up": 0.01, "gap_down": 0.012, "mu_edge": 0.02}
BESIDE = FOOTING | {"mu": 0.1, "m": 0.8, "k_2": 3.0, "k": 1000.0, "e": 0.65}

CASES = {
    "linear": Case(footing, FOOTING, ("height", "inertia", "rock"), WAVE),
    "friction at the storey": Case(
        dampers,
        FOOTING | {"mu": 0.15, "mu_edge": 0.0},
        ("height", "mu", "inertia"),
        WAVE,
    ),
    "friction at the storey and an edge": Case(
        dampers,
        FOOTING | {"mu": 0.1, "mu_edge": 0.05},
        ("height", "width", "mu_edge", "inertia"),
        WAVE,
    ),
    "friction at the middle of the footing": Case(  # a weight of 0
        dampers, FOOTING | {"width": 0.0, "mu": 0.1, "mu_edge": 0.05}, ("width", "mu_edge"), WAVE
    ),
    "pulled and let go": Case(
        dampers,
        FOOTING | {"mu": 0.1, "mu_edge": 0.05},
        ("height", "mu", "mu_edge", "inertia"),
        STILL,
        ((0.5, 0.01, 0.03), (0.2, 0.0, -0.1)),
    ),
    "friction beside a neighbour": Case(
        neighbours, BESIDE | {"gap": FAR}, ("height", "mu", "inertia"), WAVE
    ),
    "a neighbour is hit": Case(
        neighbours, BESIDE | {"gap": 0.15}, ("height", "mu", "inertia", "gap"), WAVE
    ),
    "the storey hits a wall": Case(
        walls, WALLS | TOUCHED, ("height", "mu", "inertia", "gap"), WAVE
    ),
    "edges hit walls": Case(
        walls, WALLS | EDGES, ("height", "width", "mu_edge", "inertia", "gap_up"), WAVE
    ),
    "the storey hits a wall by Newton's law": Case(
        walls, RIGID | TOUCHED, ("height", "mu", "inertia", "gap"), WAVE
    ),
    "an edge hits a wall by Newton's law": Case(
        walls,
        RIGID | EDGES | {"gap_up": 0.013, "gap_down": FAR},
        ("height", "width", "mu_edge", "inertia", "gap_up"),
        WAVE,
    ),
    "an edge comes to rest at a wall by Newton's law": Case(
        walls, RIGID | EDGES | {"gap_up": 0.008, "gap_down": FAR}, ("height",), WAVE
    ),
}
SEEDS = (3, 1), (3, 2), (4, 1), (4, 3), (5, 1), (5, 5)  # with touches
CASES |= {f"random, {n} unknowns, seed {seed}": drawn(n, seed) for n, seed in SEEDS}


def frame(parts):
    """For the reference."""
    faces = []
    for k, joint in enumerate(parts.joints):
        *stiffness, e = joint.law or (None,)
        law = e
        if stiffness:
            law = kelvin_voigt(*stiffness, e, effective_mass(joint.ends, parts.masses))
        for side, gap in zip((-1, 1), joint.gap or (), strict=False):
            faces += [Face(k, side, gap, law)] * (gap < FAR)
    sliders = tuple(Slider(joint.friction, joint.ends) for joint in parts.joints)
    return Frame(parts.masses, parts.rods, sliders, tuple(faces), parts.influence)


def solved(case, numbers=None, **options):
    """A run of the reference."""
    parts = case.build(case.numbers | (numbers or {}))
    return Run(frame(parts), ricker(*case.ground), start=case.start, **options)


def slope(case, path, name, step=1e-4):
    """The derivative of a path by a number, and by how much it differs between its two sides."""
    step *= abs(case.numbers[name]) or 1.0
    less, more = (
        solved(case, {name: case.numbers[name] + x}).path(INSTANTS) for x in (-step, step)
    )
    return (more - less) / (2 * step), np.abs(more - 2 * path + less).max() / step


def reference(case):
    """What the file has of a case."""
    run = solved(case)
    path = run.path(INSTANTS)
    slopes = {name: slope(case, path, name) for name in case.by}
    kinds = [kind for _, kind, _ in run.log]
    return {
        "x": path.tolist(),
        "events": {kind: kinds.count(kind) for kind in sorted(set(kinds))},
        "derivatives": {name: values.tolist() for name, (values, _) in slopes.items()},
        "sides_differ": {name: float(change) for name, (_, change) in slopes.items()},
    }


def rounded(numbers):
    """Numbers of ten digits."""
    if isinstance(numbers, dict):
        return {key: rounded(value) for key, value in numbers.items()}
    if isinstance(numbers, list):
        return [rounded(value) for value in numbers]
    return float(f"{numbers:.10g}") if isinstance(numbers, float) else numbers


NOTE = (
    "Independent reference by python -m tests.simulation.weighted, which says what the cases are: "
    "from event to event, DOP853 of relative accuracy 1e-10. x: of each mass at t = .4, .8, ..., "
    "12. events: how many. derivatives: of x, central differences over a share 1e-4 of the number "
    "to either side; sides_differ: by how much those of the two sides do."
)


def main(names):
    for name in names or CASES:
        result = rounded(reference(CASES[name]))
        print(name, result["events"], result["sides_differ"], flush=True)
        kept = json.loads(FILE.read_text())["cases"] if FILE.exists() else {}
        kept[name] = result
        cases = {name: kept[name] for name in CASES if name in kept}
        FILE.write_text(json.dumps({"note": NOTE, "cases": cases}) + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
