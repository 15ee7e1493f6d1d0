"""Pareto fronts: designs for ever tighter limits on one demand."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from tqdm.auto import tqdm

from jaxpound._checks import count, instance, positive, real
from jaxpound._tables import Shown, Table
from jaxpound.design.design import Design
from jaxpound.design.ensemble import Ensemble
from jaxpound.design.objective import Limit, Objective
from jaxpound.design.prices import prices_of
from jaxpound.design.problem import DesignProblem
from jaxpound.design.run import NO_LIMIT, Designer, InfeasibleError
from jaxpound.design.search import Progress, SearchOptions
from jaxpound.design.space import DesignSpace
from jaxpound.grid import TimeGrid
from jaxpound.model.system import Structures
from jaxpound.quantities import unit
from jaxpound.results.demand import unit_of
from jaxpound.simulation.scheme import Scheme
from jaxpound.units import Scales

if TYPE_CHECKING:
    from optax import GradientTransformation


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class ParetoFront(Shown):
    """Designs that do not dominate each other in objective and limited demand, in its order."""

    price: str
    over: str | float
    designs: tuple[Design, ...]
    infeasible: tuple[float, ...]
    """Limits for which no design was found."""

    @property
    def prices(self) -> np.ndarray:
        """The limited demand of each design, shape (k,)."""
        return np.array([design.prices[self.price] for design in self.designs])

    @property
    def objectives(self) -> np.ndarray:
        """The objective of each design, shape (k,)."""
        return np.array([design.objective for design in self.designs])

    def _tables(self) -> list[Table]:
        first = self.designs[0]
        price = unit_of(self.price, first.trained.si)
        own = unit(first.objective_function.quantity, first.trained.si)
        return [
            Table(
                f"Pareto front of {len(self.designs)} designs",
                (
                    f"{self.price} ({price})",
                    f"objective ({own})" if own else "objective",
                    *first.space.names,
                ),
                [
                    (design.prices[self.price], design.objective, *design.values.values())
                    for design in self.designs
                ],
                [f"no design for a limit of {x:.5g} {price}" for x in self.infeasible],
            )
        ]


def pareto_front(
    space: DesignSpace,
    ensemble: Ensemble,
    grid: TimeGrid,
    scheme: Scheme = Scheme(),
    objective: Objective = Objective(),
    *,
    price: str,
    over: str | float = "mean",
    points: int = 8,
    limits: Sequence[float] | None = None,
    start: Structures | Mapping[str, float] | None = None,
    starts: int = 3,
    key: int = 0,
    iterations: int = 100,
    optimiser: GradientTransformation | None = None,
    scales: Scales | None = None,
    progress: bool = True,
) -> ParetoFront:
    """The best objective for every limit on a demand, from loose to tight.

    Every search starts where the one before ended, and at other points of the space. All use one
    compiled program.

    Parameters
    ----------
    space, ensemble, grid, scheme, objective, start, key, iterations, optimiser, scales
        See ``design_damper``.
    price, over
        Name of the demand to be limited, and its statistic (see ``Limit``); the objective must not
        limit it.
    points
        Number of limits, evenly spaced from the demand of the best design without this limit to the
        smallest among the iterates of that first search.
    limits
        The limits, instead of ``points``.
    starts
        Number of starts of each search.
    progress
        Whether to show a progress bar, of the iterations of all searches.

    Raises
    ------
    ValueError
        As in ``design_damper``; if price is unknown or limited already.
    """
    owner = "pareto_front"
    instance(owner, "objective", objective, Objective)
    instance(owner, "space", space, DesignSpace)
    prices = prices_of(space.nominal.system())
    if price not in prices:
        raise ValueError(f"{owner}: price = {price!r} must be one of {', '.join(prices)}")
    if price in objective.limits:
        raise ValueError(f"{owner}: price = {price!r} must not be limited by the objective")
    points = count(owner, "points", points)
    if limits is not None:
        limits = np.sort(np.ravel(real(owner, "limits", list(limits))))[::-1].tolist()
        positive(owner, limits=np.asarray(limits))
    limited = dataclasses.replace(
        objective, limits={**objective.limits, price: Limit(NO_LIMIT, over)}
    )

    def report(where: Progress) -> None:
        bar.update()
        best = f"{where.best:.5g}" if np.isfinite(where.best) else "none yet"
        bar.set_postfix({"objective": best}, refresh=False)

    designer = Designer(
        DesignProblem(space, ensemble, grid, scheme, limited, scales),
        SearchOptions(
            starts=starts,
            key=key,
            iterations=iterations,
            optimiser=optimiser,
            callback=report,
            progress=False,
        ),
    )
    searches = points if limits is None else 1 + len(limits)
    # Shown with the first iterations, so that an error message has no bar beside it.
    with tqdm(unit=" iterations", disable=not progress, delay=0.1) as bar:

        def begin_search(to_come: int) -> None:
            bar.total = bar.n + iterations * to_come  # those before may have ended early

        begin_search(searches)
        free = designer.design(start)
        if limits is None:
            met = free.history.prices[..., [*limited.limits].index(price)]
            met = met[np.isfinite(met) & (met > 0)]
            least = min(met.min(initial=np.inf), free.prices[price])
            lower = np.linspace(free.prices[price], least, points).tolist()[1:] if least > 0 else []
            limits = [x for x in lower if x < free.prices[price]]
        designs, infeasible, last = [free], [], free
        for i, limit in enumerate(limits):
            begin_search(len(limits) - i)
            try:
                last = designer.design(last.values, limits={price: limit})
            except InfeasibleError:
                infeasible.append(float(limit))
                continue
            designs.append(last)
        begin_search(0)
    return ParetoFront(price, over, _front(designs, price), tuple(infeasible))


def _front(designs: Sequence[Design], price: str) -> tuple[Design, ...]:
    """Designs that do not dominate each other in objective and limited demand."""
    front: list[Design] = []
    for design in sorted(designs, key=lambda one: (one.prices[price], -one.objective)):
        if not front or design.objective > front[-1].objective:
            front.append(design)
    return tuple(front)
