"""Ground motion, displacements, friction force and gap, redrawn in hundredths of a second.

Axes, ticks and legends take most of the drawing time. Each panel keeps them as an image, on which
only the lines are redrawn, until a run no longer fits the panel's axis.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.image import imsave
from numpy.typing import NDArray

from jaxpound.plots.style import COLOURS, in_house_style, label, shade, unit_for
from jaxpound.results.response import Response

_SIZE = (4.1, 2.1)  # of a panel, in inches
_FRAME = (0.18, 0.2, 0.77, 0.76)  # left, bottom, width, height in shares of it
_DPI = 110
_LEAST_USED = 0.35  # of an axis, before it is rescaled


class _Drawn(NamedTuple):
    words: str
    quantity: str
    lines: Mapping[str, tuple[str, str]]  # symbol and colour by the name of the series


_PANELS = (
    _Drawn("ground acceleration", "acceleration", {"ground_acceleration": ("$u''$", "ground")}),
    _Drawn(
        "displacement",
        "length",
        {"x1": ("$x_1$", "structure 1"), "x2": ("$x_2$", "structure 2")},
    ),
    _Drawn("friction force", "force", {"friction": ("$q$", "damper")}),
    _Drawn("gap", "length", {"gap": (r"$\xi$", "damper")}),
)


def _unit(drawn: _Drawn, response: Response) -> tuple[float, str]:
    largest = max(float(np.abs(getattr(response, name)).max()) for name in drawn.lines)
    return unit_for(drawn.quantity, response.si, largest)


class _Panel:
    """One picture with one pair of axes."""

    @in_house_style
    def __init__(self, drawn: _Drawn, response: Response) -> None:
        figure = Figure(figsize=_SIZE, dpi=_DPI)
        figure.set_layout_engine("none")
        self._canvas = FigureCanvasAgg(figure)
        self._ax = ax = figure.add_axes(_FRAME)
        self._factor, unit = self.unit = _unit(drawn, response)
        self._lines = {
            name: ax.plot([], [], color=COLOURS[colour], label=symbol)[0]
            for name, (symbol, colour) in drawn.lines.items()
        }
        self._moving: list[Any] = list(self._lines.values())
        across = ax.get_xaxis_transform()
        self._stick = self._lowest = None
        if "friction" in drawn.lines:
            self._stick = PolyCollection([], transform=across, **shade("stick"))
            ax.add_collection(self._stick, autolim=False)
            ax.fill_between([], [], label="stick", **shade("stick"))
            self._moving.insert(0, self._stick)
        if "gap" in drawn.lines:
            (self._lowest,) = ax.plot([], [], "o", color=COLOURS["damper"], markersize=4)
            ax.axhspan(-1e9, 0, label=r"pounding, $\xi \leq 0$", **shade("pounding"))
            self._moving.append(self._lowest)
        for artist in self._moving:
            artist.set_animated(True)  # so that it is not in the kept image
        symbols = ", ".join(symbol for symbol, _ in drawn.lines.values())
        time = unit_for("time", response.si, 0)[1]
        label(ax, f"time $t$ ({time})", f"{drawn.words} {symbols} ({unit})")
        ax.set_xlim(float(response.time[0]), float(response.time[-1]))
        ax.yaxis.set_label_coords(-0.165, 0.5)
        ax.ticklabel_format(axis="y", style="plain", useOffset=False)
        ax.legend(loc="upper right", ncols=2)
        self._axes_alone: Any = None

    def pixels(self, response: Response) -> NDArray[np.uint8]:
        """The run's picture, shape (height, width, 3)."""
        low, high = 0.0, 0.0
        for name, line in self._lines.items():
            values = self._factor * np.asarray(getattr(response, name))
            line.set_data(np.asarray(response.time), values)
            low, high = min(low, float(values.min())), max(high, float(values.max()))
        if self._stick is not None:
            sticks = [(p.start, p.end) for p in response.phases() if p.kind == "stick"]
            self._stick.set_verts([[(a, 0), (b, 0), (b, 1), (a, 1)] for a, b in sticks])
        if self._lowest is not None:
            demand = response.demand
            self._lowest.set_data([float(demand.min_gap_time)], [float(demand.min_gap)])
            low = min(low, float(demand.min_gap))
        if self._axes_alone is None or not self._fits(low, high):
            span = (high - low) or 1.0  # with room to grow, and for the legend
            self._ax.set_ylim(low - 0.15 * span, high + 0.45 * span)
            self._canvas.draw()
            self._axes_alone = self._canvas.copy_from_bbox(self._ax.figure.bbox)
        self._canvas.restore_region(self._axes_alone)
        for artist in self._moving:
            self._ax.draw_artist(artist)
        return np.asarray(self._canvas.buffer_rgba())[..., :3]

    def limits(self) -> tuple[float, float, list[Any]]:
        """Ends of the vertical axis, and the values drawn there."""
        return *self._ax.get_ylim(), [line.get_ydata() for line in self._lines.values()]

    def _fits(self, low: float, high: float) -> bool:
        bottom, top = self._ax.get_ylim()
        span = top - bottom
        return bottom <= low and high <= top - 0.2 * span and high - low > _LEAST_USED * span


class LivePanels:
    """Four panels over time, first of one run, then of others on the same grid.

    Parameters
    ----------
    response
        A single run, which determines the units and the time axis.
    """

    def __init__(self, response: Response) -> None:
        self._panels = [_Panel(drawn, response) for drawn in _PANELS]

    def limits(self) -> list[tuple[float, float, list[Any]]]:
        """Ends of each panel's vertical axis, and the values drawn there."""
        return [panel.limits() for panel in self._panels]

    def png(self, response: Response) -> bytes:
        """The picture of a run on the same grid, as a PNG file."""
        for i, drawn in enumerate(_PANELS):
            if self._panels[i].unit != _unit(drawn, response):
                self._panels[i] = _Panel(drawn, response)
        one, two, three, four = (panel.pixels(response) for panel in self._panels)
        file = io.BytesIO()
        pixels = np.vstack([np.hstack([one, two]), np.hstack([three, four])])
        imsave(file, pixels, format="png", pil_kwargs={"compress_level": 1})
        return file.getvalue()
