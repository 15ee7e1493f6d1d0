"""The path of links between two instants, by the local flow."""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound.simulation.contact.events import FlowState
from jaxpound.simulation.contact.local_flow import LocalFlow
from jaxpound.simulation.contact.records import Clock, Contact, FlowInput

_POINTS = 9  # of each substep


def path_of_step(h: float, inputs: FlowInput, faces: tuple[int, ...]) -> tuple[np.ndarray, Contact]:
    """Times from the start, closings and contact forces, (points, 3, f), and contact at the end.

    A substep ends where a force is largest and where it jumps, with two points at the same time.
    """
    x, unfinished = _advance(faces, h, inputs, None)[:2]
    points = []
    while unfinished:
        x, unfinished, of_substep = _advance(faces, h, inputs, x)
        points.append(np.asarray(of_substep))
    return np.concatenate(points), x.contact


@partial(jax.jit, static_argnums=(0, 1))
def _advance(
    faces: tuple[int, ...], h: float, inputs: FlowInput, x: FlowState | None
) -> tuple[FlowState, jax.Array, jax.Array]:
    """The state after a substep is tried, whether more follow, and the points as far as it went.

    Without a state, the one in which the flow starts.
    """
    zero = 0 * inputs.closing[0]
    local = LocalFlow(h, 0, faces, inputs, Clock(zero, zero, zero > 0))
    before, after = (local.start(),) * 2 if x is None else (x, local.advance(x))
    times = jnp.linspace(0.0, 1.0, _POINTS) * (after.y[0, 0] - before.y[0, 0])
    return after, local.unfinished(after), jax.vmap(partial(local.within, before))(times)
