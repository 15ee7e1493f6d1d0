"""Sliders for every parameter of a pair, and its response redrawn while they are dragged."""

from __future__ import annotations

from base64 import b64encode
from html import escape
from operator import attrgetter
from typing import Any

import jax
import numpy as np

from jaxpound._checks import instance
from jaxpound._extras import require
from jaxpound.grid import TimeGrid
from jaxpound.ground.motion import require_dimensionless
from jaxpound.ground.record import Record
from jaxpound.ground.ricker import Ricker
from jaxpound.model.structures import AdjacentStructures
from jaxpound.plots.panels import LivePanels
from jaxpound.results.response import Response
from jaxpound.simulation.run import simulate
from jaxpound.simulation.scheme import Scheme
from jaxpound.study.scenarios import replaced
from jaxpound.units import Scales

# Name, symbol, smallest and largest value; times and ratios on a logarithmic scale.
_DAMPER = (("friction", "μ", 0.0, 1.5), ("initial_gap", "ξ₀ (g/ω₁²)", 0.0, 3.0))
_RODS = tuple(
    (f"rod_{i}.{name}", symbol, low, high)
    for i, order in ((1, "α"), (2, "β"))
    for name, symbol, low, high in (
        ("order", f"{order} (order {i})", 0.05, 1.0),
        ("tau_x", f"τx{'₁₂'[i - 1]}", 0.02, 20.0),
        ("tau_f", f"τf{'₁₂'[i - 1]}", 0.001, 1.0),
    )
)
_BUILDINGS = (("mass_ratio", "ρ = m₁/m₂", 0.2, 5.0), ("stiffness_ratio", "ε = k₂/k₁", 0.2, 8.0))
_LOGARITHMIC = {name for name, *_ in (*_RODS, *_BUILDINGS) if not name.endswith("order")}


class Explorer:
    """A pair of buildings in a notebook: sliders, and what they do to the response.

    The last expression of a cell shows it. ``sliders`` holds the widgets by the parameter's path
    (``explorer.sliders["friction"].value = 0.4``); ``structures``, ``ground`` and ``response`` are
    what is shown, in ``picture`` and ``words``. Needs the extra ``notebooks``.

    A slider is dragged from one round number to the next. Any other number can be typed into the
    field beside it or set by code, also outside of the slider's range, and stays as it was set.

    Parameters
    ----------
    structures
        The single pair to begin with, dimensionless.
    ground
        A ``Ricker`` motion, whose wavelets get sliders, or a ``Record`` (in units of g and 1/ω1),
        which gets one for its strength.
    grid
        The instants; a thousand or so are drawn fastest.
    scheme
        The discretisation.
    scales
        Shows results in SI units; the sliders stay dimensionless.

    Raises
    ------
    ImportError
        If ipywidgets is not installed.
    ValueError
        If an argument is of another kind, or the first run is invalid.

    Notes
    -----
    Where a choice breaks a rule (τf above τx, a step above the stability limit) the picture stays,
    and the line below it says why.
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
        require_dimensionless("Explorer: ground", ground)
        instance("Explorer", "grid", grid, TimeGrid)
        instance("Explorer", "scheme", scheme, Scheme)
        if scales is not None:
            instance("Explorer", "scales", scales, Scales)
        if any(np.ndim(leaf) for leaf in jax.tree.leaves(structures)):
            raise ValueError("Explorer: structures must be a single pair, not a batch")
        self._first = jax.tree.map(float, structures)
        self._ground, self._grid, self._scheme, self._scales = ground, grid, scheme, scales

        self.sliders: dict[str, Any] = {}
        self._starts: dict[str, float] = {}
        self._quiet = False  # while many sliders move at once
        tabs = {"damper": self._group(_DAMPER), "rods": self._group(_RODS)}
        tabs |= {"buildings": self._group(_BUILDINGS), "ground": self._group_of_ground()}
        back = widgets.Button(description="reset", tooltip="back to the first values")
        back.on_click(lambda _: self.reset())

        self.structures, self.ground = self._first, ground
        self.response = self._run(self.structures, ground)
        self._panels = LivePanels(self.response)
        narrow = widgets.Layout(max_width="calc(100% - 4px)")  # less its margins
        self.picture = widgets.Image(format="png", layout=narrow)
        self.words = widgets.HTML()
        self._show()
        tab = widgets.Tab([_scrolled(group) for group in tabs.values()], titles=list(tabs))
        tab.layout.width = "37em"
        beside = widgets.VBox([self.picture, self.words])
        beside.layout = widgets.Layout(flex="1 1 40em", align_items="flex-start")
        self.widget = widgets.HBox(
            [widgets.VBox([tab, back]), beside],
            layout=widgets.Layout(flex_flow="row wrap"),
        )

    def _repr_mimebundle_(self, **kwargs: Any) -> dict[str, Any]:
        # The picture is for where widgets do not live.
        picture = b64encode(self.picture.value).decode()
        return self.widget._repr_mimebundle_(**kwargs) | {"image/png": picture}

    def _slider(self, name: str, words: str, value: float, low: float, high: float) -> Any:
        from jaxpound.plots.sliders import ExactSlider, even_marks, ratio_marks

        marks = ratio_marks if name in _LOGARITHMIC else even_marks
        slider = ExactSlider(words, value, marks(min(low, value), max(high, value)))
        slider.observe(self._changed, names="value")
        self.sliders[name] = slider
        self._starts[name] = value
        return slider

    def _group(self, parameters: Any) -> list[Any]:
        return [
            self._slider(name, words, attrgetter(name)(self._first), low, high)
            for name, words, low, high in parameters
        ]

    def _group_of_ground(self) -> list[Any]:
        strength = self._slider("strength", "strength", 1.0, 0.0, 3.0)
        if not isinstance(self._ground, Ricker):
            return [strength]
        ground = self._ground
        sizes = np.broadcast_to(ground.amplitude, np.shape(ground.periods))
        kinds = (
            ("amplitude", "(g/ω₁²)", np.ravel(sizes), -1.0, 1.0),
            ("period", "(1/ω₁)", np.ravel(ground.periods), 0.3, 6.0),
            ("arrival", "(1/ω₁)", np.ravel(ground.arrivals), 0.0, self._grid.duration),
        )
        return [strength] + [
            self._slider(f"{kind}_{i + 1}", f"{kind} {i + 1} {unit}", float(values[i]), low, high)
            for i in range(np.size(sizes))
            for kind, unit, values, low, high in kinds
        ]

    def _chosen(self) -> tuple[AdjacentStructures, Any]:
        """Structures and ground as the sliders say; ValueError where they break a rule."""
        value = {name: slider.value for name, slider in self.sliders.items()}
        names = [name for name, *_ in (*_DAMPER, *_RODS, *_BUILDINGS)]
        structures = replaced(self._first, {name: value[name] for name in names})
        ground: Any = self._ground
        if isinstance(ground, Ricker):
            shape = np.shape(ground.periods)
            n = int(np.prod(shape))
            amplitudes, periods, arrivals = (
                np.reshape([value[f"{kind}_{i + 1}"] for i in range(n)], shape)
                for kind in ("amplitude", "period", "arrival")
            )
            return structures, Ricker(value["strength"] * amplitudes, periods, arrivals)
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
        for name, slider in self.sliders.items():
            slider.value = self._starts[name]
        self._quiet = False
        self._changed(None)

    def _show(self) -> None:
        self.picture.value = self._panels.png(self.response)
        d = self.response.demand
        si = self.response.si
        length, second = (" m", " s") if si else ("", "")
        phases = len(self.response.phases())
        pounds = " <b>The buildings pound.</b>" if d.pounds else ""
        self.words.value = (
            f"min gap {float(d.min_gap):.4g}{length} at t = {float(d.min_gap_time):.4g}{second}; "
            f"{phases} {'phase' if phases == 1 else 'phases'}, "
            f"slid {float(d.slip_distance):.3g}{length}, "
            f"offset left {float(d.residual_offset) + 0.0:.3g}{length}.{pounds}"
        )


def _scrolled(sliders: list[Any]) -> Any:
    """Sliders in no more than the height that leaves the picture in sight."""
    widgets = require("Explorer", "ipywidgets")
    box = widgets.Box(sliders)
    box.layout = widgets.Layout(flex_flow="column", max_height="15em", overflow="hidden auto")
    return box
