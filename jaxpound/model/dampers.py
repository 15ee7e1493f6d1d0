"""Laws of dampers in links: a resistance to the velocity, beside Coulomb's friction."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import jax.numpy as jnp

from jaxpound._checks import Range, require_batch
from jaxpound._fields import check, parameter, pytree_dataclass

_VELOCITY = Range(1e-6, 100, "m/s", "of an earthquake's motion")


@runtime_checkable
class DamperLaw(Protocol):
    """A law of a damper, user-defined ones included.

    A law is a pytree, whose numbers are traced and differentiated.
    """

    def resistance(self, speed: Any) -> Any:
        """The force against the motion at a speed |w| > 0: not negative, and 0 for speed → 0."""


@pytree_dataclass
class PowerLaw:
    r"""A viscous damper, :math:`F (|w|/v)^a \operatorname{sgn} w`.

    It is c |w|^a sgn w with c = F/v^a: with v = 1 m/s, c in N (s/m)^a is the same number as F.

    Raises ``ValueError`` if a concrete value breaks its rule.

    Parameters
    ----------
    force
        F ≥ 0, the force at the velocity v; in units of m1 g for a dimensionless system.
    exponent
        a, in (0, 2]: 1 is the linear dashpot, .2 to .5 is usual of dampers in buildings; a → 0 is
        Coulomb's friction.
    velocity
        v > 0, where the force is F; 1 by default. In units of g/ω1 for a dimensionless system.

    Examples
    --------
    >>> damper = jp.PowerLaw(force=800e3, exponent=0.3)  # 800 kN at 1 m/s
    >>> round(float(damper.resistance(0.1)) / 1e3)  # kN
    401
    """

    force: Any = parameter("F", "force", "force", least=0, usual=(0.0, 1.5))
    exponent: Any = parameter("a", words="exponent", above=0, most=2, usual=(0.2, 1.0))
    velocity: Any = parameter(
        "v", "velocity", "reference velocity", above=0, within=_VELOCITY, default=1.0
    )

    def __post_init__(self) -> None:
        check(self)
        require_batch(type(self).__name__, **vars(self))

    def resistance(self, speed: Any) -> Any:
        """F (|w|/v)^a."""
        moves = speed > 0
        share = jnp.where(moves, speed / self.velocity, 1.0)
        return jnp.where(moves, self.force * share**self.exponent, 0.0)


@pytree_dataclass
class VelocityFriction:
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

    def __post_init__(self) -> None:
        check(self)
        require_batch(type(self).__name__, **vars(self))

    def resistance(self, speed: Any) -> Any:
        """F (1 − e^(−|w|/v))."""
        return -self.increase * jnp.expm1(-speed / self.velocity)
