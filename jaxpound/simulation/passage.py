"""The passage of a group of links through a step: what it is given, and what it comes to."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax

SLOTS = 4
"""Impacts of a link that can be recorded in one step."""

SOFT = 8
"""Exponent of the norm of impacts' peak forces that is a soft maximum."""


class UnderWay(NamedTuple):
    """The contact under way of each link, (n,); times from the middle of the step."""

    touch_speed: jax.Array
    touch_time: jax.Array
    impulse: jax.Array  # so far
    peak_force: jax.Array  # so far


class Given(NamedTuple):
    """What a flow is given for a step that ends h after it starts; (n,) each for n links.

    These are what its results are differentiated by.
    """

    closing: jax.Array
    velocity: jax.Array
    pull: jax.Array  # A in the middle of the step
    rise: jax.Array  # by how much A grows in the step
    delassus: jax.Array  # G, (n, n)
    friction: jax.Array  # μ
    gap: jax.Array  # ξ0
    laws: tuple[Any, ...]  # of contact for the effective masses, None for a link without
    under_way: UnderWay


class Modes(NamedTuple):
    """What a flow starts in, and is not differentiated by."""

    contact: jax.Array  # (n,), as in ``forces``
    counts: jax.Array  # (n,), 1 if the contact under way counts as an impact
    fastest: jax.Array  # (n,), largest speed of approach so far
    start: jax.Array  # 0, or h/2 if the run starts in the middle of the step


class Impacts(NamedTuple):
    """Impacts that ended in a step, (n, slots) each; times from the middle of the step."""

    touch_time: jax.Array
    approach_velocity: jax.Array
    end_time: jax.Array
    rebound_velocity: jax.Array
    impulse: jax.Array
    peak_force: jax.Array


class MidStep(NamedTuple):
    """Links in the middle of the step, (n,) each."""

    closing: jax.Array
    velocity: jax.Array
    friction: jax.Array
    contact: jax.Array
    stored: jax.Array  # gained by the energy stored in contact until then
    lost: jax.Array  # lost by contact until then
    held: jax.Array  # 1 where the closing cannot change: stick or rest
    mode: jax.Array  # of contact
    counts: jax.Array  # 1 if the contact under way counts as an impact
    under_way: UnderWay
    strongest: jax.Array  # as in ``Record``, until then
    powers: jax.Array


class Record(NamedTuple):
    """What happened in the step, (n,) each; times from its middle."""

    touched: jax.Array  # 1 if in contact at any time
    touches: jax.Array  # impacts that began
    first_touch: jax.Array  # when the first of them did
    ended: jax.Array  # impacts that ended
    strongest: jax.Array  # largest impulse of those that ended
    powers: jax.Array  # sum of their peak forces to the power ``SOFT``
    turns: jax.Array  # 1 if a velocity vanished or reversed
    first_turn: jax.Array  # closing where it first did
    last_turn: jax.Array
    between: jax.Array  # path from the first to the last
    farthest: jax.Array  # largest closing at a turn
    farthest_time: jax.Array
    change_time: jax.Array  # when the direction of slip last changed
    highest: jax.Array  # largest contact force
    highest_time: jax.Array
    highest_forces: jax.Array  # q + p of all links then, (n, n): row j for link j
    impacts: Impacts


class Passed(NamedTuple):
    """Result of a flow, (n,) each."""

    closing: jax.Array  # at the end
    velocity: jax.Array
    acceleration: jax.Array  # at the end, without the force of a contact law
    held: jax.Array  # 1 where the closing cannot change at the end: stick or rest
    mean: jax.Array  # mean closing over the step
    stored: jax.Array  # gained by the energy stored in contact
    lost: jax.Array  # lost by contact
    mode: jax.Array  # contact at the end
    counts: jax.Array
    fastest: jax.Array
    under_way: UnderWay
    now: MidStep
    record: Record
