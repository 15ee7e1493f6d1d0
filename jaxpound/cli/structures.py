"""What every configuration has: buildings, in one of two forms, what is between them, and a run."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property
from typing import Any

import jaxpound as jp
from jaxpound._errors import warn
from jaxpound.cli import buildings
from jaxpound.cli.buildings import BlockSection, BuildingsLayout
from jaxpound.cli.reading import File, Range, Section, named, refused
from jaxpound.cli.tables import ContactSection, Earthquakes, Gap, RunSection, read_records
from jaxpound.model.places import link_places
from jaxpound.model.plausibility import doubts
from jaxpound.scenarios.ground_draw import GroundDraw
from jaxpound.simulation.scheme import require_local_flow, require_stable
from jaxpound.simulation.time_steps import chosen_step, time_grid

_OF_PAIR = {
    "gap": "the key 'gap'",
    "building_1": "the table [building_1]",
    "building_2": "the table [building_2]",
    "damper": "the table [damper], whose friction_force is 0 where there is none",
}
_WRITTEN = {"gap": "gap", "building": "[[building]]", "link": "[[link]]"}


class Structured(Section, dict=True):
    """Two buildings of one storey, or a row of buildings, which become one model; and the run."""

    gap: Gap | None = None
    building_1: BlockSection | None = None
    building_2: BlockSection | None = None
    damper: buildings.Damper | None = None
    contact: ContactSection | None = None
    building: list[buildings.BuildingSection] | None = None
    link: list[buildings.LinkSection] | None = None
    run: RunSection = RunSection()

    def __post_init__(self) -> None:
        friction, rule = f'"{self.run.friction}"', 'must be "event-resolved" where'
        if self.layout.laws and self.run.friction != "event-resolved":
            where = "there is a [contact]" if self.contact else "a [[link]] has contact"
            raise refused("[run] friction", f"{rule} {where}", friction)
        try:
            require_local_flow(self.structures.system(), self.scheme)
        except ValueError as error:
            several = f"{rule} floors have several links, or velocity_friction"
            raise refused("[run] friction", several, friction) from error
        places = link_places(self.structures.system().topology)
        tables = zip(places, self.layout.tables if self.building else (), strict=False)
        names = {f"link {place}": f"[[link]] {n} ({place})" for place, n in tables if n}
        findings = (x.partition(": ") for x in doubts(self.structures, self.scales))
        warn("configuration", ["".join((names.get(x, x), *more)) for x, *more in findings])

    @cached_property
    def layout(self) -> BuildingsLayout:
        """The buildings and what is between them."""
        of_pair = [key for key in (*_OF_PAIR, "contact") if getattr(self, key) is not None]
        if of_row := [key for key in ("building", "link") if getattr(self, key) is not None]:
            if of_pair:
                first, second = (_WRITTEN.get(x, f"[{x}]") for x in (of_pair[0], of_row[0]))
                rule = "these belong to two forms of a configuration, and a file has one"
                raise refused(first, f"must not be given beside {second}: {rule}")
            if not self.building:
                raise ValueError("the top level lacks a table [[building]]")
            return BuildingsLayout.of_row(self.building, self.link or [])
        for key, words in _OF_PAIR.items():
            if getattr(self, key) is None:
                raise ValueError(f"the top level lacks {words}")
        pair: Any = self  # with all keys of a pair
        law = self.contact.model() if self.contact else None
        link = jp.FloorLink(0, 0, 0, pair.damper.friction_force, pair.gap, law)
        laws = (self.contact.law,) if self.contact else ()
        sides = pair.building_1.shear(), pair.building_2.shear()
        blocks = tuple(building.storeys[0] for building in sides)
        if any(block.hysteresis is not None for block in blocks):  # which no pair of eq. (9) has
            return BuildingsLayout.of(jp.Buildings.of("Buildings", sides, (link,)), (1,), laws)
        return BuildingsLayout.of(jp.Buildings.of("Buildings", blocks, (link,)), (), laws)

    @property
    def structures(self) -> jp.AdjacentStructures | jp.Row:
        """The dimensionless system."""
        return self.layout.structures

    @property
    def scales(self) -> jp.Scales:
        """Its units."""
        return self.layout.scales

    @property
    def scheme(self) -> jp.Scheme:
        """The discretisation."""
        return self.run.scheme(self.scales)


class Shaken(Structured, kw_only=True):
    """Buildings under random earthquakes."""

    earthquakes: Earthquakes

    def shaking(
        self, file: File, recorded: Iterable[jp.Record] = ()
    ) -> tuple[GroundDraw, jp.TimeGrid]:
        """Random ground motion, dimensionless, and a grid fine enough for it and for records."""
        table, place, scales = self.earthquakes, f"{file.name}: [earthquakes]", self.scales
        records = read_records(f"{place} records", file.folder, table.records or [], table.units)
        with named(place):
            ground = table.motion(records, scales)
        run, shapes = f"{file.name}: [run]", table.shapes([*records, *recorded])
        longest = max((float(record.duration) for record in shapes), default=None)
        if (duration := self.run.duration or longest) is None:
            raise ValueError(f"{run} lacks the key 'duration'")
        system = self.structures, scales, self.scheme
        shortest = min((float(record.dt) for record in shapes), default=float("inf"))
        dt = self.run.dt or chosen_step(*system, duration, shortest)
        require_stable(self.structures, self.scheme, dt, run, scales.time)
        grid = time_grid(run, scales, duration, dt)
        if table.arrivals:
            within = Range(0.0, duration, "s", "the run, so that every wavelet shakes")
            table.arrivals.require(f"{place} arrivals", within)
        return ground, grid
