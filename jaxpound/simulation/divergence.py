"""How sure a run with impacts is: the growth of a small change of its gaps."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from jaxpound._checks import instance, positive
from jaxpound._fields import pytree_dataclass, quantity
from jaxpound.grid import TimeGrid
from jaxpound.ground.motion import GroundLike
from jaxpound.model import parameters
from jaxpound.model.system import Structures
from jaxpound.simulation.run import simulate
from jaxpound.simulation.scheme import Scheme, require_stable, system_of


@pytree_dataclass
class Growth:
    """By how much a run magnifies a small change of its gaps; dimensionless, as the run."""

    time: Any = quantity("time")
    """Instants t of the grid, shape (n_steps+1,)."""
    factor: Any = quantity(None)
    """Size of the change of the state at each instant over that of the gaps, shape (n_steps+1,)."""
    motion: Any = quantity(None)
    """Size of the state until then: its largest norm so far, shape (n_steps+1,)."""

    @property
    def end(self) -> Any:
        """The factor at the end of the run."""
        return self.factor[..., -1]

    def horizon(self, uncertainty: Any, share: Any = 0.1) -> Any:
        """Until when the trajectory means something; infinite if it does so until the end.

        Parameters
        ----------
        uncertainty
            What the gaps, and so the closing at the first impact, are known to, > 0, in units of
            g/ω1²: of the structure, of the ground motion, or of the scheme.
        share
            The error that the state may have, > 0, as a share of the motion's size.

        Returns
        -------
        The first instant at which the factor times the uncertainty exceeds that share.

        Raises
        ------
        ValueError
            If uncertainty or share is known and not positive.
        """
        uncertainty, share = positive("horizon", uncertainty=uncertainty, share=share)
        lost = self.factor * uncertainty > share * self.motion
        first = jnp.take_along_axis(self.time, jnp.argmax(lost, -1)[..., None], -1)[..., 0]
        return jnp.where(lost.any(-1), first, jnp.inf)


def growth(
    structures: Structures,
    ground: GroundLike,
    grid: TimeGrid,
    scheme: Scheme = Scheme(),
) -> Growth:
    """By how much a run with impacts magnifies a small change of the gaps, at every instant.

    The factor is the largest singular value of the derivative of the state, that is the
    displacements and velocities of all masses, by the gaps at rest of all links with a law of
    contact; for a single link the norm of one column. A gap acts by shifting the first impact, as
    does any other small error before it. From impact to impact the change is magnified: for a
    chaotic motion exponentially in the mean, and a trajectory and its derivatives, exact as they
    are, tell nothing of a real structure after ``horizon``. Statistics of many runs still do (see
    the page on chaos).

    The derivative is found by forward mode in one run; it costs a few runs, and their memory.

    Parameters
    ----------
    structures, ground, grid, scheme
        As of ``simulate``; at least one link must have a law of contact.

    Returns
    -------
    Growth
        With its ``factor`` (0 before the first impact), and its value at the ``end``.

    Raises
    ------
    ValueError
        As ``simulate``, and if no link has a law of contact.

    Notes
    -----
    Works under ``jit`` and ``vmap``. An invalid run, which cannot raise there, gives NaN; so does
    one that ends in non-finite numbers.

    Examples
    --------
    >>> structures = replace(jp.paper.structures(), initial_gap=0.3, contact=jp.Newton(0.65))
    >>> found = jp.growth(structures, jp.paper.ground(), jp.TimeGrid.until(8.0, dt=0.05))
    >>> 0.1 < float(found.end) < 10
    True
    """
    system = system_of("growth", structures)
    touching = [k for k, link in enumerate(system.links) if link.contact is not None]
    if not touching:
        raise ValueError("growth: structures must have a link with a law of contact")
    instance("growth", "grid", grid, TimeGrid)
    instance("growth", "scheme", scheme, Scheme)
    require_stable(system, grid, scheme)  # which the run, whose gaps are traced, cannot
    paths = [f"links.{k}.gap" for k in touching]

    def state(gaps: list[Any]) -> Any:
        changed = parameters.put(system, dict(zip(paths, gaps, strict=True)))
        run = simulate(changed, ground, grid, scheme)
        series = [mass.x for mass in run.masses] + [mass.v for mass in run.masses]
        along = jnp.stack(series, -1)
        return along, (run.time, along)

    gaps = [parameters.get(system, path) for path in paths]
    columns, (time, values) = jax.jacfwd(state, has_aux=True)(gaps)
    factor = jnp.linalg.norm(jnp.stack(columns, -1), ord=2, axis=(-2, -1))
    return Growth(time, factor, lax.cummax(jnp.linalg.norm(values, axis=-1)))
