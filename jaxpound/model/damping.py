"""Damping that buildings have in themselves, as most programs state it; in SI units."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from jaxpound._checks import Range, as_tuple, is_whole
from jaxpound._errors import InvalidInput
from jaxpound._fields import BatchInSI, parameter, pytree_dataclass, static

_RATIO = Range(0, 1, "", "of the critical damping; 0.05 is 5 %")
_OF_MASS = Range(0, 1e3, "1/s", "some hundredths of a rigid building's frequency")
_OF_STIFFNESS = Range(0, 1e2, "s", "some hundredths of a flexible building's period")
_MODES = (1, 2)
_BISECTIONS = 60  # to rounding


@pytree_dataclass
class Rayleigh(BatchInSI):
    r"""Rayleigh's damping, :math:`C = α M + β K`, with the stiffness of storeys before they yield.

    A mode of the frequency ω has the damping ratio α/(2 ω) + β ω/2. The part of the masses acts on
    their velocity relative to the ground, or to the base of a building on bearings; that of the
    stiffness on the drift of storeys, and goes on as they yield (Hall 2006 on what that costs).

    Raises ``ValueError`` if neither a ratio nor both coefficients are stated, or a value breaks its
    rule.

    Parameters
    ----------
    ratio
        Damping ratio ≥ 0 that two modes have (0.05 is 5 %); that of storeys' own rods and dashpots
        comes on top.
    modes
        The two modes, from 1; by default the first two. A building of one storey has one.
    mass, stiffness
        In the place of a ratio: α ≥ 0, 1/s, and β ≥ 0, s; one of them may be left out, and is 0.

    Examples
    --------
    >>> frame = jp.ShearBuilding.of_storeys([3e5] * 4, 4e8, damping=jp.Rayleigh(0.05))
    >>> frame.modes().damping_ratios.round(4).tolist()
    [0.05, 0.05, 0.0653, 0.0766]
    """

    ratio: Any = parameter(
        r"\zeta", words="damping ratio", least=0, within=_RATIO, optional=True, default=None
    )
    modes: tuple[int, int] = static(default=_MODES)
    mass: Any = parameter(r"\alpha", least=0, within=_OF_MASS, optional=True, default=None)
    stiffness: Any = parameter(r"\beta", least=0, within=_OF_STIFFNESS, optional=True, default=None)

    def __post_init__(self) -> None:
        modes = as_tuple("modes", self.modes)
        if len(modes) != 2 or not all(is_whole(x) and x >= 1 for x in modes):
            raise InvalidInput("modes", repr(self.modes), "must be the numbers of two, from 1")
        object.__setattr__(self, "modes", tuple(sorted(map(int, modes))))
        if self.ratio is None and self.mass is None and self.stiffness is None:
            raise InvalidInput("ratio", "None", "must be stated, or mass and stiffness")
        if self.ratio is None and self.modes != _MODES:
            rule = "must be left out beside mass and stiffness: they are those of a ratio"
            raise InvalidInput("modes", repr(self.modes), rule)
        if self.ratio is not None:
            for name in ("mass", "stiffness"):
                if (value := getattr(self, name)) is not None:
                    raise InvalidInput(name, str(value), "must be left out: it follows from ratio")
        super().__post_init__()

    def require_modes(self, n: int) -> None:
        """An ``InvalidInput`` for modes that a building of n storeys has not."""
        if max(self.modes) > max(n, 2 if self.modes == _MODES else 1):
            raise InvalidInput("modes", repr(self.modes), f"must be from 1 to {n}, the storeys")

    def coefficients(self, masses: Sequence[Any], stiffnesses: Sequence[Any]) -> tuple[Any, Any]:
        """α, 1/s, and β, s, of a shear building of these masses, kg, on storeys, N/m."""
        if self.ratio is None:
            alpha, beta = (0.0 if x is None else x for x in (self.mass, self.stiffness))
            return alpha, beta
        numbers = [min(number, len(masses)) for number in self.modes]
        first, second = (frequency(masses, stiffnesses, number - 1) for number in numbers)
        beta = 2 * self.ratio / (first + second)
        return beta * first * second, beta


@partial(jax.jit, static_argnames="mode")
def frequency(masses: Sequence[Any], stiffnesses: Sequence[Any], mode: int) -> jax.Array:
    """Frequency of a mode, from 0, of masses one above the other on springs without damping.

    By bisection and Sturm's count, and steps of Newton's method, which bring the derivatives.
    """
    above = (*stiffnesses[1:], 0.0)
    diagonal = [(k + up) / m for m, k, up in zip(masses, stiffnesses, above, strict=True)]
    pairs = zip(stiffnesses[1:], masses, masses[1:], strict=False)
    matrix = diagonal, [0.0, *(k**2 / (low * high) for k, low, high in pairs)]
    fixed = lax.stop_gradient(matrix)

    def characteristic(matrix: Any, square: Any) -> tuple[Any, Any]:
        """The characteristic polynomial, but for its size, and how many roots are below."""
        last, value, below = jnp.zeros_like(square), jnp.ones_like(square), jnp.asarray(0)
        for entry, coupling in zip(*matrix, strict=True):
            following = (entry - square) * value - coupling * last
            below += jnp.where((following < 0) != (value < 0), 1, 0)
            size = lax.stop_gradient(jnp.maximum(jnp.abs(following), jnp.abs(value)))
            last, value = value / size, following / size
        return value, below

    def halve(bracket: tuple[Any, Any], _: None) -> tuple[Any, None]:
        low, high = bracket
        middle = (low + high) / 2
        beyond = characteristic(fixed, middle)[1] > mode
        return (jnp.where(beyond, low, middle), jnp.where(beyond, middle, high)), None

    high = 2 * sum(fixed[0])  # beyond all
    (low, high), _ = lax.scan(halve, (0 * high, high), length=_BISECTIONS)
    square = (low + high) / 2
    for _ in range(2):
        value, slope = jax.jvp(
            lambda x: characteristic(matrix, x)[0], (square,), (jnp.ones_like(square),)
        )
        square = square - value / slope
    return jnp.sqrt(square)
