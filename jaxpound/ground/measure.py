"""What a measure of intensity is, as hazard curves, fragilities and analyses of records tell it."""

from __future__ import annotations

import dataclasses
import re

from jaxpound.ground.formats import units
from jaxpound.quantities import DIMENSIONLESS, SI

_ACCELERATIONS = {unit.replace("2", "²"): size for unit, size in units.UNITS.items()}
_VELOCITIES = {SI["velocity"]: 1.0, "cm/s": 0.01}
_SIZES = (_ACCELERATIONS, _VELOCITIES, {DIMENSIONLESS["velocity"]: 1.0})
"""Units by what they are of, each with its size in SI; hazard analyses use the first."""

UNITS = tuple(unit for sizes in _SIZES[:2] for unit in sizes)
"""Units of accelerations and velocities that do not depend on the structures."""

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
_USUAL_DAMPING = 0.05
_PERIOD = re.compile(r"(?:\(|, ?|\bat |\bT\d* ?= ?)(\d*\.?\d+)(?![\d.]| ?%) ?(1/ω1|ms\b)?", re.I)
_DAMPING = re.compile(r"(\d*\.?\d+) ?%")
_SAME = 0.01  # by how much periods of one measure may differ, for they are told rounded


@dataclasses.dataclass(frozen=True)
class Measure:
    """A measure of intensity in words, and the unit of its numbers.

    Which measure it is, is known of peak ground accelerations, velocities and displacements, of
    spectral accelerations and some more, as OpenQuake and the USGS name them, and as they are
    written out; of other words nothing is known.
    """

    words: str
    """Without the unit."""
    unit: str = ""
    """Empty where it is not stated."""

    @staticmethod
    def of_text(text: str) -> Measure:
        """The measure of a text that may end with a unit in brackets, as ``"Sa(0.9 s) (g)"``."""
        parts = re.fullmatch(r"(.*?)\s*[(\[]\s*([^()\[\]]*?)\s*[)\]]\s*", text)
        unit = known_unit(parts[2]) if parts else ""
        return Measure(parts[1], unit) if parts and unit else Measure(text)

    @staticmethod
    def spectral_acceleration(period: float, time_unit: str) -> Measure:
        """Of 5 % of damping, in g."""
        return Measure(f"{_SPECTRAL}({period:.4g} {time_unit})", DIMENSIONLESS["acceleration"])

    def __str__(self) -> str:
        return f"{self.words} ({self.unit})" if self.unit else self.words

    @property
    def name(self) -> str:
        """Which measure it is; empty where that is not known."""
        words = self.words.replace("_", " ")
        alone = r"(?<![^\W\d])(?:{})(?![^\W\d])"
        names = (x for x, how in _NAMES.items() if re.search(alone.format(how), words, re.I))
        return next(names, "")

    @property
    def period(self) -> tuple[float, str] | None:
        """The natural period of a spectral acceleration in s or 1/ω1; None if it is not stated."""
        stated = _PERIOD.search(self.words) if self.name == _SPECTRAL else None
        if stated is None:
            return None
        number, unit = float(stated[1]), (stated[2] or "s").lower()
        return (number / 1000, "s") if unit == "ms" else (number, unit)

    @property
    def damping(self) -> float:
        """The damping ratio of a spectral acceleration: 5 % where it is not stated."""
        stated = _DAMPING.search(self.words) if self.name == _SPECTRAL else None
        return float(stated[1]) / 100 if stated else _USUAL_DAMPING

    def is_in_unit_of(self, other: Measure) -> bool:
        """Whether the units of both are stated, and the same but for their spelling."""
        sizes = units_like(self.unit)
        return other.unit in sizes and sizes[self.unit] == sizes[other.unit]

    def may_be(self, other: Measure) -> bool:
        """Whether both may be one measure, whatever their units: what is not stated may agree."""
        if not (self.name and other.name):
            return True
        if self.period and other.period:
            (mine, of_mine), (theirs, of_theirs) = self.period, other.period
            if of_mine != of_theirs or abs(mine - theirs) > _SAME * theirs:
                return False
        return self.name == other.name and abs(self.damping - other.damping) < _SAME


def known_unit(text: str) -> str:
    """A unit of motions as this package writes it, m/s² for m/s2; empty for another text."""
    spelled = units.whole_unit(units.UNIT, text) or text
    spelled = spelled.replace("2", "²")
    return spelled if any(spelled in sizes for sizes in _SIZES) else ""


def units_like(unit: str) -> dict[str, float]:
    """The units of what a unit is of, with their sizes in SI; none for an unknown one."""
    return next((sizes for sizes in _SIZES if unit in sizes), {})
