r"""A bilinear rod over one step, with its derivative in closed form.

It does what ``yielding.followed`` does for any law, by the same rules: the slider follows the
elongation e to where it turns, and from there to the end. The derivative of that, found by JAX,
repeats all of it; in closed form it needs a few factors. With p the place of the slider and s the
elongation at the turn,

    dp = de ∓ de_y where the slider moves, else it stays,    ds = de − r dv + r²/2 dg,

with the speed v at the end, its gain g over the step and r = v/g. The slider starts at τ, within
half a step of the end, where |v| τ + g τ²/2 is its room, g being positive where the motion gains
speed. The kink is half of the speed then times (1/2 − |τ|)²; its derivative has a factor for each
of room, v and g. Where two cases tie it is that of one of them or their mean.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jaxpound._extrema import larger, smaller
from jaxpound.model.hysteresis import Bilinear, Plastic


class Turn(NamedTuple):
    """Where the elongation turns in a step, or begins it."""

    late: jax.Array  # in steps after t_m; −1 where it does not turn
    direction: jax.Array  # of the elongation after it, 1 or −1
    elongation: jax.Array
    of_law: Any  # state


class _SliderPath(NamedTuple):
    speed: jax.Array  # of the elongation at the end
    turns: jax.Array  # whether it turns
    at_turn: jax.Array  # elongation there, or at the start
    ratio: jax.Array  # r, 0 if it does not
    turned: jax.Array  # p at the turn
    place: jax.Array  # p at the end
    way: jax.Array  # direction of the elongation at the end
    room: jax.Array  # elongation until the slider starts
    speed_then: jax.Array  # of the elongation where the slider starts, forwards
    time: jax.Array  # τ
    left: jax.Array  # 1/2 − |τ| if the slider starts within half a step of the end, else 0


def has_slider(law: Any) -> bool:
    """Whether a law is ``Bilinear`` itself; a class derived from it may have other rules."""
    return type(law) is Bilinear


def slider_step(
    law: Bilinear, before: Plastic, last: Any, change: Any, gain: Any, e: Any
) -> tuple[Plastic, jax.Array, Turn]:
    """A bilinear rod after a step, its kink, and the turn; see ``yielding.followed``."""
    numbers = law.yield_displacement, before.elongation, last, change, gain, e
    place, slid, kink, late, way, at_turn, turned = _step(*numbers)
    soft = 1 - law.hardening
    work = soft * law.yield_displacement * slid
    turn = Turn(late, way, at_turn, before._replace(elongation=turned))
    return Plastic(place, before.dissipated + work), soft * kink, turn


@jax.custom_jvp
def _step(e_y: Any, place: Any, last: Any, change: Any, gain: Any, e: Any) -> tuple[Any, ...]:
    return _outcome(place, _path(e_y, place, last, change, gain, e))


def _path(e_y: Any, place: Any, last: Any, change: Any, gain: Any, e: Any) -> _SliderPath:
    speed = change + gain / 2
    turns = speed * (speed - gain) < 0
    ratio = jnp.where(turns, speed / jnp.where(turns, gain, 1.0), 0.0)
    at_turn = jnp.where(turns, e - speed * ratio / 2, last)
    turned = _followed(place, at_turn, e_y)
    way = jnp.where(speed < 0, -1.0, 1.0).astype(e.dtype)
    room = way * (turned - e) + e_y
    square = speed**2 + 2 * way * gain * room
    passes = square > 0
    speed_then = jnp.sqrt(jnp.where(passes, square, 1.0))
    time = 2 * room / (jnp.abs(speed) + speed_then)
    left = jnp.where(passes, larger(0.5 - jnp.abs(time), 0.0), 0.0)
    place = _followed(turned, e, e_y)
    path = speed, turns, at_turn, ratio, turned, place, way, room, speed_then, time, left
    return _SliderPath(*path)


def _followed(place: jax.Array, e: jax.Array, e_y: jax.Array) -> jax.Array:
    return larger(smaller(place, e + e_y), e - e_y)


def _outcome(place: jax.Array, x: _SliderPath) -> tuple[jax.Array, ...]:
    """The place at the end, the distance slid, the place less its mean over the kick; the turn."""
    slid = jnp.abs(x.turned - place) + jnp.abs(x.place - x.turned)
    # As a quotient, which XLA computes once: see ``_xla.quotients``.
    kink = x.way * (x.speed_then * x.left) ** 2 / (2 * x.speed_then)
    return x.place, slid, kink, jnp.where(x.turns, -x.ratio, -1.0), x.way, x.at_turn, x.turned


@_step.defjvp
def _(primals: Any, tangents: Any) -> tuple[Any, Any]:
    _, place, _, _, gain, e = primals
    d_e_y, d_place, d_last, d_change, d_gain, d_e = tangents
    x, d_speed = _path(*primals), d_change + d_gain / 2
    d_at_turn = jnp.where(x.turns, d_e - x.ratio * d_speed + x.ratio**2 / 2 * d_gain, d_last)
    first, second = jnp.sign(x.turned - place), jnp.sign(x.place - x.turned)
    d_turned = jnp.where(first == 0, d_place, d_at_turn) - first * d_e_y
    d_end = jnp.where(second == 0, d_turned, d_e) - second * d_e_y
    d_slid = first * (d_turned - d_place) + second * (d_end - d_turned)
    share, late = x.left**2 / 2 / x.speed_then, x.left * jnp.abs(x.time)
    by_room = share * gain - x.way * x.left * jnp.sign(x.time)
    by_speed = share * jnp.abs(x.speed) + late
    by_gain = share * x.room + late * x.time / 2
    d_room = x.way * (d_turned - d_e) + d_e_y
    d_kink = by_room * d_room + by_speed * d_speed + by_gain * d_gain
    d_late = jnp.where(x.turns, -(d_speed - x.ratio * d_gain) / jnp.where(x.turns, gain, 1.0), 0.0)
    slopes = d_end, d_slid, d_kink, d_late, jnp.zeros_like(e), d_at_turn, d_turned
    return _outcome(place, x), slopes
