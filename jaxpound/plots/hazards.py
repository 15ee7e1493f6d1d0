"""Figures of seismic hazard: the curve, and the intensities from which pounding comes."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import ArrayLike
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from jaxpound.plots.style import (
    COLOURS,
    in_house_style,
    label,
    legend,
    new_axes,
    new_figure,
    ratio_ticks,
    shade,
)
from jaxpound.risk.annual_rate import AnnualRate, Deaggregation
from jaxpound.risk.hazard import HazardCurve, rate_of

_WIDE = 300  # ratio of intensities from which ticks at powers of ten are enough
_MARKED = ((0.1, "10 % in 50 years"), (0.02, "2 % in 50 years"))


@in_house_style
def hazard_curve(hazard: HazardCurve, ax: Axes | None = None) -> Axes:
    """Annual rate of exceedance over intensity, with the rates of 10 % and 2 % in 50 years."""
    ax = new_axes(ax)
    im, rate = hazard.intensity, hazard.annual_rate
    ax.plot(im, rate, "o-", color=COLOURS["ground"], markersize=2.5, label="hazard")
    for (p, words), style in zip(_MARKED, ("--", ":"), strict=True):
        level = rate_of("hazard_curve", p, 50.0)
        if rate[-1] <= level <= rate[0]:
            colour = COLOURS["residual"]
            ax.axhline(level, color=colour, linestyle=style, linewidth=0.9, label=words)
    ax.set_xscale("log")
    ax.set_yscale("log")
    ratio_ticks(ax.xaxis)
    label(ax, hazard.measure, "exceedances per year")
    legend(ax, columns=2)
    return ax


@in_house_style
def deaggregation(
    rate: AnnualRate,
    ax: Axes | None = None,
    *,
    bands: int = 20,
    intensity: str | ArrayLike | None = None,
) -> Axes:
    """Share of the annual rate of pounding by bands of intensity, of one ratio each.

    Lines are ± one standard deviation of each share, as far as the fragility or the samples leave
    it open; of a study or a rare event ``intensity`` says by what (``AnnualRate.deaggregation``).
    The intensities beyond the ends of the hazard curve, where it is continued, are shaded.
    """
    return _bars(rate, rate.deaggregation(bands=bands, intensity=intensity), ax)


def _bars(rate: AnnualRate, found: Deaggregation, ax: Axes | None) -> Axes:
    """``deaggregation``."""
    ax = new_axes(ax)
    low, high = found.edges[[0, -1]]
    share = 100 * found.share
    ax.bar(
        found.edges[:-1],
        share,
        np.diff(found.edges),
        align="edge",
        color=COLOURS["pounding"],
        edgecolor="white",
        linewidth=0.4,
        label=rf"pounding, $\lambda = {_scientific(rate.value)}$ per year",
    )
    known = np.isfinite(found.cov)
    if known.any():
        centre = np.sqrt(found.edges[1:] * found.edges[:-1])[known]
        spread = (share * found.cov)[known]
        off = np.minimum(spread, share[known]), spread
        words = "± standard deviation"
        ax.errorbar(
            centre, share[known], off, fmt="none", color="black", linewidth=0.7, label=words
        )
    beyond = [(low, rate.ends[0]), (rate.ends[1], high)]
    for i, (start, end) in enumerate(x for x in beyond if x[0] < x[1]):
        words = "_" if i else "beyond the hazard curve"
        ax.axvspan(start, end, label=words, **shade("residual"))
    ax.set_xlim(low, high)
    ax.set_xscale("log")
    ratio_ticks(ax.xaxis)
    label(ax, found.measure, "share of the rate (%)")
    legend(ax, columns=2, bottom=0.0)
    return ax


@in_house_style
def pounding(
    hazard: HazardCurve,
    rate: AnnualRate,
    *,
    bands: int = 20,
    intensity: str | ArrayLike | None = None,
) -> Figure:
    """A hazard curve, and below it from which of its intensities the annual rate comes.

    ``intensity``, of a study or a rare event, is as of ``deaggregation``: numbers are taken to be
    of the curve's measure and unit, and share its axis.
    """
    found = rate.deaggregation(bands=bands, intensity=intensity)
    if intensity is not None and not isinstance(intensity, str):
        found = dataclasses.replace(found, measure=hazard.measure)
    shared = found.measure == hazard.measure
    figure = new_figure(1.0, 1.6)
    above, below = figure.subplots(2, sharex=shared)
    hazard_curve(hazard, above)
    _bars(rate, found, below)
    if shared:
        low, high = below.get_xlim()
        above.set_xlim(min(low, hazard.intensity[0]), max(high, hazard.intensity[-1]))
        if np.divide(*above.get_xlim()[::-1]) > _WIDE:
            below.xaxis.set_major_locator(LogLocator())
        above.set_xlabel("")
    return figure


def _scientific(x: float) -> str:
    digits, exponent = f"{x:.1e}".split("e")
    return rf"{digits} \times 10^{{{int(exponent)}}}"
