"""A design problem: space, ensemble and objective together, and the values of a design."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound._checks import instance, refusal
from jaxpound._errors import InvalidInput, renamed
from jaxpound._xla.batches import in_chunks
from jaxpound.design.ensemble import Ensemble
from jaxpound.design.goals import LeastDemand, PoundingProbability
from jaxpound.design.objective import Objective
from jaxpound.design.space import DesignSpace
from jaxpound.grid import TimeGrid
from jaxpound.ground.run_input import require_time_unit
from jaxpound.model.contact import Newton
from jaxpound.model.system import Link, common_gap, in_si, is_closable
from jaxpound.reliability.result import RareEvent
from jaxpound.results import named
from jaxpound.results.elements import of_link
from jaxpound.simulation.run import demand
from jaxpound.simulation.scheme import Scheme, single_system


class ProblemData(NamedTuple):
    """Numeric arguments of a search's programs: other numbers need no other compilation."""

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

    scaled: Any  # the design of the values and slopes, (d,)
    values: Any  # (k,)
    slopes: Any  # by the scaled variables, (k, d)
    curvatures: Any  # (k, d, d)

    def at(self, scaled: Any) -> Any:
        """Each at a design, (k,)."""
        step = scaled - self.scaled
        return self.values + (self.slopes + self.curvatures @ step / 2) @ step


class RareEstimates(NamedTuple):
    """The rare events of a design, by the demand that is limited, and their slopes there."""

    events: dict[str, RareEvent]
    log_ratios: LogRatios


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
    """A space, an ensemble of earthquakes and an objective; see ``design_damper``.

    A design is given by its scaled variables, shape (d,): from 0 to 1 between their bounds.
    """

    space: DesignSpace
    ensemble: Ensemble
    grid: TimeGrid
    scheme: Scheme
    objective: Objective

    def __post_init__(self) -> None:
        kinds = (DesignSpace, Ensemble, TimeGrid, Scheme, Objective)
        for field, kind in zip(dataclasses.fields(self), kinds, strict=True):
            instance(field.name, getattr(self, field.name), kind)
        single_system(self.space.nominal)
        require_time_unit("ensemble", self.ensemble, si=self.si)
        self.space.require_certain(self.ensemble.uncertain)
        with renamed("objective"):
            self._require_objective()

    def _require_objective(self) -> None:
        """An ``InvalidInput`` for an objective that is not one of these structures."""
        objective, goal = self.objective, self.objective.goal
        of_gaps = not isinstance(goal, LeastDemand)
        places: Any = {"penalties": objective.penalties, "limits": objective.limits}
        places["goal"] = [goal.demand] if isinstance(goal, LeastDemand) else []
        for place, names in places.items():
            for name in names:
                if rule := self._refusal(name):
                    raise InvalidInput(f"{name!r} in {place}", "", rule)
        if of_gaps and not self._closable:
            rule = "must not be of gaps where no link has a finite one"
            raise InvalidInput("goal", repr(goal), f"{rule}; LeastDemand is of a response")
        if isinstance(goal, PoundingProbability):
            if any(link.contact is not None for link in self._links):
                rule = "must be of structures without a law of contact; "
                rule += "whether they meet is the same"
                raise InvalidInput("PoundingProbability", "", rule)
            # Gaps at rest that are one number, whatever is chosen and drawn.
            drawn = {path: x[0] for path, x in self.ensemble.uncertain.items()}
            middle = jnp.full(self.space.dimension, 0.5)
            gap = jax.eval_shape(lambda *x: common_gap(self.space.structures(*x)), middle, drawn)
            if goal.gap is not None and gap is None:
                rule = "must be left out where gaps at rest differ: it is then of those gaps"
                raise InvalidInput("PoundingProbability: gap", "", rule)

    def _refusal(self, demand: str) -> str:
        """The rule that a demand breaks which the structures do not have; empty if they have it."""
        laws = {type(link.contact) for link in self._links if link.contact is not None}
        if demand in {*self.limitable, *self.objective.rare}:
            by_newton = laws == {Newton} and named.is_zero_by_newton(demand)
            instead = "peak_impulse is what they have"
            return f"must not be by Newton's law, whose impacts have none; {instead}" * by_newton
        if getattr(named.quantity_named(demand), "only", "") == "contact" and not laws:
            return "must be of structures with a contact law"
        return f"must be one of {', '.join(self.limitable)}"

    @property
    def si(self) -> bool:
        """Whether all numbers are in SI units, as the structures are."""
        return in_si(self.space.nominal)

    @property
    def _links(self) -> Sequence[Link]:
        return self.space.nominal.system().links

    @cached_property
    def _closable(self) -> list[int]:
        """Links whose gap at rest is finite, by number."""
        return [k for k, link in enumerate(self._links) if is_closable(link.gap)]

    @cached_property
    def limitable(self) -> tuple[str, ...]:
        """Names of the demands of the structures that may be limited or penalised."""
        return named.limitable_demands(self.space.nominal.system())

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """Names of a design's numbers in an earthquake: gaps, if any, and ``limitable``."""
        of_links = [of_link("min_gap", k, len(self._links)) for k in self._closable]
        gaps = ["min_gap", *of_links, "initial_gap"] if of_links else []
        return tuple(dict.fromkeys([*gaps, *self.limitable]))

    def demands(self, structures: Any, ground: Any) -> dict[str, jax.Array]:
        """The ``columns`` of structures in one earthquake."""
        response, system = demand(structures, ground, self.grid, self.scheme), structures.system()
        gaps = [system.links[k].gap for k in self._closable]
        columns = named.limited_values(system, response)
        if gaps:
            columns |= {"initial_gap": sum(gaps) / len(gaps)}
        return {name: jnp.asarray(columns[name], response.min_gap.dtype) for name in self.columns}

    def values(self, scaled: Any, data: ProblemData, rows: Any = None) -> tuple[Any, Any]:
        """Objective and limited demands (m,) at a design in the earthquakes ``rows``; traceable."""
        earthquakes = data.grounds, data.uncertain
        if rows is not None:
            earthquakes = jax.tree.map(lambda x: x[rows], earthquakes)
        columns = jax.vmap(partial(self._demands_at, scaled))(*earthquakes)
        return self.objective.value(columns), self.limited(scaled, columns, data.rare)

    def limited(self, scaled: Any, columns: Mapping[str, Any], rare: LogRatios) -> Any:
        """The limited numbers of a design with these columns of demands, (m,)."""
        return self.objective.limited_demands(columns, list(1 + rare.at(scaled)))

    def evaluate(self, scaled: np.ndarray, ensemble: Ensemble) -> dict[str, np.ndarray]:
        """Columns of demands at a design, shape (n,) each; one program for all designs."""
        designs = np.tile(scaled, (len(ensemble), 1))
        columns = self._run(designs, ensemble.grounds, dict(ensemble.uncertain))
        return {name: columns[name] for name in self.columns}

    @cached_property
    def _run(self) -> Callable[..., Any]:
        return in_chunks(self._demands_at)

    def __getstate__(self) -> dict[str, Any]:  # a pickle has no compiled program
        return {name: x for name, x in vars(self).items() if name != "_run"}

    def _demands_at(self, scaled: Any, ground: Any, uncertain: Any) -> dict[str, jax.Array]:
        return self.demands(self.space.structures(scaled, uncertain), ground)

    def data(
        self,
        before: Mapping[str, np.ndarray],
        tolerance: float,
        key: int,
        limits: Mapping[str, float] | None = None,
    ) -> ProblemData:
        """The numbers of a search, from its first start's demands; ``limits`` replace bounds."""
        bounds = {name: limit.bound for name, limit in self.objective.limits.items()}
        d, k = self.space.dimension, len(self.objective.rare)
        return ProblemData(
            grounds=jax.tree.map(jnp.asarray, self.ensemble.grounds),
            uncertain={path: jnp.asarray(x) for path, x in self.ensemble.uncertain.items()},
            limits=jnp.asarray([*(bounds | dict(limits or {})).values()], float),
            rare=LogRatios(*(jnp.zeros(shape) for shape in ((d,), (k,), (k, d), (k, d, d)))),
            box=jnp.stack([jnp.zeros(d), jnp.ones(d)]),
            size=jnp.asarray(self.objective.size(before), float),
            tolerance=jnp.asarray(tolerance, float),
            key=jax.random.key(key, impl="threefry2x32"),
        )

    def points(self, scaled: np.ndarray, data: ProblemData) -> Point:
        """Designs, shape (s, d), with their values on the whole ensemble, one after another."""
        evaluated = []
        for design in scaled:
            columns = self.evaluate(design, self.ensemble)
            values = self.objective.value(columns), self.limited(design, columns, data.rare)
            evaluated.append(jax.device_get(point(design, *values, data)))
        return jax.tree.map(lambda *x: np.stack(x), *evaluated)

    def not_finite(self, scaled: np.ndarray) -> str:
        """Why a design has no finite values, or no finite gradient."""
        columns = self.evaluate(scaled, self.ensemble)
        invalid = ~np.all([np.isfinite(x) for x in columns.values()], axis=0)
        if not invalid.any():
            return "its gradient is not finite"
        i = int(np.argmax(invalid))
        others = {path: x[i] for path, x in self.ensemble.uncertain.items()}

        def run() -> Any:
            structures = self.space.structures(jnp.asarray(scaled), others)
            return demand(structures, self.ensemble.ground(i), self.grid, self.scheme)

        if reason := refusal(run):
            return f"earthquake {i}: {reason}"
        return f"earthquake {i} of {len(invalid)} gives no finite demand"


def point(scaled: Any, objective: Any, limited: Any, data: ProblemData) -> Point:
    """A design with its values, violation and merit; traceable."""
    violation = jnp.max(limited / data.limits - 1, initial=0.0)
    infeasible = ~(violation <= data.tolerance)
    merit = jnp.where(infeasible, violation, -objective / data.size)
    return Point(scaled, objective, limited, violation, infeasible, merit)


def better(old: Point, new: Point, finite: Any) -> Point:
    """The better design of each start: a feasible one first, then that of smaller merit."""
    nearer = (new.infeasible == old.infeasible) & (new.merit < old.merit)
    replaced = finite & ((old.infeasible & ~new.infeasible & np.isfinite(new.merit)) | nearer)
    return jax.tree.map(
        lambda a, b: np.where(replaced.reshape(-1, *[1] * (a.ndim - 1)), b, a), old, new
    )


def best_start(best: Point, finite: Any = True) -> int:
    """The start of the best design: finite, feasible if any is, with the smallest merit."""
    dropped = ~(finite & np.isfinite(best.merit))
    return int(np.lexsort((best.merit, best.infeasible, dropped))[0])
