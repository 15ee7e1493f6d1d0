"""Groups of links that may need the local flow, those of the same shape in one program.

Such are links between the floors of two buildings, with contact laws of one class. A step of a
group takes seconds to compile, here once instead of for every group; at run time it is as fast.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jaxpound._xla.alike import by_kind, stacked, unstacked
from jaxpound._xla.derivatives import kept
from jaxpound.model.topology import GROUND, LinkGroup
from jaxpound.simulation.contact import group as contact_group
from jaxpound.simulation.contact.group import Coupling, GroupStep
from jaxpound.simulation.contact.records import FlowResult


class Groups(NamedTuple):
    """Groups of f faces each; where there are several, all arrays have a leading axis of them."""

    places: dict[int, LinkGroup]  # in the topology, by their numbers
    coupling: Coupling

    @property
    def links(self) -> list[int]:
        """The links of all of them."""
        return [k for place in self.places.values() for k in place.links]

    @property
    def shape(self) -> tuple[int, ...]:
        """Of an array of numbers of the faces."""
        several = (len(self.places),) if len(self.places) > 1 else ()
        return *several, len(self.links) // len(self.places)

    @property
    def faces(self) -> tuple[int, ...]:
        """As in ``LinkGroup``, the same of all."""
        return next(iter(self.places.values())).faces

    @property
    def on_ground(self) -> bool:
        """Whether their masses slide on the ground."""
        return next(iter(self.places.values())).root == GROUND

    def for_masses_over(self, share: jax.Array) -> Groups:
        """The groups with all masses divided by a share."""
        coupling = self.coupling
        return self._replace(coupling=coupling._replace(delassus=share * coupling.delassus))

    def map(self, function: Callable[..., Any], *values: Any) -> Any:
        """A function of the coupling and further values of a group, applied to each group."""
        function = jax.vmap(function) if len(self.places) > 1 else function
        return function(self.coupling, *values)

    def gather(self, by_link: Sequence[Any]) -> Any:
        """The values of the groups' links, stacked leaf by leaf into arrays of their ``shape``."""
        of_links = (by_link[k] for k in self.links)
        return jax.tree.map(lambda *y: jnp.stack(y).reshape(self.shape), *of_links)

    def by_link(self, values: Any) -> dict[int, Any]:
        """The entries of arrays of numbers of the faces."""
        links, axes = self.links, len(self.shape)
        flat = jax.tree.map(lambda y: y.reshape(len(links), *y.shape[axes:]), values)
        return dict(zip(links, unstacked(flat), strict=True))


class GroupFlows(NamedTuple):
    """Groups after their local flows."""

    groups: Groups
    before: GroupStep
    result: FlowResult
    used: jax.Array  # by group
    shift: jax.Array  # of the closings, to their mean sample

    @property
    def shift_now(self) -> jax.Array:
        """Shift of the closings at t_m by what the flow has changed until then."""
        used = self.used.reshape(*self.used.shape, 1)
        return jnp.where(used, self.result.now.closing - self.before.closing, 0.0)

    def mass_shifts(
        self, shift: jax.Array, shares: Mapping[int, Mapping[int, jax.Array]]
    ) -> dict[int, jax.Array]:
        """The shifts of the masses by those of the closings, (f,) for each group."""
        by_group = jnp.unstack(shift) if shift.ndim > 1 else [shift]
        return {
            mass: (share * of_group).sum()
            for number, of_group in zip(self.groups.places, by_group, strict=True)
            for mass, share in shares[number].items()
        }


def alike(places: Mapping[int, LinkGroup], couplings: Mapping[int, Coupling]) -> tuple[Groups, ...]:
    """Groups, by their numbers, together where their constants have the same shapes."""
    numbers, groups = [*couplings], list[Groups]()
    # As keys, since values of numbers are not compared.
    kinds = [{(places[n].faces, places[n].root == GROUND): of} for n, of in couplings.items()]
    for kind in by_kind(kinds):
        those = [numbers[i] for i in kind]
        of_each = [couplings[n] for n in those]
        coupling = stacked(of_each) if len(those) > 1 else of_each[0]
        groups.append(Groups({n: places[n] for n in those}, coupling))
    return tuple(groups)


def flows_of(groups: Groups, before: GroupStep) -> GroupFlows:
    """The groups after their local flows."""
    result, used = kept(groups.map(contact_group.run_flow, before))
    shift = groups.map(contact_group.mean_sample_shift, result, used, before)
    return GroupFlows(groups, before, result, used, shift)


def need_flows(groups: Sequence[tuple[Groups, GroupStep]]) -> jax.Array:
    """Whether any group needs its local flow."""
    needed = (jnp.ravel(of.map(contact_group.is_flow_needed, before)) for of, before in groups)
    return jnp.concatenate([*needed]).any()
