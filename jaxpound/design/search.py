"""One step of a design search, compiled: an objective and its gradient at many designs at once.

Limits are kept by an augmented Lagrangian (Nocedal and Wright 2006, section 17.3): with
c = price / limit − 1, J the objective to be made small, multipliers λ ≥ 0 and a weight w, an
optimiser makes J + Σ (max(0, λ + w c)² − λ²) / 2 w small, and now and then λ becomes
max(0, λ + w c). Bounds are kept by projection.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound.design.ensemble import Ensemble
from jaxpound.design.objective import PRICES, Objective
from jaxpound.design.space import DesignSpace
from jaxpound.grid import TimeGrid
from jaxpound.model.structures import AdjacentStructures
from jaxpound.simulation.batches import in_chunks
from jaxpound.simulation.run import demand
from jaxpound.simulation.scheme import Scheme
from jaxpound.units import Scales

if TYPE_CHECKING:
    from optax import GradientTransformationExtraArgs

_MULTIPLIERS_EVERY = 10  # iterations
_FIRST_WEIGHT, _LARGEST_WEIGHT = 10.0, 100.0  # heavier ones make steps and multipliers swing


class Point(NamedTuple):
    """A design that was met: arrays with a leading axis of starts."""

    shares: Any  # (s, d)
    infeasible: Any  # whether a limit is exceeded
    merit: Any  # to be made small: the violation if infeasible, else minus the objective over size
    objective: Any  # as the user sees it: goal less penalties
    violation: Any  # the largest c, or 0
    prices: Any  # (s, m)


class State(NamedTuple):
    """Where all starts are; arrays with a leading axis of starts."""

    shares: Any  # (s, d)
    optimiser: Any
    multipliers: Any  # (s, m)
    weight: Any  # (s,)
    violated: Any  # largest violation when multipliers last changed
    alive: Any
    best: Point
    iteration: Any


class Given(NamedTuple):
    """What a step is told beside the state; other numbers need no other program."""

    grounds: Any
    uncertain: Any
    limits: Any  # (m,)
    size: Any  # a number of the order of the objective, that makes it a pure number
    tolerance: Any  # largest violation that is none
    key: Any  # of minibatches


@dataclasses.dataclass(frozen=True)
class Setting:
    """How an earthquake is run, and in which units its demands are told."""

    grid: TimeGrid
    scheme: Scheme
    scales: Scales | None

    def demands(self, structures: AdjacentStructures, ground: Any) -> dict[str, jax.Array]:
        """Prices, smallest gap and gap at rest of structures in one earthquake."""
        found = demand(structures, ground, self.grid, self.scheme)
        gap, slip_force = structures.initial_gap, structures.friction
        if self.scales is not None:
            found = self.scales.to_si(found)
            gap, slip_force = gap * self.scales.length, slip_force * self.scales.force
        own = {"residual_offset": jnp.abs(found.residual_offset), "damper_force": slip_force}
        columns = {name: own.get(name, getattr(found, name, None)) for name in PRICES}
        rest = {"min_gap": found.min_gap, "initial_gap": gap}
        return {name: jnp.asarray(x, found.min_gap.dtype) for name, x in (columns | rest).items()}


@dataclasses.dataclass(frozen=True)
class Search:
    """What a design is sought for, and how; ``move`` is one iteration."""

    space: DesignSpace
    setting: Setting
    objective: Objective
    optimiser: GradientTransformationExtraArgs
    earthquakes: int
    batch: int  # earthquakes of an iteration

    @property
    def per_epoch(self) -> int:
        """Iterations in which every earthquake is met."""
        return -(-self.earthquakes // self.batch)

    def values(self, shares: Any, rows: Any, given: Given) -> tuple[jax.Array, jax.Array]:
        """Objective and prices of a design in some earthquakes, or in all (rows None)."""
        grounds, uncertain = given.grounds, given.uncertain
        if rows is not None:
            grounds, uncertain = jax.tree.map(lambda x: x[rows], (grounds, uncertain))

        def run(ground: Any, others: Any) -> dict[str, jax.Array]:
            return self.setting.demands(self.space.structures(shares, others), ground)

        found = jax.vmap(run)(grounds, uncertain)
        return self.objective.value(found), self.objective.prices(found)

    def merit(self, shares: Any, multipliers: Any, weight: Any, rows: Any, given: Given) -> Any:
        """The Lagrangian in units of size, and (objective, prices)."""
        objective, prices = self.values(shares, rows, given)
        pull = jax.nn.relu(multipliers + weight * (prices / given.limits - 1))
        extra = jnp.sum(pull**2 - multipliers**2) / (2 * weight)
        return extra - objective / given.size, (objective, prices)

    def begin(self, shares: np.ndarray) -> State:
        """The state of starts, shape (s, d)."""
        s, m = len(shares), len(self.objective.limits)
        places, far = jnp.asarray(shares), jnp.full(s, jnp.inf)
        best = Point(places, jnp.ones(s, bool), far, -far, far, jnp.zeros((s, m)))
        return State(
            places,
            jax.vmap(self.optimiser.init)(places),
            jnp.zeros((s, m)),
            jnp.full(s, _FIRST_WEIGHT),
            far,
            jnp.ones(s, bool),
            best,
            jnp.asarray(0),
        )

    def move(self, state: State, given: Given) -> tuple[State, Point, jax.Array]:
        """The next state; where all starts were, and the Lagrangian's gradient by shares there."""
        whole = self.per_epoch == 1
        rows = None if whole else self._rows(state.iteration, given.key)

        def one(state: State) -> tuple[State, Point, jax.Array]:
            return self._move_one(state, rows, given)

        axes = State(0, 0, 0, 0, 0, 0, Point(*[0] * len(Point._fields)), None)
        following, here, slopes = jax.vmap(one, in_axes=(axes,), out_axes=(axes, 0, 0))(state)
        if whole:
            best = _better(state.best, here, following.alive)
        else:
            # The objective of a part is noise: what is best is judged by all, once an epoch.
            def judge() -> Point:
                there = jax.vmap(
                    lambda shares: point(shares, *self.values(shares, None, given), given)
                )(here.shares)
                return _better(state.best, there, following.alive)

            due = state.iteration % self.per_epoch == 0
            best = jax.lax.cond(due, judge, lambda: state.best)
        return following._replace(best=best, iteration=state.iteration + 1), here, slopes

    def _rows(self, iteration: Any, key: Any) -> Any:
        """A part of the ensemble: all are met once an epoch, in another order each time."""
        epoch, part = jnp.divmod(iteration, self.per_epoch)
        order = jax.random.permutation(jax.random.fold_in(key, epoch), self.earthquakes)
        first = part * self.batch
        return order[(first + jnp.arange(self.batch)) % self.earthquakes]

    def _move_one(self, state: State, rows: Any, given: Given) -> tuple[State, Point, jax.Array]:
        multipliers, weight = state.multipliers, state.weight

        def merit(shares: Any) -> Any:
            return self.merit(jnp.clip(shares, 0, 1), multipliers, weight, rows, given)[0]

        shares = state.shares
        (value, (objective, prices)), gradient = jax.value_and_grad(self.merit, has_aux=True)(
            shares, multipliers, weight, rows, given
        )
        here = point(shares, objective, prices, given)
        alive = state.alive & jnp.isfinite(value) & jnp.isfinite(gradient).all()
        slope = jnp.where(held(shares, gradient), 0.0, gradient)
        updates, memory = self.optimiser.update(
            slope, state.optimiser, shares, value=value, grad=slope, value_fn=merit
        )

        due = (state.iteration + 1) % _MULTIPLIERS_EVERY == 0
        raised = jax.nn.relu(multipliers + weight * (prices / given.limits - 1))
        lagging = here.violation > jnp.maximum(10 * given.tolerance, state.violated / 2)
        heavier = jnp.minimum(jnp.where(lagging, 2 * weight, weight), _LARGEST_WEIGHT)
        following = state._replace(
            shares=jnp.clip(shares + updates, 0, 1),
            optimiser=memory,
            multipliers=jnp.where(due, raised, multipliers),
            weight=jnp.where(due, heavier, weight),
            violated=jnp.where(due, here.violation, state.violated),
        )
        kept = jax.tree.map(lambda new, old: jnp.where(alive, new, old), following, state)
        return kept._replace(alive=alive, iteration=state.iteration), here, gradient

    def compiled(self, state: State, given: Given) -> tuple[Callable[..., Any], str]:
        """``move`` as a program, and its text."""
        lowered = jax.jit(self.move).lower(state, given)
        return lowered.compile(), lowered.as_text()


def held(shares: Any, gradient: Any, within: float = 0.0) -> Any:
    """Which shares a bound holds: what is to be made small would have them leave."""
    return ((shares <= within) & (gradient > 0)) | ((shares >= 1 - within) & (gradient < 0))


def point(shares: Any, objective: Any, prices: Any, given: Given) -> Point:
    """A design with its objective and prices, and what these mean for the search."""
    violation = jnp.max(prices / given.limits - 1, initial=0.0)
    infeasible = ~(violation <= given.tolerance)
    merit = jnp.where(infeasible, violation, -objective / given.size)
    return Point(shares, infeasible, merit, objective, violation, prices)


def _better(old: Point, new: Point, alive: Any) -> Point:
    """The better one of each start: within the limits first, then the smaller merit."""
    nearer = (new.infeasible == old.infeasible) & (new.merit < old.merit)
    wins = alive & ((old.infeasible & ~new.infeasible & jnp.isfinite(new.merit)) | nearer)

    def pick(a: Any, b: Any) -> Any:
        return jnp.where(wins.reshape(-1, *[1] * (a.ndim - 1)), b, a)

    return jax.tree.map(pick, old, new)


def evaluator(
    space: DesignSpace, setting: Setting
) -> Callable[[np.ndarray, Ensemble], dict[str, np.ndarray]]:
    """From shares and an ensemble to columns of demands; one program for all designs."""
    run: Any = in_chunks(
        lambda shares, ground, others: setting.demands(space.structures(shares, others), ground)
    )

    def evaluate(shares: np.ndarray, ensemble: Ensemble) -> dict[str, np.ndarray]:
        every = np.tile(shares, (len(ensemble), 1))
        found = run(every, ensemble.grounds, dict(ensemble.uncertain))
        return {name: found[name] for name in ("min_gap", "initial_gap", *PRICES)}

    return evaluate
