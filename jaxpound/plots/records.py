"""Figures of ground motions: axes in, axes out, in the common style."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from jaxpound._checks import instance
from jaxpound.grid import TimeGrid
from jaxpound.ground import intensity
from jaxpound.ground.motion import SECONDS, GroundLike, records_in, require_ground
from jaxpound.ground.record import Record, require_records
from jaxpound.ground.suite import RecordSuite
from jaxpound.ground.target import ScaledSuite
from jaxpound.plots import style as house
from jaxpound.plots.style import COLOURS, in_house_style, label, new_axes, shade

_POINTS = 100  # of a target and of spectra over its periods


def _in_seconds(ground: GroundLike) -> bool:
    return any(part.time_unit == SECONDS for part in records_in(ground))


@in_house_style
def accelerogram(record: GroundLike, ax: Axes | None = None, grid: TimeGrid | None = None) -> Axes:
    """Acceleration of a ground motion, in g, over time in its own unit, with its peak.

    ``grid`` is the instants drawn, in the motion's unit of time; by default a record's samples. A
    ``ValueError`` if it is no ground motion, or none but a record and there is no grid.
    """
    require_ground("record", record)
    a, dt = map(np.asarray, intensity.samples_of(record, grid))
    ax, time = new_axes(ax), float(dt) * np.arange(a.size)
    in_seconds = _in_seconds(record)
    ax.plot(time, a, color=COLOURS["ground"])
    peak = np.abs(a).argmax()
    words = f"PGA = {abs(a[peak]):.3g} $g$ at $t$ = {house.in_unit(time[peak], 'time', in_seconds)}"
    ax.plot(time[peak], a[peak], "o", color=COLOURS["ground"], markersize=4, label=words)
    ax.margins(x=0)
    label(ax, house.with_unit("time $t$", "time", in_seconds)[1], "ground acceleration $u''$ ($g$)")
    house.legend(ax)
    return ax


@in_house_style
def spectra(
    records: Mapping[str, Record],
    ax: Axes | None = None,
    periods: Sequence[float] | None = None,
    damping: float = 0.05,
    marks: Mapping[str, float] | None = None,
) -> Axes:
    """Spectral acceleration of records over the natural period, both logarithmic.

    ``records`` are in g, by name, all in the same unit of time. ``periods`` are natural periods > 0
    in that unit, by default 80 from 0.05 to 5; ``damping`` is a ratio, at least 0 and below 1.
    ``marks`` are natural periods to be marked, by name, such as those of two buildings.
    """
    require_records(records, Mapping)
    t = np.geomspace(0.05, 5.0, 80) if periods is None else np.asarray(periods)
    accelerations = intensity.spectra([*records.values()], t, damping)
    ax = new_axes(ax)
    for i, (name, spectrum) in enumerate(zip(records, accelerations, strict=True)):
        cycles, place = divmod(i, len(house.CYCLE))
        ax.plot(t, spectrum, ("-", "--", ":")[cycles % 3], color=house.CYCLE[place], label=name)
    spectral_axes(ax, any(map(_in_seconds, records.values())), damping)
    for name, period in (marks or {}).items():
        ax.axvline(period, color=COLOURS["residual"], linewidth=0.7, zorder=1)
        where: Any = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points"}
        style: Any = {"rotation": 90, "color": COLOURS["residual"]}
        ax.annotate(name, (period, 0.03), (2, 0), **where, **style)
    house.legend(ax, columns=2)
    return ax


@in_house_style
def suite_spectra(
    suite: RecordSuite | ScaledSuite,
    ax: Axes | None = None,
    periods: Sequence[float] | None = None,
    damping: float = 0.05,
) -> Axes:
    """Spectra of a suite's records, their mean and a target, over the period, both logarithmic.

    Of a ``ScaledSuite`` they are the scaled records and its target, whose range of periods is
    shaded, and 90 % of it there, below which codes do not want the mean. ``periods`` are natural
    periods > 0 in the records' unit of time; by default 100 from 0.05 to 5, or from half as low to
    twice as high as the range of a ``ScaledSuite``, but no lower than two sample intervals.
    ``damping`` is the ratio of the spectra; of a ``ScaledSuite`` that of its target.
    """
    instance("suite", suite, RecordSuite, ScaledSuite)
    records = suite.suite if isinstance(suite, ScaledSuite) else suite
    low, high = 0.05, 5.0
    if isinstance(suite, ScaledSuite):
        damping = suite.target.damping
        low, high = suite.range[0] / 2, 2 * suite.range[1]
    ax = new_axes(ax)
    low = max(low, min(2 * max(float(record.dt) for record in records), high / 2))
    at = np.geomspace(low, high, _POINTS) if periods is None else np.asarray(periods, float)
    accelerations = records.spectra(at, damping)
    first, *_ = ax.plot(at, accelerations.T, color=COLOURS["residual"], alpha=0.5, linewidth=0.6)
    first.set_label(f"{len(accelerations)} records")
    ax.plot(at, accelerations.mean(axis=0), color=COLOURS["damper"], label="their mean")
    lowest = accelerations.mean(axis=0).min()
    if isinstance(suite, ScaledSuite):
        target, lowest = suite.target, suite.target.accelerations.min()
        inside = at[(at >= target.periods[0]) & (at <= target.periods[-1])]
        ax.plot(inside, target.at(inside), color=COLOURS["ground"], label="target")
        within = np.geomspace(*suite.range, _POINTS)
        ax.plot(within, 0.9 * target.at(within), ":", color=COLOURS["ground"], label="90 % of it")
        ax.axvspan(*suite.range, label="period range", **(shade("stick") | {"alpha": 0.15}))
    spectral_axes(ax, records.time_unit == SECONDS, damping)
    ax.set_xlim(at[0], at[-1])
    ax.set_ylim(bottom=lowest / 5)
    house.legend_above(ax, 3)
    return ax


def spectral_axes(ax: Axes, in_seconds: bool, damping: float) -> None:
    """Axes of spectral acceleration over period, both logarithmic."""
    house.log_log(ax)
    period = house.with_unit("natural period $T$", "time", in_seconds)[1]
    label(ax, period, f"$S_a$ at {100 * damping:.3g} % damping ($g$)")
