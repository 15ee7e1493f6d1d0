"""Figures of a design: axes in, axes out, in the common style."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np
from matplotlib.axes import Axes
from scipy.interpolate import RegularGridInterpolator

from jaxpound._errors import InvalidInput
from jaxpound.design.design import Comparison, Design, Landscape
from jaxpound.design.elasticity import Elasticities
from jaxpound.design.pareto import ParetoFront
from jaxpound.plots import style as house
from jaxpound.plots.style import COLOURS, in_house_style, label, new_axes, shade
from jaxpound.results.named import kind_and_symbol
from jaxpound.units import result_units


@in_house_style
def convergence(design: Design, ax: Axes | None = None) -> Axes:
    """Objective of every start over iterations, thin where it exceeds a limit; best in green."""
    ax = new_axes(ax)
    history = design.history
    k, starts = history.objective.shape
    factor, words = _objective_axis(design, design.objective)
    objective = factor * history.objective
    iterations = np.arange(1, k + 1)
    outside = False
    grey = COLOURS["residual"]
    thin: dict[str, Any] = {"linewidth": 0.5, "alpha": 0.5}
    for i in range(starts):
        line: dict[str, Any] = {"color": grey, "label": "_other"}
        if i == design.winner:
            line = {"color": COLOURS["damper"], "label": "winner", "zorder": 2.5}
            line["linewidth"] = 2 * house.LINE_WIDTH
        inside = history.alive[:, i] & (history.violation[:, i] <= design.limit_tolerance)
        ax.plot(iterations, objective[:, i], color=line["color"], **thin)
        ax.plot(iterations, np.where(inside, objective[:, i], np.nan), **line)
        outside |= not inside[history.alive[:, i]].all()
    if starts > 1:
        ax.plot([], [], color=grey, label="other starts")
    if outside:
        ax.plot([], [], color=grey, label="thin: limit exceeded", **thin)
    ax.margins(x=0)
    label(ax, "iteration", words)
    house.legend_above(ax, 2)
    return ax


@in_house_style
def landscape(
    design: Design, ax: Axes | None = None, drawn: Landscape | None = None, n: int = 15
) -> Axes:
    """Objective over two variables, with the path of the best start projected on it.

    Where a limit is exceeded it is shaded. ``drawn`` is a result of ``Design.landscape``; by
    default that of the two variables which changed most.
    """
    ax = new_axes(ax, height=1.25)
    if drawn is None:
        if design.space.dimension < 2:
            raise InvalidInput("design", "", "has one variable, and must have two or more")
        moved = np.abs(design.shares - design.history.shares[0, 0])
        i, j = np.sort(np.argsort(-moved, kind="stable")[:2])
        drawn = design.landscape(design.space.names[i], design.space.names[j], n)
    x_unit, x_words = _variable_axis(design, drawn.x, float(drawn.x_values.max()))
    y_unit, y_words = _variable_axis(design, drawn.y, float(drawn.y_values.max()))
    x, y = x_unit * drawn.x_values, y_unit * drawn.y_values
    style: Any = {"colors": COLOURS["ground"], "linewidths": 0.6, "alpha": 0.6}
    lines = ax.contour(x, y, drawn.objective, 12, **style)
    ax.clabel(lines, np.asarray(lines.levels)[::3], fontsize=house.FONT_SIZE - 2, fmt="%.3g")
    if (drawn.violation > design.limit_tolerance).any():
        beyond = [design.limit_tolerance, np.inf]
        x, y, violation = _violation_with_the_design(design, drawn)
        ax.contourf(x_unit * x, y_unit * y, violation, beyond, colors=COLOURS["limit"], alpha=0.3)
        ax.fill_between([], [], [], label="limit exceeded", **shade("limit"))
    path = jax.device_get(design.space.values(design.history.shares[:, design.winner]))
    xs, ys = x_unit * path[drawn.x], y_unit * path[drawn.y]
    end = x_unit * design.values[drawn.x], y_unit * design.values[drawn.y]
    green = COLOURS["damper"]
    ax.plot(xs, ys, color=green, label="path, projected")
    ax.plot(xs[0], ys[0], "o", color=green, markersize=3, fillstyle="none", label="start")
    ax.plot(*end, "*", color=green, markersize=8, label="design", zorder=5)
    variables = design.space.variables
    ax.set(xscale=variables[drawn.x].scale, yscale=variables[drawn.y].scale)
    label(ax, x_words, y_words)
    ax.margins(0.05)  # the design is often at a bound
    ax.autoscale_view(tight=False)
    for name, axis in ((drawn.x, ax.xaxis), (drawn.y, ax.yaxis)):
        if variables[name].scale == "log":
            house.ratio_ticks(axis)
    house.legend_above(ax, 2)
    return ax


def _variable_axis(design: Design, path: str, largest: float) -> tuple[float, str]:
    """Factor and name of a variable on an axis; in SI, of a design of ``Buildings``, its unit."""
    if (units := result_units(design.space.nominal)) is None:
        return 1.0, house.parameter_name(path)
    return house.parameter_axis(path, units, largest)


def _violation_with_the_design(
    design: Design, drawn: Landscape
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The landscape's axes and violation, with a row and a column added at the design.

    A design is often at an active limit. Interpolated between the landscape's points, the limit
    would be exceeded there; the violation at the design is exact.
    """

    def even(name: str, values: np.ndarray) -> np.ndarray:
        return np.log(values) if design.space.variables[name].scale == "log" else values

    x, y = drawn.x_values[0], drawn.y_values[:, 0]
    between = RegularGridInterpolator((even(drawn.y, y), even(drawn.x, x)), drawn.violation)
    x_design = np.clip(design.values[drawn.x], x[0], x[-1])
    y_design = np.clip(design.values[drawn.y], y[0], y[-1])
    x, y = np.union1d(x, x_design), np.union1d(y, y_design)
    violation = between(tuple(np.meshgrid(even(drawn.y, y), even(drawn.x, x), indexing="ij")))
    limits = design.objective_function.limits.items()
    at_design = [
        limit.limited(design.limited_demands[name]) / limit.bound - 1 for name, limit in limits
    ]
    violation[np.searchsorted(y, y_design), np.searchsorted(x, x_design)] = max(at_design)
    return x, y, violation


@in_house_style
def before_and_after(
    comparison: Comparison, ax: Axes | None = None, name: str | None = None
) -> Axes:
    """Distributions of a demand, by default the goal's, before and after; pounding shaded."""
    ax = new_axes(ax)
    name = comparison.objective_function.demand if name is None else name
    columns = (("before", comparison.before, "residual"), ("after", comparison.after, "damper"))
    largest = max(float(np.abs(x[name]).max()) for _, x, _ in columns)
    factor, words = house.demand_axis(name, comparison.si, largest, comparison.topology)
    share = np.arange(1, len(comparison) + 1) / len(comparison)
    for when, x, colour in columns:
        ax.step(factor * np.sort(x[name]), share, where="post", color=COLOURS[colour], label=when)
    if name == "min_gap" and (low := min(float(x[name].min()) for _, x, _ in columns)) <= 0:
        ax.axvspan(1.05 * low, 0, label=r"pounding, $\xi \leq 0$", **shade("pounding"))
    label(ax, words, "share of earthquakes")
    house.share_axis(ax, 3)
    return ax


@in_house_style
def pareto(front: ParetoFront, ax: Axes | None = None) -> Axes:
    """Pareto front: the objective over the limited demand, a point for each design."""
    ax = new_axes(ax)
    loosest = front.designs[0]
    over = front.over if isinstance(front.over, str) else f"worst {front.over:.0%}"
    largest, si = float(front.limited_demands.max()), loosest.trained.si
    kind, x_words = kind_and_symbol(front.limited_demand, loosest.trained.topology)
    factor, x_words = house.with_unit(f"{x_words}, {over}", kind, si, largest)
    objective_factor, y_words = _objective_axis(loosest, float(np.abs(front.objectives).max()))
    x, y = factor * front.limited_demands, objective_factor * front.objectives
    ax.plot(x, y, "o-", color=COLOURS["damper"], markersize=3)
    label(ax, x_words, y_words)
    return ax


@in_house_style
def tornado(found: Elasticities, ax: Axes | None = None) -> Axes:
    """Elasticities as bars, the twelve largest on top."""
    words = f"% of {kind_and_symbol(found.demand, found.topology)[1]}\nper % of the parameter"
    return house.signed_bars(ax, found.values, words)


def _objective_axis(design: Design, largest: float) -> tuple[float, str]:
    """Factor and name of the objective, with its unit where it has one."""
    kind = design.objective_function.quantity
    return house.with_unit("objective", kind, design.trained.si, abs(largest))
