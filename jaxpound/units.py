"""From buildings in SI units to the dimensionless system of eq. (9), and back (paper, eq. 8)."""

from __future__ import annotations

import dataclasses
import operator
from collections.abc import Callable, Sequence
from contextlib import suppress
from types import NoneType
from typing import Any, TypeVar, overload

import jax

from jaxpound._checks import enforce, instance, is_traced, not_negative, number, positive
from jaxpound._fields import Parameter, converted, parameter, pytree_dataclass, ranges, walk
from jaxpound.grid import TimeGrid
from jaxpound.ground.motion import GroundMotion, require_seconds
from jaxpound.ground.plausibility import tell
from jaxpound.ground.record import Record
from jaxpound.model.building import Building
from jaxpound.model.contact import ContactLaw, Newton
from jaxpound.model.parameters import put
from jaxpound.model.plausibility import FRICTION, GAP, doubts, too_wide
from jaxpound.model.row import (
    FloorLink,
    Naming,
    Row,
    require_buildings,
    require_floors,
    require_heights,
)
from jaxpound.model.shear_building import ShearBuilding, in_units, storeys_of
from jaxpound.model.structures import AdjacentStructures
from jaxpound.model.system import as_tuple, is_closable
from jaxpound.quantities import STANDARD_GRAVITY
from jaxpound.results.demand import Demand
from jaxpound.results.response import Response

Timed = TypeVar("Timed", bound=Any)
Law = TypeVar("Law", bound=ContactLaw | Newton | None)


@pytree_dataclass
class Scales:
    """Units of the dimensionless system (eq. 8): ω1 = √(k1/m1), m1 and gravity.

    Parameters
    ----------
    mass
        m1, kg.
    frequency
        ω1, rad/s.
    gravity
        g, m/s².

    Examples
    --------
    >>> scales = jp.Scales(mass=500e3, frequency=7.0)
    >>> round(float(scales.time), 4), round(float(scales.length), 4)  # s, m
    (0.1429, 0.2001)
    >>> scales.grid(duration=12.0, dt=0.005)
    TimeGrid(dt=0.035, n_steps=2400)
    """

    mass: Any = parameter("m_1", words="mass of building 1", above=0)
    frequency: Any = parameter(r"\omega_1", words="frequency of building 1", above=0)
    gravity: Any = parameter("g", words="gravity", above=0, default=STANDARD_GRAVITY)

    @property
    def time(self) -> Any:
        """Unit of time 1/ω1, s."""
        return 1 / self.frequency

    @property
    def length(self) -> Any:
        """Unit of length g/ω1², m."""
        return self.gravity / self.frequency**2

    @property
    def force(self) -> Any:
        """Unit of force m1 g, N."""
        return self.mass * self.gravity

    @property
    def units(self) -> dict[str, Any]:
        """The unit of each kind of quantity in SI (``quantities.SI``)."""
        return {
            "time": self.time,
            "length": self.length,
            "velocity": self.length / self.time,
            "acceleration": self.gravity,
            "force": self.force,
            "energy": self.force * self.length,
            "impulse": self.force * self.time,
            "mass": self.mass,
            "stiffness": self.force / self.length,
            "hertz stiffness": self.force / self.length**1.5,
        }

    def unit_of(self, kind: str | None) -> Any:
        """The unit of a kind of quantity; 1 for pure numbers, which have none (None)."""
        return self.units[kind] if kind else 1.0

    def grid(self, duration: float, dt: float) -> TimeGrid:
        """The dimensionless time grid for a duration and a step in seconds.

        Raises
        ------
        ValueError
            If duration or dt is not a positive number, or anything is traced: a grid is static.
        """
        if is_traced((self.frequency, duration, dt)):
            raise ValueError("Scales.grid: a grid shapes the program and cannot be traced")
        omega = float(number("Scales.grid", "frequency", self.frequency))
        positive(
            "Scales.grid",
            duration=number("Scales.grid", "duration", duration),
            dt=number("Scales.grid", "dt", dt),
        )
        return TimeGrid.until(float(duration) * omega, float(dt) * omega)

    def buildings(self, structures: AdjacentStructures) -> tuple[Building, Building, Any, Any]:
        """Dimensionless structures in SI: both buildings, slip force (N) and gap (m).

        The inverse of ``dimensionless``, for these scales; ``contact_to_si`` has the contact law.
        """
        instance("Scales.buildings", "structures", structures, AdjacentStructures)
        stiffness = self.mass * self.frequency**2
        s = structures
        rods = [
            (
                rod.order,
                rod.tau_f / self.frequency**rod.order,
                rod.tau_x / self.frequency**rod.order,
            )
            for rod in (s.rod_1, s.rod_2)
        ]
        return (
            Building(self.mass, stiffness, *rods[0]),
            Building(self.mass / s.mass_ratio, stiffness * s.stiffness_ratio, *rods[1]),
            s.friction * self.force,
            s.initial_gap * self.length,
        )

    def contact_to_dimensionless(self, law: Law) -> Law:
        """A contact law in SI units as one of the dimensionless system; None stays None.

        Raises
        ------
        ValueError
            If the law is of one's own: the dimensions of its numbers are not known. ``units`` has
            what to divide them by.
        """
        owner = "Scales.contact_to_dimensionless"
        return _in_other_units(owner, "law", law, self, operator.truediv)

    def contact_to_si(self, law: Law) -> Law:
        """The inverse of ``contact_to_dimensionless``.

        Raises
        ------
        ValueError
            If the law is of one's own.

        Examples
        --------
        >>> scales = jp.Scales(mass=500e3, frequency=7.0)
        >>> law = scales.contact_to_si(jp.KelvinVoigt(stiffness=200.0, restitution=0.65))
        >>> f"{law.stiffness:.3g} N/m", law.restitution
        ('4.9e+09 N/m', 0.65)
        """
        return _in_other_units("Scales.contact_to_si", "law", law, self, operator.mul)

    def _law_in_si(self, law: ContactLaw | None) -> ContactLaw | None:
        """None for a law of one's own, whose units are not known."""
        with suppress(ValueError):
            return self.contact_to_si(law)
        return None

    def to_dimensionless(self, record: Timed) -> Timed:
        """A ground motion in g and seconds as one in g and units of 1/ω1.

        Parameters
        ----------
        record
            A record, a pulse, a sum or scaling of them, or a random ground motion in seconds.

        Raises
        ------
        ValueError
            If it is in units of 1/ω1 already, or a part of it has no unit of time.
        """
        owner = "Scales.to_dimensionless"
        if not callable(getattr(record, "dimensionless", None)) or isinstance(record, type):
            instance(owner, "record", record, Record)
        for part in record.parts() if isinstance(record, GroundMotion) else [record]:
            require_seconds(f"{owner}: record", part)
        return record.dimensionless(self.frequency)

    @overload
    def to_si(self, result: Response) -> Response: ...

    @overload
    def to_si(self, result: Demand) -> Demand: ...

    def to_si(self, result: Response | Demand) -> Response | Demand:
        """A dimensionless ``Response`` or ``Demand`` in s, m, N and m/s² (energy in J).

        Raises
        ------
        ValueError
            If the result is in SI units already.
        """
        instance("Scales.to_si", "result", result, Response, Demand)
        if result.si:
            raise ValueError("to_si: result must be dimensionless, but is in SI units already")
        units = self.units
        known = converted(result, lambda q, x: x * units[q.kind] if q.kind else x)
        if isinstance(known, Response):
            links = tuple(
                dataclasses.replace(link, law=self._law_in_si(link.law)) for link in known.links
            )
            demand = dataclasses.replace(known.demand, si=True)
            known = dataclasses.replace(known, demand=demand, links=links)
        return dataclasses.replace(known, si=True)


def dimensionless(
    building_1: Building,
    building_2: Building,
    friction_force: Any,
    gap: Any,
    gravity: Any = STANDARD_GRAVITY,
    contact: ContactLaw | Newton | None = None,
) -> tuple[AdjacentStructures, Scales]:
    """Two buildings with a friction damper between them, in the form of eq. (9) (paper, eq. 8).

    Parameters
    ----------
    building_1, building_2
        The buildings; building 1 sets the scales. Positive displacement is towards building 2.
    friction_force
        Slip force of the damper ≥ 0, N.
    gap
        Gap between the buildings at rest ≥ 0, m.
    gravity
        g > 0, m/s².
    contact
        The law of contact between the buildings, its stiffness in N/m, or N/m^1.5 for laws after
        Hertz; None lets them pass through each other.

    Returns
    -------
    The dimensionless structures, and the scales that bring results back to SI.

    Raises
    ------
    ValueError
        If a known value breaks its rule, or is beyond what any building has: a unit is wrong.

    Warns
    -----
    PlausibilityWarning
        If masses of floors differ by more than a factor of 100, a natural period is not within 0.05
        and 10 s, a slip force is out of proportion to the weights, a gap is more than five times
        what the buildings move at an acceleration of 1 g, or a contact is so soft or hard that its
        stiffness is hardly in N/m (N/m^1.5 after Hertz). Not of traced numbers and batches.

    Examples
    --------
    >>> left = jp.Building.from_period(mass=500e3, period=0.9, damping_ratio=0.05)
    >>> right = jp.Building.from_period(mass=400e3, period=0.6, damping_ratio=0.05)
    >>> structures, scales = jp.dimensionless(left, right, friction_force=200e3, gap=0.10)
    >>> round(float(structures.mass_ratio), 4), round(float(structures.friction), 4)
    (1.25, 0.0408)
    >>> round(float(structures.initial_gap * scales.length), 6)  # back in m
    0.1
    """
    owner = "dimensionless"
    structures, scales = pair_of(
        owner, building_1, building_2, friction_force, gap, gravity, contact
    )
    tell(owner, doubts(structures, scales) + too_wide(structures, scales), strict=False)
    return structures, scales


def pair_of(
    owner: str,
    building_1: Building,
    building_2: Building,
    friction_force: Any,
    gap: Any,
    gravity: Any = STANDARD_GRAVITY,
    contact: ContactLaw | Newton | None = None,
) -> tuple[AdjacentStructures, Scales]:
    """``dimensionless`` for the function ``owner``, which itself says what is implausible."""
    instance(owner, "building_1", building_1, Building)
    instance(owner, "building_2", building_2, Building)
    friction_force, gap = not_negative(owner, friction_force=friction_force, gap=gap)
    between = [FRICTION.of("friction_force", friction_force), GAP.of("gap", gap)]
    enforce(owner, [*between, *ranges(contact, "contact.")])
    scales = Scales(building_1.mass, (building_1.stiffness / building_1.mass) ** 0.5, gravity)
    rod_1, rod_2 = (b.material(scales.frequency) for b in (building_1, building_2))
    structures = AdjacentStructures(
        rod_1=rod_1,
        rod_2=rod_2,
        mass_ratio=building_1.mass / building_2.mass,
        stiffness_ratio=building_2.stiffness / building_1.stiffness,
        friction=friction_force / scales.force,
        initial_gap=gap / scales.length,
        contact=_in_other_units(owner, "contact", contact, scales, operator.truediv),
    )
    return structures, scales


def dimensionless_row(
    buildings: Sequence[Building | ShearBuilding],
    links: Sequence[FloorLink] = (),
    gravity: Any = STANDARD_GRAVITY,
) -> tuple[Row, Scales]:
    """Buildings in a row, with links between their floors, in the form of eq. (9).

    Parameters
    ----------
    buildings
        From left to right, ``ShearBuilding`` or, of one storey, ``Building``. The first storey of
        the first one sets the scales. Positive displacement is to the right.
    links
        What is between their floors: friction in N, gap in m, contact laws in SI units.
    gravity
        g > 0, m/s².

    Returns
    -------
    The dimensionless row, and the scales that bring results back to SI.

    Raises
    ------
    ValueError
        If a known value breaks its rule, a link names a building or floor that is not there, or one
        without ``next_floor`` would join floors at different heights.

    Warns
    -----
    PlausibilityWarning
        As ``dimensionless``, of all floors and links.

    Examples
    --------
    >>> low = jp.ShearBuilding.from_period(2, 300e3, period=0.3, damping_ratio=0.05)
    >>> high = jp.ShearBuilding.from_period(4, 300e3, period=0.6, damping_ratio=0.05)
    >>> links = jp.floor_links((low, high), friction=50e3, gap=0.05)
    >>> row, scales = jp.dimensionless_row((low, high), links)
    >>> len(row.links), round(float(row.links[1].gap * scales.length), 6)  # back in m
    (2, 0.05)
    """
    owner = "dimensionless_row"
    structures, scales = row_of(owner, buildings, links, gravity)
    tell(owner, doubts(structures, scales) + too_wide(structures, scales), strict=False)
    return structures, scales


def row_of(
    owner: str,
    buildings: Sequence[Building | ShearBuilding],
    links: Sequence[FloorLink],
    gravity: Any = STANDARD_GRAVITY,
) -> tuple[Row, Scales]:
    """``dimensionless_row`` for the function ``owner``, which itself says what is implausible."""
    buildings, links = as_tuple(owner, "buildings", buildings), as_tuple(owner, "links", links)
    for i, building in enumerate(buildings):
        instance(owner, f"buildings.{i}", building, ShearBuilding, Building)
    for k, link in enumerate(links):
        instance(owner, f"links.{k}", link, FloorLink)
        gaps = [GAP.of(f"links.{k}.gap", link.gap)] if is_closable(link.gap) else []
        friction = FRICTION.of(f"links.{k}.friction", link.friction)
        enforce(owner, [friction, *gaps, *ranges(link.contact, f"links.{k}.contact.")])
    require_buildings(owner, buildings)
    floors = [len(storeys_of(building)) for building in buildings]
    require_floors(floors, links, Naming.of(owner))
    require_heights(buildings, links, Naming.of(owner))
    first = storeys_of(buildings[0])[0]
    scales = Scales(first.mass, (first.stiffness / first.mass) ** 0.5, gravity)
    of_first = first.mass, first.stiffness, scales.frequency
    return Row(
        tuple(in_units(building, *of_first) for building in buildings),
        tuple(
            dataclasses.replace(
                link,
                friction=link.friction / scales.force,
                gap=link.gap / scales.length,
                contact=_in_other_units(
                    owner, f"links.{k}.contact", link.contact, scales, operator.truediv
                ),
            )
            for k, link in enumerate(links)
        ),
    ), scales


def _in_other_units(
    owner: str, name: str, law: Law, scales: Scales, convert: Callable[[Any, Any], Any]
) -> Law:
    """A contact law with each parameter converted by the unit of its kind."""
    instance(owner, name, law, ContactLaw, Newton, NoneType)
    if law is None:
        return law
    known, units = list(walk(law, Parameter)), scales.units
    if not known or len(known) != len(jax.tree.leaves(law)):
        rule = "be a law of this package: the units of a law of one's own are not known"
        raise ValueError(f"{owner}: {name} = {law!r} must {rule}")
    return put(law, {path: convert(x, units[p.kind]) for path, p, x in known if p.kind})
