"""Figures of ground motions: axes in, axes out, in the common style."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from jaxpound.grid import TimeGrid
from jaxpound.ground import intensity
from jaxpound.ground.motion import SECONDS, GroundLike, records_in, require_ground
from jaxpound.ground.record import Record, require_records
from jaxpound.plots import style as house
from jaxpound.plots.style import COLOURS, in_house_style, label, new_axes


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


def spectral_axes(ax: Axes, in_seconds: bool, damping: float) -> None:
    """Axes of spectral acceleration over period, both logarithmic."""
    house.log_log(ax)
    period = house.with_unit("natural period $T$", "time", in_seconds)[1]
    label(ax, period, f"$S_a$ at {100 * damping:.3g} % damping ($g$)")
