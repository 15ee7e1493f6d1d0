"""Errors over the time step: axes in, axes out, in the common style."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from jaxpound.figure_style import CYCLE, LINE_WIDTH, label, legend, new_axes, ratio_ticks


def errors_by_step(
    steps: Sequence[float], errors: Mapping[str, Any], ax: Axes | None = None, what: str = "error"
) -> Axes:
    """Errors over the time step, both logarithmic, with the order fitted to each line.

    Parameters
    ----------
    steps
        Time steps h > 0, shape (n,), in units of 1/ω1.
    errors
        Errors by name, shape (n,) each; their size is drawn. An order above a half is
        told of those that fall throughout.
    ax
        Where to draw.
    what
        The error's name and unit.
    """
    ax, h = new_axes(ax), np.asarray(steps, float)
    for i, (name, values) in enumerate(errors.items()):
        size = np.abs(np.asarray(values, float))
        order = np.polyfit(np.log(h), np.log(size), 1)[0]
        falls = (np.diff(size[np.argsort(h)]) > 0).all()
        words = f"{name} (order {order:.2f})" if falls and order > 0.5 else name
        ax.plot(
            h,
            size,
            color=CYCLE[i % len(CYCLE)],
            marker="osD^vP"[i % 6],
            markersize=3.5,
            linewidth=LINE_WIDTH,
            label=words,
        )
    ax.set_xscale("log")
    ax.set_yscale("log")
    ratio_ticks(ax.xaxis)
    label(ax, r"time step $h$ ($1/\omega_1$)", what)
    legend(ax, columns=1)
    return ax
