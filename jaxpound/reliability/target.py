"""The parameter of the structures at which a rare event has a target probability."""

from __future__ import annotations

import dataclasses
import math
from os import PathLike
from pathlib import Path
from typing import NamedTuple

import jax

from jaxpound._checks import Rule, enforce, finite, require_share
from jaxpound._errors import InvalidInput, resumable
from jaxpound._tables import Shown, TextTable
from jaxpound.grid import TimeGrid
from jaxpound.model.parameters import get, interval, metadata, name, put, require_paths
from jaxpound.model.system import Structures, in_si
from jaxpound.quantities import unit
from jaxpound.reliability.limit_state import LimitState, state_of
from jaxpound.reliability.result import RareEvent, Slope
from jaxpound.reliability.run import EventSearch, event_of, require_smooth
from jaxpound.scenarios.scenarios import ScenarioSet

# What to do about scenarios with discrete numbers.
WITHOUT_JUMPS = "wavelets have no jumps with negative = 0, records none if there is one"
_MOST = 12
_FARTHEST = 3.0  # |change of ln P| that one step may aim at: beyond it the slope changes
_FLAT = 2.0  # standard errors that a slope must exceed to be followed


class TargetStep(NamedTuple):
    """One value of the parameter on the way."""

    value: float
    probability: float
    cov: float
    slope: Slope
    """d ln P by the parameter."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class TargetResult(Shown):
    """A parameter at which an event has a target probability; made by ``reach_probability``."""

    path: str
    """The parameter."""
    value: float
    """Its value."""
    error: float
    """Standard error of the value, from that of the probability; infinite where the probability
    does not depend on it."""
    target: float
    """The target probability."""
    event: RareEvent
    """The event at this value."""
    structures: Structures
    """The structures with this value, and the medians of random parameters."""
    steps: tuple[TargetStep, ...]
    """All values on the way; the last is that of ``event``."""

    runs: int
    """Total number of runs."""
    gradients: int
    """Total number of runs with a gradient by the ground motion."""

    def _tables(self) -> list[TextTable]:
        symbol = unit(metadata(self.structures, self.path).kind, in_si(self.structures))
        value = f"{self.value:.5g} ± {self.error:.2g} {symbol}".rstrip()
        parameter = f"{name(self.structures, self.path, symbols=False)} = {value}"
        title = f"{parameter} for a probability of {self.target:g}"
        columns = ("step", self.path, "probability", "c.o.v.", "d ln P")
        rows = [(str(i), *x[:3], str(x.slope)) for i, x in enumerate(self.steps, 1)]
        notes = [f"{self.runs:,} runs, {self.gradients:,} gradients"]
        notes += [f"warning: {warning}" for warning in self.event.warnings]
        return [TextTable(title, columns, rows, notes)]


@resumable("store")
def reach_probability(
    path: str,
    probability: float,
    scenarios: ScenarioSet | LimitState,
    grid: TimeGrid | None = None,
    gap: float | None = None,
    *,
    tolerance: float = 0.1,
    key: int | jax.Array = 0,
    start: RareEvent | None = None,
    store: str | PathLike[str] | None = None,
    progress: bool = True,
) -> TargetResult:
    """The value of one parameter at which a rare event has a target probability.

    Newton's method on ln P, which is nearly linear in a damper's friction or in a gap: each step
    estimates the probability and its slope (``rare_event`` by design points, ``RareEvent.slope``),
    starting from the design points of the step before. Raises ``ValueError`` as ``rare_event`` by
    "design points"; if the probability does not depend on the parameter or cannot be estimated on
    the way, or is not reached in 12 steps.

    Parameters
    ----------
    path
        The parameter of the structures: ``"friction"``, ``"initial_gap"``, ``"rod_2.tau_x"``. It is
        fixed also where the scenarios draw it.
    probability
        The target probability, between 0 and 1.
    scenarios, grid, gap, key, progress
        See ``rare_event``; of another demand a ``LimitState``. The search starts from the
        scenarios' value (its median).
    start
        An event at this value, whose design points are not sought again (see ``EventSearch``).
    tolerance
        Admissible relative deviation from the target probability, between 0 and 1. The coefficient
        of variation of each estimate is half of it.
    store
        A folder with a folder for the search of each value; see ``rare_event``.

    Examples
    --------
    >>> hills = np.exp(-np.subtract.outer(np.arange(0, 8, 0.1), np.arange(1.0, 6.0)) ** 2)
    >>> ground = jp.CustomDraw(lambda z: jp.Record(0.2 * hills @ z, 0.1, time_unit="1/ω1"), 5)
    >>> scenarios = jp.Scenarios(jp.paper.structures(), ground)
    >>> grid = jp.TimeGrid.until(8.0, dt=0.1)
    >>> result = jp.reliability.reach_probability(
    ...     "friction", 1e-4, scenarios, grid, 0.3, progress=False
    ... )
    >>> 0.05 < result.value < 0.5, 0.9e-4 < result.event.probability < 1.1e-4
    (True, True)
    """
    require_share("probability", probability)
    require_share("tolerance", tolerance)
    first = state_of(scenarios, grid, gap)
    require_smooth(first, WITHOUT_JUMPS)
    nominal = first.nominal
    require_paths(nominal, [path])
    value = float(get(nominal, path))
    enforce([Rule(path, value, finite(value), "finite")])
    low, high = map(float, interval(nominal, path))
    steps: list[TargetStep] = []
    event, runs, gradients = start, 0, 0
    for _ in range(_MOST):
        state = dataclasses.replace(first, changes={path: value})
        folder = None if store is None else Path(store) / f"{path}-{value:.9g}"
        search = EventSearch("design points", event)
        event = event_of(state, tolerance / 2, search, key, folder, progress)
        runs, gradients = runs + event.runs, gradients + event.gradients
        if not math.isfinite(event.cov) or event.probability == 1:
            rule = f"must lead to a probability that can be estimated: {'; '.join(event.warnings)}"
            raise InvalidInput(path, f"{value:.6g}", rule)
        slope = event.slopes_by([path])[path]  # by all parameters it takes longer to compile
        steps.append(TargetStep(value, event.probability, event.cov, slope))
        missing = math.log(probability / event.probability)
        if abs(missing) <= math.log1p(tolerance) - tolerance / 4:
            break
        if not abs(slope.value) > _FLAT * slope.error:
            rule = f"must depend on {path} = {value:.6g}, but d ln P is {slope}"
            raise InvalidInput(f"the probability {event.probability:.3g}", "", rule)
        change = max(-_FARTHEST, min(missing, _FARTHEST)) / slope.value
        value = _within(steps, value + change, low, high, probability)
    else:
        last = f"{steps[-1].probability:.3g} at {path} = {steps[-1].value:.6g}"
        rule = f"must be reached in {_MOST} steps; the last has {last}"
        raise InvalidInput("probability", f"{probability:g}", rule)
    error = abs(event.cov / slope.value) if slope.value else math.inf
    structures, target = put(nominal, {path: value}), float(probability)
    return TargetResult(
        path, value, error, target, event, structures, tuple(steps), runs, gradients
    )


def _within(steps: list[TargetStep], new: float, low: float, high: float, target: float) -> float:
    """The new value, inside its admissible interval and between values on either side."""
    above = [step.value for step in steps if step.probability > target]
    below = [step.value for step in steps if step.probability <= target]
    if above and below:
        # Bisect the nearest pair where Newton's step leaves it.
        ends = min(((a, b) for a in above for b in below), key=lambda pair: abs(pair[0] - pair[1]))
        least, most = sorted(ends)
        if not least < new < most and abs(most - least) > 1e-3 * max(abs(most), abs(least)):
            new = (least + most) / 2
    last = steps[-1].value
    if new <= low:
        return (low + last) / 2
    return (high + last) / 2 if new >= high else new
