"""Figures of rare events: the likeliest earthquake that brings one about, and its probability."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxpound._checks import instance, is_whole
from jaxpound.plots.runs import displacements, ground_motion
from jaxpound.plots.style import (
    COLOURS,
    in_house_style,
    label,
    legend,
    legend_above,
    new_axes,
    new_figure,
    quantity_of,
    shade,
    unit_for,
)
from jaxpound.results.response import Response
from jaxpound.risk.rare_event import RareEvent
from jaxpound.simulation.run import simulate
from jaxpound.units import Scales


@in_house_style
def design_earthquake(event: RareEvent, number: int = 0, *, scales: Scales | None = None) -> Figure:
    """The likeliest earthquake that reaches the limit state, and the response to it, over time.

    Below the ground acceleration is the series that reaches the threshold (a closing, drift or
    displacement), at the instant that is marked; of a demand that has no instants, the
    displacements.

    Parameters
    ----------
    event
        The event, with design points.
    number
        Which of ``RareEvent.design_earthquakes``, the likeliest being 0.
    scales
        For a figure in SI units; without, it is dimensionless.

    Raises
    ------
    ValueError
        If the event has no design earthquake of this number.
    """
    instance("design_earthquake", "event", event, RareEvent)
    n = len(event.design_points)
    if not (is_whole(number) and 0 <= number < n):
        rule = f"from 0 to {n - 1}" if n else "of an event with design points; this one has none"
        raise ValueError(f"design_earthquake: number = {number!r} must be {rule}")
    state, found = event.limit_state, event.design_earthquakes[number]
    response = simulate(found.structures, found.ground, state.grid, state.scheme)
    at, level = found.time, state.level
    if scales is not None:
        response = scales.to_si(response)
        at, level = at * float(scales.time), level * float(scales.length)
    figure = new_figure(1.0, 1.6)
    above, below = figure.subplots(2, sharex=True)
    ground_motion(response, above)
    if not state.series:
        displacements(response, below)
        return figure
    one, time = state.series[int(event.series[number])], np.asarray(response.time)
    below.plot(time, _series(response, one.row), color=COLOURS["damper"], label=one.words)
    below.axhline(level, color=COLOURS["limit"], linestyle="--", label="threshold")
    for ax in (above, below):
        ax.axvline(at, color=COLOURS["residual"], linewidth=0.7, zorder=1)
    words = rf"$t$ = {at:.3g}{' s' if response.si else ''}, $\beta$ = {found.beta:.3g}"
    below.plot(at, level, "o", color=COLOURS["limit"], markersize=4, label=words)
    time_unit, unit = (unit_for(kind, response.si, 0.0)[1] for kind in ("time", "length"))
    label(below, f"time $t$ ({time_unit})", f"{_kind(one.words)} ({unit})")
    legend(below, columns=2)
    above.set_xlabel("")
    return figure


def _kind(words: str) -> str:
    """What a series is, without its place."""
    return words.partition(",")[0]


def _series(response: Response, row: np.ndarray) -> np.ndarray:
    """A series of ``LimitState.series`` over the instants of a response."""
    gaps = [np.asarray(link.gap) for link in response.links]
    at_rest = [np.full_like(gap, gap[0]) for gap in gaps]
    closings = [
        rest - gap if np.isfinite(gap[0]) else np.zeros_like(gap)
        for rest, gap in zip(at_rest, gaps, strict=True)
    ]
    known = [*(np.asarray(mass.x) for mass in response.masses), *closings, *at_rest]
    used = np.flatnonzero(row)
    return np.sum([row[i] * known[i] for i in used], axis=0)


@in_house_style
def probability_curve(
    events: Sequence[RareEvent], ax: Axes | None = None, *, scales: Scales | None = None
) -> Axes:
    """Probability over the threshold, with its 95 % interval and the values by FORM.

    Parameters
    ----------
    events
        Two or more of one demand, each at another threshold (``rare_event`` with ``start``).
    ax
        Where to draw.
    scales
        For thresholds in SI units; without, they are dimensionless.

    Raises
    ------
    ValueError
        If there are fewer than two events with a threshold, or of different demands.
    """
    found = list(events)
    for i, event in enumerate(found):
        instance("probability_curve", f"events[{i}]", event, RareEvent)
    states = [event.limit_state for event in found]
    if len(found) < 2 or any(state.threshold is None for state in states):
        raise ValueError("probability_curve: events must be two or more, each with a threshold")
    if any(state.demand != states[0].demand for state in states):
        raise ValueError("probability_curve: events must be of one demand")
    ax = new_axes(ax)
    found.sort(key=lambda event: event.limit_state.level)
    demand, si = states[0].demand, scales is not None
    kind, words = quantity_of(demand) if isinstance(demand, str) else (None, "demand")
    unit = 1.0 if scales is None else float(scales.unit_of(kind))
    at = np.array([event.limit_state.level for event in found]) * unit
    factor, written = unit_for(kind, si, float(at.max())) if kind else (1.0, "")
    at = at * factor
    estimates = np.array([event.estimate[:3] for event in found])
    ax.fill_between(at, estimates[:, 1], estimates[:, 2], label="95 % interval", **shade("damper"))
    ax.plot(at, estimates[:, 0], "o-", color=COLOURS["damper"], markersize=3, label="estimate")
    form = np.array([event.form for event in found])
    if np.isfinite(form).any():
        ax.plot(at, form, "--", color=COLOURS["residual"], label="by FORM")
    ax.set_yscale("log")
    label(ax, f"{words} ({written})" if kind else words, "probability of exceedance")
    legend_above(ax, 3)
    return ax
