"""Physical quantities: their units, their names in words, and what is plausible of them."""

from __future__ import annotations

from typing import NamedTuple

STANDARD_GRAVITY = 9.80665
"""Standard gravity, m/s²."""

SI = {
    "time": "s",
    "length": "m",
    "velocity": "m/s",
    "acceleration": "m/s²",
    "force": "N",
    "energy": "J",
    "mass": "kg",
}
"""SI unit of each kind of quantity."""

DIMENSIONLESS = {
    "time": "1/ω1",
    "length": "g/ω1²",
    "velocity": "g/ω1",
    "acceleration": "g",
    "force": "m1 g",
    "energy": "m1 g²/ω1²",
    "mass": "m1",
}
"""The same in eq. (9)."""


def unit(kind: str | None, si: bool) -> str:
    """Unit of a kind of quantity; nothing for a pure number."""
    return (SI if si else DIMENSIONLESS)[kind] if kind else ""


def column(name: str, kind: str | None, si: bool) -> str:
    """Name of a column in a table, with its SI unit: ``v1_m_per_s``.

    Dimensionless numbers have no unit in their names.
    """
    if not si or not kind:
        return name
    return f"{name}_{SI[kind].replace('/', '_per_').replace('²', '2')}"


class Range(NamedTuple):
    """What is plausible of a number in a configuration: from ``low`` to ``high``, and why."""

    low: float
    high: float
    unit: str
    why: str
    whole: bool = False
    """Whether it is a whole number."""

    def __contains__(self, value: object) -> bool:
        return isinstance(value, int | float) and self.low <= value <= self.high

    @property
    def rule(self) -> str:
        """Completes 'must be'."""
        if self.whole:
            return f"from {self.low} to {self.high}"
        return f"between {with_unit(f'{self.low:g} and {self.high:g}', self.unit)} ({self.why})"


def with_unit(number: str, unit: str) -> str:
    """A number and its unit, if it has one."""
    return f"{number} {unit}" if unit else number


# Wide enough for a laboratory's models and for the tallest towers, narrow enough to catch a wrong
# unit or a slip of the pen.
RANGES = {
    # Buildings and damper.
    "mass": Range(1e-3, 1e10, "kg", "from a model of a gram to ten times the heaviest tower"),
    "stiffness": Range(1e-6, 1e16, "N/m", "what such masses and periods make"),
    "period": Range(2e-3, 60, "s", "models shake at a hundredth of a second, towers in ten"),
    "damping_ratio": Range(0, 1, "", "of the critical damping; 0.05 is 5 %"),
    "order": Range(1e-3, 1, "", "of a fractional derivative, 1 for a classical one"),
    "tau_f": Range(1e-12, 1e6, "s^order", "a relaxation time to the power of the order"),
    "tau_x": Range(1e-12, 1e6, "s^order", "a relaxation time to the power of the order"),
    "friction_force": Range(0, 1e10, "N", "a thousand of the strongest dampers"),
    "gap": Range(0, 10, "m", "buildings farther apart do not meet"),
    # Ground motion.
    "amplitude": Range(-10, 10, "m", "no ground has moved farther"),
    "periods": Range(1e-3, 60, "s", "of a wavelet, for models and for towers"),
    "arrivals": Range(0, 3600, "s", "from the start of the run"),
    "intensity": Range(0, 1e3, "", "a factor on the amplitudes"),
    "factor": Range(-1e3, 1e3, "", "a factor on the record's acceleration"),
    "pga": Range(1e-6, 20, "g", "several times the largest ever recorded"),
    "weight": Range(0, 1e9, "", "a relative frequency"),
    "probability": Range(0, 1, "", "a probability"),
    # The run.
    "duration": Range(1e-3, 3600, "s", "at most an hour: the longest earthquakes take ten minutes"),
    "dt": Range(1e-7, 10, "s", "a time step"),
    "smoothing_velocity": Range(1e-9, 1, "m/s", "the damper slips at up to about 1 m/s"),
    # What a design is asked for.
    "temperature": Range(1e-9, 10, "m", "of the soft minimum of gaps"),
    "share": Range(1e-6, 1, "", "of the earthquakes"),
    "multiple": Range(0, 1e6, "", "a factor on the value above"),
    "penalty": Range(0, 1e9, "", "metres of the goal for a unit of the price"),
    "force": Range(1e-6, 1e12, "N", "a hundred times the weight of the heaviest tower"),
    "length": Range(1e-9, 1e3, "m", "up to a kilometre"),
    "acceleration": Range(1e-6, 1e4, "m/s²", "up to a thousand times gravity"),
    "energy": Range(1e-9, 1e15, "J", "a force and a length of these sizes"),
    # Counts.
    "accuracy": Range(1, 2, "", "an order of accuracy", whole=True),
    "count": Range(1, 2**31, "", "a number of them", whole=True),
    "count_or_none": Range(0, 2**31, "", "a number of them", whole=True),
    "seed": Range(0, 2**32 - 1, "", "a seed of 32 bits", whole=True),
}
"""What is plausible of every number that a configuration may hold, by quantity."""
