"""Fractional Zener rods in time: the force under a displacement, step by step (paper, eq. 10).

Each rod keeps one history, of c_m = K τ_x x_m − τ_f f_m.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
from jax.tree_util import register_dataclass
from jaxtyping import ArrayLike

from jaxpound.model.rod import ZenerRod
from jaxpound.simulation.rods.law import RodLaw, RodStep


@register_dataclass
@dataclass(frozen=True)
class Zener(RodLaw):
    """A fractional Zener rod; its state is K e_{m−1} − f_{m−1}.

    f_m = [stiffness e_m + lag (K e_{m−1} − f_{m−1}) + memory S_m] / divisor. Where the rod is
    relaxed at another elongation than 0, e is measured from there, and f from its force there.
    """

    stiffness: Any
    lag: Any
    memory: Any
    divisor: Any
    modulus: Any  # K
    tau_f: Any
    tau_x: Any
    order: Any
    relaxed_at: Any = None  # None for 0

    @staticmethod
    def of(
        rod: ZenerRod, modulus: ArrayLike, dt: float, order: int, relaxed_at: Any = None
    ) -> Zener:
        """The rod in the scheme of this order, at step ``dt``.

        Order 1 is the paper's eq. (10). Order 2 puts the whole Zener law at t_m − γh/2, where the
        Grünwald–Letnikov sum is second-order accurate.
        """
        gamma = jnp.asarray(rod.order)
        s = gamma / 2 if order == 2 else jnp.zeros_like(gamma)
        speed = dt**-gamma
        return Zener(
            stiffness=modulus * (1 - s + rod.tau_x * speed),
            lag=s,
            memory=speed,
            divisor=1 - s + rod.tau_f * speed,
            modulus=jnp.asarray(modulus, gamma.dtype),
            tau_f=jnp.asarray(rod.tau_f),
            tau_x=jnp.asarray(rod.tau_x),
            order=gamma,
            relaxed_at=relaxed_at,
        )

    def start(self, elongation: jax.Array, change: jax.Array) -> jax.Array:
        """No force beside the spring's."""
        return 0 * elongation

    def step(
        self, before: Any, elongation: Any, total: Any, is_first: Any, mean: Any = None
    ) -> RodStep:
        """The rod at t_m; it remembers c_m = K τ_x e_m − τ_f f_m."""
        e, rest = elongation if mean is None else mean, self.relaxed_at
        e = e if rest is None else e - rest
        # Kept as a quotient, which XLA computes once: see ``_xla.quotients``.
        f = (self.stiffness * e + self.lag * before + self.memory * total) / self.divisor
        force = f if rest is None else f + self.modulus * rest
        c = self.modulus * self.tau_x * e - self.tau_f * f
        return RodStep(force, force, self.modulus * e - f, c)


def nyquist_stiffness(rod: ZenerRod, modulus: ArrayLike, dt: ArrayLike, order: int) -> Any:
    """The rod's stiffness for the fastest motion of the grid, x_m = (−1)^m; it limits the step.

    There the Grünwald–Letnikov derivative of order γ is (2/h)^γ, and the scheme's loss is zero.
    """
    speed = (2 / dt) ** rod.order
    kept = 1 - rod.order if order == 2 else 1.0
    return modulus * (kept + rod.tau_x * speed) / (kept + rod.tau_f * speed)
