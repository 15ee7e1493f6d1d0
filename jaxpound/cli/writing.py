"""Buildings as a configuration of ``jaxpound simulate``."""

from __future__ import annotations

import json
from typing import Any

import jaxpound as jp
from jaxpound.cli.tables import LAWS


def as_toml(buildings: jp.Buildings) -> str:
    """Buildings as a configuration of ``jaxpound simulate``: two ``Building`` as a pair."""
    first, *others = buildings.buildings
    if isinstance(first, jp.Building):
        (link,) = buildings.links
        lines = [f"gap = {_written(link.gap)}  # m", ""]
        for i, building in enumerate((first, *others), start=1):
            numbers = [f"{key} = {_written(x)}" for key, x in vars(building).items()]
            lines += [f"[building_{i}]", *numbers, ""]
        lines += ["[damper]", f"friction_force = {_written(link.friction)}  # N", ""]
        return "\n".join(lines + (["[contact]", *_law(link.contact), ""] if link.contact else []))
    lines = []
    for building in buildings.buildings:
        lines += ["[[building]]", "[building.storeys]", *_storeys(building), ""]
    for link in buildings.links:
        lines += ["[[link]]", *_link(link), ""]
    return "\n".join(lines)


def _storeys(building: Any) -> list[str]:
    storeys = [vars(storey) for storey in building.storeys]
    plural = {"mass": "masses", "stiffness": "stiffnesses"}
    numbers = {plural.get(key, key): [storey[key] for storey in storeys] for key in storeys[0]}
    numbers["heights"] = building.heights
    return [f"{key} = [{', '.join(map(_written, x))}]" for key, x in numbers.items()]


def _link(link: jp.FloorLink) -> list[str]:
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
    (name,) = (name for name, kind in LAWS.items() if isinstance(law, kind))
    return [f'law = "{name}"', *(f"{key} = {_written(x)}" for key, x in vars(law).items())]


def _written(value: Any) -> str:
    """A number, word or truth as TOML has it."""
    return json.dumps(value if isinstance(value, bool | str) else float(value))
