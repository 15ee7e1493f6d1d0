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
from jaxpound._extrema import peak
from jaxpound.grid import TimeGrid
from jaxpound.ground.motion import (
    Ground,
    GroundLike,
    as_motion,
    records_in,
    sampled,
    unresolved,
)

MOST_PGA = 5.0
"""Largest plausible peak ground acceleration, g: the largest recorded are about 4."""

MOST_UNSTATED = 1.5
"""Largest plausible peak, g, of a record whose unit nobody has stated: few records reach it, and
many in m/s² do."""

ISOLATED = 3.0
"""Largest plausible ratio of a record's largest sample to the next one: the ground moves through
several samples, and one alone is damage. Of recorded motions it is 1.7 at most, however coarse."""

MANY = 100
"""Samples of a record, and not of a few made-up numbers."""

MOST_GAP = 100.0
"""Largest plausible ratio of the gap to the displacements of a run, whose earthquake may be weak.
What gap no earthquake closes, buildings in SI say themselves: ``model.plausibility.too_wide``."""

DEEP = 0.25
"""Largest plausible ratio of a penetration to the displacements: real floors stay below a tenth."""

MOST_RESIDUAL = 0.03
"""Largest share of the energy put in that the balance of a resolved run leaves: where it is more,
displacements are off by about as much."""

LATE = 0.1
"""Largest plausible share of a ground motion's energy, ∫ u''² dt, after the end of a run."""

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


def of_samples(samples: np.ndarray, dt: float, *, stated: bool) -> list[str]:
    """Findings in the samples of a record in g and seconds, whose unit was stated or not."""
    size = np.abs(samples)
    if len(size) < MANY:
        return []
    largest = int(np.argmax(size))
    highest, others = float(size[largest]), float(np.delete(size, largest).max())
    if highest > ISOLATED * others > 0:
        place = f"acceleration[{largest}] = {samples[largest]:.4g} g, at {largest * dt:.6g} s,"
        return [f"{place} stands alone, no other sample is above {others:.4g} g: is it damaged?"]
    if not stated and highest > MOST_UNSTATED:
        asked = 'state units="m/s2", or units="g" if that is right'
        return [f"no unit is stated, and in g the peak is {highest:.4g} g: {asked}"]
    return []


def unseen(ground: GroundLike, grid: TimeGrid) -> list[str]:
    """Findings where a run on a grid does not resolve a ground motion, or ends before most of it.

    Known are the energies of records, wavelets and pulses, and of their sums and scalings.
    """
    return [] if is_traced(ground) else [*unresolved(ground, grid.dt), *_late(ground, grid)]


def _late(ground: GroundLike, grid: TimeGrid) -> list[str]:
    whole, later = (as_motion(ground).energy(t) for t in (-np.inf, grid.duration))
    if not (whole and later and later > LATE * whole):
        return []
    return [
        f"ground: {later / whole:.0%} of the motion's energy (∫ u''² dt) comes after the end of "
        f"the run, and should be at most {LATE:.0%}: a longer time grid holds it"
    ]


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
    if not gap > MOST_GAP * moved:
        return []
    return [
        f"{name} = {gap:.4g} {unit} should be at most {MOST_GAP:g} times what the buildings move, "
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


def unbalanced(residual: Any) -> list[str]:
    """A finding if a run's energy balance leaves too large a share of the energy put in."""
    if not float(residual) > MOST_RESIDUAL:
        return []
    return [
        f"the energy balance leaves {100 * float(residual):.2g} % of the energy put in, which "
        f"should be at most {100 * MOST_RESIDUAL:g} %: the time step is too long for this run "
        "(half of it leaves a quarter)"
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
    each = [jax.tree.map(lambda x, i=i: x[i], every) for i in range(n)]
    troubles = {
        "are not resolved": [unresolved(ground, grid.dt) for ground in each],
        "outlast the run": [_late(ground, grid) for ground in each],
    }
    for trouble, found in troubles.items():
        examples = [said[0].removeprefix("ground: ") for said in found if said]
        if len(examples) > LEAST_SHARE * n:
            share = _share(len(examples), n)
            findings.append(f"ground: {share} {trouble}; of one, {examples[0]}")
    if in_g or any(records_in(grounds)):
        pgas = np.asarray(_pgas(grounds, grid))
        beyond = int((pgas > MOST_PGA).sum())
        if beyond > LEAST_SHARE * n:
            largest = f"up to {np.nanmax(pgas):.4g} g"
            findings.append(_beyond(f"ground: PGA of {_share(beyond, n)}, {largest},"))
    return findings


@partial(jax.jit, static_argnames="grid")
def _pgas(grounds: Ground, grid: TimeGrid) -> jax.Array:
    return jax.vmap(lambda ground: peak(sampled(ground, grid).samples))(grounds)


def _share(some: int, n: int) -> str:
    return f"{some / n:.0%} of the {n} earthquakes looked at"


def _beyond(what: str) -> str:
    return f"{what} should be at most {MOST_PGA:.0f} g: are the units right?"
