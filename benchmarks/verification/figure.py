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
    "Siconos, one run": (COLOURS["rods"], "D"),
}
COLUMNS = 3


@in_house_style
def accuracy_against_time(curves: Sequence[Curve]) -> Figure:
    """A panel for each problem, a line for each program, a point for each step."""
    panels = list(dict.fromkeys(curve.panel for curve in curves))
    columns, lines = max(min(len(panels), COLUMNS), 1), max(-(-len(panels) // COLUMNS), 1)
    drawing = new_figure(0.75 * columns, 1.1 * lines)
    for i, panel in enumerate(panels):
        ax = drawing.add_subplot(lines, columns, i + 1)
        for curve in curves:
            if curve.panel == panel:
                colour, marker = LOOKS[curve.program]
                milliseconds = [1e3 * seconds for seconds in curve.seconds]
                ax.loglog(
                    milliseconds, curve.errors, color=colour, marker=marker, label=curve.program
                )
        ax.set_title(panel)
        label(ax, "wall time of one run, ms", "largest error" if i % columns == 0 else "")
        low, high = ax.get_ylim()
        room = max(0.5, 0.2 * len(ax.lines))  # above the curves, for the legend
        ax.set_ylim(low, high * (high / low) ** room)
        ends = np.log10(ax.dataLim.intervalx)
        ax.set_xlim(10 ** np.floor(ends[0]), 10 ** np.ceil(ends[1]))
        ax.xaxis.set_minor_formatter(NullFormatter())
        ax.legend(loc="upper right", handlelength=1.4)
    return drawing
