"""One iteration of a design search, first-order conditions, and polishing of the best design.

An iteration takes an augmented Lagrangian at many designs at once. With the objective J to be
maximised (in units of its size), the excesses c = limited demand / limit − 1, multipliers λ ≥ 0 and
a weight w, an optimiser minimises −J + Σ (max(0, λ + w c)² − λ²) / 2 w, and every ten iterations λ
becomes max(0, λ + w c) (Nocedal and Wright 2006, section 17.3). Bounds are kept by projection.
"""

from __future__ import annotations

import dataclasses
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.stages import Wrapped
from scipy.optimize import minimize, nnls

from jaxpound.design.problem import DesignProblem, Point, ProblemData, point

if TYPE_CHECKING:
    from optax import GradientTransformationExtraArgs

_MULTIPLIERS_EVERY = 10  # iterations
_FIRST_WEIGHT, _LARGEST_WEIGHT = 10.0, 100.0  # larger ones make steps and multipliers oscillate
_AT_BOUND = 0.005  # scaled distance from a bound within which a variable counts as at that bound
_NEAR_LIMIT = 0.01  # of the limit
_STEPS = 30  # of polishing in a region, at most
_REGIONS = 1.0, 0.2, 0.04  # the variables' ranges about the best design, until it improves
_FAR = 1e6  # replaces an objective that is not finite, in units of size
_EXACT = 1e-9  # a violation that is rounding only


class SearchState(NamedTuple):
    """State of all starts; arrays with a leading axis of starts."""

    scaled: Any  # (s, d)
    optimiser: Any
    multipliers: Any  # (s, m)
    weight: Any  # (s,)
    violation: Any  # at the last update of the multipliers
    alive: Any  # whether all values have been finite


@dataclasses.dataclass(frozen=True, eq=False)
class AugmentedLagrangian:
    """A design problem's augmented Lagrangian, and the optimiser that minimises it."""

    problem: DesignProblem
    optimiser: GradientTransformationExtraArgs
    batch: int  # earthquakes of an iteration

    @property
    def per_epoch(self) -> int:
        """Iterations of an epoch, in which every earthquake is used."""
        return -(-len(self.problem.ensemble) // self.batch)

    def begin(self, scaled: np.ndarray) -> SearchState:
        """The state of starts, shape (s, d)."""
        n, designs = len(scaled), jnp.asarray(scaled)
        state = SearchState(
            scaled=designs,
            optimiser=jax.vmap(self.optimiser.init)(designs),
            multipliers=jnp.zeros((n, len(self.problem.objective.limits))),
            weight=jnp.full(n, _FIRST_WEIGHT),
            violation=jnp.full(n, jnp.inf),
            alive=jnp.ones(n, bool),
        )
        return jax.device_get(state)

    def iterate(
        self, state: SearchState, iteration: int, data: ProblemData
    ) -> tuple[SearchState, Point]:
        """The next state, and the designs and values at this one; iterations count from 0."""
        point, gradients = self.gradient(*_gradient_arguments(state), iteration, data)
        return jax.device_get((self.update(state, point, gradients, iteration, data), point))

    def texts(self, state: SearchState, data: ProblemData) -> tuple[str, str]:
        """The programs of ``iterate`` as text, to distinguish one search from another."""
        arguments = (*_gradient_arguments(state), 0, data)
        update = self.update.lower(state, *jax.eval_shape(self.gradient, *arguments), 0, data)
        return self.gradient.lower(*arguments).as_text(), update.as_text()

    @cached_property
    def gradient(self) -> Wrapped:
        """Program: designs, (s, d), with their values, and the Lagrangian's gradients there.

        Takes factors of −J, (s,), multipliers, (s, m), and weights w, (s,); with w = 0 it is the
        ordinary Lagrangian, which is linear in the multipliers.
        """

        def of_start(
            scaled: Any, goal_factor: Any, multipliers: Any, w: Any, iteration: Any, data: Any
        ) -> tuple[Point, Any]:
            def lagrangian_terms(scaled: Any) -> Any:
                rows = self._rows(iteration, data.key)
                objective, limited = self.problem.values(scaled, data, rows)
                terms = -objective / data.size, limited / data.limits - 1
                return terms, (objective, limited)

            (_, excess), pull_back, values = jax.vjp(lagrangian_terms, scaled, has_aux=True)
            (gradient,) = pull_back((goal_factor, jax.nn.relu(multipliers + w * excess)))
            objective, limited = values
            return point(scaled, objective, limited, data), gradient

        return jax.jit(jax.vmap(of_start, in_axes=(0, 0, 0, 0, None, None)))

    @cached_property
    def update(self) -> Wrapped:
        """Program: the next state, from the designs and gradients of this one."""
        return jax.jit(jax.vmap(self._update, in_axes=(0, 0, 0, None, None)))

    def _update(
        self, state: SearchState, point: Point, gradient: Any, iteration: Any, data: ProblemData
    ) -> SearchState:
        multipliers, weight = state.multipliers, state.weight

        def projected_multipliers(limited: Any) -> Any:
            return jax.nn.relu(multipliers + weight * (limited / data.limits - 1))

        def lagrangian(objective: Any, limited: Any) -> Any:
            terms = (projected_multipliers(limited) ** 2 - multipliers**2) / (2 * weight)
            return jnp.sum(terms) - objective / data.size

        def lagrangian_at(scaled: Any) -> Any:  # for line-search optimisers
            rows = self._rows(iteration, data.key)
            return lagrangian(*self.problem.values(jnp.clip(scaled, *data.box), data, rows))

        value = lagrangian(point.objective, point.limited)
        finite = state.alive & jnp.isfinite(value) & jnp.isfinite(gradient).all()
        slope = jnp.where(at_active_bound(state.scaled, gradient, data.box), 0.0, gradient)
        steps, memory = self.optimiser.update(
            slope, state.optimiser, state.scaled, value=value, grad=slope, value_fn=lagrangian_at
        )
        is_due = (iteration + 1) % _MULTIPLIERS_EVERY == 0
        lags = point.violation > jnp.maximum(10 * data.tolerance, state.violation / 2)
        increased_weight = jnp.minimum(jnp.where(lags, 2 * weight, weight), _LARGEST_WEIGHT)
        next_state = SearchState(
            scaled=projected(state.scaled + steps, data.box),
            optimiser=memory,
            multipliers=jnp.where(is_due, projected_multipliers(point.limited), multipliers),
            weight=jnp.where(is_due, increased_weight, weight),
            violation=jnp.where(is_due, point.violation, state.violation),
            alive=finite,
        )
        stopped = jax.tree.map(lambda new, old: jnp.where(finite, new, old), next_state, state)
        return stopped._replace(alive=finite)

    def _rows(self, iteration: Any, key: Any) -> Any:
        """Indices of a minibatch, reshuffled each epoch; None if it is of all earthquakes."""
        if self.per_epoch == 1:
            return None
        epoch, part = jnp.divmod(iteration, self.per_epoch)
        n = len(self.problem.ensemble)
        order = jax.random.permutation(jax.random.fold_in(key, epoch), n)
        return order[(part * self.batch + jnp.arange(self.batch)) % n]


def _gradient_arguments(state: SearchState) -> tuple[Any, ...]:
    return state.scaled, np.ones_like(state.weight), state.multipliers, state.weight


def projected(scaled: Any, box: Any) -> Any:
    """Variables in the box; one that misses a bound by rounding only is at it."""
    xp: Any = np if isinstance(scaled, np.ndarray) else jnp
    rounding = 16 * jnp.finfo(scaled.dtype).eps
    scaled = xp.where(scaled < box[0] + rounding, box[0], scaled)
    return xp.where(scaled > box[1] - rounding, box[1], scaled)


def at_active_bound(scaled: Any, gradient: Any, box: Any, within: float = 0.0) -> Any:
    """Variables at an active bound: the descent direction points out of the box."""
    low, high = box
    at_low, at_high = scaled <= low + within, scaled >= high - within
    return (at_low & (gradient > 0)) | (at_high & (gradient < 0))


class FirstOrder(NamedTuple):
    """A design with derivatives by its scaled variables."""

    point: Point
    goal: np.ndarray  # gradient of minus the objective over its size, (d,)
    slopes: np.ndarray  # gradients of limited demands over their limits, (m, d)


@dataclasses.dataclass(frozen=True)
class FirstOrderConditions:
    """First-order conditions of a problem, kept for every design that was evaluated."""

    lagrangian: AugmentedLagrangian
    data: ProblemData
    starts: int  # number of designs that the search's program has been compiled for
    _evaluated: dict[bytes, FirstOrder] = dataclasses.field(default_factory=dict)

    def at(self, scaled: np.ndarray) -> FirstOrder:
        """A design with its derivatives; they are computed once for each design.

        By the search's ``gradient`` program, since another would take as long to compile: each row
        is the gradient of a Lagrangian with weight 1 for one term and 0 for all others, ``starts``
        rows at a time. With minibatches rows are means over an epoch, and values of its last batch.
        """
        if (key := scaled.tobytes()) in self._evaluated:
            return self._evaluated[key]
        gradient, starts, epoch = self.lagrangian.gradient, self.starts, self.lagrangian.per_epoch
        terms = 1 + len(self.lagrangian.problem.objective.limits)
        weights = np.eye(-(-terms // starts) * starts, terms)
        weights = weights.reshape(-1, starts, terms).astype(scaled.dtype)
        designs, zeros, rows = np.tile(scaled, (starts, 1)), np.zeros(starts, scaled.dtype), []
        for w in weights:
            arguments = designs, w[:, 0], w[:, 1:], zeros
            results = [gradient(*arguments, i, self.data) for i in range(epoch)]
            rows += [*np.mean([gradients for _, gradients in results], axis=0)]
        point = jax.device_get(jax.tree.map(lambda x: x[0], results[-1][0]))
        by_scaled = np.array(rows[:terms])
        return self._evaluated.setdefault(key, FirstOrder(point, by_scaled[0], by_scaled[1:]))

    def at_bound(self, scaled: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        """Variables at an active bound, nearly."""
        return np.asarray(at_active_bound(scaled, gradient, np.asarray(self.data.box), _AT_BOUND))

    def polished(self, best: Point) -> tuple[Point, int]:
        """The best design by sequential quadratic programming, and all runs with a gradient.

        The first step may lead to where nothing has a slope, such as a damper that never slips. The
        program ends there; a smaller region about the best design is then tried.
        """
        terms = 1 + np.asarray(self.data.limits).size
        for radius in _REGIONS:
            ended_well = self._program(best, radius)
            improved = self._least(best)
            if ended_well or improved.merit < best.merit:
                break
        return improved, len(self._evaluated) * -(-terms // self.starts) * self.starts

    def _program(self, best: Point, radius: float) -> bool:
        """Whether SciPy's program from a design ends well; all designs on its path are kept."""
        limits, size = np.asarray(self.data.limits, np.float64), float(self.data.size)
        low, high = np.asarray(self.data.box, np.float64)
        region = np.maximum(low, best.scaled - radius), np.minimum(high, best.scaled + radius)

        def at(scaled: np.ndarray) -> FirstOrder:
            return self.at(projected(scaled, (low, high)).astype(best.scaled.dtype))

        def double(x: Any, replacement: float = 0.0) -> np.ndarray:  # SciPy needs float64
            return np.nan_to_num(np.asarray(x, np.float64), nan=replacement)

        constraint = {
            "type": "ineq",
            "fun": lambda x: double(1 - at(x).point.limited / limits, -1.0),
            "jac": lambda x: -double(at(x).slopes),
        }
        end = minimize(
            lambda x: float(double(-at(x).point.objective / size, _FAR)),
            double(best.scaled),
            jac=lambda x: double(at(x).goal),
            bounds=[*zip(*region, strict=True)],
            constraints=[constraint] if limits.size else (),
            method="SLSQP",
            options={"maxiter": _STEPS, "ftol": 1e-10},
        )
        return bool(end.success)

    def _least(self, best: Point) -> Point:
        """The best of all designs that were evaluated, and of this one."""
        points = [evaluated.point for evaluated in self._evaluated.values()]
        candidates = [best, *(point for point in points if np.isfinite(point.merit))]
        tolerance = float(self.data.tolerance)

        def least(excess: float) -> Point | None:
            within = [point for point in candidates if point.violation <= excess]
            return min(within, key=lambda point: point.merit, default=None)

        # Prefer a design within the limits to one slightly above them with a slightly lower merit.
        exact, tolerable = least(_EXACT), least(tolerance) or best
        if exact is not None and exact.merit <= tolerable.merit + 5 * tolerance:
            return exact
        return tolerable

    def multipliers(self, point: Point) -> tuple[np.ndarray, np.ndarray]:
        """Multipliers ≥ 0 of the active limits at a design, and the Lagrangian's gradient there.

        The multipliers are those with the smallest gradient over variables at no active bound.
        """
        _, goal, slopes = self.at(point.scaled)
        active = point.limited / np.asarray(self.data.limits) - 1 > -_NEAR_LIMIT
        multipliers, gradient = np.zeros(active.size), goal
        for _ in range(3):  # which bounds are active depends on the multipliers
            free = ~self.at_bound(point.scaled, gradient)
            if active.any():
                multipliers[active] = nnls(slopes[active][:, free].T, -goal[free])[0]
            gradient = goal + multipliers @ slopes
        return multipliers, gradient
