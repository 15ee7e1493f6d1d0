"""Figures of seismic hazard: the curve, and the intensities from which pounding comes."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import ArrayLike
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from jaxpound.hazard.annual_rate import AnnualRate, Deaggregation
from jaxpound.hazard.curve import HazardCurve
from jaxpound.hazard.points import rate_of
from jaxpound.plots import style as house
from jaxpound.plots.style import COLOURS, in_house_style, label, new_axes, shade


@in_house_style
def hazard_curve(hazard: HazardCurve, ax: Axes | None = None) -> Axes:
    """Annual rate of exceedance over intensity, with the rates of 10 % and 2 % in 50 years."""
    ax = new_axes(ax)
    im, rate = hazard.intensity, hazard.annual_rate
    ax.plot(im, rate, "o-", color=COLOURS["ground"], markersize=2.5, label="hazard")
    for p, words, style in ((0.1, "10 % in 50 years", "--"), (0.02, "2 % in 50 years", ":")):
        if rate[-1] <= (level := rate_of(p, 50.0)) <= rate[0]:
            line: Any = {"color": COLOURS["residual"], "linestyle": style, "linewidth": 0.9}
            ax.axhline(level, label=words, **line)
    ax.set(xscale="log", yscale="log")
    house.ratio_ticks(ax.xaxis)
    label(ax, hazard.measure, "exceedances per year")
    house.legend(ax, columns=2)
    return ax


def _deaggregation(ax: Axes, rate: AnnualRate, parts: Deaggregation) -> None:
    """Bands with ± one standard deviation of each share; shaded beyond the ends of the curve."""
    low, high = parts.edges[[0, -1]]
    share = 100 * parts.share
    style: Any = {"color": COLOURS["pounding"], "edgecolor": "white", "linewidth": 0.4}
    digits, exponent = f"{rate.value:.1e}".split("e")
    words = rf"{rate.event}, $\lambda = {digits} \times 10^{{{int(exponent)}}}$ per year"
    ax.bar(parts.edges[:-1], share, np.diff(parts.edges), align="edge", label=words, **style)
    if (estimated := np.isfinite(parts.cov)).any():
        centre = np.sqrt(parts.edges[1:] * parts.edges[:-1])[estimated]
        spread = (share * parts.cov)[estimated]
        off = np.minimum(spread, share[estimated]), spread
        style = {"fmt": "none", "color": "black", "linewidth": 0.7}
        ax.errorbar(centre, share[estimated], off, label="± standard deviation", **style)
    beyond = [(low, rate.ends[0]), (rate.ends[1], high)]
    for i, (start, end) in enumerate(x for x in beyond if x[0] < x[1]):
        ax.axvspan(start, end, label="_" if i else "beyond the hazard curve", **shade("residual"))
    ax.set(xlim=(low, high), xscale="log")
    house.ratio_ticks(ax.xaxis)
    label(ax, parts.measure, "share of the rate (%)")
    house.legend(ax, columns=2, bottom=0.0)


@in_house_style
def pounding(
    hazard: HazardCurve,
    rate: AnnualRate,
    *,
    bands: int = 20,
    intensity: str | ArrayLike | None = None,
) -> Figure:
    """A hazard curve, and below it from which of its intensities the annual rate comes.

    That is the share of bands of intensity, of one ratio each. Lines are ± one standard deviation
    of each share, as far as the fragility or the samples leave it open. The intensities beyond the
    ends of the hazard curve, where it is continued, are shaded.

    ``intensity``, of a study or a rare event, says by what (``AnnualRate.deaggregation``): numbers
    are taken to be of the curve's measure and unit, and share its axis.
    """
    parts = rate.deaggregation(bands, intensity=intensity)
    if intensity is not None and not isinstance(intensity, str):
        parts = dataclasses.replace(parts, measure=hazard.measure)
    shared = parts.measure == hazard.measure
    figure = house.new_figure(1.0, 1.6)
    above, below = figure.subplots(2, sharex=shared)
    hazard_curve(hazard, above)
    _deaggregation(below, rate, parts)
    if shared:
        low, high = below.get_xlim()
        above.set_xlim(min(low, hazard.intensity[0]), max(high, hazard.intensity[-1]))
        if np.divide(*above.get_xlim()[::-1]) > 300:  # ticks at powers of ten are enough
            below.xaxis.set_major_locator(LogLocator())
        above.set_xlabel("")
    return figure
