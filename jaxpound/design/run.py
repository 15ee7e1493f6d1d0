"""Optimal dampers and rods: a search by gradients from many starts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from os import PathLike
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from jaxpound._checks import Rule, count, enforce, instance, require_memory
from jaxpound._errors import InvalidInput, caller, resumable, warn
from jaxpound.design.design import Comparison, Design, SearchHistory
from jaxpound.design.ensemble import Ensemble
from jaxpound.design.lagrangian import AugmentedLagrangian
from jaxpound.design.objective import Objective
from jaxpound.design.problem import DesignProblem
from jaxpound.design.rare_limits import limit_states, search_in_rounds
from jaxpound.design.search import Descent, DesignSearch
from jaxpound.design.space import DesignSpace, start_shares
from jaxpound.grid import TimeGrid
from jaxpound.ground.plausibility import of_many
from jaxpound.model.system import Structures, gravity_of
from jaxpound.simulation.scheme import Scheme, imprecise
from jaxpound.study.demands import unreached

NO_LIMIT = 1e30  # a bound that stands for no limit


class InfeasibleError(ValueError):
    """No design within the limits was found."""


@resumable("save")
def design_damper(
    space: DesignSpace,
    ensemble: Ensemble,
    grid: TimeGrid,
    scheme: Scheme = Scheme(),
    objective: Objective = Objective(),
    *,
    search: DesignSearch = DesignSearch(),
    fresh: int | Ensemble | None = 1000,
    save: str | PathLike[str] | None = None,
    progress: bool = True,
    strict: bool = False,
) -> Design:
    """The best structures within bounds and limits, over an ensemble of earthquakes.

    Raises ``ValueError`` if the start is outside the bounds, or memory has no room; if no start
    stays finite, with the reason; if no design within the limits was found, with the smallest
    excess; if the file holds another search or is damaged. ``OSError`` if it cannot be written to.

    Warns with ``PlausibilityWarning`` before the search: if, of the first 256 earthquakes, more
    than 1 % are not resolved by the grid (see ``simulate``) or, in SI or of records, have a PGA
    above 5 g; if contact is run in single precision; if the gap of a link is more than 100 times
    the displacements at its ends (peak |x1| + peak |x2|) of the first start.

    Parameters
    ----------
    space
        The variables and their bounds. Dampers are placed by ``{"links.*.friction": (0.0,
        largest)}``, viscous ones of ``Buildings`` by ``"links.*.damper.material.force"``, and a
        limit on ``total_damper_force``, the budget that they share.
    ensemble
        The earthquakes.
    grid, scheme, strict
        See ``simulate``.
    objective
        The goal, with penalties and limits. Where no gap at rest is finite (braces alone, say) the
        goal must be ``LeastDemand``.
    search
        Where the search starts, how long it lasts, and its optimiser.
    fresh
        Earthquakes that were not used in the search, on which the design is evaluated: their number
        (if the ensemble is drawn), an ensemble, or None.
    save
        A file that keeps the state every 20 iterations: the same call continues from it, with the
        result of an uninterrupted search.
    progress
        Whether to show a progress bar.

    Examples
    --------
    >>> grid = jp.TimeGrid.until(20.0, dt=0.1)
    >>> space = jp.DesignSpace(jp.paper.structures(), {"friction": (0.0, 1.0)})
    >>> earthquakes = jp.Ensemble.of([jp.paper.ground()], grid)
    >>> limited = jp.Objective(limits={"damper_force": 0.3})
    >>> short = {"search": jp.DesignSearch(starts=1, iterations=5), "progress": False}
    >>> design = jp.design_damper(space, earthquakes, grid, objective=limited, **short)
    >>> round(design.values["friction"], 2)  # all that the limit allows
    0.3
    """
    problem = DesignProblem(space, ensemble, grid, scheme, objective)
    return Designer(problem, search, save, progress, strict).design(search.start, fresh=fresh)


class Designer:
    """A problem and its solver; programs are compiled once, for any starts and limits."""

    def __init__(
        self,
        problem: DesignProblem,
        search: DesignSearch,
        save: str | PathLike[str] | None = None,
        progress: bool = True,
        strict: bool = False,
    ) -> None:
        import optax  # takes as long as all other imports

        instance("search", search, DesignSearch)
        if save is not None and not Path(save).absolute().parent.is_dir():
            raise InvalidInput("save", str(save), "must be in a folder that exists")
        self.problem, self.search, self.strict = problem, search, strict
        self.save, self.progress = None if save is None else Path(save), progress
        n = len(problem.ensemble)
        batch = n if search.batch is None else search.batch
        enforce([Rule("batch", batch, batch <= n, f"at most the ensemble's {n}")])
        # At least the variables of every start, and the demands of its earthquakes, run at once.
        each = problem.space.dimension + batch * len(problem.limitable)
        size = search.starts * each * jnp.zeros(()).dtype.itemsize
        require_memory("starts", search.starts, size)
        self.states = limit_states(problem)
        nominal = problem.space.nominal
        grounds = problem.ensemble.first_in_g(problem.grid, gravity_of(nominal))
        unresolved = of_many(grounds, problem.grid, in_g=problem.si)
        findings = imprecise(nominal.system(), problem.grid, grounds)
        warn(findings + unresolved, strict)
        steps = optax.cosine_decay_schedule(0.2, search.iterations)
        optimiser = search.optimiser or optax.adam(steps, b1=0.8, b2=0.9)
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
        problem, search = self.problem, self.search
        first = start_shares(problem.space, start)
        if isinstance(fresh, Ensemble):
            problem.space.require_certain(fresh.uncertain)
        elif fresh is not None:
            fresh = problem.ensemble.fresh(count("fresh", fresh))
        before = problem.evaluate(first, problem.ensemble)
        topology = problem.space.nominal.system().topology
        extremes = {name: (float(x.min()), float(x.max())) for name, x in before.items()}
        warn(unreached(topology, extremes, si=problem.si), self.strict)
        data = problem.data(before, search.limit_tolerance, search.key, limits)
        descent = Descent(self.lagrangian, search, data, self.save, self.progress)
        states = self.states
        result = search_in_rounds(states, descent, first) if states else descent.best(first)
        best, limits_of, iterations = result.point, problem.objective.limits, len(result.history)
        reached = dict(zip(limits_of, map(float, best.limited), strict=True))
        reached |= {name: event.probability for name, event in result.rare.events.items()}
        bounds = np.asarray(data.limits).tolist()
        used = {
            name: limit if limit.probability is not None else replace(limit, at_most=bound)
            for (name, limit), bound in zip(limits_of.items(), bounds, strict=True)
            if bound < NO_LIMIT
        }
        if best.infeasible:
            worst = max(used, key=lambda name: reached[name] / used[name].most)
            x, limit = reached[worst], used[worst]
            excess = f"{worst} = {x:.6g}, {x / limit.most - 1:.2%} above its limit {limit.most:.6g}"
            if limit.probability is not None:
                excess = f"{limit.event(worst)} = {x:.4g}, above its limit {limit.most:g}"
            closest = f"the closest that was found, in {iterations} iterations, has {excess}"
            raise InfeasibleError(f"{caller()}: limits must leave a design, but {closest}")
        function = replace(problem.objective, limits=used)
        multipliers, gradient = result.conditions.multipliers(best)
        at_bound = result.conditions.at_bound(best.scaled, gradient)
        ends = np.where(best.scaled < 0.5, "low", "high").tolist()
        after = problem.evaluate(best.scaled, problem.ensemble)
        size, names = float(data.size), problem.space.names
        design = Design(
            objective_function=function,
            history=SearchHistory.of(result.history, [*limits_of.values()]),
            limited_demands=reached,
            active_bounds={names[i]: ends[i] for i in np.flatnonzero(at_bound)},
            gradient=dict(zip(names, (-size * gradient).tolist(), strict=True)),
            multipliers=dict(zip(limits_of, (size * multipliers).tolist(), strict=True)),
            limit_tolerance=search.limit_tolerance,
            simulations=(iterations * search.starts + result.polishing) * self.lagrangian.batch,
            trained=Comparison(before, after, function, problem.si, topology),
            fresh=None,
            shares=best.scaled,
            objective=float(best.objective),
            winner=result.winner,
            stopped=result.stopped,
            events=result.rare.events,
            _log_ratios=result.rare.log_ratios,
            _first=first,
            _problem=problem,
        )
        return design if fresh is None else replace(design, fresh=design.compare(fresh))
