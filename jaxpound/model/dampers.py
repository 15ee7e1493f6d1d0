"""Viscous dampers with a power of the velocity, and friction that depends on the velocity."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxpound._checks import Range
from jaxpound._extrema import smaller
from jaxpound._fields import Batch, parameter, pytree_dataclass

_VELOCITY = Range(1e-6, 100, "m/s", "of an earthquake's motion")
_INERTANCE = Range(0, 1e12, "kg", "up to that of many buildings")
_ITERATIONS = 8  # of Newton's method, to rounding


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

    def for_steps(self, stiffness: Any, dt: Any) -> Dashpot:
        """The law in steps of a length, beside a spring."""
        return Dashpot(self.force / stiffness, 1 / self.exponent, self.velocity * dt)


class Slid(NamedTuple):
    """State of a rod with a dashpot."""

    elongation: Any
    """That of the dashpot."""
    dissipated: Any
    """Energy until now, over K."""


class Dashpot(NamedTuple):
    """A dashpot and a spring in series over steps of one length; lengths stand for forces."""

    size: Any  # F over K
    power: Any  # 1/a
    way: Any  # v times the step

    def start(self, elongation: Any) -> Slid:
        """The state of a rod at rest."""
        return Slid(elongation, 0 * elongation)

    def advance(self, state: Slid, before: Any, after: Any) -> Slid:
        """The state after a sudden change of the elongation: the dashpot cannot follow."""
        return state

    def over_step(self, state: Slid, before: Any, after: Any) -> Slid:
        """The state after a step in which the elongation changes linearly, to second order.

        By the two-stage method of Alexander (1977), which is L-stable: where the spring is stiff,
        the force is that of the dashpot alone.
        """
        gamma, change = 1 - 0.5**0.5, after - before
        last = before - state.elongation
        middle, slid = self._solved(last + gamma * change, gamma)
        ended = last + (1 - gamma) * (change - slid)
        force, slid_last = self._solved(ended + gamma * change, gamma)
        work = (1 - gamma) * middle * slid + gamma * force * slid_last
        return Slid(after - force, state.dissipated + work)

    def _slid(self, force: Any) -> Any:
        """How far the dashpot moves in a step under a force over K."""
        size = jnp.abs(force)
        # Not 1 over the size: a power of it may overflow, and 0 times its derivative is NaN.
        share = jnp.where(size > 0, size / jnp.where(self.size > 0, self.size, 1.0), 1.0)
        return jnp.where(size > 0, jnp.sign(force) * self.way * share**self.power, 0.0)

    def _solved(self, whole: Any, share: float) -> tuple[Any, Any]:
        """The force f over K for which f and what the dashpot moves in a share of a step is whole.

        And how far it moves in a step. Both grow with f and are convex: Newton's method falls to
        the root from any point above it.
        """
        none = self.size <= 0
        fixed, target = lax.stop_gradient((self, whole))
        size = jnp.abs(target)
        alone = (size / (share * fixed.way)) ** (1 / fixed.power)  # over F
        force = smaller(size, jnp.where(none, 1.0, fixed.size) * alone)

        def nearer(law: Dashpot, force: Any, whole: Any) -> Any:
            """A step of Newton's method; its slope is not differentiated."""
            ratio = fixed._slid(force) / jnp.where(force == 0, 1.0, force)
            excess = force + share * law._slid(force) - whole
            return force - excess / (1 + share * fixed.power * ratio)

        for _ in range(_ITERATIONS):
            force = nearer(fixed, force, size)
        # The last step has the derivative of the root. A dashpot whose force is 0 moves with the
        # rod, and the derivative by its force is the force over F.
        force = nearer(self, jnp.sign(target) * force, whole)
        force = jnp.where(none, self.size * jnp.sign(target) * alone, force)
        return force, jnp.where(none, (whole - force) / share, self._slid(force))

    def reduced_force(self, elongation: Any, state: Slid) -> Any:
        """The force over K."""
        return elongation - state.elongation

    def dissipated(self, state: Slid) -> Any:
        """Energy dissipated until now, over K."""
        return state.dissipated


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
