"""The earthquakes of a design problem, the same for all designs of a search."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import Literal

from jaxpound._checks import count, instance, require_memory
from jaxpound._errors import InvalidInput
from jaxpound.grid import TimeGrid
from jaxpound.ground.motion import Ground, GroundLike, Sum, as_motion, records_in, require_ground
from jaxpound.ground.plausibility import first_of
from jaxpound.ground.record import Record, derived
from jaxpound.ground.run_input import all_in_g, all_sampled, sampled
from jaxpound.ground.supports import by_each_support
from jaxpound.ground.wavelets import Ricker
from jaxpound.model.parameters import get, paths
from jaxpound.scenarios.sampling import as_key, key_numbers, points, require_sampling
from jaxpound.scenarios.scenarios import ScenarioSet


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
    >>> earthquakes.including([jp.paper.ground()], jp.paper.grid())
    Ensemble(9 earthquakes)
    """

    grounds: Ground
    """The ground motions; every array has a leading axis of n."""
    uncertain: Mapping[str, np.ndarray]
    """Parameters of the structures that differ from earthquake to earthquake, by path, (n,)."""
    time_unit: str | None = None
    """Unit of time of the records among them; None if there is none."""
    scenarios: ScenarioSet | None = None
    """The random scenarios that it was drawn from; None if it was not."""
    _more: Callable[[int], Ensemble] | None = None

    @staticmethod
    def of(grounds: Sequence[GroundLike], grid: TimeGrid) -> Ensemble:
        """Ground motions, all equally likely, in one unit of time.

        If some are neither ``Ricker`` nor ``Record`` (sums, multiples, functions of t), all are
        sampled at the instants of the grid.
        """
        motions = list(grounds) if isinstance(grounds, Sequence) else []
        if not motions:
            raise InvalidInput("grounds", repr(grounds), "must hold ground motions")
        for i, ground in enumerate(motions):
            require_ground(f"grounds[{i}]", ground)
        units = {str(part.time_unit) for ground in motions for part in records_in(ground)}
        if len(units) > 1:
            rule = f"must be in one unit of time, but are in {' and '.join(sorted(units))}"
            raise InvalidInput("grounds", "", rule)
        unit = min(units, default=None)
        waves = [ground for ground in motions if isinstance(ground, Ricker)]
        records = [ground for ground in motions if isinstance(ground, Record)]
        if len(waves) + len(records) < len(motions):
            each = [_sampled(ground, grid, unit) for ground in motions]
            return Ensemble(_stacked(each), {}, unit)
        if not (waves and records):
            return Ensemble(_stacked(_as_long(motions)), {}, unit)
        # Wavelets get a record of zeros, and records a wavelet of zero amplitude.
        no_record = Record(np.zeros(2), records[0].dt, time_unit=records[0].time_unit)
        no_wave = Ricker(0.0, np.ravel(waves[0].periods)[:1], [0.0])
        left = [ground if isinstance(ground, Ricker) else no_wave for ground in motions]
        right = [ground if isinstance(ground, Record) else no_record for ground in motions]
        pairs = zip(_as_long(left), _as_long(right), strict=True)
        return Ensemble(_stacked([wavelet + record for wavelet, record in pairs]), {}, unit)

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

        Random parameters of their structures belong to the ensemble, all others to the design.
        ``start`` is the index of the first point: from n on, the scenarios are new ones. A
        ``ValueError`` if memory has no room for n, or a scenario is not finite.
        """
        instance("scenarios", scenarios, ScenarioSet)
        n = count("n", n)
        most = require_sampling(sampling)
        key = as_key(*key_numbers(key))
        start = count("start + 1", start + 1) - 1
        scenario = jax.eval_shape(scenarios.realize, jnp.zeros(scenarios.dimension))
        size = sum(x.size * x.dtype.itemsize for x in jax.tree.leaves(scenario))
        require_memory("n", n, n * (size + 8 * scenarios.dimension))
        if start + n > most:
            rule = f"must be at most {most:,} for {sampling} sampling"
            raise InvalidInput("start + n", f"{start + n:,}", rule)
        z = points(sampling, key, scenarios.dimension)(start, start + n)
        structures, grounds = jax.jit(jax.vmap(scenarios.realize))(z)
        uncertain = {x: np.asarray(get(structures, x)) for x in drawn_parameters(scenarios)}
        grounds = jax.tree.map(np.asarray, grounds)
        for leaf in jax.tree.leaves((uncertain, grounds)):
            if not np.isfinite(leaf).all():
                first_invalid = int(np.argmin(np.isfinite(leaf).reshape(n, -1).all(axis=1)))
                raise InvalidInput(f"scenario {start + first_invalid}", "", "must be finite")
        more = partial(Ensemble.drawn, scenarios, key=key, sampling=sampling, start=start + n)
        units = [str(part.time_unit) for part in records_in(scenario[1])]
        return Ensemble(grounds, uncertain, min(units, default=None), scenarios, more)

    def fresh(self, n: int) -> Ensemble | None:
        """The next n scenarios after those of a drawn ensemble; None if it was not drawn."""
        return None if self._more is None else self._more(n)

    def including(self, grounds: Sequence[GroundLike], grid: TimeGrid) -> Ensemble:
        """The ensemble with ground motions added (see ``of``); ``fresh`` draws as before.

        Its structures must be certain, since these ground motions have no values of parameters.
        """
        for path in self.uncertain:
            raise InvalidInput(path, "", "is uncertain; these have no value of it")
        both = Ensemble.of([*self, *grounds], grid)
        return dataclasses.replace(both, scenarios=self.scenarios, _more=self._more)

    def __len__(self) -> int:
        return len(jax.tree.leaves(self.grounds)[0])

    def __iter__(self) -> Any:
        return (self.ground(i) for i in range(len(self)))

    def ground(self, i: int) -> Ground:
        """The ground motion with an index."""
        return jax.tree.map(lambda x: x[i], self.grounds)

    def first_in_g(self, grid: TimeGrid, gravity: Any) -> Ground:
        """As many of the first ground motions as are judged before a run, in g."""
        n = first_of(len(self), grid)
        return all_in_g(jax.tree.map(lambda x: x[:n], self.grounds), gravity)

    def __repr__(self) -> str:
        uncertain = f", with uncertain {', '.join(self.uncertain)}" if self.uncertain else ""
        return f"Ensemble({len(self):,} earthquakes{uncertain})"


def _sampled(ground: GroundLike, grid: TimeGrid, unit: str | None) -> Any:
    """A ground motion at the instants of a grid; beside records what is in g is apart from them."""
    if unit is None:
        return all_sampled(ground, grid)

    def apart(own: GroundLike) -> Sum:
        # In m/s² under a gravity of 0 and of 1 it is without records, and with these in g.
        rest, whole = (sampled(as_motion(own).in_si(g), grid) for g in (0.0, 1.0))
        samples = whole.samples - rest.samples
        return Sum((dataclasses.replace(whole, samples=samples, time_unit=unit), rest))

    return by_each_support(ground, apart)


def _stacked(grounds: Sequence[Any]) -> Any:
    return jax.tree.map(lambda *leaves: np.stack([np.asarray(x, float) for x in leaves]), *grounds)


def _as_long(grounds: Sequence[Any]) -> list[Any]:
    """Padded to the longest: with wavelets of zero amplitude, or with zero samples."""
    if isinstance(grounds[0], Record):
        most = max(ground.n_samples for ground in grounds)
        return [derived(_padded(g.samples, most), g.dt, "", g.time_unit) for g in grounds]
    most, waves = max(np.size(ground.arrivals) for ground in grounds), []
    for ground in grounds:
        amplitude = np.broadcast_to(ground.amplitude, np.size(ground.arrivals))
        times = (_padded(x, most, mode="edge") for x in (ground.periods, ground.arrivals))
        waves.append(Ricker(_padded(amplitude, most), *times))
    return waves


def _padded(x: Any, n: int, **options: Any) -> np.ndarray:
    return np.pad(np.ravel(np.asarray(x, float)), (0, n - np.size(x)), **options)


def drawn_parameters(scenarios: ScenarioSet) -> list[str]:
    """Paths of the structures' parameters that the program of ``realize`` computes from z.

    Even where a parameter varies so rarely that all draws agree.
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
    outputs = zip(names, program.outvars, strict=True)
    return [path for path, x in outputs if not isinstance(x, Literal) and x in drawn]
