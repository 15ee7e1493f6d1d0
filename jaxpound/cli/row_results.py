"""What ``jaxpound simulate`` tells of buildings in a row: modes, floors and links."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

import jaxpound as jp
from jaxpound._fields import quantities
from jaxpound._tables import Table
from jaxpound.cli.files import known
from jaxpound.cli.results import energy_line, first_contact, of_contact, of_run, verdict
from jaxpound.cli.row import Row
from jaxpound.quantities import column
from jaxpound.results.floors import FloorDemands


def results(form: Row, response: jp.Response) -> dict[str, Any]:
    """The scalars of a run; units are in the names, numbers count from 1."""
    floors = jp.floor_demands(form.structures, response.demand, form.buildings)
    told = of_run(response) | {
        "buildings": [_of_building(*one) for one in zip(form.buildings, floors, strict=True)],
        "links": [_of_link(form, response, k) for k in range(len(form.links))],
    }
    found: dict[str, Any] = known(told)
    return found


def _of_building(building: jp.ShearBuilding, floors: jp.FloorDemands) -> dict[str, Any]:
    modes = building.modes()
    return {
        "storeys": building.n_floors,
        "height_m": float(building.elevations[-1]),
        "series": [mass + 1 for mass in floors.masses],
        "peak_displacement_m": float(np.max(floors.displacement)),
        "peak_drift_m": float(np.max(floors.drift)),
        "peak_drift_ratio": float(np.max(floors.drift_ratio)),
        "peak_absolute_acceleration_m_per_s2": float(np.max(floors.acceleration)),
        "base_shear_N": float(floors.shear[0]),
        "modes": [
            {"period_s": float(period), "damping_ratio": float(zeta), "share_of_mass": float(share)}
            for period, zeta, share in zip(
                modes.periods, modes.damping_ratios, modes.participation, strict=True
            )
        ],
    }


def _of_link(form: Row, response: jp.Response, k: int) -> dict[str, Any]:
    link, demand = form.links[k], response.demand.links[k]
    ground = link.other_floor == jp.GROUND
    return {
        "table": form.tables[k],
        "between": str(link),
        "building": link.building + 1,
        "floor": link.floor + 1,
        "next_building": "ground" if ground else link.other_building + 1,
        "next_floor": None if ground else link.other_floor + 1,
        "gap_m": float(link.gap),
        "friction_force_N": float(link.friction),
        "min_gap_m": float(demand.min_gap),
        "min_gap_time_s": float(demand.min_gap_time) if math.isfinite(link.gap) else None,
        "first_contact_s": first_contact(response, k),
        "slip_distance_m": float(demand.slip_distance) if link.friction else None,
        "damper_energy_J": float(demand.friction_work),
        "residual_offset_m": float(demand.residual_offset),
        "contact": of_contact(response, k),
    }


def envelope(form: Row, response: jp.Response) -> str:
    """The envelope over the height of every building, floor by floor, as CSV.

    ``series`` is the number of the floor in the names of the time series, such as x3_m.
    """
    kinds = {name: known.kind for name, known in quantities(FloorDemands).items()}
    names = [column(name, kind, si=True) for name, kind in kinds.items()]
    rows = [["building", "floor", "series", "elevation_m", *names, "drift_ratio"]]
    envelopes = jp.floor_demands(form.structures, response.demand, form.buildings)
    for building, floors in zip(form.buildings, envelopes, strict=True):
        for i, mass in enumerate(floors.masses):
            where = [floors.building + 1, i + 1, mass + 1, building.elevations[i]]
            numbers = [getattr(floors, name)[i] for name in kinds]
            numbers.append(floors.drift_ratio[i])
            rows.append([str(x) for x in where] + [repr(float(x)) for x in numbers])
    return "".join(",".join(row) + "\n" for row in rows)


def lines(answers: dict[str, Any]) -> list[str]:
    """The results as text for the screen."""
    outcome = answers["results"]
    rows = [
        (
            str(i),
            building["storeys"],
            building["modes"][0]["period_s"],
            100 * building["modes"][0]["damping_ratio"],
            building["peak_displacement_m"],
            100 * building["peak_drift_ratio"],
            building["peak_absolute_acceleration_m_per_s2"],
            building["base_shear_N"] / 1e3,
        )
        for i, building in enumerate(outcome["buildings"], 1)
    ]
    columns = (
        "building",
        "storeys",
        "period (s)",
        "damping (%)",
        "displacement (m)",
        "drift (%)",
        "acceleration (m/s²)",
        "base shear (kN)",
    )
    texts = [Table.of(columns, rows).text(), ""]
    links = outcome["links"]
    if links:
        texts += [_links(links).text(), ""]
    closable = [link for link in links if link["gap_m"] is not None]
    if closable:
        closest = min(closable, key=lambda link: link["min_gap_m"])
        smallest = f"{outcome['min_gap_m']:.4g} m at {outcome['min_gap_time_s']:.5g} s"
        words = verdict(outcome, closest["contact"] is not None)
        texts.append(f"Gaps     smallest {smallest}; {words}")
    laws = [link["contact"] for link in links if link["contact"]]
    lost = sum(law["contact_work_J"] for law in laws) if laws else None
    dampers = any(link["friction_force_N"] for link in links)
    return [*texts, energy_line(outcome, lost, dampers)]


def _links(links: list[dict[str, Any]]) -> Table:
    """Every link: where it is, its gap, its damper, its impacts."""
    columns: dict[str, list[Any]] = {"link": [link["between"] for link in links]}
    gaps = [link["gap_m"] for link in links]
    if any(gap is not None for gap in gaps):
        columns |= {
            "gap (m)": gaps,
            "smallest (m)": [link["min_gap_m"] for link in links],
            "at (s)": [link["min_gap_time_s"] for link in links],
        }
    if any(link["friction_force_N"] for link in links):
        slips = [link if link["friction_force_N"] else None for link in links]
        columns |= {
            "slip force (kN)": [link and link["friction_force_N"] / 1e3 for link in slips],
            "slid (m)": [link and link["slip_distance_m"] for link in slips],
            "took (kJ)": [link and link["damper_energy_J"] / 1e3 for link in slips],
        }
    laws = [link["contact"] for link in links]
    if any(laws):
        columns |= {
            "impacts": [law and int(law["n_impacts"]) for law in laws],
            "force (kN)": [law and law["peak_contact_N"] / 1e3 for law in laws],
            "impulse (kN s)": [law and law["peak_impulse_N_s"] / 1e3 for law in laws],
        }
    return Table.of([*columns], list(zip(*columns.values(), strict=True)))
