"""Accuracy against wall time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from benchmarks.verification.case import Curve
from jaxpound.plots.style import COLOURS, in_house_style, label, new_figure

LOOKS = {
    "default scheme": (COLOURS["structure 1"], "o"),
    "paper's scheme": (COLOURS["residual"], "s"),
    "jaxpound, one run": (COLOURS["structure 1"], "o"),
    "jaxpound, a run of a batch": (COLOURS["damper"], "^"),
    "OpenSees, one run": (COLOURS["structure 2"], "s"),
}


@in_house_style
def accuracy_against_time(curves: Sequence[Curve]) -> Figure:
    """A panel for each problem, a line for each program, a point for each step."""
    panels = list(dict.fromkeys(curve.panel for curve in curves))
    drawing = new_figure(0.75 * max(len(panels), 1), 1.1)
    for i, panel in enumerate(panels):
        ax = drawing.add_subplot(1, len(panels), i + 1)
        for curve in curves:
            if curve.panel == panel:
                colour, marker = LOOKS[curve.program]
                milliseconds = [1e3 * seconds for seconds in curve.seconds]
                ax.loglog(
                    milliseconds, curve.errors, color=colour, marker=marker, label=curve.program
                )
        ax.set_title(panel)
        label(ax, "wall time of one run, ms", "largest error" if i == 0 else "")
        low, high = ax.get_ylim()
        ax.set_ylim(low, high * (high / low) ** 0.5)
        ends = np.log10(ax.dataLim.intervalx)
        ax.set_xlim(10 ** np.floor(ends[0]), 10 ** np.ceil(ends[1]))
        ax.xaxis.set_minor_formatter(NullFormatter())
        ax.legend(loc="upper right", handlelength=1.4)
    return drawing
