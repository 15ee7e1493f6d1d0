"""``jaxpound ida``: an incremental dynamic analysis of buildings under a suite of records."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

import jaxpound as jp
from jaxpound._errors import InvalidInput
from jaxpound.cli.files import VERSION, csv_text, make_folder, of_fragility, sentence, write_report
from jaxpound.cli.reading import Count, File, Form, Range, Section, between, named, refused, says
from jaxpound.cli.structures import Structured
from jaxpound.cli.tables import SampleInterval, WaveSection
from jaxpound.hazard.ida import FRACTILES
from jaxpound.results.named import demand_in_words, threshold_range
from jaxpound.simulation.time_steps import natural_periods, record_grid

_Numbers = Annotated[list[float], says("a list of numbers", min_length=1)]
_LEVELS = Range(1e-6, 100, "g", "twenty times the strongest PGA that was recorded")
_Level = Annotated[float, between(*_LEVELS)]
_Levels = Annotated[list[_Level], says(f"a list of numbers {_LEVELS.rule}", min_length=1)]
_Ends = Annotated[tuple[float, float], says("two numbers, [low, high]")]
_RANGES = {"asce 7": jp.ground.PeriodRange.asce_7, "en 1998": jp.ground.PeriodRange.en_1998}


class SuiteTable(Section):
    """The records."""

    folder: str
    pattern: str = "*"
    component: int | str = "both"
    rows: str | None = None
    units: str | None = None
    dt: SampleInterval | None = None


class TargetTable(Section):
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
        self.require_form(Form(("code",)), Form(("range",)))  # of periods


class LadderTable(Section):
    """The intensities, and the demand and threshold that they are scaled to reach."""

    intensities: _Levels
    measure: Literal["pga", "sa"] = "pga"
    period: Annotated[float, between(1e-3, 60, "s", "for models and for towers")] | None = None
    demand: str = "required_gap"
    threshold: float | None = None

    def __post_init__(self) -> None:
        if self.period is not None and self.measure != "sa":
            raise refused("period", 'must be given with measure = "sa" only')
        if self.threshold is not None:
            threshold_range(self.demand).require("threshold", self.threshold)


class IdaConfig(Structured, kw_only=True):
    """The configuration of ``jaxpound ida``."""

    suite: SuiteTable
    target: TargetTable | None = None
    ida: LadderTable
    wave: WaveSection | None = None


def run(args: argparse.Namespace) -> None:
    """Run the command."""
    file = File.opened(args.config, "ida")
    config = file.read(IdaConfig)
    suite, scaled = records(file, config, args.strict)
    analysis = analysed(file, config, suite, args.strict, args.store)
    make_folder(args.out)
    curve, remarks = None, []
    try:
        curve = analysis.fragility()
    except InvalidInput as error:
        remarks = [f"no fragility: {error.replaced(owner='')}"]
    print(analysis)
    print(curve or remarks[0])

    from jaxpound.plots import ida, studies
    from jaxpound.plots.records import suite_spectra
    from jaxpound.plots.style import drawn

    figures = {"ida": drawn(ida.curves, analysis)}
    figures["spectra"] = drawn(suite_spectra, scaled or suite)
    tables = [*(scaled._tables() if scaled else ()), *analysis._tables()]
    if curve is not None:
        measure = ida.in_symbols(analysis.measure)
        figures["fragility"] = drawn(studies.fragility, curve, intensity=measure)
        tables += curve._tables()
    parts = [VERSION, *tables, *map(sentence, remarks)]
    capacities = {"record": analysis.names, "intensity_as_it_is": analysis.unscaled}
    capacities |= {"capacity": analysis.capacities, "factor": analysis.factors}
    n, k = analysis.demands.shape
    curves = {"record": np.repeat(analysis.names, k), "intensity": np.tile(analysis.intensities, n)}
    curves |= {"demand": analysis.demands.ravel()}
    files = {"capacities.csv": csv_text(capacities), "curves.csv": csv_text(curves)}
    answers = summary(file, suite, scaled, analysis, curve)
    write_report(args, answers, "Incremental dynamic analysis", parts, figures, files)


def records(
    file: File, config: IdaConfig, strict: bool = False
) -> tuple[jp.RecordSuite, jp.ground.ScaledSuite | None]:
    """The suite that is run, and how it was scaled if there is a target."""
    table, folder = config.suite, file.folder / config.suite.folder
    with named(f"{file.name}: [suite]"):
        options = {key: x for key, x in table.stated().items() if key != "folder"}
        suite = jp.read_suite(folder, **options, strict=strict)
    if (to := config.target) is None:
        return suite, None
    with named(f"{file.name}: [target]"):
        span: Any = _RANGES[to.code](*natural_periods(config.buildings)) if to.code else to.range
        target = jp.ground.TargetSpectrum(to.periods, to.accelerations, to.damping)
        chosen: Any = {"best": to.best, "least": to.least}
        scaled = suite.scaled_to(target, span, to.factors, **chosen, strict=strict)
    return scaled.suite, scaled


def analysed(
    file: File,
    config: IdaConfig,
    suite: jp.RecordSuite,
    strict: bool = False,
    store: Path | None = None,
) -> jp.hazard.IncrementalDynamicAnalysis:
    """The analysis of the buildings under these records."""
    ladder, run, buildings = config.ida, config.run, config.buildings
    wave = {} if config.wave is None else config.wave.stated()
    shaking: list[Any] = [jp.travelling(x, **wave) for x in suite] if wave else [*suite]
    parts = [part for ground in shaking for part in ground.parts()]
    options = run.scheme, parts, run.duration, run.dt
    grid = record_grid(buildings, *options, place=f"{file.name}: [run]")
    period = ladder.period or max(natural_periods(buildings))
    with named(f"{file.name}: [ida]"):
        analysis = jp.Analysis(
            buildings,
            suite,
            grid,
            measure="pga" if ladder.measure == "pga" else period,
            demand=ladder.demand,
            threshold=ladder.threshold,
            **wave,
            scheme=run.scheme,
            strict=strict,
        )
        return jp.incremental_dynamic_analysis(
            analysis, ladder.intensities, store=store, progress=sys.stderr.isatty()
        )


def summary(
    file: File,
    suite: jp.RecordSuite,
    scaled: jp.ground.ScaledSuite | None,
    analysis: jp.hazard.IncrementalDynamicAnalysis,
    curve: jp.study.Fragility | None,
) -> dict[str, Any]:
    """The analysis in numbers; infinite capacities, of records that stay below, are null."""

    def by_name(numbers: np.ndarray) -> dict[str, float]:
        return dict(zip(suite.names, numbers.tolist(), strict=True))

    of_target = scaled and {
        "range_s": list(scaled.range),
        "factors": by_name(scaled.factors),
        "misfits": by_name(scaled.misfits),
        "misfit_of_mean": scaled.misfit,
        "least_ratio_of_mean": scaled.least_ratio,
        "at_bound": list(scaled.at_bound),
    }
    return {
        **file.origin,
        "target": of_target,
        "measure": analysis.measure,
        "demand": demand_in_words(analysis.demand, analysis.topology),
        "threshold": analysis.threshold,
        "intensities": analysis.intensities.tolist(),
        "fractiles": dict(zip(map(str, FRACTILES), analysis.fractiles().tolist(), strict=True)),
        "capacities": by_name(analysis.capacities),
        "factors": by_name(analysis.factors),
        "returning": list(analysis.returning),
        "fragility": None if curve is None else of_fragility(curve),
    }
