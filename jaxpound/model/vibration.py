"""Modes of buildings on fractional rods: natural frequencies, damping ratios and shapes."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import numpy as np

from jaxpound._checks import instance, is_known_and_single, is_traced
from jaxpound._errors import InvalidInput
from jaxpound._tables import Shown, TextTable
from jaxpound.model.dampers import PowerLaw
from jaxpound.model.hysteresis import before_yield
from jaxpound.model.system import Structures, gravity_of
from jaxpound.model.topology import elongation
from jaxpound.quantities import unit

_ITERATIONS = 50
_NONE = complex("nan+nanj")


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Modes(Shown):
    """Modes of masses, rods and inerters, without friction and contact, the slowest first.

    Rods that yield are taken as they are before they do; those of a ``PowerLaw`` are left out.

    Frequencies of dimensionless structures are in ω1, those of structures in SI in rad/s.

    The steady vibration at a real frequency ω has the complex stiffness K*(iω). Mode j is where a
    complex eigenvalue of it, K*(iω_j) φ = λ M φ, has the real part ω_j²; its damping ratio is
    Im λ / (2 Re λ), half the loss factor. For one mass on one rod these are
    ``ZenerRod.natural_frequency`` and ``damping_ratio``, and for Kelvin–Voigt rods in proportion to
    the masses or stiffnesses the ω and ζ of modal analysis. Free vibrations φ e^(st) have the
    ``eigenvalues`` s, whose |s| and −Re s / |s| agree with them to the square of the damping ratio.
    """

    frequencies: np.ndarray
    """Natural frequencies ω_j, shape (n,)."""
    damping_ratios: np.ndarray
    """Equivalent viscous damping ratios, shape (n,)."""
    shapes: np.ndarray
    """Complex shapes φ: of mode j ``shapes[:, j]``, shape (n, n), with its largest entry 1."""
    eigenvalues: np.ndarray
    """s of the free vibration of each mode, s² M φ + K*(s) φ = 0 with Im s > 0, shape (n,).

    NaN for a mode that is damped about critically or more."""
    participation: np.ndarray
    """Effective modal mass of each mode over the whole mass, of the real parts of the shapes."""
    si: bool = False
    """Whether frequencies are in rad/s, not in ω1."""

    @property
    def periods(self) -> np.ndarray:
        """Natural periods 2π / ω_j, shape (n,)."""
        return 2 * np.pi / self.frequencies

    def _tables(self) -> list[TextTable]:
        columns = self.frequencies, self.periods, self.damping_ratios, self.participation
        rows = [(f"{j}", *numbers) for j, numbers in enumerate(zip(*columns, strict=True), 1)]
        frequency, period = "rad/s" if self.si else "ω1", unit("time", self.si)
        times = f"frequency ({frequency})", f"period ({period})"
        heading = ("mode", *times, "damping ratio", "share of mass")
        return [TextTable("Modes", heading, rows, digits=4)]


def modes(structures: Structures) -> Modes:
    """Natural frequencies, damping ratios and shapes of structures, by their fractional rods.

    Raises ``ValueError`` if structures are traced or a batch.

    Parameters
    ----------
    structures
        ``Storeys``, a ``System`` or any other structures with concrete numbers. Of their links only
        inerters count: friction and contact have no modes. Those of ``Buildings`` are in rad/s and
        s; for a single building there is ``ShearBuilding.modes``.

    Examples
    --------
    >>> elastic = jp.ZenerRod(order=1.0, tau_f=1e-9, tau_x=1e-9)
    >>> modes = jp.modes(jp.Storeys((1.0, 1.0), jp.Rod(elastic, 1.0)))
    >>> modes.frequencies.round(6).tolist()  # the golden section and its inverse
    [0.618034, 1.618034]
    """
    linear = _Linear("modes", structures)
    steady_modes = [linear.steady(j) for j in range(linear.n)]
    steady_modes.sort(key=lambda mode: mode[0])
    omega, values, vectors = (np.array(x) for x in zip(*steady_modes, strict=True))
    shapes = vectors.T / vectors.T[np.abs(vectors).argmax(1), np.arange(linear.n)]
    real = shapes.real
    effective = (linear.masses @ real) ** 2 / np.einsum("ij,ik,kj->j", real, linear.inertia, real)
    return Modes(
        frequencies=omega,
        damping_ratios=values.imag / values.real / 2,
        shapes=shapes,
        eigenvalues=np.array([linear.free(*mode) for mode in steady_modes]),
        participation=effective / linear.masses.sum(),
        si=gravity_of(structures) is not None,
    )


def first_frequency(structures: Structures) -> float:
    """Natural frequency of the first mode, as in ``modes``."""
    return _Linear("first_frequency", structures).steady(0)[0]


class _Linear:
    """Masses, rods and inerters of concrete structures, scaled so that the mass matrix is 1."""

    def __init__(self, owner: str, structures: Any) -> None:
        if hasattr(structures, "modes"):
            rule = "in SI units have a method of their own, modes()"
            raise InvalidInput(owner, "structures", "", rule)
        instance(owner, "structures", structures, Structures)
        system = structures.system()
        inerters = [link.inerter for link in system.links]
        leaves = jax.tree.leaves((system.masses, system.rods, inerters))
        if not is_known_and_single(leaves):
            rule = "must be known, not traced" if is_traced(leaves) else "must be one, not a batch"
            raise InvalidInput(owner, "structures", "", rule)
        self.masses = np.array([float(mass) for mass in system.masses])
        self.n = self.masses.size
        unit_motions = [*np.eye(self.n)]
        inertia = np.diag(self.masses)
        for link in system.links:
            if link.inerter is not None:
                influence = elongation(link.ends, unit_motions)
                inertia += float(link.inerter.inertance) * np.outer(influence, influence)
        self.inertia, self._root = inertia, np.linalg.cholesky(inertia)
        self._rods: list[tuple[Any, Any]] = []
        for ends, rod in zip(system.topology.rods, system.rods, strict=True):
            influence = np.linalg.solve(self._root, elongation(ends, unit_motions))
            if isinstance(rod.material, PowerLaw):  # no stiffness in slow motion
                continue
            law = before_yield(rod.material)
            numbers = [float(x) for x in (rod.stiffness, law.order, law.tau_f, law.tau_x)]
            self._rods.append((np.outer(influence, influence), numbers))

    def stiffness(self, s: complex) -> tuple[np.ndarray, np.ndarray]:
        """K*(s) and its derivative by s."""
        value = np.zeros((self.n, self.n), complex)
        slope = np.zeros_like(value)
        for matrix, (k, order, tau_f, tau_x) in self._rods:
            z = s**order
            below = 1 + tau_f * z
            value += k * (1 + tau_x * z) / below * matrix
            slope += k * (tau_x - tau_f) / below**2 * order * z / s * matrix
        return value, slope

    def steady(self, j: int) -> tuple[float, complex, np.ndarray]:
        """ω, λ and shape of the j-th mode at a real frequency: where Re λ_j(ω) = ω²."""
        from scipy.optimize import brentq  # its import takes half a second

        def excess(log_omega: float) -> float:
            omega = np.exp(log_omega)
            values = np.linalg.eigvals(self.stiffness(1j * omega)[0])
            return float(np.sort(values.real)[j] / omega**2) - 1

        # The modulus is positive at low frequencies and bounded at high ones: a root lies between.
        soft = sum(k * matrix for matrix, (k, *_) in self._rods)
        low = high = float(np.log(np.linalg.eigvalsh(soft)[j])) / 2
        while excess(low) < 0:
            low -= 0.5
        while excess(high) >= 0:
            high += 0.5
        omega = float(np.exp(low if low == high else brentq(excess, low, high, xtol=1e-14)))
        values, vectors = np.linalg.eig(self.stiffness(1j * omega)[0])
        k = int(np.argsort(values.real)[j])
        return omega, complex(values[k]), np.linalg.solve(self._root.T, vectors[:, k])

    def free(self, omega: float, value: complex, shape: np.ndarray) -> complex:
        """Exponent s of the free vibration that belongs to a steady one, by inverse iteration.

        With T(s) = s² + K*(s) and T(s) y = T'(s) u, the step of s is −1/(w y) where w u = 1. NaN if
        it does not converge to a vibration: overdamped motions creep.
        """
        s, u = 1j * omega * np.sqrt(value / value.real), self._root.T @ shape
        for _ in range(_ITERATIONS):
            w = u.conj() / np.vdot(u, u)
            stiffness, slope = self.stiffness(s)
            matrix = stiffness + s**2 * np.eye(self.n)
            try:
                y = np.linalg.solve(matrix, 2 * s * u + slope @ u)
            except np.linalg.LinAlgError:  # s is exact to the last digit
                break
            size = w @ y
            if not np.isfinite(size) or size == 0:
                return _NONE
            s, u = s - 1 / size, y / size
            if abs(1 / size) <= 1e-12 * abs(s):
                break
        else:
            return _NONE
        return complex(s) if s.imag > 1e-6 * abs(s) else _NONE
