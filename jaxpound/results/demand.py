"""The scalars of a run, by mass, rod and link."""

from __future__ import annotations

import dataclasses
import itertools
import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import reduce
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np

from jaxpound._checks import hint
from jaxpound._errors import InvalidInput
from jaxpound._extrema import larger, smaller
from jaxpound._fields import Quantity, part, pytree_dataclass, quantities, quantity, static
from jaxpound._tables import Shown, TextTable
from jaxpound.model.row import checked_floors
from jaxpound.model.topology import Topology, is_storey, masses_of, storey_rods
from jaxpound.quantities import column, unit
from jaxpound.results import elements
from jaxpound.results.element_demands import LinkDemand, MassDemand, RodDemand
from jaxpound.results.elements import ByElement, Columnar, are_concrete, kind_in, place_of

OF_FLOORS = ("peak_drift", "peak_acceleration")
"""Demands of a storey and of a floor whose largest over all has the name without a number."""

OF_YIELDING = ("ductility", "residual_drift", "dissipated_energy")
"""Demands of a rod that yields whose largest over all has the name without a number."""

OF_CONTACTS: dict[str, Callable[[Any, Any], Any]] = {
    **dict.fromkeys(("peak_contact", "peak_impulse", "peak_penetration"), larger),
    **dict.fromkeys(("peak_column_shear", "column_shear_ratio", "peak_opening"), larger),
    **dict.fromkeys(("n_impacts", "contact_work"), operator.add),
    "first_impact_time": smaller,
}
"""How scalars of contacts whose name has no number are those of several links."""


@pytree_dataclass
class Demand(ByElement, Columnar, Shown):
    """Scalars of a run: its engineering demands. In a batch each is an array.

    Dimensionless as in eq. (9) (length g/ω1², time 1/ω1, force m1 g), or SI after ``Scales.to_si``.
    Scalars of a mass, rod or link are in ``masses[i]``, ``rods[r]`` and ``links[k]``; each has a
    flat name as well, numbered from 1, in tables (``to_pandas``, ``to_csv``, ``to_parquet``, with a
    row for each run) and as an attribute: ``peak_x1``, ``peak_acceleration_1``, ``peak_f1``, and
    for a single link ``min_gap_time``, ``slip_distance``, ``friction_work``, ``residual_offset``
    and ``soft_min_gap`` (for several ``min_gap_time_1`` and so on). As attributes only, of several
    links, such as the two faces of one, ``peak_contact``, ``peak_impulse``, ``peak_penetration``,
    ``peak_column_shear``, ``column_shear_ratio`` and ``peak_opening`` are the largest,
    ``n_impacts`` and ``contact_work`` the sums, ``first_impact_time`` the first;
    ``ductility``, ``residual_drift``, ``dissipated_energy``, ``peak_drift`` and, of floors,
    ``peak_acceleration`` are the largest of all storeys that have one.

    Examples
    --------
    >>> demand = jp.demand(jp.paper.structures(), jp.paper.ground(), jp.TimeGrid.until(20.0, 0.05))
    >>> table = demand.to_pandas()
    >>> table.index.name, round(float(table["min_gap"][0]), 3)
    ('run', 0.304)
    >>> bool(demand.peak_x2 == demand.masses[1].peak_x)
    True
    """

    _elements: ClassVar = {"masses": MassDemand, "rods": RodDemand, "links": LinkDemand}

    masses: tuple[MassDemand, ...] = part()
    """Scalars of each mass."""
    rods: tuple[RodDemand, ...] = part()
    """Scalars of each rod."""
    links: tuple[LinkDemand, ...] = part()
    """Scalars of each link."""
    pga: Any = quantity("acceleration", "peak ground acceleration", "pga", "PGA", rank=8)
    """Peak ground acceleration, largest |u''| at the instants of the run."""
    pgv: Any = quantity("velocity", "peak ground velocity", "pgv", "PGV", rank=9)
    """Peak ground velocity, largest |u'| at them, from rest by the trapezoidal rule."""
    si: bool = static(default=False)
    """Whether the numbers are SI."""
    topology: Topology | None = static(default=None)
    """Masses, rods and links of the run, by which tables name places."""

    def only(self, names: Iterable[str]) -> Demand:
        """The scalars with these flat names, a ``ValueError`` if it has none; all others are None.

        ``min_gap`` and ``min_gap_time`` of several links are of all of them.
        """
        all_names = [name for _, names_of in self.columns() for name in names_of]
        present_names = [name for name in all_names if getattr(self, name) is not None]
        over_links = ["min_gap", "min_gap_time"] if len(self.links) > 1 else []
        kept: set[tuple[str, int, str]] = set()
        for name in names:
            if name in over_links:  # needs all gaps, to find the smallest
                kept |= {("links", k, x) for k in range(len(self.links)) for x in ("min_gap", name)}
            elif name in present_names and (place := place_of(type(self), name)):
                kept.add((place.group, place.element, place.field))
            else:
                meant = hint(name, [*over_links, *present_names])
                raise InvalidInput("", "", f"unknown {name!r}; {meant}")

        def reduced(group: str, i: int, item: Any) -> Any:
            fields = quantities(type(item))
            dropped = {name: None for name in fields if (group, i, name) not in kept}
            return dataclasses.replace(item, **dropped)

        by_group = {
            group: tuple(reduced(group, i, item) for i, item in enumerate(getattr(self, group)))
            for group in self._elements
        }
        return dataclasses.replace(reduced("", 0, self), **by_group)

    def __getattr__(self, name: str) -> Any:
        if name in OF_CONTACTS and len(self.links) > 1:
            by_link = [value for x in self.links if (value := getattr(x, name)) is not None]
            if by_link:
                return reduce(OF_CONTACTS[name], by_link)
        if name in OF_FLOORS + OF_YIELDING and self.topology is not None:
            has = {"yielding": [rod.ductility is not None for rod in self.rods]}
            members = members_over_all(self.topology, has).get(name, ())
            values = [getattr(getattr(self, group)[i], field) for group, i, field in members]
            if not values or any(x is None for x in values):
                message = f"Demand has no {name!r}, the largest of all: no rod or mass here has one"
                raise AttributeError(message, name=name, obj=self)
            return reduce(larger, values)
        return super().__getattr__(name)

    @property
    def min_gap(self) -> Any:
        """Smallest gap of all links; infinite where there is no link."""
        return self._closest[0]

    @property
    def min_gap_time(self) -> Any:
        """Time of the smallest gap."""
        return self._closest[1]

    @property
    def _closest(self) -> tuple[Any, Any]:
        if not self.links:
            return jnp.full(self.batch, jnp.inf), jnp.full(self.batch, jnp.nan)
        if any(link.min_gap is None for link in self.links):
            return None, None
        gap, time = self.links[0].min_gap, self.links[0].min_gap_time
        for link in self.links[1:]:
            lower = jnp.asarray(link.min_gap) < gap
            gap = jnp.where(lower, link.min_gap, gap)
            if time is not None:
                time = jnp.where(lower, link.min_gap_time, time)
        return gap, time

    @property
    def pounds(self) -> Any:
        """1.0 where a gap closes (min_gap ≤ 0), else 0.0; NaN where the run is invalid."""
        if self.min_gap is None:
            return None
        gap = jnp.asarray(self.min_gap)
        return jnp.where(jnp.isnan(gap), jnp.nan, (gap <= 0).astype(gap.dtype))

    @property
    def checked_floors(self) -> str:
        """Of how many floors ``pounds`` tells, in words; empty if it is of all."""
        return checked_floors(self.topology, [link.min_gap for link in self.links])

    @property
    def collapsed(self) -> Any:
        """1.0 where a rod has collapsed, else 0.0; None where no rod yields."""
        each = [rod.collapsed for rod in self.rods if rod.collapsed is not None]
        return reduce(larger, each) if each else None

    def scalars(self) -> dict[str, Any]:
        """All scalars by flat name, with ``pounds``: a row of a table, or the columns of a batch.

        Python's numbers for a single run, arrays for a batch, tracers in a transformed function.
        """
        names = [name for _, names_of in self.columns() for name in names_of]
        if self.links:  # of all links; that of a single one is the same
            names = [*dict.fromkeys(["min_gap", "min_gap_time", *names]), "pounds"]
        names.append("collapsed")
        present = {name: x for name in names if (x := getattr(self, name)) is not None}
        if not are_concrete(self) or any(map(jnp.ndim, present.values())):
            return present
        return {name: float(value) for name, value in present.items()}

    def _index_and_columns(self) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        batch = self.batch
        values = {
            column(name, kind_in(Demand, name), self.si): np.broadcast_to(value, batch).ravel()
            for name, value in self.scalars().items()
        }
        return elements.run_numbers(batch or (1,)), values

    def _tables(self) -> list[TextTable]:
        return [self._table("Demand", [])]

    def _table(self, title: str, rows: list[tuple[str, str]]) -> TextTable:
        """A single run's scalars or these ``rows``; of a batch the range of each scalar."""
        batch, unit_words = self.batch, "SI" if self.si else "dimensionless"
        if batch:
            unit_words += f", batch of shape {batch}"
        if not are_concrete(self):
            return TextTable(f"{title} ({unit_words}, traced: not known before the program runs)")
        scalars = self.scalars()
        is_valid = ~np.isnan(next(iter(scalars.values()), 0.0))
        valid = {name: np.where(is_valid, x, 0.0) for name, x in scalars.items()}
        names = elements.without_idle_dampers(scalars, lambda name: float(valid[name].max()))
        scalars = {name: scalars[name] for name in names}
        units = {
            name: (unit(kind_in(Demand, name), self.si), words_of(name, self.topology))
            for name in names
        }
        if not batch:
            if not is_valid:
                return TextTable(f"{title} ({unit_words}): an invalid run, every result is NaN")
            numbers = [(name, x, *units[name]) for name, x in scalars.items()]
            notes = [f"pounds: {words[2:]}"] if (words := self.checked_floors) and not rows else []
            return TextTable(f"{title} ({unit_words})", (), rows or numbers, notes, digits=8)
        pounds, notes = scalars.pop("pounds", None), []
        if pounds is not None:
            share = f"{int(np.count_nonzero(pounds == 1)):,} of {is_valid.sum():,}"
            notes.append(f"pounding in {share} valid runs{self.checked_floors}")
        if not is_valid.all():
            notes.append(f"{(~is_valid).sum():,} invalid, with NaN for every result")
        ranges: list[tuple[Any, ...]] = []
        for name, x in scalars.items() if is_valid.any() else ():
            values = np.broadcast_to(x, batch)[is_valid]
            range_of_values = (float(f(values)) for f in (np.min, np.median, np.max))
            ranges.append((name, *range_of_values, *units[name]))
        columns = ("", "smallest", "median", "largest", "unit", "in words")
        return TextTable(f"{title} ({unit_words})", columns, ranges, notes)


def words_of(name: str, topology: Topology | None, quantity: Quantity | None = None) -> str:
    """A scalar, or another ``quantity``, in words by floor, storey or link; "" if it is neither."""
    place = place_of(Demand, name)
    if (quantity := quantity or (place and place.quantity)) is None:
        return ""
    words, of_link_number, number = quantity.words.rpartition(" of link ")
    if topology is not None and of_link_number:
        return f"{words}, {elements.PLACES['links'](topology)[int(number) - 1]}"
    if topology is None or place is None or place.group not in ("masses", "rods"):
        return quantity.words
    where = elements.PLACES[place.group](topology)[place.element]
    words = quantity.words.rpartition(" of ")[0]
    return f"{words if where.startswith('building') else words.replace('base ', '')} of {where}"


def members_over_all(topology: Topology, has: Mapping[str, Sequence[bool]]) -> dict[str, Any]:
    """Group, element and field of the demands that each name without a number is the largest of."""
    members: dict[str, list[tuple[str, int, str]]] = {}
    in_buildings = all(getattr(ends, "between", ends) for ends in topology.rods)
    if in_buildings and any(map(is_storey, topology.rods)):  # else floors are not known
        drift, acceleration = OF_FLOORS
        # The drift of a storey above the ground is the displacement of its floor.
        members[drift] = [
            ("rods", r, drift) if is_storey(ends) else ("masses", max(masses_of(ends)), "peak_x")
            for r in storey_rods(topology)
            for ends in [topology.rods[r]]
        ]
        members[acceleration] = [("masses", i, acceleration) for i in topology.floor_masses]
    if rods := [*itertools.compress(itertools.count(), has["yielding"])]:
        members |= {name: [("rods", r, name) for r in rods] for name in OF_YIELDING}
    of_links, largest = quantities(LinkDemand), [x for x, f in OF_CONTACTS.items() if f is larger]
    for name in largest if len(topology.links) > 1 else ():
        if links := [*itertools.compress(itertools.count(), has.get(of_links[name].only, ()))]:
            members[name] = [("links", k, name) for k in links]
    return members
