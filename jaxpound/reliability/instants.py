"""Series whose largest number over the run is the demand: a limit state for every instant.

At an instant a demand is a smooth function of the ground motion, so that gradients lead to its
design point; the largest number of all instants is not smooth.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jaxpound.grid import TimeGrid
from jaxpound.ground.motion import GroundLike
from jaxpound.ground.run_input import as_run
from jaxpound.model.ends import along, load_on, moving_ends
from jaxpound.model.places import link_places, mass_places, rod_places
from jaxpound.model.system import Structures, System, gravity_of, is_closable
from jaxpound.model.topology import storey_rods
from jaxpound.results.demand import OF_CONTACTS, OF_FLOORS, Demand
from jaxpound.results.elements import place_of
from jaxpound.results.named import REQUIRED_GAP
from jaxpound.simulation.constants import StepConstants
from jaxpound.simulation.rollout import Rollout, extrapolated
from jaxpound.simulation.scheme import Scheme
from jaxpound.simulation.state import Instant

_PERIOD = 2 * np.pi  # of structure 1, in 1/ω1
_PER_PERIOD = 20
_MOST = 256


def _accelerations(system: StepConstants, now: Instant) -> tuple[Any, ...]:
    """Absolute acceleration x'' + ι u'' of each mass at an instant."""
    ends, forces = list(system.rod_ends), [*now.forces]
    for group, seen in zip(system.groups, now.groups, strict=True):
        ends += [joint.ends for joint in group.joints]
        forces += seen.totals
    loads = [load_on(number, ends, forces) for number in range(len(system.masses))]
    if (more := now.on_masses) is not None:
        loads = [load + other for load, other in zip(loads, more, strict=True)]
    return tuple(load / mass for load, mass in zip(loads, system.masses, strict=True))


_OBSERVERS: dict[str, Any] = {  # by kind the numbers at an instant, and how many there are
    # Displacement of each mass and support, and the closing of each link: its gap at rest less its
    # gap.
    "length": (
        lambda system, now: (*now.x, *(x.closing for x in now.links)),
        lambda topology: topology.n_masses + topology.n_supports + len(topology.links),
    ),
    "acceleration": (_accelerations, lambda topology: topology.n_masses),
    "force": (lambda system, now: now.forces, lambda topology: len(topology.rods)),
}


class Series(NamedTuple):
    """A linear combination of the numbers of an observer at an instant."""

    words: str  # its quantity and place: "drift, storey 2 of building 1"
    row: np.ndarray
    """Factors of the displacement of each mass and, from the last on, support, each link's closing
    and each link's gap at rest, or of each mass's acceleration, or of each rod's force."""
    kind: str = "length"  # or "acceleration" or "force", the same for all series of a demand


def is_by_impacts(system: System, demand: Any) -> bool:
    """Whether impacts make a demand: one of contact, or an acceleration where blocks may meet.

    Before blocks meet the force of an impact is 0, and so is its slope; and an impact may fall
    between the chosen instants.
    """
    if not isinstance(demand, str) or all(link.contact is None for link in system.links):
        return False
    place = place_of(Demand, demand)
    if place is None:
        return demand == "peak_acceleration"
    by_contact = ("contact", "column", "capacity")
    return place.field == "peak_acceleration" or place.quantity.only in by_contact


def series_of(system: System, demand: Any, pounding: bool) -> tuple[Series, ...]:
    """The series whose largest number is a demand; none of a function, or without an instant.

    Those of a demand that impacts make are overlaps of blocks that pass through each other. If
    ``pounding``, a closing counts beyond the link's own gap at rest.
    """
    if not isinstance(demand, str):
        return ()
    topology, links, place = system.topology, system.links, place_of(Demand, demand)
    masses, rods = mass_places(topology), rod_places(topology)
    n, m, field = topology.n_masses, len(links), demand if place is None else place.field
    n_moved = n + topology.n_supports
    displacements, closings, gaps = np.split(np.eye(n_moved + 2 * m), [n_moved, n_moved + m])

    def elements(group: str, n_all: int) -> Iterable[int]:
        """Numbers of the elements that the demand is of."""
        alone = place is not None and place.group == group and demand not in OF_CONTACTS
        floors = zip(OF_FLOORS, (storey_rods(topology), topology.floor_masses), strict=True)
        return [place.element] if alone and place else dict(floors).get(demand, range(n_all))

    by_impacts = is_by_impacts(system, demand)
    if demand == REQUIRED_GAP or by_impacts:
        pounding |= by_impacts
        quantity, places = "overlap" if pounding else "closing", link_places(topology)
        return tuple(
            Series(f"{quantity}, {places[k]}", closings[k] - pounding * gaps[k])
            for k in elements("links", m)
            if is_closable(links[k].gap) and not (by_impacts and links[k].contact is None)
        )
    if field == "peak_opening":
        joints = [k for k in elements("links", m) if is_closable(links[k].gap)]
        places = link_places(topology)
        return tuple(Series(f"opening, {places[k]}", -closings[k]) for k in joints)
    drifts = [along(moving_ends(rod), [*displacements]) for rod in system.rods]
    factors: dict[str, tuple[str, str, tuple[str, ...], Any, str]] = {
        "peak_drift": ("drift", "rods", rods, drifts, "length"),
        "peak_x": ("displacement", "masses", masses, displacements[:n], "length"),
        "peak_force": ("force", "rods", rods, np.eye(len(rods)), "force"),
        "peak_acceleration": ("acceleration", "masses", masses, np.eye(n), "acceleration"),
    }
    if field not in factors:
        return ()
    quantity, group, places, rows, kind = factors[field]
    return tuple(
        Series(f"{quantity}, {places[i]}{direction}", sign * rows[i], kind)
        for i in elements(group, len(places))
        for direction, sign in (("", 1), (", reversed", -1))
    )


def observed_at(
    kind: str,
    structures: Structures,
    ground: GroundLike,
    grid: TimeGrid,
    scheme: Scheme,
    instant: ArrayLike,
) -> tuple[Any, ...]:
    """What series of a kind combine, at the instant with a number from 0 to n_steps, or traced.

    It suits many derivatives: a run keeps no series and observes nothing else. It is to be part of
    a compiled program, and does not check the input (``demand`` does); an invalid run gives NaN.
    """
    ground = as_run(ground, scheme.finest(grid), gravity_of(structures))
    numbers, size = _OBSERVERS[kind]

    def observed(grid: TimeGrid, instant: Any) -> tuple[Any, ...]:
        run = Rollout.of(structures, ground, grid, scheme)

        def observe(kept: Any, now: Instant, m: jax.Array) -> tuple[Any, None]:
            seen = numbers(run.constants, now)
            kept = jax.tree.map(lambda old, new: jnp.where(m == instant, new, old), kept, seen)
            return kept, None

        before = (run.zero,) * size(run.system.topology)
        (_, kept), _ = run.observed(observe, before)
        return kept

    if not scheme.extrapolated:
        return observed(grid, instant)
    return extrapolated(observed(grid, instant), observed(grid.halved, 2 * jnp.asarray(instant)))


def measured(kind: str, row: Any, observed: tuple[Any, ...], system: System) -> Float[Array, ""]:
    """The value of a series, given by its kind and ``row``, at an instant; traceable."""
    gaps = [jnp.where(jnp.isfinite(link.gap), link.gap, 0.0) for link in system.links]
    return row @ jnp.stack([*observed, *(gaps if kind == "length" else [])])


def chosen_instants(n_steps: int, dt: float, n_series: int) -> np.ndarray:
    """Numbers of the instants at which design points are sought, the last being the run's end."""
    most = min(int(np.ceil(n_steps * dt * _PER_PERIOD / _PERIOD)), _MOST)
    n = max(1, min(n_steps, max(most // max(1, n_series), 16)))
    return np.round(np.arange(1, n + 1) * n_steps / n).astype(int)
