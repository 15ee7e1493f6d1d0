"""The damper and rods that keep two structures apart: a search by gradients from many starts."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from tqdm.auto import tqdm

from jaxpound._checks import (
    Rule,
    count,
    enforce,
    instance,
    number,
    positive,
    refusal,
    require_memory,
    seed,
)
from jaxpound.design.comparison import Comparison
from jaxpound.design.design import Design, History
from jaxpound.design.ensemble import Ensemble
from jaxpound.design.objective import PRICES, Objective
from jaxpound.design.optimum import AT_BOUND, FirstOrderProgram
from jaxpound.design.saved import Met, SavedSearch, search_identity
from jaxpound.design.search import Given, Point, Search, Setting, State, evaluator, held, point
from jaxpound.design.space import DesignSpace, spread_shares, start_shares
from jaxpound.grid import TimeGrid
from jaxpound.ground.plausibility import far_apart, first_of, of_many, tell
from jaxpound.model.structures import AdjacentStructures
from jaxpound.simulation.run import demand
from jaxpound.simulation.scheme import Scheme
from jaxpound.units import Scales

if TYPE_CHECKING:
    from optax import GradientTransformation

NO_LIMIT = 1e30
"""A limit that is none."""

_OWNER = "design_damper"
_PATIENCE, _TOLERANCE, _LIMIT_TOLERANCE = 40, 1e-4, 1e-3
_SAVE_EVERY = 20  # iterations
_CALLBACK = "the callback ended it"


class InfeasibleError(ValueError):
    """No design within the limits was found."""


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
    patience: int = _PATIENCE,
    tolerance: float = _TOLERANCE,
    limit_tolerance: float = _LIMIT_TOLERANCE,
    scales: Scales | None = None,
    fresh: int | Ensemble | None = 1000,
    save: str | PathLike[str] | None = None,
    callback: Callable[[Progress], Any] | None = None,
    progress: bool = True,
    polish: bool = True,
    strict: bool = False,
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
    strict
        Whether what is only warned of is refused.

    Returns
    -------
    Design

    Raises
    ------
    ValueError
        If an argument breaks its rule, the start is outside the bounds, or memory has no room for
        so many starts or earthquakes; if every start is not finite, with the reason; if no design
        within the limits was found, with the least by which they were exceeded; if the file holds
        another search or is damaged; if ``strict``, also where there would be a warning.
    OSError
        If the file cannot be written to.

    Warns
    -----
    PlausibilityWarning
        Before the search: if, of the first 256 earthquakes, more than 1 % are not resolved by the
        grid (as of ``simulate``) or, where there are scales or records, have a PGA above 5 g; if
        the gap is more than 100 times what the buildings of the first start move.

    Examples
    --------
    >>> amplitude, periods = jp.LogNormal(0.1, 0.5), jp.Uniform(1.0, 3.8)
    >>> ground = jp.RandomRicker(2, amplitude, periods, arrivals=jp.Uniform(1.0, 7.0))
    >>> earthquakes = jp.Ensemble.drawn(jp.Scenarios(jp.paper.structures(), ground), 8)
    >>> design = jp.design_damper(
    ...     jp.DesignSpace(jp.paper.structures(), {"friction": (0.0, 1.0)}),
    ...     earthquakes,
    ...     jp.TimeGrid.until(20.0, dt=0.1),
    ...     objective=jp.Objective(limits={"damper_force": 0.3}),
    ...     starts=1,
    ...     iterations=5,
    ...     fresh=None,
    ...     progress=False,
    ... )
    >>> round(design.values["friction"], 2)  # all that the limit allows
    0.3
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
        strict=strict,
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
        strict=strict,
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
        strict: bool = False,
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
        space.require_certain(_OWNER, ensemble.uncertain)
        first = first_of(n, grid)
        grounds = jax.tree.map(lambda x: x[:first], ensemble.grounds)
        tell(_OWNER, of_many(grounds, grid, in_g=scales is not None), strict)
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
        progress: bool,
        patience: int = _PATIENCE,
        tolerance: float = _TOLERANCE,
        limit_tolerance: float = _LIMIT_TOLERANCE,
        fresh: int | Ensemble | None = None,
        save: str | PathLike[str] | None = None,
        callback: Callable[[Progress], Any] | None = None,
        polish: bool = True,
        strict: bool = False,
        limits: Mapping[str, float] | None = None,
    ) -> Design:
        """As of ``design_damper``; ``limits`` are bounds in the place of the objective's."""
        patience = count(_OWNER, "patience", patience)
        positive(_OWNER, limit_tolerance=number(_OWNER, "limit_tolerance", limit_tolerance))
        positive(_OWNER, tolerance=number(_OWNER, "tolerance", tolerance))
        first = start_shares(_OWNER, self.space, start)
        starts = count(_OWNER, "starts", starts)
        # At least every start's variables, and the demands of its earthquakes, which run at once.
        each = self.space.dimension + self.move.batch * len(PRICES)
        require_memory(_OWNER, "starts", starts, starts * each * first.dtype.itemsize)
        begun = spread_shares(first, starts, seed(_OWNER, "key", key))
        fresh = self._fresh(fresh)
        if save is not None and not Path(save).absolute().parent.is_dir():
            raise ValueError(f"{_OWNER}: save = {save} must be in a folder that exists")
        before = self.evaluate(first, self.ensemble)
        gap, moved = before["initial_gap"].min(), (before["peak_x1"] + before["peak_x2"]).max()
        si = self.setting.scales is not None
        tell(_OWNER, far_apart("initial_gap", gap, moved, si=si), strict)
        given = self._given(before, limits, limit_tolerance, key)
        state = self.move.begin(begun)
        if len(begun) not in self._compiled:
            self._compiled[len(begun)] = self.move.compiled(state, given)
        program, text = self._compiled[len(begun)]
        saved = None
        if save is not None:
            saved = SavedSearch(Path(save), search_identity(self.move, text, given, begun))
        try:
            state, met = (state, []) if saved is None else saved.read(state)
        except ValueError as error:
            raise ValueError(f"{_OWNER}: {error}") from error
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
        self.space.require_certain(_OWNER, fresh.uncertain)
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
        met: list[Met],
        saved: SavedSearch | None,
        patience: int,
        tolerance: float,
        callback: Callable[[Progress], Any] | None,
        progress: bool,
    ) -> tuple[State, str]:
        patience *= self.move.per_epoch
        with tqdm(
            total=self.iterations, initial=len(met), unit=" iterations", disable=not progress
        ) as bar:
            while True:
                if met and (reason := self._reason(met, patience, tolerance)):
                    break
                state, here, _ = program(state, given)
                here, alive, best = jax.device_get((here, state.alive, state.best))
                met.append(Met.at(here, alive, best))
                if not alive.any():
                    self._refuse_all(best, met)
                if saved is not None and len(met) % _SAVE_EVERY == 0:
                    saved.write(state, met)
                told = float(np.where(alive & ~best.infeasible, best.objective, -np.inf).max())
                bar.update()
                if np.isfinite(told):  # else nothing within the limits was found yet
                    bar.set_postfix({"objective": f"{told:.5g}"}, refresh=False)
                answer = callback and callback(self._progress(len(met), here, told))
                if isinstance(answer, bool | np.bool_) and answer:
                    reason = _CALLBACK
                    break
        if saved is not None:
            saved.write(state, met)
        return state, reason

    def _reason(self, met: list[Met], patience: int, tolerance: float) -> str:
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

    def _progress(self, iteration: int, here: Point, best: float) -> Progress:
        values = self.space.numbers(here.shares)
        return Progress(iteration, here.objective, here.violation, values, best)

    def _refuse_all(self, best: Point, met: list[Met]) -> None:
        """Say why no start is finite."""
        shares = met[-1].shares[0]
        columns = self.evaluate(shares, self.ensemble)
        bad = ~np.all([np.isfinite(x) for x in columns.values()], axis=0)
        reason = "its gradient is not finite"
        if bad.any():
            i = int(np.argmax(bad))
            reason = f"earthquake {i} of {len(bad)} gives no finite demand"
            others = {path: x[i] for path, x in self.ensemble.uncertain.items()}
            setting, ground = self.setting, self.ensemble.ground(i)

            def run() -> Any:
                structures = self.space.structures(jnp.asarray(shares), others)
                return demand(structures, ground, setting.grid, setting.scheme)

            if said := refusal(run):
                reason = f"earthquake {i}: {said}"
        told = ""
        if not best.infeasible.all():
            i = _least(best)
            values = self.space.numbers(best.shares[i])
            listed = ", ".join(f"{path} = {float(x):.6g}" for path, x in values.items())
            told = f"; the best before was {float(best.objective[i]):.6g} at {listed}"
        raise ValueError(
            f"{_OWNER}: all {len(best.merit)} starts must be finite, but after {len(met) - 1} "
            f"iterations none is; of the first, {reason}{told}"
        )

    def _judged(self, best: Point, ends: np.ndarray, given: Given) -> Point:
        """The better of what was best and where the starts ended, in the whole ensemble."""
        rows = []
        for i, shares in enumerate(ends):
            columns, function = self.evaluate(shares, self.ensemble), self.objective
            values = function.value(columns), function.prices(columns)
            end = jax.device_get(point(shares, *values, given))
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
        met: list[Met],
        stopped: str,
        first: np.ndarray,
        before: dict[str, np.ndarray],
        given: Given,
        fresh: Ensemble | None,
        polish: bool,
    ) -> Design:
        every, alive = jax.device_get((state.best, state.alive))
        whole = self.move.per_epoch == 1
        if not whole:
            every = self._judged(every, np.asarray(state.shares), given)
        winner = _least(every, alive)
        best = jax.tree.map(lambda x: x[winner], every)
        conditions, runs = FirstOrderProgram(self.move, program, len(alive), given), 0
        if polish and whole and stopped != _CALLBACK:
            best, runs = conditions.polished(best)
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
        there = conditions.at(shares)._replace(point=best)
        multipliers, slope = conditions.multipliers(there)
        at_bound = held(shares, slope, AT_BOUND)
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
                *(np.array([getattr(one, name) for one in met]) for name in History._fields)
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


def _least(best: Point, alive: Any = True) -> int:
    """The best start: alive, within the limits, of the least merit."""
    lost = ~(alive & np.isfinite(best.merit))
    return int(np.lexsort((best.merit, best.infeasible, lost))[0])
