"""The local flow of a step as a function that runs can differentiate and batch."""

from __future__ import annotations

from functools import lru_cache, partial
from typing import Any

import jax
from jax import lax

from jaxpound._xla.derivatives import Program, in_both_modes
from jaxpound._xla.lanes import lanes_at_a_time, where_needed
from jaxpound.simulation.contact.forces import Constants
from jaxpound.simulation.contact.local_flow import advance, result, start, unfinished
from jaxpound.simulation.contact.records import DISCRETE, Clock, FlowInput, FlowResult


def flow(h: float, slots: int, needed: jax.Array, inputs: FlowInput, clock: Clock) -> FlowResult:
    """The joints at the end of a step of length h; NaN if there are too many events in it.

    Up to ``slots`` impacts that end in the step are recorded for each gap. The result is zero where
    the flow is not ``needed``.
    """
    # JAX says so itself where it differentiates: then it needs not trace the programs once more.
    with jax.sharding.use_abstract_mesh(jax.sharding.get_abstract_mesh()):
        return _differentiable(h, slots)(inputs, (needed, clock))


@lru_cache(maxsize=64)
def _differentiable(h: float, slots: int) -> Program:
    def run(inputs: FlowInput, of_run: tuple[jax.Array, Clock]) -> FlowResult:
        constants = Constants.of(h, slots, inputs, of_run[1])
        goes_on, following = partial(unfinished, constants), partial(advance, constants)
        return result(constants, lax.while_loop(goes_on, following, start(constants)))

    def is_differentiated(path: Any) -> bool:
        return not (path[0].name == "contact" and path[1].name in DISCRETE)

    def in_lanes(program: Program, reverse: bool) -> Program:
        work = where_needed(program, lanes_at_a_time(reverse))

        def mapped(inputs: FlowInput, constants: tuple[jax.Array, Clock], *more: Any) -> Any:
            return work(constants[0], inputs, constants, *more)

        return mapped

    return in_both_modes(run, "a run with contact", is_differentiated, in_lanes)
