"""Figures of a Monte Carlo study: axes in, axes out, in the common style."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxpound._checks import instance
from jaxpound.plots.style import (
    COLOURS,
    CYCLE,
    bars,
    ends_named,
    in_house_style,
    label,
    legend,
    legend_above,
    new_axes,
    new_figure,
    numbered_colours,
    only_shares,
    parameter_axis,
    parameter_name,
    quantity_of,
    ratio_ticks,
    shade,
    signed_bars,
    unit_for,
)
from jaxpound.study.fragility import ANY_LINK, Fragility, grouped
from jaxpound.study.sensitivity import Sensitivity
from jaxpound.study.statistics import Estimate, probability
from jaxpound.study.study import Study
from jaxpound.study.weighting import Hits

_POINTS = 200  # of a curve
_MOST_DOTS = 2000  # of a scatter diagram
_FAINT = 0.15  # of bands that overlap


@in_house_style
def min_gap(study: Study, ax: Axes | None = None) -> Axes:
    """Histogram of min gap and, on the right, its empirical distribution; pounding shaded.

    The axis leaves out the smallest thousandth, unless they are positive; the legend says how many
    lie further left. It also gives the share of samples whose smallest gap is the gap at rest, if
    that is 1 % or more; where the gap at rest is the same for all, they are in the last bar.
    """
    ax = new_axes(ax)
    gaps = study.finite("min_gap")
    n = gaps.size
    low, high = np.quantile(gaps, [0.001, 1.0])
    low = min(low, 0.0)
    weights = _weights(study, "min_gap")
    counts, edges = np.histogram(gaps, np.linspace(low, high, 41), weights=weights)
    width, whole = np.diff(edges), n if weights is None else weights.sum()
    ax.bar(
        edges[:-1], counts / (whole * width), width, align="edge", color=COLOURS["damper"],
        alpha=0.6,
    )  # fmt: skip
    ax.axvspan(low, 0, label=r"pounding, $\xi \leq 0$", **shade("pounding"))
    ax.set_xlim(low, high)
    unit = _unit(study, "min_gap", "length")[1]
    label(ax, _name(study, "min_gap"), f"density (1/{unit})" if study.scales else "density")

    ax.plot([], [], color="black", label="cumulative share")
    beyond = np.sum(gaps < low)
    if beyond:
        ax.plot([], [], " ", label=f"further left: {beyond:,} of {n:,}")
    known = "required_gap" in study.columns
    if known and (still := _share(study, study.finite("required_gap") <= 0)) >= 0.01:
        ax.plot([], [], " ", label=f"min = gap at rest: {100 * still:.0f} %")
    legend_above(ax, 2)

    right = ax.twinx()
    reached = np.arange(1, n + 1)
    if weights is not None:
        reached = np.cumsum(weights[np.argsort(gaps)])
    right.plot(np.sort(gaps), reached / whole, color="black")
    right.set_ylim(0, 1.05)
    right.set_yticks([0, 0.5, 1])
    label(right, "", "cumulative share")
    right.grid(False)
    return ax


@in_house_style
def convergence(study: Study, ax: Axes | None = None, gap: float | None = None) -> Axes:
    """Probability of pounding by the first n samples over n, with its 95 % interval.

    For ``gap`` see ``Study.pounding_probability``.
    """
    ax = new_axes(ax)
    pounding = _pounding(study, gap)
    sizes = np.unique(np.geomspace(min(10, pounding.size), pounding.size, _POINTS).astype(int))
    estimates = _estimates(study, pounding, sizes, _weights(study, "pga"))
    value, low, high = np.array([estimate[:3] for estimate in estimates]).T
    ax.fill_between(sizes, low, high, label="95 % interval", **shade("damper"))
    ax.plot(sizes, value, color=COLOURS["damper"], label="estimate")
    ax.set_xscale("log")
    label(ax, "samples $n$", "probability of pounding")
    legend(ax)
    only_shares(ax)
    return ax


@in_house_style
def exceedance(study: Study, ax: Axes | None = None, rules_at: float | None = None) -> Axes:
    """Probability that the required gap exceeds a gap, over that gap, with its 95 % interval.

    ``rules_at`` marks a probability and the gaps that code rules ask for at it
    (``Study.separation``).
    """
    ax = new_axes(ax)
    order = np.argsort(study.finite("required_gap"))
    ranked, n = study.finite("required_gap")[order], order.size
    more = np.unique(np.geomspace(1, n, _POINTS).astype(int))  # counts of exceedance
    gaps, weights = ranked[n - more], _weights(study, "required_gap")
    if weights is None:
        estimates = np.array([probability(int(k), n)[:3] for k in more])
    else:
        estimates = np.array([study.pounding_probability(float(gap))[:3] for gap in gaps])
    colour = COLOURS["damper"]
    ax.plot(gaps, estimates[:, 0], color=colour, label="estimate")
    ax.fill_between(gaps, *estimates[:, 1:].T, label="95 % interval", **shade("damper"))
    ax.set_yscale("log")
    if rules_at is not None:
        found = study.separation(rules_at)
        words = f"probability {100 * rules_at:.3g} %"
        ax.axhline(rules_at, color=COLOURS["residual"], linewidth=0.7, label=words)
        for name, words, style in (
            ("double_difference", "double difference", ":"),
            ("srss", "SRSS", "--"),
            ("absolute_sum", "absolute sum", "-."),
        ):
            ax.axvline(
                getattr(found, name), color="black", linestyle=style, linewidth=0.9, label=words
            )
    label(ax, _name(study, "required_gap"), "probability of exceedance")
    ax.set_ylim(top=1)
    legend_above(ax, 2)
    return ax


@in_house_style
def fragility(
    curve: Fragility | Mapping[str, Fragility],
    ax: Axes | None = None,
    intensity: str | None = None,
    unit: float = 1.0,
) -> Axes:
    """Fragility curve with its 95 % band and the data; or several curves by name.

    A cloud is shown as the share of pounding in twelve groups of neighbouring intensities, with
    their intervals. Of several curves the data are left out; that named "any link" is black and
    dashed, for it often lies on that of one link. Beside more than six curves only "any link" has
    its band. ``intensity`` is the label of the axis, with its unit in parentheses (by default the
    curve's own measure); ``unit`` is that unit in the curve's own (9.80665 for g, of one in m/s²).

    Raises
    ------
    ValueError
        If there is no curve.

    Examples
    --------
    >>> from jaxpound.plots.studies import fragility
    >>> pga, runs = [0.2, 0.4, 0.6, 0.8, 1.0], [20] * 5
    >>> links = {"link 1": [0, 2, 5, 9, 12], "link 2": [1, 3, 8, 12, 16]}
    >>> curves = {name: jp.fit_fragility(pga, often, runs) for name, often in links.items()}
    >>> curves["any link"] = jp.fit_fragility(pga, [1, 4, 9, 14, 18], runs)
    >>> ax = fragility(curves, intensity="PGA ($g$)")
    >>> [line.get_label() for line in ax.lines]
    ['link 1', 'link 2', 'any link']
    """
    alone = isinstance(curve, Fragility)
    if intensity is None:
        intensity = (str(curve.measured) if isinstance(curve, Fragility) else "") or "im"
    drawn = [_alone(curve, intensity, unit)] if isinstance(curve, Fragility) else _named(curve)
    few = len({words for words, *_ in drawn} - {ANY_LINK}) <= len(CYCLE)
    ax = new_axes(ax)
    reach = np.array([_reach(one) for _, _, one in drawn])
    at = np.geomspace(reach[:, 0].min(), reach[:, 1].max(), _POINTS)
    for words, colour, one in drawn:
        line = "--" if words == ANY_LINK else "-"
        ax.plot(
            at / unit, one.probability(at), line, color=COLOURS.get(colour, colour), label=words
        )
        if words == ANY_LINK or few:
            low, high = one.band(at)
            if np.isnan(low).all():  # of a curve whose errors are not known
                continue
            of_band = {"label": "95 % band"} if alone else {"alpha": _FAINT}
            ax.fill_between(at / unit, low, high, **(shade(colour) | of_band))
    if isinstance(curve, Fragility):
        if curve.intensity.size:
            _data(ax, curve, unit)
    elif few or ANY_LINK in curve:
        ax.fill_between([], [], [], label="95 % band", **shade("residual"))
    ax.set_xscale("log")
    ratio_ticks(ax.xaxis)
    label(ax, intensity, "probability of pounding")
    legend(ax, columns=2 if alone else 4)
    only_shares(ax)
    return ax


def _alone(curve: Fragility, intensity: str, unit: float) -> tuple[str, str, Fragility]:
    """Its parameters, the median with the unit of ``intensity``, for the legend; its colour."""
    of = re.search(r" \(([^()]+)\)$", intensity)
    median = f"{curve.median / unit:.3g}{f' {of[1]}' if of else ''}"
    words = rf"$\theta$ = {median}, $\beta$ = {curve.dispersion:.3g}"
    return words, "damper", curve


def _named(curves: Mapping[str, Fragility]) -> list[tuple[str, str, Fragility]]:
    """Name in the legend and colour of each of several curves."""
    instance("fragility", "curve", curves, Mapping)
    if not curves:
        raise ValueError("fragility: curve = {} must hold at least one curve")
    for name, curve in curves.items():
        instance("fragility", f"curve[{name!r}]", curve, Fragility)
    names = [name for name in curves if name != ANY_LINK]
    shown = zip(ends_named(names), numbered_colours(len(names)), strict=True)
    named = dict(zip(names, shown, strict=True)) | {ANY_LINK: (ANY_LINK, "ground")}
    return [(*named[name], curve) for name, curve in curves.items()]


def _reach(curve: Fragility) -> tuple[float, float]:
    """The intensities between which a curve is drawn."""
    least, most = curve.median / 4, curve.median * 2
    if not curve.intensity.size:
        return least, most
    return min(least, curve.intensity.min()), max(most, curve.intensity.max())


def _data(ax: Axes, curve: Fragility, unit: float) -> None:
    """The data of a curve: shares of pounding with their intervals."""
    im, shares = _shares(curve)
    off = np.abs(shares[:, 1:].T - shares[:, 0])
    ax.errorbar(
        im / unit,
        shares[:, 0],
        off,
        fmt="o",
        color="black",
        markersize=3,
        linewidth=0.7,
        label="data",
    )


@in_house_style
def scatter_matrix(
    study: Study, demands: Sequence[str] = ("required_gap",), names: Sequence[str] | None = None
) -> Figure:
    """Demands over parameters, a row for each demand and a column for each parameter.

    ``names`` chooses parameters; by default the six of the largest rank correlation with the first
    demand. At most 2,000 samples are drawn.
    """
    parameters = study.parameters()
    if names is None:
        correlations = study.correlations(demands[0])
        names = sorted(correlations, key=lambda x: -abs(np.nan_to_num(correlations[x])))[:6]
    for name in names:
        if name not in parameters:
            raise ValueError(f"scatter_matrix: {name!r} must be one of {', '.join(parameters)}")
    figure = new_figure(0.35 + 0.4 * len(names), 0.13 + 0.72 * len(demands))
    panels = figure.subplots(len(demands), len(names), sharex="col", sharey="row", squeeze=False)
    for row, demand in zip(panels, demands, strict=True):
        kind, _ = quantity_of(demand)
        factor = _unit(study, demand, kind)[0] if kind else 1.0
        values = factor * study[demand][:_MOST_DOTS]
        for ax, name in zip(row, names, strict=True):
            drawn = parameters[name][:_MOST_DOTS]
            size, words = parameter_axis(name, study.scales, float(np.abs(drawn).max()))
            ax.plot(
                size * drawn,
                values,
                ".",
                color=CYCLE[0],
                markersize=1.5,
                alpha=0.4,
                rasterized=True,
            )
            label(ax, words, _name(study, demand))
            ax.locator_params(axis="x", nbins=3)
            ax.label_outer()
    return figure


@in_house_style
def correlations(study: Study, ax: Axes | None = None, column: str = "required_gap") -> Axes:
    """Rank correlation of a column with the parameters as bars, the twelve largest on top."""
    found = {k: v for k, v in study.correlations(column).items() if np.isfinite(v)}
    names = sorted(found, key=lambda name: abs(found[name]))[-12:]
    shown = {parameter_name(name): found[name] for name in names}
    return signed_bars(ax, shown, f"rank correlation with {_plain(column)}")


@in_house_style
def sensitivity(indices: Sensitivity, ax: Axes | None = None) -> Axes:
    """First-order and total Sobol indices as bars with intervals, the twelve largest on top."""
    names = sorted(indices.total, key=lambda name: indices.total[name].value)[-12:]
    ax = bars(ax, names)
    place = np.arange(len(names))
    for shift, kind, colour in ((0.2, "first", CYCLE[0]), (-0.2, "total", CYCLE[1])):
        estimates = [getattr(indices, kind)[name] for name in names]
        values = np.array([estimate.value for estimate in estimates])
        ends = np.array([[max(e.value - e.low, 0), max(e.high - e.value, 0)] for e in estimates]).T
        ax.barh(
            place + shift,
            values,
            0.38,
            xerr=ends,
            color=colour,
            alpha=0.8,
            error_kw={"linewidth": 0.7},
            label={"first": "first order", "total": "total"}[kind],
        )
    label(ax, f"Sobol index of {_plain(indices.demand)}", "")
    ax.set_yticks(place, [parameter_name(name) for name in names])
    ax.legend(loc="lower right")
    return ax


def _weights(study: Study, column: str) -> np.ndarray | None:
    """Weights of the finite numbers of a column; None if all samples count the same."""
    return None if study.weighting is None else study.weights[np.isfinite(study[column])]


def _share(study: Study, hits: np.ndarray) -> float:
    """Share of the samples with a required gap that are hits."""
    return float(np.average(hits, weights=_weights(study, "required_gap")))


def _estimates(
    study: Study, hits: np.ndarray, sizes: np.ndarray, weights: np.ndarray | None
) -> list[Estimate]:
    """Probability of hits by the first samples, for every number of these."""
    counts = np.cumsum(hits)[sizes - 1]
    if study.weighting is None or weights is None:
        return [probability(int(k), int(n)) for k, n in zip(counts, sizes, strict=True)]
    each = (weights, weights**2, weights * hits, weights**2 * hits)
    sums = np.stack([np.cumsum(x)[sizes - 1] for x in each], axis=1)
    normalised = study.weighting.normalised
    return [Hits(int(n), *x).estimate(normalised) for n, x in zip(sizes, sums, strict=True)]


def _shares(curve: Fragility) -> tuple[np.ndarray, np.ndarray]:
    """Intensities of the data, a cloud in twelve groups, and the shares of pounding at each."""
    im, k, n = curve.intensity, curve.pounding, curve.trials
    if curve.weights is not None and not curve.stripes:
        parts = np.array_split(np.argsort(im), 12)
        centre = [np.exp(np.average(np.log(im[x]), weights=curve.weights[x])) for x in parts]
        found = [Hits.of(k[x] > 0, curve.weights[x]).estimate(True)[:3] for x in parts]
        return np.array(centre), np.array(found)
    if not curve.stripes:
        im, k, n = grouped(im, k, 12)
    return im, np.array([probability(int(a), int(b))[:3] for a, b in zip(k, n, strict=True)])


def _plain(column: str) -> str:
    return quantity_of(column)[1]


def _name(study: Study, column: str) -> str:
    kind, words = quantity_of(column)
    return f"{words} ({_unit(study, column, kind)[1]})" if kind else words


def _unit(study: Study, column: str, quantity: str) -> tuple[float, str]:
    """Factor and name of a column's unit."""
    moments = study.moments(column)
    return unit_for(quantity, study.scales is not None, max(-moments.smallest, moments.largest))


def _pounding(study: Study, gap: float | None) -> Any:
    return study.finite("pounds") == 1 if gap is None else study.finite("required_gap") >= gap
