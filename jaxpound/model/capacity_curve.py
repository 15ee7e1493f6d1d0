"""Pushover of a building that yields: base shear over drifts, under static loads."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import numpy as np

from jaxpound._checks import Rule, enforce, finite, instance, is_known_and_single, number
from jaxpound._errors import InvalidInput
from jaxpound.model.hysteresis import Bilinear
from jaxpound.model.shear_building import ShearBuilding
from jaxpound.model.strength import storey_shears

_AT_YIELD = 64  # place of e_y on the way of a storey
_NEVER = Bilinear(1e6)  # a law of a storey that does not yield


class Pushover(NamedTuple):
    """States of a building under static loads that grow from zero, n of them, in SI units."""

    base_shear: np.ndarray  # (n,)
    drifts: np.ndarray  # of each storey, from the ground up, (n, n_floors)
    yields: np.ndarray  # the state in which each storey yields, or -1, (n_floors,)


def pushover(building: ShearBuilding, ductility: float = 6.0) -> Pushover:
    """A building under static loads that grow until its critical storey has a ``ductility`` > 1.

    Loads are in proportion to mass and height, so that the shear of each storey is a share of the
    base shear; its drift follows from its law alone. The critical storey is the one that within the
    ductility withstands the least base shear; where it softens, the others unload with their
    stiffness K, and below a base shear of 0 the building has to be held. After ``with_p_delta`` the
    base shear is what the building withstands beside its weight. Raises ``ValueError`` if no storey
    yields, or a number is traced or breaks its rule.

    Examples
    --------
    >>> frame = jp.ShearBuilding.from_period(3, 300e3, period=0.5, damping_ratio=0.05)
    >>> pushed = jp.pushover(frame.yielding(yield_force=1e6), ductility=4.0)
    >>> round(float(pushed.base_shear[-1])), (pushed.yields > 0).tolist()
    (1000000, [True, False, False])
    """
    instance("building", building, ShearBuilding)
    storeys, most = building.storeys[: building.n_floors], number("ductility", ductility)
    if not is_known_and_single(building) or all(storey.hysteresis is None for storey in storeys):
        raise InvalidInput("building", "", "must yield, by single numbers, none traced")
    enforce([Rule("ductility", most, (most > 1) & finite(most), "above 1 and finite")])
    shares = np.array(storey_shears(storeys, building.elevations, 1.0), float)
    softness = shares / np.array([storey.stiffness for storey in storeys])
    ramp = np.append(np.linspace(0, 1, _AT_YIELD + 1), np.linspace(1, most, 129)[1:])
    laws = [_NEVER if s.hysteresis is None else s.hysteresis for s in storeys]
    drifts = [float(law.yield_displacement) * ramp for law in laws]
    shears = np.array([*map(_reduced, laws, drifts)]) / softness[:, None]
    # Up to the largest, as functions that have an inverse.
    rising = np.maximum.accumulate(shears, axis=1) * (1 + 1e-9 * ramp)
    critical = int(np.argmin(rising[:, -1]))
    drift, at_yield = drifts[critical], shears[:, _AT_YIELD]
    places = np.interp(at_yield, rising[critical], drift)
    reached = at_yield <= rising[critical, -1]
    path = np.union1d(drift, places[reached])
    base_shear = np.interp(path, drift, shears[critical])
    largest = np.maximum.accumulate(base_shear)
    ways = [np.interp(largest, *line) for line in zip(rising, drifts, strict=True)]
    every = np.stack(ways, axis=1) - np.outer(largest - base_shear, softness)
    every[:, critical] = path
    return Pushover(base_shear, every, np.where(reached, np.searchsorted(path, places), -1))


def _reduced(law: Any, drifts: np.ndarray) -> np.ndarray:
    """The reduced force of a rod that is stretched from rest to each drift."""
    within = np.minimum(drifts, getattr(law, "ultimate_displacement", np.inf))
    return np.asarray(jax.vmap(lambda e: law.reduced_force(e, law.start(e)))(within))
