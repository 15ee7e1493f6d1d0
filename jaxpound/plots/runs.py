"""Figures of runs: every function draws a ``Response`` into axes and returns them.

The runs of a batch are drawn over each other; the more runs, the fainter the lines. With
``ax=None`` the axes belong to a new pyplot figure of column width (9 cm), which a notebook shows
and ``plt.show()`` or ``plt.savefig`` take; with axes given, pyplot is not touched.

A ``ValueError`` is raised for an invalid run, for one that has nothing of what is to be drawn (no
link, gap or law of contact), and for several runs by name if there is none, or some are in SI units
and others are not.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from jaxpound._checks import require_one_of
from jaxpound.plots import curves
from jaxpound.plots import style as house
from jaxpound.plots.curves import Curve, Loops, is_pair, same_units, series_axis, touching
from jaxpound.plots.style import COLOURS, in_house_style, label, shade
from jaxpound.results.response import Response, require_single


@in_house_style
def ground_motion(response: Response, ax: Axes | None = None) -> Axes:
    """Ground acceleration u'' over time."""
    lines = [Curve("$u''$", "ground", response.ground_acceleration)]
    return curves.over_time(response, ax, "ground acceleration", "acceleration", lines, "$u''$")


@in_house_style
def displacements(response: Response, ax: Axes | None = None) -> Axes:
    """Displacement x of each mass, relative to the ground, over time."""
    lines = curves.of_each(response, "masses", "x", "$x_{}$")
    return curves.over_time(response, ax, "displacement", "length", lines, "$x$")


@in_house_style
def velocities(response: Response, ax: Axes | None = None) -> Axes:
    """Velocity x' of each mass, relative to the ground, over time."""
    lines = curves.of_each(response, "masses", "v", "$x_{}'$")
    return curves.over_time(response, ax, "velocity", "velocity", lines, "$x'$")


@in_house_style
def rod_forces(response: Response, ax: Axes | None = None) -> Axes:
    """Force f of each rod (of one to the ground, the base shear) over time."""
    lines = curves.of_each(response, "rods", "force", "$f_{}$")
    return curves.over_time(response, ax, "rod force", "force", lines, "$f$")


@in_house_style
def gap(response: Response, ax: Axes | None = None) -> Axes:
    """Gap ξ of each link over time; the smallest of all is marked, with value and time.

    The minimum (of a batch, the smallest) is that of ``response.demand``, which may lie between
    instants of the grid. The region of pounding, ξ ≤ 0, is shaded, and named in the legend if the
    gap comes near it. Impacts of a single run, by a law of contact, are marked where they begin,
    and named instead. Else the legend of a pair says how far the gap at rest has closed.
    """
    lines = curves.gaps_of(response)
    ax = curves.over_time(response, ax, "gap", "length", lines, r"$\xi$")
    smallest = np.ravel(response.min_gap)
    low, high = float(smallest.min()), max(float(np.nanmax(curve.values)) for curve in lines)
    time = float(np.ravel(response.demand.min_gap_time)[smallest.argmin()])
    numbers = (low, "length"), (time, "time")
    words = "min {} at $t$ = {}".format(*(house.in_unit(*x, response.si) for x in numbers))
    (point,) = ax.plot(time, low, "o", color=COLOURS["damper"], markersize=4, label="_minimum")
    if len(lines) > 1:
        point.set(label=words, color=COLOURS["ground"])
    else:
        drawn: Any = ax.lines[:-1] if np.ndim(response.time) == 1 else ax.collections
        drawn[-1].set_label(rf"$\xi$, {words}")

    hits = [] if response.batch else [impact.time for impact in response.impacts()]
    if is_pair(response) and not (hits or response.batch):
        rest = float(response.gap[0] + response.x1[0] - response.x2[0])
        parts = [house.in_unit(x, "length", response.si) for x in (rest, rest - low)]
        point.set_label("gap at rest {} − closing {}".format(*parts))
    if hits:
        style: Any = {"color": COLOURS["structure 2"], "markersize": 4, "label": "impact"}
        ax.plot(hits, np.zeros(len(hits)), "v", linestyle="none", **style)
    span = (high - low) or abs(high) or 1.0
    near = low < 0.3 * span
    _shade_pounding(ax, near and not hits)
    bottom = low - 0.1 * span
    columns = 2 - (sum(not curve.label.startswith("_") for curve in lines) == 1)
    house.legend(ax, columns, min(bottom, -0.15 * span) if near else bottom)
    return ax


@in_house_style
def gaps(responses: Mapping[str, Response], ax: Axes | None = None) -> Axes:
    """Gaps ξ over time of several runs by name, the first in grey, and the smallest of each."""
    runs = list(same_units(responses).values())
    for name, response, colour in zip(responses, runs, house.shades(len(runs)), strict=True):
        ax = curves.run_axes(response, ax)
        smallest = house.in_unit(float(np.min(response.min_gap)), "length", response.si)
        for i, curve in enumerate(curves.gaps_of(response)):
            drawn = curve._replace(label="_" if i else f"{name}: min {smallest}", colour=colour)
            curves.draw_curve(ax, response.time, 1.0, drawn)
    assert ax is not None
    _shade_pounding(ax, False)
    ax.axhline(0, color=COLOURS["pounding"], zorder=1)
    ax.margins(x=0)
    label(ax, curves.time_label(runs[0]), curves.length_label(runs[0], r"gap $\xi$"))
    house.legend(ax, columns=1)
    return ax


@in_house_style
def friction_force(response: Response, ax: Axes | None = None) -> Axes:
    """Friction force q of each link over time; of one in a single run stick is shaded."""
    lines = [*curves.frictions(response).values()]
    ax = curves.over_time(response, ax, "friction force", "force", lines, "$q$")
    if np.ndim(response.time) > 1 or len(lines) > 1:
        return ax
    if sticks := [(p.start, p.end - p.start) for p in response.phases() if p.kind == "stick"]:
        across = ax.get_xaxis_transform()
        ax.broken_barh(sticks, (0, 1), transform=across, label="stick", **shade("stick"))
        house.legend(ax)
    return ax


@in_house_style
def contact_force(response: Response, ax: Axes | None = None) -> Axes:
    """Contact force p of each link with a law of contact over time, also within the steps.

    In a single run the largest force of each impact is marked. Impacts by Newton's law have no
    force: what is drawn then presses blocks together at rest. Of a user-defined law in other units
    than the run's there are only the instants; the marks have the largest forces all the same.
    """
    contacts = curves.contacts(response)
    lines = [curve for curve, _ in contacts.values()]
    peaks = []
    for hit in [] if response.batch else response.impacts():
        if np.isfinite(hit.peak_force):
            path = contacts[hit.link][1]
            outside = (path.time < hit.time) | (path.time > hit.end)
            at = np.argmax(np.where(outside, -np.inf, path.force))
            peaks.append((hit.time if outside.all() else path.time[at], hit.peak_force))
    times, highest = np.reshape(peaks, (-1, 2)).T
    ax = curves.over_time(response, ax, "contact force", "force", lines, "$p$")
    if peaks:
        factor, _ = series_axis(response, "", "force", [curve.values for curve in lines])
        style: Any = {"color": COLOURS["structure 2"], "markersize": 3}
        ax.plot(times, factor * highest, "o", label="largest of an impact", **style)
        house.legend(ax, columns=3)
    return ax


@in_house_style
def rod_hysteresis(response: Response, ax: Axes | None = None, rods: Any = None) -> Axes:
    """Force over elongation of each rod; of a pair f1 over x1 and f2 over x2.

    ``rods`` chooses some by number, from 0 as in ``response.rods``.
    """
    return curves.draw_loops(response, ax, _loops("rod", response), rods)


@in_house_style
def friction_hysteresis(response: Response, ax: Axes | None = None, links: Any = None) -> Axes:
    """Friction force q over slip of each link: the enclosed area is the energy taken by the damper.

    The slip is that of its ends, x_i − x_j, by which the gap has closed. ``links`` chooses some by
    number, from 0 as in ``response.links``.
    """
    return curves.draw_loops(response, ax, _loops("friction", response), links)


@in_house_style
def contact_hysteresis(response: Response, ax: Axes | None = None, links: Any = None) -> Axes:
    """Contact force p over penetration δ = −ξ of each link with a law of contact.

    The enclosed area is the energy lost by contact. Impacts are drawn within the steps too; of a
    user-defined law in other units than the run's there are only the instants. ``links`` chooses
    some by number, from 0 as in ``response.links``.
    """
    return curves.draw_loops(response, ax, _loops("contact", response), links)


@in_house_style
def hysteresis(response: Response, kind: str = "rod", numbers: Any = None) -> Figure:
    """A panel for each rod or link, named by its storey or floor, all to the same scales.

    The kind is "rod", "friction" or "contact", as of the functions. ``numbers`` are those of rods
    or links, from 0; by default those with a force, at most 20 at even distances.
    """
    require_one_of(kind, ("rod", "friction", "contact"), "kind")
    loops = _loops(kind, response)
    acting = [k for k, x in loops.curves.items() if np.any(x.values)] or [*loops.curves]
    evenly = np.linspace(0, len(acting) - 1, min(len(acting), 20)).round().astype(int)
    numbers = curves.chosen(loops, [acting[i] for i in evenly] if numbers is None else numbers)
    rows = -(-len(numbers) // 4)
    columns = -(-len(numbers) // rows)
    figure = house.new_figure(max(0.5 * columns, 1.0), 0.55 * rows + 0.25)
    for i, number in enumerate(numbers):
        first = figure.axes[0] if i else None
        ax = figure.add_subplot(rows, columns, i + 1, sharex=first, sharey=first)
        curves.draw_loops(response, ax, loops, [number])
        figure.supxlabel(ax.get_xlabel(), fontsize=house.FONT_SIZE)
        figure.supylabel(ax.get_ylabel(), fontsize=house.FONT_SIZE)
        ax.set(xlabel="", ylabel="")
        ax.locator_params(nbins=3)
        ax.tick_params(labelleft=i % columns == 0, labelbottom=i + columns >= len(numbers))
    return figure


def _loops(kind: str, response: Response) -> Loops:
    """The loops of all rods, dampers or contacts."""
    if kind == "rod":
        lines = curves.of_each(response, "rods", "force", "structure {}")
        words = "elongation", "rod force $f$"
        if is_pair(response):
            words = "displacement $x_1$, $x_2$", "rod force $f_1$, $f_2$"
        return Loops("rods", response.elongations, dict(enumerate(lines)), *words)
    if kind == "contact":
        contacts = curves.contacts(response)
        depths = {k: path.penetration for k, (_, path) in contacts.items()}
        by_link = {k: curve for k, (curve, _) in contacts.items()}
        return Loops("links", depths, by_link, r"penetration $\delta$", "contact force $p$")
    by_link, slips = curves.frictions(response), response.closings
    across = "slip $x_1 - x_2$" if is_pair(response) else "slip $x_i - x_j$"
    return Loops("links", slips, by_link, across, "friction force $q$")


@in_house_style
def energy(response: Response, ax: Axes | None = None) -> Axes:
    """Energy of a single run over time: damper, rods and kinetic energy, stacked, and the input.

    The stack is friction's work, the rods' work, the kinetic energy and the work of the damping of
    buildings that have one beside their rods, with a law of contact also what is lost by contact
    and stored in it; the line is the input, with the energy at t = 0 of a run that does not start
    at rest. Their difference, also a line, is the residual of the balance.
    """
    require_single(response)
    ax = curves.run_axes(response, ax)
    terms, time = response.energy, np.asarray(response.time)
    factor, words = series_axis(response, "energy $E$", "energy", [terms.input])
    parts = {"rods": "rods", "kinetic": "kinetic"}
    if any(link.has_damper for link in response.links):
        parts = {"friction": "damper"} | parts
    if any(mass.damping is not None for mass in response.masses):
        parts |= {"damping": "structure 1"}
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
    curves.draw_curve(ax, time, factor, Curve("input", "ground", terms.input + terms.initial))
    residual = Curve("residual", "residual", terms.residual)
    curves.draw_curve(ax, time, factor, residual, linestyle="--")
    ax.margins(x=0)
    label(ax, curves.time_label(response), words)
    house.legend(ax, columns=3)
    return ax


Drawing = Callable[[Response, Axes], Axes]


def overview(response: Response) -> Figure:
    """Ground motion, displacements, friction and contact force and gap, one above the other.

    Each force is left out where there is no damper, or no contact, and the gap if no link has one.
    """
    drawings: list[Drawing] = [ground_motion, displacements]
    if any(link.has_damper for link in response.links):
        drawings.append(friction_force)
    if np.any([x.peak_contact for x in response.demand.links if x.peak_contact is not None]):
        drawings.append(contact_force)
    if np.isfinite(response.min_gap).any():
        drawings.append(gap)
    return side_by_side({"": response}, drawings)


@in_house_style
def side_by_side(
    responses: Mapping[str, Response],
    drawings: Sequence[Drawing] = (ground_motion, displacements, friction_force, gap),
) -> Figure:
    """Runs by name as columns, drawings as rows, each row to one scale."""
    runs = same_units(responses)
    n = len(runs)
    result = house.new_figure(2 if n < 3 else 0.8 * n, 0.825 * max(len(drawings), 1.2))
    panels = result.subplots(len(drawings), n, squeeze=False)
    for column, (name, response) in zip(panels.T, runs.items(), strict=True):
        column[0].set_title(name)
        for draw, ax in zip(drawings, column, strict=True):
            draw(response, ax)
    for row in panels:
        house.same_height(row)
    same_x = all(len({ax.get_xlabel() for ax in column}) == 1 for column in panels.T)
    for ax in panels.flat:
        words = ax.get_xlabel()
        ax.label_outer()
        if not same_x:
            ax.set_xlabel(words)
            ax.tick_params(labelbottom=True)
    result.align_ylabels(panels[:, 0])
    return result


def _shade_pounding(ax: Axes, named: bool) -> None:
    # add_artist leaves the limits as they are, so the region may reach far down.
    low, high = ax.get_ylim()
    depth = 1e3 * (abs(low) + abs(high) + 1)
    words = r"pounding, $\xi \leq 0$" if named else "_pounding"
    across = ax.get_yaxis_transform()
    region = Rectangle((0, -depth), 1, depth, transform=across, label=words, **shade("pounding"))
    ax.add_artist(region)
