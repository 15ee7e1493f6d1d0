"""Figures of suites of records: axes in, axes out, in the common style."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from jaxpound._checks import instance
from jaxpound.ground.motion import SECONDS
from jaxpound.ground.suite import RecordSuite
from jaxpound.ground.target import ScaledSuite, TargetSpectrum
from jaxpound.plots import style as house
from jaxpound.plots.records import spectral_axes
from jaxpound.plots.style import COLOURS, in_house_style, new_axes, shade

_POINTS = 100


@in_house_style
def spectra(
    suite: RecordSuite | ScaledSuite,
    ax: Axes | None = None,
    target: TargetSpectrum | None = None,
    periods: Sequence[float] | None = None,
    damping: float = 0.05,
) -> Axes:
    """Spectra of a suite's records, their mean and a target, over the period, both logarithmic.

    Of a ``ScaledSuite`` they are the scaled records and its target, whose range of periods is
    shaded, and 90 % of it there, below which codes do not want the mean; another ``target`` may be
    given, of a ``RecordSuite`` too. ``periods`` are natural periods > 0 in the records' unit of
    time; by default 100 over the target's range, or half as low and twice as high as the range of a
    ``ScaledSuite``, but no lower than two sample intervals. ``damping`` is the ratio of the
    spectra; if there is a target, its.
    """
    instance("suite", suite, RecordSuite, ScaledSuite)
    records, span = (suite.suite, suite.range) if isinstance(suite, ScaledSuite) else (suite, None)
    if isinstance(suite, ScaledSuite):
        target = target or suite.target
    ax = new_axes(ax)
    low, high = 0.05, 5.0
    if span is not None:
        low, high = span[0] / 2, 2 * span[1]
    elif target is not None:
        low, high = float(target.periods[target.periods > 0][0]), float(target.periods[-1])
    low = max(low, min(2 * max(float(record.dt) for record in records), high / 2))
    at = np.geomspace(low, high, _POINTS) if periods is None else np.asarray(periods, float)
    damping = damping if target is None else target.damping
    accelerations = records.spectra(at, damping)
    first, *_ = ax.plot(at, accelerations.T, color=COLOURS["residual"], alpha=0.5, linewidth=0.6)
    first.set_label(f"{len(accelerations)} records")
    ax.plot(at, accelerations.mean(axis=0), color=COLOURS["damper"], label="their mean")
    if target is not None:
        inside = (at >= target.periods[0]) & (at <= target.periods[-1])
        ax.plot(at[inside], target.at(at[inside]), color=COLOURS["ground"], label="target")
        if span is not None:
            within = np.geomspace(*span, _POINTS)
            share = 0.9 * target.at(within)
            ax.plot(within, share, ":", color=COLOURS["ground"], label="90 % of it")
    if span is not None:
        ax.axvspan(*span, label="period range", **(shade("stick") | {"alpha": 0.15}))
    spectral_axes(ax, records.time_unit == SECONDS, damping)
    ax.set_xlim(at[0], at[-1])
    lowest = accelerations.mean(axis=0).min() if target is None else target.accelerations.min()
    ax.set_ylim(bottom=lowest / 5)
    house.legend_above(ax, 3)
    return ax
