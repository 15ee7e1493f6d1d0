"""The local flow of a step as a function that runs can differentiate and batch."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from jaxpound.model.contact import Newton
from jaxpound.simulation import kernels
from jaxpound.simulation.contact.derivatives import Program, in_both_modes
from jaxpound.simulation.contact.dop853 import STAGES
from jaxpound.simulation.contact.lanes import where_needed
from jaxpound.simulation.contact.local_flow import LocalFlow
from jaxpound.simulation.contact.records import DISCRETE, Clock, FlowInput, FlowResult

_LANES, _LANES_IN_REVERSE, _LANES_ON_GPU = 8, 2, 256
"""Lanes of a batch, at most, that are followed side by side where flows are no kernels: on CPUs, on
CPUs in reverse (each of them has a dozen columns), and on other devices."""

_TERMS, _MOST_LINKS = 7 * len(STAGES), 16
"""Numbers, for each link, of the largest sum in a flow: that of the weights by which a substep is
interpolated. Up to so many links it is the largest; beyond, sums over pairs of links are longer."""


def flow(
    h: float,
    slots: int,
    needed: jax.Array,
    inputs: FlowInput,
    clock: Clock,
    faces: tuple[int, ...] = (),
) -> FlowResult:
    """The links at the end of a step of length h; NaN if there are too many events in it.

    Up to ``slots`` impacts that end in the step are recorded for each face; ``faces`` are the links
    of which further faces are the other ones. The result is zero where the flow is not ``needed``.
    """
    links_of_kernel = len(inputs.laws) if _has_kernel(inputs) else None
    # JAX says so itself where it differentiates: then it needs not trace the programs once more.
    with jax.sharding.use_abstract_mesh(jax.sharding.get_abstract_mesh()):
        return _differentiable(h, slots, faces, links_of_kernel)(inputs, (needed, clock))


def _has_kernel(inputs: FlowInput) -> bool:
    """Whether XLA can make one kernel of the flow of these links."""
    if not kernels.are_available() or len(inputs.laws) > _MOST_LINKS:
        return False
    number = jax.ShapeDtypeStruct((), inputs.closing.dtype)
    laws = [law for law in inputs.laws if law is not None and not isinstance(law, Newton)]
    programs = [jax.make_jaxpr(_twice_derived(law.force))(number, number, number) for law in laws]
    resistances = [law for law in inputs.resistances if law is not None]
    programs += [jax.make_jaxpr(_twice_derived(law.resistance))(number) for law in resistances]
    return all(kernels.is_arithmetic(program.jaxpr) for program in programs)


def _twice_derived(function: Callable[..., Any]) -> Callable[..., Any]:
    """A program with all operations of a function and its derivatives, as a flow has them."""

    def slope(*state: jax.Array) -> Any:
        return jax.jvp(lambda *y: jnp.asarray(function(*y)), state, state)

    return lambda *state: jax.jvp(slope, state, state)


@lru_cache(maxsize=64)
def _differentiable(
    h: float, slots: int, faces: tuple[int, ...], links_of_kernel: int | None
) -> Program:
    in_kernel = links_of_kernel is not None
    columns = kernels.MOST_TERMS // (_TERMS * links_of_kernel) if links_of_kernel else None

    def run(inputs: FlowInput, constants: tuple[jax.Array, Clock]) -> FlowResult:
        local = LocalFlow(h, slots, faces, inputs, constants[1])
        return local.result(lax.while_loop(local.unfinished, local.advance, local.start()))

    def is_differentiated(path: Any) -> bool:
        return not (path[0].name == "contact" and path[1].name in DISCRETE)

    def in_lanes(program: Program, reverse: bool) -> Program:
        width = _LANES_ON_GPU
        if jax.default_backend() == "cpu":
            width = _LANES_IN_REVERSE if reverse else _LANES
        work = where_needed(program, None if in_kernel else width)

        def mapped(inputs: FlowInput, constants: tuple[jax.Array, Clock], *more: Any) -> Any:
            return work(constants[0], inputs, constants, *more)

        return mapped

    return in_both_modes(run, is_differentiated, in_lanes, columns)
