"""Solves the cases of ``tests/oracles/moat.json`` anew: python -m benchmarks.verification.moat.

These are links of two faces and dampers, from event to event. Nothing of jaxpound is used. A case
is what stands in the file: masses, rods, a link with its left and right gap and the law of each
face, wavelets, and the numbers by which derivatives are taken. Rods are Zener's of order 1,
f = K (e + (τx/τf − 1) y) with the elongation e and τf y' = τf e' − y; or a power law's,
f = K (e − y) with y' = v |f/F|^(1/a) sgn f. So the state is that of an ordinary differential
equation, which DOP853 integrates from one event to the next: touch and release, the end of a
clipped force and its largest value, slip and stick, the sign of a power law's force. An
event is found to rounding, by integration up to each trial. Friction is set-valued. By Newton's law
a link that approaches more slowly than ``REST`` stays closed. Derivatives are central differences
of such runs, extrapolated.
"""

import copy
import functools
import json
import operator
from pathlib import Path

import numpy as np
from scipy.integrate import DOP853, solve_ivp
from scipy.optimize import brentq

FILE = Path(__file__).parents[2] / "tests" / "oracles" / "moat.json"
REFERENCE = json.loads(FILE.read_text())
ACCURACY = {"rtol": 1e-11, "atol": 1e-14}
LONGEST = 0.02  # substep, at eight places of which events are looked for
REST = 1e-9
APART, PRESSED, CLIPPED, CLOSED = range(4)
SIDES = (-1, 1)
"""Of the left and the right face."""


class Flow:
    """A case between two events.

    Its state is x and x' of the masses, y of the rods, and energies: lost at the left and the right
    face, taken by friction, and by power laws. In the place of mass i of the link stand the closing
    and its rate.
    """

    def __init__(self, case):
        self.rods, self.link, self.m = case["rods"], case["link"], np.array(case["m"])
        self.n, (self.i, self.j) = len(self.m), self.link["ends"]
        self.wavelets = case["ricker"]["u0"], *(np.array(case["ricker"][x]) for x in ("tp", "ts"))
        self.inverse_mass = sum(1 / self.m[k] for k in (self.i, self.j) if k >= 0)
        self.damping = []
        for face in self.link["faces"]:
            decrement = -np.log(face["e"])
            ratio = decrement / np.hypot(np.pi, decrement)
            self.damping.append(2 * ratio * np.sqrt(face.get("k", 0.0) / self.inverse_mass))
        self.slip, self.modes, self.rises = 0, [APART, APART], [False, False]

    def ground(self, t):
        """u''(t)."""
        u0, periods, arrivals = self.wavelets
        v = (np.pi / periods * (t - arrivals)) ** 2
        return np.sum(2 * u0 * (np.pi / periods) ** 2 * (4 * v**2 - 12 * v + 3) * np.exp(-v))

    def of_masses(self, part):
        """Displacements of the masses, or their rates."""
        x = part.copy()
        x[self.i] += x[self.j] if self.j >= 0 else 0.0
        return x

    def depth(self, state, face):
        """Penetration at the left face, 0, or the right one, 1."""
        return SIDES[face] * state[self.i] - self.link["gap"][face]

    def speed(self, state, face):
        """Of approach to a face."""
        return SIDES[face] * state[self.n + self.i]

    def raw(self, state, face):
        """The force of Kelvin and Voigt's law, before it is clipped."""
        spring = self.link["faces"][face]["k"] * self.depth(state, face)
        return spring + self.damping[face] * self.speed(state, face)

    def growth(self, t, state, face):
        """Its rate."""
        rate = self.rates(t, state)[self.n + self.i] * SIDES[face]
        spring = self.link["faces"][face]["k"] * self.speed(state, face)
        return spring + self.damping[face] * rate

    def contact(self, state, face):
        """The force at a face."""
        return self.raw(state, face) if self.modes[face] == PRESSED else 0.0

    def rod_force(self, state, r):
        """The force of a rod, and the rates of its y and of the energy of a power law."""
        law, y, (a, b) = self.rods[r], state[2 * self.n + r], self.rods[r]["ends"]
        x, v = (self.of_masses(state[k : k + self.n]) for k in (0, self.n))
        e, rate = (z[a] - (z[b] if b >= 0 else 0.0) for z in (x, v))
        if "F" not in law:
            return law["K"] * (e + (law["tx"] / law["tf"] - 1) * y), rate - y / law["tf"], 0.0
        f = law["K"] * (e - y)
        slides = law["v"] * np.sign(f) * abs(f / law["F"]) ** (1 / law["a"])
        return f, slides, f * slides

    def forces(self, t, state):
        """Accelerations without the link's forces, friction q or what stick needs, and contact."""
        loads, inner, power = np.zeros(self.n), [], 0.0
        for r, law in enumerate(self.rods):
            f, rate, taken = self.rod_force(state, r)
            for end, sign in zip(law["ends"], (-1, 1), strict=True):
                if end >= 0:
                    loads[end] += sign * f
            inner.append(rate)
            power += taken
        a = loads / self.m - self.ground(t)
        contact = self.contact(state, 1) - self.contact(state, 0)
        if self.slip:
            gain, speed = self.link.get("velocity_friction"), abs(state[self.n + self.i])
            q = self.link["mu"] - (gain["F"] * np.expm1(-speed / gain["v"]) if gain else 0.0)
            return a, self.slip * q, contact, inner, power
        pull = a[self.i] - (a[self.j] if self.j >= 0 else 0.0)
        return a, pull / self.inverse_mass - contact, contact, inner, power

    def needed(self, *at):
        """The force that holds a link in stick, or closed at rest."""
        return self.forces(*at)[1]

    def rates(self, t, state):
        """Time derivative of the state."""
        n, i, j = self.n, self.i, self.j
        a, q, contact, inner, power = self.forces(t, state)
        a[i] -= (q + contact) / self.m[i]
        if j >= 0:
            a[j] += (q + contact) / self.m[j]
            a[i] -= a[j]
        a[i] = a[i] if self.slip else 0.0
        lost = [self.contact(state, face) * self.speed(state, face) for face in (0, 1)]
        return np.concatenate([state[n : 2 * n], a, inner, lost, [q * state[n + i], power]])

    def events(self):
        """By name, the functions of time and state whose fall below zero is the event."""
        if CLOSED in self.modes:
            side = SIDES[self.modes[1] == CLOSED]
            return {"open": lambda t, z: side * self.needed(t, z) + self.link["mu"]}
        if self.slip:
            events = {"turn": lambda t, z: self.slip * z[self.n + self.i]}
        else:
            events = {"break": lambda t, z: self.link["mu"] - abs(self.needed(t, z))}
        for face, mode in enumerate(self.modes):
            if mode == APART:
                events["touch", face] = lambda t, z, face=face: -self.depth(z, face)
                continue
            side = 1 if mode == PRESSED else -1
            events["release", face] = lambda t, z, face=face: self.depth(z, face)
            events["clip", face] = lambda t, z, face=face, side=side: side * self.raw(z, face)
            if self.rises[face]:
                events["top", face] = lambda t, z, face=face: self.growth(t, z, face)
        for r, law in enumerate(self.rods):
            if "F" in law and self.signs[r]:
                events["unload", r] = lambda t, z, r=r: self.signs[r] * self.rod_force(z, r)[0]
        return events


class Run(Flow):
    """A run from rest, and what is seen of it."""

    def __init__(self, case):
        super().__init__(case)
        self.slip = 0 if self.link["mu"] else 1
        self.t, self.state = 0.0, np.zeros(2 * self.n + len(self.rods) + 4)
        self.signs = [0] * len(self.rods)
        self.x, self.impacts = [], [[], []]
        self.extremes, self.peaks, self.blows = ([0.0, 0.0] for _ in range(3))
        end, every = REFERENCE["end"], REFERENCE["every"]
        for instant in np.arange(1, round(end / every) + 1) * every:
            while self.t < instant:
                self.advance(instant)
            self.x.append(self.of_masses(self.state[: self.n]).tolist())

    def advance(self, until):
        """To the next event, or to ``until``."""
        for r in range(len(self.rods)):
            self.signs[r] = self.signs[r] or int(np.sign(self.rod_force(self.state, r)[0]))
        events = self.events()
        solver = DOP853(self.rates, self.t, self.state, until, LONGEST, **ACCURACY)
        values = {name: event(self.t, self.state) for name, event in events.items()}
        while solver.status == "running":
            begin, state = solver.t, solver.y
            solver.step()
            between, low = solver.dense_output(), begin
            for time in np.linspace(begin, solver.t, 9)[1:]:
                place = solver.y if time == solver.t else between(time)
                before, values = values, {name: f(time, place) for name, f in events.items()}
                if late := [name for name in events if before[name] >= 0 > values[name]]:
                    first = [(self.instant(events[x], begin, state, low, time), x) for x in late]
                    self.t, name = min(first, key=lambda each: each[0])
                    self.state = self.at(begin, state, self.t)
                    self.happen(name)
                    self.look()
                    return
                low = time
            self.t, self.state = solver.t, solver.y
            self.look()

    def at(self, begin, state, time):
        """Get the state at a later time."""
        if time <= begin:
            return state.copy()
        return solve_ivp(self.rates, (begin, time), state, "DOP853", **ACCURACY).y[:, -1]

    def instant(self, event, begin, state, low, high):
        """When an event is."""

        def value(time):
            return event(time, self.at(begin, state, time))

        if value(low) <= 0:
            return low
        return high if value(high) >= 0 else brentq(value, low, high, xtol=1e-15, rtol=1e-15)

    def look(self):
        """Keep the largest closing in both directions, and the largest forces of contact."""
        for face in (0, 1):
            self.extremes[face] = max(self.extremes[face], SIDES[face] * self.state[self.i])
            force = self.contact(self.state, face)
            if self.modes[face] == CLOSED:  # friction bears what it can
                force = abs(self.needed(self.t, self.state)) - self.link["mu"]
            self.peaks[face] = max(self.peaks[face], force)

    def happen(self, name):
        """The effect of an event."""
        kind, face = name if isinstance(name, tuple) else (name, 0)
        if kind == "break":
            self.slip = int(np.sign(self.needed(self.t, self.state)))
        elif kind == "open":
            self.slip, self.modes = -SIDES[self.modes[1] == CLOSED], [APART, APART]
        elif kind == "turn":
            self.turn()
        elif kind == "touch":
            self.touch(face)
        elif kind == "release":
            self.modes[face] = APART
        elif kind == "clip":
            self.modes[face] = CLIPPED if self.modes[face] == PRESSED else PRESSED
        elif kind == "top":
            self.rises[face] = False
        else:
            self.signs[face] = -self.signs[face]

    def turn(self):
        """Slip ends in stick, or goes on in the other direction."""
        before, self.slip = self.slip, 0
        self.state[self.n + self.i] = 0.0
        if not self.link["mu"] or abs(self.needed(self.t, self.state)) > self.link["mu"]:
            self.slip = -before

    def touch(self, face):
        """Press the face, or rebound from it, or stay closed."""
        speed, law = self.speed(self.state, face), self.link["faces"][face]
        if speed > REST:
            self.impacts[face].append([self.t, speed])
        if "k" in law:
            self.modes[face], self.rises[face] = PRESSED, True
            return
        rebound = law["e"] * speed if speed > REST else 0.0
        blow, side = (speed + rebound) / self.inverse_mass, SIDES[face]
        self.blows[face] = max(self.blows[face], blow)
        if self.j >= 0:
            self.state[self.n + self.j] += side * blow / self.m[self.j]
        self.state[self.n + self.i] = -side * rebound
        self.state[-4 + face] += blow * (speed - rebound) / 2
        self.slip = -side if rebound else 0
        if not rebound:
            self.modes[face] = CLOSED

    def outputs(self):
        """What derivatives are of: energy lost by contact, and mass 0 at the end."""
        return np.array([self.state[-4:-2].sum(), self.x[-1][0]])


def part_at(case, path):
    """The part of a case that has the number at a path, such as ``link.gap.0``, and where in it."""
    *places, last = [int(x) if x.isdigit() else x for x in path.split(".")]
    return functools.reduce(operator.getitem, places, case), last


def changed(case, path, value):
    """The case with another number at a path."""
    case = copy.deepcopy(case)
    part, last = part_at(case, path)
    part[last] = value
    return case


def derivatives(case, path):
    """By a number, and by how much they may be wrong."""
    part, last = part_at(case, path)
    central = []
    for change in (4e-4 * part[last], 2e-4 * part[last]):
        ends = (Run(changed(case, path, part[last] + x)).outputs() for x in (change, -change))
        central.append(np.subtract(*ends) / (2 * change))
    extrapolated = central[1] + (central[1] - central[0]) / 3
    return extrapolated.tolist(), np.abs(extrapolated - central[1]).tolist()


def result(case):
    run = Run(case)
    by = {path: derivatives(case, path) for path in case["derivatives"]}
    return case | {
        "x": run.x,
        "min_gap": np.subtract(run.link["gap"], run.extremes).tolist(),
        "impacts": run.impacts,
        "peak_force": run.peaks,
        "peak_impulse": run.blows if any(run.blows) else None,
        "contact_lost": run.state[-4:-2].tolist(),
        "friction_work": run.state[-2],
        "dissipated": run.state[-1],
        "derivatives": {path: values for path, (values, _) in by.items()},
        "derivatives_within": {path: values for path, (_, values) in by.items()},
    }


def rounded(values):
    """To eleven digits."""
    if isinstance(values, dict):
        return {name: rounded(x) for name, x in values.items()}
    if isinstance(values, list):
        return [rounded(x) for x in values]
    return float(f"{values:.11g}") if isinstance(values, float) else values


if __name__ == "__main__":
    cases = {name: rounded(result(case)) for name, case in REFERENCE["cases"].items()}
    text = json.dumps(REFERENCE | {"cases": cases}, separators=(",", ":"))
    FILE.write_text(text.replace('},"', '},\n"') + "\n")
