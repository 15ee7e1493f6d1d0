"""``rare_event``: the probability of a rare event from design points and samples around them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from typing import Any

import jax
import numpy as np
from jaxtyping import Array
from scipy.special import ndtr
from tqdm.auto import tqdm

from jaxpound._checks import count, hint, instance, number, require_share
from jaxpound.grid import TimeGrid
from jaxpound.results.demand import Demand
from jaxpound.risk.design_points import DesignPoints, find_design_points
from jaxpound.risk.instants import REQUIRED_GAP
from jaxpound.risk.limit_state import LimitState, require_dependence, threshold_of
from jaxpound.risk.mixture import NEAR, Mixture
from jaxpound.risk.rare_event import RAREST, RareEvent, always
from jaxpound.risk.sampling import (
    BATCH,
    Samples,
    batch,
    normal_points,
    plain_batch,
    until_sure,
)
from jaxpound.risk.subset import simulated
from jaxpound.simulation.scheme import Scheme
from jaxpound.study.sampling import key_numbers
from jaxpound.study.scenarios import ScenarioSet, parameter_names

OWNER = "rare_event"

_METHODS = ("auto", "design points", "subset")
_FEW = 30  # random numbers below which one or a few points do not stand for all failures
_MOST_AROUND = 50_000  # runs around design points, by default
_COMMON = 0.04  # share of plain runs above which plain Monte Carlo is as good
_THIN, _LARGEST, _OUTSIDE = 0.1, 0.1, 0.1  # shares of the estimate that are told


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
    progress: bool = True,
) -> RareEvent:
    """Probability that random scenarios reach a limit state, however small it is.

    The likeliest ground motions that reach it are sought by gradients, one for each of many
    instants of the run, and samples are drawn around all of them. For a probability of 1e-6 that
    takes some 1,500 runs, a third of them with gradients, where plain Monte Carlo takes 1e8.

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
        to fail, or where no gradient leads to the limit state, else design points. The result's
        ``method`` says which and why.
    key
        A seed, or a key of ``jax.random``. Sample i depends on it and on i alone.
    start
        An event of the same scenarios at another threshold, or of other structures in the same
        ground motions, from whose design points to start: a curve of probabilities, from the
        likelier to the rarer, costs little.
    max_runs
        Runs at most, gradients aside; by default 50,000 around design points, and a million of
        subset simulation.
    progress
        Whether to show a bar with the estimate and its coefficient of variation.

    Returns
    -------
    RareEvent

    Raises
    ------
    ValueError
        If an argument breaks its rule or the demand does not depend on the scenarios' numbers; by
        "design points" also if a coordinate of the scenarios is discrete or no gradient leads to
        the limit state.

    Notes
    -----
    A demand over a run is reached if it is reached at any instant. Displacements, drifts and
    closings have a design point at each of some 20 instants a period (Koo, Der Kiureghian and
    Fujimura 2005), found by the improved HLRF iteration. Samples come from normal densities around
    those nearest to the origin, as Au and Beck (2001) draw them for linear structures, so that the
    estimate is unbiased with friction too. Around one design point alone it would be far too low,
    and would not tell. Other demands have design points of the whole run, from many starts.

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
    programs = None
    if start is not None:
        instance(OWNER, "start", start, RareEvent)
        programs = start.limit_state.programs
    state = LimitState(scenarios, grid, scheme, demand, threshold, _programs=programs)
    return event_of(
        state,
        cov=cov,
        method=method,
        key=key,
        start=start,
        max_runs=max_runs,
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
    progress: bool = True,
) -> RareEvent:
    """``rare_event`` of a limit state."""
    require_share(OWNER, "cov", number(OWNER, "cov", cov))
    most = _MOST_AROUND if max_runs is None else count(OWNER, "max_runs", max_runs)
    _, numbers = key_numbers(OWNER, key)
    if method not in _METHODS:
        raise ValueError(f"{OWNER}: method = {method!r}; {hint(method, _METHODS)}")
    if start is not None and start.limit_state.dimension != state.dimension:
        rule = f"of scenarios of {state.dimension} numbers, as these are"
        raise ValueError(f"{OWNER}: start of {start.limit_state.dimension} must be {rule}")

    def by_subset(why: str) -> RareEvent:
        more = {} if max_runs is None else {"max_runs": max_runs}
        return simulated(state, cov=cov, key=key, progress=progress, why=why, **more)

    against = _against_gradients(state)
    if method == "subset" or (method == "auto" and against):
        return by_subset(f"{against}: " if method == "auto" else "")
    if discrete := _discrete(state):
        rule = "must not be discrete for design points, which need gradients"
        raise ValueError(f"{OWNER}: scenarios: {discrete} {rule}; use method = 'subset'")
    normal = normal_points(key, state)
    with tqdm(unit=" runs", unit_scale=True, disable=not progress) as bar:
        pilot = None if start is not None else plain_batch(state, normal, 0)
        if pilot is not None:
            bar.update(BATCH)
            require_dependence(OWNER, state, pilot.z, pilot.values)
            if pilot.probability > _COMMON:
                return _plain(state, normal, pilot, cov, most, bar)
        found = _design_points(state, numbers, start, bar)
        if len(found) or not found.failed:
            runs = 0 if pilot is None else BATCH
            return _around(state, normal, found, cov, most, runs, bar)
    if method == "auto":
        event = by_subset("no gradient leads to the limit state: ")
        runs, gradients = event.runs + BATCH * (pilot is not None), found.gradients
        return dataclasses.replace(event, runs=runs, gradients=gradients)
    raise ValueError(
        f"{OWNER}: gradients must lead to the limit state, but none of {found.failed} searches has "
        "reached it; use method = 'subset'"
    )


def _against_gradients(state: LimitState) -> str:
    """Why not to rely on design points; empty if there is no reason."""
    if discrete := _discrete(state):
        return f"{discrete} discrete"
    if state.dimension < _FEW:
        return f"{state.dimension} random numbers, fewer than {_FEW}"
    return ""


def _discrete(state: LimitState) -> str:
    """Names of the discrete coordinates; empty if there is none."""
    indices = tuple(getattr(state.scenarios, "discrete", ()))
    names = parameter_names(state.scenarios) if indices else ()
    return ", ".join([names[i] for i in indices[:4]] + ["..."] * (len(indices) > 4))


def _design_points(
    state: LimitState, numbers: tuple[int, ...], start: RareEvent | None, bar: Any
) -> DesignPoints:
    def told(gradients: int, nearest: float) -> None:
        found = f", nearest at {nearest:.3g}" if np.isfinite(nearest) else ""
        bar.set_postfix_str(f"{gradients} gradients{found}")

    if start is None or not len(start.design_points):
        return find_design_points(state, numbers, None, told)
    instants = start.instants / state.grid.dt
    first = DesignPoints(
        start.design_points,
        np.zeros_like(start.design_points),
        np.linalg.norm(start.design_points, axis=1),
        np.where(np.isnan(instants), -1, np.round(instants)).astype(int),
        start.series,
        0,
        0,
    )
    return find_design_points(state, numbers, first, told)


def _plain(
    state: LimitState, normal: Any, pilot: Samples, cov: float, max_runs: int, bar: Any
) -> RareEvent:
    """The event of plain samples, where it is not rare."""
    found = pilot
    if pilot.probability < 1:
        for found in until_sure(
            lambda number: plain_batch(state, normal, number), cov, max_runs, pilot
        ):
            _tell(bar, found)
    event = RareEvent(
        probability=found.probability,
        cov=found.cov,
        runs=len(found),
        gradients=0,
        method="plain Monte Carlo: the event is not rare",
        limit_state=state,
        points=found.z,
        weights=found.weights,
        values=found.values,
        design_points=np.zeros((0, state.dimension)),
        instants=np.zeros(0),
        times=found.times,
    )
    warnings = [always(len(found))] if found.probability == 1 else []
    return dataclasses.replace(event, warnings=(*warnings, *_unsure(event, cov, max_runs)))


def _around(
    state: LimitState,
    normal: Any,
    found: DesignPoints,
    cov: float,
    max_runs: int,
    runs: int,
    bar: Any,
) -> RareEvent:
    """The event of samples around design points."""
    near = found.within(NEAR)
    event = RareEvent(
        probability=RAREST,
        cov=float("nan"),
        runs=runs,
        gradients=found.gradients,
        method="design points, no samples",
        limit_state=state,
        points=np.zeros((0, state.dimension)),
        weights=np.zeros(0),
        values=np.zeros(0),
        design_points=found.z,
        instants=np.where(found.instants < 0, np.nan, found.instants * state.grid.dt),
        series=found.series,
        form=near.form(),
    )
    if ndtr(-found.betas).sum() < RAREST:
        far = f"the nearest at {found.betas[0]:.3g}" if len(found) else "none found"
        said = (
            f"out of reach: the probability is below {RAREST:g}, by the design points ({far}); "
            "the number is a bound and no estimate"
        )
        return dataclasses.replace(event, warnings=(said,))
    mixture = Mixture.of(found)
    samples = None
    for samples in until_sure(lambda number: batch(state, normal, mixture, number), cov, max_runs):
        _tell(bar, samples)
    assert samples is not None
    one = ", one an instant" if state.series else ""
    event = dataclasses.replace(
        event,
        probability=samples.probability,
        cov=samples.cov,
        runs=runs + len(samples),
        method=f"importance sampling around {len(near)} design points{one}",
        points=samples.z,
        weights=samples.weights,
        values=samples.values,
        times=samples.times,
    )
    reached = samples.values >= 0
    thin = float(samples.parts[mixture.thin(samples.z)].sum() / max(samples.parts.sum(), 1e-300))
    warnings = [*_unsure(event, cov, max_runs), *_doubtful(event, near, thin, reached)]
    return dataclasses.replace(event, thin=thin, warnings=tuple(warnings))


def _tell(bar: Any, found: Samples) -> None:
    bar.set_postfix_str(f"P = {found.probability:.3g}, c.o.v. {found.cov:.2g}")
    bar.update(BATCH)


def _unsure(event: RareEvent, cov: float, max_runs: int) -> Iterator[str]:
    if event.cov > cov:
        yield (
            f"the coefficient of variation is {event.cov:.2g} after {event.runs:,} runs, above "
            f"{cov:.2g}: raise max_runs = {max_runs:,}"
        )
    failed = np.count_nonzero(~np.isfinite(event.values))
    if failed:
        yield f"{failed:,} of {len(event.values):,} runs failed and count as safe"


def _doubtful(event: RareEvent, near: DesignPoints, thin: float, reached: Any) -> Iterator[str]:
    """Signs that failures were missed."""
    if thin > _THIN:
        yield (
            f"{thin:.0%} of the estimate comes from where few samples are drawn: there are "
            "failures that no design point stands for; compare with subset_simulation"
        )
    if event.largest_share > _LARGEST:
        yield (
            f"a single sample makes {event.largest_share:.0%} of the estimate: ask for a smaller "
            "cov, or compare with subset_simulation"
        )
    ends = near.instants * event.limit_state.grid.dt
    if reached.any() and (near.instants >= 0).all():
        times, shares = event.failures_by_instant
        period = 2 * np.pi
        outside = shares[(times < ends.min() - period / 2) | (times > ends.max() + period)].sum()
        if outside > _OUTSIDE:
            yield (
                f"{outside:.0%} of the estimate comes from runs whose demand is largest at times "
                "for which there is no design point; compare with subset_simulation"
            )
