"""Masses, rods and links: what every structure of this package is made of.

Masses move along one line. A rod joins a mass to the ground or to another mass; a link, with dry
friction, a gap and a contact law, stands between two neighbours or between a mass and the ground.
Two adjacent blocks, buildings of many storeys and sliding isolators are all a ``System``.
"""

from __future__ import annotations

import reprlib
from collections.abc import Iterable, Sequence
from functools import cache
from types import NoneType
from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
import numpy as np

from jaxpound._checks import Rule, finite, is_traced, is_whole
from jaxpound._fields import check, parameter, part, pytree_dataclass, static
from jaxpound.model.contact import ContactLaw, Newton
from jaxpound.model.rod import ZenerRod

GROUND = -1
"""The ground, as an end of a rod or of a link."""

Ends = tuple[int, int]


@pytree_dataclass
class Rod:
    """A fractional Zener rod between two masses, or between a mass and the ground.

    Parameters
    ----------
    material
        The rod's law.
    stiffness
        Long-time stiffness K > 0, in units of m1 ω1² for a dimensionless system.
    ends
        Masses i and j by number, from 0, or ``GROUND``. The rod is stretched by x_i − x_j, and by
        x_i if j is the ground; its force f pulls i back and j along. Rods of ``Storeys`` may leave
        them out, since they follow from the storey.

    Raises
    ------
    ValueError
        If a known value breaks its rule, or the ends are not two different ones.
    """

    material: ZenerRod = part(ZenerRod)
    stiffness: Any = parameter("K", words="stiffness", above=0)
    ends: Ends | None = static(default=None)

    def __post_init__(self) -> None:
        if self.ends is not None:
            object.__setattr__(self, "ends", _two_ends("Rod", self.ends))
        check(self)


@pytree_dataclass
class Link:
    """What is between neighbours i and j: dry friction, a gap, and contact where the gap closes.

    Parameters
    ----------
    ends
        Mass i, which stands left, and mass j, by number from 0; one of them may be ``GROUND``: a
        sliding bearing. Its closing is s = x_i − x_j, and the current gap is ``gap`` − s.
    friction
        Slip force μ ≥ 0, in units of m1 g.
    gap
        Gap ξ0 ≥ 0 at rest, in units of g/ω1²; infinite by default.
    contact
        The law of contact, ``Newton`` or any ``ContactLaw``, for which the gap must be finite;
        None, the default, lets the neighbours pass through each other.

    Raises
    ------
    ValueError
        If a known value breaks its rule, or the ends are not two different ones.
    """

    ends: Ends = static()
    friction: Any = parameter(r"\mu", "force", "friction", least=0, default=0.0)
    gap: Any = parameter(r"\xi_0", "length", "gap at rest", least=0, finite=False, default=np.inf)
    contact: ContactLaw | Newton | None = part(
        ContactLaw, Newton, NoneType, traced=True, default=None
    )

    def __post_init__(self) -> None:
        object.__setattr__(self, "ends", _two_ends("Link", self.ends))
        check(self)

    def more_rules(self, prefix: str) -> list[Rule]:
        """A gap that can close is finite."""
        if self.contact is None:
            return []
        says = "finite (contact needs a finite gap)"
        return [Rule(f"{prefix}gap", self.gap, finite(self.gap), says)]


class Topology(NamedTuple):
    """Number of masses, and what joins which: static, it determines the compiled program."""

    n_masses: int
    rods: tuple[Ends, ...]
    links: tuple[Ends, ...]


@runtime_checkable
class Structures(Protocol):
    """What a run takes: a ``System``, or an object that can be written as one."""

    def system(self) -> System:
        """Its masses, rods and links."""


@pytree_dataclass
class System:
    """Masses on rods, with links between them; dimensionless, at rest at t = 0.

    The equations of motion are M x'' = −B_r f − B_l (q + p) − M 1 u'', with the rods' forces f, the
    links' friction q and contact force p, and the ground acceleration u''; displacements x are
    relative to the ground.

    Parameters
    ----------
    masses
        Masses > 0, one number each, in units of m1. Any of them may be m1; usually it is the first.
    rods
        The rods. Every mass must be tied to the ground by rods, through other masses if need be.
    links
        The links. They may not close a ring: the friction forces of a ring in stick are not
        determined.

    Raises
    ------
    ValueError
        If a known value breaks its rule, an end names no mass, a mass has no path of rods to the
        ground, or links close a ring.

    Examples
    --------
    A building of two storeys beside one of one storey, with a friction damper between the roofs:

    >>> steel = jp.ZenerRod(order=0.5, tau_f=0.01, tau_x=0.05)
    >>> system = jp.System(
    ...     masses=(1.0, 1.0, 0.8),
    ...     rods=(
    ...         jp.Rod(steel, 1.0, (0, jp.GROUND)),
    ...         jp.Rod(steel, 0.8, (1, 0)),
    ...         jp.Rod(steel, 1.5, (2, jp.GROUND)),
    ...     ),
    ...     links=(jp.Link((1, 2), friction=0.1, gap=1.0),),
    ... )
    >>> found = jp.demand(system, jp.paper.ground(), jp.TimeGrid.until(20.0, dt=0.05))
    >>> found.links[0].min_gap.shape, len(found.masses)
    ((), 3)
    """

    masses: tuple[Any, ...] = parameter("m", "mass", "mass", above=0, each=True)
    rods: tuple[Rod, ...] = part(Rod, each=True)
    links: tuple[Link, ...] = part(Link, each=True, default=())

    def __post_init__(self) -> None:
        for name in ("masses", "rods", "links"):
            object.__setattr__(self, name, as_tuple("System", name, getattr(self, name)))
        check(self)
        for k, rod in enumerate(self.rods):
            if rod.ends is None:
                raise ValueError(f"System: rods.{k}.ends = None must be two masses, or GROUND")
        _check_topology(self.topology)

    def system(self) -> System:
        """Itself."""
        return self

    @property
    def topology(self) -> Topology:
        """Number of masses, and the ends of rods and links."""
        return Topology(
            len(self.masses),
            tuple(rod.ends for rod in self.rods if rod.ends is not None),
            tuple(link.ends for link in self.links),
        )


def as_tuple(owner: str, name: str, value: Any) -> tuple[Any, ...]:
    """A sequence as a tuple; a ``ValueError`` for anything else."""
    if not isinstance(value, Sequence | np.ndarray | jax.Array) or isinstance(value, str):
        raise ValueError(f"{owner}: {name} = {reprlib.repr(value)} must be a tuple")
    return tuple(value)


def _two_ends(owner: str, value: Any) -> Ends:
    """Two different ends, each a mass's number or ``GROUND``."""
    rule = "two different masses by number, from 0, of which one may be GROUND"
    try:
        i, j = value
        whole = all(is_whole(end) and end >= GROUND for end in (i, j))
    except (TypeError, ValueError):
        whole = False
    if not whole or i == j:
        raise ValueError(f"{owner}: ends = {value!r} must be {rule}")
    return int(i), int(j)


def _check_topology(topology: Topology) -> None:
    """A ``ValueError`` for a topology that cannot be simulated."""
    n = topology.n_masses
    if not n:
        raise ValueError("System: masses = () must hold at least one mass")
    for name, ends_of_all in (("rods", topology.rods), ("links", topology.links)):
        for k, ends in enumerate(ends_of_all):
            if max(ends) >= n:
                rule = f"name masses from 0 to {n - 1}, or GROUND (-1)"
                raise ValueError(f"System: {name}.{k}.ends = {ends} must {rule}")
    held = _groups(n, topology.rods)
    for mass in range(n):
        if held[mass] != held[GROUND]:
            rule = "must be tied to the ground by rods, directly or through other masses"
            raise ValueError(f"System: masses.{mass} {rule}")
    closing = ring(topology)
    if closing is not None:
        rule = "must not close a ring with the links before it"
        raise ValueError(f"System: links.{closing}.ends = {topology.links[closing]} {rule}")


def ring(topology: Topology) -> int | None:
    """The first link that closes a ring with the links before it; None if none does."""
    for k, (i, j) in enumerate(topology.links):
        joined = _groups(topology.n_masses, topology.links[:k])
        if joined[i] == joined[j]:
            return k
    return None


def is_closable(gap: Any) -> bool:
    """Whether a gap is finite; one known only when the program runs counts as such."""
    return is_traced(gap) or bool(np.isfinite(gap).all())


def is_storey(ends: Ends) -> bool:
    """Whether a rod is between two masses."""
    return GROUND not in ends


@cache
def floors(topology: Topology) -> tuple[tuple[tuple[int, int], ...], ...]:
    """The floors of each building, from the ground up: each a mass and the rod of its storey.

    Raises
    ------
    ValueError
        If the masses are no shear buildings: floors one above the other, each on one rod.
    """
    beside: dict[int, list[tuple[int, int]]] = {end: [] for end in range(GROUND, topology.n_masses)}
    for rod, (i, j) in enumerate(topology.rods):
        beside[i].append((j, rod))
        beside[j].append((i, rod))
    found = []
    for first in beside[GROUND]:
        building, seen = [first], {GROUND, first[0]}
        while len(nexts := [one for one in beside[building[-1][0]] if one[0] not in seen]) == 1:
            building += nexts
            seen.add(nexts[0][0])
        found.append(tuple(building))
    masses = sorted(mass for building in found for mass, _ in building)
    if masses != list(range(topology.n_masses)):
        raise ValueError("structures: masses must be shear buildings, each floor on one rod")
    return tuple(sorted(found))


def elongation(ends: Ends, x: Sequence[Any]) -> Any:
    """x_i − x_j between two ends, of displacements or velocities by mass; the ground's is 0."""
    i, j = ends
    if j == GROUND:
        return x[i]
    return -x[j] if i == GROUND else x[i] - x[j]


def load_on(ends_of_all: Sequence[Ends], mass: int, forces: Sequence[Any]) -> Any:
    """The load on a mass by all forces that pull their ends together, of which it has one."""
    load: Any = None
    for (i, j), force in zip(ends_of_all, forces, strict=True):
        if mass in (i, j):
            term = -force if mass == i else force
            load = term if load is None else load + term
    return load


class LinkGroup(NamedTuple):
    """Links that share masses, directly or through other links between them: a tree."""

    links: tuple[int, ...]
    masses: tuple[int, ...]
    root: int
    """The ground if a link ends there, else the left end of the first link."""
    hanging: tuple[tuple[int, int, int], ...]
    """Link, the end nearer to the root and the other end, which *hangs* on it; from the root on."""


@cache
def link_groups(topology: Topology) -> tuple[LinkGroup, ...]:
    """The groups of links, in the order of their first links."""
    between = [ends for ends in topology.links if GROUND not in ends]
    member = _groups(topology.n_masses, between)
    joined: dict[int, list[int]] = {}
    for k, ends in enumerate(topology.links):
        joined.setdefault(member[max(ends)], []).append(k)
    return tuple(_link_group(topology, tuple(links)) for links in joined.values())


def _link_group(topology: Topology, links: tuple[int, ...]) -> LinkGroup:
    ends = {k: topology.links[k] for k in links}
    everyone = {end for pair in ends.values() for end in pair}
    root = GROUND if GROUND in everyone else ends[links[0]][0]
    reached = {root}
    hanging: list[tuple[int, int, int]] = []
    while len(hanging) < len(links):
        for k, (i, j) in ends.items():
            if (i in reached) != (j in reached):
                near, far = (i, j) if i in reached else (j, i)
                hanging.append((k, near, far))
                reached.add(far)
    masses = tuple(sorted(everyone - {GROUND}))
    return LinkGroup(links, masses, root, tuple(hanging))


@cache
def rod_groups(topology: Topology) -> list[tuple[int, ...]]:
    """Groups of masses that are connected by rods: the buildings of a system."""
    between = [ends for ends in topology.rods if GROUND not in ends]
    group = _groups(topology.n_masses, between)
    first = sorted({group[mass] for mass in range(topology.n_masses)})
    return [tuple(m for m in range(topology.n_masses) if group[m] == one) for one in first]


def _groups(n: int, edges: Iterable[Ends]) -> dict[int, int]:
    """For each mass, and for the ground, the smallest member of the group that edges join it to."""
    group = {end: end for end in range(GROUND, n)}
    for i, j in edges:
        low, high = sorted((group[i], group[j]))
        group = {end: low if of == high else of for end, of in group.items()}
    return group
