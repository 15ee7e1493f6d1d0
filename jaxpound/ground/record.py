"""Recorded accelerograms: uniform samples, joined by straight lines."""

from __future__ import annotations

import reprlib
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.signal import detrend
from jaxtyping import ArrayLike, Float

from jaxpound import _checks
from jaxpound._checks import Rule, count, enforce, finite, is_traced, number, positive_number, real
from jaxpound._errors import InvalidInput, warn
from jaxpound._extrema import larger, smaller
from jaxpound._fields import check, label, parameter, pytree_dataclass, static, unchecked
from jaxpound.grid import TimeGrid
from jaxpound.ground import motion
from jaxpound.ground.formats.units import UNITS, whole_unit
from jaxpound.ground.plausibility import OFFSET, of_samples, offset
from jaxpound.ground.run_input import instants
from jaxpound.quantities import STANDARD_GRAVITY

LOST_ENERGY = 0.01  # share of ∫ u''² dt that a time step may lose: 0.5 % of the rms value
_KEPT = ("name", "time_unit", "doubts", "notes", "measured")  # of what is made of a record


@pytree_dataclass
class Record(motion.GroundMotion):
    """A recorded accelerogram: uniform samples from t = 0, joined by straight lines.

    Before the first sample and after the last the acceleration goes linearly to zero within one
    sample interval, and the ground is at rest. The attribute ``notes`` says what ``without_mean``,
    ``detrended`` and ``high_passed`` removed.

    Raises ``ValueError`` if the samples are not one-dimensional, fewer than two or not finite, dt
    is not a number > 0, the name is not a string, or time_unit or units is unknown. Warns
    (``PlausibilityWarning``) of at least a hundred samples in seconds if dt is not between 0.0001
    and 0.1 s, one or two samples stand far out of those around them, the mean is above 2 % of the
    peak, with which the ground runs away, or no units are stated and the peak is above 1.5 g, as in
    few records in g and many in m/s².

    Parameters
    ----------
    acceleration
        Samples, shape (n,), n ≥ 2, in g, or in ``units``; the attribute ``samples`` is in g.
    dt, name
        Sample interval > 0, in the unit of time; a name for titles and tables, which
        transformations such as ``jit`` drop, as they drop ``notes``.
    time_unit
        Unit of time: "s", as in files, or "1/ω1" (also spelled "1/omega1"), that of the
        dimensionless model. Runs of dimensionless structures refuse a record in seconds;
        ``Scales.to_dimensionless`` converts it, and runs of ``Buildings`` take it unchanged.
    units
        Unit of the samples: "g", "m/s2", "cm/s2" or another unit of ``read_record``; None, an
        unstated unit, means g.

    Examples
    --------
    >>> record = jp.Record([0.0, 0.1, -0.2, 0.0], dt=0.5, name="made up")
    >>> record.scaled_to_pga(0.3)
    Record('made up', 4 samples, dt = 0.5 s, duration 1.5 s, peak 0.3 g)
    >>> round(float(record.acceleration(0.75)), 6)  # half way between two samples
    -0.05
    >>> float(jp.Record([0.0, 2.9, -1.4, 0.0], dt=0.5, units="m/s2").samples.max().round(4))  # g
    0.2957
    """

    samples: Any
    dt: Any = parameter(r"\Delta t", "time", "sample interval", above=0)
    name: str = label(default="")
    doubts: tuple[str, ...] = label(default=(), listed=False)  # of its warning as it was made
    notes: tuple[str, ...] = label(default=(), listed=False)  # what was removed, in this order
    measured: bool = label(default=True, listed=False)  # not scaled to a peak
    time_unit: str = static(default=motion.SECONDS)

    def __init__(
        self,
        acceleration: Any,
        dt: Any,
        name: str = "",
        time_unit: str = motion.SECONDS,
        units: str | None = None,
    ) -> None:
        samples = real("acceleration", acceleration)
        if jnp.ndim(samples) != 1 or jnp.size(samples) < 2:
            name, rule = f"acceleration of shape {jnp.shape(samples)}", "must be one-dimensional"
            raise InvalidInput(name, "", f"{rule} with at least two samples")
        if units is not None:
            samples = samples * (UNITS[stated_unit(units)] / STANDARD_GRAVITY)
        if not isinstance(name, str):
            raise InvalidInput("name", repr(name), "must be a string")
        unit = motion.time_unit_of(time_unit)
        vars(self).update(samples=samples, dt=number("dt", dt), name=name, time_unit=unit)
        check(self)
        if self.time_unit == motion.SECONDS and not is_traced((samples, self.dt)):
            doubts = of_samples(np.asarray(samples), float(self.dt), stated=units is not None)
            object.__setattr__(self, "doubts", tuple(doubts))
            warn(doubts, strict=False)

    def more_rules(self, prefix: str) -> list[Rule]:
        """The rule of the samples, under the name of the argument."""
        return [Rule(f"{prefix}acceleration", self.samples, finite(self.samples), "finite")]

    def acceleration(self, t: ArrayLike) -> jax.Array:
        """u''(t) by linear interpolation, of the shape of ``t``."""
        samples, left, share = self._place(t)
        return (1 - share) * samples[left] + share * samples[left + 1]

    def velocity(self, t: ArrayLike) -> jax.Array:
        """u'(t), the exact integral of the straight lines from rest, of the shape of ``t``."""
        samples, left, share = self._place(t)
        sums = jnp.pad(jnp.cumsum((samples[1:] + samples[:-1]) / 2), (1, 0))
        slope = samples[left + 1] - samples[left]
        return self.dt * (sums[left] + share * (samples[left] + share * slope / 2))

    def excitation(self, grid: TimeGrid, order: int) -> motion.Excitation:
        """Values and exact means over the steps of the whole grid, for schemes of both orders."""
        # At a kink on an instant u'' has no derivative by the sample interval, but its mean has.
        t = instants(grid, self)
        series = self.acceleration(t), motion.mean_acceleration(self.velocity, t, grid.dt)
        return motion.Excitation(series, lambda _, entry: entry)

    def _place(self, t: ArrayLike) -> tuple[jax.Array, jax.Array, jax.Array]:
        """Samples between two zeros, the one to the left of t, the distance of t from it."""
        last = self.n_samples + 1
        place = larger(smaller(jnp.asarray(t) / self.dt + 1, last), 0)
        left = jnp.minimum(place.astype(int), last - 1)
        return jnp.pad(jnp.asarray(self.samples), (1, 1)), left, place - left

    @property
    def n_samples(self) -> int:
        """Number of samples."""
        return jnp.shape(self.samples)[-1]

    @property
    def duration(self) -> Any:
        """Time of the last sample."""
        return (self.n_samples - 1) * self.dt

    def scaled_to_pga(self, pga: ArrayLike) -> Record:
        """The record scaled to the peak ground acceleration ``pga`` > 0."""
        (pga,) = positive_number(pga=pga)
        peak = abs(self.samples).max()
        enforce([Rule("the record's own peak", peak, peak > 0, "positive")])
        return self._with((self.samples * (pga / peak)).astype(self.samples.dtype), measured=False)

    def without_mean(self) -> Record:
        """The record without the mean of its samples, such as an instrument's offset."""
        mean = jnp.mean(self.samples, axis=-1)
        size = "" if is_traced(mean) or mean.ndim else f" of {float(mean):.4g} g"
        return self._cleaned(detrend(self.samples, type="constant"), f"mean{size} removed")

    def detrended(self) -> Record:
        """The record without the least-squares line through its samples, and so without a mean."""
        return self._cleaned(detrend(self.samples), "least-squares line removed")

    def high_passed(self, corner: float, order: int = 4) -> Record:
        """The record without its mean and its slow motion, by an acausal Butterworth filter.

        The filter runs forwards and backwards (``scipy.signal.sosfiltfilt``), and so shifts no
        phase, between zeros of 1.5 · order / corner, twice those of Boore (2005), later cut off.
        Raises ``ValueError`` if an argument breaks its rule, or corner or the record is traced.

        Parameters
        ----------
        corner
            Frequency at which both runs leave half of the amplitude, in Hz or in cycles per unit of
            time: at least 1 / duration of the record, and below its Nyquist frequency.
        order
            Order of the filter of one run, from 1 to 10.
        """
        if is_traced((corner, self.samples, self.dt)):
            raise InvalidInput("corner", "", "and the record must not be traced")
        (corner,), order = positive_number(corner=corner), count("order", order)
        dt, low, high = float(self.dt), 1 / float(self.duration), 0.5 / float(self.dt)
        ends = f"at least 1 / duration = {low:.4g} and below the Nyquist frequency, {high:.4g}"
        up_to_10 = Rule("order", order, order <= 10, "at most 10")
        enforce([Rule("corner", corner, low <= corner < high, ends), up_to_10])
        from scipy.signal import butter, sosfiltfilt  # as in resampled

        n = int(np.ceil(1.5 * order / (corner * dt)))
        padded = np.pad(np.asarray(self.samples - self.samples.mean()), n)
        filtered = sosfiltfilt(butter(order, corner / high, "high", output="sos"), padded, padlen=0)
        samples = filtered[n:-n].astype(self.samples.dtype)
        in_seconds = self.time_unit == motion.SECONDS
        unit = "Hz" if in_seconds else f"cycles per {self.time_unit}"
        note = f"high-pass at {corner:.6g} {unit} (Butterworth, order {order}, acausal)"
        return self._cleaned(samples, note, offset(samples, dt) if in_seconds else ())

    def _cleaned(self, samples: Any, note: str, doubts: Sequence[str] = ()) -> Record:
        """Other samples, without the doubt about an offset and with a note of what was removed."""
        others = (x for x in self.doubts if not x.startswith(OFFSET))
        return self._with(samples, doubts=(*others, *doubts), notes=(*self.notes, note))

    def resampled(self, dt: float) -> Record:
        """The record at another sample interval.

        A finer one inserts points on the straight lines between samples, which leaves the motion
        unchanged where the old samples are among the new ones; a coarser one low-passes first
        (``scipy.signal.resample_poly``). Raises ``ValueError`` if dt is not a positive number, is
        above the record's duration, or is coarser and no ratio of whole numbers times the record's
        dt; if either interval is traced.
        """
        if is_traced((dt, self.dt)):
            raise InvalidInput("dt", "", "decides the number of samples and cannot be traced")
        positive_number(dt=dt)
        dt, old = float(dt), float(self.dt)
        rule = f"at most the record's duration, {self.duration:.8g}"
        enforce([Rule("dt", dt, dt <= self.duration, rule)])
        if dt <= old:
            n = int((self.n_samples - 1) * old / dt * (1 + 1e-7)) + 1
            place = np.minimum(np.arange(n) * (dt / old), self.n_samples - 1)
            left = np.minimum(place.astype(int), self.n_samples - 2)
            share = (place - left).astype(self.samples.dtype)
            return self._with((1 - share) * self.samples[left] + share * self.samples[left + 1], dt)
        ratio = Fraction(old / dt).limit_denominator(1000)
        if abs(ratio * Fraction(dt) / Fraction(old) - 1) > 1e-7:
            rule = f"must be a ratio of whole numbers up to 1000 times the record's dt = {old:.8g}"
            raise InvalidInput("dt", f"{dt:.8g}", rule)
        from scipy.signal import resample_poly  # its import takes as long as the whole package's

        samples = np.asarray(self.samples)
        return self._with(resample_poly(samples, ratio.numerator, ratio.denominator), dt)

    def dimensionless(self, frequency: Any) -> Record:
        """The record, in seconds, in units of 1/ω1 for ω1 = ``frequency`` in rad/s."""
        motion.require_seconds("record", self)
        return self._with(self.samples, self.dt * frequency, time_unit=motion.DIMENSIONLESS)

    def _later(self, delay: Any) -> _LateRecord:
        fields = vars(self) | {"delay": delay + getattr(self, "delay", 0.0)}
        return unchecked(_LateRecord, **fields)

    def _with(self, samples: Any, dt: Any = None, **fields: Any) -> Record:
        """Other samples, in g; of the same interval, name and unit of time by default."""
        fields = {name: getattr(self, name) for name in _KEPT} | fields
        return derived(samples, self.dt if dt is None else dt, **fields)

    def unresolved(self, dt: float) -> list[str]:
        """A sentence if steps of ``dt`` lose much energy above their Nyquist frequency π/dt."""
        if dt <= (interval := float(self.dt)) * (1 + 1e-9):  # such steps follow the lines
            return []
        power = np.abs(np.fft.rfft(np.asarray(self.samples, float))) ** 2
        lost = power[np.fft.rfftfreq(self.n_samples, interval) > 0.5 / dt].sum()
        if not lost > LOST_ENERGY * (whole := power.sum()):
            return []
        steps = f"ground: time steps of {dt / interval:.4g} sample intervals should lose at most"
        energy = f"{LOST_ENERGY:.0%} of the energy of {self!r}, but lose {lost / whole:.0%}"
        return [f"{steps} {energy}: steps no longer than the sample interval lose nothing"]

    def energy(self, since: float) -> float:
        """∫ u''² dt after an instant, as a sum over the later samples."""
        later = np.arange(self.n_samples) * float(self.dt) > since * (1 + 1e-9)
        return float(np.sum(np.square(self.samples, dtype=float)[later]) * float(self.dt))

    def __repr__(self) -> str:
        shape = np.shape(self.samples)
        if is_traced((self.samples, self.dt)) or len(shape) != 1 or np.ndim(self.dt):
            return f"Record({shape} samples, time in {self.time_unit})"
        title, unit = f"{self.name!r}, " if self.name else "", self.time_unit
        duration, peak = float(self.duration), float(abs(self.samples).max())
        times = f"dt = {float(self.dt):.6g} {unit}, duration {duration:.6g} {unit}"
        numbers = [f"{self.n_samples} samples", times, f"peak {peak:.4g} g"]
        return f"Record({title}{', '.join([*numbers, *self.notes])})"


@pytree_dataclass
class _LateRecord(Record):
    """A record as a part of a sequence: its first sample is at ``delay``."""

    delay: Any = parameter("", "time", "delay", default=0.0)

    @property
    def duration(self) -> Any:
        """Time of the last sample."""
        return self.delay + super().duration

    def dimensionless(self, frequency: Any) -> Record:
        motion.require_seconds("record", self)
        changed = super()._with(self.samples, self.dt * frequency, time_unit=motion.DIMENSIONLESS)
        return changed._later(self.delay * frequency)

    def _with(self, samples: Any, dt: Any = None, **fields: Any) -> Record:
        return super()._with(samples, dt, **fields)._later(self.delay)

    def energy(self, since: float) -> float:
        return super().energy(since - float(self.delay))

    def _place(self, t: ArrayLike) -> tuple[jax.Array, jax.Array, jax.Array]:
        return super()._place(jnp.asarray(t) - self.delay)


def stated_unit(units: str) -> str:
    """The unit of accelerations that ``units`` names; an ``InvalidInput`` if it is none."""
    if not isinstance(units, str) or (unit := whole_unit(units)) is None:
        raise InvalidInput("units", reprlib.repr(units), f"must be one of {', '.join(UNITS)}")
    return unit


def derived(
    samples: Any, dt: Any, name: str = "", time_unit: str = motion.SECONDS, **labels: Any
) -> Record:
    """A record of samples in g, without the check of plausibility: its source has those doubts."""
    record = unchecked(Record, samples=samples, dt=dt, name=name, time_unit=time_unit, **labels)
    check(record)
    return record


def require_records(records: Any, kind: type) -> None:
    """An ``InvalidInput`` unless there are records, in a list or by name, in one unit of time."""
    _checks.instance("records", records, kind)
    if not len(records):
        raise InvalidInput("records", repr(records), "must hold at least one record")
    entries = records.items() if isinstance(records, Mapping) else enumerate(records)
    named = {f"records[{name!r}]": record for name, record in entries}
    for name, record in named.items():
        _checks.instance(name, record, Record)
    motion.require_one_time_unit(named)


def stacked(records: Sequence[Record]) -> tuple[Float[np.ndarray, "n m"], Float[np.ndarray, " n"]]:
    """Samples of n records, with zeros at the end, where the ground rests; and their intervals."""
    longest = max(record.n_samples for record in records)
    samples = [np.pad(record.samples, (0, longest - record.n_samples)) for record in records]
    return np.stack(samples), np.array([float(record.dt) for record in records])
