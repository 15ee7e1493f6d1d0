"""Loads on masses, as a run takes them: by mass, in the form of ground motions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp

from jaxpound._checks import instance, is_whole, real
from jaxpound._errors import InvalidInput, renamed
from jaxpound.grid import TimeGrid
from jaxpound.ground.motion import DIMENSIONLESS, Ground, as_motion, records_in
from jaxpound.ground.record import Record
from jaxpound.ground.run_input import as_pytree
from jaxpound.model.system import Structures
from jaxpound.model.topology import Topology, floors
from jaxpound.simulation.scheme import Scheme


def by_mass(
    loads: Mapping[Any, Any], structures: Structures, grid: TimeGrid, scheme: Scheme
) -> dict[int, Ground]:
    """Loads by the number of their mass, each a pytree whose ``acceleration`` is the force."""
    instance("loads", loads, Mapping)
    topology, forces = structures.system().topology, dict[int, Ground]()
    for key, load in loads.items():
        name, mass = f"loads[{key!r}]", _mass(key, topology)
        if mass in forces:
            raise InvalidInput(name, "", "must be of another mass than those before it")
        if not (callable(load) or isinstance(load, Ground)):
            samples, shape = real(name, load), (grid.n_steps + 1,)
            if jnp.shape(samples) != shape:
                rule = f"must be {shape}, a number for each instant, or a function of t"
                raise InvalidInput(f"{name} of shape {jnp.shape(samples)}", "", rule)
            after = 2 * samples[-1:] - samples[-2:-1]  # the last step goes on beyond the end
            with renamed(names={"acceleration": name}):
                load = Record(jnp.concatenate([samples, after]), grid.dt, time_unit=DIMENSIONLESS)
        elif any(records_in(load)):
            rule = "must be a force, but is in g: a series of its samples in N may be one"
            raise InvalidInput(name, repr(load), rule)
        with renamed(names={"ground: acceleration(t)": f"{name}: of t"}):
            forces[mass] = as_pytree(load, scheme.finest(grid))
    return dict(sorted(forces.items()))


def unresolved(loads: Mapping[int, Ground], dt: float) -> list[str]:
    """Findings for loads that steps of dt do not resolve, of those that say so."""
    return [f"loads: {x}" for load in loads.values() for x in as_motion(load).unresolved(dt)]


def _mass(key: Any, topology: Topology) -> int:
    """The mass of a key: its number, or a building and a floor, from 0."""
    if is_whole(key) and 0 <= key < topology.n_masses:
        return int(key)
    if isinstance(key, tuple) and len(key) == 2 and all(is_whole(x) and x >= 0 for x in key):
        with renamed(names={"structures: masses": f"loads: {key}"}):
            buildings = floors(topology)
        building, floor = key
        if building < len(buildings) and floor < len(buildings[building]):
            return buildings[building][floor][0]
    rule = f"must be by (building, floor), from 0, or by a mass, from 0 to {topology.n_masses - 1}"
    raise InvalidInput(f"loads: {key!r}", "", rule)
