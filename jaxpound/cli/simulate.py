"""``jaxpound simulate``: buildings in SI units under a recorded earthquake."""

from __future__ import annotations

import argparse
import dataclasses
import math
import warnings
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

import jaxpound as jp
from jaxpound._fields import quantities
from jaxpound.cli.buildings import BuildingsLayout, end_in_file
from jaxpound.cli.files import (
    csv_text,
    images,
    json_safe,
    json_text,
    make_folder,
    table_of,
    write_files,
)
from jaxpound.cli.reading import File, Section, between, named
from jaxpound.cli.structures import Structured
from jaxpound.cli.tables import FACTOR_ON_RECORD, WaveSection
from jaxpound.ground.plausibility import OFFSET
from jaxpound.ground.reader import require_possible
from jaxpound.model.places import link_places
from jaxpound.model.system import in_parallel
from jaxpound.quantities import MOST_PGA, STANDARD_GRAVITY, column
from jaxpound.results.element_demands import RodDemand
from jaxpound.results.impacts import ImpactSeries
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
    wave: WaveSection | None = None
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
    require_possible(f"{file.name}: record", "PGA", peak, "is [ground] pga or scale right?")
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
    files["floors.csv"] = envelope(layout.buildings, response)
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
    ground: Any = record
    if (wave := configuration.wave) is not None:
        ground = jp.travelling(record, **wave.stated())
    options = run.scheme, [*ground.parts()], run.duration, run.dt, strict
    grid = record_grid(buildings, *options, place=f"{file.name}: [run]")
    with named(f"{file.name}:"):
        return jp.simulate(buildings, ground, grid, run.scheme, strict=strict)


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
        "results": of_simulation(configuration.layout, response),
    }


def page(answers: dict[str, Any], buildings: jp.Buildings, response: jp.Response) -> str:
    """The summary as text for the screen, with the response and its peaks over the height."""
    record, pga = answers["record"], answers["record"]["pga_g"]
    peak = f"PGA {pga:.4g} g ({STANDARD_GRAVITY * pga:.4g} m/s²)"
    floors = jp.floor_demands(buildings, response.demand)
    lines = [f"{record['file']}: {peak}, {record['duration_s']:.6g} s", repr(response)]
    return "\n".join([*lines, *map(repr, floors), *result_lines(answers["results"])])


def of_simulation(layout: BuildingsLayout, response: jp.Response) -> dict[str, Any]:
    """The scalars of a run; units are in the names, numbers count from 1."""
    demand, energy = response.demand, response.energy
    floors = jp.floor_demands(layout.buildings, demand)
    members = zip(layout.shear_buildings, floors, layout.bearings, strict=True)
    links = [_of_link(layout, response, k) for k in range(len(layout.tables))]
    contacts = [x for link in links if np.isfinite(x := link["first_contact_s"])]
    return json_safe(
        {
            "min_gap_m": float(demand.min_gap),
            "min_gap_time_s": float(demand.min_gap_time),
            "pounds": bool(demand.pounds),
            "overlap_m": max(0.0, -float(demand.min_gap)),
            "first_contact_s": min(contacts, default=None),
            "input_energy_J": float(energy.input[-1]),
            "damper_energy_J": float(energy.friction[-1]),
            "rods_energy_J": float(energy.rods[-1]),
            "damping_energy_J": float(energy.damping[-1]),
            "kinetic_energy_J": float(energy.kinetic[-1]),
            "energy_residual_over_input": float(energy.relative_residual),
            "buildings": [
                _of_building(*member, demand, layout.buildings.modes(b))
                for b, member in enumerate(members)
            ],
            "links": links,
        }
    )


def _of_building(
    building: Any, floors: Any, bearing: Any, demand: jp.Demand, by: jp.model.Modes
) -> dict[str, Any]:
    keys = ("period_s", "damping_ratio", "share_of_mass", "overdamped")
    modes = zip(by.periods, by.damping_ratios, by.participation, by.overdamped, strict=True)
    heights, base = building.heights[: building.n_floors], float(floors.drift[0])
    footing = floors.masses[0] + len(building.storeys)
    storeys = [(i, _of_storey(demand.rods[mass])) for i, mass in enumerate(floors.masses, 1)]
    above = slice(building.n_bearings, None)  # storeys above bearings
    return {
        "storeys": building.n_floors,
        "height_m": float(building.elevations[-1]),
        "natural_period_s": float(building.natural_period),
        "series": [mass + 1 for mass in floors.masses],
        "peak_displacement_m": float(np.max(floors.displacement)),
        "peak_drift_m": float(np.max(floors.drift[above])),
        "peak_drift_ratio": float(np.max((floors.drift / np.array(heights))[above])),
        "peak_absolute_acceleration_m_per_s2": float(np.max(floors.acceleration)),
        "base_shear_N": float(floors.shear[0]),
        "yielding": [{"storey": i} | x for i, x in storeys if x],
        "tuned_mass_strokes_m": [] if floors.stroke is None else [*map(float, floors.stroke)],
        "soil": _of_soil(building, footing, demand),
        "isolation": bearing
        and {  # a spring and a dashpot, at the largest displacement of the base
            "restoring_period_s": float(bearing.model().period),
            "displacement_m": base,
            "damping_ratio": float(bearing.model().damping_ratio(base)) if base else None,
        },
        "modes": [dict(zip(keys, (*map(float, x[:3]), bool(x[3])), strict=True)) for x in modes],
    }


def _of_storey(rod: RodDemand) -> dict[str, float]:
    """What yielding does to a storey, whose rod has the number of its floor; or nothing."""
    columns = {} if rod.ductility is None else _columns(RodDemand, "yielding")
    kinds = {"collapsed": bool}
    return {key: kinds.get(key, float)(getattr(rod, x)) for x, key in columns.items()}


def _of_soil(building: jp.ShearBuilding, footing: int, demand: jp.Demand) -> dict[str, Any] | None:
    """The effect of the soil, and what the footing of a number has borne; None without soil."""
    if building.footing is None:
        return None
    effect, (sway, rocking) = building.soil_effect(), demand.rods[footing : footing + 2]
    masses = demand.masses[footing : footing + 2]  # the rotation is that of a lever of 1 m
    return {
        "period_ratio": effect.period_ratio,
        "added_damping": effect.added_damping,
        "footing_displacement_m": float(masses[0].peak_x),
        "rotation_rad": float(masses[1].peak_x),
        "sway_force_N": float(sway.peak_force),
        "rocking_moment_N_m": float(rocking.peak_force),
    }


def _of_link(layout: BuildingsLayout, response: jp.Response, k: int) -> dict[str, Any]:
    links, demand = layout.buildings.links, response.demand.links[k]
    link = links[k]
    dampers = [rod for x in links[: k + 1] if x.damper for rod in in_parallel(x.damper)]
    last = len(response.masses) + len(dampers) - 1  # a dashpot is behind its spring
    damper = response.demand.rods[last] if link.damper else None
    ground = link.other_floor <= jp.GROUND
    return {
        "table": layout.tables[k],
        "between": link_places(response.topology)[k],
        "building": link.building + 1,
        "floor": link.floor + 1,
        "next_building": end_in_file(link),
        "next_floor": None if ground else link.other_floor + 1,
        "gap_m": float(link.gap),
        "friction_force_N": float(link.friction),
        "min_gap_m": float(demand.min_gap),
        "min_gap_time_s": float(demand.min_gap_time) if math.isfinite(link.gap) else None,
        "first_contact_s": response.first_contact(k),
        "slip_distance_m": float(demand.slip_distance) if link.friction else None,
        "damper_energy_J": float(demand.friction_work),
        "residual_offset_m": float(demand.residual_offset),
        "inerter_force_N": _largest(response.links[k].inertia),
        "viscous_force_N": None if damper is None else float(damper.peak_force),
        "viscous_energy_J": _largest(getattr(damper, "dissipated_energy", None)),
        "contact": _of_contact(response, k),
        "opening_m": _largest(demand.peak_opening),
        "column_shear_N": _largest(demand.peak_column_shear),
        "column_shear_ratio": _largest(demand.column_shear_ratio),
    }


def _largest(series: Any) -> float | None:
    return None if series is None else float(np.abs(series).max())


def _of_contact(response: jp.Response, link: int) -> dict[str, Any] | None:
    """The contact of a link: its scalars and its impacts; None without a law of contact."""
    series, scalars = response.links[link], response.demand.links[link]
    if series.contact is None:
        return None
    columns, fields = _columns(type(scalars), "contact"), _columns(ImpactSeries).items()
    results: dict[str, Any] = {key: float(getattr(scalars, x)) for x, key in columns.items()}
    results["stored_at_end_J"] = float(series.contact_stored[-1])
    impacts = [{key: getattr(impact, x) for x, key in fields} for impact in response.impacts(link)]
    return results | {"impacts": impacts}


def _columns(cls: type, only: str = "") -> dict[str, str]:
    """The columns of a class of results in SI units, by field: all, or those of some elements."""
    fields = quantities(cls).items()
    return {x: column(x, y.kind, si=True) for x, y in fields if not only or y.only == only}


def envelope(buildings: jp.Buildings, response: jp.Response) -> str:
    """The table of ``FloorDemands`` of all buildings, with what yields, as CSV."""
    floors = jp.floor_demands(buildings, response.demand)
    tables = [dataclasses.replace(x, ductility=None).to_columns() for x in floors]
    columns = {name: np.concatenate([x[name] for x in tables]).tolist() for name in tables[0]}
    storeys = [_of_storey(response.demand.rods[mass]) for x in floors for mass in x.masses]
    for key in _columns(RodDemand, "yielding").values() if any(storeys) else ():
        columns[key] = [float(storey.get(key, np.nan)) for storey in storeys]
    return csv_text(columns)


def result_lines(results: dict[str, Any]) -> list[str]:
    """The results of ``of_simulation`` that the response does not print, as text for the screen."""
    links, buildings = results["links"], [*enumerate(results["buildings"], 1)]
    tables: list[list[dict[str, Any]]] = [
        [{"building": str(i), **x["modes"][0]} for i, x in buildings],
        [{"building": str(i), **storey} for i, x in buildings for storey in x["yielding"]],
        [
            {"bearings of building": str(i), **x["isolation"]}
            for i, x in buildings
            if x["isolation"]
        ],
    ]
    texts = [table_of(rows).text() for rows in tables if rows]
    if results["pounds"]:
        closable = [link for link in links if link["min_gap_m"] is not None]
        closest = min(closable, key=lambda link: link["min_gap_m"])
        by_law = closest["contact"] is not None
        depth = f"{'penetration' if by_law else 'overlap'} {results['overlap_m']:.4g} m"
        remark = "" if by_law else "; contact itself is not modelled"
        texts.append(f"{depth}, first contact at {results['first_contact_s']:.5g} s{remark}")
    shares = {name: results[f"{name}_energy_J"] for name in ("damper", "rods")}
    if not any(link["friction_force_N"] for link in links):
        del shares["damper"]
    if viscous := sum(link["viscous_energy_J"] or 0.0 for link in links):
        shares |= {"rods": shares["rods"] - viscous, "viscous dampers": viscous}
    if laws := [link["contact"] for link in links if link["contact"]]:
        shares["contact"] = sum(law["contact_work_J"] for law in laws)
    total = results["input_energy_J"] or float("inf")
    parts = ", ".join(f"{name} {x:.4g} J ({x / total:.0%})" for name, x in shares.items())
    residual = f"residual {results['energy_residual_over_input']:.1e} of the input"
    return [*texts, f"energy input {results['input_energy_J']:.4g} J: {parts}; {residual}"]
