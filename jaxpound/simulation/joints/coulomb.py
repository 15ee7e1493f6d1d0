"""Coulomb's law over one step in closed form: slip until θ, stick until φ, slip until the end.

The relative acceleration without friction is A(τ) = pull + rise (τ − ½) at the share τ of the step,
and stick lasts while |A| ≤ hold = R μ.
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jaxpound._extrema import larger, smaller
from jaxpound._xla.derivatives import recomputed
from jaxpound.simulation.joints.motion import LinkMotion


class _Events(NamedTuple):
    """Events within a step, in the direction ``way`` of slip before it."""

    way: jax.Array
    speed: jax.Array  # |w| / h
    a: jax.Array  # pull and rise in this direction
    d: jax.Array
    hold: jax.Array
    slips_first: jax.Array
    drive: jax.Array  # acceleration in the middle of the step, of the slip before
    solves: jax.Array  # whether θ is a root
    moves: jax.Array  # and not beyond the step's end by rounding
    root: jax.Array  # deceleration at θ; 1 where it is no root
    theta: jax.Array
    stops: jax.Array
    sticks: jax.Array
    breaks: jax.Array
    a_stop: jax.Array  # A(θ)
    a_rest: jax.Array  # the mean of A from θ on
    left: jax.Array  # 1 − φ in a step that breaks away, else 0
    after: jax.Array  # direction of slip after the stop
    gained: jax.Array  # its speed at the step's end, after stick or a reversal
    slipping: jax.Array  # at t_m, as before the step
    stuck: jax.Array  # at t_m

    @property
    def late(self) -> Any:
        """θ, from t_m on."""
        return self.theta - 0.5

    @property
    def opposed(self) -> Any:
        """Time until t_m in which friction opposed the first slip, less the time after its turn."""
        return smaller(self.theta, 0.5) + self.after * larger(0.5 - self.theta, 0.0)

    @property
    def released(self) -> Any:
        """Jump of the relative acceleration at θ."""
        return self.hold - jnp.where(self.sticks, self.a_stop, self.after * self.hold)

    @property
    def bend(self) -> Any:
        """Acceleration by which the closing differs at θ from its value at t_m."""
        return self.drive + 2 / 3 * self.d * self.late


def _events(w: Any, pull: Any, rise: Any, hold: Any, h: Any) -> _Events:
    # In the direction of slip: |w| = speed × h, accelerated by a − hold.
    slips_first = w != 0
    way = jnp.where(w < 0, -1.0, 1.0).astype(w.dtype)
    speed, a, d = way * w / h, way * pull, way * rise

    # Slip, until the speed vanishes at θ: a root of speed − half θ + d θ²/2 = 0.
    drive = a - jnp.where(slips_first, hold, 0.0)
    half = d / 2 - drive
    below = half**2 - 2 * d * speed
    dips = (half > 0) & (d > half) & (below >= 0)  # both roots within the step
    stops = (speed + drive <= 0) | dips | ~slips_first
    solves = stops & slips_first
    root = jnp.sqrt(jnp.where(solves, larger(below, jnp.finfo(w.dtype).tiny), 1.0))
    theta = 2 * speed / jnp.where(solves, half + root, 1.0)
    moves = solves & (theta <= 1)
    theta = jnp.where(moves, theta, jnp.where(slips_first, 1.0, 0.0))

    # Stick, until |A| exceeds hold at φ.
    a_stop, a_end, a_rest = a + d * (theta - 0.5), a + d / 2, a + d * theta / 2
    sticks = stops & (jnp.abs(a_stop) <= hold)
    breaks = sticks & (jnp.abs(a_end) > hold)
    excess = jnp.where(breaks, jnp.abs(a_end) - hold, 0.0)
    left = excess / jnp.where(breaks, jnp.abs(d), 1.0)

    # Slip again, from rest.
    after = jnp.sign(jnp.where(sticks, a_end, a_rest))
    gained = (1 - theta) * larger(jnp.abs(a_rest) - hold, 0.0)
    gained = jnp.where(sticks, excess * left / 2, gained)
    slipping = theta >= 0.5
    # A reversal that gains no velocity leaves the link in stick, with the force that holds it.
    rests = (sticks & (left <= 0.5)) | (stops & (gained == 0))
    until_stop = way, speed, a, d, hold, slips_first, drive, solves, moves, root, theta
    from_stop = stops, sticks, breaks, a_stop, a_rest, left, after, gained
    return _Events(*until_stop, *from_stop, slipping, ~slipping & rests)


def _outcome(e: _Events, h: Any) -> LinkMotion:
    # Without friction (hold = 0) the link never sticks, not even at rest. The reversal's impulse is
    # zero then, but its derivative by hold is not.
    turned = h * (e.speed + e.a - e.hold * (e.theta + e.after * (1 - e.theta)))
    w_new = jnp.where(e.stops & (e.hold > 0), h * e.after * e.gained, turned)

    resistance = jnp.where(e.stuck, _held(e.a, e.hold, e.a, e.hold), e.after * e.hold)
    turned_now, after_now = _velocities_now(e, w_new, h)
    w_now = jnp.where(e.stuck, 0.0, e.after * larger(after_now, 0.0))
    w_now = jnp.where(e.slipping, larger(turned_now, 0.0), w_now)

    # At θ the relative acceleration jumps, by s = (θ − ½) h away from t_m.
    s = h * e.late
    return LinkMotion(
        velocity=e.way * w_new,
        force=e.way * jnp.where(e.slipping, e.hold, resistance),
        velocity_now=e.way * jnp.where(e.hold > 0, w_now, turned_now),
        jump=e.way * jnp.where(e.solves, e.released * s**2 / 2, 0.0),
        turns=e.solves.astype(s.dtype),
        turn_time=s,
        turn=-e.way * e.bend * s**2 / 2,
        turn_forces=(e.way * e.hold, e.way * _held(e.a_stop, e.hold, e.a_stop, e.hold)),
        phase=e.way * jnp.where(e.stops, jnp.sign(w_new), 1.0),
        change_time=jnp.where(e.breaks, h * (0.5 - e.left), s),
    )


def _velocities_now(e: _Events, w_new: Any, h: Any) -> tuple[Any, Any]:
    """|w| at t_m of a link that has slipped until then, and of one that has slipped since."""
    turned_now = h * (e.speed + (e.a - e.d / 4) / 2 - e.hold * e.opposed)
    return turned_now, e.after * (w_new - h / 2 * (e.a + e.d / 4)) + h / 2 * e.hold


def _held(a: jax.Array, hold: jax.Array, of_a: jax.Array, of_hold: jax.Array) -> jax.Array:
    """R q of a link in stick that is pulled by a, or its derivative, by those of a and hold."""
    # Not ``clip``: at hold = 0 both limits are one point and the derivative is lost. Nor a minimum
    # of |a|: the pull may be zero, as between structures with the same motion.
    return jnp.where(jnp.abs(a) < hold, of_a, jnp.sign(a) * of_hold)


def _changes(e: _Events, out: LinkMotion, tangents: tuple[Any, ...], h: Any) -> LinkMotion:
    """Derivatives along (w, pull, rise, hold), in fewer operations than by differentiation."""
    d_speed, d_a, d_d = (e.way * tangent for tangent in tangents[:3])
    d_speed, d_hold = d_speed / h, tangents[3]
    theta, after, d, late = e.theta, e.after, e.d, e.late

    # θ is a root of speed + drive θ − d θ (1 − θ)/2, whose slope there is −root.
    tiny = jnp.finfo(d.dtype).tiny
    moves = e.moves & (e.root**2 > tiny)
    d_theta = jnp.where(moves, 1.0, 0.0) / e.root
    d_theta *= d_speed + theta * (d_a - d_hold - (1 - theta) / 2 * d_d)

    # Slip for the last share of the step, from rest; or slip that friction only turns (hold = 0).
    excess = larger(jnp.abs(e.a_rest) - e.hold, 0.0)
    share = jnp.where(e.sticks, e.left, jnp.where(excess > 0, 1 - theta, 0.0))
    by_theta = jnp.where(e.sticks, 0.0, share * d / 2 - after * excess)
    restarted = share * (d_a - after * d_hold + (1 - share) / 2 * d_d) + by_theta * d_theta
    shift = e.hold * (1 - after) * d_theta
    turned = d_speed + d_a - (theta + after * (1 - theta)) * d_hold - shift
    velocity = h * jnp.where(e.stops & (e.hold > 0), restarted, turned)

    # At t_m.
    turned_now, after_now = _velocities_now(e, e.way * out.velocity, h)
    d_turned = d_speed + d_a / 2 - d_d / 8 - e.opposed * d_hold - jnp.where(late < 0, shift, 0.0)
    d_turned *= jnp.where((e.hold > 0) & (turned_now < 0), 0.0, h)
    d_after = velocity - h / 2 * (d_a + d_d / 4 - after * d_hold)
    d_after = jnp.where(e.stuck | (after_now < 0), 0.0, d_after)
    velocity_now = jnp.where((e.hold <= 0) | e.slipping, d_turned, d_after)
    resistance = jnp.where(e.stuck, _held(e.a, e.hold, d_a, d_hold), after * d_hold)

    # At θ.
    s, d_stop = h * late, d_a + late * d_d + d * d_theta
    d_released = d_hold - jnp.where(e.sticks, d_stop, after * d_hold)
    jump = d_released * s**2 / 2 + e.released * s * h * d_theta
    d_bend = d_a - jnp.where(e.slips_first, d_hold, 0.0) + 2 / 3 * (late * d_d + d * d_theta)
    fall = after * (d_a + (0.5 - e.left) * d_d) - d_hold
    d_left = fall / jnp.where(e.breaks, jnp.abs(d), 1.0)
    return LinkMotion(
        velocity=e.way * velocity,
        force=e.way * jnp.where(e.slipping, d_hold, resistance),
        velocity_now=e.way * velocity_now,
        jump=e.way * jnp.where(e.solves, jump, 0.0),
        turns=jnp.zeros_like(s),
        turn_time=h * d_theta,
        turn=-e.way * (d_bend * s**2 / 2 + e.bend * s * h * d_theta),
        turn_forces=(e.way * d_hold, e.way * _held(e.a_stop, e.hold, d_stop, d_hold)),
        phase=jnp.zeros_like(s),
        change_time=h * jnp.where(e.breaks, -d_left, d_theta),
    )


def slip_stick(w: Any, pull: Any, rise: Any, hold: Any, h: Any) -> LinkMotion:
    """A step of length h, from the slip velocity w at its beginning; forces are R q, turns 1 or 0.

    Reverse mode keeps the four arguments of each step and finds its events again: to store their
    many intermediates, or all derivatives, takes longer.
    """
    return recomputed(_step, static_argnums=(4,))(w, pull, rise, hold, h)


@partial(jax.custom_jvp, nondiff_argnums=(4,))
def _step(w: Any, pull: Any, rise: Any, hold: Any, h: Any) -> LinkMotion:
    return _outcome(_events(w, pull, rise, hold, h), h)


@_step.defjvp
def _step_jvp(h: Any, primals: Any, tangents: Any) -> tuple[LinkMotion, LinkMotion]:
    w, pull, rise, hold = primals
    events = _events(w, pull, rise, hold, h)
    out = _outcome(events, h)
    return out, _changes(events, out, tangents, h)
