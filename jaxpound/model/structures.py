"""Two blocks with a friction link, the system of eq. (9); and floors on rods, a shear building."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any, ClassVar

import jax

from jaxpound._checks import as_tuple, is_whole
from jaxpound._errors import InvalidInput
from jaxpound._fields import check, like, parameter, part, pytree_dataclass, static, unchecked
from jaxpound.model.contact import ContactLaw, Newton
from jaxpound.model.dampers import Dashpot
from jaxpound.model.rod import ZenerRod
from jaxpound.model.system import Link, Rod, System
from jaxpound.model.topology import GROUND, Ends, WeightedMasses, shifted
from jaxpound.quantities import DIMENSIONLESS


@pytree_dataclass
class AdjacentStructures:
    """Two adjacent structures joined by a friction damper, dimensionless (paper, eq. 9).

    Parameters
    ----------
    rod_1, rod_2
        The rods; rod 1 has stiffness 1, rod 2 has stiffness ``stiffness_ratio``.
    mass_ratio
        ρ = m1 / m2 > 0.
    stiffness_ratio
        ε = k2 / k1 > 0.
    friction
        μ ≥ 0, the damper's slip force in units of m1 g.
    initial_gap
        ξ0 ≥ 0, the gap at rest in units of g/ω1².
    contact
        The law of contact when the gap closes, ``Newton`` or any ``ContactLaw``; None, the default,
        lets the structures pass through each other.

    Examples
    --------
    >>> rod_1 = jp.ZenerRod(order=0.23, tau_f=0.004, tau_x=1.183)
    >>> rod_2 = jp.ZenerRod(order=0.53, tau_f=0.2, tau_x=4.0)
    >>> structures = jp.AdjacentStructures(
    ...     rod_1, rod_2, mass_ratio=1.0, stiffness_ratio=2.0, friction=0.25, initial_gap=1.0
    ... )
    >>> [round(float(omega), 3) for omega in structures.natural_frequencies]
    [1.484, 3.341]
    """

    rod_1: ZenerRod = part(ZenerRod)
    rod_2: ZenerRod = part(ZenerRod)
    mass_ratio: Any = parameter(r"\rho", above=0, usual=(0.2, 5.0))
    stiffness_ratio: Any = parameter(r"\varepsilon", above=0, usual=(0.2, 8.0))
    friction: Any = like(Link, "friction")
    initial_gap: Any = parameter(r"\xi_0", "length", "gap at rest", least=0, usual=(0.0, 3.0))
    contact: ContactLaw | Newton | None = like(Link, "contact", default=None)
    units: ClassVar = DIMENSIONLESS

    def system(self) -> System:
        """Masses 1 and 1/ρ on rods of stiffness 1 and ε, and the link between them."""
        rods = (
            unchecked(Rod, material=self.rod_1, stiffness=1.0, ends=(0, GROUND)),
            unchecked(Rod, material=self.rod_2, stiffness=self.stiffness_ratio, ends=(1, GROUND)),
        )
        between = {"friction": self.friction, "gap": self.initial_gap, "contact": self.contact}
        link = unchecked(Link, ends=(0, 1), **between)
        return unchecked(System, masses=(1.0, 1 / self.mass_ratio), rods=rods, links=(link,))

    @property
    def natural_frequencies(self) -> tuple[jax.Array, jax.Array]:
        """Natural frequencies of the two uncoupled structures, in units of ω1 = √(k1/m1)."""
        second = self.rod_2.natural_frequency(self.stiffness_ratio, 1 / self.mass_ratio)
        return self.rod_1.natural_frequency(), second

    @property
    def damping_ratios(self) -> tuple[jax.Array, jax.Array]:
        """Equivalent viscous damping ratios of the two uncoupled structures."""
        second = self.rod_2.damping_ratio(self.stiffness_ratio, 1 / self.mass_ratio)
        return self.rod_1.damping_ratio(), second


@pytree_dataclass
class Storeys:
    """A shear building from the ground up, dimensionless: storey i is between floors i − 1 and i.

    Floors, masses and storeys are numbered from 0, the lowest; the ground is ``GROUND``, −1.

    Raises ``ValueError`` if there are not as many rods as masses, or the ends of a rod are not
    those of its storey.

    Parameters
    ----------
    masses
        Mass > 0 of each floor, in units of m1.
    rods
        The rod of each storey, below the floor of the same number, its stiffness in units of
        m1 ω1²; or one rod for all. Their ``ends`` may be left out.
    n_tuned
        How many of the last are tuned masses, which are no floors, on their rods; none by default.
    damping
        Dashpots of the building, as in ``System``; their ends are floors of the building.
    heights
        Height of each storey of a building on soil, where floors, storeys and tuned masses have two
        more masses and rods behind them: the footing on the spring of sway, and the inertia of its
        rotation on that of rocking, with the displacement of a lever of length 1. None by default.

    Examples
    --------
    >>> steel = jp.ZenerRod(order=0.5, tau_f=0.01, tau_x=0.05)
    >>> building = jp.Storeys(masses=(1.0, 1.0, 0.8), rods=jp.Rod(steel, stiffness=5.0))
    >>> [rod.ends for rod in building.system().rods]
    [(0, -1), (1, 0), (2, 1)]
    """

    masses: tuple[Any, ...] = like(System, "masses")
    rods: tuple[Rod, ...] = like(System, "rods")
    n_tuned: int = static(default=0, listed=bool)
    damping: tuple[Rod, ...] = like(System, "damping", default=())
    heights: tuple[float, ...] = static(default=(), listed=bool)

    def __post_init__(self) -> None:
        object.__setattr__(self, "masses", as_tuple("masses", self.masses))
        rods: Any = self.rods
        if isinstance(rods, Rod):
            rods = (rods,) * len(self.masses)
        elif not isinstance(rods, tuple | list):
            name = f"rods of type {type(rods).__name__}"
            raise InvalidInput(name, "", "must be a Rod, or a tuple of them")
        object.__setattr__(self, "rods", tuple(rods))
        check(self)
        if self.heights and len(self.heights) != len(self.masses) - 2:
            rule = f"must be {len(self.masses) - 2}, one for each mass but footing and rotation"
            raise InvalidInput(f"heights, {len(self.heights)} of them,", "", rule)
        require_storeys("masses", self.masses[: self.n_storeys], self.n_tuned)
        if len(rods) != (n := len(self.masses)):
            rule = f"must be one for each of the {n} masses: storey i carries floor i"
            raise InvalidInput(f"rods, {len(rods)} of them,", "", rule)
        for i, rod in enumerate(rods):
            ends = self.rod_between(i)["ends"]
            if rod.ends not in (None, ends):
                rule = f"must be left out, or those of its storey, {ends}"
                raise InvalidInput(f"rods.{i}.ends", str(rod.ends), rule)
            if isinstance(rod.material, Dashpot):
                rule = "must have a stiffness, as it is a storey: a dashpot holds no floor"
                raise InvalidInput(f"rods.{i}", "", rule)
        if self.damping:
            rods, shares = self.rods_from(0), self.influences  # which are checked
            System(self.masses, rods, influence=shares, damping=self.damping)

    @property
    def n_storeys(self) -> int:
        """Number of storeys, with those of tuned masses."""
        return len(self.masses) - (2 if self.heights else 0)

    @property
    def n_floors(self) -> int:
        """Number of floors and of storeys."""
        return self.n_storeys - self.n_tuned

    @property
    def n_ends(self) -> int:
        """Number of masses that a link may join: all but a rotation."""
        return self.n_storeys + bool(self.heights)

    @property
    def influences(self) -> tuple[float, ...]:
        """The share of the ground's motion that each mass has."""
        return (1.0,) * self.n_ends + (0.0,) * (len(self.masses) - self.n_ends)

    def system(self) -> System:
        """The building alone, without links."""
        tuned = tuple(range(self.n_floors, self.n_storeys))
        parts: dict[str, Any] = {"rods": self.rods_from(0), "links": (), "damping": self.damping}
        if self.heights:
            parts["influence"] = self.influences
        return unchecked(System, masses=self.masses, tuned=tuned, **parts)

    def rods_from(self, first: int) -> tuple[Rod, ...]:
        """The rods with their ends in a system where the lowest floor is the mass ``first``."""
        fields = [{"material": rod.material, "stiffness": rod.stiffness} for rod in self.rods]
        ends = [self.rod_between(i, first) for i in range(len(fields))]
        return tuple(unchecked(Rod, **(x | y)) for x, y in zip(fields, ends, strict=True))

    def rod_between(self, i: int, first: int = 0) -> dict[str, Any]:
        """Ends and weights of rod i in a system where the lowest floor is the mass ``first``."""
        ends = storey_ends(i) if i < self.n_storeys else (i, GROUND)  # sway and rocking
        return self.between(*ends, first)

    def between(self, i: int, j: int, first: int = 0) -> dict[str, Any]:
        """Ends and weights of what joins floors i and j, or the ground, of the building.

        On soil it is the relative displacement less that of a rigid rotation; the ground of floors
        is then the footing, whose number is that behind the last floor.
        """
        footing = self.n_storeys
        a, b = (x if x == GROUND else first + x for x in (i, j))
        if not self.heights or (GROUND in (i, j) and max(i, j) >= footing):
            return {"ends": (a, b)}
        up = dict(enumerate(itertools.accumulate(self.heights)))  # 0 of footing and ground
        masses = *(first + (footing if x == GROUND else x) for x in (i, j)), first + footing + 1
        weights = 1.0, -1.0, up.get(j, 0.0) - up.get(i, 0.0)
        return {"ends": WeightedMasses(masses, between=(a, b)), "weights": weights}

    def damping_from(self, first: int) -> tuple[Rod, ...]:
        """The dashpots in a system where the lowest floor is the mass ``first``."""
        numbers = [vars(rod) | {"ends": shifted(rod.ends, first)} for rod in self.damping]
        return tuple(unchecked(Rod, **x) for x in numbers)


def require_storeys(name: str, storeys: Sequence[Any], n_tuned: Any) -> None:
    """An ``InvalidInput`` without storeys, by name, or without a floor below the tuned masses."""
    if not (n := len(storeys)):
        raise InvalidInput(name, "()", "must hold at least one storey")
    if not (is_whole(n_tuned) and 0 <= n_tuned < n):
        rule = f"must be a whole number from 0 to {n - 1}: the last of {n} masses are tuned masses"
        raise InvalidInput("n_tuned", repr(n_tuned), rule)


def storey_ends(storey: int, first: int = 0) -> Ends:
    """The ends of a storey's rod: its floor and the one below it; ``first`` is the lowest floor."""
    return first + storey, first + storey - 1 if storey else GROUND
