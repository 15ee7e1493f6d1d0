"""Contact in a gap, and inputs and results of a local flow through one step."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax

APART, PRESSED, CLIPPED, REST = 0.0, 1.0, 2.0, 3.0
"""Modes of contact in a gap. ``APART``: open. ``PRESSED``: force ≥ 0. ``CLIPPED``: the force would
pull and is set to 0. ``REST``: closed at rest (Newton's law), with a reaction force."""

SLOTS = 4  # impacts recorded for each gap in one step
SOFT = 8  # exponent of the norm of impacts' peak forces that is a soft maximum
DISCRETE = "mode", "counts", "fastest"  # by which, of a ``Contact``, nothing is differentiated


def is_deformed(mode: jax.Array) -> jax.Array:
    """Whether a law of contact stores energy in this mode of contact."""
    return (mode == PRESSED) | (mode == CLIPPED)


class Contact(NamedTuple):
    """Mode of contact in gaps, and the contact under way; the time is that of the run."""

    mode: jax.Array
    counts: jax.Array  # 1 if the contact under way counts as an impact
    fastest: jax.Array  # largest speed of approach so far in the run
    touch_speed: jax.Array
    touch_time: jax.Array
    impulse: jax.Array  # so far
    peak_force: jax.Array  # so far


Gaps = tuple[tuple[int, int], ...]
"""The joint and the side of each gap: 1 if it closes as the joint's closing grows, −1 if it closes
as that falls."""


class FlowInput(NamedTuple):
    """Inputs of a flow over a step of length h: n joints, and g gaps of them, also none."""

    closing: jax.Array  # s, (n,)
    velocity: jax.Array
    pull: jax.Array  # A in the middle of the step, (n,)
    rise: jax.Array  # change of A over the step
    delassus: jax.Array  # G, (n, n)
    friction: jax.Array  # μ, (n,)
    resistances: tuple[Any, ...]  # what friction gains with the velocity, by joint, or None
    sizes: jax.Array  # ξ0, (g,)
    laws: tuple[Any, ...]  # of contact for the effective masses, by gap
    contact: Contact  # (g,)


class Clock(NamedTuple):
    """When a flow takes place."""

    middle: jax.Array  # time of the run in the middle of the step
    begin: jax.Array  # from the start of the step: 0, or h/2 if the run starts in mid-step
    is_last: jax.Array  # whether the run ends in mid-step


class Impacts(NamedTuple):
    """Impacts that ended in a step, (g, slots) each; times are those of the run."""

    touch_time: jax.Array
    approach_velocity: jax.Array
    end_time: jax.Array
    rebound_velocity: jax.Array
    impulse: jax.Array
    peak_force: jax.Array


class StepLog(NamedTuple):
    """Events of a step; times from its middle."""

    # Of the joints, (n,) each.
    turns: jax.Array  # 1 if a velocity vanished or reversed
    first_turn: jax.Array  # closing at the first turn
    last_turn: jax.Array
    between: jax.Array  # path from the first to the last
    farthest: jax.Array  # largest closing at a turn
    farthest_time: jax.Array
    nearest: jax.Array  # smallest closing at a turn
    nearest_time: jax.Array
    change_time: jax.Array  # when the direction of slip last changed
    # Of the gaps, (g,) each.
    touched: jax.Array  # 1 if in contact at any time
    touches: jax.Array  # impacts that began
    first_touch: jax.Array  # when the first of them did
    ended: jax.Array  # impacts that ended
    strongest: jax.Array  # largest impulse of those that ended
    powers: jax.Array  # sum of their peak forces to the power ``SOFT``
    highest: jax.Array  # largest contact force
    highest_time: jax.Array
    highest_forces: jax.Array  # q + p of all joints then, (g, n): row j for gap j
    impacts: Impacts


JOINTS_LOG = StepLog._fields[:9]
GAPS_LOG = StepLog._fields[9:17]
"""Fields of a ``StepLog`` that are numbers of the joints, and of the gaps."""


class MidStep(NamedTuple):
    """The middle of the step."""

    # Of the joints, (n,) each.
    closing: jax.Array
    velocity: jax.Array
    friction: jax.Array
    held: jax.Array  # 1 where the closing cannot change: stick or rest
    # Of the gaps, (g,) each.
    contact_force: jax.Array
    stored: jax.Array  # change of the energy stored in contact until then
    lost: jax.Array  # lost by contact until then


class FlowResult(NamedTuple):
    """Result of a flow.

    Where the run ends in mid-step, contact, energies and the log are those until then.
    """

    # Of the joints, (n,) each.
    closing: jax.Array  # at the end
    velocity: jax.Array
    acceleration: jax.Array  # at the end, without the force of a contact law
    held: jax.Array  # 1 where the closing cannot change at the end: stick or rest
    mean: jax.Array  # mean closing over the step
    # Of the gaps, (g,) each.
    contact: Contact  # at the end
    stored: jax.Array  # change of the energy stored in contact
    lost: jax.Array  # lost by contact
    now: MidStep
    log: StepLog
