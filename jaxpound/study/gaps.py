"""Gaps that buildings need: those that a study requires, and those of code rules."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from jaxpound._checks import instance, not_negative, positive_number
from jaxpound._errors import InvalidInput
from jaxpound._tables import Shown, TextTable
from jaxpound.quantities import unit
from jaxpound.study.statistics import Estimate


@dataclasses.dataclass(frozen=True, repr=False)
class RequiredGaps(Shown):
    """The gap that each link requires at a probability of pounding; ``Study.required_gaps``."""

    probability: float
    gaps: dict[int, Estimate]
    """By number of the link, from 0; without links whose required gap is unknown."""
    places: tuple[str, ...]
    """The place of every link, in words."""
    si: bool
    """Whether the gaps are in m."""

    def _tables(self) -> list[TextTable]:
        of = unit("length", self.si)
        title = f"Required gap at a probability of pounding of {self.probability:.4g}"
        columns = ("link", "between", f"gap ({of})", f"from ({of})", f"to ({of})")
        rows = [(str(k + 1), self.places[k], *gap[:3]) for k, gap in self.gaps.items()]
        return [TextTable(title, columns, rows, digits=4)]


RULES = {"absolute_sum": "absolute sum", "srss": "SRSS", "double_difference": "double difference"}
"""Codes' rules for the gap, fields of ``Separation``, in words."""


@dataclasses.dataclass(frozen=True, repr=False)
class Separation(Shown):
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

    def _tables(self) -> list[TextTable]:
        rows = [
            ("required gap", str(self.required_gap)),
            *((words, f"{getattr(self, rule):.4g}") for rule, words in RULES.items()),
        ]
        note = f"double difference with a correlation of {self.correlation:.3g}"
        return [TextTable("Separation", (), rows, [note])]


def srss(displacement_1: Any, displacement_2: Any) -> Any:
    """√(u1² + u2²), the square root of the sum of the squares."""
    return (displacement_1**2 + displacement_2**2) ** 0.5


def en_1998_gap(displacement_1: Any, displacement_2: Any, *, level_floors: bool = False) -> Any:
    """The gap that EN 1998-1:2004 requires between buildings of one property.

    Clause 4.4.2.7(2)b: √(d_s1² + d_s2²), at each level at which the buildings may touch; by (3),
    0.7 of it where their floors are at the same heights. Towards a neighbour's land, (2)a, each
    building keeps its own d_s away from the line.

    Parameters
    ----------
    displacement_1, displacement_2
        d_s1, d_s2 ≥ 0, largest horizontal displacements of the buildings at the level, of any
        shape, in any unit, which are the gap's too: peaks of runs under the design earthquake, or
        q_d d_e of a linear analysis with behaviour factor (4.23).
    level_floors
        Whether all floors of the two buildings are at the same heights.

    Examples
    --------
    >>> jp.en_1998_gap(0.12, 0.05)  # m
    0.13
    >>> round(jp.en_1998_gap(0.12, 0.05, level_floors=True), 4)
    0.091
    """
    instance("level_floors", level_floors, bool, np.bool_)
    pair = not_negative(displacement_1=displacement_1, displacement_2=displacement_2)
    return (0.7 if level_floors else 1.0) * srss(*pair)


def asce_7_gap(
    displacement_1: Any,
    displacement_2: Any,
    *,
    amplification: float | tuple[float, float],
    importance: float | tuple[float, float] = 1.0,
) -> Any:
    """The gap that ASCE/SEI 7-16 requires between structures on one property.

    Section 12.12.3: δ_MT = √(δ_M1² + δ_M2²), with δ_M = C_d δ_max / I_e of each. From the property
    line each structure keeps at least its own δ_M.

    Parameters
    ----------
    displacement_1, displacement_2
        δ_max ≥ 0, largest elastic displacements of the structures at the critical place, under the
        design forces (reduced by R); of any shape, in any unit, which are the gap's too.
    amplification
        C_d > 0, deflection amplification factor (table 12.2-1), for both structures or for each. 1
        for peaks of runs under the unreduced earthquake.
    importance
        I_e > 0, importance factor, for both structures or for each. 1 for such runs.

    Examples
    --------
    >>> round(jp.asce_7_gap(0.02, 0.015, amplification=(5.5, 4.0)), 4)  # m
    0.1253
    >>> round(jp.asce_7_gap(0.02, 0.015, amplification=5.0, importance=1.25), 4)
    0.1
    """
    pair = not_negative(displacement_1=displacement_1, displacement_2=displacement_2)
    c_d = _of_each("amplification", amplification)
    i_e = _of_each("importance", importance)
    return srss(*(c * x / i for c, x, i in zip(c_d, pair, i_e, strict=True)))


def _of_each(name: str, factor: Any) -> tuple[float, float]:
    """A factor of both structures or of each, as two positive numbers."""
    both = factor if isinstance(factor, tuple | list) else (factor, factor)
    if len(both) != 2:
        raise InvalidInput(name, repr(factor), "must be one number or one for each of two")
    first, second = (positive_number(**{name: x})[0] for x in both)
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
