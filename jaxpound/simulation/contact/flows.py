"""The local flow of a step as a function that runs can differentiate and batch."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import jax
from jax import lax

from jaxpound.simulation.contact.derivatives import Program, in_both_modes
from jaxpound.simulation.contact.lanes import where_needed
from jaxpound.simulation.contact.local_flow import LocalFlow
from jaxpound.simulation.contact.records import DISCRETE, Clock, FlowInput, FlowResult

_LANES, _LANES_IN_REVERSE = 8, 2
"""Lanes of a batch that are followed side by side; in reverse each of them has a dozen columns.

For sums of more than some 32 numbers side by side XLA calls a library, which takes longer than all
else in a substep: with four lanes, the gradient in ``benchmarks/batches.py contact`` took 2.5 times
as long.
"""


def flow(h: float, slots: int, needed: jax.Array, inputs: FlowInput, clock: Clock) -> FlowResult:
    """The links at the end of a step of length h; NaN if there are too many events in it.

    Up to ``slots`` impacts that end in the step are recorded for each link. The result is zero
    where the flow is not ``needed``.
    """
    return _differentiable(h, slots)(inputs, (needed, clock))


@lru_cache(maxsize=64)
def _differentiable(h: float, slots: int) -> Program:
    def run(inputs: FlowInput, constants: tuple[jax.Array, Clock]) -> FlowResult:
        local = LocalFlow(h, slots, inputs, constants[1])
        return local.result(lax.while_loop(local.unfinished, local.advance, local.start()))

    def is_differentiated(path: Any) -> bool:
        return not (path[0].name == "contact" and path[1].name in DISCRETE)

    return in_both_modes(run, is_differentiated, _in_lanes)


def _in_lanes(program: Program, reverse: bool) -> Program:
    lanes = where_needed(program, _LANES_IN_REVERSE if reverse else _LANES)

    def mapped(inputs: FlowInput, constants: tuple[jax.Array, Clock], *more: Any) -> Any:
        return lanes(constants[0], inputs, constants, *more)

    return mapped
