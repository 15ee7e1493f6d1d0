"""The law of each material in steps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import jax
from jax.tree_util import register_dataclass

from jaxpound.model.dampers import Dashpot, PowerLaw
from jaxpound.model.hysteresis import hysteresis_of, zener_of
from jaxpound.model.rod import Spring
from jaxpound.model.system import Rod
from jaxpound.simulation.rods.dashpot import BracedDashpot, PureDashpot
from jaxpound.simulation.rods.law import RodLaw, RodStep
from jaxpound.simulation.rods.yielding import Hysteretic
from jaxpound.simulation.rods.zener import Zener


def law_of(rod: Rod, dt: float, order: int, relaxed_at: Any = None) -> RodLaw:
    """A rod over steps of ``dt`` in the scheme of this order.

    A fractional rod is relaxed at an elongation, or at 0. A law of hysteresis beside it takes the
    place of its spring.
    """
    material, stiffness = rod.material, rod.stiffness
    if isinstance(material, Dashpot):
        return PureDashpot(dt, material.coefficient)
    if isinstance(material, PowerLaw):
        return BracedDashpot.of(material, stiffness, dt)
    zener, law = zener_of(material), hysteresis_of(material)
    if isinstance(material, Spring):
        return Elastic(stiffness)
    if zener is None:
        return Hysteretic(law, stiffness)
    memory = Zener.of(zener, stiffness, dt, order, relaxed_at)
    if law is None:
        return memory
    return HystereticZener(law, stiffness, memory)


@register_dataclass
@dataclass(frozen=True)
class Elastic(RodLaw):
    """A spring, whose force is K e."""

    modulus: Any

    def step(
        self, before: Any, elongation: Any, total: Any, is_first: Any, mean: Any = None
    ) -> RodStep:
        """The force of an elongation."""
        force = self.modulus * (elongation if mean is None else mean)
        return RodStep(force, force, None)


@register_dataclass
@dataclass(frozen=True)
class HystereticZener(Hysteretic):
    """A fractional rod with a law of hysteresis in the place of its spring."""

    memory: Zener
    peaks_at_kinks: ClassVar[bool] = False

    @property
    def order(self) -> Any:
        """The order of the fractional rod."""
        return self.memory.order

    def start(self, elongation: jax.Array, change: jax.Array) -> Any:
        """The states of both, and no force."""
        state = super().start(elongation, change)
        memory = self.memory.start(elongation, change)
        return state._replace(memory=memory, smooth=0 * elongation)

    def step(
        self, before: Any, elongation: Any, total: Any, is_first: Any, mean: Any = None
    ) -> RodStep:
        """Both at t_m; smooth forces are linear between samples, to second order."""
        yielding = super().step(before, elongation, total, is_first, mean)
        zener = self.memory.step(before.memory, elongation, total, is_first, mean)
        spring = self.modulus * (elongation if mean is None else mean)
        smooth, last = zener.force - spring, before.smooth
        return RodStep(
            # In this order both springs cancel without rounding until the rod yields.
            force=yielding.force - spring + zener.force,
            kick=yielding.kick - spring + zener.kick,
            state=yielding.state._replace(memory=zener.state, smooth=smooth),
            remembered=zener.remembered,
            kinked=yielding.kinked,
            reached=tuple(
                (late, force + smooth + (smooth - last) * late) for late, force in yielding.reached
            ),
        )
