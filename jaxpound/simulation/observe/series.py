"""The series of a run: what the scan stores, and the ``Response`` made of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jaxpound.grid import TimeGrid
from jaxpound.ground.motion import Ground, as_motion
from jaxpound.ground.supports import at_support
from jaxpound.model.contact import Newton
from jaxpound.model.ends import WeightedEnds, link_ends
from jaxpound.model.system import Link, System
from jaxpound.model.topology import WeightedMasses
from jaxpound.results.demand import Demand
from jaxpound.results.impacts import MOST, ImpactSeries
from jaxpound.results.response import (
    LinkResponse,
    MassResponse,
    Response,
    RodResponse,
    SupportResponse,
)
from jaxpound.simulation.constants import StepConstants
from jaxpound.simulation.contact.records import Contact, Impacts, is_deformed
from jaxpound.simulation.observe.tally import Tally
from jaxpound.simulation.scheme import Scheme
from jaxpound.simulation.state import Instant


class StoredSeries(NamedTuple):
    """Series that the scan stores; all others are computed from them afterwards."""

    x: tuple[Any, ...]
    v: tuple[Any, ...]
    forces: tuple[Any, ...]
    damping: tuple[Any, ...] | None  # forces on masses
    loads: tuple[Any, ...] | None
    dissipated: tuple[Any, ...]  # energy, by each rod that yields
    links: tuple[dict[str, Any], ...]  # closing, and the entries of a ``LinkResponse``
    impacts: tuple[Impacts | None, ...]  # that ended in each step, for each link that may touch

    @staticmethod
    def of(now: Instant, tally: Tally, constants: StepConstants) -> StoredSeries:
        """The entries of an instant."""
        links, impacts = [], []
        for link, tallied in zip(now.links, tally.links, strict=True):
            entries = {
                "closing": link.closing,
                "slip_velocity": link.velocity,
                "friction": link.friction,
                "phase": link.phase,
                "change_time": now.time + link.change_time,
                "inertia": link.inertia,
            }
            impact = None
            if (contact := tallied.contact) is not None and link.gap is not None:
                entries |= {
                    "contact": link.gap.force,
                    "touching": link.gap.log.touched,
                    "contact_stored": contact.stored_now,
                    "contact_lost": contact.lost_now,
                    "slid": contact.slid,
                }
                impact = jax.tree.map(tuple, link.gap.log.impacts)
            links.append(entries)
            impacts.append(impact)
        rods = zip(constants.rods, now.rods, strict=True)
        dissipated = tuple(law.dissipated(rod.state) for law, rod in rods)
        series = now.x, now.v, now.forces, now.damping, now.loads, dissipated
        return StoredSeries(*series, tuple(links), tuple(impacts))


def response_of(
    system: System,
    ground: Ground,
    grid: TimeGrid,
    scheme: Scheme,
    scalars: Demand,
    stored: StoredSeries,
    ends: Sequence[Contact | None],
    with_ground: Sequence[Sequence[Any]],
) -> Response:
    """The response from the stored series; ``ends`` are the links' contacts at the end.

    ``with_ground`` are shares of the ground's motion, and of those of supports, that masses have
    beside their joints'.
    """
    rest, paths, n = 0 * stored.forces[0], link_ends(system.links), len(system.masses)
    # The scan does not store series that follow from others; those of an invalid run are NaN.
    time = jnp.asarray(grid.times(), rest.dtype)
    motion = as_motion(ground).velocity_and_bulge(time, grid.dt)
    ground_velocity, bulge = (y.astype(rest.dtype) for y in motion)
    # A free mass's velocity is the mean of those half a step away. The ground's mean there exceeds
    # the ground velocity now by the bulge, which is added; but not as the run starts. What moves
    # with a support has the bulge of its motion, too.
    supports = [at_support(ground, k) for k in range(system.topology.n_supports, 0, -1)]
    own = [as_motion(y).velocity_and_bulge(time, grid.dt)[1].astype(rest.dtype) for y in supports]
    bulges = [y.at[0].set(0) for y in (bulge, *(-y for y in own))]
    v = list(stored.v)
    for shares, y in zip(with_ground, bulges, strict=True):
        v = [of_mass + share * y for of_mass, share in zip(v, shares, strict=True)]
    acceleration = _acceleration(ground, time, rest)
    series = [SupportResponse(rest, rest, acceleration)]
    for k, motion_there in enumerate(reversed(supports), 1):
        moved = stored.x[-k], v[-k], _acceleration(motion_there, time, rest)
        series.append(SupportResponse(*moved))
    damping, loads = (y or (None,) * n for y in (stored.damping, stored.loads))
    numbers = zip(
        stored.x[:n], v[:n], system.masses, system.influences, damping, loads, strict=True
    )
    return Response(
        time=time + rest,
        ground_acceleration=acceleration,
        ground_velocity=ground_velocity + rest,
        masses=tuple(
            MassResponse(x, v, mass + rest[0], *others) for x, v, mass, *others in numbers
        ),
        rods=tuple(
            RodResponse(force, ends, dissipated, rod.weights)
            for force, ends, dissipated, rod in zip(
                stored.forces, system.topology.rods, stored.dissipated, system.rods, strict=True
            )
        ),
        links=tuple(
            _link_response(
                link, paths[k], stored.links[k], stored.impacts[k], ends[k], time[-1] + rest[0]
            )
            for k, link in enumerate(system.links)
        ),
        supports=tuple(series) if supports else (),
        demand=scalars,
        method=f"{scheme.friction}, order {scheme.order}, {scheme.history}"
        + scheme.extrapolated * ", extrapolated",
    )


def _acceleration(ground: Ground, time: jax.Array, rest: jax.Array) -> jax.Array:
    """Ground acceleration u'' at the instants."""
    return jax.vmap(ground.acceleration)(time).astype(rest.dtype) + rest


def _link_response(
    link: Link,
    path: WeightedEnds,
    series: dict[str, Any],
    ended: Impacts | None,
    end: Contact | None,
    last: jax.Array,
) -> LinkResponse:
    """The series of a link, whose ``path`` closes its gap.

    They follow from the impacts that ended in each step and the last instant.
    """
    fast = link.velocity_friction
    slip_force = link.friction if fast is None else link.friction + fast.increase
    entries = dict(series, slip_force=slip_force + 0 * last, velocity_friction=fast)
    entries["ends"] = link.ends
    if isinstance(link.ends, WeightedMasses):
        entries["weights"] = tuple(weight for _, weight in path)
    if link.inerter is not None:
        entries["inertance"] = link.inerter.inertance + 0 * last
    entries["gap"] = link.gap - entries.pop("closing")
    if ended is None or end is None:
        return LinkResponse(**entries)
    slid = entries.pop("slid")
    passed = Impacts(*[jnp.stack(slots, -1).ravel() for slots in ended])
    never, acts = jnp.nan * last, is_deformed(end.mode) & (end.counts > 0)
    unfinished = Impacts(
        touch_time=end.touch_time,
        approach_velocity=jnp.where(acts, end.touch_speed, 0.0),
        end_time=never,
        rebound_velocity=never,
        impulse=end.impulse,
        peak_force=end.peak_force,
    )
    impacts = jax.tree.map(jnp.append, passed, unfinished)
    if isinstance(link.contact, Newton):
        impacts = impacts._replace(peak_force=jnp.full_like(impacts.peak_force, jnp.inf))
    is_impact = impacts.approach_velocity > 0
    (numbers,) = jnp.nonzero(is_impact, size=min(MOST, is_impact.size), fill_value=is_impact.size)
    kept = jax.tree.map(lambda x: jnp.append(x, jnp.nan)[numbers], impacts)
    fields = kept._asdict()
    return LinkResponse(
        friction_work=None if link.velocity_friction else link.friction * slid,
        impacts=ImpactSeries(fields.pop("touch_time"), fields.pop("end_time"), **fields),
        law=None if isinstance(link.contact, Newton) else link.contact,
        **entries,
    )
