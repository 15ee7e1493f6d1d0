"""A shear building: floors, one above the other, on the rods of its storeys."""

from __future__ import annotations

from typing import Any

from jaxpound._errors import InvalidInput
from jaxpound._fields import check, like, pytree_dataclass, unchecked
from jaxpound.model.system import GROUND, Ends, Rod, System, as_tuple


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
            name = f"rods of type {type(rods).__name__}"
            raise InvalidInput("Storeys", name, "", "must be a Rod, or a tuple of them")
        object.__setattr__(self, "rods", tuple(rods))
        check(self)
        if not self.masses:
            raise InvalidInput("Storeys", "masses", "()", "must hold at least one floor")
        if len(rods) != self.n_floors:
            rule = f"must be one for each of the {self.n_floors} masses: storey i carries floor i"
            raise InvalidInput("Storeys", f"rods, {len(rods)} of them,", "", rule)
        for i, rod in enumerate(rods):
            if rod.ends not in (None, storey_ends(i)):
                rule = f"must be left out, or those of its storey, {storey_ends(i)}"
                raise InvalidInput("Storeys", f"rods.{i}.ends", str(rod.ends), rule)

    @property
    def n_floors(self) -> int:
        """Number of floors and of storeys."""
        return len(self.masses)

    def system(self) -> System:
        """The building alone, without links."""
        return unchecked(System, masses=self.masses, rods=self.rods_from(0), links=())

    def rods_from(self, first: int) -> tuple[Rod, ...]:
        """The rods with their ends in a system where the lowest floor is the mass ``first``."""
        fields = [{"material": rod.material, "stiffness": rod.stiffness} for rod in self.rods]
        return tuple(unchecked(Rod, **x, ends=storey_ends(i, first)) for i, x in enumerate(fields))


def storey_ends(storey: int, first: int = 0) -> Ends:
    """The ends of a storey's rod: its floor and the one below it; ``first`` is the lowest floor."""
    return first + storey, first + storey - 1 if storey else GROUND
