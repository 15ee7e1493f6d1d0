"""Contact of a link, and inputs and results of a local flow through one step."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax

APART, PRESSED, CLIPPED, REST = 0.0, 1.0, 2.0, 3.0
"""Modes of a link's contact. ``APART``: open. ``PRESSED``: force ≥ 0. ``CLIPPED``: the force would
pull and is set to 0. ``REST``: closed at rest (Newton's law), with a reaction force."""

SLOTS = 4  # impacts recorded for each link in one step
SOFT = 8  # exponent of the norm of impacts' peak forces that is a soft maximum
DISCRETE = "mode", "counts", "fastest"  # by which, of a ``Contact``, nothing is differentiated


def is_deformed(mode: jax.Array) -> jax.Array:
    """Whether a law of contact stores energy in this mode of contact."""
    return (mode == PRESSED) | (mode == CLIPPED)


class Contact(NamedTuple):
    """Mode of a link's contact, and the contact under way; the time is that of the run."""

    mode: jax.Array
    counts: jax.Array  # 1 if the contact under way counts as an impact
    fastest: jax.Array  # largest speed of approach so far in the run
    touch_speed: jax.Array
    touch_time: jax.Array
    impulse: jax.Array  # so far
    peak_force: jax.Array  # so far


class FlowInput(NamedTuple):
    """Inputs of a flow over a step of length h; (f,) for the f faces of n links (``forces``)."""

    closing: jax.Array
    velocity: jax.Array
    pull: jax.Array  # A in the middle of the step
    rise: jax.Array  # change of A over the step
    delassus: jax.Array  # G, (n, n)
    friction: jax.Array  # μ
    gap: jax.Array  # ξ0
    laws: tuple[Any, ...]  # of contact for the effective masses, None for a face without
    resistances: tuple[Any, ...]  # what friction gains with the velocity, by link, or None
    contact: Contact


class Clock(NamedTuple):
    """When a flow takes place."""

    middle: jax.Array  # time of the run in the middle of the step
    begin: jax.Array  # from the start of the step: 0, or h/2 if the run starts in mid-step
    is_last: jax.Array  # whether the run ends in mid-step


class Impacts(NamedTuple):
    """Impacts that ended in a step, (f, slots) each; times are those of the run."""

    touch_time: jax.Array
    approach_velocity: jax.Array
    end_time: jax.Array
    rebound_velocity: jax.Array
    impulse: jax.Array
    peak_force: jax.Array


class StepLog(NamedTuple):
    """Events of a step, (f,) each; times from its middle."""

    touched: jax.Array  # 1 if in contact at any time
    touches: jax.Array  # impacts that began
    first_touch: jax.Array  # when the first of them did
    ended: jax.Array  # impacts that ended
    strongest: jax.Array  # largest impulse of those that ended
    powers: jax.Array  # sum of their peak forces to the power ``SOFT``
    turns: jax.Array  # 1 if a velocity vanished or reversed
    first_turn: jax.Array  # closing at the first turn
    last_turn: jax.Array
    between: jax.Array  # path from the first to the last
    farthest: jax.Array  # largest closing at a turn
    farthest_time: jax.Array
    change_time: jax.Array  # when the direction of slip last changed
    highest: jax.Array  # largest contact force
    highest_time: jax.Array
    highest_forces: jax.Array  # q + p of all faces then, (f, f): row j for face j
    impacts: Impacts


class MidStep(NamedTuple):
    """Links in the middle of the step, (f,) each."""

    closing: jax.Array
    velocity: jax.Array
    friction: jax.Array
    contact_force: jax.Array
    stored: jax.Array  # change of the energy stored in contact until then
    lost: jax.Array  # lost by contact until then
    held: jax.Array  # 1 where the closing cannot change: stick or rest


class FlowResult(NamedTuple):
    """Result of a flow, (f,) each.

    Where the run ends in mid-step, contact, energies and the log are those until then.
    """

    closing: jax.Array  # at the end
    velocity: jax.Array
    acceleration: jax.Array  # at the end, without the force of a contact law
    held: jax.Array  # 1 where the closing cannot change at the end: stick or rest
    mean: jax.Array  # mean closing over the step
    contact: Contact  # at the end
    stored: jax.Array  # change of the energy stored in contact
    lost: jax.Array  # lost by contact
    now: MidStep
    log: StepLog
