"""Sliders for every parameter of a pair, and its response redrawn while they are dragged.

Axes, ticks and legends take most of the drawing time. They are kept as an image, on which only the
lines are redrawn, in hundredths of a second; a panel is drawn anew when a run no longer fits it.
"""

from __future__ import annotations

import io
import re
from base64 import b64encode
from collections.abc import Iterator
from dataclasses import replace
from html import escape
from typing import Any
from unicodedata import lookup

import jax
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imsave

from jaxpound._checks import instance
from jaxpound._errors import InvalidInput
from jaxpound._extras import require
from jaxpound._fields import Parameter
from jaxpound.buildings import Buildings
from jaxpound.grid import TimeGrid
from jaxpound.ground.record import Record
from jaxpound.ground.wavelets import Ricker
from jaxpound.model import parameters
from jaxpound.model.structures import AdjacentStructures
from jaxpound.model.system import in_si
from jaxpound.plots.curves import Curve, series_axis, time_label
from jaxpound.plots.style import COLOURS, in_house_style, label, shade
from jaxpound.quantities import unit
from jaxpound.results.named import PAIR
from jaxpound.results.response import Response
from jaxpound.scenarios.random_ground import WAVELET_KINDS
from jaxpound.simulation.run import simulate
from jaxpound.simulation.scheme import Scheme


def _panels(response: Response) -> list[tuple[str, str, list[Curve]]]:
    """Words and kind of quantity of each vertical axis, and its curves."""
    r, d = response, response.demand
    ground = [Curve("$u''$", "ground", r.ground_acceleration)]
    displacements = [Curve("$x_1$", "structure 1", r.x1), Curve("$x_2$", "structure 2", r.x2)]
    lowest = Curve("_lowest", "damper", d.min_gap[None], d.min_gap_time[None])
    return [
        ("ground acceleration $u''$", "acceleration", ground),
        ("displacement $x_1$, $x_2$", "length", displacements),
        ("friction force $q$", "force", [Curve("$q$", "damper", r.friction)]),
        (r"gap $\xi$", "length", [Curve(r"$\xi$", "damper", r.gap), lowest]),
    ]


class LivePanels:
    """Four panels over time of a single run, which sets the time axis, and of others."""

    @in_house_style
    def __init__(self, response: Response) -> None:
        self.figure = Figure(figsize=(8.2, 4.2), dpi=110)
        self.figure.set_layout_engine("none")
        self._canvas = FigureCanvasAgg(self.figure)
        panels: Any = self.figure.subfigures(2, 2, facecolor="white")
        for panel, (*_, curves) in zip(panels.flat, _panels(response), strict=True):
            ax = panel.add_axes((0.18, 0.2, 0.77, 0.76))
            for curve in curves:  # animated, so that the kept image is without them
                kind, colour = "-" if curve.times is None else "o", COLOURS[curve.colour]
                ax.plot([], [], kind, markersize=4, color=colour, label=curve.label, animated=True)
            label(ax, time_label(response), "")
            ax.set_xlim(float(response.time[0]), float(response.time[-1]))
            ax.yaxis.set_label_coords(-0.165, 0.5)
            ax.ticklabel_format(axis="y", style="plain", useOffset=False)
        *_, force, gap = self.figure.axes
        self._stick = force.fill_between([], [], label="stick", animated=True, **shade("stick"))
        self._stick.set_transform(force.get_xaxis_transform())
        gap.axhspan(-1e9, 0, label=r"pounding, $\xi \leq 0$", **shade("pounding"))
        for ax in self.figure.axes:
            ax.legend(loc="upper right", ncols=2)
        self._axes_alone = self._canvas.copy_from_bbox(self.figure.bbox)

    def png(self, response: Response) -> bytes:
        """The picture of a run on the same grid, as a PNG file."""
        sticks = [(p.start, p.end) for p in response.phases() if p.kind == "stick"]
        self._stick.set_verts([[(a, 0), (b, 0), (b, 1), (a, 1)] for a, b in sticks])
        renderer = self._canvas.get_renderer()
        self._canvas.restore_region(self._axes_alone)
        for ax, (words, kind, curves) in zip(self.figure.axes, _panels(response), strict=True):
            factor, words = series_axis(response, words, kind, [curve.values for curve in curves])
            low, high = 0.0, 0.0
            for line, curve in zip(ax.lines, curves, strict=True):
                times = response.time if curve.times is None else curve.times
                values = factor * np.asarray(curve.values)
                line.set_data(np.asarray(times), values)
                low, high = min(low, float(values.min())), max(high, float(values.max()))
            bottom, top = ax.get_ylim()
            room, used = top - bottom, high - low
            fits = bottom <= low and high <= top - 0.2 * room and used > 0.35 * room
            if not fits or words != ax.get_ylabel():
                span = used or 1.0  # with room to grow, and for the legend
                ax.set(ylabel=words, ylim=(low - 0.15 * span, high + 0.45 * span))
                ax.figure.draw(renderer)
        self._axes_alone = self._canvas.copy_from_bbox(self.figure.bbox)
        for artist in (self._stick, *(line for ax in self.figure.axes for line in ax.lines)):
            artist.draw(renderer)
        file, pixels = io.BytesIO(), np.asarray(self._canvas.buffer_rgba())[..., :3]
        imsave(file, pixels, format="png", pil_kwargs={"compress_level": 1})
        return file.getvalue()


_TABS = {  # parameters by their names; those of a law of contact together
    "damper": ("friction", "initial_gap", "gap"),
    "contact": ("contact",),
    "rods": ("order", "tau_x", "tau_f", "dashpot", "ratio"),
    "buildings": ("mass_ratio", "stiffness_ratio", "mass", "stiffness"),
}


class Explorer:
    """A pair of buildings in a notebook: sliders for its parameters, and the response.

    The last expression of a cell shows it. ``sliders`` holds the widgets by the parameter's path
    (``explorer.sliders["friction"].value = 0.4``); ``structures``, ``ground`` and ``response`` are
    what is shown, in ``picture`` and ``words``. Needs the extra ``notebooks``.

    A slider is dragged from one round number to the next. Any other number can be typed into the
    field beside it or set by code, also outside of the slider's range, and stays as it was set.
    Structures with a contact law have sliders for its parameters too (``"contact.stiffness"``).

    ``structures`` are the single pair to begin with: ``AdjacentStructures``, or ``Buildings`` of
    one storey with one link. ``ground`` is a ``Ricker`` motion, whose wavelets get sliders, or a
    ``Record``, which gets one for its strength; in the units of the structures, as results are.
    About a thousand instants of ``grid`` are fast enough to be redrawn live.

    An ``ImportError`` if ipywidgets is not installed; a ``ValueError`` if an argument is of another
    kind, or the first run is invalid. Where a choice breaks a rule (τf above τx, a step above the
    stability limit) the picture does not change, and the line below it says why.
    """

    def __init__(
        self,
        structures: AdjacentStructures | Buildings,
        ground: Ricker | Record,
        grid: TimeGrid,
        scheme: Scheme = Scheme(),
    ) -> None:
        widgets = require("ipywidgets")
        from jaxpound.plots.sliders import ExactSlider, even_marks, ratio_marks

        instance("structures", structures, AdjacentStructures, Buildings)
        instance("ground", ground, Ricker, Record)
        instance("grid", grid, TimeGrid)
        if any(np.ndim(leaf) for leaf in jax.tree.leaves(structures)):
            raise InvalidInput("structures", "", "must be a single pair, not a batch")
        if structures.system().topology != PAIR:
            rule = "must be two buildings of one storey with one link"
            raise InvalidInput("structures", "", rule)
        self._first, self._ground = jax.tree.map(float, structures), ground
        self._grid, self._scheme = grid, scheme
        self._panels: LivePanels | None = None

        self.sliders: dict[str, Any] = {}
        tabs: dict[str, list[Any]] = {}
        for tab, name, words, field, value in self._slider_fields():
            low, high = field.usual or (value / 5, 5 * value)
            marks = ratio_marks if field.is_ratio else even_marks
            words += f" ({unit(field.kind, in_si(structures))})" if field.kind else ""
            slider = ExactSlider(words, value, marks(min(low, value), max(high, value)))
            slider.observe(self._changed, names="value")
            tabs.setdefault(tab, []).append(slider)
            self.sliders[name] = slider
        # Scrolled, and low enough that the picture stays in view.
        scrolled = {"flex_flow": "column", "max_height": "15em", "overflow": "hidden auto"}
        boxes = [widgets.Box(sliders, layout=scrolled) for sliders in tabs.values()]
        all_tabs = widgets.Tab(boxes, titles=list(tabs), layout={"width": "37em"})
        back = widgets.Button(description="reset", tooltip="back to the first values")
        back.on_click(lambda _: self.reset())
        narrow = {"max_width": "calc(100% - 4px)"}  # less its margins
        self.picture, self.words = widgets.Image(format="png", layout=narrow), widgets.HTML()
        beside = widgets.VBox([self.picture, self.words])
        beside.layout = {"flex": "1 1 40em", "align_items": "flex-start"}
        wrapped = {"flex_flow": "row wrap"}
        self.widget = widgets.HBox([widgets.VBox([all_tabs, back]), beside], layout=wrapped)
        self._run()

    def _repr_mimebundle_(self, **kwargs: Any) -> dict[str, Any]:
        # The picture is for viewers without live widgets.
        picture = b64encode(self.picture.value).decode()
        return self.widget._repr_mimebundle_(**kwargs) | {"image/png": picture}

    def _slider_fields(self) -> Iterator[tuple[str, str, str, Parameter, float]]:
        """Tab, name, words, metadata and first value of each slider."""
        pair, ground = self._first, self._ground
        units = pair.scales.units if isinstance(pair, Buildings) else {}

        def in_units(field: Parameter) -> Parameter:
            if field.usual is None or field.kind not in units:
                return field
            low, high = (x * float(units[field.kind]) for x in field.usual)
            return replace(field, usual=(low, high))

        for tab, names in _TABS.items():
            for path in sorted(parameters.paths(pair)):
                *owners, name = path.split(".")
                if ("contact" if "contact" in owners else name) in names:
                    words, field = parameters.name(pair, path), parameters.metadata(pair, path)
                    yield tab, path, plain(words), in_units(field), parameters.get(pair, path)
        yield "ground", "strength", "strength", Parameter(usual=(0.0, 3.0)), 1.0
        if isinstance(ground, Ricker):
            usual = {"amplitude": (-1.0, 1.0), "period": (0.3, 6.0)}
            usual["arrival"] = (0.0, self._grid.duration / float(units.get("time", 1)))
            series = np.broadcast_arrays(ground.amplitude, ground.periods, ground.arrivals)
            for i, wavelet in enumerate(np.reshape(series, (3, -1)).T, 1):
                for (kind, ends), value in zip(usual.items(), wavelet, strict=True):
                    field = in_units(Parameter(kind=WAVELET_KINDS[kind], usual=ends))
                    yield "ground", f"{kind}_{i}", f"{kind} {i}", field, float(value)

    def _run(self) -> None:
        """Run and show what the sliders are set to; a ValueError where that breaks a rule."""
        value = {name: slider.value for name, slider in self.sliders.items()}
        paths = value.keys() & {*parameters.paths(self._first)}
        structures = parameters.put(self._first, {path: value[path] for path in paths})
        ground: Any = self._ground
        if isinstance(ground, Ricker):
            series = [[value[x] for x in value if x.startswith(kind)] for kind in WAVELET_KINDS]
            amplitudes, *times = np.reshape(series, (3, *np.shape(ground.periods)))
            ground = Ricker(value["strength"] * amplitudes, *times)
        else:
            ground = value["strength"] * ground
        response = simulate(structures, ground, self._grid, self._scheme)
        self._panels = self._panels or LivePanels(response)
        self.picture.value = self._panels.png(response)
        self.words.value = response._repr_html_()
        self.structures, self.ground, self.response = structures, ground, response

    def _changed(self, _: Any) -> None:
        try:
            self._run()
        except (ValueError, ArithmeticError) as error:
            self.words.value = f'<span style="color: #D55E00">{escape(str(error))}</span>'

    def reset(self) -> None:
        """Back to the first values."""
        for slider in self.sliders.values():
            slider.value = slider.first


def plain(text: str) -> str:
    """A name with its mathematics as plain text, for places that do not render it: ``τ_x``."""
    text = re.sub(r"\$|\\bar|(?<=\\)var", "", text)
    return re.sub(r"\\([a-z]+)", lambda letter: lookup(f"GREEK SMALL LETTER {letter[1]}"), text)
