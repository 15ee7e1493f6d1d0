"""Implausible combinations of numbers in buildings and links, most often because of a unit.

Numbers beyond their ranges are refused as objects are made (``Parameter.within``); this module
compares numbers with each other, floor by floor. It skips traced numbers and batches.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, NamedTuple

import jax
import numpy as np

from jaxpound._checks import Range, is_known_and_single
from jaxpound._fields import Parameter, walk
from jaxpound.model.hysteresis import hysteresis_of
from jaxpound.model.places import link_places, rod_places
from jaxpound.model.system import Link, System
from jaxpound.model.topology import GROUND, AnyEnds, footings, on_soil, stacks, two_ends
from jaxpound.quantities import SI, STANDARD_GRAVITY

if TYPE_CHECKING:
    from jaxpound.buildings import Buildings

FRICTION = Range(0, 1e10, "N", "a thousand of the strongest dampers")
GAP = Range(0, 10, "m", "buildings farther apart do not meet")

FAR_GAP = 5.0
"""Largest plausible ratio of a gap to the displacements of its sides: beyond it they never meet."""

MOST_RATIO = 100.0
"""Largest plausible ratio of the masses of floors."""

SLIP = 1e-3, 10.0
"""Plausible slip force: least over the lightest floor's weight, most over the whole weight."""

LEAST_FOOTING = 9e-4
"""Least plausible mass of a footing over those on it: that of a floor and more is usual, and a
thousandth stands for a massless one; one in t beside floors in kg has less."""

USUAL_PERIOD = Range(0.05, 10, "s", "models on shaking tables and the tallest towers")

LEAST_MASS, MODEL_PERIOD = 9e3, 0.25
"""Least plausible mass of the heaviest floor, kg: a shed has 10 t. Below are floors of up to 900 t
with the mass in t or the weight in kN. Models on shaking tables are lighter, and quicker than a
period, s."""

MOST_MASS = {20: 1e7, 2: 2.5e6, 0: np.inf}
"""Most plausible mass of a floor, kg, of more than so many storeys: 50 m by 50 m have 2,500 t,
floors of the tallest 7,000 t, one or two storeys may stand for a tower. Beyond are floors of 255 t
and more with the weight in N."""

STRENGTH = 0.005, 3.0
"""Plausible force at yield: least over the weight above, most over the building's. Weak towers
yield at 2 %; the strongest spectra of codes, of 2 g, make 3 with an overstrength of 1.5."""

MOST_INERTANCE = 10.0
"""Largest plausible inertance over the mass of all floors; that of dampers is .01 to 1 times it."""

LEAST_TOUCHING, MOST_TOUCHING = 1 / 250, 1 / 2
"""Plausible duration of a contact over the period of the lighter floor on its storey. Contact of 20
times the storey's stiffness, and Hertz's of the literature, lasts 1/4 to 1/30 of it; beyond 1/2 it
is softer than the storey. With masses in t for kg any contact lasts 1/300 or less."""

_STIFFNESSES = "stiffness", "hertz stiffness"
"""Kinds of a stiffness of contact; a law of one's own that states none is not judged."""

_HERTZ = 2.9432
"""Duration of an elastic impact after Hertz, in units of its depth over its speed (Hertz 1882)."""


def doubts(buildings: Buildings) -> list[str]:
    """The first finding of each kind: in masses, periods, strengths, slip forces, laws, gaps.

    Gaps are too wide if no earthquake closes them; of dimensionless structures in a run its
    displacements decide (``ground.plausibility.far_apart``).
    """
    system = buildings.system()
    if (floors := _Floors.of(buildings, system)) is None:
        return []
    places = [f"link {place}" for place in link_places(system.topology)]
    links = [*zip(places, system.links, strict=True)]
    soil = on_soil(system.topology)  # no storey of its own says how footings move
    between_floors = [x for x in links if not soil & {*_two_masses(x[1].ends)}]
    findings = [
        *floors.doubts(),
        *_undamped(buildings),
        *_light_footing(buildings),
        *_first(floors.strengths),
        *_first(_slip(*x, floors) for x in links),
        *_first(_touching(*x, floors) for x in between_floors),
    ]
    # The size of masses is for those in which nothing else asks for their unit.
    return (findings or floors.size()) + _first(_width(*x, floors) for x in between_floors)


def _undamped(buildings: Buildings) -> list[str]:
    """A finding for the first building in which nothing takes energy."""
    for number, building in enumerate(buildings.buildings, 1):
        rods = [
            x
            for storey in building.storeys
            for x in (storey.order, storey.hysteresis, storey.dashpot)
        ]
        if all(x is None for x in [*rods, getattr(building, "damping", None)]):
            return [
                f"building {number} has no damping: damping=jp.Rayleigh(0.05), or order, tau_f and "
                "tau_x of its rods, give it some; Rayleigh(0.0) says that there is none"
            ]
    return []


def _light_footing(buildings: Buildings) -> list[str]:
    """A finding for the first footing that is far lighter than what stands on it."""
    for number, building in enumerate(buildings.buildings, 1):
        if (footing := building.footing) is None:
            continue
        least = LEAST_FOOTING * sum(storey.mass for storey in building.storeys)
        if footing.mass < least:
            return [
                f"the footing of building {number} has a mass of {footing.mass:.4g} kg, "
                f"should be at least {least:.4g} kg: that of a floor and more is usual"
            ]
    return []


class _Floors(NamedTuple):
    """The floors of concrete buildings, by mass; in SI."""

    weights: np.ndarray  # also of footings
    masses: np.ndarray
    inertias: np.ndarray  # masses with the inertances at each
    others: tuple[int, ...]  # tuned masses, footings and rotations, which are no floors
    moved: np.ndarray  # displacement under 1 g, by the stiffness of the first mode
    periods: np.ndarray  # of each floor on its own storey, by the same stiffness
    first_periods: tuple[float, ...]  # natural period of each building
    buildings: list[list[int]]  # masses of each
    inertance: float  # the largest
    strengths: list[str]  # a finding, or none, for each storey that yields

    @staticmethod
    def of(structures: Buildings, system: System) -> _Floors | None:
        """Those of buildings and their system; None if they are traced or a batch."""
        inerters = [(link.ends, link.inerter) for link in system.links if link.inerter]
        if not is_known_and_single((system.masses, system.rods, inerters, structures.gravity)):
            return None
        masses, gravity = np.array([*map(float, system.masses)]), float(structures.gravity)
        stiffnesses, moved = np.ones_like(masses), np.ones_like(masses)
        places, buildings, strengths = rod_places(system.topology), list[list[int]](), []
        with jax.ensure_compile_time_eval():  # concrete numbers, in a traced function too
            frequencies = [float(omega) for omega in structures.natural_frequencies]
        for building, omega in zip(stacks(system.topology), frequencies, strict=True):
            above = [mass for mass, _ in building]
            soft = np.array([float(system.rods[rod].stiffness) for _, rod in building])
            carried = gravity * np.cumsum(masses[above][::-1])[::-1]
            at_rest = np.cumsum(carried / soft)
            buildings.append(above)
            for (_, rod), k, weight in zip(building, soft, carried, strict=True):
                if (law := hysteresis_of(system.rods[rod].material)) is not None:
                    force = k * float(law.yield_displacement)
                    strengths.append(_strength(places[rod], force, weight, carried[0]))
            # Rods are stiffer in vibration, by Rayleigh's quotient of this shape.
            weights = masses[above] * at_rest
            stiffer = omega**2 / gravity * (weights @ at_rest) / weights.sum()
            stiffnesses[above], moved[above] = soft * stiffer, at_rest / stiffer
        rotations = [*footings(system.topology).values()]
        masses[rotations] = 0.0
        inertias = masses.copy()
        for ends, inerter in inerters:
            inertias[_two_masses(ends)] += float(inerter.inertance)
        return _Floors(
            weights=np.delete(masses, rotations) * gravity,
            masses=masses,
            inertias=inertias,
            others=(*system.topology.tuned, *on_soil(system.topology)),
            moved=moved,
            periods=2 * np.pi * np.sqrt(masses / stiffnesses),
            first_periods=tuple(2 * math.pi / omega for omega in frequencies),
            buildings=buildings,
            inertance=max((float(x.inertance) for _, x in inerters), default=0.0),
            strengths=strengths,
        )

    def doubts(self) -> Iterator[str]:
        """Findings in masses and periods."""
        inertias, masses = (np.delete(x, self.others) for x in (self.inertias, self.masses))
        least, most = inertias.min(), inertias.max()
        if most > MOST_RATIO * least:
            inertances = " with inertances" if (inertias != masses).any() else ""
            yield (
                f"the masses of floors{inertances}, {least:.4g} to {most:.4g} kg, should be within "
                f"a factor of {MOST_RATIO:g}: are all in kg?"
            )
        for number, period in enumerate(self.first_periods, 1):
            if period not in USUAL_PERIOD:
                yield (
                    f"building {number}: natural period = {period:.4g} s should be "
                    f"{USUAL_PERIOD.rule}: is it a period in s, mass in kg and stiffness in N/m?"
                )
                break
        if self.inertance > (most := MOST_INERTANCE * masses.sum()):
            yield (
                f"inertance = {self.inertance:.4g} kg should be at most {most:.4g} kg, "
                f"{MOST_INERTANCE:g} times the mass of all floors: is it in kg?"
            )

    def size(self) -> list[str]:
        """A finding in the heaviest floor."""
        heaviest, rules = np.delete(self.masses, self.others).max(), list[str]()
        if heaviest < LEAST_MASS and max(self.first_periods) > MODEL_PERIOD:
            rules = [f"{heaviest:.4g} kg, should be at least {LEAST_MASS:g}"]
        for x in (self.masses[floors] for floors in self.buildings):
            most = next(mass for storeys, mass in MOST_MASS.items() if x.size > storeys)
            if x.max() > most:
                rules.append(f"{x.max():.4g} kg, should be at most {most:g}")
        question = "are masses in kg, not in t, and no weights in kN or N?"
        return [f"the heaviest floor, of {rule} kg: {question}" for rule in rules[:1]]


def _strength(place: str, force: float, carried: float, whole: float) -> str:
    """A finding if a storey's force at yield is out of proportion to the weights; in N."""
    low, high = STRENGTH[0] * carried, STRENGTH[1] * whole
    if low <= force <= high:
        return ""
    return (
        f"{place}: the force at yield, {force:.4g} N, should be between {low:.4g} N, "
        f"{STRENGTH[0] * 100:g} % of the weight above, and {high:.4g} N, {STRENGTH[1]:g} times the "
        "building's weight: is it in N, or as a coefficient not in %, and masses in kg?"
    )


def _slip(place: str, link: Link, floors: _Floors) -> str:
    """A finding if the slip force is out of proportion to the weights."""
    if not is_known_and_single(link.friction):
        return ""
    low, high = SLIP[0] * floors.weights.min(), SLIP[1] * floors.weights.sum()
    force = float(link.friction)
    if not force or low <= force <= high:
        return ""
    return (
        f"{place}: slip force = {force:.4g} N should be 0 or between {low:.4g} N, "
        f"{SLIP[0] * 100:g} % of the lightest floor's weight, and {high:.4g} N, ten times the "
        "weight of all: is it in N, and masses in kg?"
    )


def _width(place: str, link: Link, floors: _Floors) -> str:
    """A finding if the gap is out of proportion to the displacements of both its sides."""
    if not is_known_and_single(link.gap) or link.gap == np.inf:
        return ""
    gap, moved = float(link.gap), floors.moved[_two_masses(link.ends)].sum()
    if gap <= FAR_GAP * moved:
        return ""
    return (
        f"{place}: gap = {gap:.4g} m should be at most {FAR_GAP:g} times what the buildings move "
        f"at an acceleration of 1 g, {moved:.4g} m (both its sides): is it in m?"
    )


def _touching(place: str, link: Link, floors: _Floors) -> str:
    """A finding if a contact lasts too long or too short beside the floors' periods."""
    of_law = {parameter.kind: x for _, parameter, x in walk(link.contact, Parameter)}
    kind = next(filter(of_law.__contains__, _STIFFNESSES), "")
    if not kind or link.column or not is_known_and_single(of_law[kind]):
        return ""
    ends = _two_masses(link.ends)
    masses, stiffness, unit = floors.masses[ends], float(of_law[kind]), SI[kind]
    mass, period = 1 / (1 / masses).sum(), floors.periods[ends[int(masses.argmin())]]
    if kind == "stiffness":
        duration = math.pi * math.sqrt(mass / stiffness)
        advice = "contact_stiffness computes one"
    else:  # of an impact at the speed that 1 g gives the lighter floor
        advice = "one in N/m is for KelvinVoigt"
        speed = STANDARD_GRAVITY * period / (2 * math.pi)
        depth = (1.25 * mass * speed**2 / stiffness) ** 0.4
        duration = _HERTZ * depth / speed
    low, high = LEAST_TOUCHING * period, MOST_TOUCHING * period
    if low <= duration <= high:
        return ""
    return (
        f"{place}: stiffness = {stiffness:.4g} {unit} makes a contact last about {duration:.2g} s, "
        f"which should be between {low:.2g} and {high:.2g} s (1/250 and 1/2 of the lighter floor's "
        f"period on its storey): is it in {unit}, and masses in kg? {advice}"
    )


def _two_masses(ends: AnyEnds) -> list[int]:
    """The masses that a link is between, without the ground and other supports."""
    return [end for end in two_ends(ends) if end > GROUND]


def _first(findings: Iterable[str]) -> list[str]:
    """The first finding that is not empty; links often repeat the same one."""
    return list(filter(None, findings))[:1]
