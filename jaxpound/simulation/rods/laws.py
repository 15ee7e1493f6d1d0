"""The law of each material in steps."""

from __future__ import annotations

from typing import Any

from jaxpound.model.dampers import PowerLaw
from jaxpound.model.hysteresis import hysteresis_of, zener_of
from jaxpound.model.system import Rod
from jaxpound.simulation.rods.dashpot import Dashpot
from jaxpound.simulation.rods.law import Parallel, RodLaw, Spring
from jaxpound.simulation.rods.yielding import Hysteretic
from jaxpound.simulation.rods.zener import Zener


def law_of(rod: Rod, dt: float, order: int, relaxed_at: Any = None) -> RodLaw:
    """A rod over steps of ``dt`` in the scheme of this order.

    A fractional rod is relaxed at an elongation, or at 0. A law of hysteresis beside it takes the
    place of its spring.
    """
    material, stiffness = rod.material, rod.stiffness
    if isinstance(material, PowerLaw):
        return Dashpot.of(material, stiffness, dt)
    zener, law = zener_of(material), hysteresis_of(material)
    if zener is None:
        return Hysteretic(law, stiffness)
    memory = Zener.of(zener, stiffness, dt, order, relaxed_at)
    if law is None:
        return memory
    # In this order both springs cancel without rounding until the rod yields.
    return Parallel((Hysteretic(law, stiffness), Spring(-stiffness), memory))
