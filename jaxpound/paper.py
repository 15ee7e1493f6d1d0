"""The paper's case: parameters of its numerical example, with h = κ = .002 on [0, 20]."""

from __future__ import annotations

from jaxpound.ground import Ricker
from jaxpound.scheme import TimeGrid
from jaxpound.structures import AdjacentStructures, ZenerRod


def structures() -> AdjacentStructures:
    """The two structures. The paper gives no initial gap; any above .696 stays open, here 1."""
    return AdjacentStructures(
        rod_1=ZenerRod(order=0.23, tau_f=0.004, tau_x=1.183),
        rod_2=ZenerRod(order=0.53, tau_f=0.2, tau_x=4.0),
        mass_ratio=1.0,
        stiffness_ratio=2.0,
        friction=0.25,
        initial_gap=1.0,
    )


def ground() -> Ricker:
    """Five Ricker wavelets (eq. 6)."""
    return Ricker(
        amplitude=0.5, periods=[1.25, 1.0, 2.0, 3.5, 3.8], arrivals=[1.5, 2.0, 3.0, 4.0, 5.0]
    )


def grid() -> TimeGrid:
    """10,000 steps of .002."""
    return TimeGrid(dt=0.002, n_steps=10_000)
