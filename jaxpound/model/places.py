"""Names of masses, rods and links in words: by building, floor and storey, numbered from 1."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress

from jaxpound.model.topology import (
    GROUND,
    AnyEnds,
    Ends,
    Topology,
    WeightedMasses,
    faces,
    soil_spring,
    stacks,
    two_ends,
)

TUNED, FOOTING, ROTATION = 0, -1, -2
"""The numbers of a tuned mass, of a footing on soil and of its rotation among the floors of a
building, which count from 1."""

_NO_FLOORS = {TUNED: "tuned mass", FOOTING: "footing", ROTATION: "rotation"}
_ON_SOIL = {FOOTING: "sway", ROTATION: "rocking"}  # their rods
_LEVER = {ROTATION: ", at 1 m"}  # a rotation is the displacement of a lever of this length


def mass_places(topology: Topology) -> tuple[str, ...]:
    """``floor 2 of building 1``; of buildings of one storey ``building 1``, else ``mass 1``.

    A tuned mass and its rod are ``tuned mass of building 1``; on soil there are ``footing of
    building 1`` and ``rotation of building 1, at 1 m``.
    """
    home, n = homes(topology), topology.n_masses
    return tuple(_part("floor", home, home[i]) if home else f"mass {i + 1}" for i in range(n))


def rod_places(topology: Topology) -> tuple[str, ...]:
    """``storey 2 of building 1``; of buildings of one storey ``building 1``, else ``rod 1``.

    A rod beside the storeys, such as a damper, is ``rod 1–2, floor 2`` after its ends; the springs
    of the soil are ``sway of building 1`` and ``rocking of building 1, at 1 m``.
    """
    storeys, home, places = homes(topology, of_rods=True), homes(topology), list[str]()
    for rod, ends in enumerate(topology.rods):
        if rod in storeys:
            places.append(_part("storey", home, storeys[rod]))
        elif home and getattr(ends, "between", ends) is not None:
            low, high = sorted(two_ends(ends))
            places.append(f"rod {link_place(home[high], home.get(low, low))}")
        else:
            places.append(f"rod {rod + 1}")
    return tuple(places)


def _part(part: str, home: Mapping[int, Ends], place: Ends) -> str:
    """A part of a building by its number; the building where all have one storey."""
    building, floor = place
    if floor in _NO_FLOORS:
        words = _ON_SOIL.get(floor) if part == "storey" else None
        return f"{words or _NO_FLOORS[floor]} of building {building}{_LEVER.get(floor, '')}"
    has_floors = any(floor > 1 for _, floor in home.values())
    return f"{part} {floor} of building {building}" if has_floors else f"building {building}"


def homes(topology: Topology, *, of_rods: bool = False) -> dict[int, Ends]:
    """Building and floor of each mass or rod, from 1; empty if these are no shear buildings."""
    places = dict[int, Ends]()
    with suppress(ValueError):
        for building, stack in enumerate(stacks(topology), 1):
            for floor, pair in enumerate(stack, 1):
                is_tuned = pair[0] in topology.tuned
                places[pair[of_rods]] = building, TUNED if is_tuned else floor
            if isinstance(ends := topology.rods[stack[0][1]], WeightedMasses):
                for number, mass in zip((FOOTING, ROTATION), ends.masses[1:], strict=True):
                    key = soil_spring(topology, mass) if of_rods else mass
                    places[key] = building, number
    return places


def link_places(topology: Topology) -> tuple[str, ...]:
    """Each link's ends as in ``link_place``; by masses where there are no floors.

    Of the two faces of a link the right one is where its left end touches as it moves to the right.
    """
    home, places = homes(topology), list[str]()
    for ends in topology.links:
        if isinstance(ends, WeightedMasses) and ends.between and home:
            ends = two_ends(ends)
        if isinstance(ends, WeightedMasses) and ends.column and home:
            hit, storey = (home[mass] for mass in ends.masses[:2])
            places.append(column_place(hit, storey))
            continue
        if isinstance(ends, WeightedMasses):
            numbers = ", ".join(str(mass + 1) for mass in ends.masses)
            words = f"mass{'es' * (len(ends.masses) > 1)} {numbers}"
            places.append(f"{words} (link {len(places) + 1})")  # several may join the same
            continue
        low, high = sorted(ends)
        words = f"mass {high + 1}–{support_place(low)}"
        words = words if low <= GROUND else f"masses {low + 1}–{high + 1}"
        places.append(link_place(home[high], home.get(low, low)) if home else words)
    for pair in faces(topology).items():
        for k in pair:
            places[k] += ", right" if _is_right(topology.links[k]) else ", left"
    return tuple(places)


def _is_right(ends: AnyEnds) -> bool:
    """Whether a link is the right face of a link of two faces."""
    if isinstance(ends, WeightedMasses):
        return ends.side > 0
    i, j = ends
    return j <= GROUND or GROUND < i < j


def support_place(end: int) -> str:
    """The ground or, from 1, another support."""
    return "ground" if end == GROUND else f"support {GROUND - end + 1}"


def link_place(end: Ends, other: Ends | int) -> str:
    """A link's ends by building and floor, from 1, of which one may be the ground or a support.

    Examples
    --------
    >>> from jaxpound.model.places import GROUND, link_place
    >>> link_place((1, 2), (2, 2)), link_place((1, 2), (2, 3))
    ('1–2, floor 2', '1–2, floors 2–3')
    >>> link_place((1, 2), (1, 1)), link_place((1, 2), GROUND)
    ('in 1, floors 1–2', '1–ground, floor 2')
    """
    if isinstance(other, int):
        return f"{end[0]}–{support_place(other)}, {_floor(end[1])}"
    (building, floor), (next_building, next_floor) = sorted((end, other))
    between = f"in {building}" if building == next_building else f"{building}–{next_building}"
    if floor == next_floor:
        return f"{between}, {_floor(floor)}"
    if {floor, next_floor} & _NO_FLOORS.keys():
        return f"{between}, {_floor(floor)}–{_floor(next_floor)}"
    return f"{between}, floors {floor}–{next_floor}"


def column_place(hit: Ends, storey: Ends) -> str:
    """A link at a column, ``1–2, floor 3–column 2``, by the floor that hits it and its storey."""
    (left, a), (right, b) = sorted(((hit[0], _floor(hit[1])), (storey[0], f"column {storey[1]}")))
    return f"{left}–{right}, {a}–{b}"


def _floor(number: int) -> str:
    return _NO_FLOORS.get(number, f"floor {number}")
