"""``jaxpound hazard``: how often buildings pound, from a hazard curve and a fragility or study."""

from __future__ import annotations

import argparse
import csv
import dataclasses
import io
from collections.abc import Mapping, Sequence
from typing import Annotated, Any

import numpy as np

import jaxpound as jp
from jaxpound._tables import Table as Shown
from jaxpound.cli.files import known, make_folder, write_figures, write_json, write_text
from jaxpound.cli.reading import File, Table, between, named, says, shown
from jaxpound.cli.results import of_fragility
from jaxpound.cli.tables import Gap
from jaxpound.ground.measure import UNITS, Measure, known_unit, units_like
from jaxpound.results.demand import in_words, unit_of
from jaxpound.risk.hazard_files import read_hazard
from jaxpound.risk.hazard_meets import is_drawn
from jaxpound.study.demands import is_ours
from jaxpound.study.statistics import Estimate

# --- the configuration --------------------------------------------------------------------------

_Numbers = Annotated[list[float], says("a list of two numbers or more", min_length=2)]

_OF_SHAKING = ("pga", "pgv")  # of a study's demands

_Site = Annotated[
    Annotated[int, between(1, 2**31)] | str,
    says("the row of a site, from 1, or its name"),
]
_Shares = Annotated[
    list[Annotated[float, between(1e-9, 0.999, "", "a probability")]],
    says("a list of probabilities", min_length=1),
]
_Positive = between(1e-12, 1e12, "", "of the hazard's intensities")
_Dispersion = between(1e-3, 10, "", "a standard deviation of the logarithm")


class Curve(Table):
    """The hazard curve, by its points or by a file."""

    intensity: _Numbers | None = None
    annual_rate: _Numbers | None = None
    measure: str | None = None
    unit: str | None = None
    file: str | None = None
    site: _Site | None = None

    def __post_init__(self) -> None:
        points = [key for key in ("intensity", "annual_rate") if getattr(self, key) is not None]
        if self.file is not None and points:
            raise ValueError(f"{points[0]} must not be given beside file")
        if self.file is None and len(points) < 2:
            raise ValueError("must have intensity and annual_rate, or file")
        if self.site is not None and self.file is None:
            raise ValueError("site must be given with file only")
        if self.unit is not None and not known_unit(self.unit):
            raise ValueError(f"unit = {shown(self.unit)} must be one of {', '.join(UNITS)}")

    def model(self, file: File) -> jp.HazardCurve:
        """The library's ``HazardCurve``."""
        if self.file is not None:
            found = jp.HazardCurve(*read_hazard(file.folder / self.file, self.site, first=1))
        else:
            assert self.intensity is not None
            assert self.annual_rate is not None
            found = jp.HazardCurve(np.array(self.intensity), np.array(self.annual_rate))
        return found if self.measure is None else dataclasses.replace(found, measure=self.measure)


class Stated(Table):
    """A fragility in numbers."""

    median: Annotated[float, _Positive]
    dispersion: Annotated[float, _Dispersion]
    median_error: Annotated[float, between(0, 1e12, "", "a standard error")] | None = None
    dispersion_error: Annotated[float, between(0, 10, "", "a standard error")] | None = None

    def __post_init__(self) -> None:
        if (self.median_error is None) != (self.dispersion_error is None):
            raise ValueError("must have median_error and dispersion_error, both or none")
        for name in ("median", "dispersion"):
            value, error = getattr(self, name), getattr(self, f"{name}_error") or 0.0
            if error > value:
                rule = f"at most the {name} itself, {value:g}"
                raise ValueError(f"{name}_error = {error:g} must be {rule}")

    def model(self) -> jp.Fragility:
        """The library's ``Fragility``, without data."""
        errors = [np.nan, np.nan]
        if self.median_error is not None and self.dispersion_error is not None:
            errors = [self.median_error / self.median, self.dispersion_error]
        return jp.Fragility(self.median, self.dispersion, np.diag(np.square(errors)))


class Stored(Table):
    """A study to whose runs a fragility is fitted, or whose earthquakes the hazard has drawn."""

    store: str
    intensity: str = "pga"
    gap: Gap | None = None
    link: Annotated[int, between(1, 2**31)] | None = None
    gap_probabilities: _Shares | None = None
    drawn: bool = False

    def opened(self, file: File) -> jp.Study:
        """The study; a ``ValueError`` if it has no such column or link."""
        study = jp.Study.open(file.folder / self.store)
        study.moments(self.intensity)
        if is_ours(self.intensity) and self.intensity not in _OF_SHAKING:
            rule = "measure the shaking, such as pga, and not the response"
            raise ValueError(f'intensity = "{self.intensity}" must {rule}')
        if self.link is not None:
            rule = f"one of the study's links, from 1 to {study.n_links}"
            if self.link > study.n_links:
                raise ValueError(f"link = {self.link} must be {rule}")
            if not study.finite(f"min_gap_{self.link}" if study.n_links > 1 else "min_gap").size:
                raise ValueError(f"link = {self.link} must be a link with a gap")
        return study

    @property
    def number(self) -> int | None:
        """The link, from 0."""
        return None if self.link is None else self.link - 1


class Results(Table):
    """What is told."""

    years: Annotated[float, between(1e-3, 1e6, "years", "of a building's life")] = 50.0
    bands: Annotated[int, between(1, 1000)] = 20
    confidence: Annotated[float, between(0.01, 0.9999, "", "of an interval")] = 0.95


class Lifetime(Table):
    """The configuration of ``jaxpound hazard``."""

    hazard: Curve
    fragility: Stated | None = None
    study: Stored | None = None
    results: Results = Results()

    def __post_init__(self) -> None:
        if (self.fragility is None) == (self.study is None):
            raise ValueError("must have the table [fragility] or the table [study], one of them")
        if self.hazard.unit is not None and self.study is None:
            rule = "must be given with [study] only: a [fragility] is in the hazard's own unit"
            raise ValueError(f"[hazard] unit {rule}")


@dataclasses.dataclass(frozen=True)
class Found:
    """What follows from hazard and fragility."""

    hazard: jp.HazardCurve
    fragility: jp.Fragility | None
    """None if the hazard has drawn the study's earthquakes."""
    rate: jp.AnnualRate
    gaps: Mapping[float, Estimate]
    """Required gaps by their probabilities within the years."""
    results: Results
    column: str | None = None
    """Without a fragility the study's column that measures the shaking."""

    @property
    def deaggregation(self) -> jp.Deaggregation:
        """The rate by bands of intensity."""
        return self.rate.deaggregation(bands=self.results.bands, intensity=self.column)


# --- the command --------------------------------------------------------------------------------


def run(args: argparse.Namespace) -> None:
    """Run the command."""
    file = File.opened(args.config, "hazard")
    given = file.read(Lifetime)
    found = combined(file, given)
    make_folder(args.out)
    for table in tables(found):
        print(table.text())

    from jaxpound.plots import hazards, studies
    from jaxpound.plots.style import drawn

    by: Any = {"bands": found.results.bands, "intensity": found.column}
    figures = {"hazard": drawn(hazards.pounding, found.hazard, found.rate, **by)}
    if found.fragility is not None and found.fragility.intensity.size:
        figures["fragility"] = drawn(
            studies.fragility, found.fragility, intensity=found.hazard.measure
        )
    write_json(args.out / "summary.json", summary(file, found))
    write_text(args.out / "summary.md", page(found, figures))
    write_text(args.out / "deaggregation.csv", _csv(found.deaggregation))
    write_figures(figures, args.out, args.pdf)


def combined(file: File, given: Lifetime) -> Found:
    """The annual rate of pounding, and the gaps that are asked for."""
    place = f"{file.name}: [hazard]"
    with named(place):
        hazard = given.hazard.model(file)
    if given.study is not None:
        return of_study(file, given, given.study, hazard)
    assert given.fragility is not None
    curve = given.fragility.model()
    with named(place):
        rate = hazard.annual_rate_of(curve, given.results.confidence)
    return Found(hazard, curve, rate, {}, given.results)


def of_study(file: File, given: Lifetime, stored: Stored, hazard: jp.HazardCurve) -> Found:
    """The same by a study, through the fragility of its runs unless the hazard has drawn them."""
    results, place = given.results, f"{file.name}: [study]"
    with named(place):
        study = stored.opened(file)
        if stored.drawn:
            if given.hazard.unit is not None:
                raise ValueError("drawn = true must not be given beside [hazard] unit")
            if not is_drawn((hazard.intensity, hazard.annual_rate), study):
                rule = "this hazard is not known to have drawn the study's earthquakes"
                raise ValueError(f"drawn = true must not be given: {rule}; leave it out")
            return straight(hazard, stored, study, results)
    column = stored.intensity
    theirs = Measure(in_words(column), unit_of(column, study.scales is not None))
    hazard, factor = _measured(f"{file.name}: [hazard]", given.hazard.unit, hazard, theirs)
    ours = Measure.of_text(hazard.measure)
    with named(place):
        curve = study.fragility(column, stored.gap, link=stored.number)
    curve = dataclasses.replace(
        curve,
        median=curve.median / factor,
        intensity=curve.intensity / factor,
        unit=ours.unit,
        measure=str(dataclasses.replace(theirs, unit=ours.unit)),
    )
    with named(f"{file.name}: [hazard]"):
        rate = hazard.annual_rate_of(curve, results.confidence)
    in_their_unit = jp.HazardCurve(
        hazard.intensity * factor,
        hazard.annual_rate,
        str(dataclasses.replace(ours, unit=theirs.unit)),
    )
    with named(place):
        gaps = {
            share: in_their_unit.required_gap(
                study,
                share,
                results.years,
                intensity=column,
                link=stored.number,
                confidence=results.confidence,
            )
            for share in stored.gap_probabilities or ()
        }
    return Found(hazard, curve, rate, gaps, results)


def straight(hazard: jp.HazardCurve, stored: Stored, study: jp.Study, results: Results) -> Found:
    """The same by a study whose earthquakes the hazard has drawn."""
    link, confidence = stored.number, results.confidence
    rate = hazard.annual_rate_of(study, confidence, gap=stored.gap, link=link)
    if not rate.value:
        raise ValueError("store must hold runs with pounding, for its rate to be told")
    gaps = {
        share: hazard.required_gap(study, share, results.years, link=link, confidence=confidence)
        for share in stored.gap_probabilities or ()
    }
    return Found(hazard, None, rate, gaps, results, stored.intensity)


def _measured(
    place: str, unit: str | None, hazard: jp.HazardCurve, theirs: Measure
) -> tuple[jp.HazardCurve, float]:
    """A hazard whose measure tells its unit, and that unit in the one of a study's column.

    The unit is that of the key, or of the measure, or else the usual one of hazard analyses.
    """
    ours, sizes = Measure.of_text(hazard.measure), units_like(theirs.unit)
    if not sizes:
        if unit is not None:
            rule = f"must not be given: the unit of the study's column, {theirs}, is not known"
            raise ValueError(f'{place} unit = "{unit}" {rule}')
        return hazard, 1.0
    stated = dataclasses.replace(
        ours, unit=known_unit(unit or "") or ours.unit or next(iter(sizes))
    )
    if ours.unit and not stated.is_in_unit_of(ours):
        raise ValueError(f'{place} unit = "{unit}" must be that of measure = "{hazard.measure}"')
    if stated.unit not in sizes:
        rule = f"must be one of {', '.join(sizes)}, as the study has {theirs}"
        raise ValueError(f'{place} unit = "{stated.unit}" {rule}')
    factor = sizes[stated.unit] / sizes[theirs.unit]
    return dataclasses.replace(hazard, measure=str(stated)), factor


# --- the report ---------------------------------------------------------------------------------


def summary(file: File, found: Found) -> dict[str, Any]:
    """The rate in numbers, for JSON."""
    rate, curve, years = found.rate, found.fragility, found.results.years
    answers: dict[str, Any] = known(
        {
            **file.origin,
            "measure": found.hazard.measure,
            "hazard": {
                "intensity": found.hazard.intensity.tolist(),
                "annual_rate": found.hazard.annual_rate.tolist(),
            },
            "fragility": of_fragility(curve),
            "confidence": found.results.confidence,
            "annual_rate": {
                "value": rate.value,
                "low": rate.low,
                "high": rate.high,
                "cov": rate.cov,
                "from_below_the_curve": rate.below,
                "from_above_the_curve": rate.above,
                "bounds": list(rate.bounds),
            },
            "return_period_years": rate.return_period,
            "years": years,
            "probability": _interval(rate.probability(years)),
            "required_gap": {f"{p:g}": _interval(gap) for p, gap in found.gaps.items()},
            "mean_intensity_at_pounding": found.deaggregation.mean,
        }
    )
    return answers


def _interval(found: Estimate) -> dict[str, float]:
    return {"value": found.value, "low": found.low, "high": found.high}


def tables(found: Found) -> list[Shown]:
    """The results for people."""
    rate, curve, years = found.rate, found.fragility, found.results.years
    (of_rate,) = rate._tables(years)
    parts = [of_rate]
    if curve is not None:
        numbers = [
            ("median", _with_error(curve.median, curve.median_error)),
            ("dispersion", _with_error(curve.dispersion, curve.dispersion_error)),
        ]
        parts.append(Shown(f"Fragility by {found.hazard.measure}", (), numbers))
    if found.gaps:
        rows = [(f"{100 * p:g} %", str(gap)) for p, gap in found.gaps.items()]
        columns = (f"closes within {years:g} years with probability", "required gap (m)")
        parts.append(Shown("Required gap", columns, rows))
    return [*parts, *found.deaggregation._tables()]


def _with_error(value: float, error: float) -> str:
    return f"{value:.4g} ± {error:.2g}" if np.isfinite(error) else f"{value:.4g}"


def page(found: Found, figures: Mapping[str, Any]) -> str:
    """One page."""
    what = "probability in an earthquake" if found.fragility is None else "fragility"
    lines = ["# Pounding in a lifetime", "", f"jaxpound {jp.__version__}.", ""]
    for part in tables(found):
        notes = ". ".join(part.notes).replace(",. ", ", ")  # a note may go on in the next
        table = part if any(part.columns) else part._replace(columns=("quantity", "value"))
        lines += [f"## {part.title}", "", table.markdown(), ""]
        lines += [f"{notes[0].upper()}{notes[1:]}.", ""] if notes else []
    lines += [
        "Earthquakes with pounding are taken for a Poisson process. The interval is that of the "
        f"{what}; the hazard curve is taken as known.",
        "",
        *(f"![{name}]({name}.png)" for name in figures),
        "",
    ]
    return "\n".join(lines)


def _csv(found: jp.Deaggregation) -> str:
    """The rate by bands of intensity."""
    text = io.StringIO()
    cov = [x if np.isfinite(x) else "" for x in found.cov]
    numbers = (found.edges[:-1], found.edges[1:], found.rate, found.share)
    rows: Sequence[Any] = list(zip(*(x.tolist() for x in numbers), cov, strict=True))
    writer = csv.writer(text, lineterminator="\n")
    writer.writerows([("from", "to", "annual_rate", "share", "cov"), *rows])
    return text.getvalue()
