"""Pareto fronts: designs for ever tighter limits on one demand."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from tqdm.auto import tqdm

from jaxpound._checks import count, instance, positive, real, require_one_of
from jaxpound._errors import InvalidInput
from jaxpound._tables import Shown, TextTable
from jaxpound.design.design import Design
from jaxpound.design.ensemble import Ensemble
from jaxpound.design.objective import Limit, Objective
from jaxpound.design.problem import DesignProblem
from jaxpound.design.run import NO_LIMIT, Designer, InfeasibleError
from jaxpound.design.search import DesignSearch, Progress
from jaxpound.design.space import DesignSpace
from jaxpound.grid import TimeGrid
from jaxpound.quantities import unit
from jaxpound.results.named import in_words, limitable_demands, unit_of
from jaxpound.simulation.scheme import Scheme


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class ParetoFront(Shown):
    """Designs that do not dominate each other in objective and limited demand, in its order."""

    limited_demand: str
    over: str | float
    designs: tuple[Design, ...]
    infeasible: tuple[float, ...]
    """Limits for which no design was found."""

    @property
    def limited_demands(self) -> np.ndarray:
        """The limited demand of each design, shape (k,)."""
        return np.array([design.limited_demands[self.limited_demand] for design in self.designs])

    @property
    def objectives(self) -> np.ndarray:
        """The objective of each design, shape (k,)."""
        return np.array([design.objective for design in self.designs])

    def _tables(self) -> list[TextTable]:
        first = self.designs[0]
        demand_unit = unit_of(self.limited_demand, first.trained.si)
        symbol = unit(first.objective_function.quantity, first.trained.si)
        objective = f"objective ({symbol})" if symbol else "objective"
        words = in_words(self.limited_demand, first.trained.topology)
        columns = (f"{words} ({demand_unit})", objective, *first.space.names)
        limited = zip(self.limited_demands, self.designs, strict=True)
        rows = [(reached, x.objective, *x.values.values()) for reached, x in limited]
        notes = [f"no design for a limit of {x:.5g} {demand_unit}" for x in self.infeasible]
        return [TextTable(f"Pareto front of {len(self.designs)} designs", columns, rows, notes)]


def pareto_front(
    space: DesignSpace,
    ensemble: Ensemble,
    grid: TimeGrid,
    scheme: Scheme = Scheme(),
    objective: Objective = Objective(),
    *,
    limited_demand: str,
    over: str | float = "mean",
    limits: int | Sequence[float] = 8,
    search: DesignSearch = DesignSearch(starts=3, iterations=100),
    progress: bool = True,
) -> ParetoFront:
    """The best objective for every limit on a demand, from loose to tight.

    Every search starts where the one before ended, and at other points, by one compiled program.

    Raises ``ValueError`` as in ``design_damper``; if limited_demand is unknown or limited already.

    Parameters
    ----------
    space, ensemble, grid, scheme, objective
        See ``design_damper``.
    limited_demand, over
        Name of the demand to be limited, and its statistic (see ``Limit``); the objective must not
        limit it.
    limits
        The limits; or their number: they are evenly spaced from the demand of the best design
        without this limit to the smallest among the iterates of that first search.
    search
        How the design of each limit is searched for, the first one from its ``start``; by default
        by 3 starts and 100 iterations each.
    progress
        Whether to show a progress bar, of the iterations of all searches.
    """
    instance("objective", objective, Objective)
    instance("space", space, DesignSpace)
    name, allowed = "limited_demand", limitable_demands(space.nominal.system())
    require_one_of(limited_demand, allowed, name)
    if limited_demand in objective.limits:
        raise InvalidInput(name, repr(limited_demand), "must not be limited by the objective")
    instance("search", search, DesignSearch)
    number, bounds = 0, []
    if isinstance(limits, Iterable) and not isinstance(limits, str):
        bounds = np.sort(np.ravel(real("limits", [*limits])))[::-1].tolist()
        positive(limits=np.asarray(bounds))
    else:
        number = count("limits", limits)
    all_limits = {**objective.limits, limited_demand: Limit(NO_LIMIT, over)}
    limited = dataclasses.replace(objective, limits=all_limits)

    def report(where: Progress) -> Any:
        bar.update()
        best = f"{where.best:.5g}" if np.isfinite(where.best) else "none yet"
        bar.set_postfix({"objective": best}, refresh=False)
        return None if search.callback is None else search.callback(where)

    problem = DesignProblem(space, ensemble, grid, scheme, limited)
    designer = Designer(problem, dataclasses.replace(search, callback=report), progress=False)
    # Shown with the first iterations, so that an error message has no bar beside it.
    with tqdm(unit=" iterations", disable=not progress, delay=0.1) as bar:

        def begin_search(to_come: int) -> None:
            bar.total = bar.n + search.iterations * to_come  # those before may have ended early

        begin_search(number or 1 + len(bounds))
        free = designer.design(search.start)
        if number:  # below its demand, the last that is limited, down to its iterates'
            most = free.limited_demands[limited_demand]
            reached = free.history.limited_demands[..., -1]
            reached = reached[np.isfinite(reached) & (reached > 0)]
            least = min(reached.min(initial=np.inf), most)
            even = np.linspace(most, least, number)[1:].tolist() if least > 0 else []
            bounds = [x for x in even if x < most]
        designs, infeasible = [free], []
        for i, limit in enumerate(bounds):
            begin_search(len(bounds) - i)
            try:
                designs.append(designer.design(designs[-1].values, limits={limited_demand: limit}))
            except InfeasibleError:
                infeasible.append(float(limit))
        begin_search(0)
    front: list[Design] = []  # the undominated designs, in the order of the limited demand
    for design in sorted(designs, key=lambda x: (x.limited_demands[limited_demand], -x.objective)):
        if not front or design.objective > front[-1].objective:
            front.append(design)
    return ParetoFront(limited_demand, over, tuple(front), tuple(infeasible))
