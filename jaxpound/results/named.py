"""Demands by their names: what each is called, its unit, its limits, and its value in a run.

Besides the scalars of ``Demand`` by flat name, a demand may be one over all floors or contacts
(``peak_drift``), a required gap, the ``OVERLAP`` of blocks, or the slip force of a damper.
"""

from __future__ import annotations

import itertools
import re
import reprlib
from collections.abc import Callable
from functools import partial, reduce
from typing import Any

import jax.numpy as jnp

from jaxpound._checks import Range, did_you_mean, hint, real
from jaxpound._errors import InvalidInput
from jaxpound._extrema import larger
from jaxpound._fields import Quantity
from jaxpound.model.contact import Newton
from jaxpound.model.dampers import PowerLaw
from jaxpound.model.hysteresis import hysteresis_of
from jaxpound.model.plausibility import GAP
from jaxpound.model.rod import ZenerRod
from jaxpound.model.system import Link, Rod, System, is_closable
from jaxpound.model.topology import GROUND, Topology, is_storey
from jaxpound.quantities import unit
from jaxpound.results.demand import OF_FLOORS, OF_YIELDING, Demand, members_over_all, words_of
from jaxpound.results.elements import columns_of, of_link, place_of, sizes_of

REQUIRED_GAP = "required_gap"
"""Name of the largest closing of any link."""

OVERLAP = "overlap"
"""Name of the demand in pounding where links differ in their gaps: the largest of −ξ."""

DemandSpec = str | Callable[[Demand], Any]
"""A demand by its name, or a function of a run's ``Demand``."""

_DAMPER, _ALL_DAMPERS = "damper_force", "total_damper_force"
_INERTANCE = "total_inertance"

_further = partial(Quantity, limited=True)
_FURTHER = {
    _DAMPER: _further("force", "slip force of the damper", _DAMPER, "slip force"),
    _ALL_DAMPERS: _further("force", "forces of all dampers together", "", "total damper force"),
    _INERTANCE: _further("mass", "inertances of all inerters together", "", "total inertance"),
    REQUIRED_GAP: Quantity("length", "required gap", REQUIRED_GAP, "required gap"),
    OVERLAP: Quantity("length", "overlap"),
    "initial_gap": Quantity("length", "gap at rest"),
    "peak_drift": _further("length", "largest storey drift", "", "largest peak drift $|d|$"),
    "peak_acceleration": _further(
        "acceleration", "largest absolute acceleration", "", "largest peak $|a|$"
    ),
    "ductility": _further(None, "largest ductility", "", r"largest ductility $\mu$"),
    "residual_drift": _further("length", "largest residual drift", "", "largest residual drift"),
    "dissipated_energy": _further("energy", "largest energy dissipated by a storey"),
    "collapsed": Quantity(None, "collapse"),
    "spectral_acceleration": Quantity(
        "acceleration", "spectral acceleration at period {}", "spectral_acceleration_{}"
    ),
}
"""Columns of studies and designs beside ``Demand``; those with a ``column`` may be numbered."""


def quantity_named(name: str) -> Quantity | None:
    """Metadata of a demand by its name; None for a pure number and for any other column."""
    if place := place_of(Demand, name):
        return place.quantity
    if name in _FURTHER:
        return _FURTHER[name]
    base, _, number = name.rpartition("_")
    quantity = _FURTHER.get(base)
    return quantity.of(number) if quantity and quantity.column and number.isdigit() else None


def kind_of(name: str) -> str | None:
    """Kind of quantity of a demand; None for a pure number and for any other column."""
    return getattr(quantity_named(name), "kind", None)


_THRESHOLDS = {  # in SI, by the kind of quantity
    "force": Range(1e-6, 1e12, "N", "a hundred times the weight of the heaviest tower"),
    "length": Range(1e-9, 1e3, "m", "up to a kilometre"),
    "acceleration": Range(1e-6, 1e4, "m/s²", "up to a thousand times gravity"),
    "velocity": Range(1e-6, 1e3, "m/s", "faster than sound"),
    "time": Range(1e-6, 3600, "s", "from the start of the run"),
    "energy": Range(1e-9, 1e15, "J", "a force and a length of these sizes"),
    "mass": Range(1e-6, 1e12, "kg", "up to the inertance of many buildings"),
    "impulse": Range(1e-9, 1e15, "N s", "a force for a time"),
    None: Range(1e-9, 1e9, "", "of a count or a ratio"),
}


def threshold_range(demand: str) -> Range:
    """The range of a threshold or limit of a demand in SI: beyond it all runs reach it, or none."""
    within = _THRESHOLDS[kind_of(demand)]
    return GAP._replace(low=within.low) if demand == REQUIRED_GAP else within


def unit_of(name: str, si: bool) -> str:
    """Unit of a demand; empty for a pure number and for any other column."""
    return unit(kind_of(name), si)


def in_words(name: str, topology: Topology | None = None) -> str:
    """A demand's name in words; any other column's name with spaces.

    A topology calls masses, rods and links by floor and storey; else each mass is a building.
    """
    if (quantity := quantity_named(name)) is None:
        return name.replace("_", " ")
    return words_of(name, topology, quantity)


def demand_in_words(name: str, topology: Topology | None = None) -> str:
    """A demand ``in_words``, with its SI unit in parentheses; a pure number has none."""
    of_unit = unit_of(name, si=True)
    return in_words(name, topology) + (f" ({of_unit})" if of_unit else "")


def event_in_words(name: str, threshold: float, si: bool, topology: Topology | None = None) -> str:
    """What the fragility of a demand is of: pounding, or that the demand reaches the threshold."""
    if name in (REQUIRED_GAP, OVERLAP):
        return "pounding"
    return f"{in_words(name, topology)} ≥ {threshold:.4g} {unit_of(name, si)}".rstrip()


def kind_and_symbol(name: str, topology: Topology | None = None) -> tuple[str | None, str]:
    """Kind of a demand and its name in a figure, where floors of a row are in words.

    Of any other column None and its own name.
    """
    if (quantity := quantity_named(name)) is None or not quantity.symbol:
        return None, name.replace("_", " ")
    if topology and (topology.n_masses > 2 or len(topology.links) > 1) and name[-1].isdigit():
        return quantity.kind, re.sub(" (of .*)|(?<=,) ", r"\n\1", in_words(name, topology), count=1)
    return quantity.kind, quantity.symbol


def is_demand(name: str) -> bool:
    """Whether a study's column is a demand, not a user-defined measure or a parameter."""
    is_gap = re.fullmatch(rf"{REQUIRED_GAP}(_[1-9]\d*)?", name) is not None
    is_over_all = name in (*OF_FLOORS, *OF_YIELDING, "collapsed")
    return is_gap or is_over_all or place_of(Demand, name) is not None


def is_zero_by_newton(name: str) -> bool:
    """Whether a demand is 0 in every impact by ``Newton``'s law, which has no contact force."""
    forces_and_depth = ("peak_contact", "soft_peak_contact", "peak_penetration")
    return getattr(place_of(Demand, name), "field", None) in forces_and_depth


def limitable_demands(system: System) -> tuple[str, ...]:
    """Names of the demands of a system that a design may limit or penalise.

    Scalars of ``Demand`` by flat name, ``residual_offset`` by its absolute value; the slip forces
    of links (``damper_force``) and, of several dampers, the sum of these and of the forces of
    viscous ones at their reference velocity; the sum of inertances; the largest demands of
    ``over_all``.
    """
    topology, n, has = system.topology, len(system.links), _present(system)
    n_dampers = n + len(viscous_forces(system))
    names = [of_link(_DAMPER, k, n) for k in range(n)] + [_ALL_DAMPERS] * (n_dampers > 1)
    names += [_INERTANCE] * bool(inertances(system))
    for quantity, names_of in columns_of(Demand, sizes_of(topology)):
        if quantity.limited:
            present = has[quantity.only] if quantity.only else itertools.repeat(True)
            names += itertools.compress(names_of, present)
    return (*names, *members_over_all(topology, has))


def inertances(system: System) -> list[Any]:
    """The inertance of each inerter."""
    return [link.inerter.inertance for link in system.links if link.inerter]


def viscous_forces(system: System) -> list[Any]:
    """The force of each viscous damper at its reference velocity."""
    return [rod.material.force for rod in system.rods if isinstance(rod.material, PowerLaw)]


def _present(system: System) -> dict[str, list[bool]]:
    """Whether each element has the quantities that some have only, by ``Quantity.only``."""
    return {
        "contact": [link.contact is not None for link in system.links],
        "column": [link.column is not None and link.contact is not None for link in system.links],
        "capacity": [getattr(link.column, "capacity", None) is not None for link in system.links],
        "supports": [
            system.topology.n_supports > 0 and is_closable(link.gap) for link in system.links
        ],
        "yielding": [hysteresis_of(rod.material) is not None for rod in system.rods],
        "storey": [is_storey(ends) for ends in system.topology.rods],
    }


# The numbers of this pair do not matter.
_RODS = tuple(Rod(ZenerRod(1.0, 1.0, 1.0), 1.0, ends=(mass, GROUND)) for mass in (0, 1))
_PAIR = System((1.0, 1.0), _RODS, (Link((0, 1), gap=1.0, contact=Newton(1.0)),))

PAIR = _PAIR.topology
"""Two adjacent structures."""

LIMITABLE_OF_PAIR = limitable_demands(_PAIR)
"""``limitable_demands`` of two adjacent structures with a law of contact."""


def over_all(system: System, demand: Demand) -> dict[str, Any]:
    """The largest demands of all storeys and floors, and of all contacts of several links."""
    names = members_over_all(system.topology, _present(system))
    return {name: getattr(demand, name) for name in names}


def required_gaps(system: System, demand: Demand) -> dict[str, Any]:
    """The smallest gaps at rest without pounding, where a run determines them.

    ``required_gap_2`` is that of link 2, its gap at rest less its smallest gap, where the gap is
    finite and has no law of contact: once neighbours have met, their motion does not show how far
    they would have moved without. ``required_gap`` is the largest, if no link has such a law.
    """
    gaps = {
        k: link.gap - demand.links[k].min_gap
        for k, link in enumerate(system.links)
        if is_closable(link.gap) and link.contact is None
    }
    named = {of_link(REQUIRED_GAP, k, len(system.links)): gap for k, gap in gaps.items()}
    if any(link.contact is not None for link in system.links) or not gaps:
        return named
    return named | {REQUIRED_GAP: reduce(larger, gaps.values())}


def all_demands(system: System, demand: Demand) -> dict[str, Any]:
    """The scalars of a run by name, those over all floors, and the required gaps."""
    return demand.scalars() | over_all(system, demand) | required_gaps(system, demand)


def limited_values(system: System, demand: Demand) -> dict[str, Any]:
    """The ``limitable_demands`` of a run by name, among other scalars; in one system of units."""
    slip_forces = [link.friction for link in system.links]
    n, forces = len(slip_forces), [*slip_forces, *viscous_forces(system)]
    return (
        demand.scalars()
        | over_all(system, demand)
        | {name: jnp.abs(x) for name, x in demand.flat("residual_offset").items()}
        | {of_link(_DAMPER, k, n): x for k, x in enumerate(slip_forces)}
        | {_ALL_DAMPERS: sum(forces), _INERTANCE: sum(inertances(system))}
    )


def value_of(system: System, demand: Demand, spec: DemandSpec) -> Any:
    """The demand of a run by its name or the user's function; traceable.

    Raises ``InvalidInput`` if the structures have no such demand, or the function gives no number.
    """
    if not isinstance(spec, str):
        value = jnp.asarray(real("demand", spec(demand)))
        return value.astype(jnp.result_type(float, value))
    if spec in (REQUIRED_GAP, OVERLAP) and not any(is_closable(x.gap) for x in system.links):
        raise InvalidInput("structures", "", "must have a link whose gap is finite")
    if spec == OVERLAP:
        return -demand.min_gap
    if spec in (values := all_demands(system, demand)):
        return values[spec]
    of_all = spec in (*OF_YIELDING, "collapsed")
    only = "yielding" if of_all else getattr(quantity_named(spec), "only", "")
    if needed := _NEEDED.get(only):
        raise InvalidInput("demand", repr(spec), f"must be of structures with {needed}")
    raise InvalidInput("", "", f"unknown demand {reprlib.repr(spec)}; {hint(spec, values)}")


_NEEDED = {"contact": "a contact law", "yielding": "a rod that yields"}
_NEEDED |= {"column": "contact at a column", "capacity": "contact at a column with a capacity"}
_NEEDED |= {"supports": "a gap, on supports that move apart"}


def require_limited(name: Any, place: str) -> None:
    """An ``InvalidInput`` for no limited demand of any system; ``place`` follows its name."""
    quantity = quantity_named(name) if isinstance(name, str) else None
    if quantity is None or not quantity.limited:
        limited = (*LIMITABLE_OF_PAIR, _ALL_DAMPERS, _INERTANCE, *OF_FLOORS, *OF_YIELDING)
        raise InvalidInput("", "", f"unknown demand {name!r}{place}; {hint(name, limited)}")


def require_threshold(demand: Any) -> None:
    """An ``InvalidInput`` for a demand without its threshold, or of an unknown name."""
    if isinstance(demand, str) and not is_demand(demand):
        such = "demands are named as in Demand, such as 'peak_x1'"
        meant = did_you_mean(demand, OF_FLOORS + OF_YIELDING) or such
        raise InvalidInput("", "", f"unknown demand {reprlib.repr(demand)}; {meant}")
    shown = repr(demand) if isinstance(demand, str) else "a function"
    raise InvalidInput("threshold", "None", f"must be a number: demand is {shown}")
