"""Limits on the probabilities of rare events, by a sequence of searches.

This is sequential approximate optimisation in a trust region, a box around the current design that
shrinks where the model is wrong. In each round a search takes the logarithm of every limited
probability as a quadratic model: value and slopes come from samples of the rare event, curvatures
from the slopes of earlier rounds. Rounds end at a design that is within all limits and meets
first-order conditions, or that a round no longer changes.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound._errors import InvalidInput, renamed
from jaxpound.design.lagrangian import FirstOrderConditions
from jaxpound.design.problem import DesignProblem, LogRatios, RareEstimates
from jaxpound.design.search import STOPPED_BY_CALLBACK, Descent, SearchResult
from jaxpound.model.parameters import get, put
from jaxpound.model.system import Structures
from jaxpound.reliability.limit_state import LimitState
from jaxpound.reliability.result import RAREST, RareEvent
from jaxpound.reliability.run import EventSearch, event_of
from jaxpound.scenarios.scenarios import ScenarioSet, discrete_coordinates, parameter_names

TOLERANCE = 0.1  # relative excess over a limit on a probability that is tolerated
_COV = TOLERANCE / 3  # of each estimate
_MOST_ROUNDS = 15
_LARGEST_DECREASE = 3.0  # of ln P in a round: beyond it the slope changes
_MODEL_ERROR = 1.0  # excess of ln P over the model at which a step is rejected
_CURVATURE_STEP = 0.02  # change of a scaled variable from which slopes determine a curvature
_STEP_TOLERANCE = 0.002  # change of a scaled variable
_GRADIENT_TOLERANCE = 0.05  # gradient of the Lagrangian over that of the objective
_DECAY = 0.5  # of curvatures, from round to round


@dataclasses.dataclass(frozen=True, eq=False)
class DesignScenarios:
    """Random scenarios of a design: its structures, but for those parameters that are drawn."""

    scenarios: ScenarioSet
    nominal: Structures
    drawn: tuple[str, ...]

    @property
    def dimension(self) -> int:
        """Number of standard normal numbers."""
        return self.scenarios.dimension

    @property
    def discrete(self) -> tuple[int, ...]:
        """Indices of the discrete ones."""
        return tuple(discrete_coordinates(self.scenarios))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Their names."""
        return tuple(parameter_names(self.scenarios))

    def realize(self, z: Any) -> tuple[Structures, Any]:
        """The scenario drawn by z: structures and ground motion."""
        structures, ground = self.scenarios.realize(z)
        return put(self.nominal, {path: get(structures, path) for path in self.drawn}), ground


def limit_states(problem: DesignProblem) -> dict[str, LimitState]:
    """The events whose probabilities a problem limits, by the demand's name."""
    ensemble, nominal, states = problem.ensemble, problem.space.nominal, {}
    for name in problem.objective.rare:
        limit, place = problem.objective.limits[name], f"objective: limits: {name}"
        if ensemble.scenarios is None:
            rule = "needs an ensemble that is drawn (Ensemble.drawn)"
            raise InvalidInput(f"{place}: a probability", "", rule)
        if limit.most < RAREST:
            rule = f"must be at least {RAREST:g}"
            raise InvalidInput(f"{place}: probability", f"{limit.most:.8g}", rule)
        scenarios = DesignScenarios(ensemble.scenarios, nominal, tuple(ensemble.uncertain))
        with renamed(place):
            states[name] = LimitState(scenarios, problem.grid, problem.scheme, name, limit.at_most)
    return states


@dataclasses.dataclass
class RareLimits:
    """Estimates of limited probabilities, at one design after another; kept beside ``save``."""

    problem: DesignProblem
    descent: Descent
    states: Mapping[str, LimitState]
    made: int = 0
    last: dict[str, RareEvent] = dataclasses.field(default_factory=dict)

    def at(self, scaled: np.ndarray) -> RareEstimates:
        """Events at a design, with the slopes of their logarithms; an error if one is certain."""
        events = {name: self._event(name, scaled) for name in self.states}
        by_scaled = jax.jacobian(self.problem.space.values)(jnp.asarray(scaled))
        k, d = len(events), len(scaled)
        logs, slopes = np.zeros(k), np.zeros((k, d))
        for i, (name, event) in enumerate(events.items()):
            most = self.problem.objective.limits[name].most
            logs[i] = math.log(max(event.probability, RAREST) / most)
            if math.isfinite(event.cov):  # else it is rarer than can be estimated
                by_path = event.slopes_by(tuple(by_scaled))
                slopes[i] = sum(by_path[path].value * x for path, x in by_scaled.items())
        numbers = (scaled, logs, slopes, np.zeros((k, d, d)))
        return RareEstimates(events, LogRatios(*(np.asarray(x, scaled.dtype) for x in numbers)))

    def _event(self, name: str, scaled: np.ndarray) -> RareEvent:
        changes = {path: float(x) for path, x in self.problem.space.values(scaled).items()}
        descent, save = self.descent, self.descent.save
        store = None if save is None else save.with_suffix(".events") / f"{self.made}-{name}"
        self.made += 1
        state = dataclasses.replace(self.states[name], changes=changes)
        search = EventSearch(start=self.last.get(name))
        event = event_of(state, _COV, search, descent.search.key, store, descent.progress)
        if event.probability == 1:
            listed = ", ".join(f"{path} = {x:.6g}" for path, x in changes.items())
            rule = f"must be rare enough to be estimated at {listed}: {'; '.join(event.warnings)}"
            raise InvalidInput(f"objective: limits: {name}", "", rule)
        if len(event.design_points):
            self.last[name] = event
        return event


def search_in_rounds(
    states: Mapping[str, LimitState], descent: Descent, first: np.ndarray
) -> SearchResult:
    """The best design within limits on probabilities too; ``states`` are ``limit_states``."""
    data, save = descent.data, descent.save
    rare = RareLimits(descent.lagrangian.problem, descent, states)
    region = TrustRegion(rare.at(first))
    history: list[Any] = []
    polishing, best, file = 0, None, save
    for number in range(_MOST_ROUNDS):
        if number and save is not None:  # a file for each round
            file = save.with_stem(f"{save.stem}.{number + 1}")
        approximate = data._replace(rare=region.model, box=jnp.asarray(region.box, data.box.dtype))
        round_of = dataclasses.replace(descent, data=approximate, save=file)
        result = round_of.best(region.centre)
        history, polishing = history + result.history, polishing + result.polishing
        trial = rare.at(result.point.scaled)
        ratios = trial.log_ratios
        # A probability within half of the tolerance of its limit is at its limit.
        at_limit = np.abs(ratios.values) <= TOLERANCE / 2
        active = ratios._replace(values=np.where(at_limit, 0.0, ratios.values))
        conditions = descent.conditions(data._replace(rare=active))
        result = result._replace(rare=trial, conditions=conditions)
        feasible = (ratios.values <= math.log1p(TOLERANCE)).all() and not result.point.infeasible
        if feasible and (best is None or result.point.objective > best.point.objective):
            best = result
        converged = region.distance(trial) <= _STEP_TOLERANCE
        if not region.accepts(trial):
            continue
        if result.stopped == STOPPED_BY_CALLBACK or (converged and result.point.infeasible):
            break
        if feasible and (converged or _is_optimal(conditions, result.point.scaled)):
            best = result
            break
    final = result if best is None else best
    return final._replace(
        point=final.point._replace(infeasible=np.asarray(best is None)),
        history=history,
        polishing=polishing,
        stopped=f"{result.stopped} of round {number + 1}",
    )


@dataclasses.dataclass
class TrustRegion:
    """The box around the current design in which the model of ln(P/p) is used (move limits)."""

    current: RareEstimates
    radius: float = 1.0  # half the edge of the box
    last_step: Any = 0.0

    @property
    def centre(self) -> np.ndarray:
        """The current design, (d,)."""
        return self.current.log_ratios.scaled

    @property
    def box(self) -> np.ndarray:
        """Smallest and largest scaled variables, (2, d)."""
        return np.clip([self.centre - self.radius, self.centre + self.radius], 0.0, 1.0)

    @property
    def model(self) -> LogRatios:
        """The model that a search uses: no probability is too far above its limit for one step."""
        ratios = self.current.log_ratios
        return ratios._replace(values=np.minimum(ratios.values, _LARGEST_DECREASE))

    def distance(self, trial: RareEstimates) -> float:
        """Largest change of a scaled variable from the current design."""
        return float(np.abs(trial.log_ratios.scaled - self.centre).max())

    def accepts(self, trial: RareEstimates) -> bool:
        """Move to a trial design, unless the model was wrong there; adapt radius and curvatures."""
        model, reached = self.current.log_ratios, trial.log_ratios
        step, size = reached.scaled - self.centre, self.distance(trial)
        curvatures = updated_curvatures(model, reached)
        predicted = np.maximum(model.at(reached.scaled), 0.0)
        if size > _STEP_TOLERANCE and (reached.values > predicted + _MODEL_ERROR).any():
            self.radius = size / 2
            self.current = self.current._replace(log_ratios=model._replace(curvatures=curvatures))
            return False
        if (step * self.last_step < 0).any():  # oscillates
            self.radius = max(size / 2, _STEP_TOLERANCE)
        elif size > 0.8 * self.radius:
            self.radius = min(2 * self.radius, 1.0)
        self.current = trial._replace(log_ratios=reached._replace(curvatures=curvatures))
        self.last_step = step
        return True


def updated_curvatures(old: LogRatios, new: LogRatios) -> np.ndarray:
    """Curvatures, upwards only, that explain the slopes at both designs: symmetric rank-one."""
    curvatures, step = _DECAY * old.curvatures, new.scaled - old.scaled
    if np.abs(step).max() < _CURVATURE_STEP:
        return curvatures
    for curvature, change in zip(curvatures, new.slopes - old.slopes, strict=True):
        residual = change - curvature @ step
        along = residual @ step
        if along > 1e-3 * np.linalg.norm(residual) * np.linalg.norm(step):
            curvature += np.outer(residual, residual) / along
    return curvatures


def _is_optimal(conditions: FirstOrderConditions, scaled: np.ndarray) -> bool:
    point, goal, _ = conditions.at(scaled)
    _, gradient = conditions.multipliers(point)
    free = gradient[~conditions.at_bound(scaled, gradient)]
    return bool(np.linalg.norm(free) <= _GRADIENT_TOLERANCE * np.linalg.norm(goal))
