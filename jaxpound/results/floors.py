"""Demands floor by floor: envelopes over the height of each building."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxpound._checks import instance
from jaxpound._errors import InvalidInput
from jaxpound._fields import pytree_dataclass, quantities, quantity, static
from jaxpound._tables import Shown, TextTable
from jaxpound.model.ends import weighted
from jaxpound.model.system import Structures, System
from jaxpound.model.topology import floors, is_storey, stacks, two_ends
from jaxpound.quantities import column, unit
from jaxpound.results.demand import Demand
from jaxpound.results.elements import Columnar, are_concrete, run_numbers, sizes_of


@pytree_dataclass
class FloorDemands(Columnar, Shown):
    """Peak demands of a building over its height, from the ground up.

    Each has the shape (..., n_floors) in the units of the ``Demand``; ``floor_demands`` makes them.
    As a table (``to_pandas``, ``to_csv``, ``to_parquet``) it has a row for each floor of each run,
    counted from 1; ``series`` is the floor's number in names such as ``peak_x3``.
    """

    building: int = static()
    """The building's number, from 0 as in ``Row.buildings``."""
    masses: tuple[int, ...] = static()
    """The number of each floor's mass in the system."""
    displacement: Any = quantity("length", "peak displacement", symbol="peak $|x|$")
    """Largest displacement |x| of each floor relative to the ground."""
    drift: Any = quantity("length", "peak storey drift", symbol="peak drift $|d|$")
    """Largest drift of the storey below each floor."""
    acceleration: Any = quantity("acceleration", "peak absolute acceleration", symbol="peak $|a|$")
    """Largest absolute acceleration of each floor."""
    shear: Any = quantity("force", "peak storey shear", symbol="peak $|f|$")
    """Largest force of the rod of the storey below each floor, without dampers beside it."""
    contact_left: Any = quantity("force", "peak contact force from the left", symbol="peak $p$")
    """Largest force of contact with what stands to the left; 0 where there is no contact law."""
    contact_right: Any = quantity("force", "peak contact force from the right", symbol="peak $p$")
    """Largest force of contact with what stands to the right."""
    ductility: Any = None
    """Ductility of the storey below each floor, 0 of one without a law of hysteresis; None if no
    storey has one."""
    stroke: Any = None
    """Largest stroke of each tuned mass on what it stands on, shape (..., n_tuned); None without
    one: it is no floor."""
    si: bool = static(default=False)
    """Whether the numbers are SI."""
    heights: tuple[float, ...] = static(default=())
    """Height of each storey, m; empty where buildings are not stated."""

    @property
    def drift_ratio(self) -> Any:
        """Largest drift of the storey below each floor over its height; needs SI and heights."""
        if not (self.heights and self.si):
            rule = "needs drifts in SI and the heights of storeys: floor_demands(Buildings(…), …)"
            raise InvalidInput("it", "", rule)
        return self.drift / np.array(self.heights)

    @property
    def contact(self) -> Any:
        """Largest force of contact on each floor, from either side."""
        return jnp.maximum(self.contact_left, self.contact_right)

    def _index_and_columns(self) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        shape, n = np.shape(self.displacement), len(self.masses)
        index: dict[str, Any] = {"building": self.building + 1, "floor": np.arange(1, n + 1)}
        columns: dict[str, Any] = {"series": np.array(self.masses) + 1}
        columns |= {"elevation_m": np.cumsum(self.heights)} if self.heights else {}
        for name, x in quantities(FloorDemands).items():
            columns[column(name, x.kind, self.si)] = getattr(self, name)
        columns |= {"drift_ratio": self.drift_ratio} if self.heights and self.si else {}
        columns |= {} if self.ductility is None else {"ductility": self.ductility}
        for values in (index, columns):
            values |= {name: np.broadcast_to(x, shape).ravel() for name, x in values.items()}
        return run_numbers(shape[:-1], n) | index, columns

    def _tables(self) -> list[TextTable]:
        title = f"Building {self.building + 1}, floor by floor"
        if not are_concrete(self) or np.ndim(self.displacement) != 1:
            return [TextTable(f"{title} (of shape {jnp.shape(self.displacement)})")]
        columns = {
            f"{name.replace('_', ' ')} ({unit(quantity.kind, self.si)})": getattr(self, name)
            for name, quantity in quantities(FloorDemands).items()
        }
        if self.heights and self.si:
            columns["drift ratio (%)"] = 100 * self.drift_ratio
        if self.ductility is not None:
            columns["ductility"] = self.ductility
        if self.stroke is not None:
            strokes = ", ".join(f"{float(x):.4g}" for x in self.stroke)
            title += f"; tuned mass: stroke {strokes} {unit('length', self.si)}"
        from_below = enumerate(zip(*columns.values(), strict=True), 1)
        rows: list[Any] = [(str(floor), *map(float, x)) for floor, x in from_below]
        return [TextTable(title, ("floor", *columns), rows[::-1], digits=4)]


def floor_demands(structures: Structures, found: Demand) -> tuple[FloorDemands, ...]:
    """Peak demands of each building over its height, from left to right.

    A ``ValueError`` if the structures are no shear buildings, or ``found`` is not theirs.

    Parameters
    ----------
    structures
        ``Buildings``, whose heights make ``drift_ratio``, ``Row``, ``Storeys``,
        ``AdjacentStructures``, or a ``System`` whose masses are the floors of shear buildings.
    found
        The scalars of a run or a batch of runs of these structures.

    Examples
    --------
    >>> steel = jp.ZenerRod(order=0.5, tau_f=0.01, tau_x=0.05)
    >>> row = jp.Row(tuple(jp.Storeys((1.0,) * n, jp.Rod(steel, 5.0)) for n in (3, 2)))
    >>> found = jp.demand(row, jp.Ricker(0.3, 2.0, 4.0), jp.TimeGrid.until(20.0, dt=0.05))
    >>> high, low = jp.floor_demands(row, found)
    >>> high.drift.round(3).tolist()
    [0.328, 0.253, 0.392]
    """
    instance("structures", structures, Structures)
    instance("found", found, Demand)
    system = structures.system()
    topology = system.topology
    for name, n in sizes_of(topology).items():
        if (count := len(getattr(found, name))) != n:
            rule = f"has {count} {name}; it must be of these structures, which have {n}"
            raise InvalidInput("found", "", rule)
    if [rod.peak_drift is not None for rod in found.rods] != [*map(is_storey, topology.rods)]:
        raise InvalidInput("found", "", "must be of these structures, but is of other storeys")
    sizes = [len(building) for building in floors(topology)]
    buildings = getattr(structures, "buildings", sizes)  # only those in SI have heights
    heights = [getattr(x, "heights", ())[:n] for x, n in zip(buildings, sizes, strict=True)]
    return tuple(_of_building(b, system, found, each) for b, each in enumerate(heights))


def _of_building(
    number: int, system: System, demand: Demand, heights: tuple[float, ...]
) -> FloorDemands:
    topology = system.topology
    masses, rods = zip(*floors(topology)[number], strict=True)
    zero = jnp.zeros_like(jnp.asarray(demand.masses[0].peak_x))

    def stacked(values: Sequence[Any]) -> Any:
        return jnp.stack([jnp.asarray(value) + zero for value in values], axis=-1)

    def contact(side: int) -> Any:
        largest = dict.fromkeys(masses, zero)
        for scalars, link in zip(demand.links, system.links, strict=True):
            end, force = two_ends(link.ends)[side], scalars.peak_contact
            if force is None or end not in largest:
                continue
            for mass, share in weighted(link) if link.column else ((end, 1.0),):
                if mass in largest:  # a column passes shares of the force on to its floors
                    largest[mass] = jnp.maximum(largest[mass], jnp.abs(share) * force)
        return stacked(list(largest.values()))

    displacements = [demand.masses[m].peak_x for m in masses]
    drifts = [demand.rods[r].peak_drift for r in rods]  # None of a storey above the ground
    ductilities = [demand.rods[r].ductility for r in rods]
    yields = ductilities.count(None) < len(rods)
    strokes = [
        demand.rods[r].peak_drift for m, r in stacks(topology)[number] if m in topology.tuned
    ]
    return FloorDemands(
        building=number,
        masses=masses,
        displacement=stacked(displacements),
        drift=stacked([displacements[0] if x is None else x for x in drifts]),
        acceleration=stacked([demand.masses[m].peak_acceleration for m in masses]),
        shear=stacked([demand.rods[r].peak_force for r in rods]),
        contact_left=contact(1),
        contact_right=contact(0),
        ductility=stacked([0.0 if x is None else x for x in ductilities]) if yields else None,
        stroke=stacked(strokes) if strokes else None,
        si=demand.si,
        heights=heights,
    )
