"""Random ground motions: sums of Ricker wavelets, and recorded accelerograms."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from types import NoneType
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax.scipy.special import ndtr, ndtri
from jaxtyping import Array, Float

from jaxpound._checks import count, instance, require_memory
from jaxpound._fields import Checked, parameter, part
from jaxpound.ground.motion import DIMENSIONLESS, require_dimensionless
from jaxpound.ground.record import Record, stacked
from jaxpound.ground.ricker import Ricker
from jaxpound.model.parameters import SMALLEST
from jaxpound.study.distributions import Distribution, TwoSided, truncated
from jaxpound.study.ground_draw import GroundDraw
from jaxpound.study.scenarios import NUMBER_BYTES

WAVELET_KINDS = {"amplitude": "length", "period": "time", "arrival": "time"}
"""Kinds of quantity of a wavelet's parameters; names end with its number, as in ``period_2``."""


@dataclasses.dataclass(frozen=True)
class RandomRicker(Checked, GroundDraw):
    """A sum of random Ricker wavelets, independent of each other.

    Parameters
    ----------
    wavelets
        Number n of wavelets, at least 1.
    amplitude
        Distribution of each displacement amplitude, in g/ω1² (the scale of ``Ricker.amplitude``).
        With a ``TwoSided`` one amplitude and sign follow from one number, without a jump between
        the signs: methods that need the derivative by z can then follow them.
    periods, arrivals
        Distributions of each wavelet's period, truncated to positive values, and centre, in 1/ω1.
    negative
        Probability, 0 to 1, that a wavelet has the opposite sign, by a number of z of its own, in
        which that is a jump (``discrete``). By default ½, or 0 with ``TwoSided`` amplitudes.
    intensity
        Distribution of one factor for all wavelets of an earthquake; none by default. A wide one
        covers the range of intensities of a fragility curve.

    Raises
    ------
    ValueError
        If wavelets is not a positive whole number or too large for the memory, negative not a
        probability, or another argument not a distribution.

    Examples
    --------
    >>> periods, arrivals = jp.Uniform(1.0, 3.8), jp.Uniform(1.0, 7.0)
    >>> jumping = jp.RandomRicker(5, jp.LogNormal(0.1, 0.5), periods, arrivals)
    >>> jumping.dimension, jumping.discrete
    (20, (15, 16, 17, 18, 19))
    >>> smooth = jp.RandomRicker(5, jp.TwoSided(jp.LogNormal(0.1, 0.5)), periods, arrivals)
    >>> smooth.dimension, smooth.discrete
    (15, ())
    """

    wavelets: int
    amplitude: Distribution = part(Distribution)
    periods: Distribution = part(Distribution)
    arrivals: Distribution = part(Distribution)
    negative: Any = parameter(words="probability", least=0, most=1, single=True, default=None)
    intensity: Distribution | None = part(Distribution, NoneType, default=None)

    def __post_init__(self) -> None:
        n = count("RandomRicker", "wavelets", self.wavelets)
        require_memory("RandomRicker", "wavelets", n, 4 * n * NUMBER_BYTES)
        if self.negative is None:
            object.__setattr__(self, "negative", 0.0 if self._two_sided else 0.5)
        super().__post_init__()

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
        n = self.wavelets
        return tuple(range(3 * n, 4 * n)) if self._signed else ()

    @property
    def _signed(self) -> bool:
        return 0 < self.negative < 1

    @property
    def _two_sided(self) -> bool:
        return isinstance(self.amplitude, TwoSided)

    def _values(self, z: Any) -> dict[str, Any]:
        n = self.wavelets
        amplitude, periods, arrivals = z[:n], z[n : 2 * n], z[2 * n : 3 * n]
        if self._signed:
            sign = jnp.where(z[3 * n : 4 * n] < ndtri(self.negative), -1.0, 1.0).astype(z.dtype)
        else:
            sign = jnp.full(n, 1.0 - 2.0 * self.negative, z.dtype)
        periods = truncated(self.periods, periods, SMALLEST, math.inf)
        return {
            "amplitude": self.amplitude.from_normal(amplitude),
            "period": periods,
            "arrival": self.arrivals.from_normal(arrivals),
            "sign": sign,
            "intensity": 1.0 if self.intensity is None else self.intensity.from_normal(z[-1]),
        }


@dataclasses.dataclass(frozen=True)
class RandomRecord(Checked, GroundDraw):
    """One of several recorded accelerograms, scaled.

    Parameters
    ----------
    records
        The records, in units of g over 1/ω1 (``Scales.to_dimensionless``), of any lengths.
    factor
        Distribution of the factor; none (a factor of 1) by default.
    weights
        Relative frequencies of the records ≥ 0; equal by default.

    Raises
    ------
    ValueError
        If records is empty, holds something else or a record in seconds, factor is not a
        distribution, or the weights are not one number ≥ 0 for each record, with a positive sum.
    """

    records: tuple[Record, ...]
    factor: Distribution | None = part(Distribution, NoneType, default=None)
    weights: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        records = tuple(self.records) if isinstance(self.records, Sequence) else ()
        if not records:
            raise ValueError(f"RandomRecord: records = {self.records!r} must hold records")
        for i, record in enumerate(records):
            instance("RandomRecord", f"records[{i}]", record, Record)
            require_dimensionless(f"RandomRecord: records[{i}]", record)
        object.__setattr__(self, "records", records)
        super().__post_init__()
        if self.weights is not None:
            weights = np.asarray(self.weights, float)
            right = weights.shape == (len(records),) and (weights >= 0).all() and weights.sum() > 0
            if not (right and np.isfinite(weights).all()):
                raise ValueError(
                    f"RandomRecord: weights = {self.weights!r} must be {len(records)} numbers, "
                    "finite and not negative, with a positive sum"
                )
            object.__setattr__(self, "weights", tuple(map(float, weights)))

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
        which, factor = self._values(z)
        samples, intervals = stacked(self.records)
        return Record(
            factor * jnp.asarray(samples, z.dtype)[which],
            jnp.asarray(intervals, z.dtype)[which],
            time_unit=DIMENSIONLESS,
        )

    def parameters(self, z: Float[Array, " d"]) -> dict[str, Any]:
        """The record's number, from 0, and the factor, each if it is random."""
        which, factor = self._values(z)
        named = {"record": which} if len(self.records) > 1 else {}
        return named | ({} if self.factor is None else {"factor": factor})

    def _values(self, z: Any) -> tuple[Any, Any]:
        weights = np.array(self.weights or [1.0] * len(self.records))
        ends = np.cumsum(weights / weights.sum())[:-1]
        which: Any = 0
        if len(self.records) > 1:
            which = jnp.sum(ndtr(z[0]) >= jnp.asarray(ends, z.dtype))
        return which, 1.0 if self.factor is None else self.factor.from_normal(z[-1])
