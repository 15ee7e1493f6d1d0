"""``jaxpound design``: dampers and rods that keep buildings apart, chosen by gradients."""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from msgspec import field
from msgspec.structs import astuple

import jaxpound as jp
from jaxpound.cli.buildings import as_toml
from jaxpound.cli.design_report import answer_of, summary, tables_of
from jaxpound.cli.files import VERSION, kept_search, write_files, write_report
from jaxpound.cli.parameters import Parameters, VariableBounds, design_space
from jaxpound.cli.reading import Count, File, Range, Section, Seed, between, named, refused, says
from jaxpound.cli.structures import Shaken
from jaxpound.cli.tables import Files, Gap, OfClass, read_records
from jaxpound.design.problem import DesignProblem
from jaxpound.reliability.result import RAREST
from jaxpound.results.named import threshold_range

_Temperature = Annotated[float, between(1e-9, 10, "m", "of the soft minimum of gaps")]
_SHARE = '"worst", "mean" or a share'
_Share = Annotated[float, between(1e-6, 1, "", "of the earthquakes")]
_Over = Annotated[str | _Share, says(_SHARE)]
_OfGaps = Literal["mean gap", "worst gap", "soft minimum", "CVaR"]


class ObjectiveTable(OfClass):
    """The goal: a function of the smallest gaps, or a demand that is to be least."""

    CLASSES: ClassVar = {
        "mean gap": partial(jp.SmallestGap, "mean"),
        "worst gap": partial(jp.SmallestGap, "worst"),
        "soft minimum": jp.design.SoftMinimum,
        "CVaR": lambda share=0.1: jp.SmallestGap(share),
        "pounding probability": jp.PoundingProbability,
        "gap at rest": jp.design.GapAtRest,
        "least demand": jp.design.LeastDemand,
    }
    goal: Literal[_OfGaps, "pounding probability", "gap at rest", "least demand"] = "mean gap"
    temperature: _Temperature | None = None
    share: _Share | None = None
    gap: Gap | None = None
    demand: str | None = None
    over: _Over | None = None


class AtMost(Section):
    """The bound of a demand in some of the earthquakes, or by probability in a random one."""

    at_most: float | None = None
    over: _Over = "worst"
    probability: Annotated[float, between(RAREST, 0.5, "", "in one earthquake")] | None = None


class Weighted(Section):
    """The weight of a demand, and the statistic over the earthquakes that is penalised."""

    weight: float
    over: _Over = "mean"


_BOUND = f"a number, {{at_most = ..., over = {_SHARE}}} or {{at_most = ..., probability = ...}}"
_PENALTY = Range(0, 1e9, "", "metres of the goal for a unit of the demand")
_AtMost = Annotated[float | AtMost, says(_BOUND)]
_Weighted = Annotated[float | Weighted, says(f"a number, or {{weight = ..., over = {_SHARE}}}")]


class RecordedTable(Section):
    """Recorded earthquakes in addition to the random ones."""

    files: Files
    units: str | None = None


class SearchTable(Section):
    """Options of the search, and how many other random earthquakes the design is evaluated on."""

    earthquakes: Annotated[int, Count] = 256
    fresh: Annotated[int, between(0, 2**31)] = 1000
    starts: Annotated[int, Count] | None = None
    iterations: Annotated[int, Count] | None = None
    batch: Annotated[int, Count] | None = None
    seed: Annotated[int, Seed] = 0

    def model(self) -> jp.DesignSearch:
        """The search; an omitted option has its default."""
        options = self.stated() | {"key": self.seed}
        names = {"starts", "iterations", "batch", "key"} & options.keys()
        return jp.DesignSearch(**{name: options[name] for name in names})


Chosen = Annotated[VariableBounds, says('{low = ..., high = ..., scale = "linear" or "log"}')]


class DesignConfig(Shaken):
    """The configuration of ``jaxpound design``."""

    recorded: RecordedTable | None = None
    variables: dict[str, Chosen] = field(default_factory=dict)
    objective: ObjectiveTable = ObjectiveTable()
    limits: dict[str, _AtMost] = field(default_factory=dict)
    penalties: dict[str, _Weighted] = field(default_factory=dict)
    search: SearchTable = SearchTable()


def run(args: argparse.Namespace) -> None:
    """Run the command."""
    file = File.opened(args.config, "design")
    config = file.read(DesignConfig)
    problem, records = prepared(file, config, args.record)
    inputs = file.text.encode(), *(path.read_bytes() for path in args.record)
    shaken = problem.ensemble, problem.grid, problem.scheme
    with kept_search(args, "save", "search.npz", *inputs):
        with named(f"{file.name}: [search]"):
            design = jp.design_damper(
                *(problem.space, *shaken, problem.objective),
                search=config.search.model(),
                fresh=config.search.fresh or None,
                save=args.save,
                progress=sys.stderr.isatty(),
                strict=args.strict,
            )
        recorded = {name: design.compare(single) for name, single in records.items()}
        answer = answer_of(design, Parameters(config.layout))
        answers, tables = summary(design, answer, recorded), tables_of(design, answer, recorded)
        print("\n".join(table.text() for table in tables))
        buildings = as_toml(design.structures)
        write_files(args.out, {"design.toml": file.text, "buildings.toml": buildings})

        from jaxpound.plots import designs as plots
        from jaxpound.plots.style import drawn

        compared = design.trained if design.fresh is None else design.fresh
        figures = {"convergence": drawn(plots.convergence, design)}
        figures["before_and_after"] = drawn(plots.before_and_after, compared)
        if (demand := design.objective_function.demand) == "min_gap" and config.layout.has_contact:
            demand = "peak_impulse"
        with contextlib.suppress(ValueError):  # what is zero has no elasticity
            slopes = jp.elasticities(design.structures, *shaken, demand=demand)
            figures["elasticities"] = drawn(plots.tornado, slopes)
        if design.space.dimension > 1:
            figures["landscape"] = drawn(plots.landscape, design)
        parts: list[Any] = [VERSION, *tables]
        write_report(args, file.origin | answers, "Design of buildings", parts, figures)


def prepared(
    file: File, config: DesignConfig, paths: Sequence[Path] = ()
) -> tuple[DesignProblem, dict[str, jp.Ensemble]]:
    """A file's design problem, and each recorded earthquake alone, by name.

    ``paths`` are accelerograms in g that join the earthquakes of the file.
    """
    if not config.variables:
        raise ValueError(f"{file.name}: [variables] must name what may be chosen")
    constant = config.objective.goal == "gap at rest" and not config.penalties
    if constant and not any("gap" in name for name in config.variables):
        rule = "must be given with a gap at rest, such as link.1.gap, among the [variables]"
        raise refused(f"{file.name}: [objective] goal", rule, '"gap at rest"')
    parameters, objective = Parameters(config.layout), objective_of(file.name, config)
    space = design_space(f"{file.name}: [variables]", config.variables, parameters)
    recorded = _recorded(file, config.recorded, paths)
    ground, grid = config.shaking(file, recorded.values())
    with named(f"{file.name}: [search] earthquakes:"):
        scenarios = jp.Scenarios(config.buildings, ground)
        ensemble = jp.Ensemble.drawn(scenarios, config.search.earthquakes, config.search.seed)
    with named(f"{file.name}:"):
        if recorded:
            ensemble = ensemble.including([*recorded.values()], grid)
        problem = DesignProblem(space, ensemble, grid, config.run.scheme, objective)
        return problem, {name: jp.Ensemble.of([x], grid) for name, x in recorded.items()}


def _recorded(
    file: File, table: RecordedTable | None, paths: Sequence[Path]
) -> dict[str, jp.Record]:
    """Recorded earthquakes of the file, and others in g, by name."""
    files, units = (table.files, table.units) if table else ([], None)
    motions = read_records(f"{file.name}: [recorded] files", file.folder, files, units)
    motions += [jp.read_record(path) for path in paths]
    if not motions:
        return {}
    with named("records:"):
        suite = jp.RecordSuite(tuple(motions))
    return dict(zip(suite.names, suite, strict=True))


def objective_of(name: str, config: DesignConfig) -> jp.Objective:
    """The library's ``Objective``; ``name`` is the name of the file."""
    kinds = {"limits": jp.design.Limit, "penalties": jp.design.Penalty}
    by_demand: dict[str, dict[str, Any]] = {table: {} for table in kinds}
    for table, kind in kinds.items():
        for demand, x in getattr(config, table).items():
            place = f"{name}: [{table}] {demand}"
            number, *more = [x] if isinstance(x, float) else astuple(x)
            if number is not None:
                within = threshold_range(demand) if table == "limits" else _PENALTY
                within.require(place, number)
            with named(f"{place}:"):
                by_demand[table][demand] = kind(number, *more)
    with named(f"{name}: [objective]"):
        return jp.Objective(config.objective.model(), **by_demand)
