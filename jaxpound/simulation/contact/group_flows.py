"""Local flows of the groups of links of a step, before the rods take the mean sample."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.ad_checkpoint import checkpoint_name

from jaxpound.model.topology import LinkGroup
from jaxpound.simulation.contact.group import (
    Coupling,
    GroupStep,
    is_flow_needed,
    mean_sample,
    run_flow,
)
from jaxpound.simulation.contact.records import FlowResult

FLOW = "local flow"
"""Name of the results of local flows, which reverse mode keeps where it computes steps anew."""


class Group(NamedTuple):
    """A group of links that may need the local flow, before a step."""

    place: LinkGroup  # in the topology
    coupling: Coupling
    before: GroupStep

    @property
    def of_flow(self) -> tuple[Coupling, GroupStep]:
        """The group without numbers of its masses: groups of one structure would differ in them."""
        return self.coupling._replace(mass_shares={}), self.before


class GroupFlow(NamedTuple):
    """A group after its local flow."""

    place: LinkGroup  # in the topology
    coupling: Coupling
    before: GroupStep
    result: FlowResult
    used: jax.Array
    shift: jax.Array  # of the closings, to their mean sample

    def shift_now(self) -> jax.Array:
        """Shift of the closings at t_m by what the flow has changed until then."""
        return jnp.where(self.used, self.result.now.closing - self.before.closing, 0.0)


def flows_of(groups: Sequence[Group]) -> list[GroupFlow]:
    """The groups after their local flows."""
    results = _map_like(run_flow, [group.of_flow for group in groups])
    results, flows = checkpoint_name(results, FLOW), []
    for group, (result, used) in zip(groups, results, strict=True):
        before = group.before
        shift = jnp.where(used, mean_sample(result, before) - before.closing, 0.0)
        flows.append(GroupFlow(*group, result, used, shift))
    return flows


def need_flows(groups: Sequence[Group]) -> jax.Array:
    """Whether any group needs its local flow."""
    return jnp.stack(_map_like(is_flow_needed, [group.of_flow for group in groups])).any()


def _map_like(function: Callable[..., Any], arguments: Sequence[tuple[Any, ...]]) -> list[Any]:
    """A function of each tuple of arguments; vmap over those of the same structure and shapes.

    Such are links between the floors of two buildings, with contact laws of one class. A local flow
    takes seconds to compile, here once instead of for every link; at run time a batch is as fast.
    """
    groups: dict[Any, list[int]] = {}
    for n, args in enumerate(arguments):
        shapes = tuple(jnp.shape(leaf) for leaf in jax.tree.leaves(args))
        groups.setdefault((jax.tree.structure(args), shapes), []).append(n)
    results: dict[int, Any] = {}
    for numbers in groups.values():
        if len(numbers) == 1:
            results[numbers[0]] = function(*arguments[numbers[0]])
            continue
        stacked = jax.tree.map(lambda *x: jnp.stack(x), *(arguments[n] for n in numbers))
        batch = jax.vmap(function)(*stacked)
        for i, n in enumerate(numbers):
            results[n] = jax.tree.map(lambda x, i=i: x[i], batch)
    return [results[n] for n in range(len(arguments))]
