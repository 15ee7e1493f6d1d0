"""Which masses rods and links join: the static part of a system, and what follows from it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache
from itertools import chain
from typing import Any, NamedTuple

from jaxpound._checks import is_whole
from jaxpound._errors import InvalidInput

GROUND = -1
"""The ground, as an end of a rod or of a link; that of the first support if there are several."""


def support(number: int) -> int:
    """A support, as an end of a rod or of a link, by its number from 0, which is ``GROUND``.

    The ground motions of a run are then those of the supports, ``ground=(u0, u1, …)``, and
    displacements are relative to support 0. Raises ``ValueError`` unless it is a whole number ≥ 0.

    Examples
    --------
    A deck on two piers, of which the second stands on ground that moves .1 s later:

    >>> pier = jp.ZenerRod(order=1.0, tau_f=0.01, tau_x=0.03)
    >>> rods = [jp.Rod(pier, 0.5, (0, jp.GROUND)), jp.Rod(pier, 0.5, (0, jp.support(1)))]
    >>> bridge = jp.System(masses=(1.0,), rods=rods)
    >>> wave = jp.travelling(jp.paper.ground(), velocity=1.0, distances=(0.0, 0.1))
    >>> response = jp.simulate(bridge, wave, jp.TimeGrid.until(20.0, dt=0.05))
    >>> len(response.supports), round(float(abs(response.supports[1].displacement).max()), 3)
    (2, 0.279)
    """
    if not (is_whole(number) and number >= 0):
        raise InvalidInput("number", repr(number), "must be a whole number from 0 on")
    return GROUND - int(number)


Ends = tuple[int, int]


class WeightedMasses(NamedTuple):
    """Masses that a rod or a link joins with weights, which it holds itself.

    The other face of a link of two faces has the side −1: its closing is the negative one. At a
    ``column`` they are the floor that hits it, the floor above it and, if any, that below. A rod or
    link ``between`` floors of a building on soil joins the rotation of its footing, too, the last
    of the masses; the ground of such a building is the footing, the mass before the last.
    """

    masses: tuple[int, ...]
    side: int = 1
    column: bool = False
    between: Ends | None = None


AnyEnds = Ends | WeightedMasses


def stored_ends(ends: Any) -> AnyEnds:
    """Ends whose tuples may be the lists of a file."""
    first, *others = ends
    if not isinstance(first, list | tuple):
        return first, *others
    weighted = WeightedMasses(tuple(first), *others)
    return weighted._replace(between=weighted.between and tuple(weighted.between))  # type: ignore[arg-type]


def masses_of(ends: AnyEnds) -> tuple[int, ...]:
    """The masses at the ends of a rod or a link, without the ground and other supports."""
    if isinstance(ends, WeightedMasses):
        return ends.masses
    return tuple(end for end in ends if end > GROUND)


def shifted(ends: AnyEnds | None, first: int) -> AnyEnds | None:
    """Ends of masses whose numbers are larger by ``first``."""
    if isinstance(ends, WeightedMasses):
        masses, pair = tuple(first + mass for mass in ends.masses), ends.between
        return ends._replace(masses=masses, between=pair and shifted(pair, first))  # type: ignore[arg-type]
    return ends and tuple(end if end <= GROUND else first + end for end in ends)  # type: ignore[return-value]


def two_ends(ends: AnyEnds) -> Ends:
    """The two ends of a link; an ``InvalidInput`` for one of masses with weights.

    At a column they are the floor that hits it and the floor above it, the left one first.
    """
    if isinstance(ends, WeightedMasses):
        if ends.column:
            hit, above, *_ = ends.masses
            return min(hit, above), max(hit, above)
        if ends.between is not None:
            return ends.between if ends.side > 0 else ends.between[::-1]
        rule = "must be between two floors or a floor and the ground, not of masses with weights"
        raise InvalidInput("links", "", rule)
    return ends


class Topology(NamedTuple):
    """Number of masses, and the ends of rods and links: static, it shapes the compiled program."""

    n_masses: int
    rods: tuple[AnyEnds, ...]
    links: tuple[AnyEnds, ...]
    tuned: tuple[int, ...] = ()
    """Tuned masses, which stand on a building and are no floors."""

    @property
    def n_supports(self) -> int:
        """How many supports rods and links name beside the ground, which is support 0."""
        pairs = (x for x in (*self.rods, *self.links) if not isinstance(x, WeightedMasses))
        return GROUND - min(chain((GROUND,), *pairs))

    @property
    def floor_masses(self) -> list[int]:
        """All masses but tuned ones, footings and their rotations."""
        others = {*self.tuned, *on_soil(self)}
        return [mass for mass in range(self.n_masses) if mass not in others]

    @property
    def elongations(self) -> tuple[int, ...]:
        """By rod the number of its elongation among displacements, those of the masses first.

        Rods with the same ends have the same one, and those of a mass on the ground its own.
        """
        numbers: dict[Any, int] = {(mass, GROUND): mass for mass in range(self.n_masses)}
        keys = [k if isinstance(ends, WeightedMasses) else ends for k, ends in enumerate(self.rods)]
        return tuple(numbers.setdefault(key, len(numbers)) for key in keys)


def ring(topology: Topology, hold: Sequence[bool]) -> int | None:
    """The first link that closes a ring of links that ``hold``, or has the ends of one before it.

    None if none does. A link may hold its ends to each other. Links with weights are left out:
    whether they close a ring is a question of their weights.
    """
    no_faces = (k for k in range(len(topology.links)) if k not in faces(topology))
    links = [k for k in no_faces if not isinstance(topology.links[k], WeightedMasses)]
    holding, pairs = [k for k in links if hold[k]], [{*topology.links[k]} for k in links]
    _, tree = joined_ends(topology.n_masses, [topology.links[k] for k in holding])
    closing = {k for n, k in enumerate(holding) if n not in tree}
    closing |= {k for n, k in enumerate(links) if pairs[n] in pairs[:n]}
    return min(closing, default=None)


@cache
def faces(topology: Topology) -> dict[int, int]:
    """The links that are the other face of a link before them, and of which."""
    first, opposite = dict[Ends, int](), dict[int, int]()
    for k, ends in enumerate(topology.links):
        if isinstance(ends, WeightedMasses):
            if ends.side < 0:
                opposite[k] = k - 1
        elif (link := first.get(ends[::-1])) is not None and link not in opposite.values():
            opposite[k] = link
        else:
            first.setdefault(ends, k)
    return opposite


def is_storey(ends: AnyEnds) -> bool:
    """Whether a rod, or a link, is not between a mass and the ground, by whose x it stretches."""
    return isinstance(ends, WeightedMasses) or GROUND not in ends


@cache
def footings(topology: Topology) -> dict[int, int]:
    """Footings of buildings on soil, and the rotation of each."""
    weighted = [ends for ends in topology.rods if isinstance(ends, WeightedMasses)]
    return dict(x.masses[1:] for x in weighted if x.between and x.between[1] == GROUND)  # type: ignore[misc]


def on_soil(topology: Topology) -> set[int]:
    """Footings and rotations."""
    return {mass for pair in footings(topology).items() for mass in pair}


def soil_spring(topology: Topology, mass: int) -> int:
    """The spring of the soil under a footing, by its mass, or against its rotation."""
    return next(
        number
        for number, ends in enumerate(topology.rods)
        if not isinstance(ends, WeightedMasses) and mass in ends and min(ends) <= GROUND
    )


def _on_rigid_ground(topology: Topology) -> list[AnyEnds]:
    """The ends of rods as if footings were the ground."""
    soil, rods = on_soil(topology), list[AnyEnds]()
    for ends in topology.rods:
        if isinstance(ends, WeightedMasses):
            rods.append(ends.between or ends)
        else:
            rods.append((GROUND, GROUND) if {*ends} & soil else ends)
    return rods


@cache
def storey_rods(topology: Topology) -> tuple[int, ...]:
    """Rods that are storeys: not of tuned masses, nor of masses that rods before tie to ground."""
    _, tree = joined_ends(topology.n_masses, _on_rigid_ground(topology))
    return tuple(r for r in tree if not {*masses_of(topology.rods[r])} & {*topology.tuned})


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
    rods = _on_rigid_ground(topology)
    for rod in joined_ends(topology.n_masses, rods)[1]:
        if not isinstance(ends := rods[rod], WeightedMasses):
            low, high = max(min(ends), GROUND), max(ends)  # all supports are ground
            beside[low].append((high, rod))
            beside[high].append((low, rod))
    buildings = []
    for first in beside[GROUND]:
        building, below = [first], GROUND
        while len(above := [end for end in beside[building[-1][0]] if end[0] != below]) == 1:
            below = building[-1][0]
            building += above
        buildings.append(tuple(building))
    masses = sorted(mass for building in buildings for mass, _ in building)
    if masses != [mass for mass in range(topology.n_masses) if mass not in on_soil(topology)]:
        rule = "must be shear buildings, each floor on one storey"
        raise InvalidInput("structures: masses", "", rule)
    return tuple(sorted(buildings))


@cache
def rod_groups(topology: Topology) -> list[tuple[int, ...]]:
    """Groups of masses that are connected by rods: the buildings of a system."""
    members: dict[int, list[int]] = {}
    between = (x for x in topology.rods if isinstance(x, WeightedMasses) or min(x) > GROUND)
    member, _ = joined_ends(topology.n_masses, between)
    for mass, first in member.items():
        members.setdefault(first, []).append(mass)
    return [tuple(masses) for first, masses in members.items() if first != GROUND]


def joined_ends(n: int, edges: Iterable[AnyEnds]) -> tuple[dict[int, int], list[int]]:
    """The smallest member of the group of each mass, and of the ground, that edges make.

    All supports are ground. And the edges, by number, that close no ring with those before them;
    with weights, those that join groups.
    """
    group, tree = {end: end for end in range(GROUND, n)}, list[int]()
    for k, ends in enumerate(edges):
        all_ends = ends.masses if isinstance(ends, WeightedMasses) else ends
        joined = {group[max(end, GROUND)] for end in all_ends}
        if len(joined) > 1:
            low = min(joined)
            group = {end: low if member in joined else member for end, member in group.items()}
            tree.append(k)
    return group, tree
