"""Seismic hazard: how often per year an intensity is exceeded, and what follows for pounding."""

from __future__ import annotations

import dataclasses
from os import PathLike

import numpy as np
from jaxtyping import ArrayLike

from jaxpound._checks import Rule, enforce, instance, number, positive, real, require_share
from jaxpound._tables import Shown, Table
from jaxpound.ground.measure import Measure
from jaxpound.ground.plausibility import tell
from jaxpound.risk.annual_rate import AnnualRate
from jaxpound.risk.fragility_rate import FragilityRate, integral
from jaxpound.risk.hazard_files import read_hazard
from jaxpound.risk.hazard_gap import TRIED, gap_by_fragilities
from jaxpound.risk.hazard_intensity import CurvePoints, HazardIntensity, HazardWeights
from jaxpound.risk.hazard_meets import require_drawn, require_measure
from jaxpound.risk.hazard_points import checked, doubts
from jaxpound.risk.rare_event import RareEvent
from jaxpound.risk.samples_rate import of_event, of_study
from jaxpound.study.distributions import Distribution, density
from jaxpound.study.fragility import Fragility
from jaxpound.study.statistics import Estimate
from jaxpound.study.study import Study

_ROUNDING = 1e-9
_MOST_BEYOND = 0.5  # share of a rate from beyond the curve's ends that says nothing of a wrong unit


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class HazardCurve(Shown):
    """Mean annual rates at which intensities of the shaking are exceeded at a site.

    Between its points, and beyond both ends, ln rate is linear in ln intensity.

    Parameters
    ----------
    intensity
        Intensities im from 1e-12 to 1e12, rising, shape (m,), m ≥ 2, in any unit: that of the
        intensities of the fragility or the factors that it meets. Hazard analyses tell PGA and
        spectral acceleration in g, as ``study["pga"]`` of a dimensionless study is.
    annual_rate
        Mean number of earthquakes a year that exceed each, shape (m,), from 1e-100 to 1000 and
        nowhere rising.
    measure
        Name of the measure of intensity, with its unit, such as ``"PGA (g)"``, ``"PGA (m/s²)"`` or
        ``"Sa(0.9 s) (g)"``, for tables and figures, and to be checked against that of a fragility.
        Where it tells no measure that is known here, or no unit, that is not checked.

    Raises
    ------
    ValueError
        If the shapes differ or are not (m,) with m ≥ 2, a number is out of its range, intensities
        do not rise, or rates rise.

    Warns
    -----
    PlausibilityWarning
        If annual rates look like probabilities within years: the first two are nearly 1, or the
        curve has 0.4 g of PGA more often than once in 50 years.

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
        owner = "HazardCurve"
        im, rate = points = checked(owner, self.intensity, self.annual_rate)
        instance(owner, "measure", self.measure, str)
        tell(owner, doubts(points, Measure.of_text(self.measure)), strict=False)
        object.__setattr__(self, "intensity", im)
        object.__setattr__(self, "annual_rate", rate)

    @staticmethod
    def read(file: str | PathLike[str], site: int | str | None = None) -> HazardCurve:
        """A hazard curve from a file of OpenQuake or of the USGS, as comma-separated values.

        Of OpenQuake (``hazard_curve-mean-PGA_12.csv``) the probabilities p of exceedance within the
        investigation time T become rates −ln(1 − p) / T. Of the USGS (the curves of nshmp-haz, a
        line ``name,lon,lat`` and intensities above the sites) the numbers are taken for annual
        rates, as that program writes them unless it is told to write probabilities. Points at
        which the rate is zero or cannot be told (p = 1) are left out.

        Parameters
        ----------
        file
            Its path.
        site
            The row, from 0, or the site's name in a file of the USGS; needed if there are several.

        Raises
        ------
        ValueError
            If the file is neither, has no such site or several and none is chosen, or its numbers
            are no hazard curve; with the file's name.
        """
        intensity, annual_rate, measure = read_hazard(file, site)
        try:
            return HazardCurve(intensity, annual_rate, measure)
        except ValueError as error:
            raise ValueError(f"HazardCurve.read: {file}: {str(error).partition(': ')[2]}") from None

    @property
    def slope(self) -> np.ndarray:
        """Exponents k = −d ln rate / d ln im of the m − 1 pieces between the points."""
        return -np.diff(np.log(self.annual_rate)) / np.diff(np.log(self.intensity))

    def rate(self, intensity: ArrayLike) -> np.ndarray:
        """Mean annual rate of exceeding intensities > 0, of their shape."""
        (im,) = positive("HazardCurve.rate", intensity=intensity)
        piece = self.piece(im)
        return self.annual_rate[piece] * (im / self.intensity[piece]) ** -self.slope[piece]

    def probability(self, years: float = 1.0) -> np.ndarray:
        """Probability that each intensity is exceeded within years: 1 − e^(−rate years).

        Earthquakes are a Poisson process: independent of each other, and of the time since the
        last.

        Raises
        ------
        ValueError
            If years is not one positive number.
        """
        owner = "HazardCurve.probability"
        (years,) = positive(owner, years=number(owner, "years", years))
        return -np.expm1(-self.annual_rate * years)

    def intensity_at(self, probability: float, years: float = 50.0) -> float:
        """The intensity that is exceeded with this probability within years.

        Raises
        ------
        ValueError
            If an argument breaks its rule, or the rate is not one of the curve: it is never told
            from beyond the ends.
        """
        owner = "HazardCurve.intensity_at"
        rate = rate_of(owner, probability, years)
        most, least = self.annual_rate[0], self.annual_rate[-1]
        # A rate may be that of an end but for its rounding.
        if not least * (1 - _ROUNDING) <= rate <= most * (1 + _ROUNDING):
            told = f"has an annual rate of {rate:.4g}"
            raise ValueError(
                f"{owner}: probability = {probability:.4g} in {years:.4g} years {told}, which must "
                f"be one of the curve's, {least:.4g} to {most:.4g}"
            )
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

        Parameters
        ----------
        pounding
            A fragility: the integral over every piece of the curve is taken in closed form, so
            that a curve that is one power law gives Cornell's λ(θ) e^(k² β² / 2) (Cornell et al.
            2002), and the covariance of (ln θ, β) is carried through to first order (the delta
            method). Beyond the curve's ends its end pieces are continued; the result tells how much
            comes from there, and between which bounds it lies.

            Or what tells the probability of pounding in an earthquake that exceeds the lowest
            intensity of the curve, which is multiplied by that intensity's rate; weaker earthquakes
            are left out. That is a study, or a ``RareEvent``, whose intensities ``distribution`` of
            this curve, or of one that differs in a factor only, draws or, in a study, ``weights``
            weigh; or an estimate alone, such as ``pounding_probability`` of such a study.
        confidence
            Confidence level of the interval; an estimate alone keeps its own.
        gap, link
            Of a study: see ``Study.pounding_probability``.
        drawn
            Of a study or a ``RareEvent``: True if its intensities follow this curve though that
            cannot be told, because a function of the user's own draws them.

        Raises
        ------
        ValueError
            If pounding is none of these, or an argument breaks its rule; if the curve's measure is
            another, or in another unit, than that of the fragility; if it is not known that the
            intensities of a study or a rare event follow the curve.

        Warns
        -----
        PlausibilityWarning
            If a fragility is not in g, and the name of the curve's measure tells no unit.
        """
        owner = "HazardCurve.annual_rate_of"
        require_share(owner, "confidence", confidence)
        instance(owner, "pounding", pounding, Fragility, Estimate, Study, RareEvent)
        if not isinstance(pounding, Study) and (gap is not None or link is not None):
            name, value = ("link", link) if gap is None else ("gap", gap)
            raise ValueError(f"{owner}: {name} = {value!r} must be None: pounding is not a study")
        if isinstance(pounding, Fragility):
            require_measure(owner, self.measure, "the fragility", pounding.measured)
            return self._by_fragility(pounding, confidence)
        often = float(self.annual_rate[0])
        if isinstance(pounding, Study | RareEvent) and not drawn:
            instead = "a fragility, such as study.fragility('pga')"
            require_drawn(owner, self._points, pounding, instead)
        if isinstance(pounding, Study):
            estimate = pounding.pounding_probability(gap, confidence, link=link)
            cov, by = pounding.pounding_cov(gap, link=link), of_study(often, pounding, gap, link)
            return AnnualRate.of_estimate(often, estimate, cov, _source=by)
        if isinstance(pounding, RareEvent):
            estimate, by = pounding.interval(confidence), of_event(often, pounding)
            told = pounding.warnings
            return AnnualRate.of_estimate(often, estimate, pounding.cov, warnings=told, _source=by)
        return AnnualRate.of_estimate(often, pounding)

    def _by_fragility(self, pounding: Fragility, confidence: float) -> AnnualRate:
        """``annual_rate_of`` a fragility."""
        ends = np.r_[0.0, self.intensity, np.inf]
        with np.errstate(over="ignore", invalid="ignore"):
            parts, slopes = integral(self, pounding, ends)
        if not np.isfinite([*parts, *slopes.flat]).all():
            raise ValueError(
                f"HazardCurve.annual_rate_of: median = {pounding.median:.4g} of the fragility must "
                f"be nearer to the curve's intensities, {self.intensity[0]:.4g} to "
                f"{self.intensity[-1]:.4g}: continued to it, the curve has no finite rate"
            )
        by_fragility = slopes.sum(axis=0)
        least, below = float(parts[1:-1].sum()), float(parts[0])
        most = self.annual_rate[-1]  # if every earthquake beyond the end were one of pounding
        low = least + most * float(pounding.probability(self.intensity[-1]))
        whole, doubts = float(parts.sum()), []
        if below + float(parts[-1]) > _MOST_BEYOND * whole:
            doubts.append(
                f"more than {_MOST_BEYOND:.0%} of the rate comes from intensities beyond the "
                "curve's ends, where it is only continued; are curve and fragility in one unit?"
            )
        return AnnualRate.of_fragility(
            whole,
            by_fragility @ pounding.covariance @ by_fragility,
            confidence,
            below=below,
            above=float(parts[-1]),
            bounds=(low, least + below + most),
            ends=(float(self.intensity[0]), float(self.intensity[-1])),
            measure=self.measure,
            warnings=tuple(doubts),
            _source=FragilityRate(self, pounding),
        )

    def distribution(self) -> HazardIntensity:
        """The intensity of an earthquake that exceeds the curve's lowest intensity.

        It draws the intensities of a study, as the factor of ``RandomRecord`` (of records that are
        scaled to intensity 1) or the intensity of ``RandomRicker``. ``annual_rate_of`` and
        ``required_gap`` turn the study's estimates into annual rates.

        Raises
        ------
        ValueError
            If the last two rates are equal, so that the curve does not tell how it goes on.
        """
        return HazardIntensity(*(tuple(x.tolist()) for x in self._points))

    @property
    def _points(self) -> CurvePoints:
        return self.intensity, self.annual_rate

    def weights(self, intensity: ArrayLike, drawn_from: Distribution | None = None) -> np.ndarray:
        """Weights that give a study's intensities the frequencies of the hazard.

        For ``Study.weighted``; the probabilities of the weighted study are those of an earthquake
        that exceeds the curve's lowest intensity, as ``annual_rate_of`` takes them.

        Parameters
        ----------
        intensity
            The samples' intensities > 0, shape (n,); NaN, of runs that failed, has a weight of NaN.
        drawn_from
            The distribution that drew them: the weights are the ratio of both densities. By default
            they are multiple stripes, a few intensities with many samples each: a stripe has the
            share of the earthquakes nearer to it than to its neighbours, in ratio, spread over its
            samples.

        Raises
        ------
        ValueError
            If an intensity is not positive, or cannot be drawn from drawn_from; there are fewer
            than two stripes, or drawn_from is no distribution.
        """
        owner = "HazardCurve.weights"
        im = np.atleast_1d(np.asarray(real(owner, "intensity", intensity), float))
        if (failed := np.isnan(im)).any():
            weights = np.full(im.shape, np.nan)
            weights[~failed] = self.weights(im[~failed], drawn_from)
            return HazardWeights.of(weights, self._points)
        positive(owner, intensity=im)
        if drawn_from is not None:
            instance(owner, "drawn_from", drawn_from, Distribution)
            drawn = density(drawn_from, im)
            enforce(owner, [Rule("intensity", im, drawn > 0, "one that drawn_from can draw")])
            return HazardWeights.of(density(self.distribution(), im) / drawn, self._points)
        stripes, which, often = np.unique(im, return_inverse=True, return_counts=True)
        if stripes.size < 2:
            raise ValueError(f"{owner}: intensity of {stripes.size} stripe must be of two or more")
        inner = np.maximum(np.sqrt(stripes[1:] * stripes[:-1]), self.intensity[0])
        exceeded = np.r_[self.annual_rate[0], self.rate(inner), 0.0]
        weights = (-np.diff(exceeded) / exceeded[0] * im.size / often)[which]
        return HazardWeights.of(weights, self._points)

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

        Parameters
        ----------
        study
            A study whose required gaps are known.
        probability, years
            The target; 2 % in 50 years by default.
        intensity
            None if the intensities of the study are those of the hazard, because ``distribution``
            drew them or ``weights`` weigh them: the gap is a quantile of the study, with its
            interval. Or the column of the study that measures the shaking, however it was drawn:
            a fragility is fitted at every gap that is tried, until its annual rate is the wanted;
            the interval is that of ln rate there over the slope of ln rate by ln gap.
        link
            A link by number, from 0; by default any of them.
        confidence
            Confidence level of the interval.
        drawn
            See ``annual_rate_of``.

        Raises
        ------
        ValueError
            If an argument breaks its rule, the target is more frequent than the curve's lowest
            intensity, or no gap at which a fragility can be fitted has that rate; if the curve's
            measure is another, or in another unit, than that of the column; if intensity is None
            and it is not known that the study's intensities follow the curve.

        Warns
        -----
        PlausibilityWarning
            If the column is not in g, and the name of the curve's measure tells no unit.
        """
        owner = "HazardCurve.required_gap"
        instance(owner, "study", study, Study)
        require_share(owner, "confidence", confidence)
        target = rate_of(owner, probability, years)
        if intensity is None:
            if not drawn:
                require_drawn(owner, self._points, study, "intensity, such as 'pga'")
            share = target / self.annual_rate[0]
            if share >= 1:
                raise ValueError(
                    f"{owner}: the annual rate of probability = {probability:.4g} in {years:.4g} "
                    f"years, {target:.4g}, must be below the curve's largest rate, "
                    f"{self.annual_rate[0]:.4g}"
                )
            return study.required_gap(float(share), confidence, link=link)
        column = f"the study's column {intensity!r}"
        require_measure(owner, self.measure, column, study.measure(intensity))
        return gap_by_fragilities(
            lambda gap: self._by_fragility(study.fragility(intensity, gap, link=link), confidence),
            [study.required_gap(p, link=link).value for p in TRIED],
            target,
        )

    def piece(self, im: np.ndarray) -> np.ndarray:
        """The piece between points that an intensity is in, or the one that is continued there."""
        before = np.searchsorted(self.intensity, im, side="right") - 1
        return np.clip(before, 0, self.intensity.size - 2)

    def _tables(self) -> list[Table]:
        rows = [
            (f"{im:.4g}", rate, 1 / rate, f"{100 * -np.expm1(-50 * rate):.3g} %")
            for im, rate in zip(self.intensity, self.annual_rate, strict=True)
        ]
        columns = (self.measure, "annual rate", "return period (years)", "in 50 years")
        return [Table("Seismic hazard: rates of exceedance", columns, rows, digits=4)]


def rate_of(owner: str, probability: float, years: float) -> float:
    """Annual rate of an event of this probability within years: −ln(1 − p) / years.

    Raises
    ------
    ValueError
        If probability is not between 0 and 1, or years not positive; with the owner's name.
    """
    require_share(owner, "probability", probability)
    (years,) = positive(owner, years=number(owner, "years", years))
    return float(-np.log1p(-probability) / years)
