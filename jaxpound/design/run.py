"""The damper and rods that keep two structures apart: a search by gradients from many starts."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from os import PathLike
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound._checks import Rule, count, enforce, require_memory
from jaxpound.design.design import Comparison, Design, History
from jaxpound.design.ensemble import Ensemble
from jaxpound.design.lagrangian import AugmentedLagrangian, at_active_bound
from jaxpound.design.objective import Limit, Objective
from jaxpound.design.optimum import AT_BOUND
from jaxpound.design.problem import OWNER, DesignProblem
from jaxpound.design.rare_limits import limit_states
from jaxpound.design.rounds import searched, searched_in_rounds
from jaxpound.design.search import Iterate, Progress, SearchOptions
from jaxpound.design.space import DesignSpace, start_shares
from jaxpound.grid import TimeGrid
from jaxpound.ground.plausibility import first_of, of_many, tell
from jaxpound.model.structures import AdjacentStructures
from jaxpound.model.system import Structures
from jaxpound.simulation.scheme import Scheme
from jaxpound.study.demands import unreached
from jaxpound.units import Scales

if TYPE_CHECKING:
    from optax import GradientTransformation

NO_LIMIT = 1e30
"""A bound that stands for no limit."""


class InfeasibleError(ValueError):
    """No design within the limits was found."""


def design_damper(
    space: DesignSpace,
    ensemble: Ensemble,
    grid: TimeGrid,
    scheme: Scheme = Scheme(),
    objective: Objective = Objective(),
    *,
    start: Structures | Mapping[str, float] | None = None,
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
    strict: bool = False,
) -> Design:
    """The best structures within bounds and limits, over an ensemble of earthquakes.

    Parameters
    ----------
    space
        The variables and their bounds, of a pair, a ``Row`` or any ``System``. Dampers are placed
        by ``{"links.*.friction": (0.0, largest)}`` and a limit on ``total_damper_force``, the
        budget that they share.
    ensemble
        The earthquakes.
    grid, scheme
        See ``simulate``.
    objective
        The goal, with penalties and limits. Where no gap at rest is finite (braces alone, say) the
        goal must be ``LeastDemand``, the response that is to be least.
    start
        The design of the first start; by default the space's nominal structures.
    starts
        Number of starts: the others are spread over the space (scrambled Sobol points).
    key
        Seed of the starts and of the minibatches.
    iterations
        Largest number of iterations.
    optimiser
        An optimiser of optax, for the variables scaled to 0 to 1 between their bounds; by default
        Adam with steps that fall from 0.2 to 0 (cosine). Line-search optimisers such as
        ``optax.lbfgs()`` work too.
    batch
        Earthquakes of an iteration; by default all. With minibatches, the best design is evaluated
        on the whole ensemble once per epoch and at the end, and there is no polishing; gradient and
        multipliers of the result are means over the minibatches of an epoch.
    patience, tolerance
        The search ends when in ``patience`` iterations (with minibatches: epochs) no start has
        improved by ``tolerance`` times the size of the goal: the mean required gap, or the demand
        that is to be least.
    limit_tolerance
        Relative excess over a limit that is tolerated.
    scales
        Given for an objective in SI units.
    fresh
        Earthquakes that were not used in the search, on which the design is evaluated: their number
        (if the ensemble is drawn), an ensemble, or None.
    save
        A file that keeps the state every 20 iterations: the same call goes on from there, and ends
        as if it had not been interrupted.
    callback
        Called with a ``Progress`` after every iteration; if it returns True, the search ends.
    progress
        Whether to show a progress bar.
    polish
        Whether the best design is refined by at most 30 steps of SciPy's sequential quadratic
        programming, with the same gradients.
    strict
        Whether a ``PlausibilityWarning`` is raised as a ``ValueError``.

    Returns
    -------
    Design

    Raises
    ------
    ValueError
        If an argument breaks its rule, the start is outside the bounds, or memory has no room for
        so many starts or earthquakes; if no start stays finite, with the reason; if no design
        within the limits was found, with the smallest excess; if the file holds another search or
        is damaged; if ``strict``, also where there would be a warning.
    OSError
        If the file cannot be written to.

    Warns
    -----
    PlausibilityWarning
        Before the search: if, of the first 256 earthquakes, more than 1 % are not resolved by the
        grid (see ``simulate``) or, where there are scales or records, have a PGA above 5 g; if the
        gap of a link is more than 100 times the displacements at its ends (peak |x1| + peak |x2|)
        of the first start.

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
    problem = DesignProblem(space, ensemble, grid, scheme, objective, scales)
    options = SearchOptions(
        starts=starts,
        key=key,
        iterations=iterations,
        optimiser=optimiser,
        batch=batch,
        patience=patience,
        tolerance=tolerance,
        limit_tolerance=limit_tolerance,
        save=save,
        callback=callback,
        progress=progress,
        polish=polish,
    )
    return Designer(problem, options, strict).design(start, fresh=fresh)


class Designer:
    """A problem and its solver; programs are compiled once, for any starts and limits."""

    def __init__(
        self, problem: DesignProblem, options: SearchOptions, strict: bool = False
    ) -> None:
        import optax  # takes as long as all the rest

        self.problem, self.options, self.strict = problem, options, strict
        n = len(problem.ensemble)
        batch = n if options.batch is None else options.batch
        enforce(OWNER, [Rule("batch", batch, batch <= n, f"at most the ensemble's {n}")])
        # At least the variables of every start, and the demands of its earthquakes, run at once.
        each = problem.space.dimension + batch * len(problem.prices)
        size = options.starts * each * jnp.zeros(()).dtype.itemsize
        require_memory(OWNER, "starts", options.starts, size)
        self.states = limit_states(problem)
        first = first_of(n, problem.grid)
        grounds = jax.tree.map(lambda x: x[:first], problem.ensemble.grounds)
        tell(OWNER, of_many(grounds, problem.grid, in_g=problem.scales is not None), strict)
        optimiser = options.optimiser
        if optimiser is None:
            steps = optax.cosine_decay_schedule(0.2, options.iterations)
            optimiser = optax.adam(steps, b1=0.8, b2=0.9)
        optimiser = optax.with_extra_args_support(optimiser)
        self.lagrangian = AugmentedLagrangian(problem, optimiser, batch)

    def design(
        self,
        start: Structures | Mapping[str, float] | None = None,
        *,
        fresh: int | Ensemble | None = None,
        limits: Mapping[str, float] | None = None,
    ) -> Design:
        """See ``design_damper``; ``limits`` replace bounds of the objective's limits."""
        problem, options = self.problem, self.options
        first = start_shares(OWNER, problem.space, start)
        fresh = self._fresh(fresh)
        before = problem.evaluate(first, problem.ensemble)
        topology = problem.space.nominal.system().topology
        findings = unreached(
            topology,
            lambda name: float(np.min(before.get(name, np.inf))),
            lambda name: float(np.max(before[name])),
            pair=isinstance(problem.space.nominal, AdjacentStructures),
            si=problem.scales is not None,
        )
        tell(OWNER, findings, self.strict)
        data = problem.data(before, options.limit_tolerance, options.key, limits)
        posed = self.lagrangian, options, data, first
        found = searched_in_rounds(*posed, self.states) if self.states else searched(*posed)
        own, history, limits_of = found.own, found.history, problem.objective.limits
        bounds, events = np.asarray(data.limits), found.rare.events
        prices = {
            name: float(x) if limit.probability is None else events[name].probability
            for (name, limit), x in zip(limits_of.items(), own.limited, strict=True)
        }
        if own.infeasible:
            n = f"{len(history)} iterations"
            said = _excess(prices, dict(zip(limits_of, bounds.tolist(), strict=True)), limits_of)
            rule = f"limits must leave a design, but the closest that was found, in {n}, has {said}"
            raise InfeasibleError(f"{OWNER}: {rule}")
        si = problem.scales is not None
        function = _limited(problem.objective, bounds.tolist())
        multipliers, slope = found.conditions.multipliers(own)
        active = at_active_bound(own.scaled, slope, np.asarray(data.box), AT_BOUND)
        after = problem.evaluate(own.scaled, problem.ensemble)
        size, names = float(data.size), problem.space.names
        design = Design(
            structures=jax.tree.map(float, problem.space.structures(jnp.asarray(own.scaled))),
            shares=np.asarray(own.scaled),
            objective=float(own.objective),
            prices=prices,
            events=events,
            objective_function=function,
            history=_history(history, [*limits_of.values()]),
            winner=found.winner,
            active_bounds={
                names[i]: "low" if own.scaled[i] < 0.5 else "high" for i in np.flatnonzero(active)
            },
            gradient=dict(zip(names, (-size * slope).tolist(), strict=True)),
            multipliers=dict(zip(limits_of, (size * multipliers).tolist(), strict=True)),
            limit_tolerance=options.limit_tolerance,
            stopped=found.stopped,
            simulations=(len(history) * options.starts + found.polishing) * self.lagrangian.batch,
            trained=Comparison(before, after, function, si, topology),
            fresh=None,
            _first=first,
            _problem=problem,
            _log_ratios=found.rare.log_ratios,
        )
        return design if fresh is None else replace(design, fresh=design.compare(fresh))

    def _fresh(self, fresh: Any) -> Ensemble | None:
        """Earthquakes that the search does not use, to evaluate the design."""
        if fresh is None:
            return None
        if not isinstance(fresh, Ensemble):
            return self.problem.ensemble.fresh(count(OWNER, "fresh", fresh))
        self.problem.space.require_certain(OWNER, fresh.uncertain)
        return fresh


def _excess(
    reached: Mapping[str, float], bounds: Mapping[str, float], limits: Mapping[str, Limit]
) -> str:
    """The limit that is exceeded most, in words."""
    rare = {name: limit for name, limit in limits.items() if limit.probability is not None}
    most = {**bounds, **{name: limit.most for name, limit in rare.items()}}
    worst = max(reached, key=lambda name: reached[name] / most[name])
    if worst in rare:
        return f"{rare[worst].event(worst)} = {reached[worst]:.4g}, above its limit {most[worst]:g}"
    excess = reached[worst] / most[worst] - 1
    return f"{worst} = {reached[worst]:.6g}, {excess:.2%} above its limit {most[worst]:.6g}"


def _limited(objective: Objective, bounds: Sequence[float]) -> Objective:
    """An objective with other bounds, without those limits that bound nothing."""
    limits = {
        name: limit if limit.probability is not None else replace(limit, at_most=bound)
        for (name, limit), bound in zip(objective.limits.items(), bounds, strict=True)
        if bound < NO_LIMIT
    }
    return replace(objective, limits=limits)


def _history(met: Sequence[Iterate], limits: Sequence[Limit]) -> History:
    here = jax.tree.map(lambda *rows: np.array(rows), *[one.here for one in met])
    reached = [limit.reached(here.limited[..., i]) for i, limit in enumerate(limits)]
    return History(
        objective=here.objective,
        violation=here.violation,
        prices=np.stack(reached, axis=-1) if limits else here.limited,
        shares=here.scaled,
        alive=np.array([one.alive for one in met]),
    )
