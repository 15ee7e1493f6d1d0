"""A limit state: demand ≥ threshold, as a function of standard normal numbers; and its runs."""

from __future__ import annotations

import dataclasses
import reprlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, cached_property
from os import PathLike
from typing import Any
from weakref import WeakValueDictionary

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxpound._checks import not_negative, number
from jaxpound._errors import InvalidInput, renamed, warn
from jaxpound._fields import check, parameter, part
from jaxpound._xla.batches import in_chunks
from jaxpound.buildings import Buildings
from jaxpound.grid import TimeGrid
from jaxpound.model.parameters import get, paths, replaced, require_paths
from jaxpound.model.system import Structures, without_contact
from jaxpound.reliability.instants import Series, is_by_impacts, measured, observed_at, series_of
from jaxpound.results import named
from jaxpound.results.named import REQUIRED_GAP, DemandSpec
from jaxpound.scenarios.sampling import key_numbers
from jaxpound.scenarios.scenarios import ScenarioSet, discrete_names
from jaxpound.simulation.run import demand
from jaxpound.simulation.scheme import Scheme, single_system
from jaxpound.store.store import RunLog, identity, program_digest
from jaxpound.study.demands import doubts

COMPILING = "compiling the runs"  # what a progress bar says before the first run
_STRONGER = (3.0, 10.0)  # factors of z for the runs that check a seemingly constant demand

# Runs, and runs with a gradient, at a time on a core: few enough for points of many numbers to stay
# in its cache, and for a search whose last points take long to waste little.
_RUNS = 128
_GRADIENTS = 32

BatchId = tuple[int, int]  # of subset simulation the numbers of a repeat and of one of its queries


@dataclasses.dataclass(frozen=True, eq=False)
class LimitState:
    """The event that a demand of random scenarios reaches a threshold.

    Whether blocks meet does not depend on laws of contact, and the required gap is that of blocks
    that may pass through each other: runs for it leave these laws out. Raises ``ValueError`` if a
    demand or path is unknown, or the demand is the required gap of structures without a link whose
    gap is finite.

    Parameters
    ----------
    scenarios
        Structures and ground motion as functions of a standard normal point z, shape (d,).
    grid, scheme
        See ``simulate``.
    demand
        The flat name of a scalar of ``Demand`` (``"peak_contact"``, ``"peak_drift_2"``), of one
        over all storeys (``"peak_drift"``), ``"required_gap"``, the largest closing of any link, or
        a function of a run's ``Demand`` that JAX can trace, which gives one number.
    threshold
        The event is demand ≥ threshold, in the demand's unit (SI for ``Buildings``). None, for the
        required gap only: the event is pounding, that any link closes its own gap at rest.
    changes
        Values of parameters of the structures, by path, which replace those of the scenarios.

    Notes
    -----
    Limit states of the same scenarios (the same object), grid, scheme and demand share their
    compiled programs, as those of ``dataclasses.replace(state, threshold=0.3)`` do.

    Examples
    --------
    >>> ground = jp.RandomRicker(2, jp.LogNormal(0.1, 0.5), jp.Uniform(1, 3.8), jp.Uniform(1, 7))
    >>> scenarios = jp.Scenarios(jp.paper.structures(), ground)
    >>> state = jp.LimitState(scenarios, jp.TimeGrid.until(20.0, dt=0.05), threshold=0.4)
    >>> z = np.zeros((1, scenarios.dimension))
    >>> bool(state.values(z)[0] < 0)  # the median earthquake needs less than a gap of 0.4
    True
    """

    scenarios: ScenarioSet = part(ScenarioSet)
    grid: TimeGrid = part(TimeGrid)
    scheme: Scheme = part(Scheme, default=Scheme())
    demand: DemandSpec = REQUIRED_GAP
    threshold: float | None = parameter(single=True, default=None)
    changes: Mapping[str, float] = part(Mapping, default_factory=dict)

    def __post_init__(self) -> None:
        check(self)
        if self.threshold is not None:
            object.__setattr__(self, "threshold", float(self.threshold))
        elif self.demand != REQUIRED_GAP:
            named.require_threshold(self.demand)
        nominal = self.nominal
        with renamed("changes"):
            require_paths(nominal, self.changes)

    def __reduce__(self) -> tuple[Any, ...]:  # without compiled programs, which are made anew
        return LimitState, tuple(getattr(self, x.name) for x in dataclasses.fields(self))

    @cached_property
    def _programs(self) -> LimitStatePrograms:
        """Compiled programs, which limit states share that differ in numbers alone."""
        demand = self.demand if isinstance(self.demand, str) else id(self.demand)
        # Without a threshold that of the overlap. Programs keep alive what is known by identity.
        key = id(self.scenarios), self.grid, self.scheme, demand, self.threshold is None
        if (programs := _PROGRAMS.get(key)) is None:
            programs = _PROGRAMS[key] = LimitStatePrograms(self)
        return programs

    @property
    def nominal(self) -> Structures:
        """The structures at z = 0, with the medians of random parameters, without changes."""
        return self._programs.nominal

    @property
    def dimension(self) -> int:
        """Number d of standard normal numbers."""
        return self.scenarios.dimension

    @property
    def discrete_names(self) -> str:
        """Names of the first four discrete numbers, joined by commas; empty if there are none."""
        return discrete_names(self.scenarios)

    @property
    def time_step(self) -> float:
        """The time step in 1/ω1, whichever unit of time the grid has."""
        nominal = self.nominal
        unit = float(nominal.scales.frequency) if isinstance(nominal, Buildings) else 1
        return self.grid.dt * unit

    @property
    def level(self) -> float:
        """The number that ``demanded`` must reach: the threshold, or 0 for pounding."""
        return 0.0 if self.threshold is None else self.threshold

    def value(self, z: Float[Array, " d"]) -> Float[Array, ""]:
        """The demand less the threshold, traceable: the event is value ≥ 0."""
        return self.observed(z, self.changes)[0] - self.level

    def values(self, z: np.ndarray) -> np.ndarray:
        """``value`` of points, shape (n, d), in chunks of one size: one program runs them all.

        Raises ``ValueError`` if there is no point, or it has another number of coordinates.
        """
        return self.values_and_times(z)[0]

    def values_and_times(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """``values``, and the times of the smallest gap; NaN for other demands, shape (n,) each."""
        if np.ndim(z) != 2 or not len(z) or np.shape(z)[1] != self.dimension:
            rule = f"of shape {np.shape(z)} must be of shape (n, {self.dimension}), n at least 1"
            raise InvalidInput("z", "", rule)
        demanded, times = self._programs.observed(z, self.changes)
        return demanded - self.level, times

    def gradients(
        self, z: np.ndarray, instants: np.ndarray, series: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Values at one instant each of points z, shape (n, d), and their gradients by z.

        ``instants`` and ``series`` are each point's numbers of its instant and, in
        ``LimitState.series``, of its series. Without series the values are those of the whole run.
        """
        more = (instants, np.array([x.row for x in self.series])[series]) if self.series else ()
        demanded, slope = self._programs.gradients(z, self.changes, *more)
        return demanded - self.level, slope

    def sensitivities(
        self, z: np.ndarray, chosen: Sequence[str] | None = None
    ) -> dict[str, np.ndarray]:
        """Derivatives of ``values`` by chosen or all parameters, by path, shape (n,) each."""
        names = tuple(paths(self.nominal) if chosen is None else chosen)
        require_paths(self.nominal, names)
        return self._programs.sensitivities(names)(z, self.changes)

    @property
    def series(self) -> tuple[Series, ...]:
        """The series whose largest number over the run is the demand; none for other demands."""
        return self._programs.series

    @property
    def searches_overlaps(self) -> bool:
        """Whether ``series`` are overlaps of blocks that pass through each other.

        They are for a demand that impacts make, which has no slope before blocks meet.
        """
        return self._programs.searches_overlaps

    def realized(
        self, z: Any, changes: Mapping[str, Any], *, passing: bool = False
    ) -> tuple[Structures, Any]:
        """The scenario of a point z, with changes; ``passing`` leaves out laws of contact."""
        structures, ground = self.scenarios.realize(z)
        structures = replaced(structures, changes) if changes else structures
        return without_contact(structures) if passing else structures, ground

    def observed(self, z: Any, changes: Mapping[str, Any]) -> tuple[Any, Any]:
        """Demand (of pounding minus the smallest gap) and its time of a point z, traceable."""
        gaps = self.demand == REQUIRED_GAP
        structures, ground = self.realized(z, changes, passing=gaps)
        scalars = demand(structures, ground, self.grid, self.scheme)
        spec = named.OVERLAP if gaps and self.threshold is None else self.demand
        demanded = named.value_of(structures.system(), scalars, spec)
        return demanded, scalars.min_gap_time if gaps else jnp.nan * demanded

    def at_instant(self, z: Any, changes: Mapping[str, Any], instant: Any, row: Any) -> Any:
        """The value of a series at an instant, traceable; see ``instants``."""
        passing = self.searches_overlaps or self.demand == REQUIRED_GAP
        structures, ground = self.realized(z, changes, passing=passing)
        kind = self.series[0].kind
        observed = observed_at(kind, structures, ground, self.grid, self.scheme, instant)
        return measured(kind, row, observed, structures.system())


def state_of(
    scenarios: ScenarioSet | LimitState,
    grid: Any,
    gap: Any,
    demand: DemandSpec = REQUIRED_GAP,
    threshold: float | None = None,
) -> LimitState:
    """The limit state of a search; a gap stands for its threshold."""
    if isinstance(scenarios, LimitState):
        others = {"grid": grid, "gap": gap, "threshold": threshold}
        others |= {"demand": demand} if demand != REQUIRED_GAP else {}
        for name, value in others.items():
            if value is not None:
                rule = "must be left out beside a LimitState, which has its own"
                raise InvalidInput(name, reprlib.repr(value), rule)
        state, findings = scenarios, doubts(scenarios.scenarios, scenarios.grid)
    else:
        if gap is not None and (demand != REQUIRED_GAP or threshold is not None):
            raise InvalidInput("gap", repr(gap), "must be None where another demand is given")
        if gap is not None:
            (threshold,) = not_negative(gap=number("gap", gap))
        findings = doubts(scenarios, grid)
        with renamed():
            state = LimitState(scenarios, grid, demand=demand, threshold=threshold)
    if state.demand != REQUIRED_GAP:  # whose runs leave laws of contact out
        warn(findings, strict=False)
    return state


def require_dependence(state: LimitState, z: Any, values: Any) -> None:
    """An ``InvalidInput`` if a demand is the same at points z, and under stronger motions, too."""
    if not np.isfinite(values).any():
        raise InvalidInput("demand", "", f"must be a number, but is none in {len(z):,} random runs")
    if np.ptp(values[np.isfinite(values)]) > 0:
        return
    if not np.ptp([values, *(state.values(factor * z) for factor in _STRONGER)]) > 0:
        constant = f"{values[0] + state.level:.6g} in {len(z) * (1 + len(_STRONGER)):,} random runs"
        rule = f"must depend on the random numbers of the scenarios, but is {constant}"
        raise InvalidInput("demand", "", rule)


class LimitStatePrograms:
    """Compiled programs of a limit state, for batches of points of any size, shape (n, d)."""

    def __init__(self, state: LimitState) -> None:
        origin = jnp.zeros(state.dimension)
        self.nominal, _ = state.scenarios.realize(origin)
        single_system(self.nominal)
        shape, _ = jax.eval_shape(lambda z: state.observed(z, {}), origin)
        if shape.shape:
            raise InvalidInput("demand", "", f"of shape {shape.shape} must be one number")
        system = self.nominal.system()
        self.series = series_of(system, state.demand, state.threshold is None)
        self.searches_overlaps = bool(self.series) and is_by_impacts(system, state.demand)

        def whole(z: Any, changes: Any) -> Any:
            return state.observed(z, changes)[0]

        @cache  # by few parameters they compile sooner than by all
        def sensitivities(chosen: tuple[str, ...]) -> Callable[..., Any]:
            def by_parameters(z: Any, changes: Any) -> Any:
                structures, _ = state.realized(z, changes)
                # As arrays of the run's kind: a number may be a float, or differ in its precision.
                numbers = {x: jnp.asarray(get(structures, x), z.dtype) for x in chosen}
                return jax.grad(lambda numbers: whole(z, {**changes, **numbers}))(numbers)

            return _in_batches(by_parameters, _GRADIENTS)

        value = state.at_instant if self.series else whole
        self.observed = _in_batches(state.observed, _RUNS)
        self.gradients = _in_batches(jax.value_and_grad(value), _GRADIENTS)
        self.sensitivities = sensitivities
        self.digest = cache(  # whatever the values of changes, which a search has in its identity
            lambda *names: program_digest(state.observed, origin, dict.fromkeys(names, 0.0))
        )


_PROGRAMS: WeakValueDictionary[tuple[Any, ...], LimitStatePrograms] = WeakValueDictionary()
"""Programs of the limit states that are in use, by what the programs depend on."""


def _in_batches(function: Callable[..., Any], per_core: int) -> Callable[..., Any]:
    """``function`` of points, changes and more, in whole chunks, so that it is compiled once."""
    chunk = len(jax.local_devices()) * per_core
    run = in_chunks(function, chunk)

    def batched(z: Any, changes: Mapping[str, float], *more: Any) -> Any:
        n = len(z)
        rows = np.minimum(np.arange(-(-n // chunk) * chunk), n - 1)
        batch = {path: np.full(len(rows), float(x)) for path, x in changes.items()}
        results = run(np.asarray(z)[rows], batch, *(np.asarray(x)[rows] for x in more))
        return jax.tree.map(lambda x: x[:n], results)

    return batched


class SearchRuns:
    """Results of batches of runs; those in the folder, if there is one, are not run again.

    Points follow from the key and earlier results: the folder has only results. The first two of
    its ``columns`` identify the batch of a run, the others are its results; ``described`` is all
    else that determines the runs.
    """

    def __init__(
        self,
        folder: str | PathLike[str] | None,
        search: str,
        state: LimitState,
        key: Any,
        columns: tuple[str, ...],
        chunk_size: int,
        **described: Any,
    ) -> None:
        self.identity: dict[str, Any] = {}  # all that determines the runs; empty without a folder
        self._columns, self._log = columns, None
        self._finished: dict[BatchId, np.ndarray] = {}
        if folder is None:
            return
        kind, numbers = key_numbers(key)
        described["key"] = {"kind": kind, "numbers": list(numbers)}
        names = ("demand", "threshold", "changes", "scenarios", "grid", "scheme")
        described |= {name: getattr(state, name) for name in names}
        program = state._programs.digest(*state.changes)
        self.identity = identity(search, columns, chunk_size, program, **described)
        self._log = RunLog(folder, self.identity)
        first, second, *results = (self._log.rows[name] for name in columns)
        order = np.lexsort((second, first))  # stable
        pairs = np.column_stack([first, second])[order].astype(int)
        batches, starts = np.unique(pairs, axis=0, return_index=True)
        parts = np.split(np.stack(results)[:, order], starts[1:], axis=1)
        self._finished = {(i, j): x for (i, j), x in zip(batches.tolist(), parts, strict=False)}

    def results(
        self,
        batches: Mapping[BatchId, np.ndarray],
        run: Callable[[np.ndarray], Sequence[np.ndarray]],
    ) -> dict[BatchId, np.ndarray]:
        """Results, shape (m, n), of batches of points; missing ones are run and stored together."""
        if missing := {name: z for name, z in batches.items() if name not in self._finished}:
            results = np.stack(run(np.concatenate([*missing.values()])))
            sizes = [len(z) for z in missing.values()]
            if self._log is not None:
                rows = (*np.repeat([*missing], sizes, axis=0).T, *results)
                self._log.add(dict(zip(self._columns, rows, strict=True)))
            parts = np.split(results, np.cumsum(sizes)[:-1], axis=1)
            self._finished.update(zip(missing, parts, strict=True))
        # Processes that filled a store at once may have stored a batch twice in succession.
        return {name: self._finished.pop(name)[:, : len(z)] for name, z in batches.items()}


class SubsetRuns:
    """Values of a limit state for ``run_in_lockstep``, counted."""

    def __init__(self, state: LimitState, bar: Any, runs: SearchRuns, part: int) -> None:
        self.count = 0  # runs, including those from the folder
        self.failed = 0  # runs without a result
        self._state, self._bar, self._runs, self._part = state, bar, runs, part

    def __call__(self, queries: Mapping[BatchId, np.ndarray]) -> dict[BatchId, np.ndarray]:
        """Values of points by query; −∞ of runs that fail."""
        answers = {}
        for batches in self._parts(queries):
            results = self._runs.results(batches, lambda z: [self._state.values(z)])
            for name, (values,) in results.items():
                answers[name] = np.where(np.isnan(values), -np.inf, values).astype(float)
                self.failed += int(np.isnan(values).sum())
            size = sum(map(len, batches.values()))
            self.count += size
            self._bar.update(size)
        return answers

    def _parts(self, queries: Mapping[BatchId, np.ndarray]) -> Iterator[dict[BatchId, np.ndarray]]:
        """Queries that are run and written together: the same ones, and rounding, after a stop."""
        batches: dict[BatchId, np.ndarray] = {}
        for name, points in queries.items():
            if batches and sum(map(len, batches.values())) + len(points) > self._part:
                yield batches
                batches = {}
            batches[name] = points
        yield batches
