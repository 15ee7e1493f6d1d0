"""What is under a building, bearings with a moat wall and soil, and a tuned mass on its roof."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Literal

import jaxpound as jp
from jaxpound.cli.reading import Form, Section, between, named, of_field, refused
from jaxpound.cli.tables import ContactSection, Gaps, OfClass, of_faces
from jaxpound.model.foundation import FOOTING_NAMES
from jaxpound.model.isolation import RATE
from jaxpound.model.parameters import paths
from jaxpound.model.row import by_face
from jaxpound.model.shear_building import HEIGHT

_Share = between(1e-4, 10, "", "of the modal mass; 0.05 is usual")
_Ultimate = Annotated[float, of_field(jp.Bilinear, "ultimate_displacement")]

_YieldDisplacement = Annotated[float, of_field(jp.LeadRubber, "yield_displacement")]


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
    friction: Annotated[float, of_field(jp.FrictionPendulum, "friction")] | None = None
    fast_friction: Annotated[float, of_field(jp.FrictionPendulum, "friction")] | None = None
    rate: Annotated[float, between(*RATE)] | None = None
    period: Annotated[float, of_field(jp.LeadRubber, "period")] | None = None
    strength: Annotated[float, of_field(jp.LeadRubber, "strength")] | None = None
    yield_displacement: _YieldDisplacement | None = None
    ultimate_displacement: _Ultimate | None = None
    height: Annotated[float, between(*HEIGHT)] = 0.5
    wall: WallSection | None = None

    def under(
        self, building: jp.ShearBuilding, links: Sequence[jp.FloorLink], number: int
    ) -> tuple[Any, tuple[Any, ...]]:
        """A building on the bearings, and its links, also those to the ground, face by face."""
        options: dict[str, Any] = {"links": links, "number": number, "height": self.height}
        if (wall := self.wall) is not None:
            options["wall"] = jp.MoatWall(of_faces(wall.gap), wall.contact and wall.contact.model())
        with named("isolation:"):
            isolated, all_links = jp.on_bearings(building, self.model(), self.base_mass, **options)
        return isolated, by_face(all_links)


class SoilSection(Section):
    """The soil, and the footing on it: a disk or a rectangle."""

    shear_wave_velocity: Annotated[float, of_field(jp.Soil, "shear_wave_velocity")]
    density: Annotated[float, of_field(jp.Soil, "density")]
    poisson_ratio: Annotated[float, of_field(jp.Soil, "poisson_ratio")]
    footing_mass: Annotated[float, of_field(jp.model.Footing, "mass")]
    footing_inertia: Annotated[float, of_field(jp.model.Footing, "inertia")] | None = None
    radius: Annotated[float, of_field(jp.model.Footing, "radius")] | None = None
    length: Annotated[float, of_field(jp.model.Footing, "length")] | None = None
    width: Annotated[float, of_field(jp.model.Footing, "width")] | None = None
    embedment: Annotated[float, of_field(jp.model.Footing, "embedment")] | None = None

    def __post_init__(self) -> None:
        needed = *paths(jp.Soil), "footing_mass"
        rectangle = Form((*needed, "length", "width"), ("embedment", "footing_inertia"))
        self.require_form(Form((*needed, "radius"), ("footing_inertia",)), rectangle)

    def under(self, building: jp.ShearBuilding) -> jp.ShearBuilding:
        """A building on this soil."""
        footing = self.stated()
        with named("soil:"):
            soil = jp.Soil(*(footing.pop(key) for key in paths(jp.Soil)))
            return jp.on_soil(building, soil, **footing)


def soil_keys(footing: jp.model.Footing | None) -> dict[str, str]:
    """The paths of a footing's numbers by the keys of a file; none on rigid ground."""
    keys = {path: path.removeprefix("soil.") for path in paths(footing)}
    return {FOOTING_NAMES.get(key, key): path for path, key in keys.items()}


def device_of(link: jp.FloorLink) -> str:
    """The table of a [[building]] that a link comes from."""
    return "tuned_mass" if link.inerter else "isolation"


class TunedMassSection(Section):
    """A tuned mass on a spring and a dashpot, and an inerter from it to a floor below."""

    mass_ratio: Annotated[float, _Share] | None = None
    inertance_ratio: Annotated[float, _Share] | None = None
    floor: Annotated[int, between(1, 1000)] | None = None
    frequency_ratio: Annotated[float, between(0.01, 100, "", "of the first mode's")] | None = None
    damping_ratio: Annotated[float, between(1e-6, 1, "", "of the critical damping")] | None = None

    def __post_init__(self) -> None:
        of_inerter = Form(("inertance_ratio",), ("mass_ratio", "floor"))
        self.require_form(Form(("mass_ratio",)), of_inerter)

    def on(
        self, building: jp.ShearBuilding, number: int
    ) -> tuple[jp.ShearBuilding, tuple[jp.FloorLink, ...]]:
        """A building with the tuned mass on its roof, and its inerter."""
        options: dict[str, Any] = self.stated()
        with named("tuned_mass:"):
            if self.inertance_ratio is None:
                return jp.tuned_mass_damper(building, **options), ()
            if self.floor is not None:
                if self.floor >= building.n_floors:
                    rule = f"must be below the roof, from 1 to {building.n_floors - 1}"
                    if building.n_floors == 1:
                        rule = "must not be given for one storey"
                    raise refused("floor", rule, str(self.floor))
                options["floor"] = self.floor - 1
            return jp.tuned_inerter_damper(building, number=number, **options)
