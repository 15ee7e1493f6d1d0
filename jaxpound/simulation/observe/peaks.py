"""Peaks of series, observed sample by sample.

A smooth series peaks between its samples too, at the vertex of a parabola.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jaxpound._extrema import larger

_TIE = 64  # units of rounding of the peak below which a rise is none


class Peak(NamedTuple):
    """Largest absolute value of a series, between its samples too where it is smooth.

    Its numbers may be arrays, of several series.
    """

    largest: jax.Array
    last: jax.Array
    rise: jax.Array  # from the sample before to the last
    rise_before: jax.Array  # and to the sample before

    def observe(
        self, y: jax.Array, smooth: jax.Array | bool = True, terms: jax.Array | None = None
    ) -> Peak:
        """The peak with one more sample; ``smooth`` says that no jump is among the last three.

        ``terms`` is the size of the numbers whose difference it is, in which it is rounded.
        """
        rise = y - self.last
        if smooth is False:
            return Peak(larger(self.largest, jnp.abs(y)), y, rise, self.rise)
        # The parabola through them turns within half a step of the middle one. Where two of them
        # tie but for rounding, as in stick, a rise has no sign: the sample after the tie tells.
        limits = jnp.finfo(rise.dtype)
        size = larger(self.largest, jnp.abs(y))
        tie = _TIE * limits.eps * (size if terms is None else larger(size, terms))
        to_middle = jnp.where(jnp.abs(self.rise) > tie, self.rise, self.rise_before)
        up, down = (to_middle > tie) & (rise < -tie), (to_middle < -tie) & (rise > tie)
        bend = rise - self.rise
        # A bend whose square underflows has no derivative in floating point.
        arch = smooth & (up | down) & (jnp.abs(bend) > limits.tiny**0.5)
        bend = jnp.where(arch, bend, 1.0)
        vertex = jnp.where(arch, self.last - (self.rise + rise) ** 2 / (8 * bend), y)
        largest = larger(self.largest, larger(jnp.abs(y), jnp.abs(vertex)))
        return Peak(largest, y, rise, self.rise)

    def include(self, *values: Any) -> Peak:
        """The peak with further values that are no samples."""
        largest = self.largest
        for value in values:
            largest = larger(largest, jnp.abs(value))
        return self._replace(largest=largest)


class Sample(NamedTuple):
    """One more sample of a series."""

    value: jax.Array
    smooth: jax.Array | bool  # whether no jump is among the last three samples
    others: Sequence[jax.Array] = ()  # values that the series has reached since the last sample
    terms: jax.Array | None = None  # size of the numbers whose difference it is


class Peaks(NamedTuple):
    """The peaks of several series: a tuple, or those of many in arrays, which compile sooner."""

    of_series: tuple[Peak, ...] | Peak

    @staticmethod
    def start(zero: jax.Array, size: int, in_arrays: bool) -> Peaks:
        """Those of so many series before their first sample."""
        if in_arrays:
            zero = jnp.broadcast_to(zero, (size,))
        peak = Peak(zero, zero, zero, zero)
        return Peaks(peak if in_arrays else (peak,) * size)

    def each(self) -> tuple[Peak, ...]:
        """The peak of each series."""
        if isinstance(self.of_series, Peak):
            return tuple(map(Peak, *map(jnp.unstack, self.of_series)))
        return self.of_series

    def observe(self, samples: Sequence[Sample]) -> Peaks:
        """The peaks with one more sample of each series."""
        if isinstance(self.of_series, Peak):
            values, smooth, others, terms = zip(*samples, strict=True)
            sizes = [0.0 if size is None else size for size in terms]
            all_sizes = None if terms == (None,) * len(terms) else jnp.stack(sizes)
            peak = self.of_series.observe(jnp.stack(values), jnp.stack(smooth), all_sizes)
            return Peaks(peak.include(*map(jnp.stack, zip_longest(*others, fillvalue=0.0))))
        observed = (
            peak.observe(sample.value, sample.smooth, sample.terms).include(*sample.others)
            for peak, sample in zip(self.of_series, samples, strict=True)
        )
        return Peaks(tuple(observed))


class GroundPeaks(NamedTuple):
    """Largest ground acceleration and velocity at the instants, from rest."""

    last: jax.Array  # u''
    velocity: jax.Array
    largest: jax.Array
    largest_velocity: jax.Array

    def observe(self, a: jax.Array, dt: float, is_first: jax.Array) -> GroundPeaks:
        """The peaks with one more acceleration, which may be the first of the run."""
        gained = jnp.where(is_first, 0.0, dt * (self.last + a) / 2)
        velocity = self.velocity + gained
        peak = larger(self.largest, jnp.abs(a))
        return GroundPeaks(a, velocity, peak, larger(self.largest_velocity, jnp.abs(velocity)))
