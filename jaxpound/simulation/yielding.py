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

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound._checks import Rule, all_hold, count, enforce, finite, instance, real
from jaxpound._errors import InvalidInput
from jaxpound._extrema import larger, smaller
from jaxpound._fields import rules
from jaxpound._xla.quotients import once, unit_of
from jaxpound.model.dampers import Dashpot
from jaxpound.model.hysteresis import HysteresisLaw
from jaxpound.model.system import Rod
from jaxpound.simulation.slider import has_slider, slider_step


class HysteresisConstants(NamedTuple):
    """A law of hysteresis, and the stiffness K of its rod."""

    law: Any
    modulus: jax.Array

    @property
    def ultimate(self) -> Any:
        """The elongation at which the rod collapses."""
        return getattr(self.law, "ultimate_displacement", np.inf)

    def within(self, elongation: jax.Array) -> jax.Array:
        """The elongation, or the limit beyond which the rod has collapsed."""
        limit = jnp.broadcast_to(self.ultimate, jnp.shape(elongation)).astype(elongation.dtype)
        return _within(elongation, limit)

    def dissipated(self, state: HysteresisState) -> jax.Array:
        """Energy that the rod has dissipated."""
        return self.modulus * self.law.dissipated(state.of_law)

    def once(self, tree: Any) -> Any:
        """Numbers that XLA is to compute once: see ``_xla.quotients``."""
        return once(tree, unit_of(0 * self.modulus))


@jax.custom_jvp
def _within(x: jax.Array, limit: jax.Array) -> jax.Array:
    """The number within ±limit; its derivative is one choice, where JAX would make two."""
    return larger(smaller(x, limit), -limit)


@_within.defjvp
def _(primals: Any, tangents: Any) -> tuple[jax.Array, jax.Array]:
    (x, limit), (d_x, d_limit) = primals, tangents
    return _within(x, limit), jnp.where(jnp.abs(x) <= limit, d_x, jnp.sign(x) * d_limit)


class HysteresisState(NamedTuple):
    """State of a rod that yields at t_{m−1}."""

    of_law: Any
    elongation: jax.Array
    change: jax.Array  # of the elongation since the instant before


class HysteresisStep(NamedTuple):
    """A rod that yields at t_m."""

    state: HysteresisState
    elongation: jax.Array
    lost: jax.Array  # force below the elastic one, K (e − r)
    kink: jax.Array  # what the mean over the kick exceeds it by


def time_until(room: jax.Array, speed: jax.Array, gain: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Steps until a motion with a speed ≥ 0 that gains speed has passed a distance, and its speed.

    The distance may be negative: it was passed before. Both are 0, as are their derivatives, where
    the motion turns before.
    """
    square = speed**2 + 2 * gain * room
    passes = square > 0
    then = jnp.where(passes, jnp.sqrt(jnp.where(passes, square, 1.0)), 0.0)
    return jnp.where(passes, 2 * room / jnp.where(passes, speed + then, 1.0), 0.0), then


def hysteresis_step(
    constants: HysteresisConstants,
    before: HysteresisState,
    elongation: jax.Array,
    is_first: jax.Array | None,
) -> HysteresisStep:
    """The rod at t_m, from its state at t_{m−1} and its elongation at t_m.

    ``is_first`` says whether the run begins at t_m displaced or moving; None for runs from rest.
    """
    law, e, last = constants.law, constants.within(elongation), before.elongation
    change = e - last if is_first is None else jnp.where(is_first, before.change, e - last)
    if isinstance(law, Dashpot):
        state = constants.once(law.over_step(before.of_law, last, e))
        lost = constants.once(constants.modulus * state.elongation)
        now = HysteresisState(state, e, change)
        return HysteresisStep(now, elongation, lost, jnp.zeros_like(lost))
    path = last, change, change - before.change, e
    if has_slider(law):
        state, kink = slider_step(law, before.of_law, *path)
    else:
        state, kink = constants.once(followed(constants, before.of_law, *path))
    lost = constants.modulus * (elongation - law.reduced_force(e, state))
    now = HysteresisState(state, e, change)
    return HysteresisStep(now, elongation, lost, constants.modulus * kink)


def followed(
    constants: HysteresisConstants, before: Any, last: Any, change: Any, gain: Any, e: Any
) -> tuple[Any, jax.Array]:
    """The state of a law after a step, and its kink: what the mean of −r over the kick lacks.

    The elongation was ``last`` and is e; it changed by ``change``, which is more than a step before
    by ``gain``.
    """
    law = constants.law
    speed = constants.once(change + gain / 2)  # at t_m; at t_{m−1} it was less by the gain
    turns = speed * (speed - gain) < 0
    at_turn = jnp.where(turns, e - speed**2 / (2 * jnp.where(turns, gain, 1.0)), last)
    turned = constants.once(law.advance(before, last, at_turn))
    state = law.advance(turned, at_turn, e)
    if not hasattr(law, "kink"):
        return state, jnp.zeros_like(e)
    direction = jnp.where(speed < 0, -1.0, 1.0).astype(e.dtype)
    place, jump = law.kink(turned, direction)
    time, then = time_until(direction * (place - e), jnp.abs(speed), direction * gain)
    missed = (0.5 - jnp.abs(time)) ** 2 / 2
    inside = (jnp.abs(time) < 0.5) & (then > 0)
    return state, jnp.where(inside, -jump * direction * then * missed, 0.0)


def moved(constants: HysteresisConstants, now: HysteresisStep, sample: jax.Array) -> HysteresisStep:
    """The rod with the force of another elongation: after an impact the mean sample of the kick."""
    e = constants.within(sample)
    state = constants.law.advance(now.state.of_law, now.state.elongation, e)
    lost = constants.modulus * (sample - constants.law.reduced_force(e, state))
    return now._replace(lost=lost)


class CyclicTest(NamedTuple):
    """Series of a cyclic test, each of shape (n,), in the units of its arguments."""

    displacement: jax.Array
    force: jax.Array
    dissipated: jax.Array  # energy, by yielding until then


def cyclic_test(law: Any, displacements: Any, stiffness: Any = 1.0, steps: int = 32) -> CyclicTest:
    """Force of a rod under prescribed displacements, by its law of hysteresis and stiffness K.

    The law is ``Bilinear``, ``BoucWen`` or any ``HysteresisLaw``. ``displacements`` are turning
    points or a whole history, shape (n,) with n ≥ 2: between two of them the displacement only
    grows or only falls, there in equal ``steps`` of the law. The result has all of them, (n − 1)
    ``steps`` + 1 instants. ``Bilinear`` is exact for any number, ``BoucWen`` of second order.

    Works under ``jit``, ``vmap`` and ``grad``. Raises ``ValueError`` for a number that breaks its
    rule; traced ones give NaN.

    Examples
    --------
    >>> test = jp.cyclic_test(jp.Bilinear(0.1), [0.0, 0.3, -0.3], stiffness=5.0, steps=1)
    >>> test.force.tolist(), round(float(test.dissipated[-1]), 6)  # 0.5 (0.2 + 0.4)
    ([0.0, 0.5, -0.5], 0.3)
    """
    owner = "cyclic_test"
    instance(owner, "law", law, HysteresisLaw)
    rod, x = Rod(law, stiffness), jnp.asarray(real(owner, "displacements", displacements))
    if any(map(jnp.ndim, jax.tree.leaves(rod))):
        raise InvalidInput(owner, "law", "", "must be of single numbers: jax.vmap takes several")
    if x.ndim != 1 or x.size < 2:
        raise InvalidInput(owner, "displacements", "", f"of shape {x.shape} must be (n,), n ≥ 2")
    enforce(owner, checks := [Rule("displacements", x, finite(x), "finite"), *rules(rod)])
    test = _tested(HysteresisConstants(law, rod.stiffness), x, count(owner, "steps", steps))
    return jax.tree.map(lambda y: jnp.where(all_hold(checks), y, jnp.nan), test)


@partial(jax.jit, static_argnames="steps")
def _tested(rod: HysteresisConstants, turns: jax.Array, steps: int) -> CyclicTest:
    share = jnp.arange(1, steps + 1, dtype=turns.dtype)[None] / steps
    between = turns[:-1, None] * (1 - share) + turns[1:, None] * share
    x, law = jnp.append(turns[0], between.reshape(-1)), rod.law
    path = rod.within(x)

    def step(before: tuple[Any, Any], e: Any) -> tuple[Any, Any]:
        state = law.advance(*before, e)
        return (state, e), (law.reduced_force(e, state), law.dissipated(state))

    _, (force, dissipated) = jax.lax.scan(step, (law.start(path[0]), path[0]), path)
    return CyclicTest(x, rod.modulus * force, rod.modulus * dissipated)
