"""Physical quantities: their units, and their names in words."""

from __future__ import annotations

STANDARD_GRAVITY = 9.80665
"""Standard gravity, m/s²."""

MOST_PGA = 20.0
"""Peak ground acceleration above which a record is refused, in g: several times the largest ever
recorded."""

SI = {
    "time": "s",
    "length": "m",
    "velocity": "m/s",
    "acceleration": "m/s²",
    "force": "N",
    "energy": "J",
    "impulse": "N s",
    "mass": "kg",
    "stiffness": "N/m",
    "hertz stiffness": "N/m^1.5",
}
"""SI unit of each kind of quantity."""

DIMENSIONLESS = {
    "time": "1/ω1",
    "length": "g/ω1²",
    "velocity": "g/ω1",
    "acceleration": "g",
    "force": "m1 g",
    "energy": "m1 g²/ω1²",
    "impulse": "m1 g/ω1",
    "mass": "m1",
    "stiffness": "m1 ω1²",
    "hertz stiffness": "m1 ω1³/√g",
}
"""Unit of each kind of quantity in eq. (9)."""


def unit(kind: str | None, si: bool) -> str:
    """Unit of a kind of quantity; empty for a pure number."""
    return (SI if si else DIMENSIONLESS)[kind] if kind else ""


def column(name: str, kind: str | None, si: bool) -> str:
    """Name of a column in a table, with its SI unit: ``v1_m_per_s``.

    Dimensionless numbers have no unit in their names.
    """
    if not si or not kind:
        return name
    return f"{name}_{SI[kind].replace('/', '_per_').replace('²', '2').replace(' ', '_')}"
