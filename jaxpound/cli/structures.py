"""What every configuration has: buildings, what is between them, and a run."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property
from typing import Any

import jaxpound as jp
from jaxpound._errors import warn
from jaxpound.cli import buildings
from jaxpound.cli.buildings import OF_STOREYS, BuildingSection, BuildingsLayout, LinkSection
from jaxpound.cli.reading import File, Form, Range, Section, named, refused
from jaxpound.cli.tables import ContactSection, Earthquakes, Gap, RunSection, read_records
from jaxpound.model.places import link_places
from jaxpound.scenarios.random_ground import GroundDraw
from jaxpound.simulation.scheme import require_local_flow
from jaxpound.simulation.time_steps import record_grid

_ROW = Form(("building",), ("link",))
_PAIR = Form(("gap", "building_1", "building_2", "damper"), ("contact",))


class Structured(Section, dict=True):
    """Buildings in a row, or two of one storey written as a pair; and the run."""

    gap: Gap | None = None
    building_1: BuildingSection | None = None
    building_2: BuildingSection | None = None
    damper: buildings.Damper | None = None
    contact: ContactSection | None = None
    building: list[BuildingSection] | None = None
    link: list[LinkSection] | None = None
    run: RunSection = RunSection()

    def __post_init__(self) -> None:
        system = self.buildings.system()
        try:
            require_local_flow(system, self.run.scheme)
        except ValueError as error:
            rule = 'must be "event-resolved" where a link has contact or velocity_friction, '
            rule += "or floors have several links"
            raise refused("[run] friction", rule, f'"{self.run.friction}"') from error
        findings = self.buildings.doubts
        for place, number in zip(link_places(system.topology), self.layout.tables, strict=True):
            link = f"[[link]] {number} ({place}): " if self.link else ""  # a pair has one
            findings = [x.replace(f"link {place}: ", link) if number else x for x in findings]
        warn(findings)
        stated, needed = len(getattr(self, "wave", None) or ()), system.topology.n_supports + 1
        if stated != needed and (stated or needed > 1):
            rule = f"must be {needed}, one for each support that buildings and links name"
            raise refused("[wave] distances", rule, f"{stated} of them")

    @cached_property
    def layout(self) -> BuildingsLayout:
        """The buildings and what is between them; a pair is a row of two."""
        if self.require_form(_ROW, _PAIR) is _ROW:
            if not self.building:
                raise ValueError("the top level lacks a table [[building]]")
            return BuildingsLayout.of(self.building, self.link or [])
        pair: Any = self  # with all keys of a pair
        sides: list[BuildingSection] = [pair.building_1, pair.building_2]
        for number, building in enumerate(sides, 1):
            rule = "belongs in [[building]]; two buildings of one storey have none"
            building.refuse_any(OF_STOREYS, f"in [building_{number}] {rule}")
        between = {"gap": pair.gap, "contact": pair.contact, **pair.damper.stated()}
        return BuildingsLayout.of(sides, [LinkSection(1, 1, next_floor=1, **between)])

    @property
    def buildings(self) -> jp.Buildings:
        """The buildings, in SI units."""
        return self.layout.buildings


class Shaken(Structured, kw_only=True):
    """Buildings under random earthquakes."""

    earthquakes: Earthquakes

    def shaking(
        self, file: File, recorded: Iterable[jp.Record] = ()
    ) -> tuple[GroundDraw, jp.TimeGrid]:
        """Random ground motion, and a grid fine enough for it and for records."""
        table, place = self.earthquakes, f"{file.name}: [earthquakes]"
        records = read_records(f"{place} records", file.folder, table.records or [], table.units)
        with named(place):
            ground = table.motion(records)
        shapes, run = table.shapes([*records, *recorded]), self.run
        if run.duration is None and not shapes:
            raise ValueError(f"{file.name}: [run] lacks the key 'duration'")
        steps = self.buildings, run.scheme, shapes, run.duration, run.dt
        grid = record_grid(*steps, place=f"{file.name}: [run]")
        if table.arrivals:
            whole, why = run.duration or grid.duration, "the run, so that every wavelet shakes"
            table.arrivals.require(f"{place} arrivals", Range(0.0, whole, "s", why))
        return ground, grid
