"""Figures of a design: axes in, axes out, in the common style."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from scipy.interpolate import RegularGridInterpolator

from jaxpound.design.design import Comparison, Design, Landscape
from jaxpound.design.elasticity import Elasticities
from jaxpound.design.pareto import ParetoFront
from jaxpound.plots.style import (
    COLOURS,
    FONT_SIZE,
    LINE_WIDTH,
    in_house_style,
    label,
    legend,
    legend_above,
    new_axes,
    only_shares,
    parameter_name,
    quantity_of,
    ratio_ticks,
    shade,
    signed_bars,
    unit_for,
)


@in_house_style
def convergence(design: Design, ax: Axes | None = None) -> Axes:
    """Objective of every start over iterations, thin where it exceeds a limit; best in green."""
    ax = new_axes(ax)
    history = design.history
    k, starts = history.objective.shape
    factor, unit = _unit(design, design.objective)
    objective = factor * history.objective
    iterations = np.arange(1, k + 1)
    outside = False
    for i in range(starts):
        colour = COLOURS["damper"] if i == design.winner else COLOURS["residual"]
        inside = history.alive[:, i] & (history.violation[:, i] <= design.limit_tolerance)
        ax.plot(iterations, objective[:, i], color=colour, linewidth=0.5, alpha=0.5)
        kept = np.where(inside, objective[:, i], np.nan)
        words = "winner" if i == design.winner else "_other"
        width = (2 if i == design.winner else 1) * LINE_WIDTH
        on_top = 2.5 if i == design.winner else 2.0
        ax.plot(iterations, kept, color=colour, linewidth=width, label=words, zorder=on_top)
        outside |= not inside[history.alive[:, i]].all()
    grey = COLOURS["residual"]
    if starts > 1:
        ax.plot([], [], color=grey, label="other starts")
    if outside:
        ax.plot([], [], color=grey, linewidth=0.5, alpha=0.5, label="thin: limit exceeded")
    ax.margins(x=0)
    label(ax, "iteration", f"objective{unit}")
    legend_above(ax, 2)
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
            raise ValueError("landscape: design has one variable, and must have two or more")
        moved = np.abs(design.shares - design.history.shares[0, 0])
        i, j = np.sort(np.argsort(-moved, kind="stable")[:2])
        drawn = design.landscape(design.space.names[i], design.space.names[j], n)
    x, y, z = drawn.x_values, drawn.y_values, drawn.objective
    lines = ax.contour(x, y, z, 12, colors=COLOURS["ground"], linewidths=0.6, alpha=0.6)
    ax.clabel(lines, np.asarray(lines.levels)[::3], fontsize=FONT_SIZE - 2, fmt="%.3g")
    if (drawn.violation > design.limit_tolerance).any():
        beyond = [design.limit_tolerance, np.inf]
        seen = _violation_with_the_design(design, drawn)
        ax.contourf(*seen, beyond, colors=COLOURS["limit"], alpha=0.3)
        ax.fill_between([], [], [], label="limit exceeded", **shade("limit"))
    path = design.space.numbers(design.history.shares[:, design.winner])
    xs, ys = path[drawn.x], path[drawn.y]
    ax.plot(xs, ys, color=COLOURS["damper"], label="path, projected")
    ax.plot(
        xs[0], ys[0], "o", color=COLOURS["damper"], markersize=3, fillstyle="none", label="start"
    )
    end = design.values
    ax.plot(
        end[drawn.x],
        end[drawn.y],
        "*",
        color=COLOURS["damper"],
        markersize=8,
        label="design",
        zorder=5,
    )
    ax.set_xscale(design.space.variables[drawn.x].scale)
    ax.set_yscale(design.space.variables[drawn.y].scale)
    label(ax, parameter_name(drawn.x), parameter_name(drawn.y))
    ax.margins(0.05)  # the design is often at a bound
    ax.autoscale_view(tight=False)
    for name, one in ((drawn.x, ax.xaxis), (drawn.y, ax.yaxis)):
        if design.space.variables[name].scale == "log":
            ratio_ticks(one)
    legend_above(ax, 2)
    return ax


def _violation_with_the_design(
    design: Design, drawn: Landscape
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The landscape's axes and violation, with a row and a column added at the design.

    A design is often at an active limit. Interpolated between the landscape's points, the limit
    would be exceeded there; at the design itself the violation is known.
    """

    def even(name: str, values: np.ndarray) -> np.ndarray:
        return np.log(values) if design.space.variables[name].scale == "log" else values

    x, y = drawn.x_values[0], drawn.y_values[:, 0]
    between = RegularGridInterpolator((even(drawn.y, y), even(drawn.x, x)), drawn.violation)
    x_own, y_own = (np.clip(design.values[n], v[0], v[-1]) for n, v in ((drawn.x, x), (drawn.y, y)))
    x, y = np.union1d(x, x_own), np.union1d(y, y_own)
    places = np.meshgrid(even(drawn.y, y), even(drawn.x, x), indexing="ij")
    violation = between(tuple(places))
    limits = design.objective_function.limits
    own = max(one.limited(design.prices[name]) / one.bound - 1 for name, one in limits.items())
    violation[np.searchsorted(y, y_own), np.searchsorted(x, x_own)] = own
    return x, y, violation


@in_house_style
def before_and_after(
    comparison: Comparison, ax: Axes | None = None, name: str | None = None
) -> Axes:
    """Empirical distributions of a demand before and after; pounding shaded.

    By default of the demand that the goal is of, such as the smallest gap.
    """
    ax = new_axes(ax)
    name = comparison.objective_function.demand if name is None else name
    kind, words = quantity_of(name)
    columns = (("before", comparison.before, "residual"), ("after", comparison.after, "damper"))
    largest = max(float(np.abs(x[name]).max()) for _, x, _ in columns)
    factor, unit = unit_for(str(kind), comparison.si, largest)
    share = np.arange(1, len(comparison) + 1) / len(comparison)
    for when, x, colour in columns:
        ranked = factor * np.sort(x[name])
        ax.step(ranked, share, where="post", color=COLOURS[colour], label=when)
    if name == "min_gap":
        low = min(float(x[name].min()) for _, x, _ in columns)
        if low <= 0:
            ax.axvspan(1.05 * low, 0, label=r"pounding, $\xi \leq 0$", **shade("pounding"))
    label(ax, f"{words} ({unit})", "share of earthquakes")
    legend(ax, columns=3)
    only_shares(ax)
    return ax


@in_house_style
def pareto(front: ParetoFront, ax: Axes | None = None) -> Axes:
    """Pareto front: the objective over the limited demand, a point for each design."""
    ax = new_axes(ax)
    kind, words = quantity_of(front.price)
    si = front.designs[0].trained.si
    factor, unit = unit_for(str(kind), si, float(front.prices.max()))
    own_factor, own_unit = _unit(front.designs[0], float(np.abs(front.objectives).max()))
    ax.plot(
        factor * front.prices,
        own_factor * front.objectives,
        "o-",
        color=COLOURS["damper"],
        markersize=3,
    )
    over = front.over if isinstance(front.over, str) else f"worst {front.over:.0%}"
    label(
        ax,
        f"{words}, {over} ({unit})",
        f"objective{own_unit}",
    )
    return ax


@in_house_style
def tornado(found: Elasticities, ax: Axes | None = None) -> Axes:
    """Elasticities as bars, the twelve largest on top."""
    names = sorted(found.values, key=lambda path: abs(found.values[path]))[-12:]
    shown = {parameter_name(path): found.values[path] for path in names}
    return signed_bars(ax, shown, f"% of {quantity_of(found.demand)[1]}\nper % of the parameter")


def _unit(design: Design, largest: float) -> tuple[float, str]:
    """Factor and unit of the objective, where it has one."""
    quantity = design.objective_function.quantity
    if not quantity:
        return 1.0, ""
    factor, unit = unit_for(quantity, design.trained.si, abs(largest))
    return factor, f" ({unit})"
