"""The contact of a run within its steps, which may be longer than an impact."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound._fields import unchecked
from jaxpound.model.dampers import Inerter
from jaxpound.model.system import Link, System
from jaxpound.model.topology import elongation, link_groups
from jaxpound.results.impacts import Impact
from jaxpound.results.response import LinkResponse, Response
from jaxpound.simulation.contact.events import FlowState
from jaxpound.simulation.contact.forces import Constants
from jaxpound.simulation.contact.group import Coupling, coupling
from jaxpound.simulation.contact.local_flow import advance, start, unfinished, within
from jaxpound.simulation.contact.records import (
    APART,
    CLIPPED,
    PRESSED,
    Clock,
    Contact,
    FlowInput,
    Gaps,
)
from jaxpound.simulation.inertance import Inerters
from jaxpound.simulation.state import StepConstants

_POINTS = 9  # of each substep


class ContactPath(NamedTuple):
    """Contact of a link, also within the steps: (points,) each, with a leading axis of a batch."""

    time: Any
    penetration: Any
    force: Any


def followed_contacts(response: Response) -> dict[int, ContactPath]:
    """The contact of each link with a law of it, by the link's number.

    From an instant to the next it is that of the local flow, under a pull that changes linearly,
    bent to end where the run is then and to reach the largest force of each impact. A law without a
    force, or of unknown units, has only the instants.
    """
    if response.batch:
        runs = [followed_contacts(response[i]) for i in np.ndindex(response.batch)]
        most = max((path.time.size for run in runs for path in run.values()), default=0)

        def together(*series: np.ndarray) -> np.ndarray:
            padded = [np.pad(y, (0, most - y.size), "edge") for y in series]
            return np.reshape(padded, (*response.batch, most))

        return jax.tree.map(together, *runs)
    time, steps, paths = np.asarray(response.time), _steps(response), {}
    for k, link in enumerate(response.links):
        if link.contact is not None:
            instants = np.stack([time, -np.asarray(link.gap), np.asarray(link.contact)])
            parts = [
                steps.get((k, m), instants[:, [m]])
                for m in range(time.size)
                if (k, m) in steps or (k, m - 1) not in steps
            ]
            times, depth, force = np.concatenate(parts, axis=1)
            for hit in response.impacts(k) if link.law is not None else ():
                _reach(hit, times, force, time)
            paths[k] = ContactPath(times, np.maximum(depth, 0.0), force)
    return paths


def _reach(hit: Impact, times: np.ndarray, force: np.ndarray, instants: np.ndarray) -> None:
    """Change the largest force of an impact, and those about it between the instants, to its."""
    within = (times >= hit.time) & ~(times > hit.end)
    if np.isfinite(hit.peak_force) and force[within].any():
        largest, at = force[within].max(), times[within][force[within].argmax()]
        before = instants[instants < at].max(initial=hit.time)
        after = instants[instants > at].min(initial=times[-1])
        near = np.interp(times[within], [before, at, after], [0.0, 1.0, 0.0])
        bent = force[within] * (1 + near * (hit.peak_force / largest - 1))
        force[within] = np.minimum(bent, hit.peak_force)


def _steps(response: Response) -> dict[tuple[int, int], np.ndarray]:
    """Times, penetrations and forces, (3, points), by link and number of the instant before."""
    topology, masses = response.topology, tuple(mass.mass for mass in response.masses)
    x, inverse = [mass.x for mass in response.masses], tuple(1 / jnp.asarray(m) for m in masses)
    links = tuple(
        unchecked(
            Link,
            ends=link.ends,
            friction=link.slip_force - getattr(link.velocity_friction, "increase", 0.0),
            gap=link.gap[0] + elongation(link.ends, x)[0],
            contact=link.law,
            velocity_friction=link.velocity_friction,
            inerter=None if link.inertance is None else Inerter(link.inertance),
        )
        for link in response.links
    )
    inerters = Inerters.of(unchecked(System, masses=masses, rods=(), links=links), inverse)
    constants = StepConstants(topology, inverse, (), (), (), {}, inerters, 0)
    loads = topology.loads([rod.force for rod in response.rods])
    pulls = jax.vmap(constants.link_pulls)(loads, response.ground_acceleration)
    steps: dict[tuple[int, int], np.ndarray] = {}
    for group in link_groups(topology):
        if any(links[k].contact for k in group.links):
            coupled, _ = coupling(topology, group, links, inverse, inerters)
            closing = np.stack([elongation(links[k].ends, x) for k in group.links], -1)
            responses = [response.links[k] for k in group.links]
            motion = response.time, closing, np.stack([pulls[k] for k in group.links], -1)
            numbers = [group.links[j] for j in coupled.with_law]
            for m, points in _flows(motion, responses, coupled, group.faces):
                steps |= {(k, m): points[:, :, j].T for j, k in enumerate(numbers)}
    return steps


def _flows(
    motion: tuple[Any, Any, Any],
    links: Sequence[LinkResponse],
    group: Coupling,
    faces: tuple[int, ...],
) -> Iterator[tuple[int, np.ndarray]]:
    """Numbers of the instants before contact, and the paths to the next, (points, 3, g).

    ``motion`` are times, and closings and pulls of the links, (n, f). A substep ends where a force
    is largest and where it jumps, with two points at the same time.
    """
    time, closing, pull = motion

    def series(name: str) -> np.ndarray:
        columns = (getattr(link, name) for link in links)
        return np.stack([np.zeros(len(time)) if y is None else y for y in columns], -1)

    gap, velocity, forces = series("gap"), series("slip_velocity"), series("contact")
    modes = np.where(gap >= 0, APART, np.where(forces == 0, CLIPPED, PRESSED))
    met, with_law = series("touching").max(-1), group.with_law
    sizes = group.by_gap(group.gaps)
    depth, force = -gap[:, with_law], forces[:, with_law]
    none: Any = np.zeros(sizes.size)  # not 0 times the sizes, which may be infinite
    contact = Contact(*(none,) * len(Contact._fields))
    h = float(time[1] - time[0])
    for m in np.flatnonzero(np.maximum(met[1:], met[:-1])).tolist():
        pulls = (pull[m] + pull[m + 1]) / 2, pull[m + 1] - pull[m]
        contact = contact._replace(mode=jnp.asarray(modes[m, with_law]))
        inputs = group.flow_input((closing[m], velocity[m], *pulls), contact)
        step = partial(_advance, group.sides(faces), h, inputs)
        x, goes_on, _ = step(None)
        substeps = []
        while goes_on:
            x, goes_on, points = step(x)
            substeps.append(points)
        contact = x.contact
        points = np.concatenate(substeps) + np.stack([none + time[m], -sizes, none])
        share, ended = (points[:, 0] - time[m]) / h, points[-1, 1:]
        missing = np.zeros_like(ended)  # also where a gap is infinite
        np.subtract([depth[m + 1], force[m + 1]], ended, missing, where=ended[1] * force[m + 1] > 0)
        points[:, 1:] += share[:, None] * missing[None]
        yield m, points


@partial(jax.jit, static_argnums=(0, 1))
def _advance(
    gaps: Gaps, h: float, inputs: FlowInput, x: FlowState | None
) -> tuple[FlowState, jax.Array, jax.Array]:
    """The state after a substep is tried, whether more follow, and the points as far as it went."""
    zero = 0 * inputs.closing[0]
    constants = Constants.of(h, 0, gaps, inputs, Clock(zero, zero, zero > 0))
    before, after = (start(constants),) * 2 if x is None else (x, advance(constants, x))
    times = jnp.linspace(0.0, 1.0, _POINTS) * (after.y.t - before.y.t)

    def point(time: jax.Array) -> jax.Array:
        return jnp.stack(jnp.broadcast_arrays(*within(constants, before, time)))

    return after, unfinished(constants, after), jax.vmap(point)(times)
