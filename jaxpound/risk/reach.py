"""The parameter of the structures at which a rare event has a wanted probability."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from os import PathLike
from pathlib import Path
from typing import NamedTuple

import jax
from jaxtyping import Array

from jaxpound._checks import Rule, enforce, finite, number, require_share
from jaxpound._tables import Shown, Table
from jaxpound.grid import TimeGrid
from jaxpound.model.parameters import get, interval, name, put, require_paths
from jaxpound.model.system import Structures
from jaxpound.results.demand import Demand
from jaxpound.risk.demanded import REQUIRED_GAP
from jaxpound.risk.limit_state import LimitState, threshold_of
from jaxpound.risk.rare_event import RareEvent
from jaxpound.risk.run import event_of, programs_of, require_smooth
from jaxpound.risk.slope import Slope
from jaxpound.simulation.scheme import Scheme
from jaxpound.study.scenarios import ScenarioSet

OWNER = "reach_probability"

WITHOUT_JUMPS = "wavelets have no jumps with negative = 0, records none if there is one"
"""What to do about scenarios with discrete numbers."""

_MOST = 12
_FARTHEST = 3.0  # |change of ln P| that one step may aim at: beyond it the slope changes
_FLAT = 2.0  # standard errors that a slope must exceed to be followed


class Step(NamedTuple):
    """One value of the parameter on the way."""

    value: float
    probability: float
    cov: float
    slope: Slope
    """d ln P by the parameter."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Reached(Shown):
    """A parameter at which an event has a wanted probability; made by ``reach_probability``."""

    path: str
    """The parameter."""
    value: float
    """Its value."""
    error: float
    """Standard error of the value, from that of the estimated probability; infinite where this does
    not depend on it."""
    target: float
    """The wanted probability."""
    event: RareEvent
    """The event at this value."""
    structures: Structures
    """The structures with this value; what the scenarios draw is at its median."""
    steps: tuple[Step, ...]
    """All values on the way, the last one's being that of ``event``."""

    runs: int
    """Runs in all."""
    gradients: int
    """Runs with a gradient by the ground motion in all."""

    def _tables(self) -> list[Table]:
        what = f"{name(self.structures, self.path, symbols=False)} = {self.value:.5g}"
        rows = [
            (str(i + 1), one.value, one.probability, one.cov, str(one.slope))
            for i, one in enumerate(self.steps)
        ]
        return [
            Table(
                f"{what} ± {self.error:.2g} for a probability of {self.target:g}",
                ("step", self.path, "probability", "c.o.v.", "d ln P"),
                rows,
                [f"{self.runs:,} runs, {self.gradients:,} gradients"],
            )
        ]


def reach_probability(
    path: str,
    probability: float,
    scenarios: ScenarioSet,
    grid: TimeGrid,
    gap: float | None = None,
    *,
    demand: str | Callable[[Demand], Array] = REQUIRED_GAP,
    threshold: float | None = None,
    scheme: Scheme = Scheme(),
    tolerance: float = 0.1,
    key: int | jax.Array = 0,
    start: RareEvent | None = None,
    store: str | PathLike[str] | None = None,
    progress: bool = True,
) -> Reached:
    """The value of one parameter at which a rare event has a wanted probability.

    Newton's method on ln P, which is nearly linear in a damper's friction or in a gap: each step
    estimates the probability and its slope (``rare_event`` by design points,
    ``RareEvent.slope``), starting from the design points of the step before.

    Parameters
    ----------
    path
        The parameter of the structures: ``"friction"``, ``"initial_gap"``, ``"rod_2.tau_x"``. Where
        the scenarios draw it, it is fixed instead.
    probability
        The wanted probability, between 0 and 1.
    scenarios, grid, gap, demand, threshold, scheme, key, start, progress
        See ``rare_event``. The search starts from the scenarios' own value (their median); where
        ``start`` is the event there, its design points are not sought again.
    tolerance
        Relative deviation from the wanted probability that is small enough, between 0 and 1. The
        coefficient of variation of each estimate is half of it.
    store
        A folder that keeps the search of each value in a folder of its own: the same call goes on
        from there after it was stopped.

    Returns
    -------
    Reached

    Raises
    ------
    ValueError
        If an argument breaks its rule, a number of the scenarios is discrete (such as the signs of
        wavelets), the probability does not depend on the parameter or cannot be estimated on the
        way, or is not reached in 12 steps. If the store holds another search.
    OSError
        If the store cannot be written to.

    Examples
    --------
    >>> hills = np.exp(-np.subtract.outer(np.arange(0, 8, 0.1), np.arange(1.0, 6.0)) ** 2)
    >>> def ground(z):
    ...     return jp.Record(0.2 * hills @ z, dt=0.1, time_unit="1/ω1")
    >>> scenarios = jp.Scenarios(jp.paper.structures(), jp.CustomDraw(ground, 5))
    >>> grid = jp.TimeGrid.until(8.0, dt=0.1)
    >>> found = jp.reach_probability("friction", 1e-4, scenarios, grid, 0.3, progress=False)
    >>> 0.05 < found.value < 0.5, 0.9e-4 < found.event.probability < 1.1e-4
    (True, True)
    """
    require_share(OWNER, "probability", number(OWNER, "probability", probability))
    require_share(OWNER, "tolerance", number(OWNER, "tolerance", tolerance))
    threshold = threshold_of(OWNER, gap, demand, threshold)
    programs = programs_of(OWNER, start)
    first = LimitState(scenarios, grid, scheme, demand, threshold, _programs=programs)
    require_smooth(OWNER, scenarios, WITHOUT_JUMPS)
    nominal = first.programs.nominal
    require_paths(OWNER, nominal, [path])
    value = float(get(nominal, path))
    enforce(OWNER, [Rule(path, value, finite(value), "finite")])
    low, high = map(float, interval(nominal, path))
    steps: list[Step] = []
    event = start
    runs = gradients = 0
    for _ in range(_MOST):
        state = dataclasses.replace(first, changes={path: value})
        event = event_of(
            state,
            cov=tolerance / 2,
            method="design points",
            key=key,
            start=event,
            store=None if store is None else Path(store) / f"{path}-{value:.9g}",
            progress=progress,
        )
        runs, gradients = runs + event.runs, gradients + event.gradients
        if not math.isfinite(event.cov) or event.probability == 1:
            raise ValueError(
                f"{OWNER}: {path} = {value:.6g} must lead to a probability that can be estimated: "
                f"{'; '.join(event.warnings)}"
            )
        slope = event.slope(path)
        steps.append(Step(value, event.probability, event.cov, slope))
        missing = math.log(probability / event.probability)
        if abs(missing) <= math.log1p(tolerance) - tolerance / 4:
            break
        if not abs(slope.value) > _FLAT * slope.error:
            rule = f"depend on {path} = {value:.6g}, but d ln P is {slope}"
            raise ValueError(f"{OWNER}: the probability {event.probability:.3g} must {rule}")
        aimed = max(-_FARTHEST, min(missing, _FARTHEST)) / slope.value
        value = _within(steps, value + aimed, low, high, probability)
    else:
        last = steps[-1]
        raise ValueError(
            f"{OWNER}: probability = {probability:g} must be reached in {_MOST} steps; the last "
            f"has {last.probability:.3g} at {path} = {last.value:.6g}"
        )
    return Reached(
        path=path,
        value=value,
        error=abs(event.cov / slope.value) if slope.value else math.inf,
        target=float(probability),
        event=event,
        structures=put(nominal, {path: value}),
        steps=tuple(steps),
        runs=runs,
        gradients=gradients,
    )


def _within(steps: list[Step], new: float, low: float, high: float, target: float) -> float:
    """The new value, inside its admissible interval and between values on either side."""
    above = [one.value for one in steps if one.probability > target]
    below = [one.value for one in steps if one.probability <= target]
    if above and below:
        # The nearest pair; where Newton's step leaves it, its middle.
        ends = min(((a, b) for a in above for b in below), key=lambda pair: abs(pair[0] - pair[1]))
        near, far = sorted(ends)
        if not near < new < far and abs(far - near) > 1e-3 * max(abs(far), abs(near)):
            new = (near + far) / 2
    last = steps[-1].value
    if new <= low:
        return (low + last) / 2
    return (high + last) / 2 if new >= high else new
