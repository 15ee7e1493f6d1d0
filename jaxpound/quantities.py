"""What every number of a result measures, and in which unit."""

from __future__ import annotations

UNITS = {
    "time": ("1/ω1", "s"),
    "length": ("g/ω1²", "m"),
    "velocity": ("g/ω1", "m/s"),
    "acceleration": ("g", "m/s²"),
    "force": ("m1 g", "N"),
    "energy": ("m1 g²/ω1²", "J"),
}
"""Unit of each quantity: that of the dimensionless system (eq. 8), and the SI unit."""

SCALARS = {
    "min_gap": "length",
    "min_gap_time": "time",
    "peak_x1": "length",
    "peak_x2": "length",
    "peak_f1": "force",
    "peak_f2": "force",
    "peak_acceleration_1": "acceleration",
    "peak_acceleration_2": "acceleration",
    "slip_distance": "length",
    "friction_work": "energy",
    "residual_offset": "length",
    "pga": "acceleration",
    "pgv": "velocity",
    "soft_min_gap": "length",
    "required_gap": "length",
    "initial_gap": "length",
    "damper_force": "force",
}
"""Quantity of each scalar of a run; those that are not here are pure numbers."""


def unit(quantity: str | None, si: bool) -> str:
    """Unit of a quantity in words; nothing for a pure number."""
    return UNITS[quantity][si] if quantity else ""


def unit_of(name: str, si: bool) -> str:
    """Unit of a scalar in words."""
    return unit(SCALARS.get(name), si)


def column(name: str, quantity: str | None, si: bool) -> str:
    """Name of a column in a table, with its SI unit: ``v1_m_per_s``.

    Dimensionless numbers have no unit in their names.
    """
    if not si or not quantity:
        return name
    return f"{name}_{unit(quantity, si).replace('/', '_per_').replace('²', '2')}"
