"""Gaps that buildings need, as a study answers: link by link, and beside those of code rules."""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import numpy as np

from jaxpound._checks import instance, not_negative, number, positive
from jaxpound._tables import Shown, Table
from jaxpound.quantities import unit
from jaxpound.study.statistics import Estimate


@dataclasses.dataclass(frozen=True, repr=False)
class RequiredGaps(Shown):
    """The gap that each link requires at a probability of pounding; ``Study.required_gaps``."""

    probability: float
    """The probability of pounding at the link."""
    gaps: dict[int, Estimate]
    """By number of the link, from 0 as in ``links``; those whose required gap can be told."""
    places: tuple[str, ...]
    """Where every link is, in words."""
    si: bool
    """Whether the gaps are in m."""

    def _tables(self) -> list[Table]:
        of = unit("length", self.si)
        return [
            Table(
                f"Required gap at a probability of pounding of {self.probability:.4g}",
                ("link", "between", f"gap ({of})", f"from ({of})", f"to ({of})"),
                [(str(k + 1), self.places[k], *gap[:3]) for k, gap in self.gaps.items()],
                digits=4,
            )
        ]


class Separation(NamedTuple):
    """The required gap at a probability of exceedance, beside those of code rules.

    The rules combine the two peak displacements u1, u2 that are exceeded with that probability.
    """

    required_gap: Estimate
    absolute_sum: float
    """u1 + u2."""
    srss: float
    """√(u1² + u2²)."""
    double_difference: float
    """√(u1² + u2² − 2 ρ u1 u2), with the correlation coefficient ρ of the two oscillators."""
    correlation: float
    """ρ for the median structures without damper (``double_difference_correlation``)."""

    def _table(self) -> Table:
        rules = (self.absolute_sum, self.srss, self.double_difference)
        names = ("absolute sum", "SRSS", "double difference")
        return Table(
            "Separation",
            (),
            [
                ("required gap", str(self.required_gap)),
                *((name, f"{x:.4g}") for name, x in zip(names, rules, strict=True)),
            ],
            [f"double difference with a correlation of {self.correlation:.3g}"],
        )

    def __repr__(self) -> str:
        return self._table().text()

    def _repr_html_(self) -> str:
        return self._table().html()


def srss(displacement_1: Any, displacement_2: Any) -> Any:
    """√(u1² + u2²), the square root of the sum of the squares."""
    return (displacement_1**2 + displacement_2**2) ** 0.5


def en_1998_gap(displacement_1: Any, displacement_2: Any, *, level_floors: bool = False) -> Any:
    """The gap that EN 1998-1:2004 asks for between buildings of one property.

    Clause 4.4.2.7(2)b: √(d_s1² + d_s2²), at each level at which the buildings may touch; by (3),
    0.7 of it where their floors are at the same heights. Towards a neighbour's land, (2)a, each
    building keeps its own d_s away from the line.

    Parameters
    ----------
    displacement_1, displacement_2
        d_s1, d_s2 ≥ 0, largest horizontal displacements of the buildings at the level, of any
        shape, in any unit: peaks of runs under the design earthquake, or q_d d_e of a linear
        analysis with behaviour factor (4.23).
    level_floors
        Whether all floors of the two buildings are at the same heights.

    Returns
    -------
    The gap, of the displacements' shape and in their unit.

    Raises
    ------
    ValueError
        If a known displacement is negative or not finite, or level_floors is not a truth value.

    Examples
    --------
    >>> jp.en_1998_gap(0.12, 0.05)  # m
    0.13
    >>> round(jp.en_1998_gap(0.12, 0.05, level_floors=True), 4)
    0.091
    """
    owner = "en_1998_gap"
    instance(owner, "level_floors", level_floors, bool, np.bool_)
    pair = {"displacement_1": displacement_1, "displacement_2": displacement_2}
    return (0.7 if level_floors else 1.0) * srss(*not_negative(owner, **pair))


def asce_7_gap(
    displacement_1: Any,
    displacement_2: Any,
    *,
    amplification: float | tuple[float, float],
    importance: float | tuple[float, float] = 1.0,
) -> Any:
    """The gap that ASCE/SEI 7-16 asks for between structures on one property.

    Section 12.12.3: δ_MT = √(δ_M1² + δ_M2²), with δ_M = C_d δ_max / I_e of each. From the property
    line each structure keeps at least its own δ_M.

    Parameters
    ----------
    displacement_1, displacement_2
        δ_max ≥ 0, largest elastic displacements of the structures at the critical place, under the
        design forces, which are reduced by R; of any shape, in any unit.
    amplification
        C_d > 0, deflection amplification factor (table 12.2-1): of both, or of each. 1 for peaks of
        runs under the unreduced earthquake.
    importance
        I_e > 0, importance factor: of both, or of each. 1 for such runs.

    Returns
    -------
    The gap, of the displacements' shape and in their unit.

    Raises
    ------
    ValueError
        If a known displacement is negative or not finite, or a factor is neither a positive number
        nor two of them.

    Examples
    --------
    >>> round(jp.asce_7_gap(0.02, 0.015, amplification=(5.5, 4.0)), 4)  # m
    0.1253
    >>> round(jp.asce_7_gap(0.02, 0.015, amplification=5.0, importance=1.25), 4)
    0.1
    """
    owner = "asce_7_gap"
    pair = {"displacement_1": displacement_1, "displacement_2": displacement_2}
    first, second = not_negative(owner, **pair)
    c_d = _of_each(owner, "amplification", amplification)
    i_e = _of_each(owner, "importance", importance)
    return srss(c_d[0] * first / i_e[0], c_d[1] * second / i_e[1])


def _of_each(owner: str, name: str, factor: Any) -> tuple[float, float]:
    """A factor of both structures, or of each, as two positive numbers."""
    both = factor if isinstance(factor, tuple | list) else (factor, factor)
    if len(both) != 2:
        raise ValueError(f"{owner}: {name} = {factor!r} must be one number or one for each of two")
    first, second = (positive(owner, **{name: number(owner, name, x)})[0] for x in both)
    return float(first), float(second)


def double_difference_correlation(
    period_1: float, damping_1: float, period_2: float, damping_2: float
) -> float:
    """Correlation coefficient ρ of the double difference combination.

    That of the stationary responses of two oscillators to white noise (Der Kiureghian 1980), as
    used for the separation of buildings by Jeng, Kasai and Maison (1992): with β = T1/T2,
    ρ = 8 √(ζ1 ζ2) (ζ1 + β ζ2) β^1.5 / ((1 − β²)² + 4 ζ1 ζ2 β (1 + β²) + 4 (ζ1² + ζ2²) β²).
    """
    b, z1, z2 = period_1 / period_2, damping_1, damping_2
    above = 8 * (z1 * z2) ** 0.5 * (z1 + b * z2) * b**1.5
    below = (1 - b**2) ** 2 + 4 * z1 * z2 * b * (1 + b**2) + 4 * (z1**2 + z2**2) * b**2
    return above / below if below else 1.0  # equal and undamped
