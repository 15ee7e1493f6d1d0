"""Fractional Zener rods in time: the force under a displacement, step by step (paper, eq. 10).

Each rod keeps one history, of c_m = K τ_x x_m − τ_f f_m.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, ArrayLike, Float

from jaxpound._checks import Rule, enforce, finite, real
from jaxpound.fractional import History, ModalHistory
from jaxpound.structures import ZenerRod


class RodLaw(NamedTuple):
    """A rod's law over one step, f_m = stiffness x_m + lag (K x_{m−1} − f_{m−1}) + memory S_m.

    Fields have the shape of the rod's parameters: () for one rod, (2,) for two side by side.
    """

    stiffness: jax.Array
    lag: jax.Array
    memory: jax.Array
    modulus: jax.Array  # K
    tau_f: jax.Array
    tau_x: jax.Array
    kernel: Any


class RodState(NamedTuple):
    """What a rod remembers: K x_{m−1} − f_{m−1}, and its history."""

    excess: jax.Array
    memory: Any


def rod_law(
    rod: ZenerRod, modulus: ArrayLike, dt: float, n_steps: int, order: int, history: History
) -> RodLaw:
    """The rod as the scheme of the given order sees it at step ``dt``.

    Order 1 is the paper's eq. (10). Order 2 puts the whole Zener law at t_m − γh/2, where the
    Grünwald–Letnikov sum is second-order accurate.
    """
    gamma = jnp.asarray(rod.order)
    s = gamma / 2 if order == 2 else jnp.zeros_like(gamma)
    speed = dt**-gamma
    denominator = 1 - s + rod.tau_f * speed
    return RodLaw(
        stiffness=modulus * (1 - s + rod.tau_x * speed) / denominator,
        lag=s / denominator,
        memory=speed / denominator,
        modulus=jnp.asarray(modulus, gamma.dtype),
        tau_f=jnp.asarray(rod.tau_f),
        tau_x=jnp.asarray(rod.tau_x),
        kernel=history.kernel(gamma, n_steps),
    )


def rod_at_rest(law: RodLaw, history: History) -> RodState:
    """The rod before t = 0."""
    return RodState(jnp.zeros_like(law.stiffness), history.empty(law.kernel))


def rod_step(
    law: RodLaw, state: RodState, x: jax.Array, history: History
) -> tuple[RodState, jax.Array]:
    """Force f_m at displacement x_m, and the rod's state after it."""
    f = (
        law.stiffness * x
        + law.lag * state.excess
        + law.memory * history.total(law.kernel, state.memory)
    )
    c = law.modulus * law.tau_x * x - law.tau_f * f
    return RodState(law.modulus * x - f, history.push(law.kernel, state.memory, c)), f


def rod_force(
    rod: ZenerRod,
    displacement: ArrayLike,
    dt: float,
    *,
    stiffness: ArrayLike = 1.0,
    order: int = 2,
    history: History | None = None,
) -> Float[Array, " time"]:
    """Force of a rod that follows a given displacement from rest.

    Parameters
    ----------
    rod
        The rod.
    displacement
        Samples x_0, x_1, … at interval ``dt``, shape (n,), n ≥ 3.
    dt
        Sample interval, in the unit of time of the rod's relaxation times.
    stiffness
        K, in the unit of force per unit of displacement.
    order
        Order of accuracy in dt, 1 (paper, eq. 10) or 2.
    history
        ``ModalHistory()`` by default.

    Returns
    -------
    f_0, f_1, …, shape (n,).

    Raises
    ------
    ValueError
        If an argument breaks its rule.

    Notes
    -----
    Where the displacement jumps, order 2 needs the mean of both sides as the sample: for x = 1 from
    t = 0 on, x_0 = 1/2.
    """
    x = jnp.asarray(real("rod_force", "displacement", displacement))
    enforce(
        "rod_force",
        [
            Rule("dt", dt, 0 < dt < np.inf, "positive and finite"),
            Rule("order", order, order in (1, 2), "1 or 2"),
            Rule("displacement", x, finite(x), "finite"),
            Rule("number of samples", x.size, x.ndim == 1 and x.size > 2, "at least 3, in one row"),
        ],
    )
    history = ModalHistory() if history is None else history
    law = rod_law(rod, stiffness, dt, x.size - 1, order, history)
    law = jax.tree.map(lambda a: jnp.asarray(a, jnp.result_type(x, float)), law)
    _, f = lax.scan(
        lambda state, xm: rod_step(law, state, xm, history), rod_at_rest(law, history), x
    )
    return f


def nyquist_stiffness(rod: ZenerRod, modulus: ArrayLike, dt: ArrayLike, order: int) -> Any:
    """The rod's stiffness for the fastest motion of the grid, x_m = (−1)^m: what bounds the step.

    There the Grünwald–Letnikov derivative of order γ is (2/h)^γ, and the scheme's loss is zero.
    """
    speed = (2 / dt) ** rod.order
    kept = 1 - rod.order if order == 2 else 1.0
    return modulus * (kept + rod.tau_x * speed) / (kept + rod.tau_f * speed)
