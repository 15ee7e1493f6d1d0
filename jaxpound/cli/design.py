"""``jaxpound design``: dampers and rods that keep buildings apart, chosen by gradients."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from msgspec import field

import jaxpound as jp
from jaxpound.cli.design_report import changes, page, summary
from jaxpound.cli.factors import Bounds, design_space
from jaxpound.cli.files import (
    make_folder,
    unfinished_search,
    write_figures,
    write_json,
    write_text,
)
from jaxpound.cli.notes import noted
from jaxpound.cli.objective import Limits, Objective, Penalties, priced
from jaxpound.cli.parameters import Parameters, RowParameters, parameters_of
from jaxpound.cli.reading import Count, File, Seed, Table, between, named, says
from jaxpound.cli.row import Row
from jaxpound.cli.structures import Shaken
from jaxpound.cli.tables import Files, read_records
from jaxpound.cli.writing import as_toml, row_as_toml

# --- the configuration --------------------------------------------------------------------------


class Recorded(Table):
    """Recorded earthquakes in addition to the random ones."""

    files: Files
    units: str | None = None


class Search(Table):
    """Options of the search, and how many other random earthquakes the design is evaluated on."""

    earthquakes: Annotated[int, Count] = 256
    fresh: Annotated[int, between(0, 2**31)] = 1000
    starts: Annotated[int, Count] | None = None
    iterations: Annotated[int, Count] | None = None
    batch: Annotated[int, Count] | None = None
    seed: Annotated[int, Seed] = 0

    def options(self) -> dict[str, Any]:
        """Options of ``design_damper``; those that are left out have its defaults."""
        given = {name: getattr(self, name) for name in ("starts", "iterations", "batch")}
        return {name: x for name, x in given.items() if x is not None} | {"key": self.seed}


Chosen = Annotated[Bounds, says('{low = ..., high = ..., scale = "linear" or "log"}')]


class Wanted(Shaken):
    """The configuration of ``jaxpound design``."""

    recorded: Recorded | None = None
    variables: dict[str, Chosen] = field(default_factory=dict)
    objective: Objective = Objective()
    limits: Limits = field(default_factory=dict)
    penalties: Penalties = field(default_factory=dict)
    search: Search = Search()


# --- the command --------------------------------------------------------------------------------


def run(args: argparse.Namespace) -> None:
    """Run the command."""
    file = File.opened(args.config, "design")
    given = file.read(Wanted)
    task = prepared(file, given, args.record)
    make_folder(args.out)
    with contextlib.ExitStack() as stack:
        if not args.save:
            inputs = file.text.encode(), *(path.read_bytes() for path in args.record)
            folder = stack.enter_context(unfinished_search(args.out, *inputs))
            make_folder(folder)
            args.save = folder / "search.npz"  # where an interrupted process says that it is
        _design(args, file, given, task)


def _design(args: argparse.Namespace, file: File, given: Wanted, task: Task) -> None:
    """Search, print the answer and write the files."""
    with noted(given.structures):
        design = jp.design_damper(
            task.space,
            task.ensemble,
            task.grid,
            given.scheme,
            task.objective,
            scales=given.scales,
            fresh=given.search.fresh or None,
            save=args.save,
            strict=args.strict,
            progress=sys.stderr.isatty(),
            **given.search.options(),
        )
    recorded = {name: design.compare(one) for name, one in task.recorded.items()}
    answers = summary(design, recorded, given.scales, task.parameters)
    print(changes("quantity", answers["answer"]).text())
    print(design)
    write_text(args.out / "design.toml", file.text)
    write_text(args.out / "buildings.toml", _buildings(given, task, design))
    write_json(args.out / "summary.json", file.origin | answers)

    from jaxpound.plots import designs as plots
    from jaxpound.plots.style import drawn

    compared = design.trained if design.fresh is None else design.fresh
    figures = {
        "convergence": drawn(plots.convergence, design),
        "before_and_after": drawn(plots.before_and_after, compared),
    }
    told = design.objective_function.demand
    if told == "min_gap" and given.form.laws:
        told = "peak_impulse"
    with contextlib.suppress(ValueError):  # what is zero has no elasticity
        slopes = jp.elasticities(
            design.structures,
            task.ensemble,
            task.grid,
            given.scheme,
            demand=told,
        )
        figures["elasticities"] = drawn(plots.tornado, slopes)
    if design.space.dimension > 1:
        figures["landscape"] = drawn(plots.landscape, design)
    write_text(args.out / "summary.md", page(answers, list(figures), design.trained.topology))
    write_figures(figures, args.out, args.pdf)


def _buildings(given: Wanted, task: Task, design: jp.Design) -> str:
    """The design as a configuration of ``jaxpound simulate``."""
    if isinstance(given.form, Row) and isinstance(task.parameters, RowParameters):
        return row_as_toml(task.parameters.in_si(design.structures), given.form.buildings)
    return as_toml(design.structures, given.scales)


@dataclasses.dataclass(frozen=True)
class Task:
    """The design problem, for the dimensionless system."""

    parameters: Parameters
    space: jp.DesignSpace
    ensemble: jp.Ensemble
    recorded: dict[str, jp.Ensemble]
    """The recorded earthquakes, each alone, by name."""
    objective: jp.Objective
    grid: jp.TimeGrid


def prepared(file: File, given: Wanted, more: Sequence[Path] = ()) -> Task:
    """A file's design problem; ``more`` are accelerograms in g added to its random earthquakes."""
    place = f"{file.name}: [variables]"
    if not given.variables:
        raise ValueError(f"{place} must name what may be chosen")
    constant = given.objective.goal == "gap at rest" and not given.penalties
    if constant and not any("gap" in name for name in given.variables):
        rule = "must be given with a gap at rest among the [variables]: initial_gap of a pair"
        raise ValueError(f'{file.name}: [objective] goal = "gap at rest" {rule}')
    drawn_from = given.records(file)
    ground = given.motion(file, drawn_from)
    recorded = _recorded(file, given.recorded, more)
    grid = given.grid(file, [*drawn_from, *recorded.values()])
    n, batch = given.search.earthquakes, given.search.batch
    if batch is not None and batch > (most := n + len(recorded)):
        rule = f"at most the number of earthquakes, {most}"
        raise ValueError(f"{file.name}: [search] batch = {batch} must be {rule}")
    shaking = {name: given.scales.to_dimensionless(record) for name, record in recorded.items()}
    with named(f"{file.name}:"):
        scenarios = jp.Scenarios(given.structures, ground)
    with named(f"{file.name}: [search] earthquakes:"):
        ensemble = jp.Ensemble.drawn(scenarios, n, given.search.seed)
    with named(f"{file.name}:"):
        if shaking:
            ensemble = ensemble.including([*shaking.values()], grid)
    parameters = parameters_of(given.form)
    return Task(
        parameters,
        design_space(place, given.variables, parameters),
        ensemble,
        {name: jp.Ensemble.of([record], grid) for name, record in shaking.items()},
        priced(
            file.name,
            given.objective,
            given.limits,
            given.penalties,
            given.structures,
            given.form.laws,
        ),
        grid,
    )


def _recorded(file: File, table: Recorded | None, more: Sequence[Path]) -> dict[str, jp.Record]:
    """Recorded earthquakes of the file, and others in g, by name."""
    read: list[tuple[Path, jp.Record]] = []
    if table:
        own = read_records(f"{file.name}: [recorded] files", file, table.files, table.units)
        read += zip((file.folder / name for name in table.files), own, strict=True)
    read += [(path, jp.read_record(path)) for path in more]
    found: dict[str, jp.Record] = {}
    for path, record in read:
        if path.stem in found:
            raise ValueError(f"record {path}: its name {path.stem!r} must be another's than before")
        found[path.stem] = record
    return found
