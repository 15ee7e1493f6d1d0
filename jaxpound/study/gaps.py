"""Gaps that buildings need, as a study answers: link by link, and beside those of code rules."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

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
