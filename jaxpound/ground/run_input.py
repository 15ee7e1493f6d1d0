"""Ground motions as a run takes them: in the structures' units, and as pytrees of arrays."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jaxpound._errors import InvalidInput
from jaxpound._fields import parameter, pytree_dataclass, static
from jaxpound.grid import TimeGrid
from jaxpound.ground import motion
from jaxpound.ground.motion import DIMENSIONLESS, SECONDS, Ground, GroundLike, GroundMotion
from jaxpound.ground.supports import by_each_support, n_supports


@pytree_dataclass
class Sampled(GroundMotion):
    """Values at the instants m·dt of a time grid only."""

    samples: Any = parameter(r"u''", "acceleration", "ground acceleration")
    dt: Any
    time_unit: str | None = static(default=None)

    def acceleration(self, t: ArrayLike) -> jax.Array:
        """u''(t) at an instant of the grid, of the shape of ``t``."""
        return jnp.asarray(self.samples)[jnp.round(jnp.asarray(t) / self.dt).astype(int)]

    def excitation(self, grid: TimeGrid, order: int) -> motion.Excitation:
        """The samples."""
        at_instants = self.acceleration(instants(grid, self))
        return motion.Excitation(at_instants, lambda _, entry: (entry, entry))


def instants(grid: TimeGrid, tree: Any) -> Float[Array, " n_steps+1"]:
    """The instants of a grid in the time loop, in the precision of a tree's arrays."""
    dtype = jnp.result_type(float, *jax.tree.leaves(tree))
    # A compiled program might fuse m·dt with later operations and round it differently.
    return jnp.asarray(np.arange(grid.n_steps + 1, dtype=dtype) * np.asarray(grid.dt, dtype))


def sampled(ground: GroundLike, grid: TimeGrid) -> Sampled:
    """The motion of the ground, or of support 0, at the instants of a time grid.

    Each value must be a finite real number.
    """
    motion.require_ground("ground", ground)
    return Sampled(motion.as_motion(ground).samples_at(grid.times()), grid.dt)


def all_sampled(ground: GroundLike, grid: TimeGrid) -> GroundMotion:
    """``sampled``, of each support."""
    return by_each_support(ground, lambda own: sampled(own, grid))


def require_time_unit(name: str, ground: Any, *, si: bool = False) -> None:
    """An error for a ground motion, or a random one, in another unit of time than the structures.

    Sums and scalings are checked part by part; ``si`` says that the structures are in SI units.
    """
    for member in motion.records_in(ground) if isinstance(ground, GroundMotion) else [ground]:
        if getattr(member, "time_unit", None) == (DIMENSIONLESS if si else SECONDS):
            rule = f"must be in units of {DIMENSIONLESS}, as the structures are: "
            rule += "scales.to_dimensionless makes it so, or Buildings takes it unchanged, in SI"
            rule = "must be in seconds, as Buildings are" if si else f"{rule} units"
            raise InvalidInput(name, repr(member), rule)


def as_run(ground: GroundLike, grid: TimeGrid, gravity: Any = None) -> Ground:
    """A ground motion as a run takes it: a pytree, in m/s² with a ``gravity``, in g without."""
    ground = motion.by_supports(ground)
    require_time_unit("ground", ground, si=gravity is not None)
    return as_pytree(ground if gravity is None else motion.as_motion(ground).in_si(gravity), grid)


def all_in_g(grounds: Ground, gravity: Any) -> Ground:
    """Ground motions with a leading axis, of runs in SI with a ``gravity``, in g."""
    if gravity is None:
        return grounds
    return jax.vmap(lambda ground: motion.Scaled(ground.in_si(gravity), 1 / gravity))(grounds)


def as_pytree(ground: GroundLike, grid: TimeGrid) -> Ground:
    """The ground motion itself if JAX can trace through it, else ``sampled``."""
    leaves = jax.tree.leaves(ground)
    if isinstance(ground, Ground) and all(hasattr(x, "dtype") or np.isscalar(x) for x in leaves):
        return ground
    if n_supports(ground):
        return by_each_support(ground, lambda own: as_pytree(own, grid))
    return sampled(ground, grid)
