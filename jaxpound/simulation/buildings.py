"""Buildings and a record in SI units: the choice of the time step, and the run."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import jax
import numpy as np

from jaxpound._checks import Range, instance, is_traced, number
from jaxpound._errors import warn
from jaxpound.buildings import Buildings, pair_of
from jaxpound.grid import TimeGrid
from jaxpound.ground.plausibility import excessive
from jaxpound.ground.record import Record
from jaxpound.model.building import Building
from jaxpound.model.contact import ContactLaw, Newton
from jaxpound.model.plausibility import doubts, too_wide
from jaxpound.model.row import FloorLink, Row
from jaxpound.model.shear_building import ShearBuilding
from jaxpound.model.structures import AdjacentStructures
from jaxpound.quantities import STANDARD_GRAVITY
from jaxpound.results.response import Response
from jaxpound.simulation.run import implausible_links, respond
from jaxpound.simulation.scheme import Scheme, require_stable, stability_limit, stiffest_rod
from jaxpound.units import Scales

STEPS_PER_PERIOD = 50  # at least: the error in a free vibration is then below 0.1 % of its period
MOST_SHORTENED = 20.0  # times the steps that periods and record need: above it, a run warns of τ_f
MOST_STEPS = 1_000_000  # of a run
DURATION = Range(1e-3, 3600, "s", "at most an hour: the longest earthquakes take ten minutes")


def simulate_buildings(
    building_1: Building,
    building_2: Building,
    record: Record,
    *,
    friction_force: Any,
    gap: Any,
    contact: ContactLaw | Newton | None = None,
    duration: float | None = None,
    dt: float | None = None,
    scheme: Scheme = Scheme(),
    gravity: Any = STANDARD_GRAVITY,
    strict: bool = False,
) -> Response:
    """Response of two buildings with a friction damper between them to a record; all in SI units.

    ``dimensionless``, ``simulate`` and ``Scales`` in one call, as in ``jaxpound simulate``. Works
    under ``jit``, ``vmap``, ``grad`` and ``jacfwd`` over slip force, gap, the contact law's numbers
    and the record's samples; where none of these is traced it warns as ``dimensionless`` and
    ``simulate``.

    Parameters
    ----------
    building_1, building_2
        The buildings. Positive displacement is towards building 2.
    record
        The ground acceleration, in g and seconds, as ``read_record`` gives it.
    friction_force
        Slip force of the damper ≥ 0, N.
    gap
        Gap between the buildings at rest ≥ 0, m.
    contact
        The law of contact between the buildings, its stiffness in N/m, or N/m^1.5 for laws after
        Hertz; None lets them pass through each other.
    duration
        Duration of the run, s; by default the record's.
    dt
        Time step, s; by default the record's sample interval, or the largest 1/n of it, n whole,
        with at least 50 steps in the shorter natural period and within half of the stability limit;
        it warns (``PlausibilityWarning``) if a small τ_f makes them 20 times as many as else.
    gravity
        g > 0, m/s².
    scheme, strict
        See ``simulate``.

    Raises
    ------
    ValueError, FloatingPointError
        As in ``simulate``; dt must be positive, below the stability limit and at most the record's,
        the duration from 2 to 1,000,000 steps. Also if the contact law is of one's own, since the
        units of its numbers are not known, or if buildings or sample interval are traced, since the
        time step follows from them.

    Examples
    --------
    >>> left = jp.Building.from_period(mass=500e3, period=0.9, damping_ratio=0.05)
    >>> right = jp.Building.from_period(mass=400e3, period=0.6, damping_ratio=0.05)
    >>> t = 0.02 * np.arange(500)
    >>> record = jp.Record(0.1 * np.sin(7 * t) * np.exp(-((t - 4) ** 2)), dt=0.02, name="burst")
    >>> response = jp.simulate_buildings(left, right, record, friction_force=200e3, gap=0.10)
    >>> print(f"{float(response.min_gap):.3f} m")
    0.061 m
    """
    owner = "simulate_buildings"
    by_name = {"building_1": building_1, "building_2": building_2}
    _require_single(owner, friction_force=friction_force, gap=gap, gravity=gravity)
    pair = building_1, building_2
    structures, scales = pair_of(owner, pair, friction_force, gap, contact, gravity)
    return _respond(owner, structures, scales, by_name, record, duration, dt, scheme, strict)


def simulate_row(
    buildings: Sequence[Building | ShearBuilding],
    links: Sequence[FloorLink],
    record: Record,
    *,
    duration: float | None = None,
    dt: float | None = None,
    scheme: Scheme = Scheme(),
    gravity: Any = STANDARD_GRAVITY,
    strict: bool = False,
) -> Response:
    """Response of buildings in a row, of one or more storeys, to a record; all in SI units.

    ``dimensionless_row``, ``simulate`` and ``Scales`` in one call, as in ``jaxpound simulate``.
    Masses and rods of the response are floors and storeys, building by building. Raises and warns
    as ``simulate_buildings`` and ``dimensionless_row``, of every link.

    Parameters
    ----------
    buildings, links
        As of ``Buildings``.
    record, duration, dt, scheme, gravity, strict
        See ``simulate_buildings``; by default dt has at least 50 steps in the shortest of the
        buildings' first periods, and is within half of the stability limit, which the highest mode
        sets.

    Examples
    --------
    >>> low = jp.ShearBuilding.from_period(1, 300e3, period=0.3, damping_ratio=0.05)
    >>> high = jp.ShearBuilding.from_period(2, 300e3, period=0.6, damping_ratio=0.05)
    >>> t = 0.02 * np.arange(250)
    >>> record = jp.Record(0.2 * np.sin(10 * t) * np.exp(-((t - 2) ** 2)), dt=0.02, name="burst")
    >>> law = jp.KelvinVoigt(stiffness=5e9, restitution=0.65)
    >>> links = jp.floor_links((low, high), gap=0.02, contact=law)
    >>> response = jp.simulate_row((low, high), links, record)
    >>> print(*(f"{float(link.min_gap):.3f} m" for link in response.demand.links))
    -0.002 m
    """
    owner = "simulate_row"
    _require_single(owner, gravity=gravity)
    structures, scales = Buildings.of(owner, buildings, links, gravity).dimensionless_for(owner)
    by_name = {f"buildings.{i}": building for i, building in enumerate(buildings)}
    return _respond(owner, structures, scales, by_name, record, duration, dt, scheme, strict)


def _require_single(owner: str, **values: Any) -> None:
    """A ``ValueError`` for arrays: many runs are one function of numbers under ``jax.vmap``."""
    for name, value in values.items():
        if shape := np.shape(value):
            rule = "must be one number: a sweep is jax.vmap of a function of it"
            raise ValueError(f"{owner}: {name} of shape {shape} {rule}")


def _respond(
    owner: str,
    structures: AdjacentStructures | Row,
    scales: Scales,
    buildings: Mapping[str, Building | ShearBuilding],
    record: Record,
    duration: float | None,
    dt: float | None,
    scheme: Scheme,
    strict: bool,
) -> Response:
    """The response to a record; buildings, by name, must be known for the time step."""
    instance(owner, "record", record, Record)
    instance(owner, "scheme", scheme, Scheme)
    if is_traced((tuple(buildings.values()), record.dt)):
        rule = "must be known, since the time step follows from them; simulate takes traced ones"
        raise ValueError(f"{owner}: buildings and record.dt {rule}")
    for name, building in buildings.items():
        if shape := np.broadcast_shapes(*map(np.shape, jax.tree.leaves(building))):
            raise ValueError(f"{owner}: {name} of shape {shape} must be one building, not a batch")
    shaking = scales.to_dimensionless(record)
    warn(owner, doubts(structures, scales) + too_wide(structures, scales), strict)
    # Of what is between buildings, which may be traced, only stiffness and inertance matter to the
    # time step.
    names, free = None, dict[str, Any](friction=0.0, contact=None)
    if isinstance(structures, AdjacentStructures):
        names = ("gap", "contact")
        unlinked: Any = dataclasses.replace(structures, initial_gap=0.0, **free)
    else:
        free |= {"gap": np.inf, "velocity_friction": None}
        links_alone = []
        for x in structures.links:
            traced: Any = {y: None for y in ("damper", "inerter") if is_traced(getattr(x, y))}
            links_alone.append(dataclasses.replace(x, **free, **traced))
        unlinked = dataclasses.replace(structures, links=tuple(links_alone))
    with jax.ensure_compile_time_eval():  # all of this is known, in a traced function too
        grid = record_grid(f"{owner}:", unlinked, scales, scheme, record, duration, dt, strict)
    response = respond(owner, structures, shaking, grid, scheme, strict)
    in_si = scales.to_si(response)
    links = [dataclasses.replace(x, gap=x.gap * scales.length) for x in structures.system().links]
    findings = excessive(record, response.demand.pga, "record", si=True)
    findings += implausible_links(links, in_si.demand, names, gaps=False)
    warn(owner, findings, strict)
    return in_si


def record_grid(
    place: str,
    structures: AdjacentStructures | Row | Buildings,
    scales: Scales,
    scheme: Scheme,
    record: Record,
    duration: float | None = None,
    dt: float | None = None,
    strict: bool = False,
) -> TimeGrid:
    """The dimensionless time grid of a run under a record; duration and dt are in s.

    A ``ValueError`` if one of them breaks its rule, whose message starts with ``place``.
    """
    own, whole = float(record.dt), float(record.duration)
    if duration is not None:
        whole = float(number(place.rstrip(":"), "duration", duration))
        DURATION.require(f"{place} duration", whole)
    if dt is None:
        dt = chosen_step(structures, scales, scheme, whole, own, strict)
    else:
        dt = float(number(place.rstrip(":"), "dt", dt))
        require_stable(structures, scheme, dt, place, scales.time)
        if dt > own * (1 + 1e-9):
            rule = f"at most the record's, {own:.6g} s: samples would be skipped"
            raise ValueError(f"{place} dt = {dt:.6g} s must be {rule}")
    return time_grid(place, scales, whole, dt)


def natural_periods(
    structures: AdjacentStructures | Row | Buildings, scales: Scales
) -> list[float]:
    """Natural period of the first mode of each building, uncoupled, s."""
    return [2 * math.pi / float(w) * float(scales.time) for w in structures.natural_frequencies]


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
    structures: AdjacentStructures | Row | Buildings,
    scales: Scales,
    scheme: Scheme,
    duration: float,
    record_dt: float = math.inf,
    strict: bool = False,
) -> float:
    """``time_step`` of a run of a duration, s; a warning if a small τ_f makes it short."""
    limit, time = stability_limit(structures, scheme), float(scales.time)
    periods = natural_periods(structures, scales)
    dt, needed = (time_step(periods, x, record_dt) for x in (limit * time, math.inf))
    part, stiffer = stiffest_rod(structures.system(), limit, scheme, time)
    if min(needed / dt, stiffer**0.5) > MOST_SHORTENED:  # steps shorten with the square root
        times = f"{duration / dt:,.0f} steps of {dt:.3g} s are taken, {needed / dt:.0f} times as "
        warn("dt", [f"{times}many as periods and record need, because of {part}"], strict)
    return dt


def time_grid(place: str, scales: Scales, duration: float, dt: float) -> TimeGrid:
    """The dimensionless grid of a duration and a step in s, if there are few enough steps."""
    if not 2 * dt <= duration <= MOST_STEPS * dt:
        rule = f"between 2 and {MOST_STEPS:,} steps of dt = {dt:.6g} s"
        raise ValueError(f"{place} duration = {duration:.6g} s must be {rule}")
    return scales.grid(duration, dt)
