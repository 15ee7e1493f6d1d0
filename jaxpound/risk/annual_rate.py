"""The mean annual rate of pounding, and the intensities from which it comes."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import ArrayLike
from scipy.special import ndtri

from jaxpound._checks import Rule, count, enforce, positive
from jaxpound._tables import Shown, Table
from jaxpound.study.statistics import Estimate

Deaggregate = Callable[[np.ndarray], np.ndarray]

_LEFT_OUT = 1e-3  # share of the rate beyond either end of a deaggregation's own bands
_TOLD = 0.01  # share of the rate from beyond the hazard curve that a table tells


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class AnnualRate(Shown):
    """Mean annual rate λ of pounding; ``HazardCurve.annual_rate_of`` makes it.

    The interval and the coefficient of variation are those of the fragility or of the estimate of
    the probability; the hazard curve is taken as known.
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
    _deaggregate: Deaggregate | None = None

    @staticmethod
    def of_fragility(value: float, variance: float, confidence: float, **more: Any) -> AnnualRate:
        """Of an integral and its variance to first order; ln λ is taken as normal."""
        cov = variance**0.5 / value if value else float("nan")
        factor = float(np.exp(ndtri((1 + confidence) / 2) * cov))
        deaggregate = more.pop("deaggregate")
        return AnnualRate(
            value, value / factor, value * factor, confidence, cov, _deaggregate=deaggregate, **more
        )

    @staticmethod
    def of_estimate(rate: float, estimate: Estimate) -> AnnualRate:
        """Of the rate of earthquakes and the probability of pounding in one."""
        value, low, high, confidence = estimate
        z, cov = ndtri((1 + confidence) / 2), float("nan")
        if 0 < low < high < np.inf:
            cov = float(np.log(high / low) / (2 * z))
        return AnnualRate(rate * value, rate * low, rate * high, confidence, cov)

    @property
    def return_period(self) -> float:
        """Mean time between earthquakes with pounding, 1 / λ, in years."""
        return 1 / self.value if self.value else float("inf")

    def probability(self, years: float) -> Estimate:
        """Probability of pounding within years, 1 − e^(−λ years), with its interval.

        Earthquakes with pounding are a Poisson process.
        """
        (years,) = positive("AnnualRate.probability", years=years)
        rates = (self.value, self.low, self.high)
        value, low, high = (float(-np.expm1(-rate * years)) for rate in rates)
        return Estimate(value, low, high, self.confidence)

    def deaggregation(self, edges: ArrayLike | None = None, *, bands: int = 20) -> Deaggregation:
        """From which intensities the rate comes.

        Parameters
        ----------
        edges
            Edges of the bands of intensity, shape (n,), rising, ≥ 0; ∞ is allowed. By default bands
            of one ratio that hold all but 0.1 % of the rate at either end.
        bands
            Number of bands, if there are no edges.

        Raises
        ------
        ValueError
            If edges are not so, bands is not a positive whole number, or the rate is not of a
            fragility: an estimate does not tell the intensities.
        """
        owner = "AnnualRate.deaggregation"
        if self._deaggregate is None:
            raise ValueError(f"{owner}: the rate must be of a fragility, not of an estimate")
        at = (
            self._bands(count(owner, "bands", bands)) if edges is None else np.asarray(edges, float)
        )
        if at.ndim != 1 or at.size < 2:
            raise ValueError(f"{owner}: edges of shape {at.shape} must be (n,), n ≥ 2")
        rises = np.r_[at[0] >= 0, np.diff(at) > 0]
        enforce(owner, [Rule("edges", at, rises, "at least 0 and larger than the one before")])
        return Deaggregation(at, self._deaggregate(at), self.value, self.measure)

    def _bands(self, n: int) -> np.ndarray:
        assert self._deaggregate is not None
        low, high = self.ends
        fine = np.r_[0.0, np.geomspace(low / 1e3, high * 1e3, 2000), np.inf]
        share = np.cumsum(self._deaggregate(fine)) / self.value
        first, last = np.searchsorted(share, [_LEFT_OUT, 1 - _LEFT_OUT])
        return np.geomspace(fine[max(first, 1)], fine[min(last + 1, fine.size - 2)], n + 1)

    def _tables(self, years: float = 50.0) -> list[Table]:
        told = Estimate(self.value, self.low, self.high, self.confidence)
        rows = [
            ("annual rate", str(told)),
            ("return period", f"{self.return_period:,.4g} years"),
            (f"probability in {years:g} years", str(self.probability(years))),
        ]
        notes = [] if np.isnan(self.cov) else [f"c.o.v. of the rate {100 * self.cov:.3g} %"]
        if self.below + self.above > _TOLD * self.value:
            shares = [100 * x / self.value for x in (self.below, self.above)]
            notes += [
                f"{shares[0]:.3g} % of it from {self.measure} below {self.ends[0]:.4g}, "
                f"{shares[1]:.3g} % from above {self.ends[1]:.4g},",
                "where the hazard curve is continued: it lies between "
                f"{self.bounds[0]:.4g} and {self.bounds[1]:.4g}",
            ]
        return [Table("Mean annual rate of pounding", (), rows, notes)]


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

    @property
    def share(self) -> np.ndarray:
        """Share of the total rate of each band."""
        return self.rate / self.total

    @property
    def mean(self) -> float:
        """Geometric mean of the intensity at pounding, of the bands that are neither 0 nor ∞."""
        good = (self.edges[:-1] > 0) & np.isfinite(self.edges[1:])
        centre = np.log(self.edges[:-1][good] * self.edges[1:][good]) / 2
        return float(np.exp(np.average(centre, weights=self.rate[good])))

    def _tables(self) -> list[Table]:
        rows = [
            (f"{low:.4g}", f"{high:.4g}", rate, f"{100 * share:.3g} %")
            for low, high, rate, share in zip(
                self.edges[:-1], self.edges[1:], self.rate, self.share, strict=True
            )
        ]
        rest = 1 - float(self.share.sum())
        notes = [f"outside these bands {100 * rest:.2g} %"] if rest > _LEFT_OUT / 10 else []
        columns = (f"{self.measure} from", "to", "annual rate", "share")
        return [Table("Pounding by intensity", columns, rows, notes, digits=4)]
