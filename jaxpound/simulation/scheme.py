"""How the equations of motion are discretised, and the largest stable step."""

from __future__ import annotations

import dataclasses
import reprlib
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound._checks import instance, instead, is_traced
from jaxpound.grid import TimeGrid
from jaxpound.model.system import Structures, System, link_groups, rod_groups
from jaxpound.simulation.friction import EventResolved, FrictionLaw, Switching
from jaxpound.simulation.history import FullHistory, History, ModalHistory
from jaxpound.simulation.rod import nyquist_stiffness


@dataclasses.dataclass(frozen=True)
class Scheme:
    """How eq. (9) is discretised. Static: another scheme is another compiled program.

    Parameters
    ----------
    friction
        Friction law: ``EventResolved()``, ``Switching()`` or ``Smoothed(velocity)``.
    order
        Order of accuracy of the rods: 1 (the paper, eq. 10) or 2.
    history
        ``ModalHistory()`` or ``FullHistory()``.
    start
        ``"rest"`` starts with the half kick of a block at rest, second-order accurate;
        ``"paper"`` sets x_0 = x_1 = 0, first-order accurate.
    checkpoint
        For reverse-mode differentiation of long runs: keep the state at about √n_steps instants
        only, and recompute each segment in the backward pass. Memory falls from O(n_steps) to
        O(√n_steps) states; results and derivatives stay the same.
    extrapolated
        Whether every run is made at dt and at dt/2 as well, and the errors of second order cancel
        (Richardson 1911): positions, velocities, rods' forces and all scalars are (4 y(dt/2) −
        y(dt))/3; forces and phases of links are those at dt. It takes three times as long, and pays
        from relative errors of some 1e-4 downwards. Derivatives stay of second order: how they
        change as an event crosses an instant does not cancel. Only for schemes of second order and
        links without contact laws.

    Examples
    --------
    >>> jp.Scheme(jp.Smoothed(0.1)).friction
    Smoothed(velocity=0.1)
    >>> jp.Scheme(history=jp.ModalHistory(tolerance=1e-8), checkpoint=True).order
    2
    """

    friction: FrictionLaw = EventResolved()
    order: int = 2
    history: History = ModalHistory()
    start: str = "rest"
    checkpoint: bool = False
    extrapolated: bool = False

    def __post_init__(self) -> None:
        if not hasattr(self.friction, "slide") or isinstance(self.friction, type):
            raise ValueError(f"Scheme: friction = {self.friction!r} must be a friction law")
        if self.order not in (1, 2):
            raise ValueError(f"Scheme: order = {self.order!r} must be 1 or 2")
        if not hasattr(self.history, "kernel") or isinstance(self.history, type):
            raise ValueError(f"Scheme: history = {self.history!r} must be a history")
        if self.start not in ("rest", "paper"):
            raise ValueError(f"Scheme: start = {self.start!r} must be 'rest' or 'paper'")
        for name in ("checkpoint", "extrapolated"):
            if not isinstance(getattr(self, name), bool):
                raise ValueError(f"Scheme: {name} = {getattr(self, name)!r} must be True or False")
        second = self.order == 2 and self.start == "rest"
        if self.extrapolated and not (second and not isinstance(self.friction, Switching)):
            rule = 'must have order 2, start "rest" and another friction than Switching()'
            raise ValueError(f"Scheme: extrapolated = True {rule}")

    def finest(self, grid: TimeGrid) -> TimeGrid:
        """The finest grid of a run."""
        return grid.halved if self.extrapolated else grid


PAPER_SCHEME = Scheme(Switching(), order=1, history=FullHistory(), start="paper")
"""The paper's scheme (eqs. 10–12): order 1, full history, switching friction, x_0 = x_1 = 0."""


def stability_limit(structures: Structures, scheme: Scheme = Scheme()) -> float:
    """Largest stable time step, in units of 1/ω1, of structures whose values are known.

    Where the scheme loses stability the fastest motion of the grid, x_m = (−1)^m, neither grows nor
    decays: h² λ = 4 with the largest eigenvalue λ of M⁻¹ K, where K has each rod's stiffness for
    that motion (for the paper's pair λ is the larger of K1 and ρ K2). Links in stick never raise λ.
    The limit says nothing of accuracy, which asks for some 50 steps in the shortest natural period.

    Parameters
    ----------
    structures
        ``AdjacentStructures``, a ``System`` or anything else with ``system()``; for a batch, the
        result is the smallest limit.
    scheme
        The discretisation.

    Raises
    ------
    ValueError
        If structures is something else, or its values are traced.

    Examples
    --------
    >>> structures = jp.paper.structures()
    >>> round(jp.stability_limit(structures), 3)
    0.442
    >>> round(jp.stability_limit(structures, jp.PAPER_SCHEME), 3)
    0.561
    """
    system = system_of("stability_limit", structures)
    if is_traced(system):
        raise ValueError("stability_limit: structures must be known, not traced")
    known = jax.tree.map(np.asarray, system)
    static = _largest_eigenvalue(known, [rod.stiffness for rod in known.rods])
    low, high = 0.0, 2 / float(np.max(static)) ** 0.5  # a rod is never softer than at rest
    for _ in range(60):
        middle = (low + high) / 2
        stable = (_courant(known, middle, scheme) < 1).all()
        low, high = (middle, high) if stable else (low, middle)
    return float(low)


def system_of(owner: str, structures: Any) -> System:
    """The system of structures; a ``ValueError`` for what is none."""
    if not isinstance(structures, Structures) or isinstance(structures, type):
        rule = "AdjacentStructures, a System, or anything else with system()"
        rule += instead(structures, rule)
        raise ValueError(f"{owner}: structures = {reprlib.repr(structures)} must be {rule}")
    system = structures.system()
    instance(owner, "structures.system()", system, System)
    return system


def require_stable(system: System, grid: TimeGrid, scheme: Scheme) -> None:
    """A ``ValueError`` for a step with which a known system diverges."""
    if is_traced(system):
        return
    known = jax.tree.map(np.asarray, system)
    if not _courant(known, grid.dt, scheme) < 1:
        limit = stability_limit(system, scheme)
        rule = f"below the stability limit {limit:.8g} of these structures"
        raise ValueError(f"grid: dt = {grid.dt:.8g} must be {rule}")


def require_followed(system: System, scheme: Scheme) -> None:
    """A ``ValueError`` for a scheme that cannot follow a system's links from event to event."""
    if scheme.extrapolated:
        for k, link in enumerate(system.links):
            if link.contact is not None:
                rule = (
                    "must have no contact: impacts leave no error that extrapolation could take out"
                )
                raise ValueError(f"scheme: extrapolated = True: links.{k} {rule}")
    if isinstance(scheme.friction, EventResolved) and scheme.start == "rest":
        return
    for group in link_groups(system.topology):
        several = len(group.links) > 1
        law = system.links[group.links[0]].contact
        if several or law is not None:
            what = "links that share masses" if several else f"contact = {type(law).__name__}"
            rule = 'friction EventResolved() and start "rest"'
            raise ValueError(
                f"scheme: friction = {scheme.friction} with start {scheme.start!r} must be {rule} "
                f"for links.{group.links[0]} with {what}"
            )


def is_stable(system: System, dt: Any, scheme: Scheme) -> Any:
    """Whether explicit stepping is stable, traceable (see ``stability_limit``).

    1 − (h²/4) M^(−1/2) K M^(−1/2) is then positive definite. Elimination tells so without a call of
    LAPACK: two of these at a time in a large batch, one for each building of a row, wait for each
    other for ever in XLA's threads on a machine of two cores.
    """
    stable: Any = True
    for matrix in _scaled_stiffness(system, _nyquist(system, dt, scheme), jnp):
        one = jnp.eye(matrix.shape[-1], dtype=matrix.dtype)
        rest = jax.lax.stop_gradient(one - dt**2 / 4 * matrix)  # no derivative is asked for
        while rest.shape[-1]:
            pivot, column = rest[0, 0], rest[1:, 0]
            stable &= pivot > 0  # false for NaN
            rest = rest[1:, 1:] - jnp.outer(column, column) / jnp.where(pivot > 0, pivot, 1.0)
    return stable


def _courant(system: System, dt: Any, scheme: Scheme) -> Any:
    """h² λ / 4 of a known system, below 1 where explicit stepping is stable."""
    return dt**2 / 4 * _largest_eigenvalue(system, _nyquist(system, dt, scheme))


def _nyquist(system: System, dt: Any, scheme: Scheme) -> list[Any]:
    """The stiffness of each rod at the highest frequency that steps resolve."""
    return [nyquist_stiffness(rod.material, rod.stiffness, dt, scheme.order) for rod in system.rods]


def _largest_eigenvalue(system: System, stiffness: list[Any]) -> Any:
    """The largest eigenvalue of M⁻¹ K of a known system, with a stiffness for each rod."""
    matrices = _scaled_stiffness(system, stiffness, np)
    return np.max([np.linalg.eigvalsh(matrix)[..., -1] for matrix in matrices], axis=0)


def _scaled_stiffness(system: System, stiffness: list[Any], xp: Any) -> list[Any]:
    """M^(−1/2) K M^(−1/2) of each group of masses that rods join: others are uncoupled."""
    topology, matrices = system.topology, []
    for masses in rod_groups(topology):
        rods = [k for k, ends in enumerate(topology.rods) if set(ends) & {*masses}]
        k = xp.stack(xp.broadcast_arrays(*[stiffness[i] for i in rods]), -1)
        m = xp.stack(xp.broadcast_arrays(*[system.masses[i] for i in masses]), -1)
        ends = [topology.rods[i] for i in rods]
        signs = [[(mass == i) - (mass == j) for i, j in ends] for mass in masses]
        root = np.array(signs, k.dtype) / xp.sqrt(m)[..., None]
        matrices.append((root * k[..., None, :]) @ xp.swapaxes(root, -1, -2))
    return matrices
