"""Viscous dampers with a power of the velocity, and friction that depends on the velocity."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from jaxpound._checks import Range
from jaxpound._fields import Batch, parameter, pytree_dataclass

_VELOCITY = Range(1e-6, 100, "m/s", "of an earthquake's motion")
COEFFICIENT = Range(0, 1e14, "N s/m", "from models to the ground under a tower")
_INERTANCE = Range(0, 1e12, "kg", "up to that of many buildings")


@pytree_dataclass
class PowerLaw(Batch):
    r"""A viscous damper, :math:`f = F (|v_d|/v)^a \operatorname{sgn} v_d`; a material of a rod.

    It is c |v_d|^a sgn v_d with c = F/v^a: for v = 1 m/s, c in N (s/m)^a is the same number as F.
    The dashpot, whose velocity is v_d, is in series with a spring, the stiffness K of the rod: that
    of brace, joints and fluid (Reinhorn et al. 1995; OpenSees' ``ViscousDamper``). The stiffer it
    is, the closer the rod is to the dashpot alone; the stability limit of the time step falls, and
    above 4 F/(v K) steps are of first order only, of which a run warns.

    Raises ``ValueError`` if a concrete value breaks its rule.

    Parameters
    ----------
    force
        F ≥ 0, the force at the velocity v; in units of m1 g for a dimensionless system.
    exponent
        a, in (0, 1]: 1 is the linear dashpot, .2 to .5 is usual of dampers in buildings; a → 0 is
        Coulomb's friction.
    velocity
        v > 0, where the force is F; 1 by default. In units of g/ω1 for a dimensionless system.

    Examples
    --------
    800 kN at 1 m/s with a brace of 200 kN/mm, between the first floors of two buildings:

    >>> damper = jp.Rod(jp.PowerLaw(force=800e3, exponent=0.3), stiffness=2e8)
    >>> link = jp.FloorLink(building=0, floor=0, gap=0.1, damper=damper)
    """

    force: Any = parameter("F", "force", "force", least=0, usual=(0.0, 1.5))
    exponent: Any = parameter("a", words="exponent", above=0, most=1, usual=(0.2, 1.0))
    velocity: Any = parameter(
        "v", "velocity", "reference velocity", above=0, within=_VELOCITY, default=1.0
    )


@pytree_dataclass
class Dashpot(Batch):
    """A linear dashpot, f = c e'; a material of a rod, whose stiffness is left out.

    It needs no brace, and no shorter time step for stability. Beside links that touch, share masses
    or have friction that grows with the velocity, steps should be below 0.4 m/c of the mass at its
    ends; a run warns of longer ones.

    Raises ``ValueError`` if a concrete value breaks its rule.

    Parameters
    ----------
    coefficient
        c ≥ 0, in units of m1 ω1 for a dimensionless system.

    Examples
    --------
    A spring and a dashpot of 5 % between a block and the ground:

    >>> spring = jp.Rod(jp.ZenerRod(order=1.0, tau_f=1.0, tau_x=1.0), 1.0, (0, jp.GROUND))
    >>> dashpot = jp.Rod(jp.Dashpot(0.1), ends=(0, jp.GROUND))
    >>> system = jp.System((1.0,), (spring, dashpot))
    """

    coefficient: Any = parameter("c", "damping", "coefficient", least=0, within=COEFFICIENT)


@pytree_dataclass
class MatrixDashpot(Dashpot):
    """A dashpot of a damping matrix: it may be negative, as only the sum of all must dissipate."""

    coefficient: Any = parameter("c", "damping", "coefficient")


@pytree_dataclass
class Inerter:
    """An inerter: its force is b (x_i'' − x_j''), in proportion to the relative acceleration.

    A flywheel with a rack or a ball screw has an inertance of many times its own mass (Smith 2002).

    Raises ``ValueError`` if a concrete value breaks its rule.

    Parameters
    ----------
    inertance
        b ≥ 0, in units of m1 for a dimensionless system.

    Examples
    --------
    Between the roof of a building and the floor below:

    >>> link = jp.FloorLink(building=0, floor=3, next_building=0, inerter=jp.Inerter(2e5))
    """

    inertance: Any = parameter("b", "mass", "inertance", least=0, within=_INERTANCE)


@pytree_dataclass
class VelocityFriction(Batch):
    r"""What friction gains with the velocity, :math:`F (1 - e^{-|w|/v})`.

    Beside the slip force μ of a link it is the friction of PTFE and other bearings, which grows
    from μ in slow slip to μ + F in fast slip (Constantinou, Mokha and Reinhorn 1990).

    Raises ``ValueError`` if a concrete value breaks its rule.

    Parameters
    ----------
    increase
        F ≥ 0, friction in fast slip less that in slow slip; in units of m1 g for a dimensionless
        system.
    velocity
        v > 0, over which it grows: 1/v is 20 to 100 s/m. In units of g/ω1 for a dimensionless
        system.
    """

    increase: Any = parameter("F", "force", "increase of friction", least=0)
    velocity: Any = parameter(
        "v", "velocity", "velocity of the increase", above=0, within=_VELOCITY
    )

    def resistance(self, speed: Any) -> jax.Array:
        """F (1 − e^(−|w|/v))."""
        return -self.increase * jnp.expm1(-speed / self.velocity)
