"""Which masses rods and links join: the static part of a system, and what follows from it."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import NamedTuple

from jaxpound._errors import InvalidInput

GROUND = -1
"""The ground, as an end of a rod or of a link."""

Ends = tuple[int, int]


class Topology(NamedTuple):
    """Number of masses, and the ends of rods and links: static, it shapes the compiled program."""

    n_masses: int
    rods: tuple[Ends, ...]
    links: tuple[Ends, ...]
    tuned: tuple[int, ...] = ()
    """Tuned masses, which stand on a building and are no floors."""

    @property
    def floor_masses(self) -> list[int]:
        """All masses but tuned ones."""
        return [mass for mass in range(self.n_masses) if mass not in self.tuned]

    @property
    def observed_ends(self) -> list[Ends]:
        """The ends of displacements that are observed: of the masses, then those of other rods."""
        return [*dict.fromkeys([*((i, GROUND) for i in range(self.n_masses)), *self.rods])]


def ring(topology: Topology) -> int | None:
    """The first link that closes a ring with the links before it; None if none does."""
    links = [k for k in range(len(topology.links)) if k not in faces(topology)]
    _, tree = joined_ends(topology.n_masses, [topology.links[k] for k in links])
    return next((k for n, k in enumerate(links) if n not in tree), None)


@cache
def faces(topology: Topology) -> dict[int, int]:
    """The links that are the other face of a link before them, and of which."""
    first, opposite = dict[Ends, int](), dict[int, int]()
    for k, ends in enumerate(topology.links):
        if (link := first.get(ends[::-1])) is not None and link not in opposite.values():
            opposite[k] = link
        else:
            first.setdefault(ends, k)
    return opposite


def is_storey(ends: Ends) -> bool:
    """Whether a rod, or a link, is between two masses."""
    return GROUND not in ends


@cache
def storey_rods(topology: Topology) -> tuple[int, ...]:
    """Rods that are storeys: not of tuned masses, nor of masses that rods before tie to ground."""
    _, tree = joined_ends(topology.n_masses, topology.rods)
    return tuple(r for r in tree if not {*topology.rods[r]} & {*topology.tuned})


@cache
def floors(topology: Topology) -> tuple[tuple[tuple[int, int], ...], ...]:
    """The floors of each building, from the ground up: each a mass and the rod of its storey."""
    buildings, tuned = stacks(topology), {*topology.tuned}
    return tuple(tuple(pair for pair in pairs if pair[0] not in tuned) for pairs in buildings)


@cache
def stacks(topology: Topology) -> tuple[tuple[tuple[int, int], ...], ...]:
    """``floors`` of each building, and above them its tuned masses, each with its rod.

    An ``InvalidInput`` for masses that are no floors one above the other.
    """
    beside: dict[int, list[tuple[int, int]]] = {end: [] for end in range(GROUND, topology.n_masses)}
    for rod in joined_ends(topology.n_masses, topology.rods)[1]:
        i, j = topology.rods[rod]
        beside[i].append((j, rod))
        beside[j].append((i, rod))
    buildings = []
    for first in beside[GROUND]:
        building, below = [first], GROUND
        while len(above := [end for end in beside[building[-1][0]] if end[0] != below]) == 1:
            below = building[-1][0]
            building += above
        buildings.append(tuple(building))
    masses = sorted(mass for building in buildings for mass, _ in building)
    if masses != list(range(topology.n_masses)):
        rule = "must be shear buildings, each floor on one storey"
        raise InvalidInput("structures", "masses", "", rule)
    return tuple(sorted(buildings))


@cache
def rod_groups(topology: Topology) -> list[tuple[int, ...]]:
    """Groups of masses that are connected by rods: the buildings of a system."""
    members: dict[int, list[int]] = {}
    member, _ = joined_ends(topology.n_masses, filter(is_storey, topology.rods))
    for mass, first in member.items():
        members.setdefault(first, []).append(mass)
    return [tuple(masses) for first, masses in members.items() if first != GROUND]


def joined_ends(n: int, edges: Iterable[Ends]) -> tuple[dict[int, int], list[int]]:
    """The smallest member of the group of each mass, and of the ground, that edges make.

    And the edges, by number, that close no ring with those before them.
    """
    group, tree = {end: end for end in range(GROUND, n)}, list[int]()
    for k, (i, j) in enumerate(edges):
        low, high = sorted((group[i], group[j]))
        if low != high:
            group = {end: low if member == high else member for end, member in group.items()}
            tree.append(k)
    return group, tree
