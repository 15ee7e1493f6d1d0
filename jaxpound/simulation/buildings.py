"""Buildings and a record in SI units: the choice of the time step, and the run."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from jaxpound._checks import Range, instance, is_traced, number
from jaxpound.grid import TimeGrid
from jaxpound.ground.plausibility import excessive, tell
from jaxpound.ground.record import Record
from jaxpound.model.building import Building
from jaxpound.model.contact import ContactLaw, Newton
from jaxpound.model.plausibility import doubts, too_wide
from jaxpound.model.row import FloorLink, Row
from jaxpound.model.shear_building import ShearBuilding
from jaxpound.model.structures import AdjacentStructures
from jaxpound.quantities import STANDARD_GRAVITY
from jaxpound.results.response import Response
from jaxpound.simulation.run import of_links, respond
from jaxpound.simulation.scheme import Scheme, stability_limit
from jaxpound.units import Scales, pair_of, row_of

STEPS_PER_PERIOD = 50
"""Steps in a natural period, at least: the scheme's error in a free vibration is then below 0.1 %
of its period."""

MOST_STEPS = 1_000_000
"""Of a run."""

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

    ``dimensionless``, ``simulate`` and ``Scales`` in one call, as in ``jaxpound simulate``.

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
        with at least 50 steps in the shorter natural period and within half of the stability limit.
    scheme
        The discretisation.
    gravity
        g > 0, m/s².
    strict
        Whether a ``PlausibilityWarning`` is raised as a ``ValueError``.

    Returns
    -------
    Response
        In s, m, N and m/s².

    Raises
    ------
    ValueError
        If a known value breaks its rule: dt must be positive, below the stability limit and at most
        the record's, and the duration from 2 to 1,000,000 steps. If the contact law is of one's
        own: the units of its numbers are not known. If buildings or sample interval are traced: the
        time step follows from them. If ``strict``, also where there would be a warning.
    FloatingPointError
        If the run ends in non-finite numbers although its input was valid.

    Warns
    -----
    PlausibilityWarning
        As ``dimensionless``; if the record has a PGA above 5 g, or the penetration is more than a
        quarter of the displacements (peak |x1| + peak |x2|).
        Not where slip force, gap or samples are traced.

    Notes
    -----
    Works under ``jit``, ``vmap``, ``grad`` and ``jacfwd`` over slip force, gap, the numbers of the
    contact law and the record's samples.

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
    known = {"building_1": building_1, "building_2": building_2}
    between = friction_force, gap
    _require_single(owner, friction_force=friction_force, gap=gap, gravity=gravity)
    structures, scales = pair_of(owner, building_1, building_2, *between, gravity, contact)
    # Neither damper nor gap nor contact, which may be traced, matters to the time step.
    alone = dataclasses.replace(structures, friction=0.0, initial_gap=0.0, contact=None)
    run = _Run(owner, structures, scales, scheme, ("gap", "contact"), strict)
    return run.under(record, known, alone, duration, dt)


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

    Parameters
    ----------
    buildings
        From left to right, ``ShearBuilding`` or, of one storey, ``Building``. Positive displacement
        is to the right.
    links
        What is between their floors: friction in N, gap in m, contact laws in SI units.
    record
        The ground acceleration, in g and seconds, as ``read_record`` gives it.
    duration
        Duration of the run, s; by default the record's.
    dt
        Time step, s; by default the record's sample interval, or the largest 1/n of it, n whole,
        with at least 50 steps in the shortest of the buildings' first periods and within half of
        the stability limit, which the highest mode sets.
    scheme, gravity, strict
        As in ``simulate_buildings``.

    Returns
    -------
    Response
        In s, m, N and m/s²; its masses and rods are floors and storeys, building by building.

    Raises
    ------
    ValueError
        As in ``simulate_buildings`` and ``dimensionless_row``.
    FloatingPointError
        If the run ends in non-finite numbers although its input was valid.

    Warns
    -----
    PlausibilityWarning
        As in ``simulate_buildings``, of every link whose gap is finite.

    Examples
    --------
    >>> low = jp.ShearBuilding.from_period(2, 300e3, period=0.3, damping_ratio=0.05)
    >>> high = jp.ShearBuilding.from_period(3, 300e3, period=0.6, damping_ratio=0.05)
    >>> t = 0.02 * np.arange(250)
    >>> record = jp.Record(0.2 * np.sin(10 * t) * np.exp(-((t - 2) ** 2)), dt=0.02, name="burst")
    >>> law = jp.KelvinVoigt(stiffness=5e9, restitution=0.65)
    >>> links = jp.floor_links((low, high), gap=0.02, contact=law)
    >>> response = jp.simulate_row((low, high), links, record)
    >>> print(*(f"{float(link.min_gap):.3f} m" for link in response.demand.links))
    0.001 m -0.003 m
    """
    owner = "simulate_row"
    _require_single(owner, gravity=gravity)
    structures, scales = row_of(owner, buildings, links, gravity)
    known = {f"buildings.{i}": building for i, building in enumerate(buildings)}
    run = _Run(owner, structures, scales, scheme, None, strict)
    return run.under(record, known, dataclasses.replace(structures, links=()), duration, dt)


def _require_single(owner: str, **values: Any) -> None:
    """A ``ValueError`` for arrays: many runs are one function of numbers under ``jax.vmap``."""
    for name, value in values.items():
        if shape := np.shape(value):
            rule = "must be one number: a sweep is jax.vmap of a function of it"
            raise ValueError(f"{owner}: {name} of shape {shape} {rule}")


class _Run(NamedTuple):
    """A run of structures in SI units for the function ``owner``."""

    owner: str
    structures: AdjacentStructures | Row
    scales: Scales
    scheme: Scheme
    alone: tuple[str, str] | None
    strict: bool

    def under(
        self,
        record: Record,
        known: Mapping[str, Building | ShearBuilding],
        unlinked: AdjacentStructures | Row,
        duration: float | None,
        dt: float | None,
    ) -> Response:
        """The response to a record; buildings must be ``known``, by name, for the time step."""
        owner, scales = self.owner, self.scales
        instance(owner, "record", record, Record)
        instance(owner, "scheme", self.scheme, Scheme)
        if is_traced((tuple(known.values()), record.dt)):
            rule = (
                "must be known, since the time step follows from them; simulate takes traced ones"
            )
            raise ValueError(f"{owner}: buildings and record.dt {rule}")
        for name, building in known.items():
            if shape := np.broadcast_shapes(*map(np.shape, jax.tree.leaves(building))):
                raise ValueError(
                    f"{owner}: {name} of shape {shape} must be one building, not a batch"
                )
        shaking = scales.to_dimensionless(record)
        findings = doubts(self.structures, scales) + too_wide(self.structures, scales)
        tell(owner, findings, self.strict)
        with jax.ensure_compile_time_eval():  # all of this is known, in a traced function too
            grid = record_grid(f"{owner}:", unlinked, scales, self.scheme, record, duration, dt)
        response = respond(owner, self.structures, shaking, grid, self.scheme, self.strict)
        in_si = scales.to_si(response)
        findings = excessive(record, response.demand.pga, "record")
        links = [
            dataclasses.replace(link, gap=link.gap * scales.length)
            for link in self.structures.system().links
        ]
        findings += of_links(links, in_si.demand, self.alone, gaps=False)
        tell(owner, findings, self.strict)
        return in_si


def record_grid(
    place: str,
    structures: AdjacentStructures | Row,
    scales: Scales,
    scheme: Scheme,
    record: Record,
    duration: float | None = None,
    dt: float | None = None,
) -> TimeGrid:
    """The dimensionless time grid of a run under a record; duration and dt in s if they are given.

    Raises
    ------
    ValueError
        If dt or duration breaks its rule; ``place`` is what the message starts with.
    """
    own = float(record.dt)
    limit = stability_limit(structures, scheme) * float(scales.time)
    if dt is None:
        dt = time_step(natural_periods(structures, scales), limit, own)
    else:
        dt = float(number(place.rstrip(":"), "dt", dt))
        require_stable(place, dt, limit, "these buildings")
        if dt > own * (1 + 1e-9):
            rule = f"at most the record's, {own:.6g} s: samples would be skipped"
            raise ValueError(f"{place} dt = {dt:.6g} s must be {rule}")
    whole = float(record.duration)
    if duration is not None:
        whole = float(number(place.rstrip(":"), "duration", duration))
        DURATION.require(f"{place} duration", whole)
    return time_grid(place, scales, whole, dt)


def natural_periods(structures: AdjacentStructures | Row, scales: Scales) -> list[float]:
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


def require_stable(place: str, dt: float, limit: float, whose: str) -> None:
    """A ``ValueError`` for a time step, s, with which stepping diverges."""
    if not 0 < dt < limit:
        rule = f"positive and below the stability limit {limit:.6g} s of {whose}"
        raise ValueError(f"{place} dt = {dt:.6g} s must be {rule}")


def time_grid(place: str, scales: Scales, duration: float, dt: float) -> TimeGrid:
    """The dimensionless grid of a duration and a step in s, if there are few enough steps."""
    if not 2 * dt <= duration <= MOST_STEPS * dt:
        rule = f"between 2 and {MOST_STEPS:,} steps of dt = {dt:.6g} s"
        raise ValueError(f"{place} duration = {duration:.6g} s must be {rule}")
    return scales.grid(duration, dt)
