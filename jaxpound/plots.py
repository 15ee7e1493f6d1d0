"""Figures of a run: every function draws one ``Response`` into given axes and returns them.

Nothing here changes matplotlib's settings. With ``ax=None`` the axes belong to a new pyplot figure
of column width (9 cm), which a notebook shows; with axes given, pyplot is not touched.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from jaxpound.response import Response

# Okabe and Ito's colours, which stay apart for every kind of colour vision.
COLOURS = {
    "structure 1": "#0072B2",
    "structure 2": "#D55E00",
    "ground": "#000000",
    "damper": "#009E73",
    "rods": "#CC79A7",
    "kinetic": "#56B4E9",
    "stick": "#56B4E9",
    "pounding": "#E69F00",
    "residual": "#7F7F7F",
}

FIGURE_SIZE = (3.54, 2.36)
"""Width and height of a new figure in inches: 9 cm by 6 cm."""

FONT_SIZE = 8
LINE_WIDTH = 0.9
_LINE_ALPHA = 0.85  # where two lines run close together, both are seen
_SHADE = 0.3

_DIMENSIONLESS = {
    "time": r"$1/\omega_1$",
    "length": r"$g/\omega_1^2$",
    "velocity": r"$g/\omega_1$",
    "acceleration": "$g$",
    "force": "$m_1 g$",
    "energy": r"$m_1 g^2/\omega_1^2$",
}
_SI = {
    "time": "s",
    "length": "m",
    "velocity": "m/s",
    "acceleration": "m/s²",
    "force": "N",
    "energy": "J",
}


# Quantity of each demand, and its name in a figure.
QUANTITIES = {
    "min_gap": ("length", r"min gap $\xi$"),
    "min_gap_time": ("time", "time of min gap $t$"),
    "peak_x1": ("length", "peak $|x_1|$"),
    "peak_x2": ("length", "peak $|x_2|$"),
    "peak_f1": ("force", "peak $|f_1|$"),
    "peak_f2": ("force", "peak $|f_2|$"),
    "peak_acceleration_1": ("acceleration", "peak $|a_1|$"),
    "peak_acceleration_2": ("acceleration", "peak $|a_2|$"),
    "damper_force": ("force", "slip force"),
    "slip_distance": ("length", "slip distance"),
    "friction_work": ("energy", "friction work"),
    "residual_offset": ("length", "residual offset"),
    "pga": ("acceleration", "PGA"),
    "pgv": ("velocity", "PGV"),
    "required_gap": ("length", "required gap"),
}


class _Curve(NamedTuple):
    label: str
    colour: str
    values: Any


def ground_motion(response: Response, ax: Axes | None = None) -> Axes:
    """Ground acceleration u'' over time."""
    curve = _Curve("$u''$", "ground", response.ground_acceleration)
    return _over_time(response, ax, "ground acceleration", "acceleration", [curve])


def displacements(response: Response, ax: Axes | None = None) -> Axes:
    """Displacements x1 and x2, relative to the ground, over time."""
    curves = _pair("$x_1$", response.x1, "$x_2$", response.x2)
    return _over_time(response, ax, "displacement", "length", curves)


def velocities(response: Response, ax: Axes | None = None) -> Axes:
    """Velocities x1' and x2', relative to the ground, over time."""
    curves = _pair("$x_1'$", response.v1, "$x_2'$", response.v2)
    return _over_time(response, ax, "velocity", "velocity", curves)


def rod_forces(response: Response, ax: Axes | None = None) -> Axes:
    """Rod forces f1 and f2 (base shears) over time."""
    curves = _pair("$f_1$", response.f1, "$f_2$", response.f2)
    return _over_time(response, ax, "rod force", "force", curves)


def gap(response: Response, ax: Axes | None = None) -> Axes:
    """Gap ξ over time, its minimum marked with value and time.

    The minimum is that of ``response.demand``, which may lie between instants of the grid. The
    region of pounding, ξ ≤ 0, is shaded if the gap comes near it.
    """
    ax = _over_time(response, ax, "gap", "length", [_Curve(r"$\xi$", "damper", response.gap)])
    low, high = float(response.min_gap), float(np.max(response.gap))
    span = (high - low) or abs(high) or 1.0
    bottom = low - 0.25 * span  # room for the label
    if low < 0.3 * span:
        bottom = min(bottom, -0.15 * span)
        ax.axhspan(bottom, 0, label=r"pounding, $\xi \leq 0$", **shade("pounding"))
        legend(ax)
    ax.set_ylim(bottom=bottom)

    time = float(response.demand.min_gap_time)
    ax.plot(time, low, "o", color=COLOURS["damper"], markersize=4, label="_minimum")
    place = time / float(response.time[-1])
    units = (" m", " s") if response.si else ("", "")
    ax.annotate(
        rf"min $\xi$ = {low:.4g}{units[0]} at $t$ = {time:.4g}{units[1]}".replace("-", "−"),
        (time, low),
        xytext=(0, -5),
        textcoords="offset points",
        horizontalalignment="left" if place < 0.3 else "right" if place > 0.7 else "center",
        verticalalignment="top",
        fontsize=FONT_SIZE,
    )
    return ax


def friction_force(response: Response, ax: Axes | None = None) -> Axes:
    """Friction force q of the damper over time, the intervals of stick shaded."""
    curve = _Curve("$q$", "damper", response.friction)
    ax = _over_time(response, ax, "friction force", "force", [curve])
    sticks = [(p.start, p.end - p.start) for p in response.phases() if p.kind == "stick"]
    if sticks:
        across = ax.get_xaxis_transform()
        ax.broken_barh(sticks, (0, 1), transform=across, label="stick", **shade("stick"))
        legend(ax)
    return ax


def rod_hysteresis(response: Response, ax: Axes | None = None) -> Axes:
    """Rod force over displacement of both structures: f1 over x1, f2 over x2."""
    ax = _axes(response, ax)
    factor, unit = _unit(response, "force", response.f1, response.f2)
    for x, curve in zip(
        (response.x1, response.x2),
        _pair("structure 1", response.f1, "structure 2", response.f2),
        strict=True,
    ):
        _draw(ax, x, factor, curve)
    label(
        ax, f"displacement $x_1$, $x_2$ ({_length(response)})", f"rod force $f_1$, $f_2$ ({unit})"
    )
    legend(ax)
    return ax


def friction_hysteresis(response: Response, ax: Axes | None = None) -> Axes:
    """Friction force q over slip x1 − x2: the enclosed area is the energy taken by the damper."""
    ax = _axes(response, ax)
    factor, unit = _unit(response, "force", response.friction)
    _draw(ax, response.x1 - response.x2, factor, _Curve("$q$", "damper", response.friction))
    label(ax, f"slip $x_1 - x_2$ ({_length(response)})", f"friction force $q$ ({unit})")
    return ax


def energy(response: Response, ax: Axes | None = None) -> Axes:
    """Energy over time: what damper, rods and motion hold, stacked, under the input.

    The stack is friction's work, the rods' work and the kinetic energy; the line is the input.
    What is between the two is the residual of the balance, drawn on its own as well.
    """
    ax = _axes(response, ax)
    terms = response.energy
    factor, unit = _unit(response, "energy", terms.input)
    time = np.asarray(response.time)
    parts = {"friction": "damper", "rods": "rods", "kinetic": "kinetic"}
    ax.stackplot(
        time,
        *(factor * np.asarray(getattr(terms, name)) for name in parts),
        labels=list(parts),
        colors=[COLOURS[colour] for colour in parts.values()],
        alpha=0.6,
        linewidth=0,
    )
    _draw(ax, time, factor, _Curve("input", "ground", terms.input))
    _draw(ax, time, factor, _Curve("residual", "residual", terms.residual), linestyle="--")
    ax.margins(x=0)
    label(ax, _time(response), f"energy $E$ ({unit})")
    legend(ax, columns=3)
    return ax


def figure(draw: Callable[[Any, Axes], Axes], drawn: Any) -> Figure:
    """A figure of column width with one drawing of a response or study, unknown to pyplot."""
    result = Figure(figsize=FIGURE_SIZE, layout="constrained")
    draw(drawn, result.add_subplot())
    return result


def overview(response: Response) -> Figure:
    """Ground motion, displacements, friction force and gap, one above the other over time."""
    drawings = (ground_motion, displacements, friction_force, gap)
    result = Figure(figsize=(2 * FIGURE_SIZE[0], 3.3 * FIGURE_SIZE[1]), layout="constrained")
    panels = result.subplots(len(drawings), sharex=True)
    for draw, ax in zip(drawings, panels, strict=True):
        draw(response, ax)
        ax.label_outer()
    result.align_ylabels(panels)
    return result


def paper_figures(response: Response) -> dict[str, Figure]:
    """The six figures of the paper's numerical example, of one run.

    Returns
    -------
    ``"figure_3"`` ground motion, ``"figure_4"`` displacements, ``"figure_5"`` velocities,
    ``"figure_6"`` gap, ``"figure_7"`` friction force with the phases of stick, ``"figure_8"`` rod
    forces. This order of the paper's Figures 3 to 8 is an assumption: the project has the paper's
    equations and parameters, but not its figures.
    """
    drawings = (ground_motion, displacements, velocities, gap, friction_force, rod_forces)
    return {
        f"figure_{number}": figure(draw, response) for number, draw in enumerate(drawings, start=3)
    }


def _pair(label_1: str, values_1: Any, label_2: str, values_2: Any) -> list[_Curve]:
    return [_Curve(label_1, "structure 1", values_1), _Curve(label_2, "structure 2", values_2)]


def _over_time(
    response: Response, ax: Axes | None, words: str, quantity: str, curves: Sequence[_Curve]
) -> Axes:
    ax = _axes(response, ax)
    factor, unit = _unit(response, quantity, *(curve.values for curve in curves))
    for curve in curves:
        _draw(ax, response.time, factor, curve)
    symbols = ", ".join(curve.label for curve in curves)
    ax.margins(x=0)
    label(ax, _time(response), f"{words} {symbols} ({unit})")
    if len(curves) > 1:
        legend(ax)
    return ax


def _axes(response: Response, ax: Axes | None) -> Axes:
    if np.ndim(response.time) != 1:
        shape = np.shape(response.time)
        raise ValueError(f"plots: a batch of shape {shape} must be indexed to one response")
    if not np.isfinite(response.min_gap):
        raise ValueError("plots: the run is invalid (its results are NaN)")
    return new_axes(ax)


def new_axes(ax: Axes | None) -> Axes:
    """The axes given, or those of a new pyplot figure of column width."""
    if ax is not None:
        return ax
    from matplotlib import pyplot  # only here, so that no window system is asked for

    return pyplot.subplots(figsize=FIGURE_SIZE, layout="constrained")[1]


def only_shares(ax: Axes) -> None:
    """Ticks from 0 to 1, not beside the legend above."""
    ax.set_yticks([tick for tick in ax.get_yticks() if ax.get_ylim()[0] <= tick <= 1 + 1e-9])


def ratio_ticks(axis: Axis) -> None:
    """Ticks of a logarithmic axis at 1, 2 and 5 times powers of ten, as plain numbers."""
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


def bars(ax: Axes | None, names: Sequence[str]) -> Axes:
    """Axes with room for so many bars."""
    if ax is None:
        ax = new_axes(ax)
        figure: Any = ax.figure
        figure.set_size_inches(FIGURE_SIZE[0], max(FIGURE_SIZE[1], 0.27 * len(names) + 0.8))
    return ax


def signed_bars(ax: Axes | None, values: Mapping[str, float], words: str) -> Axes:
    """A bar for each name, to the left or right of zero, from below in their order."""
    ax, place = bars(ax, list(values)), np.arange(len(values))
    ax.barh(place, list(values.values()), 0.6, color=COLOURS["structure 1"], alpha=0.8)
    ax.axvline(0, color="black", linewidth=0.7)
    label(ax, words, "")
    ax.set_yticks(place, list(values))
    return ax


def _draw(ax: Axes, x: Any, factor: float, curve: _Curve, **style: Any) -> None:
    y = factor * np.asarray(curve.values)
    style |= {"color": COLOURS[curve.colour], "linewidth": LINE_WIDTH, "alpha": _LINE_ALPHA}
    ax.plot(np.asarray(x), y, label=curve.label, **style)


def shade(colour: str) -> dict[str, Any]:
    """Style of a shaded region."""
    return {"facecolor": COLOURS[colour], "alpha": _SHADE, "linewidth": 0, "zorder": 0.5}


def unit_for(quantity: str, si: bool, peak: float) -> tuple[float, str]:
    """Factor and name of a quantity's unit: as it is, or in kN, MN, kJ, MJ if the peak is large."""
    unit = (_SI if si else _DIMENSIONLESS)[quantity]
    if si and quantity in ("force", "energy"):
        for factor, prefix in ((1e-6, "M"), (1e-3, "k")):
            if peak * factor >= 10:
                return factor, prefix + unit
    return 1.0, unit


def _unit(response: Response, quantity: str, *series: Any) -> tuple[float, str]:
    """Factor and name of the unit for the series."""
    peak = max((float(np.max(np.abs(values))) for values in series), default=0.0)
    return unit_for(quantity, response.si, peak)


def _time(response: Response) -> str:
    return f"time $t$ ({_unit(response, 'time')[1]})"


def _length(response: Response) -> str:
    return _unit(response, "length")[1]


def label(ax: Axes, x: str, y: str) -> None:
    """Labels of both axes, ticks and a light grid."""
    ax.set_xlabel(x, fontsize=FONT_SIZE)
    ax.set_ylabel(y, fontsize=FONT_SIZE)
    ax.tick_params(labelsize=FONT_SIZE)
    if ax.get_xscale() == "linear":
        ax.locator_params(axis="x", nbins=5)  # more would touch at column width
    ax.grid(True, color="0.88", linewidth=0.6)
    ax.set_axisbelow(True)


def legend(ax: Axes, columns: int = 4) -> None:
    """A legend in a strip of its own, above everything drawn."""
    ax.autoscale(axis="y")
    low, high = ax.get_ylim()
    handles, _ = ax.get_legend_handles_labels()
    room = 0.16 * -(-len(handles) // columns)  # in heights of the axes, for each row
    log = ax.get_yscale() == "log"
    ax.set_ylim(low, high * (high / low) ** room if log else high + room * (high - low))
    ax.legend(
        loc="upper right",
        ncols=columns,
        fontsize=FONT_SIZE,
        frameon=False,
        handlelength=1.2,
        columnspacing=1.0,
        borderaxespad=0.2,
    )
