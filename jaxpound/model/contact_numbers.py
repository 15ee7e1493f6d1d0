"""Numbers of contact laws: a stiffness, and the damping for a restitution."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from math import factorial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxpound._checks import is_traced, positive
from jaxpound._errors import InvalidInput
from jaxpound._extrema import larger, smaller

STIFFER_THAN_A_STOREY = 20.0
"""Stiffness of the contact over that of the stiffer storey (Anagnostopoulos 1988)."""

_SERIES_END = 2.0
_TERMS = 25  # the first term left out is below 1e-17 of the sum


def contact_stiffness(
    *,
    modulus: Any = None,
    area: Any = None,
    length: Any = None,
    storeys: Sequence[Any] | None = None,
) -> Any:
    """A stiffness for ``KelvinVoigt``, from the colliding floor or from the storeys beside it.

    It is the axial stiffness E A/L of the floor (Maison and Kasai 1992) or, without floor plans, 20
    times the stiffness of the stiffer storey (Anagnostopoulos 1988). Any consistent units.

    Raises ``ValueError`` if a concrete value breaks its rule, or neither or both of floor and
    storeys are given.

    Parameters
    ----------
    modulus
        Young's modulus E > 0 of the floor.
    area
        Cross-section A > 0 of the floor, across the direction of impact.
    length
        Length L > 0 of the floor in the direction of impact.
    storeys
        Stiffness > 0 of the colliding storeys, two numbers or more.

    Examples
    --------
    >>> f"{jp.contact_stiffness(modulus=30e9, area=2.0, length=15.0):.3g} N/m"
    '4e+09 N/m'
    >>> float(jp.contact_stiffness(storeys=(1.0, 2.5)))
    50.0
    """
    floor = {"modulus": modulus, "area": area, "length": length}
    if (storeys is None) == all(x is None for x in floor.values()):
        raise InvalidInput("", "", "give either modulus, area and length, or storeys")
    if storeys is None:
        modulus, area, length = positive(**floor)
        return modulus * area / length
    if not isinstance(storeys, Sequence | np.ndarray | jax.Array) or len(storeys) < 2:
        raise InvalidInput("storeys", repr(storeys), "must be two numbers or more")
    numbers = positive(**{f"storeys.{i}": storey for i, storey in enumerate(storeys)})
    stiffer = larger if is_traced(numbers) else np.maximum
    return STIFFER_THAN_A_STOREY * reduce(stiffer, numbers)


@jax.jit
def exact_damping_factor(restitution: Any) -> jax.Array:
    """The root Z of Z (1 + e) = ln((1 + Z)/(1 − Z e)), with its derivatives up to the third.

    This integrates m* w dw/(1 + Z w/v0) = −k δ^(3/2) dδ over a free collision, from w = v0 to w =
    −e v0, both at δ = 0. In y = Z (1 + e) it has a closed solution for e (``_loss``) and no
    singularity where Z approaches 1/e, as it does for small e.
    """
    loss = (1 - restitution) / restitution
    held = lax.stop_gradient(loss)

    def improved(y: jax.Array, loss: jax.Array) -> jax.Array:
        value, slope = jax.jvp(_loss, (y,), (jnp.ones_like(y),))
        return y + (loss - value) / slope

    # The loss is at least y/3 and at least y − 2; from that bound five Newton steps converge.
    bound = smaller(3 * held, held + 2)
    y, _ = lax.scan(lambda y, _: (improved(y, held), None), bound, length=5)
    for _ in range(2):  # these steps carry the derivatives
        y = improved(y, loss)
    return y / (1 + restitution)


def _loss(y: jax.Array) -> jax.Array:
    """1/e − 1 = ((2 + y) exp(−y) − 2 + y) / (1 − (1 + y) exp(−y)), for y ≥ 0.

    For small y, where both differences cancel, the series of both over y² replace them.
    """
    small, large = smaller(y, _SERIES_END), larger(y, _SERIES_END)
    above = below = jnp.zeros_like(y)
    for n in reversed(range(_TERMS)):
        above = (n + 1) / factorial(n + 3) - small * above
        below = (n + 1) / factorial(n + 2) - small * below
    decay = jnp.exp(-large)
    closed = ((2 + large) * decay - 2 + large) / (1 - (1 + large) * decay)
    return jnp.where(y < _SERIES_END, small * above / below, closed)
