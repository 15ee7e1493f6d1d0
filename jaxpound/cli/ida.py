"""``jaxpound ida``: an incremental dynamic analysis of buildings under a suite of records."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

import jaxpound as jp
from jaxpound._tables import Table as Shown
from jaxpound.cli.files import known, make_folder, write_figures, write_json, write_text
from jaxpound.cli.notes import noted
from jaxpound.cli.reading import Count, File, Table, between, named, says
from jaxpound.cli.results import of_fragility
from jaxpound.cli.structures import Structured
from jaxpound.model.plausibility import GAP
from jaxpound.risk.demanded import REQUIRED_GAP
from jaxpound.risk.suite_runs import demand_in_words
from jaxpound.simulation.buildings import natural_periods, record_grid

# --- the configuration --------------------------------------------------------------------------

_Numbers = Annotated[list[float], says("a list of numbers", min_length=1)]
_Ends = Annotated[tuple[float, float], says("two numbers, [low, high]")]
_RANGES = {"asce 7": jp.PeriodRange.asce_7, "en 1998": jp.PeriodRange.en_1998}


class Suite(Table):
    """The records."""

    folder: str
    pattern: str = "*.AT2"
    units: str | None = None
    dt: Annotated[float, between(1e-6, 10, "s", "a sample interval")] | None = None


class Target(Table):
    """The spectrum to which the records are scaled, and how."""

    periods: _Numbers
    accelerations: _Numbers
    damping: Annotated[float, between(0, 0.99, "", "of the critical damping")] = 0.05
    code: Literal["asce 7", "en 1998"] | None = None
    range: _Ends | None = None
    factors: _Ends = (0.25, 4.0)
    best: Annotated[int, Count] | None = None
    least: Annotated[float, between(1e-3, 10, "", "a share of the target")] | None = None

    def __post_init__(self) -> None:
        if (self.code is None) == (self.range is None):
            raise ValueError("must have the range of periods, by code or by range, not by both")

    def scaled(
        self, suite: jp.RecordSuite, first_periods: list[float], strict: bool
    ) -> jp.ScaledSuite:
        """The records scaled to the target."""
        target = jp.TargetSpectrum(self.periods, self.accelerations, self.damping)
        span = _RANGES[self.code](*first_periods) if self.code else self.range
        assert span
        return suite.scaled_to(
            target, span, self.factors, best=self.best, least=self.least, strict=strict
        )


class Increments(Table):
    """What is scaled, and until when."""

    intensities: _Numbers
    measure: Literal["pga", "sa"] = "pga"
    period: Annotated[float, between(1e-3, 60, "s", "for models and for towers")] | None = None
    demand: str = "required_gap"
    threshold: float | None = None
    refine: Literal["bisection", "newton"] = "bisection"

    def __post_init__(self) -> None:
        if self.period is not None and self.measure != "sa":
            raise ValueError('period must be given with measure = "sa" only')
        if self.demand == REQUIRED_GAP and self.threshold is not None:
            GAP.require("threshold", self.threshold)


class Analysis(Structured, kw_only=True):
    """The configuration of ``jaxpound ida``."""

    suite: Suite
    target: Target | None = None
    ida: Increments


# --- the command --------------------------------------------------------------------------------


def run(args: argparse.Namespace) -> None:
    """Run the command."""
    file = File.opened(args.config, "ida")
    given = file.read(Analysis)
    suite, scaled = records(file, given, args.strict)
    found = analysed(file, given, suite, args.strict, args.store)
    make_folder(args.out)
    curve, why = _fragility(found)
    answers = summary(file, given, suite, scaled, found, curve)
    print(found)
    print(curve or why)

    from jaxpound.plots import ida, suites
    from jaxpound.plots.style import figure

    figures = {"ida": figure(ida.curves, found), "spectra": figure(suites.spectra, scaled or suite)}
    if curve is not None:
        figures["fragility"] = figure(ida.fragility, found)
    write_json(args.out / "summary.json", answers)
    write_text(args.out / "summary.md", page(answers, scaled, found, curve, why, figures))
    write_text(args.out / "capacities.csv", _capacities(found))
    write_text(args.out / "curves.csv", _curves(found))
    write_figures(figures, args.out, args.pdf)


def records(
    file: File, given: Analysis, strict: bool = False
) -> tuple[jp.RecordSuite, jp.ScaledSuite | None]:
    """The suite that is run, and how it was scaled if there is a target."""
    table = given.suite
    with named(f"{file.name}: [suite]"):
        suite = jp.read_suite(
            file.folder / table.folder, table.pattern, units=table.units, dt=table.dt
        )
    if given.target is None:
        return suite, None
    with named(f"{file.name}: [target]"):
        scaled = given.target.scaled(suite, _first_periods(given), strict)
    return scaled.suite, scaled


def analysed(
    file: File,
    given: Analysis,
    suite: jp.RecordSuite,
    strict: bool = False,
    store: Path | None = None,
) -> jp.IncrementalDynamicAnalysis:
    """The analysis of the buildings under these records."""
    how, place = given.ida, f"{file.name}: [run]"
    finest = min(suite, key=lambda record: float(record.dt))
    longest = given.run.duration or max(float(record.duration) for record in suite)
    of_system = given.structures, given.scales, given.scheme
    grid = record_grid(place, *of_system, finest, longest, given.run.dt)
    period = how.period or max(_first_periods(given))
    with named(f"{file.name}: [ida]"), noted(given.structures):
        return jp.incremental_dynamic_analysis(
            given.structures,
            suite,
            grid,
            intensities=np.array(how.intensities),
            measure="pga" if how.measure == "pga" else period,
            demand=how.demand,
            threshold=how.threshold,
            refine=how.refine,
            scales=given.scales,
            scheme=given.scheme,
            strict=strict,
            store=store,
            progress=sys.stderr.isatty(),
        )


def _first_periods(given: Analysis) -> list[float]:
    return natural_periods(given.structures, given.scales)


def _fragility(found: jp.IncrementalDynamicAnalysis) -> tuple[jp.Fragility | None, str]:
    """The fragility of the capacities, or why there is none."""
    try:
        return found.fragility(), ""
    except ValueError as error:
        return None, f"no fragility: {str(error).partition(': ')[2]}"


# --- the report ---------------------------------------------------------------------------------


def summary(
    file: File,
    given: Analysis,
    suite: jp.RecordSuite,
    scaled: jp.ScaledSuite | None,
    found: jp.IncrementalDynamicAnalysis,
    curve: jp.Fragility | None,
) -> dict[str, Any]:
    """The analysis in numbers; infinite capacities, of records that stay below, are null."""
    of_target = None
    if scaled is not None:
        of_target = {
            "range_s": list(scaled.range),
            "factors": dict(zip(suite.names, map(float, scaled.factors), strict=True)),
            "misfits": dict(zip(suite.names, map(float, scaled.misfits), strict=True)),
            "misfit_of_mean": scaled.misfit,
            "least_ratio_of_mean": scaled.least_ratio,
            "at_bound": list(scaled.at_bound),
        }
    answers: dict[str, Any] = known(
        {
            **file.origin,
            "target": of_target,
            "measure": found.measure,
            "demand": demand_in_words(found.demand, found.si),
            "threshold": found.threshold,
            "intensities": list(map(float, found.intensities)),
            "fractiles": dict(
                zip(("0.16", "0.5", "0.84"), map(list, found.fractiles().tolist()), strict=True)
            ),
            "capacities": dict(zip(found.names, map(float, found.capacities), strict=True)),
            "factors": dict(zip(found.names, map(float, found.factors), strict=True)),
            "returning": list(found.returning),
            "fragility": of_fragility(curve),
        }
    )
    return answers


def page(
    answers: Mapping[str, Any],
    scaled: jp.ScaledSuite | None,
    found: jp.IncrementalDynamicAnalysis,
    curve: jp.Fragility | None,
    why: str,
    figures: Mapping[str, Any],
) -> str:
    """One page."""
    parts: list[Shown] = [] if scaled is None else [*scaled._tables()]
    parts += [*found._tables(), *([] if curve is None else curve._tables())]
    lines = ["# Incremental dynamic analysis", "", f"jaxpound {answers['jaxpound']}.", ""]
    for part in parts:
        notes = [f"{note[0].upper()}{note[1:]}." for note in part.notes]
        lines += [f"## {part.title}", "", part.markdown(), "", *(x for n in notes for x in (n, ""))]
    lines += [f"{why[0].upper()}{why[1:]}.", ""] if why else []
    lines += [*(f"![{name}]({name}.png)" for name in figures), ""]
    return "\n".join(lines)


def _capacities(found: jp.IncrementalDynamicAnalysis) -> str:
    """The intensity and factor at which each record reaches the threshold; empty if it does not."""
    rows = zip(found.names, found.unscaled, found.capacities, found.factors, strict=True)
    return _csv(["record", "intensity_as_it_is", "capacity", "factor"], rows)


def _curves(found: jp.IncrementalDynamicAnalysis) -> str:
    """The demand of each record at each intensity."""
    rows = (
        (name, im, demand)
        for name, demands in zip(found.names, found.demands, strict=True)
        for im, demand in zip(found.intensities, demands, strict=True)
    )
    return _csv(["record", "intensity", "demand"], rows)


def _csv(names: list[str], rows: Any) -> str:
    def cell(x: Any) -> str:
        if isinstance(x, str):
            return '"' + x.replace('"', '""') + '"'
        return repr(float(x)) if np.isfinite(x) else ""

    return "".join(",".join(row) + "\n" for row in [names, *(map(cell, row) for row in rows)])
