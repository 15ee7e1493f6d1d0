"""Modes of buildings on fractional rods: natural frequencies, damping ratios and shapes."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import numpy as np

from jaxpound._checks import instance, is_known_and_single, is_traced
from jaxpound._errors import InvalidInput
from jaxpound._tables import Shown, TextTable
from jaxpound.model.dampers import Dashpot, PowerLaw
from jaxpound.model.ends import elongation
from jaxpound.model.hysteresis import before_yield
from jaxpound.model.system import Structures, in_si
from jaxpound.quantities import unit

_ITERATIONS = 30
_STEPS = 8  # from no damping to that of the rods
_NONE = complex("nan+nanj")


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Modes(Shown):
    """Modes of masses, rods, dampers and inerters, without friction and contact, the slowest first.

    Rods that yield are taken as they are before they do; dashpots count, those of a ``PowerLaw`` if
    they are linear.

    Frequencies of dimensionless structures are in ω1, those of structures in SI in rad/s.

    Mode j is a free vibration φ e^(st), of the damped structures: s² M φ + K*(s) φ = 0 with the
    rods' complex stiffness K*(s) on the principal branch. Its natural frequency is |s| and its
    damping ratio −Re s / |s|, for Kelvin–Voigt rods in proportion to the masses or stiffnesses the
    ω and ζ of modal analysis. The *steady* vibration at a real frequency, by which
    ``Building.from_period`` and ``natural_period`` define period and damping ratio, agrees with it
    to the square of the damping ratio if no other mode is close.

    A mode that is ``overdamped`` creeps back to rest; its frequency, damping ratio and shape are
    those of the steady vibration: where an eigenvalue λ of K*(iω) φ = λ M φ has the real part ω²,
    the damping ratio is Im λ / (2 Re λ).
    """

    frequencies: np.ndarray
    """Natural frequencies ω_j = |s|, shape (n,)."""
    damping_ratios: np.ndarray
    """Damping ratios −Re s / |s|, shape (n,)."""
    shapes: np.ndarray
    """Complex shapes φ: of mode j ``shapes[:, j]``, shape (n, n), with its largest entry 1."""
    eigenvalues: np.ndarray
    """s of each mode, Im s > 0, shape (n,); NaN of one that is damped about critically or more."""
    participation: np.ndarray
    """Effective modal mass over Σ ι² m, the mass that the ground moves, shape (n,), of the undamped
    mode that becomes mode j as damping grows; its rods have their storage moduli at the first
    natural frequency. They add up to 1, but for the inertia that inerters lead to the
    ground; NaN if the ground moves no mass."""
    si: bool = False
    """Whether frequencies are in rad/s, not in ω1."""

    @property
    def overdamped(self) -> np.ndarray:
        """Whether each mode creeps back to rest without a vibration, shape (n,)."""
        return np.isnan(self.eigenvalues)

    @property
    def periods(self) -> np.ndarray:
        """Natural periods 2π / ω_j, shape (n,)."""
        return 2 * np.pi / self.frequencies

    def _tables(self) -> list[TextTable]:
        columns = self.frequencies, self.periods, self.damping_ratios, self.participation
        names = [f"{j}{', overdamped' * x}" for j, x in enumerate(self.overdamped.tolist(), 1)]
        frequency, period = "rad/s" if self.si else "ω1", unit("time", self.si)
        times = f"frequency ({frequency})", f"period ({period})"
        heading = ("mode", *times, "damping ratio", "share of mass")
        return [TextTable("Modes", heading, [*zip(names, *columns, strict=True)], digits=4)]


def modes(structures: Structures) -> Modes:
    """Natural frequencies, damping ratios and shapes of structures, by their fractional rods.

    Raises ``ValueError`` if structures are traced or a batch.

    Parameters
    ----------
    structures
        ``Storeys``, a ``System`` or any other structures with concrete numbers. Of their links
        inerters and dampers count: friction and contact have no modes. Those of ``Buildings`` are
        in rad/s and s; for a single building there is ``ShearBuilding.modes``.

    Examples
    --------
    >>> elastic = jp.ZenerRod(order=1.0, tau_f=1e-9, tau_x=1e-9)
    >>> modes = jp.modes(jp.Storeys((1.0, 1.0), jp.Rod(elastic, 1.0)))
    >>> modes.frequencies.round(6).tolist()  # the golden section and its inverse
    [0.618034, 1.618034]
    """
    linear = _Linear(structures)
    undamped = linear.stiffness(1j * linear.steady(0)[0])[0].real
    squares, vectors = np.linalg.eigh(undamped)
    eigenvalues = linear.free(vectors, 1j * np.sqrt(squares))
    vibrations = [linear.vibration(j, eigenvalues) for j in range(linear.n)]
    frequencies, damping, shapes = (np.array(x) for x in zip(*vibrations, strict=True))
    driven = linear.masses * structures.system().influences
    whole = float(driven @ structures.system().influences) or np.nan
    shares = (driven @ linear.unscaled(vectors)) ** 2 / whole
    order = np.argsort(frequencies, kind="stable")
    largest = shapes[np.arange(linear.n), np.abs(shapes).argmax(1)]
    return Modes(
        frequencies=frequencies[order],
        damping_ratios=damping[order],
        shapes=(shapes.T / largest)[:, order],
        eigenvalues=eigenvalues[order],
        participation=shares[order],
        si=in_si(structures),
    )


def first_frequency(structures: Structures) -> float:
    """Frequency of the steady vibration of the first mode (``Modes``)."""
    return _Linear(structures).steady(0)[0]


class _Linear:
    """Masses, rods and inerters of concrete structures, scaled so that the mass matrix is 1."""

    def __init__(self, structures: Any) -> None:
        if hasattr(structures, "modes") and not hasattr(structures, "system"):
            rule = "in SI units have a method of their own, modes()"
            raise InvalidInput("structures", "", rule)
        instance("structures", structures, Structures)
        system = structures.system()
        inerters = [link.inerter for link in system.links]
        rods = *system.rods, *system.damping
        leaves = jax.tree.leaves((system.masses, rods, inerters))
        if not is_known_and_single(leaves):
            rule = "must be known, not traced" if is_traced(leaves) else "must be one, not a batch"
            raise InvalidInput("structures", "", rule)
        self.masses = np.array([float(mass) for mass in system.masses])
        self.n = self.masses.size
        unit_motions = [*np.eye(self.n)]
        inertia = np.diag(self.masses)
        for link in system.links:
            if link.inerter is not None:
                influence = elongation(link, unit_motions)
                inertia += float(link.inerter.inertance) * np.outer(influence, influence)
        self._root = np.linalg.cholesky(inertia)
        self._rods: list[tuple[Any, Any]] = []
        for rod in rods:
            influence = np.linalg.solve(self._root, elongation(rod, unit_motions))
            law = rod.material
            if isinstance(law, Dashpot):
                numbers = 0.0, float(law.coefficient), 1.0, 0.0
            elif isinstance(law, PowerLaw):
                c = float(law.force / law.velocity) if law.exponent == 1 else 0.0  # if linear
                numbers = 0.0, c, 1.0, c / float(rod.stiffness)
            else:
                k, law = float(rod.stiffness), before_yield(law)
                numbers = k, k * float(law.tau_x), float(law.order), float(law.tau_f)
            self._rods.append((np.outer(influence, influence), numbers))

    def unscaled(self, vectors: np.ndarray) -> np.ndarray:
        """Displacements of vectors for which the mass matrix is 1."""
        return np.linalg.solve(self._root.T, vectors)

    def stiffness(self, s: complex) -> tuple[np.ndarray, np.ndarray]:
        """K*(s) and its derivative by s."""
        value = np.zeros((self.n, self.n), complex)
        slope = np.zeros_like(value)
        for matrix, (k, k_tau_x, order, tau_f) in self._rods:
            z = s**order
            below = 1 + tau_f * z
            value += (k + k_tau_x * z) / below * matrix
            slope += (k_tau_x - k * tau_f) / below**2 * order * z / s * matrix
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
        return omega, complex(values[k]), self.unscaled(vectors[:, k])

    def free(self, vectors: np.ndarray, starts: np.ndarray) -> np.ndarray:
        """Exponents s of the free vibrations, followed from those of undamped modes.

        First each mode vibrates alone, then damping couples them more and more. NaN if a path ends
        without a vibration: overdamped motions creep.
        """
        alone = starts
        for _ in range(_ITERATIONS):  # which keeps to the left of the imaginary axis and above 0
            stiffnesses = [self.stiffness(x)[0] for x in alone]
            alone = 1j * np.sqrt(np.einsum("ij,jik,kj->j", vectors, stiffnesses, vectors))
        s = np.where(alone.imag > 1e-6 * abs(alone), alone, starts)
        vibrates = np.ones(self.n, bool)
        for share in np.linspace(0, 1, _STEPS + 1)[1:]:
            start, steps = s, s.copy()
            for _ in range(_ITERATIONS):
                active = abs(steps) > 1e-9 * abs(s)
                for j in np.flatnonzero(active).tolist():
                    steps[j] = self._step(j, s, share, vectors)
                s = s - np.where(active, steps, 0)
            vibrates = (abs(steps) <= 1e-6 * abs(s)) & (abs(s.imag) > 1e-6 * abs(s))
            s = np.where(vibrates, s.real + 1j * abs(s.imag), start)
        return np.where(vibrates, s, _NONE)

    def _step(self, j: int, roots: np.ndarray, share: float, vectors: np.ndarray) -> complex:
        """Newton's step to root j of det (s² + K*(s)), where modes are coupled by a share of K*.

        The determinant is over the product of s − x for all other roots, so that no two paths meet
        (Aberth 1973); those that start as one are a multiple root.
        """
        s, others, shared = roots[j], np.delete(roots, j), np.full((self.n, self.n), share)
        np.fill_diagonal(shared, 1)
        stiffness, slope = (shared * (vectors.T @ x @ vectors) for x in self.stiffness(s))
        matrix, slope = stiffness + s**2 * np.eye(self.n), slope + 2 * s * np.eye(self.n)
        try:
            ratio = np.linalg.solve(matrix, slope)
        except np.linalg.LinAlgError:  # s is exact to the last digit
            return 0.0
        away = s - np.concatenate([others, roots.conj()])
        equal = abs(away) <= 1e-6 * abs(s)
        return (1 + equal.sum()) / (np.trace(ratio) - np.sum(1 / away[~equal]))

    def vibration(self, j: int, eigenvalues: np.ndarray) -> tuple[float, float, np.ndarray]:
        """Frequency, damping ratio and shape of mode j; of an overdamped one as it is steady."""
        if np.isnan(s := eigenvalues[j]):
            omega, value, shape = self.steady(j)
            return omega, value.imag / value.real / 2, shape
        _, sizes, vectors = np.linalg.svd(self.stiffness(s)[0] + s**2 * np.eye(self.n))
        equal = np.sum(abs(eigenvalues[:j] - s) <= 1e-6 * abs(s))  # modes before it
        independent = max(1, np.sum(sizes <= 1e-6 * sizes[0]))
        shape = vectors[-1 - min(equal, independent - 1)].conj()
        return abs(s), -s.real / abs(s), self.unscaled(shape)
