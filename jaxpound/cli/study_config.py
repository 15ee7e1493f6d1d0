"""What ``jaxpound montecarlo`` is told in a TOML file: buildings, earthquakes, uncertainty; SI."""

from __future__ import annotations

import dataclasses
from functools import partial
from pathlib import Path
from statistics import NormalDist
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound.cli.config import PAIR, Keys, in_si, named, require_plausible, shown
from jaxpound.cli.earthquake_config import (
    EARTHQUAKES,
    distribution,
    drawn,
    flag,
    opened,
    require_reach,
    scaled,
)
from jaxpound.cli.examples import STUDY as EXAMPLE
from jaxpound.grid import TimeGrid
from jaxpound.ground.intensity import spectral_acceleration
from jaxpound.ground.motion import GroundLike
from jaxpound.model import parameters
from jaxpound.model.structures import AdjacentStructures
from jaxpound.quantities import RANGES
from jaxpound.simulation.scheme import Scheme
from jaxpound.study.chunk import Measure
from jaxpound.study.distributions import RARE, Distribution
from jaxpound.study.random_structures import UncertainStructures
from jaxpound.study.scenarios import Scenarios
from jaxpound.units import Scales

_KEYS: Keys = PAIR | {
    "earthquakes": EARTHQUAKES,
    "uncertain": dict.fromkeys(parameters.paths(AdjacentStructures), distribution),
    "study": {
        "samples": RANGES["count"],
        "seed": RANGES["seed"],
        "sampling": ("plain", "sobol"),
        "chunk_size": RANGES["count"],
        "keep_failures": flag,
        "spectral_acceleration": flag,
    },
}


@dataclasses.dataclass(frozen=True)
class StudyConfiguration:
    """A Monte Carlo study of two buildings in SI units; ``text`` is the file's."""

    source: str
    text: str
    scenarios: Scenarios
    scales: Scales
    grid: TimeGrid
    scheme: Scheme
    samples: int
    seed: int
    sampling: str
    chunk_size: int | None
    keep_failures: bool
    measures: dict[str, Measure]


def read_study(path: Path | None) -> StudyConfiguration:
    """Read and check the configuration of a study, or the example if ``path`` is None.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        As ``config.read_config``, and for a record that it names and that cannot be read.
    """
    read = opened(path, "study", EXAMPLE, _KEYS, by_field="uncertain")
    source, given, structures, grid = read.source, read.given, read.structures, read.grid()
    study = given.get("study", {})
    uncertain = _uncertain(source, given, structures, read.scales)
    if not (uncertain or read.ground.dimension):
        rule = "[uncertain], a factor on the record, or several records"
        raise ValueError(f"{source}: nothing is random; it must have {rule}")
    scenarios = Scenarios(uncertain or structures, read.ground)
    measures: dict[str, Measure] = {}
    if study.get("spectral_acceleration", False):
        gravity = float(read.scales.gravity)
        for i in (0, 1):
            measure = partial(_spectral_acceleration, grid, i, gravity)
            measures[f"spectral_acceleration_{i + 1}"] = measure
    return StudyConfiguration(
        source,
        read.text,
        scenarios,
        read.scales,
        grid,
        read.scheme,
        study.get("samples", 10_000),
        study.get("seed", 0),
        study.get("sampling", "plain"),
        study.get("chunk_size"),
        study.get("keep_failures", False),
        measures,
    )


def _uncertain(
    source: str, given: dict[str, Any], structures: AdjacentStructures, scales: Scales
) -> UncertainStructures | None:
    """The uncertain structures; in the file distributions are of factors on what it states."""
    if not (table := given.get("uncertain")):
        return None
    physical = in_si(structures, scales)
    made: dict[str, dict[str, Distribution]] = {"SI": {}, "dimensionless": {}}
    for path in table:
        place, factor = f"{source}: [uncertain] {path}", drawn(source, given, "uncertain", path, "")
        require_reach(f"{source}: [uncertain] {path}", table[path], factor, RANGES["multiple"])
        for units, nominal in (("SI", physical), ("dimensionless", structures)):
            value = float(parameters.get(nominal, path))
            if not value:
                raise ValueError(f"{place} must be of a value above 0, for factors on it")
            with named(f"{place}:"):
                made[units][path] = scaled(factor, value)
    with named(f"{source}: [uncertain], in SI units:"):
        drawn_in_si = UncertainStructures(physical, made["SI"])
    # Each at its two ends, the others at their medians.
    z = NormalDist().inv_cdf(RARE)
    ends = np.array([z, -z])[:, None, None] * np.eye(len(table))
    rows = jax.jit(jax.vmap(jax.vmap(drawn_in_si.parameters)))(ends)
    extremes = []
    for i, (path, value) in enumerate(table.items()):
        place = f"{source}: [uncertain] {path} = {shown(value)}, once in {1 / RARE:,.0f} draws:"
        for end in (0, 1):
            with named(place):
                at = parameters.put(physical, {x: float(rows[x][end, i]) for x in table})
            extremes.append((place, path, at))
    require_plausible(extremes, scales)
    return UncertainStructures(structures, made["dimensionless"])


def _spectral_acceleration(
    grid: TimeGrid,
    building: int,
    gravity: float,
    structures: AdjacentStructures,
    ground: GroundLike,
) -> jax.Array:
    """At the natural period of a building, with 5 % of damping, m/s²."""
    period = 2 * jnp.pi / structures.natural_frequencies[building]
    return gravity * spectral_acceleration(ground, grid, period=period)
