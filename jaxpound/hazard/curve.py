"""Seismic hazard: how often per year an intensity is exceeded, and what follows for pounding."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import ArrayLike

from jaxpound._checks import Rule, enforce, instance, positive, positive_number, real, require_share
from jaxpound._errors import InvalidInput, renamed, warn
from jaxpound._tables import Shown, TextTable
from jaxpound.ground.measure import Measure, units_like
from jaxpound.hazard.annual_rate import AnnualRate, FragilityRate, gap_of_rate, of_event, of_study
from jaxpound.hazard.points import CurvePoints, HazardIntensity, rate_of, read_hazard
from jaxpound.quantities import DIMENSIONLESS
from jaxpound.reliability.result import RareEvent
from jaxpound.scenarios.distributions import Distribution, density
from jaxpound.store.store import describe
from jaxpound.study.fragility import Fragility
from jaxpound.study.statistics import Estimate
from jaxpound.study.study import Study

_ROUNDING = 1e-9
_SAME = 1e-6  # largest difference of logarithms between points of one curve, up to a factor
_DEFAULT_UNIT = DIMENSIONLESS["acceleration"]  # of a curve whose measure has no unit
_TRIED = (0.98, 0.9, 0.5, 0.1, 0.02, 5e-3, 1e-3)  # shares of runs that pound at the first gaps


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class HazardCurve(Shown):
    """Mean annual rates at which intensities of the shaking are exceeded at a site.

    Between its points, and beyond both ends, ln rate is linear in ln intensity. Warns
    (``PlausibilityWarning``) if annual rates look like probabilities within years: the first two
    are nearly 1, or the curve has 0.4 g of PGA more often than once in 50 years.

    Parameters
    ----------
    intensity
        Intensities im from 1e-12 to 1e12, rising, shape (m,), m ≥ 2, in the unit of ``measure``, or
        of the fragility or the factors that the curve is combined with. Hazard analyses give PGA
        and spectral acceleration in g, as a dimensionless study has ``study["pga"]``.
    annual_rate
        Mean number of earthquakes a year that exceed each, (m,), from 1e-100 to 1000, not rising.
    measure
        Name of the measure of intensity, with its unit, such as ``"PGA (g)"``, ``"PGA (m/s²)"`` or
        ``"Sa(0.9 s) (g)"``, for tables and figures, and to be checked against that of a fragility.
        An unknown measure, or one without a unit, is not checked.

    Examples
    --------
    >>> hazard = jp.HazardCurve([0.1, 0.2, 0.4, 0.8], [1e-2, 3e-3, 6e-4, 8e-5], measure="PGA (g)")
    >>> round(hazard.intensity_at(0.1, years=50), 3)  # exceeded with 10 % in 50 years
    0.233
    >>> curve = jp.fit_fragility([0.2, 0.4, 0.6, 0.8, 1.0], [1, 4, 9, 14, 18], trials=[20] * 5)
    >>> rate = hazard.annual_rate_of(curve)
    >>> round(rate.value, 6), round(rate.probability(years=50).value, 4)
    (0.000484, 0.0239)
    """

    intensity: np.ndarray
    annual_rate: np.ndarray
    measure: str = "im"

    def __post_init__(self) -> None:
        points = CurvePoints.of(self.intensity, self.annual_rate)
        instance("measure", self.measure, str)
        warn(points.doubts(Measure.of_text(self.measure)), strict=False)
        object.__setattr__(self, "intensity", points.intensity)
        object.__setattr__(self, "annual_rate", points.annual_rate)

    @staticmethod
    def read(file: str | PathLike[str], site: int | str | None = None) -> HazardCurve:
        """A hazard curve from a file of OpenQuake or of the USGS, as comma-separated values.

        In a file of OpenQuake (``hazard_curve-mean-PGA_12.csv``) the probabilities p of exceedance
        within the investigation time T become rates −ln(1 − p) / T. In a file of the USGS (the
        curves of nshmp-haz, a line ``name,lon,lat`` and intensities above the sites) the numbers
        are annual rates, which that program writes by default. Points whose rate is zero or
        infinite (p = 1) are left out. Raises ``ValueError`` if the file has another format, its
        site is missing or not chosen, or its numbers are no hazard curve; with the file's name.

        Parameters
        ----------
        file
            Its path.
        site
            The row, from 0, or the site's name in a file of the USGS; needed if there are several.
        """
        with renamed(str(file)):
            return HazardCurve(*read_hazard(Path(file), site))

    def rate(self, intensity: ArrayLike) -> np.ndarray:
        """Mean annual rate of exceeding intensities > 0, of their shape."""
        (im,) = positive(intensity=intensity)
        piece, slope = self._points.piece(im), self._points.slope
        return self.annual_rate[piece] * (im / self.intensity[piece]) ** -slope[piece]

    def probability(self, years: float = 1.0) -> np.ndarray:
        """Probability that each intensity is exceeded within years > 0: 1 − e^(−rate years).

        Earthquakes are a Poisson process.
        """
        (years,) = positive_number(years=years)
        return -np.expm1(-self.annual_rate * years)

    def intensity_at(self, probability: float, years: float = 50.0) -> float:
        """The intensity that is exceeded with this probability within years.

        Raises ``ValueError`` if the rate is beyond the ends: the curve is not extrapolated.
        """
        rate = rate_of(probability, years)
        most, least = self.annual_rate[0], self.annual_rate[-1]
        if not least * (1 - _ROUNDING) <= rate <= most * (1 + _ROUNDING):
            rule = f"in {years:.4g} years has an annual rate of {rate:.4g}, which must be one of"
            rule = f"{rule} the curve's, {least:.4g} to {most:.4g}"
            raise InvalidInput("probability", f"{probability:.4g}", rule)
        falling = np.log(self.annual_rate[::-1]), np.log(self.intensity[::-1])
        return float(np.exp(np.interp(np.log(rate), *falling)))

    def annual_rate_of(
        self,
        pounding: Fragility | Study | RareEvent | Estimate,
        confidence: float = 0.95,
        *,
        gap: float | None = None,
        link: int | None = None,
        drawn: bool = False,
    ) -> AnnualRate:
        """Mean annual rate of pounding, λ = ∫ P(pounding | im) |dλ(im)|.

        A fragility in another unit of the curve's measure is converted. Raises ``ValueError`` if
        curve and fragility have different measures; if it is not known that the intensities of a
        study or a rare event follow the curve. Warns (``PlausibilityWarning``) if a fragility is
        not in g, and the curve's measure has no unit.

        Parameters
        ----------
        pounding
            A fragility: the integral over every piece of the curve has a closed form; for a curve
            that is one power law it is Cornell's λ(θ) e^(k² β² / 2) (Cornell et al. 2002). The
            covariance of (ln θ, β) is propagated to first order (the delta method). Beyond the
            curve's ends its end pieces are continued; the result states their share of the rate,
            and its bounds.

            Or the probability of pounding in an earthquake that exceeds the lowest intensity of the
            curve, which is multiplied by that intensity's rate; weaker earthquakes are left out.
            It is that of a study or a ``RareEvent`` whose intensities are drawn by ``distribution``
            of this curve, or of one that differs in a factor only, or of an estimate, such as
            ``pounding_probability`` of such a study: it is taken for one of pounding.
        confidence
            Confidence level of the interval; an estimate alone keeps its own.
        gap, link
            Of a study: see ``Study.pounding_probability``.
        drawn
            True if a user-defined function draws the intensities of a study or a ``RareEvent`` so
            that they follow this curve, or a study has its ``weights``, which cannot be checked.
        """
        require_share("confidence", confidence)
        instance("pounding", pounding, Fragility, Estimate, Study, RareEvent)
        for name, value in (("gap", gap), ("link", link)):
            if value is not None and not isinstance(pounding, Study):
                raise InvalidInput(name, repr(value), "must be None: pounding is not a study")
        if isinstance(pounding, Fragility):
            measure = Measure.of_text(pounding.measure)
            _require_measure(self.measure, "the fragility", measure)
            return self._rate_of(pounding, confidence)
        often = float(self.annual_rate[0])
        if isinstance(pounding, Study | RareEvent) and not drawn:
            instead = "a fragility, such as study.fragility('pga')"
            _require_drawn(self._points, pounding, instead)
        if isinstance(pounding, Study):
            estimate = pounding.pounding_probability(gap, confidence, link=link)
            cov = pounding.pounding_cov(gap, link=link)
            source = partial(of_study, often, pounding, gap, link)
            return AnnualRate.of_estimate(often, estimate, cov, _source=source)
        if isinstance(pounding, RareEvent):
            estimate, source = pounding.interval(confidence), partial(of_event, often, pounding)
            more = {"warnings": pounding.warnings, "event": pounding.event, "_source": source}
            return AnnualRate.of_estimate(often, estimate, pounding.cov, **more)
        return AnnualRate.of_estimate(often, pounding)

    def _rate_of(self, fragility: Fragility, confidence: float) -> AnnualRate:
        """Of a fragility by the same measure, in the curve's unit where both state one."""
        if fragility.unit and (unit := Measure.of_text(self.measure).unit):
            fragility = fragility.in_unit(unit)
        return FragilityRate(self._points, fragility, self.measure).annual_rate(confidence)

    def distribution(self) -> HazardIntensity:
        """The intensity of an earthquake that exceeds the curve's lowest intensity.

        It draws the intensities of a study: the factor of ``RandomRecord``, of records that are
        scaled to intensity 1, or the intensity of ``RandomRicker``. Raises ``ValueError`` if the
        last two rates are equal, so that the curve cannot be continued.
        """
        return HazardIntensity(*(tuple(x.tolist()) for x in self._points))

    @property
    def _points(self) -> CurvePoints:
        return CurvePoints(self.intensity, self.annual_rate)

    def weights(self, intensity: ArrayLike, drawn_from: Distribution | None = None) -> np.ndarray:
        """Weights for ``Study.weighted`` that give intensities the frequencies of the hazard.

        The probabilities of the weighted study are those of an earthquake that exceeds the curve's
        lowest intensity, as ``annual_rate_of`` takes them with ``drawn=True``. Raises
        ``ValueError`` if an intensity is not positive, or cannot be drawn from drawn_from; there
        are fewer than two stripes, or drawn_from is no distribution.

        Parameters
        ----------
        intensity
            The samples' intensities > 0, shape (n,); NaN, of runs that failed, has a weight of NaN.
        drawn_from
            The distribution that drew them: the weights are the ratio of both densities. By default
            they are multiple stripes, a few intensities with many samples each: a stripe has the
            share of the earthquakes nearer to it, in ratio, than to its neighbours, spread over its
            samples.
        """
        im = np.atleast_1d(np.asarray(real("intensity", intensity), float))
        finished = ~np.isnan(im)
        weights, im = np.full(im.shape, np.nan), im[finished]
        positive(intensity=im)
        if drawn_from is not None:
            instance("drawn_from", drawn_from, Distribution)
            drawn = density(drawn_from, im)
            enforce([Rule("intensity", im, drawn > 0, "one that drawn_from can draw")])
            weights[finished] = density(self.distribution(), im) / drawn
        else:
            stripes, stripe, size = np.unique(im, return_inverse=True, return_counts=True)
            if stripes.size < 2:
                rule = f"of {stripes.size} stripe must be of two or more"
                raise InvalidInput("intensity", "", rule)
            inner = np.maximum(np.sqrt(stripes[1:] * stripes[:-1]), self.intensity[0])
            exceeded = np.r_[self.annual_rate[0], self.rate(inner), 0.0]
            weights[finished] = (-np.diff(exceeded) / exceeded[0] * im.size / size)[stripe]
        return weights

    def required_gap(
        self,
        study: Study,
        probability: float = 0.02,
        years: float = 50.0,
        *,
        intensity: str | None = None,
        link: int | None = None,
        confidence: float = 0.95,
        drawn: bool = False,
    ) -> Estimate:
        """The gap at rest at which there is pounding with this probability within years.

        Raises ``ValueError`` if an argument breaks its rule, the target is more frequent than the
        curve's lowest intensity, or no gap at which a fragility can be fitted has that rate. Else
        raises and warns as ``annual_rate_of``: of a fragility by the column, or of the study where
        intensity is None.

        Parameters
        ----------
        study
            A study whose required gaps are known.
        probability, years
            The target; 2 % in 50 years by default.
        intensity
            None if the study's intensities follow the curve, by ``distribution`` or ``weights``:
            the gap is a quantile of the study, with its interval. Or the column of the study that
            measures the shaking, however it was drawn: the gap is sought at which a fragility has
            the target rate; the interval is that of ln rate over the slope of ln rate by ln gap.
        link, confidence, drawn
            See ``annual_rate_of``.
        """
        instance("study", study, Study)
        require_share("confidence", confidence)
        target = rate_of(probability, years)
        if intensity is None:
            if not drawn:
                _require_drawn(self._points, study, "intensity, such as 'pga'")
            if (share := target / self.annual_rate[0]) >= 1:
                most = f"{self.annual_rate[0]:.4g}"
                rule = f"in {years:.4g} years, {target:.4g}, must be below the curve's largest rate"
                name = "the annual rate of probability"
                raise InvalidInput(name, f"{probability:.4g}", f"{rule}, {most}")
            return study.required_gap(float(share), confidence, link=link)
        column = f"the study's column {intensity!r}"
        _require_measure(self.measure, column, study.measure(intensity))

        def annual_rate(gap: float) -> AnnualRate:
            return self._rate_of(study.fragility(intensity, gap, link=link), confidence)

        gaps = [study.required_gap(p, link=link).value for p in _TRIED]
        return gap_of_rate(annual_rate, gaps, target)

    def _tables(self) -> list[TextTable]:
        rows = [
            (f"{im:.4g}", rate, 1 / rate, f"{100 * -np.expm1(-50 * rate):.3g} %")
            for im, rate in zip(self.intensity, self.annual_rate, strict=True)
        ]
        columns = (self.measure, "annual rate", "return period (years)", "in 50 years")
        return [TextTable("Seismic hazard: rates of exceedance", columns, rows, digits=4)]


def _require_measure(text: str, source: str, measure: Measure) -> None:
    """An ``InvalidInput`` if a curve has another measure or unit than ``source``, or a warning."""
    of_curve, unit = Measure.of_text(text), measure.unit
    curve, other = f"measure = {text!r}", f"{source}, {measure}"
    if not of_curve.may_be(measure):
        raise InvalidInput("measure", repr(text), f"must be that of {other}")
    rule = f"be in the unit of {source}, {unit}: convert the curve's intensities and name them so"
    if of_curve.unit and unit and of_curve.unit not in units_like(unit):
        raise InvalidInput("measure", repr(text), f"must {rule}")
    doubts = []
    if unit not in ("", _DEFAULT_UNIT) and not of_curve.unit:
        doubts.append(f"{curve} names no unit; it should {rule}")
    if measure.name and of_curve.unit and not unit:
        doubts.append(f"{other}, names no unit; it should be that of {curve}")
    if of_curve.name == measure.name and (of_curve.period is None) != (measure.period is None):
        silent, reference = (curve, other) if of_curve.period is None else (f"{other},", curve)
        doubts.append(f"{silent} names no period; it should be that of {reference}")
    warn(doubts, strict=False)


def _require_drawn(curve: CurvePoints, source: Study | RareEvent, instead: str) -> None:
    """An ``InvalidInput`` that offers ``instead`` unless intensities follow a hazard curve.

    It is known of scenarios that have this curve, up to a factor, without other weights.
    """
    if isinstance(source, RareEvent):
        noun, described = "rare event", describe(source.limit_state.scenarios)
    else:
        noun, described = "study", source.about["identity"]["scenarios"]
        described = described if source.weighting is None else None
    curves = (x for x in _drawing(described) if np.shape(x) == np.shape(curve))
    if not any((np.ptp(np.log(curve) - np.log(x), axis=1) < _SAME).all() for x in curves):
        rule = "must be drawn by HazardCurve.distribution of this curve, or weighed by its "
        rule += f"HazardCurve.weights, and are not known to be; give {instead}, or drawn=True if"
        rule += " they follow this curve (weights are plain numbers, of which none is known to)"
        raise InvalidInput(f"intensities of the {noun}", "", rule)


def _drawing(described: Any) -> Iterator[Any]:
    """The points of all curves that draw a number in a description."""
    if isinstance(described, dict):
        if described.get("type") == HazardIntensity.__name__:
            yield described["intensity"], described["annual_rate"]
        described = list(described.values())
    if isinstance(described, list):
        for part in described:
            yield from _drawing(part)
