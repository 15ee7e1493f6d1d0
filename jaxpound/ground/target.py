"""Target spectra, those of codes included, and how records are scaled to them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import ArrayLike

from jaxpound._checks import Rule, enforce, number, positive, positive_number, real, require_one_of
from jaxpound._errors import InvalidInput
from jaxpound._fields import check, parameter, part
from jaxpound._tables import Shown, TextTable
from jaxpound.ground.intensity import damping_rule

if TYPE_CHECKING:
    from jaxpound.ground.suite import RecordSuite


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
    >>> jp.ground.PeriodRange.asce_7(0.9, 0.6)
    PeriodRange(low=0.12, high=1.8)
    >>> jp.ground.PeriodRange.en_1998(1.0)
    PeriodRange(low=0.2, high=2.0)
    """

    low: float
    high: float

    @classmethod
    def asce_7(cls, *periods: float, shortest: float | None = None) -> PeriodRange:
        """That of ASCE/SEI 7-16 and 7-22, section 16.2.3.1: 0.2 T_min to 2.0 T_max.

        The mean spectrum of the scaled records must be at least 90 % of the target in this range
        (section 16.2.3.2); the standard requires at least 11 records.

        ``periods`` > 0 are the first-mode periods of the buildings in the direction of shaking,
        from T_min to T_max; ``shortest`` is the period of the last mode that is needed for 90 % of
        the mass: the range begins there if it is shorter than 0.2 T_min.
        """
        low, high = _around(periods)
        if shortest is not None:
            (least,) = positive_number(shortest=shortest)
            low = min(low, float(least))
        return cls(low, high)

    @classmethod
    def en_1998(cls, *periods: float) -> PeriodRange:
        """That of EN 1998-1:2004, clause 3.2.3.1.2(4)c: 0.2 T1 to 2 T1.

        The mean spectrum of all records, with 5 % of damping, must be at least 90 % of the elastic
        response spectrum in this range; the clause requires at least 3 records, whose mean peak
        must reach a_g S. It is written for artificial accelerograms; clause 3.2.3.1.3 applies it to
        records. ``periods`` are the fundamental periods T1 > 0 of the buildings in the direction of
        shaking: the range covers that of each.
        """
        return cls(*_around(periods))

    @classmethod
    def of(cls, value: Any) -> PeriodRange:
        """A pair of numbers as a range; an ``InvalidInput`` for anything else."""
        low, high = positive_pair("periods", value, "a range")
        enforce([Rule("periods", high, high > low, f"above the lower end, {low:g}")])
        return cls(low, high)


def positive_pair(name: str, value: Any, kind: str) -> tuple[float, float]:
    """Two positive numbers; an ``InvalidInput`` for anything else."""
    if np.shape(value) != (2,):
        raise InvalidInput(name, repr(value), f"must be {kind} (low, high)")
    low, high = positive(**{f"{name}[{i}]": x for i, x in enumerate(value)})
    return float(low), float(high)


def _around(periods: Sequence[float]) -> tuple[float, float]:
    """0.2 times the shortest of periods, and twice the longest."""
    if not periods:
        raise InvalidInput("periods", "()", "must hold at least one period")
    (valid,) = positive(periods=list(periods))
    return 0.2 * float(np.min(valid)), 2.0 * float(np.max(valid))


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class TargetSpectrum(Shown):
    """A target spectrum, given by its ordinates.

    Between ordinates it is linear in the logarithms, as plateaus and branches in 1/T of codes'
    spectra are; from a period of 0 to the next one it is linear.

    Parameters
    ----------
    periods, accelerations
        Natural periods ≥ 0, rising, in the unit of time of the records, and spectral acceleration
        > 0 at each, g, both of shape (m,), m ≥ 2.
    damping, name
        Damping ratio of the spectrum, at least 0 and below 1; a name for titles and figures.

    Examples
    --------
    >>> plateau = jp.ground.TargetSpectrum([0.0, 0.1, 0.5, 2.0], [0.4, 1.0, 1.0, 0.25], name="site")
    >>> [round(float(x), 3) for x in plateau.at([0.05, 0.3, 1.0])]
    [0.7, 1.0, 0.5]
    """

    periods: Any = parameter(least=0)
    accelerations: Any = parameter(above=0)
    damping: float = parameter(least=0, below=1, single=True, default=0.05)
    name: str = part(str, default="")

    def __post_init__(self) -> None:
        check(self)
        arrays = self.periods, self.accelerations
        periods, accelerations = (np.asarray(x, float) for x in arrays)
        if periods.ndim != 1 or periods.size < 2 or accelerations.shape != periods.shape:
            shapes = f"periods {periods.shape} and accelerations {accelerations.shape}"
            raise InvalidInput(shapes, "", "must be of one shape, (m,) with m ≥ 2")
        enforce([Rule("periods", periods, np.diff(periods, prepend=-1.0) > 0, "rising")])
        numbers = {"periods": periods, "accelerations": accelerations}
        vars(self).update(numbers, damping=float(self.damping))

    @classmethod
    def en_1998(
        cls, acceleration: float, ground: str, *, kind: int = 1, damping: float = 0.05
    ) -> TargetSpectrum:
        """Horizontal elastic response spectrum of EN 1998-1:2004, clause 3.2.2.2, up to 4 s.

        With the recommended values of soil factor S and periods T_B, T_C, T_D (tables 3.2 and 3.3).
        The correction of damping is η = √(10 / (5 + ξ)) ≥ 0.55, with ξ in percent (3.6).

        ``acceleration`` is a_g > 0, the design ground acceleration on ground of type A, γ_I a_gR,
        in g; ``ground`` the type of ground (table 3.1), "A", "B", "C", "D" or "E"; ``kind`` 1, or 2
        for hazards whose magnitude M_s is 5.5 at most; ``damping`` is ξ, at least 0 and below 1.

        Examples
        --------
        >>> target = jp.ground.TargetSpectrum.en_1998(0.25, "C")
        >>> [round(float(x), 4) for x in target.at([0.0, 0.2, 0.6, 1.2, 4.0])]
        [0.2875, 0.7188, 0.7188, 0.3594, 0.0539]
        """
        (a_g,) = positive_number(acceleration=acceleration)
        require_one_of(ground, _SOILS, "ground")
        if kind not in (1, 2):
            raise InvalidInput("kind", repr(kind), "must be 1 or 2")
        damping = float(number("damping", damping))
        enforce([damping_rule(damping)])
        percent = 100 * damping
        soil, t_b, t_c, t_d = _SOILS[ground][kind - 1]
        top, last = 2.5 * max(math.sqrt(10 / (5 + percent)), 0.55), 4.0
        shares = [1.0, top, top, top * t_c / t_d, top * t_c * t_d / last**2]
        name = f"EN 1998-1 type {kind}, ground {ground}"
        accelerations = float(a_g) * soil * np.array(shares)
        return cls([0.0, t_b, t_c, t_d, last], accelerations, percent / 100, name)

    @classmethod
    def asce_7(cls, s_ds: float, s_d1: float, t_l: float) -> TargetSpectrum:
        """Design response spectrum of ASCE/SEI 7-16, section 11.4.6, up to 2 T_L.

        It is also the two-period spectrum of ASCE/SEI 7-22, section 11.4.5.2. With S_MS = 1.5 S_DS
        and S_M1 = 1.5 S_D1 it is that of the risk-targeted maximum considered earthquake (7-16,
        section 11.4.7), to which chapter 16 scales records.

        ``s_ds`` and ``s_d1`` are S_DS, S_D1 > 0, the design spectral accelerations at short periods
        and at 1 s, in g; ``t_l`` is T_L, the long-period transition period in s, above S_D1 / S_DS.

        Examples
        --------
        >>> target = jp.ground.TargetSpectrum.asce_7(s_ds=1.0, s_d1=0.6, t_l=8.0)
        >>> [round(float(x), 4) for x in target.at([0.0, 0.06, 0.12, 0.6, 1.0, 8.0])]
        [0.4, 0.7, 1.0, 1.0, 0.6, 0.075]
        """
        short, second, long = map(float, positive_number(s_ds=s_ds, s_d1=s_d1, t_l=t_l))
        t_s = second / short
        enforce([Rule("t_l", t_l, long > t_s, f"above s_d1 / s_ds = {t_s:.4g} s")])
        accelerations = np.array([0.4 * short, short, short, second / long, second / long / 4])
        return cls([0.0, 0.2 * t_s, t_s, long, 2 * long], accelerations, name="ASCE 7")

    def at(self, periods: ArrayLike) -> np.ndarray:
        """Spectral acceleration at natural periods, g, of their shape; a ``ValueError`` outside."""
        at = np.asarray(real("periods", periods), float)
        low, high = self.periods[0], self.periods[-1]
        # The end of a range may differ from that of the target by rounding.
        inside = (at >= low * (1 - 1e-9)) & (at <= high * (1 + 1e-9))
        rule = f"within those of the target{self.named()}, {low:g} to {high:g}"
        enforce([Rule("periods", at, inside, rule)])
        first = int(low == 0)
        x, y = np.log(self.periods[first:]), np.log(self.accelerations[first:])
        with np.errstate(divide="ignore"):
            accelerations = np.exp(np.interp(np.log(at), x, y))
        if first:
            line = np.interp(at, self.periods[:2], self.accelerations[:2])
            accelerations = np.where(at < self.periods[1], line, accelerations)
        return np.asarray(accelerations)

    def named(self) -> str:
        """The name behind a blank, as titles and messages have it; empty without one."""
        return f" {self.name!r}" if self.name else ""

    def _tables(self) -> list[TextTable]:
        rows = [("", t, a) for t, a in zip(self.periods, self.accelerations, strict=True)]
        title = f"Target spectrum{self.named()}, {100 * self.damping:.3g} % of damping"
        return [TextTable(title, ("", "period", "acceleration (g)"), rows, digits=4)]


def fitted_factors(
    ratios: np.ndarray, bounds: tuple[float, float], best: int | None, least: float | None
) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the records to keep, and the factor of each.

    ``ratios`` are those of the target to each record's spectrum, shape (n, m).
    """
    low, high = bounds
    enforce([Rule("factors", high, high >= low, f"at least the lower bound, {low:g}")])
    # Σ (ln factor − ln ratio)² is least at the vertex of a parabola or the nearest bound.
    factors = np.clip(np.exp(np.log(ratios).mean(axis=1)), low, high)
    selected = np.arange(len(ratios))
    if best is not None:
        errors = _misfit(np.log(factors[:, None] / ratios))
        selected = np.sort(np.argsort(errors, kind="stable")[:best])
    ratios, factors = ratios[selected], factors[selected]
    if least is None:
        return selected, factors
    from scipy.optimize import brentq

    def shortfall(common: float) -> float:  # of all factors times one
        mean = np.mean(np.minimum(common * factors, high)[:, None] / ratios, axis=0)
        return float(mean.min() - least)

    common, most = 1.0, high / factors.min()
    if shortfall(common) < 0:  # the smallest that reaches ``least``
        if (reached := shortfall(most)) < 0:
            largest = f"{reached + least:.4g}, which factors of {high:g} reach"
            raise InvalidInput("least", f"{least:g}", f"must be at most {largest}")
        common = brentq(shortfall, 1.0, most, xtol=1e-13, rtol=1e-13)
    return selected, np.minimum(common * factors, high)


def _misfit(logarithms: Any) -> Any:
    """Root mean square of the logarithm of a ratio, over the last axis."""
    return np.sqrt(np.mean(logarithms**2, axis=-1))


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class ScaledSuite(Shown):
    """Records scaled to a target spectrum; ``RecordSuite.scaled_to`` makes it."""

    suite: RecordSuite
    """The scaled records."""
    factors: np.ndarray
    """Factor of each record, shape (n,)."""
    target: TargetSpectrum
    range: PeriodRange
    """The range of periods of the fit."""
    periods: np.ndarray
    """Periods of the comparison, evenly spaced in the logarithm, shape (m,)."""
    accelerations: np.ndarray
    """Spectral acceleration of each scaled record at these periods, g, shape (n, m)."""
    bounds: tuple[float, float]
    """Bounds of the factors, low and high."""

    @property
    def mean(self) -> np.ndarray:
        """Arithmetic mean of the scaled records' spectra, as in the codes, g, shape (m,)."""
        return np.asarray(self.accelerations.mean(axis=0))

    @property
    def misfits(self) -> np.ndarray:
        """Root mean square of ln(record / target) over the periods, of each record, shape (n,)."""
        return _misfit(np.log(self.accelerations / self.target.at(self.periods)))

    @property
    def misfit(self) -> float:
        """Root mean square of ln(mean spectrum / target) over the periods."""
        return float(_misfit(np.log(self.mean / self.target.at(self.periods))))

    @property
    def least_ratio(self) -> float:
        """Smallest ratio of the mean spectrum to the target; codes require at least 0.9."""
        return float((self.mean / self.target.at(self.periods)).min())

    @property
    def at_bound(self) -> tuple[str, ...]:
        """Names of the records whose factor is a bound."""
        low, high = self.bounds
        is_at = (self.factors <= low * (1 + 1e-12)) | (self.factors >= high * (1 - 1e-12))
        return tuple(np.array(self.suite.names)[is_at].tolist())

    def findings(self) -> list[str]:
        """A sentence on the factors that are bounds; none if all are within."""
        if not self.at_bound:
            return []
        listed, (low, high) = ", ".join(self.at_bound), self.bounds
        return [f"factors of {listed} are at a bound, {low:g} or {high:g}: they fit less well"]

    def _tables(self) -> list[TextTable]:
        low, high = self.range
        notes_at = ["at a bound" if name in self.at_bound else "" for name in self.suite.names]
        rows = [*zip(self.suite.names, self.factors, self.misfits, notes_at, strict=True)]
        misfit = f"root mean square of ln(spectrum / target), periods {low:.4g} to {high:.4g}"
        mean = f"misfit {self.misfit:.4g}, at least {self.least_ratio:.4g} of the target"
        notes = [f"misfit: {misfit}", f"mean of the suite: {mean}", *self.findings()]
        title = f"Scaled to the target spectrum{self.target.named()}"
        return [TextTable(title, ("record", "factor", "misfit", ""), rows, notes, digits=4)]
