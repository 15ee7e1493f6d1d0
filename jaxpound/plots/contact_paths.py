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
from jaxpound.model.ends import along, elongation
from jaxpound.model.joint import groups, joints
from jaxpound.model.system import Link, System
from jaxpound.results.impacts import Impact
from jaxpound.results.response import Response
from jaxpound.simulation.contact.forces import Constants
from jaxpound.simulation.contact.local_flow import FlowProgress, advance, start, unfinished, within
from jaxpound.simulation.contact.records import APART, CLIPPED, PRESSED, Clock, Contact, FlowInput
from jaxpound.simulation.joints.coupled import Coupled, all_coupled

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
    x, masses = response.displacements, [jnp.asarray(mass.mass) for mass in response.masses]
    supports = response.supports[:0:-1]
    links = tuple(
        unchecked(
            Link,
            ends=link.ends,
            weights=link.weights,
            friction=jnp.asarray(link.slip_force - getattr(link.velocity_friction, "increase", 0)),
            gap=jnp.asarray(link.gap[0] + elongation(link, x)[0]),
            contact=link.law,
            velocity_friction=link.velocity_friction,
            inerter=None if link.inertance is None else Inerter(link.inertance),
        )
        for link in response.links
    )
    influence = [*(mass.influence for mass in response.masses), *(1.0,) * len(supports)]
    system = unchecked(System, masses=tuple(masses), rods=(), links=links, tuned=())
    free = [*response.accelerations(response.rods, [rod.force for rod in response.rods])]
    free += [support.acceleration for support in supports]
    steps: dict[tuple[int, int], np.ndarray] = {}
    for group in groups(joints(system)):
        if any(links[face.link].contact for joint in group for face in joint.faces):
            (kind,) = all_coupled([group], system, masses, influence)
            pulls = jax.vmap(kind.pull)(free, response.ground_acceleration)
            closings = jnp.stack([along(joint.path, x) for joint in group], -1)
            for m, points in _flows(response, kind, closings, pulls):
                steps |= {(k, m): points[:, :, j].T for j, k in enumerate(kind.of[0].links)}
    return steps


def _flows(
    response: Response, kind: Coupled, closings: Any, pulls: Any
) -> Iterator[tuple[int, np.ndarray]]:
    """Numbers of the instants before contact, and the paths to the next, (points, 3, g).

    ``closings`` and ``pulls`` are of the n joints of a group, (time, n). A substep ends where a
    force is largest and where it jumps, with two points at the same time.
    """
    time, h = response.time, float(response.time[1] - response.time[0])

    def series(name: str, links: Sequence[int]) -> np.ndarray:
        return np.stack([np.asarray(getattr(response.links[k], name)) for k in links], -1)

    gaps, sizes = kind.of[0].links, np.asarray(kind.coupling.sizes)
    velocity = series("slip_velocity", [joint.link for joint in kind.of[0].joints])
    depth, force = -series("gap", gaps), series("contact", gaps)
    modes = np.where(depth <= 0, APART, np.where(force == 0, CLIPPED, PRESSED))
    met, none = series("touching", gaps).max(-1), np.zeros(len(gaps))
    contact = Contact(*(jnp.asarray(none),) * len(Contact._fields))
    for m in np.flatnonzero(np.maximum(met[1:], met[:-1])).tolist():
        contact = contact._replace(mode=jnp.asarray(modes[m]))
        pull, rise = (pulls[m] + pulls[m + 1]) / 2, pulls[m + 1] - pulls[m]
        inputs = FlowInput(closings[m], velocity[m], pull, rise, kind.coupling, contact)
        step = partial(_advance, h, inputs)
        x, goes_on, _ = step(None)
        substeps = []
        while goes_on:
            x, goes_on, points = step(x)
            substeps.append(points)
        contact = x.now.contact
        points = np.concatenate(substeps) + np.stack([none + time[m], -sizes, none])
        share, ended = (points[:, 0] - time[m]) / h, points[-1, 1:]
        missing = np.zeros_like(ended)  # also where a gap is infinite
        np.subtract([depth[m + 1], force[m + 1]], ended, missing, where=ended[1] * force[m + 1] > 0)
        points[:, 1:] += share[:, None] * missing[None]
        yield m, points


@partial(jax.jit, static_argnums=0)
def _advance(
    h: float, inputs: FlowInput, x: FlowProgress | None
) -> tuple[FlowProgress, jax.Array, jax.Array]:
    """The state after a substep is tried, whether more follow, and the points as far as it went."""
    zero = 0 * inputs.closing[0]
    constants = Constants.of(h, 0, inputs, Clock(zero, zero, zero > 0))
    before, after = (start(constants),) * 2 if x is None else (x, advance(constants, x))
    times = jnp.linspace(0.0, 1.0, _POINTS) * (after.now.y.t - before.now.y.t)

    def point(time: jax.Array) -> jax.Array:
        return jnp.stack(jnp.broadcast_arrays(*within(constants, before, time)))

    return after, unfinished(constants, after), jax.vmap(point)(times)
