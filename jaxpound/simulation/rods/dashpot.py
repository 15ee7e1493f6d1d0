"""Dashpots over one step: linear ones, and those of a power of the velocity on a spring."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jax.tree_util import register_dataclass

from jaxpound._extrema import smaller
from jaxpound._xla.quotients import once, unit_of
from jaxpound.model.dampers import PowerLaw
from jaxpound.simulation.rods.law import RodLaw, RodStep

_ITERATIONS = 8  # of Newton's method, to rounding


class DashpotState(NamedTuple):
    """State at t_{m−1} of a rod with a dashpot."""

    elongation: Any
    slid: Any  # elongation of the dashpot
    dissipated: Any  # energy until then, over K


@register_dataclass
@dataclass(frozen=True)
class PureDashpot(RodLaw):
    """A dashpot without a brace, whose force follows from the velocities alone."""

    dt: float = field(metadata={"static": True})
    viscosity: Any
    modulus = 0.0

    def start(self, elongation: jax.Array, change: jax.Array) -> tuple[Any, Any]:
        """The elongation, and the energy that the dashpot has dissipated until then."""
        return elongation, 0 * elongation

    def step(
        self, before: Any, elongation: Any, total: Any, is_first: Any, mean: Any = None
    ) -> RodStep:
        """No force that the elongation makes; the energy by its mean rate since t_{m−1}."""
        last, energy = before
        return RodStep(
            0.0, 0.0, (elongation, energy + self.viscosity * (elongation - last) ** 2 / self.dt)
        )

    def dissipated(self, state: Any) -> Any:
        """Energy that the dashpot has dissipated."""
        return state[1]


@register_dataclass
@dataclass(frozen=True)
class BracedDashpot(RodLaw):
    """A dashpot on a brace over steps of one length; lengths stand for forces over K."""

    size: Any  # F over K
    power: Any  # 1/a
    way: Any  # v times the step
    modulus: Any  # K, of the brace

    @staticmethod
    def of(material: PowerLaw, modulus: Any, dt: float) -> BracedDashpot:
        """The damper over steps of ``dt``."""
        size, power = material.force / modulus, 1 / material.exponent
        return BracedDashpot(size, power, material.velocity * dt, modulus)

    def start(self, elongation: jax.Array, change: jax.Array) -> DashpotState:
        """The state of a rod at rest, without a force."""
        return DashpotState(elongation, elongation, 0 * elongation)

    def step(
        self, before: Any, elongation: Any, total: Any, is_first: Any, mean: Any = None
    ) -> RodStep:
        """The rod at t_m; the dashpot cannot follow an impact."""
        unit = unit_of(0 * self.modulus)
        now = once(self._moved(before, elongation), unit)
        sample = elongation if mean is None else mean
        force = once(self.modulus * (sample - now.slid), unit)
        return RodStep(force, force, now)

    def dissipated(self, state: DashpotState) -> Any:
        """Energy that the dashpot has dissipated."""
        return self.modulus * state.dissipated

    def _moved(self, before: DashpotState, after: Any) -> DashpotState:
        """The state after a step in which the elongation changes linearly, to second order.

        By the two-stage method of Alexander (1977), which is L-stable: where the spring is stiff,
        the force is that of the dashpot alone.
        """
        gamma, change = 1 - 0.5**0.5, after - before.elongation
        last = before.elongation - before.slid
        middle, slid = self._solved(last + gamma * change, gamma)
        ended = last + (1 - gamma) * (change - slid)
        force, slid_last = self._solved(ended + gamma * change, gamma)
        work = (1 - gamma) * middle * slid + gamma * force * slid_last
        return DashpotState(after, after - force, before.dissipated + work)

    def _slid(self, force: Any) -> Any:
        """How far the dashpot moves in a step under a force over K."""
        size = jnp.abs(force)
        # Not 1 over the size: a power of it may overflow, and 0 times its derivative is NaN.
        share = jnp.where(size > 0, size / jnp.where(self.size > 0, self.size, 1.0), 1.0)
        return jnp.where(size > 0, jnp.sign(force) * self.way * share**self.power, 0.0)

    def _solved(self, whole: Any, share: float) -> tuple[Any, Any]:
        """The force f over K for which f and what the dashpot moves in a share of a step is whole.

        And how far it moves in a step. Both grow with f and are convex: Newton's method falls to
        the root from any point above it.
        """
        none = self.size <= 0
        fixed, target = lax.stop_gradient((self, whole))
        size = jnp.abs(target)
        alone = (size / (share * fixed.way)) ** (1 / fixed.power)  # over F
        force = smaller(size, jnp.where(none, 1.0, fixed.size) * alone)

        def nearer(law: BracedDashpot, force: Any, whole: Any) -> Any:
            """A step of Newton's method; its slope is not differentiated."""
            ratio = fixed._slid(force) / jnp.where(force == 0, 1.0, force)
            excess = force + share * law._slid(force) - whole
            return force - excess / (1 + share * fixed.power * ratio)

        for _ in range(_ITERATIONS):
            force = nearer(fixed, force, size)
        # The last step has the derivative of the root. A dashpot whose force is 0 moves with the
        # rod, and the derivative by its force is the force over F.
        force = nearer(self, jnp.sign(target) * force, whole)
        force = jnp.where(none, self.size * jnp.sign(target) * alone, force)
        return force, jnp.where(none, (whole - force) / share, self._slid(force))
