"""How eq. (9) is discretised: time grid, scheme, and the largest stable step."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound.model.structures import AdjacentStructures
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
        only, and compute each stretch again on the way back. Memory falls from O(n_steps) to
        O(√n_steps) states; results and derivatives stay the same.

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

    def __post_init__(self) -> None:
        if not hasattr(self.friction, "slide") or isinstance(self.friction, type):
            raise ValueError(f"Scheme: friction = {self.friction!r} must be a friction law")
        if self.order not in (1, 2):
            raise ValueError(f"Scheme: order = {self.order!r} must be 1 or 2")
        if not hasattr(self.history, "kernel") or isinstance(self.history, type):
            raise ValueError(f"Scheme: history = {self.history!r} must be a history")
        if self.start not in ("rest", "paper"):
            raise ValueError(f"Scheme: start = {self.start!r} must be 'rest' or 'paper'")
        if not isinstance(self.checkpoint, bool):
            raise ValueError(f"Scheme: checkpoint = {self.checkpoint!r} must be True or False")


PAPER_SCHEME = Scheme(Switching(), order=1, history=FullHistory(), start="paper")
"""The paper's scheme (eqs. 10–12): order 1, full history, switching friction, x_0 = x_1 = 0."""


def stability_limit(structures: AdjacentStructures, scheme: Scheme = Scheme()) -> float:
    """Largest stable time step, in units of 1/ω1, of structures whose values are known.

    Where the scheme loses stability the fastest motion of the grid, x_m = (−1)^m, neither grows nor
    decays: h² max(K1, ρ K2) = 4 with each rod's stiffness for that motion. The limit says nothing
    of accuracy, which asks for some 50 steps in the shorter natural period.

    Examples
    --------
    >>> structures = jp.paper.structures()
    >>> round(jp.stability_limit(structures), 3)
    0.442
    >>> round(jp.stability_limit(structures, jp.PAPER_SCHEME), 3)
    0.561
    """
    known = jax.tree.map(np.asarray, structures)
    stiffest = np.maximum(1.0, known.mass_ratio * known.stiffness_ratio).max()
    low, high = 0.0, 2 / stiffest**0.5  # the static stiffness bounds the step from above
    for _ in range(60):
        middle = (low + high) / 2
        stable = (courant(known, middle, scheme, np) < 1).all()
        low, high = (middle, high) if stable else (low, middle)
    return float(low)


def courant(structures: AdjacentStructures, dt: Any, scheme: Scheme, xp: Any = jnp) -> Any:
    """h² max(K1, ρ K2) / 4: below 1 where explicit stepping is stable."""
    stiff_1 = nyquist_stiffness(structures.rod_1, 1.0, dt, scheme.order)
    stiff_2 = nyquist_stiffness(structures.rod_2, structures.stiffness_ratio, dt, scheme.order)
    return dt**2 / 4 * xp.maximum(stiff_1, structures.mass_ratio * stiff_2)
