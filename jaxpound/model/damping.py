"""Damping that buildings have in themselves, as most programs state it; in SI units."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxpound._checks import Range, as_tuple, is_traced, is_whole
from jaxpound._errors import InvalidInput
from jaxpound._fields import BatchInSI, parameter, pytree_dataclass, static, unchecked
from jaxpound.model.dampers import Dashpot, MatrixDashpot
from jaxpound.model.structures import storey_ends
from jaxpound.model.topology import GROUND, Ends

_RATIO = Range(0, 1, "", "of the critical damping; 0.05 is 5 %")
_OF_MASS = Range(0, 1e3, "1/s", "2 ζ ω1 ω2/(ω1 + ω2), some hundredths of ω1")
_OF_STIFFNESS = Range(0, 1e2, "s", "2 ζ/(ω1 + ω2), some thousandths of the period")
_MODES = (1, 2)


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

    ratio: Any = parameter(r"\zeta", words="damping ratio", least=0, within=_RATIO, default=None)
    modes: tuple[int, int] = static(default=_MODES)
    mass: Any = parameter(r"\alpha", least=0, within=_OF_MASS, default=None)
    stiffness: Any = parameter(r"\beta", least=0, within=_OF_STIFFNESS, default=None)

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
        numbers = [min(number, len(masses)) - 1 for number in self.modes]
        frequencies, _ = normal_modes(masses, stiffnesses)
        first, second = (frequencies[..., number] for number in numbers)
        beta = 2 * self.ratio / (first + second)
        return beta * first * second, beta

    def dashpots(self, masses: Sequence[Any], stiffnesses: Sequence[Any]) -> list[tuple[Ends, Any]]:
        """Ends by floor, from 0, and material of what it is in such a building."""
        alpha, beta = self.coefficients(masses, stiffnesses)
        pairs = enumerate(zip(masses, stiffnesses, strict=True))
        both = ([((i, GROUND), alpha * m), (storey_ends(i), beta * k)] for i, (m, k) in pairs)
        return [(ends, unchecked(Dashpot, coefficient=c)) for ends, c in chain(*both)]


@pytree_dataclass
class ModalDamping(BatchInSI):
    r"""A damping ratio for each mode, :math:`C = M Φ \operatorname{diag}(2 ζ ω) Φ^T M`.

    Φ are the modes of a building on springs, of unit modal mass, before storeys yield: dashpots
    then go on as they are, between any two floors (Wilson and Penzien 1972). As ``Rayleigh``'s
    damping it acts on velocities relative to the ground, to the base of a building on bearings or
    to the footing on soil. With the weight of ``with_p_delta`` the modes are those with weight.

    Raises ``ValueError`` if a value breaks its rule; a building, if it has another number of modes.

    Parameters
    ----------
    ratios
        Damping ratio ≥ 0 of each mode (0.05 is 5 %), the first first, as many as there are storeys
        above bearings; or one for all.

    Examples
    --------
    >>> damping = jp.model.ModalDamping([0.02, 0.05, 0.05, 0.1])
    >>> frame = jp.ShearBuilding.of_storeys([3e5] * 4, 4e8, damping=damping)
    >>> frame.modes().damping_ratios.round(4).tolist()
    [0.02, 0.05, 0.05, 0.1]
    """

    ratios: Any = parameter(r"\zeta", words="damping ratio", least=0, within=_RATIO, each=True)

    def __post_init__(self) -> None:
        is_single = not isinstance(self.ratios, Sequence) and np.ndim(self.ratios) == 0
        ratios = (self.ratios,) if is_single else as_tuple("ratios", self.ratios)
        if not ratios:
            raise InvalidInput("ratios", "()", "must hold at least one")
        object.__setattr__(self, "ratios", ratios)
        super().__post_init__()

    def require_modes(self, n: int) -> None:
        """An ``InvalidInput`` for a number of ratios that is not that of n storeys."""
        if (count := len(self.ratios)) not in (1, n):
            rule = f"must be {n}, one for each storey above bearings, or one for all"
            raise InvalidInput(f"ratios, {count} of them,", "", rule)

    def dashpots(self, masses: Sequence[Any], stiffnesses: Sequence[Any]) -> list[tuple[Ends, Any]]:
        """Ends by floor, from 0, and material of what it is in such a building."""
        n, (frequencies, shapes) = len(masses), normal_modes(masses, stiffnesses)
        xp: Any = jnp if is_traced((self.ratios, frequencies)) else np
        moving = xp.stack(masses, -1)[..., None] * shapes
        sizes = 2 * xp.stack(self.ratios, -1) * frequencies
        matrix = (moving * sizes[..., None, :]) @ xp.swapaxes(moving, -1, -2)
        pairs = [((i, GROUND), matrix[..., i, :].sum(-1)) for i in range(n)]
        pairs += [((i, j), -matrix[..., i, j]) for i in range(n) for j in range(i)]
        return [(ends, unchecked(MatrixDashpot, coefficient=c)) for ends, c in pairs]


def normal_modes(masses: Sequence[Any], stiffnesses: Sequence[Any]) -> tuple[Any, Any]:
    """Frequencies, rising, and shapes of masses one above the other on springs, by the last axes.

    Column i of the shapes is mode i, of unit modal mass.
    """
    xp: Any = jnp if is_traced((masses, stiffnesses)) else np
    numbers = xp.stack(xp.broadcast_arrays(*masses, *stiffnesses), -1)
    m, k = numbers[..., : len(masses)], numbers[..., len(masses) :]
    above, scale = xp.concatenate([k[..., 1:], 0 * k[..., :1]], -1), 1 / xp.sqrt(m)
    main, upper = (xp.eye(len(masses), k=offset, dtype=m.dtype) for offset in (0, 1))
    diagonal = ((k + above) * scale**2)[..., None] * main
    coupling = (-above * scale * xp.roll(scale, -1, -1))[..., None] * upper
    squares, vectors = xp.linalg.eigh(diagonal + coupling + xp.swapaxes(coupling, -1, -2))
    least = float(xp.finfo(squares.dtype).eps) * squares[..., -1:]  # what rounding leaves of it
    return xp.sqrt(xp.where(squares > least, squares, least)), scale[..., None] * vectors
