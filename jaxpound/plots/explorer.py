"""Sliders for every parameter of a pair, and its response redrawn while they are dragged.

Axes, ticks and legends take most of the drawing time. Each panel keeps them as an image, on which
only the lines are redrawn, until a run no longer fits the panel's axis: in hundredths of a second.
"""

from __future__ import annotations

import io
import re
from base64 import b64encode
from collections.abc import Iterable, Mapping
from html import escape
from typing import Any, NamedTuple
from unicodedata import lookup

import jax
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.image import imsave
from numpy.typing import NDArray

from jaxpound._checks import instance
from jaxpound._errors import InvalidInput
from jaxpound._extras import require
from jaxpound.grid import TimeGrid
from jaxpound.ground.record import Record
from jaxpound.ground.run_input import require_time_unit
from jaxpound.ground.wavelets import Ricker
from jaxpound.model import parameters
from jaxpound.model.structures import AdjacentStructures
from jaxpound.plots.curves import series_axis, time_label
from jaxpound.plots.style import COLOURS, in_house_style, label, shade
from jaxpound.quantities import unit
from jaxpound.results.response import Response
from jaxpound.scenarios.random_ground import WAVELET_KINDS
from jaxpound.simulation.run import simulate
from jaxpound.simulation.scheme import Scheme
from jaxpound.units import Scales

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
        self._stick = self._lowest = None
        if "friction" in spec.lines:
            self._stick = PolyCollection([], transform=ax.get_xaxis_transform(), **shade("stick"))
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


class Explorer:
    """A pair of buildings in a notebook: sliders for its parameters, and the response.

    The last expression of a cell shows it. ``sliders`` holds the widgets by the parameter's path
    (``explorer.sliders["friction"].value = 0.4``); ``structures``, ``ground`` and ``response`` are
    what is shown, in ``picture`` and ``words``. Needs the extra ``notebooks``.

    A slider is dragged from one round number to the next. Any other number can be typed into the
    field beside it or set by code, also outside of the slider's range, and stays as it was set.
    Structures with a contact law have sliders for its parameters too (``"contact.stiffness"``).

    ``structures`` are the single pair to begin with, dimensionless; ``ground`` is a ``Ricker``
    motion, whose wavelets get sliders, or a ``Record`` (in units of g and 1/ω1), which gets one for
    its strength. About a thousand instants of ``grid`` are fast enough to be redrawn live.
    ``scales`` shows results in SI units; the sliders stay dimensionless.

    An ``ImportError`` if ipywidgets is not installed; a ``ValueError`` if an argument is of another
    kind, or the first run is invalid. Where a choice breaks a rule (τf above τx, a step above the
    stability limit) the picture does not change, and the line below it says why.
    """

    def __init__(
        self,
        structures: AdjacentStructures,
        ground: Ricker | Record,
        grid: TimeGrid,
        scheme: Scheme = Scheme(),
        scales: Scales | None = None,
    ) -> None:
        widgets = require("Explorer", "ipywidgets")
        instance("Explorer", "structures", structures, AdjacentStructures)
        instance("Explorer", "ground", ground, Ricker, Record)
        require_time_unit("Explorer: ground", ground)
        instance("Explorer", "grid", grid, TimeGrid)
        instance("Explorer", "scheme", scheme, Scheme)
        if scales is not None:
            instance("Explorer", "scales", scales, Scales)
        if any(np.ndim(leaf) for leaf in jax.tree.leaves(structures)):
            raise InvalidInput("Explorer", "structures", "", "must be a single pair, not a batch")
        self._first = jax.tree.map(float, structures)
        self._ground, self._grid, self._scheme, self._scales = ground, grid, scheme, scales

        self.sliders: dict[str, Any] = {}
        self._quiet = False  # while many sliders move at once
        of_contact = [p for p in parameters.paths(self._first) if p.startswith("contact.")]
        rods = [f"rod_{i}.{name}" for i in (1, 2) for name in ("order", "tau_x", "tau_f")]
        groups = {"damper": ["friction", "initial_gap"], "contact": of_contact, "rods": rods}
        groups["buildings"] = ["mass_ratio", "stiffness_ratio"]
        tabs = {name: self._group(paths) for name, paths in groups.items() if paths}
        tabs["ground"] = self._group_of_ground()
        back = widgets.Button(description="reset", tooltip="back to the first values")
        back.on_click(lambda _: self.reset())

        self.structures, self.ground = self._first, ground
        # As the sliders have the numbers, so that the first move needs no other program.
        self.response = self._run(*self._chosen())
        self._panels = LivePanels(self.response)
        narrow = widgets.Layout(max_width="calc(100% - 4px)")  # less its margins
        self.picture = widgets.Image(format="png", layout=narrow)
        self.words = widgets.HTML()
        self._show()
        # Scrolled, and low enough that the picture stays in view.
        low = {"flex_flow": "column", "max_height": "15em", "overflow": "hidden auto"}
        boxes = [widgets.Box(group, layout=widgets.Layout(**low)) for group in tabs.values()]
        tab = widgets.Tab(boxes, titles=list(tabs))
        tab.layout.width = "37em"
        beside = widgets.VBox([self.picture, self.words])
        beside.layout = widgets.Layout(flex="1 1 40em", align_items="flex-start")
        wrapped = widgets.Layout(flex_flow="row wrap")
        self.widget = widgets.HBox([widgets.VBox([tab, back]), beside], layout=wrapped)

    def _repr_mimebundle_(self, **kwargs: Any) -> dict[str, Any]:
        # The picture is for viewers without live widgets.
        picture = b64encode(self.picture.value).decode()
        return self.widget._repr_mimebundle_(**kwargs) | {"image/png": picture}

    def _slider(
        self, name: str, words: str, value: float, low: float, high: float, is_ratio: bool = False
    ) -> Any:
        from jaxpound.plots.sliders import ExactSlider, even_marks, ratio_marks

        marks = ratio_marks if is_ratio else even_marks
        slider = ExactSlider(words, value, marks(min(low, value), max(high, value)))
        slider.observe(self._changed, names="value")
        self.sliders[name] = slider
        return slider

    def _group(self, paths: Iterable[str]) -> list[Any]:
        sliders = []
        for path in paths:
            field = parameters.metadata(self._first, path)
            words = plain(parameters.name(self._first, path))
            if field.kind:
                words += f" ({unit(field.kind, False)})"
            value = parameters.get(self._first, path)
            low, high = field.usual or (value, value)
            sliders.append(self._slider(path, words, value, low, high, field.is_ratio))
        return sliders

    def _group_of_ground(self) -> list[Any]:
        strength = self._slider("strength", "strength", 1.0, 0.0, 3.0)
        if not isinstance(self._ground, Ricker):
            return [strength]
        ranges = {"amplitude": (-1.0, 1.0), "period": (0.3, 6.0)}
        ranges["arrival"] = (0.0, self._grid.duration)
        ground, sliders = self._ground, [strength]
        series = np.broadcast_arrays(ground.amplitude, ground.periods, ground.arrivals)
        for i, numbers in enumerate(zip(*map(np.ravel, series), strict=True)):
            for (kind, ends), number in zip(ranges.items(), numbers, strict=True):
                words = f"{kind} {i + 1} ({unit(WAVELET_KINDS[kind], False)})"
                sliders.append(self._slider(f"{kind}_{i + 1}", words, float(number), *ends))
        return sliders

    def _chosen(self) -> tuple[AdjacentStructures, Any]:
        """Structures and ground set by the sliders; ValueError where they break a rule."""
        value = {name: slider.value for name, slider in self.sliders.items()}
        paths = parameters.paths(self._first)
        structures = parameters.put(self._first, {path: value[path] for path in paths})
        ground: Any = self._ground
        if isinstance(ground, Ricker):
            shape = np.shape(ground.periods)
            amplitudes, *times = (
                np.reshape([x for name, x in value.items() if name.startswith(f"{kind}_")], shape)
                for kind in ("amplitude", "period", "arrival")
            )
            return structures, Ricker(value["strength"] * amplitudes, *times)
        return structures, value["strength"] * ground

    def _run(self, structures: AdjacentStructures, ground: Any) -> Response:
        response = simulate(structures, ground, self._grid, self._scheme)
        return response if self._scales is None else self._scales.to_si(response)

    def _changed(self, _: Any) -> None:
        if self._quiet:
            return
        try:
            structures, ground = self._chosen()
            response = self._run(structures, ground)
        except (ValueError, ArithmeticError) as error:
            self.words.value = f'<span style="color: #D55E00">{escape(str(error))}</span>'
            return
        self.structures, self.ground, self.response = structures, ground, response
        self._show()

    def reset(self) -> None:
        """Back to the first values."""
        self._quiet = True
        for slider in self.sliders.values():
            slider.value = slider.first
        self._quiet = False
        self._changed(None)

    def _show(self) -> None:
        self.picture.value = self._panels.png(self.response)
        d, si = self.response.demand, self.response.si
        length, second = (f" {unit(kind, si)}".replace(" 1/", "/") for kind in ("length", "time"))
        phases = len(self.response.phases())
        pounds = " <b>The buildings pound.</b>" if d.pounds else ""
        if d.pounds and d.links[0].n_impacts is not None:
            n, lost = int(d.n_impacts), f"{float(d.contact_work):.3g} {unit('energy', si)}"
            times = f"{n} time{'s' * (n != 1)}"
            pounds = f" <b>The buildings pound {times}</b> and lose {lost}."
        self.words.value = (
            f"min gap {float(d.min_gap):.4g}{length} at t = {float(d.min_gap_time):.4g}{second}; "
            f"{phases} phase{'s' * (phases != 1)}, slid {float(d.slip_distance):.3g}{length}, "
            f"offset left {float(d.residual_offset) + 0.0:.3g}{length}.{pounds}"
        )


def plain(text: str) -> str:
    """A name with its mathematics as plain text, for places that do not render it: ``τ_x``."""
    text = re.sub(r"\$|\\bar|(?<=\\)var", "", text)
    return re.sub(r"\\([a-z]+)", lambda letter: lookup(f"GREEK SMALL LETTER {letter[1]}"), text)
