"""The exact motion of masses on fractional rods without friction, by their relaxation spectra.

A fractional rod is a spring with many Maxwell elements beside it, whose relaxation times follow
from its law. With them the system is a linear one of first order, y' = A y + b u'', whose
eigenvalues are those of the free vibrations, and whose motion under a piecewise linear u'' is a
matrix exponential.
"""

import numpy as np
from scipy.linalg import expm

from jaxpound.model import Spring


def elements(material, spacing=0.7, decades=(-9.0, 7.0)):
    """Rates λ and weights w of K*(s)/K = 1 + Σ w s/(s + λ); exact for rods of order 1.

    With z = s^γ, z/(1 + τ_f z) = ∫ H(λ) s/(s + λ) dλ, where the trapezoidal rule in ln λ converges
    exponentially. Slower elements are springs, whose weights have a closed form; faster ones do not
    move.
    """
    if isinstance(material, Spring):
        return np.zeros(0), np.zeros(0)
    order, tau_f, tau_x = material.order, material.tau_f, material.tau_x
    excess = tau_x / tau_f - 1
    if order == 1:
        return np.array([1 / tau_f]), np.array([excess])
    rate = np.exp(np.arange(*np.log(10.0) * np.array(decades), spacing))
    b, power, angle = 1 / tau_f, rate**order, np.pi * order
    density = b * np.sin(angle) / np.pi * power / (power**2 + 2 * b * power * np.cos(angle) + b**2)
    least = np.exp(-spacing / 2 * order) * power[0]
    slower = np.arctan((least + b * np.cos(angle)) / (b * np.sin(angle))) - np.pi / 2 + angle
    return np.append(0.0, rate), excess * np.append(slower / angle, density * spacing)


def first_order(system):
    """A and b of y' = A y + b u'', where y begins with displacements and velocities."""
    n = len(system.masses)
    mass = np.array(system.masses, float)
    axes = np.eye(n + 1)[:, :n]  # of the masses, and nothing for the ground, whose number is -1
    ways = [axes[rod.ends[0]] - axes[rod.ends[1]] for rod in system.rods]
    spectra = [elements(rod.material) for rod in system.rods]
    size = 2 * n + sum(len(rates) for rates, _ in spectra)
    a, b = np.zeros((size, size)), np.zeros(size)
    a[:n, n : 2 * n] = np.eye(n)
    b[n : 2 * n] = -1.0
    at = 2 * n
    for rod, way, (rates, weights) in zip(system.rods, ways, spectra, strict=True):
        inner = slice(at, at + len(rates))
        # y_k' = e' − λ_k y_k has the transform s/(s + λ_k) of the elongation e.
        a[inner, n : 2 * n] = way
        a[inner, inner] = -np.diag(rates)
        a[n : 2 * n, :n] -= rod.stiffness * np.outer(way, way) / mass[:, None]
        a[n : 2 * n, inner] -= rod.stiffness * np.outer(way, weights) / mass[:, None]
        at = inner.stop
    for dashpot in system.damping:
        way = axes[dashpot.ends[0]] - axes[dashpot.ends[1]]
        force = float(dashpot.material.coefficient) * np.outer(way, way)
        a[n : 2 * n, n : 2 * n] -= force / mass[:, None]
    return a, b


def positions(system, acceleration, dt, every):
    """Displacements at every so many samples, shape (instants, masses), from rest.

    ``acceleration`` has samples of u'' at steps dt, with straight lines between them.
    """
    a, b = first_order(system)
    size = len(b)
    whole = np.zeros((size + 2, size + 2))
    whole[:size, :size] = a * dt
    whole[:size, size] = b * dt
    whole[size, size + 1] = 1.0
    step = expm(whole)
    # What a sample, and the change to the next, have moved after 1, 2, ... steps.
    moved = [step[:size, size:]]
    for _ in range(every - 1):
        moved.append(step[:size, :size] @ moved[-1])
    response = np.concatenate(moved[::-1], axis=1)
    steps = np.linalg.matrix_power(step[:size, :size], every)
    y, x = np.zeros(size), []
    inputs = np.stack([acceleration, np.diff(acceleration, append=0.0)], -1)
    for start in range(0, len(acceleration), every):
        x.append(y[: len(system.masses)])
        block = inputs[start : start + every].ravel()
        y = steps @ y + response[:, : block.size] @ block
    return np.array(x)


def vibrations(system):
    """Exponents s of the free vibrations, Im s > 0, from the slowest to the fastest."""
    exponents = np.linalg.eigvals(first_order(system)[0])
    exponents = exponents[exponents.imag > 0.05 * np.abs(exponents)]
    return exponents[np.argsort(np.abs(exponents))]
