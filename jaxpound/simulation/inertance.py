"""Inerters of links: a force b s'' in proportion to the relative acceleration of their ends.

Links have s'' = a − G q, with the relative accelerations a of their ends without them, their forces
q and G = Bᵀ M⁻¹ B. With inertances b this is s'' = (1 + G b)⁻¹ (a − G q): the same law with (1 + G
b)⁻¹ a and (1 + G b)⁻¹ G, in which friction, contact and events are those without inerters.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound.model.system import System
from jaxpound.model.topology import elongation
from jaxpound.simulation.contact.forces import inverse_of, times


class Inerters(NamedTuple):
    """The inerters of a system with n links."""

    inertances: dict[int, jax.Array]  # b of the links that have one
    reduction: jax.Array  # (1 + G b)⁻¹, (n, n)
    delassus: jax.Array  # (1 + G b)⁻¹ G

    @staticmethod
    def of(system: System, inverse_masses: Sequence[jax.Array]) -> Inerters | None:
        """Those of a system; None if no link has one."""
        inertances = {k: x.inerter.inertance for k, x in enumerate(system.links) if x.inerter}
        if not inertances:
            return None
        links, inverse = system.topology.links, jnp.stack(inverse_masses)
        motions = [*np.eye(len(system.masses), dtype=inverse.dtype)]
        influence = np.stack([elongation(ends, motions) for ends in links])
        delassus = (influence * inverse[None]) @ influence.T
        by_link = jnp.stack([inertances.get(k, 0 * inverse[0]) for k in range(len(links))])
        reduction = inverse_of(jnp.eye(len(links), dtype=inverse.dtype) + delassus * by_link[None])
        return Inerters(inertances, reduction, reduction @ delassus)

    def for_masses_over(self, share: jax.Array) -> Inerters:
        """The same where all masses and inertances are divided by a number."""
        inertances = {k: b / share for k, b in self.inertances.items()}
        return Inerters(inertances, self.reduction, self.delassus * share)

    def reduced(self, pulls: Sequence[jax.Array]) -> list[jax.Array]:
        """Relative accelerations without the links' forces, from those without inerters."""
        return [*times(self.reduction, jnp.stack(pulls))]

    def forces(self, pulls: Sequence[Any], totals: Sequence[Any]) -> dict[int, jax.Array]:
        """Forces of the inerters by link, from reduced ``pulls`` and the other forces of links."""
        accelerations = jnp.stack(pulls) - times(self.delassus, jnp.stack(totals))
        return {k: b * accelerations[k] for k, b in self.inertances.items()}
