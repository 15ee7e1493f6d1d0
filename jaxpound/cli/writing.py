"""Buildings as a configuration of ``jaxpound simulate``."""

from __future__ import annotations

import json
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
        (name,) = (name for name, kind in LAWS.items() if isinstance(law, kind))
        numbers = [f"{key} = {_written(x)}" for key, x in vars(law).items()]
        lines += ["[contact]", f'law = "{name}"', *numbers, ""]
    return "\n".join(lines)


def _written(value: Any) -> str:
    """A number, word or truth as TOML has it."""
    return json.dumps(value if isinstance(value, bool | str) else float(value))
