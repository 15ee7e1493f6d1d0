"""The scalars of a run, by mass, rod and link, and what they are called in tables."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound._checks import hint
from jaxpound._fields import Quantity, part, pytree_dataclass, quantities, quantity, static
from jaxpound._tables import Shown, Table
from jaxpound.model.places import link_places, mass_places, rod_places
from jaxpound.model.system import Topology, is_storey
from jaxpound.quantities import column, unit
from jaxpound.results.columns import Columnar
from jaxpound.results.elements import (
    ByElement,
    are_known,
    chosen,
    columns_of,
    place_of,
    run_numbers,
    without_idle_dampers,
)


@pytree_dataclass
class MassDemand:
    """Scalars of a mass."""

    peak_x: Any = quantity(
        "length",
        "peak displacement of building {}",
        "peak_x{}",
        "peak $|x_{}|$",
        rank=2,
        limited=True,
    )
    """Largest |x|, displacement relative to the ground."""
    peak_acceleration: Any = quantity(
        "acceleration",
        "peak absolute acceleration of building {}",
        "peak_acceleration_{}",
        "peak $|a_{}|$",
        rank=4,
        limited=True,
    )
    """Largest absolute acceleration |x'' + u''|, contact forces included; by ``Newton``'s law,
    whose impacts have no force, the largest between impacts."""


@pytree_dataclass
class RodDemand:
    """Scalars of a rod."""

    peak_force: Any = quantity(
        "force",
        "peak base shear of building {}",
        "peak_f{}",
        "peak $|f_{}|$",
        rank=3,
        limited=True,
    )
    """Largest |f|, the rod's force (of a rod to the ground, the base shear)."""
    peak_drift: Any = quantity(
        "length",
        "peak drift of storey {}",
        "peak_drift_{}",
        "peak drift $|d_{}|$",
        rank=2,
        limited=True,
        only="storey",
        default=None,
    )
    """Largest |e|, the elongation of a rod between two masses: the drift of a storey. None for a
    rod to the ground, of which it is ``peak_x`` of its mass."""


@pytree_dataclass
class LinkDemand:
    """Scalars of a link."""

    min_gap: Any = quantity("length", "smallest gap", "min_gap", r"min gap $\xi$", rank=0)
    """Smallest gap ξ, where the slip velocity vanishes or at an end of the run."""
    min_gap_time: Any = quantity(
        "time", "time of the smallest gap", "min_gap_time", "time of min gap $t$", rank=1
    )
    """When the gap is smallest."""
    slip_distance: Any = quantity(
        "length",
        "distance slid by the damper",
        "slip_distance",
        "slip distance",
        rank=5,
        limited=True,
    )
    """Distance slid by the damper, ∫ |w| dt with the slip velocity w."""
    friction_work: Any = quantity(
        "energy",
        "energy taken by the damper",
        "friction_work",
        "friction work",
        rank=6,
        limited=True,
    )
    """Energy taken by the damper, ∫ q w dt."""
    residual_offset: Any = quantity(
        "length", "residual offset", "residual_offset", "residual offset", rank=7, limited=True
    )
    """x_j − x_i at the end of the run: by how much the gap has changed."""
    soft_min_gap: Any = quantity(
        "length",
        "soft minimum of the gap",
        "soft_min_gap",
        r"soft min gap $\xi$",
        rank=10,
        default=None,
    )
    """−T log of the mean of e^(−ξ/T) over the run, for the temperature T given to ``demand``."""
    peak_contact: Any = quantity(
        "force",
        "peak contact force",
        "peak_contact",
        "peak contact force $p$",
        rank=11,
        limited=True,
        only="contact",
        default=None,
    )
    """Largest contact force p; of ``Newton``'s law, whose impacts have impulses but no force, the
    largest with which blocks are pressed together at rest. None, as all below, without contact."""
    peak_impulse: Any = quantity(
        "impulse",
        "impulse of the strongest impact",
        "peak_impulse",
        "peak impulse",
        rank=12,
        limited=True,
        only="contact",
        default=None,
    )
    """Impulse ∫ p dt of the strongest impact."""
    peak_penetration: Any = quantity(
        "length",
        "peak penetration",
        "peak_penetration",
        r"peak penetration $\delta$",
        rank=13,
        limited=True,
        only="contact",
        default=None,
    )
    """Largest penetration −ξ, 0 where the gap never closes."""
    n_impacts: Any = quantity(
        None,
        "number of impacts",
        "n_impacts",
        "number of impacts",
        rank=14,
        only="contact",
        default=None,
    )
    """Touches after the link was apart, faster than 1e-4 of the fastest before."""
    first_impact_time: Any = quantity(
        "time",
        "time of the first impact",
        "first_impact_time",
        "time of first impact $t$",
        rank=15,
        only="contact",
        default=None,
    )
    """When the first impact begins; infinite if there is none."""
    contact_work: Any = quantity(
        "energy",
        "energy lost by contact",
        "contact_work",
        "energy lost by contact",
        rank=16,
        limited=True,
        only="contact",
        default=None,
    )
    """Energy lost by contact, the work of p less what its spring has stored."""
    soft_peak_contact: Any = quantity(
        "force",
        "soft maximum of the impacts' peak forces",
        "soft_peak_contact",
        "soft peak contact force",
        rank=17,
        limited=True,
        only="contact",
        default=None,
    )
    """(Σ P⁸)^(1/8) of all impacts' peak forces P: smooth also where two are equally strong. Zero by
    ``Newton``'s law, whose impacts have no force."""


@pytree_dataclass
class Demand(ByElement, Columnar, Shown):
    """Scalars of a run: its engineering demands. In a batch each is an array.

    Dimensionless as in eq. (9) (length g/ω1², time 1/ω1, force m1 g), or SI after ``Scales.to_si``.
    Scalars of a mass, rod or link are in ``masses[i]``, ``rods[r]`` and ``links[k]``; each has a
    flat name as well, numbered from 1, in tables (``to_pandas``, ``to_csv``, ``to_parquet``, with a
    row for each run) and as an attribute: ``peak_x1``, ``peak_acceleration_1``, ``peak_f1``, and
    for a single link ``min_gap_time``, ``slip_distance``, ``friction_work``, ``residual_offset``
    and ``soft_min_gap`` (for several ``min_gap_time_1`` and so on).

    Examples
    --------
    >>> found = jp.demand(jp.paper.structures(), jp.paper.ground(), jp.paper.grid())
    >>> table = found.to_pandas()
    >>> table.index.name, round(float(table["min_gap"][0]), 3)
    ('run', 0.305)
    >>> bool(found.peak_x2 == found.masses[1].peak_x)
    True
    """

    _elements: ClassVar[dict[str, type]] = {
        "masses": MassDemand,
        "rods": RodDemand,
        "links": LinkDemand,
    }

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
    """Of which masses, rods and links they are, for the places that tables tell."""

    @classmethod
    def of_columns(cls, columns: Mapping[str, Any], *, si: bool) -> Demand:
        """The demand with the scalars in ``columns``, by flat name; other columns are ignored.

        The inverse of ``scalars``.
        """
        found: dict[str, dict[int, dict[str, Any]]] = {group: {} for group in cls._elements}
        own: dict[str, Any] = {"si": si}
        several = "min_gap_1" in columns
        for name, value in columns.items():
            if (place := place_of(cls, name)) is None:
                continue
            if not place.group:
                own[place.field] = value
            elif not (several and name == place.known.column):  # of all links
                found[place.group].setdefault(place.element, {})[place.field] = value
        try:
            groups: dict[str, Any] = {
                group: tuple(kind(**found[group][i]) for i in sorted(found[group]))
                for group, kind in cls._elements.items()
            }
            return cls(**groups, **own)
        except TypeError as error:
            raise ValueError(f"Demand.of_columns: columns must be complete: {error}") from error

    def only(self, names: Iterable[str]) -> Demand:
        """The scalars with these flat names; all others are None.

        ``min_gap`` and ``min_gap_time`` of several links are of all of them.

        Raises
        ------
        ValueError
            If a name is none of a scalar that the demand has.
        """
        known = [name for _, of in self.columns() for name in of]
        known = [name for name in known if getattr(self, name) is not None]
        over_links = ["min_gap", "min_gap_time"] if len(self.links) > 1 else []
        wanted: set[tuple[str, int, str]] = set()
        for name in names:
            if name in over_links:  # which link is the closest, the gaps tell
                wanted |= {
                    ("links", k, x) for k in range(len(self.links)) for x in ("min_gap", name)
                }
            elif name in known and (place := place_of(type(self), name)):
                wanted.add((place.group, place.element, place.field))
            else:
                raise ValueError(f"only: unknown {name!r}; {hint(name, [*over_links, *known])}")

        def left(group: str, i: int, item: Any, fields: Iterable[str]) -> Any:
            unwanted = {name: None for name in fields if (group, i, name) not in wanted}
            return dataclasses.replace(item, **unwanted)

        elements = {
            group: tuple(
                left(group, i, item, quantities(kind))
                for i, item in enumerate(getattr(self, group))
            )
            for group, kind in self._elements.items()
        }
        return dataclasses.replace(left("", 0, self, quantities(type(self))), **elements)

    @property
    def min_gap(self) -> Any:
        """Smallest gap of all links; infinite where there is no link."""
        return self._closest()[0]

    @property
    def min_gap_time(self) -> Any:
        """Time of the smallest gap."""
        return self._closest()[1]

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
    def batch(self) -> tuple[int, ...]:
        """Shape of the batch; () for a single run."""
        return np.shape(next(iter(jax.tree.leaves(self)), 0.0))

    def scalars(self) -> dict[str, Any]:
        """All of them by flat name, with ``pounds``: a row of a table, or the columns of a batch.

        Python's numbers for a single run, arrays for a batch, tracers under ``jit``, ``vmap`` or
        ``grad``.
        """
        values: dict[str, Any] = {}
        if self.links:  # of all links; that of a single one is the same
            values = {"min_gap": self.min_gap, "min_gap_time": self.min_gap_time}
        for _, names in self.columns():
            values |= {name: getattr(self, name) for name in names}
        values |= {"pounds": self.pounds} if self.links else {}
        known = {name: value for name, value in values.items() if value is not None}
        if not are_known(self) or any(map(jnp.ndim, known.values())):
            return known
        return {name: float(value) for name, value in known.items()}

    def _index_and_columns(self) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        batch = self.batch
        values = {
            column(name, kind_of(name), self.si): np.broadcast_to(value, batch).ravel()
            for name, value in self.scalars().items()
        }
        return run_numbers(batch or (1,)), values

    def __getitem__(self, index: Any) -> Demand:
        """Runs of a batch by number, slice or mask, as an array is indexed."""
        return chosen(self, index, self.batch)

    def _tables(self) -> list[Table]:
        return [self._table("Demand", [])]

    def _table(self, title: str, rows: list[tuple[str, str]]) -> Table:
        """Of a single run its scalars or the ``rows`` given, of a batch the range of each."""
        batch, about = self.batch, "SI" if self.si else "dimensionless"
        if batch:
            about += f", batch of shape {batch}"
        if not are_known(self):
            return Table(f"{title} ({about}, traced: not known before the program runs)")
        scalars = self.scalars()
        good = ~np.isnan(next(iter(scalars.values()), 0.0))
        valid = {name: np.where(good, x, 0.0) for name, x in scalars.items()}
        wanted = without_idle_dampers(scalars, lambda name: float(valid[name].max()))
        scalars = {name: scalars[name] for name in wanted}
        if not batch:
            if not good:
                return Table(f"{title} ({about}): an invalid run, every result is NaN")
            numbers = [
                (name, x, unit_of(name, self.si), *self._where(name)) for name, x in scalars.items()
            ]
            return Table(f"{title} ({about})", (), rows or numbers, digits=8)
        pounds, notes = scalars.pop("pounds", None), []
        if pounds is not None:
            share = f"{int(np.count_nonzero(pounds == 1)):,} of {good.sum():,}"
            notes.append(f"pounding in {share} valid runs")
        if not good.all():
            notes.append(f"{(~good).sum():,} invalid, with NaN for every result")
        ranges: list[tuple[Any, ...]] = [
            (
                name,
                *_range(np.broadcast_to(x, batch)[good]),
                unit_of(name, self.si),
                *self._where(name),
            )
            for name, x in scalars.items()
            if good.any()
        ]
        where = self._where("") and ("of",)
        columns = ("", "smallest", "median", "largest", "unit", *where)
        return Table(f"{title} ({about})", columns, ranges, notes)

    def _where(self, name: str) -> tuple[str, ...]:
        """Where a scalar's mass, rod or link is; () for all of a pair, whose numbers say it."""
        if self.topology is None or max(self.topology.n_masses, len(self.topology.links) + 1) < 3:
            return ()
        place = place_of(type(self), name)
        of_all = len(self.topology.links) > 1 and name in ("min_gap", "min_gap_time")
        if place is None or not place.group or of_all:
            return ("",)
        return (_PLACES[place.group](self.topology)[place.element],)

    __repr__ = Shown.__repr__  # else a dataclass makes its own


_PLACES = {"masses": mass_places, "rods": rod_places, "links": link_places}
"""Where the elements of each group are."""


def _range(values: np.ndarray) -> tuple[float, float, float]:
    return float(values.min()), float(np.median(values)), float(values.max())


_OTHERS = {
    "damper_force": Quantity(
        "force", "slip force of the damper", "damper_force", "slip force", limited=True
    ),
    "total_damper_force": Quantity(
        "force", "slip forces of all dampers together", symbol="total slip force", limited=True
    ),
    "required_gap": Quantity("length", "required gap", "required_gap", "required gap"),
    "initial_gap": Quantity("length", "gap at rest"),
    "peak_drift": Quantity(
        "length", "largest storey drift", symbol="largest peak drift $|d|$", limited=True
    ),
    "peak_acceleration": Quantity(
        "acceleration",
        "largest absolute acceleration",
        symbol="largest peak $|a|$",
        limited=True,
    ),
    "spectral_acceleration": Quantity(
        "acceleration", "spectral acceleration at period {}", "spectral_acceleration_{}"
    ),
}
"""Further columns of studies and designs; of links those that have a name of a column."""


def known_of(name: str) -> Quantity | None:
    """Metadata of a scalar by its flat name; None if it is a pure number or no scalar."""
    place = place_of(Demand, name)
    if place is not None:
        return place.known
    base, _, number = name.rpartition("_")
    known = _OTHERS.get(base)
    if name not in _OTHERS and known is not None and known.column and number.isdigit():
        return known.of(number)
    return _OTHERS.get(name)


def in_words(name: str, topology: Topology | None = None) -> str:
    """Name of a scalar in words; the name itself of any other column.

    With the masses, rods and links that it is of, by floor and storey; without, every mass is taken
    for a building.
    """
    place, known = place_of(Demand, name), known_of(name)
    if known is None:
        return name.replace("_", " ")
    what, of_link, number = known.words.rpartition(" of link ")
    if topology is not None and of_link:
        return f"{what}, {_PLACES['links'](topology)[int(number) - 1]}"
    if topology is None or place is None or place.group not in ("masses", "rods"):
        return known.words
    where = _PLACES[place.group](topology)[place.element]
    what = known.words.rpartition(" of ")[0]
    return f"{what if where.startswith('building') else what.replace('base ', '')} of {where}"


def kind_of(name: str) -> str | None:
    """Kind of quantity of a scalar; None for a pure number and for any other column."""
    known = known_of(name)
    return None if known is None else known.kind


def unit_of(name: str, si: bool) -> str:
    """Unit of a scalar; empty for a column whose unit is not known."""
    return unit(kind_of(name), si)


def limited_columns(topology: Topology, touching: Sequence[bool]) -> list[str]:
    """Flat names of what a design may be limited in.

    Given are the masses, rods and links, and of each link whether it has a law of contact.
    """
    has = {
        "contact": touching,
        "storey": [is_storey(ends) for ends in topology.rods],
    }
    sizes = {"masses": topology.n_masses, "rods": len(topology.rods), "links": len(touching)}
    return [
        name
        for known, names in columns_of(Demand, sizes)
        if known.limited
        for i, name in enumerate(names)
        if not known.only or has[known.only][i]
    ]
