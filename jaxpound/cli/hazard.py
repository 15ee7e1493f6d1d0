"""``jaxpound hazard``: how often buildings pound, from a hazard curve and a fragility or study."""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple

import numpy as np

import jaxpound as jp
from jaxpound._tables import TextTable
from jaxpound.cli import files
from jaxpound.cli.reading import Count, File, Numbers, Section, between, named, refused, says, shown
from jaxpound.cli.tables import Gap
from jaxpound.ground.measure import UNITS, Measure, measure_unit, units_like
from jaxpound.hazard.curve import is_drawn
from jaxpound.hazard.points import read_hazard
from jaxpound.results.named import is_demand
from jaxpound.study.statistics import Estimate

_Site = Annotated[Annotated[int, Count] | str, says("the row of a site, from 1, or its name")]
_Share = Annotated[float, between(1e-9, 0.999, "", "a probability")]
_Shares = Annotated[list[_Share], says("a list of probabilities", min_length=1)]
_Error = "a standard error"


class HazardTable(Section):
    """The hazard curve, by its points or by a file."""

    intensity: Numbers | None = None
    annual_rate: Numbers | None = None
    measure: str | None = None
    unit: str | None = None
    file: str | None = None
    site: _Site | None = None

    def __post_init__(self) -> None:
        if self.file is not None:
            self.refuse_any(("intensity", "annual_rate"), "must not be given beside file")
        elif self.intensity is None or self.annual_rate is None:
            raise ValueError("must have intensity and annual_rate, or file")
        else:
            self.refuse_any(("site",), "must be given with file only")
        if self.unit is not None and not measure_unit(self.unit):
            raise refused("unit", f"must be one of {', '.join(UNITS)}", shown(self.unit))

    def model(self, file: File) -> jp.HazardCurve:
        """The library's ``HazardCurve``."""
        points: Any = map(np.array, (self.intensity, self.annual_rate))
        if self.file is not None:
            points = read_hazard(file.folder / self.file, self.site, first=1)
        hazard = jp.HazardCurve(*points)
        return hazard if self.measure is None else dataclasses.replace(hazard, measure=self.measure)


class FragilityTable(Section):
    """A fragility in numbers."""

    median: Annotated[float, between(1e-12, 1e12, "", "of the hazard's intensities")]
    dispersion: Annotated[float, between(1e-3, 10, "", "a standard deviation of the logarithm")]
    median_error: Annotated[float, between(0, 1e12, "", _Error)] | None = None
    dispersion_error: Annotated[float, between(0, 10, "", _Error)] | None = None

    def __post_init__(self) -> None:
        if (self.median_error is None) != (self.dispersion_error is None):
            raise ValueError("must have median_error and dispersion_error, both or none")
        for name in ("median", "dispersion"):
            value, error = getattr(self, name), getattr(self, f"{name}_error") or 0.0
            if error > value:
                rule = f"must be at most the {name} itself, {value:g}"
                raise refused(f"{name}_error", rule, f"{error:g}")

    def model(self) -> jp.study.Fragility:
        """The library's ``Fragility``, without data."""
        errors = [np.nan, np.nan]
        if self.median_error is not None and self.dispersion_error is not None:
            errors = [self.median_error / self.median, self.dispersion_error]
        return jp.study.Fragility(self.median, self.dispersion, np.diag(np.square(errors)))


class StudyTable(Section):
    """A study to whose runs a fragility is fitted, or whose earthquakes the hazard has drawn."""

    store: str
    intensity: str = "pga"
    gap: Gap | None = None
    link: Annotated[int, Count] | None = None
    gap_probabilities: _Shares | None = None
    drawn: bool = False

    def opened(self, file: File) -> jp.Study:
        """The study; a ``ValueError`` if it has no such column or link."""
        study = jp.Study.open(file.folder / self.store)
        study.moments(self.intensity)
        if is_demand(self.intensity) and self.intensity not in ("pga", "pgv"):
            rule = "must measure the shaking, such as pga, and not the response"
            raise refused("intensity", rule, f'"{self.intensity}"')
        if self.link is not None:
            if self.link > (n := study.n_links):
                rule = f"must be one of the study's links, from 1 to {n}"
                raise refused("link", rule, str(self.link))
            if not study.finite(f"min_gap_{self.link}" if n > 1 else "min_gap").size:
                raise refused("link", "must be a link with a gap", str(self.link))
        return study


class LifetimeResults(Section):
    """The life of a building, and the form of the results."""

    years: Annotated[float, between(1e-3, 1e6, "years", "of a building's life")] = 50.0
    bands: Annotated[int, between(1, 1000)] = 20
    confidence: Annotated[float, between(0.01, 0.9999, "", "of an interval")] = 0.95


class Lifetime(Section):
    """The configuration of ``jaxpound hazard``."""

    hazard: HazardTable
    fragility: FragilityTable | None = None
    study: StudyTable | None = None
    results: LifetimeResults = LifetimeResults()

    def __post_init__(self) -> None:
        if (self.fragility is None) == (self.study is None):
            raise ValueError("must have the table [fragility] or the table [study], one of them")
        if self.hazard.unit is not None and self.study is None:
            rule = "must be given with [study] only: a [fragility] is in the hazard's own unit"
            raise refused("[hazard] unit", rule)


class LifetimeRisk(NamedTuple):
    """The annual rate of pounding, and what it is computed from."""

    hazard: jp.HazardCurve
    fragility: jp.study.Fragility | None  # None if the hazard has drawn the study's earthquakes
    rate: jp.hazard.AnnualRate
    gaps: Mapping[float, Estimate]  # required ones, by their probabilities within the years
    results: LifetimeResults
    column: str | None = None  # without a fragility the study's column that measures the shaking

    @property
    def deaggregation(self) -> jp.hazard.Deaggregation:
        """The rate by bands of intensity."""
        return self.rate.deaggregation(bands=self.results.bands, intensity=self.column)


def run(args: argparse.Namespace) -> None:
    """Run the command."""
    file = File.opened(args.config, "hazard")
    risk = combined(file, file.read(Lifetime))
    files.make_folder(args.out)
    parts: list[Any] = tables(risk)
    print("\n".join(table.text() for table in parts))

    from jaxpound.plots import hazards, studies
    from jaxpound.plots.style import drawn

    options: Any = {"bands": risk.results.bands, "intensity": risk.column}
    figures = {"hazard": drawn(hazards.pounding, risk.hazard, risk.rate, **options)}
    if (curve := risk.fragility) is not None and curve.intensity.size:
        figures["fragility"] = drawn(studies.fragility, curve, intensity=risk.hazard.measure)
    interval = "probability in an earthquake" if curve is None else "fragility"
    remark = (
        "Earthquakes with pounding are taken for a Poisson process. The interval is that of the "
        f"{interval}; the hazard curve is taken as known."
    )
    bands = risk.deaggregation
    columns = {"from": bands.edges[:-1], "to": bands.edges[1:], "annual_rate": bands.rate}
    text = files.csv_text({**columns, "share": bands.share, "cov": bands.cov})
    parts, csv = [files.VERSION, *parts, remark], {"deaggregation.csv": text}
    files.write_report(args, summary(file, risk), "Pounding in a lifetime", parts, figures, csv)


def combined(file: File, lifetime: Lifetime) -> LifetimeRisk:
    """The annual rate of pounding, and the requested gaps."""
    results, place = lifetime.results, f"{file.name}: [hazard]"
    with named(place):
        hazard = lifetime.hazard.model(file)
    if lifetime.study is not None:
        return of_study(file, lifetime, lifetime.study, hazard)
    assert lifetime.fragility is not None
    curve = lifetime.fragility.model()
    with named(place):
        rate = hazard.annual_rate_of(curve, results.confidence)
    return LifetimeRisk(hazard, curve, rate, {}, results)


def of_study(
    file: File, lifetime: Lifetime, table: StudyTable, hazard: jp.HazardCurve
) -> LifetimeRisk:
    """The rate by a study, through the fragility of its runs unless the hazard has drawn them."""
    results, place = lifetime.results, f"{file.name}: [study]"
    shares, link = table.gap_probabilities or (), None if table.link is None else table.link - 1
    options: Any = {"link": link, "confidence": results.confidence}
    with named(place):
        study = table.opened(file)
        if table.drawn:
            if lifetime.hazard.unit is not None:
                raise refused("drawn", "must not be given beside [hazard] unit", "true")
            if not is_drawn((hazard.intensity, hazard.annual_rate), study):
                rule = "must not be given: this hazard is not known to have drawn the study's "
                rule += "earthquakes; leave it out, or use HazardCurve.annual_rate_of(..., "
                rule += "drawn=True) in Python if they follow it"
                raise refused("drawn", rule, "true")
            rate = hazard.annual_rate_of(study, results.confidence, gap=table.gap, link=link)
            if not rate.value:
                raise refused("store", "must hold runs with pounding to have a rate")
            gaps = {p: hazard.required_gap(study, p, results.years, **options) for p in shares}
            return LifetimeRisk(hazard, None, rate, gaps, results, table.intensity)
    column, place_of_hazard = table.intensity, f"{file.name}: [hazard]"
    study_measure = study.measure(column)
    hazard, factor = _with_unit(place_of_hazard, lifetime.hazard.unit, hazard, study_measure)
    measure = Measure.of_text(hazard.measure)
    with named(place):
        curve = study.fragility(column, table.gap, link=link)
    numbers: Any = {"median": curve.median / factor, "intensity": curve.intensity / factor}
    words = str(dataclasses.replace(study_measure, unit=measure.unit))
    curve = dataclasses.replace(curve, **numbers, measure=words)
    with named(place_of_hazard):
        rate = hazard.annual_rate_of(curve, results.confidence)
    words = str(dataclasses.replace(measure, unit=study_measure.unit))
    in_study_unit = jp.HazardCurve(hazard.intensity * factor, hazard.annual_rate, words)
    with named(place):
        options |= {"years": results.years, "intensity": column}
        gaps = {p: in_study_unit.required_gap(study, p, **options) for p in shares}
    return LifetimeRisk(hazard, curve, rate, gaps, results)


def _with_unit(
    place: str, unit: str | None, hazard: jp.HazardCurve, study_measure: Measure
) -> tuple[jp.HazardCurve, float]:
    """A hazard whose measure has a unit, and the size of this unit in that of a study's column.

    The unit is that of the key, or of the measure, or else the usual one of hazard analyses.
    """
    measure, sizes = Measure.of_text(hazard.measure), units_like(study_measure.unit)
    if not sizes:
        if unit is not None:
            rule = f"must not be given: the unit of the study's column, {study_measure}, is not "
            raise refused(f"{place} unit", f"{rule}known", f'"{unit}"')
        return hazard, 1.0
    unit_of_hazard = measure_unit(unit or "") or measure.unit or next(iter(sizes))
    stated = dataclasses.replace(measure, unit=unit_of_hazard)
    rule = f"must be one of {', '.join(sizes)}, as the study has {study_measure}"
    if clashing := measure.unit and not stated.is_in_unit_of(measure):
        rule = f'must be that of measure = "{hazard.measure}"'
    if clashing or stated.unit not in sizes:
        raise refused(f"{place} unit", rule, f'"{unit if clashing else stated.unit}"')
    factor = sizes[stated.unit] / sizes[study_measure.unit]
    return dataclasses.replace(hazard, measure=str(stated)), factor


def summary(file: File, risk: LifetimeRisk) -> dict[str, Any]:
    """The rate in numbers, for JSON."""
    rate, curve, years = risk.rate, risk.fragility, risk.results.years
    return {
        **file.origin,
        "measure": risk.hazard.measure,
        "hazard": {
            "intensity": risk.hazard.intensity.tolist(),
            "annual_rate": risk.hazard.annual_rate.tolist(),
        },
        "fragility": None if curve is None else files.of_fragility(curve),
        "confidence": risk.results.confidence,
        "annual_rate": {
            **files.of_estimate(rate),
            "cov": rate.cov,
            "from_below_the_curve": rate.below,
            "from_above_the_curve": rate.above,
            "bounds": list(rate.bounds),
        },
        "return_period_years": rate.return_period,
        "years": years,
        "probability": files.of_estimate(rate.probability(years)),
        "required_gap": {f"{p:g}": files.of_estimate(gap) for p, gap in risk.gaps.items()},
        "mean_intensity_at_pounding": risk.deaggregation.mean,
    }


def tables(risk: LifetimeRisk) -> list[TextTable]:
    """The results for people."""
    curve, years = risk.fragility, risk.results.years
    parts = risk.rate._tables(years)
    if curve is not None:
        parts += curve._tables()
    if risk.gaps:
        rows = [(f"{100 * p:g} %", str(gap)) for p, gap in risk.gaps.items()]
        columns = (f"closes within {years:g} years with probability", "required gap (m)")
        parts.append(TextTable("Required gap", columns, rows))
    return [*parts, *risk.deaggregation._tables()]
