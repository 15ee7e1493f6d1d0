"""Random ground motions that can be added, scaled and brought into other units of time."""

from __future__ import annotations

import dataclasses
from collections import Counter
from typing import Any

from jaxtyping import Array, Float

from jaxpound._checks import Rule, enforce, finite, instance, number
from jaxpound._errors import InvalidInput
from jaxpound.ground import motion
from jaxpound.scenarios.distributions import Distribution
from jaxpound.scenarios.scenarios import Composed, CustomDraw, Draw


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
        object.__setattr__(self, "parts", tuple(part for parts in flat for part in parts))
        if not any(isinstance(part, Draw) for part in self.parts):
            raise InvalidInput("parts", "", "must hold at least one that is drawn")
        for i, part in enumerate(self.parts):
            if not isinstance(part, Draw):
                motion.require_ground(f"parts[{i}]", part)
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
        units = (getattr(part, "time_unit", None) for group in groups for part in group)
        return [unit for unit in units if unit]


@dataclasses.dataclass(frozen=True)
class ScaledDraw(Composed, GroundDraw):
    """A random ground motion times a factor, which is fixed or drawn.

    The factor is a finite number, or a ``Distribution``, which takes one more standard normal
    number, the last; the parameter ``scale``. Others raise ``ValueError``.
    """

    ground: Draw
    factor: Any

    def __post_init__(self) -> None:
        instance("ground", self.ground, Draw)
        if not isinstance(self.factor, Distribution):
            factor = number("factor", self.factor)
            enforce([Rule("factor", factor, finite(factor), "finite")])
            object.__setattr__(self, "factor", factor)

    @property
    def time_unit(self) -> str | None:  # type: ignore[override]
        """Unit of time of the ground motion."""
        return getattr(self.ground, "time_unit", None)

    def draw(self, z: Float[Array, " d"]) -> Any:
        """The motion drawn, scaled."""
        ground, factor = self._drawn(z)
        return motion.as_motion(ground) * factor

    def parameters(self, z: Float[Array, " d"]) -> dict[str, Any]:
        """The parameters of the ground motion, and the factor if it is random."""
        random = isinstance(self.factor, Distribution)
        scale = {"scale": self.factor.from_normal(z[-1])} if random else {}
        return self._parameters(z)[0] | scale

    def _parts(self) -> tuple[Any, ...]:
        if not isinstance(self.factor, Distribution):
            return self.ground, self.factor
        return self.ground, CustomDraw(lambda z: self.factor.from_normal(z[0]), 1)


@dataclasses.dataclass(frozen=True)
class _Dimensionless(Composed, GroundDraw):
    """The motions of a draw in seconds, converted to units of 1/ω1."""

    ground: GroundDraw
    frequency: Any
    time_unit = motion.DIMENSIONLESS

    def __post_init__(self) -> None:
        motion.require_seconds("ground", self.ground)

    def draw(self, z: Float[Array, " d"]) -> Any:
        return self._drawn(z)[0].dimensionless(self.frequency)

    def _parts(self) -> tuple[Any, ...]:
        return (self.ground,)
