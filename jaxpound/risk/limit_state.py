"""The limit state: which demand in which random scenarios must not reach which threshold."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxpound._checks import Rule, enforce, finite, instance, not_negative, number, real
from jaxpound.grid import TimeGrid
from jaxpound.model.parameters import get, paths, put, require_paths
from jaxpound.model.system import Structures, System
from jaxpound.results.demand import Demand
from jaxpound.risk.demanded import (
    OVERLAP,
    REQUIRED_GAP,
    demand_named,
    passing_through,
    require_threshold,
)
from jaxpound.risk.instants import Series, measured, series_of
from jaxpound.simulation.batches import in_chunks
from jaxpound.simulation.course import positions_at
from jaxpound.simulation.run import demand
from jaxpound.simulation.scheme import Scheme
from jaxpound.study.scenarios import ScenarioSet

OWNER = "LimitState"

_STRONGER = (3.0, 10.0)  # factors of z at which a demand that seems constant is looked at


@dataclasses.dataclass(frozen=True, eq=False)
class LimitState:
    """The event that a demand of random scenarios reaches a threshold.

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
        The event is demand ≥ threshold, in the demand's dimensionless unit. None, for the required
        gap only: the event is pounding, that any link closes its own gap at rest.
    changes
        Parameters of the structures by path, with the numbers that they have in the place of those
        of the scenarios.

    Raises
    ------
    ValueError
        If an argument is of another type or breaks its rule, a demand or path is unknown, or the
        required gap is asked for of structures without a link whose gap is finite.

    Notes
    -----
    Gaps do not depend on laws of contact: whether blocks meet is the same with and without one, and
    the required gap is that of blocks that may pass through each other. Runs for it leave these
    laws out.

    Examples
    --------
    >>> ground = jp.RandomRicker(2, jp.LogNormal(0.1, 0.5), jp.Uniform(1, 3.8), jp.Uniform(1, 7))
    >>> scenarios = jp.Scenarios(jp.paper.structures(), ground)
    >>> state = jp.LimitState(scenarios, jp.TimeGrid.until(20.0, dt=0.05), threshold=0.4)
    >>> z = np.zeros((1, scenarios.dimension))
    >>> bool(state.values(z)[0] < 0)  # the median earthquake needs less than a gap of 0.4
    True
    """

    scenarios: ScenarioSet
    grid: TimeGrid
    scheme: Scheme = Scheme()
    demand: str | Callable[[Demand], Array] = REQUIRED_GAP
    threshold: float | None = None
    changes: Mapping[str, float] = dataclasses.field(default_factory=dict)
    _programs: Any = dataclasses.field(default=None, repr=False)

    def __post_init__(self) -> None:
        instance(OWNER, "scenarios", self.scenarios, ScenarioSet)
        instance(OWNER, "grid", self.grid, TimeGrid)
        instance(OWNER, "scheme", self.scheme, Scheme)
        instance(OWNER, "changes", self.changes, Mapping)
        if self.threshold is None:
            if self.demand != REQUIRED_GAP:
                require_threshold(OWNER, self.demand)
        else:
            threshold = number(OWNER, "threshold", self.threshold)
            rule = Rule("threshold", threshold, finite(threshold), "finite")
            enforce(OWNER, [rule])
            object.__setattr__(self, "threshold", float(threshold))
        known = self._programs
        if known is None or not known.are_of(self):
            object.__setattr__(self, "_programs", _Programs(self))
        if self.changes:
            require_paths(f"{OWNER}: changes", self.programs.nominal, self.changes)

    @property
    def dimension(self) -> int:
        """Number d of standard normal numbers."""
        return self.scenarios.dimension

    @property
    def level(self) -> float:
        """The number that ``demanded`` must reach: the threshold, or 0 for pounding."""
        return 0.0 if self.threshold is None else self.threshold

    @property
    def programs(self) -> Any:
        """Compiled programs, the same for all thresholds and values of ``changes``."""
        return self._programs

    def value(self, z: Float[Array, " d"]) -> Float[Array, ""]:
        """The demand less the threshold, traceable: the event is value ≥ 0."""
        return self.observed(z, self.changes)[0] - self.level

    def values(self, z: np.ndarray) -> np.ndarray:
        """``value`` of points, shape (n, d), in chunks of one size: one program runs them all.

        Raises
        ------
        ValueError
            If there is no point, or it has another number of coordinates.
        """
        return self.values_and_times(z)[0]

    def values_and_times(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """``values``, and the times of the smallest gap; NaN for other demands, shape (n,) each."""
        if np.ndim(z) != 2 or not len(z) or np.shape(z)[1] != self.dimension:
            rule = f"must be of shape (n, {self.dimension}), n at least 1"
            raise ValueError(f"{OWNER}.values: z of shape {np.shape(z)} {rule}")
        demanded, times = self.programs.observed(z, self.changes)
        return demanded - self.level, times

    def gradients(
        self, z: np.ndarray, instants: np.ndarray, series: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Values at one instant each, and their gradients by z.

        Parameters
        ----------
        z
            Points, shape (n, d).
        instants, series
            For each the number of the instant, and of the series in ``series``. If there are no
            series they are not used, and the value is that of the whole run.
        """
        found, slope = self.programs.gradients(z, self.changes, instants, series)
        return found - self.level, slope

    def sensitivities(self, z: np.ndarray) -> dict[str, np.ndarray]:
        """Derivatives of ``values`` by all parameters of the structures, by path, shape (n,)."""
        return self.programs.sensitivities(z, self.changes)

    @property
    def series(self) -> tuple[Series, ...]:
        """The series whose largest number over the run is the demand; none for other demands."""
        return self.programs.series

    def realized(self, z: Any, changes: Mapping[str, Any]) -> tuple[Structures, Any]:
        """The scenario of a point z, with the changes made in its structures."""
        structures, ground = self.scenarios.realize(z)
        return put(structures, changes) if changes else structures, ground

    def observed(self, z: Any, changes: Mapping[str, Any]) -> tuple[Any, Any]:
        """Demand (of pounding minus the smallest gap) and its time of a point z, traceable."""
        structures, ground = self._moved(z, changes)
        found = demand(structures, ground, self.grid, self.scheme)
        demanded = self._demanded(structures.system(), found)
        gaps = self.demand == REQUIRED_GAP
        return demanded, found.min_gap_time if gaps else jnp.nan * demanded

    def at_instant(self, z: Any, changes: Mapping[str, Any], instant: Any, row: Any) -> Any:
        """The value of a series at an instant, traceable; see ``instants``."""
        structures, ground = self._moved(z, changes)
        found = positions_at(structures, ground, self.grid, self.scheme, instant)
        return measured(row, found, structures.system())

    def _moved(self, z: Any, changes: Mapping[str, Any]) -> tuple[Structures, Any]:
        """The scenario that is run: of gaps without laws of contact."""
        structures, ground = self.realized(z, changes)
        if self.demand == REQUIRED_GAP:
            structures = passing_through(structures)
        return structures, ground

    def _demanded(self, system: System, found: Demand) -> Any:
        if callable(self.demand):
            known = jnp.asarray(real(OWNER, "demand", self.demand(found)))
            return known.astype(jnp.result_type(float, known))
        pounding = self.demand == REQUIRED_GAP and self.threshold is None
        return demand_named(OWNER, system, found, OVERLAP if pounding else self.demand)


def threshold_of(owner: str, gap: Any, demand: Any, threshold: Any) -> float | None:
    """The threshold, which for gaps is the gap; a ``ValueError`` where both are given."""
    if gap is None:
        return threshold
    if demand != REQUIRED_GAP or threshold is not None:
        raise ValueError(f"{owner}: gap = {gap!r} must be None where another demand is given")
    (gap,) = not_negative(owner, gap=number(owner, "gap", gap))
    return float(gap)


def require_dependence(owner: str, state: LimitState, z: Any, values: Any) -> None:
    """A ``ValueError`` for a demand that is the same in all runs, however strong the motion.

    Parameters
    ----------
    owner
        Begins the message.
    state
        The limit state.
    z, values
        Random points, shape (n, d), and their values.
    """
    if not np.isfinite(values).any():
        raise ValueError(f"{owner}: demand must be a number, but is none in {len(z):,} random runs")
    if np.ptp(values[np.isfinite(values)]) > 0:
        return
    if not np.ptp([values, *(state.values(factor * z) for factor in _STRONGER)]) > 0:
        runs = len(z) * (1 + len(_STRONGER))
        raise ValueError(
            f"{owner}: demand must depend on the random numbers of the scenarios, but is "
            f"{values[0] + state.level:.6g} in {runs:,} random runs"
        )


class _Programs:
    """Compiled programs of a limit state, for batches of points of any size."""

    def __init__(self, state: LimitState) -> None:
        self._of = state
        here = jnp.zeros(state.dimension)
        self.nominal, _ = state.scenarios.realize(here)
        shape, _ = jax.eval_shape(lambda z: state.observed(z, {}), here)
        if shape.shape:
            raise ValueError(f"{OWNER}: demand of shape {shape.shape} must be one number")
        cores = len(jax.local_devices())
        self._chunk = cores * _RUNS
        self._observed = in_chunks(state.observed, self._chunk)
        self.series = series_of(self.nominal.system(), state.demand, state.threshold is None)
        self._rows = np.array([one.row for one in self.series])
        self._size = cores * _GRADIENTS

        def whole(z: Any, changes: Any) -> Any:
            return state.observed(z, changes)[0]

        one = state.at_instant if self.series else whole
        self._gradients = in_chunks(jax.value_and_grad(one), self._size)

        def by_parameters(z: Any, changes: Any) -> Any:
            structures, _ = state.realized(z, changes)
            # As arrays of the run's kind: a parameter may be a number or differ in its precision.
            known = {
                path: jnp.asarray(get(structures, path), z.dtype) for path in paths(structures)
            }
            return jax.grad(lambda known: whole(z, known))(known)

        self._sensitivities = in_chunks(by_parameters, self._size)

    def are_of(self, state: LimitState) -> bool:
        """Whether they serve another limit state."""
        mine = self._of
        same = (mine.grid, mine.scheme, mine.demand) == (state.grid, state.scheme, state.demand)
        # Of the threshold only whether there is one.
        alike = (mine.threshold is None) == (state.threshold is None)
        return mine.scenarios is state.scenarios and same and alike

    def observed(self, z: Any, changes: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
        """``LimitState.observed`` of points z, shape (n, d)."""
        return _filled_up(self._observed, self._chunk, z, changes)

    def gradients(self, z: Any, changes: Any, instants: Any, series: Any) -> Any:
        """Values of series at instants, and gradients, of points z, shape (n, d)."""
        more = (instants, self._rows[series]) if self.series else ()
        return _filled_up(self._gradients, self._size, z, changes, *more)

    def sensitivities(self, z: Any, changes: Any) -> dict[str, np.ndarray]:
        """Derivatives of the demand by all parameters, by path, of points z, shape (n, d)."""
        return _filled_up(self._sensitivities, self._size, z, changes)


def _filled_up(run: Any, chunk: int, z: Any, changes: Mapping[str, float], *more: Any) -> Any:
    """The results of ``run``, made by ``in_chunks``, on whole chunks: it is compiled only once."""
    n = len(z)
    rows = np.minimum(np.arange(-(-n // chunk) * chunk), n - 1)
    batch = {path: np.full(len(rows), float(x)) for path, x in changes.items()}
    found = run(np.asarray(z)[rows], batch, *(np.asarray(x)[rows] for x in more))
    return jax.tree.map(lambda x: x[:n], found)


# Runs, and runs with a gradient, at a time on a core: few enough for points of many numbers to stay
# in its cache, and for a search whose last points take long to waste little.
_RUNS = 128
_GRADIENTS = 32
