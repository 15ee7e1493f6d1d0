"""Which masses rods and links join: the static part of a system, and what follows from it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache
from typing import Any, NamedTuple

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

    def loads(self, forces: Sequence[Any]) -> list[Any]:
        """The loads of the rods' forces on all masses."""
        return [load_on(self.rods, mass, forces) for mass in range(self.n_masses)]

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


def elongation(ends: Ends, x: Sequence[Any]) -> Any:
    """x_i − x_j between two ends, of displacements or velocities by mass; the ground's is 0."""
    i, j = ends
    if j == GROUND:
        return x[i]
    return -x[j] if i == GROUND else x[i] - x[j]


def load_on(ends_of_all: Sequence[Ends], mass: int, forces: Sequence[Any]) -> Any:
    """The load on a mass of the forces that pull it and their other end together."""
    pairs = zip(ends_of_all, forces, strict=True)
    loads = [-force if mass == ends[0] else force for ends, force in pairs if mass in ends]
    return sum(loads[1:], loads[0]) if loads else None


class LinkGroup(NamedTuple):
    """Links that share masses, directly or through other links between them: a tree."""

    links: tuple[int, ...]
    """Those of the tree, then the other faces of some of them."""
    faces: tuple[int, ...]
    """For each other face: the position in ``links`` of the link that it belongs to."""
    masses: tuple[int, ...]
    root: int
    """The ground if it is the end of a link, else the left end of the first link."""
    hanging: tuple[tuple[int, int, int], ...]
    """Link, parent end and child end, which *hangs* on the parent; from the root on."""


@cache
def link_groups(topology: Topology) -> tuple[LinkGroup, ...]:
    """The groups of links, in the order of their first links."""
    member, _ = joined_ends(topology.n_masses, filter(is_storey, topology.links))
    joined: dict[int, list[int]] = {}
    opposite, groups = faces(topology), []
    for k, ends in enumerate(topology.links):
        if k not in opposite:
            joined.setdefault(member[max(ends)], []).append(k)
    for links in joined.values():
        members = {end for k in links for end in topology.links[k]}
        root = GROUND if GROUND in members else topology.links[links[0]][0]
        reached, hanging = {root}, list[tuple[int, int, int]]()
        while len(hanging) < len(links):
            for k in links:
                i, j = topology.links[k]
                if (i in reached) != (j in reached):
                    parent, child = (i, j) if i in reached else (j, i)
                    hanging.append((k, parent, child))
                    reached.add(child)
        masses = tuple(sorted(members - {GROUND}))
        others = {k: links.index(link) for k, link in opposite.items() if link in links}
        group = (*links, *others), tuple(others.values()), masses, root, tuple(hanging)
        groups.append(LinkGroup(*group))
    return tuple(groups)


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
