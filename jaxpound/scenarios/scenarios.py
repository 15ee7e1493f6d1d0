"""Scenario sets: structures and a ground motion as functions of a standard normal point z.

A set has a ``dimension`` d and a pure, traceable ``realize(z)`` with z of shape (d,). A scenario is
therefore determined by its z, can be differentiated, can be drawn from a low-discrepancy point set,
and different designs can be compared in the same earthquakes.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import accumulate
from typing import Any, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxpound._checks import count, instance, is_whole, require_memory
from jaxpound._errors import InvalidInput
from jaxpound.grid import TimeGrid
from jaxpound.ground import motion
from jaxpound.ground.run_input import as_run, require_time_unit
from jaxpound.model.system import Structures, gravity_of, in_si
from jaxpound.model.topology import Topology
from jaxpound.scenarios.sampling import as_key, key_numbers, points, require_sampling

NUMBER_BYTES = 22_000  # of JAX for each number of z in a study's trace and program (measured)


@runtime_checkable
class ScenarioSet(Protocol):
    """The members of a scenario set that ``monte_carlo`` needs.

    A set may also have ``parameters(z)``, a dictionary of d numbers by name, one for each number of
    z, or ``names`` of the numbers of z (by default z_1 to z_d), to which correlations and
    sensitivities refer; and ``discrete``, the indices of the numbers of z of which it is a step
    function, such as a sign, without derivative.
    """

    @property
    def dimension(self) -> int:
        """Number d of independent standard normal numbers."""

    def realize(self, z: Float[Array, " d"]) -> tuple[Structures, motion.GroundLike]:
        """The scenario drawn by z: structures and ground motion."""


@runtime_checkable
class Draw(Protocol):
    """Random structures, or a random ground motion: a part of a scenario.

    It may have the optional members of a ``ScenarioSet``.
    """

    @property
    def dimension(self) -> int:
        """Number of independent standard normal numbers."""

    def draw(self, z: Float[Array, " d"]) -> Any:
        """The structures or the ground motion drawn by z."""


class Composed:
    """A draw of several parts, each fixed or drawn, independently of each other."""

    _parts: Callable[[], Sequence[Any]]

    @property
    def dimension(self) -> int:
        """Number of standard normal numbers: those of one part after the other."""
        return sum(end - start for _, start, end in self._ranges())

    @property
    def discrete(self) -> tuple[int, ...]:
        """Indices of the numbers of which a part is a step function."""
        return tuple(i + k for x, i, _ in self._ranges() for k in discrete_coordinates(x))

    def parameters(self, z: Float[Array, " d"]) -> dict[str, Any]:
        """The drawn parameters, by name, in the order of z."""
        return {name: x for drawn in self._parameters(z) for name, x in drawn.items()}

    def _drawn(self, z: Any) -> list[Any]:
        """Each part as drawn by its numbers of z, or itself if it is fixed."""
        return [x.draw(z[i:j]) if isinstance(x, Draw) else x for x, i, j in self._ranges()]

    def _parameters(self, z: Any) -> list[dict[str, Any]]:
        return [parameters(x, z[i:j], i) if j > i else {} for x, i, j in self._ranges()]

    def _ranges(self) -> Iterator[tuple[Any, int, int]]:
        """Each part, with start and end of its numbers in those of all parts."""
        parts = self._parts()
        sizes = (part.dimension if isinstance(part, Draw) else 0 for part in parts)
        ends = [*accumulate(sizes, initial=0)]
        return zip(parts, ends, ends[1:], strict=False)


@dataclasses.dataclass(frozen=True)
class Scenarios(Composed):
    """Structures and a ground motion, each fixed or drawn, independently of each other.

    ``structures`` are ``Buildings`` in SI units, dimensionless ``AdjacentStructures`` or others, or
    a ``Draw`` of them (``UncertainStructures``, ``CustomDraw``); ``ground`` is a ground motion in
    their unit of time, or a ``Draw`` (``RandomRicker``, ``RandomRecord``, ``FilteredNoise``,
    ``RandomPulse``, sums of them, ``CustomDraw``). Raises ``ValueError`` for other types and units
    of time, two fixed arguments, or parameters of the same name.

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
    ground: motion.GroundLike | Draw

    def __post_init__(self) -> None:
        instance("structures", self.structures, Structures, Draw)
        if not isinstance(self.ground, Draw):
            motion.require_ground("ground", self.ground)
        nominal = getattr(self.structures, "nominal", self.structures)
        if isinstance(nominal, Structures):  # else each run checks the unit of time
            require_time_unit("ground", self.ground, si=in_si(nominal))
        if not self.dimension:
            raise InvalidInput("structures and ground", "", "are both fixed; one must be drawn")
        parameter_names(self)

    def _parts(self) -> Sequence[Any]:
        return self.structures, self.ground

    def realize(self, z: Float[Array, " d"]) -> tuple[Structures, motion.GroundLike]:
        """Structures and ground motion of z, shape (dimension,)."""
        structures, ground = self._drawn(z)
        return structures, ground

    def at(
        self, indices: Any, key: int | jax.Array = 0, *, sampling: str = "plain"
    ) -> tuple[Structures, motion.GroundLike]:
        """Structures and ground motion of samples of a study, by one or by n ``Study.indices``.

        Shape (n,) makes batches of n.
        """
        limit = require_sampling(sampling)
        chosen = np.asarray(indices)
        if chosen.ndim > 1 or chosen.dtype.kind not in "iu" or not chosen.size:
            raise InvalidInput("indices", repr(indices), "must be whole numbers, shape (n,)")
        if chosen.min() < 0 or chosen.max() >= limit:
            raise InvalidInput("indices", repr(indices), f"must be from 0 to {limit - 1}")
        draw = points(sampling, as_key(*key_numbers(key)), self.dimension)
        z = jnp.asarray(np.concatenate([draw(int(i), int(i) + 1) for i in chosen.ravel()]))
        # By one program: operation by operation a batch would compile a hundred.
        return jax.jit(jax.vmap(self.realize))(z) if chosen.ndim else self.realize(z[0])


def structures_of(scenarios: ScenarioSet) -> Any:
    """The structures of a scenario, with shapes in the place of numbers."""
    return jax.eval_shape(lambda z: scenarios.realize(z)[0], jnp.zeros(scenarios.dimension))


def topology_of(scenarios: ScenarioSet) -> Topology:
    """The topology of the structures of every scenario."""
    z = jnp.zeros(scenarios.dimension)
    return jax.eval_shape(lambda z: scenarios.realize(z)[0].system(), z).topology


def grounds_at(scenarios: ScenarioSet, grid: TimeGrid) -> Callable[[Any], motion.Ground]:
    """Program: points (n, d) to the n ground motions of their scenarios, in g, to be checked."""

    def ground_of(z: Any) -> motion.Ground:
        structures, ground = scenarios.realize(z)
        gravity = gravity_of(structures)
        traceable = as_run(ground, grid, gravity)
        return traceable if gravity is None else motion.Scaled(traceable, 1 / gravity)

    return jax.jit(jax.vmap(ground_of))


def discrete_coordinates(drawn: Any) -> tuple[int, ...]:
    """The ``discrete`` indices of a scenario set or a part; none where it has no such member."""
    return tuple(getattr(drawn, "discrete", ()))


def discrete_names(scenarios: ScenarioSet) -> str:
    """Names of the first discrete numbers of scenarios; empty if there are none."""
    indices = discrete_coordinates(scenarios)
    names = parameter_names(scenarios) if indices else ()
    return ", ".join([names[i] for i in indices[:4]] + ["..."] * (len(indices) > 4))


def parameters(drawn: Any, z: Float[Array, " d"], before: int = 0) -> dict[str, Any]:
    """Parameters by name of a scenario set, or of a part whose z follows ``before`` numbers."""
    if hasattr(drawn, "parameters"):
        return drawn.parameters(z)
    names = getattr(drawn, "names", ()) or [f"z_{before + i + 1}" for i in range(len(z))]
    return dict(zip(names, z, strict=False))


def parameter_names(scenarios: ScenarioSet) -> tuple[str, ...]:
    """Names of ``parameters`` in the order of z."""
    names = keys_in_order(partial(parameters, scenarios), jnp.zeros(scenarios.dimension))
    if len(names) != scenarios.dimension:
        rule = f"must be {scenarios.dimension} different names: one for each z"
        raise InvalidInput(f"scenarios: the names of parameters, {', '.join(names)},", "", rule)
    return names


def keys_in_order(function: Callable[[Any], Mapping[str, Any]], z: Any) -> tuple[str, ...]:
    """Keys of the mapping that a traceable function returns, in their order (JAX sorts them)."""
    names: list[str] = []
    jax.eval_shape(lambda z: names.extend(function(z)), z)
    return tuple(names)


@dataclasses.dataclass(frozen=True)
class CustomDraw:
    """Structures, or a ground motion, drawn by a user's function.

    ``function`` is a pure and traceable function of z, shape (dimension,), independent standard
    normal numbers; ``names`` are different names for each z, by default z_1, z_2, ...;
    ``discrete`` are the indices of the numbers of z of which it is a step function, without
    derivative. Raises ``ValueError`` for others, or if the memory has no room for z.
    """

    function: Callable[[Any], Any]
    dimension: int
    names: tuple[str, ...] = ()
    discrete: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if not callable(self.function):
            raise InvalidInput("function", repr(self.function), "must be a function of z")
        n = count("dimension", self.dimension)
        require_memory("dimension", n, n * NUMBER_BYTES)
        names, discrete = tuple(self.names), tuple(self.discrete)
        if names and len(set(names)) != n:
            raise InvalidInput("names", str(names), f"must be {n} different names")
        if not all(is_whole(i) and 0 <= i < n for i in discrete):
            raise InvalidInput("discrete", str(discrete), f"must be indices from 0 to {n - 1}")
        vars(self).update(names=names, discrete=discrete)

    def draw(self, z: Float[Array, " d"]) -> Any:
        """The function's result at z."""
        return self.function(z)
