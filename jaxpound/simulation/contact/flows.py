"""The local flow of a step as a function that runs can differentiate and batch."""

from __future__ import annotations

from functools import lru_cache, partial
from typing import Any

import jax
from jax import lax

from jaxpound.simulation.contact.derivatives import Program, in_both_modes
from jaxpound.simulation.contact.forces import Constants
from jaxpound.simulation.contact.lanes import where_needed
from jaxpound.simulation.contact.local_flow import advance, result, start, unfinished
from jaxpound.simulation.contact.records import DISCRETE, Clock, FlowInput, FlowResult, Gaps

_LANES, _LANES_IN_REVERSE, _LANES_ON_GPU = 8, 2, 256
"""Lanes of a batch, at most, that are followed side by side: on CPUs, on CPUs in reverse (each of
them has a dozen columns), and on other devices."""


def flow(
    h: float, slots: int, gaps: Gaps, needed: jax.Array, inputs: FlowInput, clock: Clock
) -> FlowResult:
    """The joints at the end of a step of length h; NaN if there are too many events in it.

    Up to ``slots`` impacts that end in the step are recorded for each gap. The result is zero where
    the flow is not ``needed``.
    """
    # JAX says so itself where it differentiates: then it needs not trace the programs once more.
    with jax.sharding.use_abstract_mesh(jax.sharding.get_abstract_mesh()):
        return _differentiable(h, slots, gaps)(inputs, (needed, clock))


@lru_cache(maxsize=64)
def _differentiable(h: float, slots: int, gaps: Gaps) -> Program:
    def run(inputs: FlowInput, of_run: tuple[jax.Array, Clock]) -> FlowResult:
        constants = Constants.of(h, slots, gaps, inputs, of_run[1])
        goes_on, following = partial(unfinished, constants), partial(advance, constants)
        return result(constants, lax.while_loop(goes_on, following, start(constants)))

    def is_differentiated(path: Any) -> bool:
        return not (path[0].name == "contact" and path[1].name in DISCRETE)

    def in_lanes(program: Program, reverse: bool) -> Program:
        width = _LANES_ON_GPU
        if jax.default_backend() == "cpu":
            width = _LANES_IN_REVERSE if reverse else _LANES
        work = where_needed(program, width)

        def mapped(inputs: FlowInput, constants: tuple[jax.Array, Clock], *more: Any) -> Any:
            return work(constants[0], inputs, constants, *more)

        return mapped

    return in_both_modes(run, is_differentiated, in_lanes)
