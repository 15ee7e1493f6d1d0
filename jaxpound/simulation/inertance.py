"""Inerters of links: a force b s'' in proportion to the relative acceleration of their ends.

The links of a group have s'' = a − G q, with the relative accelerations a of their ends without
them, their forces q and G = Bᵀ M⁻¹ B. With inertances b this is s'' = (1 + G b)⁻¹ (a − G q): the
same law with (1 + G b)⁻¹ a and (G⁻¹ + b)⁻¹ in the place of a and G, in which friction, contact and
events are those of links without inerters.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp

from jaxpound.model.system import Link
from jaxpound.model.topology import LinkGroup
from jaxpound.simulation.contact.forces import inverse_of, times


class Inerters(NamedTuple):
    """The inerters of a group of n links."""

    inertances: jax.Array  # b, (n,)
    reduction: jax.Array  # (1 + G b)⁻¹, (n, n)
    delassus: jax.Array  # (G⁻¹ + b)⁻¹

    @staticmethod
    def of(group: LinkGroup, links: Sequence[Link], delassus: jax.Array) -> Inerters | None:
        """Those of a group with G; None if no link has one."""
        parts = [links[k].inerter for k in group.links[: len(group.hanging)]]
        if not any(parts):
            return None
        zero = jnp.zeros_like(delassus[0, 0])
        inertances = jnp.stack([zero + (x.inertance if x else 0.0) for x in parts])
        whole = inverse_of(delassus)
        reduced = inverse_of(whole + jnp.diag(inertances))
        return Inerters(inertances, reduced @ whole, reduced)

    def for_masses_over(self, share: jax.Array) -> Inerters:
        """The same where all masses and inertances are divided by a number."""
        return Inerters(self.inertances / share, self.reduction, self.delassus * share)

    def reduced(self, pulls: jax.Array) -> jax.Array:
        """Relative accelerations without the links' forces."""
        return times(self.reduction, pulls)

    def forces(self, pulls: jax.Array, totals: jax.Array) -> jax.Array:
        """Forces of the inerters, from a and the forces of the links."""
        return self.inertances * (self.reduced(pulls) - times(self.delassus, totals))
