"""Tests of a rod alone: its force under prescribed displacements."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jaxpound._checks import Rule, all_hold, count, enforce, finite, instance, real
from jaxpound._errors import InvalidInput
from jaxpound._fields import rules
from jaxpound._xla.plan import Work, choice
from jaxpound.model.hysteresis import HysteresisLaw
from jaxpound.model.rod import ZenerRod
from jaxpound.model.system import Rod
from jaxpound.simulation.rods.yielding import Hysteretic
from jaxpound.simulation.rods.zener import Zener
from jaxpound.simulation.time.history import HistorySum, ModalHistory
from jaxpound.simulation.time.scan import scan_with_history


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
    >>> force = jp.study.rod_force(rod, [0.0, 0.1, 0.2, 0.3, 0.4], dt=0.1)
    >>> [round(float(f), 3) for f in force]
    [0.0, 0.325, 0.569, 0.804, 1.028]
    """
    x = jnp.asarray(real("displacement", displacement))
    rules = [
        Rule("dt", dt, 0 < dt < np.inf, "positive and finite"),
        Rule("order", order, order in (1, 2), "1 or 2"),
        Rule("displacement", x, finite(x), "finite"),
        Rule("number of samples", x.size, x.ndim == 1 and x.size > 2, "at least 3, in one row"),
    ]
    enforce(rules)
    history = ModalHistory() if history is None else history
    dtype = jnp.result_type(x, float)
    x, rod = jax.tree.map(lambda a: jnp.asarray(a, dtype), (x, rod))
    law = Zener.of(rod, jnp.asarray(stiffness, dtype), dt, order)

    def advance(state: jax.Array, sums: list[jax.Array], m: jax.Array, now: jax.Array) -> Any:
        at = law.step(state, now, sums[0], None)
        return at.state, [at.remembered], at.force

    rest = jnp.zeros((), dtype)
    plan = choice()(Work(elements=1))
    return scan_with_history(advance, rest, x.size - 1, [rod.order], history, x, plan)[1]


class CyclicTest(NamedTuple):
    """Series of a cyclic test, each of shape (n,), in the units of its arguments."""

    displacement: jax.Array
    force: jax.Array
    dissipated: jax.Array  # energy, by yielding until then


def cyclic_test(law: Any, displacements: Any, stiffness: Any = 1.0, steps: int = 32) -> CyclicTest:
    """Force of a rod under prescribed displacements, by its law of hysteresis and stiffness K.

    The law is ``Bilinear``, ``BoucWen`` or any ``HysteresisLaw``. ``displacements`` are turning
    points or a whole history, shape (n,) with n ≥ 2: between two of them the displacement only
    grows or only falls, there in equal ``steps`` of the law. The result has all of them, (n − 1)
    ``steps`` + 1 instants. ``Bilinear`` is exact for any number, ``BoucWen`` of second order.

    Works under ``jit``, ``vmap`` and ``grad``. Raises ``ValueError`` for a number that breaks its
    rule; traced ones give NaN.

    Examples
    --------
    >>> test = jp.study.cyclic_test(jp.Bilinear(0.1), [0.0, 0.3, -0.3], stiffness=5.0, steps=1)
    >>> test.force.tolist(), round(float(test.dissipated[-1]), 6)  # 0.5 (0.2 + 0.4)
    ([0.0, 0.5, -0.5], 0.3)
    """
    instance("law", law, HysteresisLaw)
    rod, x = Rod(law, stiffness), jnp.asarray(real("displacements", displacements))
    if any(map(jnp.ndim, jax.tree.leaves(rod))):
        raise InvalidInput("law", "", "must be of single numbers: jax.vmap takes several")
    if x.ndim != 1 or x.size < 2:
        raise InvalidInput("displacements", "", f"of shape {x.shape} must be (n,), n ≥ 2")
    enforce(checks := [Rule("displacements", x, finite(x), "finite"), *rules(rod)])
    test = _tested(Hysteretic(law, rod.stiffness), x, count("steps", steps))
    return jax.tree.map(lambda y: jnp.where(all_hold(checks), y, jnp.nan), test)


@partial(jax.jit, static_argnames="steps")
def _tested(rod: Hysteretic, turns: jax.Array, steps: int) -> CyclicTest:
    share = jnp.arange(1, steps + 1, dtype=turns.dtype)[None] / steps
    between = turns[:-1, None] * (1 - share) + turns[1:, None] * share
    x, law = jnp.append(turns[0], between.reshape(-1)), rod.law
    path = rod.within(x)

    def step(before: tuple[Any, Any], e: Any) -> tuple[Any, Any]:
        state = law.advance(*before, e)
        return (state, e), (law.reduced_force(e, state), law.dissipated(state))

    _, (force, dissipated) = jax.lax.scan(step, (law.start(path[0]), path[0]), path)
    return CyclicTest(x, rod.modulus * force, rod.modulus * dissipated)
