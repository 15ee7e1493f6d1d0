"""``jaxpound montecarlo``: a study of buildings under random earthquakes."""

from __future__ import annotations

import argparse
import math
import re
import sys
from functools import partial
from typing import Annotated, Any, Literal

import jax
import jax.numpy as jnp
from msgspec import field

import jaxpound as jp
from jaxpound.cli.factors import FACTOR, random_scenarios
from jaxpound.cli.notes import noted
from jaxpound.cli.reading import Count, File, Seed, Table, between
from jaxpound.cli.structures import Shaken
from jaxpound.cli.tables import Stated, drawn
from jaxpound.ground.intensity import spectral_acceleration
from jaxpound.ground.motion import GroundLike
from jaxpound.model.system import is_closable

# --- the configuration --------------------------------------------------------------------------


class Sampling(Table):
    """Number of scenarios, kind of sampling, and what is stored of them."""

    samples: Annotated[int, Count] = 10_000
    seed: Annotated[int, Seed] = 0
    sampling: Literal["plain", "sobol"] = "plain"
    chunk_size: Annotated[int, Count] | None = None
    keep_failures: bool = False
    spectral_acceleration: bool = False
    correlation: Annotated[float, between(-1, 1, "", "of the same parameter of storeys")] | None = (
        None
    )


class Study(Shaken):
    """The configuration of ``jaxpound montecarlo``."""

    uncertain: dict[str, Annotated[Stated, drawn(*FACTOR)]] = field(default_factory=dict)
    study: Sampling = Sampling()


# --- the command --------------------------------------------------------------------------------


def run(args: argparse.Namespace) -> None:
    """Run the command."""
    file = File.opened(args.config, "montecarlo")
    given = file.read(Study)
    how = given.study
    scenarios, grid = prepared(file, given)
    with noted(given.structures):
        found = jp.monte_carlo(
            scenarios,
            how.samples if args.samples is None else args.samples,
            grid,
            given.scheme,
            how.seed,
            sampling=how.sampling,
            store=args.store,
            chunk_size=how.chunk_size,
            measures=_measures(given, grid) if how.spectral_acceleration else {},
            keep_parameters=True,
            keep_failures=how.keep_failures,
            scales=given.scales,
            notes={"configuration": file.text},
            shard=_shard(args.shard),
            strict=args.strict,
            progress=sys.stderr.isatty(),
        )
    print(found)
    part = "" if args.shard == "1/1" else f" by shard {args.shard} alone"
    print(f"probability of pounding{part} {found.pounding_probability()}")
    print(f"jaxpound report --store {args.store} --out DIR says more")


def _shard(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d+)/(\d+)", text)
    if not match or not 1 <= int(match[1]) <= int(match[2]):
        raise ValueError(f"argument --shard: {text!r} must be I/N with I from 1 to N, such as 2/8")
    return int(match[1]), int(match[2])


def prepared(file: File, given: Study) -> tuple[jp.Scenarios, jp.TimeGrid]:
    """The scenarios of a study and the time grid of its runs."""
    if not any(is_closable(link.gap) for link in given.structures.system().links):
        rule = "must have a gap: the study is of how often gaps close"
        raise ValueError(f"{file.name}: a [[link]] {rule}")
    records = given.records(file)
    ground = given.motion(file, records)
    grid = given.grid(file, records)
    correlation = given.study.correlation
    return random_scenarios(file, given, ground, given.uncertain, correlation), grid


def _measures(given: Study, grid: jp.TimeGrid) -> dict[str, Any]:
    """Further measures of intensity: spectral accelerations at the natural periods."""
    gravity = float(given.scales.gravity)
    if isinstance(given.structures, jp.Row):
        measured = [
            partial(_spectral_acceleration_at, grid, 2 * math.pi / float(w), gravity)
            for w in given.structures.natural_frequencies
        ]
    else:
        measured = [partial(_spectral_acceleration, grid, i, gravity) for i in (0, 1)]
    return {f"spectral_acceleration_{i}": one for i, one in enumerate(measured, 1)}


def _spectral_acceleration(
    grid: jp.TimeGrid,
    building: int,
    gravity: float,
    structures: jp.AdjacentStructures,
    ground: GroundLike,
) -> jax.Array:
    """At the natural period of a building, with 5 % of damping, m/s²."""
    period = 2 * jnp.pi / structures.natural_frequencies[building]
    return gravity * spectral_acceleration(ground, grid, period=period)


def _spectral_acceleration_at(
    grid: jp.TimeGrid, period: float, gravity: float, _: jp.Row, ground: GroundLike
) -> jax.Array:
    """At the natural period of a building as it is stated, with 5 % of damping, m/s²."""
    return gravity * spectral_acceleration(ground, grid, period=period)
