"""Fractional Zener rods in time: the force under a displacement, step by step (paper, eq. 10).

Each rod keeps one history, of c_m = K τ_x x_m − τ_f f_m.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jaxpound._checks import Rule, enforce, finite, real
from jaxpound._xla.plan import Work, choice
from jaxpound.model.rod import ZenerRod
from jaxpound.simulation.history import HistorySum, ModalHistory
from jaxpound.simulation.scan import scan_with_history


class RodLaw(NamedTuple):
    """A rod's law over one step.

    f_m = [stiffness x_m + lag (K x_{m−1} − f_{m−1}) + memory S_m] / divisor, x its elongation.
    """

    stiffness: jax.Array
    lag: jax.Array
    memory: jax.Array
    divisor: jax.Array
    modulus: jax.Array  # K
    tau_f: jax.Array
    tau_x: jax.Array


class SpringLaw(NamedTuple):
    """An elastic spring, f_m = K x_m, without a memory."""

    modulus: jax.Array


class RodStep(NamedTuple):
    """A rod at t_m: what its history remembers is None of a spring."""

    force: jax.Array
    excess: Any  # K e_m − f_m
    remembered: Any  # c_m


def rod_law(rod: ZenerRod, modulus: ArrayLike, dt: float, order: int) -> RodLaw:
    """The rod in the scheme of this order, at step ``dt``.

    Order 1 is the paper's eq. (10). Order 2 puts the whole Zener law at t_m − γh/2, where the
    Grünwald–Letnikov sum is second-order accurate.
    """
    gamma = jnp.asarray(rod.order)
    s = gamma / 2 if order == 2 else jnp.zeros_like(gamma)
    speed = dt**-gamma
    return RodLaw(
        stiffness=modulus * (1 - s + rod.tau_x * speed),
        lag=s,
        memory=speed,
        divisor=1 - s + rod.tau_f * speed,
        modulus=jnp.asarray(modulus, gamma.dtype),
        tau_f=jnp.asarray(rod.tau_f),
        tau_x=jnp.asarray(rod.tau_x),
    )


def rod_step(law: RodLaw, excess: jax.Array, total: jax.Array, x: jax.Array) -> RodStep:
    """Force f_m from K x_{m−1} − f_{m−1}, S_m and x_m; then K x_m − f_m, and c_m to remember."""
    # Kept as a quotient, which XLA computes once: see ``_xla.quotients``.
    f = (law.stiffness * x + law.lag * excess + law.memory * total) / law.divisor
    return RodStep(f, law.modulus * x - f, law.modulus * law.tau_x * x - law.tau_f * f)


@jax.jit  # traced once, not for every rod
def rod_moved(law: RodLaw | SpringLaw, passed: RodStep, dx: jax.Array) -> RodStep:
    """What the step would have been for an elongation greater by dx."""
    if isinstance(law, SpringLaw):
        return passed._replace(force=passed.force + law.modulus * dx)
    f, excess, c = passed
    df = law.stiffness * dx / law.divisor
    c = c + law.modulus * law.tau_x * dx - law.tau_f * df
    return RodStep(f + df, excess + law.modulus * dx - df, c)


def rod_force(
    rod: ZenerRod,
    displacement: ArrayLike | Sequence[float],
    dt: float,
    *,
    stiffness: ArrayLike = 1.0,
    order: int = 2,
    history: HistorySum | None = None,
) -> Float[Array, " time"]:
    """Force f_0, f_1, …, shape (n,), of a rod under a prescribed displacement, from rest.

    Where the displacement jumps, order 2 needs the mean of both sides as the sample: for x = 1 from
    t = 0 on, x_0 = 1/2. An argument that breaks its rule is a ``ValueError``.

    Parameters
    ----------
    rod
        The rod.
    displacement
        Samples x_0, x_1, … at interval ``dt``, shape (n,), n ≥ 3.
    dt
        Sample interval > 0, in the unit of time of the rod's relaxation times.
    stiffness
        K, in the unit of force per unit of displacement.
    order
        Order of accuracy in dt, 1 (paper, eq. 10) or 2.
    history
        ``ModalHistory()`` by default.

    Examples
    --------
    >>> rod = jp.ZenerRod(order=0.23, tau_f=0.004, tau_x=1.183)
    >>> force = jp.rod_force(rod, [0.0, 0.1, 0.2, 0.3, 0.4], dt=0.1)
    >>> [round(float(f), 3) for f in force]
    [0.0, 0.325, 0.569, 0.804, 1.028]
    """
    x = jnp.asarray(real("rod_force", "displacement", displacement))
    rules = [
        Rule("dt", dt, 0 < dt < np.inf, "positive and finite"),
        Rule("order", order, order in (1, 2), "1 or 2"),
        Rule("displacement", x, finite(x), "finite"),
        Rule("number of samples", x.size, x.ndim == 1 and x.size > 2, "at least 3, in one row"),
    ]
    enforce("rod_force", rules)
    history = ModalHistory() if history is None else history
    dtype = jnp.result_type(x, float)
    x, rod = jax.tree.map(lambda a: jnp.asarray(a, dtype), (x, rod))
    law = rod_law(rod, jnp.asarray(stiffness, dtype), dt, order)

    def advance(excess: jax.Array, sums: list[jax.Array], m: jax.Array, now: jax.Array) -> Any:
        f, excess, c = rod_step(law, excess, sums[0], now)
        return excess, [c], f

    rest = jnp.zeros((), dtype)
    plan = choice()(Work(elements=1))
    return scan_with_history(advance, rest, x.size - 1, [rod.order], history, x, plan)[1]


def nyquist_stiffness(rod: ZenerRod, modulus: ArrayLike, dt: ArrayLike, order: int) -> Any:
    """The rod's stiffness for the fastest motion of the grid, x_m = (−1)^m; it limits the step.

    There the Grünwald–Letnikov derivative of order γ is (2/h)^γ, and the scheme's loss is zero.
    """
    speed = (2 / dt) ** rod.order
    kept = 1 - rod.order if order == 2 else 1.0
    return modulus * (kept + rod.tau_x * speed) / (kept + rod.tau_f * speed)
