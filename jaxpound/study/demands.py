"""The demands of a scenario by name, and the gaps that its earthquake needs."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import reduce
from typing import Any

import numpy as np

from jaxpound._checks import is_traced
from jaxpound._extrema import larger
from jaxpound.grid import TimeGrid
from jaxpound.ground.motion import GroundLike
from jaxpound.ground.plausibility import far_apart
from jaxpound.model.system import (
    GROUND,
    Structures,
    System,
    Topology,
    is_closable,
    is_storey,
)
from jaxpound.results.demand import Demand
from jaxpound.results.elements import of_link, place_of
from jaxpound.simulation.run import demand
from jaxpound.simulation.scheme import Scheme


def is_ours(name: str) -> bool:
    """Whether a column is one of ``demands_of``, not a measure or a parameter of the user's."""
    of_gaps = re.fullmatch(r"required_gap(_[1-9]\d*)?", name)
    return bool(of_gaps) or name in OF_FLOORS or place_of(Demand, name) is not None


def rest_gap(structures: Structures) -> Any:
    """The one gap at rest of all links that have one; None where there is none, or more than one.

    Several gaps that are known only when the program runs are not one, unless they are one object.
    """
    gaps = [link.gap for link in structures.system().links if is_closable(link.gap)]
    if not gaps or not all(gap is gaps[0] or _equal(gap, gaps[0]) for gap in gaps):
        return None
    return gaps[0]


def _equal(one: Any, other: Any) -> bool:
    return not is_traced((one, other)) and np.array_equal(one, other)


def demands_of(
    structures: Structures, ground: GroundLike, grid: TimeGrid, scheme: Scheme
) -> dict[str, Any]:
    """The scalars of ``Demand`` by name, those over all floors, and the gaps that are required."""
    found, system = demand(structures, ground, grid, scheme), structures.system()
    return found.scalars() | over_all(system, found) | required_gaps(system, found)


def required_gaps(system: System, found: Demand) -> dict[str, Any]:
    """The smallest gaps at rest without pounding, where they can be told.

    ``required_gap_2`` is that of link 2, its gap at rest less its smallest gap, where the gap is
    finite and has no law of contact: once neighbours have met, their motion does not tell how far
    they would have moved without. ``required_gap`` is the largest of them, the one gap that all
    links would need, if no link that can close has a law of contact.
    """
    own = {
        k: link.gap - found.links[k].min_gap
        for k, link in enumerate(system.links)
        if is_closable(link.gap) and link.contact is None
    }
    n, meet = len(system.links), any(link.contact is not None for link in system.links)
    named = {of_link("required_gap", k, n): gap for k, gap in own.items()}
    return named if meet or not own else named | {"required_gap": reduce(larger, own.values())}


def over_all(system: System, found: Demand) -> dict[str, Any]:
    """The largest demand of all floors, storeys and contacts (``names_over_all``)."""
    touching = [link.contact is not None for link in system.links]
    return {
        name: reduce(
            larger, [getattr(getattr(found, group)[i], field) for group, i, field in those]
        )
        for name, those in _over_all(system.topology, touching).items()
    }


def names_over_all(topology: Topology, touching: Sequence[bool]) -> tuple[str, ...]:
    """Names of the largest demands of several floors, storeys and contacts.

    Of structures with storeys these are ``peak_drift`` and ``peak_acceleration``; of several links
    some of which have a law of contact (``touching``), also ``peak_contact``, ``peak_impulse`` and
    ``peak_penetration``.
    """
    return tuple(_over_all(topology, touching))


def _over_all(
    topology: Topology, touching: Sequence[bool]
) -> dict[str, list[tuple[str, int, str]]]:
    """Group, element and field of the demands that each name is the largest of."""
    found: dict[str, list[tuple[str, int, str]]] = {}
    if any(map(is_storey, topology.rods)):
        drift, acceleration = OF_FLOORS
        # The drift of a storey above the ground is the displacement of its floor.
        found[drift] = [
            ("rods", r, drift) if is_storey(ends) else ("masses", max(ends), "peak_x")
            for r, ends in enumerate(topology.rods)
        ]
        found[acceleration] = [("masses", i, acceleration) for i in range(topology.n_masses)]
    if len(touching) > 1 and any(touching):
        those = [k for k, touches in enumerate(touching) if touches]
        found |= {name: [("links", k, name) for k in those] for name in OF_CONTACTS}
    return found


OF_FLOORS = ("peak_drift", "peak_acceleration")
"""Demands of a storey and of a floor whose largest over all has the name without a number."""

OF_CONTACTS = ("peak_contact", "peak_impulse", "peak_penetration")
"""Demands of a link whose largest over several links has the name without a number."""


def unreached(
    topology: Topology,
    smallest: Callable[[str], float],
    largest: Callable[[str], float],
    *,
    pair: bool,
    si: bool,
) -> list[str]:
    """Findings: gaps out of proportion to the displacements of a whole study.

    Parameters
    ----------
    topology
        Of the structures.
    smallest, largest
        The extremes of a column by its name; of an infinite gap NaN or infinite.
    pair
        Whether the structures call their gap ``initial_gap``.
    si
        Whether the numbers are SI.
    """
    findings = []
    for k, ends in enumerate(topology.links):
        gap = smallest(of_link("min_gap", k, len(topology.links)))
        if np.isfinite(gap):
            moved = sum(largest(f"peak_x{end + 1}") for end in ends if end != GROUND)
            findings += far_apart("initial_gap" if pair else f"links.{k}.gap", gap, moved, si=si)
    return findings
