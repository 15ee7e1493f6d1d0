"""Contact laws: the force between two blocks whose gap has closed.

The penetration δ is how far the closing of a link exceeds its gap, δ' its rate; m* = 1/(1/m_i +
1/m_j) is the effective mass of the two blocks, and e the coefficient of restitution: the speed at
which they part over that at which they met. ``Newton`` has an impulse, all others a force.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import factorial
from typing import Any, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxpound._checks import Range, hint, is_traced, one_batch, positive
from jaxpound._extrema import larger, smaller
from jaxpound._fields import assembled, check, like, parameter, pytree_dataclass, static

STIFFER_THAN_A_STOREY = 20.0
"""Stiffness of the contact over that of the stiffer storey (Anagnostopoulos 1988)."""

_STIFFNESS = Range(1e-3, 1e20, "", "N/m, and N/m^1.5 for laws after Hertz")
_RESTITUTION = Range(1e-3, 1, "", "speed at parting over speed at touch; 0.65 for concrete")


@runtime_checkable
class ContactLaw(Protocol):
    """A law of contact with a force: one of those here, or one of one's own.

    A law is a pytree, whose numbers are traced and differentiated. It is a force alone: where
    contact begins and ends is found by the run. What the force does with speed 0 is stored, the
    rest of its work is lost.

    Two more members may be there. ``tension``, a bool, says whether the force may pull while the
    blocks are in contact; without it, or where it is False, the blocks let go: a negative force is
    none. ``for_mass(effective_mass)`` returns a law with the force for blocks of that effective
    mass. It is for laws whose damping follows from a restitution, and so from the mass, and for
    what need not be computed again at every call of ``force``; such a law's own ``force`` is that
    for effective mass 1.

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
            δ ≥ 0.
        speed
            δ', positive in approach.
        touch_speed
            δ' at the touch, where this contact began; 0 for blocks that touch at rest.
        """


def bound(law: Any, effective_mass: Any) -> Any:
    """A law with the force for blocks of this effective mass, at any penetration.

    A law of one's own is never asked for its force at a negative one.
    """
    for_mass = getattr(law, "for_mass", None)
    found = law if for_mass is None else for_mass(effective_mass)
    ours = (Newton, Hertz, _Viscous, _HertzFactored, _HertzInApproach)
    return found if isinstance(found, ours) else assembled(_Pressed, law=found)


def may_pull(law: Any) -> bool:
    """Whether a law's force may be negative; if not, the blocks let go."""
    return bool(getattr(law, "tension", False))


@pytree_dataclass
class Newton:
    """Newton's law of impact: the blocks part at e times the speed at which they met.

    Contact has no duration, penetration or force, but the impulse (1 + e) m* δ'. Blocks that are
    pressed together at rest stay so, by the force that this takes.

    Parameters
    ----------
    restitution
        e, in (0, 1]; .65 is usual for concrete, .4 to .75 has been studied.

    Raises
    ------
    ValueError
        If a known value breaks its rule. Traced values cannot raise: a run with an invalid law
        returns NaN in every result. So it is with all laws.
    """

    restitution: Any = parameter(
        "e", words="restitution", above=0, most=1, usual=(0.4, 0.75), within=_RESTITUTION
    )


@pytree_dataclass
class KelvinVoigt:
    r"""A spring and a dashpot, :math:`p = k δ + 2 ξ \sqrt{k m^*} δ'` (Anagnostopoulos 1988).

    The damping ratio is :math:`ξ = -\ln e / \sqrt{π^2 + \ln^2 e}`. The force jumps to its dashpot's
    as the blocks touch. Towards the end of contact it would pull; unless ``tension`` is set they
    let go instead.

    Asked for e = .4, .65, .9, a free collision really returns .472, .675, .902, and with
    ``tension`` .4, .65, .9.

    Parameters
    ----------
    stiffness
        k > 0, in units of m1 ω1² for a dimensionless system, where 50 to 1,000 is usual
        (``contact_stiffness``).
    restitution
        e, in (0, 1].
    tension
        Whether the force may pull, until the penetration has gone.

    Raises
    ------
    ValueError
        If a known value breaks its rule.

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

    def __post_init__(self) -> None:
        if not isinstance(self.tension, bool | np.bool_):
            raise ValueError(f"KelvinVoigt: tension = {self.tension!r} must be True or False")
        object.__setattr__(self, "tension", bool(self.tension))
        _check_one_batch(self)

    @property
    def damping_ratio(self) -> jax.Array:
        """ξ, of the blocks on spring and dashpot."""
        decrement = -jnp.log(self.restitution)
        return decrement / jnp.sqrt(jnp.pi**2 + decrement**2)

    def for_mass(self, effective_mass: Any) -> ContactLaw:
        """The law for blocks of this effective mass."""
        damping = 2 * self.damping_ratio * jnp.sqrt(self.stiffness * effective_mass)
        return assembled(_Viscous, stiffness=self.stiffness, damping=damping, tension=self.tension)

    def force(self, penetration: Any, speed: Any, touch_speed: Any) -> jax.Array:
        """The force for effective mass 1; neither clamped nor clipped."""
        return self.for_mass(1.0).force(penetration, speed, touch_speed)


@pytree_dataclass
class Hertz:
    r"""Hertz's elastic contact, :math:`p = k δ^{3/2}` (Hertz 1882).

    Nothing is lost: a free collision returns 1.

    Parameters
    ----------
    stiffness
        k > 0, in units of m1 ω1³/√g for a dimensionless system, where 10,000 to 30,000 is usual.

    Raises
    ------
    ValueError
        If a known value breaks its rule.
    """

    stiffness: Any = parameter(
        "k", "hertz stiffness", "contact stiffness", above=0, usual=(1e4, 3e4), within=_STIFFNESS
    )

    def force(self, penetration: Any, speed: Any, touch_speed: Any) -> jax.Array:
        """The force; 0 without penetration."""
        return self.stiffness * _power(penetration, _three_halves)


@pytree_dataclass
class HertzDamped:
    r"""Hertz's contact with damping that grows with it, :math:`p = k δ^{3/2} (1 + Z δ'/v_0)`.

    v0 is the speed at the touch. The form is that of Hunt and Crossley (1975); the laws of the
    literature differ in Z:

    ===================  =============================  ===========================
    ``damping``          Z                              really returned, asked for
                                                        e = .4, .65, .9
    ===================  =============================  ===========================
    ``"exact"``          Z (1 + e)                      .4, .65, .9
                         = ln((1 + Z)/(1 − Z e))
    ``"muthukumar"``     ¾ (1 − e²)                     .702, .775, .913
    ``"ye"``             8 (1 − e)/(5 e)                .363, .630, .894
    ``"hunt-crossley"``  1.5 (1 − e)                    .620, .739, .909
    ===================  =============================  ===========================

    "exact" makes a free collision return what was asked for. "muthukumar" is by Muthukumar and
    DesRoches (2006) after Lankarani and Nikravesh (1990), "ye" by Ye et al. (2009) and Flores et
    al. (2011).

    Parameters
    ----------
    stiffness
        k > 0, as of ``Hertz``.
    restitution
        e, in (0, 1].
    damping
        "exact", "muthukumar", "ye" or "hunt-crossley".

    Raises
    ------
    ValueError
        If a known value breaks its rule, or the damping is unknown.

    Examples
    --------
    >>> for damping in ("exact", "muthukumar", "ye", "hunt-crossley"):
    ...     law = jp.HertzDamped(2e4, restitution=0.65, damping=damping)
    ...     print(f"{damping}: {float(law.damping_factor):.4f}")
    exact: 0.7931
    muthukumar: 0.4331
    ye: 0.8615
    hunt-crossley: 0.5250
    """

    stiffness: Any = like(Hertz, "stiffness")
    restitution: Any = like(Newton, "restitution")
    damping: str = static(default="exact")

    def __post_init__(self) -> None:
        if self.damping not in [*_DAMPING_FACTORS]:
            told = f"HertzDamped: damping = {self.damping!r} must be the name of a law for Z"
            raise ValueError(f"{told}; {hint(self.damping, _DAMPING_FACTORS)}")
        _check_one_batch(self)

    @property
    def damping_factor(self) -> Any:
        """Z."""
        return _DAMPING_FACTORS[self.damping](self.restitution)

    def for_mass(self, effective_mass: Any) -> ContactLaw:
        """The law with Z computed once; the effective mass does not matter to it."""
        return assembled(_HertzFactored, stiffness=self.stiffness, factor=self.damping_factor)

    def force(self, penetration: Any, speed: Any, touch_speed: Any) -> jax.Array:
        """The force; 0 without penetration, that of ``Hertz`` for blocks that touch at rest."""
        return self.for_mass(1.0).force(penetration, speed, touch_speed)


@pytree_dataclass
class Jankowski:
    r"""Hertz's contact with a dashpot in approach alone (Jankowski 2005).

    :math:`p = k δ^{3/2} + 2 ξ \sqrt{k \sqrt{δ} m^*} δ'` in approach and :math:`k δ^{3/2}` in
    return, with :math:`ξ = (9\sqrt{5}/2) (1 - e^2) / (e (e (9π - 16) + 16))` (Jankowski 2006). At
    the touch the force rises with an infinite slope.

    Asked for e = .4, .65, .9, a free collision really returns .393, .647, .900.

    Parameters
    ----------
    stiffness
        k > 0, as of ``Hertz``.
    restitution
        e, in (0, 1].

    Raises
    ------
    ValueError
        If a known value breaks its rule.
    """

    stiffness: Any = like(Hertz, "stiffness")
    restitution: Any = like(Newton, "restitution")

    def __post_init__(self) -> None:
        _check_one_batch(self)

    @property
    def damping_ratio(self) -> Any:
        """ξ."""
        e = self.restitution
        return 4.5 * 5**0.5 * (1 - e**2) / (e * (e * (9 * np.pi - 16) + 16))

    def for_mass(self, effective_mass: Any) -> ContactLaw:
        """The law for blocks of this effective mass."""
        damping = 2 * self.damping_ratio * jnp.sqrt(self.stiffness * effective_mass)
        return assembled(_HertzInApproach, stiffness=self.stiffness, damping=damping)

    def force(self, penetration: Any, speed: Any, touch_speed: Any) -> jax.Array:
        """The force for effective mass 1; 0 without penetration, as is its derivative there."""
        return self.for_mass(1.0).force(penetration, speed, touch_speed)


def contact_stiffness(
    *,
    modulus: Any = None,
    area: Any = None,
    length: Any = None,
    storeys: Sequence[Any] | None = None,
) -> Any:
    """A stiffness for ``KelvinVoigt``, from the colliding floor or from the storeys beside it.

    The floor's is its axial stiffness E A/L (Maison and Kasai 1992); without floor plans 20 times
    the stiffness of the stiffer storey will do (Anagnostopoulos 1988). Any consistent units.

    Parameters
    ----------
    modulus
        Young's modulus E > 0 of the floor.
    area
        Cross-section A > 0 of the floor, across the direction of impact.
    length
        Length L > 0 of the floor in the direction of impact.
    storeys
        Stiffness > 0 of the colliding storeys, two numbers.

    Raises
    ------
    ValueError
        If a known value breaks its rule, or neither or both of floor and storeys are given.

    Examples
    --------
    >>> f"{jp.contact_stiffness(modulus=30e9, area=2.0, length=15.0):.3g} N/m"
    '4e+09 N/m'
    >>> float(jp.contact_stiffness(storeys=(1.0, 2.5)))
    50.0
    """
    owner, floor = "contact_stiffness", {"modulus": modulus, "area": area, "length": length}
    if (storeys is None) == all(x is None for x in floor.values()):
        raise ValueError(f"{owner}: give either modulus, area and length, or storeys")
    if storeys is None:
        modulus, area, length = positive(owner, **floor)
        return modulus * area / length
    try:
        one, other = storeys
    except (TypeError, ValueError):
        raise ValueError(f"{owner}: storeys = {storeys!r} must be two numbers") from None
    one, other = positive(owner, **{"storeys.0": one, "storeys.1": other})
    stiffer = larger(one, other) if is_traced((one, other)) else np.maximum(one, other)
    return STIFFER_THAN_A_STOREY * stiffer


@pytree_dataclass
class _Viscous:
    """A spring and a dashpot."""

    stiffness: Any
    damping: Any
    tension: bool = static()

    def force(self, penetration: Any, speed: Any, touch_speed: Any) -> Any:
        return self.stiffness * penetration + self.damping * speed


@pytree_dataclass
class _HertzFactored:
    """k δ^(3/2) (1 + Z δ'/v0)."""

    stiffness: Any
    factor: Any

    def force(self, penetration: Any, speed: Any, touch_speed: Any) -> jax.Array:
        met = touch_speed > 0
        share = jnp.where(met, speed / jnp.where(met, touch_speed, 1.0), 0.0)
        return self.stiffness * _power(penetration, _three_halves) * (1 + self.factor * share)


@pytree_dataclass
class _HertzInApproach:
    """k δ^(3/2) + c δ^(1/4) δ', the second term in approach."""

    stiffness: Any
    damping: Any

    def force(self, penetration: Any, speed: Any, touch_speed: Any) -> jax.Array:
        elastic = self.stiffness * _power(penetration, _three_halves)
        dashpot = self.damping * _power(penetration, _fourth_root)
        return elastic + dashpot * jnp.where(speed > 0, speed, 0.0)


@pytree_dataclass
class _Pressed:
    """A law that holds for δ ≥ 0; below it has its force without penetration."""

    law: Any

    @property
    def tension(self) -> bool:
        return may_pull(self.law)

    def force(self, penetration: Any, speed: Any, touch_speed: Any) -> Any:
        # At touch, where rounding may leave δ a little below 0, the derivative is that of contact.
        limits = jnp.finfo(jnp.result_type(penetration, float))
        least = jnp.sqrt(limits.tiny)
        lifted = penetration + lax.stop_gradient(larger(least - penetration, 0.0))
        pressed = jnp.where(penetration > -(limits.eps**0.75), lifted, 0.0)
        return self.law.force(pressed, speed, touch_speed)


def _check_one_batch(law: Any) -> None:
    check(law)
    one_batch(type(law).__name__, stiffness=law.stiffness, restitution=law.restitution)


def _three_halves(x: jax.Array) -> jax.Array:
    return x * jnp.sqrt(x)


def _fourth_root(x: jax.Array) -> jax.Array:
    return jnp.sqrt(jnp.sqrt(x))


def _power(penetration: Any, of: Any) -> jax.Array:
    """A power of the penetration; it and its derivative are 0 where there is none."""
    pressed = penetration > 0
    return jnp.where(pressed, of(jnp.where(pressed, penetration, 1.0)), 0.0)


@jax.jit
def _exact(restitution: Any) -> jax.Array:
    """The root Z of Z (1 + e) = ln((1 + Z)/(1 − Z e)), with its derivatives up to the third.

    This integrates m* w dw/(1 + Z w/v0) = −k δ^(3/2) dδ over a free collision, from w = v0 to w =
    −e v0, both at δ = 0. In y = Z (1 + e) it can be solved for e (``_loss``), and nothing is
    singular where Z comes near 1/e, as it does for small e.
    """
    wanted = (1 - restitution) / restitution
    known = lax.stop_gradient(wanted)

    def improve(y: jax.Array, _: None) -> tuple[jax.Array, None]:
        value, slope = _with_slope(y)
        return y + (known - value) / slope, None

    # The loss is at least y/3 and at least y − 2; from there five of Newton's steps are enough.
    y, _ = lax.scan(improve, smaller(3 * known, known + 2), length=5)
    for _ in range(2):  # which can be differentiated
        value, slope = _with_slope(y)
        y = y + (wanted - value) / slope
    return y / (1 + restitution)


def _with_slope(y: jax.Array) -> tuple[jax.Array, jax.Array]:
    return jax.jvp(_loss, (y,), (jnp.ones_like(y),))


def _loss(y: jax.Array) -> jax.Array:
    """1/e − 1 = ((2 + y) exp(−y) − 2 + y) / (1 − (1 + y) exp(−y)), for y ≥ 0.

    Near y = 0, where both differences cancel, by their series over y².
    """
    near, far = smaller(y, _NEAR), larger(y, _NEAR)
    above = below = jnp.zeros_like(y)
    for n in reversed(range(_TERMS)):
        above = (n + 1) / factorial(n + 3) - near * above
        below = (n + 1) / factorial(n + 2) - near * below
    decay = jnp.exp(-far)
    closed = ((2 + far) * decay - 2 + far) / (1 - (1 + far) * decay)
    return jnp.where(y < _NEAR, near * above / below, closed)


_NEAR = 2.0
_TERMS = 25  # the first term left out is below 1e-17 of the sum

_DAMPING_FACTORS: dict[str, Callable[[Any], Any]] = {
    "exact": _exact,
    "muthukumar": lambda e: 0.75 * (1 - e**2),
    "ye": lambda e: 1.6 * (1 - e) / e,
    "hunt-crossley": lambda e: 1.5 * (1 - e),
}
