"""The damper and rods that keep two structures apart: a search by gradients from many starts."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import minimize, nnls
from tqdm.auto import tqdm

from jaxpound._checks import Rule, count, enforce, instance, number, positive, seed
from jaxpound._describe import describe, digest
from jaxpound.comparison import Comparison
from jaxpound.design_space import DesignSpace, spread_shares, start_shares
from jaxpound.ensembles import Ensemble
from jaxpound.objectives import Objective
from jaxpound.scheme import Scheme, TimeGrid
from jaxpound.search import (
    Given,
    Point,
    Search,
    Setting,
    State,
    evaluator,
    held,
    judged,
)
from jaxpound.simulation import demand
from jaxpound.store import replace_file
from jaxpound.structures import AdjacentStructures
from jaxpound.units import Scales

if TYPE_CHECKING:
    from optax import GradientTransformation

_SAVE_EVERY = 20  # iterations
_AT_BOUND = 0.005  # of the way between the bounds
_NEAR_LIMIT = 0.01  # of the limit
_POLISHING = 30  # steps at most
_NO_WEIGHT = 1e-6  # with which the Lagrangian's gradient is linear in the multipliers


class Progress(NamedTuple):
    """Where a search is, as a callback is told."""

    iteration: int
    objective: np.ndarray
    """Goal less penalties of every start, shape (s,); the larger the better."""
    violation: np.ndarray
    """By how much a limit is exceeded, at most, as a share of the limit, shape (s,)."""
    values: dict[str, np.ndarray]
    """The variables of every start, shape (s,) each."""
    best: float
    """Best objective within the limits so far; −∞ while there is none."""


class Landscape(NamedTuple):
    """Objective and violation over two variables, shape (n, n) each."""

    x: str
    y: str
    x_values: np.ndarray
    y_values: np.ndarray
    objective: np.ndarray
    violation: np.ndarray


class History(NamedTuple):
    """All that was met on the way; a start that was dropped stays where it was."""

    objective: np.ndarray
    """Shape (k, s): iterations and starts."""
    violation: np.ndarray
    """Shape (k, s)."""
    prices: np.ndarray
    """What is limited, shape (k, s, m)."""
    shares: np.ndarray
    """Where every start was between the bounds, shape (k, s, d)."""
    alive: np.ndarray
    """Whether a start was still finite, shape (k, s)."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Design:
    """The structures that a search ended with, and how it came there."""

    space: DesignSpace
    structures: AdjacentStructures
    """The design; dimensionless."""
    shares: np.ndarray
    """Where it is between the bounds, shape (d,)."""
    objective: float
    """Goal less penalties on the ensemble that it was made for."""
    prices: dict[str, float]
    """What is limited, by price."""
    objective_function: Objective
    history: History
    winner: int
    """The start that found it, from 0."""
    dropped: dict[int, int]
    """Starts that were dropped because something was not finite, and their last iterations."""
    active_bounds: dict[str, str]
    """Variables that stand at a bound, "low" or "high", because the objective would leave it."""
    gradient: dict[str, float]
    """Of the objective, with multipliers for the limits, by shares of the way between bounds."""
    gradient_norm: float
    """Of the gradient's components that no bound holds."""
    multipliers: dict[str, float]
    """What a relative change of each limit is worth, in the objective's unit."""
    limit_tolerance: float
    """By which share a limit may be exceeded."""
    stopped: str
    """Why the search ended."""
    simulations: int
    """Runs with their gradients, of iterations and polishing; line searches are not counted."""
    trained: Comparison
    """Before (the first start) and after, on the ensemble that it was made for."""
    fresh: Comparison | None
    """The same on earthquakes that it was not made for."""
    _evaluate: Callable[[np.ndarray, Ensemble], dict[str, np.ndarray]]
    _first: np.ndarray
    _ensemble: Ensemble

    @property
    def values(self) -> dict[str, float]:
        """The variables by path."""
        return {path: float(x) for path, x in self.space.values(jnp.asarray(self.shares)).items()}

    @property
    def start(self) -> dict[str, float]:
        """The variables before."""
        return {path: float(x) for path, x in self.space.values(jnp.asarray(self._first)).items()}

    def compare(self, ensemble: Ensemble) -> Comparison:
        """Before and after on other earthquakes."""
        instance("Design.compare", "ensemble", ensemble, Ensemble)
        require_apart("Design.compare", self.space, ensemble)
        return Comparison(
            self._evaluate(self._first, ensemble),
            self._evaluate(self.shares, ensemble),
            self.objective_function,
            self.trained.si,
        )

    def landscape(self, x: str, y: str, n: int = 15) -> Landscape:
        """Objective and violation over two variables, all others as designed.

        Parameters
        ----------
        x, y
            Paths of the variables.
        n
            Points along each, evenly spaced between the bounds as these are scaled.

        Raises
        ------
        ValueError
            If x or y is no variable, both are the same, or n < 2.
        """
        names = self.space.names
        for name, path in (("x", x), ("y", y)):
            if path not in names:
                raise ValueError(f"landscape: {name} = {path!r} must be one of {', '.join(names)}")
        if x == y:
            raise ValueError(f"landscape: x = y = {x!r} must be two variables")
        enforce("landscape", [Rule("n", n, count("landscape", "n", n) >= 2, "at least 2")])
        i, j = names.index(x), names.index(y)
        ticks, rows = np.linspace(0, 1, n), []
        for share in ticks:
            row = np.tile(self.shares, (n, 1))
            row[:, i], row[:, j] = ticks, share
            rows.append(row)
        at = np.concatenate(rows)
        found = [self._evaluate(shares, self._ensemble) for shares in at]
        function = self.objective_function
        objective = np.array([float(function.value(columns)) for columns in found])
        limits = np.array([limit.at_most for limit in function.limits.values()])
        prices = np.array([function.prices(columns) for columns in found])
        violation = (prices / limits - 1).max(axis=1, initial=0.0)
        values = jax.vmap(self.space.values)(jnp.asarray(at))
        shape = (n, n)
        return Landscape(
            x,
            y,
            np.asarray(values[x]).reshape(shape),
            np.asarray(values[y]).reshape(shape),
            objective.reshape(shape),
            violation.reshape(shape),
        )

    def __repr__(self) -> str:
        lines = [
            f"Design by start {self.winner + 1} of {self.history.objective.shape[1]}: objective "
            f"{self.objective:.6g} ({self.stopped}, {self.simulations:,} runs with gradient)"
        ]
        before = self.start
        for path, value in self.values.items():
            bound = self.active_bounds.get(path)
            at = f", at its {bound} bound" if bound else ""
            lines.append(f"    {path:18} {before[path]:10.5g} -> {value:10.5g}{at}")
        for price, limit in self.objective_function.limits.items():
            lines.append(
                f"    {price:18} {self.prices[price]:10.5g} of at most {limit.at_most:.5g}"
            )
        lines.append(f"    gradient within the bounds {self.gradient_norm:.2g}")
        for start, iteration in self.dropped.items():
            lines.append(f"    start {start + 1} dropped at iteration {iteration}: not finite")
        for words, comparison in (("trained on", self.trained), ("fresh:", self.fresh)):
            if comparison is not None:
                lines.append(f"{words} {comparison}")
        return "\n".join(lines)


def design_damper(
    space: DesignSpace,
    ensemble: Ensemble,
    grid: TimeGrid,
    scheme: Scheme = Scheme(),
    objective: Objective = Objective(),
    *,
    start: AdjacentStructures | Mapping[str, float] | None = None,
    starts: int = 4,
    key: int = 0,
    iterations: int = 150,
    optimiser: GradientTransformation | None = None,
    batch: int | None = None,
    patience: int = 40,
    tolerance: float = 1e-4,
    limit_tolerance: float = 1e-3,
    scales: Scales | None = None,
    fresh: int | Ensemble | None = 1000,
    save: str | PathLike[str] | None = None,
    callback: Callable[[Progress], Any] | None = None,
    progress: bool = True,
    polish: bool = True,
) -> Design:
    """The best structures within bounds and limits, over an ensemble of earthquakes.

    Parameters
    ----------
    space
        What may be chosen, within which bounds.
    ensemble
        The earthquakes.
    grid, scheme
        As of ``simulate``.
    objective
        What is to be achieved, at what price.
    start
        Where the first start is; by default the space's nominal structures.
    starts
        Their number: the others are spread over the space (scrambled Sobol points).
    key
        A seed, of the starts and of the minibatches.
    iterations
        At most.
    optimiser
        Of optax, for shares, from 0 to 1, of the way between the bounds; by default Adam with
        steps that fall from 0.2 to 0 (cosine). Those that search along lines, such as
        ``optax.lbfgs()``, will do.
    batch
        Earthquakes an iteration; by default all. Of a part, the best design is judged by all once
        every design has met each, and in the end; gradient and multipliers of the result are then
        means over such parts.
    patience, tolerance
        The search ends when no start has become better by ``tolerance``, as a share of the mean
        required gap, in ``patience`` iterations (of all earthquakes: epochs, if there is a batch).
    limit_tolerance
        By which share a limit may be exceeded.
    scales
        For an objective in SI units.
    fresh
        How many earthquakes to try the design on that it was not made for (where the ensemble is
        drawn), an ensemble of such, or None.
    save
        A file that keeps the state every 20 iterations: the same call goes on from there, and ends
        as if it had not been interrupted.
    callback
        Called with a ``Progress`` after every iteration; if it returns True, the search ends.
    progress
        Whether to show a progress bar.
    polish
        Whether the winner, if there are no minibatches, is brought to its optimum by at most 30
        steps of SciPy's sequential quadratic programming, with the same gradients.

    Returns
    -------
    Design

    Raises
    ------
    ValueError
        If an argument breaks its rule or the start is outside the bounds; if every start is not
        finite, with the reason; if no design within the limits was found, with the least by which
        they were exceeded; if the file holds another search.
    OSError
        If the file cannot be written to.
    """
    sought = Sought(
        space,
        ensemble,
        grid,
        scheme,
        objective,
        optimiser=optimiser,
        batch=batch,
        iterations=iterations,
        scales=scales,
    )
    return sought.search(
        start=start,
        starts=starts,
        key=key,
        patience=patience,
        tolerance=tolerance,
        limit_tolerance=limit_tolerance,
        fresh=fresh,
        save=save,
        callback=callback,
        progress=progress,
        polish=polish,
    )


class Sought:
    """A search that is set up; its program is compiled once, for any starts and limits."""

    def __init__(
        self,
        space: DesignSpace,
        ensemble: Ensemble,
        grid: TimeGrid,
        scheme: Scheme,
        objective: Objective,
        *,
        optimiser: GradientTransformation | None,
        batch: int | None,
        iterations: int,
        scales: Scales | None,
    ) -> None:
        import optax  # takes as long as all the rest

        instance(_OWNER, "space", space, DesignSpace)
        instance(_OWNER, "ensemble", ensemble, Ensemble)
        instance(_OWNER, "grid", grid, TimeGrid)
        instance(_OWNER, "scheme", scheme, Scheme)
        instance(_OWNER, "objective", objective, Objective)
        if scales is not None:
            instance(_OWNER, "scales", scales, Scales)
        self.iterations = count(_OWNER, "iterations", iterations)
        n = len(ensemble)
        batch = n if batch is None else count(_OWNER, "batch", batch)
        enforce(_OWNER, [Rule("batch", batch, batch <= n, f"at most the ensemble's {n}")])
        if optimiser is None:
            steps = optax.cosine_decay_schedule(0.2, self.iterations)
            optimiser = optax.adam(steps, b1=0.8, b2=0.9)
        instance(_OWNER, "optimiser", optimiser, optax.GradientTransformation)
        require_apart(_OWNER, space, ensemble)
        self.space, self.ensemble, self.objective = space, ensemble, objective
        self.setting = Setting(grid, scheme, scales)
        self.evaluate = evaluator(space, self.setting)
        self.move = Search(
            space, self.setting, objective, optax.with_extra_args_support(optimiser), n, batch
        )
        self._compiled: dict[int, tuple[Callable[..., Any], str]] = {}

    def search(
        self,
        *,
        start: AdjacentStructures | Mapping[str, float] | None,
        starts: int,
        key: int,
        patience: int,
        tolerance: float,
        limit_tolerance: float,
        fresh: int | Ensemble | None,
        save: str | PathLike[str] | None,
        callback: Callable[[Progress], Any] | None,
        progress: bool,
        polish: bool = True,
        limits: Mapping[str, float] | None = None,
    ) -> Design:
        """As of ``design_damper``; ``limits`` are bounds in the place of the objective's."""
        patience = count(_OWNER, "patience", patience)
        positive(_OWNER, limit_tolerance=number(_OWNER, "limit_tolerance", limit_tolerance))
        positive(_OWNER, tolerance=number(_OWNER, "tolerance", tolerance))
        first = start_shares(_OWNER, self.space, start)
        begun = spread_shares(first, count(_OWNER, "starts", starts), seed(_OWNER, "key", key))
        fresh = self._fresh(fresh)
        if save is not None and not Path(save).absolute().parent.is_dir():
            raise ValueError(f"{_OWNER}: save = {save} must be in a folder that exists")
        before = self.evaluate(first, self.ensemble)
        given = self._given(before, limits, limit_tolerance, key)
        state = self.move.begin(begun)
        if len(begun) not in self._compiled:
            self._compiled[len(begun)] = self.move.compiled(state, given)
        program, text = self._compiled[len(begun)]
        saved = None
        if save is not None:
            saved = _Saved(Path(save), _identity(self, text, given, begun))
            saved.require_numbers(state)
        state, met = (state, []) if saved is None else saved.read(state)
        state, stopped = self._run(
            program, state, given, met, saved, patience, tolerance, callback, progress
        )
        return self._design(program, state, met, stopped, first, before, given, fresh, polish)

    def _fresh(self, fresh: Any) -> Ensemble | None:
        """Earthquakes to try the design on."""
        if fresh is None:
            return None
        if not isinstance(fresh, Ensemble):
            return self.ensemble.fresh(count(_OWNER, "fresh", fresh))
        require_apart(_OWNER, self.space, fresh)
        return fresh

    def _given(self, before: Any, limits: Any, limit_tolerance: float, key: int) -> Given:
        own = {price: limit.at_most for price, limit in self.objective.limits.items()}
        at_most = {price: (limits or {}).get(price, x) for price, x in own.items()}
        size = getattr(self.objective.goal, "size", None)
        if size is None:
            required = np.mean(before["initial_gap"] - before["min_gap"])
            size = required if np.isfinite(required) and required > 0 else 1.0
        return Given(
            jax.tree.map(jnp.asarray, self.ensemble.grounds),
            {path: jnp.asarray(x) for path, x in self.ensemble.uncertain.items()},
            jnp.asarray([at_most[price] for price in own], float),
            jnp.asarray(size, float),
            jnp.asarray(limit_tolerance, float),
            jax.random.key(key, impl="threefry2x32"),
        )

    def _run(
        self,
        program: Callable[..., Any],
        state: State,
        given: Given,
        met: list[_Met],
        saved: _Saved | None,
        patience: int,
        tolerance: float,
        callback: Callable[[Progress], Any] | None,
        progress: bool,
    ) -> tuple[State, str]:
        per_epoch = -(-self.move.earthquakes // self.move.batch)
        with tqdm(
            total=self.iterations, initial=len(met), unit=" iterations", disable=not progress
        ) as bar:
            while True:
                if met and (reason := self._reason(met, patience * per_epoch, tolerance)):
                    break
                state, here = program(state, given)
                point, alive, best = jax.device_get((here, state.alive, state.best))
                met.append(
                    _Met(
                        point.shares,
                        point.objective,
                        point.violation,
                        point.prices,
                        alive,
                        best.infeasible,
                        best.merit,
                    )
                )
                if not alive.any():
                    self._refuse_all(best, met)
                if saved is not None and len(met) % _SAVE_EVERY == 0:
                    saved.write(state, met)
                told = float(np.where(alive & ~best.infeasible, best.objective, -np.inf).max())
                bar.update()
                bar.set_postfix({"objective": f"{told:.5g}"}, refresh=False)
                answer = callback and callback(self._progress(len(met), point, told))
                if isinstance(answer, bool | np.bool_) and answer:
                    reason = _CALLBACK
                    break
        if saved is not None:
            saved.write(state, met)
        return state, reason

    def _reason(self, met: list[_Met], patience: int, tolerance: float) -> str:
        """Why to stop, or nothing."""
        if len(met) >= self.iterations:
            return f"{self.iterations} iterations"
        if len(met) <= patience:
            return ""
        then, now = met[-1 - patience], met[-1]
        alive, within = now.alive, ~now.infeasible
        entered = then.infeasible & within
        gained = then.merit[alive] - now.merit[alive]
        if within[alive].any() and not entered[alive].any() and (gained < tolerance).all():
            return f"no progress in {patience} iterations"
        return ""

    def _progress(self, iteration: int, point: Point, best: float) -> Progress:
        values = jax.vmap(self.space.values)(jnp.asarray(point.shares))
        return Progress(
            iteration,
            point.objective,
            point.violation,
            {path: np.asarray(x) for path, x in values.items()},
            best,
        )

    def _refuse_all(self, best: Point, met: list[_Met]) -> None:
        """Say why no start is finite."""
        shares = met[-1].shares[0]
        columns = self.evaluate(shares, self.ensemble)
        bad = ~np.all([np.isfinite(x) for x in columns.values()], axis=0)
        reason = "its gradient is not finite"
        if bad.any():
            i = int(np.argmax(bad))
            reason = f"earthquake {i} of {len(bad)} gives no finite demand"
            others = {path: x[i] for path, x in self.ensemble.uncertain.items()}
            try:
                structures = self.space.structures(jnp.asarray(shares), others)
                demand(structures, self.ensemble.ground(i), self.setting.grid, self.setting.scheme)
            except (ValueError, FloatingPointError) as error:
                reason = f"earthquake {i}: {error}"
        told = ""
        if not best.infeasible.all():
            i = _least(best)
            values = self.space.values(jnp.asarray(best.shares[i]))
            listed = ", ".join(f"{path} = {float(x):.6g}" for path, x in values.items())
            told = f"; the best before was {float(best.objective[i]):.6g} at {listed}"
        raise ValueError(
            f"{_OWNER}: all {len(best.merit)} starts must be finite, but after {len(met) - 1} "
            f"iterations none is; of the first, {reason}{told}"
        )

    def _first_order(
        self, program: Callable[..., Any], shares: np.ndarray, starts: int, given: Given
    ) -> _FirstOrder:
        """Objective and prices with their derivatives, by the program of the search.

        Its gradient is linear in the multipliers where their weight is as good as nothing: one
        place for the objective, and one with a multiplier of 1 for each limit.
        """
        m = len(self.objective.limits)
        blocks = np.zeros((-(-(m + 1) // starts) * starts, m))
        blocks[1 : m + 1] = np.eye(m)
        parts = -(-self.move.earthquakes // self.move.batch)
        gradients, here = [], None
        for block in np.split(blocks, len(blocks) // starts):
            state = self.move.begin(np.tile(shares, (starts, 1)))
            state = state._replace(
                multipliers=jnp.asarray(block), weight=jnp.full(starts, _NO_WEIGHT)
            )
            seen = []
            for i in range(parts):
                _, here = program(state._replace(iteration=jnp.asarray(i)), given)
                seen.append(np.asarray(here.gradient))
            gradients.append(np.mean(seen, axis=0))
        goal, *with_one = np.concatenate(gradients)[: m + 1]
        slopes = np.reshape([one - goal for one in with_one], (m, shares.size))
        first = jax.device_get(jax.tree.map(lambda x: x[0], here))
        return _FirstOrder(first, goal, slopes)

    def _polished(
        self, program: Callable[..., Any], best: Point, winner: int, given: Given
    ) -> tuple[Point, int]:
        """The winner after SciPy's sequential quadratic programming, and how many runs it took."""
        starts, seen = len(best.merit), {}
        limits = np.asarray(given.limits, np.float64)

        def at(shares: np.ndarray) -> _FirstOrder:
            shares = np.clip(shares, 0.0, 1.0)
            if (key := shares.tobytes()) not in seen:
                seen[key] = self._first_order(program, shares, starts, given)
            return seen[key]

        def double(x: Any, otherwise: float = 0.0) -> np.ndarray:  # SciPy takes no other
            return np.nan_to_num(np.asarray(x, np.float64), nan=otherwise)

        constraint = {
            "type": "ineq",
            "fun": lambda x: double(1 - at(x).point.prices / limits, -1.0),
            "jac": lambda x: -double(at(x).slopes),
        }
        size, own = float(given.size), jax.tree.map(lambda x: x[winner], best)
        minimize(
            lambda x: float(double(-at(x).point.objective / size, _FAR)),
            double(own.shares),
            jac=lambda x: double(at(x).goal),
            bounds=[(0.0, 1.0)] * self.space.dimension,
            constraints=[constraint] if limits.size else (),
            method="SLSQP",
            options={"maxiter": _POLISHING, "ftol": 1e-10},
        )
        # Within the limits to rounding is better than a little above and a little better.
        allowance = np.array([_EXACT, *[float(given.tolerance)] * bool(limits.size)])
        blocks = -(-(limits.size + 1) // starts)
        runs = len(seen) * blocks * starts
        for excess in allowance:
            found = [one.point for one in seen.values() if np.isfinite(one.point.merit)]
            found = [point for point in found if point.violation <= excess]
            if found:
                least = min(found, key=lambda point: point.merit)
                worse = 5 * float(given.tolerance) if own.violation > excess else 0.0
                if own.infeasible or least.merit <= own.merit + worse:
                    return least, runs
        return own, runs

    def _multipliers(self, there: _FirstOrder, given: Given) -> tuple[np.ndarray, np.ndarray]:
        """Multipliers ≥ 0 of the limits that hold at a design, and the Lagrangian's gradient there.

        Those that leave the smallest gradient within the bounds (first-order conditions).
        """
        shares, goal, slopes = there.point.shares, there.goal, there.slopes.T
        holding = there.point.prices / np.asarray(given.limits) - 1 > -_NEAR_LIMIT
        free = ~held(shares, goal, _AT_BOUND)
        multipliers = np.zeros(holding.size)
        if holding.any():
            for _ in range(3):  # which bounds hold depends on the multipliers
                multipliers[holding] = nnls(slopes[free][:, holding], -goal[free])[0]
                free = ~held(shares, goal + slopes @ multipliers, _AT_BOUND)
        return multipliers, goal + slopes @ multipliers

    def _judged(self, best: Point, ends: np.ndarray, given: Given) -> Point:
        """The better of what was best and where the starts ended, in the whole ensemble."""
        rows = []
        for i, shares in enumerate(ends):
            columns = self.evaluate(shares, self.ensemble)
            end = judged(shares, columns, self.objective, given)
            own = jax.tree.map(lambda x, i=i: x[i], best)
            wins = (bool(end.infeasible), float(end.merit)) < (
                bool(own.infeasible),
                float(own.merit),
            )
            rows.append(end if wins else own)
        return jax.tree.map(lambda *x: np.stack(x), *rows)

    def _design(
        self,
        program: Callable[..., Any],
        state: State,
        met: list[_Met],
        stopped: str,
        first: np.ndarray,
        before: dict[str, np.ndarray],
        given: Given,
        fresh: Ensemble | None,
        polish: bool,
    ) -> Design:
        every, alive = jax.device_get((state.best, state.alive))
        whole = self.move.batch == self.move.earthquakes
        if not whole:
            every = self._judged(every, np.asarray(state.shares), given)
        winner, runs = _least(every, alive), 0
        best = jax.tree.map(lambda x: x[winner], every)
        if polish and whole and stopped != _CALLBACK:
            best, runs = self._polished(program, every, winner, given)
        limits = np.asarray(given.limits)
        prices = dict(zip(self.objective.limits, best.prices.tolist(), strict=True))
        if best.infeasible:
            worst = int(np.argmax(best.prices / limits))
            price = [*self.objective.limits][worst]
            raise InfeasibleError(
                f"{_OWNER}: limits must leave a design, but the closest that was found, in "
                f"{len(met)} iterations, has {price} = {prices[price]:.6g}, "
                f"{best.violation:.2%} above its limit {limits[worst]:.6g}"
            )
        shares, size = np.asarray(best.shares), float(given.size)
        there = self._first_order(program, shares, len(every.merit), given)._replace(point=best)
        multipliers, slope = self._multipliers(there, given)
        at_bound = held(shares, slope, _AT_BOUND)
        gradient, names = -size * slope, self.space.names
        sides = zip(names, at_bound, shares, strict=True)
        active = {name: "low" if share < 0.5 else "high" for name, at, share in sides if at}
        alive = np.array([one.alive for one in met])
        function = dataclasses.replace(
            self.objective,
            limits={
                price: dataclasses.replace(limit, at_most=float(x))
                for (price, limit), x in zip(self.objective.limits.items(), limits, strict=True)
                if x < NO_LIMIT
            },
        )
        si = self.setting.scales is not None
        objective = float(best.objective)
        after = self.evaluate(shares, self.ensemble)
        design = Design(
            space=self.space,
            structures=jax.tree.map(float, self.space.structures(jnp.asarray(shares))),
            shares=shares,
            objective=objective,
            prices=prices,
            objective_function=function,
            history=History(
                np.array([one.objective for one in met]),
                np.array([one.violation for one in met]),
                np.array([one.prices for one in met]),
                np.array([one.shares for one in met]),
                alive,
            ),
            winner=winner,
            dropped={i: int(np.argmin(alive[:, i])) for i in np.flatnonzero(~alive[-1]).tolist()},
            active_bounds=active,
            gradient=dict(zip(names, gradient.tolist(), strict=True)),
            gradient_norm=float(np.linalg.norm(gradient[~at_bound])),
            multipliers=dict(
                zip(self.objective.limits, (size * multipliers).tolist(), strict=True)
            ),
            limit_tolerance=float(given.tolerance),
            stopped=stopped,
            simulations=(len(met) * len(alive[0]) + runs) * self.move.batch,
            trained=Comparison(before, after, function, si),
            fresh=None,
            _evaluate=self.evaluate,
            _first=first,
            _ensemble=self.ensemble,
        )
        if fresh is None:
            return design
        return dataclasses.replace(design, fresh=design.compare(fresh))


_OWNER = "design_damper"
_CALLBACK = "the callback ended it"
_FAR = 1e6  # what is not finite, in units of size
_EXACT = 1e-9  # violation by rounding
NO_LIMIT = 1e30  # a limit that is none


class InfeasibleError(ValueError):
    """No design within the limits was found."""


def _least(best: Point, alive: Any = True) -> int:
    """The best start: alive, within the limits, of the least merit."""
    return int(
        np.lexsort((best.merit, best.infeasible, ~np.asarray(alive & (best.merit == best.merit))))[
            0
        ]
    )


class _Met(NamedTuple):
    """Where all starts were at an iteration, with a leading axis of starts."""

    shares: np.ndarray
    objective: np.ndarray
    violation: np.ndarray
    prices: np.ndarray
    alive: np.ndarray
    infeasible: np.ndarray  # the best so far
    merit: np.ndarray


class _FirstOrder(NamedTuple):
    """A place, with the gradient of what is to be made small and of prices over limits."""

    point: Point
    goal: np.ndarray  # (d,)
    slopes: np.ndarray  # (m, d)


class _Saved:
    """A file with the state of a search."""

    def __init__(self, path: Path, identity: dict[str, Any]) -> None:
        self.path, self.identity = path, json.dumps(identity, sort_keys=True)

    def require_numbers(self, state: State) -> None:
        """Refuse a state that a file of arrays cannot hold."""
        for leaf in jax.tree.leaves(state):
            if jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key):
                raise ValueError(f"{_OWNER}: save cannot keep an optimiser that draws at random")

    def read(self, state: State) -> tuple[State, list[_Met]]:
        """The state and what was met, or the state given where there is no file."""
        if not self.path.exists():
            return state, []
        try:
            with np.load(self.path, allow_pickle=False) as file:
                held = dict(file)
            theirs = str(held["identity"])
        except Exception as error:
            raise ValueError(f"{_OWNER}: save = {self.path} holds no search ({error})") from error
        if theirs != self.identity:
            ours = json.loads(self.identity)
            other = [k for k, x in json.loads(theirs).items() if ours.get(k) != x]
            raise ValueError(
                f"{_OWNER}: save = {self.path} holds another search: {', '.join(other)} differs"
            )
        leaves, structure = jax.tree.flatten(state)
        held_leaves = [jnp.asarray(held[f"state_{i}"]) for i in range(len(leaves))]
        state = jax.tree.unflatten(structure, held_leaves)
        met = [_Met(*rows) for rows in zip(*(held[name] for name in _Met._fields), strict=True)]
        return state, met

    def write(self, state: State, met: Sequence[_Met]) -> None:
        """Put state and history in the place of what the file held."""
        leaves = {f"state_{i}": np.asarray(x) for i, x in enumerate(jax.tree.leaves(state))}
        rows = {name: np.array([getattr(one, name) for one in met]) for name in _Met._fields}
        replace_file(self.path, {**leaves, **rows, "identity": np.array(self.identity)})


def _identity(sought: Sought, text: str, given: Given, begun: np.ndarray) -> dict[str, Any]:
    """What determines every number of a search."""
    told = {name: np.asarray(getattr(given, name)).tolist() for name in ("limits", "tolerance")}
    leaves = jax.tree.leaves((given.grounds, given.uncertain))
    return {
        "space": describe(sought.space),
        "setting": describe(sought.setting),
        "objective": describe(sought.objective),
        **told,
        "key": np.asarray(jax.random.key_data(given.key)).tolist(),
        "ensemble": [digest(np.asarray(x).tobytes()) for x in leaves],
        "starts": digest(begun.tobytes()),
        "program": digest(text.encode()),
    }


def require_apart(owner: str, space: DesignSpace, ensemble: Ensemble) -> None:
    """Refuse what is to be chosen and uncertain at once."""
    for path in ensemble.uncertain:
        if path in space.names:
            raise ValueError(f"{owner}: {path} must not be both chosen and uncertain")
        rod, _, name = path.partition(".")
        other = {"tau_f": f"{rod}.tau_x", "tau_x": f"{rod}.tau_f"}.get(name)
        if other in space.names:
            raise ValueError(f"{owner}: {other} must not be chosen where {path} is uncertain")
