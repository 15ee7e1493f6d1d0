"""Random ground motions that can be added, scaled and brought into other units of time.

Ricker wavelets, recorded accelerograms, near-fault velocity pulses.
"""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax.scipy.special import ndtr, ndtri
from jaxtyping import Array, Float

from jaxpound._checks import Rule, enforce, finite, instance, number, require_memory
from jaxpound._errors import InvalidInput
from jaxpound._fields import Checked, Parameter, parameter, part, walk
from jaxpound.ground import motion
from jaxpound.ground.record import Record, require_records, stacked
from jaxpound.ground.supports import travelling
from jaxpound.ground.wavelets import Pulse, Ricker
from jaxpound.model.parameters import SMALLEST
from jaxpound.scenarios.distributions import Distribution, TwoSided, require_inside, truncated
from jaxpound.scenarios.scenarios import NUMBER_BYTES, Composed, Draw

# Kinds of quantity of a wavelet's parameters, whose names end with its number, as in ``period_2``.
WAVELET_KINDS = {"amplitude": "length", "period": "time", "arrival": "time"}
_PULSE = {name: rule for name, rule, _ in walk(Pulse, Parameter)}  # parameters of a pulse
_POSITIVE = {name for name, rule in _PULSE.items() if rule.above == 0}


class GroundDraw(motion.Addable["SumOfDraws", "ScaledDraw"], Draw):
    """Base class of random ground motions: sums, scalings, another unit of time.

    They are combined as in ``motion.Addable``: one of two summands may be a fixed ground motion,
    and the factor may be a ``Distribution``.
    """

    time_unit: str | None = None  # None if unknown

    @property
    def discrete(self) -> tuple[int, ...]:
        """Indices of the numbers of which the motion is a step function."""
        return ()

    def dimensionless(self, frequency: Any) -> GroundDraw:
        """These motions converted from seconds to units of 1/ω1, ω1 = ``frequency`` in rad/s."""
        return _Dimensionless(self, frequency)

    def _travelling(self, velocity: Any, distances: tuple[Any, ...]) -> TravellingDraw:
        return TravellingDraw(self, velocity, distances)

    def _make_sum(self, *terms: Any) -> SumOfDraws:
        return SumOfDraws(terms)

    def _make_scaled(self, term: Any, factor: Any) -> Any:
        if isinstance(term, Draw):
            return ScaledDraw(term, factor)
        return motion.as_motion(term) * factor


@dataclasses.dataclass(frozen=True)
class SumOfDraws(Composed, GroundDraw):
    """The sum of several ground motions, each fixed or drawn, independently of each other.

    The parts are draws, at least one, and fixed ground motions or functions of t, all in one unit
    of time; others raise ``ValueError``. The standard normal numbers are those of one part after
    the other. If several parts have a parameter of the same name, the name ends with the part's
    number: ``noise_1_of_2``.

    Examples
    --------
    >>> noise = jp.FilteredNoise(jp.KanaiTajimi(2.0, 0.6), samples=100, dt=0.1, intensity=0.1)
    >>> near_fault = jp.Pulse(amplitude=0.2, period=3.0, arrival=4.0) + noise
    >>> near_fault.dimension
    100
    """

    parts: tuple[Any, ...]

    def __post_init__(self) -> None:
        flat = (p.parts if isinstance(p, SumOfDraws) else (p,) for p in self.parts)
        object.__setattr__(self, "parts", tuple(term for terms in flat for term in terms))
        if not any(isinstance(x, Draw) for x in self.parts):
            raise InvalidInput("parts", "", "must hold at least one that is drawn")
        for i, term in enumerate(self.parts):
            if not isinstance(term, Draw):
                motion.require_ground(f"parts[{i}]", term)
        if len(units := sorted({*self._units()})) > 1:
            rule = "must be in the same unit of time, but are in " + " and ".join(units)
            raise InvalidInput("parts", "", rule)

    @property
    def time_unit(self) -> str | None:  # type: ignore[override]
        """Unit of time of the parts; None if no part has one."""
        return next(iter(self._units()), None)

    def draw(self, z: Float[Array, " d"]) -> Any:
        """The sum of the motions drawn."""
        first, *others = map(motion.as_motion, self._drawn(z))
        return sum(others, first)

    def parameters(self, z: Float[Array, " d"]) -> dict[str, Any]:
        """The parameters of all parts."""
        each = self._parameters(z)
        times = Counter(name for drawn in each for name in drawn)
        return {
            f"{name}_of_{i}" if times[name] > 1 else name: value
            for i, drawn in enumerate(each, 1)
            for name, value in drawn.items()
        }

    def _parts(self) -> tuple[Any, ...]:
        return self.parts

    def _units(self) -> list[str]:
        groups = ([x] if isinstance(x, Draw) else motion.records_in(x) for x in self.parts)
        units = (getattr(term, "time_unit", None) for group in groups for term in group)
        return [unit for unit in units if unit]


@dataclasses.dataclass(frozen=True)
class _NumberDraw(Draw):
    """A number of a ``Distribution``, and its name among the parameters."""

    name: str
    distribution: Distribution
    dimension = 1

    def draw(self, z: Float[Array, " d"]) -> Any:
        return self.distribution.from_normal(z[0])

    def parameters(self, z: Float[Array, " d"]) -> dict[str, Any]:
        return {self.name: self.draw(z)}


def _number(name: str, x: Any) -> Any:
    return _NumberDraw(name, x) if isinstance(x, Distribution) else x


@dataclasses.dataclass(frozen=True)
class _ChangedDraw(Composed, GroundDraw):
    """A random ground motion that is changed."""

    ground: Any

    @property
    def time_unit(self) -> str | None:  # type: ignore[override]
        """Unit of time of the ground motion."""
        return getattr(self.ground, "time_unit", None)

    def _parts(self) -> tuple[Any, ...]:
        return (self.ground,)


@dataclasses.dataclass(frozen=True)
class ScaledDraw(_ChangedDraw):
    """A random ground motion times a factor, which is fixed or drawn.

    The factor is a finite number, or a ``Distribution``, which takes one more standard normal
    number, the last; the parameter ``scale``. Others raise ``ValueError``.
    """

    factor: Any

    def __post_init__(self) -> None:
        instance("ground", self.ground, Draw)
        if not isinstance(self.factor, Distribution):
            factor = number("factor", self.factor)
            enforce([Rule("factor", factor, finite(factor), "finite")])
            object.__setattr__(self, "factor", factor)

    def draw(self, z: Float[Array, " d"]) -> Any:
        """The motion drawn, scaled."""
        ground, factor = self._drawn(z)
        return motion.as_motion(ground) * factor

    def _parts(self) -> tuple[Any, ...]:
        return self.ground, _number("scale", self.factor)


@dataclasses.dataclass(frozen=True)
class TravellingDraw(_ChangedDraw):
    """A random ground motion that travels along supports (``travelling``).

    The velocity is a number > 0 or a ``Distribution``, which takes one more standard normal
    number, the last; the parameter ``velocity``. Others raise ``ValueError``.
    """

    velocity: Any
    distances: tuple[Any, ...]

    def __post_init__(self) -> None:
        known = self.velocity
        if isinstance(known, Distribution):
            require_inside("velocity", known, SMALLEST, math.inf)
            known = 1.0
        travelling(lambda t: 0.0 * t, known, self.distances)  # which checks them

    def draw(self, z: Float[Array, " d"]) -> Any:
        """The motions of the supports drawn."""
        ground, velocity = self._drawn(z)
        return travelling(ground, velocity, self.distances)

    def _parts(self) -> tuple[Any, ...]:
        return self.ground, _number("velocity", self.velocity)


@dataclasses.dataclass(frozen=True)
class _Dimensionless(_ChangedDraw):
    """The motions of a draw in seconds, converted to units of 1/ω1."""

    frequency: Any
    time_unit = motion.DIMENSIONLESS

    def __post_init__(self) -> None:
        motion.require_seconds("ground", self.ground)

    def draw(self, z: Float[Array, " d"]) -> Any:
        return self._drawn(z)[0].dimensionless(self.frequency)


@dataclasses.dataclass(frozen=True)
class RandomRicker(Checked, GroundDraw):
    """A sum of random Ricker wavelets, independent of each other.

    Raises ``ValueError`` if an argument breaks its rule, or the memory has no room for n wavelets.

    Parameters
    ----------
    wavelets, amplitude
        Number n of wavelets, at least 1, and distribution of each displacement amplitude, in g/ω1².
        A ``TwoSided`` distribution draws amplitude and sign from one number without a jump, for
        methods that need the derivative with respect to z.
    periods, arrivals
        Distributions of each wavelet's period, truncated to positive values, and centre, in 1/ω1.
    negative
        Probability, 0 to 1, that a wavelet has the opposite sign; a further number of z draws it,
        with a jump (``discrete``). By default ½, or 0 with ``TwoSided`` amplitudes.
    intensity
        Distribution of a common factor of all wavelets of an earthquake; none by default. A wide
        distribution covers the intensities of a fragility curve.

    Examples
    --------
    >>> periods, arrivals = jp.Uniform(1.0, 3.8), jp.Uniform(1.0, 7.0)
    >>> jumping = jp.RandomRicker(5, jp.LogNormal(0.1, 0.5), periods, arrivals)
    >>> jumping.dimension, jumping.discrete
    (20, (15, 16, 17, 18, 19))
    >>> amplitudes = jp.scenarios.TwoSided(jp.LogNormal(0.1, 0.5))
    >>> smooth = jp.RandomRicker(5, amplitudes, periods, arrivals)
    >>> smooth.dimension, smooth.discrete
    (15, ())
    """

    wavelets: int = parameter(whole=True)
    amplitude: Distribution = part(Distribution)
    periods: Distribution = part(Distribution)
    arrivals: Distribution = part(Distribution)
    negative: Any = parameter(words="probability", least=0, most=1, single=True, default=None)
    intensity: Distribution | None = part(Distribution, default=None)

    def __post_init__(self) -> None:
        if self.negative is None:
            two_sided = isinstance(self.amplitude, TwoSided)
            object.__setattr__(self, "negative", 0.0 if two_sided else 0.5)
        super().__post_init__()
        require_memory("wavelets", self.wavelets, 4 * self.wavelets * NUMBER_BYTES)
        require_inside("periods", self.periods, SMALLEST, math.inf)

    @property
    def dimension(self) -> int:
        """Amplitude, period and arrival of each wavelet, its sign and the intensity if random."""
        return self.wavelets * (3 + self._signed) + (self.intensity is not None)

    def draw(self, z: Float[Array, " d"]) -> Ricker:
        """The wavelets drawn by z."""
        values = self._values(z)
        amplitude = values["intensity"] * values["sign"] * values["amplitude"]
        return Ricker(amplitude, values["period"], values["arrival"])

    def parameters(self, z: Float[Array, " d"]) -> dict[str, Any]:
        """Amplitudes, periods, arrivals, signs by wavelet, and the intensity, if random."""
        values = self._values(z)
        kinds = ["amplitude", "period", "arrival", *["sign"] * self._signed]
        named = {f"{kind}_{i + 1}": values[kind][i] for kind in kinds for i in range(self.wavelets)}
        return named | ({} if self.intensity is None else {"intensity": values["intensity"]})

    @property
    def discrete(self) -> tuple[int, ...]:
        """Indices of the numbers that draw signs."""
        return tuple(range(3 * self.wavelets, 4 * self.wavelets)) if self._signed else ()

    @property
    def _signed(self) -> bool:
        return 0 < self.negative < 1

    def _values(self, z: Any) -> dict[str, Any]:
        n = self.wavelets
        amplitude, periods, arrivals = z[:n], z[n : 2 * n], z[2 * n : 3 * n]
        sign = jnp.full(n, 1.0 - 2.0 * self.negative, z.dtype)
        if self._signed:
            sign = jnp.where(z[3 * n : 4 * n] < ndtri(self.negative), -1.0, 1.0).astype(z.dtype)
        return {
            "amplitude": self.amplitude.from_normal(amplitude),
            "period": truncated(self.periods, periods, SMALLEST, math.inf),
            "arrival": self.arrivals.from_normal(arrivals),
            "sign": sign,
            "intensity": 1.0 if self.intensity is None else self.intensity.from_normal(z[-1]),
        }


@dataclasses.dataclass(frozen=True)
class RandomRecord(Checked, GroundDraw):
    """A recorded accelerogram, drawn from several and scaled.

    The ``records``, at least one, have any lengths and one unit of time. ``factor`` is the
    distribution of the factor, by default 1; ``weights`` are relative frequencies ≥ 0, one of each
    record, with a positive sum, by default equal. Others raise ``ValueError``.
    """

    records: tuple[Record, ...]
    factor: Distribution | None = part(Distribution, default=None)
    weights: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        require_records(self.records, Sequence)
        object.__setattr__(self, "records", tuple(self.records))
        super().__post_init__()
        if self.weights is not None:
            weights, n = np.asarray(self.weights, float), len(self.records)
            valid = weights.shape == (n,) and (weights >= 0).all() and weights.sum() > 0
            if not (valid and np.isfinite(weights).all()):
                rule = f"must be {n} numbers, finite and not negative, with a positive sum"
                raise InvalidInput("weights", repr(self.weights), rule)
            object.__setattr__(self, "weights", tuple(map(float, weights)))

    @property
    def time_unit(self) -> str:  # type: ignore[override]
        """That of the records."""
        return self.records[0].time_unit

    @property
    def dimension(self) -> int:
        """One number for the record, if there are several, and one for a random factor."""
        return (len(self.records) > 1) + (self.factor is not None)

    @property
    def discrete(self) -> tuple[int, ...]:
        """Index of the number that draws the record, if there are several."""
        return (0,) if len(self.records) > 1 else ()

    def draw(self, z: Float[Array, " d"]) -> Record:
        """The record drawn by z, scaled."""
        number, factor = self._values(z)
        samples, intervals = (jnp.asarray(x, z.dtype)[number] for x in stacked(self.records))
        return Record(factor * samples, intervals, time_unit=self.time_unit)

    def parameters(self, z: Float[Array, " d"]) -> dict[str, Any]:
        """The record's number, from 0, and the factor, as far as they are random."""
        number, factor = self._values(z)
        named = {"record": number} if len(self.records) > 1 else {}
        return named | ({} if self.factor is None else {"factor": factor})

    def _values(self, z: Any) -> tuple[Any, Any]:
        weights = np.array(self.weights or [1.0] * len(self.records))
        ends = np.cumsum(weights / weights.sum())[:-1]
        number = jnp.sum(ndtr(z[0]) >= jnp.asarray(ends, z.dtype)) if len(ends) else 0
        return number, 1.0 if self.factor is None else self.factor.from_normal(z[-1])


@dataclasses.dataclass(frozen=True)
class RandomPulse(GroundDraw):
    """A near-fault velocity pulse of random parameters, independent of each other.

    Each parameter is a number or, at least one, a ``Distribution``; those of period and cycles are
    truncated to positive values. Each random parameter takes a standard normal number, in the order
    of the fields. Raises ``ValueError`` for other parameters. See ``Pulse`` for them; a
    ``TwoSided`` amplitude makes pulses of either sign, and ``time_unit`` is "1/ω1" (also
    "1/omega1") or "s".

    Examples
    --------
    >>> pulse = jp.scenarios.RandomPulse(
    ...     amplitude=jp.scenarios.TwoSided(jp.LogNormal(median=0.5, sigma=0.4)),
    ...     period=jp.LogNormal(median=3.0, sigma=0.3),
    ...     arrival=5.0,
    ...     phase=jp.Uniform(0.0, np.pi),
    ... )
    >>> pulse.dimension
    3
    >>> round(float(pulse.draw(np.array([1.0, 0.0, 0.0])).amplitude), 3)
    0.605
    """

    amplitude: Any
    period: Any
    arrival: Any
    phase: Any = 0.0
    cycles: Any = 2.0
    time_unit: str = motion.DIMENSIONLESS

    def __post_init__(self) -> None:
        object.__setattr__(self, "time_unit", motion.time_unit_of(self.time_unit))
        if not self._random():
            raise InvalidInput("one of the parameters", "", "must be a Distribution")
        for name in _PULSE:
            if isinstance(getattr(self, name), type):
                instance(name, getattr(self, name), Distribution)
        fixed = {name: getattr(self, name) for name in _PULSE if name not in self._random()}
        Pulse(**dict.fromkeys(_PULSE, 1.0) | fixed, time_unit=self.time_unit)
        for name, x in self._random().items():
            if name in _POSITIVE:
                require_inside(name, x, SMALLEST, math.inf)

    @property
    def dimension(self) -> int:
        """Number of random parameters."""
        return len(self._random())

    def draw(self, z: Float[Array, " d"]) -> Pulse:
        """The pulse drawn by z."""
        return Pulse(**vars(self) | self.parameters(z))

    def parameters(self, z: Float[Array, " d"]) -> dict[str, Any]:
        """The random parameters, by name."""
        return {
            name: truncated(x, u, SMALLEST, math.inf) if name in _POSITIVE else x.from_normal(u)
            for (name, x), u in zip(self._random().items(), z, strict=True)
        }

    def _random(self) -> dict[str, Distribution]:
        values = {name: getattr(self, name) for name in _PULSE}
        return {name: x for name, x in values.items() if isinstance(x, Distribution)}
