"""What every configuration has: buildings, in one of two forms, what is between them, and a run."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import jaxpound as jp
from jaxpound.cli.noise import Shaking
from jaxpound.cli.pair import Building, Damper, Pair
from jaxpound.cli.reading import File, Range, Table, named
from jaxpound.cli.row import FloorLink, Row, RowBuilding
from jaxpound.cli.tables import Contact, Gap, Run, read_records
from jaxpound.ground.plausibility import tell
from jaxpound.model.plausibility import doubts, too_wide
from jaxpound.simulation.buildings import natural_periods, require_stable, time_grid, time_step
from jaxpound.simulation.scheme import require_followed
from jaxpound.study.ground_draw import GroundDraw

_OF_PAIR = {
    "gap": "the key 'gap'",
    "building_1": "the table [building_1]",
    "building_2": "the table [building_2]",
    "damper": "the table [damper], whose friction_force is 0 where there is none",
}
_WRITTEN = {"gap": "gap", "building": "[[building]]", "link": "[[link]]"}


class Structured(Table, dict=True):
    """Two buildings of one storey, or a row of buildings; and the run.

    Both forms become one model: the dimensionless ``structures`` and their ``scales``.
    """

    gap: Gap | None = None
    building_1: Building | None = None
    building_2: Building | None = None
    damper: Damper | None = None
    contact: Contact | None = None
    building: list[RowBuilding] | None = None
    link: list[FloorLink] | None = None
    run: Run = Run()

    def __post_init__(self) -> None:
        friction = self.run.friction
        if self.form.laws and friction != "event-resolved":
            where = "there is a [contact]" if self.contact else "a [[link]] has contact"
            rule = f'must be "event-resolved" where {where}'
            raise ValueError(f'[run] friction = "{friction}" {rule}')
        try:
            require_followed(self.structures.system(), self.scheme)
        except ValueError as error:
            rule = 'must be "event-resolved" where floors have several links'
            raise ValueError(f'[run] friction = "{friction}" {rule}') from error
        tell("configuration", self.doubts(), strict=False)

    def doubts(self) -> list[str]:
        """What is implausible in buildings, dampers and contact."""
        return doubts(self.structures, self.scales)

    @cached_property
    def form(self) -> Pair | Row:
        """The buildings and what is between them."""
        of_pair = [key for key in (*_OF_PAIR, "contact") if getattr(self, key) is not None]
        of_row = [key for key in ("building", "link") if getattr(self, key) is not None]
        if of_row:
            if of_pair:
                both = [_WRITTEN.get(key, f"[{key}]") for key in (of_pair[0], of_row[0])]
                rule = "these belong to two forms of a configuration, and a file has one"
                raise ValueError(f"{both[0]} must not be given beside {both[1]}: {rule}")
            if not self.building:
                raise ValueError("the top level lacks a table [[building]]")
            return Row.of(self.building, self.link or [])
        for key, words in _OF_PAIR.items():
            if getattr(self, key) is None:
                raise ValueError(f"the top level lacks {words}")
        assert self.gap is not None
        assert self.building_1
        assert self.building_2
        assert self.damper
        return Pair(self.gap, self.building_1, self.building_2, self.damper, self.contact)

    @property
    def structures(self) -> jp.AdjacentStructures | jp.Row:
        """The dimensionless system."""
        return self.form.structures

    @property
    def scales(self) -> jp.Scales:
        """Its units."""
        return self.form.scales

    @property
    def scheme(self) -> jp.Scheme:
        """The discretisation."""
        return self.run.scheme(self.scales)


class Shaken(Structured, kw_only=True):
    """Buildings under random earthquakes."""

    earthquakes: Shaking

    def doubts(self) -> list[str]:
        """And in gaps, which no run of the buildings judges by what they move."""
        return super().doubts() + too_wide(self.structures, self.scales)

    def records(self, file: File) -> list[jp.Record]:
        """The records from which earthquakes are drawn; none if these are sums of wavelets."""
        table = self.earthquakes
        place = f"{file.name}: [earthquakes] records"
        return read_records(place, file, table.records or [], table.units)

    def motion(self, file: File, records: Sequence[jp.Record]) -> GroundDraw:
        """The random ground motion of the dimensionless system."""
        with named(f"{file.name}: [earthquakes]"):
            return self.earthquakes.motion(records, self.scales)

    def grid(self, file: File, records: Sequence[jp.Record]) -> jp.TimeGrid:
        """The dimensionless time grid, fine and long enough for records."""
        place, scales = f"{file.name}: [run]", self.scales
        records = self.earthquakes.shapes(records)
        limit = jp.stability_limit(self.structures, self.scheme) * float(scales.time)
        shortest = min((float(record.dt) for record in records), default=float("inf"))
        periods = natural_periods(self.structures, scales)
        dt = self.run.dt or time_step(periods, limit, shortest)
        require_stable(place, dt, limit, "the nominal buildings")
        longest = max((float(record.duration) for record in records), default=None)
        duration = self.run.duration or longest
        if duration is None:
            raise ValueError(f"{place} lacks the key 'duration'")
        grid = time_grid(place, scales, duration, dt)
        if self.earthquakes.arrivals:
            within = Range(0.0, duration, "s", "the run, so that every wavelet shakes")
            self.earthquakes.arrivals.require(f"{file.name}: [earthquakes] arrivals", within)
        return grid
