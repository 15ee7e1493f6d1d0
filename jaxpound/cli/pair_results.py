"""What ``jaxpound simulate`` tells of two buildings of one storey."""

from __future__ import annotations

from typing import Any

import jaxpound as jp
from jaxpound._tables import Table
from jaxpound.cli.pair import Pair
from jaxpound.cli.results import energy_line, in_thousands, of_contact, of_run, verdict


def results(form: Pair, response: jp.Response) -> dict[str, Any]:
    """The scalars of a run; units are in the names."""
    demand, told = response.demand, of_run(response)
    told |= {
        "slip_distance_m": float(demand.slip_distance),
        "residual_offset_m": float(demand.residual_offset),
    }
    for i, building in enumerate((form.building_1.model(), form.building_2.model()), start=1):
        told[f"building_{i}"] = {
            "period_s": float(building.natural_period),
            "damping_ratio": float(building.damping_ratio),
            "peak_displacement_m": float(getattr(demand, f"peak_x{i}")),
            "peak_absolute_acceleration_m_per_s2": float(getattr(demand, f"peak_acceleration_{i}")),
            "base_shear_N": float(getattr(demand, f"peak_f{i}")),
        }
    return told | {"contact": of_contact(response, 0)}


def lines(answers: dict[str, Any]) -> list[str]:
    """The results as text for the screen."""
    told, given = answers["results"], answers["configuration"]
    contact, slip_force = told["contact"], given["damper"]["friction_force"]
    quantities = [
        ("natural period", "period_s", 1, "s"),
        ("damping ratio", "damping_ratio", 100, "%"),
        ("peak displacement", "peak_displacement_m", 1, "m"),
        ("peak absolute acceleration", "peak_absolute_acceleration_m_per_s2", 1, "m/s²"),
        ("peak base shear", "base_shear_N", 1e-3, "kN"),
    ]
    rows = [
        (words, *(factor * told[f"building_{i}"][key] for i in (1, 2)), of)
        for words, key, factor, of in quantities
    ]
    return [
        Table.of(("", "building 1", "building 2", "unit"), rows).text(),
        "",
        f"Gap      {given['gap']:.4g} m at rest, smallest {told['min_gap_m']:.4g} m "
        f"at {told['min_gap_time_s']:.5g} s",
        f"         {verdict(told, contact is not None)}",
        *([contact_line(given["contact"]["law"], contact)] if contact else []),
        *([_damper_line(slip_force, told)] if slip_force else []),
        energy_line(told, contact["contact_work_J"] if contact else None, bool(slip_force)),
    ]


def _damper_line(slip_force: float, told: dict[str, Any]) -> str:
    """The damper in one line."""
    offset = f"offset left {told['residual_offset_m']:.4g} m"
    slid = f"slid {told['slip_distance_m']:.4g} m"
    return f"Damper   slip force {slip_force / 1e3:.4g} kN, {slid}, {offset}"


def contact_line(law: str, contact: dict[str, Any]) -> str:
    """The impacts in one line; by Newton's law they have impulses, but no force."""
    impulse = f"largest impulse {in_thousands(contact['peak_impulse_N_s'])} kN s"
    force = f"peak force {in_thousands(contact['peak_contact_N'])} kN, "
    lost = f"{in_thousands(contact['contact_work_J'])} kJ lost"
    n = contact["n_impacts"]
    told = f"{n:.0f} impact{'s' if n != 1 else ''}"
    if n:
        told += f", {'' if law == 'newton' else force}{impulse}, {lost}"
    return f"Contact  {law}: {told}"
