"""One iteration of a design search: an augmented Lagrangian at many designs at once.

With the objective J to be maximised (in units of its size), the excesses c = limited demand / limit
− 1, multipliers λ ≥ 0 and a weight w, an optimiser minimises −J + Σ (max(0, λ + w c)² − λ²) / 2 w,
and every ten iterations λ becomes max(0, λ + w c) (Nocedal and Wright 2006, section 17.3). Bounds
are kept by projection.

An iteration is two programs: ``gradient`` does nearly all of the work, and is used for polishing
and first-order conditions as well; ``update`` is the optimiser's step.
"""

from __future__ import annotations

import dataclasses
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.stages import Wrapped

from jaxpound.design.problem import DesignProblem, Point, ProblemData, point

if TYPE_CHECKING:
    from optax import GradientTransformationExtraArgs

_MULTIPLIERS_EVERY = 10  # iterations
_FIRST_WEIGHT, _LARGEST_WEIGHT = 10.0, 100.0  # larger ones make steps and multipliers oscillate


class State(NamedTuple):
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

    def begin(self, scaled: np.ndarray) -> State:
        """The state of starts, shape (s, d)."""
        n, places = len(scaled), jnp.asarray(scaled)
        begun = State(
            scaled=places,
            optimiser=jax.vmap(self.optimiser.init)(places),
            multipliers=jnp.zeros((n, len(self.problem.objective.limits))),
            weight=jnp.full(n, _FIRST_WEIGHT),
            violation=jnp.full(n, jnp.inf),
            alive=jnp.ones(n, bool),
        )
        return jax.device_get(begun)

    def iterate(self, state: State, iteration: int, data: ProblemData) -> tuple[State, Point]:
        """The next state, and the designs and values at this one; iterations count from 0."""
        here, gradients = self.gradient(*_given(state), iteration, data)
        following = self.update(state, here, gradients, iteration, data)
        return jax.device_get((following, here))  # on one device or on all, it is the same program

    def texts(self, state: State, data: ProblemData) -> tuple[str, str]:
        """The programs of ``iterate`` as text, to distinguish one search from another."""
        found = jax.eval_shape(self.gradient, *_given(state), 0, data)
        return (
            self.gradient.lower(*_given(state), 0, data).as_text(),
            self.update.lower(state, *found, 0, data).as_text(),
        )

    def jacobian(self, scaled: np.ndarray, starts: int, data: ProblemData) -> tuple[Point, Any]:
        """A design, and the derivatives of −J and every excess by its scaled variables, (1 + m, d).

        Computed with the search's ``gradient`` program, since another would take as long to
        compile: each row is the gradient of a Lagrangian with weight 1 for one term and 0 for all
        others, ``starts`` rows at a time. With minibatches the rows are means over an epoch, and
        the design's values are those of its last minibatch.
        """
        m = len(self.problem.objective.limits)
        weights = np.eye(-(-(1 + m) // starts) * starts, 1 + m)
        weights = weights.reshape(-1, starts, 1 + m).astype(scaled.dtype)
        places, zero, rows = np.tile(scaled, (starts, 1)), np.zeros(starts, scaled.dtype), []
        for block in weights:
            found = [
                self.gradient(places, block[:, 0], block[:, 1:], zero, i, data)
                for i in range(self.per_epoch)
            ]
            rows += [*np.mean([gradients for _, gradients in found], axis=0)]
        here = jax.device_get(jax.tree.map(lambda x: x[0], found[-1][0]))
        return here, np.array(rows[: 1 + m])

    @cached_property
    def gradient(self) -> Wrapped:
        """Program: designs, (s, d), with their values, and the Lagrangian's gradients there.

        Takes factors of −J, (s,), multipliers, (s, m), and weights w, (s,); with w = 0 it is the
        ordinary Lagrangian, which is linear in the multipliers.
        """

        def one(
            scaled: Any, of_goal: Any, multipliers: Any, w: Any, iteration: Any, data: ProblemData
        ) -> tuple[Point, Any]:
            def lagrangian_terms(scaled: Any) -> Any:
                rows = self._rows(iteration, data.key)
                objective, limited = self.problem.values(scaled, data, rows)
                terms = -objective / data.size, limited / data.limits - 1
                return terms, (objective, limited)

            (_, excess), pull_back, values = jax.vjp(lagrangian_terms, scaled, has_aux=True)
            (gradient,) = pull_back((of_goal, jax.nn.relu(multipliers + w * excess)))
            objective, limited = values
            return point(scaled, objective, limited, data), gradient

        return jax.jit(jax.vmap(one, in_axes=(0, 0, 0, 0, None, None)))

    @cached_property
    def update(self) -> Wrapped:
        """Program: the next state, from the designs and gradients of this one."""
        return jax.jit(jax.vmap(self._update, in_axes=(0, 0, 0, None, None)))

    def _update(
        self, state: State, here: Point, gradient: Any, iteration: Any, data: ProblemData
    ) -> State:
        multipliers, weight = state.multipliers, state.weight

        def raised(limited: Any) -> Any:
            return jax.nn.relu(multipliers + weight * (limited / data.limits - 1))

        def lagrangian(objective: Any, limited: Any) -> Any:
            terms = (raised(limited) ** 2 - multipliers**2) / (2 * weight)
            return jnp.sum(terms) - objective / data.size

        def lagrangian_at(scaled: Any) -> Any:  # for line-search optimisers
            rows = self._rows(iteration, data.key)
            return lagrangian(*self.problem.values(jnp.clip(scaled, *data.box), data, rows))

        value = lagrangian(here.objective, here.limited)
        alive = state.alive & jnp.isfinite(value) & jnp.isfinite(gradient).all()
        slope = jnp.where(at_active_bound(state.scaled, gradient, data.box), 0.0, gradient)
        steps, memory = self.optimiser.update(
            slope, state.optimiser, state.scaled, value=value, grad=slope, value_fn=lagrangian_at
        )
        due = (iteration + 1) % _MULTIPLIERS_EVERY == 0
        lagging = here.violation > jnp.maximum(10 * data.tolerance, state.violation / 2)
        heavier = jnp.minimum(jnp.where(lagging, 2 * weight, weight), _LARGEST_WEIGHT)
        following = State(
            scaled=jnp.clip(state.scaled + steps, *data.box),
            optimiser=memory,
            multipliers=jnp.where(due, raised(here.limited), multipliers),
            weight=jnp.where(due, heavier, weight),
            violation=jnp.where(due, here.violation, state.violation),
            alive=alive,
        )
        kept = jax.tree.map(lambda new, old: jnp.where(alive, new, old), following, state)
        return kept._replace(alive=alive)

    def _rows(self, iteration: Any, key: Any) -> Any:
        """Indices of an iteration's minibatch: each epoch uses all earthquakes once, reshuffled.

        None if every iteration uses all earthquakes.
        """
        if self.per_epoch == 1:
            return None
        epoch, part = jnp.divmod(iteration, self.per_epoch)
        n = len(self.problem.ensemble)
        order = jax.random.permutation(jax.random.fold_in(key, epoch), n)
        return order[(part * self.batch + jnp.arange(self.batch)) % n]


def _given(state: State) -> tuple[Any, ...]:
    """The arguments of ``AugmentedLagrangian.gradient`` at a state."""
    return state.scaled, np.ones_like(state.weight), state.multipliers, state.weight


def at_active_bound(scaled: Any, gradient: Any, box: Any, within: float = 0.0) -> Any:
    """Variables at an active bound: the descent direction points out of the box."""
    low, high = box
    return ((scaled <= low + within) & (gradient > 0)) | (
        (scaled >= high - within) & (gradient < 0)
    )
