"""Displacements and velocities of masses at the start of a run."""

from __future__ import annotations

from typing import Any

from jaxpound._checks import Rule
from jaxpound._errors import InvalidInput
from jaxpound._fields import parameter, pytree_dataclass
from jaxpound.model.ends import along, link_ends
from jaxpound.model.places import link_places
from jaxpound.model.system import System


@pytree_dataclass
class InitialState:
    """Displacements and velocities of all masses at t = 0, relative to the ground.

    The rods have been held at these displacements for an infinite time: they start relaxed, with
    the forces K e of their elongations e and no memory of the past. (Rods that were stretched
    quickly pull back harder at first, until their forces relax: simulate the stretching for that.)

    Raises ``ValueError`` if a concrete value is not finite.

    Parameters
    ----------
    displacements
        One number a mass, in units of g/ω1², or in m with ``Buildings``; () for 0 throughout.
    velocities
        One number a mass, in units of g/ω1, or in m/s with ``Buildings``; () for 0 throughout.

    Examples
    --------
    One of two blocks starts displaced; friction between them holds it before it is back:

    >>> still = jp.Ricker(0.0, [1.0], [0.0])
    >>> aside = jp.InitialState(displacements=(0.3, 0.0))
    >>> grid = jp.TimeGrid.until(20.0, dt=0.05)
    >>> response = jp.simulate(jp.paper.structures(), still, grid, initial=aside)
    >>> round(float(response.x1[0]), 3), round(float(response.x1[-1]), 3)
    (0.3, 0.224)
    """

    displacements: tuple[Any, ...] = parameter(
        "x_0", "length", "initial displacement", each=True, default=()
    )
    velocities: tuple[Any, ...] = parameter(
        "v_0", "velocity", "initial velocity", each=True, default=()
    )

    def of(self, system: System) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        """Displacements and velocities of a system's masses; an ``InvalidInput`` for too few."""
        n = len(system.masses)
        for name in ("displacements", "velocities"):
            if len(values := getattr(self, name)) not in (0, n):
                rule = f"must be one number for each of {n} masses, or ()"
                raise InvalidInput(f"initial: {name} of {len(values)} numbers", "", rule)
        return self.displacements or (0.0,) * n, self.velocities or (0.0,) * n


def initial_rules(initial: InitialState, system: System, dt: float) -> list[Rule]:
    """The rules of a state for a run with steps of ``dt``: links with a contact law are open."""
    x, v = initial.of(system)
    rules = []
    columns = link_places(system.topology), system.links, link_ends(system.links)
    for place, link, ends in zip(*columns, strict=True):
        if link.contact is not None:
            left = link.gap - along(ends, x)
            rule = "open, and stay so for a step: a law of contact starts apart"
            rules.append(Rule(f"initial: gap of {place}", left, left > dt * along(ends, v), rule))
    return rules
