"""A design problem: space, ensemble and objective together, and the values of a design."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound._checks import instance, refusal
from jaxpound.design.ensemble import Ensemble
from jaxpound.design.goals import LeastDemand, PoundingProbability
from jaxpound.design.objective import Objective
from jaxpound.design.prices import BUDGET, DAMPER, prices_of
from jaxpound.design.space import DesignSpace
from jaxpound.grid import TimeGrid
from jaxpound.model.system import is_closable
from jaxpound.results.elements import of_link
from jaxpound.simulation.batches import in_chunks
from jaxpound.simulation.run import demand
from jaxpound.simulation.scheme import Scheme
from jaxpound.study.demands import over_all, rest_gap
from jaxpound.units import Scales

OWNER = "design_damper"


class ProblemData(NamedTuple):
    """Numeric arguments of a search's programs: other numbers need no new compilation."""

    grounds: Any
    uncertain: Any
    limits: Any  # (m,)
    rare: Any  # ``LogRatios`` of the limited probabilities
    box: Any  # smallest and largest scaled variables, (2, d)
    size: Any  # order of magnitude of the objective, in its unit
    tolerance: Any  # the largest violation that counts as feasible
    key: Any  # random key of the minibatches


class LogRatios(NamedTuple):
    """ln(P/p) of k probabilities with limits p, as quadratic functions of a design."""

    scaled: Any  # the design at which values and slopes are known, (d,)
    values: Any  # (k,)
    slopes: Any  # by the scaled variables, (k, d)
    curvatures: Any  # (k, d, d)

    def at(self, scaled: Any) -> Any:
        """Each at a design, (k,)."""
        step = scaled - self.scaled
        return self.values + (self.slopes + self.curvatures @ step / 2) @ step


class Point(NamedTuple):
    """A design and its values; for several designs, arrays with a leading axis."""

    scaled: Any  # the scaled variables, (d,)
    objective: Any  # goal less penalties
    limited: Any  # the limited numbers, ``Limit.limited``, (m,)
    violation: Any  # largest relative excess over a limit
    infeasible: Any  # whether the violation is above its tolerance
    merit: Any  # to be minimised: the violation if infeasible, else minus the objective over size


@dataclasses.dataclass(frozen=True, eq=False)
class DesignProblem:
    """Parameters of structures to be chosen for an ensemble of earthquakes; see ``design_damper``.

    A design is given by its scaled variables, shape (d,): from 0 to 1 between their bounds.
    """

    space: DesignSpace
    ensemble: Ensemble
    grid: TimeGrid
    scheme: Scheme
    objective: Objective
    scales: Scales | None = None

    def __post_init__(self) -> None:
        kinds = {"space": DesignSpace, "ensemble": Ensemble, "grid": TimeGrid, "scheme": Scheme}
        kinds |= {"objective": Objective} | ({} if self.scales is None else {"scales": Scales})
        for name, kind in kinds.items():
            instance(OWNER, name, getattr(self, name), kind)
        self.space.require_certain(OWNER, self.ensemble.uncertain)
        for name in ("penalties", "limits"):
            for price in getattr(self.objective, name):
                if price not in (*self.prices, *self.objective.rare):
                    rule = f"must be one of {', '.join(self.prices)}"
                    raise ValueError(f"{OWNER}: objective: {price!r} in {name} {rule}")
        goal = self.objective.goal
        if self.objective.needs_gap and not self._closable:
            rule = (
                "must not be of gaps where no link has a finite one; LeastDemand is of a response"
            )
            raise ValueError(f"{OWNER}: objective: goal = {goal!r} {rule}")
        if isinstance(goal, LeastDemand) and goal.demand not in self.prices:
            rule = f"must be one of {', '.join(self.prices)}"
            raise ValueError(f"{OWNER}: objective: {goal.demand!r} in goal {rule}")
        if isinstance(goal, PoundingProbability):
            if self._touching:
                rule = "of structures without a law of contact; whether they meet is the same"
                raise ValueError(f"{OWNER}: objective: PoundingProbability must be {rule}")
            if goal.gap is not None and not self._one_gap():
                rule = "must be left out where gaps at rest differ: it is then of those gaps"
                raise ValueError(f"{OWNER}: objective: PoundingProbability: gap {rule}")

    @property
    def _touching(self) -> bool:
        return any(link.contact is not None for link in self.space.nominal.system().links)

    @cached_property
    def _closable(self) -> list[int]:
        """Links whose gap at rest is finite, by number."""
        links = enumerate(self.space.nominal.system().links)
        return [k for k, link in links if is_closable(link.gap)]

    def _one_gap(self) -> bool:
        """Whether all gaps at rest are one number, whatever is chosen and drawn."""
        one = {path: x[0] for path, x in self.ensemble.uncertain.items()}
        middle = jnp.full(self.space.dimension, 0.5)
        found = jax.eval_shape(lambda *x: rest_gap(self.space.structures(*x)), middle, one)
        return found is not None

    @cached_property
    def prices(self) -> tuple[str, ...]:
        """Names of what may be limited or penalised of the structures."""
        return prices_of(self.space.nominal.system())

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """Names of all that is known of a design in an earthquake: gaps, if any, and ``prices``."""
        n = len(self.space.nominal.system().links)
        of_links = [of_link("min_gap", k, n) for k in self._closable]
        gaps = ["min_gap", *of_links, "initial_gap"] if of_links else []
        return tuple(dict.fromkeys([*gaps, *self.prices]))

    def demands(self, structures: Any, ground: Any) -> dict[str, jax.Array]:
        """The ``columns`` of structures in one earthquake."""
        found, system = demand(structures, ground, self.grid, self.scheme), structures.system()
        gaps = [system.links[k].gap for k in self._closable]
        slip_forces = [link.friction for link in system.links]
        if self.scales is not None:
            found = self.scales.to_si(found)
            gaps = [x * self.scales.length for x in gaps]
            slip_forces = [x * self.scales.force for x in slip_forces]
        n = len(slip_forces)
        known = found.scalars() | over_all(system, found)
        known |= {name: jnp.abs(x) for name, x in found.flat("residual_offset").items()}
        known |= {of_link(DAMPER, k, n): x for k, x in enumerate(slip_forces)}
        known |= {BUDGET: sum(slip_forces)}
        if gaps:
            known |= {"initial_gap": sum(gaps) / len(gaps)}
        return {name: jnp.asarray(known[name], found.min_gap.dtype) for name in self.columns}

    def values(self, scaled: Any, data: ProblemData, rows: Any = None) -> tuple[Any, Any]:
        """Objective and limited demands (m,) at a design, traceable.

        For the earthquakes with the indices ``rows``, or all.
        """
        earthquakes = data.grounds, data.uncertain
        if rows is not None:
            earthquakes = jax.tree.map(lambda x: x[rows], earthquakes)

        def run(ground: Any, others: Any) -> dict[str, jax.Array]:
            return self.demands(self.space.structures(scaled, others), ground)

        found = jax.vmap(run)(*earthquakes)
        return self.objective.value(found), self.limited(scaled, found, data.rare)

    def limited(self, scaled: Any, columns: Mapping[str, Any], rare: LogRatios) -> Any:
        """The limited numbers of a design with these columns of demands, (m,)."""
        return self.objective.prices(columns, list(1 + rare.at(scaled)))

    def evaluate(self, scaled: np.ndarray, ensemble: Ensemble) -> dict[str, np.ndarray]:
        """Columns of demands at a design, shape (n,) each; one program for all designs."""
        every = np.tile(scaled, (len(ensemble), 1))
        found = self._run(every, ensemble.grounds, dict(ensemble.uncertain))
        return {name: found[name] for name in self.columns}

    @cached_property
    def _run(self) -> Callable[..., Any]:
        return in_chunks(
            lambda scaled, ground, others: self.demands(
                self.space.structures(scaled, others), ground
            )
        )

    def data(
        self,
        before: Mapping[str, np.ndarray],
        tolerance: float,
        key: int,
        limits: Mapping[str, float] | None = None,
    ) -> ProblemData:
        """The numbers of a search; ``before`` are the demands of its first start.

        ``limits`` replace bounds of the objective's limits.
        """
        own = {name: limit.bound for name, limit in self.objective.limits.items()}
        d, k = self.space.dimension, len(self.objective.rare)
        nowhere = LogRatios(*(jnp.zeros(shape) for shape in ((d,), (k,), (k, d), (k, d, d))))
        return ProblemData(
            grounds=jax.tree.map(jnp.asarray, self.ensemble.grounds),
            uncertain={path: jnp.asarray(x) for path, x in self.ensemble.uncertain.items()},
            limits=jnp.asarray([*{**own, **(limits or {})}.values()], float),
            rare=nowhere,
            box=jnp.stack([jnp.zeros(d), jnp.ones(d)]),
            size=jnp.asarray(self.objective.size(before), float),
            tolerance=jnp.asarray(tolerance, float),
            key=jax.random.key(key, impl="threefry2x32"),
        )

    def points(self, scaled: np.ndarray, data: ProblemData) -> Point:
        """Designs, shape (s, d), with their values on the whole ensemble, one after another."""
        found = []
        for one in scaled:
            columns = self.evaluate(one, self.ensemble)
            values = self.objective.value(columns), self.limited(one, columns, data.rare)
            found.append(jax.device_get(point(one, *values, data)))
        return jax.tree.map(lambda *x: np.stack(x), *found)

    def not_finite(self, scaled: np.ndarray) -> str:
        """Why a design has no finite values, or no finite gradient."""
        columns = self.evaluate(scaled, self.ensemble)
        bad = ~np.all([np.isfinite(x) for x in columns.values()], axis=0)
        if not bad.any():
            return "its gradient is not finite"
        i = int(np.argmax(bad))
        others = {path: x[i] for path, x in self.ensemble.uncertain.items()}

        def run() -> Any:
            structures = self.space.structures(jnp.asarray(scaled), others)
            return demand(structures, self.ensemble.ground(i), self.grid, self.scheme)

        if said := refusal(run):
            return f"earthquake {i}: {said}"
        return f"earthquake {i} of {len(bad)} gives no finite demand"


def point(scaled: Any, objective: Any, limited: Any, data: ProblemData) -> Point:
    """A design with its values, violation and merit; traceable."""
    violation = jnp.max(limited / data.limits - 1, initial=0.0)
    infeasible = ~(violation <= data.tolerance)
    merit = jnp.where(infeasible, violation, -objective / data.size)
    return Point(scaled, objective, limited, violation, infeasible, merit)


def better(old: Point, new: Point, alive: Any) -> Point:
    """The better design of each start: a feasible one first, then that of smaller merit."""
    nearer = (new.infeasible == old.infeasible) & (new.merit < old.merit)
    wins = alive & ((old.infeasible & ~new.infeasible & np.isfinite(new.merit)) | nearer)
    return jax.tree.map(
        lambda a, b: np.where(wins.reshape(-1, *[1] * (a.ndim - 1)), b, a), old, new
    )


def best_start(best: Point, alive: Any = True) -> int:
    """The start of the best design: alive, feasible if any is, with the smallest merit."""
    lost = ~(alive & np.isfinite(best.merit))
    return int(np.lexsort((best.merit, best.infeasible, lost))[0])
