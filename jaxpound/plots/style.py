"""Colours, sizes, units, labels and legends of all figures.

Sizes are those of the style file ``house.mplstyle``, which ``plt.style.use("jaxpound.house")``
takes for user-defined figures. Every public function that draws is decorated by ``in_house_style``:
its figures do not depend on the caller's settings of matplotlib, nor change them. ``label`` sets
fonts and grid of axes that the caller made under other settings.
"""

from __future__ import annotations

import functools
import logging
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from importlib import resources
from typing import Any, ParamSpec, TypeVar

import numpy as np
from matplotlib import colormaps, rc_params_from_file, rcParams
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch
from matplotlib.ticker import LogLocator, NullFormatter

from jaxpound.buildings import Buildings
from jaxpound.model import parameters
from jaxpound.model.row import Row
from jaxpound.model.structures import AdjacentStructures, Storeys
from jaxpound.model.system import System
from jaxpound.model.topology import Topology
from jaxpound.quantities import DIMENSIONLESS, SI
from jaxpound.results.named import kind_and_symbol
from jaxpound.scenarios.random_ground import WAVELET_KINDS

# Okabe and Ito's colours, which are distinct for every kind of colour vision, by what they stand
# for; series that are merely compared have those of CYCLE.
COLOURS = {
    "structure 1": "#0072B2",
    "structure 2": "#D55E00",
    "ground": "#000000",
    "damper": "#009E73",
    "rods": "#CC79A7",
    "kinetic": "#F0E442",
    "stick": "#56B4E9",
    "pounding": "#E69F00",
    "limit": "#CC6677",
    "residual": "#7F7F7F",
}

with resources.as_file(resources.files("jaxpound") / "house.mplstyle") as _file:
    _HOUSE = rc_params_from_file(_file, use_default_template=False)

# The font of the prime in u'' dates from before 1970, which fontTools says for each PDF.
_HEAD = logging.getLogger("fontTools.ttLib.tables._h_e_a_d")
_HEAD.addFilter(lambda record: "timestamp seems very low" not in str(record.msg))

P = ParamSpec("P")
R = TypeVar("R")

# The resolution of a figure is the caller's choice.
_DRAWN = {name: value for name, value in _HOUSE.items() if not name.endswith(".dpi")}

FIGURE_SIZE = tuple(_HOUSE["figure.figsize"])
"""Width and height of a new figure in inches: 9 cm by 6 cm."""
FONT_SIZE = _HOUSE["font.size"]
LINE_WIDTH = _HOUSE["lines.linewidth"]
CYCLE = [style["color"] for style in _HOUSE["axes.prop_cycle"]]


def parameter_name(path: str, *, symbols: bool = True) -> str:
    """Name of a parameter in a figure; ``symbols`` are dimensionless, ``Buildings`` have none."""
    owner = _owner(path)
    symbols = symbols and owner is not Buildings
    return parameters.name(owner, path, symbols=symbols) if owner else parameters.in_words(path)


def parameter_axis(path: str, scales: Any, largest: float) -> tuple[float, str]:
    """Factor and name, with its unit, of a parameter on an axis.

    ``scales``, if any, convert it to SI units; ``largest`` is its size before. A parameter without
    a unit, such as a ratio or an order, has a name alone.
    """
    owner, si = _owner(path), scales is not None
    if owner is Buildings:  # in SI, as the ranges of their parameters
        within = parameters.metadata(owner, path).within
        return 1.0, parameter_name(path) + (f" ({within.unit})" if within and within.unit else "")
    of_wavelet = WAVELET_KINDS.get(path.rpartition("_")[0])
    kind = parameters.metadata(owner, path).kind if owner else of_wavelet
    scale = float(scales.unit_of(kind)) if si else 1.0
    name = parameter_name(path, symbols=kind is None or not si)
    factor, words = with_unit(name, kind, si, scale * largest)
    return scale * factor, words


def _owner(path: str) -> type | None:
    """The kind of structures with a parameter of a path, as an opened study holds no object."""
    for kind in (AdjacentStructures, System, Row, Storeys, Buildings):
        with suppress(ValueError):
            parameters.metadata(kind, path)
            return kind
    return None


def unit_for(quantity: str, si: bool, peak: float) -> tuple[float, str]:
    """Factor and name of a unit; of forces and energies with k or M where the peak is large.

    Accelerations are in m/s² as in tables: of the ground too, but in figures of records alone.
    """
    unit = (SI if si else DIMENSIONLESS)[quantity]
    if not si:
        for plain, drawn in (("ω1", r"\omega_1"), ("m1", "m_1"), ("²", "^2")):
            unit = unit.replace(plain, drawn)
        return 1.0, f"${unit}$"
    if quantity == "mass":
        return 1e-3, "t"
    if quantity in ("force", "energy", "stiffness", "damping"):
        for factor, prefix in ((1e-6, "M"), (1e-3, "k")):
            if peak * factor >= 10:
                return factor, prefix + unit
    return 1.0, unit


def in_unit(number: float, kind: str, si: bool, digits: int = 4) -> str:
    """A number with its unit, as words in a figure have it: ``−0.1085 m``."""
    factor, unit = unit_for(kind, si, abs(number))
    ending = unit.replace("$1/", "$/") if unit.startswith("$1/") else f" {unit}"
    return f"{factor * number:.{digits}g}{ending}".replace("-", "−")


def with_unit(words: str, kind: str | None, si: bool, peak: float = 0.0) -> tuple[float, str]:
    """Factor of ``unit_for``, and words for an axis with its unit; of a pure number words alone."""
    if not kind:
        return 1.0, words
    factor, unit = unit_for(kind, si, peak)
    return factor, f"{words} ({unit})"


def demand_axis(name: str, si: bool, peak: float, topology: Topology | None) -> tuple[float, str]:
    """``with_unit`` of a demand, or another column of a study, by its name."""
    kind, words = kind_and_symbol(name, topology)
    return with_unit(words, kind, si, peak)


def in_house_style(draw: Callable[P, R]) -> Callable[P, R]:
    """Decorator of a function that draws: ``house.mplstyle`` applies while it runs."""

    @functools.wraps(draw)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> R:
        # Not rc_context, which restores all settings: a notebook turns interactive with its first
        # figure, and would show no other if that were taken back.
        before = {name: rcParams[name] for name in _DRAWN}
        rcParams.update(_DRAWN)
        try:
            return draw(*args, **kwargs)
        finally:
            rcParams.update(before)

    return drawn


def new_figure(width: float = 1.0, height: float = 1.0, *, standalone: bool = True) -> Figure:
    """A new pyplot figure; width in columns, height in usual heights.

    A notebook shows what a cell returns and all figures that pyplot has: a ``standalone`` one,
    which is returned itself, is taken from pyplot there, or it would be shown twice.
    """
    from matplotlib import pyplot  # only here, so that no window system is asked for

    size = (width * FIGURE_SIZE[0], height * FIGURE_SIZE[1])
    figure = pyplot.figure(figsize=size, layout="constrained")
    if standalone and "inline" in pyplot.get_backend():
        pyplot.close(figure)
    return figure


def new_axes(ax: Axes | None, width: float = 1.0, height: float = 1.0) -> Axes:
    """The given axes, or those of a new pyplot figure (width in columns, usual heights)."""
    return new_figure(width, height, standalone=False).add_subplot() if ax is None else ax


def drawn(draw: Callable[..., Any], *args: Any, **options: Any) -> Figure:
    """What a function draws, as a figure without a window that pyplot has forgotten."""
    import matplotlib
    from matplotlib import pyplot

    matplotlib.use("agg")
    figure: Figure = draw(*args, **options).figure
    pyplot.close(figure)
    return figure


def shades(n: int) -> list[str]:
    """Colours of n results to be compared: grey for the first, then greens from light to dark."""
    green = np.array(to_rgb(COLOURS["damper"]))
    greens = np.linspace(0.35 + 0.65 * green, 0.45 * green, n - 1) if n > 2 else [green]
    return [COLOURS["residual"], *map(to_hex, greens)][:n]


def numbered_colours(n: int) -> list[str]:
    """Colours of n series by number: those of ``CYCLE``; of more series from dark to light."""
    if n <= len(CYCLE):
        return CYCLE[:n]
    return [to_hex(colour) for colour in colormaps["viridis"](np.linspace(0, 0.92, n))]


def ends_named(names: Sequence[str]) -> list[str]:
    """Names for a legend: of more series than ``CYCLE`` has colours only the first and the last."""
    if len(names) <= len(CYCLE):
        return [*names]
    return [names[0], *(f"_{name}" for name in names[1:-1]), names[-1]]


def building_colour(number: int) -> str:
    """Colour of a building of a row, by its number from 0; the first two are those of a pair."""
    # Of the cycle's colours those that letters can be read in, and that are unlike the first two.
    colours = (COLOURS["structure 1"], COLOURS["structure 2"], CYCLE[2], CYCLE[3], CYCLE[5])
    return colours[number % len(colours)]


def tones(colour: str, n: int) -> list[str]:
    """A colour from light to full, of n floors one above the other; of a single floor full."""
    full = np.array(to_rgb(colour))
    return [*map(to_hex, np.linspace(0.65 + 0.35 * full, full, n) if n > 1 else [full])]


def shade(colour: str) -> dict[str, Any]:
    """Style of a shaded region, of a colour by its name in ``COLOURS`` or of any other."""
    return {"facecolor": COLOURS.get(colour, colour), "alpha": 0.3, "linewidth": 0, "zorder": 0.5}


def label(ax: Axes, x: str, y: str) -> None:
    """Labels of both axes, ticks and a light grid."""
    ax.set_xlabel(x, fontsize=FONT_SIZE)
    ax.set_ylabel(y, fontsize=FONT_SIZE)
    ax.tick_params(labelsize=FONT_SIZE)
    if ax.get_xscale() == "linear":
        ax.locator_params(axis="x", nbins=5)  # more would touch at column width
    ax.grid(True, color=_HOUSE["grid.color"], linewidth=_HOUSE["grid.linewidth"])
    ax.set_axisbelow(True)


def text_at(
    ax: Axes, x: float, y: float, words: str, colour: str, align: str = "center", **options: Any
) -> None:
    """Words in a drawing, above all lines."""
    how: dict[str, Any] = {"fontsize": FONT_SIZE, "linespacing": 1.4, "zorder": 5} | options
    ax.text(x, y, words, color=colour, ha=align, va="center", **how)


def arrow(
    ax: Axes, start: Any, end: Any, colour: str, size: float, style: str = "-|>", **options: Any
) -> FancyArrowPatch:
    """An arrow between two points with heads of a size in points."""
    options |= {"arrowstyle": style, "mutation_scale": size, "shrinkA": 0, "shrinkB": 0}
    patch = FancyArrowPatch(start, end, color=colour, **options)
    ax.add_patch(patch)
    return patch


def legend(ax: Axes, columns: int = 4, bottom: float | None = None) -> None:
    """A legend above everything drawn, of columns as they fit; the axis may begin at ``bottom``."""
    ax.autoscale(axis="y")
    low, high = ax.get_ylim()
    low = low if bottom is None else bottom
    handles, names = ax.get_legend_handles_labels()
    drawing: Any = ax.figure
    width = 72 * ax.get_window_extent().width / drawing.dpi
    while columns > 1 and _legend_width(names, columns) > width:
        columns -= 1
    rows = -(-len(handles) // columns)
    points = 72 * ax.get_window_extent().height / drawing.dpi
    share = min((0.4 + 1.6 * rows) * FONT_SIZE / points, 0.5)  # of low axes, such as a film's
    room = max(0.07 + 0.09 * rows, share / (1 - share))  # in heights of what is drawn
    log = ax.get_yscale() == "log"
    ax.set_ylim(low, high * (high / low) ** room if log else high + room * (high - low))
    shown = ax.legend(
        loc="upper right", ncols=columns, handlelength=1.2, columnspacing=1.0, borderaxespad=0.2
    )
    for handle in shown.legend_handles:
        if isinstance(handle, Line2D):
            handle.set_alpha(1.0)  # a batch's lines are faint


def _legend_width(names: Sequence[str], columns: int) -> float:
    """About how wide a legend is, in points: a letter is about half as wide as it is high."""
    letters = [len(re.sub("[${}_^]", "", re.sub(r"\\[a-zA-Z]+", "x", name))) for name in names]
    widest = [max(column, default=0) for column in np.array_split(letters, columns)]
    return FONT_SIZE * (0.55 * sum(widest) + 3.0 * columns - 1.0)


def legend_above(ax: Axes, columns: int) -> None:
    """A legend above the axes, for drawings that leave no corner free."""
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=columns, columnspacing=1.0)


def same_height(panels: Iterable[Axes]) -> None:
    """One vertical scale for all, as wide as the widest."""
    panels = list(panels)
    lows, highs = np.transpose([ax.get_ylim() for ax in panels])
    for ax in panels:
        ax.set_ylim(lows.min(), highs.max())


def share_axis(ax: Axes, columns: int) -> None:
    """A vertical axis of shares, within 0 and 1, and the legend above the axes."""
    ax.autoscale(axis="y")
    ax.set_ylim(np.clip(ax.get_ylim(), 0.0, 1.0).tolist())
    legend_above(ax, columns)


def ratio_ticks(axis: Axis) -> None:
    """Ticks of a logarithmic axis at 1, 2 and 5 times powers of ten, as plain numbers."""
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


def log_log(ax: Axes) -> None:
    """Both axes logarithmic, with ``ratio_ticks``."""
    ax.set(xscale="log", yscale="log")
    ratio_ticks(ax.xaxis)
    ratio_ticks(ax.yaxis)


def bars(ax: Axes | None, sizes: Mapping[str, float], words: str) -> tuple[Axes, list[str], Any]:
    """Axes for horizontal bars of parameters, the largest of twelve on top: paths and places."""
    paths = sorted(sizes, key=lambda path: sizes[path])[-12:]
    ax = new_axes(ax, height=max(1.0, (0.27 * len(paths) + 0.8) / FIGURE_SIZE[1]))
    label(ax, words, "")
    ax.set_yticks(range(len(paths)), [parameter_name(path) for path in paths])
    return ax, paths, np.arange(len(paths))


def signed_bars(ax: Axes | None, values: Mapping[str, float], words: str) -> Axes:
    """A bar to the left or right of zero for each of twelve parameters, the largest on top."""
    ax, paths, places = bars(ax, {path: abs(value) for path, value in values.items()}, words)
    ax.barh(places, [values[path] for path in paths], 0.6, color=CYCLE[0], alpha=0.8)
    ax.axvline(0, color="black", linewidth=0.7)
    return ax
