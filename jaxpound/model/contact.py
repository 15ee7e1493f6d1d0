"""Contact laws: the force between two blocks whose gap has closed.

The penetration δ is how far the closing of a link exceeds its gap, δ' its rate; m* = 1/(1/m_i +
1/m_j) is the effective mass of the two blocks, and e the coefficient of restitution: the speed at
which they part over that at which they met. ``Newton`` has an impulse, all others a force.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxpound._checks import Range, hint
from jaxpound._errors import InvalidInput
from jaxpound._extrema import larger
from jaxpound._fields import (
    Batch,
    like,
    node_classes,
    parameter,
    pytree_dataclass,
    static,
    unchecked,
)
from jaxpound.model.contact_numbers import contact_stiffness as contact_stiffness
from jaxpound.model.contact_numbers import exact_damping_factor

_STIFFNESS = Range(1e-3, 1e20, "", "N/m, and N/m^1.5 for laws after Hertz")
_RESTITUTION = Range(1e-3, 1, "", "speed at parting over speed at touch; 0.65 for concrete")


@runtime_checkable
class ContactLaw(Protocol):
    """A law of contact with a force, user-defined ones included.

    A law is a pytree, whose numbers are traced and differentiated. It has a force only: the run
    finds where contact begins and ends. The force at speed 0 is evaluated, too: its work is stored
    energy, the rest of the work is lost.

    Three more members are optional. ``tension``, a bool, says whether the force may pull while the
    blocks are in contact; without it, or where it is False, the force is 0 instead. ``linear``, a
    bool, says that the force is a sum of multiples of penetration, speed and touch speed: the run
    then follows it by power series, else by a Runge–Kutta method, which is slower. A law
    whose damping depends on the mass has ``for_mass(effective_mass)``: a run calls it once for each
    link and takes the force of the law that it returns. Outside of runs the law's own ``force`` is
    that for effective mass 1. A law without ``for_mass`` does not get the mass.

    Examples
    --------
    A rubber cushion that stiffens as it is pressed:

    >>> import dataclasses
    >>> @jax.tree_util.register_dataclass
    ... @dataclasses.dataclass(frozen=True)
    ... class Cushion:
    ...     stiffness: float
    ...     thickness: float
    ...
    ...     def force(self, penetration, speed, touch_speed):
    ...         return self.stiffness * penetration * (1 + (penetration / self.thickness) ** 2)
    >>> link = jp.Link((0, 1), gap=0.5, contact=Cushion(stiffness=50.0, thickness=0.1))
    >>> link.contact.force(0.1, 0.0, 1.0)
    10.0
    """

    def force(self, penetration: Any, speed: Any, touch_speed: Any) -> Any:
        """The force p that pushes the blocks apart.

        Parameters
        ----------
        penetration
            δ ≥ 0; in runs above 0, so that roots of it need no guard.
        speed
            δ', positive in approach.
        touch_speed
            δ' at the touch, where this contact began; in runs above 0, at least a hundredth of what
            the relative acceleration adds in a step, without the links' forces too.
        """


def with_mass(law: Any, effective_mass: Any) -> Any:
    """The law for blocks of this effective mass.

    Its force may also be evaluated while the blocks are apart; a user-defined law is then called
    with a negligible penetration, and the touch speed of the last contact or 1.
    """
    for_mass = getattr(law, "for_mass", None)
    law = law if for_mass is None else for_mass(effective_mass)
    if isinstance(law, Newton | Hertz | _ForMass):
        return law
    flags = {"tension": may_pull(law), "linear": is_linear(law)}
    return unchecked(_Pressed, law=law, classes=node_classes(law), **flags)


def may_pull(law: Any) -> bool:
    """Whether a law's force may be negative; if not, the blocks separate instead."""
    return bool(getattr(law, "tension", False))


def is_linear(law: Any) -> bool:
    """Whether a law says that its force is a sum of multiples of what it depends on."""
    return bool(getattr(law, "linear", False))


@pytree_dataclass
class Newton:
    """Newton's law of impact: the blocks part at e times the speed at which they met.

    Contact has no duration, penetration or force, but the impulse (1 + e) m* δ'. A reaction force
    keeps blocks together that are pressed against each other at rest.

    Parameters
    ----------
    restitution
        e, in (0, 1]; .65 is usual for concrete, .4 to .75 has been studied.
    """

    restitution: Any = parameter(
        "e", words="restitution", above=0, most=1, usual=(0.4, 0.75), within=_RESTITUTION
    )


class _DampedLaw(Batch):
    """A law whose damping coefficient is computed once for an effective mass."""

    stiffness: Any
    restitution: Any
    _form: ClassVar[Callable[..., Any]]  # the force by stiffness, coefficient and a law's state

    def _damping_for(self: Any, effective_mass: Any) -> Any:
        return 2 * self.damping_ratio * jnp.sqrt(self.stiffness * effective_mass)

    def for_mass(self, effective_mass: Any) -> ContactLaw:
        """The law for blocks of this effective mass."""
        numbers = {"stiffness": self.stiffness, "damping": self._damping_for(effective_mass)}
        flags = {"tension": may_pull(self), "linear": is_linear(self)}
        return unchecked(_ForMass, **numbers, form=type(self)._form, **flags)

    def force(self, penetration: Any, speed: Any, touch_speed: Any) -> jax.Array:
        """The force; outside of runs for effective mass 1."""
        return self.for_mass(1.0).force(penetration, speed, touch_speed)


@pytree_dataclass
class _ForMass:
    """A law with its damping coefficient for an effective mass."""

    stiffness: Any
    damping: Any
    form: Callable[..., Any] = static()
    tension: bool = static()
    linear: bool = static()

    def force(self, penetration: Any, speed: Any, touch_speed: Any) -> Any:
        return self.form(self.stiffness, self.damping, penetration, speed, touch_speed)


def _spring_and_dashpot(k: Any, c: Any, penetration: Any, speed: Any, _: Any) -> Any:
    return k * penetration + c * speed


def _damped_hertz(k: Any, c: Any, penetration: Any, speed: Any, touch_speed: Any) -> Any:
    met = touch_speed > 0
    share = jnp.where(met, speed / jnp.where(met, touch_speed, 1.0), 0.0)
    return _elastic(k, penetration) * (1 + c * share)


def _hertz_damped_in_approach(k: Any, c: Any, penetration: Any, speed: Any, _: Any) -> Any:
    dashpot = c * _power(penetration, lambda x: jnp.sqrt(jnp.sqrt(x)))
    return _elastic(k, penetration) + dashpot * jnp.where(speed > 0, speed, 0.0)


@pytree_dataclass
class KelvinVoigt(_DampedLaw):
    r"""A spring and a dashpot, :math:`p = k δ + 2 ζ \sqrt{k m^*} δ'` (Anagnostopoulos 1988).

    The damping ratio is :math:`ζ = -\ln e / \sqrt{π^2 + \ln^2 e}`. At the touch the force jumps to
    that of the dashpot. Towards the end of contact it would pull; unless ``tension`` is set the
    blocks separate instead.

    With e = .4, .65, .9 the restitution of a free collision is .472, .675, .902, and with
    ``tension`` .4, .65, .9.

    Parameters
    ----------
    stiffness
        k > 0, in units of m1 ω1² for a dimensionless system, where 50 to 1,000 is usual
        (``contact_stiffness``).
    restitution
        e, in (0, 1].
    tension
        Whether the force may pull, until the penetration is 0.

    Examples
    --------
    >>> law = jp.KelvinVoigt(stiffness=400.0, restitution=0.65)
    >>> round(float(law.damping_ratio), 4)
    0.1359
    """

    stiffness: Any = parameter(
        "k", "stiffness", "contact stiffness", above=0, usual=(50.0, 1000.0), within=_STIFFNESS
    )
    restitution: Any = like(Newton, "restitution")
    tension: bool = static(default=False)
    linear: ClassVar[bool] = True
    _form = _spring_and_dashpot

    def __post_init__(self) -> None:
        if not isinstance(self.tension, bool | np.bool_):
            rule = "must be True or False"
            raise InvalidInput("tension", repr(self.tension), rule)
        object.__setattr__(self, "tension", bool(self.tension))
        super().__post_init__()

    @property
    def damping_ratio(self) -> jax.Array:
        """ζ, of the blocks on spring and dashpot."""
        decrement = -jnp.log(self.restitution)
        return decrement / jnp.sqrt(jnp.pi**2 + decrement**2)


@pytree_dataclass
class Hertz:
    r"""Hertz's elastic contact, :math:`p = k δ^{3/2}` (Hertz 1882).

    It loses no energy: the restitution of a free collision is 1.

    Parameters
    ----------
    stiffness
        k > 0, in units of m1 ω1³/√g for a dimensionless system, where 10,000 to 30,000 is usual.
    """

    stiffness: Any = parameter(
        "k", "hertz stiffness", "contact stiffness", above=0, usual=(1e4, 3e4), within=_STIFFNESS
    )

    def force(self, penetration: Any, speed: Any, touch_speed: Any) -> jax.Array:
        """The force; 0 without penetration."""
        return _elastic(self.stiffness, penetration)


@pytree_dataclass
class HertzDamped(_DampedLaw):
    r"""Hertz's contact with damping in proportion to it, :math:`p = k δ^{3/2} (1 + Z δ'/v_0)`.

    v0 is the speed at the touch; at v0 = 0, which runs avoid (``ContactLaw.force``), the force is
    Hertz's. The form is that of Hunt and Crossley (1975); the laws of the literature differ in Z:

    ===================  =============================  ===========================
    ``damping``          Z                              restitution of a collision
                                                        with e = .4, .65, .9
    ===================  =============================  ===========================
    ``"exact"``          Z (1 + e)                      .4, .65, .9
                         = ln((1 + Z)/(1 − Z e))
    ``"muthukumar"``     ¾ (1 − e²)                     .702, .775, .913
    ``"ye"``             8 (1 − e)/(5 e)                .363, .630, .894
    ``"hunt-crossley"``  1.5 (1 − e)                    .620, .739, .909
    ===================  =============================  ===========================

    With "exact" the restitution of a free collision is e. "muthukumar" is by Muthukumar and
    DesRoches (2006) after Lankarani and Nikravesh (1990), "ye" by Ye et al. (2009) and Flores et
    al. (2011).

    Parameters
    ----------
    stiffness, restitution
        As in ``Hertz`` and ``Newton``.
    damping
        "exact", "muthukumar", "ye" or "hunt-crossley".

    Examples
    --------
    >>> round(float(jp.HertzDamped(2e4, restitution=0.65).damping_factor), 4)
    0.7931
    """

    stiffness: Any = like(Hertz, "stiffness")
    restitution: Any = like(Newton, "restitution")
    damping: str = static(default="exact")
    _form = _damped_hertz

    def __post_init__(self) -> None:
        if self.damping not in [*_DAMPING_FACTORS]:
            rule = f"must be the name of a law for Z; {hint(self.damping, _DAMPING_FACTORS)}"
            raise InvalidInput("damping", repr(self.damping), rule)
        super().__post_init__()

    @property
    def damping_factor(self) -> Any:
        """Z."""
        return _DAMPING_FACTORS[self.damping](self.restitution)

    def _damping_for(self, effective_mass: Any) -> Any:
        return self.damping_factor


@pytree_dataclass
class Jankowski(_DampedLaw):
    r"""Hertz's contact with a dashpot in approach only (Jankowski 2005).

    :math:`p = k δ^{3/2} + 2 ζ \sqrt{k \sqrt{δ} m^*} δ'` in approach and :math:`k δ^{3/2}` in
    return, with :math:`ζ = (9\sqrt{5}/2) (1 - e^2) / (e (e (9π - 16) + 16))` (Jankowski 2006). At
    the touch the force rises with an infinite slope.

    With e = .4, .65, .9 the restitution of a free collision is .393, .647, .900.

    Parameters
    ----------
    stiffness, restitution
        As in ``Hertz`` and ``Newton``.
    """

    stiffness: Any = like(Hertz, "stiffness")
    restitution: Any = like(Newton, "restitution")
    _form = _hertz_damped_in_approach

    @property
    def damping_ratio(self) -> Any:
        """ζ."""
        e = self.restitution
        return 4.5 * 5**0.5 * (1 - e**2) / (e * (e * (9 * np.pi - 16) + 16))


@pytree_dataclass
class _Pressed:
    """A law for δ > 0; below, its force is that at a negligible penetration."""

    law: Any
    tension: bool = static()
    linear: bool = static()
    classes: tuple[type, ...] = static()

    def force(self, penetration: Any, speed: Any, touch_speed: Any) -> Any:
        # At the touch, where rounding may leave δ just below 0, the derivative is that of contact.
        # Third derivatives of powers such as δ^(1/2) must not overflow at the least penetration.
        limits = jnp.finfo(jnp.result_type(penetration, float))
        least = limits.tiny**0.25
        lifted = penetration + lax.stop_gradient(larger(least - penetration, 0.0))
        pressed = jnp.where(penetration > -(limits.eps**0.75), lifted, least)
        met = touch_speed > 0  # not before the first contact
        return self.law.force(pressed, speed, jnp.where(met, touch_speed, 1.0))


def _elastic(k: Any, penetration: Any) -> jax.Array:
    """Hertz's force, k δ^(3/2)."""
    return k * _power(penetration, lambda x: x * jnp.sqrt(x))


def _power(penetration: Any, power: Any) -> jax.Array:
    """A power of the penetration; it and its derivative are 0 without penetration."""
    pressed = penetration > 0
    return jnp.where(pressed, power(jnp.where(pressed, penetration, 1.0)), 0.0)


_DAMPING_FACTORS: dict[str, Callable[[Any], Any]] = {
    "exact": exact_damping_factor,
    "muthukumar": lambda e: 0.75 * (1 - e**2),
    "ye": lambda e: 1.6 * (1 - e) / e,
    "hunt-crossley": lambda e: 1.5 * (1 - e),
}
