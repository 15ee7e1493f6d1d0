"""Scenario sets: what makes structures and a ground motion of independent standard normal numbers.

A set has a ``dimension`` d and a pure, traceable ``realize(z)`` with z of shape (d,). So a scenario
is known by its numbers, a gradient or a low-discrepancy point set passes through, and the same
numbers can shake different designs.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import ndtr, ndtri
from jaxtyping import Array, Float

from jaxpound._checks import Rule, count, enforce, hint, instance, is_traced, number, require_memory
from jaxpound.ground.motion import DIMENSIONLESS, GroundLike, require_dimensionless, require_ground
from jaxpound.ground.record import Record
from jaxpound.ground.ricker import Ricker
from jaxpound.model.structures import AdjacentStructures
from jaxpound.study.distributions import Distribution, truncated
from jaxpound.study.sampling import as_key, key_numbers, points, require_sampling


@runtime_checkable
class ScenarioSet(Protocol):
    """What ``monte_carlo`` asks of a scenario set.

    A set may also have ``parameters(z)``, a dictionary of d numbers by name, one for each z, or
    ``names`` for z itself: they stand for the axes of correlations and sensitivities. Without
    these are z_1 to z_d.
    """

    @property
    def dimension(self) -> int:
        """Number d of independent standard normal numbers."""

    def realize(self, z: Float[Array, " d"]) -> tuple[AdjacentStructures, GroundLike]:
        """The scenario of z."""


@runtime_checkable
class Draw(Protocol):
    """One part of a scenario, drawn at random: structures or a ground motion."""

    @property
    def dimension(self) -> int:
        """Number of independent standard normal numbers."""

    def draw(self, z: Float[Array, " d"]) -> Any:
        """What z stands for."""


@dataclasses.dataclass(frozen=True)
class Scenarios:
    """Structures and a ground motion, each fixed or drawn, independently of each other.

    Parameters
    ----------
    structures
        ``AdjacentStructures``, or a ``Draw`` of them (``UncertainStructures``, ``CustomDraw``).
    ground
        A ground motion, or a ``Draw`` (``RandomRicker``, ``RandomRecord``, ``CustomDraw``).

    Raises
    ------
    ValueError
        If one is of another type or a record in seconds, both are fixed, or they have parameters
        of the same name.

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

    structures: AdjacentStructures | Draw
    ground: GroundLike | Draw

    def __post_init__(self) -> None:
        if not isinstance(self.structures, AdjacentStructures | Draw):
            raise ValueError(
                f"Scenarios: structures = {self.structures!r} must be AdjacentStructures or drawn"
            )
        if not isinstance(self.ground, Draw):
            require_ground("Scenarios: ground", self.ground)
            require_dimensionless("Scenarios: ground", self.ground)
        if not self.dimension:
            raise ValueError("Scenarios: structures and ground are both fixed; one must be drawn")
        parameter_names(self)

    @property
    def dimension(self) -> int:
        """Number of standard normal numbers: first the structures', then the ground's."""
        return _dimension(self.structures) + _dimension(self.ground)

    def realize(self, z: Float[Array, " d"]) -> tuple[AdjacentStructures, GroundLike]:
        """Structures and ground motion of z, shape (dimension,)."""
        first = _dimension(self.structures)
        structures, ground = self.structures, self.ground
        return (
            structures.draw(z[:first]) if isinstance(structures, Draw) else structures,
            ground.draw(z[first:]) if isinstance(ground, Draw) else ground,
        )

    def at(
        self, indices: Any, key: int | jax.Array = 0, *, sampling: str = "plain"
    ) -> tuple[AdjacentStructures, GroundLike]:
        """The scenarios of a study's samples, to be looked at one by one.

        Parameters
        ----------
        indices
            A sample's index (``Study.indices``), or some of them, shape (n,).
        key, sampling
            As of ``monte_carlo``.

        Returns
        -------
        Structures and ground motion, each a batch of n where indices are some.

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
        """What was drawn, by name, in the order of z."""
        first = _dimension(self.structures)
        drawn = parameters(self.structures, z[:first]) if first else {}
        return drawn | (parameters(self.ground, z[first:], first) if len(z) > first else {})


def _dimension(part: Any) -> int:
    return part.dimension if isinstance(part, Draw) else 0


def parameters(drawn: Any, z: Float[Array, " d"], before: int = 0) -> dict[str, Any]:
    """The named numbers of a scenario set, or of a part of one after ``before`` others."""
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
    """Keys of what a traceable function returns, in its order, which JAX does not keep."""
    names: list[str] = []
    jax.eval_shape(lambda z: names.extend(function(z)), z)
    return tuple(names)


@dataclasses.dataclass(frozen=True)
class CustomDraw:
    """Structures, or a ground motion, by a function of one's own.

    Parameters
    ----------
    function
        Pure and traceable: from z of shape (dimension,), independent standard normals, to
        ``AdjacentStructures`` or a ground motion.
    dimension
        Length of z, at least 1.
    names
        A name for each z; by default z_1, z_2, ...

    Raises
    ------
    ValueError
        If function is not callable, dimension is not a positive whole number or is more than memory
        has room for, or the names are not so many, each another.
    """

    function: Callable[[Any], Any]
    dimension: int
    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not callable(self.function):
            raise ValueError(f"CustomDraw: function = {self.function!r} must be a function of z")
        n = count("CustomDraw", "dimension", self.dimension)
        require_memory("CustomDraw", "dimension", n, n * _NUMBER_BYTES)
        names = tuple(self.names)
        if names and len(set(names)) != self.dimension:
            raise ValueError(
                f"CustomDraw: names = {names} must be {self.dimension} names, each another"
            )
        object.__setattr__(self, "names", names)

    def draw(self, z: Float[Array, " d"]) -> Any:
        """What the function makes of z."""
        return self.function(z)


@dataclasses.dataclass(frozen=True)
class RandomRicker:
    """A sum of random Ricker wavelets, independent of each other.

    Parameters
    ----------
    wavelets
        Their number n, at least 1.
    amplitude
        Distribution of each displacement amplitude, in g/ω1² (the scale of ``Ricker.amplitude``).
    periods, arrivals
        Distributions of each wavelet's period, truncated to what is positive, and centre, in 1/ω1.
    negative
        Probability, 0 to 1, that a wavelet is turned upside down.
    intensity
        Distribution of one factor for all wavelets of an earthquake; none by default. A wide one
        spreads the earthquakes over the intensities of a fragility curve.

    Raises
    ------
    ValueError
        If wavelets is not a positive whole number, or more than memory has room for, negative not a
        probability, or another argument not a distribution.
    """

    wavelets: int
    amplitude: Distribution
    periods: Distribution
    arrivals: Distribution
    negative: float = 0.5
    intensity: Distribution | None = None

    def __post_init__(self) -> None:
        n = count("RandomRicker", "wavelets", self.wavelets)
        require_memory("RandomRicker", "wavelets", n, 4 * n * _NUMBER_BYTES)
        for name in ("amplitude", "periods", "arrivals"):
            instance("RandomRicker", name, getattr(self, name), Distribution)
        p = number("RandomRicker", "negative", self.negative)
        enforce("RandomRicker", [Rule("negative", p, (p >= 0) & (p <= 1), "between 0 and 1")])
        if self.intensity is not None:
            instance("RandomRicker", "intensity", self.intensity, Distribution)

    @property
    def dimension(self) -> int:
        """Amplitude, period and arrival of each wavelet, its sign and the intensity if random."""
        return self.wavelets * (3 + self._signed) + (self.intensity is not None)

    def draw(self, z: Float[Array, " d"]) -> Ricker:
        """The wavelets of z."""
        values = self._values(z)
        amplitude = values["intensity"] * values["sign"] * values["amplitude"]
        return Ricker(amplitude, values["period"], values["arrival"])

    def parameters(self, z: Float[Array, " d"]) -> dict[str, Any]:
        """Amplitudes, periods, arrivals, signs by wavelet, and the intensity, if random."""
        values = self._values(z)
        kinds = ["amplitude", "period", "arrival", *["sign"] * self._signed]
        named = {f"{kind}_{i + 1}": values[kind][i] for kind in kinds for i in range(self.wavelets)}
        return named | ({} if self.intensity is None else {"intensity": values["intensity"]})

    @property
    def _signed(self) -> bool:
        return 0 < self.negative < 1

    def _values(self, z: Any) -> dict[str, Any]:
        n = self.wavelets
        amplitude, periods, arrivals = z[:n], z[n : 2 * n], z[2 * n : 3 * n]
        if self._signed:
            sign = jnp.where(z[3 * n : 4 * n] < ndtri(self.negative), -1.0, 1.0).astype(z.dtype)
        else:
            sign = jnp.full(n, 1.0 - 2.0 * self.negative, z.dtype)
        periods = truncated(self.periods, periods, _SMALLEST, math.inf)
        return {
            "amplitude": self.amplitude.from_normal(amplitude),
            "period": periods,
            "arrival": self.arrivals.from_normal(arrivals),
            "sign": sign,
            "intensity": 1.0 if self.intensity is None else self.intensity.from_normal(z[-1]),
        }


@dataclasses.dataclass(frozen=True)
class RandomRecord:
    """One of several recorded accelerograms, scaled.

    Parameters
    ----------
    records
        The records, in units of g over 1/ω1 (``Scales.to_dimensionless``), of any lengths.
    factor
        Distribution of the factor; none (a factor of 1) by default.
    weights
        Relative frequencies of the records ≥ 0; equal by default.

    Raises
    ------
    ValueError
        If records is empty, holds something else or a record in seconds, factor is not a
        distribution, or the weights are not so many, not negative, with a positive sum.
    """

    records: tuple[Record, ...]
    factor: Distribution | None = None
    weights: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        records = tuple(self.records) if isinstance(self.records, Sequence) else ()
        if not records:
            raise ValueError(f"RandomRecord: records = {self.records!r} must hold records")
        for i, record in enumerate(records):
            instance("RandomRecord", f"records[{i}]", record, Record)
            require_dimensionless(f"RandomRecord: records[{i}]", record)
        object.__setattr__(self, "records", records)
        if self.factor is not None:
            instance("RandomRecord", "factor", self.factor, Distribution)
        if self.weights is not None:
            weights = np.asarray(self.weights, float)
            right = weights.shape == (len(records),) and (weights >= 0).all() and weights.sum() > 0
            if not (right and np.isfinite(weights).all()):
                raise ValueError(
                    f"RandomRecord: weights = {self.weights!r} must be {len(records)} numbers, "
                    "finite and not negative, with a positive sum"
                )
            object.__setattr__(self, "weights", tuple(map(float, weights)))

    @property
    def dimension(self) -> int:
        """The choice, if there is one, and the factor, if it is random."""
        return (len(self.records) > 1) + (self.factor is not None)

    def draw(self, z: Float[Array, " d"]) -> Record:
        """The record of z, scaled."""
        which, factor = self._values(z)
        # Zeros at the end change nothing: there a record is at rest.
        longest = max(record.n_samples for record in self.records)
        samples = np.stack([np.pad(r.samples, (0, longest - r.n_samples)) for r in self.records])
        dts = np.array([float(record.dt) for record in self.records])
        return Record(
            factor * jnp.asarray(samples, z.dtype)[which],
            jnp.asarray(dts, z.dtype)[which],
            time_unit=DIMENSIONLESS,
        )

    def parameters(self, z: Float[Array, " d"]) -> dict[str, Any]:
        """The record's number, from 0, and the factor, as they are random."""
        which, factor = self._values(z)
        named = {"record": which} if len(self.records) > 1 else {}
        return named | ({} if self.factor is None else {"factor": factor})

    def _values(self, z: Any) -> tuple[Any, Any]:
        weights = np.array(self.weights or [1.0] * len(self.records))
        ends = np.cumsum(weights / weights.sum())[:-1]
        which: Any = 0
        if len(self.records) > 1:
            which = jnp.sum(ndtr(z[0]) >= jnp.asarray(ends, z.dtype))
        return which, 1.0 if self.factor is None else self.factor.from_normal(z[-1])


_NUMBER_BYTES = (
    22_000  # that JAX keeps of each number of z, in a study's trace and program; measured
)
_LEAST = 0.1  # of a distribution's probability that must be where its parameter may be
_SMALLEST = 1e-30  # of what must be positive, and is not 0 in single precision either

# The interval that each parameter must be in, where it does not depend on others; in this order
# they are drawn.
PARAMETERS: dict[str, tuple[float, float]] = {
    **{f"rod_{i}.order": (_SMALLEST, 1.0) for i in (1, 2)},
    **{f"rod_{i}.tau_{x}": (_SMALLEST, math.inf) for x in "fx" for i in (1, 2)},
    "mass_ratio": (_SMALLEST, math.inf),
    "stiffness_ratio": (_SMALLEST, math.inf),
    "friction": (0.0, math.inf),
    "initial_gap": (0.0, math.inf),
}


@dataclasses.dataclass(frozen=True)
class UncertainStructures:
    """Structures some of whose parameters are random, independently of each other.

    A distribution is truncated to what its parameter may be: order in (0, 1], the rest positive,
    τ_f ≤ τ_x where τ_x is certain, and τ_x ≥ the τ_f drawn. So every draw is valid.

    Parameters
    ----------
    nominal
        The parameters that are certain.
    uncertain
        Distributions by field path: ``{"friction": LogNormal(0.25, 0.2), "rod_1.tau_x": ...}``.

    Raises
    ------
    ValueError
        If a path is unknown, a value is not a distribution, there is none, or less than a tenth of
        a distribution's probability is where its parameter may be.
    """

    nominal: AdjacentStructures
    uncertain: Mapping[str, Distribution]

    def __post_init__(self) -> None:
        instance("UncertainStructures", "nominal", self.nominal, AdjacentStructures)
        instance("UncertainStructures", "uncertain", self.uncertain, Mapping)
        if not self.uncertain:
            raise ValueError("UncertainStructures: uncertain = {} must name a parameter")
        for path, distribution in self.uncertain.items():
            if path not in PARAMETERS:
                meant = hint(path, PARAMETERS)
                raise ValueError(f"UncertainStructures: unknown path {path!r}; {meant}")
            instance("UncertainStructures", path, distribution, Distribution)
            low, high = self._bounds(path, {})
            if not is_traced((low, high)):
                below, upto = (float(ndtr(distribution.to_normal(x))) for x in (low, high))
                inside = upto - below
                if inside < _LEAST:
                    raise ValueError(
                        f"UncertainStructures: {path} ~ {distribution} must have at least "
                        f"{_LEAST:.0%} of its probability in [{float(low):.6g}, {float(high):.6g}]"
                    )
        object.__setattr__(self, "uncertain", dict(self.uncertain))

    @property
    def dimension(self) -> int:
        """Number of uncertain parameters."""
        return len(self.uncertain)

    def draw(self, z: Float[Array, " d"]) -> AdjacentStructures:
        """The structures of z."""
        return replaced(self.nominal, self.parameters(z))

    def parameters(self, z: Float[Array, " d"]) -> dict[str, Any]:
        """The parameters drawn, by field path."""
        numbers = dict(zip(self.uncertain, z, strict=True))
        drawn: dict[str, Any] = {}
        for path in PARAMETERS:
            if path not in numbers:
                continue
            low, high = self._bounds(path, drawn)
            drawn[path] = truncated(self.uncertain[path], numbers[path], low, high)
        return {path: drawn[path] for path in self.uncertain}

    def _bounds(self, path: str, drawn: Mapping[str, Any]) -> tuple[Any, Any]:
        """The interval that a parameter must be in, given those drawn before."""
        low, high = PARAMETERS[path]
        rod, _, name = path.partition(".")
        if name == "tau_x" and f"{rod}.tau_f" in self.uncertain:
            return drawn.get(f"{rod}.tau_f", low), high
        if name == "tau_x":
            return getattr(self.nominal, rod).tau_f, high
        if name == "tau_f" and f"{rod}.tau_x" not in self.uncertain:
            return low, getattr(self.nominal, rod).tau_x
        return low, high


def replaced(structures: AdjacentStructures, values: Mapping[str, Any]) -> AdjacentStructures:
    """Structures with other values of parameters, by path."""
    changes: dict[str, Any] = {path: x for path, x in values.items() if "." not in path}
    for rod in ("rod_1", "rod_2"):
        fields = {p.removeprefix(f"{rod}."): x for p, x in values.items() if p.startswith(rod)}
        if fields:
            changes[rod] = dataclasses.replace(getattr(structures, rod), **fields)
    return dataclasses.replace(structures, **changes)
