"""Buildings on soil, and the soil between neighbours; in SI units."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax.numpy as jnp

from jaxpound._checks import Rule, enforce, instance, is_traced, number
from jaxpound._errors import InvalidInput, renamed
from jaxpound.model.building import Building
from jaxpound.model.dampers import Dashpot
from jaxpound.model.row import FloorLink
from jaxpound.model.shear_building import ShearBuilding
from jaxpound.model.soil import Footing, Soil
from jaxpound.model.system import Rod

FOOTING_NAMES = {"mass": "footing_mass", "inertia": "footing_inertia"}
"""Numbers of a ``Footing`` that have another name beside those of a building."""

_MOST_SHARED = 0.5  # of the stiffness of a footing


def on_soil(
    building: Any,
    soil: Soil,
    *,
    footing_mass: Any,
    radius: Any = None,
    length: Any = None,
    width: Any = None,
    embedment: Any = None,
    footing_inertia: Any = None,
    height: Any = None,
) -> Any:
    """A building on a rigid footing that sways and rocks on soil, with radiation of waves.

    Springs and dashpots of the cone model (Wolf 1994; Veletsos and Meek 1974) are those of
    ``Footing``. The ground of the building's storeys and dashpots, and of links from its floors to
    ``GROUND``, is the footing, and what acts within the building acts on motions relative to the
    rigid one of the footing. Bearings and tuned inerters are put in place before.

    Raises ``ValueError`` if the building is on soil already, a ``Building`` has no ``height``, the
    mass of the footing is below 1e-4 times that of floors and tuned masses, its inertia is below
    that of a thin plate of this mass, or a value breaks its rule.

    Parameters
    ----------
    building
        ``ShearBuilding`` or ``Building``; or ``Buildings``, each of them on a footing of its own of
        the same size.
    soil
        The soil.
    footing_mass
        Mass > 0, kg.
    radius
        Radius > 0 of a disk, m.
    length, width, embedment
        In its place, of a rectangle, as in ``Footing``.
    footing_inertia
        > 0, of the footing alone about its axis, kg m²; by default that of a thin plate.
    height
        Of the mass of a ``Building`` above its footing > 0, m, by which it rocks; None for a
        ``ShearBuilding``, which has heights.

    Examples
    --------
    >>> frame = jp.ShearBuilding.from_period(5, 300e3, period=0.6, damping_ratio=0.05)
    >>> sand = jp.Soil(shear_wave_velocity=200, density=1800, poisson_ratio=0.3)
    >>> building = jp.on_soil(frame, sand, length=15, width=12, footing_mass=400e3)
    >>> round(building.natural_period / frame.natural_period, 3)
    1.081
    """
    shape = {"radius": radius, "length": length, "width": width, "embedment": embedment}
    if isinstance(several := getattr(building, "buildings", None), tuple):
        numbers: Any = {"footing_mass": footing_mass, "footing_inertia": footing_inertia}
        blocks = [isinstance(x, Building) for x in several]
        heights = [height if is_block or not any(blocks) else None for is_block in blocks]
        pairs = zip(several, heights, strict=True)
        placed = tuple(on_soil(x, soil, **numbers, **shape, height=h) for x, h in pairs)
        return dataclasses.replace(building, buildings=placed)
    instance("building", building, ShearBuilding, Building)
    frame = _with_height(building, height)
    if frame.footing is not None:
        raise InvalidInput("building", "", "must not be on soil already")
    names = {f"footing.{key}": name for key, name in FOOTING_NAMES.items()}
    with renamed(names=FOOTING_NAMES | names):
        footing = Footing(soil, footing_mass, inertia=footing_inertia, **shape)
        return dataclasses.replace(frame, footing=footing)


def _with_height(building: Building | ShearBuilding, height: Any) -> ShearBuilding:
    """A building with the heights by which it rocks."""
    if isinstance(building, ShearBuilding):
        if height is not None:
            rule = "must be left out: a ShearBuilding has heights of its own"
            raise InvalidInput("height", str(height), rule)
        return building
    if height is None:
        rule = "must be stated, in m: a Building, which has none, rocks by its square"
        raise InvalidInput("height", "None", rule)
    with renamed(names={"heights.0": "height"}):
        return ShearBuilding((building,), heights=height)


def through_soil(
    left: ShearBuilding, right: ShearBuilding, share: Any, *, building: int = 0
) -> tuple[FloorLink, ...]:
    """The link through the soil between the footings of neighbours: a spring and a dashpot.

    It has a share of the sway of the footings, of their geometric mean if these differ: 5 to 25 %
    at clear distances below the width of a footing. Spring and dashpot are numbers of the link,
    computed here: they do not follow a soil that is changed later, or is random in a study.

    Raises ``ValueError`` if a building is not on soil or the share is not from 0 to 0.5.

    Parameters
    ----------
    left, right
        The buildings.
    share
        Of stiffness and dashpot; 0 makes no link, so that a traced share is to be more than 0.
    building
        The number of the left one in ``Buildings``, from 0.

    Examples
    --------
    >>> frame = jp.ShearBuilding.from_period(2, 300e3, period=0.4, damping_ratio=0.05)
    >>> sand = jp.Soil(shear_wave_velocity=200, density=1800, poisson_ratio=0.3)
    >>> building = jp.on_soil(frame, sand, radius=6, footing_mass=300e3)
    >>> pair = jp.Buildings((building, building), jp.model.through_soil(building, building, 0.1))
    >>> jp.modes(pair).periods[:2].round(4).tolist()
    [0.4242, 0.422]
    """
    footings = []
    for name, x in (("left", left), ("right", right)):
        instance(name, x, ShearBuilding)
        if x.footing is None:
            raise InvalidInput(f"{name}.footing", "None", "must be stated: on_soil(building, …)")
        footings.append(x.footing)
    share = number("share", share)
    says = f"between 0 and {_MOST_SHARED:g}"
    enforce([Rule("share", share, (share >= 0) & (share <= _MOST_SHARED), says)])
    if not is_traced(share) and not share:
        return ()
    a, b = footings
    k = share * jnp.sqrt(a.sway_stiffness * b.sway_stiffness)
    c = share * jnp.sqrt(a.sway_damping * b.sway_damping)
    ends = len(left.storeys), len(right.storeys)
    return (FloorLink(building, *ends, damper=Rod(Dashpot(c), k)),)
