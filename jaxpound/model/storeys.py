"""A shear building: floors, one above the other, on the rods of its storeys."""

from __future__ import annotations

from typing import Any

from jaxpound._fields import assembled, check, like, pytree_dataclass
from jaxpound.model.system import GROUND, Ends, Rod, System, as_tuple


@pytree_dataclass
class Storeys:
    """A shear building from the ground up, dimensionless: storey i is between floors i − 1 and i.

    Floors are numbered from 0, the lowest above the ground, as masses and storeys are; the ground
    itself is ``GROUND``, −1.

    Parameters
    ----------
    masses
        Mass > 0 of each floor, in units of m1.
    rods
        The rod of each storey, below the floor of the same number, its stiffness in units of
        m1 ω1²; or one rod, which every storey has. Their ``ends`` may be left out.

    Raises
    ------
    ValueError
        If a known value breaks its rule, there are not as many rods as masses, or a rod has other
        ends than those of its storey.

    Examples
    --------
    >>> steel = jp.ZenerRod(order=0.5, tau_f=0.01, tau_x=0.05)
    >>> building = jp.Storeys(masses=(1.0, 1.0, 0.8), rods=jp.Rod(steel, stiffness=5.0))
    >>> [rod.ends for rod in building.system().rods]
    [(0, -1), (1, 0), (2, 1)]
    """

    masses: tuple[Any, ...] = like(System, "masses")
    rods: tuple[Rod, ...] = like(System, "rods")

    def __post_init__(self) -> None:
        object.__setattr__(self, "masses", as_tuple("Storeys", "masses", self.masses))
        rods: Any = self.rods
        if isinstance(rods, Rod):
            rods = (rods,) * self.n_floors
        elif not isinstance(rods, tuple | list):
            kind = type(rods).__name__
            raise ValueError(f"Storeys: rods of type {kind} must be a Rod, or a tuple of them")
        object.__setattr__(self, "rods", tuple(rods))
        check(self)
        if not self.masses:
            raise ValueError("Storeys: masses = () must hold at least one floor")
        rods = self.rods
        if len(rods) != self.n_floors:
            rule = f"one for each of the {self.n_floors} masses: storey i carries floor i"
            raise ValueError(f"Storeys: rods, {len(rods)} of them, must be {rule}")
        for i, rod in enumerate(rods):
            if rod.ends not in (None, storey_ends(i)):
                rule = f"left out, or those of its storey, {storey_ends(i)}"
                raise ValueError(f"Storeys: rods.{i}.ends = {rod.ends} must be {rule}")

    @property
    def n_floors(self) -> int:
        """Number of floors, which is that of storeys."""
        return len(self.masses)

    def system(self) -> System:
        """The building alone, without links."""
        return assembled(System, masses=self.masses, rods=self.rods_from(0), links=())

    def rods_from(self, first: int) -> tuple[Rod, ...]:
        """The rods with their ends in a system where the lowest floor is the mass ``first``."""
        return tuple(
            assembled(
                Rod, material=rod.material, stiffness=rod.stiffness, ends=storey_ends(i, first)
            )
            for i, rod in enumerate(self.rods)
        )


def storey_ends(storey: int, first: int = 0) -> Ends:
    """The ends of a storey's rod: its floor and the one below it; ``first`` is the lowest floor."""
    return first + storey, first + storey - 1 if storey else GROUND
