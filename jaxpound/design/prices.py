"""What a design may be limited in or pay for: demands of its structures, over all earthquakes."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from jaxpound._checks import hint, require_share
from jaxpound.model.system import GROUND, System, Topology
from jaxpound.results.demand import known_of, limited_columns
from jaxpound.results.elements import of_link
from jaxpound.study.demands import OF_FLOORS, names_over_all

DAMPER, BUDGET = "damper_force", "total_damper_force"


def prices_of(system: System) -> tuple[str, ...]:
    """Demands of a system that may be limited or penalised.

    Scalars of ``Demand`` by flat name, ``residual_offset`` by its absolute value;
    ``damper_force``, the slip force μ of a single link, or of several links ``damper_force_1`` and
    so on, and their sum, ``total_damper_force``; and the largest demands of all floors, storeys and
    contacts (``names_over_all``). Scalars of contact are those of links with a law of contact.
    """
    touching = [link.contact is not None for link in system.links]
    n, topology = len(touching), system.topology
    return (
        *(of_link(DAMPER, k, n) for k in range(n)),
        *((BUDGET,) if n > 1 else ()),
        *limited_columns(topology, touching),
        *names_over_all(topology, touching),
    )


_PAIR = Topology(2, ((0, GROUND), (1, GROUND)), ((0, 1),))
PRICES = (DAMPER, *limited_columns(_PAIR, touching=[True]))
"""Those of two adjacent structures with a law of contact."""

_MEANT = (*PRICES, BUDGET, *OF_FLOORS)
"""What an unknown name is compared with."""


def require_price(owner: str, name: Any, place: str) -> None:
    """A ``ValueError`` for a name of no demand that any system has; ``place`` ends the message."""
    known = known_of(name) if isinstance(name, str) else None
    if known is None or not known.limited:
        raise ValueError(f"{owner}: unknown demand {name!r}{place}; {hint(name, _MEANT)}")


def require_over(owner: str, over: Any) -> None:
    """A ``ValueError`` if ``over`` is not "worst", "mean" or a share."""
    if isinstance(over, str):
        if over not in ("worst", "mean"):
            raise ValueError(f"{owner}: over = {over!r} must be 'worst', 'mean' or a share")
    else:
        require_share(owner, "over", over)


def gathered(prices: jax.Array, over: str | float) -> jax.Array:
    """One number for a demand in all earthquakes, shape (n,); ``over`` is that of ``Limit``."""
    if over == "mean":
        return jnp.mean(prices)
    if over == "worst":
        return prices[jnp.argmax(prices)]
    return tail_mean(prices, float(over))


def tail_mean(x: jax.Array, share: float) -> jax.Array:
    """Mean of the largest ``share`` of n numbers, shape (n,), the last of them weighted in part."""
    whole = share * x.size
    weights = jnp.clip(whole - jnp.arange(x.size), 0.0, 1.0).astype(x.dtype)
    return jnp.sum(weights * jnp.sort(x, descending=True)) / whole
