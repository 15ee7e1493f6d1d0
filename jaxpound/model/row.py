"""Buildings of one or more storeys in a row, and the links between their floors."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from jaxpound._checks import Rule, instance, is_whole
from jaxpound._fields import assembled, check, like, part, pytree_dataclass, static
from jaxpound.model.building import Building
from jaxpound.model.contact import ContactLaw, Newton
from jaxpound.model.places import link_place
from jaxpound.model.shear_building import ShearBuilding
from jaxpound.model.storeys import Storeys
from jaxpound.model.system import GROUND, Ends, Link, System, Topology, as_tuple, ring
from jaxpound.model.vibration import first_frequency


@pytree_dataclass
class FloorLink:
    """What is between two floors of a row: dry friction, a gap, and contact where the gap closes.

    It stands between neighbouring buildings; or between two floors of one building, a friction
    brace; or between a floor and the ground. Buildings and floors are numbered from 0.

    Parameters
    ----------
    building
        The building on the left.
    floor
        Its floor.
    next_floor
        The floor at the other end. By default that of the same number, or in a brace the floor
        below; ``GROUND`` there is the ground.
    friction, gap, contact
        As in ``Link``: slip force μ ≥ 0, gap ξ0 ≥ 0 at rest (infinite by default) and law of
        contact; dimensionless in a ``Row``, in N, m and SI units between buildings in SI.
    next_building
        The building at the other end: by default the next one to the right; ``building`` itself
        for a brace, which slips by the drift of its storeys; ``GROUND`` for a damper to the ground.

    Raises
    ------
    ValueError
        If a known value breaks its rule, or a number is none of a building or floor.

    Examples
    --------
    Arguments count from 0; what is printed counts from 1:

    >>> print(jp.FloorLink(building=0, floor=2, friction=0.1))
    1–2, floor 3
    >>> print(jp.FloorLink(building=1, floor=3, friction=0.2, next_building=1))  # a brace
    in 2, floors 3–4
    """

    building: int = static()
    floor: int = static()
    next_floor: int | None = static(default=None)
    friction: Any = like(Link, "friction", default=0.0)
    gap: Any = like(Link, "gap", default=np.inf)
    contact: ContactLaw | Newton | None = like(Link, "contact", default=None)
    next_building: int | None = static(default=None)

    def __post_init__(self) -> None:
        for name in ("building", "floor", "next_floor", "next_building"):
            number, least = getattr(self, name), GROUND if name.startswith("next") else 0
            if number is None and least == GROUND:
                continue
            if not (is_whole(number) and number >= least):
                rule = "a whole number from 0 on" + (", or GROUND" if least else "")
                raise ValueError(f"FloorLink: {name} = {number!r} must be {rule}")
            object.__setattr__(self, name, int(number))
        if GROUND in (self.next_floor, self.next_building):
            above = self.next_floor not in (None, GROUND)
            elsewhere = self.next_building not in (None, self.building, GROUND)
            if above or elsewhere:
                name = "next_floor" if above else "next_building"
                rule = "must be left out: the other end is the ground"
                raise ValueError(f"FloorLink: {name} = {getattr(self, name)} {rule}")
        try:
            check(self)
        except ValueError as error:
            between = f"FloorLink {self}:"
            raise ValueError(str(error).replace("FloorLink:", between, 1)) from error

    def more_rules(self, prefix: str) -> list[Rule]:
        """Those of a ``Link``: a gap that can close is finite."""
        return Link.more_rules(self, prefix)  # type: ignore[arg-type]

    @property
    def other_building(self) -> int:
        """The building at the other end, or ``GROUND``."""
        return self.building + 1 if self.next_building is None else self.next_building

    @property
    def other_floor(self) -> int:
        """The floor at the other end, or ``GROUND``."""
        if self.other_building == GROUND:
            return GROUND
        if self.next_floor is not None:
            return self.next_floor
        return self.floor - (self.other_building == self.building)

    def __str__(self) -> str:
        """What it stands between, in words and numbers from 1."""
        other = (self.other_building + 1, self.other_floor + 1)
        end = (self.building + 1, self.floor + 1)
        return link_place(end, None if self.other_floor == GROUND else other)


@pytree_dataclass
class Row:
    """Buildings side by side, from left to right, with links between their floors; dimensionless.

    Parameters
    ----------
    buildings
        ``Storeys``, from left to right. Their floors are the masses of ``system()`` in this order,
        floor by floor from the ground up: so are ``masses`` and ``rods`` of its results.
    links
        What is between floors (``floor_links`` makes them for every common floor). They may not
        close a ring: the friction forces of a ring in stick are not determined.

    Raises
    ------
    ValueError
        If a known value breaks its rule, a link names a building or floor that is not there, both
        its ends are one floor, it skips a building, or links close a ring.

    Examples
    --------
    A house of two storeys beside one of a single storey, a damper and contact between their first
    floors:

    >>> steel = jp.ZenerRod(order=0.5, tau_f=0.01, tau_x=0.05)
    >>> low, high = (jp.Storeys((1.0,) * n, jp.Rod(steel, 5.0)) for n in (1, 2))
    >>> law = jp.KelvinVoigt(stiffness=300.0, restitution=0.65)
    >>> row = jp.Row((high, low), (jp.FloorLink(0, 0, friction=0.1, gap=0.2, contact=law),))
    >>> row.system().links[0].ends
    (0, 2)
    """

    buildings: tuple[Storeys, ...] = part(Storeys, each=True)
    links: tuple[FloorLink, ...] = part(FloorLink, each=True, default=())

    def __post_init__(self) -> None:
        for name in ("buildings", "links"):
            object.__setattr__(self, name, as_tuple("Row", name, getattr(self, name)))
        check(self)
        require_buildings("Row", self.buildings)
        floors = [building.n_floors for building in self.buildings]
        require_floors(floors, self.links, Naming.of("Row"))

    @property
    def natural_frequencies(self) -> tuple[Any, ...]:
        """Natural frequency of the first mode of each building (``jp.modes``), in units of ω1."""
        return tuple(first_frequency(building) for building in self.buildings)

    def system(self) -> System:
        """Masses, rods and links, building by building."""
        starts = first_floors([building.n_floors for building in self.buildings])
        return assembled(
            System,
            masses=tuple(mass for building in self.buildings for mass in building.masses),
            rods=tuple(
                rod
                for building, first in zip(self.buildings, starts, strict=False)
                for rod in building.rods_from(first)
            ),
            links=tuple(
                assembled(
                    Link,
                    ends=_ends(link, starts),
                    friction=link.friction,
                    gap=link.gap,
                    contact=link.contact,
                )
                for link in self.links
            ),
        )


def floor_links(
    buildings: Sequence[Any],
    *,
    friction: Any = 0.0,
    gap: Any = np.inf,
    contact: ContactLaw | Newton | None = None,
    building: int | None = None,
) -> tuple[FloorLink, ...]:
    """Equal links between neighbouring buildings at every common floor.

    What differs from gap to gap is made one ``building`` after the other, and added.

    Parameters
    ----------
    buildings
        All ``Storeys``, or all in SI, ``ShearBuilding`` or ``Building``; from left to right. Common
        are floors of the same number; of two ``ShearBuilding``, those at the same height, to a
        slab's thickness of 0.2 m.
    friction, gap, contact
        As in ``FloorLink``.
    building
        The building on the left of the only gap that gets links; by default all gaps do.

    Raises
    ------
    ValueError
        If there are fewer than two buildings, neighbours have no common floor, or building is not
        the number of one with another on its right.

    Examples
    --------
    >>> steel = jp.ZenerRod(order=0.5, tau_f=0.01, tau_x=0.05)
    >>> low, high = (jp.Storeys((1.0,) * n, jp.Rod(steel, 5.0)) for n in (2, 3))
    >>> [str(link) for link in jp.floor_links((low, high), friction=0.1, gap=0.2)][1]
    '1–2, floor 2'

    A damper in the first gap, contact in the second:

    >>> row, law = (low, high, low), jp.KelvinVoigt(stiffness=400.0, restitution=0.65)
    >>> dampers = jp.floor_links(row, building=0, friction=0.1, gap=0.2)
    >>> links = dampers + jp.floor_links(row, building=1, gap=0.1, contact=law)
    >>> [link.building for link in links]
    [0, 0, 1, 1]
    """
    buildings = as_tuple("floor_links", "buildings", buildings)
    if len(buildings) < 2:
        raise ValueError(f"floor_links: buildings, {len(buildings)} of them, must be two or more")
    kinds = (Storeys,) if isinstance(buildings[0], Storeys) else (ShearBuilding, Building)
    for i, one in enumerate(buildings):
        instance("floor_links", f"buildings.{i}", one, *kinds)
    last = len(buildings) - 2
    if building is not None and not (is_whole(building) and 0 <= building <= last):
        rule = f"from 0 to {last}, a building with another on its right"
        raise ValueError(f"floor_links: building = {building!r} must be {rule}")
    found = []
    for i, (left, right) in enumerate(pairwise(buildings)):
        if building not in (None, i):
            continue
        common = common_floors(left, right)
        if not common:
            rule = "must have floors at the same height"
            raise ValueError(f"floor_links: buildings {i + 1} and {i + 2} {rule}")
        found += [FloorLink(i, *floors, friction, gap, contact) for floors in common]
    return tuple(found)


_SLAB = 0.2
"""Floors whose heights differ by no more than this, in m, meet: about the thickness of a slab. In
models with low storeys it is a quarter of a storey."""


def common_floors(left: Any, right: Any) -> list[tuple[int, int]]:
    """Floors of two buildings that meet: of equal number or, where heights are known, height."""
    if not _have_heights(left, right):
        both = [1 if isinstance(one, Building) else one.n_floors for one in (left, right)]
        return [(i, i) for i in range(min(both))]
    pairs = np.ndindex(left.n_floors, right.n_floors)
    return [(i, j) for i, j in pairs if _meet(left, i, right, j)]


def _have_heights(*buildings: Any) -> bool:
    return all(isinstance(building, ShearBuilding) for building in buildings)


def _meet(left: Any, i: int, right: Any, j: int) -> bool:
    slab = min(_SLAB, float(left.heights[i]) / 4, float(right.heights[j]) / 4)
    return abs(float(left.elevations[i] - right.elevations[j])) <= slab * (1 + 1e-9)


class Naming(NamedTuple):
    """How messages name arguments: where link k is given, and the number of the first floor.

    Places in words count from 1 everywhere (``link_place``).
    """

    place: Callable[[int], str]
    first: int = 0

    @classmethod
    def of(cls, owner: str) -> Naming:
        """That of the class or function ``owner``: links and floors are numbered from 0."""
        return cls(lambda k: f"{owner}: links.{k}:")


def require_buildings(owner: str, buildings: Sequence[Any]) -> None:
    """A ``ValueError`` for a row without buildings."""
    if not buildings:
        raise ValueError(f"{owner}: buildings = () must hold at least one building")


def require_floors(floors: Sequence[int], links: Iterable[FloorLink], naming: Naming) -> None:
    """A ``ValueError`` for links that do not join floors of these buildings.

    Parameters
    ----------
    floors
        Number of floors of each building.
    links
        The links.
    naming
        How messages name them.
    """
    place, first = naming
    links = tuple(links)
    for k, link in enumerate(links):
        ends = ((link.building, link.floor, ""), (link.other_building, link.other_floor, "next_"))
        for building, floor, which in ends:
            if GROUND in (building, floor):
                continue
            if building >= (n := len(floors)):
                told = f"{place(k)} {which}building = {building + first}"
                rule = f"from {first} to {n - 1 + first}: there are {n} buildings"
                raise ValueError(f"{told} must be {rule}")
            if floor >= floors[building]:
                rule = f"from {first} to {floors[building] - 1 + first}"
                told = f"{place(k)} {which}floor = {floor + first} must be {rule}"
                n = floors[building]
                has = f"building {building + 1} has {n} floor{'s' * (n > 1)}"
                raise ValueError(f"{told}: {has}")
        one, other = ends[0][:2], ends[1][:2]
        if one == other:
            raise ValueError(f"{place(k)} {link} must be two different floors")
        if other[0] not in (one[0], one[0] + 1, GROUND):
            rule = f"{one[0] + 1 + first} (to the right), {one[0] + first} itself or the ground"
            raise ValueError(f"{place(k)} next_building = {other[0] + first} must be {rule}")
    starts = first_floors(floors)
    topology = Topology(starts[-1], (), tuple(_ends(link, starts) for link in links))
    _require_forest(topology, links, naming)


def _require_forest(topology: Topology, links: Sequence[FloorLink], naming: Naming) -> None:
    """A ``ValueError`` for a link that closes a ring with those before it, as a second one does."""
    closing = ring(topology)
    if closing is None:
        return
    place, ends = naming.place, topology.links
    rule = "must not close a ring with the links before it"
    for k in range(closing):
        if {*ends[k]} == {*ends[closing]}:
            other = place(k).rstrip(":").rpartition(": ")[2]
            rule = f"must not stand where {other} does: one link has friction, gap and contact"
    raise ValueError(f"{place(closing).rstrip(':')} ({links[closing]}) {rule}")


def first_floors(floors: Iterable[int]) -> list[int]:
    """The mass that is the lowest floor of each building, and the number of masses."""
    return [0, *np.cumsum(list(floors)).tolist()]


def _ends(link: FloorLink, starts: Sequence[int]) -> Ends:
    """The ends of a link as masses of the system, where the lowest floors are ``starts``."""
    floor = link.other_floor
    other = GROUND if floor == GROUND else starts[link.other_building] + floor
    return starts[link.building] + link.floor, other


def require_heights(buildings: Sequence[Any], links: Iterable[FloorLink], naming: Naming) -> None:
    """A ``ValueError`` for links between floors at different heights that do not say so."""
    for k, link in enumerate(links):
        if link.next_floor is not None or link.other_building in (link.building, GROUND):
            continue
        left, right = buildings[link.building], buildings[link.other_building]
        if _have_heights(left, right) and not _meet(left, link.floor, right, link.other_floor):
            one, other = left.elevations[link.floor], right.elevations[link.other_floor]
            rule = "must be at one height; next_floor says which floor is meant where none is"
            told = f"{link}, at {one:g} m and {other:g} m,"
            raise ValueError(f"{naming.place(k)} {told} {rule}")
