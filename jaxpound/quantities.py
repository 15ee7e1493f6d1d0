"""Physical quantities: their units, and their names in words."""

from __future__ import annotations

SI = {
    "time": "s",
    "length": "m",
    "velocity": "m/s",
    "acceleration": "m/s²",
    "force": "N",
    "energy": "J",
}
"""SI unit of each kind of quantity."""

DIMENSIONLESS = {
    "time": "1/ω1",
    "length": "g/ω1²",
    "velocity": "g/ω1",
    "acceleration": "g",
    "force": "m1 g",
    "energy": "m1 g²/ω1²",
}
"""The same in eq. (9)."""

DEMANDS = {
    "min_gap": ("length", "smallest gap"),
    "min_gap_time": ("time", "time of the smallest gap"),
    "peak_x1": ("length", "peak displacement of building 1"),
    "peak_x2": ("length", "peak displacement of building 2"),
    "peak_f1": ("force", "peak base shear of building 1"),
    "peak_f2": ("force", "peak base shear of building 2"),
    "peak_acceleration_1": ("acceleration", "peak absolute acceleration of building 1"),
    "peak_acceleration_2": ("acceleration", "peak absolute acceleration of building 2"),
    "damper_force": ("force", "slip force of the damper"),
    "slip_distance": ("length", "distance slid by the damper"),
    "friction_work": ("energy", "energy taken by the damper"),
    "residual_offset": ("length", "residual offset"),
    "pga": ("acceleration", "peak ground acceleration"),
    "pgv": ("velocity", "peak ground velocity"),
    "required_gap": ("length", "required gap"),
    "soft_min_gap": ("length", "soft minimum of the gap"),
    "initial_gap": ("length", "gap at rest"),
}
"""Kind of each demand, and its name in words; what is not here is a pure number."""


def unit(kind: str | None, si: bool) -> str:
    """Unit of a kind of quantity; nothing for a pure number."""
    return (SI if si else DIMENSIONLESS)[kind] if kind else ""


def kind_of(name: str) -> str | None:
    """Kind of a demand; none of a pure number, and of what is no demand."""
    return DEMANDS[name][0] if name in DEMANDS else None


def unit_of(name: str, si: bool) -> str:
    """Unit of a demand; nothing for a column of which it is not known."""
    return unit(kind_of(name), si)


def column(name: str, kind: str | None, si: bool) -> str:
    """Name of a column in a table, with its SI unit: ``v1_m_per_s``.

    Dimensionless numbers have no unit in their names.
    """
    if not si or not kind:
        return name
    return f"{name}_{SI[kind].replace('/', '_per_').replace('²', '2')}"
