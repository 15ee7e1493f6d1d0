"""Bearings under a building with the moat wall around them, and a tuned mass on its roof."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

import jaxpound as jp
from jaxpound.cli.reading import Section, between, named, of_field
from jaxpound.cli.tables import ContactSection, Gaps, OfClass, of_faces
from jaxpound.model.row import by_face
from jaxpound.model.shear_building import HEIGHT

_Friction = Annotated[float, of_field(jp.FrictionPendulum, "friction")]
_Yield = Annotated[float, of_field(jp.LeadRubber, "yield_displacement")]
_Ultimate = Annotated[float, of_field(jp.Bilinear, "ultimate_displacement")]


class WallSection(Section):
    """The moat wall around the base."""

    gap: Gaps
    contact: ContactSection | None = None

    def __post_init__(self) -> None:
        of_faces(self.gap)


class IsolationSection(OfClass):
    """The bearings, the base on them, and the wall around it."""

    CLASSES: ClassVar = {"friction pendulum": jp.FrictionPendulum, "lead rubber": jp.LeadRubber}
    type: Literal["friction pendulum", "lead rubber"]
    base_mass: Annotated[float, of_field(jp.Building, "mass")]
    radius: Annotated[float, of_field(jp.FrictionPendulum, "radius")] | None = None
    friction: _Friction | None = None
    fast_friction: _Friction | None = None
    rate: Annotated[float, of_field(jp.FrictionPendulum, "rate")] | None = None
    period: Annotated[float, of_field(jp.LeadRubber, "period")] | None = None
    strength: Annotated[float, of_field(jp.LeadRubber, "strength")] | None = None
    yield_displacement: _Yield | None = None
    ultimate_displacement: _Ultimate | None = None
    height: Annotated[float, between(*HEIGHT)] = 0.5
    wall: WallSection | None = None

    def under(self, building: jp.ShearBuilding, number: int) -> tuple[Any, tuple[Any, ...]]:
        """A building on the bearings, and their links to the ground, face by face."""
        options: dict[str, Any] = {"number": number, "height": self.height}
        if (wall := self.wall) is not None:
            law = wall.contact and wall.contact.model()
            options["wall"] = jp.MoatWall(of_faces(wall.gap), law)
        with named("isolation:"):
            isolated, links = jp.isolated(building, self.model(), self.base_mass, **options)
        return isolated, by_face(links)


class TunedMassSection(Section):
    """A tuned mass on a spring and a dashpot."""

    mass_ratio: Annotated[float, between(1e-4, 10, "", "of the modal mass; 0.05 is usual")]
    frequency_ratio: Annotated[float, between(0.01, 100, "", "of the first mode's")] | None = None
    damping_ratio: Annotated[float, between(1e-6, 1, "", "of the critical damping")] | None = None

    def on(self, building: jp.ShearBuilding) -> jp.ShearBuilding:
        """A building with the tuned mass on its roof."""
        with named("tuned_mass:"):
            return jp.tuned_mass_damper(building, **self.stated())
