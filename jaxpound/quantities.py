"""Physical quantities: their units, and their names in words."""

from __future__ import annotations

STANDARD_GRAVITY = 9.80665
"""Standard gravity, m/s²."""

MOST_PGA = 20.0  # that a file may hold, g: several times the largest ever recorded

_UNITS = {  # of each kind of quantity
    "time": ("s", "1/ω1"),
    "length": ("m", "g/ω1²"),
    "velocity": ("m/s", "g/ω1"),
    "acceleration": ("m/s²", "g"),
    "force": ("N", "m1 g"),
    "energy": ("J", "m1 g²/ω1²"),
    "impulse": ("N s", "m1 g/ω1"),
    "mass": ("kg", "m1"),
    "stiffness": ("N/m", "m1 ω1²"),
    "damping": ("N s/m", "m1 ω1"),
    "rigidity": ("N m²", "m1 g³/ω1⁴"),
    "hertz stiffness": ("N/m^1.5", "m1 ω1³/√g"),
}
SI = {kind: unit for kind, (unit, _) in _UNITS.items()}
DIMENSIONLESS = {kind: unit for kind, (_, unit) in _UNITS.items()}  # of eq. (9)


def unit(kind: str | None, si: bool) -> str:
    """Unit of a kind of quantity; empty for a pure number."""
    return (SI if si else DIMENSIONLESS)[kind] if kind else ""


def column(name: str, kind: str | None, si: bool) -> str:
    """Name of a column in a table, with its unit if that is one of SI: ``v1_m_per_s``."""
    if not si or not kind:
        return name
    return f"{name}_{SI[kind].replace('/', '_per_').replace('²', '2').replace(' ', '_')}"
