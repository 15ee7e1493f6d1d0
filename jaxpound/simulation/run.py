"""Runs: ``simulate`` keeps every instant, ``demand`` only scalars.

A run goes from structures to their ``System``, its rules and constants, through the scan over time,
where ``step`` moves it and ``Tally`` observes it, to a ``Demand`` or a ``Response``.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from jaxpound._checks import Rule, enforce, finite, instance, is_traced, number
from jaxpound._fields import rules
from jaxpound.grid import TimeGrid
from jaxpound.ground.motion import (
    Ground,
    GroundLike,
    as_pytree,
    require_ground,
    velocity_and_bulge,
)
from jaxpound.ground.plausibility import (
    excessive,
    far_apart,
    tell,
    too_deep,
    unbalanced,
    unseen,
)
from jaxpound.model.contact import Newton
from jaxpound.model.initial import InitialState, initial_rules
from jaxpound.model.system import GROUND, Link, Structures, System, is_closable
from jaxpound.results.demand import Demand
from jaxpound.results.impacts import MOST, ImpactSeries
from jaxpound.results.response import LinkResponse, MassResponse, Response, RodResponse
from jaxpound.simulation.course import Course
from jaxpound.simulation.extrapolation import extrapolated, extrapolated_response
from jaxpound.simulation.forces import is_deformed
from jaxpound.simulation.passage import SLOTS, Impacts
from jaxpound.simulation.programs import note_long_compilations
from jaxpound.simulation.scheme import Scheme, require_followed, require_stable, system_of
from jaxpound.simulation.stepping import Instant, of_all_masses
from jaxpound.simulation.tally import ContactTally, Tally


def simulate(
    structures: Structures,
    ground: GroundLike,
    grid: TimeGrid,
    scheme: Scheme = Scheme(),
    *,
    initial: InitialState | None = None,
    strict: bool = False,
) -> Response:
    """Response of structures to a ground motion, at every instant of the grid.

    Parameters
    ----------
    structures
        ``AdjacentStructures`` (eq. 9), a ``System`` of any number of masses, rods and links, or
        any other pytree with ``system()``; dimensionless.
    ground
        A ground motion in units of g over time in units of 1/ω1: ``Ricker``, ``Record``, sums and
        scalings of them, any object with ``acceleration(t)`` or any function of t. One that is not
        a pytree of arrays is evaluated on the grid before the run.
    grid
        The instants.
    scheme
        The discretisation; the default is second-order accurate through stick and slip.
    initial
        Displacements and velocities at t = 0; by default all is at rest.
    strict
        Whether a ``PlausibilityWarning`` is raised as a ``ValueError``.

    Returns
    -------
    Response
        Time series of shape (n_steps+1,) and the run's ``Demand``.

    Raises
    ------
    ValueError
        If dt is not below the stability limit, a known value is invalid, or the ground motion is
        made of a record in seconds; if links share masses or have a law of contact and the scheme
        is not of friction ``EventResolved()``; if ``strict``, also where there would be a warning.
    FloatingPointError
        If the run ends in non-finite numbers although its input was valid.

    Warns
    -----
    PlausibilityWarning
        If the grid has fewer than 8 steps a period of the shortest wavelet, or is coarser than a
        record and loses more than 1 % of its energy; if more than 10 % of the motion's energy comes
        after the end of the grid; if the energy balance of ``simulate`` leaves more than 3 % of the
        energy put in; if a record has a PGA above 5 g; if the gap is more than 100 times the peak
        displacements of both its ends together, or a penetration more than a quarter of them; if
        contact is run in single precision. Neither resolution nor end of a plain function of t is
        checked, since its periods and duration are not known.

    Notes
    -----
    Works under ``jit``, ``vmap``, ``grad`` and ``jacfwd`` over every leaf of structures and ground.
    Traced values can neither raise nor give a warning: an invalid run gives NaN in every result.

    Examples
    --------
    >>> grid = jp.TimeGrid.until(20.0, dt=0.05)
    >>> response = jp.simulate(jp.paper.structures(), jp.paper.ground(), grid)
    >>> round(float(response.min_gap), 3)
    0.304
    >>> [(phase.kind, round(phase.start, 2)) for phase in response.phases()[:3]]
    [('stick', 0.0), ('slip left', 0.64), ('slip right', 1.19)]
    """
    response = respond("simulate", structures, ground, grid, scheme, strict, initial)
    _look("simulate", structures, ground, response.demand, strict)
    return response


def respond(
    owner: str,
    structures: Structures,
    ground: GroundLike,
    grid: TimeGrid,
    scheme: Scheme,
    strict: bool,
    initial: InitialState | None = None,
) -> Response:
    """``simulate`` for the function ``owner``, which itself checks that results are plausible."""
    shaking = _prepare(owner, structures, ground, grid, scheme, strict, initial)
    balanced = not is_traced((structures, shaking, initial))
    response, residual = _simulate(structures, shaking, grid, scheme, initial, balanced)
    response = _finished(response)
    if balanced:
        tell(owner, unbalanced(residual), strict)
    return response


def demand(
    structures: Structures,
    ground: GroundLike,
    grid: TimeGrid,
    scheme: Scheme = Scheme(),
    *,
    temperature: ArrayLike | None = None,
    initial: InitialState | None = None,
    only: Sequence[str] | None = None,
    strict: bool = False,
) -> Demand:
    """Scalars of a run, ``simulate(...).demand``, accumulated in O(modes) memory.

    A batch is ``jax.vmap`` of this function; where JAX has several devices of a kind (the cores of
    a CPU after ``use_cores``), a batch that divides evenly among them, with at least 16 runs each,
    is spread over them. ``in_chunks`` spreads batches of any size, and keeps them in the caches.

    Parameters
    ----------
    structures, ground, grid, scheme
        See ``simulate``.
    temperature
        T > 0, dimensionless as the gap ξ (in g/ω1²), asks for ``Demand.soft_min_gap``, −T log of
        the mean of e^(−ξ/T) over the run's instants: smooth in every parameter, and between the
        smallest ξ of them (T → 0) and their mean (T → ∞). It is never below the smallest, and
        nearer to the mean the longer the run goes on after the shaking.
    only
        Flat names of the scalars that are wanted, such as ``("min_gap", "peak_f1")``: all others
        are None, and a batch of pairs takes some 0.7 of the time. By default all.
    initial, strict
        See ``simulate``.

    Returns
    -------
    Demand

    Raises
    ------
    ValueError
        As in ``simulate``; if temperature is not positive and finite, or ``only`` holds something
        else than names of scalars.
    FloatingPointError
        As in ``simulate``.

    Warns
    -----
    PlausibilityWarning
        As in ``simulate``; of results only if all scalars are asked for.

    Examples
    --------
    >>> grid = jp.TimeGrid.until(20.0, dt=0.05)
    >>> demand = jp.demand(jp.paper.structures(), jp.paper.ground(), grid)
    >>> round(float(demand.min_gap), 3), round(float(demand.min_gap_time), 2)
    (0.304, 7.48)
    >>> float(demand.pounds)
    0.0
    """
    shaking = _prepare("demand", structures, ground, grid, scheme, strict, initial)
    if temperature is not None:
        temperature = number("demand", "temperature", temperature)
        if not structures.system().links:
            raise ValueError(
                f"demand: temperature = {temperature} must be of gaps: there is no link"
            )
        enforce("demand", _temperature_rules(temperature))
    wanted = None if only is None else _names(only)
    found = _finished(_demand(structures, shaking, grid, scheme, temperature, initial, wanted))
    if wanted is None:
        _look("demand", structures, ground, found, strict)
    return found


def _names(only: Any) -> tuple[str, ...]:
    """The names of the scalars that are wanted; a ``ValueError`` for anything else."""
    if isinstance(only, str) or not all(isinstance(name, str) for name in only) or not only:
        raise ValueError(f"demand: only = {only!r} must hold names of scalars")
    return tuple(only)


def _temperature_rules(temperature: Any) -> list[Rule]:
    if temperature is None:
        return []
    holds = (temperature > 0) & finite(temperature)
    return [Rule("temperature", temperature, holds, "positive and finite")]


def _prepare(
    owner: str,
    structures: Structures,
    ground: GroundLike,
    grid: TimeGrid,
    scheme: Scheme,
    strict: bool,
    initial: InitialState | None,
) -> Ground:
    """Refuse known invalid input; put the ground motion in a form that can be traced."""
    note_long_compilations()
    system = system_of(owner, structures)
    instance(owner, "grid", grid, TimeGrid)
    instance(owner, "scheme", scheme, Scheme)
    require_ground("ground", ground)
    # A system of one's own making is judged by its parts, ours by their own parameters.
    found = rules(structures) or rules(system)
    for rule in found:
        if jnp.ndim(rule.value):
            raise ValueError(
                f"structures: {rule.name} of shape {jnp.shape(rule.value)} must be one number; "
                "a batch of structures goes through jax.vmap"
            )
    enforce("structures", found)
    require_stable(system, grid, scheme)
    require_followed(system, scheme)
    if initial is not None:
        instance(owner, "initial", initial, InitialState)
        enforce("initial", rules(initial))
        enforce("initial", initial_rules(initial, system, grid.dt))
    traceable = as_pytree(ground, scheme.finest(grid))
    if not is_traced((structures, traceable)):
        tell(owner, unseen(ground, grid) + _unsharp(system, traceable), strict)
    return traceable


def _unsharp(system: System, ground: Ground) -> list[str]:
    """A finding for contact in single precision, whose rounding impacts amplify."""
    dtype = jnp.result_type(float, *jax.tree.leaves((system, ground)))
    if dtype == jnp.float64 or all(link.contact is None for link in system.links):
        return []
    return [
        f"contact is run in {dtype}, in which forces are off by up to 1e-4 of themselves and "
        'impacts may be missed: jax.config.update("jax_enable_x64", True) first makes it float64'
    ]


def _look(
    owner: str, structures: Structures, ground: GroundLike, found: Demand, strict: bool
) -> None:
    """Warn of implausible results of a run with known values, or refuse them."""
    if is_traced((structures, found)):
        return
    alone = ("initial_gap", "contact") if hasattr(structures, "initial_gap") else None
    findings = excessive(ground, found.pga)
    findings += of_links(structures.system().links, found, alone)
    tell(owner, findings, strict)


def of_links(
    links: Iterable[Link],
    found: Demand,
    alone: tuple[str, str] | None = None,
    *,
    gaps: bool = True,
) -> list[str]:
    """Findings in the gaps and contact laws of a run.

    Parameters
    ----------
    links
        The links, in the units of ``found``.
    found
        The scalars of the run.
    alone
        What gap and law are called where there is but one link; by default links are numbered.
    gaps
        Whether gaps are judged: those of buildings are, before their runs.
    """
    findings = []
    for k, link in enumerate(links):
        if is_closable(link.gap):  # else no contact is meant
            moved = sum(found.masses[end].peak_x for end in link.ends if end != GROUND)
            gap, law = alone or (f"links.{k}.gap", f"links.{k}.contact")
            if gaps:
                findings += far_apart(gap, link.gap, moved, si=found.si)
            findings += too_deep(law, found.links[k].peak_penetration, moved, si=found.si)
    return findings


_TIMES = ("touch_time", "end_time")


class _Kept(NamedTuple):
    """Series that the scan stores; all others are computed from these afterwards."""

    x: tuple[Any, ...]
    v: tuple[Any, ...]
    forces: tuple[Any, ...]
    links: tuple[dict[str, Any], ...]
    """Closing, and the entries of a ``LinkResponse``."""
    impacts: tuple[Impacts | None, ...]
    """That ended in each step, for each link that may touch."""

    @staticmethod
    def of(now: Instant, tally: Tally) -> _Kept:
        """The entries of an instant."""
        links, impacts = [], []
        for link, tallied in zip(now.links, tally.links, strict=True):
            motion, seen = link.motion, link.motion.contact
            entries = {
                "closing": link.closing,
                "slip_velocity": link.velocity,
                "friction": motion.force,
                "phase": motion.phase,
                "change_time": now.time + motion.change_time,
            }
            impact = None
            if (contact := tallied.contact) is not None:
                record = seen.passed.record
                entries |= {
                    "contact": seen.passed.now.contact,
                    "touching": record.touched,
                    "contact_stored": contact.stored_now,
                    "contact_lost": contact.lost_now,
                    "slid": contact.slid,
                }
                later = {name: now.time + getattr(record.impacts, name) for name in _TIMES}
                impact = jax.tree.map(tuple, record.impacts._replace(**later))
            links.append(entries)
            impacts.append(impact)
        return _Kept(now.x, now.v, now.forces, tuple(links), tuple(impacts))


def _run(
    structures: Structures,
    ground: Ground,
    grid: TimeGrid,
    scheme: Scheme,
    temperature: ArrayLike | None,
    initial: InitialState | None,
    keep: bool,
) -> tuple[System, Demand, _Kept | None, tuple[ContactTally | None, ...]]:
    """The system in the run's dtype, the scalars, the series if they are to be kept, and contact.

    That is, of each link, what was tallied of it.
    """
    run = Course.of(
        structures,
        ground,
        grid,
        scheme,
        temperature,
        _temperature_rules,
        SLOTS if keep else 0,
        initial,
    )
    system, zero, temperature, n = run.system, run.zero, run.given, grid.n_steps

    def advance(carry: Any, sums: list[jax.Array], m: jax.Array, entry: Any) -> Any:
        state, tally = carry
        state, c, now = run.advance(state, sums, m, entry)
        tally = tally.observe(now, run.constants, grid.dt, m == n, temperature)
        return (state, tally), c, _Kept.of(now, tally) if keep else None

    closings = [link.closing for link in run.start.links]
    start = run.start, Tally.start(system, zero, temperature is not None, closings)
    (state, tally), kept = run.scan(advance, start, segmented=keep)
    scalars = tally.demand(system, scheme.friction.set_valued, temperature)
    # A run that becomes non-finite is NaN throughout as well. Multiply by NaN: ``where`` would
    # leave finite derivatives.
    closings = [link.closing for link in state.links]
    ends = jnp.stack(of_all_masses(system.topology, state.x, closings))
    poison = jnp.where(jnp.isfinite(ends).all(), 1.0, jnp.nan).astype(zero.dtype)
    contacts = tuple(link.contact for link in tally.links)
    return (system, *jax.tree.map(lambda x: x * poison, (scalars, kept, contacts)))


@partial(jax.jit, static_argnames=("grid", "scheme", "only"))
def _demand(
    structures: Structures,
    ground: Ground,
    grid: TimeGrid,
    scheme: Scheme,
    temperature: ArrayLike | None,
    initial: InitialState | None,
    only: tuple[str, ...] | None,
) -> Demand:
    def at(grid: TimeGrid) -> Demand:
        return _run(structures, ground, grid, scheme, temperature, initial, keep=False)[1]

    found = at(grid)
    if scheme.extrapolated:
        found = extrapolated(found, at(grid.halved))
    return found if only is None else found.only(only)


@partial(jax.jit, static_argnames=("grid", "scheme", "balanced"))
def _simulate(
    structures: Structures,
    ground: Ground,
    grid: TimeGrid,
    scheme: Scheme,
    initial: InitialState | None,
    balanced: bool,
) -> tuple[Response, jax.Array | None]:
    """The response and, if ``balanced``, the share of its energy that the balance leaves."""
    response = _response(structures, ground, grid, scheme, initial)
    if scheme.extrapolated:
        finer = _response(structures, ground, grid.halved, scheme, initial)
        response = extrapolated_response(response, finer)
    return response, response.energy.relative_residual if balanced else None


def _response(
    structures: Structures,
    ground: Ground,
    grid: TimeGrid,
    scheme: Scheme,
    initial: InitialState | None,
) -> Response:
    system, scalars, kept, ends = _run(structures, ground, grid, scheme, None, initial, keep=True)
    assert kept is not None
    topology, rest = system.topology, 0 * kept.forces[0]
    # Series that follow from others are not stored by the scan; those of an invalid run are NaN.
    time = jnp.asarray(grid.times(), rest.dtype)
    ground_velocity, bulge = (
        y.astype(rest.dtype) for y in velocity_and_bulge(ground, time, grid.dt)
    )
    # A free mass's velocity is the mean of those half a step away. The ground's mean there exceeds
    # the ground velocity now by the bulge, which is added; but not as the run starts.
    bulge = bulge.at[0].set(0)
    v = of_all_masses(
        topology,
        [None if v is None else v + bulge for v in kept.v],
        [link["slip_velocity"] for link in kept.links],
    )
    x = of_all_masses(topology, kept.x, [link["closing"] for link in kept.links])
    return Response(
        time=time + rest,
        ground_acceleration=jax.vmap(ground.acceleration)(time).astype(rest.dtype) + rest,
        ground_velocity=ground_velocity + rest,
        masses=tuple(
            MassResponse(x=x, v=v, mass=mass + rest[0])
            for x, v, mass in zip(x, v, system.masses, strict=True)
        ),
        rods=tuple(
            RodResponse(force=force, ends=ends)
            for force, ends in zip(kept.forces, topology.rods, strict=True)
        ),
        links=tuple(
            _link_response(link, kept.links[k], kept.impacts[k], ends[k], time[-1] + rest[0])
            for k, link in enumerate(system.links)
        ),
        demand=scalars,
        method=f"{scheme.friction}, order {scheme.order}, {scheme.history}"
        + scheme.extrapolated * ", extrapolated",
    )


def _link_response(
    link: Link,
    series: dict[str, Any],
    ended: Impacts | None,
    end: ContactTally | None,
    last: jax.Array,
) -> LinkResponse:
    """The series of a link, from the impacts that ended in each step and the last instant."""
    own = dict(series)
    gap = link.gap - own.pop("closing")
    if ended is None or end is None:
        return LinkResponse(gap=gap, **own, ends=link.ends)
    passed = Impacts(*[jnp.stack(slots, -1).ravel() for slots in ended])
    acts, never = is_deformed(end.mode) & (end.counts > 0), jnp.nan * last
    under_way = end.under_way
    unfinished = Impacts(
        touch_time=under_way.touch_time,
        approach_velocity=jnp.where(acts, under_way.touch_speed, 0.0),
        end_time=never,
        rebound_velocity=never,
        impulse=under_way.impulse,
        peak_force=under_way.peak_force,
    )
    every = jax.tree.map(lambda x, y: jnp.append(x, y), passed, unfinished)
    if isinstance(link.contact, Newton):
        every = every._replace(peak_force=jnp.full_like(every.peak_force, jnp.inf))
    there = (every.approach_velocity > 0) & (every.touch_time <= last) & ~(every.end_time > last)
    (which,) = jnp.nonzero(there, size=min(MOST, there.size), fill_value=there.size)
    kept = jax.tree.map(lambda x: jnp.append(x, jnp.nan)[which], every)
    return LinkResponse(
        gap=gap,
        friction_work=link.friction * own.pop("slid"),
        impacts=ImpactSeries(
            time=kept.touch_time,
            end=kept.end_time,
            approach_velocity=kept.approach_velocity,
            rebound_velocity=kept.rebound_velocity,
            impulse=kept.impulse,
            peak_force=kept.peak_force,
        ),
        law=None if isinstance(link.contact, Newton) else link.contact,
        **own,
        ends=link.ends,
    )


def _finished(result: Any) -> Any:
    """The result of a run; a run that is known to have failed raises."""
    scalars = result.demand if isinstance(result, Response) else result
    if is_traced(scalars) or all(np.isfinite(x).all() for x in jax.tree.leaves(scalars)):
        return result
    # An infinite gap stays infinite, and so does the time of an impact that never comes.
    gaps = [
        x
        for link in scalars.links
        for x in (link.min_gap, link.soft_min_gap, link.first_impact_time)
    ]
    closed = tuple(
        dataclasses.replace(link, min_gap=0.0, soft_min_gap=0.0, first_impact_time=0.0)
        for link in scalars.links
    )
    others = jax.tree.leaves(dataclasses.replace(scalars, links=closed))
    above = [gap > -np.inf for gap in gaps if gap is not None]
    if not all(np.all(x) for x in [*above, *map(np.isfinite, others)]):
        raise FloatingPointError(
            "the run ended in non-finite numbers: the ground motion returns some or overflows, the "
            "temperature is too small, or the contact of a link has more events within a step than "
            "can be followed (take a smaller dt)"
        )
    return result
