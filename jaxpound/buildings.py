"""Buildings in SI units with what is between them, and their dimensionless form (paper, eq. 8)."""

from __future__ import annotations

import operator
from dataclasses import replace
from functools import partial
from itertools import chain
from typing import Any, ClassVar

from jaxpound._checks import as_tuple, enforce, is_traced, is_whole
from jaxpound._errors import InvalidInput, warn
from jaxpound._fields import check, parameter, part, pytree_dataclass, ranges, static, unchecked
from jaxpound.model.building import Building
from jaxpound.model.plausibility import FRICTION, GAP, doubts
from jaxpound.model.row import (
    FloorLink,
    LinkLabels,
    Row,
    at_elevations,
    by_face,
    known_supports,
    require_floors,
    require_heights,
)
from jaxpound.model.shear_building import ShearBuilding, in_units
from jaxpound.model.system import System, is_closable, may_hold, require_independent
from jaxpound.model.topology import GROUND, support
from jaxpound.model.vibration import Modes, modes
from jaxpound.quantities import SI, STANDARD_GRAVITY
from jaxpound.units import Scales, law_in_other_units

_LAWS = ("contact", "damper", "velocity_friction", "inerter", "column")  # of a link, all with units


@pytree_dataclass
class Buildings:
    """Buildings side by side, from left to right, with links between their floors; in SI units.

    ``simulate``, ``monte_carlo`` and all others that take structures take them: records are then in
    g and s, wavelets in m and s, functions of t in m/s², time grids in s, gaps and thresholds in m
    and N, and so are all results.

    Raises ``ValueError`` if a known value breaks its rule or is beyond what any building has, or a
    link names a building or floor that does not exist, or joins floors at different heights without
    ``next_floor``.

    Parameters
    ----------
    buildings
        ``ShearBuilding`` or, of one storey, ``Building``, from left to right. Positive displacement
        is to the right.
    links
        What is between their floors: friction in N, gap in m, contact laws in N/m (N/m^1.5 for laws
        after Hertz). ``floor_links`` makes them for every common floor.
    gravity
        g > 0, m/s²: the unit of records.
    supports
        The number of the support that each building stands on, from 0, where these move apart
        under ``ground=(u0, u1, …)`` or ``travelling``: decks and piers of a bridge. Displacements
        are relative to support 0, on which all stand by default. Links lead to supports by
        ``next_building=jp.support(k)``.

    Warns
    -----
    PlausibilityWarning
        If masses of floors differ by more than a factor of 100, a natural period is not within 0.05
        and 10 s, a slip force or a strength is out of proportion to the weights, a gap is more than
        five times what the buildings move at an acceleration of 1 g, or a contact is so soft or
        hard that its stiffness is hardly in N/m (N/m^1.5 after Hertz). Not of traced numbers and
        batches.

    Examples
    --------
    >>> left = jp.Building.from_period(mass=500e3, period=0.9, damping_ratio=0.05)
    >>> right = jp.Building.from_period(mass=400e3, period=0.6, damping_ratio=0.05)
    >>> pair = jp.Buildings((left, right), (jp.FloorLink(0, 0, friction=200e3, gap=0.10),))
    >>> demand = jp.demand(pair, jp.Ricker(0.03, 0.9, 2.0), jp.TimeGrid.until(8.0, dt=0.01))
    >>> print(f"{float(demand.min_gap):.4f} m")
    0.0233 m
    """

    buildings: tuple[Building | ShearBuilding, ...] = part(ShearBuilding, Building, each=True)
    links: tuple[FloorLink, ...] = part(FloorLink, each=True, default=())
    gravity: Any = parameter("g", "acceleration", above=0, single=True, default=STANDARD_GRAVITY)
    supports: tuple[int, ...] = static(default=(), listed=bool)
    units: ClassVar = SI

    def __post_init__(self) -> None:
        self._check()
        warn(self.doubts, strict=False)

    @classmethod
    def of(
        cls, buildings: Any, links: Any = (), gravity: Any = STANDARD_GRAVITY, supports: Any = ()
    ) -> Buildings:
        """Buildings of a function, which errors name and which itself warns."""
        self = unchecked(cls, buildings=buildings, links=links, gravity=gravity, supports=supports)
        self._check()
        return self

    def _check(self) -> None:
        object.__setattr__(self, "buildings", as_tuple("buildings", self.buildings))
        object.__setattr__(self, "links", by_face(as_tuple("links", self.links)))
        check(self)
        object.__setattr__(self, "supports", known_supports(self.supports, len(self.buildings)))
        for k, link in enumerate(self.links):
            gaps = [GAP.of(f"links.{k}.gap", link.gap)] if is_closable(link.gap) else []
            friction = FRICTION.of(f"links.{k}.friction", link.friction)
            laws = [ranges(getattr(link, x), f"links.{k}.{x}.") for x in _LAWS]
            enforce([friction, *gaps, *chain(*laws)])
        require_floors([x.n_ends for x in self.buildings], self.links, LinkLabels())
        require_heights(self.buildings, self.links, LinkLabels())
        self._require_own_support()
        on_soil = any(building.footing for building in self.buildings)
        if on_soil or any(link.column for link in self.links):
            require_independent(self.system())

    def _require_own_support(self) -> None:
        """An ``InvalidInput`` for bearings and inerters that lead to a support not theirs."""
        for k, link in enumerate(self.links if self.supports else ()):
            building = self.buildings[link.building]
            stands_on = support(self.supports[link.building])
            if building.footing is not None:  # which is its ground
                stands_on = GROUND
            is_base = link.floor == 0 and building.n_bearings > 0
            slides = may_hold(link) or link.damper is not None
            if link.other_building in (stands_on, link.building) or link.other_building >= 0:
                continue
            if (is_base and slides) or link.inerter is not None:
                number = GROUND - stands_on
                rule = f"must be support({number}), on which bearings and inerters of it stand"
                raise InvalidInput(f"links.{k}.next_building", str(link.other_building), rule)

    @property
    def doubts(self) -> list[str]:
        """What is implausible in buildings that are not traced; it was warned of."""
        return [] if is_traced(self) else doubts(self)

    @property
    def natural_frequencies(self) -> tuple[float, ...]:
        """Natural frequency of the first mode of each building, uncoupled, rad/s."""
        return self.row_in(1.0, 1.0, 1.0).natural_frequencies

    @property
    def scales(self) -> Scales:
        """The scales of the dimensionless form, which the first building's first storey sets."""
        storey = self.buildings[0].storeys[0]
        return Scales(storey.mass, (storey.stiffness / storey.mass) ** 0.5, self.gravity)

    def modes(self, building: int) -> Modes:
        """Modes of a building by number, from 0, alone, with the dampers and inerters that it has.

        These lead to another of its floors or to the ground. ``jp.modes`` has those of all
        buildings together.
        """
        n = len(self.buildings)
        if not (is_whole(building) and 0 <= building < n):
            rule = f"must be the number of one of the {n} buildings, from 0"
            raise InvalidInput("building", repr(building), rule)
        links = (
            x
            for x in self.links
            if x.building == building
            and (x.other_building <= GROUND or x.other_building == building)
        )
        devices = tuple(
            replace(
                x,
                building=0,
                next_building=min(x.other_building, 0),  # or GROUND, < 0
                damper=x.damper and replace(x.damper, ends=None),
            )
            for x in links
            if x.damper or x.inerter
        )
        alone = Row((in_units(self.buildings[building], 1.0, 1.0, 1.0),), devices)
        return replace(modes(alone), si=True)

    def system(self) -> System:
        """Masses (kg), rods (N/m, s) and links (N, m), building by building."""
        return self.row_in(1.0, 1.0, 1.0).system()

    def dimensionless(self) -> tuple[Row, Scales]:
        """The buildings in the form of eq. (9), and the ``scales`` that bring results back to SI.

        Raises ``ValueError`` if a contact law is user-defined: its numbers' units are not known.

        Examples
        --------
        >>> left, right = (jp.Building.from_period(m, 0.9, 0.05) for m in (500e3, 400e3))
        >>> pair = jp.Buildings((left, right), (jp.FloorLink(0, 0, friction=200e3, gap=0.10),))
        >>> row, scales = pair.dimensionless()
        >>> round(float(row.links[0].friction), 4)  # in units of m1 g
        0.0408
        >>> round(float(row.links[0].gap * scales.length), 6)  # back in m
        0.1
        """
        scales, links = self.scales, list[FloorLink]()
        law_in_units = partial(law_in_other_units, scales=scales, convert=operator.truediv)
        for k, link in enumerate(self._links):
            laws = {x: law_in_units(f"links.{k}.{x}", getattr(link, x)) for x in _LAWS}
            friction, gap = link.friction / scales.force, link.gap / scales.length
            links.append(replace(link, friction=friction, gap=gap, **laws))
        stiffness = self.buildings[0].storeys[0].stiffness
        row = self.row_in(scales.mass, stiffness, scales.frequency, scales.length)
        return Row(row.buildings, tuple(links), self.supports), scales

    def row_in(self, mass: Any, stiffness: Any, frequency: Any, length: Any = 1.0) -> Row:
        """The row in units of a mass, kg, stiffness, N/m, frequency, rad/s, and of rods' length, m.

        Links are in SI.
        """
        buildings = tuple(in_units(x, mass, stiffness, frequency, length) for x in self.buildings)
        return unchecked(Row, buildings=buildings, links=self._links, supports=self.supports)

    @property
    def _links(self) -> tuple[FloorLink, ...]:
        """The links, with the positions of columns."""
        return tuple(
            at_elevations(link, self.buildings, f"links.{k}: ") for k, link in enumerate(self.links)
        )
