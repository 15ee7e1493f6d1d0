"""A run in words and numbers: the paper's case beside its reference, a pair of buildings in SI."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

import jaxpound as jp
from jaxpound.cli.config import Configuration

PAPER_SCHEME_ERROR = -6.4e-4  # of the paper's own scheme in that minimum, at the paper's step


def known(x: Any) -> Any:
    """A tree with None in the place of what is not finite, as JSON can hold it."""
    if isinstance(x, dict):
        return {key: known(value) for key, value in x.items()}
    if isinstance(x, list):
        return [known(value) for value in x]
    return None if isinstance(x, float) and not math.isfinite(x) else x


def cell(x: Any) -> str:
    """A number of a table to four digits; a dash for none; words as they are."""
    if x is None:
        return "-"
    if isinstance(x, str):
        return x
    return f"{float(f'{x:.4g}'):,.0f}" if 1e4 <= abs(x) < 1e10 else f"{x:.4g}"


Row = Mapping[str, Any]
"""A row of a table: its cells by the names of their columns."""


def markdown_table(rows: Sequence[Row]) -> list[str]:
    """A table's lines. Its header is the names of the rows' cells, so that they cannot part.

    Raises
    ------
    ValueError
        If there is no row, or one has other cells than the first or the same in another order.
    """
    header, *cells = _cells(rows)
    lines = [header, ["---"] * len(header), *cells]
    return [f"| {' | '.join(x.replace('|', chr(92) + '|') for x in line)} |" for line in lines]


def text_table(rows: Sequence[Row]) -> list[str]:
    """The same for the screen: numbers to the right, words to the left."""
    cells = _cells(rows)
    columns = []
    for name, *column in zip(*cells, strict=True):
        widest = max(map(len, (name, *column)))
        words = all(isinstance(row[name], str) for row in rows)
        columns.append([x.ljust(widest) if words else x.rjust(widest) for x in (name, *column)])
    return ["  ".join(line).rstrip() for line in zip(*columns, strict=True)]


def _cells(rows: Sequence[Row]) -> list[list[str]]:
    """Names of the columns, and the rows' cells in their order."""
    if not rows:
        raise ValueError("table: rows = [] must hold a row")
    names = list(rows[0])
    for row in rows:
        if list(row) != names:
            raise ValueError(f"table: the cells of a row, {', '.join(row)}, must be {names}")
    return [names, *([cell(x) for x in row.values()] for row in rows)]


def paper_table(response: jp.Response, papers_own: float, initial_gap: float) -> str:
    """The paper's case beside the reference: smallest gap, phase changes, energy residual."""
    reference = jp.paper.reference()
    changes = [(phase.start, phase.kind) for phase in response.phases()[1:]]
    rows: list[tuple[str, float | None, float | None]] = [
        ("min of x2 - x1", float(response.min_gap) - initial_gap, reference.min_gap_change),
        ("  at t", float(response.demand.min_gap_time), reference.min_gap_time),
        ("phase changes", len(changes), len(reference.phase_changes)),
    ]
    pairs = zip_longest(changes, reference.phase_changes, fillvalue=(None, ""))
    for (time, kind), (expected_time, expected) in pairs:
        rows.append((f"  {kind or expected} from t", time, expected_time))
    rows += [
        ("energy residual / input", _relative_residual(response), None),
        ("min by the paper's scheme", papers_own, reference.min_gap_change),
    ]
    return "\n".join(
        [
            f"The paper's case: {response.time.size - 1} steps of {float(response.time[1]):.6g}",
            response.method,
            "Dimensionless: length g/omega1^2, time 1/omega1. The reference is an independent",
            "event-driven solver. The paper gives no initial gap; pounding is x2 - x1 <= -gap.",
            "",
            f"{'':28}{'jaxpound':>14}{'reference':>14}{'difference':>13}",
            *(_table_row(*row) for row in rows),
            "",
            "The paper's scheme (order 1, switching friction) is known to miss the minimum by "
            f"{PAPER_SCHEME_ERROR:.1e}.",
        ]
    )


def _table_row(name: str, value: float | None, reference: float | None) -> str:
    cells = [
        f"{'-':>14}" if x is None else f"{x:14d}" if isinstance(x, int) else f"{x:14.8f}"
        for x in (value, reference)
    ]
    known = value is not None and reference is not None
    cells.append(f"{value - reference:13.1e}" if known else f"{'-':>13}")  # type: ignore[operator]
    return f"{name:28}{''.join(cells)}"


def _relative_residual(response: jp.Response) -> float:
    """Largest residual of the energy balance over the largest input; 0 for a run at rest."""
    energy = response.energy
    largest = float(np.max(np.abs(energy.input)))
    return float(np.max(np.abs(energy.residual))) / largest if largest else 0.0


def summary(
    configuration: Configuration, file: Path, record: jp.Record, response: jp.Response
) -> dict[str, Any]:
    """What was run, and the scalars that came out of it; units are in the names."""
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
        "energy_residual_over_input": _relative_residual(response),
    }
    for i, building in enumerate((configuration.building_1, configuration.building_2), start=1):
        results[f"building_{i}"] = {
            "period_s": float(building.natural_period),
            "damping_ratio": float(building.damping_ratio),
            "peak_displacement_m": float(getattr(demand, f"peak_x{i}")),
            "peak_absolute_acceleration_m_per_s2": float(getattr(demand, f"peak_acceleration_{i}")),
            "base_shear_N": float(getattr(demand, f"peak_f{i}")),
        }
    return {
        "jaxpound": jp.__version__,
        "record": {
            "file": str(file),
            "pga_g": float(jp.pga(record)),
            "duration_s": float(record.duration),
            "dt_s": float(record.dt),
        },
        "run": {
            "steps": response.time.size - 1,
            "dt_s": float(response.time[1]),
            "method": response.method,
        },
        "configuration": configuration.given,
        "results": results,
    }


def _first_contact(response: jp.Response) -> float:
    """When the gap first closes, by the straight line between instants of the grid."""
    time, gap = np.asarray(response.time), np.asarray(response.gap)
    closed = np.flatnonzero(gap <= 0)
    if closed.size == 0:  # it opens again before the next instant
        return float(response.demand.min_gap_time)
    around = [closed[0], max(closed[0] - 1, 0)]
    return float(np.interp(0.0, gap[around], time[around]))


def as_text(summary: dict[str, Any]) -> str:
    """The summary as text for the screen."""
    record, run, results = summary["record"], summary["run"], summary["results"]
    given = summary["configuration"]
    supplied = results["input_energy_J"]
    taken = {name: results[f"{name}_energy_J"] for name in ("damper", "rods")}
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
        {"": words}
        | {f"building {i}": factor * results[f"building_{i}"][key] for i in (1, 2)}
        | {"unit": unit}
        for words, key, factor, unit in quantities
    ]
    lines = [
        f"Record   {record['file']}: PGA {record['pga_g']:.4g} g, {record['duration_s']:.6g} s",
        f"Run      {run['steps']} steps of {run['dt_s']:.4g} s; {run['method']}",
        "",
        *text_table(rows),
    ]
    lines += [
        "",
        f"Gap      {given['gap']:.4g} m at rest, smallest {results['min_gap_m']:.4g} m "
        f"at {results['min_gap_time_s']:.5g} s",
        _verdict(results),
        f"Damper   slip force {given['damper']['friction_force'] / 1e3:.4g} kN, slid "
        f"{results['slip_distance_m']:.4g} m, offset left {results['residual_offset_m']:.4g} m",
        f"Energy   input {supplied / 1e3:.4g} kJ: {shares}; "
        f"residual {results['energy_residual_over_input']:.1e} of the input",
    ]
    return "\n".join(lines)


def _verdict(results: dict[str, Any]) -> str:
    if not results["pounds"]:
        return "         no pounding"
    return (
        f"         POUNDS: overlap {results['overlap_m']:.4g} m, first contact at "
        f"{results['first_contact_s']:.5g} s; contact itself is not modelled"
    )
