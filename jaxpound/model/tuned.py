"""Tuned masses and tuned inerters on a building; in SI units."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax.numpy as jnp

from jaxpound._checks import instance, is_whole, positive
from jaxpound._errors import InvalidInput, renamed
from jaxpound.model.building import Building
from jaxpound.model.dampers import Inerter
from jaxpound.model.row import FloorLink
from jaxpound.model.shear_building import ShearBuilding, in_units
from jaxpound.model.topology import GROUND

_DEVICE = 0.01  # ratio of the small mass over that of the inertance, by default


def tuned_mass_damper(
    building: Building | ShearBuilding,
    mass_ratio: Any,
    *,
    frequency_ratio: Any = None,
    damping_ratio: Any = None,
) -> ShearBuilding:
    """A building with a tuned mass on a spring and a dashpot on its roof.

    Parameters
    ----------
    building
        The building.
    mass_ratio
        m > 0, the tuned mass over the modal mass of the first mode at the roof.
    frequency_ratio
        > 0, frequency of the tuned mass over that of the first mode; by default 1/(1 + m).
    damping_ratio
        > 0, of the tuned mass alone, at its own frequency; by default √(3 m/(8 (1 + m))). Both are
        those of Den Hartog (1956), for an undamped building under a harmonic load; his damping
        refers to the frequency of the building and is 1 + m times smaller.

    Examples
    --------
    >>> frame = jp.ShearBuilding.from_period(4, 300e3, period=0.5, damping_ratio=0.02)
    >>> tuned = jp.tuned_mass_damper(frame, mass_ratio=0.05)
    >>> tuned.n_floors, [round(float(x), 3) for x in tuned.modes().periods[:2]]
    (4, [0.565, 0.466])
    """
    (ratio,) = positive(mass_ratio=mass_ratio)
    mode = _FirstMode.of(building)
    return mode.tuned(ratio, ratio * mode.mass, 0.0, frequency_ratio, damping_ratio)


def tuned_inerter_damper(
    building: Building | ShearBuilding,
    inertance_ratio: Any,
    *,
    mass_ratio: Any = None,
    floor: int = GROUND,
    number: int = 0,
    frequency_ratio: Any = None,
    damping_ratio: Any = None,
) -> tuple[ShearBuilding, tuple[FloorLink]]:
    """A building with a tuned inerter on its roof, and the link that is its inerter.

    A spring and a dashpot lead from the roof to a small mass, a tuned mass, and an inerter from
    there to a floor below (Lazar, Neild and Wagg 2014). With a larger mass it is the tuned mass
    damper inerter of Marian and Giaralis (2014).

    Parameters
    ----------
    building
        The building.
    inertance_ratio
        b > 0: the inertance times (1 − φ)² over the modal mass of the first mode, which is φ at
        that floor, 0 at the ground and 1 at the roof.
    mass_ratio
        m > 0, the small mass over the modal mass of the first mode at the roof; by default a
        hundredth of the ratio of the inertance.
    floor
        The floor at the other end, from 0; ``GROUND`` by default. The nearer it is to the roof, the
        larger is the inertance for the same ratio.
    number
        The number of the building in ``Buildings``, from 0.
    frequency_ratio
        > 0, frequency of mass and inertance on the spring over that of the first mode; by default
        1/(1 + r) with r = b + m.
    damping_ratio
        > 0, at that frequency; by default √(3 r/(8 (1 + r))). Both are those of Den Hartog (1956)
        as in ``tuned_mass_damper``; one storey with its inerter to the ground obeys his equations.

    Examples
    --------
    >>> frame = jp.ShearBuilding.from_period(4, 300e3, period=0.5, damping_ratio=0.02)
    >>> tuned, links = jp.tuned_inerter_damper(frame, 0.05)
    >>> print(links[0], f"{links[0].inerter.inertance / 1e3:.1f} t")
    1–ground, floor 5 34.8 t
    """
    (ratio,) = positive(inertance_ratio=inertance_ratio)
    mode = _FirstMode.of(building)
    if mode.frame.footing is not None:
        rule = "must be put on soil afterwards: on_soil(tuned_inerter_damper(…)[0], …)"
        raise InvalidInput("building", "", rule)
    roof = len(mode.frame.storeys) - 1
    if not (is_whole(floor) and GROUND <= floor < roof):
        below = f"a floor below the roof, from 0 to {roof - 1}, or GROUND" if roof else "GROUND"
        raise InvalidInput("floor", repr(floor), f"must be {below}")
    inertance = ratio * mode.mass / (1 - (0.0 if floor == GROUND else mode.shape[floor])) ** 2
    if mass_ratio is None:
        mass_ratio = _DEVICE * ratio
    (light,) = positive(mass_ratio=mass_ratio)
    masses = light * mode.mass, inertance
    tuned = mode.tuned(ratio + light, *masses, frequency_ratio, damping_ratio)
    ends: dict[str, Any] = {"next_building": GROUND}
    if floor != GROUND:
        ends = {"next_building": number, "next_floor": int(floor)}
    with renamed(names={"building": "number"}):
        return tuned, (FloorLink(number, roof + 1, inerter=Inerter(inertance), **ends),)


@dataclasses.dataclass(frozen=True)
class _FirstMode:
    """The first mode of a building: its shape is 1 at the roof."""

    frame: ShearBuilding
    shape: Any
    mass: Any
    period: Any

    @staticmethod
    def of(building: Any) -> _FirstMode:
        instance("building", building, ShearBuilding, Building)
        frame = building if isinstance(building, ShearBuilding) else ShearBuilding((building,))
        modes, roof = frame.modes(), len(frame.storeys) - 1
        shape = (modes.shapes[:, 0] / modes.shapes[roof, 0]).real
        masses = in_units(frame, 1.0, 1.0, 1.0).masses  # with footing and rotation
        mass = sum(x * shape[i] ** 2 for i, x in enumerate(masses))
        return _FirstMode(frame, shape, mass, frame.natural_period)

    def tuned(
        self, ratio: Any, mass: Any, inertance: Any, frequency: Any, damping: Any
    ) -> ShearBuilding:
        """The building with a mass that, with an inertance, is tuned."""
        tuning = 1 / (1 + ratio) if frequency is None else frequency
        damping = jnp.sqrt(3 * ratio / (8 * (1 + ratio))) if damping is None else damping
        tuning, damping = positive(frequency_ratio=tuning, damping_ratio=damping)
        with renamed(names={"mass": "mass_ratio: mass", "period": "frequency_ratio: period"}):
            both = Building.from_period(mass + inertance, self.period / tuning, damping, None)
            top = dataclasses.replace(both, mass=mass)
        storeys, heights = self.frame.storeys, self.frame.heights
        return dataclasses.replace(
            self.frame,
            storeys=(*storeys, top),
            heights=(*heights, heights[-1] / 2),
            n_tuned=self.frame.n_tuned + 1,
        )
