"""Configurations of two buildings of one storey: gap, [building_1], [building_2], [damper]."""

from __future__ import annotations

import dataclasses
from functools import cached_property
from typing import Annotated

import jaxpound as jp
from jaxpound.cli.reading import Table, between, named, of_field, ranges
from jaxpound.cli.tables import Contact, Friction, Run
from jaxpound.model.building import DAMPING, PERIOD
from jaxpound.units import pair_of

BY_PERIOD = ("mass", "period", "damping_ratio")
_BY_ROD = ("mass", "stiffness", "order", "tau_f", "tau_x")
WAYS = f"{', '.join(BY_PERIOD)} (order, tau_f), or {', '.join(_BY_ROD)}"

Mass, Stiffness, Order, Relaxation = (of_field(jp.Building, key) for key in _BY_ROD[:4])
Damping = between(*DAMPING)


class Building(Table):
    """A building of one storey, by its period and damping or by its rod."""

    mass: Annotated[float, Mass] | None = None
    period: Annotated[float, between(*PERIOD)] | None = None
    damping_ratio: Annotated[float, Damping] | None = None
    stiffness: Annotated[float, Stiffness] | None = None
    order: Annotated[float, Order] | None = None
    tau_f: Annotated[float, Relaxation] | None = None
    tau_x: Annotated[float, Relaxation] | None = None

    def __post_init__(self) -> None:
        self.check()

    def check(self) -> None:
        """A ``ValueError`` if keys are missing or contradict each other, or the period is odd."""
        given = self.given()
        by_period = not given.keys().isdisjoint({"period", "damping_ratio"})
        if clashing := [key for key in ("stiffness", "tau_x") if by_period and key in given]:
            raise ValueError(f"must not have {clashing[0]} here; give {WAYS}")
        if missing := [key for key in (BY_PERIOD if by_period else _BY_ROD) if key not in given]:
            raise ValueError(f"lacks {', '.join(missing)}; give {WAYS}")
        model = self.model()
        if not by_period:
            PERIOD.require("natural period", model.natural_period)

    def given(self) -> dict[str, float]:
        """The keys of the block and its rod that are not left out."""
        return {key: x for key in ranges(Building) if (x := getattr(self, key)) is not None}

    def model(self) -> jp.Building:
        """The library's ``Building``."""
        given = self.given()
        with named("", UNITS):
            return (jp.Building.from_period if "period" in given else jp.Building)(**given)


UNITS = {key: allowed.unit for key, allowed in ranges(Building).items()}
"""Units of the numbers of a building, by key."""


class Damper(Table):
    """The friction damper between the buildings."""

    friction_force: Friction


@dataclasses.dataclass(frozen=True)
class Pair:
    """Two buildings and what is between them."""

    gap: float
    building_1: Building
    building_2: Building
    damper: Damper
    contact: Contact | None

    @property
    def structures(self) -> jp.AdjacentStructures:
        """The dimensionless system."""
        return self._dimensionless[0]

    @property
    def scales(self) -> jp.Scales:
        """Its units."""
        return self._dimensionless[1]

    @property
    def laws(self) -> list[str]:
        """Names of the laws of contact."""
        return [self.contact.law] if self.contact else []

    @cached_property
    def _dimensionless(self) -> tuple[jp.AdjacentStructures, jp.Scales]:
        law = self.contact.model() if self.contact else None
        models = self.building_1.model(), self.building_2.model()
        return pair_of("dimensionless", *models, self.damper.friction_force, self.gap, contact=law)

    def respond(self, record: jp.Record, run: Run, *, strict: bool = False) -> jp.Response:
        """The run in SI units, as ``simulate_buildings`` makes it."""
        return jp.simulate_buildings(
            self.building_1.model(),
            self.building_2.model(),
            record,
            friction_force=self.damper.friction_force,
            gap=self.gap,
            contact=self.contact.model() if self.contact else None,
            duration=run.duration,
            dt=run.dt,
            scheme=run.scheme(self.scales),
            strict=strict,
        )
