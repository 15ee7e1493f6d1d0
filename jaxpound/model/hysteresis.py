"""Laws of hysteresis, of rods that yield, and the fractional Zener rod whose spring yields.

A law is rate independent: its state changes with the elongation e only. With the rod's stiffness K
its force is K r(e, state), where r, the *reduced force*, is e before it has yielded.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol, TypeVar, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound._checks import Range, Rule, finite
from jaxpound._extrema import larger
from jaxpound._fields import Batch, Parameter, like, parameter, part, pytree_dataclass, walk
from jaxpound.model.dampers import Dashpot, PowerLaw
from jaxpound.model.parameters import replaced
from jaxpound.model.rod import Spring, ZenerRod

State = TypeVar("State")

_LENGTH = Range(1e-9, 1e6, "", "from models to towers, in m or g/ω1²")
_END = _LENGTH._replace(high=np.inf)
_WEAR = Range(0, 100, "", "for each K e_y² of energy; usually 0 to 0.1")


@runtime_checkable
class HysteresisLaw(Protocol[State]):
    """A law of hysteresis, user-defined ones included: the material of a rod that yields.

    A law is a pytree, whose numbers are traced and differentiated, and so is its state, of which
    every leaf is a number. The run finds where the elongation turns: ``advance`` gets changes in
    one direction only.

    Two more members are optional. ``kink(state, direction)`` returns the elongation at which the
    slope of the reduced force jumps while the elongation grows (``direction`` 1) or falls (−1), and
    the jump of the slope there; with it gradients are of second order in the time step, for laws
    with a force of continuous slope they are without. ``ultimate_displacement`` is the elongation
    at which the rod collapses: beyond it the reduced force stays constant.

    Examples
    --------
    The page on extending has a user-defined law. Those of the library:

    >>> all(isinstance(law(0.1), jp.model.HysteresisLaw) for law in (jp.Bilinear, jp.BoucWen))
    True
    """

    yield_displacement: Any
    """e_y, the elongation at which the rod yields first; ductility is in units of it."""

    def start(self, elongation: Any) -> State:
        """The state of a new rod that has been stretched to an elongation in one direction."""

    def advance(self, state: State, before: Any, after: Any) -> State:
        """The state after a change of the elongation in one direction, or none."""

    def reduced_force(self, elongation: Any, state: State) -> Any:
        """r, the force over the stiffness K."""

    def dissipated(self, state: State) -> Any:
        """Energy dissipated until now, over K."""


class Plastic(NamedTuple):
    """State of a bilinear rod."""

    elongation: Any
    """That of the slider, p = e − e_y z."""
    dissipated: Any


@pytree_dataclass
class Bilinear(Batch):
    r"""A bilinear rod, :math:`f = K (α e + (1 - α) e_y z)`, with z' = e'/e_y inside |z| < 1.

    At z = ±1 it yields, and z stays there until the elongation e turns: a spring of stiffness α K
    beside one of (1 − α) K in series with a slider. α = 0 is the elastoplastic rod; several rods
    beside each other (Iwan 1966) have any backbone.

    Raises ``ValueError`` if a concrete value breaks its rule.

    Parameters
    ----------
    yield_displacement
        e_y > 0, in units of g/ω1² for a dimensionless system.
    hardening
        α, the stiffness after yield over that before, from −1 to 1; usually .02 to .1. If it is
        negative, ``ultimate_displacement`` must be finite.
    ultimate_displacement
        The elongation ≥ e_y at which the rod collapses, in its unit; infinite by default. Beyond it
        the force stays what it is there, so that a run that diverges remains finite.

    Examples
    --------
    >>> law = jp.Bilinear(yield_displacement=0.1, hardening=0.05)
    >>> stretched = law.start(0.3)
    >>> round(float(law.reduced_force(0.3, stretched)), 4)  # 0.1 + 0.05 * 0.2
    0.11
    """

    yield_displacement: Any = parameter("e_y", "length", above=0, usual=(0.01, 1.0), within=_LENGTH)
    hardening: Any = parameter(r"\alpha", least=-1, most=1, usual=(0.0, 0.3), default=0.0)
    ultimate_displacement: Any = parameter(
        "e_u", "length", least="yield_displacement", finite=False, within=_END, default=np.inf
    )

    def more_rules(self, prefix: str) -> list[Rule]:
        """A rod whose stiffness may be negative collapses somewhere."""
        limit = self.ultimate_displacement
        holds = finite(limit) | (self.hardening >= 0)
        rule = "finite where hardening is negative: there the rod collapses"
        return [Rule(f"{prefix}ultimate_displacement", limit, holds, rule)]

    def start(self, elongation: Any) -> Plastic:
        """The state of a new rod that has been stretched to an elongation."""
        zero = 0 * jnp.asarray(elongation)
        return self.advance(Plastic(zero, zero), zero, elongation)

    def advance(self, state: Plastic, before: Any, after: Any) -> Plastic:
        """The state after a change of the elongation in one direction: the slider follows."""
        p, e_y = state.elongation, self.yield_displacement
        low, high = after - e_y, after + e_y
        place = jnp.where(low > p, low, jnp.where(high < p, high, p))
        work = (1 - self.hardening) * e_y * jnp.abs(place - p)
        return Plastic(place, state.dissipated + work)

    def reduced_force(self, elongation: Any, state: Plastic) -> Any:
        """The force over the stiffness K."""
        return elongation - (1 - self.hardening) * state.elongation

    def dissipated(self, state: Any) -> Any:
        """Energy dissipated until now, over K."""
        return state.dissipated

    def kink(self, state: Plastic, direction: Any) -> tuple[Any, Any]:
        """Where the rod will yield, and the change of its slope there."""
        return state.elongation + direction * self.yield_displacement, self.hardening - 1


class Smooth(NamedTuple):
    """State of a Bouc–Wen rod."""

    z: Any
    dissipated: Any


@pytree_dataclass
class BoucWen(Batch):
    r"""A rod after Bouc, Wen, Baber and Noori, :math:`f = K (α e + (1 - α) e_y z)`.

    .. math:: z' = \frac{e'}{e_y} \frac{1 - |z|^n (β\, \mathrm{sgn}(e' z) + γ) ν}{η},
       \quad γ = 1 - β, \quad ν = 1 + δ_ν ε, \quad η = 1 + δ_η ε

    ε is the dissipated energy over K e_y². So z is a number between −1 and 1 and e_y the elongation
    where the elastic line meets the force at yield (Wen 1976; Baber and Noori 1985). Baber and
    Noori's A is 1: it has the effect of the other parameters (Ma et al. 2004).

    Beware of names. OpenSees' ``BoucWen`` takes α, K, n, γ, β with β at the sgn term, as here, and
    the z of a length: its γ and β are ours over e_y^n, its A is 1, its δ_ν and δ_η are ours over
    K e_y² (its energy is (1 − α) K ∫ z e'). Others, structdyn among them, call γ what is β here.

    Raises ``ValueError`` if a concrete value breaks its rule.

    Parameters
    ----------
    yield_displacement, hardening, ultimate_displacement
        As in ``Bilinear``.
    exponent
        n ≥ 1, how sharply the rod yields: 1 to 2 for concrete, 2 to 5 for steel; n → ∞ is
        ``Bilinear``.
    beta
        β, from 0 to 1; .5 unloads along the elastic line.
    strength_degradation, stiffness_degradation
        δ_ν and δ_η ≥ 0; usually 0 to .1.

    Examples
    --------
    >>> law = jp.BoucWen(yield_displacement=0.1, hardening=0.0, exponent=2.0, beta=0.5)
    >>> state = law.start(0.0)
    >>> for step in range(20):  # a tenth of e_y each
    ...     state = law.advance(state, 0.01 * step, 0.01 * (step + 1))
    >>> bool(abs(state.z - np.tanh(2.0)) < 1e-3)  # the exact law for n = 2
    True
    """

    yield_displacement: Any = like(Bilinear, "yield_displacement")
    hardening: Any = like(Bilinear, "hardening", default=0.0)
    exponent: Any = parameter("n", least=1, usual=(1.0, 5.0), within=Range(1, 50), default=2.0)
    beta: Any = parameter(r"\beta", least=0, most=1, default=0.5)
    strength_degradation: Any = parameter(r"\delta_\nu", least=0, within=_WEAR, default=0.0)
    stiffness_degradation: Any = parameter(r"\delta_\eta", least=0, within=_WEAR, default=0.0)
    ultimate_displacement: Any = like(Bilinear, "ultimate_displacement", default=np.inf)

    more_rules = Bilinear.more_rules
    dissipated = Bilinear.dissipated

    def start(self, elongation: Any) -> Smooth:
        """The state of a new rod that has been stretched to an elongation, in 64 steps."""
        change = jnp.asarray(elongation) / 64
        state = Smooth(0 * change, 0 * change)
        return jax.lax.fori_loop(
            0, 64, lambda i, state: self.advance(state, i * change, (i + 1) * change), state
        )

    def advance(self, state: Smooth, before: Any, after: Any) -> Smooth:
        """The state after a change of the elongation in one direction, to second order.

        By the exponential Rosenbrock–Euler method, exact for n = 1 and stable for any change
        (Hochbruck and Ostermann 2010). z' has a kink where z changes its sign: the way to there is
        a step of its own, by the midpoint rule in z.
        """
        e_y, change = self.yield_displacement, after - before
        power = _power(state.z, self.exponent)
        slope = self._slope(state, change, power * jnp.exp2(-self.exponent))  # at z/2
        crosses = (change * state.z < 0) & (slope * jnp.abs(change) > e_y * jnp.abs(state.z))
        way = jnp.where(crosses, -e_y * state.z / jnp.where(crosses, slope, 1.0), 0.0)
        state = self._moved(state, way, jnp.where(crosses, 0.0, state.z))
        change, power = change - way, jnp.where(crosses, 0.0, power)
        half = state.z + change / (2 * e_y) * self._slope(state, change, power)
        state_halfway = self._moved(state, change / 2, half)
        worn = state._replace(dissipated=state_halfway.dissipated)
        slope = self._slope(worn, change, power)
        exponent = self._bend(state_halfway, change) * jnp.abs(change) / e_y
        curved = jnp.abs(exponent) > 1e-4
        exact = jnp.expm1(exponent) / jnp.where(curved, exponent, 1.0)
        z = state.z + change / e_y * slope * jnp.where(curved, exact, 1 + exponent / 2)
        outside = jnp.abs(z) > larger(jnp.abs(state.z), 1.0)  # after a very large change
        return self._moved(state, change, jnp.where(outside, jnp.sign(z), z))

    def _slope(self, state: Smooth, change: Any, power: Any) -> Any:
        """e_y dz/de, with |z|^n."""
        return (1 - self._strength(state, change) * power) / self._softening(state)

    def _bend(self, state: Smooth, change: Any) -> Any:
        """Derivative of ``_slope`` by z, where the elongation grows."""
        loss = self._strength(state, change) * _power(state.z, self.exponent - 1)
        sign = jnp.where(change * state.z < 0, 1.0, -1.0)
        return sign * self.exponent * loss / self._softening(state)

    def _strength(self, state: Smooth, change: Any) -> Any:
        worn = state.dissipated / self.yield_displacement**2
        share = jnp.where(change * state.z < 0, 1 - 2 * self.beta, 1.0)
        return share * (1 + self.strength_degradation * worn)

    def _softening(self, state: Smooth) -> Any:
        return 1 + self.stiffness_degradation * state.dissipated / self.yield_displacement**2

    def _moved(self, state: Smooth, change: Any, z: Any) -> Smooth:
        """The state with another z after a change of the elongation, by the work in between."""
        e_y = self.yield_displacement
        slid = change - e_y * (z - state.z)
        work = (1 - self.hardening) * e_y * (state.z + z) / 2 * slid
        return Smooth(z, state.dissipated + work)

    def reduced_force(self, elongation: Any, state: Smooth) -> Any:
        """The force over the stiffness K."""
        return elongation - (1 - self.hardening) * (elongation - self.yield_displacement * state.z)


def _power(z: Any, exponent: Any) -> Any:
    """|z|^n, 0 at z = 0; the derivative by n there is 0 as well.

    By the exponential of the logarithm, which takes half the time of a power, and has derivatives
    without further powers.
    """
    is_zero = z == 0
    return jnp.where(is_zero, 0.0, jnp.exp(exponent * jnp.log(jnp.where(is_zero, 1.0, jnp.abs(z)))))


@pytree_dataclass
class YieldingZener:
    """A fractional Zener rod whose spring yields, f = Z[e] − K e + K r(e).

    Z[e] is the force of the fractional rod and K r(e) that of the law of hysteresis, which replaces
    its spring: until it yields, the rod is the fractional rod. The damping stays beside the
    yielding spring and adds to its strength, as in most programs (Hall 2006 on what that costs).

    Parameters
    ----------
    zener
        The rod before it yields.
    hysteresis
        ``Bilinear``, ``BoucWen`` or any ``HysteresisLaw``.

    Examples
    --------
    >>> steel = jp.ZenerRod(order=0.5, tau_f=0.01, tau_x=0.05)
    >>> law = jp.Bilinear(yield_displacement=0.1, hardening=0.03)
    >>> material = jp.model.YieldingZener(steel, law)
    >>> storeys = jp.Storeys(masses=(1.0, 1.0), rods=jp.Rod(material, stiffness=5.0))
    """

    zener: ZenerRod = part(ZenerRod)
    hysteresis: Any = part(HysteresisLaw, traced=True)


def zener_of(material: Any) -> ZenerRod | None:
    """The fractional rod of a material, with a memory; None for materials without one."""
    rod = material.zener if isinstance(material, YieldingZener) else material
    return rod if isinstance(rod, ZenerRod) else None


def hysteresis_of(material: Any) -> Any:
    """The law of hysteresis of a material; None for one that does not yield."""
    law = material.hysteresis if isinstance(material, YieldingZener) else material
    return None if isinstance(law, ZenerRod | Spring | PowerLaw | Dashpot) else law


def material_in(material: Any, frequency: Any, length: Any = 1.0) -> Any:
    """A material with times in units of 1/frequency^order, displacements in those of a length."""
    changes = {}
    for path, spec, x in walk(material, Parameter):
        if path.endswith(("tau_f", "tau_x")):
            changes[path] = x * frequency ** before_yield(material).order
        elif spec.kind == "length":
            changes[path] = x / length
    return replaced(material, changes) if changes else material


def before_yield(material: Any) -> ZenerRod:
    """The fractional rod as which a material begins: of a law alone an elastic spring."""
    return zener_of(material) or ZenerRod(1.0, 1.0, 1.0)
