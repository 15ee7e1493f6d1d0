"""The earthquakes that a design is made for, the same for all designs."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import Literal

from jaxpound._checks import count, instance, require_memory, seed
from jaxpound.grid import TimeGrid
from jaxpound.ground.motion import (
    DIMENSIONLESS,
    Ground,
    GroundLike,
    require_dimensionless,
    require_ground,
    sampled,
)
from jaxpound.ground.record import Record, derived
from jaxpound.ground.ricker import Ricker
from jaxpound.model.parameters import get, paths
from jaxpound.study.sampling import as_key, key_numbers, points, require_sampling
from jaxpound.study.scenarios import ScenarioSet


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Ensemble:
    """Earthquakes, each with uncertain parameters of the structures; made by ``of`` or ``drawn``.

    All designs of a search are evaluated in the same earthquakes (common random numbers).

    Examples
    --------
    >>> amplitude, periods = jp.LogNormal(0.1, 0.5), jp.Uniform(1.0, 3.8)
    >>> ground = jp.RandomRicker(2, amplitude, periods, arrivals=jp.Uniform(1.0, 7.0))
    >>> earthquakes = jp.Ensemble.drawn(jp.Scenarios(jp.paper.structures(), ground), 8)
    >>> earthquakes
    Ensemble(8 earthquakes)
    >>> earthquakes + jp.Ensemble.of([jp.paper.ground()], jp.paper.grid())
    Ensemble(9 earthquakes)
    """

    grounds: Ground
    """The ground motions; every array has a leading axis of n."""
    uncertain: Mapping[str, np.ndarray]
    """Parameters of the structures that differ from earthquake to earthquake, by path, (n,)."""
    scenarios: ScenarioSet | None = None
    """The random scenarios that it was drawn from; None if it was not."""
    _more: Callable[[int], Ensemble] | None = None

    @staticmethod
    def of(grounds: Sequence[GroundLike], grid: TimeGrid) -> Ensemble:
        """Given ground motions, all equally likely.

        ``Ricker`` and ``Record`` may have any numbers of wavelets and samples. If there are others
        (sums, multiples, functions of t), all are sampled at the instants of the grid.

        Raises
        ------
        ValueError
            If there is none, or one is no ground motion or a record in seconds.
        """
        given = list(grounds) if isinstance(grounds, Sequence) else []
        if not given:
            raise ValueError(f"Ensemble: grounds = {grounds!r} must hold ground motions")
        for i, ground in enumerate(given):
            require_ground(f"Ensemble: grounds[{i}]", ground)
            require_dimensionless(f"Ensemble: grounds[{i}]", ground)
        waves = [ground for ground in given if isinstance(ground, Ricker)]
        records = [ground for ground in given if isinstance(ground, Record)]
        if len(waves) + len(records) < len(given):
            return Ensemble(_stacked([sampled(ground, grid) for ground in given]), {})
        if not (waves and records):
            return Ensemble(_stacked(_as_long(given)), {})
        # Wavelets get a record of zeros, and records a wavelet of zero amplitude.
        still = (
            Record(np.zeros(2), records[0].dt, time_unit=DIMENSIONLESS),
            Ricker(0.0, np.ravel(waves[0].periods)[:1], [0.0]),
        )
        left = [ground if isinstance(ground, Ricker) else still[1] for ground in given]
        right = [ground if isinstance(ground, Record) else still[0] for ground in given]
        pairs = zip(_as_long(left), _as_long(right), strict=True)
        return Ensemble(_stacked([one + other for one, other in pairs]), {})

    @staticmethod
    def drawn(
        scenarios: ScenarioSet,
        n: int,
        key: int | jax.Array = 0,
        *,
        sampling: str = "plain",
        start: int = 0,
    ) -> Ensemble:
        """The random scenarios, n of them, that ``monte_carlo`` draws with the same key.

        Parameters of their structures that are random belong to the ensemble; all others are those
        of the design.

        Parameters
        ----------
        scenarios, n, key, sampling
            See ``monte_carlo``.
        start
            Index of the first point: from n on, the scenarios are new ones.

        Raises
        ------
        ValueError
            If an argument breaks its rule, memory has no room for n, or a scenario is not finite.
        """
        owner = "Ensemble.drawn"
        instance(owner, "scenarios", scenarios, ScenarioSet)
        n = count(owner, "n", n)
        most = require_sampling(owner, sampling)
        key = as_key(
            *key_numbers(owner, key if isinstance(key, jax.Array) else seed(owner, "key", key))
        )
        start = count(owner, "start + 1", start + 1) - 1
        normal = jax.ShapeDtypeStruct((scenarios.dimension,), jnp.zeros(()).dtype)
        one = jax.eval_shape(scenarios.realize, normal)
        size = sum(x.size * x.dtype.itemsize for x in jax.tree.leaves(one))
        require_memory(owner, "n", n, n * (size + 8 * scenarios.dimension))
        if start + n > most:
            rule = f"at most {most:,} for {sampling} sampling"
            raise ValueError(f"{owner}: start + n = {start + n:,} must be {rule}")
        z = points(sampling, key, scenarios.dimension)(start, start + n)
        structures, grounds = jax.jit(jax.vmap(scenarios.realize))(z)
        drawn = drawn_parameters(scenarios)
        uncertain = {path: np.asarray(get(structures, path)) for path in drawn}
        grounds = jax.tree.map(np.asarray, grounds)
        for leaf in jax.tree.leaves((uncertain, grounds)):
            if not np.isfinite(leaf).all():
                bad = int(np.argmin(np.isfinite(leaf).reshape(n, -1).all(axis=1)))
                raise ValueError(f"{owner}: scenario {start + bad} must be finite")

        def more(m: int) -> Ensemble:
            return Ensemble.drawn(scenarios, m, key, sampling=sampling, start=start + n)

        return Ensemble(grounds, uncertain, scenarios, more)

    def fresh(self, n: int) -> Ensemble | None:
        """The next n scenarios after those of a drawn ensemble; None if it was not drawn."""
        return None if self._more is None else self._more(n)

    def including(self, grounds: Sequence[GroundLike], grid: TimeGrid) -> Ensemble:
        """The ensemble with given ground motions added (see ``of``); ``fresh`` draws as before.

        Raises
        ------
        ValueError
            As in ``of``; if structures are uncertain, since given ground motions have no values.
        """
        self._require_certain()
        both = Ensemble.of([*self, *grounds], grid)
        return dataclasses.replace(both, scenarios=self.scenarios, _more=self._more)

    def __add__(self, other: Ensemble) -> Ensemble:
        """Both ensembles together; neither may have uncertain structures."""
        instance("Ensemble", "other", other, Ensemble)
        self._require_certain()
        other._require_certain()
        kinds = {type(self.grounds), type(other.grounds)}
        if not kinds <= {Ricker, Record}:
            names = " and ".join(kind.__name__ for kind in kinds)
            raise ValueError(f"Ensemble: {names} cannot be added; use Ensemble.of for all")
        # The grid is not used: all are wavelets and records.
        return Ensemble.of([*self, *other], TimeGrid(1.0, 2))

    def _require_certain(self) -> None:
        for path in self.uncertain:
            raise ValueError(f"Ensemble: {path} is uncertain; such ensembles cannot be added")

    def __len__(self) -> int:
        return len(jax.tree.leaves(self.grounds)[0])

    def __iter__(self) -> Any:
        return (self.ground(i) for i in range(len(self)))

    def ground(self, i: int) -> Ground:
        """The ground motion with an index."""
        return jax.tree.map(lambda x: x[i], self.grounds)

    def __repr__(self) -> str:
        what = f", with uncertain {', '.join(self.uncertain)}" if self.uncertain else ""
        return f"Ensemble({len(self):,} earthquakes{what})"


def _stacked(grounds: Sequence[Any]) -> Any:
    return jax.tree.map(lambda *leaves: np.stack([np.asarray(x, float) for x in leaves]), *grounds)


def _as_long(grounds: Sequence[Any]) -> list[Any]:
    """Padded to the longest: with wavelets of zero amplitude, or with zero samples."""
    if isinstance(grounds[0], Record):
        most = max(ground.n_samples for ground in grounds)
        return [derived(_padded(g.samples, most), g.dt, "", g.time_unit) for g in grounds]
    most = max(np.size(ground.arrivals) for ground in grounds)
    return [
        Ricker(
            _padded(np.broadcast_to(ground.amplitude, np.size(ground.arrivals)), most),
            _padded(ground.periods, most, mode="edge"),
            _padded(ground.arrivals, most, mode="edge"),
        )
        for ground in grounds
    ]


def _padded(x: Any, n: int, **how: Any) -> np.ndarray:
    return np.pad(np.ravel(np.asarray(x, float)), (0, n - np.size(x)), **how)


def drawn_parameters(scenarios: ScenarioSet) -> list[str]:
    """Paths of the structures' parameters that depend on what is drawn.

    They are those that the program of ``realize`` computes from z, even where a parameter varies so
    rarely that all draws agree.
    """
    names: list[str] = []

    def parameters(z: Any) -> list[Any]:
        structures, _ = scenarios.realize(z)
        names[:] = paths(structures)
        return [get(structures, path) for path in names]

    program = jax.make_jaxpr(parameters)(jnp.zeros(scenarios.dimension)).jaxpr
    drawn = {*program.invars}
    for equation in program.eqns:
        if any(x in drawn for x in equation.invars if not isinstance(x, Literal)):
            drawn.update(equation.outvars)
    found = zip(names, program.outvars, strict=True)
    return [path for path, x in found if not isinstance(x, Literal) and x in drawn]
