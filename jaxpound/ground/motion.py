"""Ground motions: anything with ``acceleration(t)``, their sums and scalings.

In the dimensionless model (eq. 9) acceleration is in units of g and time in units of 1/ω1. A record
as read from a file is in g and seconds. It says so (``Record.time_unit``), and no dimensionless run
takes it before ``Scales.to_dimensionless`` has turned it into the other.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from fractions import Fraction
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from jaxpound._checks import Rule, enforce, finite, is_traced, number, positive, real
from jaxpound._extrema import larger, smaller
from jaxpound._fields import label, pytree_dataclass, static

if TYPE_CHECKING:
    from jaxpound.grid import TimeGrid

SECONDS, DIMENSIONLESS = "s", "1/ω1"
"""Units of time that a record may be in."""

_SPELLINGS = {SECONDS: SECONDS, DIMENSIONLESS: DIMENSIONLESS, "1/omega1": DIMENSIONLESS}

STEPS_PER_WAVELET = 8
"""Steps that a wavelet's period should have: the mean of a sine over an eighth of its period, which
is what moves the blocks in a step, is already 2.6 % less than its value in the middle."""

LOST_ENERGY = 0.01
"""Share of a record's energy (∫ u''² dt) that a time step may lose: it is 0.5 % of the root mean
square."""


@runtime_checkable
class Ground(Protocol):
    """What the simulator asks of a ground motion.

    One may also have ``unresolved(dt)``: sentences that say what of it steps of dt do not resolve.
    """

    def acceleration(self, t: ArrayLike) -> Any:
        """Ground acceleration u''(t), of the shape of ``t``."""


GroundLike = Ground | Callable[[Any], Any]


class _Combinable:
    """Sums and scalings: ``a + b``, ``a - b``, ``2 * a``, ``a / 2``, ``-a``, ``sum([a, b])``.

    A plain function of t may be one of the two that are added or subtracted.
    """

    __array_ufunc__ = None  # a NumPy factor on the left leaves the product to us

    def __add__(self, other: GroundLike) -> Sum:
        return Sum((self, other))

    def __radd__(self, other: GroundLike | int) -> Any:
        if isinstance(other, int) and other == 0:  # where the builtin sum starts
            return self
        return Sum((other, self))

    def __sub__(self, other: GroundLike) -> Sum:
        return Sum((self, Scaled(other, -1.0)))

    def __rsub__(self, other: GroundLike) -> Sum:
        return Sum((other, Scaled(self, -1.0)))

    def __mul__(self, factor: ArrayLike) -> Scaled:
        return Scaled(self, factor)

    __rmul__ = __mul__

    def __truediv__(self, divisor: ArrayLike) -> Scaled:
        return Scaled(self, 1 / number("Scaled", "divisor", divisor))

    def __neg__(self) -> Scaled:
        return Scaled(self, -1.0)


@pytree_dataclass
class Sum(_Combinable):
    """The sum of several ground motions; a plain function of t counts as one."""

    grounds: tuple[Any, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "grounds", tuple(self.grounds))
        if not self.grounds:
            raise ValueError("Sum: grounds = () must hold at least one ground motion")
        for i, ground in enumerate(self.grounds):
            require_ground(f"Sum: grounds[{i}]", ground)
        records = list(records_in(self))
        for record in records:
            if record.time_unit != records[0].time_unit:
                raise ValueError(
                    f"Sum: grounds: {record!r} must be in the same unit of time as {records[0]!r}"
                )

    def acceleration(self, t: ArrayLike) -> Any:
        """Sum of the accelerations, of the shape of ``t``."""
        return sum(accelerate(ground, t) for ground in self.grounds)

    def unresolved(self, dt: float) -> list[str]:
        """What of the parts steps of ``dt`` do not resolve, in words."""
        return [said for ground in self.grounds for said in unresolved(ground, dt)]


@pytree_dataclass
class Scaled(_Combinable):
    """A ground motion times a real factor."""

    ground: Any
    factor: Any

    def __post_init__(self) -> None:
        require_ground("Scaled: ground", self.ground)
        object.__setattr__(self, "factor", number("Scaled", "factor", self.factor))
        enforce("Scaled", self.rules())

    def rules(self) -> list[Rule]:
        """The rule of the factor."""
        return [Rule("factor", self.factor, finite(self.factor), "finite")]

    def acceleration(self, t: ArrayLike) -> Any:
        """Factor times the acceleration, of the shape of ``t``."""
        return self.factor * accelerate(self.ground, t)

    def unresolved(self, dt: float) -> list[str]:
        """What of the ground motion steps of ``dt`` do not resolve, in words."""
        return unresolved(self.ground, dt) if np.any(self.factor) else []


@pytree_dataclass
class Ricker(_Combinable):
    r"""A sum of Ricker wavelets, in closed form (paper, eq. 6).

    With :math:`a = π/t_p`, :math:`s = t - t_s` and :math:`v = (a s)^2`, each wavelet is
    :math:`u = u_0 (2v - 1) e^{-v}`.

    Parameters
    ----------
    amplitude
        u0, the displacement amplitude: one for all wavelets, as in the paper, or one each.
    periods
        t_p > 0, one per wavelet, shape (n,) (a number is one wavelet).
    arrivals
        t_s, the instants of the wavelets' centres, shape (n,).

    Raises
    ------
    ValueError
        If the shapes are others, a period is not positive, or anything known is not finite.

    Examples
    --------
    >>> ground = jp.Ricker(amplitude=0.5, periods=2.0, arrivals=3.0)
    >>> float(ground.displacement(3.0))
    -0.5
    >>> round(float(ground.acceleration(3.0)), 4)
    7.4022
    >>> round(float((0.1 * ground + jp.Ricker(0.2, 1.0, 5.0)).acceleration(3.0)), 4)
    0.7402
    """

    amplitude: Any
    periods: Any
    arrivals: Any

    def __post_init__(self) -> None:
        for name in ("amplitude", "periods", "arrivals"):
            object.__setattr__(self, name, real("Ricker", name, getattr(self, name)))
        amplitudes, periods, arrivals = (
            jnp.shape(x) for x in (self.amplitude, self.periods, self.arrivals)
        )
        if periods != arrivals:
            raise ValueError(
                f"Ricker: periods of shape {periods} and arrivals of shape {arrivals} "
                "must have one entry per wavelet"
            )
        if len(periods) > 1:
            raise ValueError(
                f"Ricker: periods of shape {periods} must be a number or one-dimensional; "
                "a batch of ground motions goes through jax.vmap"
            )
        if amplitudes not in ((), periods):
            raise ValueError(
                f"Ricker: amplitude of shape {amplitudes} must be one number or, like periods, "
                f"of shape {periods}"
            )
        enforce("Ricker", self.rules())

    def rules(self) -> list[Rule]:
        """The rules of the wavelets' parameters."""
        u0, tp, ts = self.amplitude, self.periods, self.arrivals
        return [
            Rule("amplitude", u0, finite(u0), "finite"),
            Rule("periods", tp, (tp > 0) & finite(tp), "positive and finite"),
            Rule("arrivals", ts, finite(ts), "finite"),
        ]

    def displacement(self, t: ArrayLike) -> jax.Array:
        """u(t), of the shape of ``t``."""
        return self._sum(t, lambda a, s, v: 2 * v - 1)

    def velocity(self, t: ArrayLike) -> jax.Array:
        """u'(t), of the shape of ``t``."""
        return self._sum(t, lambda a, s, v: 2 * a**2 * s * (3 - 2 * v))

    def acceleration(self, t: ArrayLike) -> jax.Array:
        """u''(t), of the shape of ``t``."""
        return self._sum(t, lambda a, s, v: 2 * a**2 * (4 * v**2 - 12 * v + 3))

    def acceleration_and_mean(self, h: float) -> Callable[[Any], tuple[Any, Any]]:
        """A function of a number t: u'', and its mean from t − h/2 to t + h/2 to fourth order in h.

        The mean is u'' + (h²/24) d²u''/dt²; the exponentials, most of the work, serve both.
        """
        u0, tp, ts = (jnp.atleast_1d(x) for x in (self.amplitude, self.periods, self.arrivals))
        a = jnp.pi / tp
        size, c = 2 * a**2 * u0, (a * h) ** 2 / 24
        mean = (3 - 30 * c, 180 * c - 12, 4 - 120 * c, 16 * c)  # of 1, v, v² and v³

        def both(t: Any) -> tuple[Any, Any]:
            v = (a * (t - ts)) ** 2
            wave = size * jnp.exp(-v)
            averaged = wave * (((mean[3] * v + mean[2]) * v + mean[1]) * v + mean[0])
            return jnp.sum(wave * ((4 * v - 12) * v + 3)), jnp.sum(averaged)

        return both

    def unresolved(self, dt: float) -> list[str]:
        """Whether the shortest wavelet has too few steps of ``dt``, in words."""
        u0, periods = np.broadcast_arrays(np.asarray(self.amplitude), np.asarray(self.periods))
        shortest = float(periods[u0 != 0].min(initial=np.inf))
        if not shortest < STEPS_PER_WAVELET * dt:
            return []
        return [
            f"ground: the shortest of periods is {shortest / dt:.3g} time steps long and should "
            f"be at least {STEPS_PER_WAVELET}: a finer time grid resolves it"
        ]

    def _sum(self, t: ArrayLike, shape: Callable[..., Any]) -> jax.Array:
        t = jnp.asarray(t)
        u0, tp, ts = (
            jnp.expand_dims(jnp.atleast_1d(x), tuple(range(t.ndim)))
            for x in (self.amplitude, self.periods, self.arrivals)
        )
        a, s = jnp.pi / tp, t[..., None] - ts
        v = (a * s) ** 2
        return jnp.sum(u0 * shape(a, s, v) * jnp.exp(-v), axis=-1)


@pytree_dataclass
class Record(_Combinable):
    """A recorded accelerogram: uniform samples from t = 0, joined by straight lines.

    Before the first sample and after the last the ground is at rest; the acceleration goes linearly
    to zero within one sample interval there.

    Parameters
    ----------
    acceleration
        Samples, shape (n,), n ≥ 2, in g.
    dt
        Sample interval > 0, in the unit of time.
    name
        For titles and tables; transformations such as ``jit`` drop it.
    time_unit
        Unit of time: "s", as in files, or "1/ω1" (also spelled "1/omega1"), that of the
        dimensionless model. Runs of dimensionless structures refuse a record in seconds;
        ``Scales.to_dimensionless`` makes one of it that they take, and ``simulate_buildings`` takes
        it as it is.

    Raises
    ------
    ValueError
        If the samples are not one-dimensional, fewer than two or not finite, dt is not a number
        > 0, the name is not a string, or time_unit is another.

    Examples
    --------
    >>> record = jp.Record([0.0, 0.1, -0.2, 0.0], dt=0.5, name="made up")
    >>> record.scaled_to_pga(0.3)
    Record('made up', 4 samples, dt = 0.5 s, duration 1.5 s, peak 0.3 g)
    >>> round(float(record.acceleration(0.75)), 6)  # half way between two samples
    -0.05
    """

    samples: Any
    dt: Any
    name: str = label(default="")
    time_unit: str = static(default=SECONDS)

    def __init__(
        self, acceleration: Any, dt: Any, name: str = "", time_unit: str = SECONDS
    ) -> None:
        samples = real("Record", "acceleration", acceleration)
        if jnp.ndim(samples) != 1 or jnp.size(samples) < 2:
            raise ValueError(
                f"Record: acceleration of shape {jnp.shape(samples)} must be one-dimensional "
                "with at least two samples"
            )
        object.__setattr__(self, "samples", samples)
        if not isinstance(name, str):
            raise ValueError(f"Record: name = {name!r} must be a string")
        object.__setattr__(self, "dt", number("Record", "dt", dt))
        object.__setattr__(self, "name", name)
        if not (isinstance(time_unit, str) and time_unit in _SPELLINGS):
            rule = f"{SECONDS!r} or {DIMENSIONLESS!r}"
            raise ValueError(f"Record: time_unit = {time_unit!r} must be {rule}")
        object.__setattr__(self, "time_unit", _SPELLINGS[time_unit])
        enforce("Record", self.rules())

    def rules(self) -> list[Rule]:
        """The rules of a record."""
        samples, dt = self.samples, self.dt
        return [
            Rule("acceleration", samples, finite(samples), "finite"),
            Rule("dt", dt, (dt > 0) & finite(dt), "positive and finite"),
        ]

    def acceleration(self, t: ArrayLike) -> jax.Array:
        """u''(t) by linear interpolation, of the shape of ``t``."""
        return self.acceleration_function()(t)

    def acceleration_function(self) -> Callable[[Any], Any]:
        """u''(t); the samples are prepared once, here."""
        samples = jnp.pad(jnp.asarray(self.samples), (1, 1))

        def acceleration(t: Any) -> jax.Array:
            left, share = self._place(t)
            return (1 - share) * samples[left] + share * samples[left + 1]

        return acceleration

    def velocity_function(self) -> Callable[[Any], jax.Array]:
        """u'(t), exactly integrated from rest; the sums over samples are made once, here."""
        samples = jnp.pad(jnp.asarray(self.samples), (1, 1))
        sums = jnp.pad(jnp.cumsum((samples[1:] + samples[:-1]) / 2), (1, 0))

        def velocity(t: Any) -> jax.Array:
            left, share = self._place(t)
            slope = samples[left + 1] - samples[left]
            return self.dt * (sums[left] + share * (samples[left] + share * slope / 2))

        return velocity

    def _place(self, t: ArrayLike) -> tuple[jax.Array, jax.Array]:
        """Sample to the left of t, among samples with a zero at either end, and the way from it."""
        last = self.n_samples + 1
        place = larger(smaller(jnp.asarray(t) / self.dt + 1, last), 0)
        left = jnp.minimum(place.astype(int), last - 1)
        return left, place - left

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
        owner = "Record.scaled_to_pga"
        (pga,) = positive(owner, pga=number(owner, "pga", pga))
        peak = abs(self.samples).max()
        enforce(owner, [Rule("the record's own peak", peak, peak > 0, "positive")])
        return self._with((self.samples * (pga / peak)).astype(self.samples.dtype), self.dt)

    def baseline_corrected(self, kind: str = "linear") -> Record:
        """The record without its mean (``"mean"``) or its least-squares line (``"linear"``)."""
        if kind not in ("mean", "linear"):
            raise ValueError(
                f"Record.baseline_corrected: kind = {kind!r} must be 'mean' or 'linear'"
            )
        samples = self.samples - self.samples.mean()
        if kind == "linear":
            ramp = np.linspace(-1, 1, self.n_samples, dtype=samples.dtype)  # of mean zero
            samples = samples - ramp * (ramp @ samples / (ramp @ ramp))
        return self._with(samples, self.dt)

    def resampled(self, dt: float) -> Record:
        """The record at another sample interval.

        A finer one inserts points on the straight lines between samples, which leaves the motion
        as the simulator sees it unchanged where the old samples are among the new ones; a coarser
        one low-passes first (``scipy.signal.resample_poly``), so that nothing aliases.

        Raises
        ------
        ValueError
            If dt is not a positive number, is above the record's duration, or is coarser in no
            ratio of whole numbers to the record's own; if either interval is traced.
        """
        owner = "Record.resampled"
        if is_traced((dt, self.dt)):
            raise ValueError(f"{owner}: dt decides the number of samples and cannot be traced")
        positive(owner, dt=number(owner, "dt", dt))
        dt, old = float(dt), float(self.dt)
        if dt > self.duration:
            raise ValueError(
                f"{owner}: dt = {dt:.8g} must be at most the record's duration, {self.duration:.8g}"
            )
        if dt <= old:
            n = int((self.n_samples - 1) * old / dt * (1 + 1e-7)) + 1
            place = np.minimum(np.arange(n) * (dt / old), self.n_samples - 1)
            left = np.minimum(place.astype(int), self.n_samples - 2)
            share = (place - left).astype(self.samples.dtype)
            samples = (1 - share) * self.samples[left] + share * self.samples[left + 1]
            return self._with(samples, dt)
        ratio = Fraction(old / dt).limit_denominator(1000)
        if abs(ratio * Fraction(dt) / Fraction(old) - 1) > 1e-7:
            raise ValueError(
                f"{owner}: dt = {dt:.8g} must be a ratio of whole numbers up to 1000 times "
                f"the record's dt = {old:.8g}"
            )
        from scipy.signal import resample_poly  # takes as long to import as all the rest

        samples = resample_poly(np.asarray(self.samples), ratio.numerator, ratio.denominator)
        return self._with(samples, dt)

    def _with(self, samples: Any, dt: Any) -> Record:
        """Other samples under the same name, in the same unit of time."""
        return Record(samples, dt, self.name, self.time_unit)

    def unresolved(self, dt: float) -> list[str]:
        """Whether steps of ``dt`` lose much above their Nyquist frequency π/dt, in words.

        Steps no longer than the sample interval lose nothing: they follow the straight lines.
        """
        own = float(self.dt)
        if dt <= own * (1 + 1e-9):
            return []
        power = np.abs(np.fft.rfft(np.asarray(self.samples, float))) ** 2
        lost = power[np.fft.rfftfreq(self.n_samples, own) > 0.5 / dt].sum()
        if not lost > LOST_ENERGY * (whole := power.sum()):
            return []
        return [
            f"ground: time steps of {dt / own:.4g} sample intervals should lose at most "
            f"{LOST_ENERGY:.0%} of the energy of {self!r}, but lose {lost / whole:.0%}: steps no "
            "longer than the sample interval lose nothing"
        ]

    def __repr__(self) -> str:
        shape = np.shape(self.samples)
        if is_traced((self.samples, self.dt)) or len(shape) != 1 or np.ndim(self.dt):
            return f"Record({shape} samples, time in {self.time_unit})"
        title, unit = f"{self.name!r}, " if self.name else "", self.time_unit
        return (
            f"Record({title}{self.n_samples} samples, dt = {float(self.dt):.6g} {unit}, "
            f"duration {float(self.duration):.6g} {unit}, "
            f"peak {float(abs(self.samples).max()):.4g} g)"
        )


@pytree_dataclass
class Sampled(_Combinable):
    """Values at the instants m·dt of a time grid, and nothing in between."""

    samples: Any
    dt: Any

    def acceleration(self, t: ArrayLike) -> jax.Array:
        """u''(t) at an instant of the grid, of the shape of ``t``."""
        return jnp.asarray(self.samples)[jnp.round(jnp.asarray(t) / self.dt).astype(int)]

    def rules(self) -> list[Rule]:
        """The rule of the values."""
        return [Rule("acceleration", self.samples, finite(self.samples), "finite")]


def acceleration_and_mean(ground: Any, h: float, order: int = 2) -> Callable[[Any], Any]:
    """A function of t: u''(t), and its mean over h about t, as a step of the simulator takes it.

    A record's kinks lie on the instants of the grid, where u'' at a point has no derivative by the
    time scale; its mean, from the exact integral, has one and is closer. Of a smooth ground motion
    the value at t is the mean to second order; Ricker wavelets know it to fourth, which a scheme of
    ``order`` 1, the paper's, does not ask for.
    """
    if isinstance(ground, Sum):
        parts = [acceleration_and_mean(part, h, order) for part in ground.grounds]
        return lambda t: jax.tree.map(lambda *terms: sum(terms), *[part(t) for part in parts])
    if isinstance(ground, Scaled):
        whole = acceleration_and_mean(ground.ground, h, order)
        return lambda t: jax.tree.map(lambda a: ground.factor * a, whole(t))
    if isinstance(ground, Ricker) and order == 2:
        return ground.acceleration_and_mean(h)
    if not isinstance(ground, Record):
        return lambda t: (ground.acceleration(t),) * 2
    value, integral = ground.acceleration_function(), ground.velocity_function()
    return lambda t: (value(t), (integral(t + h / 2) - integral(t - h / 2)) / h)


def velocity_and_bulge(ground: Any, t: jax.Array, h: float) -> tuple[jax.Array, jax.Array]:
    """Velocity u' at the instants t of a grid of step h, and how much its mean at t ∓ h/2 is more.

    Shape (n_steps+1,) each. Records and Ricker wavelets are integrated exactly; of anything else u'
    is the trapezoidal sum from rest.
    """
    if isinstance(ground, Sum):
        parts = [velocity_and_bulge(part, t, h) for part in ground.grounds]
        return jax.tree.map(lambda *terms: sum(terms), *parts)
    if isinstance(ground, Scaled):
        return jax.tree.map(lambda x: ground.factor * x, velocity_and_bulge(ground.ground, t, h))
    if isinstance(ground, Record | Ricker):
        exact = ground.velocity if isinstance(ground, Ricker) else ground.velocity_function()
        velocity, around = exact(t), (exact(t - h / 2) + exact(t + h / 2)) / 2
        return velocity, around - velocity
    a = jax.vmap(ground.acceleration)(t)
    rise = jnp.pad((a[2:] - a[:-2]) / 2, 1)
    return jnp.pad(jnp.cumsum((a[1:] + a[:-1]) * h / 2), (1, 0)), h / 8 * rise


def accelerate(ground: GroundLike, t: ArrayLike) -> Any:
    """Acceleration at ``t`` of a ground motion or of a plain function of t."""
    return ground.acceleration(t) if isinstance(ground, Ground) else ground(t)


def ground_rules(ground: Any) -> list[Rule]:
    """The rules of a ground motion's parameters, of all its parts."""
    if isinstance(ground, Sum):
        return [rule for part in ground.grounds for rule in ground_rules(part)]
    if isinstance(ground, Scaled):
        return [*ground.rules(), *ground_rules(ground.ground)]
    return ground.rules() if hasattr(ground, "rules") else []


def sampled(ground: GroundLike, grid: TimeGrid) -> Sampled:
    """The ground motion at the instants of a time grid.

    This is how the simulator takes a ground motion that is not a pytree of arrays (a Python
    function, say): it is evaluated once on the grid, by array or, if it raises ``TypeError`` or
    ``ValueError`` there, by ``jax.vmap`` or at last instant by instant. An error then is its own.

    Raises
    ------
    ValueError
        If it returns anything but a finite real number for each instant.
    """
    require_ground("ground", ground)
    return Sampled(_on_grid(ground, grid.times()), grid.dt)


def records_in(ground: GroundLike) -> Iterator[Record]:
    """The records that a ground motion is made of."""
    if isinstance(ground, Record):
        yield ground
    elif isinstance(ground, Scaled):
        yield from records_in(ground.ground)
    elif isinstance(ground, Sum):
        for part in ground.grounds:
            yield from records_in(part)


def require_dimensionless(place: str, ground: GroundLike) -> None:
    """A ``ValueError`` for a record in seconds, also within sums and scalings."""
    for record in records_in(ground):
        if record.time_unit != DIMENSIONLESS:
            raise ValueError(
                f"{place}: {record!r} must be in units of {DIMENSIONLESS}, as the structures are: "
                "scales.to_dimensionless(record) makes it so, or simulate_buildings takes "
                "buildings and a record as they are, in SI units"
            )


def unresolved(ground: GroundLike, dt: float) -> list[str]:
    """What of a ground motion steps of ``dt`` do not resolve, in words, as far as it is known."""
    if is_traced(ground) or not hasattr(ground, "unresolved"):
        return []
    return ground.unresolved(dt)


def as_pytree(ground: GroundLike, grid: TimeGrid) -> Ground:
    """The ground motion as a run takes it: itself if JAX can trace through it, else ``sampled``.

    Raises
    ------
    ValueError
        If it is made of a record in seconds, or as ``sampled``.
    """
    require_dimensionless("ground", ground)
    leaves = jax.tree.leaves(ground)
    if isinstance(ground, Ground) and all(hasattr(x, "dtype") or np.isscalar(x) for x in leaves):
        return ground
    return sampled(ground, grid)


def _on_grid(ground: GroundLike, t: np.ndarray) -> Any:
    if isinstance(ground, Sum):
        return sum(_on_grid(part, t) for part in ground.grounds)
    if isinstance(ground, Scaled):
        return ground.factor * _on_grid(ground.ground, t)
    values: Any = None
    for whole in (partial(accelerate, ground), jax.vmap(partial(accelerate, ground))):
        with suppress(TypeError, ValueError):
            values = whole(t)
            break
    else:
        values = [accelerate(ground, float(instant)) for instant in t]
        if not is_traced(values):  # one by one: JAX would compile a program of as many inputs
            values = [np.asarray(value) for value in values]
    values = real("ground", "acceleration(t)", values)
    if jnp.shape(values) not in ((), t.shape):
        raise ValueError(
            f"ground: acceleration(t) of shape {jnp.shape(values)} must have the shape of t, "
            f"{t.shape}"
        )
    enforce("ground", [Rule("acceleration(t)", values, finite(values), "finite")])
    return jnp.broadcast_to(values, t.shape)


def require_ground(name: str, value: Any) -> None:
    """A ``ValueError`` for what is neither a ground motion nor a function of t."""
    if not (callable(value) or isinstance(value, Ground)):
        raise ValueError(f"{name} = {value!r} must have acceleration(t) or be a function of t")
