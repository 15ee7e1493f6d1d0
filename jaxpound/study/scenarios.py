"""Scenario sets: structures and a ground motion as functions of a standard normal point z.

A set has a ``dimension`` d and a pure, traceable ``realize(z)`` with z of shape (d,). So a scenario
is determined by its z, can be differentiated, can be drawn from a low-discrepancy point set, and
different designs can be compared in the same earthquakes.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxpound._checks import count, instance, is_whole, require_memory
from jaxpound.grid import TimeGrid
from jaxpound.ground.motion import (
    DIMENSIONLESS,
    SECONDS,
    Ground,
    GroundLike,
    as_pytree,
    require_dimensionless,
    require_ground,
)
from jaxpound.model.system import Structures
from jaxpound.study.sampling import as_key, key_numbers, points, require_sampling

NUMBER_BYTES = 22_000
"""Bytes that JAX needs for each number of z, in a study's trace and program; measured."""


@runtime_checkable
class ScenarioSet(Protocol):
    """What ``monte_carlo`` needs of a scenario set.

    A set may also have ``parameters(z)``, a dictionary of d numbers by name, one for each number of
    z, or ``names`` of the numbers of z: correlations and sensitivities refer to them. Without
    either the names are z_1 to z_d. And it may have ``discrete``, the indices of those numbers of z
    of which it is a step function, such as a sign: there it has no derivative.
    """

    @property
    def dimension(self) -> int:
        """Number d of independent standard normal numbers."""

    def realize(self, z: Float[Array, " d"]) -> tuple[Structures, GroundLike]:
        """The scenario drawn by z: structures and ground motion."""


@runtime_checkable
class Draw(Protocol):
    """One part of a scenario, drawn at random: structures or a ground motion.

    It may have the same other members as a ``ScenarioSet``.
    """

    @property
    def dimension(self) -> int:
        """Number of independent standard normal numbers."""

    def draw(self, z: Float[Array, " d"]) -> Any:
        """The structures or the ground motion drawn by z."""


@dataclasses.dataclass(frozen=True)
class Scenarios:
    """Structures and a ground motion, each fixed or drawn, independently of each other.

    Parameters
    ----------
    structures
        ``AdjacentStructures`` or others, or a ``Draw`` of them (``UncertainStructures``,
        ``CustomDraw``).
    ground
        A ground motion, or a ``Draw`` (``RandomRicker``, ``RandomRecord``, ``FilteredNoise``,
        ``RandomPulse``, sums of them, ``CustomDraw``).

    Raises
    ------
    ValueError
        If one is of another type or a ground motion in seconds, both are fixed, or they have
        parameters of the same name.

    Examples
    --------
    >>> friction = jp.LogNormal(median=0.25, sigma=0.2)
    >>> scenarios = jp.Scenarios(
    ...     jp.UncertainStructures(jp.paper.structures(), {"friction": friction}),
    ...     jp.RandomRicker(2, jp.LogNormal(0.1, 0.5), jp.Uniform(1.0, 3.8), jp.Uniform(1.0, 7.0)),
    ... )
    >>> scenarios.dimension
    9
    >>> structures, ground = scenarios.realize(np.zeros(9))
    >>> round(float(structures.friction), 6)
    0.25
    """

    structures: Structures | Draw
    ground: GroundLike | Draw

    def __post_init__(self) -> None:
        instance("Scenarios", "structures", self.structures, Structures, Draw)
        if isinstance(self.ground, Draw):
            require_dimensionless_draw("Scenarios: ground", self.ground)
        else:
            require_ground("Scenarios: ground", self.ground)
            require_dimensionless("Scenarios: ground", self.ground)
        if not self.dimension:
            raise ValueError("Scenarios: structures and ground are both fixed; one must be drawn")
        parameter_names(self)

    @property
    def dimension(self) -> int:
        """Number of standard normal numbers: first the structures', then the ground's."""
        return _dimension(self.structures) + _dimension(self.ground)

    @property
    def discrete(self) -> tuple[int, ...]:
        """Indices of the numbers of which structures or ground motion are a step function."""
        first = _dimension(self.structures)
        others = (first + i for i in discrete_coordinates(self.ground))
        return (*discrete_coordinates(self.structures), *others)

    def realize(self, z: Float[Array, " d"]) -> tuple[Structures, GroundLike]:
        """Structures and ground motion of z, shape (dimension,)."""
        first = _dimension(self.structures)
        structures, ground = self.structures, self.ground
        return (
            structures.draw(z[:first]) if isinstance(structures, Draw) else structures,
            ground.draw(z[first:]) if isinstance(ground, Draw) else ground,
        )

    def at(
        self, indices: Any, key: int | jax.Array = 0, *, sampling: str = "plain"
    ) -> tuple[Structures, GroundLike]:
        """The scenarios of some samples of a study.

        Parameters
        ----------
        indices
            A sample's index (``Study.indices``), or some of them, shape (n,).
        key, sampling
            See ``monte_carlo``.

        Returns
        -------
        Structures and ground motion, each a batch of n if ``indices`` is an array.

        Raises
        ------
        ValueError
            If an argument breaks its rule.
        """
        owner = "Scenarios.at"
        limit = require_sampling(owner, sampling)
        chosen = np.asarray(indices)
        if chosen.ndim > 1 or chosen.dtype.kind not in "iu" or not chosen.size:
            raise ValueError(f"{owner}: indices = {indices!r} must be whole numbers, shape (n,)")
        if chosen.min() < 0 or chosen.max() >= limit:
            raise ValueError(f"{owner}: indices = {indices!r} must be from 0 to {limit - 1}")
        seeded = as_key(*key_numbers(owner, key))
        point = points(sampling, seeded, self.dimension)
        if chosen.ndim == 0:
            return self.realize(jnp.asarray(point(int(chosen), int(chosen) + 1)[0]))
        rows = np.concatenate([point(int(i), int(i) + 1) for i in chosen])
        return jax.vmap(self.realize)(jnp.asarray(rows))

    def parameters(self, z: Float[Array, " d"]) -> dict[str, Any]:
        """The drawn parameters, by name, in the order of z."""
        first = _dimension(self.structures)
        drawn = parameters(self.structures, z[:first]) if first else {}
        return drawn | (parameters(self.ground, z[first:], first) if len(z) > first else {})


def _dimension(part: Any) -> int:
    return part.dimension if isinstance(part, Draw) else 0


def require_dimensionless_draw(place: str, ground: Any) -> None:
    """A ``ValueError`` for a random ground motion in seconds."""
    if getattr(ground, "time_unit", None) == SECONDS:
        raise ValueError(
            f"{place}: {ground!r} must be in units of {DIMENSIONLESS}, as the structures are: "
            "scales.to_dimensionless(ground) makes it so"
        )


def grounds_at(scenarios: ScenarioSet, grid: TimeGrid) -> Callable[[Any], Ground]:
    """Program: points (n, d) to the n ground motions of their scenarios, to be looked at."""
    return jax.jit(jax.vmap(lambda z: as_pytree(scenarios.realize(z)[1], grid)))


def discrete_coordinates(drawn: Any) -> tuple[int, ...]:
    """Indices of the numbers of z of which a scenario set, or a part, says it is a step function.

    None of a set that says nothing, and of a fixed part.
    """
    return tuple(getattr(drawn, "discrete", ()))


def parameters(drawn: Any, z: Float[Array, " d"], before: int = 0) -> dict[str, Any]:
    """Parameters by name of a scenario set, or of a part whose z follows ``before`` others."""
    if hasattr(drawn, "parameters"):
        return drawn.parameters(z)
    names = getattr(drawn, "names", ()) or [f"z_{before + i + 1}" for i in range(len(z))]
    return dict(zip(names, z, strict=False))


def parameter_names(scenarios: ScenarioSet) -> tuple[str, ...]:
    """Names of ``parameters`` in the order of z."""
    names = keys_in_order(partial(parameters, scenarios), jnp.zeros(scenarios.dimension))
    if len(names) != scenarios.dimension:
        listed = ", ".join(names)
        raise ValueError(
            f"scenarios: the names of parameters, {listed}, must be {scenarios.dimension}, each "
            "another: one for each z"
        )
    return names


def keys_in_order(function: Callable[[Any], Mapping[str, Any]], z: Any) -> tuple[str, ...]:
    """Keys of the mapping that a traceable function returns, in their order (JAX sorts them)."""
    names: list[str] = []
    jax.eval_shape(lambda z: names.extend(function(z)), z)
    return tuple(names)


@dataclasses.dataclass(frozen=True)
class CustomDraw:
    """Structures, or a ground motion, drawn by a user's function.

    Parameters
    ----------
    function
        Pure and traceable: from z of shape (dimension,), independent standard normals, to
        structures or a ground motion.
    dimension
        Length of z, at least 1.
    names
        A name for each z; by default z_1, z_2, ...
    discrete
        Indices of those z of which the function is a step function: there it has no derivative.

    Raises
    ------
    ValueError
        If function is not callable, dimension is not a positive whole number or too large for the
        memory, the names are not ``dimension`` different ones, or an index in discrete is not one
        of a z.
    """

    function: Callable[[Any], Any]
    dimension: int
    names: tuple[str, ...] = ()
    discrete: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if not callable(self.function):
            raise ValueError(f"CustomDraw: function = {self.function!r} must be a function of z")
        n = count("CustomDraw", "dimension", self.dimension)
        require_memory("CustomDraw", "dimension", n, n * NUMBER_BYTES)
        names = tuple(self.names)
        if names and len(set(names)) != self.dimension:
            raise ValueError(
                f"CustomDraw: names = {names} must be {self.dimension} names, each another"
            )
        object.__setattr__(self, "names", names)
        discrete = tuple(self.discrete)
        if not all(is_whole(i) and 0 <= i < self.dimension for i in discrete):
            rule = f"indices from 0 to {self.dimension - 1}"
            raise ValueError(f"CustomDraw: discrete = {discrete} must be {rule}")
        object.__setattr__(self, "discrete", discrete)

    def draw(self, z: Float[Array, " d"]) -> Any:
        """The function's result at z."""
        return self.function(z)
