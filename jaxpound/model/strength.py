"""Strength of the storeys of buildings that yield, and the effect of weights on their drift."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxpound._checks import Rule, enforce, finite, hint, positive
from jaxpound._errors import InvalidInput
from jaxpound.model.building import Building

BEHAVIOUR_FACTORS = {"DCL": 1.5, "DCM": 3.9, "DCH": 5.85}
"""q of concrete frames of several bays (EN 1998-1, section 5.2.2.2, with α_u/α_1 = 1.3)."""


def base_shear_coefficient(spectral_acceleration: Any, ductility_class: str) -> Any:
    """Base shear at yield over the weight of a concrete frame designed to EN 1998-1, S_a/q.

    Overstrength is not counted. Raises ``ValueError`` for an acceleration that is not positive, or
    another class.

    Parameters
    ----------
    spectral_acceleration
        S_a > 0 of the elastic design spectrum at the building's period, g.
    ductility_class
        "DCL", "DCM" or "DCH": q of 1.5, 3.9 or 5.85.

    Examples
    --------
    >>> round(jp.model.base_shear_coefficient(0.6, "DCM"), 4)
    0.1538
    """
    (acceleration,) = positive(spectral_acceleration=spectral_acceleration)
    if ductility_class not in BEHAVIOUR_FACTORS:
        rule = f"must be a class; {hint(ductility_class, BEHAVIOUR_FACTORS)}"
        raise InvalidInput("ductility_class", repr(ductility_class), rule)
    return acceleration / BEHAVIOUR_FACTORS[ductility_class]


def storey_shears(storeys: Sequence[Building], elevations: np.ndarray, base_shear: Any) -> Any:
    """Shear of each storey under loads that grow with mass and height, as codes have them."""
    loads = [storey.mass * float(z) for storey, z in zip(storeys, elevations, strict=True)]
    return [base_shear * sum(loads[i:]) / sum(loads) for i in range(len(loads))]


def with_weight(storey: Building, weight: Any, height: float) -> Building:
    """A storey that carries a weight, N, above it: its stiffness is less by weight over height.

    With θ that over its stiffness k, f − θ k e of a storey is the force of one of stiffness
    (1 − θ) k, the same dashpot, the same e_y and a hardening (α − θ)/(1 − θ).
    """
    theta = weight / height / storey.stiffness
    rule = "below 1: else the weight buckles the storey"
    enforce([Rule("weight above over stiffness and height", theta, theta < 1, rule)])
    left, law = 1 - theta, storey.hysteresis
    if law is not None:
        if not hasattr(law, "hardening"):
            rule = "must be Bilinear or BoucWen: the hardening of a law of one's own is not known"
            raise InvalidInput("hysteresis", repr(law), rule)
        limit = getattr(law, "ultimate_displacement", 0.0)
        rule = "finite where hardening is below W/(k h), weight above over stiffness and height"
        holds = finite(limit) | (law.hardening >= theta)
        enforce([Rule("hysteresis.ultimate_displacement", limit, holds, rule)])
        law = dataclasses.replace(law, hardening=(law.hardening - theta) / left)
    changes = {"stiffness": storey.stiffness * left, "hysteresis": law}
    if storey.order is not None:
        changes["tau_x"] = storey.tau_f + (storey.tau_x - storey.tau_f) / left
    return dataclasses.replace(storey, **changes)
