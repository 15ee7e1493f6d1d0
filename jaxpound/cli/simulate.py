"""``jaxpound simulate``: two buildings in SI units under a recorded earthquake."""

from __future__ import annotations

import argparse
import json
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

import jaxpound as jp
from jaxpound._fields import quantities
from jaxpound._tables import Table as Lines
from jaxpound._tables import rounded
from jaxpound.cli.files import known, make_folder, write, write_figures, write_json
from jaxpound.cli.reading import File, Table, between, named
from jaxpound.cli.tables import LAWS, Pair
from jaxpound.ground.intensity import pga
from jaxpound.ground.reader import require_possible
from jaxpound.quantities import MOST_PGA, column
from jaxpound.results.impacts import ImpactSeries
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


class Output(Table):
    """What is written in addition to summary and figures."""

    series: Literal["npz", "csv", "none"] = "npz"


class Simulation(Pair):
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

    from jaxpound import plots
    from jaxpound.plots.style import figure

    write_json(args.out / "summary.json", answers)
    series = args.out / f"series.{given.output.series}"
    if given.output.series == "npz":
        columns: Any = response.to_columns()
        write(series, lambda to: np.savez(to, **columns))
    elif given.output.series == "csv":
        write(series, response.to_csv)
    names = _FIGURES + (_CONTACT_FIGURES if given.contact else ())
    figures = {name: figure(getattr(plots, name), response) for name in names}
    write_figures({"overview": plots.overview(response)} | figures, args.out, args.pdf)


def respond(
    file: File, given: Simulation, record: jp.Record, *, strict: bool = False
) -> jp.Response:
    """The run in SI units, as ``simulate_buildings`` makes it."""
    run = given.run
    grid(file, given, record)  # so that messages on dt and duration have their place in the file
    with named(f"{file.name}:"):
        return jp.simulate_buildings(
            given.building_1.model(),
            given.building_2.model(),
            record,
            friction_force=given.damper.friction_force,
            gap=given.gap,
            contact=given.contact.model() if given.contact else None,
            duration=run.duration,
            dt=run.dt,
            scheme=given.scheme,
            strict=strict,
        )


def grid(file: File, given: Simulation, record: jp.Record) -> jp.TimeGrid:
    """The dimensionless time grid of the run."""
    place, run = f"{file.name}: [run]", given.run
    of_system = given.structures, given.scales, given.scheme
    return record_grid(place, *of_system, record, run.duration, run.dt)


def as_toml(structures: jp.AdjacentStructures, scales: jp.Scales) -> str:
    """Two buildings as a configuration of ``jaxpound simulate``."""
    left, right, friction_force, gap = scales.buildings(structures)
    lines = [f"gap = {float(gap)!r}  # m", ""]
    for i, building in enumerate((left, right), start=1):
        numbers = [f"{name} = {float(np.asarray(x))!r}" for name, x in vars(building).items()]
        lines += [f"[building_{i}]", *numbers, ""]
    lines += ["[damper]", f"friction_force = {float(friction_force)!r}  # N", ""]
    if (law := scales.contact_to_si(structures.contact)) is not None:
        (name,) = (name for name, kind in LAWS.items() if isinstance(law, kind))
        numbers = [f"{key} = {_written(x)}" for key, x in vars(law).items()]
        lines += ["[contact]", f'law = "{name}"', *numbers, ""]
    return "\n".join(lines)


def _written(value: Any) -> str:
    """A number, word or truth as TOML has it."""
    return json.dumps(value if isinstance(value, bool | str) else float(value))


# --- the report ---------------------------------------------------------------------------------


def summary(
    file: File, given: Simulation, path: Path, record: jp.Record, response: jp.Response
) -> dict[str, Any]:
    """Summary of a run: its input and its scalars; units are in the names."""
    demand = response.demand
    at_end = {name: float(term[-1]) for name, term in response.energy._asdict().items()}
    results: dict[str, Any] = {
        "min_gap_m": float(demand.min_gap),
        "min_gap_time_s": float(demand.min_gap_time),
        "pounds": bool(demand.pounds),
        "overlap_m": max(0.0, -float(demand.min_gap)),
        "first_contact_s": _first_contact(response) if demand.pounds else None,
        "slip_distance_m": float(demand.slip_distance),
        "residual_offset_m": float(demand.residual_offset),
        "input_energy_J": at_end["input"],
        "damper_energy_J": at_end["friction"],
        "rods_energy_J": at_end["rods"],
        "kinetic_energy_J": at_end["kinetic"],
        "energy_residual_over_input": relative_residual(response),
    }
    for i, building in enumerate((given.building_1.model(), given.building_2.model()), start=1):
        results[f"building_{i}"] = {
            "period_s": float(building.natural_period),
            "damping_ratio": float(building.damping_ratio),
            "peak_displacement_m": float(getattr(demand, f"peak_x{i}")),
            "peak_absolute_acceleration_m_per_s2": float(getattr(demand, f"peak_acceleration_{i}")),
            "base_shear_N": float(getattr(demand, f"peak_f{i}")),
        }
    results["contact"] = None if given.contact is None else of_contact(response)
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
        "results": results,
    }


def of_contact(response: jp.Response) -> dict[str, Any]:
    """What the law of contact gave: its scalars, and the impacts one by one."""
    (link,), energy = response.demand.links, response.energy
    scalars = {
        column(name, about.kind, si=True): float(getattr(link, name))
        for name, about in quantities(type(link)).items()
        if about.only == "contact"
    }
    kinds = {name: about.kind for name, about in quantities(ImpactSeries).items()}
    impacts = [
        {column(name, kind, si=True): getattr(impact, name) for name, kind in kinds.items()}
        for impact in response.impacts()
    ]
    stored = {"stored_at_end_J": float(energy.contact_stored[-1])}
    return known(scalars | stored | {"impacts": impacts})


def relative_residual(response: jp.Response) -> float:
    """Largest residual of the energy balance over the largest input; 0 for a run at rest."""
    energy = response.energy
    largest = float(np.max(np.abs(energy.input)))
    return float(np.max(np.abs(energy.residual))) / largest if largest else 0.0


def _first_contact(response: jp.Response) -> float:
    """When the gap first closes: at an impact, or by linear interpolation between instants."""
    if impacts := response.impacts():
        return impacts[0].time
    time, gap = np.asarray(response.time), np.asarray(response.gap)
    closed = np.flatnonzero(gap <= 0)
    if closed.size == 0:  # it opens again before the next instant
        return float(response.demand.min_gap_time)
    around = [closed[0], max(closed[0] - 1, 0)]
    return float(np.interp(0.0, gap[around], time[around]))


def page(answers: dict[str, Any]) -> str:
    """The summary as text for the screen."""
    record, run, results = answers["record"], answers["run"], answers["results"]
    given = answers["configuration"]
    supplied = results["input_energy_J"]
    taken = {name: results[f"{name}_energy_J"] for name in ("damper", "rods")}
    if contact := results["contact"]:
        taken["contact"] = contact["contact_work_J"]
    shares = ", ".join(
        f"{name} {energy / 1e3:.4g} kJ ({energy / supplied if supplied else 0:.0%})"
        for name, energy in taken.items()
    )
    quantities = [
        ("natural period", "period_s", 1, "s"),
        ("damping ratio", "damping_ratio", 100, "%"),
        ("peak displacement", "peak_displacement_m", 1, "m"),
        ("peak absolute acceleration", "peak_absolute_acceleration_m_per_s2", 1, "m/s²"),
        ("peak base shear", "base_shear_N", 1e-3, "kN"),
    ]
    rows = [
        (words, *(factor * results[f"building_{i}"][key] for i in (1, 2)), of)
        for words, key, factor, of in quantities
    ]
    table = Lines.of(("", "building 1", "building 2", "unit"), rows)
    verdict = "no pounding"
    if results["pounds"]:
        verdict = (
            f"POUNDS: {'penetration' if contact else 'overlap'} {results['overlap_m']:.4g} m, "
            "first contact at "
            f"{results['first_contact_s']:.5g} s"
            + ("" if contact else "; contact itself is not modelled")
        )
    return "\n".join(
        [
            f"Record   {record['file']}: PGA {record['pga_g']:.4g} g, {record['duration_s']:.6g} s",
            f"Run      {run['steps']} steps of {run['dt_s']:.4g} s; {run['method']}",
            "",
            table.text(),
            "",
            f"Gap      {given['gap']:.4g} m at rest, smallest {results['min_gap_m']:.4g} m "
            f"at {results['min_gap_time_s']:.5g} s",
            f"         {verdict}",
            *([_contact_line(given["contact"]["law"], contact)] if contact else []),
            f"Damper   slip force {given['damper']['friction_force'] / 1e3:.4g} kN, slid "
            f"{results['slip_distance_m']:.4g} m, offset left {results['residual_offset_m']:.4g} m",
            f"Energy   input {supplied / 1e3:.4g} kJ: {shares}; "
            f"residual {results['energy_residual_over_input']:.1e} of the input",
        ]
    )


def _contact_line(law: str, contact: dict[str, Any]) -> str:
    """The impacts in one line; by Newton's law they have impulses, but no force."""
    impulse = f"largest impulse {rounded(contact['peak_impulse_N_s'] / 1e3)} kN s"
    force = f"peak force {rounded(contact['peak_contact_N'] / 1e3)} kN, "
    lost = f"{rounded(contact['contact_work_J'] / 1e3)} kJ lost"
    n = contact["n_impacts"]
    told = f"{n:.0f} impact{'s' if n != 1 else ''}"
    if n:
        told += f", {'' if law == 'newton' else force}{impulse}, {lost}"
    return f"Contact  {law}: {told}"
