"""``rare_event``: the probability of a rare event by the method that suits the scenarios."""

from __future__ import annotations

import dataclasses
from os import PathLike
from pathlib import Path

import jax
from tqdm.auto import tqdm

from jaxpound._checks import hint, instance, require_share
from jaxpound._errors import InvalidInput, resumable
from jaxpound._fields import Checked, parameter, part
from jaxpound.grid import TimeGrid
from jaxpound.reliability.importance import DesignPointSearch
from jaxpound.reliability.limit_state import LimitState, state_of
from jaxpound.reliability.result import RareEvent
from jaxpound.reliability.subset import SubsetSearch, simulated
from jaxpound.results.named import REQUIRED_GAP, DemandSpec
from jaxpound.scenarios.scenarios import ScenarioSet

_METHODS = ("auto", "design points", "subset")
_FEW = 30  # random numbers below which a few points do not stand for all failures
_MOST_AROUND = 50_000  # runs around design points, by default


@dataclasses.dataclass(frozen=True, eq=False)
class EventSearch(Checked):
    """The way in which ``rare_event`` finds a probability.

    Parameters
    ----------
    method
        "design points"; "subset", which is ``subset_simulation`` and needs neither gradients nor
        design points, but many more runs; or "auto": subset simulation where coordinates of the
        scenarios are discrete, where they are fewer than 30 (a few points then do not stand for all
        ways to fail), and where the search finds failures far from its design points; elsewhere
        design points. The event's ``method`` says which and why; by "design points" such failures
        are warnings.
    start
        An event of the same demand at another threshold, or of other structures in the same ground
        motions: the search starts from its design points, if it has any. A curve of
        probabilities, from the likelier to the rarer, then costs little.
    max_runs
        Largest number of runs without gradients; by default 50,000 around design points, and a
        million by subset simulation. They come in batches of 256, three at least.
    """

    method: str = "auto"
    start: RareEvent | None = part(RareEvent, default=None)
    max_runs: int | None = parameter(whole=True, default=None)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.method not in _METHODS:
            raise InvalidInput("", "", f"method = {self.method!r}; {hint(self.method, _METHODS)}")

    def start_of(self, state: LimitState) -> RareEvent | None:
        """The event from whose design points the search of a limit state starts, if it has any."""
        if self.start is None:
            return None
        before = self.start.limit_state
        if before.dimension != state.dimension:
            rule = f"must be of scenarios of {state.dimension} numbers, as these are"
            raise InvalidInput(f"start of {before.dimension}", "", rule)
        by_name = isinstance(state.demand, str) or isinstance(before.demand, str)
        if (by_name and before.demand != state.demand) or len(before.series) != len(state.series):
            rule = f"must be of {state.demand!r}, as this event is"
            raise InvalidInput(f"start of the demand {before.demand!r}", "", rule)
        return self.start if len(self.start.design_points) else None


@resumable("store")
def rare_event(
    scenarios: ScenarioSet | LimitState,
    grid: TimeGrid | None = None,
    gap: float | None = None,
    *,
    demand: DemandSpec = REQUIRED_GAP,
    threshold: float | None = None,
    cov: float = 0.1,
    search: EventSearch = EventSearch(),
    key: int | jax.Array = 0,
    store: str | PathLike[str] | None = None,
    progress: bool = True,
) -> RareEvent:
    """Probability that random scenarios reach a limit state, however small it is.

    By design points, 256 plain runs come first, and more where the event is frequent, in more than
    some 4 % of all runs. Then gradients lead to the likeliest ground motions that reach the limit
    state, one for each of many instants of the run. Failures to which no gradient leads are sought
    among 256 or 512 stronger random motions. Last, samples are drawn around all of these motions.
    For a probability of 1e-6 that takes some 2,000 runs, a third with gradients, where plain Monte
    Carlo takes 1e8. Warns (``PlausibilityWarning``) if contact is run in single precision.

    Parameters
    ----------
    scenarios, grid
        Structures and ground motion as functions of standard normal numbers, and the time grid of
        ``simulate``; or a ``LimitState`` alone, which may also have another scheme.
    gap
        The gap at rest ≥ 0 of all links, in g/ω1², or in m for ``Buildings``: the event is that any
        link closes by more. By default gaps are those of the structures.
    demand, threshold
        Another event, demand ≥ threshold; see ``LimitState``.
    cov
        The target coefficient of variation of the estimate, between 0 and 1.
    search
        The method, an event to start from, and the largest number of runs.
    key
        A seed, or a key of ``jax.random``. Sample i depends on it and on i alone.
    store
        A folder that keeps design points and finished runs: after an interruption the same call,
        or one with a smaller ``cov``, continues from them, and its result is the same. It is for
        one process at a time. Damaged files are named in a warning, and their runs are repeated.
    progress
        Whether to show a progress bar with the estimate and its c.o.v.

    Raises
    ------
    ValueError
        If an argument breaks its rule or the demand does not depend on the scenarios' numbers; by
        "design points" also if a coordinate of the scenarios is discrete or no gradient leads to
        the limit state. If the store holds another search, with what differs.
    OSError
        If the store cannot be written to.

    Notes
    -----
    The page on rare events of the documentation describes the methods, and when not to trust them.
    Displacements, drifts, closings, accelerations and base shears have a design point at each of
    some 20 instants a period (Koo, Der Kiureghian and Fujimura 2005), demands of impacts (contact,
    or an acceleration where blocks may meet) on the ways to design points of overlaps, in some
    1,000 runs more, and other demands of the whole run, from 32 to 512 random starts (Good 1953).
    Samples come from normal densities around those nearest to the origin, as Au and Beck (2001)
    draw them for linear structures, so that the estimate is unbiased with friction too.

    Examples
    --------
    >>> hills = np.exp(-np.subtract.outer(np.arange(0, 8, 0.1), np.arange(1.0, 6.0)) ** 2)
    >>> ground = jp.CustomDraw(lambda z: jp.Record(0.2 * hills @ z, 0.1, time_unit="1/ω1"), 5)
    >>> scenarios = jp.Scenarios(jp.paper.structures(), ground)
    >>> grid = jp.TimeGrid.until(8.0, dt=0.1)
    >>> by_points = jp.reliability.EventSearch("design points")
    >>> event = jp.rare_event(scenarios, grid, 0.4, search=by_points, progress=False)
    >>> 5e-6 < event.probability < 1e-5, event.cov <= 0.1
    (True, True)
    >>> earthquake = event.design_earthquakes[0]
    >>> bool(jp.demand(earthquake.structures, earthquake.ground, grid).min_gap < 1 - 0.399)
    True
    """
    state = state_of(scenarios, grid, gap, demand, threshold)
    instance("search", search, EventSearch)
    return event_of(state, cov, search, key, store, progress)


def event_of(
    state: LimitState,
    cov: float,
    options: EventSearch,
    key: int | jax.Array,
    store: str | PathLike[str] | None,
    progress: bool,
) -> RareEvent:
    """``rare_event`` of a limit state."""
    require_share("cov", cov)
    start, most = options.start_of(state), options.max_runs
    subset, why = choice(state, options.method)
    runs = gradients = 0
    if not subset:
        with tqdm(unit=" runs", unit_scale=True, disable=not progress) as bar:
            search = DesignPointSearch(state, cov, most or _MOST_AROUND, key, start, store, bar)
            outcome = search.event(only_by_points=options.method == "design points")
        if isinstance(outcome, RareEvent):
            return outcome
        runs, gradients, why = search.runs, search.gradients, f"{outcome}: "
        store = None if store is None else Path(store) / "subset"
    levels = SubsetSearch() if most is None else SubsetSearch(max_runs=most)
    event = simulated(state, cov, levels, key, store, progress)
    method, runs = why + event.method, runs + event.runs
    return dataclasses.replace(event, method=method, runs=runs, gradients=gradients)


def choice(state: LimitState, method: str) -> tuple[bool, str]:
    """Whether to use subset simulation, and why; an error where gradients cannot work."""
    if method == "subset":
        return True, ""
    if method == "design points":
        require_smooth(state, "use the method 'subset'")
    elif names := state.discrete_names:
        return True, f"{names} discrete: "
    elif state.dimension < _FEW:
        return True, f"{state.dimension} random numbers, fewer than {_FEW}: "
    return False, ""


def require_smooth(state: LimitState, instead: str) -> None:
    """An ``InvalidInput`` for scenarios with discrete numbers, which have no gradients."""
    if names := state.discrete_names:
        rule = f"must not be discrete for design points, which need gradients; {instead}"
        raise InvalidInput(f"scenarios: {names}", "", rule)
