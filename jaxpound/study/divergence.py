"""Growth of a small change of the gaps: the finite-time sensitivity of a run with impacts."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from jaxpound._checks import instance, is_traced, positive
from jaxpound._errors import InvalidInput, warn
from jaxpound._fields import pytree_dataclass, quantity
from jaxpound.grid import TimeGrid
from jaxpound.ground.motion import GroundLike
from jaxpound.ground.run_input import all_sampled, as_run
from jaxpound.model import parameters
from jaxpound.model.system import Structures, gravity_of, in_si
from jaxpound.simulation.run import simulate
from jaxpound.simulation.scheme import Scheme, imprecise, require_stable, single_system


@pytree_dataclass
class PerturbationGrowth:
    """Factor by which a run magnifies a small change of its gaps; dimensionless, as the run."""

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
        """Time until which the trajectory is predictable; infinite if it is so until the end.

        It is the first instant at which the factor times the uncertainty exceeds the share.

        Parameters
        ----------
        uncertainty
            Uncertainty of the gaps, and so of the closing at the first impact, > 0, in units of
            g/ω1²: that of the structure, of the ground motion, or of the scheme.
        share
            The error that the state may have, > 0, as a share of the motion's size.
        """
        uncertainty, share = positive(uncertainty=uncertainty, share=share)
        lost = self.factor * uncertainty > share * self.motion
        first = jnp.take_along_axis(self.time, jnp.argmax(lost, -1)[..., None], -1)[..., 0]
        return jnp.where(lost.any(-1), first, jnp.inf)


def perturbation_growth(
    structures: Structures, ground: GroundLike, grid: TimeGrid, scheme: Scheme = Scheme()
) -> PerturbationGrowth:
    """Factor by which a run with impacts magnifies a small change of its gaps, at every instant.

    The factor is the largest singular value of the derivative of the state, that is the
    displacements and velocities of all masses, by the gaps at rest of all links with a law of
    contact; for a single link the norm of one column. A gap acts by shifting the first impact, as
    does any other small error before it. From impact to impact the change is magnified: for a
    chaotic motion exponentially in the mean, and a trajectory and its derivatives say nothing about
    a real structure after ``horizon``. Statistics of many runs still do (see the page on chaos).
    Before the first impact the factor is 0; its last value is the result's ``end``.

    Forward mode finds the derivative in one run, which costs a few runs and their memory. Works
    under ``jit`` and ``vmap``; an invalid run, which cannot raise there, gives NaN, as does one
    that ends in non-finite numbers. Arguments are those of ``simulate``. Raises ``ValueError`` as
    ``simulate``, and if no link has a law of contact; warns (``PlausibilityWarning``) if contact is
    run in single precision.

    Examples
    --------
    >>> import jax
    >>> grid = jp.TimeGrid.until(8.0, dt=0.05)
    >>> def end(gap):  # under jit only what it needs is compiled
    ...     structures = replace(jp.paper.structures(), initial_gap=gap, contact=jp.Newton(0.65))
    ...     return jp.study.perturbation_growth(structures, jp.paper.ground(), grid).end
    >>> round(float(jax.jit(end)(0.3)), 2)
    1.49
    """
    system = single_system(structures)
    touching = [k for k, link in enumerate(system.links) if link.contact is not None]
    if not touching:
        raise InvalidInput("structures", "", "must have a link with a law of contact")
    instance("grid", grid, TimeGrid)
    instance("scheme", scheme, Scheme)
    # The run, whose gaps are traced, cannot check it.
    require_stable(structures, scheme, grid.dt)
    ground_motion = as_run(ground, scheme.finest(grid), gravity_of(structures))
    if in_si(structures):  # the system below knows no unit of time
        ground_motion = all_sampled(ground_motion, scheme.finest(grid))
    if not is_traced((system, ground_motion)):
        warn(imprecise(system, grid, ground_motion), strict=False)
    paths = [f"links.{k}.gap" for k in touching]

    def state(gaps: list[Any]) -> Any:
        changed = parameters.put(system, dict(zip(paths, gaps, strict=True)))
        run = simulate(changed, ground_motion, grid, scheme)
        along = jnp.stack([mass.x for mass in run.masses] + [mass.v for mass in run.masses], -1)
        return along, (run.time, along)

    gaps = [parameters.get(system, path) for path in paths]
    columns, (time, values) = jax.jacfwd(state, has_aux=True)(gaps)
    factor = jnp.linalg.norm(jnp.stack(columns, -1), ord=2, axis=(-2, -1))
    return PerturbationGrowth(time, factor, lax.cummax(jnp.linalg.norm(values, axis=-1)))
