"""Masses, rods and links, of which all structures are made.

Masses move along one line. A rod joins a mass to the ground or to another mass; a link, with dry
friction, a gap and a contact law, joins two neighbours, or a mass and the ground. Two adjacent
blocks, buildings of many storeys and sliding isolators are all a ``System``. A "mass" may also be
the inertia of a rotation, which rods and links join with weights: footings that rock.
"""

from __future__ import annotations

import itertools
import reprlib
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np

from jaxpound._checks import Rule, as_tuple, finite, is_traced, is_whole, number, real
from jaxpound._errors import InvalidInput, renamed
from jaxpound._fields import check, parameter, part, pytree_dataclass, static, unchecked
from jaxpound.model.column import Column
from jaxpound.model.contact import ContactLaw, Newton
from jaxpound.model.dampers import Dashpot, Inerter, PowerLaw, VelocityFriction
from jaxpound.model.ends import along, beside_axis, weighted
from jaxpound.model.hysteresis import HysteresisLaw, YieldingZener
from jaxpound.model.rod import Spring, ZenerRod
from jaxpound.model.topology import (
    GROUND,
    AnyEnds,
    Ends,
    Topology,
    WeightedMasses,
    faces,
    joined_ends,
    masses_of,
    ring,
)
from jaxpound.quantities import DIMENSIONLESS, SI


@pytree_dataclass
class Rod:
    """A rod between two masses, or between a mass and the ground. Several may have the same ends.

    Parameters
    ----------
    material
        The rod's law: a ``ZenerRod`` or ``Spring``; ``Bilinear``, ``BoucWen`` or any
        ``HysteresisLaw``, of rods that yield; ``YieldingZener``, both in one; ``PowerLaw``, a
        viscous damper on a brace; or ``Dashpot``.
    stiffness
        Long-time stiffness K > 0, before the rod yields; in units of m1 ω1² for a dimensionless
        system. A ``Dashpot`` has none or, as the damper of a link, that of a spring beside it.
    ends
        Two masses i and j by number, from 0, or ``GROUND``, or ``jp.support(k)`` that moves apart.
        The rod is stretched by x_i − x_j, and by x_i if j is the ground, by x_i less what a support
        moves relative to it; its force f pulls i back and j along. Rods of ``Storeys`` may
        leave them out, since they follow from the storey. Or any masses with their weights,
        ((mass, weight), …): the rod is stretched by Σ weight × x, and its force puts −weight × f on
        each mass. Weights are numbers that can be traced; they are then in ``weights``.
    """

    material: Any = part(
        ZenerRod, Spring, YieldingZener, PowerLaw, Dashpot, HysteresisLaw, traced=True
    )
    stiffness: Any = parameter("K", "stiffness", "stiffness", above=0, default=None)
    ends: AnyEnds | None = static(default=None)
    weights: tuple[Any, ...] = parameter("w", words="weight", each=True, default=())

    def __post_init__(self) -> None:
        if self.ends is not None:
            _set_ends(self)
        check(self)
        if self.stiffness is None and not isinstance(self.material, Dashpot):
            words = f"must be positive for {type(self.material).__name__}"
            raise InvalidInput("stiffness", "None", words)


@pytree_dataclass
class Link:
    """A link between neighbours i and j: friction, a damper, a gap, and contact where it closes.

    Parameters
    ----------
    ends
        Mass i on the left and another, j, by number from 0; one may be ``GROUND``, as of a sliding
        bearing, or ``jp.support(k)``. Its closing is s = x_i − x_j, and the current gap is ``gap``
        − s. Or any masses with weights, as those of a ``Rod``: its closing is s = Σ weight × x.
    friction
        Slip force μ ≥ 0, in units of m1 g.
    gap
        Gap ξ0 ≥ 0 at rest, in units of g/ω1²; infinite by default. A tuple (left, right) makes a
        link of two faces, such as a base between two moat walls: the right gap closes as i moves to
        the right of j, the left gap as it moves to the left. Either may be infinite.
    contact
        The law of contact, ``Newton`` or any ``ContactLaw``, for which the gap must be finite;
        None, the default, lets the neighbours pass through each other. Of two faces one law for
        both that can close, or a tuple of one for each.
    damper
        A ``Rod`` without ends between the same neighbours, such as one of a ``PowerLaw``, or a
        ``Dashpot`` with the stiffness of a spring beside it; None by default. In a ``System`` it is
        one of the rods, or two, which have the link's weights as their own.
    velocity_friction
        What the friction gains with |x_i' − x_j'|, a ``VelocityFriction``; None by default.
    inerter
        A force in proportion to x_i'' − x_j'', an ``Inerter``; None by default.
    column
        Of the links that a ``FloorLink`` at a ``Column`` becomes: the column, whose shear is a
        demand. Its weights are then those of the link, and its spring is in the law of contact.

    Notes
    -----
    In a ``System`` a link of two faces is two links with opposite ends: the first, the right face,
    has friction, damper and inerter; the second, the left face, only its gap and contact. Results
    are by face, such as ``min_gap_1`` and ``min_gap_2``; ``min_gap`` is of both.
    """

    ends: AnyEnds = static()
    friction: Any = parameter(r"\mu", "force", "friction", least=0, usual=(0, 1.5), default=0.0)
    gap: Any = parameter(
        r"\xi_0", "length", "gap at rest", least=0, finite=False, usual=(0, 3), default=np.inf
    )
    contact: ContactLaw | Newton | None = part(ContactLaw, Newton, traced=True, default=None)
    damper: Rod | None = part(Rod, default=None)
    velocity_friction: VelocityFriction | None = part(VelocityFriction, default=None)
    inerter: Inerter | None = part(Inerter, default=None)
    weights: tuple[Any, ...] = parameter("w", words="weight", each=True, default=())
    column: Column | None = part(Column, default=None, listed=bool)

    def __post_init__(self) -> None:
        _set_ends(self)
        if (self.column is None) == getattr(self.ends, "column", False):
            raise InvalidInput("column", "", "must be left to the links of FloorLink(column=…)")
        check_link(self)

    def faces(self) -> tuple[Link, ...]:
        """The link itself; of a link of two faces the right face and the left face."""
        if not isinstance(self.ends, WeightedMasses):
            return faces_of(self, ends=self.ends[::-1])
        return faces_of(self, ends=self.ends._replace(side=-1), weights=())

    def more_rules(self, prefix: str) -> list[Rule]:
        """A gap that can close is finite."""
        if self.contact is None:
            return []
        says = "finite (contact needs a finite gap)"
        return [Rule(f"{prefix}gap", self.gap, finite(self.gap), says)]


OPPOSITE: Any = {"friction": 0.0, "damper": None, "velocity_friction": None, "inerter": None}
"""What the left face of a link of two faces leaves to the right one."""


def check_link(link: Any, part: str = "") -> None:
    """Check a link, or both faces of a link of two; errors name the class and ``part``."""
    for name in ("gap", "contact"):
        if isinstance(value := getattr(link, name), tuple) and len(value) != 2:
            rule = "must be two, (left, right), of a link of two faces"
            raise InvalidInput(name, reprlib.repr(value), rule)
    if isinstance(link.contact, tuple) and not isinstance(link.gap, tuple):
        rule = "must be a tuple (left, right), as contact is"
        raise InvalidInput("gap", reprlib.repr(link.gap), rule)
    if isinstance(link.gap, tuple):
        for gap in link.gap:
            real("gap", gap)
        link.faces()  # which checks them
        return
    with renamed(part):
        check(link)


def faces_of(link: Any, **of_left: Any) -> tuple[Any, ...]:
    """A link itself; of a link of two faces the right one, and the left one with ``of_left``.

    One law of contact is that of faces that close.
    """
    if not isinstance(link.gap, tuple):
        return (link,)
    laws = link.contact
    if not isinstance(laws, tuple):
        laws = tuple(laws if is_closable(x) else None for x in link.gap)
    left, right = ({"gap": x, "contact": law} for x, law in zip(link.gap, laws, strict=True))
    return replace(link, **right), replace(link, **left, **OPPOSITE, **of_left)


@runtime_checkable
class Structures(Protocol):
    """Structures that can be simulated: a ``System``, or an object that returns one."""

    def system(self) -> System:
        """Masses, rods and links."""


def gravity_of(structures: Any) -> Any:
    """Gravity, m/s², of structures in SI units (``Buildings``); None of dimensionless ones."""
    return structures.gravity if in_si(structures) else None


def in_si(structures: Any) -> bool:
    """Whether structures, and with them all results, are in SI units (``Buildings``)."""
    return getattr(structures, "units", DIMENSIONLESS) is SI


@pytree_dataclass
class System:
    """Masses on rods, with links between them; dimensionless, at rest at t = 0.

    The equations of motion are M x'' = −Bᵀ f − Cᵀ (q + p) − M ι u'', with the rods' forces f, the
    links' friction q and contact force p, and the ground acceleration u'', of which each mass has
    its share ι; displacements x are relative to the ground. Rods are stretched by B x, and gaps of
    links close by C x. Inerters add Cᵀ b C x'' on the left.

    Raises ``ValueError`` if an end names no mass, a mass has no path of rods with a stiffness to
    the ground, a dashpot comes before the rods that tie its ends, or links with friction close a
    ring; with weights, if rods leave a motion of the masses free, or the closing of a link follows
    from those of other links.

    Parameters
    ----------
    masses
        Masses > 0, one number each, in units of m1. Any of them may be m1; usually it is the first.
    rods
        The rods. Those with a stiffness must tie every mass to the ground, directly or through
        other masses, and come before dashpots on them.
    links
        The links. Those with friction or contact by ``Newton`` may not close a ring: its forces in
        stick and at rest are not determined. A link without friction may have the opposite ends of
        one before it, whose other face it is; ``gap=(left, right)`` of a ``Link`` makes both. Their
        dampers become rods.
    tuned
        The masses that are tuned masses, by number: no floors of a building, but what stands on it.
    influence
        The share ι of the ground's motion that each mass has, known numbers; by default 1. The
        inertia of a rotation is a mass of influence 0, whose displacement is the angle.
    damping
        Damping of the masses that is no rod of its own in results: rods of a ``Dashpot``, of which
        only the sum on each mass is observed.

    Examples
    --------
    A building of two storeys beside one of one storey, with a friction damper between the roofs:

    >>> steel = jp.ZenerRod(order=0.5, tau_f=0.01, tau_x=0.05)
    >>> storeys = {(0, jp.GROUND): 1.0, (1, 0): 0.8, (2, jp.GROUND): 1.5}
    >>> rods = [jp.Rod(steel, stiffness, ends) for ends, stiffness in storeys.items()]
    >>> damper = jp.Link((1, 2), friction=0.1, gap=1.0)
    >>> system = jp.System(masses=(1.0, 1.0, 0.8), rods=rods, links=[damper])
    >>> demand = jp.demand(system, jp.paper.ground(), jp.TimeGrid.until(20.0, dt=0.05))
    >>> demand.links[0].min_gap.shape, len(demand.masses)
    ((), 3)

    A storey of height 3 on a footing that sways and rocks; masses are floor, footing and rotation:

    >>> storey = jp.Rod(steel, 1.0, ends=((0, 1.0), (1, -1.0), (2, -3.0)))
    >>> sway, rocking = jp.Rod(steel, 4.0, (1, jp.GROUND)), jp.Rod(steel, 40.0, (2, jp.GROUND))
    >>> system = jp.System((1.0, 0.5, 0.3), [storey, sway, rocking], influence=(1, 1, 0))
    >>> jp.modes(system).frequencies.round(3).tolist()
    [0.827, 3.202, 13.465]
    """

    masses: tuple[Any, ...] = parameter("m", "mass", "mass", above=0, each=True)
    rods: tuple[Rod, ...] = part(Rod, each=True)
    links: tuple[Link, ...] = part(Link, each=True, default=())
    tuned: tuple[int, ...] = static(default=(), listed=bool)
    influence: tuple[float, ...] = static(default=(), listed=bool)
    damping: tuple[Rod, ...] = part(Rod, each=True, default=(), listed=bool)
    units: ClassVar = DIMENSIONLESS
    """The unit of each kind of quantity, such as ``units["force"]``; of ``Buildings`` in SI."""

    def __post_init__(self) -> None:
        check(self)
        kept, dampers = without_dampers(itertools.chain(*(link.faces() for link in self.links)))
        object.__setattr__(self, "links", kept)
        object.__setattr__(self, "rods", self.rods + dampers)
        object.__setattr__(self, "influence", as_tuple("influence", self.influence))
        for name in ("rods", "damping"):
            for k, rod in enumerate(getattr(self, name)):
                if rod.ends is None:
                    rule = "must be two masses, or GROUND"
                    raise InvalidInput(f"{name}.{k}.ends", "None", rule)
                is_dashpot = isinstance(rod.material, Dashpot)
                if name == "damping" and not is_dashpot:
                    rule = "must be a Dashpot: rods with a stiffness belong in rods"
                    raise InvalidInput(f"damping.{k}.material", repr(rod.material), rule)
                if is_dashpot and rod.stiffness is not None:
                    rule = "must be left out for Dashpot; only as damper of a link it has one"
                    raise InvalidInput(f"{name}.{k}.stiffness", str(rod.stiffness), rule)
        topology, n = self.topology, len(self.masses)
        if not n:
            raise InvalidInput("masses", "()", "must hold at least one mass")
        for name in ("rods", "links", "damping"):
            for k, element in enumerate(getattr(self, name)):
                alone = Topology(n, (element.ends,), ())
                if name == "damping" and alone.n_supports > topology.n_supports:
                    rule = "must lead to a support that a rod or a link leads to, too"
                    raise InvalidInput(f"damping.{k}.ends", _written(element), rule)
                if max(masses_of(element.ends)) >= n:
                    rule = f"must name masses from 0 to {n - 1}, or GROUND (-1)"
                    raise InvalidInput(f"{name}.{k}.ends", _written(element), rule)
        for k, ends in enumerate(topology.links):
            if isinstance(ends, WeightedMasses) and ends.side < 0:
                before = topology.links[k - 1 : k]
                if before != (ends._replace(side=1),):
                    rule = "must be behind the right face of the same link"
                    raise InvalidInput(f"links.{k}, a left face,", "", rule)
        object.__setattr__(self, "influence", _shares(self.influence, n))
        _require_held(self)
        for k in faces(topology):
            require_face(f"links.{k}.", self.links[k])

    def system(self) -> System:
        """The system, unchanged."""
        return self

    @property
    def topology(self) -> Topology:
        """Number of masses, and the ends of rods and links."""
        rods = tuple(rod.ends for rod in self.rods if rod.ends is not None)
        return Topology(len(self.masses), rods, tuple(link.ends for link in self.links), self.tuned)

    @property
    def influences(self) -> tuple[float, ...]:
        """The share of the ground's motion that each mass has, also where all have it."""
        return self.influence or (1.0,) * len(self.masses)


def _set_ends(element: Rod | Link) -> None:
    """Set two ends, masses or ``GROUND``; or masses and, apart from them, their weights."""
    ends, weights = element.ends, element.weights
    if isinstance(ends, WeightedMasses):  # those of an element that has been made before
        return
    if weights:
        rule = "must be left out: ends ((mass, weight), …) have them; with replace, weights=()"
        raise InvalidInput("weights", reprlib.repr(weights), rule)
    if isinstance(ends, list | tuple) and all(isinstance(end, list | tuple) for end in ends):
        masses, weights = _weighted_ends(ends)
        object.__setattr__(element, "ends", WeightedMasses(masses))
        object.__setattr__(element, "weights", weights)
    else:
        object.__setattr__(element, "ends", _two_ends(ends))


def _written(element: Rod | Link) -> str:
    """The ends of an element as they are written."""
    return str(element.ends if not element.weights else weighted(element))


def _weighted_ends(value: Sequence[Any]) -> tuple[tuple[int, ...], tuple[Any, ...]]:
    """Masses and their weights of ends ((mass, weight), …)."""
    masses = [end[0] for end in value if len(end) == 2 and is_whole(end[0]) and end[0] >= 0]
    if not value or len(set(masses)) < len(value):
        rule = "must be ((mass, weight), …), of different masses by number, from 0"
        raise InvalidInput("ends", reprlib.repr(value), f"{rule}; the ground has no weight")
    return tuple(map(int, masses)), tuple(weight for _, weight in value)


def _two_ends(value: Any) -> Ends:
    """Two different ends, each the number of a mass or, but not of both, a support."""
    try:
        i, j = tuple(value) if isinstance(value, Sequence | np.ndarray) else ()
        valid = is_whole(i) and is_whole(j) and max(i, j) > GROUND
    except (TypeError, ValueError):
        valid = False
    if not valid or i == j:
        rule = "must be two different masses by number, from 0; one may be GROUND or a support"
        raise InvalidInput("ends", repr(value), f"{rule}, or ((mass, weight), …)")
    return int(i), int(j)


def _shares(influence: tuple[Any, ...], n: int) -> tuple[float, ...]:
    """The shares of the ground's motion of n masses, () where each mass has all of it."""
    if len(influence) not in (0, n):
        rule = f"must be one number for each of {n} masses"
        raise InvalidInput(f"influence of {len(influence)} numbers", "", rule)
    for mass, share in enumerate(influence):
        if is_traced(share) or not finite(number(f"influence.{mass}", share)):
            rule = "must be a finite number that is known, not traced"
            raise InvalidInput(f"influence.{mass}", str(share), rule)
    shares = tuple(map(float, influence))
    return () if set(shares) == {1.0} else shares


def _require_held(system: System) -> None:
    """An ``InvalidInput`` if rods leave a motion of the masses free, or closings are dependent.

    With weights it depends on numbers, which traced ones may not tell.
    """
    topology, n = system.topology, len(system.masses)
    holding = [rod for rod in system.rods if rod.stiffness is not None]
    if any(isinstance(rod.ends, WeightedMasses) for rod in holding):
        if (rows := _rows(holding, n)) is not None and (_rank(rows) < n).any():
            rule = "must hold all masses: in some motion of them no rod but dashpots is stretched"
            raise InvalidInput("rods", "", rule)
    else:
        group, _ = joined_ends(n, tuple(rod.ends for rod in holding if rod.ends is not None))
        for mass in range(n):
            if group[mass] != group[GROUND]:
                rule = "must be tied to the ground by rods, directly or through other masses"
                rule += "; dashpots hold no mass" * (len(holding) < len(system.rods))
                raise InvalidInput(f"masses.{mass}", "", rule)
    if (first := _untied_dashpot(system)) is not None:
        rule = "must come after the rods with a stiffness that tie its ends"
        raise InvalidInput(f"rods.{first}, a dashpot,", "", rule)
    if (closing := ring(topology, [*map(may_hold, system.links)])) is not None:
        ends, rule = topology.links[closing], RING
        if any({*ends} == {*before} for before in topology.links[:closing]):
            rule = ONE_LINK
        raise InvalidInput(f"links.{closing}.ends", str(ends), rule)
    require_independent(system)


def require_independent(system: System) -> None:
    """An ``InvalidInput`` if the closing of a link with weights follows from those before it."""
    topology, n = system.topology, len(system.masses)
    joints = [k for k in range(len(system.links)) if k not in faces(topology)]
    if any(isinstance(topology.links[k], WeightedMasses) for k in joints):
        if (rows := _rows([system.links[k] for k in joints], n)) is None:
            return
        for number, k in enumerate(joints, 1):
            if (_rank(rows[..., :number, :]) < number).any():
                rule = "must have a closing that does not follow from those of the links before it"
                raise InvalidInput(f"links.{k}.ends", _written(system.links[k]), rule)


def _untied_dashpot(system: System) -> int | None:
    """The first dashpot whose ends rods before it do not tie, so that it seems to be a storey."""
    tying: list[AnyEnds] = []
    for k, rod in enumerate(system.rods):
        if rod.ends is None or isinstance(rod.ends, WeightedMasses):
            continue
        if rod.stiffness is not None:
            tying.append(rod.ends)
        else:
            group, _ = joined_ends(len(system.masses), tuple(tying))
            if len({group[max(end, GROUND)] for end in rod.ends}) > 1:
                return k
    return None


def _rows(elements: Sequence[Rod | Link], n: int) -> np.ndarray | None:
    """The weights of n masses in the elongation of each element; None if some are traced."""
    if is_traced([element.weights for element in elements]):
        return None
    unit_motions = [*np.eye(n)]
    rows = [along(beside_axis(weighted(element)), unit_motions) for element in elements]
    return np.stack(np.broadcast_arrays(*rows), -2)


def _rank(rows: np.ndarray) -> np.ndarray:
    """The rank of rows of any size, by batch."""
    sizes = np.abs(rows).max(-1, keepdims=True)
    return np.linalg.matrix_rank(rows / np.where(sizes > 0, sizes, 1.0))


def without_dampers(links: Iterable[Any]) -> tuple[tuple[Any, ...], tuple[Rod, ...]]:
    """Links without their dampers, and these as rods."""
    kept, rods = list[Any](), list[Rod]()
    for link in links:
        if damper := link.damper:
            if damper.weights or damper.ends not in (None, link.ends):
                rule = f"must be left out, or those of the link, {link.ends}"
                raise InvalidInput("damper.ends", str(damper.ends), rule)
            ends = {"ends": link.ends, "weights": link.weights}
            rods += [unchecked(Rod, **vars(rod) | ends) for rod in in_parallel(damper)]
            link = replace(link, damper=None)
        kept.append(link)
    return tuple(kept), tuple(rods)


def in_parallel(damper: Rod) -> tuple[Rod, ...]:
    """The rods of a link's damper: of a dashpot with a stiffness a spring, and the dashpot."""
    if not isinstance(damper.material, Dashpot) or damper.stiffness is None:
        return (damper,)
    parts = {"material": Spring()}, {"stiffness": None}
    return tuple(unchecked(Rod, **vars(damper) | part) for part in parts)


def may_hold(link: Any) -> bool:
    """Whether a link may hold its ends to each other: by friction in stick, or Newton's contact."""
    # Structures are traced as they are changed, which were checked before.
    friction = not is_traced(link.friction) and bool(np.any(np.asarray(link.friction) != 0))
    holds = (*link.contact,) if isinstance(link.contact, tuple) else (link.contact,)
    rests = any(isinstance(law, Newton) for law in holds)
    return friction or rests or link.velocity_friction is not None


RING = "must not close a ring with links before it: friction in stick, and contact by Newton's law "
RING += "at rest, would not be determined; without friction, and with a law of force, it may"

ONE_LINK = "must not be those of a link before it: gap=(left, right) makes a link of two faces"


_FACE = "must be that of the link before it, whose other face this is"


def require_face(prefix: str, link: Any, rule: str = _FACE) -> None:
    """An ``InvalidInput`` for the second face of a link with friction or a damper of its own."""
    for field, none in OPPOSITE.items():
        value = getattr(link, field)
        if value is not none and not is_traced(value) and not np.all(value == none):
            raise InvalidInput(f"{prefix}{field}", reprlib.repr(value), rule)


def is_closable(gap: Any) -> bool:
    """Whether a gap is finite; a traced one counts as finite."""
    return is_traced(gap) or bool(np.isfinite(gap).all())


def common_gap(structures: Structures) -> Any:
    """The gap at rest that all links with a finite one share; None if none is, or they differ.

    Traced gaps count as equal only if they are the same object.
    """
    gaps = [link.gap for link in structures.system().links if is_closable(link.gap)]
    first, *others = gaps or [None]
    concrete = not is_traced(gaps)
    same = (gap is first or (concrete and np.array_equal(gap, first)) for gap in others)
    return first if all(same) else None


def without_contact(structures: Structures) -> Structures:
    """The structures without laws of contact, so that blocks may pass through each other.

    Whether they meet is the same with and without one; how far they close is known only without.
    """
    system = structures.system()
    if all(link.contact is None for link in system.links):
        return structures
    linked: Any = structures if hasattr(structures, "links") else system  # of the same units
    links = tuple(replace(link, contact=None) for link in linked.links)
    return unchecked(type(linked), **{**vars(linked), "links": links})
