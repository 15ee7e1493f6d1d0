"""What ``jaxpound montecarlo`` is told in a TOML file: buildings, earthquakes, uncertainty; SI."""

from __future__ import annotations

import dataclasses
from functools import partial
from operator import attrgetter
from pathlib import Path

import jax
import jax.numpy as jnp

from jaxpound.chunks import Measure
from jaxpound.config import BUILDING, RUN, Keys, named
from jaxpound.earthquake_config import (
    EARTHQUAKES,
    distribution,
    flag,
    opened,
    scaled,
)
from jaxpound.examples import STUDY as EXAMPLE
from jaxpound.ground import GroundLike
from jaxpound.intensity import spectral_acceleration
from jaxpound.scenarios import (
    PARAMETERS,
    Scenarios,
    UncertainStructures,
)
from jaxpound.scheme import Scheme, TimeGrid
from jaxpound.structures import AdjacentStructures
from jaxpound.units import Scales

_KEYS: Keys = {
    "": {"gap": float},
    "building_1": BUILDING,
    "building_2": BUILDING,
    "damper": {"friction_force": float},
    "earthquakes": EARTHQUAKES,
    "uncertain": dict.fromkeys(PARAMETERS, distribution),
    "run": RUN,
    "study": {
        "samples": int,
        "seed": int,
        "sampling": ("plain", "sobol"),
        "chunk_size": int,
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
        If the file, or a record that it names, cannot be read.
    ValueError
        As ``config.read_config``.
    """
    read = opened(path, "study", EXAMPLE, _KEYS, by_field="uncertain")
    source, given, structures, grid = read.source, read.given, read.structures, read.grid()
    study = given.get("study", {})
    samples, chunk_size = study.get("samples", 10_000), study.get("chunk_size")
    for key, value in (("samples", samples), ("chunk_size", chunk_size)):
        if value is not None and value < 1:
            raise ValueError(f"{source}: [study] {key} = {value} must be positive")
    if not 0 <= (seed := study.get("seed", 0)) < 2**32:
        raise ValueError(f"{source}: [study] seed = {seed} must be from 0 to 2^32 - 1")
    drawn: AdjacentStructures | UncertainStructures = structures
    if uncertain := given.get("uncertain", {}):
        with named(f"{source}: [uncertain]"):
            drawn = UncertainStructures(
                structures,
                {
                    path: scaled(value, float(attrgetter(path)(structures)))
                    for path, value in uncertain.items()
                },
            )
    with named(f"{source}:"):
        scenarios = Scenarios(drawn, read.ground)
    sampling = study.get("sampling", "plain")
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
        samples,
        seed,
        sampling,
        chunk_size,
        study.get("keep_failures", False),
        measures,
    )


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
