"""Where masses, rods and links are, in words: by building, floor and storey, numbered from 1."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress

from jaxpound.model.system import GROUND, Ends, Topology, floors


def mass_places(topology: Topology) -> tuple[str, ...]:
    """``floor 2 of building 1``; of buildings of one storey ``building 1``, else ``mass 1``."""
    return _each("floor", "mass", topology.n_masses, _homes(topology, of_rods=False))


def rod_places(topology: Topology) -> tuple[str, ...]:
    """``storey 2 of building 1``; of buildings of one storey ``building 1``, else ``rod 1``."""
    return _each("storey", "rod", len(topology.rods), _homes(topology, of_rods=True))


def _homes(topology: Topology, *, of_rods: bool) -> dict[int, Ends]:
    """Building and floor of each mass or rod, from 1; none if these are no shear buildings."""
    with suppress(ValueError):
        return {
            pair[of_rods]: (building + 1, floor + 1)
            for building, storeys in enumerate(floors(topology))
            for floor, pair in enumerate(storeys)
        }
    return {}


def _each(one: str, other: str, n: int, homes: Mapping[int, Ends]) -> tuple[str, ...]:
    if len(homes) < n:  # a rod may stand beside the storeys
        return tuple(f"{other} {i + 1}" for i in range(n))
    if all(floor == 1 for _, floor in homes.values()):
        return tuple(f"building {homes[i][0]}" for i in range(n))
    return tuple(f"{one} {homes[i][1]} of building {homes[i][0]}" for i in range(n))


def link_places(topology: Topology) -> tuple[str, ...]:
    """Where each link is, as ``link_place`` has it; by masses where there are no floors.

    Examples
    --------
    >>> from jaxpound.model.places import link_places
    >>> steel = jp.ZenerRod(order=0.5, tau_f=0.01, tau_x=0.05)
    >>> low, high = (jp.Storeys((1.0,) * n, jp.Rod(steel, 5.0)) for n in (1, 2))
    >>> brace = jp.FloorLink(building=0, floor=1, friction=0.1, next_building=0)
    >>> row = jp.Row((high, low), (jp.FloorLink(0, 0), brace))
    >>> link_places(row.system().topology)
    ('1–2, floor 1', 'in 1, floors 1–2')
    """
    home = _homes(topology, of_rods=False)
    return tuple(_place(ends, home) for ends in topology.links)


def _place(ends: Ends, home: dict[int, Ends]) -> str:
    first, other = ends if ends[0] != GROUND else ends[::-1]
    if home:
        return link_place(home[first], home.get(other))
    return (
        f"mass {first + 1}–ground" if other == GROUND else f"masses {min(ends) + 1}–{max(ends) + 1}"
    )


def link_place(end: Ends, other: Ends | None) -> str:
    """Where a link is, by building and floor of its ends, from 1; None is the ground.

    Examples
    --------
    >>> from jaxpound.model.places import link_place
    >>> link_place((1, 2), (2, 2)), link_place((1, 2), (2, 3))
    ('1–2, floor 2', '1–2, floors 2–3')
    >>> link_place((1, 2), (1, 1)), link_place((1, 2), None)
    ('in 1, floors 1–2', '1–ground, floor 2')
    """
    if other is None:
        return f"{end[0]}–ground, floor {end[1]}"
    (building, floor), (next_building, next_floor) = sorted((end, other))
    between = f"in {building}" if building == next_building else f"{building}–{next_building}"
    floors = f"floor {floor}" if floor == next_floor else f"floors {floor}–{next_floor}"
    return f"{between}, {floors}"
