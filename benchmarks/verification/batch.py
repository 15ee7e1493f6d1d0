"""jaxpound's time of a run among many earthquakes in one call."""

from __future__ import annotations

from contextlib import nullcontext

import jax
import jax.numpy as jnp

import jaxpound as jp
from benchmarks.verification.case import timed

OURS, BATCH = "jaxpound, one run", "jaxpound, a run of a batch"
LANES = 256
BEST_OF = 10
"""Rounds of runs that take milliseconds."""


def seconds_a_run(
    structures: jp.AdjacentStructures,
    ground: jp.Ricker,
    grid: jp.TimeGrid,
    lanes: int = LANES,
    one_core: bool = False,
) -> float:
    """Wall time of a run's smallest gap: the ground's amplitudes are 0.8 to 1.2 times its own."""

    @jax.jit
    @jax.vmap
    def smallest_gap(factor):
        shaking = jp.Ricker(factor * ground.amplitude, ground.periods, ground.arrivals)
        return jp.demand(structures, shaking, grid).min_gap

    factors = jnp.linspace(0.8, 1.2, lanes)
    with jax.default_device(jax.devices()[0]) if one_core else nullcontext():
        return timed(lambda: smallest_gap(factors), BEST_OF)[1] / lanes
