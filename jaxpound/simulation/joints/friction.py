r"""The friction of a link: Coulomb's set-valued law q ∈ μ Sgn(w) over one step, w = x_i' − x_j'.

The slip velocity obeys w' = A − R q, with A the relative acceleration of the link's ends without
friction and R the sum of their inverse masses (A = −f1 + ρ f2 and R = 1 + ρ for the paper's pair).
A law takes w from t_m − h/2 to t_m + h/2. Within a step time is counted by τ from 0 to 1, and
A(τ) = A_m + D (τ − ½) with D = A_m − A_{m−1}.
"""

from __future__ import annotations

import dataclasses
from typing import Any, ClassVar, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
from jax import lax

from jaxpound._checks import is_traced, positive_number
from jaxpound._errors import InvalidInput
from jaxpound.simulation.joints.coulomb import slip_stick
from jaxpound.simulation.joints.motion import LinkMotion, LinkStep


@runtime_checkable
class FrictionLaw(Protocol):
    """A law of friction, by which a link moves over one step."""

    set_valued: ClassVar[bool]
    """Whether |q| = μ in any slip."""

    def slide(self, before: LinkStep) -> LinkMotion:
        """One step of the link."""


@dataclasses.dataclass(frozen=True)
class EventResolved:
    """Coulomb's law with the instants of stopping and of breaking away found within the step.

    The step is slip until θ, stick until φ, slip until its end; θ = 1 is a step without event, θ <
    φ < 1 a stop with a breakaway after it, θ = φ a reversal. All three follow in closed form from
    the linear A(τ). Value and gradient of a run are second-order accurate in h, in the root mean
    square over where events fall within a step. More events than these in one step are not
    resolved, so that phases shorter than a step may be missed; the force stays within ±μ.
    """

    set_valued: ClassVar[bool] = True

    def slide(self, before: LinkStep) -> LinkMotion:
        """One step of the link."""
        w, _, a, rise, inverse_mass, mu, h = before
        motion = slip_stick(w, a, rise, inverse_mass * mu, h)
        before_turn, after_turn = motion.turn_forces
        return motion._replace(
            force=motion.force / inverse_mass,
            turns=motion.turns > 0,
            turn_forces=(before_turn / inverse_mass, after_turn / inverse_mass),
        )


@dataclasses.dataclass(frozen=True)
class Switching:
    """The paper's law (eqs. 10–12): stick or slip for the whole step, chosen by ``jnp.where``.

    Stick ends when the force needed for it, A/R, exceeds μ; slip ends, in stick or in slip the
    other way, one step after w has changed sign. The paper then gives x_j the velocity of x_i,
    without a force that makes it (``stop``). First-order accurate, and its derivatives miss how
    the switching instants move with the parameters.
    """

    set_valued: ClassVar[bool] = True

    def slide(self, before: LinkStep) -> LinkMotion:
        """One step of the link."""
        w, phase, a, _, inverse_mass, mu, h = before
        hold = a / inverse_mass
        leaves = (phase == 0) | (w * phase <= 0)
        pushed = jnp.where(jnp.abs(hold) <= mu, 0.0, jnp.where(phase == 0, jnp.sign(hold), -phase))
        new_phase = jnp.where(leaves, pushed, phase)
        sticks = new_phase == 0
        force = jnp.where(sticks, hold, mu * new_phase)
        w_new = jnp.where(sticks, 0.0, w + h * (a - inverse_mass * force))
        turns, turn_time, turn = vertex(w, w_new, h)
        return LinkMotion(
            velocity=w_new,
            force=force,
            velocity_now=(w + w_new) / 2,
            jump=jnp.zeros_like(w),
            turns=turns,
            turn_time=turn_time,
            turn=turn,
            turn_forces=(force, force),
            phase=new_phase,
            change_time=jnp.where(phase == 0, 0.0, -h) * jnp.ones_like(w),
            stop=jnp.where(sticks, -w, 0.0),
        )


@dataclasses.dataclass(frozen=True)
class Smoothed:
    """Regularised friction, q = μ tanh(w / velocity), by an L-stable second-order implicit step.

    w' = A − R μ tanh(w/v_s) is taken over the step by the two-stage SDIRK method with γ = 1 − 1/√2
    (Alexander 1977); each stage is one monotone scalar equation. No width is unstable, and v_s → 0
    gives stick (w = 0) wherever Coulomb's law does. There is no true stick: blocks creep at
    w ≈ v_s A/(Rμ), so that ``phase`` is the sign of w.

    The gradient tends to that of ``EventResolved`` as v_s falls, if steps resolve it: a v_s that
    steps jump over spoils the gradient, much more than the value. Take at least h/2 times the
    largest relative acceleration, half of ``abs(diff(v1 - v2)).max()`` of a run.

    Parameters
    ----------
    velocity
        v_s > 0, the slip velocity at which friction reaches 76 % of μ, in units of g/ω1.
    """

    velocity: float
    set_valued: ClassVar[bool] = False

    def __post_init__(self) -> None:
        if is_traced(self.velocity):
            rule = "shapes the program and cannot be traced"
            raise InvalidInput("velocity", "", rule)
        (velocity,) = positive_number(velocity=self.velocity)
        object.__setattr__(self, "velocity", float(velocity))

    def slide(self, before: LinkStep) -> LinkMotion:
        """One step of the link."""
        w, _, a, _, inverse_mass, mu, h = before
        # Widths below √tiny make no difference; the limit keeps brake / width finite.
        width = jnp.maximum(jnp.asarray(self.velocity, w.dtype), jnp.finfo(w.dtype).tiny ** 0.5)
        share = 1 - 0.5**0.5
        brake = h * share * inverse_mass * mu
        push = h * share * a
        stage = _creep(w + push, brake, width)
        slope = (stage - w) / share  # h w' at the first stage
        w_new = _creep(w + (1 - share) * slope + push, brake, width)
        w_now = (w + w_new) / 2
        turns, turn_time, turn = vertex(w, w_new, h)
        return LinkMotion(
            velocity=w_new,
            force=mu * jnp.tanh(_ratio(w_now, width)),
            velocity_now=w_now,
            jump=jnp.zeros_like(w),
            turns=turns,
            turn_time=turn_time,
            turn=turn,
            turn_forces=(jnp.zeros_like(w), jnp.zeros_like(w)),
            phase=jnp.sign(w_new),
            change_time=turn_time,
        )


def vertex(before: jax.Array, after: jax.Array, h: Any) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Extremum of a series near t_m from its mean velocities in the steps before and after t_m.

    Returns whether the parabola through the three values turns within h/2 of t_m, when (after
    t_m), and the extremum less the value at t_m.
    """
    turns = before * after < 0
    mean = (before + after) / 2
    gain = jnp.where(turns, after - before, 1.0)
    time = jnp.where(turns, -mean / gain * h, 0.0)
    return turns, time, mean * time / 2


def _ratio(w: jax.Array, width: jax.Array) -> jax.Array:
    # tanh is ±1 to rounding from 40 on; the limit keeps w/width, and its derivative, finite.
    near = jnp.abs(w) < 40 * width
    return jnp.where(near, jnp.where(near, w, 0.0) / width, 40 * jnp.sign(w))


@jax.custom_jvp
def _creep(push: jax.Array, brake: jax.Array, width: jax.Array) -> jax.Array:
    """The w that solves w + brake tanh(w / width) = push, for brake ≥ 0 and width > 0."""
    goal = jnp.abs(push)
    # For w > 0 the left side is concave: from below the root, Newton's method climbs to it.
    start = jnp.maximum(goal - brake, goal / (1 + brake / width))

    def improve(carry: tuple[Any, Any, Any]) -> tuple[Any, Any, Any]:
        w, _, turn = carry
        t = jnp.tanh(_ratio(w, width))
        better = w + (goal - w - brake * t) / (1 + brake / width * (1 - t * t))
        better = jnp.clip(better, w, goal)
        return better, better - w, turn + 1

    def unsettled(carry: tuple[Any, Any, Any]) -> Any:
        w, change, turn = carry
        return (turn < 400) & (change > 4 * jnp.finfo(w.dtype).eps * w)

    w, _, _ = lax.while_loop(unsettled, improve, (start, jnp.full_like(start, jnp.inf), 0))
    return jnp.sign(push) * w


@_creep.defjvp
def _creep_jvp(primals: Any, tangents: Any) -> Any:
    push, brake, width = primals
    d_push, d_brake, d_width = tangents
    w = _creep(push, brake, width)
    y = _ratio(w, width)
    t = jnp.tanh(y)
    # With s = sech², dw (1 + brake s / width) = d_push − t d_brake + (brake s / width) y d_width;
    # dividing by 1 + brake s / width is safe at any size of it.
    stiff = brake / width * (1 - t * t)
    change = (d_push - t * d_brake) / (1 + stiff) + stiff / (1 + stiff) * y * d_width
    return w, change
