"""``jaxpound design``: dampers and rods that keep buildings apart, chosen by gradients."""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from msgspec import field
from msgspec.structs import astuple

import jaxpound as jp
from jaxpound._errors import renamed
from jaxpound._tables import TextTable
from jaxpound.cli.buildings import as_toml
from jaxpound.cli.files import VERSION, kept_search, write_files, write_report
from jaxpound.cli.parameters import Parameters, VariableBounds, design_space
from jaxpound.cli.reading import Count, File, Range, Section, Seed, between, named, refused, says
from jaxpound.cli.structures import Shaken
from jaxpound.cli.tables import Files, Gap, OfClass, read_records
from jaxpound.design.problem import DesignProblem
from jaxpound.model.parameters import put
from jaxpound.quantities import unit
from jaxpound.reliability.result import RAREST
from jaxpound.results.named import in_words, threshold_range, unit_of, viscous_forces

_WHEN = ("before", "after")

_Temperature = Annotated[float, between(1e-9, 10, "m", "of the soft minimum of gaps")]
_SHARE = '"worst", "mean" or a share'
_Share = Annotated[float, between(1e-6, 1, "", "of the earthquakes")]
_Over = Annotated[str | _Share, says(_SHARE)]
_OfGaps = Literal["mean gap", "worst gap", "soft minimum", "CVaR"]


def _worst_share(share: float = 0.1) -> jp.SmallestGap:
    """The mean of the smallest share of gaps, whose key is ``share``."""
    with renamed(names={"over": "share"}):
        return jp.SmallestGap(share)


class ObjectiveTable(OfClass):
    """The goal: a function of the smallest gaps, or a demand that is to be least."""

    CLASSES: ClassVar = {
        "mean gap": partial(jp.SmallestGap, "mean"),
        "worst gap": partial(jp.SmallestGap, "worst"),
        "soft minimum": jp.design.SoftMinimum,
        "CVaR": _worst_share,
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
            slopes = jp.design.elasticities(design.structures, *shaken, demand=demand)
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


def answer_of(design: jp.design.Design, parameters: Parameters) -> list[dict[str, Any]]:
    """The design in words: what was chosen, and what follows for dampers and buildings."""
    ends: list[Any] = [put(design.space.nominal, design.start), design.structures]
    rows: list[tuple[Any, ...]] = [
        (parameters.in_words(path), parameters.unit_of(path), before, design.values[path])
        for path, before in design.start.items()
    ]
    systems = [buildings.system() for buildings in ends]
    forces = [[*(link.friction for link in x.links), *viscous_forces(x)] for x in systems]
    rows.append(("forces of all dampers together", "N", *map(sum, forces)))
    names = [path.split(".") for path in design.space.names]
    for b in sorted({int(number) for kind, number, *_ in names if kind == "buildings"}):
        of_both = [x.buildings[b] for x in ends]
        periods = [building.natural_period for building in of_both]
        rows.append((f"natural period of building {b + 1}", "s", *periods))
        percent = [100 * building.modes().damping_ratios[0] for building in of_both]
        rows.append((f"damping ratio of the first mode of building {b + 1}", "%", *percent))
    bounds = [design.active_bounds.get(path) for path in design.start]
    answer = []
    for (words, symbol, *both), bound in zip_longest(rows, bounds):
        before, after = map(float, both)
        change, relative = after - before, after / before - 1 if before else None
        row = {"quantity": words, "unit": symbol, "before": before, "after": after}
        row |= {"change": change, "relative_change": relative, "at_bound": bound}
        answer.append(row)
    return answer


def summary(
    design: jp.design.Design,
    answer: Sequence[Mapping[str, Any]],
    recorded: Mapping[str, jp.design.Comparison],
) -> dict[str, Any]:
    """Summary of a design for JSON; ``recorded`` are single earthquakes by name."""
    si, demand, bounds = design.trained.si, design.objective_function.demand, design.active_bounds
    return {
        "units": "SI",
        "objective": design.objective,
        "objective_unit": unit(design.objective_function.quantity, si),
        "answer": [*answer],
        "variables": {
            path: {"before": before, "after": design.values[path], "at_bound": bounds.get(path)}
            for path, before in design.start.items()
        },
        "limits": {
            name: {
                "unit": unit_of(name, si),
                **vars(limit),
                "cov": design.events[name].cov if name in design.events else None,
                "reached": design.limited_demands[name],
                "multiplier": design.multipliers[name],
                "active": name in design.active_limits,
            }
            for name, limit in design.objective_function.limits.items()
        },
        "gradient_within_bounds": design.gradient_norm,
        "winner": design.winner + 1,
        "starts": design.history.objective.shape[1],
        "dropped_starts": [i + 1 for i in design.dropped],
        "iterations": design.history.objective.shape[0],
        "stopped": design.stopped,
        "simulations_with_gradient": design.simulations,
        "trained": _compared(design.trained),
        "fresh": None if design.fresh is None else _compared(design.fresh),
        "recorded": {
            name: {f"{demand}_{x}": float(getattr(shaken, x)[demand][0]) for x in _WHEN}
            for name, shaken in recorded.items()
        },
        "demand": demand,
    }


def _compared(comparison: jp.design.Comparison) -> dict[str, Any]:
    objective = {name: x._asdict() for name, x in comparison.objective.items()}
    answers: dict[str, Any] = {"earthquakes": len(comparison), "objective": objective}
    if comparison.has_gaps:
        answers["share_that_pounds"] = dict(zip(_WHEN, comparison.pounding, strict=True))
        answers["min_gap_wider_by"] = comparison.difference("min_gap")._asdict()
    demands = comparison.rows().items()
    return answers | {
        "hardly_slipping": list(comparison.hardly_slipping),
        "demand_changes_by": comparison.difference()._asdict(),
        "demands": {name: {"unit": unit_of(name, comparison.si)} | row for name, row in demands},
    }


def tables_of(
    design: jp.design.Design,
    answer: Sequence[Mapping[str, Any]],
    recorded: Mapping[str, jp.design.Comparison],
) -> list[TextTable]:
    """The tables of the screen and the page: what changed, the design's own, and the recorded."""
    keys, cells = ("unit", "before", "after", "change"), []
    for row in answer:
        share, bound = row["relative_change"], row["at_bound"]
        relative = "-" if share is None else f"{share:+.1%}"
        at_bound = f"the {bound} one" if bound else "no"
        cells.append((row["quantity"], *(row[key] for key in keys), relative, at_bound))
    changes = TextTable.of(("quantity", *keys, "relative change", "at a bound"), cells)
    demand, of_design = design.objective_function.demand, design.trained
    ends = [f"{in_words(demand, of_design.topology)} {when}" for when in _WHEN]
    symbol = unit_of(demand, of_design.si)
    rows: list[Any] = [
        (name, symbol, *(float(getattr(x, when)[demand][0]) for when in _WHEN))
        for name, x in recorded.items()
    ]
    shaken = [TextTable.of(("recorded earthquake", "unit", *ends), rows)] if rows else []
    return [changes, *design._tables(), *shaken]
