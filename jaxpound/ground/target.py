"""Target spectra, of codes too, and the ranges of periods in which records are to meet them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import ArrayLike

from jaxpound._checks import Rule, enforce, number, positive, real
from jaxpound._tables import Shown, Table

_SOILS = {  # S, T_B, T_C, T_D of spectra of type 1 and 2
    "A": ((1.0, 0.15, 0.4, 2.0), (1.0, 0.05, 0.25, 1.2)),
    "B": ((1.2, 0.15, 0.5, 2.0), (1.35, 0.05, 0.25, 1.2)),
    "C": ((1.15, 0.2, 0.6, 2.0), (1.5, 0.1, 0.25, 1.2)),
    "D": ((1.35, 0.2, 0.8, 2.0), (1.8, 0.1, 0.3, 1.2)),
    "E": ((1.4, 0.15, 0.5, 2.0), (1.6, 0.05, 0.25, 1.2)),
}


class PeriodRange(NamedTuple):
    """A range of natural periods, in the unit of time of the records.

    Examples
    --------
    >>> jp.PeriodRange.asce_7(0.9, 0.6)
    PeriodRange(low=0.12, high=1.8)
    >>> jp.PeriodRange.en_1998(1.0)
    PeriodRange(low=0.2, high=2.0)
    """

    low: float
    high: float

    @classmethod
    def asce_7(cls, *periods: float, shortest: float | None = None) -> PeriodRange:
        """That of ASCE/SEI 7-16 and 7-22, section 16.2.3.1: 0.2 T_min to 2.0 T_max.

        The mean spectrum of the scaled records must not fall below 90 % of the target there
        (section 16.2.3.2); the standard asks for at least 11 records.

        Parameters
        ----------
        periods
            First-mode periods > 0 of the buildings, each in the direction of shaking; T_min is the
            shortest and T_max the longest.
        shortest
            Period of the last mode that is needed for 90 % of the mass, if it is shorter than
            0.2 T_min: the range begins there.

        Raises
        ------
        ValueError
            If there is no period, or one is not positive and finite.
        """
        low, high = _ends("PeriodRange.asce_7", periods)
        if shortest is not None:
            owner = "PeriodRange.asce_7"
            (least,) = positive(owner, shortest=number(owner, "shortest", shortest))
            return cls(min(0.2 * low, float(least)), 2.0 * high)
        return cls(0.2 * low, 2.0 * high)

    @classmethod
    def en_1998(cls, *periods: float) -> PeriodRange:
        """That of EN 1998-1:2004, clause 3.2.3.1.2(4)c: 0.2 T1 to 2 T1.

        The mean spectrum of all records, with 5 % of damping, must not be below 90 % of the elastic
        response spectrum there; the clause asks for at least 3 records, whose mean peak must reach
        a_g S. It is written for artificial accelerograms; clause 3.2.3.1.3 applies it to recorded
        ones. For several buildings the range covers that of each.

        Parameters
        ----------
        periods
            Fundamental periods T1 > 0 of the buildings, each in the direction of shaking.

        Raises
        ------
        ValueError
            If there is no period, or one is not positive and finite.
        """
        low, high = _ends("PeriodRange.en_1998", periods)
        return cls(0.2 * low, 2.0 * high)

    @classmethod
    def of(cls, owner: str, value: Any) -> PeriodRange:
        """A pair of numbers as a range; a ``ValueError`` for anything else."""
        if np.shape(value) != (2,):
            raise ValueError(f"{owner}: periods = {value!r} must be a range (low, high)")
        low, high = positive(owner, **{f"periods[{i}]": x for i, x in enumerate(value)})
        enforce(owner, [Rule("periods", high, high > low, f"above the lower end, {low:g}")])
        return cls(float(low), float(high))


def _ends(owner: str, periods: Sequence[float]) -> tuple[float, float]:
    if not periods:
        raise ValueError(f"{owner}: periods = () must hold at least one period")
    known = np.asarray(positive(owner, periods=list(periods))[0], float)
    return float(known.min()), float(known.max())


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class TargetSpectrum(Shown):
    """A target spectrum, given by its ordinates.

    Between them it is a straight line in the logarithms, as plateaus and branches in 1/T of codes'
    spectra are; from a period of 0 to the next one it is a straight line.

    Parameters
    ----------
    periods
        Natural periods ≥ 0, rising, shape (m,), m ≥ 2, in the unit of time of the records.
    accelerations
        Spectral acceleration > 0 at each, g, shape (m,).
    damping
        Damping ratio of the spectrum, at least 0 and below 1.
    name
        For titles and figures.

    Raises
    ------
    ValueError
        If shapes differ or a value breaks its rule.

    Examples
    --------
    >>> plateau = jp.TargetSpectrum([0.0, 0.1, 0.5, 2.0], [0.4, 1.0, 1.0, 0.25], name="site")
    >>> [round(float(x), 3) for x in plateau.at([0.05, 0.3, 1.0])]
    [0.7, 1.0, 0.5]
    """

    periods: Any
    accelerations: Any
    damping: float = 0.05
    name: str = ""

    def __post_init__(self) -> None:
        owner = "TargetSpectrum"
        known = {key: real(owner, key, getattr(self, key)) for key in ("periods", "accelerations")}
        periods, accelerations = (np.asarray(x, float) for x in known.values())
        if periods.ndim != 1 or periods.size < 2 or accelerations.shape != periods.shape:
            raise ValueError(
                f"{owner}: periods {periods.shape} and accelerations {accelerations.shape} must "
                "be of one shape, (m,) with m ≥ 2"
            )
        damping = float(number(owner, "damping", self.damping))
        positive(owner, accelerations=accelerations)
        rises = np.append(True, np.diff(periods) > 0) & (periods >= 0) & np.isfinite(periods)
        enforce(
            owner,
            [
                Rule("periods", periods, rises, "finite, not negative and rising"),
                Rule("damping", damping, 0 <= damping < 1, "at least 0 and below 1"),
            ],
        )
        if not isinstance(self.name, str):
            raise ValueError(f"{owner}: name = {self.name!r} must be a string")
        object.__setattr__(self, "periods", periods)
        object.__setattr__(self, "accelerations", accelerations)
        object.__setattr__(self, "damping", damping)

    @classmethod
    def en_1998(
        cls, acceleration: float, ground: str, *, kind: int = 1, damping: float = 0.05
    ) -> TargetSpectrum:
        """Horizontal elastic response spectrum of EN 1998-1:2004, clause 3.2.2.2, up to 4 s.

        With the recommended values of soil factor S and periods T_B, T_C, T_D (tables 3.2 and 3.3).
        The correction of damping is η = √(10 / (5 + ξ)) ≥ 0.55, with ξ in percent (3.6).

        Parameters
        ----------
        acceleration
            a_g > 0, design ground acceleration on ground of type A, γ_I a_gR, g.
        ground
            Type of ground (table 3.1): "A", "B", "C", "D" or "E".
        kind
            1, or 2 for hazards whose magnitude M_s is 5.5 at most.
        damping
            Damping ratio ξ, at least 0 and below 1.

        Raises
        ------
        ValueError
            If an argument breaks its rule.

        Examples
        --------
        >>> target = jp.TargetSpectrum.en_1998(0.25, "C")
        >>> [round(float(x), 4) for x in target.at([0.0, 0.2, 0.6, 1.2, 4.0])]
        [0.2875, 0.7188, 0.7188, 0.3594, 0.0539]
        """
        owner = "TargetSpectrum.en_1998"
        (a_g,) = positive(owner, acceleration=number(owner, "acceleration", acceleration))
        if ground not in _SOILS:
            raise ValueError(f"{owner}: ground = {ground!r} must be one of {', '.join(_SOILS)}")
        if kind not in (1, 2):
            raise ValueError(f"{owner}: kind = {kind!r} must be 1 or 2")
        percent = 100 * float(number(owner, "damping", damping))
        inside = 0 <= percent < 100
        enforce(owner, [Rule("damping", damping, inside, "at least 0 and below 1")])
        soil, t_b, t_c, t_d = _SOILS[ground][kind - 1]
        top = 2.5 * max(math.sqrt(10 / (5 + percent)), 0.55)
        last = 4.0
        shares = [1.0, top, top, top * t_c / t_d, top * t_c * t_d / last**2]
        name = f"EN 1998-1 type {kind}, ground {ground}"
        accelerations = float(a_g) * soil * np.array(shares)
        return cls([0.0, t_b, t_c, t_d, last], accelerations, percent / 100, name)

    @classmethod
    def asce_7(cls, s_ds: float, s_d1: float, t_l: float) -> TargetSpectrum:
        """Design response spectrum of ASCE/SEI 7-16, section 11.4.6, up to 2 T_L.

        It is the two-period spectrum of ASCE/SEI 7-22, section 11.4.5.2, too. With S_MS and S_M1,
        which are 1.5 times S_DS and S_D1, it is that of the risk-targeted maximum considered
        earthquake (7-16, section 11.4.7), to which chapter 16 scales records.

        Parameters
        ----------
        s_ds, s_d1
            S_DS, S_D1 > 0, design spectral accelerations at short periods and at 1 s, g.
        t_l
            T_L, long-period transition period, s, above T_S = S_D1 / S_DS.

        Raises
        ------
        ValueError
            If an argument breaks its rule.

        Examples
        --------
        >>> target = jp.TargetSpectrum.asce_7(s_ds=1.0, s_d1=0.6, t_l=8.0)
        >>> [round(float(x), 4) for x in target.at([0.0, 0.06, 0.12, 0.6, 1.0, 8.0])]
        [0.4, 0.7, 1.0, 1.0, 0.6, 0.075]
        """
        owner = "TargetSpectrum.asce_7"
        given = {"s_ds": s_ds, "s_d1": s_d1, "t_l": t_l}
        known = positive(owner, **{key: number(owner, key, x) for key, x in given.items()})
        short, second, long = map(float, known)
        t_s = second / short
        enforce(owner, [Rule("t_l", t_l, long > t_s, f"above s_d1 / s_ds = {t_s:.4g} s")])
        accelerations = np.array([0.4 * short, short, short, second / long, second / long / 4])
        return cls([0.0, 0.2 * t_s, t_s, long, 2 * long], accelerations, name="ASCE 7")

    def at(self, periods: ArrayLike) -> np.ndarray:
        """Spectral acceleration at natural periods, g, of their shape.

        Raises
        ------
        ValueError
            If a period lies outside those of the target.
        """
        owner = "TargetSpectrum.at"
        at = np.asarray(real(owner, "periods", periods), float)
        low, high = self.periods[0], self.periods[-1]
        # A range may end at the target's own end but for its rounding.
        inside = (at >= low * (1 - 1e-9)) & (at <= high * (1 + 1e-9))
        rule = f"within those of the target{self._named()}, {low:g} to {high:g}"
        enforce(owner, [Rule("periods", at, inside, rule)])
        first = int(low == 0)
        x, y = np.log(self.periods[first:]), np.log(self.accelerations[first:])
        with np.errstate(divide="ignore"):
            found = np.exp(np.interp(np.log(at), x, y))
        if first:
            line = np.interp(at, self.periods[:2], self.accelerations[:2])
            found = np.where(at < self.periods[1], line, found)
        return np.asarray(found)

    def _named(self) -> str:
        return f" {self.name!r}" if self.name else ""

    def _tables(self) -> list[Table]:
        rows = [("", t, a) for t, a in zip(self.periods, self.accelerations, strict=True)]
        title = f"Target spectrum{self._named()}, {100 * self.damping:.3g} % of damping"
        return [Table(title, ("", "period", "acceleration (g)"), rows, digits=4)]
