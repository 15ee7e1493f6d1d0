"""``jaxpound rare``: the probability of a rare event, however small, and how it comes about."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import math
import sys
from pathlib import Path
from typing import Annotated, Any, Literal

import jax
from msgspec import field

import jaxpound as jp
from jaxpound.cli.factors import FACTOR, random_scenarios
from jaxpound.cli.files import make_folder, unfinished_search
from jaxpound.cli.notes import noted
from jaxpound.cli.parameters import Parameters, by_path, parameters_of
from jaxpound.cli.rare_report import Found, Target, kind_of_demand, write_report
from jaxpound.cli.reading import Count, File, Seed, Table, between, named, says
from jaxpound.cli.structures import Shaken
from jaxpound.cli.tables import Gap, Stated, drawn, require_threshold
from jaxpound.ground.plausibility import first_of, of_many, tell
from jaxpound.model.parameters import get
from jaxpound.model.system import is_closable
from jaxpound.risk.instants import REQUIRED_GAP
from jaxpound.risk.reach import WITHOUT_JUMPS
from jaxpound.risk.run import choice, event_of, require_smooth
from jaxpound.study.scenarios import grounds_at

# --- the configuration --------------------------------------------------------------------------

_LOOKED_AT = 64  # random earthquakes that must be plausible

_Numbers = Annotated[list[float], says("a list of two numbers or more", min_length=2)]


class Limit(Table):
    """The event: that links close by a gap, or that a demand reaches a threshold."""

    gap: Gap | None = None
    demand: str | None = None
    threshold: float | None = None
    thresholds: _Numbers | None = None

    def __post_init__(self) -> None:
        if self.demand is None and self.threshold is not None:
            raise ValueError("threshold must be given with demand; of the required gap it is gap")
        if self.demand is not None and self.threshold is None:
            raise ValueError("lacks the key 'threshold', which demand needs")
        if self.demand is not None and self.gap is not None:
            raise ValueError("gap must not be given with demand")
        of_demand = self.demand or REQUIRED_GAP
        for level in self.thresholds or ():
            require_threshold("thresholds", of_demand, level)
        if self.level is not None:
            place = "gap" if self.demand is None else "threshold"
            require_threshold(place, of_demand, self.level)

    @property
    def level(self) -> float | None:
        """The threshold in SI units; None for pounding across the gaps of the structures."""
        return self.gap if self.demand is None else self.threshold


class Search(Table):
    """How the probability is estimated."""

    cov: Annotated[float, between(1e-3, 0.99, "", "a coefficient of variation")] = 0.1
    method: Literal["auto", "design points", "subset"] = "auto"
    seed: Annotated[int, Seed] = 0
    max_runs: Annotated[int, Count] | None = None


class Wanted(Table):
    """The parameter that is changed until the event has a probability."""

    parameter: str
    probability: Annotated[float, between(1e-12, 0.5, "", "of the event in one earthquake")]
    tolerance: Annotated[float, between(0.01, 0.9, "", "of the probability, relative")] = 0.1


class Rare(Shaken, kw_only=True):
    """The configuration of ``jaxpound rare``."""

    uncertain: dict[str, Annotated[Stated, drawn(*FACTOR)]] = field(default_factory=dict)
    limit: Limit = Limit()
    search: Search = Search()
    design: Wanted | None = None


# --- the command --------------------------------------------------------------------------------


def run(args: argparse.Namespace) -> None:
    """Run the command."""
    file = File.opened(args.config, "rare")
    given = file.read(Rare)
    wanted = None if given.design is None else _path(file, given, given.design)
    state = limit_state(file, given)
    with named(f"{file.name}: [search]"):
        choice(state, given.search.method)  # before a folder is made
    if wanted is not None:
        with named(f"{file.name}: [design]"):
            require_smooth("reach_probability", state.scenarios, WITHOUT_JUMPS)
    tell("rare", _doubts(state, given.search.seed), args.strict)
    make_folder(args.out)
    with contextlib.ExitStack() as stack:
        if args.store is None:
            args.store = stack.enter_context(unfinished_search(args.out, file.text.encode()))
        with noted(given.structures):
            found = searched(file, given, state, args.store)
            if given.design is not None and wanted is not None:
                target = reached(file, given, given.design, found, *wanted, store=args.store)
                found = dataclasses.replace(found, target=target)
        write_report(file, found, args.out, args.pdf)


def _doubts(state: jp.LimitState, seed: int) -> list[str]:
    """What is implausible in some of the random earthquakes."""
    scenarios, grid = state.scenarios, state.grid
    numbers = jax.random.normal(jax.random.key(seed), (first_of(_LOOKED_AT, grid), state.dimension))
    return of_many(grounds_at(scenarios, grid)(numbers), grid, in_g=True)


def limit_state(file: File, given: Rare) -> jp.LimitState:
    """The event, dimensionless."""
    records = given.records(file)
    ground = given.motion(file, records)
    grid = given.grid(file, records)
    scenarios = random_scenarios(file, given, ground, given.uncertain)
    limit, place = given.limit, f"{file.name}: [limit]"
    demand = limit.demand or REQUIRED_GAP
    if demand == REQUIRED_GAP and not any(
        is_closable(link.gap) for link in given.structures.system().links
    ):
        rule = "must be of buildings with a gap: give a [[link]] one, or another demand"
        raise ValueError(f"{place} gap {rule}")
    with named(place):
        # The demand is known by its name before its threshold can have a unit.
        state = jp.LimitState(
            scenarios, grid, given.scheme, demand, None if limit.level is None else 0.0
        )
    return _at(state, given, limit.level)


def _at(state: jp.LimitState, given: Rare, level: float | None) -> jp.LimitState:
    """The same event at a threshold in SI units."""
    unit = float(given.scales.unit_of(kind_of_demand(state)))
    return dataclasses.replace(state, threshold=None if level is None else level / unit)


def searched(file: File, given: Rare, state: jp.LimitState, store: Path | None = None) -> Found:
    """The event and, where thresholds are given, those of the curve, each from the one before."""
    how, limit = given.search, given.limit
    levels: list[float | None] = sorted({*(limit.thresholds or ()), *_known(limit.level)})
    of_event = limit.level
    if limit.level is None:
        gap = _gap_of_all(given)
        of_event = next((x for x in levels if x is not None and math.isclose(gap, x)), None)
        if of_event is None:
            levels.append(None)
    start: jp.RareEvent | None = None
    events: dict[float | None, jp.RareEvent] = {}
    for level in levels:
        name = "pounding" if level is None else f"threshold-{level:.9g}"
        if len(levels) > 1:
            print(f"jaxpound: {name.replace('-', ' ')} ...", file=sys.stderr)
        with named(f"{file.name}: [search]"):
            event = event_of(
                _at(state, given, level),
                cov=how.cov,
                method=how.method,
                key=how.seed,
                start=start,
                max_runs=how.max_runs,
                store=None if store is None else store / name,
                progress=sys.stderr.isatty(),
            )
        events[level] = event
        # Without design points, where the event is common, the next search starts anew.
        start = event if len(event.design_points) else None
    curve = [events[x] for x in sorted(limit.thresholds or ())]
    return Found(events[of_event], curve, limit.level, given.scales)


def _gap_of_all(given: Rare) -> float:
    """The closing in SI units at which any link pounds; NaN where gaps differ or are random."""
    links = given.structures.system().links
    gaps = {float(link.gap) for link in links if is_closable(link.gap)}
    if len(gaps) != 1 or any("gap" in key for key in given.uncertain):
        return math.nan
    return gaps.pop() * float(given.scales.length)


def _known(level: float | None) -> list[float]:
    return [] if level is None else [level]


def _path(file: File, given: Rare, wanted: Wanted) -> tuple[Parameters, str]:
    """The parameters of the file, and the path of the wanted one."""
    known, place = parameters_of(given.form), f"{file.name}: [design] parameter:"
    found = by_path(place, {wanted.parameter: None}, known)
    if len(found) > 1:
        raise ValueError(f"{place} {wanted.parameter} must stand for one parameter")
    (path,) = found
    return known, path


def reached(
    file: File,
    given: Rare,
    wanted: Wanted,
    found: Found,
    known: Parameters,
    path: str,
    store: Path | None = None,
) -> Target:
    """The parameter at which the event has the wanted probability, in SI units.

    The search starts from the design points of the event that was found.
    """
    event = found.event
    state = _at(event.limit_state, given, found.level)
    with named(f"{file.name}: [design]"):
        reach = jp.reach_probability(
            path,
            wanted.probability,
            state.scenarios,
            state.grid,
            demand=state.demand,
            threshold=state.threshold,
            scheme=state.scheme,
            tolerance=wanted.tolerance,
            key=given.search.seed,
            start=event,
            store=None if store is None else store / "design",
            progress=sys.stderr.isatty(),
        )
    stated: Any = get(known.si, path)
    unit = float(stated) / float(get(known.nominal, path))
    return Target(reach, wanted.parameter, unit, known.unit_of(path), float(stated))
