"""Random velocity pulses of earthquakes near their fault."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

from jaxtyping import Array, Float

from jaxpound._checks import instance
from jaxpound._fields import Parameter, walk
from jaxpound.ground.motion import DIMENSIONLESS, known_unit
from jaxpound.ground.pulse import Pulse
from jaxpound.model.parameters import SMALLEST
from jaxpound.study.distributions import Distribution, truncated
from jaxpound.study.ground_draw import GroundDraw

_KNOWN = {name: known for name, known, _ in walk(Pulse, Parameter)}


@dataclasses.dataclass(frozen=True)
class RandomPulse(GroundDraw):
    """A near-fault velocity pulse of random parameters, independent of each other.

    Each parameter is a number or a ``Distribution``, those of period and cycles truncated to
    positive values. Random ones take a standard normal number each, in this order, and have these
    names.

    Parameters
    ----------
    amplitude, period, arrival, phase, cycles
        Those of ``Pulse``. Pulses of either sign have a ``TwoSided`` amplitude.
    time_unit
        Unit of time: "1/ω1" (also spelled "1/omega1") or "s", as of ``Pulse``.

    Raises
    ------
    ValueError
        If a parameter is neither a distribution nor a valid number, or none is a distribution.

    Examples
    --------
    >>> pulse = jp.RandomPulse(
    ...     amplitude=jp.TwoSided(jp.LogNormal(median=0.5, sigma=0.4)),
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
    time_unit: str = DIMENSIONLESS

    def __post_init__(self) -> None:
        object.__setattr__(self, "time_unit", known_unit("RandomPulse", self.time_unit))
        if not self._random():
            raise ValueError("RandomPulse: one of the parameters must be a Distribution")
        for name in _KNOWN:
            if isinstance(getattr(self, name), type):
                instance("RandomPulse", name, getattr(self, name), Distribution)
        fixed = {name: getattr(self, name) for name in _KNOWN if name not in self._random()}
        Pulse(**dict.fromkeys(_KNOWN, 1.0) | fixed, time_unit=self.time_unit)

    @property
    def dimension(self) -> int:
        """Number of random parameters."""
        return len(self._random())

    def draw(self, z: Float[Array, " d"]) -> Pulse:
        """The pulse drawn by z."""
        known = {name: getattr(self, name) for name in _KNOWN}
        return Pulse(**known | self.parameters(z), time_unit=self.time_unit)

    def parameters(self, z: Float[Array, " d"]) -> dict[str, Any]:
        """The random parameters, by name."""
        return {name: self._value(name, x) for name, x in zip(self._random(), z, strict=True)}

    def _random(self) -> list[str]:
        return [name for name in _KNOWN if isinstance(getattr(self, name), Distribution)]

    def _value(self, name: str, z: Any) -> Any:
        distribution = getattr(self, name)
        if _KNOWN[name].above == 0:
            return truncated(distribution, z, SMALLEST, math.inf)
        return distribution.from_normal(z)
