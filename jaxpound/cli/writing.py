"""Buildings as a configuration of ``jaxpound simulate``."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np

import jaxpound as jp
from jaxpound.cli.tables import LAWS


def as_toml(structures: jp.AdjacentStructures, scales: jp.Scales) -> str:
    """Two buildings as a configuration of ``jaxpound simulate``."""
    left, right, friction_force, gap = scales.buildings(structures)
    lines = [f"gap = {float(gap)!r}  # m", ""]
    for i, building in enumerate((left, right), start=1):
        numbers = [f"{name} = {float(np.asarray(x))!r}" for name, x in vars(building).items()]
        lines += [f"[building_{i}]", *numbers, ""]
    lines += ["[damper]", f"friction_force = {float(friction_force)!r}  # N", ""]
    if (law := scales.contact_to_si(structures.contact)) is not None:
        lines += ["[contact]", *_law(law), ""]
    return "\n".join(lines)


def row_as_toml(row: jp.Row, buildings: Sequence[jp.ShearBuilding]) -> str:
    """A row whose parameters are in SI units as a configuration of ``jaxpound simulate``.

    ``buildings`` have the heights.
    """
    lines = []
    for building, stated in zip(row.buildings, buildings, strict=True):
        rods = building.rods
        numbers = {
            "masses": building.masses,
            "stiffnesses": [rod.stiffness for rod in rods],
            "order": [rod.material.order for rod in rods],
            "tau_f": [rod.material.tau_f for rod in rods],
            "tau_x": [rod.material.tau_x for rod in rods],
            "heights": stated.heights,
        }
        written = [f"{key} = [{', '.join(map(_written, x))}]" for key, x in numbers.items()]
        lines += ["[[building]]", "[building.storeys]", *written, ""]
    for link in row.links:
        lines += ["[[link]]", *_link(link), ""]
    return "\n".join(lines)


def _link(link: jp.FloorLink) -> list[str]:
    """The keys of a [[link]]."""
    lines = [f"building = {link.building + 1}", f"floor = {link.floor + 1}"]
    if link.other_building == jp.GROUND:
        lines.append('next_building = "ground"')
    else:
        lines.append(f"next_building = {link.other_building + 1}")
        if link.other_floor != jp.GROUND:
            lines.append(f"next_floor = {link.other_floor + 1}")
    lines.append(f"friction_force = {_written(link.friction)}  # N")
    if link.gap < float("inf"):
        lines.append(f"gap = {_written(link.gap)}  # m")
    if link.contact is not None:
        lines.append(f"contact = {{{', '.join(_law(link.contact))}}}")
    return lines


def _law(law: Any) -> list[str]:
    """The keys of a law of contact."""
    (name,) = (name for name, kind in LAWS.items() if isinstance(law, kind))
    return [f'law = "{name}"', *(f"{key} = {_written(x)}" for key, x in vars(law).items())]


def _written(value: Any) -> str:
    """A number, word or truth as TOML has it."""
    return json.dumps(value if isinstance(value, bool | str) else float(value))
