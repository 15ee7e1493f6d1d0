"""What commands tell of results: of a run its gaps, contact and energy; of a fragility its fit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

import jaxpound as jp
from jaxpound._fields import quantities
from jaxpound._tables import rounded
from jaxpound.cli.files import known
from jaxpound.quantities import column
from jaxpound.results.impacts import ImpactSeries


def of_run(response: jp.Response) -> dict[str, Any]:
    """Smallest gap and energies, in SI units."""
    demand = response.demand
    energy = response.energy
    pounds = bool(demand.pounds)
    touches = [first_contact(response, k) for k in range(len(response.links))]
    return {
        "min_gap_m": float(demand.min_gap),
        "min_gap_time_s": float(demand.min_gap_time),
        "pounds": pounds,
        "overlap_m": max(0.0, -float(demand.min_gap)),
        "first_contact_s": min(time for time in touches if time is not None) if pounds else None,
        "input_energy_J": float(energy.input[-1]),
        "damper_energy_J": float(energy.friction[-1]),
        "rods_energy_J": float(energy.rods[-1]),
        "kinetic_energy_J": float(energy.kinetic[-1]),
        "energy_residual_over_input": float(energy.relative_residual),
    }


def of_fragility(curve: jp.Fragility | None) -> dict[str, float] | None:
    """The parameters of a fragility, with their standard errors."""
    names = ("median", "median_error", "dispersion", "dispersion_error")
    return None if curve is None else {name: getattr(curve, name) for name in names}


def first_contact(response: jp.Response, link: int) -> float | None:
    """When a gap first closes: at an impact, or by linear interpolation between instants."""
    if not float(response.demand.links[link].min_gap) <= 0:
        return None
    if impacts := response.impacts(link):
        return impacts[0].time
    time, gap = np.asarray(response.time), np.asarray(response.links[link].gap)
    closed = np.flatnonzero(gap <= 0)
    if closed.size == 0:  # it opens again before the next instant
        return float(response.demand.links[link].min_gap_time)
    around = [closed[0], max(closed[0] - 1, 0)]
    return float(np.interp(0.0, gap[around], time[around]))


def of_contact(response: jp.Response, link: int) -> dict[str, Any] | None:
    """What a link's law of contact gave: its scalars, and the impacts one by one."""
    series, scalars = response.links[link], response.demand.links[link]
    if series.contact is None:
        return None
    told = {
        column(name, about.kind, si=True): float(getattr(scalars, name))
        for name, about in quantities(type(scalars)).items()
        if about.only == "contact"
    }
    kinds = {name: about.kind for name, about in quantities(ImpactSeries).items()}
    impacts = [
        {column(name, kind, si=True): getattr(impact, name) for name, kind in kinds.items()}
        for impact in response.impacts(link)
    ]
    stored = {"stored_at_end_J": float(series.contact_stored[-1])}
    found: dict[str, Any] = known(told | stored | {"impacts": impacts})
    return found


def verdict(results: Mapping[str, Any], by_law: bool) -> str:
    """Whether buildings pound, in words; ``by_law`` says whether their contact has a law."""
    if not results["pounds"]:
        return "no pounding"
    told = f"POUNDS: {'penetration' if by_law else 'overlap'} {results['overlap_m']:.4g} m, "
    told += f"first contact at {results['first_contact_s']:.5g} s"
    return told + ("" if by_law else "; contact itself is not modelled")


def energy_line(
    results: Mapping[str, Any], lost_by_contact: float | None, with_damper: bool
) -> str:
    """The energy's shares in one line."""
    supplied = results["input_energy_J"]
    takers = ("damper", "rods") if with_damper else ("rods",)
    taken = {name: results[f"{name}_energy_J"] for name in takers}
    if lost_by_contact is not None:
        taken["contact"] = lost_by_contact
    shares = ", ".join(
        f"{name} {energy / 1e3:.4g} kJ ({energy / supplied if supplied else 0:.0%})"
        for name, energy in taken.items()
    )
    return (
        f"Energy   input {supplied / 1e3:.4g} kJ: {shares}; "
        f"residual {results['energy_residual_over_input']:.1e} of the input"
    )


def in_thousands(number: float) -> str:
    """A number in kN, kJ or kN s, in words."""
    return rounded(number / 1e3)
