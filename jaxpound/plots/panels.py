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

from jaxpound.plots.curves import series_axis, time_label
from jaxpound.plots.style import COLOURS, in_house_style, label, shade
from jaxpound.results.response import Response

_LEAST_USED = 0.35  # of an axis, before it is rescaled


class _PanelSpec(NamedTuple):
    words: str
    quantity: str
    lines: Mapping[str, tuple[str, str]]  # symbol and colour by the name of the series

    def axis(self, response: Response) -> tuple[float, str]:
        """Factor and label of the vertical axis, in the unit for a run."""
        symbols = ", ".join(symbol for symbol, _ in self.lines.values())
        series = [getattr(response, name) for name in self.lines]
        return series_axis(response, f"{self.words} {symbols}", self.quantity, series)


_MASSES = {"x1": ("$x_1$", "structure 1"), "x2": ("$x_2$", "structure 2")}
_PANELS = (
    _PanelSpec("ground acceleration", "acceleration", {"ground_acceleration": ("$u''$", "ground")}),
    _PanelSpec("displacement", "length", _MASSES),
    _PanelSpec("friction force", "force", {"friction": ("$q$", "damper")}),
    _PanelSpec("gap", "length", {"gap": (r"$\xi$", "damper")}),
)


class _Panel:
    """One picture with one pair of axes."""

    @in_house_style
    def __init__(self, spec: _PanelSpec, response: Response) -> None:
        figure = Figure(figsize=(4.1, 2.1), dpi=110)
        figure.set_layout_engine("none")
        self._canvas = FigureCanvasAgg(figure)
        self.ax = ax = figure.add_axes((0.18, 0.2, 0.77, 0.76))
        self._factor, words = self.axis = spec.axis(response)
        self.lines = {
            name: ax.plot([], [], color=COLOURS[colour], label=symbol)[0]
            for name, (symbol, colour) in spec.lines.items()
        }
        self._moving: list[Any] = list(self.lines.values())
        across = ax.get_xaxis_transform()
        self._stick = self._lowest = None
        if "friction" in spec.lines:
            self._stick = PolyCollection([], transform=across, **shade("stick"))
            ax.add_collection(self._stick, autolim=False)
            ax.fill_between([], [], label="stick", **shade("stick"))
            self._moving.insert(0, self._stick)
        if "gap" in spec.lines:
            (self._lowest,) = ax.plot([], [], "o", color=COLOURS["damper"], markersize=4)
            ax.axhspan(-1e9, 0, label=r"pounding, $\xi \leq 0$", **shade("pounding"))
            self._moving.append(self._lowest)
        for artist in self._moving:
            artist.set_animated(True)  # so that it is not in the kept image
        label(ax, time_label(response), words)
        ax.set_xlim(float(response.time[0]), float(response.time[-1]))
        ax.yaxis.set_label_coords(-0.165, 0.5)
        ax.ticklabel_format(axis="y", style="plain", useOffset=False)
        ax.legend(loc="upper right", ncols=2)
        self.axes_alone: Any = None

    def pixels(self, response: Response) -> NDArray[np.uint8]:
        """The run's picture, shape (height, width, 3)."""
        low, high = 0.0, 0.0
        for name, line in self.lines.items():
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
        bottom, top = self.ax.get_ylim()
        room = top - bottom
        fits = bottom <= low and high <= top - 0.2 * room and high - low > _LEAST_USED * room
        if self.axes_alone is None or not fits:
            span = (high - low) or 1.0  # with room to grow, and for the legend
            self.ax.set_ylim(low - 0.15 * span, high + 0.45 * span)
            self._canvas.draw()
            self.axes_alone = self._canvas.copy_from_bbox(self.ax.figure.bbox)
        self._canvas.restore_region(self.axes_alone)
        for artist in self._moving:
            self.ax.draw_artist(artist)
        return np.asarray(self._canvas.buffer_rgba())[..., :3]


class LivePanels:
    """Four panels over time of a single run, which sets units and time axis, and of others."""

    def __init__(self, response: Response) -> None:
        self._panels = [_Panel(spec, response) for spec in _PANELS]

    def png(self, response: Response) -> bytes:
        """The picture of a run on the same grid, as a PNG file."""
        for i, spec in enumerate(_PANELS):
            if self._panels[i].axis != spec.axis(response):
                self._panels[i] = _Panel(spec, response)
        upper_left, upper_right, *lower = (panel.pixels(response) for panel in self._panels)
        file = io.BytesIO()
        pixels = np.vstack([np.hstack([upper_left, upper_right]), np.hstack(lower)])
        imsave(file, pixels, format="png", pil_kwargs={"compress_level": 1})
        return file.getvalue()
