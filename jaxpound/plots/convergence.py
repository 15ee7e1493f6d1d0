"""Errors over the time step: axes in, axes out, in the common style."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from jaxpound.plots.style import CYCLE, in_house_style, label, legend, new_axes


@in_house_style
def errors_by_step(
    steps: Sequence[float], errors: Mapping[str, Any], ax: Axes | None = None, what: str = "error"
) -> Axes:
    """Errors over the time step, both logarithmic, with the order fitted to each line.

    ``steps`` are time steps h > 0, shape (n,), in units of 1/ω1; ``errors`` are by name, shape (n,)
    each, and ``what`` is their name and unit. Absolute values are drawn, with the order where they
    lie on a straight line.
    """
    ax, h = new_axes(ax), np.asarray(steps, float)
    for i, (name, values) in enumerate(errors.items()):
        size = np.abs(np.asarray(values, float))
        order = _order(h, size)
        words = name if order is None else f"{name} (order {order:.2f})"
        style: Any = {"color": CYCLE[i % len(CYCLE)], "marker": "osD^vP"[i % 6]}
        ax.plot(h, size, markersize=3.5, label=words, **style)
    ax.set(xscale="log", yscale="log")
    ax.set_xticks(h, [f"{step:g}" for step in h])
    ax.minorticks_off()
    label(ax, r"time step $h$ ($1/\omega_1$)", what)
    legend(ax, columns=1)
    return ax


def _order(h: NDArray[np.float64], size: NDArray[np.float64]) -> float | None:
    """The slope of the errors' logarithms; None if an error is off the line by a third."""
    if h.size < 3 or not (size > 0).all():
        return None
    slope, start = np.polyfit(np.log(h), np.log(size), 1)
    off = np.abs(np.log(size) - start - slope * np.log(h)).max()
    return float(slope) if slope > 0.5 and off < 0.33 else None
