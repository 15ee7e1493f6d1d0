r"""Rods that yield, step by step: the state of a law of hysteresis, and the kick of its force.

The law's state at t_m follows from that at t_{m−1} along the path of the elongation, which turns
where the parabola through its last three values does. The kick of a step lasts from t_m − h/2 to
t_m + h/2. Where the rod yields in it, at t_m + τ h, the slope of its force jumps by J e', and the
force at t_m misses

    J e' h (1/2 − |τ|)²/2

of its mean over the kick: an error of order h² whose factor depends on where in the step it falls,
and so an error of order h in derivatives. τ is a root of the same parabola.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.tree_util import register_dataclass

from jaxpound._extrema import larger, smaller
from jaxpound._xla.quotients import once, unit_of
from jaxpound.simulation.rods.law import RodLaw, RodStep
from jaxpound.simulation.rods.slider import Turn, has_slider, slider_step

_MIXED = 2  # phase of a step in which the slope of the force jumps
_THROUGHOUT = 1 - 1e-3  # share of a step from which it is all of it


class HystereticState(NamedTuple):
    """State of a rod that yields at t_{m−1}."""

    of_law: Any
    elongation: jax.Array
    change: jax.Array  # of the elongation since the instant before
    phase: Any  # of the step before: 0 elastic, ±1 yielding in a direction, or ``_MIXED``
    memory: Any = None  # state of a fractional rod, if one is in the place of the law's spring
    smooth: Any = None  # its force without the spring


@register_dataclass
@dataclass(frozen=True)
class Hysteretic(RodLaw):
    """A rod with a law of hysteresis, f_m = K r(e_m)."""

    law: Any
    modulus: Any  # K
    peaks_at_kinks: ClassVar[bool] = True

    @property
    def yield_displacement(self) -> Any:
        """The elongation where the rod yields first."""
        return self.law.yield_displacement

    @property
    def is_long(self) -> bool:  # type: ignore[override]
        """Laws have more operations than a slider."""
        return not has_slider(self.law)

    @property
    def ultimate(self) -> Any:
        """The elongation at which the rod collapses."""
        return getattr(self.law, "ultimate_displacement", np.inf)

    def within(self, elongation: jax.Array) -> jax.Array:
        """The elongation, or the limit beyond which the rod has collapsed."""
        limit = jnp.broadcast_to(self.ultimate, jnp.shape(elongation)).astype(elongation.dtype)
        return _within(elongation, limit)

    def start(self, elongation: jax.Array, change: jax.Array) -> HystereticState:
        """A new rod that has been stretched to the elongation in one direction."""
        phase = jnp.zeros_like(elongation, jnp.int8)
        return HystereticState(self.law.start(elongation), self.within(elongation), change, phase)

    def step(
        self, before: Any, elongation: Any, total: Any, is_first: Any, mean: Any = None
    ) -> RodStep:
        """The rod at t_m; its mean force over the kick lacks a kink."""
        law, e, last = self.law, self.within(elongation), before.elongation
        change = e - last if is_first is None else jnp.where(is_first, before.change, e - last)
        path = last, change, change - before.change, e
        if has_slider(law):
            state, kink, turn = slider_step(law, before.of_law, *path)
        else:
            state, kink, turn = once(
                followed(self, before.of_law, *path), unit_of(0 * self.modulus)
            )
        force_at, sample = state, e
        if mean is not None:
            sample = self.within(mean)
            force_at = law.advance(state, e, sample)
        force = self.modulus * law.reduced_force(sample, force_at)
        reached, phase = self._reached(turn, e)
        slides = law.dissipated(state) != law.dissipated(before.of_law)
        phase = jnp.where(slides, phase, 0).astype(jnp.int8)
        return RodStep(
            force=force,
            kick=force - self.modulus * kink,
            state=HystereticState(state, e, change, phase),
            kinked=(phase != before.phase) | (phase == _MIXED),
            reached=reached,
        )

    def _reached(self, turn: Turn, e: jax.Array) -> tuple[Any, jax.Array]:
        """Steps after t_m and force, at kinks of a step; and its phase if the rod yields in it."""
        law, (late, direction, at_turn, turned) = self.law, turn
        reached, mixed = [(late, self.modulus * law.reduced_force(at_turn, turned))], late > -1
        if hasattr(law, "kink"):
            change, (at_kink, _) = e - at_turn, law.kink(turned, direction)
            moves = direction * change > 0
            after = jnp.where(moves, (e - at_kink) / jnp.where(moves, change, 1.0), 0.0)
            mixed |= after < _THROUGHOUT
            begins = (after > 0) & (after < 1)
            numbers = late * after, self.modulus * law.reduced_force(at_kink, turned)
            reached.append(jax.tree.map(partial(jnp.where, begins), numbers, reached[0]))
        return tuple(reached), jnp.where(mixed, _MIXED, jnp.where(direction < 0, -1, 1))

    def dissipated(self, state: HystereticState) -> jax.Array:
        """Energy that the rod has dissipated by yielding."""
        return self.modulus * self.law.dissipated(state.of_law)

    def scalars(
        self, end: HystereticState, largest: jax.Array, last: jax.Array
    ) -> dict[str, jax.Array]:
        """Ductility, residual drift, dissipated energy, and whether the rod has collapsed."""
        return {
            "ductility": largest / self.law.yield_displacement,
            "residual_drift": jnp.abs(last - self.law.reduced_force(end.elongation, end.of_law)),
            "dissipated_energy": self.dissipated(end),
            "collapsed": 0 * largest + (largest > self.ultimate).astype(largest.dtype),
        }


@jax.custom_jvp
def _within(x: jax.Array, limit: jax.Array) -> jax.Array:
    """The number within ±limit; its derivative is one choice, where JAX would make two."""
    return larger(smaller(x, limit), -limit)


@_within.defjvp
def _(primals: Any, tangents: Any) -> tuple[jax.Array, jax.Array]:
    (x, limit), (d_x, d_limit) = primals, tangents
    return _within(x, limit), jnp.where(jnp.abs(x) <= limit, d_x, jnp.sign(x) * d_limit)


def time_until(room: jax.Array, speed: jax.Array, gain: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Steps until a motion with a speed ≥ 0 that gains speed has passed a distance, and its speed.

    The distance may be negative: it was passed before. Both are 0, as are their derivatives, where
    the motion turns before.
    """
    square = speed**2 + 2 * gain * room
    passes = square > 0
    then = jnp.where(passes, jnp.sqrt(jnp.where(passes, square, 1.0)), 0.0)
    return jnp.where(passes, 2 * room / jnp.where(passes, speed + then, 1.0), 0.0), then


def followed(
    rod: Hysteretic, before: Any, last: Any, change: Any, gain: Any, e: Any
) -> tuple[Any, jax.Array, Turn]:
    """The state of a law after a step, what the mean of −r over the kick lacks, and the turn.

    The elongation was ``last`` and is e; it changed by ``change``, which is more than a step before
    by ``gain``.
    """
    law, unit = rod.law, unit_of(0 * rod.modulus)
    speed = once(change + gain / 2, unit)  # at t_m; at t_{m−1} it was less by the gain
    turns = speed * (speed - gain) < 0
    divisor = jnp.where(turns, gain, 1.0)
    at_turn = jnp.where(turns, e - speed**2 / (2 * divisor), last)
    turned = once(law.advance(before, last, at_turn), unit)
    state = law.advance(turned, at_turn, e)
    direction = jnp.where(speed < 0, -1.0, 1.0).astype(e.dtype)
    turn = Turn(jnp.where(turns, -speed / divisor, -1.0), direction, at_turn, turned)
    if not hasattr(law, "kink"):
        return state, jnp.zeros_like(e), turn
    place, jump = law.kink(turned, direction)
    time, then = time_until(direction * (place - e), jnp.abs(speed), direction * gain)
    missed = (0.5 - jnp.abs(time)) ** 2 / 2
    inside = (jnp.abs(time) < 0.5) & (then > 0)
    return state, jnp.where(inside, -jump * direction * then * missed, 0.0), turn
