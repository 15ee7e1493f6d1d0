"""Intensity measures in the words of hazard curves, fragilities and analyses of records."""

from __future__ import annotations

import dataclasses
import re

from jaxpound.ground.formats import units
from jaxpound.quantities import DIMENSIONLESS, SI

# Units by quantity, each with its size in SI; hazard analyses use the first.
_SIZES = (
    {unit.replace("2", "²"): size for unit, size in units.UNITS.items()},
    {SI["velocity"]: 1.0, "cm/s": 0.01},
    {DIMENSIONLESS["velocity"]: 1.0},
)
UNITS = tuple(unit for sizes in _SIZES[:2] for unit in sizes)  # independent of the structures

_NAMES = {
    "PGA": "pga|peak ground acceleration",
    "PGV": "pgv|peak ground velocity",
    "PGD": "pgd|peak ground displacement",
    "AvgSA": "(?:avg|average) ?(?:sa|spectral acceleration)",
    "Sa": "p?sa|spectral acceleration",
    "Arias intensity": "ia|arias(?: intensity)?",
    "CAV": "cav|cumulative absolute velocity",
}
_SPECTRAL = "Sa"
_PERIOD = re.compile(r"(?:\(|, ?|\bat |\bT\d* ?= ?)(\d*\.?\d+)(?![\d.]| ?%) ?(1/ω1|ms\b)?", re.I)
_DAMPING = re.compile(r"(\d*\.?\d+) ?%")
_SAME = 0.01  # largest relative difference of equal periods, which are rounded in texts


@dataclasses.dataclass(frozen=True)
class Measure:
    """A measure of intensity in words, and the unit of its numbers.

    Peak ground accelerations, velocities and displacements, spectral accelerations and some more
    are recognised, by the names of OpenQuake and the USGS and written out.
    """

    words: str  # without the unit
    unit: str = ""  # empty if it is not stated

    @staticmethod
    def of_text(text: str) -> Measure:
        """The measure of a text that may end with a unit in brackets, as ``"Sa(0.9 s) (g)"``."""
        parts = re.fullmatch(r"(.*?)\s*[(\[]\s*([^()\[\]]*?)\s*[)\]]\s*", text)
        unit = measure_unit(parts[2]) if parts else ""
        return Measure(parts[1], unit) if parts and unit else Measure(text)

    @staticmethod
    def spectral_acceleration(
        period: float, time_unit: str, unit: str = DIMENSIONLESS["acceleration"]
    ) -> Measure:
        """Spectral acceleration with 5 % of damping."""
        return Measure(f"{_SPECTRAL}({period:.4g} {time_unit})", unit)

    def __str__(self) -> str:
        return f"{self.words} ({self.unit})" if self.unit else self.words

    @property
    def name(self) -> str:
        """The standard name of the measure; empty for unrecognised words."""
        words = self.words.replace("_", " ")
        alone = r"(?<![^\W\d])(?:{})(?![^\W\d])"
        names = (x for x, how in _NAMES.items() if re.search(alone.format(how), words, re.I))
        return next(names, "")

    @property
    def period(self) -> tuple[float, str] | None:
        """The natural period of a spectral acceleration in s or 1/ω1; None if it is not stated."""
        if self.name != _SPECTRAL or not (match := _PERIOD.search(self.words)):
            return None
        number, unit = float(match[1]), (match[2] or "s").lower()
        return (number / 1000, "s") if unit == "ms" else (number, unit)

    @property
    def damping(self) -> float:
        """The damping ratio of a spectral acceleration: 5 % where it is not stated."""
        match = _DAMPING.search(self.words) if self.name == _SPECTRAL else None
        return float(match[1]) / 100 if match else 0.05

    def may_be(self, other: Measure) -> bool:
        """Whether both may be the same measure, regardless of units and of what is not stated."""
        if not (self.name and other.name):
            return True
        if self.period and other.period:
            (period, unit), (other_period, other_unit) = self.period, other.period
            if unit != other_unit or abs(period - other_period) > _SAME * other_period:
                return False
        return self.name == other.name and abs(self.damping - other.damping) < _SAME


def measure_unit(text: str) -> str:
    """A unit of motions in this package's spelling, m/s² for m/s2; empty for another text."""
    spelled = (units.whole_unit(text) or text).replace("2", "²")
    return spelled if any(spelled in sizes for sizes in _SIZES) else ""


def units_like(unit: str) -> dict[str, float]:
    """The units of the same quantity, with their sizes in SI; empty for an unknown unit."""
    return next((sizes for sizes in _SIZES if unit in sizes), {})
