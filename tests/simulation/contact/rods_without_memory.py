"""Masses on Zener rods of order 1, from event to event: a solver of its own, with SciPy.

Nothing of jaxpound is used. Ends are masses with weights, ((mass, weight), …): the elongation of a
rod, f + τf f' = K (e + τx e'), and the closing of a link are Σ weight · x. A ``Face`` closes as
side · closing exceeds its gap. Its law is the restitution of Newton's law, a number, or a force as
a function of penetration, its rate and the touch speed, which pushes only. Friction is set-valued:
links that stick have the forces that keep their closings.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

ACCURACY = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-13}
LONGEST = 5e-3  # substep, at whose ends events are looked for
REST = 1e-7  # duration of a flight below which rebounds are over
SLOW = 1e-13  # speed of a slide at its end: one that has just begun may have 0, or -0 by rounding
SMALL = 1e-9  # forces, and closings, that count as none


GROUND = -1

Ends = tuple[tuple[int, float], ...]


class Spring(NamedTuple):
    stiffness: float
    tau_f: float
    tau_x: float
    ends: Ends


class Dashpot(NamedTuple):
    coefficient: float
    ends: Ends


class Slider(NamedTuple):
    friction: float
    ends: Ends


class Face(NamedTuple):
    link: int
    side: int
    gap: float
    law: float | Callable

    @property
    def is_rigid(self):
        return isinstance(self.law, float)


class Frame(NamedTuple):
    """Masses with rods, links and the faces of links.

    The ground's acceleration acts on a mass by its influence, 0 on a rotation's inertia.
    """

    masses: tuple[float, ...]
    rods: tuple[Spring, ...]
    links: tuple[Slider, ...] = ()
    faces: tuple[Face, ...] = ()
    influence: tuple[float, ...] | None = None
    dashpots: tuple[Dashpot, ...] = ()


def between(i: int, j: int) -> Ends:
    """The ends of what x_i − x_j stretches, or x_i alone if j is the ground."""
    return tuple((mass, weight) for mass, weight in ((i, 1.0), (j, -1.0)) if mass != GROUND)


def rows(elements, n):
    """Weights by element and mass, of shape (elements, n)."""
    b = np.zeros((len(elements), n))
    for row, element in zip(b, elements, strict=True):
        for mass, weight in element.ends:
            row[mass] += weight
    return b


def effective_mass(ends, masses):
    """Of a collision, 1/Σ weight²/mass."""
    return 1 / sum(weight**2 / masses[mass] for mass, weight in ends)


def kelvin_voigt(stiffness, restitution, mass):
    """The law for two bodies of an effective mass."""
    decrement = -np.log(restitution)
    damping = 2 * decrement / np.hypot(np.pi, decrement) * np.sqrt(stiffness * mass)
    return lambda depth, speed, _: stiffness * depth + damping * speed


def ricker(amplitude, periods, arrivals):
    """Acceleration of the ground over time, by the formula of the paper (eq. 6)."""
    a, amplitude, arrivals = np.pi / np.array(periods), np.array(amplitude), np.array(arrivals)

    def acceleration(t):
        v = (a * (t - arrivals)) ** 2
        return np.sum(amplitude * 2 * a**2 * (4 * v**2 - 12 * v + 3) * np.exp(-v))

    return acceleration


class Run:
    """A frame from rest, or with displacements and velocities and rods that are relaxed so.

    Its state: x and x' of the masses, f of the rods. ``log`` has instants, kinds and links or faces
    of events. A touch speed is at least ``least`` times the largest acceleration since the touch
    that the closing would have without the forces of links.
    """

    def __init__(self, frame, ground, least=0.0, start=None, longest=LONGEST):
        n = self.n = len(frame.masses)
        self.m, self.faces = np.array(frame.masses), frame.faces
        self.ground, self.least = ground, least
        self.iota = np.ones(n) if frame.influence is None else np.array(frame.influence)
        self.k, self.tau_f, self.tau_x = np.array([rod[:3] for rod in frame.rods]).T
        self.friction = np.array([link.friction for link in frame.links], float)
        self.rods, self.b = rows(frame.rods, n), rows(frame.links, n)
        of_dashpots = rows(frame.dashpots, n)
        coefficients = np.array([dashpot.coefficient for dashpot in frame.dashpots])
        self.damping = of_dashpots.T * coefficients @ of_dashpots
        self.g = self.b / self.m @ self.b.T
        x, v = np.zeros((2, n)) if start is None else np.array(start, float)
        self.t, self.state = 0.0, np.concatenate([x, v, self.k * (self.rods @ x)])
        self.slip, self.touch_speeds = np.sign(self.b @ v), np.zeros(len(self.faces))
        self.closed = np.zeros(len(self.faces), bool)
        self.flight, self.longest, self.log = np.inf, longest, []
        self.settle()

    def path(self, instants):
        """Displacements of the masses at these instants, (instants, masses)."""
        return self.states(instants)[:, : self.n]

    def states(self, instants):
        states = []
        for instant in instants:
            while self.t < instant - 1e-13:
                self.advance(instant)
            states.append(self.state)
        return np.array(states)

    def advance(self, until):
        """To the next event, or to ``until``; no substep is longer than an eighth of a flight."""
        events, longest = self.events(), min(self.longest, self.flight / 8)
        span, self.flight = (self.t, min(until, self.t + 4 * self.flight)), np.inf
        for value, _, _ in events:
            value.terminal, value.direction = True, -1
        values = [value for value, _, _ in events]
        run = solve_ivp(self.rates, span, self.state, events=values, max_step=longest, **ACCURACY)
        self.t, self.state = run.t[-1], run.y[:, -1].copy()
        pulls = self.least * np.abs(self.b @ self.free(self.t, self.state))
        self.touch_speeds = np.maximum(self.touch_speeds, [pulls[x.link] for x in self.faces])
        for (_, effect, which), times in zip(events, run.t_events, strict=True):
            if times.size:
                self.log.append((self.t, effect.__name__, which))
                effect(which)
                self.settle()
                return

    def free(self, t, state):
        """Accelerations without the forces of links."""
        _, v, f = np.split(state, [self.n, 2 * self.n])
        return -(f @ self.rods + self.damping @ v) / self.m - self.iota * self.ground(t)

    def forces(self, t, state):
        """Accelerations, and by link all of its forces, and those of contact laws."""
        free, contact, held = self.free(t, state), np.zeros(len(self.b)), self.held()
        for c, face in enumerate(self.faces):
            if self.closed[c] and not face.is_rigid:
                touch_speed = max(self.touch_speeds[c], self.least * abs(self.b[face.link] @ free))
                depth, speed = max(self.depth(state, c), 0.0), self.approach(state, c)
                contact[face.link] += face.side * max(face.law(depth, speed, touch_speed), 0.0)
        total = self.friction * self.slip + contact
        if held.any():
            pull = self.b @ free - self.g @ np.where(held, 0.0, total)
            total[held] = np.linalg.solve(self.g[np.ix_(held, held)], pull[held])
        return free - self.b.T @ total / self.m, total, contact

    def rates(self, t, state):
        x, v, f = np.split(state, [self.n, 2 * self.n])
        a = self.forces(t, state)[0]
        stretched = self.k * (self.rods @ x + self.tau_x * (self.rods @ v))
        return np.concatenate([v, a, (stretched - f) / self.tau_f])

    def speed(self, state, k):
        return self.b[k] @ state[self.n : 2 * self.n]

    def approach(self, state, c):
        return self.faces[c].side * self.speed(state, self.faces[c].link)

    def depth(self, state, c):
        face = self.faces[c]
        return face.side * (self.b[face.link] @ state[: self.n]) - face.gap

    def holding(self, t, state, k):
        """The friction that holds a link."""
        _, total, contact = self.forces(t, state)
        return total[k] - contact[k]

    def held(self):
        """Links that neither slide nor, without friction, move freely."""
        resting = np.array([self.resting(k) != 0 for k in range(len(self.b))], bool)
        return (self.slip == 0) & ((self.friction > 0) | resting)

    def resting(self, k):
        """The side on which a link is closed at rest, or 0."""
        rigid = (x.side * (x.link == k and x.is_rigid) for x in self.faces)
        return sum(side for side, closed in zip(rigid, self.closed, strict=True) if closed)

    def margin(self, t, state, k):
        """What a link that does not slide lacks to being moved."""
        if side := self.resting(k):
            return side * self.forces(t, state)[1][k] + self.friction[k]
        return self.friction[k] - abs(self.holding(t, state, k))

    def events(self):
        """Functions of time and state whose fall below zero is an event, its effect, and where."""
        events, held = [], self.held()
        for k, holds in enumerate(held):
            if holds:
                events.append((lambda t, z, k=k: self.margin(t, z, k), self.slide, k))
            elif self.friction[k] > 0:
                events.append(
                    (lambda _, z, k=k: self.slip[k] * self.speed(z, k) + SLOW, self.turn, k)
                )
        for c, face in enumerate(self.faces):
            if not held[face.link] and not self.closed[c]:
                events.append((lambda _, z, c=c: -self.depth(z, c), self.touch, c))
            elif not held[face.link]:
                events.append((lambda _, z, c=c: self.depth(z, c), self.release, c))
        return events

    def settle(self):
        """Links are moved at once where forces beside them have jumped, and closed ones struck."""
        for c, face in enumerate(self.faces):
            struck = face.is_rigid and not self.closed[c] and self.approach(self.state, c) > SLOW
            if struck and abs(self.depth(self.state, c)) < SMALL:
                self.touch(c)
                self.settle()
                return
        for k, holds in enumerate(self.held()):
            if holds and self.margin(self.t, self.state, k) < -SMALL:
                self.slide(k)
                self.settle()
                return

    def slide(self, k):
        side = self.resting(k)
        slip = -side if side else np.sign(self.holding(self.t, self.state, k))
        for c, face in enumerate(self.faces):
            if face.link == k and face.is_rigid:
                self.closed[c] = False
        self.set_off(k, slip)

    def set_off(self, k, slip):
        """Slide from rest; a gap of 0 on that side closes."""
        self.slip[k] = slip
        for c, face in enumerate(self.faces):
            ahead = face.link == k and face.side == slip and not self.closed[c]
            if ahead and abs(self.depth(self.state, c)) < SMALL:
                self.touch(c)

    def turn(self, k):
        self.slip[k] = 0.0
        self.push(k, -self.speed(self.state, k))
        if abs(holding := self.holding(self.t, self.state, k)) > self.friction[k]:
            self.set_off(k, np.sign(holding))

    def push(self, k, change):
        """Change the speed of a link by a blow."""
        self.state[self.n : 2 * self.n] += self.b[k] / self.m * change / self.g[k, k]

    def stop(self):
        """Blows in all links that are closed at rest stop them together."""
        b = self.b[[self.resting(k) != 0 for k in range(len(self.b))]]
        speeds = b @ self.state[self.n : 2 * self.n]
        self.state[self.n : 2 * self.n] -= b.T @ np.linalg.solve(b / self.m @ b.T, speeds) / self.m

    def release(self, c):
        self.closed[c] = False

    def touch(self, c):
        (k, side, _, law), speed = self.faces[c], max(self.approach(self.state, c), 0.0)
        if not self.faces[c].is_rigid:
            self.closed[c], self.touch_speeds[c] = True, speed
            return
        self.slip[k] = -side
        after_blow = -side * self.b[k] @ self.forces(self.t, self.state)[0]
        flight = 2 * law * speed / max(-after_blow, 1e-3)
        if flight < REST:
            self.slip[k], self.closed[c] = 0.0, True
            self.stop()
            return
        before, self.flight = self.b @ self.state[self.n : 2 * self.n], flight
        self.push(k, -side * (1 + law) * speed)
        after = self.b @ self.state[self.n : 2 * self.n]
        struck = after != before
        self.slip[struck] = np.sign(after[struck])
        for other, face in enumerate(self.faces):
            if face.is_rigid and struck[face.link]:
                self.closed[other] = False
