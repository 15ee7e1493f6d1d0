"""``jaxpound design``: dampers and rods that keep buildings apart, chosen by gradients."""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

from msgspec import field
from msgspec.structs import astuple

import jaxpound as jp
from jaxpound._checks import did_you_mean
from jaxpound.cli import reading
from jaxpound.cli.buildings import BuildingsLayout, as_toml
from jaxpound.cli.design_report import answer_of, summary, tables_of
from jaxpound.cli.files import VERSION, kept_search, write_files, write_report
from jaxpound.cli.parameters import Parameters, VariableBounds, design_space
from jaxpound.cli.reading import Count, File, Range, Section, Seed, between, named, refused, says
from jaxpound.cli.structures import Shaken
from jaxpound.cli.tables import OF_DEMANDS, Files, Gap, OfClass, read_records
from jaxpound.reliability.result import RAREST
from jaxpound.results import named as demands
from jaxpound.results.named import REQUIRED_GAP

_Temperature = Annotated[float, between(1e-9, 10, "m", "of the soft minimum of gaps")]
_SHARE = '"worst", "mean" or a share'
_Share = Annotated[float, between(1e-6, 1, "", "of the earthquakes")]
_Over = Annotated[str | _Share, says(_SHARE)]
_OfGaps = Literal["mean gap", "worst gap", "soft minimum", "CVaR"]


class ObjectiveTable(OfClass):
    """The goal: a function of the smallest gaps, or a demand that is to be least."""

    CLASSES: ClassVar = {
        "mean gap": jp.MeanGap,
        "worst gap": jp.design.WorstGap,
        "soft minimum": jp.design.SoftMinimum,
        "CVaR": jp.design.CVaR,
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
_AtMost = Annotated[float | AtMost, says(_BOUND)]
_Weighted = Annotated[float | Weighted, says(f"a number, or {{weight = ..., over = {_SHARE}}}")]
_PENALTY = Range(0, 1e9, "", "metres of the goal for a unit of the demand")


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
    task = prepared(file, config, args.record)
    inputs = file.text.encode(), *(path.read_bytes() for path in args.record)
    shaken = task.ensemble, task.grid, config.run.scheme
    with kept_search(args, "save", "search.npz", *inputs):
        design = jp.design_damper(
            *(task.space, *shaken, task.objective),
            search=config.search.model(),
            fresh=config.search.fresh or None,
            save=args.save,
            progress=sys.stderr.isatty(),
            strict=args.strict,
        )
        recorded = {name: design.compare(single) for name, single in task.recorded.items()}
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
        if (demand := design.objective_function.demand) == "min_gap" and config.layout.laws:
            demand = "peak_impulse"
        with contextlib.suppress(ValueError):  # what is zero has no elasticity
            slopes = jp.elasticities(design.structures, *shaken, demand=demand)
            figures["elasticities"] = drawn(plots.tornado, slopes)
        if design.space.dimension > 1:
            figures["landscape"] = drawn(plots.landscape, design)
        parts: list[Any] = [VERSION, *tables]
        write_report(args, file.origin | answers, "Design of buildings", parts, figures)


class DesignTask(NamedTuple):
    """The design problem."""

    space: jp.DesignSpace
    ensemble: jp.Ensemble
    recorded: dict[str, jp.Ensemble]  # each of the recorded earthquakes alone, by name
    objective: jp.Objective
    grid: jp.TimeGrid


def prepared(file: File, config: DesignConfig, paths: Sequence[Path] = ()) -> DesignTask:
    """A file's design problem; ``paths`` are accelerograms in g that join its earthquakes."""
    place = f"{file.name}: [variables]"
    if not config.variables:
        raise ValueError(f"{place} must name what may be chosen")
    constant = config.objective.goal == "gap at rest" and not config.penalties
    if constant and not any("gap" in name for name in config.variables):
        rule = "must be given with a gap at rest, such as link.1.gap, among the [variables]"
        raise refused(f"{file.name}: [objective] goal", rule, '"gap at rest"')
    recorded = _recorded(file, config.recorded, paths)
    ground, grid = config.shaking(file, recorded.values())
    n, batch = config.search.earthquakes, config.search.batch
    if batch is not None and batch > (most := n + len(recorded)):
        rule = f"must be at most the number of earthquakes, {most}"
        raise refused(f"{file.name}: [search] batch", rule, str(batch))
    with named(f"{file.name}:"):
        scenarios = jp.Scenarios(config.buildings, ground)
    with named(f"{file.name}: [search] earthquakes:"):
        ensemble = jp.Ensemble.drawn(scenarios, n, config.search.seed)
    if recorded:
        with named(f"{file.name}:"):
            ensemble = ensemble.including([*recorded.values()], grid)
    space = design_space(place, config.variables, Parameters(config.layout))
    alone = {name: jp.Ensemble.of([record], grid) for name, record in recorded.items()}
    objective = priced(file.name, config.objective, config.limits, config.penalties, config.layout)
    return DesignTask(space, ensemble, alone, objective, grid)


def _recorded(
    file: File, table: RecordedTable | None, paths: Sequence[Path]
) -> dict[str, jp.Record]:
    """Recorded earthquakes of the file, and others in g, by name."""
    files, units = (table.files, table.units) if table else ([], None)
    motions = read_records(f"{file.name}: [recorded] files", file.folder, files, units)
    motions += [jp.read_record(path) for path in paths]
    by_name: dict[str, jp.Record] = {}
    for record in motions:
        if record.name in by_name:
            raise refused("records: name", "must be that of one record only", repr(record.name))
        by_name[record.name] = record
    return by_name


def priced(
    name: str,
    objective: ObjectiveTable,
    limits: Mapping[str, float | AtMost],
    penalties: Mapping[str, float | Weighted],
    layout: BuildingsLayout,
) -> jp.Objective:
    """The library's ``Objective`` of these buildings; ``name`` is the name of the file."""
    laws, system = layout.laws, layout.buildings.system()
    goal = f'"{objective.goal}"'
    if laws and objective.goal == "pounding probability":
        rule = "must not be given with a law of [contact]: whether they meet is the same"
        raise refused(f"{name}: [objective] goal", rule, goal)
    if objective.demand is None and not layout.gaps:
        rule = 'must be "least demand" where no [[link]] has a gap'
        raise refused(f"{name}: [objective] goal", rule, goal)
    tables: dict[str, Any] = {
        "limits": (jp.design.Limit, limits),
        "penalties": (jp.design.Penalty, penalties),
    }
    priced: dict[str, dict[str, Any]] = {table: {} for table in tables}
    allowed = demands.limitable_demands(system)
    if objective.demand is not None:
        _require_price(f"{name}: [objective]", objective.demand, allowed, laws, "demand")
    for table, (kind, prices) in tables.items():
        for price, x in prices.items():
            place = f"{name}: [{table}] {price}"
            gaps = [REQUIRED_GAP] if isinstance(x, AtMost) and x.probability is not None else []
            _require_price(f"{name}: [{table}]", price, [*allowed, *gaps], laws)
            number, *more = [x] if isinstance(x, float) else astuple(x)
            within = OF_DEMANDS[demands.kind_of(price)] if table == "limits" else _PENALTY
            if number is not None:
                within.require(place, number)
            with named(f"{place}:"):
                priced[table][price] = kind(number, *more)
    with named(f"{name}: [objective]"):
        return jp.Objective(objective.model(), **priced)


def _require_price(
    place: str, price: str, allowed: Sequence[str], laws: Sequence[str], key: str = "key"
) -> None:
    """Require a demand that the structures have; ``key`` is where its name is in the file."""
    quantity, rule = demands.quantity_named(price), ""
    if price not in allowed:
        if quantity is not None and quantity.only == "contact" and not laws:
            rule = "must not be given without a law of [contact]"
        elif price == REQUIRED_GAP and place.endswith("[limits]"):
            rule = "must be given with a probability, such as {at_most = 0.2, probability = 1e-3}"
        else:
            words = did_you_mean(price, allowed) or f"allowed are {', '.join(allowed)}"
            raise ValueError(reading.unknown_key(place, price, words, key))
    elif {*laws} == {"newton"} and demands.is_zero_by_newton(price):  # never above a limit
        impulse = "peak_impulse is what they have"
        rule = f'must not be given with law = "newton", whose impacts have none; {impulse}'
    if rule:
        raise refused(f"{place} {price}", rule)
