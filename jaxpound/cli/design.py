"""``jaxpound design``: dampers and rods that keep buildings apart, chosen by gradients."""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from msgspec import field

import jaxpound as jp
from jaxpound.cli.design_report import changes, parts_of_page, summary
from jaxpound.cli.files import kept_search, make_folder, write_report, write_text
from jaxpound.cli.objective import Limits, ObjectiveTable, Penalties, priced
from jaxpound.cli.parameters import Parameters, VariableBounds, design_space
from jaxpound.cli.reading import Count, File, Section, Seed, between, named, refused, says
from jaxpound.cli.structures import Shaken, compile_notice
from jaxpound.cli.tables import Files, read_records
from jaxpound.cli.writing import as_toml


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

    def options(self) -> dict[str, Any]:
        """Options of ``design_damper``; an omitted one has its default."""
        options = self.stated() | {"key": self.seed}
        return {x: options[x] for x in options if x not in ("earthquakes", "fresh", "seed")}


Chosen = Annotated[VariableBounds, says('{low = ..., high = ..., scale = "linear" or "log"}')]


class DesignConfig(Shaken):
    """The configuration of ``jaxpound design``."""

    recorded: RecordedTable | None = None
    variables: dict[str, Chosen] = field(default_factory=dict)
    objective: ObjectiveTable = ObjectiveTable()
    limits: Limits = field(default_factory=dict)
    penalties: Penalties = field(default_factory=dict)
    search: SearchTable = SearchTable()


def run(args: argparse.Namespace) -> None:
    """Run the command."""
    file = File.opened(args.config, "design")
    config = file.read(DesignConfig)
    task = prepared(file, config, args.record)
    make_folder(args.out)
    inputs = file.text.encode(), *(path.read_bytes() for path in args.record)
    with kept_search(args, "save", "search.npz", *inputs):
        _design(args, file, config, task)


def _design(args: argparse.Namespace, file: File, config: DesignConfig, task: DesignTask) -> None:
    with compile_notice(config.structures):
        design = jp.design_damper(
            task.space,
            task.ensemble,
            task.grid,
            config.scheme,
            task.objective,
            scales=config.scales,
            fresh=config.search.fresh or None,
            save=args.save,
            strict=args.strict,
            progress=sys.stderr.isatty(),
            **config.search.options(),
        )
    recorded = {name: design.compare(single) for name, single in task.recorded.items()}
    answers = summary(design, recorded, task.parameters)
    print(changes("quantity", answers["answer"]).text())
    print(design)
    write_text(args.out / "design.toml", file.text)
    write_text(args.out / "buildings.toml", as_toml(task.parameters.buildings(design.structures)))

    from jaxpound.plots import designs as plots
    from jaxpound.plots.style import drawn

    compared = design.trained if design.fresh is None else design.fresh
    figures = {
        "convergence": drawn(plots.convergence, design),
        "before_and_after": drawn(plots.before_and_after, compared),
    }
    demand = design.objective_function.demand
    if demand == "min_gap" and config.layout.laws:
        demand = "peak_impulse"
    with contextlib.suppress(ValueError):  # what is zero has no elasticity
        runs = task.ensemble, task.grid, config.scheme
        slopes = jp.elasticities(design.structures, *runs, demand=demand)
        figures["elasticities"] = drawn(plots.tornado, slopes)
    if design.space.dimension > 1:
        figures["landscape"] = drawn(plots.landscape, design)
    buildings = "two adjacent structures" if config.layout.is_pair else "buildings in a row"
    parts = parts_of_page(answers, design.trained.topology)
    write_report(args, file.origin | answers, f"Design of {buildings}", parts, figures)


class DesignTask(NamedTuple):
    """The design problem, for the dimensionless system."""

    parameters: Parameters
    space: jp.DesignSpace
    ensemble: jp.Ensemble
    recorded: dict[str, jp.Ensemble]
    """The recorded earthquakes, each alone, by name."""
    objective: jp.Objective
    grid: jp.TimeGrid


def prepared(file: File, config: DesignConfig, paths: Sequence[Path] = ()) -> DesignTask:
    """A file's design problem; ``paths`` are accelerograms in g that join its earthquakes."""
    place = f"{file.name}: [variables]"
    if not config.variables:
        raise ValueError(f"{place} must name what may be chosen")
    constant = config.objective.goal == "gap at rest" and not config.penalties
    if constant and not any("gap" in name for name in config.variables):
        rule = "must be given with a gap at rest among the [variables]: initial_gap of a pair"
        raise refused(f"{file.name}: [objective] goal", rule, '"gap at rest"')
    recorded = _recorded(file, config.recorded, paths)
    ground, grid = config.shaking(file, recorded.values())
    n, batch = config.search.earthquakes, config.search.batch
    if batch is not None and batch > (most := n + len(recorded)):
        rule = f"must be at most the number of earthquakes, {most}"
        raise refused(f"{file.name}: [search] batch", rule, str(batch))
    shaking = {name: config.scales.to_dimensionless(record) for name, record in recorded.items()}
    with named(f"{file.name}:"):
        scenarios = jp.Scenarios(config.structures, ground)
    with named(f"{file.name}: [search] earthquakes:"):
        ensemble = jp.Ensemble.drawn(scenarios, n, config.search.seed)
    if shaking:
        with named(f"{file.name}:"):
            ensemble = ensemble.including([*shaking.values()], grid)
    parameters = Parameters(config.layout)
    space = design_space(place, config.variables, parameters)
    alone = {name: jp.Ensemble.of([record], grid) for name, record in shaking.items()}
    tables = config.objective, config.limits, config.penalties
    objective = priced(file.name, *tables, config.layout)
    return DesignTask(parameters, space, ensemble, alone, objective, grid)


def _recorded(
    file: File, table: RecordedTable | None, paths: Sequence[Path]
) -> dict[str, jp.Record]:
    """Recorded earthquakes of the file, and others in g, by name."""
    files, units = (table.files, table.units) if table else ([], None)
    motions = read_records(f"{file.name}: [recorded] files", file.folder, files, units)
    motions += [jp.read_record(path) for path in paths]
    names = [*(file.folder / name for name in files), *paths]
    by_name: dict[str, jp.Record] = {}
    for path, record in zip(names, motions, strict=True):
        if path.stem in by_name:
            raise ValueError(f"record {path}: its name {path.stem!r} must be another's than before")
        by_name[path.stem] = record
    return by_name
