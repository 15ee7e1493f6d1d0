"""Figures of runs: every function draws a ``Response`` into given axes and returns them.

The runs of a batch are drawn over each other; the more runs, the fainter the lines. Matplotlib's
settings stay as they are. With ``ax=None`` the axes belong to a new pyplot figure of column width
(9 cm), which a notebook shows and ``plt.show()`` or ``plt.savefig`` take; with axes given, pyplot
is not touched.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from jaxpound._checks import instance
from jaxpound.model.system import elongation
from jaxpound.plots.curves import (
    Curve,
    contact_loops,
    contacts,
    dampers,
    frictions,
    gaps_of,
    is_pair,
    of_masses,
    of_rods,
    touching,
)
from jaxpound.plots.style import (
    COLOURS,
    in_house_style,
    label,
    legend,
    new_axes,
    new_figure,
    same_height,
    shade,
    shades,
    unit_for,
)
from jaxpound.results.response import Response, require_single

_LINE_ALPHA = 0.85  # where two lines run close together, both are seen


@in_house_style
def ground_motion(response: Response, ax: Axes | None = None) -> Axes:
    """Ground acceleration u'' over time."""
    curve = Curve("$u''$", "ground", response.ground_acceleration)
    return _over_time(response, ax, "ground acceleration", "acceleration", [curve], curve.label)


@in_house_style
def displacements(response: Response, ax: Axes | None = None) -> Axes:
    """Displacement x of each mass, relative to the ground, over time."""
    curves = of_masses(response, "x", "$x_{}$")
    return _over_time(response, ax, "displacement", "length", curves, "$x$")


@in_house_style
def velocities(response: Response, ax: Axes | None = None) -> Axes:
    """Velocity x' of each mass, relative to the ground, over time."""
    curves = of_masses(response, "v", "$x_{}'$")
    return _over_time(response, ax, "velocity", "velocity", curves, "$x'$")


@in_house_style
def rod_forces(response: Response, ax: Axes | None = None) -> Axes:
    """Force f of each rod (of one to the ground, the base shear) over time."""
    curves = of_rods(response, "$f_{}$")
    return _over_time(response, ax, "rod force", "force", curves, "$f$")


@in_house_style
def gap(response: Response, ax: Axes | None = None) -> Axes:
    """Gap ξ of each link over time; the smallest of all is marked, with value and time.

    The minimum (of a batch, the smallest) is that of ``response.demand``, which may lie between
    instants of the grid. The region of pounding, ξ ≤ 0, is shaded, and named in the legend if the
    gap comes near it. Impacts of a single run, by a law of contact, are marked where they begin,
    and named instead.

    Raises
    ------
    ValueError
        If no link has a gap, or a run is invalid.
    """
    curves = gaps_of("gap", response)
    ax = _over_time(response, ax, "gap", "length", curves, r"$\xi$")
    smallest = np.ravel(response.min_gap)
    low, high = float(smallest.min()), max(float(np.nanmax(curve.values)) for curve in curves)
    time = float(np.ravel(response.demand.min_gap_time)[smallest.argmin()])
    units = (" m", " s") if response.si else ("", "")
    words = rf"min {low:.4g}{units[0]} at $t$ = {time:.4g}{units[1]}".replace("-", "−")
    named = [curve for curve in curves if not curve.label.startswith("_")]
    (point,) = ax.plot(time, low, "o", color=COLOURS["damper"], markersize=4, label="_minimum")
    if len(curves) > 1:
        point.set(label=words, color=COLOURS["ground"])
    else:
        lines: Any = ax.lines[:-1] if np.ndim(response.time) == 1 else ax.collections
        lines[-1].set_label(rf"$\xi$, {words}")

    hits = [] if response.batch else [impact.time for impact in response.impacts()]
    if hits:
        style: Any = {"color": COLOURS["structure 2"], "markersize": 4, "label": "impact"}
        ax.plot(hits, np.zeros(len(hits)), "v", linestyle="none", **style)
    span = (high - low) or abs(high) or 1.0
    near = low < 0.3 * span
    _shade_pounding(ax, near and not hits)
    bottom = low - 0.1 * span
    columns = 1 if len(named) == 1 else 2
    legend(ax, columns, min(bottom, -0.15 * span) if near else bottom)
    return ax


@in_house_style
def gaps(responses: Mapping[str, Response], ax: Axes | None = None) -> Axes:
    """Gaps ξ over time of several runs by name, the first in grey, and the smallest of each.

    Raises
    ------
    ValueError
        If there is no run, one has no gap, or some are in SI units and others are not.
    """
    runs = list(same_units("gaps", responses).values())
    for name, response, colour in zip(responses, runs, shades(len(runs)), strict=True):
        ax = _axes(response, ax)
        words = f"{name}: min {float(np.min(response.min_gap)):.4g}".replace("-", "−")
        for i, curve in enumerate(gaps_of("gaps", response)):
            one = curve._replace(label="_" + curve.label if i else words, colour=colour)
            _draw(ax, response.time, 1.0, one)
    assert ax is not None
    _shade_pounding(ax, False)
    ax.axhline(0, color=COLOURS["pounding"], zorder=1)
    ax.margins(x=0)
    label(ax, _time(runs[0]), rf"gap $\xi$ ({_length(runs[0])})")
    legend(ax, columns=1)
    return ax


@in_house_style
def friction_force(response: Response, ax: Axes | None = None) -> Axes:
    """Friction force q of each link over time; of one in a single run, intervals of stick shaded.

    Raises
    ------
    ValueError
        If there is no link, or a run is invalid.
    """
    curves = frictions("friction_force", response)
    ax = _over_time(response, ax, "friction force", "force", curves, "$q$")
    if np.ndim(response.time) > 1 or len(curves) > 1:
        return ax
    sticks = [(p.start, p.end - p.start) for p in response.phases() if p.kind == "stick"]
    if sticks:
        across = ax.get_xaxis_transform()
        ax.broken_barh(sticks, (0, 1), transform=across, label="stick", **shade("stick"))
        legend(ax)
    return ax


@in_house_style
def contact_force(response: Response, ax: Axes | None = None) -> Axes:
    """Contact force p of each link with a law of contact over time.

    The line has the force at the instants; in a single run the largest of each impact, which may
    lie between them, is marked where the impact begins. Impacts by Newton's law have no force: what
    is drawn then presses blocks together at rest.

    Raises
    ------
    ValueError
        If no link has a law of contact, or a run is invalid.
    """
    curves = contacts("contact_force", response)
    peaks = [] if response.batch else response.impacts()
    peaks = [impact for impact in peaks if np.isfinite(impact.peak_force)]
    highest = [impact.peak_force for impact in peaks]
    ax = _axes(response, ax)
    factor, unit = _unit(response, "force", *(curve.values for curve in curves), highest or [0.0])
    for curve in curves:
        _draw(ax, response.time, factor, curve)
    if peaks:
        ax.plot(
            [impact.time for impact in peaks],
            factor * np.array(highest),
            "o",
            color=COLOURS["structure 2"],
            markersize=3,
            label="largest of an impact",
        )
    ax.margins(x=0)
    label(ax, _time(response), f"contact force $p$ ({unit})")
    if peaks or len(curves) > 1:
        legend(ax, columns=3)
    return ax


@in_house_style
def rod_hysteresis(response: Response, ax: Axes | None = None) -> Axes:
    """Force over elongation of each rod; of a pair f1 over x1 and f2 over x2."""
    ax = _axes(response, ax)
    curves = of_rods(response, "structure {}")
    factor, unit = _unit(response, "force", *(curve.values for curve in curves))
    x = [mass.x for mass in response.masses]
    for rod, curve in zip(response.rods, curves, strict=True):
        _draw(ax, elongation(rod.ends, x), factor, curve)
    pair = is_pair(response)
    across, up = ("displacement $x_1$, $x_2$", "$f_1$, $f_2$") if pair else ("elongation", "$f$")
    label(ax, f"{across} ({_length(response)})", f"rod force {up} ({unit})")
    if len(curves) > 1:
        legend(ax, columns=3)
    return ax


@in_house_style
def friction_hysteresis(response: Response, ax: Axes | None = None) -> Axes:
    """Friction force q over slip of each link: the enclosed area is the energy taken by the damper.

    The slip is that of its ends, x_i − x_j, by which the gap has closed.

    Raises
    ------
    ValueError
        If there is no link, or a run is invalid.
    """
    ax = _axes(response, ax)
    curves = frictions("friction_hysteresis", response)
    factor, unit = _unit(response, "force", *(curve.values for curve in curves))
    x = [mass.x for mass in response.masses]
    for link, curve in zip(dampers(response), curves, strict=True):
        _draw(ax, elongation(link.ends, x), factor, curve)
    ends = "x_1 - x_2" if is_pair(response) else "x_i - x_j"
    label(ax, f"slip ${ends}$ ({_length(response)})", f"friction force $q$ ({unit})")
    if len(curves) > 1:
        legend(ax, columns=3)
    return ax


@in_house_style
def contact_hysteresis(response: Response, ax: Axes | None = None) -> Axes:
    """Contact force p over penetration δ = −ξ of each link with a law of contact.

    The enclosed area is the energy lost by contact. Of a single run each impact that the response
    keeps is drawn within the steps too, by the law of contact along the motion between the
    instants; of a batch, or a law of one's own in SI units, there are only the instants.

    Raises
    ------
    ValueError
        If no link has a law of contact, or a run is invalid.
    """
    ax = _axes(response, ax)
    curves = contacts("contact_hysteresis", response)
    factor, unit = _unit(response, "force", *(curve.values for curve in curves))
    for link, curve in zip(touching(response), curves, strict=True):
        loops = contact_loops(response, link)
        penetration = np.maximum(-np.asarray(link.gap), 0.0)
        for x, force in loops or [(penetration, curve.values)]:
            _draw(ax, x, factor, curve._replace(values=force))
            curve = curve._replace(label="_" + curve.label)
    label(ax, rf"penetration $\delta$ ({_length(response)})", f"contact force $p$ ({unit})")
    if len(curves) > 1:
        legend(ax, columns=3)
    return ax


@in_house_style
def energy(response: Response, ax: Axes | None = None) -> Axes:
    """Energy of a single run over time: damper, rods and kinetic energy, stacked, and the input.

    The stack is friction's work, the rods' work and the kinetic energy, with a law of contact also
    what is lost by contact and stored in it; the line is the input, with the energy at t = 0 of a
    run that does not start at rest. Their difference is the residual of the balance, also drawn as
    a line.
    """
    require_single("energy", response)
    ax = _axes(response, ax)
    terms = response.energy
    factor, unit = _unit(response, "energy", terms.input)
    time = np.asarray(response.time)
    parts = {"rods": "rods", "kinetic": "kinetic"}
    if any(link.has_damper for link in response.links):
        parts = {"friction": "damper"} | parts
    if touching(response):
        parts |= {"contact_lost": "pounding", "contact_stored": "stick"}
    ax.stackplot(
        time,
        *(factor * np.asarray(getattr(terms, name)) for name in parts),
        labels=[name.replace("_", " ") for name in parts],
        colors=[COLOURS[colour] for colour in parts.values()],
        alpha=0.6,
        linewidth=0,
    )
    _draw(ax, time, factor, Curve("input", "ground", terms.input + terms.initial))
    _draw(ax, time, factor, Curve("residual", "residual", terms.residual), linestyle="--")
    ax.margins(x=0)
    label(ax, _time(response), f"energy $E$ ({unit})")
    legend(ax, columns=3)
    return ax


Drawing = Callable[[Response, Axes], Axes]


def overview(response: Response) -> Figure:
    """Ground motion, displacements, friction and contact force and gap, one above the other.

    Without friction force where there is no damper, without contact force where none acts, and
    without gap where no link has one.
    """
    drawings: list[Drawing] = [ground_motion, displacements]
    if any(link.has_damper for link in response.links):
        drawings.append(friction_force)
    if any(np.any(link.contact != 0) for link in touching(response)):
        drawings.append(contact_force)
    if np.isfinite(response.min_gap).any():
        drawings.append(gap)
    return side_by_side({"": response}, drawings)


@in_house_style
def side_by_side(
    responses: Mapping[str, Response],
    drawings: Sequence[Drawing] = (ground_motion, displacements, friction_force, gap),
) -> Figure:
    """Runs by name as columns, drawings as rows, each row to one scale.

    Raises
    ------
    ValueError
        If there is no run, or some are in SI units and others are not.
    """
    runs = same_units("side_by_side", responses)
    n = len(runs)
    result = new_figure(2 if n < 3 else 0.8 * n, 0.825 * max(len(drawings), 1.2))
    panels = result.subplots(len(drawings), n, squeeze=False)
    for column, (name, response) in zip(panels.T, runs.items(), strict=True):
        column[0].set_title(name)
        for draw, ax in zip(drawings, column, strict=True):
            draw(response, ax)
    for row in panels:
        same_height(row)
    same_x = all(len({ax.get_xlabel() for ax in column}) == 1 for column in panels.T)
    for ax in panels.flat:
        spec = ax.get_subplotspec()
        if same_x and not spec.is_last_row():
            ax.set_xlabel("")
            ax.tick_params(labelbottom=False)
        if not spec.is_first_col():
            ax.set_ylabel("")
            ax.tick_params(labelleft=False)
    result.align_ylabels(panels[:, 0])
    return result


PAPER = (ground_motion, displacements, velocities, gap, friction_force, rod_forces)


def paper_figures(response: Response) -> dict[str, Figure]:
    """The figures that the paper shows of its numerical example, drawn for one run.

    Returns
    -------
    ``"ground_motion"``, ``"displacements"``, ``"velocities"``, ``"gap"``, ``"friction_force"`` with
    the phases of stick, and ``"rod_forces"``.
    """
    figures: dict[str, Any] = {draw.__name__: draw(response).figure for draw in PAPER}
    return figures


def _over_time(
    response: Response,
    ax: Axes | None,
    words: str,
    quantity: str,
    curves: Sequence[Curve],
    symbol: str,
) -> Axes:
    """Curves over time; the axis has their labels where these are symbols, else the symbol."""
    ax = _axes(response, ax)
    factor, unit = _unit(response, quantity, *(curve.values for curve in curves))
    for curve in curves:
        _draw(ax, response.time, factor, curve)
    named = all(curve.label.startswith("$") for curve in curves)
    symbols = ", ".join(curve.label for curve in curves) if named else symbol
    ax.margins(x=0)
    label(ax, _time(response), f"{words} {symbols} ({unit})")
    if len(curves) > 1:
        legend(ax, 4 if named else 3)
    return ax


def _axes(response: Response, ax: Axes | None) -> Axes:
    invalid = np.ravel(~np.isfinite(response.demand.pga))
    if invalid.any():
        n = invalid.size
        which = f"{invalid.sum()} of {n} runs are" if n > 1 else "the run is"
        raise ValueError(f"plots: {which} invalid (NaN)")
    return new_axes(ax)


def same_units(name: str, responses: Mapping[str, Response]) -> dict[str, Response]:
    """The runs, at least one and all in the same units; ``name`` begins the error's message."""
    instance(name, "responses", responses, Mapping)
    if not responses:
        raise ValueError(f"{name}: responses must hold at least one run")
    for run, response in responses.items():
        instance(name, f"responses[{run!r}]", response, Response)
    if len({response.si for response in responses.values()}) > 1:
        raise ValueError(f"{name}: responses must all be in SI units, or all be dimensionless")
    return dict(responses)


def _draw(ax: Axes, x: Any, factor: float, curve: Curve, **style: Any) -> None:
    x, y = np.asarray(x), factor * np.asarray(curve.values)
    style |= {"color": COLOURS.get(curve.colour, curve.colour), "label": curve.label}
    if x.ndim == 1:
        ax.plot(x, y, alpha=_LINE_ALPHA, **style)
        return
    runs = np.stack([x, y], -1).reshape(-1, x.shape[-1], 2)
    alpha = max(0.03, _LINE_ALPHA / len(runs) ** 0.4)
    ax.add_collection(LineCollection(list(runs), alpha=alpha, **style))
    ax.autoscale_view()


def _shade_pounding(ax: Axes, named: bool) -> None:
    # add_artist leaves the limits as they are, so the region may reach far down.
    low, high = ax.get_ylim()
    depth = 1e3 * (abs(low) + abs(high) + 1)
    words = r"pounding, $\xi \leq 0$" if named else "_pounding"
    across = ax.get_yaxis_transform()
    region = Rectangle((0, -depth), 1, depth, transform=across, label=words, **shade("pounding"))
    ax.add_artist(region)


def _unit(response: Response, quantity: str, *series: Any) -> tuple[float, str]:
    """Factor and name of the unit for the series."""
    peak = max((float(np.max(np.abs(values))) for values in series), default=0.0)
    return unit_for(quantity, response.si, peak)


def _time(response: Response) -> str:
    return f"time $t$ ({_unit(response, 'time')[1]})"


def _length(response: Response) -> str:
    return _unit(response, "length")[1]
