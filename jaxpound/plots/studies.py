"""Figures of a Monte Carlo study: axes in, axes out, in the common style."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxpound._checks import instance, require_one_of
from jaxpound._errors import InvalidInput
from jaxpound.plots import style as house
from jaxpound.plots.style import COLOURS, in_house_style, label, new_axes, shade
from jaxpound.results.named import kind_and_symbol
from jaxpound.study.fragility import ANY_LINK, Fragility
from jaxpound.study.gaps import RULES
from jaxpound.study.sensitivity import Sensitivity
from jaxpound.study.study import Study
from jaxpound.study.weighting import Hits

_POINTS = 200  # of a curve
_MOST_DOTS = 2000  # of a scatter diagram


@in_house_style
def min_gap(study: Study, ax: Axes | None = None) -> Axes:
    """Histogram of min gap and, on the right, its empirical distribution; pounding shaded.

    The axis leaves out the smallest thousandth, unless they are positive; the legend says how many
    lie further left. It also gives the share of samples whose smallest gap is the gap at rest, if
    that is 1 % or more; where the gap at rest is the same for all, they are in the last bar.
    """
    ax = new_axes(ax)
    gaps = study.finite("min_gap")
    low, high = np.quantile(gaps, [0.001, 1.0])
    low = min(low, 0.0)
    weights = _weights(study, "min_gap")
    counts, edges = np.histogram(gaps, np.linspace(low, high, 41), weights=weights)
    width, whole = np.diff(edges), weights.sum()
    style: Any = {"align": "edge", "color": COLOURS["damper"], "alpha": 0.6}
    ax.bar(edges[:-1], counts / (whole * width), width, **style)
    ax.axvspan(low, 0, label=r"pounding, $\xi \leq 0$", **shade("pounding"))
    ax.set_xlim(low, high)
    label(ax, _axis(study, "min_gap")[1], "density (1/m)" if study.si else "density")

    ax.plot([], [], color="black", label="cumulative share")
    if beyond := np.sum(gaps < low):
        ax.plot([], [], " ", label=f"further left: {beyond:,} of {gaps.size:,}")
    if "required_gap" in study.columns:
        stays = study.finite("required_gap") <= 0
        at_rest = float(np.average(stays, weights=_weights(study, "required_gap")))
        if at_rest >= 0.01:
            ax.plot([], [], " ", label=f"min = gap at rest: {100 * at_rest:.0f} %")
    house.legend_above(ax, 2)

    right = ax.twinx()
    order = np.argsort(gaps)
    right.plot(gaps[order], np.cumsum(weights[order]) / whole, color="black")
    right.set(ylim=(0, 1.05), yticks=[0, 0.5, 1])
    label(right, "", "cumulative share")
    right.grid(False)
    return ax


@in_house_style
def convergence(study: Study, ax: Axes | None = None, gap: float | None = None) -> Axes:
    """Probability of pounding by the first n samples over n, with its 95 % interval.

    For ``gap`` see ``Study.pounding_probability``.
    """
    ax = new_axes(ax)
    pounding = study.finite("pounds") == 1
    if gap is not None:
        pounding = study.finite("required_gap") >= gap
    sizes = np.unique(np.geomspace(min(10, pounding.size), pounding.size, _POINTS).astype(int))
    weights = _weights(study, "pga")
    hits = [Hits.of(pounding[:n], weights[:n]) for n in sizes]
    value, low, high = np.array([x.estimate(study.normalised)[:3] for x in hits]).T
    ax.fill_between(sizes, low, high, label="95 % interval", **shade("damper"))
    ax.plot(sizes, value, color=COLOURS["damper"], label="estimate")
    ax.set_xscale("log")
    label(ax, "samples $n$", "probability of pounding")
    house.share_axis(ax, 2)
    return ax


@in_house_style
def exceedance(study: Study, ax: Axes | None = None, rules_at: float | None = None) -> Axes:
    """Probability that the required gap exceeds a gap, over that gap, with its 95 % interval.

    ``rules_at`` marks a probability and the gaps of code rules at it (``separation``, of a pair).
    """
    separation = None if rules_at is None else study.separation(rules_at)
    ax = new_axes(ax)
    order = np.argsort(study.finite("required_gap"))
    ranked, n = study.finite("required_gap")[order], order.size
    more = np.unique(np.geomspace(1, n, _POINTS).astype(int))  # counts of exceedance
    gaps = ranked[n - more]
    weights = _weights(study, "required_gap")[order]
    hits = [Hits.of(ranked >= gap, weights) for gap in gaps]
    estimates = np.array([x.estimate(study.normalised)[:3] for x in hits])
    ax.plot(gaps, estimates[:, 0], color=COLOURS["damper"], label="estimate")
    ax.fill_between(gaps, *estimates[:, 1:].T, label="95 % interval", **shade("damper"))
    ax.set_yscale("log")
    if rules_at is not None:
        words = f"probability {100 * rules_at:.3g} %"
        ax.axhline(rules_at, color=COLOURS["residual"], linewidth=0.7, label=words)
        for (name, words), style in zip(reversed(RULES.items()), (":", "--", "-."), strict=True):
            at = getattr(separation, name)
            ax.axvline(at, color="black", linestyle=style, linewidth=0.9, label=words)
    label(ax, _axis(study, "required_gap")[1], "probability of exceedance")
    ax.set_ylim(top=1)
    house.legend_above(ax, 2)
    return ax


@in_house_style
def fragility(
    curve: Fragility | Mapping[str, Fragility], ax: Axes | None = None, intensity: str | None = None
) -> Axes:
    """Fragility curve with its 95 % band and the data; or several curves by name.

    A cloud is shown as the share of pounding in twelve groups of neighbouring intensities, with
    their intervals. Of several curves the data are left out; that named "any link" is black and
    dashed, for it often lies on that of one link. Beside more than six curves only "any link" has
    its band. ``intensity`` is the label of the axis, with the curve's unit in parentheses; by
    default its own measure.

    Examples
    --------
    >>> from jaxpound.plots.studies import fragility
    >>> pga, runs = [0.2, 0.4, 0.6, 0.8, 1.0], [20] * 5
    >>> counts = {"link 1": [0, 2, 5, 9, 12], "any link": [1, 4, 9, 14, 18]}
    >>> curves = {name: jp.fit_fragility(pga, often, runs) for name, often in counts.items()}
    >>> ax = fragility(curves, intensity="PGA ($g$)")
    >>> [line.get_label() for line in ax.lines]
    ['link 1', 'any link']
    """
    single = isinstance(curve, Fragility)
    if intensity is None:
        intensity = getattr(curve, "measure", "") or "im"
    if isinstance(curve, Fragility):
        axis_unit = re.search(r" \(([^()]+)\)$", intensity)
        median = f"{curve.median:.3g}{f' {axis_unit[1]}' if axis_unit else ''}"
        words = rf"$\theta$ = {median}, $\beta$ = {curve.dispersion:.3g}"
        drawn = [(words, "damper", curve)]
    else:
        drawn = _named(curve)
    few = len({words for words, *_ in drawn} - {ANY_LINK}) <= len(house.CYCLE)
    ax = new_axes(ax)
    members = [member for _, _, member in drawn]
    ends = np.hstack([np.append(m.intensity, [m.median / 4, m.median * 2]) for m in members])
    at = np.geomspace(ends.min(), ends.max(), _POINTS)
    for words, colour, member in drawn:
        style: Any = {"linestyle": "--"} if words == ANY_LINK else {}
        style |= {"color": COLOURS.get(colour, colour), "label": words}
        ax.plot(at, member.probability(at), **style)
        if words == ANY_LINK or few:
            low, high = member.band(at)
            if np.isnan(low).all():  # of a curve without errors
                continue
            of_band = {"label": "95 % band"} if single else {"alpha": 0.15}
            ax.fill_between(at, low, high, **(shade(colour) | of_band))
    if isinstance(curve, Fragility):
        if curve.intensity.size:
            im, shares = _shares(curve)
            off = np.abs(shares[:, 1:].T - shares[:, 0])
            points: Any = {"fmt": "o", "color": "black", "markersize": 3, "linewidth": 0.7}
            ax.errorbar(im, shares[:, 0], off, label="data", clip_on=False, **points)
    elif few or ANY_LINK in curve:
        ax.fill_between([], [], [], label="95 % band", **shade("residual"))
    ax.set_xscale("log")
    house.ratio_ticks(ax.xaxis)
    events = {member.event for member in members}
    label(ax, intensity, f"probability of {events.pop()}" if len(events) == 1 else "probability")
    house.share_axis(ax, 2 if single else 3)
    return ax


def _named(curves: Mapping[str, Fragility]) -> list[tuple[str, str, Fragility]]:
    """Name in the legend and colour of each of several curves."""
    instance("curve", curves, Mapping)
    if not curves:
        raise InvalidInput("curve", "{}", "must hold at least one curve")
    for name, curve in curves.items():
        instance(f"curve[{name!r}]", curve, Fragility)
    names = [name for name in curves if name != ANY_LINK]
    shown = zip(house.ends_named(names), house.numbered_colours(len(names)), strict=True)
    named = dict(zip(names, shown, strict=True)) | {ANY_LINK: (ANY_LINK, "ground")}
    return [(*named[name], curve) for name, curve in curves.items()]


@in_house_style
def scatter_matrix(
    study: Study, demands: Sequence[str] = ("required_gap",), names: Sequence[str] | None = None
) -> Figure:
    """Demands over parameters, a row for each demand and a column for each parameter.

    ``names`` chooses parameters; by default the four of the largest rank correlation with the first
    demand, of those that chance alone would not give. At most 2,000 samples are drawn; lines are
    the medians of ten groups of as many samples each.
    """
    parameters = study.parameters()
    by_demand = {demand: study.correlations(demand) for demand in demands}
    if names is None:
        sizes = {name: abs(np.nan_to_num(x)) for name, x in by_demand[demands[0]].items()}
        ranked = sorted(sizes, key=lambda name: -sizes[name])[:4]
        names = [name for name in ranked if sizes[name] > 1.96 / len(study) ** 0.5] or ranked[:1]
    for name in names:
        require_one_of(name, parameters)
    figure = house.new_figure(0.35 + 0.4 * len(names), 0.13 + 0.72 * len(demands))
    panels = figure.subplots(len(demands), len(names), sharex="col", sharey="row", squeeze=False)
    for row, demand in zip(panels, demands, strict=True):
        factor, demand_words = _axis(study, demand)
        values = factor * study[demand][:_MOST_DOTS]
        for ax, name in zip(row, names, strict=True):
            numbers = parameters[name][:_MOST_DOTS]
            size, words = house.parameter_axis(name, study.scales, float(np.abs(numbers).max()))
            style: Any = {"color": house.CYCLE[0], "markersize": 1.5, "alpha": 0.4}
            ax.plot(size * numbers, values, ".", rasterized=True, **style)
            groups = np.array_split(np.argsort(numbers), min(10, numbers.size))
            medians = [[np.median(y[group]) for group in groups] for y in (numbers, values)]
            ax.plot(size * np.array(medians[0]), medians[1], color="black", label="median")
            ax.set_title(f"rank corr. {by_demand[demand][name]:+.2f}".replace("-", "−"))
            label(ax, words.replace(": ", ":\n"), demand_words)
            ax.locator_params(axis="x", nbins=3)
            ax.label_outer()
    return figure


@in_house_style
def correlations(study: Study, ax: Axes | None = None, column: str = "required_gap") -> Axes:
    """Rank correlation of a column with the parameters as bars, the twelve largest on top."""
    finite = {k: v for k, v in study.correlations(column).items() if np.isfinite(v)}
    symbol = kind_and_symbol(column, study.stored_topology)[1]
    break_before = "\n" if "\n" in symbol else " "
    return house.signed_bars(ax, finite, f"rank correlation with{break_before}{symbol}")


@in_house_style
def sensitivity(indices: Sensitivity, ax: Axes | None = None) -> Axes:
    """First-order and total Sobol indices as bars with intervals, the twelve largest on top."""
    totals = {name: estimate.value for name, estimate in indices.total.items()}
    words = f"Sobol index of {kind_and_symbol(indices.demand, indices.topology)[1]}"
    ax, names, places = house.bars(ax, totals, words)
    for shift, name_of, by_name, colour in (
        (0.2, "first order", indices.first, house.CYCLE[0]),
        (-0.2, "total", indices.total, house.CYCLE[1]),
    ):
        value, low, high = np.array([by_name[name][:3] for name in names]).T
        ends = np.maximum([value - low, high - value], 0)
        style: Any = {"color": colour, "alpha": 0.8, "error_kw": {"linewidth": 0.7}}
        ax.barh(places + shift, value, 0.38, xerr=ends, label=name_of, **style)
    ax.legend(loc="lower right")
    return ax


def _weights(study: Study, column: str) -> np.ndarray:
    """Weights of the finite numbers of a column, 1 without weights."""
    if study.weighting is None:
        return np.ones(study.finite(column).size)
    return study.weights[np.isfinite(study[column])]


def _shares(curve: Fragility) -> tuple[np.ndarray, np.ndarray]:
    """Intensities of the data, a cloud in twelve groups, and the shares of pounding at each."""
    im, k, n = curve.intensity, curve.pounding, curve.trials
    if curve.stripes:
        hits = [Hits.of(np.arange(b) < a, np.ones(b)) for a, b in zip(k, n, strict=True)]
        return im, np.array([x.estimate(True)[:3] for x in hits])
    weights = np.ones(im.size) if curve.weights is None else curve.weights
    parts = np.array_split(np.argsort(im), min(12, im.size))
    centre = [np.exp(np.average(np.log(im[x]), weights=weights[x])) for x in parts]
    estimates = [Hits.of(k[x] > 0, weights[x]).estimate(True)[:3] for x in parts]
    return np.array(centre), np.array(estimates)


def _axis(study: Study, column: str) -> tuple[float, str]:
    """Factor and name, with its unit, of a column on an axis."""
    moments = study.moments(column)
    peak = max(-moments.smallest, moments.largest)
    return house.demand_axis(column, study.si, peak, study.stored_topology)
