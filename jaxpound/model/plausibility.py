"""What is hardly meant in buildings and in what is between them, most often because of a unit.

Numbers beyond their ranges are refused as objects are made (``Parameter.within``). Here numbers
are judged beside each other: of pairs and rows alike, floor by floor, for the library and for the
command line. Traced numbers and batches are not judged.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import numpy as np

from jaxpound._checks import Range, is_traced
from jaxpound.model.contact import KelvinVoigt, Newton
from jaxpound.model.system import GROUND
from jaxpound.model.system import floors as floors_of
from jaxpound.quantities import SI, STANDARD_GRAVITY

if TYPE_CHECKING:
    from jaxpound.model.row import Row
    from jaxpound.model.structures import AdjacentStructures
    from jaxpound.units import Scales

FRICTION = Range(0, 1e10, "N", "a thousand of the strongest dampers")
GAP = Range(0, 10, "m", "buildings farther apart do not meet")

FAR_GAP = 5.0
"""Largest plausible ratio of a gap to what its two sides move: beyond it they never meet."""

MOST_RATIO = 100.0
"""Largest plausible ratio of the masses of floors."""

SLIP = 1e-3, 10.0
"""Plausible slip force: the least over the lightest floor's weight, the most over all weights."""

USUAL_PERIOD = Range(0.05, 10, "s", "models on shaking tables and the tallest towers")

LEAST_TOUCHING, MOST_TOUCHING = 1 / 250, 1 / 2
"""Plausible duration of a contact over the period of the lighter floor on its storey: at least, at
most. Contact of 20 times the storey's stiffness, and Hertz's of the literature, lasts 1/4 to 1/30
of it; beyond 1/2 it is softer than the storey. With masses in t for kg any contact lasts 1/300 or
less."""


def doubts(structures: AdjacentStructures | Row, scales: Scales) -> list[str]:
    """What is implausible in masses, periods, slip forces and contact laws, the first of each."""
    floors = _Floors.of(structures, scales)
    if floors is None:
        return []
    links = _links(structures, scales)
    slips = [link.slip(floors) for link in links]
    contacts = [link.touching(floors) for link in links]
    return [*floors.doubts(), *_first(slips), *_first(contacts)]


def too_wide(structures: AdjacentStructures | Row, scales: Scales) -> list[str]:
    """A finding if no earthquake closes a gap, of the first such gap.

    Where a run follows, its displacements say it better (``ground.plausibility.far_apart``).
    """
    floors = _Floors.of(structures, scales)
    if floors is None:
        return []
    return _first([link.width(floors) for link in _links(structures, scales)])


class _Floors(NamedTuple):
    """The floors of known buildings, by mass; in SI."""

    weights: np.ndarray
    masses: np.ndarray
    moved: np.ndarray
    """Displacement under an acceleration of 1 g, by the stiffness of the first mode."""
    periods: np.ndarray
    """Period of each floor on its own storey, by the same stiffness."""
    first_periods: tuple[float, ...]
    """Natural period of each building."""

    @staticmethod
    def of(structures: AdjacentStructures | Row, scales: Scales) -> _Floors | None:
        """Those of buildings that are known and no batch."""
        system = structures.system()
        leaves = jax.tree.leaves((system.masses, system.rods, scales))
        if is_traced(leaves) or any(np.ndim(leaf) for leaf in leaves):
            return None
        masses = np.array([float(mass) for mass in system.masses])
        stiffnesses, moved = np.ones_like(masses), np.ones_like(masses)
        with jax.ensure_compile_time_eval():  # all of this is known, in a traced function too
            frequencies = [float(omega) for omega in structures.natural_frequencies]
        for building, omega in zip(floors_of(system.topology), frequencies, strict=True):
            above = [mass for mass, _ in building]
            soft = np.array([float(system.rods[rod].stiffness) for _, rod in building])
            at_rest = np.cumsum(np.cumsum(masses[above][::-1])[::-1] / soft)
            # Rods are stiffer as they vibrate: Rayleigh's quotient of this shape says how much.
            share = masses[above] * at_rest
            stiffer = omega**2 * (share @ at_rest) / share.sum()
            stiffnesses[above], moved[above] = soft * stiffer, at_rest / stiffer
        time, mass = float(scales.time), float(scales.mass)
        return _Floors(
            weights=masses * mass * float(scales.gravity),
            masses=masses * mass,
            moved=moved * float(scales.length),
            periods=2 * np.pi * np.sqrt(masses / stiffnesses) * time,
            first_periods=tuple(2 * math.pi / omega * time for omega in frequencies),
        )

    def doubts(self) -> Iterator[str]:
        """What is implausible in masses and periods."""
        least, most = self.masses.min(), self.masses.max()
        if most > MOST_RATIO * least:
            yield (
                f"the masses of floors, {least:.4g} to {most:.4g} kg, should be within a factor of "
                f"{MOST_RATIO:g}: are all in kg?"
            )
        for number, period in enumerate(self.first_periods, 1):
            if period not in USUAL_PERIOD:
                yield (
                    f"building {number}: natural period = {period:.4g} s should be "
                    f"{USUAL_PERIOD.rule}: is it a period in s, mass in kg and stiffness in N/m?"
                )
                return


def _links(structures: AdjacentStructures | Row, scales: Scales) -> list[_Between]:
    """The links of structures, by the names of their arguments in messages."""
    system, alone = structures.system(), not hasattr(structures, "links")
    found = []
    for k, link in enumerate(system.links):
        names = ("friction_force", "gap", "contact")
        if not alone:
            names = (f"links.{k}.friction", f"links.{k}.gap", f"links.{k}.contact")
        force, gap = link.friction * scales.force, link.gap * scales.length
        ends = tuple(end for end in link.ends if end != GROUND)
        found.append(_Between(names, ends, force, gap, scales.contact_to_si(link.contact)))
    return found


class _Between(NamedTuple):
    """What is between two floors, or a floor and the ground; in SI."""

    names: tuple[str, str, str]
    """Of slip force, gap and law."""
    ends: tuple[int, ...]
    """The masses."""
    friction: Any
    gap: Any
    contact: Any

    def slip(self, floors: _Floors) -> str:
        """A finding if the slip force is out of proportion to the weights."""
        if not _is_one(self.friction):
            return ""
        low, high = SLIP[0] * floors.weights.min(), SLIP[1] * floors.weights.sum()
        force = float(self.friction)
        if not force or low <= force <= high:
            return ""
        return (
            f"{self.names[0]} = {force:.4g} N should be 0 or between {low:.4g} N, "
            f"{SLIP[0] * 100:g} % of the lightest floor's weight, and {high:.4g} N, ten times the "
            "weight of all: is it in N, and masses in kg?"
        )

    def width(self, floors: _Floors) -> str:
        """A finding if the gap is out of proportion to what both its sides may move."""
        if not _is_one(self.gap) or self.gap == np.inf:
            return ""
        gap, moved = float(self.gap), sum(floors.moved[end] for end in self.ends)
        if gap <= FAR_GAP * moved:
            return ""
        return (
            f"{self.names[1]} = {gap:.4g} m should be at most {FAR_GAP:g} times what the buildings "
            f"move at an acceleration of 1 g, {moved:.4g} m (both its sides): is it in m?"
        )

    def touching(self, floors: _Floors) -> str:
        """A finding if a contact lasts too long or too short beside the floors' own motion."""
        law = self.contact
        if law is None or isinstance(law, Newton) or not _is_one(law.stiffness):
            return ""
        masses = floors.masses[list(self.ends)]
        mass, period = 1 / (1 / masses).sum(), floors.periods[self.ends[int(masses.argmin())]]
        stiffness = float(law.stiffness)
        if linear := isinstance(law, KelvinVoigt):
            duration = math.pi * math.sqrt(mass / stiffness)
        else:  # of an impact at the speed that 1 g gives the lighter floor
            speed = STANDARD_GRAVITY * period / (2 * math.pi)
            depth = (1.25 * mass * speed**2 / stiffness) ** 0.4
            duration = _HERTZ * depth / speed
        low, high = LEAST_TOUCHING * period, MOST_TOUCHING * period
        if low <= duration <= high:
            return ""
        unit, more = SI["hertz stiffness"], "one in N/m is for KelvinVoigt"
        if linear:
            unit, more = SI["stiffness"], "contact_stiffness computes one"
        return (
            f"{self.names[2]}: stiffness = {stiffness:.4g} {unit} makes a contact last about "
            f"{duration:.2g} s, which should be between {low:.2g} and {high:.2g} s (1/250 and 1/2 "
            "of the lighter floor's period on its storey): "
            f"is it in {unit}, and masses in kg? {more}"
        )


def _first(findings: list[str]) -> list[str]:
    """The first finding that is one; links are often alike."""
    return list(filter(None, findings))[:1]


_HERTZ = 2.9432
"""Duration of an elastic impact after Hertz, in units of its depth over its speed (Hertz 1882)."""


def _is_one(value: Any) -> bool:
    """Whether a value is a known single number."""
    return not is_traced(value) and not np.ndim(value)
