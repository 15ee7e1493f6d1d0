"""``jaxpound hazard``: how often buildings pound, from a hazard curve and a fragility or study."""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple

import numpy as np

import jaxpound as jp
from jaxpound._errors import renamed
from jaxpound._tables import TextTable
from jaxpound.cli import files
from jaxpound.cli.reading import Count, File, Form, Numbers, Section, between, named, refused, says
from jaxpound.cli.tables import Gap
from jaxpound.ground.measure import Measure, units_like
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
        self.require_form(Form(("intensity", "annual_rate")), Form(("file",), ("site",)))
        self.refuse_any(("unit",), 'must be written in measure, such as measure = "PGA (g)"')

    def model(self, file: File) -> jp.HazardCurve:
        """The library's ``HazardCurve``."""
        points: Any = self.intensity, self.annual_rate, "im"
        if self.file is not None:
            path = file.folder / self.file
            with renamed(str(path)):
                points = read_hazard(path, self.site, first=1)
        intensity, annual_rate, measure = points
        return jp.HazardCurve(intensity, annual_rate, self.measure or measure)


class FragilityTable(Section):
    """A fragility in numbers."""

    median: Annotated[float, between(1e-12, 1e12, "", "of the hazard's intensities")]
    dispersion: Annotated[float, between(1e-3, 10, "", "a standard deviation of the logarithm")]
    median_error: Annotated[float, between(0, 1e12, "", _Error)] | None = None
    dispersion_error: Annotated[float, between(0, 10, "", _Error)] | None = None

    def __post_init__(self) -> None:
        curve = ("median", "dispersion")
        self.require_form(Form(curve), Form((*curve, "median_error", "dispersion_error")))
        for name in curve:
            if (error := getattr(self, f"{name}_error") or 0.0) > (number := getattr(self, name)):
                rule = f"must be at most the {name} itself, {number:g}"
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
        if self.link not in (None, *(links := [k + 1 for k in study.closable_links])):
            rule = f"must be one of the study's links with a gap, {', '.join(map(str, links))}"
            raise refused("link", rule, str(self.link))
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
        self.require_form(Form(("fragility",)), Form(("study",)))


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
        return self.rate.deaggregation(self.results.bands, intensity=self.column)


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
    table, results, of_hazard = lifetime.study, lifetime.results, f"{file.name}: [hazard]"
    with named(of_hazard):
        hazard = lifetime.hazard.model(file)
    if table is None:
        assert lifetime.fragility is not None
        curve = lifetime.fragility.model()
        with named(of_hazard):
            rate = hazard.annual_rate_of(curve, results.confidence)
        return LifetimeRisk(hazard, curve, rate, {}, results)
    link, of_study, fragility = table.link and table.link - 1, f"{file.name}: [study]", None
    column, confidence = table.intensity, results.confidence
    with named(of_study):
        study = table.opened(file)
        if table.drawn:
            rate = hazard.annual_rate_of(study, confidence, gap=table.gap, link=link)
            if not rate.value:
                raise refused("store", "must hold runs with pounding to have a rate")
        else:
            fragility = study.fragility(column, table.gap, link=link)
    if fragility is not None:
        with named(of_hazard):
            hazard, fragility = in_one_unit(hazard, fragility)
            rate = hazard.annual_rate_of(fragility, confidence)
    options: Any = {"link": link, "confidence": confidence}
    options["intensity"] = None if fragility is None else column
    with named(of_study):
        shares = table.gap_probabilities or ()
        gaps = {p: hazard.required_gap(study, p, results.years, **options) for p in shares}
    drawn = None if fragility else table.intensity
    return LifetimeRisk(hazard, fragility, rate, gaps, results, drawn)


def in_one_unit(
    hazard: jp.HazardCurve, fragility: jp.study.Fragility
) -> tuple[jp.HazardCurve, jp.study.Fragility]:
    """Both in the hazard's unit, which is the usual one of hazard analyses if it states none."""
    measure, units = Measure.of_text(hazard.measure), [*units_like(fragility.unit)]
    if units and not measure.unit:
        measure = dataclasses.replace(measure, unit=units[0])
        hazard = dataclasses.replace(hazard, measure=str(measure))
    return hazard, fragility.in_unit(measure.unit) if measure.unit in units else fragility


def summary(file: File, risk: LifetimeRisk) -> dict[str, Any]:
    """The rate in numbers, for JSON."""
    rate, curve, years = risk.rate, risk.fragility, risk.results.years
    return {
        **file.origin,
        "measure": risk.hazard.measure,
        "hazard": {x: getattr(risk.hazard, x) for x in ("intensity", "annual_rate")},
        "fragility": None if curve is None else files.of_fragility(curve),
        "confidence": risk.results.confidence,
        "annual_rate": {
            **{key: getattr(rate, key) for key in ("value", "low", "high", "cov")},
            "from_below_the_curve": rate.below,
            "from_above_the_curve": rate.above,
            "bounds": rate.bounds,
        },
        "return_period_years": rate.return_period,
        "years": years,
        "probability": rate.probability(years)._asdict(),
        "required_gap": {f"{p:g}": gap._asdict() for p, gap in risk.gaps.items()},
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
