"""Figures of rare events: the likeliest earthquake that brings one about, and its probability."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxpound._checks import instance, is_whole
from jaxpound._errors import InvalidInput
from jaxpound.model.system import in_si
from jaxpound.plots import style as house
from jaxpound.plots.curves import time_label
from jaxpound.plots.runs import displacements, ground_motion
from jaxpound.plots.style import COLOURS, in_house_style, label, new_axes, shade
from jaxpound.reliability.instants import Series
from jaxpound.reliability.result import RareEvent
from jaxpound.results.response import Response
from jaxpound.simulation.run import simulate


@in_house_style
def design_earthquake(event: RareEvent, number: int = 0) -> Figure:
    """The likeliest earthquake that reaches the limit state, and the response to it, over time.

    Below the ground acceleration is the series that reaches the threshold (a closing, drift,
    displacement, acceleration or force), at the instant that is marked; of a demand that has no
    instants, or that impacts make, the displacements.

    ``number`` is that of ``RareEvent.design_earthquakes``, the likeliest being 0; a ``ValueError``
    if there is none.
    """
    instance("event", event, RareEvent)
    n = len(event.design_points)
    if not (is_whole(number) and 0 <= number < n):
        rule = f"from 0 to {n - 1}" if n else "of an event with design points; this one has none"
        raise InvalidInput("number", repr(number), f"must be {rule}")
    state, earthquake = event.limit_state, event.design_earthquakes[number]
    response = simulate(earthquake.structures, earthquake.ground, state.grid, state.scheme)
    figure = house.new_figure(1.0, 1.6)
    above, below = figure.subplots(2, sharex=True)
    ground_motion(response, above)
    if not state.series or state.searches_overlaps:
        displacements(response, below)
        return figure
    series = state.series[int(event.design_points.series[number])]
    time, level = earthquake.time, state.level
    values, words = _values(response, series), series.words.partition(",")[0]
    factor, words = house.with_unit(words, series.kind, response.si, float(np.abs(values).max()))
    values, level = factor * values, factor * level
    below.plot(np.asarray(response.time), values, color=COLOURS["damper"], label=series.words)
    below.axhline(level, color=COLOURS["limit"], linestyle="--", label="threshold")
    for ax in (above, below):
        ax.axvline(time, color=COLOURS["residual"], linewidth=0.7, zorder=1)
    at = house.in_unit(time, "time", response.si, 3)
    instant = rf"$t$ = {at}, $\beta$ = {earthquake.beta:.3g}"
    below.plot(time, level, "o", color=COLOURS["limit"], markersize=4, label=instant)
    label(below, time_label(response), words)
    house.legend(below, columns=2)
    above.set_xlabel("")
    return figure


def _values(response: Response, series: Series) -> np.ndarray:
    """A series of ``LimitState.series`` over the instants of a response."""
    terms: list[Any] = [rod.force for rod in response.rods]
    if series.kind == "acceleration":
        terms = list(response.absolute_accelerations)
    elif series.kind == "length":
        at_rest = [np.full_like(link.gap, link.gap[0]) for link in response.links]
        terms = [*(mass.x for mass in response.masses), *response.closings, *at_rest]
    shares = [series.row[i] * np.asarray(terms[i]) for i in np.flatnonzero(series.row)]
    return np.sum(shares, axis=0)


@in_house_style
def probability_curve(events: Sequence[RareEvent], ax: Axes | None = None) -> Axes:
    """Probability over the threshold, with its 95 % interval and the values by FORM.

    ``events`` are two or more of one demand, each at another threshold (``rare_event`` with
    ``start``).

    A ``ValueError`` if there are fewer than two events with a threshold, or of different demands.
    """
    for i, event in enumerate(events):
        instance(f"events[{i}]", event, RareEvent)
    states = [event.limit_state for event in events]
    if len(states) < 2 or any(state.threshold is None for state in states):
        raise InvalidInput("events", "", "must be two or more, each with a threshold")
    if any(state.demand != states[0].demand for state in states):
        raise InvalidInput("events", "", "must be of one demand")
    ax = new_axes(ax)
    ranked = sorted(events, key=lambda event: event.limit_state.level)
    demand, nominal = states[0].demand, states[0].nominal
    at = np.array([event.limit_state.level for event in ranked])
    factor, words = 1.0, "demand"
    if isinstance(demand, str):
        topology, largest = nominal.system().topology, float(at.max())
        factor, words = house.demand_axis(demand, in_si(nominal), largest, topology)
    at = factor * at
    estimates = np.array([event.estimate[:3] for event in ranked])
    ax.fill_between(at, estimates[:, 1], estimates[:, 2], label="95 % interval", **shade("damper"))
    ax.plot(at, estimates[:, 0], "o-", color=COLOURS["damper"], markersize=3, label="estimate")
    if np.isfinite(form := np.array([event.form for event in ranked])).any():
        ax.plot(at, form, "--", color=COLOURS["residual"], label="by FORM")
    ax.set_yscale("log")
    label(ax, words, "probability of exceedance")
    house.legend_above(ax, 3)
    return ax
