"""What is observed of structures at one instant of a run, for its derivatives."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import ArrayLike

from jaxpound.grid import TimeGrid
from jaxpound.ground.motion import Ground, GroundLike
from jaxpound.ground.run_input import as_run
from jaxpound.model.ends import load_on
from jaxpound.model.system import Structures, gravity_of
from jaxpound.model.topology import Topology
from jaxpound.simulation.constants import StepConstants
from jaxpound.simulation.rollout import Rollout, extrapolated, program_key
from jaxpound.simulation.scheme import Scheme
from jaxpound.simulation.state import Instant


class Observer(NamedTuple):
    """What is observed of structures at an instant."""

    of: Callable[[StepConstants, Instant], tuple[Any, ...]]
    size: Callable[[Topology], int]  # of the numbers


def _positions(system: StepConstants, now: Instant) -> tuple[Any, ...]:
    return *now.x, *(link.closing for link in now.links)


def _accelerations(system: StepConstants, now: Instant) -> tuple[Any, ...]:
    """Absolute acceleration x'' + ι u'' of each mass at an instant."""
    ends, forces = list(system.rod_ends), [*now.forces]
    for group, seen in zip(system.groups, now.groups, strict=True):
        ends += [joint.ends for joint in group.joints]
        forces += seen.totals
    masses = enumerate(system.masses)
    return tuple(load_on(number, ends, forces) / mass for number, mass in masses)


POSITIONS = Observer(_positions, lambda topology: topology.n_masses + len(topology.links))
"""Displacement of each mass, and the closing of each link: its gap at rest less its gap."""

ACCELERATIONS = Observer(_accelerations, lambda topology: topology.n_masses)
"""Absolute acceleration x'' + u'' of each mass."""

ROD_FORCES = Observer(lambda system, now: now.forces, lambda topology: len(topology.rods))
"""Force of each rod."""


def observed_at(
    observer: Observer,
    structures: Structures,
    ground: GroundLike,
    grid: TimeGrid,
    scheme: Scheme,
    instant: ArrayLike,
) -> tuple[Any, ...]:
    """What is observed at the instant with a number, from 0 to n_steps, which may be traced.

    It suits many derivatives: a run keeps no series and observes nothing else. It does not check
    the input (``demand`` does); an invalid run gives NaN.
    """
    ground = as_run(ground, scheme.finest(grid), gravity_of(structures))
    case = structures, ground
    return _observed_at(observer, case, program_key(case), grid, scheme, jnp.asarray(instant))


@partial(jax.jit, static_argnames=("observer", "key", "grid", "scheme"))
def _observed_at(
    observer: Observer,
    case: tuple[Structures, Ground],
    key: Hashable,
    grid: TimeGrid,
    scheme: Scheme,
    number: Any,
) -> tuple[Any, ...]:
    def observed(grid: TimeGrid, instant: Any) -> tuple[Any, ...]:
        run = Rollout.of(*case, grid, scheme)

        def observe(kept: Any, now: Instant, m: jax.Array) -> tuple[Any, None]:
            seen = observer.of(run.constants, now)
            kept = jax.tree.map(lambda old, new: jnp.where(m == instant, new, old), kept, seen)
            return kept, None

        before = (run.zero,) * observer.size(run.system.topology)
        (_, kept), _ = run.observed(observe, before)
        return kept

    if not scheme.extrapolated:
        return observed(grid, number)
    return extrapolated(observed(grid, number), observed(grid.halved, 2 * number))
