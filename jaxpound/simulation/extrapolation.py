"""Richardson extrapolation: a run at two steps, of whose results the leading errors cancel.

An error of c h² + O(h³) leaves O(h³) in (4 y(h/2) − y(h))/3. Events of friction are found within
their step, so that c does not jump with where they fall; impacts are not as regular.
"""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar

import jax
import jax.numpy as jnp

from jaxpound.results.demand import Demand
from jaxpound.results.response import Response

T = TypeVar("T")

_SMOOTH = {"x", "v", "force", "gap", "slip_velocity"}
"""Series of a response that are extrapolated."""


def _better(coarse: Any, fine: Any) -> Any:
    known = jnp.isfinite(coarse) & jnp.isfinite(fine)  # a gap may be infinite
    coarse = jnp.where(known, coarse, 0.0)
    return jnp.where(known, (4 * jnp.where(known, fine, 0.0) - coarse) / 3, fine)


def extrapolated(coarse: T, fine: T) -> T:
    """Results of a run by those of the same run at half the step, leaf by leaf."""
    return jax.tree.map(_better, coarse, fine)


def extrapolated_response(coarse: Response, fine: Response) -> Response:
    """A response, with the smooth series and all scalars extrapolated."""
    demand: Demand = extrapolated(coarse.demand, fine.demand)

    def one(path: Any, old: Any, new: Any) -> Any:
        if path[-1].name in _SMOOTH and new.shape != old.shape:
            return _better(old, new[::2])
        return old

    series = jax.tree.map_with_path(one, coarse, fine)
    return dataclasses.replace(series, demand=demand)
