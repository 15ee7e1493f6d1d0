"""``jaxpound simulate``: buildings in SI units under a recorded earthquake."""

from __future__ import annotations

import argparse
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

import jaxpound as jp
from jaxpound.cli import pair_results, row_results
from jaxpound.cli.files import make_folder, write, write_figures, write_json, write_text
from jaxpound.cli.notes import noted
from jaxpound.cli.pair import Pair
from jaxpound.cli.reading import File, Table, between, named
from jaxpound.cli.row import Row
from jaxpound.cli.structures import Structured
from jaxpound.ground.intensity import pga
from jaxpound.ground.reader import require_possible
from jaxpound.quantities import MOST_PGA
from jaxpound.simulation.buildings import record_grid

_FIGURES = (
    "ground_motion",
    "displacements",
    "gap",
    "friction_force",
    "rod_hysteresis",
    "friction_hysteresis",
    "energy",
)
_CONTACT_FIGURES = ("contact_force", "contact_hysteresis")


# --- the configuration --------------------------------------------------------------------------


class Ground(Table):
    """Processing of the record, in this order."""

    baseline: Literal["none", "mean", "linear"] = "none"
    scale: (
        Annotated[float, between(-1e3, 1e3, "", "a factor on the record's acceleration")] | None
    ) = None
    pga: (
        Annotated[float, between(1e-6, MOST_PGA, "g", "several times the largest ever recorded")]
        | None
    ) = None

    def __post_init__(self) -> None:
        if self.scale is not None and self.pga is not None:
            raise ValueError("must have scale or pga, not both")
        if self.scale == 0:
            raise ValueError("scale = 0 must not be 0: nothing would shake")


class Output(Table):
    """What is written in addition to summary and figures."""

    series: Literal["npz", "csv", "none"] = "npz"


class Simulation(Structured):
    """The configuration of ``jaxpound simulate``."""

    ground: Ground = Ground()
    output: Output = Output()


def shaking(file: File, ground: Ground, record: jp.Record) -> jp.Record:
    """The record with the baseline correction and the scaling asked for."""
    if ground.baseline != "none":
        record = record.baseline_corrected(ground.baseline)
    if ground.pga is not None:
        with named(f"{file.name}: [ground]"):
            record = record.scaled_to_pga(ground.pga)
    elif ground.scale is not None:
        record = record._with(record.samples * ground.scale, record.dt)
    hint = "is [ground] pga or scale right?"
    require_possible(f"{file.name}: record", "PGA", float(pga(record)), hint)
    return record


# --- the command --------------------------------------------------------------------------------


def run(args: argparse.Namespace) -> None:
    """Run the command."""
    file = File.opened(args.config, "simulate")
    given = file.read(Simulation)
    record = jp.read_record(args.record, dt=args.dt, units=args.units)
    record = shaking(file, given.ground, record)
    response = respond(file, given, record, strict=args.strict)
    make_folder(args.out)

    if args.config is None:
        print("No --config given: these are the buildings of jaxpound simulate --example-config.")
    answers = summary(file, given, args.record, record, response)
    print(page(answers))

    write_json(args.out / "summary.json", answers)
    series = args.out / f"series.{given.output.series}"
    if given.output.series == "npz":
        columns: Any = response.to_columns()
        write(series, lambda to: np.savez(to, **columns))
    elif given.output.series == "csv":
        write(series, response.to_csv)
    form = given.form
    if isinstance(form, Row):
        write_text(args.out / "floors.csv", row_results.envelope(form, response))
        write_figures(_figures_of_row(form, response), args.out, args.pdf)
    else:
        write_figures(_figures_of_pair(response), args.out, args.pdf)


def _figures_of_pair(response: jp.Response) -> dict[str, Any]:
    from jaxpound import plots
    from jaxpound.plots.style import drawn

    (link,) = response.links
    names = [name for name in _FIGURES if link.has_damper or not name.startswith("friction")]
    names += _CONTACT_FIGURES if link.contact is not None else ()
    alone = {name: drawn(getattr(plots, name), response) for name in names}
    return {"overview": drawn(plots.overview, response)} | alone


def _figures_of_row(form: Row, response: jp.Response) -> dict[str, Any]:
    """The pair's figures, without what the row has not, and those of floors over the height."""
    from jaxpound import plots
    from jaxpound.plots.style import drawn

    links = response.links
    by_law = any(link.contact is not None for link in links)
    dampers = any(link.has_damper for link in links)
    gaps = bool(np.isfinite(response.min_gap))
    wanted = {
        "ground_motion": True,
        "displacements": True,
        "gap": gaps,
        "gap_map": gaps,
        "friction_force": dampers,
        "friction_hysteresis": dampers,
        "rod_hysteresis": True,
        "contact_force": by_law,
        "contact_hysteresis": by_law,
        "energy": True,
    }
    names = [name for name, has in wanted.items() if has]
    alone = {name: drawn(getattr(plots, name), response) for name in names}
    elevations = [building.elevations for building in form.buildings]
    shapes = {
        f"mode_shapes_{i}": drawn(plots.mode_shapes, building)
        for i, building in enumerate(form.buildings, 1)
        if building.n_floors > 1
    }
    floors = jp.floor_demands(form.structures, response.demand)
    return {
        "overview": drawn(plots.overview, response),
        "row": drawn(plots.row, form.structures, elevations, scales=form.scales),
        "envelopes": drawn(plots.envelopes, floors, elevations),
        **alone,
        **shapes,
    }


def respond(
    file: File, given: Simulation, record: jp.Record, *, strict: bool = False
) -> jp.Response:
    """The run in SI units, as the library makes it of these buildings."""
    grid(file, given, record)  # so that messages on dt and duration have their place in the file
    with named(f"{file.name}:"), noted(given.structures):
        return given.form.respond(record, given.run, strict=strict)


def grid(file: File, given: Simulation, record: jp.Record) -> jp.TimeGrid:
    """The dimensionless time grid of the run."""
    place, run = f"{file.name}: [run]", given.run
    of_system = given.structures, given.scales, given.scheme
    return record_grid(place, *of_system, record, run.duration, run.dt)


# --- the report ---------------------------------------------------------------------------------


def summary(
    file: File, given: Simulation, path: Path, record: jp.Record, response: jp.Response
) -> dict[str, Any]:
    """Summary of a run: its input and its scalars; units are in the names."""
    return {
        "jaxpound": jp.__version__,
        "record": {
            "file": str(path),
            "pga_g": float(jp.pga(record)),
            "duration_s": float(record.duration),
            "dt_s": float(record.dt),
        },
        "run": {
            "steps": response.time.size - 1,
            "dt_s": float(response.time[1]),
            "method": response.method,
        },
        "configuration": tomllib.loads(file.text),
        "results": (
            pair_results.results(given.form, response)
            if isinstance(given.form, Pair)
            else row_results.results(given.form, response)
        ),
    }


def page(answers: dict[str, Any]) -> str:
    """The summary as text for the screen."""
    record, run = answers["record"], answers["run"]
    of_row = "building" in answers["configuration"]
    return "\n".join(
        [
            f"Record   {record['file']}: PGA {record['pga_g']:.4g} g, {record['duration_s']:.6g} s",
            f"Run      {run['steps']} steps of {run['dt_s']:.4g} s; {run['method']}",
            "",
            *(row_results if of_row else pair_results).lines(answers),
        ]
    )
