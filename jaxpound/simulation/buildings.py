"""Two buildings and a record in SI units: the choice of the time step, and the run."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from typing import Any

import jax
import numpy as np

from jaxpound._checks import instance, is_traced, number
from jaxpound.grid import TimeGrid
from jaxpound.ground.plausibility import excessive, far_apart, tell, too_deep
from jaxpound.ground.record import Record
from jaxpound.model.building import Building
from jaxpound.model.contact import ContactLaw, Newton
from jaxpound.model.structures import AdjacentStructures
from jaxpound.quantities import STANDARD_GRAVITY
from jaxpound.results.response import Response
from jaxpound.simulation.run import respond
from jaxpound.simulation.scheme import Scheme, stability_limit
from jaxpound.units import Scales, dimensionless

STEPS_PER_PERIOD = 50
"""Steps in a natural period, at least: the scheme's error in a free vibration is then below 0.1 %
of its period."""

MOST_STEPS = 1_000_000
"""Of a run."""


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
        If the record has a PGA above 5 g, or the gap is more than 100 times the displacements (peak
        |x1| + peak |x2|), or the penetration more than a quarter of them. Not where slip force, gap
        or samples are traced.

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
    instance(owner, "record", record, Record)
    instance(owner, "scheme", scheme, Scheme)
    between = friction_force, gap
    structures, scales = dimensionless(building_1, building_2, *between, gravity, contact)
    shaking = scales.to_dimensionless(record)
    if is_traced((building_1, building_2, record.dt)):
        rule = "must be known, since the time step follows from them; simulate takes traced ones"
        raise ValueError(f"{owner}: buildings and record.dt {rule}")
    for name, building in (("building_1", building_1), ("building_2", building_2)):
        if shape := np.broadcast_shapes(*map(np.shape, jax.tree.leaves(building))):
            raise ValueError(f"{owner}: {name} of shape {shape} must be one building, not a batch")
    # Neither damper nor gap nor contact, which may be traced, matters to the time step.
    pair = dataclasses.replace(structures, friction=0.0, initial_gap=0.0, contact=None)
    with jax.ensure_compile_time_eval():  # all of this is known, in a traced function too
        grid = record_grid(f"{owner}:", pair, scales, scheme, record, duration, dt)
    response = respond(owner, structures, shaking, grid, scheme, strict)
    in_si = scales.to_si(response)
    moved = in_si.demand.peak_x1 + in_si.demand.peak_x2
    findings = excessive(record, response.demand.pga, "record")
    findings += far_apart("gap", gap, moved, si=True)
    findings += too_deep("contact", in_si.demand.links[0].peak_penetration, moved, si=True)
    tell(owner, findings, strict)
    return in_si


def record_grid(
    place: str,
    structures: AdjacentStructures,
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
    whole = float(record.duration) if duration is None else duration
    return time_grid(place, scales, float(number(place.rstrip(":"), "duration", whole)), dt)


def natural_periods(structures: AdjacentStructures, scales: Scales) -> list[float]:
    """Natural periods of the two buildings, uncoupled, s."""
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
