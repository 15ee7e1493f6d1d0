"""The paper's numerical example, with h = κ = .002 on [0, 20].

The paper is Žigić and Grahovac, "Dynamics of adjacent structures during horizontal ground motion".
Its ground motion reaches 22 g, which no earthquake does. The system is homogeneous, so that the
case is also that of .22 g, μ = .0025 and a gap of .01 g/ω1²: every displacement and force is then a
hundredth, at the same instants.
"""

from __future__ import annotations

from typing import NamedTuple

from jaxpound.grid import TimeGrid
from jaxpound.ground.wavelets import Ricker
from jaxpound.model.rod import ZenerRod
from jaxpound.model.structures import AdjacentStructures


def structures() -> AdjacentStructures:
    """The two structures. The paper gives no initial gap; any above .696, such as 1, stays open."""
    return AdjacentStructures(
        rod_1=ZenerRod(order=0.23, tau_f=0.004, tau_x=1.183),
        rod_2=ZenerRod(order=0.53, tau_f=0.2, tau_x=4.0),
        mass_ratio=1.0,
        stiffness_ratio=2.0,
        friction=0.25,
        initial_gap=1.0,
    )


def ground() -> Ricker:
    """Five Ricker wavelets (eq. 6), up to 22 g; a hundredth of it is equivalent (see the module).

    Examples
    --------
    >>> round(float(jp.pga(jp.paper.ground(), jp.paper.grid())), 1)  # in g
    22.0
    """
    periods, arrivals = [1.25, 1.0, 2.0, 3.5, 3.8], [1.5, 2.0, 3.0, 4.0, 5.0]
    return Ricker(amplitude=0.5, periods=periods, arrivals=arrivals)


def grid() -> TimeGrid:
    """10,000 steps of .002."""
    return TimeGrid(dt=0.002, n_steps=10_000)


class Reference(NamedTuple):
    """Results of an independent solver for the paper's case, dimensionless."""

    min_gap_change: float
    """Smallest x2 − x1, in g/ω1²; the smallest gap is this plus ξ0."""
    min_gap_time: float
    """Its instant, in 1/ω1."""
    phase_changes: tuple[tuple[float, str], ...]
    """Instants at which stick or slip changes, and the new phase; the first phase is stick."""
    gradient: dict[str, float]
    """Derivatives of the smallest gap by the parameter's path."""


def reference() -> Reference:
    """The paper's case by an event-driven solver that shares nothing with this package's scheme.

    It integrates each rod's exact relaxation spectrum adaptively between located events. Its error
    is 1e-7 in the gap, 1e-6 in the times and, by central differences, 1e-5 in the derivatives.
    """
    return Reference(
        min_gap_change=-0.6953576904934496,
        min_gap_time=7.485141646677831,
        phase_changes=(
            (0.6407985927504466, "slip left"),
            (1.1918951848944157, "slip right"),
            (1.75850180068001, "slip left"),
            (2.6526652617070234, "slip right"),
            (3.431842922335319, "slip left"),
            (4.178860121161499, "slip right"),
            (4.673135468619, "slip left"),
            (5.835848983491708, "slip right"),
            (7.485141646677831, "slip left"),
            (9.406650925155228, "slip right"),
            (11.440562762815782, "stick"),
        ),
        gradient={
            "friction": 0.8763577664742117,
            "rod_1.tau_x": 0.0856772917687169,
            "rod_1.tau_f": -0.5023254044006498,
            "rod_2.tau_x": 0.017510270943564554,
            "rod_2.tau_f": -0.2826428061861175,
            "rod_1.order": 1.2930269577602156,
            "rod_2.order": 0.3395890014121478,
            "stiffness_ratio": 0.024860598162368408,
            "mass_ratio": 0.08090075433886401,
        },
    )
