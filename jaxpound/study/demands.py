"""The demands of a scenario by name, and what is doubtful in a study before and after its runs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound._checks import count, evaluated, instance
from jaxpound.grid import TimeGrid
from jaxpound.ground.motion import GroundLike
from jaxpound.ground.plausibility import far_apart
from jaxpound.model.places import link_places
from jaxpound.model.system import Structures
from jaxpound.model.topology import Topology, WeightedMasses, masses_of
from jaxpound.results.elements import of_link
from jaxpound.results.named import all_demands
from jaxpound.scenarios.scenarios import ScenarioSet
from jaxpound.simulation.run import demand
from jaxpound.simulation.scheme import Scheme, imprecise, single_system


def demands_of(
    structures: Structures, ground: GroundLike, grid: TimeGrid, scheme: Scheme
) -> dict[str, Any]:
    """``all_demands`` of a run by name."""
    return all_demands(structures.system(), demand(structures, ground, grid, scheme))


def doubts(scenarios: ScenarioSet, grid: TimeGrid, scheme: Scheme = Scheme()) -> list[str]:
    """``imprecise`` of the structures of scenarios; a ``ValueError`` if they are a batch.

    Or if an argument is of another type.
    """
    instance("scenarios", scenarios, ScenarioSet)
    count("scenarios.dimension", scenarios.dimension)
    instance("grid", grid, TimeGrid)
    instance("scheme", scheme, Scheme)
    findings: list[str] = []

    def look(z: jax.Array) -> None:
        structures = scenarios.realize(z)[0]
        with evaluated(structures):
            findings.extend(imprecise(single_system(structures), grid, z))

    jax.eval_shape(look, jnp.zeros(scenarios.dimension))
    return findings


def unreached(
    topology: Topology, extremes: Mapping[str, tuple[float, float]], *, si: bool
) -> list[str]:
    """Findings: gaps out of proportion to the displacements of a whole study.

    ``extremes`` are the smallest and the largest number of each column (of an infinite gap NaN or
    infinite).
    """
    findings = []
    for k, (ends, place) in enumerate(zip(topology.links, link_places(topology), strict=True)):
        gap, _ = extremes.get(of_link("min_gap", k, len(topology.links)), (np.inf, np.inf))
        if np.isfinite(gap) and not isinstance(ends, WeightedMasses):
            moved = sum(extremes[f"peak_x{mass + 1}"][1] for mass in masses_of(ends))
            findings += far_apart(f"link {place}: gap", gap, moved, si=si)
    return findings
