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
    "jaxonomy, one run": (COLOURS["ground"], "v"),
    "jaxonomy, a run of a batch": (COLOURS["ground"], "x"),
}
COLUMNS = 4


@in_house_style
def accuracy_against_time(curves: Sequence[Curve]) -> Figure:
    """A panel for each problem, a line for each program, a point for each step; then a legend."""
    panels = list(dict.fromkeys(curve.panel for curve in curves))
    columns, lines = min(len(panels) + 1, COLUMNS), -(-(len(panels) + 1) // COLUMNS)
    drawing = new_figure(0.7 * columns, 1.1 * lines)
    entries = {}
    for i, panel in enumerate(panels):
        ax = drawing.add_subplot(lines, columns, i + 1)
        for curve in curves:
            if curve.panel == panel:
                colour, marker = LOOKS[curve.program]
                milliseconds = [1e3 * seconds for seconds in curve.seconds]
                name = "jaxpound, one run" if curve.program == "default scheme" else curve.program
                (entries[name],) = ax.loglog(
                    milliseconds, curve.errors, color=colour, marker=marker
                )
        ax.set_title(panel)
        label(ax, "wall time (ms)", "largest error (–)" if i % columns == 0 else "")
        ends = np.log10(ax.dataLim.intervalx)
        ax.set_xlim(10 ** np.floor(ends[0]), 10 ** np.ceil(ends[1]))
        ax.xaxis.set_minor_formatter(NullFormatter())
    corner = drawing.add_subplot(lines, columns, len(panels) + 1)
    corner.set_axis_off()
    corner.legend(entries.values(), entries.keys(), loc="center left", handlelength=1.4)
    return drawing
