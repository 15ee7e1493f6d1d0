"""Demands floor by floor: envelopes over the height of each building."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxpound._checks import instance
from jaxpound._fields import pytree_dataclass, quantities, quantity, static
from jaxpound._tables import Shown, Table
from jaxpound.model.building import Building
from jaxpound.model.shear_building import ShearBuilding, storeys_of
from jaxpound.model.system import Structures, Topology, as_tuple, floors, is_storey
from jaxpound.quantities import unit
from jaxpound.results.demand import Demand
from jaxpound.results.elements import are_known


@pytree_dataclass
class FloorDemands(Shown):
    """Peak demands of a building over its height, from the ground up.

    Each has the shape (..., n_floors), with the axes of a batch in front; dimensionless, or in SI
    as the ``Demand`` they are of. ``floor_demands`` makes them.
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
    """Largest force of the rod of the storey below each floor."""
    contact_left: Any = quantity("force", "peak contact force from the left", symbol="peak $p$")
    """Largest force of contact with what stands to the left; 0 where there is no contact law."""
    contact_right: Any = quantity("force", "peak contact force from the right", symbol="peak $p$")
    """Largest force of contact with what stands to the right."""
    si: bool = static(default=False)
    """Whether the numbers are SI."""
    heights: tuple[float, ...] = static(default=())
    """Height of each storey, m; empty where buildings are not stated."""

    @property
    def drift_ratio(self) -> Any:
        """Largest drift of the storey below each floor over the storey's height.

        Raises
        ------
        ValueError
            If heights or drifts are not known in m.
        """
        if not (self.heights and self.si):
            rule = "needs drifts in SI and the buildings: floor_demands(row, found, buildings)"
            raise ValueError(f"FloorDemands.drift_ratio: it {rule}")
        return self.drift / np.array(self.heights)

    @property
    def contact(self) -> Any:
        """Largest force of contact on each floor, from either side."""
        return jnp.maximum(self.contact_left, self.contact_right)

    def _tables(self) -> list[Table]:
        title = f"Building {self.building + 1}, floor by floor"
        if not are_known(self) or np.ndim(self.displacement) != 1:
            return [Table(f"{title} (of shape {jnp.shape(self.displacement)})")]
        columns = [(name, about.kind) for name, about in quantities(FloorDemands).items()]
        has = bool(self.heights) and self.si
        ratios = [[float(100 * x)] for x in self.drift_ratio] if has else [[]] * len(self.masses)
        rows: list[list[str | float]] = [
            [str(i + 1), *(float(getattr(self, name)[i]) for name, _ in columns), *ratios[i]]
            for i in reversed(range(len(self.masses)))
        ]
        words = [f"{name.replace('_', ' ')} ({unit(kind, self.si)})" for name, kind in columns]
        words += ["drift ratio (%)"] * has
        return [Table(title, ("floor", *words), rows, digits=4)]

    __repr__ = Shown.__repr__  # else a dataclass makes its own


def floor_demands(
    structures: Structures,
    found: Demand,
    buildings: Sequence[Building | ShearBuilding] | None = None,
) -> tuple[FloorDemands, ...]:
    """Peak demands of each building over its height.

    Parameters
    ----------
    structures
        ``Row``, ``Storeys``, ``AdjacentStructures``, or a ``System`` whose masses are the floors of
        shear buildings.
    found
        The scalars of a run or a batch of runs of these structures.
    buildings
        The buildings of ``dimensionless_row``, from left to right: their heights make
        ``drift_ratio`` of drifts in SI. A ``Building`` has none.

    Returns
    -------
    One for each building, from left to right.

    Raises
    ------
    ValueError
        If the structures are no shear buildings, or ``found`` or ``buildings`` are other ones.

    Examples
    --------
    >>> steel = jp.ZenerRod(order=0.5, tau_f=0.01, tau_x=0.05)
    >>> row = jp.Row(tuple(jp.Storeys((1.0,) * n, jp.Rod(steel, 5.0)) for n in (3, 2)))
    >>> found = jp.demand(row, jp.Ricker(0.3, 2.0, 4.0), jp.TimeGrid.until(20.0, dt=0.05))
    >>> high, low = jp.floor_demands(row, found)
    >>> high.drift.round(3).tolist()
    [0.328, 0.253, 0.392]
    """
    instance("floor_demands", "structures", structures, Structures)
    instance("floor_demands", "found", found, Demand)
    topology = structures.system().topology
    sizes = {"masses": topology.n_masses, "rods": len(topology.rods), "links": len(topology.links)}
    for name, n in sizes.items():
        if (given := len(getattr(found, name))) != n:
            rule = f"be of these structures, which have {n}"
            raise ValueError(f"floor_demands: found has {given} {name}; it must {rule}")
    drifting = [rod.peak_drift is not None for rod in found.rods]
    if drifting != [is_storey(ends) for ends in topology.rods]:
        raise ValueError(
            "floor_demands: found must be of these structures, but is of other storeys"
        )
    all_floors = floors(topology)
    sizes_of = [len(building) for building in all_floors]
    heights: list[tuple[float, ...]] = [()] * len(all_floors)
    if buildings is not None:
        stated = as_tuple("floor_demands", "buildings", buildings)
        for b, building in enumerate(stated):
            instance("floor_demands", f"buildings.{b}", building, ShearBuilding, Building)
        if [len(storeys_of(building)) for building in stated] != sizes_of:
            rule = f"be those of the structures, of {sizes_of} floors"
            raise ValueError(f"floor_demands: buildings must {rule}")
        heights = [getattr(building, "heights", ()) for building in stated]
    return tuple(
        _of_building(b, building, topology, found, heights[b])
        for b, building in enumerate(all_floors)
    )


def _of_building(
    number: int,
    building: Sequence[tuple[int, int]],
    topology: Topology,
    found: Demand,
    heights: tuple[float, ...],
) -> FloorDemands:
    masses, rods = zip(*building, strict=True)
    zero = jnp.zeros_like(jnp.asarray(found.masses[0].peak_x))

    def stacked(values: Sequence[Any]) -> Any:
        return jnp.stack([jnp.asarray(value) + zero for value in values], axis=-1)

    def contact(side: int) -> Any:
        largest = dict.fromkeys(masses, zero)
        for link, ends in zip(found.links, topology.links, strict=True):
            if link.peak_contact is not None and ends[side] in largest:
                largest[ends[side]] = jnp.maximum(largest[ends[side]], link.peak_contact)
        return stacked(list(largest.values()))

    return FloorDemands(
        building=number,
        masses=masses,
        displacement=stacked([found.masses[m].peak_x for m in masses]),
        drift=stacked(
            [found.masses[masses[0]].peak_x, *(found.rods[r].peak_drift for r in rods[1:])]
        ),
        acceleration=stacked([found.masses[m].peak_acceleration for m in masses]),
        shear=stacked([found.rods[r].peak_force for r in rods]),
        contact_left=contact(1),
        contact_right=contact(0),
        si=found.si,
        heights=heights,
    )
