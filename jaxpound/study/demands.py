"""The demands of a scenario by name, and the gap that its earthquake needs."""

from __future__ import annotations

from typing import Any

import numpy as np

from jaxpound._checks import is_traced
from jaxpound.grid import TimeGrid
from jaxpound.ground.motion import GroundLike
from jaxpound.model.system import Structures
from jaxpound.simulation.run import demand
from jaxpound.simulation.scheme import Scheme


def rest_gap(structures: Structures) -> Any:
    """The one gap at rest of all links; None where there is no link, no gap, or more than one gap.

    Several gaps that are known only when the program runs are not one, unless they are one object.
    """
    gaps = [link.gap for link in structures.system().links]
    if not gaps or not all(gap is gaps[0] or _equal(gap, gaps[0]) for gap in gaps):
        return None
    return gaps[0] if is_traced(gaps[0]) or np.isfinite(gaps[0]).all() else None


def _equal(one: Any, other: Any) -> bool:
    return not is_traced((one, other)) and np.array_equal(one, other)


def demands_of(
    structures: Structures, ground: GroundLike, grid: TimeGrid, scheme: Scheme
) -> dict[str, Any]:
    """The scalars of ``Demand`` by name, and ``required_gap`` where it can be told.

    That is where there is a ``rest_gap`` and no law of contact: once blocks have met, their motion
    does not tell how far they would have moved without.
    """
    found = demand(structures, ground, grid, scheme)
    gap = rest_gap(structures)
    meet = any(link.contact is not None for link in structures.system().links)
    required = {} if gap is None or meet else {"required_gap": gap - found.min_gap}
    return found.scalars() | required
