"""The limit state: which demand in which random scenarios must not reach which threshold."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from functools import reduce
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxpound._checks import Rule, enforce, finite, hint, instance, number
from jaxpound._extrema import larger
from jaxpound.grid import TimeGrid
from jaxpound.model.parameters import put, require_paths
from jaxpound.model.system import Structures, is_closable
from jaxpound.results.demand import Demand
from jaxpound.simulation.batches import in_chunks, runs_at_a_time
from jaxpound.simulation.run import demand
from jaxpound.simulation.scheme import Scheme
from jaxpound.study.demands import over_all
from jaxpound.study.scenarios import ScenarioSet

OWNER = "LimitState"

REQUIRED_GAP = "required_gap"


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
        a function of a run's ``Demand`` that JAX can trace.
    threshold
        The event is demand ≥ threshold, in the demand's dimensionless unit. None, for the required
        gap only: the event is pounding, that any link closes its own gap at rest.
    changes
        Parameters of the structures by path, with the numbers that they have in the place of those
        that the scenarios draw.

    Raises
    ------
    ValueError
        If an argument is of another type or breaks its rule, a demand or path is unknown, or the
        required gap is asked for and its link has a law of contact or no gap.

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
    _programs: _Programs | None = dataclasses.field(default=None, repr=False)

    def __post_init__(self) -> None:
        instance(OWNER, "scenarios", self.scenarios, ScenarioSet)
        instance(OWNER, "grid", self.grid, TimeGrid)
        instance(OWNER, "scheme", self.scheme, Scheme)
        instance(OWNER, "changes", self.changes, Mapping)
        if self.threshold is None:
            if self.demand != REQUIRED_GAP:
                raise ValueError(f"{OWNER}: threshold = None must be a number: demand is not a gap")
        else:
            threshold = number(OWNER, "threshold", self.threshold)
            rule = Rule("threshold", threshold, finite(threshold), "finite")
            enforce(OWNER, [rule])
            object.__setattr__(self, "threshold", float(threshold))
        known = self._programs
        if known is None or not known.are_of(self):
            object.__setattr__(self, "_programs", _Programs(self))
        nominal, _ = jax.eval_shape(self.scenarios.realize, jnp.zeros(self.dimension))
        require_paths(f"{OWNER}: changes", nominal, self.changes)
        jax.eval_shape(self.value, jnp.zeros(self.dimension))

    @property
    def dimension(self) -> int:
        """Number d of standard normal numbers."""
        return self.scenarios.dimension

    @property
    def level(self) -> float:
        """The number that ``demanded`` must reach: the threshold, or 0 for pounding."""
        return 0.0 if self.threshold is None else self.threshold

    @property
    def programs(self) -> _Programs:
        """Compiled programs, the same for all thresholds and values of ``changes``."""
        assert self._programs is not None
        return self._programs

    def value(self, z: Float[Array, " d"]) -> Float[Array, ""]:
        """The demand less the threshold, traceable: the event is value ≥ 0."""
        return self.demanded(z, self.changes) - self.level

    def values(self, z: Float[np.ndarray, "n d"]) -> Float[np.ndarray, " n"]:
        """``value`` of many points, in chunks of one size, so that one program runs them all."""
        return self.programs.demanded(z, self.changes) - self.level

    def realized(self, z: Any, changes: Mapping[str, Any]) -> tuple[Structures, Any]:
        """The scenario of a point z, with the changes made in its structures."""
        structures, ground = self.scenarios.realize(z)
        return put(structures, changes) if changes else structures, ground

    def demanded(self, z: Any, changes: Mapping[str, Any]) -> Any:
        """The demand of a point z, traceable; of pounding minus the smallest gap."""
        structures, ground = self.realized(z, changes)
        found = demand(structures, ground, self.grid, self.scheme)
        if callable(self.demand):
            return jnp.asarray(self.demand(found))
        system = structures.system()
        if self.demand == REQUIRED_GAP:
            closable = [k for k, link in enumerate(system.links) if is_closable(link.gap)]
            if not closable:
                raise ValueError(f"{OWNER}: structures must have a link whose gap is finite")
            if self.threshold is None:
                return -found.min_gap
            if any(system.links[k].contact is not None for k in closable):
                rule = "of structures without a law of contact, or gap = None for their own gaps"
                raise ValueError(f"{OWNER}: required_gap must be {rule}")
            return reduce(larger, [system.links[k].gap - found.links[k].min_gap for k in closable])
        known = found.scalars() | over_all(system, found)
        if self.demand not in known:
            raise ValueError(f"{OWNER}: unknown demand {self.demand!r}; {hint(self.demand, known)}")
        return known[self.demand]


class _Programs:
    """Compiled programs of a limit state, for batches of points of any size."""

    def __init__(self, state: LimitState) -> None:
        self._of = (state.scenarios, state.grid, state.scheme, state.demand, _is_given(state))
        per_device = 128 if state.dimension > _MANY else 512
        self.chunk = runs_at_a_time() // 512 * per_device
        self._demanded = in_chunks(state.demanded, self.chunk)

    def are_of(self, state: LimitState) -> bool:
        """Whether they serve another limit state."""
        own = (state.scenarios, state.grid, state.scheme, state.demand, _is_given(state))
        return all(x is y for x, y in zip(self._of, own, strict=True))

    def demanded(self, z: Any, changes: Mapping[str, float]) -> np.ndarray:
        """``LimitState.demanded`` of points z, shape (n, d)."""
        return filled_up(self._demanded, self.chunk, np.asarray(z), changes)


def filled_up(run: Any, chunk: int, z: np.ndarray, changes: Mapping[str, float], *more: Any) -> Any:
    """The results of ``run``, made by ``in_chunks``, on whole chunks: it is compiled only once."""
    n = len(z)
    rows = np.minimum(np.arange(-(-n // chunk) * chunk), n - 1)
    batch = {path: np.full(len(rows), float(x)) for path, x in changes.items()}
    found = run(z[rows], batch, *(np.asarray(x)[rows] for x in more))
    return jax.tree.map(lambda x: x[:n], found)


def _is_given(state: LimitState) -> bool:
    return state.threshold is not None


_MANY = 64  # numbers of a point above which fewer runs fit the caches of a core
