"""The cyclic test of a rod that yields: its force under prescribed displacements."""

from __future__ import annotations

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp

from jaxpound._checks import Rule, all_hold, count, enforce, finite, instance, real
from jaxpound._errors import InvalidInput
from jaxpound._fields import pytree_dataclass, quantity, rules
from jaxpound.model.hysteresis import HysteresisLaw
from jaxpound.model.system import Rod
from jaxpound.simulation.yielding import HysteresisConstants, within


@pytree_dataclass
class CyclicTest:
    """Series of a cyclic test, each of shape (n,), in the units of its displacements and force."""

    displacement: Any = quantity("length")
    """Elongation of the rod."""
    force: Any = quantity("force")
    """Force of the rod, K times the law's reduced force."""
    dissipated: Any = quantity("energy")
    """Energy dissipated by yielding until then."""


def cyclic_test(law: Any, displacements: Any, stiffness: Any = 1.0, steps: int = 32) -> CyclicTest:
    """Force of a rod under prescribed displacements, by the step of its law of hysteresis.

    Works under ``jit``, ``vmap`` and ``grad`` by every number of the law, the displacements and the
    stiffness; traced ones that break a rule give NaN. Raises ``ValueError`` if a known one does.

    Parameters
    ----------
    law
        ``Bilinear``, ``BoucWen`` or any ``HysteresisLaw``; a batch of laws is ``jax.vmap``.
    displacements
        Elongations of the rod, shape (n,) with n ≥ 2: turning points, or all samples of a history.
        Between them the displacement only grows or only falls.
    stiffness
        K > 0 before yield; forces are in its unit times that of displacements.
    steps
        Equal steps ≥ 1 of the law from a displacement to the next, all of which are in the result:
        (n − 1) ``steps`` + 1 instants. ``Bilinear`` is exact for any, ``BoucWen`` of second order.

    Examples
    --------
    >>> test = jp.cyclic_test(jp.Bilinear(0.1), [0.0, 0.3, -0.3], stiffness=5.0, steps=1)
    >>> test.force.tolist(), round(float(test.dissipated[-1]), 6)  # 0.5 (0.2 + 0.4)
    ([0.0, 0.5, -0.5], 0.3)
    """
    owner = "cyclic_test"
    instance(owner, "law", law, HysteresisLaw)
    rod = Rod(law, stiffness)
    if any(map(jnp.ndim, jax.tree.leaves(law))):
        raise InvalidInput(owner, "law", "", "must be of single numbers: jax.vmap takes several")
    x = jnp.asarray(real(owner, "displacements", displacements))
    if x.ndim != 1 or x.size < 2:
        raise InvalidInput(owner, "displacements", "", f"of shape {x.shape} must be (n,), n ≥ 2")
    checks = [Rule("displacements", x, finite(x), "finite"), *rules(rod)]
    enforce(owner, checks)
    test = _tested(law, x, rod.stiffness, count(owner, "steps", steps))
    return jax.tree.map(lambda y: jnp.where(all_hold(checks), y, jnp.nan), test)


@partial(jax.jit, static_argnames="steps")
def _tested(law: Any, turns: jax.Array, modulus: Any, steps: int) -> CyclicTest:
    share = jnp.arange(1, steps + 1)[None] / steps
    between = turns[:-1, None] * (1 - share) + turns[1:, None] * share
    x = jnp.append(turns[0], between.reshape(-1))
    path = within(HysteresisConstants(law, modulus).ultimate, x)

    def step(before: tuple[Any, Any], e: Any) -> tuple[Any, Any]:
        state = law.advance(before[0], before[1], e)
        return (state, e), (law.reduced_force(e, state), law.dissipated(state))

    _, (force, dissipated) = jax.lax.scan(step, (law.start(path[0]), path[0]), path)
    return CyclicTest(x, modulus * force, modulus * dissipated)
