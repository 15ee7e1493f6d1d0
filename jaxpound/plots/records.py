"""Figures of ground motions: axes in, axes out, in the common style."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes

from jaxpound._checks import instance
from jaxpound.grid import TimeGrid
from jaxpound.ground.intensity import samples_of, spectral_acceleration
from jaxpound.ground.motion import SECONDS, GroundLike, records_in, require_ground
from jaxpound.ground.record import Record
from jaxpound.plots.style import (
    COLOURS,
    CYCLE,
    in_house_style,
    label,
    legend,
    new_axes,
    ratio_ticks,
    unit_for,
)


def _unit(record: GroundLike) -> str:
    """The unit of time of a ground motion, as axes name it."""
    in_seconds = any(part.time_unit == SECONDS for part in records_in(record))
    return unit_for("time", in_seconds, 0.0)[1]


@in_house_style
def accelerogram(record: GroundLike, ax: Axes | None = None, grid: TimeGrid | None = None) -> Axes:
    """Acceleration of a ground motion, in g, over time in its own unit, with its peak.

    Parameters
    ----------
    record
        A record, such as one drawn by ``FilteredNoise``, or another ground motion.
    ax
        Where to draw.
    grid
        The instants drawn, in the motion's unit of time; by default a record's samples.

    Raises
    ------
    ValueError
        If it is no ground motion, or none but a record and there is no grid.
    """
    require_ground("accelerogram: record", record)
    a, dt = map(np.asarray, samples_of(record, grid))
    ax, time = new_axes(ax), float(dt) * np.arange(a.size)
    unit = _unit(record)
    ax.plot(time, a, color=COLOURS["ground"])
    peak = np.abs(a).argmax()
    words = f"PGA = {abs(a[peak]):.3g} $g$ at $t$ = {time[peak]:.4g} {unit}"
    ax.plot(time[peak], a[peak], "o", color=COLOURS["ground"], markersize=4, label=words)
    ax.margins(x=0)
    label(ax, f"time $t$ ({unit})", "ground acceleration $u''$ ($g$)")
    legend(ax)
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

    Parameters
    ----------
    records
        Records in g, by name; all in the same unit of time.
    ax
        Where to draw.
    periods
        Natural periods > 0 in the records' unit of time; by default 80 from 0.05 to 5.
    damping
        Damping ratio, at least 0 and below 1.
    marks
        Natural periods to be marked, by name, such as those of two buildings.

    Raises
    ------
    ValueError
        If there is no record, their units of time differ, or an argument breaks its rule.
    """
    instance("spectra", "records", records, Mapping)
    if not records:
        raise ValueError("spectra: records must hold at least one record")
    for name, record in records.items():
        instance("spectra", f"records[{name!r}]", record, Record)
    first, *others = records.values()
    for record in others:
        if record.time_unit != first.time_unit:
            raise ValueError(
                f"spectra: records: {record!r} must be in the same unit of time as {first!r}"
            )
    t = np.geomspace(0.05, 5.0, 80) if periods is None else np.asarray(periods, float)
    if t.ndim != 1 or not t.size or not ((t > 0) & np.isfinite(t)).all():
        raise ValueError(f"spectra: periods = {periods!r} must be positive and finite, shape (n,)")
    ax = new_axes(ax)
    for i, (name, record) in enumerate(records.items()):
        one = partial(spectral_acceleration, record, damping=damping)
        ax.plot(
            t,
            jax.vmap(lambda period, one=one: one(period=period))(jnp.asarray(t)),
            color=CYCLE[i % len(CYCLE)],
            linestyle=("-", "--", ":")[i // len(CYCLE) % 3],
            label=name,
        )
    ax.set_xscale("log")
    ax.set_yscale("log")
    for name, period in (marks or {}).items():
        ax.axvline(period, color=COLOURS["residual"], linewidth=0.7, zorder=1)
        ax.annotate(
            name,
            (period, 0.03),
            xycoords=("data", "axes fraction"),
            xytext=(2, 0),
            textcoords="offset points",
            rotation=90,
            color=COLOURS["residual"],
        )
    ratio_ticks(ax.xaxis)
    ratio_ticks(ax.yaxis)
    label(
        ax, f"natural period $T$ ({_unit(first)})", f"$S_a$ at {100 * damping:.3g} % damping ($g$)"
    )
    legend(ax, columns=2)
    return ax
