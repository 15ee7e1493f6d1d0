"""``rare_event``: the probability of a rare event from design points and samples around them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from os import PathLike
from pathlib import Path
from typing import Any

import jax
from jaxtyping import Array
from tqdm.auto import tqdm

from jaxpound._checks import count, hint, instance, number, require_share
from jaxpound.grid import TimeGrid
from jaxpound.results.demand import Demand
from jaxpound.risk.demanded import REQUIRED_GAP
from jaxpound.risk.kept import Kept
from jaxpound.risk.limit_state import LimitState, threshold_of
from jaxpound.risk.rare_event import RareEvent
from jaxpound.risk.sampling import BATCH, normal_points
from jaxpound.risk.search import COMMON, OWNER, Search
from jaxpound.risk.subset import simulated
from jaxpound.simulation.scheme import Scheme
from jaxpound.study.sampling import key_numbers
from jaxpound.study.scenarios import ScenarioSet, discrete_coordinates, parameter_names

_METHODS = ("auto", "design points", "subset")
_FEW = 30  # random numbers below which one or a few points do not stand for all failures
_MOST_AROUND = 50_000  # runs around design points, by default


def rare_event(
    scenarios: ScenarioSet,
    grid: TimeGrid,
    gap: float | None = None,
    *,
    demand: str | Callable[[Demand], Array] = REQUIRED_GAP,
    threshold: float | None = None,
    scheme: Scheme = Scheme(),
    cov: float = 0.1,
    method: str = "auto",
    key: int | jax.Array = 0,
    start: RareEvent | None = None,
    max_runs: int | None = None,
    store: str | PathLike[str] | None = None,
    progress: bool = True,
) -> RareEvent:
    """Probability that random scenarios reach a limit state, however small it is.

    The likeliest ground motions that reach it are sought by gradients, one for each of many
    instants of the run, and samples are drawn around all of them. For a probability of 1e-6 that
    takes some 2,000 runs, a third of them with gradients, where plain Monte Carlo takes 1e8.

    Parameters
    ----------
    scenarios
        Structures and ground motion as functions of standard normal numbers, smooth in them.
    grid, scheme
        See ``simulate``.
    gap
        The gap at rest ≥ 0 of all links, in units of g/ω1²: the event is that any link closes by
        more. By default gaps are those of the structures.
    demand, threshold
        Another event: demand ≥ threshold. The demand is a scalar of ``Demand`` by its flat name
        (``"peak_contact"``, ``"peak_drift_2"``), the largest of several (``"peak_drift"``), or a
        function of a run's ``Demand`` that JAX can trace.
    cov
        The coefficient of variation of the estimate at which to stop, between 0 and 1.
    method
        "design points"; "subset", which is ``subset_simulation`` and needs neither gradients nor
        design points, but many more runs; or "auto": subset simulation of scenarios that have
        discrete coordinates or fewer than 30 numbers, where a few points do not stand for all ways
        to fail, and wherever the search finds signs that its points do not, else design points. The
        result's ``method`` says which and why; by "design points" these signs are warnings.
    key
        A seed, or a key of ``jax.random``. Sample i depends on it and on i alone.
    start
        An event of the same demand at another threshold, or of other structures in the same ground
        motions, from whose design points, if it has any, to start: a curve of probabilities, from
        the likelier to the rarer, costs little.
    max_runs
        Runs at most, gradients aside; by default 50,000 around design points, and a million of
        subset simulation. They come in batches of 256, three at least.
    store
        A folder that keeps design points and finished runs: the same call goes on from there
        after it was stopped, or to a smaller ``cov``, and ends as if it had not been interrupted.
    progress
        Whether to show a bar with the estimate and its coefficient of variation, and before with
        what is compiled.

    Returns
    -------
    RareEvent

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
    A demand over a run is reached if it is reached at any instant. Displacements, drifts and
    closings have a design point at each of some 20 instants a period (Koo, Der Kiureghian and
    Fujimura 2005), found by the improved HLRF iteration. Samples come from normal densities around
    those nearest to the origin, as Au and Beck (2001) draw them for linear structures, so that the
    estimate is unbiased with friction too. Around one design point alone it would be far too low,
    and would not tell. Other demands have design points of the whole run, from 32 random starts or
    more, up to 512, until nine in ten end in a point that another start has found too (Good 1953).

    Failures that no gradient shows, such as those of a factor that only rare numbers make large,
    are looked for in 256 or 512 random motions so strong that a failure in any direction, as near
    as the nearest design point, is two of their standard deviations off. Some that fail far from
    all design points are a sign that failures as likely as those found are missing.

    The linearised limit states of all instants together give ``RareEvent.form`` without a run.

    Where a demand is reached in more than some 4 % of all runs, plain Monte Carlo takes over.

    Examples
    --------
    >>> hills = np.exp(-np.subtract.outer(np.arange(0, 8, 0.1), np.arange(1.0, 6.0)) ** 2)
    >>> def ground(z):
    ...     return jp.Record(0.2 * hills @ z, dt=0.1, time_unit="1/ω1")
    >>> scenarios = jp.Scenarios(jp.paper.structures(), jp.CustomDraw(ground, 5))
    >>> grid = jp.TimeGrid.until(8.0, dt=0.1)
    >>> event = jp.rare_event(scenarios, grid, 0.4, method="design points", progress=False)
    >>> 5e-6 < event.probability < 1e-5, event.cov <= 0.1
    (True, True)
    >>> earthquake = event.design_earthquakes[0]
    >>> bool(jp.demand(earthquake.structures, earthquake.ground, grid).min_gap < 1 - 0.399)
    True
    """
    threshold = threshold_of(OWNER, gap, demand, threshold)
    programs = programs_of(OWNER, start)
    state = LimitState(scenarios, grid, scheme, demand, threshold, _programs=programs)
    return event_of(
        state,
        cov=cov,
        method=method,
        key=key,
        start=start,
        max_runs=max_runs,
        store=store,
        progress=progress,
    )


def event_of(
    state: LimitState,
    *,
    cov: float = 0.1,
    method: str = "auto",
    key: int | jax.Array = 0,
    start: RareEvent | None = None,
    max_runs: int | None = None,
    store: str | PathLike[str] | None = None,
    progress: bool = True,
) -> RareEvent:
    """``rare_event`` of a limit state."""
    require_share(OWNER, "cov", number(OWNER, "cov", cov))
    most = _MOST_AROUND if max_runs is None else count(OWNER, "max_runs", max_runs)
    _, numbers = key_numbers(OWNER, key)
    start = _start(state, start)

    def by_subset(why: str, folder: str | PathLike[str] | None) -> RareEvent:
        more = {} if max_runs is None else {"max_runs": max_runs}
        return simulated(state, cov=cov, key=key, store=folder, progress=progress, why=why, **more)

    subset, why = choice(state, method)
    if subset:
        return by_subset(why, store)
    kept = None
    if store is not None:
        first = None if start is None else start.design_points
        kept = Kept(store, state, key, first, BATCH, most)
    with tqdm(unit=" runs", unit_scale=True, disable=not progress) as bar:
        search = Search(state, cov, most, normal_points(key, state), kept, bar)
        found = None if start is None else search.points(numbers, start)
        if found is None or not len(found) or found.form() > COMMON / 2:
            pilot = search.pilot()
            if pilot.probability > COMMON:
                return search.plain(pilot, 0 if found is None else found.gradients)
        if found is None:
            found = search.points(numbers, None)
        doubt = search.doubt(found)
        if not doubt or (method == "design points" and len(found)):
            return search.around(found, doubt)
    if method == "auto":
        folder = None if store is None else Path(store) / "subset"
        event = by_subset(f"{doubt}: ", folder)
        runs, gradients = event.runs + search.runs, found.gradients
        return dataclasses.replace(event, runs=runs, gradients=gradients)
    raise ValueError(
        f"{OWNER}: gradients must lead to the limit state, but none of {found.failed} searches has "
        "reached it; use method = 'subset', or in reach_probability another value to start from"
    )


def programs_of(owner: str, start: RareEvent | None) -> Any:
    """Compiled programs of an event from which to start, if there is one."""
    if start is None:
        return None
    instance(owner, "start", start, RareEvent)
    return start.limit_state.programs


def _start(state: LimitState, event: RareEvent | None) -> RareEvent | None:
    """An event to start from; None without design points, a ``ValueError`` if of another kind."""
    if event is None:
        return None
    before = event.limit_state
    if before.dimension != state.dimension:
        rule = f"of scenarios of {state.dimension} numbers, as these are"
        raise ValueError(f"{OWNER}: start of {before.dimension} must be {rule}")
    named = isinstance(state.demand, str) or isinstance(before.demand, str)
    if (named and before.demand != state.demand) or len(before.series) != len(state.series):
        rule = f"must be of {state.demand!r}, as this event is"
        raise ValueError(f"{OWNER}: start of the demand {before.demand!r} {rule}")
    return event if len(event.design_points) else None


def choice(state: LimitState, method: str) -> tuple[bool, str]:
    """Whether to take subset simulation, and why; a ``ValueError`` where gradients cannot work."""
    if method not in _METHODS:
        raise ValueError(f"{OWNER}: method = {method!r}; {hint(method, _METHODS)}")
    if method == "subset":
        return True, ""
    if shown := _discrete(state.scenarios):
        if method == "auto":
            return True, f"{shown} discrete: "
        require_smooth(OWNER, state.scenarios, "use method = 'subset'")
    if method == "auto" and state.dimension < _FEW:
        return True, f"{state.dimension} random numbers, fewer than {_FEW}: "
    return False, ""


def require_smooth(owner: str, scenarios: ScenarioSet, instead: str) -> None:
    """A ``ValueError`` for scenarios with discrete numbers, by which there are no gradients."""
    if shown := _discrete(scenarios):
        rule = "must not be discrete for design points, which need gradients"
        raise ValueError(f"{owner}: scenarios: {shown} {rule}; {instead}")


def _discrete(scenarios: ScenarioSet) -> str:
    """Names of the first discrete numbers of scenarios; empty if there are none."""
    indices = discrete_coordinates(scenarios)
    names = parameter_names(scenarios) if indices else ()
    return ", ".join([names[i] for i in indices[:4]] + ["..."] * (len(indices) > 4))
