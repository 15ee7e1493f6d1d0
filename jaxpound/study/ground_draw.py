"""Random ground motions that can be added, scaled and brought into other units of time."""

from __future__ import annotations

import dataclasses
from collections import Counter
from typing import Any

from jaxtyping import Array, Float

from jaxpound._checks import Rule, enforce, finite, instance, number
from jaxpound.ground.motion import (
    DIMENSIONLESS,
    GroundLike,
    as_motion,
    records_in,
    require_ground,
    require_seconds,
)
from jaxpound.study.distributions import Distribution
from jaxpound.study.scenarios import Draw, discrete_coordinates, parameters


class GroundDraw:
    """Base class of random ground motions: sums, scalings, another unit of time.

    They are combined by ``a + b``, ``a - b``, ``2 * a``, ``a / 2``, ``-a`` and ``sum([a, b])``;
    one of the two that are added may be a fixed ground motion, and the factor a ``Distribution``.
    """

    __array_ufunc__ = None  # so that a NumPy factor on the left calls our ``__rmul__``
    time_unit: str | None = None  # where it is known, as that of records is

    @property
    def dimension(self) -> int:
        """Number of independent standard normal numbers."""
        raise NotImplementedError

    @property
    def discrete(self) -> tuple[int, ...]:
        """Indices of the numbers of which the motion is a step function."""
        return ()

    def draw(self, z: Float[Array, " d"]) -> Any:
        """The ground motion drawn by z."""
        raise NotImplementedError

    def dimensionless(self, frequency: Any) -> GroundDraw:
        """The same motions, in seconds, in units of 1/ω1 for ω1 = ``frequency`` in rad/s."""
        return _Dimensionless(self, frequency)

    def __add__(self, other: Draw | GroundLike) -> SumOfDraws:
        return SumOfDraws((self, other))

    def __radd__(self, other: Any) -> Any:
        if isinstance(other, int) and other == 0:  # where the builtin sum starts
            return self
        return SumOfDraws((other, self))

    def __sub__(self, other: Draw | GroundLike) -> SumOfDraws:
        return SumOfDraws((self, _negative(other)))

    def __rsub__(self, other: Draw | GroundLike) -> SumOfDraws:
        return SumOfDraws((other, -self))

    def __mul__(self, factor: Any) -> ScaledDraw:
        return ScaledDraw(self, factor)

    __rmul__ = __mul__

    def __truediv__(self, divisor: Any) -> ScaledDraw:
        divisor = number("ScaledDraw", "divisor", divisor)
        enforce("ScaledDraw", [Rule("divisor", divisor, divisor != 0, "no zero")])
        return ScaledDraw(self, 1 / divisor)

    def __neg__(self) -> ScaledDraw:
        return ScaledDraw(self, -1.0)


@dataclasses.dataclass(frozen=True)
class SumOfDraws(GroundDraw):
    """The sum of several ground motions, each fixed or drawn, independently of each other.

    Its standard normal numbers are those of the parts, one part after the other. A parameter whose
    name more than one part has is numbered by its part, as in ``noise_1_of_2``.

    Parameters
    ----------
    parts
        Draws, and fixed ground motions or functions of t; at least one draw. All that have a unit
        of time have the same.

    Raises
    ------
    ValueError
        If a part is none of these, none is drawn, or their units of time differ.

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
            raise ValueError("SumOfDraws: parts must hold at least one that is drawn")
        for i, part in enumerate(self.parts):
            if not isinstance(part, Draw):
                require_ground(f"SumOfDraws: parts[{i}]", part)
        units = self._units()
        if len(set(units)) > 1:
            rule = "must be in the same unit of time, but are in " + " and ".join(sorted({*units}))
            raise ValueError(f"SumOfDraws: parts {rule}")

    @property
    def time_unit(self) -> str | None:  # type: ignore[override]
        """That of the parts which have one."""
        units = self._units()
        return units[0] if units else None

    @property
    def dimension(self) -> int:
        """Numbers of all parts."""
        return sum(_dimension(part) for part in self.parts)

    @property
    def discrete(self) -> tuple[int, ...]:
        """Indices of the numbers of which the motion is a step function."""
        ends = self._ends()
        return tuple(
            start + i
            for part, (start, _) in zip(self.parts, ends, strict=True)
            for i in discrete_coordinates(part)
        )

    def draw(self, z: Float[Array, " d"]) -> Any:
        """The sum of the motions drawn."""
        motions = [
            as_motion(part.draw(z[start:end]) if isinstance(part, Draw) else part)
            for part, (start, end) in zip(self.parts, self._ends(), strict=True)
        ]
        return sum(motions[1:], motions[0])

    def parameters(self, z: Float[Array, " d"]) -> dict[str, Any]:
        """The parameters of all parts."""
        each = [
            parameters(part, z[start:end], start) if end > start else {}
            for part, (start, end) in zip(self.parts, self._ends(), strict=True)
        ]
        names = [name for found in each for name in found]
        repeated = {name for name, times in Counter(names).items() if times > 1}
        return {
            f"{name}_of_{i}" if name in repeated else name: value
            for i, found in enumerate(each, 1)
            for name, value in found.items()
        }

    def _units(self) -> list[str]:
        units = []
        for part in self.parts:
            if isinstance(part, Draw):
                units.append(getattr(part, "time_unit", None))
            else:
                units += [record.time_unit for record in records_in(part)]
        return [unit for unit in units if unit]

    def _ends(self) -> list[tuple[int, int]]:
        """Where the numbers of each part begin and end."""
        ends, start = [], 0
        for part in self.parts:
            ends.append((start, start + _dimension(part)))
            start = ends[-1][1]
        return ends


@dataclasses.dataclass(frozen=True)
class ScaledDraw(GroundDraw):
    """A random ground motion times a factor, a number or drawn too.

    Parameters
    ----------
    ground
        The draw.
    factor
        A number, or a ``Distribution``, which takes one more standard normal number, the last; the
        parameter's name is ``scale``.

    Raises
    ------
    ValueError
        If ground is not a draw, or the factor neither a finite number nor a distribution.

    Examples
    --------
    >>> noise = jp.FilteredNoise(jp.KanaiTajimi(2.0, 0.6), samples=100, dt=0.1, intensity=0.1)
    >>> (noise * jp.LogNormal(median=1.0, sigma=0.5)).dimension
    101
    """

    ground: Draw
    factor: Any

    def __post_init__(self) -> None:
        instance("ScaledDraw", "ground", self.ground, Draw)
        if not isinstance(self.factor, Distribution):
            factor = number("ScaledDraw", "factor", self.factor)
            enforce("ScaledDraw", [Rule("factor", factor, finite(factor), "finite")])
            object.__setattr__(self, "factor", factor)

    @property
    def time_unit(self) -> str | None:  # type: ignore[override]
        """That of the ground motion."""
        return getattr(self.ground, "time_unit", None)

    @property
    def dimension(self) -> int:
        """Numbers of the ground motion, and one of a random factor."""
        return self.ground.dimension + isinstance(self.factor, Distribution)

    @property
    def discrete(self) -> tuple[int, ...]:
        """Indices of the numbers of which the motion is a step function."""
        return discrete_coordinates(self.ground)

    def draw(self, z: Float[Array, " d"]) -> Any:
        """The motion drawn, scaled."""
        return as_motion(self.ground.draw(z[: self.ground.dimension])) * self._factor(z)

    def parameters(self, z: Float[Array, " d"]) -> dict[str, Any]:
        """The parameters of the ground motion, and the factor, if it is random."""
        found = parameters(self.ground, z[: self.ground.dimension])
        return found | ({"scale": self._factor(z)} if self._is_random else {})

    @property
    def _is_random(self) -> bool:
        return isinstance(self.factor, Distribution)

    def _factor(self, z: Any) -> Any:
        return self.factor.from_normal(z[-1]) if self._is_random else self.factor


@dataclasses.dataclass(frozen=True)
class _Dimensionless(GroundDraw):
    """The motions of a draw in seconds, in units of 1/ω1."""

    ground: GroundDraw
    frequency: Any

    def __post_init__(self) -> None:
        require_seconds("dimensionless: ground", self.ground)

    time_unit = DIMENSIONLESS

    @property
    def dimension(self) -> int:
        return self.ground.dimension

    @property
    def discrete(self) -> tuple[int, ...]:
        return self.ground.discrete

    def draw(self, z: Float[Array, " d"]) -> Any:
        return self.ground.draw(z).dimensionless(self.frequency)

    def parameters(self, z: Float[Array, " d"]) -> dict[str, Any]:
        return parameters(self.ground, z)


def _negative(ground: Draw | GroundLike) -> Any:
    return ScaledDraw(ground, -1.0) if isinstance(ground, Draw) else -as_motion(ground)


def _dimension(part: Any) -> int:
    return part.dimension if isinstance(part, Draw) else 0
