"""Runs: ``simulate`` keeps every instant, ``demand`` only scalars.

A run goes from structures to their ``System``, its rules and constants, through the scan over time,
where ``step`` moves it and ``Tally`` observes it, to a ``Demand`` or a ``Response``.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Hashable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from jaxpound._checks import Rule, enforce, finite, instance, is_traced, number
from jaxpound._errors import InvalidInput, renamed, warn
from jaxpound._fields import rules
from jaxpound._xla.programs import note_long_compilations
from jaxpound.buildings import Buildings
from jaxpound.grid import TimeGrid
from jaxpound.ground.motion import GroundLike, require_ground
from jaxpound.ground.plausibility import excessive, far_apart, too_deep, unbalanced, unseen
from jaxpound.ground.run_input import as_run
from jaxpound.model.ends import link_ends, moving_ends
from jaxpound.model.initial import InitialState, initial_rules
from jaxpound.model.places import link_places
from jaxpound.model.system import Link, Structures, System, gravity_of, in_si, is_closable
from jaxpound.model.topology import Topology
from jaxpound.results.demand import Demand
from jaxpound.results.elements import is_valid
from jaxpound.results.response import Response
from jaxpound.simulation.constants import contacts
from jaxpound.simulation.contact.records import Contact
from jaxpound.simulation.loads import by_mass, unresolved
from jaxpound.simulation.observe.series import StoredSeries, response_of
from jaxpound.simulation.observe.tally import Tally
from jaxpound.simulation.rollout import Rollout, extrapolated, extrapolated_response, program_key
from jaxpound.simulation.scheme import (
    Scheme,
    imprecise,
    require_local_flow,
    require_stable,
    single_system,
)
from jaxpound.simulation.state import Instant
from jaxpound.simulation.time_steps import run_grid


def simulate(
    structures: Structures,
    ground: GroundLike,
    grid: TimeGrid | None = None,
    scheme: Scheme = Scheme(),
    *,
    duration: float | None = None,
    dt: float | None = None,
    initial: InitialState | None = None,
    loads: Mapping[Any, Any] | None = None,
    strict: bool = False,
) -> Response:
    """Response of structures to a ground motion: series of shape (n_steps+1,) and the ``Demand``.

    Works under ``jit``, ``vmap``, ``grad`` and ``jacfwd`` over every leaf of structures and ground.
    Traced values can neither raise nor give a warning: an invalid run gives NaN in every result.

    Parameters
    ----------
    structures
        ``Buildings``, whose results are in SI units too; or dimensionless ``AdjacentStructures``
        (eq. 9), a ``System`` of any number of masses, rods and links, or any other pytree with
        ``system()``.
    ground
        ``Ricker``, ``Record``, sums and scalings of them, any object with ``acceleration(t)`` or
        any function of t: in units of g over time in units of 1/ω1. For ``Buildings``, records are
        in g over time in s and all others in m/s². One that is not a pytree of arrays is evaluated
        on the grid before the run.
    grid
        The instants, in the same unit of time. None chooses it for ``Buildings`` that are not
        traced.
    scheme
        The discretisation; the default is second-order accurate through stick and slip.
    duration, dt
        Of a grid that is chosen, in s. By default the duration is that of the longest record or of
        a sequence, and must be stated without one. The step is by default the sample interval of
        the finest record, or the largest 1/n of it, n whole, with at least 50 steps in the shortest
        of the buildings' first periods and within half of the stability limit; without a record it
        also resolves wavelets. It warns if a small τ_f makes the steps 20 times as many as else.
    initial
        Displacements and velocities at t = 0; by default all is at rest.
    loads
        Forces on masses beside the ground motion, such as wind or a blast, positive to the right:
        by (building, floor), both from 0, or by the number of a mass of a ``System``, a function of
        t, a series of n_steps+1 numbers at the grid's instants, linear in between, or an object
        with ``acceleration(t)``, which is the force; in N with ``Buildings``. The steps must
        resolve them. None by default.
    strict
        Whether a ``PlausibilityWarning`` is raised as a ``ValueError``, also one that came when the
        buildings, or a record of the ground motion, were made.

    Raises
    ------
    ValueError
        If dt is not below the stability limit, or above a record's where the grid is chosen, or the
        duration is not from 2 to 1,000,000 steps; if a known value is invalid, or the ground motion
        has another unit of time than the structures; if links share masses or have a law of contact
        and the scheme is not of friction ``EventResolved()``; if ``strict``, also where there would
        be a warning.
    FloatingPointError
        If the run ends in non-finite numbers although its input was valid.

    Warns
    -----
    PlausibilityWarning
        If the grid has fewer than 8 steps a period of the shortest wavelet, or is coarser than a
        record and loses more than 1 % of its energy; if more than 10 % of the motion's energy comes
        after the end of the grid (a function of t is not checked for either); if the energy balance
        of ``simulate`` leaves more than 3 % of the energy put in; if a record has a PGA above 5 g,
        or for ``Buildings`` any other ground motion one above 2 g; if the gap of dimensionless
        structures is more than 100 times the peak displacements of both its ends together, or any
        penetration more than a quarter of them; if contact is run in single precision; if dt is
        more than four times c/K of a viscous damper (``PowerLaw``) on its brace, c = F/v.

    Examples
    --------
    >>> grid = jp.TimeGrid.until(20.0, dt=0.05)
    >>> response = jp.simulate(jp.paper.structures(), jp.paper.ground(), grid)
    >>> round(float(response.min_gap), 3)
    0.304
    >>> [(phase.kind, round(phase.start, 2)) for phase in response.phases()[:3]]
    [('stick', 0.0), ('slip left', 0.64), ('slip right', 1.19)]
    """
    case = Case(structures, ground, initial, loads)
    traceable, grid = case.prepared(grid, scheme, duration, dt, strict)
    balanced = not is_traced(traceable)
    response, residual = _simulate(traceable, program_key(traceable), grid, scheme, balanced)
    response = _finished(response)
    if balanced and not is_traced(residual):
        warn(unbalanced(residual), strict)
    if in_si(structures):
        scalars = dataclasses.replace(response.demand, si=True)
        response = dataclasses.replace(response, demand=scalars, si=True)
    case.warn_of_results(response.demand, strict)
    return response


def demand(
    structures: Structures,
    ground: GroundLike,
    grid: TimeGrid | None = None,
    scheme: Scheme = Scheme(),
    *,
    duration: float | None = None,
    dt: float | None = None,
    temperature: ArrayLike | None = None,
    initial: InitialState | None = None,
    only: Sequence[str] | None = None,
    strict: bool = False,
) -> Demand:
    """Scalars of a run, ``simulate(...).demand``, accumulated in O(modes) memory.

    A batch is ``jax.vmap`` of this function (see ``use_cores``), or ``in_chunks`` for any size.
    Raises and warns as ``simulate``, of results only if all scalars are requested; a ``ValueError``
    also if temperature is not positive and finite, or ``only`` holds anything but their names.

    Parameters
    ----------
    structures, ground, grid, scheme, duration, dt
        See ``simulate``.
    temperature
        T > 0, in the unit of the gap ξ, requests ``Demand.soft_min_gap``, −T log of the mean of
        e^(−ξ/T) over the run's instants: smooth in every parameter, and between the smallest ξ of
        them (T → 0) and their mean (T → ∞), nearer to it the longer the run goes on after the
        shaking.
    only
        Flat names of the requested scalars, such as ``("min_gap", "peak_f1")``: all others
        are None, and a batch of pairs takes some 0.7 of the time. By default all.
    initial, strict
        See ``simulate``, which takes ``loads``, too.

    Examples
    --------
    >>> grid = jp.TimeGrid.until(20.0, dt=0.05)
    >>> demand = jp.demand(jp.paper.structures(), jp.paper.ground(), grid)
    >>> round(float(demand.min_gap), 3), round(float(demand.min_gap_time), 2)
    (0.304, 7.48)
    >>> float(demand.pounds)
    0.0
    """
    case = Case(structures, ground, initial)
    traceable, grid = case.prepared(grid, scheme, duration, dt, strict)
    if temperature is not None:
        temperature = number("temperature", temperature)
        if not case.structures.system().links:
            rule = "must be of gaps: there is no link"
            raise InvalidInput("temperature", str(temperature), rule)
        enforce(_temperature_rules(temperature))
    if only is not None:
        if isinstance(only, str) or not all(isinstance(name, str) for name in only) or not only:
            raise InvalidInput("only", repr(only), "must hold names of scalars")
        only = tuple(only)
    options = grid, scheme, temperature, only
    scalars = _finished(_demand(traceable, program_key(traceable), *options))
    scalars = dataclasses.replace(scalars, si=in_si(structures))
    if only is None:
        case.warn_of_results(scalars, strict)
    return scalars


def _temperature_rules(temperature: Any) -> list[Rule]:
    if temperature is None:
        return []
    holds = (temperature > 0) & finite(temperature)
    return [Rule("temperature", temperature, holds, "positive and finite")]


class Case(NamedTuple):
    """What a run is of: structures, a ground motion, loads, and the start unless all is at rest."""

    structures: Structures
    ground: Any  # as the user has it, or in a form that can be traced
    initial: InitialState | None
    loads: Any = None  # by mass

    @property
    def gravity(self) -> Any:
        """Gravity of structures in SI units, m/s²; None of dimensionless ones."""
        return gravity_of(self.structures)

    def prepared(
        self,
        grid: TimeGrid | None,
        scheme: Scheme,
        duration: float | None,
        dt: float | None,
        strict: bool,
    ) -> tuple[Case, TimeGrid]:
        """The case in a form that can be traced, and its grid; invalid input is refused."""
        note_long_compilations()
        structures, ground, initial, loads = self
        system = single_system(structures)
        instance("scheme", scheme, Scheme)
        require_ground("ground", ground)
        grid = run_grid(structures, ground, grid, scheme, duration, dt, strict)
        require_stable(structures, scheme, grid.dt)
        require_local_flow(system, scheme)
        if initial is not None:
            instance("initial", initial, InitialState)
            enforce(rules(initial, "initial: "))
            enforce(initial_rules(initial, system, grid.dt))
        traceable = as_run(ground, scheme.finest(grid), self.gravity)
        if loads is not None:
            loads = by_mass(loads, structures, grid, scheme)
        if not is_traced((structures, traceable, loads)):
            findings = unseen(ground, grid, strict=strict) + imprecise(system, grid, traceable)
            findings += unresolved(loads or {}, grid.dt)
            earlier = structures.doubts if strict and isinstance(structures, Buildings) else []
            warn(findings + earlier, strict)
        return self._replace(ground=traceable, loads=loads), grid

    def warn_of_results(self, demand: Demand, strict: bool) -> None:
        """Warn of implausible results that are not traced, or refuse them if ``strict``."""
        if is_traced((self.structures, demand)):
            return
        findings = excessive(self.ground, demand.pga / (self.gravity or 1.0), si=demand.si)
        findings += _implausible_links(self.structures.system().links, demand)
        warn(findings, strict)


def _run(
    case: Case, grid: TimeGrid, scheme: Scheme, temperature: ArrayLike | None, keep: bool
) -> tuple[System, Demand, StoredSeries | None, tuple[Contact | None, ...], list[Any]]:
    """The system in the run's dtype, scalars, series if ``keep``, and links' contact at the end.

    And by mass the shares of the motions of ground and supports that it has beside its joints'.
    """
    structures, ground, initial, loads = case
    extra = temperature, _temperature_rules
    run = Rollout.of(structures, ground, grid, scheme, *extra, keep, initial, loads)
    system, zero, temperature, n = run.system, run.zero, run.extra, grid.n_steps

    def observe(tally: Tally, now: Instant, m: jax.Array) -> tuple[Tally, StoredSeries | None]:
        if initial is not None:  # all is as it starts until then
            tally = jax.tree.map(lambda x, y: jnp.where(m <= 0, x, y), start, tally)
        tally = tally.observe(now, run.constants, system.topology, m == n, temperature)
        return tally, StoredSeries.of(now, tally, run.constants) if keep else None

    start = Tally.start(run.constants, system, zero, temperature is not None, run.start)
    (state, tally), kept = run.observed(observe, start)
    ends = contacts(run.constants, state, len(system.links))
    set_valued = scheme.friction.set_valued
    scalars = tally.demand(run.constants, system, state, ends, set_valued, temperature)
    # A run that becomes non-finite is NaN throughout as well. Multiply by NaN: ``where`` would
    # leave finite derivatives.
    is_finite = jnp.isfinite(jnp.stack(state.x)).all()
    poison = jnp.where(is_finite, 1.0, jnp.nan).astype(zero.dtype)
    results = jax.tree.map(lambda x: x * poison, (scalars, kept, ends))
    return system, *results, run.constants.with_ground


@partial(jax.jit, static_argnames=("key", "grid", "scheme", "only"))
def _demand(
    case: Case,
    key: Hashable,
    grid: TimeGrid,
    scheme: Scheme,
    temperature: ArrayLike | None,
    only: Any,
) -> Demand:
    def at(grid: TimeGrid) -> Demand:
        return _run(case, grid, scheme, temperature, keep=False)[1]

    scalars = extrapolated(at(grid), at(grid.halved)) if scheme.extrapolated else at(grid)
    if only is None:
        return scalars
    with renamed("only"):
        return scalars.only(only)


@partial(jax.jit, static_argnames=("key", "grid", "scheme", "balanced"))
def _simulate(
    case: Case, key: Hashable, grid: TimeGrid, scheme: Scheme, balanced: bool
) -> tuple[Response, jax.Array | None]:
    """The response and, if ``balanced``, the share of its energy that the balance leaves."""

    def at(grid: TimeGrid) -> Response:
        system, scalars, stored, *ends = _run(case, grid, scheme, None, keep=True)
        assert stored is not None
        return response_of(system, case.ground, grid, scheme, scalars, stored, *ends)

    response = extrapolated_response(at(grid), at(grid.halved)) if scheme.extrapolated else at(grid)
    return response, response.energy.relative_residual if balanced else None


def _implausible_links(links: Sequence[Link], demand: Demand) -> list[str]:
    """Findings in contact laws, and in gaps of dimensionless structures, by links' ends."""
    findings, places = [], link_places(cast("Topology", demand.topology))
    for place, link, ends, of_link in zip(
        places, links, link_ends(links), demand.links, strict=True
    ):
        # Without a gap no contact is meant, and what supports move is not known here.
        if is_closable(link.gap) and moving_ends(link)[0][0] >= 0:
            displacement = sum(abs(w) * demand.masses[mass].peak_x for mass, w in ends)
            if not demand.si:  # those of Buildings were judged as they were made
                findings += far_apart(f"link {place}: gap", link.gap, displacement, si=False)
            deepest = of_link.peak_penetration
            findings += too_deep(f"link {place}", deepest, displacement, si=demand.si)
    return findings


def _finished(result: Any) -> Any:
    """The result of a run; a concrete one that has failed raises."""
    scalars = result.demand if isinstance(result, Response) else result
    if is_traced(scalars) or all(np.isfinite(x).all() for x in jax.tree.leaves(scalars)):
        return result
    values = {name: getattr(scalars, name) for _, names in scalars.columns() for name in names}
    if not all(np.all(is_valid(Demand, k, x)) for k, x in values.items() if x is not None):
        raise FloatingPointError(
            "the run ended in non-finite numbers: the ground motion returns some or overflows, the "
            "temperature is too small, or the contact of a link has more events within a step than "
            "can be followed (take a smaller dt)"
        )
    return result
