"""The mean annual rate of pounding, and the intensities from which it comes."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from jaxtyping import ArrayLike
from scipy.special import ndtri

from jaxpound._checks import Rule, count, enforce, number, positive, real
from jaxpound._tables import Shown, Table
from jaxpound.study.statistics import Estimate


class ByIntensity(Protocol):
    """A rate by bands of intensity."""

    @property
    def measure(self) -> str:
        """Name of the intensity, with its unit."""

    def edges(self, bands: int) -> np.ndarray:
        """Edges of so many bands of one ratio that hold nearly all of the rate."""

    def parts(self, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The rate from each band between edges, and its coefficient of variation."""


Source = Callable[[str, Any], ByIntensity]
"""Of an owner, for messages, and the intensity that ``AnnualRate.deaggregation`` is given."""

LEFT_OUT = 1e-3
"""Share of the rate beyond either end of a deaggregation's own bands."""

_NO_END = 300.0  # of the logarithm of an interval's half width
_TOLD = 0.01  # share of the rate from beyond the hazard curve that a table tells


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class AnnualRate(Shown):
    """Mean annual rate λ of pounding; ``HazardCurve.annual_rate_of`` makes it.

    The interval and the coefficient of variation are those of the fragility, or of the estimate of
    the probability in an earthquake; the hazard curve is taken as known.
    """

    value: float
    """λ, per year."""
    low: float
    high: float
    confidence: float
    cov: float
    """Coefficient of variation of λ; NaN if the estimate that it follows from has no interval."""
    below: float = 0.0
    """The part of λ from intensities below the hazard curve, by its first piece continued."""
    above: float = 0.0
    """The part of λ from intensities above the hazard curve, by its last piece continued."""
    bounds: tuple[float, float] = (float("nan"), float("nan"))
    """What λ lies between whatever the hazard is beyond the curve's ends, unless the curve is
    steeper below its first point than in its first piece; NaN for an estimate."""
    ends: tuple[float, float] = (float("nan"), float("nan"))
    """The curve's lowest and highest intensity."""
    measure: str = "im"
    """Name of the measure of intensity, with its unit."""
    warnings: tuple[str, ...] = ()
    """Of a rare event: why not to trust its probability, in sentences."""
    _source: Source | None = None

    @staticmethod
    def of_fragility(value: float, variance: float, confidence: float, **more: Any) -> AnnualRate:
        """Of an integral and its variance to first order; ln λ is taken as normal.

        Where the c.o.v. is so large that the interval has no end, there is none.
        """
        cov = variance**0.5 / value if value else float("nan")
        reach = float(ndtri((1 + confidence) / 2)) * cov
        factor = float(np.exp(reach)) if reach < _NO_END else float("nan")
        return AnnualRate(value, value / factor, value * factor, confidence, cov, **more)

    @staticmethod
    def of_estimate(
        rate: float, estimate: Estimate, cov: float | None = None, **more: Any
    ) -> AnnualRate:
        """Of the rate of earthquakes and the probability of pounding in one.

        Without its c.o.v. that of a lognormal law with this interval is told.
        """
        value, low, high, confidence = estimate
        if cov is None:
            z, cov = ndtri((1 + confidence) / 2), float("nan")
            if 0 < low < high < np.inf:
                cov = float(np.log(high / low) / (2 * z))
        return AnnualRate(rate * value, rate * low, rate * high, confidence, cov, **more)

    @property
    def return_period(self) -> float:
        """Mean time between earthquakes with pounding, 1 / λ, in years."""
        return 1 / self.value if self.value else float("inf")

    def probability(self, years: float) -> Estimate:
        """Probability of pounding within years, 1 − e^(−λ years), with its interval.

        Earthquakes with pounding are a Poisson process.

        Raises
        ------
        ValueError
            If years is not one positive number.
        """
        owner = "AnnualRate.probability"
        (years,) = positive(owner, years=number(owner, "years", years))
        rates = (self.value, self.low, self.high)
        value, low, high = (float(-np.expm1(-rate * years)) for rate in rates)
        return Estimate(value, low, high, self.confidence)

    def deaggregation(
        self,
        edges: ArrayLike | None = None,
        *,
        bands: int = 20,
        intensity: str | ArrayLike | None = None,
    ) -> Deaggregation:
        """From which intensities the rate comes.

        Parameters
        ----------
        edges
            Edges of the bands, shape (n,), rising, ≥ 0; ∞ is allowed. By default bands of one ratio
            that hold all but 0.1 % of the rate at either end; of samples, all that pound.
        bands
            Number of bands, if there are no edges.
        intensity
            Of a study: a column (by default "pga"), a parameter that its scenarios draw, or a
            number for each sample, shape (n,). Of a ``RareEvent``: a parameter or a number for each
            sample. None for a fragility, which has its own.

        Raises
        ------
        ValueError
            If edges or intensity are not so, or bands is not a positive whole number; if the rate
            is 0, or that of an estimate alone, which does not tell the intensities.
        """
        owner = "AnnualRate.deaggregation"
        n = count(owner, "bands", bands)
        if self._source is None:
            rule = "of a fragility, a study or a rare event, not of an estimate"
            raise ValueError(f"{owner}: the rate must be {rule}")
        if not self.value > 0:
            raise ValueError(f"{owner}: the rate, {self.value:g} a year, must be positive")
        by = self._source(owner, intensity)
        at = by.edges(n) if edges is None else np.asarray(real(owner, "edges", edges), float)
        if at.ndim != 1 or at.size < 2:
            raise ValueError(f"{owner}: edges of shape {at.shape} must be (n,), n ≥ 2")
        rises = np.r_[at[0] >= 0, np.diff(at) > 0]
        enforce(owner, [Rule("edges", at, rises, "at least 0 and larger than the one before")])
        rate, cov = by.parts(at)
        return Deaggregation(at, rate, self.value, by.measure, cov)

    def _tables(self, years: float = 50.0) -> list[Table]:
        rows = [
            ("annual rate", str(Estimate(self.value, self.low, self.high, self.confidence))),
            ("return period", f"{self.return_period:,.4g} years"),
            (f"probability in {years:g} years", str(self.probability(years))),
        ]
        notes = [] if np.isnan(self.cov) else [f"c.o.v. of the rate {100 * self.cov:.3g} %"]
        if self.below + self.above > _TOLD * self.value:
            shares = [100 * x / self.value for x in (self.below, self.above)]
            low, high = (f"{bound:.4g}" for bound in self.bounds)
            told = f"it lies between {low} and {high}"
            if low == high:
                told = f"whatever it is there, the rate is {low}"
            notes += [
                f"{shares[0]:.3g} % of it from {self.measure} below {self.ends[0]:.4g}, "
                f"{shares[1]:.3g} % from above {self.ends[1]:.4g},",
                f"where the hazard curve is continued: {told}",
            ]
        return [Table("Mean annual rate of pounding", (), rows, [*notes, *self.warnings])]


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Deaggregation(Shown):
    """The mean annual rate of pounding by bands of intensity; ``AnnualRate.deaggregation``."""

    edges: np.ndarray
    """Edges of the bands, shape (n,)."""
    rate: np.ndarray
    """Annual rate of pounding in earthquakes of each band, shape (n − 1,)."""
    total: float
    """The annual rate over all intensities."""
    measure: str
    """Name of the measure of intensity, with its unit."""
    cov: np.ndarray
    """Coefficient of variation of the rate of each band, shape (n − 1,); NaN where not known."""

    @property
    def share(self) -> np.ndarray:
        """Share of the total rate of each band."""
        return self.rate / self.total

    @property
    def mean(self) -> float:
        """Geometric mean of the intensity at pounding, of the bands that end neither at 0 nor ∞.

        NaN if there is no pounding in such bands.
        """
        good = (self.edges[:-1] > 0) & np.isfinite(self.edges[1:]) & (self.rate > 0)
        if not good.any():
            return float("nan")
        centre = np.log(self.edges[:-1][good] * self.edges[1:][good]) / 2
        return float(np.exp(np.average(centre, weights=self.rate[good])))

    def _tables(self) -> list[Table]:
        told = [f"{100 * cov:.3g} %" if np.isfinite(cov) else "-" for cov in self.cov]
        rows = [
            (f"{low:.4g}", f"{high:.4g}", rate, f"{100 * share:.3g} %", cov)
            for low, high, rate, share, cov in zip(
                self.edges[:-1], self.edges[1:], self.rate, self.share, told, strict=True
            )
        ]
        rest = 1 - float(self.share.sum())
        notes = [f"outside these bands {100 * rest:.2g} %"] if rest > LEFT_OUT / 10 else []
        columns = (f"{self.measure} from", "to", "annual rate", "share", "c.o.v. of the rate")
        return [Table("Pounding by intensity", columns, rows, notes, digits=4)]
