"""Pairs whose rods are Maxwell branches: linear systems for programs without fractional rods.

A rod's complex modulus is replaced by that of a spring, Maxwell branches (a spring and a dashpot in
series each) and a dashpot beside each other, K*(s)/K = spring + Σ w s/(s + λ) + dashpot s.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import nnls

import jaxpound as jp

BAND = (-2.0, 2.0)
"""Decades of the frequencies at which the modulus is fitted."""
BRANCHES = 20
"""Branches of a fractional rod, whose rates go from a decade below the band to one above it."""


class Branches(NamedTuple):
    """A rod in units of its stiffness: spring, weights w and rates λ of its branches, dashpot."""

    spring: float
    weights: NDArray
    rates: NDArray
    dashpot: float

    def modulus(self, omega: ArrayLike) -> NDArray:
        """K*(iω)/K."""
        s = 1j * np.asarray(omega)[..., None]
        branches = (self.weights * s / (s + self.rates)).sum(-1)
        return self.spring + branches + self.dashpot * s[..., 0]


def branches(material: jp.ZenerRod) -> Branches:
    """A rod's branches: exact for order 1, where it has one, and a fit of its modulus otherwise.

    Rates are equally spaced in their logarithms; spring, weights and dashpot, none of them
    negative, follow by least squares from the modulus at 400 frequencies, in relative terms. The
    spring takes the place of all slower branches, the dashpot that of all faster ones.
    """
    order, tau_f, tau_x = (float(x) for x in (material.order, material.tau_f, material.tau_x))
    if order == 1:
        return Branches(1.0, np.array([tau_x / tau_f - 1]), np.array([1 / tau_f]), 0.0)
    omega = np.logspace(*BAND, 400)
    z = (1j * omega) ** order
    exact = (1 + tau_x * z) / (1 + tau_f * z)
    rates = np.logspace(BAND[0] - 1, BAND[1] + 1, BRANCHES)
    s = 1j * omega[:, None]
    parts = np.hstack([np.ones_like(s), s / (s + rates), s]) / exact[:, None]
    one = np.ones_like(omega)
    shares, _ = nnls(np.vstack([parts.real, parts.imag]), np.concatenate([one, 0 * one]))
    kept = shares[1:-1] > 0
    return Branches(shares[0], shares[1:-1][kept], rates[kept], shares[-1])


class Pair(NamedTuple):
    """M q″ + C q′ + K q = −M (1, 1, 0, …) u″ + friction; q begins with x1 and x2.

    The other coordinates are the points between spring and dashpot of each branch, without mass.
    """

    mass: NDArray
    damping: NDArray
    stiffness: NDArray
    friction: float

    def first_order(self) -> NDArray:
        """A of y′ = A y + …, where y has x1, x2, x1′, x2′ and the other coordinates."""
        blocks = self.mass[:2, :2], self.damping[2:, 2:]
        a = np.zeros((len(self.mass) + 2,) * 2)
        a[:2, 2:4] = np.eye(2)
        moved, inner = np.r_[0:2, 4 : len(a)], np.r_[4 : len(a)]
        a[2:4, moved] = -np.linalg.solve(blocks[0], self.stiffness[:2])
        a[2:4, 2:4] = -np.linalg.solve(blocks[0], self.damping[:2, :2])
        a[np.ix_(inner, moved)] = -np.linalg.solve(blocks[1], self.stiffness[2:])
        return a


def pair(structures: jp.AdjacentStructures) -> Pair:
    """A pair, its rods as branches."""
    rods = [branches(structures.rod_1), branches(structures.rod_2)]
    moduli = 1.0, float(structures.stiffness_ratio)
    size = 2 + sum(len(rod.rates) for rod in rods)
    mass, damping, stiffness = np.zeros((3, size, size))
    mass[0, 0], mass[1, 1] = 1.0, 1 / float(structures.mass_ratio)
    at = 2
    for i, (rod, k) in enumerate(zip(rods, moduli, strict=True)):
        own = np.arange(at, at + len(rod.rates))
        stiffness[i, i] = k * (rod.spring + rod.weights.sum())
        stiffness[i, own] = stiffness[own, i] = -k * rod.weights
        stiffness[own, own] = k * rod.weights
        damping[i, i] = k * rod.dashpot
        damping[own, own] = k * rod.weights / rod.rates
        at = own[-1] + 1
    return Pair(mass, damping, stiffness, float(structures.friction))
