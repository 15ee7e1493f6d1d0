"""The demand of a run by its name: what limit states and analyses of suites are about."""

from __future__ import annotations

import reprlib
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from jaxpound._checks import did_you_mean, hint
from jaxpound.model.system import Structures, System, is_closable
from jaxpound.results.demand import Demand, known_of
from jaxpound.study.demands import OF_FLOORS, is_ours, over_all, required_gaps

REQUIRED_GAP = "required_gap"
"""Name of the largest closing of any link."""

OVERLAP = "overlap"
"""Name of the demand in pounding where links differ in their gaps: the largest of −ξ."""

Demanded = str | Callable[[Demand], Any]


def passing_through(structures: Structures) -> Structures:
    """The structures without laws of contact, so that blocks may pass through each other.

    Whether they meet is the same with and without one; how far they close is known only without.
    """
    system = structures.system()
    if all(link.contact is None for link in system.links):
        return structures
    return replace(system, links=tuple(replace(link, contact=None) for link in system.links))


def demand_named(owner: str, system: System, found: Demand, name: str) -> Any:
    """The demand of a run by its name, dimensionless.

    Raises
    ------
    ValueError
        If the name is unknown, or gaps are asked for where none is finite.
    """
    if name in (REQUIRED_GAP, OVERLAP) and not any(is_closable(x.gap) for x in system.links):
        raise ValueError(f"{owner}: structures must have a link whose gap is finite")
    if name == OVERLAP:
        return -found.min_gap
    known = found.scalars() | over_all(system, found) | required_gaps(system, found)
    if name not in known:
        about = known_of(name)
        if about is not None and about.only == "contact":
            raise ValueError(f"{owner}: demand = {name!r} must be of structures with a contact law")
        raise ValueError(f"{owner}: unknown demand {reprlib.repr(name)}; {hint(name, known)}")
    return known[name]


def require_threshold(owner: str, demand: Any) -> None:
    """A ``ValueError`` for a demand without the threshold that it needs, or of an unknown name."""
    if isinstance(demand, str) and not is_ours(demand):
        meant = (
            did_you_mean(demand, OF_FLOORS) or "demands are named as in Demand, such as 'peak_x1'"
        )
        raise ValueError(f"{owner}: unknown demand {reprlib.repr(demand)}; {meant}")
    shown = repr(demand) if isinstance(demand, str) else "a function"
    raise ValueError(f"{owner}: threshold = None must be a number: demand is {shown}")
