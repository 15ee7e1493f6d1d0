"""Configurations of buildings in a row: [[building]] and [[link]], counted from 1."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import Annotated, Any, Literal

from msgspec import Meta
from msgspec.structs import asdict

import jaxpound as jp
from jaxpound.cli.pair import (
    BY_PERIOD,
    UNITS,
    WAYS,
    Building,
    Damping,
    Mass,
    Order,
    Relaxation,
    Stiffness,
)
from jaxpound.cli.reading import Table, between, each, named, says
from jaxpound.cli.tables import Contact, Friction, Gap, Run
from jaxpound.model.building import PERIOD
from jaxpound.model.row import Naming, common_floors, require_floors, require_heights
from jaxpound.model.shear_building import HEIGHT, TAPER
from jaxpound.units import row_of

_MOST = 1000  # buildings or floors: more are a typing error
_Number = Annotated[int, between(1, _MOST)]
_Mass = Annotated[float, Mass]
_Stiffness = Annotated[float, Stiffness]
_Order = Annotated[float, Order]
_Relaxation = Annotated[float, Relaxation]
_Height = Annotated[float, between(*HEIGHT)]

_UNIFORM = ("number", *BY_PERIOD)
_LISTED = ("masses", "stiffnesses", "order", "tau_f", "tau_x")
_ONE_RULE = (*_UNIFORM, "order", "tau_f", "taper", "height")
_STOREYS = (
    f"{', '.join(_UNIFORM)} (order, tau_f, taper, height), or, from the ground up, "
    f"{', '.join(_LISTED)} (heights)"
)


class Storeys(Table):
    """The storeys of a building: by its period and damping, or each by its mass and rod."""

    number: _Number | None = None
    mass: _Mass | None = None
    period: Annotated[float, between(*PERIOD)] | None = None
    damping_ratio: Annotated[float, Damping] | None = None
    taper: Annotated[float, between(*TAPER)] | None = None
    height: _Height | None = None

    masses: Annotated[list[_Mass], each(_Mass, alone=False)] | None = None
    stiffnesses: Annotated[_Stiffness | list[_Stiffness], each(_Stiffness)] | None = None
    order: Annotated[_Order | list[_Order], each(_Order)] | None = None
    tau_f: Annotated[_Relaxation | list[_Relaxation], each(_Relaxation)] | None = None
    tau_x: Annotated[_Relaxation | list[_Relaxation], each(_Relaxation)] | None = None
    heights: Annotated[_Height | list[_Height], each(_Height)] | None = None

    def __post_init__(self) -> None:
        given = self._given()
        uniform = not given.keys().isdisjoint({*_ONE_RULE} - {*_LISTED})
        allowed = _ONE_RULE if uniform else (*_LISTED, "heights")
        for key, value in given.items():
            if key not in allowed or (uniform and isinstance(value, list)):
                what = f"a list of {key}" if key in allowed else key
                raise ValueError(f"must not have {what} here; give {_STOREYS}")
        if missing := [key for key in (_UNIFORM if uniform else _LISTED) if key not in given]:
            raise ValueError(f"lacks {', '.join(missing)}; give {_STOREYS}")
        self.model()

    def _given(self) -> dict[str, Any]:
        return {key: x for key, x in asdict(self).items() if x is not None}

    def model(self) -> jp.ShearBuilding:
        """The library's ``ShearBuilding``."""
        given = self._given()
        try:
            with named("", UNITS):
                if "masses" in given:
                    return jp.ShearBuilding.of_storeys(**given)
                n, mass = given.pop("number"), given.pop("mass")
                return jp.ShearBuilding.from_period(n, mass, **given)
        except ValueError as error:
            raise ValueError(re.sub(r"^storeys\.(\d+):", _storey, str(error))) from error


def _storey(found: re.Match[str]) -> str:
    return f"storey {int(found[1]) + 1}:"


class RowBuilding(Building):
    """A building of a row: its storeys, one of the literature, or a block on a rod."""

    height: _Height | None = None
    storeys: Storeys | None = None
    published: str | None = None

    def check(self) -> None:
        """As ``Building.check``; and a ``ValueError`` for a building given in two ways."""
        given = [key for key, x in asdict(self).items() if x is not None]
        ways = [key for key in ("storeys", "published") if key in given]
        if not given:
            raise ValueError(f"lacks its storeys; give storeys, published, or {WAYS}")
        if ways and (others := [key for key in given if key != ways[0]]):
            raise ValueError(f"must not have {others[0]} beside {ways[0]}")
        if not ways:
            super().check()
        PERIOD.require("natural period", self.shear().natural_period)

    def shear(self) -> jp.ShearBuilding:
        """The library's ``ShearBuilding``."""
        if self.storeys is not None:
            return self.storeys.model()
        if self.published is not None:
            with named("published:"):
                return jp.ShearBuilding.published(self.published)
        storeys = (self.model(),)
        if self.height is None:
            return jp.ShearBuilding(storeys)
        return jp.ShearBuilding(storeys, (self.height,))


class FloorLink(Table):
    """What is between two floors, or between several floors of neighbouring buildings."""

    building: _Number | None = None
    floor: _Number | None = None
    floors: (
        Annotated[
            Literal["common"] | Annotated[list[_Number], Meta(min_length=1)],
            says('"common" or a list of floors, counted from 1'),
        ]
        | None
    ) = None
    next_building: (
        Annotated[_Number | Literal["ground"], says('the number of a building, or "ground"')] | None
    ) = None
    next_floor: _Number | None = None
    friction_force: Friction | None = None
    gap: Gap | None = None
    contact: Contact | None = None

    def __post_init__(self) -> None:
        if (self.floor is None) == (self.floors is None):
            raise ValueError("must have floor or floors, one of them")
        if self.floors != "common" and self.building is None:
            raise ValueError("lacks the key 'building'")
        if self.next_floor is not None:
            for key, wrong in (("floors", self.floors), ("ground", self.next_building == "ground")):
                if wrong:
                    raise ValueError(f"next_floor must not be given with {key}")
        if self.floors == "common" and self.next_building is not None:
            rule = 'must not be given with floors = "common": it is the one to the right'
            raise ValueError(f"next_building {rule}")
        if self.contact is not None and self.gap is None:
            raise ValueError("lacks the key 'gap', which contact needs")
        if self.gap is None and self.friction_force is None:
            raise ValueError("must have friction_force or gap, at least one of them")

    def links(self, buildings: Sequence[jp.ShearBuilding]) -> list[jp.FloorLink]:
        """The library's ``FloorLink``, of each floor."""
        floors: Iterable[tuple[int, int, int | None, int | None]]
        if self.floors == "common":
            if len(buildings) < 2:
                raise ValueError('floors = "common" must be between two buildings or more')
            lefts = range(len(buildings) - 1) if self.building is None else [self.building - 1]
            floors = [(i, *pair, None) for i in lefts for pair in _common(buildings, i)]
        else:
            assert self.building is not None
            here, over = self.building - 1, None if self.next_floor is None else self.next_floor - 1
            numbers = [self.floor] if self.floors is None else self.floors
            floors = [(here, i - 1, over, self._other()) for i in numbers if i is not None]
        gap = float("inf") if self.gap is None else self.gap
        law = self.contact.model() if self.contact else None
        friction = self.friction_force or 0.0
        return [
            jp.FloorLink(building, floor, next_floor, friction, gap, law, other)
            for building, floor, next_floor, other in floors
        ]

    def _other(self) -> int | None:
        """The building at the other end, as ``FloorLink`` numbers it."""
        if self.next_building == "ground":
            return jp.GROUND
        return None if self.next_building is None else self.next_building - 1


def _common(buildings: Sequence[jp.ShearBuilding], left: int) -> list[tuple[int, int]]:
    """The common floors of a building and the next one."""
    if left >= len(buildings) - 1:
        rule = f"from 1 to {len(buildings) - 1}, with another building to the right"
        raise ValueError(f"building = {left + 1} must be {rule}")
    if not (found := common_floors(*buildings[left : left + 2])):
        which = f"buildings {left + 1} and {left + 2}"
        raise ValueError(f'floors = "common": {which} must have floors at the same height')
    return found


@dataclasses.dataclass(frozen=True)
class Row:
    """Buildings in a row, and the links between their floors."""

    buildings: tuple[jp.ShearBuilding, ...]
    links: tuple[jp.FloorLink, ...]
    tables: tuple[int, ...]
    """The number of the [[link]] that each link is of."""
    laws: list[str]
    """Names of the laws of contact."""

    @classmethod
    def of(cls, buildings: Sequence[RowBuilding], links: Sequence[FloorLink]) -> Row:
        """The row that the tables state; a ``ValueError`` for a link that cannot be."""
        models = tuple(building.shear() for building in buildings)
        made: list[tuple[int, jp.FloorLink]] = []
        for number, link in enumerate(links, 1):
            try:
                made += [(number, one) for one in link.links(models)]
            except ValueError as error:
                raise ValueError(f"[[link]] {number} {error}") from error
        tables, all_links = tuple(x for x, _ in made), tuple(link for _, link in made)
        naming = Naming(lambda k: f"[[link]] {tables[k]}", first=1)
        require_floors([building.n_floors for building in models], all_links, naming)
        require_heights(models, all_links, naming)
        return cls(models, all_links, tables, [link.contact.law for link in links if link.contact])

    @property
    def structures(self) -> jp.Row:
        """The dimensionless row."""
        return self._dimensionless[0]

    @property
    def scales(self) -> jp.Scales:
        """Its units."""
        return self._dimensionless[1]

    @cached_property
    def _dimensionless(self) -> tuple[jp.Row, jp.Scales]:
        return row_of("dimensionless_row", self.buildings, self.links)

    def respond(self, record: jp.Record, run: Run, *, strict: bool = False) -> jp.Response:
        """The run in SI units, as ``simulate_row`` makes it."""
        return jp.simulate_row(
            self.buildings,
            self.links,
            record,
            duration=run.duration,
            dt=run.dt,
            scheme=run.scheme(self.scales),
            strict=strict,
        )
