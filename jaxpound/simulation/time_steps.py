"""The choice of a time step, and the grid of a run that a ground motion sets."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

from jaxpound._checks import Range, instance, is_traced, number
from jaxpound._errors import InvalidInput, warn
from jaxpound.buildings import Buildings
from jaxpound.grid import TimeGrid
from jaxpound.ground.motion import GroundLike, as_motion
from jaxpound.ground.record import Record
from jaxpound.ground.run_input import require_time_unit
from jaxpound.ground.sequences import sequences_in
from jaxpound.model.system import Structures
from jaxpound.simulation.scheme import Scheme, require_stable, stability_limit, stiffest_rod

STEPS_PER_PERIOD = 50  # at least: the error in a free vibration is then below 0.1 % of its period
MOST_SHORTENED = 20.0  # times the steps that periods and record need: above it, a run warns of τ_f
MOST_STEPS = 1_000_000  # of a run
DURATION = Range(1e-3, 3600, "s", "at most an hour: the longest earthquakes take ten minutes")


def run_grid(
    structures: Structures,
    ground: GroundLike,
    grid: TimeGrid | None,
    scheme: Scheme,
    duration: Any,
    dt: Any,
    strict: bool,
) -> TimeGrid:
    """The grid of a run: the caller's, or, of ``Buildings``, that which the ground motion sets."""
    if grid is not None:
        instance("grid", grid, TimeGrid)
        for name, value in (("duration", duration), ("dt", dt)):
            if value is not None:
                raise InvalidInput(name, repr(value), "must be None, since the grid has it")
        return grid
    records = [part for part in as_motion(ground).parts() if isinstance(part, Record)]
    ends = [x.duration for x in sequences_in(ground)]
    rule = "must be a TimeGrid"
    if not isinstance(structures, Buildings):
        raise InvalidInput("grid", "None", f"{rule}: it is chosen for Buildings only")
    if is_traced((structures, ends, [record.dt for record in records] or ground)):
        reason = "it follows from buildings, a record's dt, wavelets and rests, of which some are "
        reason += "traced; TimeGrid.until(duration, dt) makes one"
        raise InvalidInput("grid", "None", f"{rule}: {reason}")
    require_time_unit("ground", ground, si=True)
    if duration is None and ends:
        duration = _end_of(ends, records)
    if not records and duration is None:
        rule = "must be stated in s, since the ground motion has no record"
        raise InvalidInput("duration", "None", rule)
    grid = record_grid(structures, scheme, records, duration, dt, strict)
    while dt is None and not records and as_motion(ground).unresolved(grid.dt):
        if 2 * grid.n_steps > MOST_STEPS:
            break
        grid = grid.halved
    return grid


def _end_of(ends: Sequence[Any], records: Sequence[Record]) -> float:
    """When sequences with these ends and records are over."""
    if any(end is None for end in ends):
        rule = "must be stated in s, since that of the last ground motion is unknown"
        raise InvalidInput("duration", "None", rule)
    return max(map(float, [*ends, *(record.duration for record in records)]))


def record_grid(
    buildings: Buildings,
    scheme: Scheme,
    records: Sequence[Record],
    duration: float | None = None,
    dt: float | None = None,
    strict: bool = False,
    place: str = "",
) -> TimeGrid:
    """The time grid of a run of buildings under records; duration and dt are in s.

    By default it is as long as the longest, with steps for the finest; without records the duration
    is stated. An ``InvalidInput``, named by ``place``, if one of them breaks its rule.
    """
    own = min((float(record.dt) for record in records), default=math.inf)
    if duration is None:
        whole = max(float(record.duration) for record in records)
    else:
        whole = float(number(name := f"{place} duration".lstrip(), duration))
        DURATION.require(name, whole)
    if dt is None:
        dt = chosen_step(buildings, scheme, whole, own, strict)
    else:
        dt = float(number(f"{place} dt".lstrip(), dt))
        require_stable(buildings, scheme, dt, place)
        if dt > own * (1 + 1e-9):
            rule = f"at most the record's, {own:.6g} s: samples would be skipped"
            raise InvalidInput(f"{place} dt".lstrip(), f"{dt:.6g} s", f"must be {rule}")
    if not 2 * dt <= whole <= MOST_STEPS * dt:
        rule = f"must be between 2 and {MOST_STEPS:,} steps of dt = {dt:.6g} s"
        raise InvalidInput(f"{place} duration".lstrip(), f"{whole:.6g} s", rule)
    return TimeGrid.until(whole, dt)


def natural_periods(buildings: Buildings) -> list[float]:
    """Natural period of the first mode of each building, uncoupled, s."""
    return [2 * math.pi / float(w) for w in buildings.natural_frequencies]


def time_step(periods: Iterable[float], limit: float, record_dt: float = math.inf) -> float:
    """The default time step of a run, s.

    At most 1/50 of the shortest natural period and half of the stability limit; under a record its
    sample interval over a whole number, so that no sample is missed.
    """
    largest = min(min(periods) / STEPS_PER_PERIOD, limit / 2)
    if record_dt == math.inf:
        return largest
    return record_dt / math.ceil(record_dt / largest * (1 - 1e-9))


def chosen_step(
    buildings: Buildings,
    scheme: Scheme,
    duration: float,
    record_dt: float = math.inf,
    strict: bool = False,
) -> float:
    """``time_step`` of a run of a duration, s; a warning if a small τ_f makes it short."""
    limit, periods = stability_limit(buildings, scheme), natural_periods(buildings)
    dt, needed = (time_step(periods, x, record_dt) for x in (limit, math.inf))
    part, stiffer = stiffest_rod(buildings.system(), limit, scheme, " s")
    if min(needed / dt, stiffer**0.5) > MOST_SHORTENED:  # steps shorten with the square root
        times = f"{duration / dt:,.0f} steps of {dt:.3g} s are taken, {needed / dt:.0f} times as "
        warn([f"dt: {times}many as periods and record need, because of {part}"], strict)
    return dt
