"""Two blocks on fractional Zener rods, joined by a friction link: the system of eq. (9)."""

from __future__ import annotations

from typing import Any

import jax

from jaxpound._fields import like, parameter, part, pytree_dataclass, unchecked
from jaxpound.model.contact import ContactLaw, Newton
from jaxpound.model.rod import ZenerRod
from jaxpound.model.system import GROUND, Link, Rod, System


@pytree_dataclass
class AdjacentStructures:
    """Two adjacent structures joined by a friction damper, dimensionless (paper, eq. 9).

    Parameters
    ----------
    rod_1, rod_2
        The rods; rod 1 has stiffness 1, rod 2 has stiffness ``stiffness_ratio``.
    mass_ratio
        ρ = m1 / m2 > 0.
    stiffness_ratio
        ε = k2 / k1 > 0.
    friction
        μ ≥ 0, the damper's slip force in units of m1 g.
    initial_gap
        ξ0 ≥ 0, the gap at rest in units of g/ω1².
    contact
        The law of contact when the gap closes, ``Newton`` or any ``ContactLaw``; None, the default,
        lets the structures pass through each other.

    Examples
    --------
    >>> rod_1 = jp.ZenerRod(order=0.23, tau_f=0.004, tau_x=1.183)
    >>> rod_2 = jp.ZenerRod(order=0.53, tau_f=0.2, tau_x=4.0)
    >>> structures = jp.AdjacentStructures(
    ...     rod_1, rod_2, mass_ratio=1.0, stiffness_ratio=2.0, friction=0.25, initial_gap=1.0
    ... )
    >>> [round(float(omega), 3) for omega in structures.natural_frequencies]
    [1.484, 3.341]
    """

    rod_1: ZenerRod = part(ZenerRod)
    rod_2: ZenerRod = part(ZenerRod)
    mass_ratio: Any = parameter(r"\rho", words="mass ratio", above=0, usual=(0.2, 5.0))
    stiffness_ratio: Any = parameter(
        r"\varepsilon", words="stiffness ratio", above=0, usual=(0.2, 8.0)
    )
    friction: Any = parameter(r"\mu", "force", "friction", least=0, usual=(0.0, 1.5))
    initial_gap: Any = parameter(r"\xi_0", "length", "gap at rest", least=0, usual=(0.0, 3.0))
    contact: ContactLaw | Newton | None = like(Link, "contact", default=None)

    def system(self) -> System:
        """Masses 1 and 1/ρ on rods of stiffness 1 and ε, and the link between them."""
        rods = (
            unchecked(Rod, material=self.rod_1, stiffness=1.0, ends=(0, GROUND)),
            unchecked(Rod, material=self.rod_2, stiffness=self.stiffness_ratio, ends=(1, GROUND)),
        )
        between = {"friction": self.friction, "gap": self.initial_gap, "contact": self.contact}
        link = unchecked(Link, ends=(0, 1), **between)
        return unchecked(System, masses=(1.0, 1 / self.mass_ratio), rods=rods, links=(link,))

    @property
    def natural_frequencies(self) -> tuple[jax.Array, jax.Array]:
        """Natural frequencies of the two uncoupled structures, in units of ω1 = √(k1/m1)."""
        second = self.rod_2.natural_frequency(self.stiffness_ratio, 1 / self.mass_ratio)
        return self.rod_1.natural_frequency(), second

    @property
    def damping_ratios(self) -> tuple[jax.Array, jax.Array]:
        """Equivalent viscous damping ratios of the two uncoupled structures."""
        second = self.rod_2.damping_ratio(self.stiffness_ratio, 1 / self.mass_ratio)
        return self.rod_1.damping_ratio(), second
