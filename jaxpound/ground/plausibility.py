"""Valid but implausible input, such as a number in a wrong unit: a warning or, if strict, an error.

In a dimensionless run PGA is checked only if the ground motion has a record, which is in g: eq. 9
is homogeneous, so that ground, friction and gap may be scaled together. In a Monte Carlo study it
is always checked: the probabilities are those of real earthquakes. Traced values are not checked.
"""

from __future__ import annotations

import sys
import warnings
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound._checks import is_traced
from jaxpound.grid import TimeGrid
from jaxpound.ground.intensity import pga
from jaxpound.ground.motion import Ground, GroundLike, records_in, unresolved
from jaxpound.model.plausibility import FAR_GAP

MOST_PGA = 5.0
"""Largest plausible peak ground acceleration, g: the largest recorded are about 4."""

DEEP = 0.25
"""Largest plausible ratio of a penetration to the displacements: real floors stay below a tenth."""

LEAST_SHARE = 0.01
"""Share of a study's earthquakes that may be implausible: no probability changes by more."""

LOOKED_AT = 256
"""How many earthquakes of a study are checked: 92 % probable to have one that is 1 % probable."""


class PlausibilityWarning(UserWarning):
    """Input that the time grid does not resolve, or that is implausible: see ``simulate``."""


def tell(owner: str, findings: list[str], strict: bool) -> None:
    """Warn of each finding, at the line that called the library; or refuse them all.

    Raises
    ------
    ValueError
        If there are findings, and ``strict``.
    """
    if strict and findings:
        raise ValueError(f"{owner}: {'; '.join(findings)}")
    level, frame = 1, sys._getframe()
    own = ("jaxpound.", "jaxtyping.")  # in between, where it checks annotations
    while frame.f_back and frame.f_globals.get("__name__", "").startswith(own):
        level, frame = level + 1, frame.f_back
    for finding in findings:
        warnings.warn(f"{owner}: {finding}", PlausibilityWarning, stacklevel=level)


def excessive(ground: GroundLike, pga: Any, name: str = "ground") -> list[str]:
    """A finding if a ground motion in g, as a record is, exceeds the plausible PGA."""
    if is_traced(pga) or jnp.ndim(pga) or not any(records_in(ground)):
        return []
    return [_beyond(f"{name}: PGA = {float(pga):.4g} g")] if float(pga) > MOST_PGA else []


def far_apart(name: str, gap: Any, moved: Any, *, si: bool) -> list[str]:
    """A finding if a gap is out of proportion to the displacements, peak |x1| + peak |x2|."""
    if is_traced((gap, moved)) or jnp.ndim(moved):
        return []
    gap, moved, unit = float(gap), float(moved), "m" if si else "g/ω1²"
    if not gap > FAR_GAP * moved:
        return []
    return [
        f"{name} = {gap:.4g} {unit} should be at most {FAR_GAP:g} times what the buildings move, "
        f"{moved:.4g} {unit} (peaks of both its sides): are the units right?"
    ]


def too_deep(name: str, penetration: Any, moved: Any, *, si: bool) -> list[str]:
    """A finding if a contact law yields as if there were none; None is a link without one."""
    if penetration is None or is_traced((penetration, moved)) or jnp.ndim(moved):
        return []
    depth, moved, unit = float(penetration), float(moved), "m" if si else "g/ω1²"
    if not depth > DEEP * moved:
        return []
    return [
        f"{name}: the penetration, {depth:.4g} {unit}, should be at most {DEEP:g} of what the "
        f"buildings move, {moved:.4g} {unit} (peaks of both its sides): is the law stiff enough?"
    ]


def first_of(n: int, grid: TimeGrid) -> int:
    """How many of n earthquakes are checked: fewer if they are long, to save time."""
    return min(n, LOOKED_AT, max(16, 2**20 // grid.n_steps))


def of_many(grounds: Ground, grid: TimeGrid, *, in_g: bool) -> list[str]:
    """Findings in the first earthquakes of a study.

    Parameters
    ----------
    grounds
        Their ground motions; every array has a leading axis of n.
    grid
        The instants of their runs.
    in_g
        Whether accelerations are meant in g although no record is among them.
    """
    n, findings = len(jax.tree.leaves(grounds)[0]), []
    every = jax.tree.map(np.asarray, grounds)
    found = [unresolved(jax.tree.map(lambda x, i=i: x[i], every), grid.dt) for i in range(n)]
    unclear = [said for said in found if said]
    if len(unclear) > LEAST_SHARE * n:
        one = unclear[0][0].removeprefix("ground: ")
        findings.append(f"ground: {_share(len(unclear), n)} are not resolved; of one, {one}")
    if in_g or any(records_in(grounds)):
        pgas = np.asarray(_pgas(grounds, grid))
        beyond = int((pgas > MOST_PGA).sum())
        if beyond > LEAST_SHARE * n:
            largest = f"up to {np.nanmax(pgas):.4g} g"
            findings.append(_beyond(f"ground: PGA of {_share(beyond, n)}, {largest},"))
    return findings


@partial(jax.jit, static_argnames="grid")
def _pgas(grounds: Ground, grid: TimeGrid) -> jax.Array:
    return jax.vmap(lambda ground: pga(ground, grid))(grounds)


def _share(some: int, n: int) -> str:
    return f"{some / n:.0%} of the {n} earthquakes looked at"


def _beyond(what: str) -> str:
    return f"{what} should be at most {MOST_PGA:.0f} g: are the units right?"
