"""The scalars of a link, accumulated instant by instant."""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jaxpound._extrema import larger, smaller
from jaxpound.model.system import Link
from jaxpound.results.element_demands import LinkDemand
from jaxpound.simulation.contact.records import APART, Contact, GapStep, is_deformed, soft_larger
from jaxpound.simulation.state import LinkInstant

WINDOW = 3  # samples of a parabola: no older event is a kink of it


class LogMeanExp(NamedTuple):
    """log of the mean of e^z over time: largest z so far, sum of e^(z − largest), and time."""

    largest: jax.Array
    total: jax.Array
    time: jax.Array

    def observe(self, z: jax.Array, share: jax.Array) -> LogMeanExp:
        """One more value, which stands for a time ``share``."""
        # Which z is the largest does not change the result, nor its derivative.
        largest = jax.lax.stop_gradient(jnp.maximum(self.largest, z))
        total = self.total * jnp.exp(self.largest - largest) + share * jnp.exp(z - largest)
        return LogMeanExp(largest, total, self.time + share)

    def value(self) -> jax.Array:
        """The result."""
        return self.largest + jnp.log(self.total / self.time)


class ContactTally(NamedTuple):
    """Running values for the scalars of a link's contact."""

    highest: jax.Array  # largest force
    strongest: jax.Array  # largest impulse
    touches: jax.Array  # impacts that began
    first: jax.Array  # when the first did
    lost: jax.Array  # energy until t_m + h/2
    stored: jax.Array
    lost_now: jax.Array  # until t_m
    stored_now: jax.Array
    soft_peak: jax.Array  # soft maximum of the peak forces of impacts that ended
    slid: jax.Array  # distance until t_m
    since_touch: jax.Array  # instants since an impact began
    since_end: jax.Array  # and since one ended

    @property
    def is_kink(self) -> jax.Array:
        """Whether an impact has begun and ended within the last three instants."""
        return (self.since_touch < WINDOW) & (self.since_end < WINDOW)

    def observe(self, step: GapStep | None, time: jax.Array) -> ContactTally:
        """Add one step, or one without flow (None)."""
        later = self._replace(
            lost_now=self.lost,
            stored_now=self.stored,
            since_touch=self.since_touch + 1,
            since_end=self.since_end + 1,
        )
        if step is None:
            return later
        log = step.log
        touches = log.touches > 0
        return later._replace(
            highest=larger(self.highest, log.highest),
            strongest=larger(self.strongest, log.strongest),
            touches=self.touches + log.touches,
            first=jnp.where(touches & (self.touches == 0), time + log.first_touch, self.first),
            lost=self.lost + step.lost_after,
            stored=self.stored + step.stored_after,
            lost_now=self.lost + step.lost,
            stored_now=self.stored + step.stored,
            soft_peak=soft_larger(self.soft_peak, log.soft_peak),
            since_touch=jnp.where(touches, 0.0, later.since_touch),
            since_end=jnp.where(log.ended > 0, 0.0, later.since_end),
        )


class LinkTally(NamedTuple):
    """Running values for the scalars of a link."""

    closing: jax.Array
    farthest: jax.Array  # largest closing, where the gap is smallest
    farthest_time: jax.Array
    last_turn: jax.Array  # closing where the slip velocity last vanished
    distance: jax.Array  # slid until then
    work: jax.Array  # ∫ q w dt by the trapezoidal rule
    instants_since_turn: jax.Array  # since the slip velocity last vanished
    opened: jax.Array | None  # smallest closing, where supports move apart
    softly: LogMeanExp | None  # of closing / temperature
    contact: ContactTally | None  # of a link that may touch

    def observe(
        self, now: LinkInstant, time: jax.Array, share: jax.Array, last: Any, temperature: Any
    ) -> LinkTally:
        """Add one instant, for a time ``share``; the run may end with it (``last``)."""
        turns = now.turns
        turned_before = turns.farthest_time <= 0
        in_run = turns.exist & (~last | turned_before)
        path = jnp.abs(turns.first - self.last_turn) + turns.between
        distance = self.distance + jnp.where(in_run, path, 0.0)
        last_turn = jnp.where(in_run, turns.last, self.last_turn)
        contact = self.contact
        if contact is not None:
            turned_before &= in_run
            slid = jnp.where(turned_before, distance, self.distance) + jnp.abs(
                now.closing - jnp.where(turned_before, last_turn, self.last_turn)
            )
            contact = contact.observe(now.gap, time)._replace(slid=slid)
        higher = in_run & (turns.farthest > self.farthest)
        farthest = jnp.where(higher, turns.farthest, self.farthest)
        farthest_time = jnp.where(higher, time + turns.farthest_time, self.farthest_time)
        # The run's end counts only if the link slips there: in stick the largest closing was at the
        # stop before, from which the closing since differs by the error of a step.
        ends = last & (now.velocity > 0) & (now.closing > farthest)
        opened = self.opened
        if opened is not None:
            opened = smaller(opened, now.closing)
            counts = turns.exist & (~last | (turns.nearest_time <= 0))
            opened = jnp.where(counts, smaller(opened, turns.nearest), opened)
        softly = self.softly
        if softly is not None:
            softly = softly.observe(now.closing / temperature, jnp.where(time < 0, 0.0, share))
        changes = turns.exist | now.jumps
        return LinkTally(
            closing=now.closing,
            farthest=jnp.where(ends, now.closing, farthest),
            farthest_time=jnp.where(ends, time, farthest_time),
            last_turn=last_turn,
            distance=distance,
            work=self.work + share * now.friction * now.velocity,
            instants_since_turn=jnp.where(changes, 0.0, self.instants_since_turn + 1),
            opened=opened,
            softly=softly,
            contact=contact,
        )

    def demand(
        self, link: Link, end: Contact | None, slip_force: jax.Array | None, temperature: Any
    ) -> LinkDemand:
        """The scalars of the ``link``, with its contact at the ``end``.

        ``slip_force`` is μ if |q| = μ in any slip, which makes the work exact, else None.
        """
        distance = self.distance + jnp.abs(self.closing - self.last_turn)
        soft, contact, gap = self.softly, self.contact, link.gap
        opening = self.opened  # of a joint, which has a gap
        if opening is not None:
            opening = jnp.where(gap < jnp.inf, larger(-opening, 0.0), 0.0)
        demand = LinkDemand(
            min_gap=gap - self.farthest,
            min_gap_time=self.farthest_time,
            slip_distance=distance,
            friction_work=self.work if slip_force is None else slip_force * distance,
            residual_offset=-self.closing,
            peak_opening=opening,
            soft_min_gap=None if soft is None else gap - temperature * soft.value(),
        )
        if contact is None or end is None:
            return demand
        counts = (end.mode != APART) & (end.counts > 0)
        deformed = counts & is_deformed(end.mode)
        if (column := link.column) is not None:
            shear = column.shear(contact.highest)
            ratio = None if column.capacity is None else shear / column.capacity
            of_column = {"peak_column_shear": shear, "column_shear_ratio": ratio}
            demand = dataclasses.replace(demand, **of_column)
        return dataclasses.replace(
            demand,
            peak_contact=contact.highest,
            peak_impulse=larger(contact.strongest, jnp.where(deformed, end.impulse, 0.0)),
            peak_penetration=jnp.where(demand.min_gap < 0, -demand.min_gap, 0.0),
            n_impacts=contact.touches,
            first_impact_time=contact.first,
            contact_work=contact.lost,
            soft_peak_contact=soft_larger(
                contact.soft_peak, jnp.where(counts, end.peak_force, 0.0)
            ),
        )
