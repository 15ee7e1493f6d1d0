"""What a law of friction takes and returns for one step."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax


class LinkStep(NamedTuple):
    """Inputs of a friction law for a step from t_m − h/2 to t_m + h/2."""

    velocity: jax.Array  # w at t_m − h/2
    phase: jax.Array  # direction of slip before the step, 0 in stick
    pull: jax.Array  # A_m
    rise: jax.Array  # D = A_m − A_{m−1}
    inverse_mass: jax.Array  # R
    friction: jax.Array  # μ
    dt: Any  # h


class LinkMotion(NamedTuple):
    """Result of a friction law for one step, from t_m − h/2 to t_m + h/2.

    ``jump`` is the part of x_i − x_j that the drift from t_m to t_{m+1} misses because friction
    changed within the step. ``turns`` says whether w vanished in the step, ``turn_time`` when
    (after t_m) and ``turn`` the difference of x_i − x_j there from its value at t_m. ``phase`` is
    the direction of slip after the step, 0 in stick; ``change_time`` is when that phase began
    (after t_m). ``stop`` is the part of the change of w that no force makes: the last end alone
    makes it.
    """

    velocity: jax.Array  # w at t_m + h/2
    force: jax.Array  # q at t_m
    velocity_now: jax.Array  # w at t_m
    jump: jax.Array
    turns: jax.Array
    turn_time: jax.Array
    turn: jax.Array
    turn_forces: tuple[jax.Array, jax.Array]  # q before and after it
    phase: jax.Array
    change_time: jax.Array
    stop: Any = None
