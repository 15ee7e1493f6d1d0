"""Buildings of one or more storeys in a row, and the links between their floors."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from types import NoneType
from typing import Any, ClassVar, NamedTuple

import numpy as np

from jaxpound._checks import as_tuple, instance, is_traced, is_whole, require_one_of
from jaxpound._errors import InvalidInput, warn
from jaxpound._fields import check, like, part, pytree_dataclass, static, unchecked
from jaxpound.model.building import Building
from jaxpound.model.column import Column
from jaxpound.model.contact import ContactLaw, KelvinVoigt, Newton
from jaxpound.model.dampers import Inerter, VelocityFriction
from jaxpound.model.places import TUNED, column_place, homes, link_place
from jaxpound.model.shear_building import ShearBuilding
from jaxpound.model.structures import Storeys
from jaxpound.model.system import (
    RING,
    Link,
    Rod,
    System,
    check_link,
    faces_of,
    is_closable,
    may_hold,
    require_face,
    require_independent,
    without_dampers,
)
from jaxpound.model.topology import (
    GROUND,
    AnyEnds,
    Ends,
    Topology,
    WeightedMasses,
    faces,
    masses_of,
    ring,
    support,
)
from jaxpound.model.vibration import first_frequency
from jaxpound.quantities import DIMENSIONLESS

BETWEEN = ("friction", "gap", "contact", "damper", "velocity_friction", "inerter")
"""What a link has between its ends."""


@pytree_dataclass
class FloorLink:
    """A link between two floors of a row: dry friction, a gap, and contact where the gap closes.

    It joins neighbouring buildings, two floors of one building (a friction brace), or a floor and
    the ground. Buildings and floors are numbered from 0.

    Parameters
    ----------
    building
        The building on the left.
    floor
        Its floor; the number behind those of floors and tuned masses is a footing on soil.
    next_floor
        The floor at the other end, or ``GROUND``; by default the same, or in a brace that below.
    friction, gap, contact, damper, velocity_friction, inerter
        As in ``Link``: slip force μ ≥ 0, gap ξ0 ≥ 0 at rest (infinite by default), law of contact,
        damper and so on; dimensionless in a ``Row``, in N, m and SI units between buildings in SI.
        A tuple (left, right) of gaps, and of laws, makes a link of two faces.
    next_building
        The building at the other end: by default the next one to the right; ``building`` itself
        for a brace, which slips by the drift of its storeys; ``GROUND`` for a damper to the ground,
        on soil to the footing, or ``jp.support(k)`` for one to a support that moves apart, such as
        an abutment.
    side
        "left" of the left face of a link, where the gap closes as ``building`` moves to the left of
        the other end; a ``Row`` makes it of a link of two faces. "right" by default.
    column
        The ``Column`` that one of the floors hits: that of the storey below the other one, which is
        higher. The link then has only one gap, and contact by ``KelvinVoigt`` or none, and joins
        neighbours. None by default.

    Examples
    --------
    Arguments count from 0; what is printed counts from 1:

    >>> print(jp.FloorLink(building=0, floor=2, friction=0.1))
    1–2, floor 3
    >>> print(jp.FloorLink(building=1, floor=3, friction=0.2, next_building=1))  # a brace
    in 2, floors 3–4

    Floor 3 of the left building hits the columns between floors 3 and 4 of the right one:

    >>> column = jp.model.Column(rigidity=300e6)
    >>> link = jp.FloorLink(building=0, floor=2, next_floor=3, gap=0.05, column=column)
    """

    building: int = static()
    floor: int = static()
    next_floor: int | None = static(default=None)
    friction: Any = like(Link, "friction", default=0.0)
    gap: Any = like(Link, "gap", default=np.inf)
    contact: ContactLaw | Newton | None = like(Link, "contact", default=None)
    next_building: int | None = static(default=None)
    damper: Rod | None = like(Link, "damper", default=None)
    velocity_friction: VelocityFriction | None = like(Link, "velocity_friction", default=None)
    inerter: Inerter | None = like(Link, "inerter", default=None)
    side: str = static(default="right")
    column: Column | None = part(Column, default=None, listed=bool)

    def __post_init__(self) -> None:
        require_one_of(self.side, ("right", "left"), "side")
        for name in ("building", "floor", "next_floor", "next_building"):
            number, is_next = getattr(self, name), name.startswith("next")
            least = number if name == "next_building" else GROUND if is_next else 0
            if number is None and is_next:
                continue
            if not (is_whole(number) and number >= least):
                rule = "must be a whole number from 0 on" + ", or GROUND" * is_next
                raise InvalidInput(name, repr(number), rule)
            object.__setattr__(self, name, int(number))
        own = {"next_floor": None, "next_building": self.building}
        ends = {name: getattr(self, name) for name in own}
        stated = {name: end for name, end in ends.items() if end not in (None, own[name])}
        if stated and min(stated.values()) <= GROUND and len({*stated.values()}) > 1:
            name = max(stated, key=stated.__getitem__)
            rule = "must be left out: the other end is the ground"
            raise InvalidInput(name, str(stated[name]), rule)
        check_link(self, f"link {self}")
        if self.column is not None:
            self._require_only_contact()

    def _require_only_contact(self) -> None:
        """An ``InvalidInput`` for what a link at a column may not have."""
        require_face("", self, "must be left out at a column, which has a gap and contact only")
        is_single = self.side == "right" and not isinstance(self.gap, tuple)
        is_single &= self.other_floor > GROUND
        if not is_single or self.other_building != self.building + 1:
            rule = "must be of one gap between neighbours, without side and next_building"
            raise InvalidInput(f"link {self}, at a column,", "", rule)
        if not isinstance(self.contact, KelvinVoigt | NoneType):
            rule = "must be KelvinVoigt at a column: a spring in series with the column's"
            raise InvalidInput("contact", type(self.contact).__name__, rule)

    more_rules = Link.more_rules

    def faces(self) -> tuple[FloorLink, ...]:
        """The link itself; of a link of two faces the right face and the left face."""
        return faces_of(self, side="left")

    @property
    def other_building(self) -> int:
        """The building at the other end, ``GROUND`` or another support."""
        return self.building + 1 if self.next_building is None else self.next_building

    @property
    def other_floor(self) -> int:
        """The floor at the other end, ``GROUND`` or another support."""
        if self.other_building <= GROUND:
            return self.other_building
        if self.next_floor is not None:
            return self.next_floor
        return self.floor - (self.other_building == self.building)

    def __str__(self) -> str:
        """Its two ends in words, numbered from 1."""
        other = (self.other_building + 1, self.other_floor + 1)
        end = (self.building + 1, self.floor + 1)
        if (column := self.column) is not None and column.side is not None:
            return column_place(*((end, other) if column.side == "right" else (other, end)))
        words = link_place(end, self.other_floor if self.other_floor <= GROUND else other)
        return words + ", column" * (column is not None)


@pytree_dataclass
class Row:
    """Buildings side by side, from left to right, with links between their floors; dimensionless.

    Raises ``ValueError`` if a link names no building or floor of the row, has one floor at both
    ends or skips a building, or links with friction close a ring.

    Parameters
    ----------
    buildings
        ``Storeys``, from left to right. Their floors are the masses of ``system()`` and of results
        in this order, each building's from the ground up.
    links
        Links between floors (``floor_links`` makes them for every common floor). Those with
        friction may not close a ring (see ``System``).
    supports
        The number of the support that each building stands on (``support``), where these move
        apart; by default all stand on 0.

    Examples
    --------
    A house of two storeys beside one of a single storey, with damper and contact at floor 1:

    >>> steel = jp.ZenerRod(order=0.5, tau_f=0.01, tau_x=0.05)
    >>> low, high = (jp.Storeys((1.0,) * n, jp.Rod(steel, 5.0)) for n in (1, 2))
    >>> law = jp.KelvinVoigt(stiffness=300.0, restitution=0.65)
    >>> row = jp.Row((high, low), (jp.FloorLink(0, 0, friction=0.1, gap=0.2, contact=law),))
    >>> row.system().links[0].ends
    (0, 2)
    """

    buildings: tuple[Storeys, ...] = part(Storeys, each=True)
    links: tuple[FloorLink, ...] = part(FloorLink, each=True, default=())
    supports: tuple[int, ...] = static(default=(), listed=bool)
    units: ClassVar = DIMENSIONLESS

    def __post_init__(self) -> None:
        object.__setattr__(self, "links", by_face(as_tuple("links", self.links)))
        check(self)
        object.__setattr__(self, "supports", known_supports(self.supports, len(self.buildings)))
        require_floors([x.n_ends for x in self.buildings], self.links, LinkLabels())
        if any(x.column for x in self.links) or any(x.heights for x in self.buildings):
            require_independent(self.system())

    @property
    def natural_frequencies(self) -> tuple[Any, ...]:
        """Natural frequency of the first mode of each building (``jp.modes``), in units of ω1."""
        return tuple(first_frequency(building) for building in self.buildings)

    def system(self) -> System:
        """Masses, rods and links, building by building."""
        starts = _first_floors([len(building.masses) for building in self.buildings])
        masses, rods, links, tuned = list[Any](), list[Rod](), list[Link](), list[int]()
        damping, influence = list[Rod](), list[float]()
        for number, (building, first) in enumerate(zip(self.buildings, starts, strict=False)):
            masses += building.masses
            stands_on = support(self.supports[number]) if self.supports else GROUND
            rotation = first + building.n_storeys + 1 if building.heights else None
            damping += standing(building.damping_from(first), stands_on, rotation)
            influence += building.influences
            tuned += range(first + building.n_floors, first + building.n_storeys)
            rods += standing(building.rods_from(first), stands_on, rotation)
        for x in self.links:
            between = {name: getattr(x, name) for name in BETWEEN}
            links.append(unchecked(Link, **(between | self._joint(x, starts, links))))
        kept, dampers = without_dampers(links)
        parts = {"rods": (*rods, *dampers), "links": kept, "damping": tuple(damping)}
        if 0.0 in influence:
            parts["influence"] = tuple(influence)
        return unchecked(System, masses=tuple(masses), tuned=tuple(tuned), **parts)

    def _joint(self, link: FloorLink, starts: Sequence[int], before: Sequence[Link]) -> Any:
        """Ends, weights and, at a column, law of a link behind those ``before`` it.

        Within a building on soil, and from it to its footing, they leave out a rigid rotation.
        """
        if link.column is not None:
            b = link.building + (link.column.side != "left")
            return _at_column(link, _ends(link, starts), self.buildings[b], starts[b])
        if link.other_building not in (link.building, GROUND):
            return {"ends": _ends(link, starts)}
        building, first = self.buildings[link.building], starts[link.building]
        joint = building.between(link.floor, link.other_floor, first)
        if link.side == "right":
            return joint
        if before and before[-1].ends == joint["ends"] and building.heights:
            return {"ends": joint["ends"]._replace(side=-1)}
        return building.between(link.other_floor, link.floor, first)


def known_supports(supports: Any, n: int) -> tuple[int, ...]:
    """The support under each of n buildings, () where it is 0; an ``InvalidInput`` for others."""
    supports = as_tuple("supports", supports)
    if len(supports) not in (0, n) or not all(is_whole(x) and x >= 0 for x in supports):
        rule = f"must be a whole number from 0 on for each of the {n} buildings"
        raise InvalidInput("supports", repr(supports), rule)
    return tuple(map(int, supports)) if any(supports) else ()


def standing(rods: Sequence[Rod], stands_on: int, rotation: int | None) -> list[Rod]:
    """Rods of which those on the ground stand on a support, but for that of a rotation."""
    if stands_on == GROUND:
        return [*rods]
    kept = list[Rod]()
    for rod in rods:
        ends: Any = rod.ends
        if not isinstance(ends, WeightedMasses) and rotation not in ends:
            ends = tuple(stands_on if end == GROUND else end for end in ends)
        kept.append(unchecked(Rod, **(vars(rod) | {"ends": ends})))
    return kept


def by_face(links: Sequence[Any]) -> tuple[Any, ...]:
    """Links with each link of two faces as two links."""
    faces = [link.faces() if isinstance(link, FloorLink) else (link,) for link in links]
    return tuple(itertools.chain(*faces))


def floor_links(
    buildings: Sequence[Any],
    *,
    friction: Any = 0.0,
    gap: Any = np.inf,
    contact: ContactLaw | Newton | None = None,
    building: int | None = None,
    columns: Column | Sequence[Column | None] | None = None,
) -> tuple[FloorLink, ...]:
    """Links between neighbouring buildings at every common floor, and where floors meet columns.

    Raises ``ValueError`` if there are fewer than two buildings, neighbours have no common floor and
    no columns, ``building`` has no neighbour on its right, a list is not as long as the links, or
    columns are of buildings without heights. Warns (``PlausibilityWarning``) of floors up to the
    lower roof that get no gap: ``columns``, or a ``FloorLink`` with ``next_floor``, make one.

    Parameters
    ----------
    buildings
        From left to right: all are ``Storeys``, or all ``ShearBuilding`` or ``Building`` in SI. Two
        floors are common if they have the same number; for two ``ShearBuilding`` instead, if their
        heights above the ground differ by at most 0.2 m, the thickness of a slab.
    friction, gap, contact
        As in ``FloorLink``, of every link; or a list or an array with one for each link, from left
        to right and from the ground up. (A tuple of gaps are those of two faces.)
    building
        The building on the left of the only gap that gets links; by default all gaps get them.
    columns
        The ``Column`` of every storey that a floor of a neighbour hits: floors up to the lower roof
        that have none at their height then get a link, too. One for all ``ShearBuilding``, or one
        for each, or None for a building whose columns are not hit. Position, height and side follow
        from the elevations.

    Examples
    --------
    >>> steel = jp.ZenerRod(order=0.5, tau_f=0.01, tau_x=0.05)
    >>> low, high = (jp.Storeys((1.0,) * n, jp.Rod(steel, 5.0)) for n in (2, 3))
    >>> dampers = jp.floor_links((low, high, low), building=0, friction=0.1, gap=0.2)
    >>> contact = jp.floor_links((low, high, low), building=1, gap=0.1, contact=jp.Newton(0.65))
    >>> [str(link) for link in dampers + contact]
    ['1–2, floor 1', '1–2, floor 2', '2–3, floor 1', '2–3, floor 2']
    """
    if len(buildings := as_tuple("buildings", buildings)) < 2:
        name = f"buildings, {len(buildings)} of them,"
        raise InvalidInput(name, "", "must be two or more")
    kinds = (Storeys,) if isinstance(buildings[0], Storeys) else (ShearBuilding, Building)
    for i, member in enumerate(buildings):
        instance(f"buildings.{i}", member, *kinds)
    last = len(buildings) - 2
    if building is not None and not (is_whole(building) and 0 <= building <= last):
        rule = f"must be from 0 to {last}, a building with another on its right"
        raise InvalidInput("building", repr(building), rule)
    lefts = range(last + 1) if building is None else [building]
    common = meeting_floors(buildings, lefts, gap, _columns_of(buildings, columns))
    n, between = len(common), {"friction": friction, "gap": gap, "contact": contact}
    for name, x in between.items():
        is_list = isinstance(x, list) or getattr(x, "ndim", 0) > 0
        is_list |= name == "friction" and isinstance(x, tuple)  # which has no faces
        if is_list and len(x) != n:
            rule = f"must be one for all links or {n}, one for each"
            raise InvalidInput(f"{name}, {len(x)} of them,", "", rule)
        between[name] = x if is_list else [x] * n
    links = zip(common, *between.values(), strict=True)
    return tuple(
        FloorLink(b, i, j, mu, size, law, column=column)
        for (b, i, j, column), mu, size, law in links
    )


_SLAB = 0.2
"""Largest difference in height of floors that meet, m: about the thickness of a slab. In models
with low storeys it is a quarter of a storey."""


Meeting = tuple[int, int, int, Column | None]  # building on the left, floors, a column hit


def meeting_floors(
    buildings: Sequence[Any], lefts: Iterable[int], gap: Any, columns: Sequence[Column | None]
) -> list[Meeting]:
    """Common floors, and floors that meet ``columns``; warns of floors that meet neither."""
    meeting, alone = list[Meeting](), list[str]()
    for i in lefts:
        pair = buildings[i : i + 2]
        common = common_floors(*pair)
        links: list[Meeting] = [(i, *floors, None) for floors in common]
        if all(isinstance(building, ShearBuilding) for building in pair):
            ups = [building.elevations for building in pair]
            for side, floors in enumerate(_without_partner(ups, common)):
                storeys = np.searchsorted(ups[1 - side], ups[side][floors]).tolist()
                left_alone = [*floors]
                if (column := columns[i + 1 - side]) is not None:
                    hit = replace(column, side="left" if side else "right")
                    for floor, storey in zip(floors, storeys, strict=True):
                        if storey >= pair[1 - side].n_bearings:  # which have no columns
                            left_alone.remove(floor)
                            ends = (storey, floor) if side else (floor, storey)
                            links.append((i, *ends, hit))
                if left_alone:
                    listed = ", ".join(str(j + 1) for j in left_alone)
                    alone.append(f"{listed} of building {i + side + 1} beside {i + 2 - side}")
            links.sort(key=lambda x: min(ups[0][x[1]], ups[1][x[2]]))
        if not links:
            rule = f"must have floors at the same height, within {_SLAB} m; next_floor joins others"
            raise InvalidInput(f"buildings {i + 1} and {i + 2}", "", rule)
        meeting += links
    if alone and any(map(is_closable, gap if isinstance(gap, tuple | list) else [gap])):
        finding = f"floors {' and '.join(alone)} have no floor of the neighbour within {_SLAB} m "
        finding += "and are not checked for pounding; columns or next_floor join others"
        warn([finding], False)
    return meeting


def _without_partner(
    ups: Sequence[np.ndarray], common: Sequence[tuple[int, int]]
) -> Iterator[list[int]]:
    """Of each of two buildings the floors up to the lower roof that have none at their height."""
    for side, elevations in enumerate(ups):
        joined = {floors[side] for floors in common}
        below = np.flatnonzero(elevations <= min(x[-1] for x in ups)).tolist()
        yield [floor for floor in below if floor not in joined]


def _columns_of(buildings: Sequence[Any], columns: Any) -> list[Column | None]:
    """The column of each building that floors of neighbours hit, one for all or listed."""
    listed = [*columns] if isinstance(columns, list | tuple) else [columns] * len(buildings)
    for x in listed:
        instance("columns", x, Column, NoneType)
        for key in ("position", "height", "side") if x is not None else ():
            if getattr(x, key) is not None:
                rule = "must be left out: it follows from the elevations"
                raise InvalidInput(f"columns: {key}", str(getattr(x, key)), rule)
    if len(listed) != len(buildings):
        rule = f"must be one for all or {len(buildings)}, one for each building"
        raise InvalidInput(f"columns, {len(listed)} of them,", "", rule)
    if any(listed) and not all(isinstance(x, ShearBuilding) for x in buildings):
        rule = "must be left out of buildings without heights: all must be ShearBuilding"
        raise InvalidInput("columns", "", rule)
    return listed


def checked_floors(topology: Topology | None, gaps: Sequence[Any]) -> str:
    """Of how many floors of neighbours gaps tell, in words; empty if it is of all.

    Of two buildings that links with gaps join it counts the floors of that with fewer. ``gaps`` are
    numbers or arrays by link, infinite or empty without a gap.
    """
    home = homes(topology) if topology else {}
    sizes, walls = Counter(b for b, floor in home.values() if floor >= TUNED), set[Ends]()
    joined: dict[tuple[int, ...], set[Ends]] = {}
    for ends, gap in zip(topology.links if home and topology else (), gaps, strict=False):
        if np.any(np.isfinite(np.asarray(gap, float))):
            floors = {home[mass] for mass in masses_of(ends) if home[mass][1] >= TUNED}
            pair = tuple(sorted({building for building, _ in floors}))
            if isinstance(ends, WeightedMasses) and ends.column:  # the floor, and not what it hits
                floors = {home[ends.masses[0]]}
            (joined.setdefault(pair, set()) if len(pair) > 1 else walls).update(floors)
    lower = {pair: min(pair, key=sizes.__getitem__) for pair in joined}
    n = sum(b == lower[pair] for pair, x in joined.items() for b, _ in x | walls)
    whole = sum(sizes[b] for b in lower.values())
    return "" if n == whole else f", of {n} of {whole} floors (the others have no gap)"


def common_floors(left: Any, right: Any) -> list[tuple[int, int]]:
    """Floors of two buildings that meet: of equal number or, where heights are known, height."""
    if not (isinstance(left, ShearBuilding) and isinstance(right, ShearBuilding)):
        return [(i, i) for i in range(min(left.n_floors, right.n_floors))]
    heights = [building.heights[: building.n_floors] for building in (left, right)]
    slab = np.minimum(_SLAB, np.minimum.outer(*heights) / 4)
    apart = np.abs(np.subtract.outer(left.elevations, right.elevations))
    return [(i, j) for i, j in np.argwhere(apart <= slab * (1 + 1e-9)).tolist()]


class LinkLabels(NamedTuple):
    """How messages name links and count floors."""

    link: Callable[[int], str] = "links.{}".format
    """The name of link k."""
    between: str = ": "
    """What stands between a link and its field."""
    first: int = 0
    """The number of the first building and floor."""

    def invalid(self, k: int, name: str, value: Any, rule: str) -> InvalidInput:
        """The error for a field of link k."""
        return InvalidInput(self.link(k) + self.between + name, str(value), rule)


def require_floors(floors: Sequence[int], links: Sequence[FloorLink], labels: LinkLabels) -> None:
    """An ``InvalidInput`` without buildings, or for links that do not join floors of these."""
    if not floors:
        raise InvalidInput("buildings", "()", "must hold at least one building")
    first = labels.first
    for k, link in enumerate(links):
        ends = ((link.building, link.floor, ""), (link.other_building, link.other_floor, "next_"))
        for building, floor, prefix in ends:
            if min(building, floor) <= GROUND:
                continue
            if building >= (n := len(floors)):
                rule = f"must be from {first} to {n - 1 + first}: there are {n} buildings"
                raise labels.invalid(k, f"{prefix}building", building + first, rule)
            if floor >= (n := floors[building]):
                has = f"building {building + 1} has {n} floor{'s' * (n > 1)}"
                rule = f"must be from {first} to {n - 1 + first}: {has}"
                raise labels.invalid(k, f"{prefix}floor", floor + first, rule)
        left, right = link.building, link.other_building
        if (left, link.floor) == (right, link.other_floor):
            raise labels.invalid(k, str(link), "", "must be two different floors")
        if right > GROUND and right not in (left, left + 1):
            rule = f"must be {left + 1 + first} (to the right), {left + first} itself or the ground"
            raise labels.invalid(k, "next_building", right + first, rule)
    _require_forest(floors, links, labels)


def _require_forest(floors: Sequence[int], links: Sequence[FloorLink], labels: LinkLabels) -> None:
    """An ``InvalidInput`` for a link that closes a ring, or has the ends of one before it."""
    starts = _first_floors(floors)
    ends = tuple(_ends(link, starts) for link in links)
    topology = Topology(starts[-1], (), ends)
    for k in faces(topology):
        require_face(labels.link(k) + labels.between, links[k])
    if (closing := ring(topology, [*map(may_hold, links)])) is None:
        return
    rule = RING
    for k in range(closing):
        if {*ends[k]} == {*ends[closing]}:
            place = labels.link(k)
            rule = f"must not stand where {place} does: one link has friction, damper, gap and "
            rule += "contact, and gap=(left, right) makes one of two faces"
    raise InvalidInput(f"{labels.link(closing)} ({links[closing]})", "", rule)


def _first_floors(floors: Sequence[int]) -> list[int]:
    """The mass of the lowest floor of each building, and the number of masses."""
    return [0, *np.cumsum(floors).tolist()]


def _ends(link: FloorLink, starts: Sequence[int]) -> AnyEnds:
    """The ends of a link as masses of the system, where the lowest floors are ``starts``."""
    floor = link.other_floor
    other = floor if floor <= GROUND else starts[link.other_building] + floor
    end = starts[link.building] + link.floor
    if link.column is not None:
        hit, above = (other, end) if link.column.side == "left" else (end, other)
        stands_on = () if above in starts else (above - 1,)
        return WeightedMasses((hit, above, *stands_on), column=True)
    return (other, end) if link.side == "left" else (end, other)


def _at_column(link: FloorLink, ends: Any, owner: Storeys, first: int) -> dict[str, Any]:
    """Ends, weights and law of a link at a column of ``owner``, which moves as floors and it do."""
    column: Any = link.column
    if column.position is None or column.height is None:
        rule = "must have position and height where buildings have no elevations"
        raise InvalidInput(f"link {link}: column", "", rule)
    sign, w = -1.0 if column.side == "left" else 1.0, column.weight
    storey = link.floor if column.side == "left" else link.other_floor
    weights = (sign, -sign * w, -sign * (1 - w))[: 2 + (storey > 0)]
    if owner.heights:  # the point turns with the storey
        footing, (hit, above, *_) = first + owner.n_storeys, ends.masses
        masses = (hit, above, above - 1 if storey else footing, footing + 1)
        turn = (column.position - w) * owner.heights[storey]
        weights = sign, -sign * w, -sign * (1 - w), -sign * turn
        ends = ends._replace(masses=masses)
    behind = column.behind(link.contact)
    return {"ends": ends, "weights": weights, "column": column, "contact": behind}


def at_elevations(link: FloorLink, buildings: Sequence[Any], name: str) -> FloorLink:
    """A link whose column has what is not stated from the elevations of buildings in SI.

    An ``InvalidInput``, with the name of the link, if they do not say it.
    """
    column, floors = link.column, (link.floor, link.other_floor)
    pair = buildings[link.building], buildings[max(link.other_building, 0)]
    if column is None or not all(isinstance(building, ShearBuilding) for building in pair):
        return link
    ups = [float(np.cumsum(x.heights)[floor]) for x, floor in zip(pair, floors, strict=True)]
    side = column.side or ("left" if ups[0] > ups[1] else "right")
    on_right = side == "right"
    height = pair[on_right].heights[floors[on_right]]
    position = 1 - (ups[on_right] - ups[not on_right]) / height
    hit = pair[on_right]
    if not 0 < position < 1 or not hit.n_bearings <= floors[on_right] < hit.n_floors:
        rule = f"must be within the storey of the column, {height:g} m high below the higher floor"
        rule += "; bearings and tuned masses have none"
        raise InvalidInput(f"{name}{link}, at {ups[0]:g} m and {ups[1]:g} m,", "", rule)
    changes = {"position": position, "height": height}
    for key, x in changes.items():
        stated = getattr(column, key)
        if stated is not None and (is_traced(stated) or abs(stated - x) > _SLAB * x):
            rule = f"must be left out, as it is {x:.4g} by the elevations"
            raise InvalidInput(f"{name}column.{key}", str(stated), rule)
    resolved = unchecked(Column, **{**vars(column), **changes, "side": side})
    return unchecked(FloorLink, **{**vars(link), "column": resolved})


def require_heights(
    buildings: Sequence[Any], links: Sequence[FloorLink], labels: LinkLabels
) -> None:
    """An ``InvalidInput`` for a link without ``next_floor`` between floors of different heights.

    Also for one between a tuned mass and that, or the footing, of a neighbour.
    """
    for k, link in enumerate(links):
        if link.other_building <= GROUND or link.other_building == link.building:
            continue
        left, right = buildings[link.building], buildings[link.other_building]
        ends = (left, link.floor), (right, link.other_floor)
        if all(floor == len(building.storeys) for building, floor in ends):
            continue  # footings
        if all(floor >= building.n_floors for building, floor in ends):
            numbers = link.building + 1, link.other_building + 1
            footings = [
                f"; the footing of building {b} is floor {len(building.storeys) + labels.first}"
                for b, (building, _) in zip(numbers, ends, strict=True)
                if building.footing is not None
            ]
            rule = "must not join a tuned mass to that, or the footing, of a neighbour"
            raise labels.invalid(k, f"{link},", "", rule + "".join(footings))
        is_at_any_height = link.next_floor is not None or link.column is not None
        if not is_at_any_height and (link.floor, link.other_floor) not in common_floors(
            left, right
        ):
            low, high = (np.append(np.cumsum(x.heights), 0.0)[floor] for x, floor in ends)
            rule = "must be at one height; next_floor says which floor is meant where none is"
            raise labels.invalid(k, f"{link}, at {low:g} m and {high:g} m,", "", rule)
