"""Pushover of a building that yields: base shear over roof displacement, by static loads."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import numpy as np

from jaxpound._checks import Rule, enforce, instance, is_known_and_single, number, require_one_of
from jaxpound._errors import InvalidInput
from jaxpound.model.building import Building
from jaxpound.model.shear_building import ShearBuilding
from jaxpound.model.strength import storey_shears

_YIELDS = 64  # place of e_y on the way of a storey
_FAR = 1e9  # m: a storey that never yields has a straight line
_ROUNDED = 1 + 1e-9


@dataclasses.dataclass(frozen=True, eq=False)
class Pushover:
    """States of a building under growing static loads, n of them, from none on."""

    base_shear: np.ndarray
    """Shape (n,), N."""
    drifts: np.ndarray
    """Drift of each storey, from the ground up, shape (n, n_floors), m."""
    yields: tuple[int | None, ...]
    """The state in which each storey yields; None where it does not."""

    @property
    def roof_displacement(self) -> np.ndarray:
        """Shape (n,), m."""
        return self.drifts.sum(axis=1)


def pushover(building: ShearBuilding, ductility: float = 6.0, loads: str = "height") -> Pushover:
    """Static pushover of a building, until the ductility of its critical storey.

    Loads in a constant proportion make the shear of each storey a share of the base shear. So the
    drift of each follows from its own law, exactly: storeys are springs in series. The critical
    storey is the one whose strength, up to the ductility, allows the least base shear. Where it
    softens, the other storeys unload with their stiffness K.

    Raises ``ValueError`` if no storey yields, or a number is not known or breaks its rule.

    Parameters
    ----------
    building
        The building; after ``with_p_delta``, shears are what its storeys withstand beside the
        weight.
    ductility
        Drift over that at yield of the critical storey at the end, above 1.
    loads
        "height", in proportion to mass and height, or "first mode", to mass and mode shape.

    Examples
    --------
    >>> frame = jp.ShearBuilding.from_period(3, 300e3, period=0.5, damping_ratio=0.05)
    >>> pushed = jp.pushover(frame.yielding(yield_force=1e6), ductility=4.0)
    >>> round(float(pushed.base_shear[-1]) / 1e6, 6), [i is not None for i in pushed.yields]
    (1.0, [True, False, False])
    """
    owner = "pushover"
    instance(owner, "building", building, ShearBuilding)
    if not is_known_and_single(building):
        raise InvalidInput(owner, "building", "", "must be of known, single numbers")
    most = number(owner, "ductility", ductility)
    enforce(owner, [Rule("ductility", most, (most > 1) & np.isfinite(most), "above 1 and finite")])
    require_one_of(owner, loads, ("height", "first mode"), "loads")
    profile = building.elevations if loads == "height" else building.modes().shapes[:, 0].real
    shares, storeys = storey_shears(building.storeys, profile, 1.0), building.storeys
    if all(storey.hysteresis is None for storey in storeys):
        rule = "must have a storey that yields: ShearBuilding.yielding makes them"
        raise InvalidInput(owner, "building", "", rule)
    ramp = np.append(np.linspace(0, 1, _YIELDS + 1), np.linspace(1, most, 129)[1:])
    lines = [_backbone(*each, ramp) for each in zip(storeys, shares, strict=True)]
    critical = int(np.argmin([shears.max() for _, shears in lines]))
    drift, shears = lines[critical]
    upto, rising = _rising(drift, shears)
    at_yield = {
        i: np.interp(own[_YIELDS], rising, upto)
        for i, (_, own) in enumerate(lines)
        if own.size > 2 and own[_YIELDS] <= rising[-1] * _ROUNDED
    }
    path = np.union1d(drift, [*at_yield.values()])
    base_shear = np.interp(path, drift, shears)
    largest = np.where(path <= upto[-1], base_shear, rising[-1])
    unloading = [
        (largest - base_shear) * x / y.stiffness for x, y in zip(shares, storeys, strict=True)
    ]
    drifts = [np.interp(largest, *_rising(*line)[::-1]) for line in lines]
    drifts = [x - less for x, less in zip(drifts, unloading, strict=True)]
    drifts[critical] = path
    states = {i: int(np.searchsorted(path, x)) for i, x in at_yield.items()}
    yields = tuple(map(states.get, range(building.n_floors)))
    return Pushover(base_shear, np.stack(drifts, axis=1), yields)


def _backbone(storey: Building, share: Any, ramp: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Drifts of a storey in one direction, e_y by a ramp, and the base shear of each."""
    law, k = storey.hysteresis, float(storey.stiffness) / float(share)
    if law is None:
        return np.array([0.0, _FAR]), np.array([0.0, k * _FAR])
    drifts = float(law.yield_displacement) * ramp
    limit = getattr(law, "ultimate_displacement", np.inf)
    reduced = jax.vmap(lambda e: law.reduced_force(e, law.start(e)))(np.minimum(drifts, limit))
    return drifts, k * np.asarray(reduced)


def _rising(drifts: np.ndarray, shears: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A backbone up to its largest shear, which it may hold."""
    end = int(np.argmax(shears * _ROUNDED >= shears.max())) + 1
    return drifts[:end], shears[:end]
