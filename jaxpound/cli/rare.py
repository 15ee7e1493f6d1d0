"""``jaxpound rare``: the probability of a rare event, however small, and how it comes about."""

from __future__ import annotations

import argparse
import dataclasses
import math
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import jax
import numpy as np

import jaxpound as jp
from jaxpound._errors import warn
from jaxpound._tables import TextTable
from jaxpound.cli.files import VERSION, csv_text, kept_search, write_report
from jaxpound.cli.parameters import Parameters, Uncertain, by_path
from jaxpound.cli.reading import Count, File, Form, Section, Seed, between, named, refused, says
from jaxpound.ground.plausibility import first_of, of_many
from jaxpound.model.parameters import get
from jaxpound.reliability.run import choice, require_smooth
from jaxpound.reliability.target import WITHOUT_JUMPS
from jaxpound.results.named import REQUIRED_GAP, demand_in_words, in_words, threshold_range, unit_of
from jaxpound.scenarios.scenarios import grounds_at

_Thresholds = says("a list of two numbers or more, each above 0", min_length=2)
_CHECKED = 64  # random earthquakes that must be plausible
_OF_STEP = ("value", "probability", "cov", "slope_of_ln_probability", "slope_error")


class LimitTable(Section):
    """The event: that links close by a gap, or that a demand reaches a threshold."""

    gap: float | None = None
    demand: str | None = None
    threshold: float | None = None
    thresholds: Annotated[list[float], _Thresholds] | None = None

    def __post_init__(self) -> None:
        self.require_form(Form((), ("gap",)), Form(("demand", "threshold")))
        within = threshold_range(self.demand_name)
        if self.lowest_threshold is not None:
            within.require("gap" if self.demand is None else "threshold", self.lowest_threshold)
        for threshold in self.thresholds or ():
            within.require("thresholds", threshold)

    @property
    def demand_name(self) -> str:
        """The demand that reaches the thresholds."""
        return self.demand or REQUIRED_GAP

    @property
    def lowest_threshold(self) -> float | None:
        """The threshold; None for pounding across the gaps of the structures."""
        return self.gap if self.demand is None else self.threshold


class EstimationTable(Section):
    """How the probability is estimated."""

    cov: Annotated[float, between(1e-3, 0.99, "", "a coefficient of variation")] = 0.1
    method: Literal["auto", "design points", "subset"] = "auto"
    seed: Annotated[int, Seed] = 0
    max_runs: Annotated[int, Count] | None = None


class TargetSpec(Section):
    """The parameter that is changed until the event has a probability."""

    parameter: str
    probability: Annotated[float, between(1e-12, 0.5, "", "of the event in one earthquake")]
    tolerance: Annotated[float, between(0.01, 0.9, "", "of the probability, relative")] = 0.1


class RareConfig(Uncertain, kw_only=True):
    """The configuration of ``jaxpound rare``."""

    limit: LimitTable = LimitTable()
    search: EstimationTable = EstimationTable()
    design: TargetSpec | None = None

    def target_path(self, file: File) -> str:
        """The path of the parameter that is changed; empty if there is none."""
        if self.design is None:
            return ""
        place, key = f"{file.name}: [design] parameter:", self.design.parameter
        path, *others = by_path(place, {key: None}, Parameters(self.layout))
        if others:
            raise refused(f"{place} {key}", "must stand for one parameter")
        return path

    @property
    def event(self) -> str:
        """The event in words."""
        if (threshold := self.limit.lowest_threshold) is None:
            return "pounding"
        words = in_words(self.limit.demand_name, self.buildings.system().topology)
        number = f"{threshold:g} {unit_of(self.limit.demand_name, si=True)}".rstrip()
        return f"{words} of {number} or more"


class RareResult(NamedTuple):
    """The event, those of the curve, and the target."""

    config: RareConfig
    event: jp.RareEvent
    curve: Mapping[float, jp.RareEvent]  # events by other thresholds, which rise
    target: jp.reliability.TargetResult | None = None


def run(args: argparse.Namespace) -> None:
    """Run the command."""
    file = File.opened(args.config, "rare")
    config = file.read(RareConfig)
    path = config.target_path(file)
    state = limit_state(file, config)
    with named(f"{file.name}: [search]"):
        choice(state, config.search.method)  # before a folder is made
    if path:
        with named(f"{file.name}: [design]"):
            require_smooth(state, WITHOUT_JUMPS)
    size = first_of(_CHECKED, state.grid), state.dimension
    z = jax.random.normal(jax.random.key(config.search.seed), size)
    grounds = grounds_at(state.scenarios, state.grid)(z)
    warn(of_many(grounds, state.grid, in_g=True), args.strict)
    with kept_search(args, "store", "", file.text.encode()):
        result = searched(file, config, state, args.store)
        if config.design is not None:
            result = result._replace(target=reached(file, config.design, path, result, args.store))
        report_result(args, file, result)


def limit_state(file: File, config: RareConfig) -> jp.LimitState:
    """The event."""
    scenarios, grid = config.scenarios(file)
    limit, place = config.limit, f"{file.name}: [limit]"
    if limit.demand_name == REQUIRED_GAP and not config.layout.gaps:
        rule = "must be of buildings with a gap: give a [[link]] one, or another demand"
        raise refused(f"{place} gap", rule)
    with named(place):
        options = config.run.scheme, limit.demand_name, limit.lowest_threshold
        return jp.LimitState(scenarios, grid, *options)


def searched(
    file: File, config: RareConfig, state: jp.LimitState, store: Path | None = None
) -> RareResult:
    """The event, and events at the stated thresholds, each started from the one before."""
    options, curve_at = config.search, sorted(config.limit.thresholds or ())
    more: Any = {"cov": options.cov, "key": options.seed, "progress": sys.stderr.isatty()}
    event_at, gaps = config.limit.lowest_threshold, {*config.layout.gaps}
    if event_at is None and len(gaps) == 1 and not any("gap" in x for x in config.uncertain):
        (gap,) = gaps  # of all links: a closing by it is pounding
        event_at = next((x for x in curve_at if math.isclose(gap, x)), None)
    thresholds = sorted({*curve_at, event_at}, key=lambda x: math.inf if x is None else x)
    start: jp.RareEvent | None = None
    events: dict[float | None, jp.RareEvent] = {}
    for threshold in thresholds:
        name = "pounding" if threshold is None else f"threshold-{threshold:.9g}"
        if len(thresholds) > 1:
            print(f"jaxpound: {name.replace('-', ' ')} ...", file=sys.stderr)
        at = dataclasses.replace(state, threshold=threshold)
        with named(f"{file.name}: [search]"):
            search = jp.reliability.EventSearch(options.method, start, options.max_runs)
            event = jp.rare_event(at, search=search, store=store and store / name, **more)
        events[threshold] = event
        # Without design points, where the event is common, the next search starts anew.
        start = event if len(event.design_points) else None
    return RareResult(config, events[event_at], {x: events[x] for x in curve_at})


def reached(
    file: File, target: TargetSpec, path: str, result: RareResult, store: Path | None
) -> jp.reliability.TargetResult:
    """The parameter at which the event has the target probability."""
    state = result.event.limit_state
    with named(f"{file.name}: [design]"):
        return jp.reliability.reach_probability(
            path,
            target.probability,
            state,
            tolerance=target.tolerance,
            key=result.config.search.seed,
            start=result.event,
            store=store and store / "design",
            progress=sys.stderr.isatty(),
        )


def report_result(args: argparse.Namespace, file: File, result: RareResult) -> None:
    """Print the results and write them to a folder."""
    parts: list[Any] = tables(result)
    print("\n".join(table.text() for table in parts))

    from jaxpound.plots import rare_events as plots
    from jaxpound.plots.style import drawn

    answers = summary(file, result)
    figures, files, remarks = {}, {}, []
    if curve := answers["curve"]:
        files["curve.csv"] = csv_text({key: [row[key] for row in curve] for key in curve[0]})
    if len(result.event.design_points):
        figures["design_earthquake"] = drawn(plots.design_earthquake, result.event)
        first, state = result.event.design_earthquakes[0], result.event.limit_state
        response = jp.simulate(first.structures, first.ground, state.grid, state.scheme)
        acceleration = np.asarray(response.ground_acceleration) / result.config.buildings.gravity
        rows = zip(np.asarray(response.time), acceleration, strict=True)
        files["design_earthquake.csv"] = "".join(f"{t:.9g},{a:.9g}\n" for t, a in rows)
        remarks.append(
            "The design earthquake is the likeliest ground motion that brings the event about. "
            "design_earthquake.csv has it (time in s, acceleration in g), as "
            "`jaxpound simulate --record design_earthquake.csv --units g` reads it."
        )
    if events := [*result.curve.values()]:
        figures["probability"] = drawn(plots.probability_curve, events)
    parts = [VERSION, *parts, *remarks]
    write_report(args, answers, "Probability of a rare event", parts, figures, files)


def summary(file: File, result: RareResult) -> dict[str, Any]:
    """The search in numbers, for JSON."""
    event, limit = result.event, result.config.limit
    earthquakes = [
        {"reliability_index": float(beta), "time_s": float(at)}
        for beta, at in zip(event.design_points.betas, event.instants, strict=True)
    ]
    samples = event.samples
    times, shares = samples.failures_by_instant
    return {
        **file.origin,
        "event": result.config.event,
        "demand": limit.demand_name,
        "unit": unit_of(limit.demand_name, si=True),
        "random_numbers": event.limit_state.dimension,
        **_numbers(limit.lowest_threshold, event),
        "method": event.method,
        "warnings": list(event.warnings),
        "largest_share_of_a_sample": samples.largest_share,
        "share_where_samples_are_thin": event.thin,
        "mean_time_of_failure_s": float(times @ shares) if len(times) else None,
        "design_earthquakes": earthquakes,
        "curve": [_numbers(*pair) for pair in result.curve.items()],
        "design": result.target and _of_target(result.config, result.target),
    }


def _numbers(threshold: float | None, event: jp.RareEvent) -> dict[str, Any]:
    return {
        "threshold": threshold,
        "probability": event.probability,
        "low": event.estimate.low,
        "high": event.estimate.high,
        "cov": event.cov,
        "reliability_index": event.beta,
        "probability_by_form": event.form,
        "runs": event.runs,
        "gradients": event.gradients,
    }


def _of_target(config: RareConfig, target: jp.reliability.TargetResult) -> dict[str, Any]:
    parameters = Parameters(config.layout)
    steps = ((*step[:3], step.slope.value, step.slope.error) for step in target.steps)
    return {
        "parameter": parameters.key_of[target.path],
        "unit": parameters.unit_of(target.path),
        "before": float(get(parameters.buildings, target.path)),
        "value": target.value,
        "standard_error": target.error,
        "wanted_probability": target.target,
        "probability": target.event.probability,
        "cov": target.event.cov,
        "runs": target.runs,
        "gradients": target.gradients,
        "warnings": list(target.event.warnings),
        "steps": [dict(zip(_OF_STEP, step, strict=True)) for step in steps],
    }


def tables(result: RareResult) -> list[TextTable]:
    """The results for people."""
    config, (of_event,) = result.config, result.event._tables()
    parts = [of_event._replace(title=f"Rare event: {config.event}")]
    if result.curve:
        words = demand_in_words(config.limit.demand_name, config.buildings.system().topology)
        columns = (words, "probability", "95 % from", "to", "by FORM", "runs", "gradients")
        rows, notes = [], []
        for threshold, event in result.curve.items():
            rows.append((threshold, *event.estimate[:3], event.form, event.runs, event.gradients))
            notes += [f"at {threshold:.4g}: warning: {warning}" for warning in event.warnings]
        table = TextTable.of(columns, rows)
        parts.append(table._replace(title="Probability by threshold", notes=notes))
    return [*parts, *(result.target._tables() if result.target else ())]
