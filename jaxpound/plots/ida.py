"""Figures of incremental dynamic analyses and clouds: axes in, axes out, in the common style."""

from __future__ import annotations

import re

import numpy as np
from matplotlib.axes import Axes

from jaxpound._checks import instance
from jaxpound.hazard.cloud import Cloud
from jaxpound.hazard.ida import FRACTILES, IncrementalDynamicAnalysis
from jaxpound.plots import style as house
from jaxpound.plots.style import COLOURS, in_house_style, label, new_axes, shade
from jaxpound.results.named import in_words, kind_of


@in_house_style
def curves(analysis: IncrementalDynamicAnalysis, ax: Axes | None = None) -> Axes:
    """Intensity over demand: a curve for each record, and their 16, 50 and 84 % fractiles.

    A dot on the threshold marks where a record first reaches it. Curves leave the figure beyond
    the 84 % fractile and three times the threshold. Where the threshold is 0,
    pounding by the overlap, the demand without shaking is minus the smallest gap at rest.
    """
    instance("analysis", analysis, IncrementalDynamicAnalysis)
    ax = new_axes(ax)
    shares = analysis.fractiles()
    demand = in_words(analysis.demand, analysis.topology), kind_of(analysis.demand)
    unit, words = house.with_unit(*demand, True, shares.max())
    im, limit, demands = analysis.intensities, unit * analysis.threshold, unit * analysis.demands
    first, *_ = ax.plot(demands.T, im, color=COLOURS["residual"], alpha=0.6, linewidth=0.6)
    first.set_label(f"{len(analysis.names)} records")
    for share, curve, style in zip(FRACTILES, unit * shares, ("--", "-", "--"), strict=True):
        name = {0.16: "16 and 84 %", 0.5: "median"}.get(share, "_84 %")
        ax.plot(curve, im, style, color=COLOURS["damper"], label=name)
    ax.axvline(limit, color=COLOURS["limit"], linewidth=0.9, label="threshold")
    if (capacities := analysis.capacities[np.isfinite(analysis.capacities)]).size:
        dots = np.full(capacities.size, limit)
        ax.plot(dots, capacities, "o", color=COLOURS["limit"], markersize=3, label="first reached")
    low, high = min(0.0, demands.min()), min(demands.max(), max(3 * limit, unit * shares.max()))
    ax.set_xlim(low, high if high > low else None)  # of a single run there is no range
    ax.set_ylim(0, im[-1])
    label(ax, words, in_symbols(analysis.measure))
    house.legend_above(ax, 3)
    return ax


@in_house_style
def cloud(found: Cloud, ax: Axes | None = None) -> Axes:
    """Demands of records over intensity, both logarithmic, and the line fitted with its ± σ.

    Demands of which only a lower bound is known are triangles.
    """
    instance("found", found, Cloud)
    ax = new_axes(ax)
    im, demand, censored = found.intensity, found.demand, found.censored
    name, kind = in_words(found.name, found.topology), kind_of(found.name)
    unit, words = house.with_unit(name, kind, True, float(demand.max()))
    at = np.geomspace(im.min(), im.max(), 40)
    middle, spread = unit * found.median(at), np.exp(found.dispersion)
    ax.fill_between(at, middle / spread, middle * spread, label=r"$\pm\sigma$", **shade("damper"))
    ax.plot(at, middle, color=COLOURS["damper"], label=rf"median, $b$ = {found.slope:.3g}")
    for selected, marker, name in (
        (~censored, "o", f"{np.count_nonzero(~censored)} records"),
        (censored, "^", "at least so much"),
    ):
        if selected.any():
            points = im[selected], unit * demand[selected]
            ax.plot(*points, marker, color="black", markersize=3, label=name)
    if found.threshold is not None:
        ax.axhline(unit * found.threshold, color=COLOURS["limit"], linewidth=0.9, label="threshold")
    house.log_log(ax)
    label(ax, in_symbols(found.measure), words)
    house.legend(ax, columns=3)
    return ax


def in_symbols(measure: str) -> str:
    """A measure of intensity as axes have it."""
    symbols = re.sub(r"^Sa\(", "$S_a$(", measure).replace("1/ω1", r"$/\omega_1$")
    return symbols.replace("(g)", "($g$)")
