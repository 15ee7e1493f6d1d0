"""Results of a run as numbers and words."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

import jaxpound as jp
from jaxpound._fields import quantities
from jaxpound.cli.buildings import BuildingsLayout
from jaxpound.cli.files import csv_text, json_safe, table_of
from jaxpound.model.places import link_places
from jaxpound.quantities import column
from jaxpound.results.demand import RodDemand
from jaxpound.results.impacts import ImpactSeries


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
    heights = building.heights[: building.n_floors]
    storeys = [(i, _of_storey(demand.rods[mass])) for i, mass in enumerate(floors.masses, 1)]
    above = slice(bearing is not None, None)  # storeys above bearings
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
        "isolation": bearing and _of_bearing(bearing.model(), float(floors.displacement[0])),
        "modes": [dict(zip(keys, (*map(float, x[:3]), bool(x[3])), strict=True)) for x in modes],
    }


def _of_bearing(bearing: Any, displacement: float) -> dict[str, Any]:
    """Bearings as a spring and a dashpot, at the largest displacement of the base."""
    return {
        "restoring_period_s": float(bearing.period),
        "displacement_m": displacement,
        "damping_ratio": float(bearing.damping_ratio(displacement)) if displacement else None,
    }


def _of_storey(rod: RodDemand) -> dict[str, float]:
    """What yielding does to a storey, whose rod has the number of its floor; or nothing."""
    columns = {} if rod.ductility is None else _columns(RodDemand, "yielding")
    kinds = {"collapsed": bool}
    return {key: kinds.get(key, float)(getattr(rod, x)) for x, key in columns.items()}


def _of_link(layout: BuildingsLayout, response: jp.Response, k: int) -> dict[str, Any]:
    links, demand = layout.buildings.links, response.demand.links[k]
    link, before = links[k], sum(x.damper is not None for x in links[:k])
    damper = response.demand.rods[len(response.masses) + before] if link.damper else None
    ground = link.other_floor == jp.GROUND
    return {
        "table": layout.tables[k],
        "between": link_places(response.topology)[k],
        "building": link.building + 1,
        "floor": link.floor + 1,
        "next_building": "ground" if ground else link.other_building + 1,
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


def lines(results: dict[str, Any]) -> list[str]:
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
