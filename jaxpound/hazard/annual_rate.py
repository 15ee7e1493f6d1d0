"""The mean annual rate of pounding, and the intensities from which it comes."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from typing import Any

import jax
import numpy as np
from jaxtyping import ArrayLike
from scipy.optimize import brentq
from scipy.special import ndtri

from jaxpound._checks import Rule, array, count, enforce, hint, positive_number
from jaxpound._errors import InvalidInput
from jaxpound._tables import Shown, TextTable
from jaxpound.hazard.points import CurvePoints
from jaxpound.reliability.result import RareEvent
from jaxpound.scenarios.scenarios import parameter_names, parameters
from jaxpound.study.fragility import Fragility
from jaxpound.study.statistics import Estimate
from jaxpound.study.study import Study
from jaxpound.study.weighting import Hits

_LEFT_OUT = 1e-3  # share of the rate beyond either end of the default bands
_MOST_BEYOND = 0.5  # a larger share of a rate from beyond the curve's ends hints at a wrong unit
_MAX_EXPONENT = 300.0  # of the logarithm of an interval's half width
_REPORTED = 0.01  # share of the rate from beyond the hazard curve from which tables report it
_FINE = 2000  # bands in which the default bands are sought
_FAR = 1e3  # ratio beyond median and curve up to which they are sought, at least
_ENDS = (1e-300, 1e300)  # intensities within which they are sought, whatever the median
_STEP_OF_GAP = 0.05  # of ln gap, for the slope of ln rate
_WIDER = 1e-6  # of the outermost bands, so that the samples at their ends are within


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class AnnualRate(Shown):
    """Mean annual rate λ of an event, such as pounding; made by ``HazardCurve.annual_rate_of``.

    The interval and the coefficient of variation are those of the fragility, or of the estimate of
    the probability in an earthquake; the hazard curve counts as exact.
    """

    value: float
    """λ, per year."""
    low: float
    high: float
    confidence: float
    cov: float
    """Coefficient of variation of λ; NaN if the estimate that it follows from has no interval."""
    below: float = 0.0
    """Part of λ from intensities below the hazard curve, whose first piece is continued."""
    above: float = 0.0
    """Part of λ from intensities above the hazard curve, whose last piece is continued."""
    bounds: tuple[float, float] = (float("nan"), float("nan"))
    """Lower and upper bound of λ, however the hazard goes on beyond the curve's ends; the upper one
    assumes that it gets no steeper below the first point. NaN for an estimate."""
    ends: tuple[float, float] = (float("nan"), float("nan"))
    """The curve's lowest and highest intensity."""
    measure: str = "im"
    """Name of the measure of intensity, with its unit."""
    event: str = "pounding"
    """Whose rate it is, in words."""
    warnings: tuple[str, ...] = ()
    """Of a rare event: why not to trust its probability, in sentences."""
    _source: Callable[[Any], FragilityRate | SamplesRate] | None = None  # by ``intensity``

    @staticmethod
    def of_estimate(
        rate: float, estimate: Estimate, cov: float | None = None, **more: Any
    ) -> AnnualRate:
        """From the rate of earthquakes and P(pounding) in one, by default with its c.o.v."""
        value, low, high, confidence = estimate
        if cov is None:
            bounded = 0 < low < high < np.inf
            cov = np.log(high / low) / (2 * ndtri((1 + confidence) / 2)) if bounded else np.nan
        return AnnualRate(rate * value, rate * low, rate * high, confidence, float(cov), **more)

    @property
    def return_period(self) -> float:
        """Mean time between earthquakes with pounding, 1 / λ, in years."""
        return 1 / self.value if self.value else float("inf")

    def probability(self, years: float) -> Estimate:
        """Probability of pounding within years > 0, 1 − e^(−λ years), with its interval.

        Earthquakes with pounding are a Poisson process.
        """
        (years,) = positive_number(years=years)
        rates = (self.value, self.low, self.high)
        value, low, high = (float(-np.expm1(-rate * years)) for rate in rates)
        return Estimate(value, low, high, self.confidence)

    def deaggregation(
        self, bands: int | ArrayLike = 20, *, intensity: str | ArrayLike | None = None
    ) -> Deaggregation:
        """From which intensities the rate comes.

        Raises ``ValueError`` if the rate is 0, or that of an estimate alone: it has no intensities.

        Parameters
        ----------
        bands
            Number of bands, of one ratio, that hold all but 0.1 % of the rate at either end, or all
            samples that pound; or their edges, shape (n,), rising, ≥ 0; ∞ is allowed.
        intensity
            Of a study: a column (by default "pga"), a parameter that its scenarios draw, or a
            number for each sample, shape (n,). Of a ``RareEvent``: a parameter or a number for each
            sample. None for a fragility.
        """
        n = 0 if np.ndim(bands) else count("bands", bands)
        if self._source is None:
            rule = "must be of a fragility, a study or a rare event, not of an estimate"
            raise InvalidInput("the rate", "", rule)
        if not self.value > 0:
            raise InvalidInput(f"the rate, {self.value:g} a year,", "", "must be positive")
        source = self._source(intensity)
        ends = source.edges(n) if n else array("bands", bands, (-1,))
        enforce([Rule("bands: number of edges", ends.size, ends.size > 1, "2 or more")])
        rises = np.r_[ends[0] >= 0, np.diff(ends) > 0]
        enforce([Rule("bands", ends, rises, "at least 0 and larger than the one before")])
        rate, cov = source.per_band(ends)
        return Deaggregation(ends, rate, self.value, source.measure, cov, self.event)

    def _tables(self, years: float = 50.0) -> list[TextTable]:
        rows = [
            ("annual rate", str(Estimate(self.value, self.low, self.high, self.confidence))),
            ("return period", f"{self.return_period:,.4g} years"),
            (f"probability in {years:g} years", str(self.probability(years))),
        ]
        notes = [] if np.isnan(self.cov) else [f"c.o.v. of the rate {100 * self.cov:.3g} %"]
        if self.below + self.above > _REPORTED * self.value:
            low, high = (f"{bound:.4g}" for bound in self.bounds)
            between = f"it lies between {low} and {high}"
            range_ = f"whatever it is there, the rate is {low}" if low == high else between
            below, above = 100 * self.below / self.value, 100 * self.above / self.value
            weaker = f"{below:.3g} % of it from {self.measure} below {self.ends[0]:.4g}"
            notes.append(f"{weaker}, {above:.3g} % from above {self.ends[1]:.4g},")
            notes.append(f"where the hazard curve is continued: {range_}")
        return [TextTable(f"Mean annual rate of {self.event}", (), rows, [*notes, *self.warnings])]


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Deaggregation(Shown):
    """Mean annual rate of an event by bands of intensity; made by ``AnnualRate.deaggregation``."""

    edges: np.ndarray
    """Edges of the bands, shape (n,)."""
    rate: np.ndarray
    """Annual rate of the event in earthquakes of each band, shape (n − 1,)."""
    total: float
    """The annual rate over all intensities."""
    measure: str
    """Name of the measure of intensity, with its unit."""
    cov: np.ndarray
    """Coefficient of variation of the rate of each band, shape (n − 1,); NaN where unknown."""
    event: str = "pounding"
    """Whose rate it is, in words."""

    @property
    def share(self) -> np.ndarray:
        """Share of the total rate of each band."""
        return self.rate / self.total

    @property
    def mean(self) -> float:
        """Geometric mean of the intensity at pounding, of the bands that end neither at 0 nor ∞.

        NaN if there is no pounding in such bands.
        """
        inner = (self.edges[:-1] > 0) & np.isfinite(self.edges[1:]) & (self.rate > 0)
        if not inner.any():
            return float("nan")
        centre = np.log(self.edges[:-1][inner] * self.edges[1:][inner]) / 2
        return float(np.exp(np.average(centre, weights=self.rate[inner])))

    def _tables(self) -> list[TextTable]:
        covs = [f"{100 * cov:.3g} %" if np.isfinite(cov) else "-" for cov in self.cov]
        data = zip(self.edges[:-1], self.edges[1:], self.rate, self.share, covs, strict=True)
        rows = [
            (f"{low:.4g}", f"{high:.4g}", rate, f"{100 * share:.3g} %", cov)
            for low, high, rate, share, cov in data
        ]
        outside = 1 - float(self.share.sum())
        notes = [f"outside these bands {100 * outside:.2g} %"] if outside > _LEFT_OUT / 10 else []
        columns = (f"{self.measure} from", "to", "annual rate", "share", "c.o.v. of the rate")
        return [TextTable(f"Rate of {self.event} by intensity", columns, rows, notes, digits=4)]


@dataclasses.dataclass(frozen=True, eq=False)
class FragilityRate:
    """∫ P(pounding | im) |dλ(im)| over bands of intensity."""

    points: CurvePoints
    fragility: Fragility
    measure: str  # name of the intensity, with its unit

    def __call__(self, intensity: Any) -> FragilityRate:
        """Itself: the intensity is that of the fragility."""
        if intensity is not None:
            raise InvalidInput("intensity", "", "must be None: a fragility has its own")
        return self

    def annual_rate(self, confidence: float) -> AnnualRate:
        """The rate over all intensities: ln λ is normal, with a variance to first order."""
        im, curve = self.points.intensity, self.fragility
        with np.errstate(over="ignore", invalid="ignore"):
            ends = np.r_[0.0, im, np.inf]
            rates, slopes = self.points.integral(curve.median, curve.dispersion, ends)
        if not np.isfinite([*rates, *slopes.flat]).all():
            rule = f"must be nearer to the curve's intensities, {im[0]:.4g} to {im[-1]:.4g}:"
            rule = f"of the fragility {rule} continued to it, the curve has no finite rate"
            raise InvalidInput("median", f"{curve.median:.4g}", rule)
        slope = slopes.sum(axis=0)
        least, below, above = float(rates[1:-1].sum()), float(rates[0]), float(rates[-1])
        value, most = float(rates.sum()), self.points.annual_rate[-1]
        # At most every earthquake beyond the end causes pounding.
        bounds = least + most * float(curve.probability(im[-1])), least + below + most
        doubt = f"more than {_MOST_BEYOND:.0%} of the rate comes from intensities beyond the"
        doubt += " curve's ends, where it is only continued; are curve and fragility in one unit?"
        cov = (slope @ curve.covariance @ slope) ** 0.5 / value if value else float("nan")
        reach = float(ndtri((1 + confidence) / 2)) * cov
        factor = float(np.exp(reach)) if reach < _MAX_EXPONENT else float("nan")
        return AnnualRate(
            *(value, value / factor, value * factor, confidence, cov, below, above, bounds),
            ends=(float(im[0]), float(im[-1])),
            measure=self.measure,
            event=curve.event,
            warnings=(doubt,) if below + above > _MOST_BEYOND * value else (),
            _source=self,
        )

    def edges(self, bands: int) -> np.ndarray:
        """Edges of so many bands of one ratio that hold nearly all of the rate."""
        points, curve = self.points, self.fragility
        # The intensities at pounding are lognormal about θ e^(−k β²) where k is the slope, and
        # beyond θ fall as im^−k.
        steepest, last = points.slope.max(), points.slope[-1]
        lowest = curve.median * np.exp(-steepest * curve.dispersion**2)
        low = min(points.intensity[0], lowest) / _FAR
        high = max(points.intensity[-1], curve.median) * _FAR ** max(1.0, 1 / max(last, 0.1))
        low, high = np.clip([low, high], *_ENDS).tolist()
        fine = np.r_[0.0, np.geomspace(low, high, _FINE), np.inf]
        rates, _ = self.per_band(fine)
        first, final = np.searchsorted(np.cumsum(rates) / rates.sum(), [_LEFT_OUT, 1 - _LEFT_OUT])
        first = int(np.clip(first, 1, _FINE - 1))
        final = int(np.clip(final + 1, first + 1, _FINE))
        return np.geomspace(fine[first], fine[final], bands + 1)

    def per_band(self, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The rate from each band between edges, and its c.o.v. by the covariance."""
        curve = self.fragility
        rate, slope = self.points.integral(curve.median, curve.dispersion, edges)
        variance = np.einsum("bi,ij,bj->b", slope, curve.covariance, slope)
        with np.errstate(divide="ignore", invalid="ignore"):
            return rate, np.where(rate > 0, np.sqrt(variance) / rate, np.nan)


@dataclasses.dataclass(frozen=True, eq=False)
class SamplesRate:
    """The rate of earthquakes times the weights of the samples that pound, by their intensity."""

    measure: str  # name of the intensity, with its unit
    rate: float  # earthquakes a year
    intensity: np.ndarray  # of each sample, shape (n,), as the next three
    hits: np.ndarray  # whether the sample pounds
    weights: np.ndarray
    normalised: bool  # see ``Study.weighted``
    repeats: np.ndarray | None = None  # of each sample, where those of a repeat are correlated

    def __post_init__(self) -> None:
        if not (x := self.intensity[self.hits]).size:
            raise InvalidInput("a sample", "", "must pound, for the rate to have intensities")
        valid = (x > 0) & np.isfinite(x)
        enforce([Rule("intensity", x, valid, "positive and finite in samples that pound")])

    def edges(self, bands: int) -> np.ndarray:
        """Edges of so many bands of one ratio that hold all samples that pound."""
        im = self.intensity[self.hits]
        return np.geomspace(im.min() / (1 + _WIDER), im.max() * (1 + _WIDER), bands + 1)

    def per_band(self, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The rate from each band, its upper edge excluded, and its c.o.v. by the samples."""
        n, w = edges.size - 1, self.weights
        band = np.searchsorted(edges, self.intensity, side="right") - 1
        band[self.intensity == edges[-1]] = n - 1
        counted = self.hits & (band >= 0) & (band < n)
        band_hit, w_hit = band[counted], w[counted]
        by_band: Any = [np.bincount(band_hit, x, minlength=n) for x in (w_hit, w_hit**2)]
        sums: Any = Hits(w.size, w.sum(), (w**2).sum(), *by_band)  # arrays: all bands at once
        p = sums.hit / (sums.weight if self.normalised else sums.n)
        variance = sums.variance(p, self.normalised)
        if self.repeats is not None:
            _, repeat = np.unique(self.repeats, return_inverse=True)
            m = repeat.max() + 1
            cell = repeat[counted] * n + band_hit
            by_repeat = np.bincount(cell, w_hit, minlength=m * n).reshape(m, n)
            # The mean over all samples is that of m repeats of the same size.
            variance = (by_repeat * m / w.size).var(axis=0, ddof=1) / m
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.rate * p, np.where(sums.hit > 0, np.sqrt(variance) / p, np.nan)


def of_study(
    rate: float, study: Study, gap: float | None, link: int | None, intensity: Any
) -> SamplesRate:
    """Of a study whose intensities follow the hazard, by its pounding at a gap."""
    name = "pga" if intensity is None else intensity
    if isinstance(name, str) and name in study.columns:
        measure, x = str(study.measure(name)), study[name]
    else:
        values = study.parameters() if isinstance(name, str) else {}
        measure, x = _named(name, values, [*study.columns, *values], len(study))
    pounding = study.pounding(gap, link=link)
    finished = ~np.isnan(pounding)
    samples = x[finished], pounding[finished] == 1, study.weights[finished]
    return SamplesRate(measure, rate, *samples, study.normalised)


def of_event(rate: float, event: RareEvent, intensity: Any) -> SamplesRate:
    """Of a rare event whose scenarios draw the intensity by the hazard."""
    scenarios, samples, values = event.limit_state.scenarios, event.samples, {}
    names = parameter_names(scenarios) if intensity is None or isinstance(intensity, str) else ()
    if intensity is None:
        options = f"a parameter, {', '.join(names[-6:])}, or a number for each sample"
        raise InvalidInput("intensity", "None", f"must be {options}, of a rare event")
    if names:
        values = jax.jit(jax.vmap(lambda z: parameters(scenarios, z)))(samples.points)
    measure, x = _named(intensity, values, names, len(samples))
    repeats = samples.repeats if samples.repeats.size else None
    return SamplesRate(measure, rate, x, samples.values >= 0, samples.weights, False, repeats)


def _named(intensity: Any, values: Any, names: Sequence[str], n: int) -> tuple[str, np.ndarray]:
    """The name and values of an intensity, which is a name or a number for each of n samples."""
    if isinstance(intensity, str):
        if intensity not in values:
            rule = f"unknown intensity = {intensity!r}; {hint(intensity, names)}"
            raise InvalidInput("", "", rule)
        return intensity, np.asarray(values[intensity], float)
    return "intensity", array("intensity", intensity, (n,))


def gap_of_rate(
    annual_rate: Callable[[float], AnnualRate], tried: Iterable[float], target: float
) -> Estimate:
    """The gap of a target rate, with the interval of ln rate over the slope of ln rate by ln gap.

    ``annual_rate`` raises a ``ValueError`` at a gap at which no fragility can be fitted; the gaps
    ``tried`` are the first. Within, u is ln gap.
    """

    @cache
    def rate_at(u: float) -> AnnualRate | None:
        try:
            return annual_rate(float(np.exp(u)))
        except ValueError:
            return None

    def log_excess(u: float) -> float:
        rate = rate_at(u)
        return float("nan") if rate is None else float(np.log(rate.value / target))

    logs = [*filter(rate_at, (float(np.log(gap)) for gap in sorted(tried) if gap > 0))]
    excesses = [log_excess(u) for u in logs]
    if not (excesses and excesses[0] > 0 > excesses[-1]):
        ends = [min(excesses), max(excesses)] if excesses else []
        rates = " to ".join(f"{target * np.exp(x):.4g}" for x in ends) or "none"
        rule = "must be the rate of pounding at a gap at which a fragility can be fitted"
        rule = f"{target:.4g} a year, {rule}: of these there are {rates}"
        raise InvalidInput("the target,", "", rule)
    last = max(i for i, x in enumerate(excesses) if x > 0)
    root = float(brentq(log_excess, logs[last], logs[last + 1], xtol=1e-6))
    slope = (log_excess(root + _STEP_OF_GAP) - log_excess(root - _STEP_OF_GAP)) / (2 * _STEP_OF_GAP)
    gap, rate = float(np.exp(root)), rate_at(root)
    assert rate is not None
    factor = float(np.exp(abs(np.log(rate.high / rate.value) / slope)))
    return Estimate(gap, gap / factor, gap * factor, rate.confidence)
