"""``jaxpound simulate``: buildings in SI units under a recorded earthquake."""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

import jaxpound as jp
from jaxpound.cli import results
from jaxpound.cli.buildings import BuildingsLayout
from jaxpound.cli.files import images, json_text, make_folder, write_files
from jaxpound.cli.reading import File, Section, between, named
from jaxpound.cli.structures import Structured
from jaxpound.cli.tables import FACTOR_ON_RECORD
from jaxpound.ground.plausibility import OFFSET
from jaxpound.ground.reader import require_possible
from jaxpound.quantities import MOST_PGA, STANDARD_GRAVITY
from jaxpound.simulation.time_steps import record_grid

_Pga = Annotated[float, between(1e-6, MOST_PGA, "g", "several times the largest ever recorded")]


class RecordSection(Section):
    """Processing of the record, in this order."""

    baseline: Literal["none", "mean", "linear"] = "none"
    scale: Annotated[float, between(*FACTOR_ON_RECORD)] | None = None
    pga: _Pga | None = None

    def __post_init__(self) -> None:
        if self.scale is not None and self.pga is not None:
            raise ValueError("must have scale or pga, not both")
        if self.scale == 0:
            raise ValueError("scale = 0 must not be 0: nothing would shake")


class Output(Section):
    """What is written in addition to summary and figures."""

    series: Literal["npz", "csv", "none"] = "npz"


class Simulation(Structured):
    """The configuration of ``jaxpound simulate``."""

    ground: RecordSection = RecordSection()
    output: Output = Output()


def shaking(file: File, ground: RecordSection, record: jp.Record) -> jp.Record:
    """The record with its baseline corrected, and scaled."""
    if ground.baseline != "none":
        record = record.without_mean() if ground.baseline == "mean" else record.detrended()
    if ground.pga is not None:
        with named(f"{file.name}: [ground]"):
            record = record.scaled_to_pga(ground.pga)
    elif ground.scale is not None:
        record = record._with(record.samples * ground.scale, measured=False)
    return record


def of_record(file: File, path: Path, record: jp.Record) -> dict[str, Any]:
    """The record in numbers; a ``ValueError`` if no earthquake is as strong."""
    peak = float(jp.pga(record))
    hint = "is [ground] pga or scale right?"
    require_possible(f"{file.name}: record", "PGA", peak, hint)
    duration = float(record.duration)
    return {"file": str(path), "pga_g": peak, "duration_s": duration, "dt_s": float(record.dt)}


def run(args: argparse.Namespace) -> None:
    """Run the command."""
    file = File.opened(args.config, "simulate")
    configuration = file.read(Simulation)
    names = ("dt", "units", "column", "vertical", "rows")
    with warnings.catch_warnings():
        if configuration.ground.baseline != "none":  # which removes it
            warnings.filterwarnings("ignore", f".*: {OFFSET}", jp.PlausibilityWarning)
        record = jp.read_record(args.record, **{name: getattr(args, name) for name in names})
    record = shaking(file, configuration.ground, record)
    in_numbers = of_record(file, args.record, record)
    response = respond(file, configuration, record, strict=args.strict)
    make_folder(args.out)

    if args.config is None:
        print("No --config given: these are the buildings of jaxpound simulate --example-config.")
    layout = configuration.layout
    answers = summary(file, configuration, in_numbers, response)
    print(page(answers, layout.buildings, response))
    files: dict[str, Any] = {"summary.json": json_text(answers)}
    if configuration.output.series == "npz":
        columns: Any = response.to_columns()
        files["series.npz"] = lambda to: np.savez(to, **columns)
    elif configuration.output.series == "csv":
        files["series.csv"] = response.to_csv
    files["floors.csv"] = results.envelope(layout.buildings, response)
    write_files(args.out, files | images(_figures(layout, response), args.pdf))


def _figures(layout: BuildingsLayout, response: jp.Response) -> dict[str, Any]:
    from jaxpound import plots
    from jaxpound.plots.style import drawn

    gaps, several = bool(layout.gaps), len(response.links) > 1
    dampers = any(link.has_damper for link in response.links)
    names = ["overview", "ground_motion", "displacements", "energy"]
    names += ["gap"] * gaps + ["gap_map"] * (gaps and several) + ["friction_force"] * dampers
    names += ["contact_force"] * layout.has_contact
    elevations = [building.elevations for building in layout.shear_buildings]
    floors = jp.floor_demands(layout.buildings, response.demand)
    figures = {name: drawn(getattr(plots, name), response) for name in names}
    figures["row"] = drawn(plots.row, layout.buildings, elevations)
    figures["envelopes"] = drawn(plots.envelopes, floors, elevations)
    for i, building in enumerate(layout.shear_buildings, 1):
        if len(building.storeys) > 1:
            figures[f"mode_shapes_{i}"] = drawn(plots.mode_shapes, building)
    loops = ["rod", *["friction"] * dampers, *["contact"] * layout.has_contact]
    return figures | {f"{x}_hysteresis": drawn(plots.hysteresis, response, x) for x in loops}


def respond(
    file: File, configuration: Simulation, record: jp.Record, *, strict: bool = False
) -> jp.Response:
    """The run in SI units, as the library makes it of these buildings."""
    run, buildings = configuration.run, configuration.buildings
    options = run.scheme, [record], run.duration, run.dt, strict
    grid = record_grid(buildings, *options, place=f"{file.name}: [run]")
    with named(f"{file.name}:"):
        return jp.simulate(buildings, record, grid, run.scheme, strict=strict)


def summary(
    file: File, configuration: Simulation, record: dict[str, Any], response: jp.Response
) -> dict[str, Any]:
    """Summary of a run: its input and its scalars; units are in the names."""
    return {
        **file.origin,
        "record": record,
        "run": {
            "steps": response.time.size - 1,
            "dt_s": float(response.time[1]),
            "method": response.method,
        },
        "results": results.of_simulation(configuration.layout, response),
    }


def page(answers: dict[str, Any], buildings: jp.Buildings, response: jp.Response) -> str:
    """The summary as text for the screen, with the response and its peaks over the height."""
    record, pga = answers["record"], answers["record"]["pga_g"]
    peak = f"PGA {pga:.4g} g ({STANDARD_GRAVITY * pga:.4g} m/s²)"
    floors = jp.floor_demands(buildings, response.demand)
    lines = [f"{record['file']}: {peak}, {record['duration_s']:.6g} s", repr(response)]
    return "\n".join([*lines, *map(repr, floors), *results.lines(answers["results"])])
