"""A drawing of buildings in a row: floors and storeys, and the links between them."""

from __future__ import annotations

import reprlib
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.path import Path

from jaxpound._checks import instance, is_known_and_single, real
from jaxpound._errors import InvalidInput
from jaxpound._fields import Parameter, walk
from jaxpound.model.dampers import Dashpot, PowerLaw
from jaxpound.model.places import homes
from jaxpound.model.system import Link, Rod, Structures, in_si
from jaxpound.model.topology import (
    GROUND,
    Topology,
    WeightedMasses,
    floors,
    footings,
    soil_spring,
    stacks,
    two_ends,
)
from jaxpound.plots import style as house
from jaxpound.plots.style import COLOURS, in_house_style, new_axes, text_at, unit_for

Lines = list[tuple[str, str]]  # words and their colours
Damper = tuple[int, Rod] | None  # of a link: its number among the rods, and itself
Storey = tuple[float, str, Lines, float]  # height, words, lines below, share of the width
Place = tuple[float, float, float]  # left end and height of a floor, and of the ground below it

_WIDTH, _LINKED, _UNLINKED = 3.0, 2.6, 0.8  # of a building, of a space with links, without
_PAD = 0.09  # width of the pads of a contact law
_WALL = 0.4  # width of a wall on the ground
_PLATES: Any = {"marker": "s", "markersize": 5}  # the symbol of a friction damper
_PISTON = [(1, 0.7), (-1, 0.7), (-1, -0.7), (1, -0.7), (0, 0.4), (0, -0.4), (0, 0), (1, 0)]
_DASHPOT = _PLATES | {"marker": Path(_PISTON, [1, 2, 2, 2, 1, 2, 1, 2]), "markersize": 7}
_DASHPOT |= {"markerfacecolor": "white"}
_FLYWHEEL: Any = {"marker": "o", "markersize": 7, "markerfacecolor": "white"}
_HATCH: Any = {"facecolor": "0.85", "hatch": "////", "edgecolor": "0.6", "linewidth": 0}
_STOREY, _SLAB, _LINE = 0.45, 0.18, 0.15  # least height of a storey, floor, number in inches


@in_house_style
def row(
    structures: Structures, elevations: Sequence[Any] | None = None, ax: Axes | None = None
) -> Axes:
    """Buildings from left to right, with the numbers of their floors, storeys and links.

    Masses m stand in the floors, stiffnesses K in the storeys, slip forces μ, from slow to fast,
    forces F or coefficients c of viscous dampers and gaps at rest ξ0 at the links, with the numbers
    of their series; in SI units of ``Buildings``, else dimensionless. Dampers are green, also
    braces within a building and dampers to the ground; pads are orange where contact has a law; an
    arrow is a gap, to a wall where the other end is the ground, or to a column. Bearings, a first
    storey of less than half of the height of another, and walls as low as these stand in a pit.
    Tuned masses are narrower. A footing on soil is a block in the ground, with the stiffnesses of
    sway and of rocking, that of a lever of 1 m.

    Structures are ``Buildings``, ``Row``, ``Storeys``, ``AdjacentStructures`` or a ``System`` of
    shear buildings, which stand in the order of their masses. ``elevations`` are the heights of the
    floors of each building above the ground, m (each one's ``elevations``); by default all storeys
    are as high, but for buildings with a link to a column. A new figure is high enough for the
    numbers to be read.

    A ``ValueError`` if structures are no shear buildings, traced or a batch, or elevations are not
    one for each floor of each building, finite, from the lowest up.

    Examples
    --------
    >>> from jaxpound.plots import row
    >>> ax = row(jp.paper.structures())
    """
    instance("structures", structures, Structures)
    if not is_known_and_single(system := structures.system()):
        raise InvalidInput("structures", "", "must be known and one row, not a batch")
    at_columns = any(link.column for link in system.links)
    if elevations is None and at_columns:
        elevations = _elevations_of(structures)
    buildings = stacks(system.topology)
    heights = stack_heights(system.topology, elevations)
    rods = homes(system.topology, of_rods=True)
    building_of = {mass: b - 1 for mass, (b, _) in homes(system.topology).items()}
    ends_of_links = [two_ends(link.ends) for link in system.links]
    linked = [{building_of.get(end) for end in pair} for pair in ends_of_links]
    with_ends = zip(system.links, ends_of_links, strict=True)
    walls = {(building_of[max(x)], x[1] <= GROUND) for link, x in with_ends if _has_wall(link)}
    space = [[_LINKED * ((b, x) in walls) for x in (False, True)] for b in range(len(buildings))]
    lefts = [0.0]
    for b in range(1, len(buildings)):
        between = _LINKED if {b - 1, b} in linked else _UNLINKED
        lefts.append(lefts[-1] + _WIDTH + between + space[b - 1][1] + space[b][0])

    top, right = max(ups[-1] for ups in heights), lefts[-1] + _WIDTH + space[-1][1]
    rises = [np.diff(ups, prepend=0.0) for ups in heights]
    most = float(max(map(np.max, rises)))  # bearings, and walls as low as these, do not count
    storey = min(float(x[int(x[0] < most / 2) :].min(initial=most)) for x in rises)
    feet = [float(ups[0]) - storey if ups[0] < storey / 2 else 0.0 for ups in heights]
    write = partial(_written, in_si(structures))
    ends = system.topology.rods
    beside = {frozenset(ends[r]): (r, x) for r, x in enumerate(system.rods) if r not in rods}
    links = [(link, beside.pop(frozenset(link.ends), None)) for link in system.links]
    numbers = [_numbers(k, *link, write) for k, link in enumerate(links)]
    inside: dict[int, Lines] = {}  # of links within buildings, by the upper floor
    for (x, _), pair, lines in zip(links, linked, numbers, strict=True):
        if len(pair) == 1 or (None in pair and not _has_wall(x)):
            by_line = [(line, colour) for text, colour in lines for line in text.split("\n")]
            inside.setdefault(max(two_ends(x.ends)), []).extend(by_line)
    extra = [*map(len, inside.values()), *(text.count("\n") for x in numbers for text, _ in x)]
    storey_inches = _STOREY + _LINE * max(extra, default=0)
    soil = bool(footings(system.topology))
    deep = soil * storey * (_SLAB + 2.9 * _LINE) / storey_inches
    if ax is None:
        inches = storey_inches * (top + deep - min(feet)) / storey + 0.7
        across = right + space[0][0]
        closest = np.diff(np.unique(np.concatenate(heights))).min(initial=storey)
        inches *= float(np.clip(0.45 * storey / closest, 1.0, 2.0)) if at_columns else 1.0
        width = min(2.0, 0.15 * across + 0.3) if across < 14 else 2.0 * across / 14
        ax = new_axes(None, width, inches / house.FIGURE_SIZE[1])
    slab = storey * _SLAB / storey_inches
    ax.set_xlim(-0.4 - space[0][0], right + 0.4)
    ax.set_ylim(min(feet) - 0.95 * storey - deep, top + 1.2 * slab)
    _ground(ax, lefts, space, feet, min(feet) - max(storey / 4, 1.3 * slab * soil))
    places: dict[int, Place] = {}
    for b, (building, ups, left) in enumerate(zip(buildings, heights, lefts, strict=True)):
        colour, with_words = house.building_colour(b), list[Storey]()
        for (mass, rod), up in zip(building, ups.tolist(), strict=True):
            in_floor = f"$m_{{{mass + 1}}}$ = {write('mass', system.masses[mass])}"
            words = f"$K_{{{rod + 1}}}$ = {write('stiffness', system.rods[rod].stiffness)}"
            share = 0.8 if mass in system.tuned else 1.0
            with_words.append((up, in_floor, [(words, colour), *inside.get(mass, [])], share))
            places[mass] = left, up, feet[b]
        _building(ax, left, feet[b], slab, colour, with_words)
        low = min(feet) - 0.65 * storey - deep
        text_at(ax, left + _WIDTH / 2, low, f"building {b + 1}", colour)
    places |= _footings(ax, structures, [*zip(lefts, feet, strict=True)], slab)
    for link, lines in zip(links, numbers, strict=True):
        _link(ax, *link, places, slab, lines)
    _finish(ax, links, elevations is not None)
    return ax


def _elevations_of(structures: Structures) -> list[Any] | None:
    """The elevations of buildings that all have some; else None."""
    by_building = [getattr(x, "elevations", None) for x in getattr(structures, "buildings", ())]
    return None if any(x is None for x in by_building) else by_building


def _has_wall(link: Link) -> bool:
    """Whether a link has a gap to the ground."""
    return min(two_ends(link.ends)) <= GROUND and bool(np.isfinite(link.gap))


def floor_heights(n_floors: Sequence[int], elevations: Any) -> list[np.ndarray]:
    """Height of each floor of each building above the ground: as given, or its number."""
    if elevations is None:
        return [np.arange(1.0, n + 1) for n in n_floors]
    rule = f"must be one for each of the {len(n_floors)} buildings"
    if isinstance(elevations, str) or not isinstance(elevations, Sequence | np.ndarray):
        raise InvalidInput("elevations", reprlib.repr(elevations), rule)
    if len(elevations) != len(n_floors):
        raise InvalidInput(f"elevations, {len(elevations)} of them,", "", rule)
    heights = []
    for b, (elevation, n) in enumerate(zip(elevations, n_floors, strict=True)):
        ups = np.asarray(real(f"elevations[{b}]", elevation), float)
        rises = ups.shape == (n,) and (np.diff(ups, prepend=0.0) > 0).all()
        if not (rises and np.isfinite(ups).all()):
            floors = f"{n} floor{'s' * (n > 1)}"
            rule = f"must be the heights of {floors} above the ground, finite, from the lowest up"
            raise InvalidInput(f"elevations[{b}]", reprlib.repr(elevation), rule)
        heights.append(ups)
    return heights


def stack_heights(topology: Topology, elevations: Any) -> list[np.ndarray]:
    """``floor_heights``, and of tuned masses, each half a storey above what it stands on."""
    heights = floor_heights([*map(len, floors(topology))], elevations)
    for b, stack in enumerate(stacks(topology)):
        ups, rise = heights[b], np.diff(heights[b], prepend=0.0)[-1] / 2
        heights[b] = np.append(ups, ups[-1] + rise * np.arange(1, len(stack) - ups.size + 1))
    return heights


def _ground(
    ax: Axes, lefts: Sequence[float], space: Sequence[Any], feet: Sequence[float], bottom: float
) -> None:
    """The ground, lower where buildings and the spaces beside them are in pits."""
    ends = [(x - a, x + _WIDTH + b) for x, (a, b) in zip(lefts, space, strict=True)]
    low, high = ax.get_xlim()
    x = [low, *np.repeat(ends, 2).tolist(), high]
    y = [0.0, *(height for foot in feet for height in (0.0, foot, foot, 0.0)), 0.0]
    ax.plot(x, y, color=COLOURS["ground"], linewidth=1.0)
    ax.fill_between(x, bottom, y, **_HATCH)


def _building(ax: Axes, left: float, below: float, slab: float, colour: str, storeys: Any) -> None:
    """Storeys from the ground below them on."""
    middle = left + _WIDTH / 2
    style: Any = {"edgecolor": colour, "facecolor": (colour, 0.25), "linewidth": 1.0}
    for up, in_floor, lines, share in storeys:
        under, columns = up - slab / 2, middle + np.array([-0.4, 0.4]) * share * _WIDTH
        ax.plot([columns, columns], [below, under], color=colour, linewidth=2.2)
        ax.add_patch(Rectangle((middle - share * _WIDTH / 2, under), share * _WIDTH, slab, **style))
        text_at(ax, middle, up, in_floor, colour)
        for i, (text, of_text) in enumerate(lines):
            at = below + (under - below) * (1 - (i + 0.5) / len(lines))
            x, align, behind = middle, "center", None
            if len(lines) > 1:  # on either side of the brace, which a wide number hides
                behind = {"facecolor": "white", "linewidth": 0, "pad": 1}
                align, shift = ("right", 0.36) if i else ("left", -0.36)
                x += shift * _WIDTH
            text_at(ax, x, at, text, of_text, align, bbox=behind)
        below = under + slab


def _footings(
    ax: Axes, structures: Structures, left_and_foot: Sequence[Any], slab: float
) -> dict[int, Place]:
    """Footings in the ground with their masses, and below each its soil's stiffnesses."""
    system, places = structures.system(), dict[int, Place]()
    write, line = partial(_written, in_si(structures)), slab * _LINE / _SLAB
    building_of = homes(system.topology)
    for footing, rotation in footings(system.topology).items():
        b = building_of[footing][0] - 1
        (left, foot), colour = left_and_foot[b], house.building_colour(b)
        words = [f"$m_{{{footing + 1}}}$ = {write('mass', system.masses[footing])}"]
        for r in (soil_spring(system.topology, mass) for mass in (footing, rotation)):
            words.append(f"$K_{{{r + 1}}}$ = {write('stiffness', system.rods[r].stiffness)}")
        style: Any = {"edgecolor": colour, "facecolor": "white", "linewidth": 1.0, "zorder": 2}
        ax.add_patch(Rectangle((left, foot - slab), _WIDTH, slab, **style))
        up = foot - slab / 2
        for i, text in enumerate(words):
            down = slab / 2 + (1.25 * i - 0.4) * line if i else 0.0
            text_at(ax, left + _WIDTH / 2, up - down, text, colour)
        places[footing] = left, up, foot
    return places


def _written(si: bool, kind: str, number: Any) -> str:
    """A number, in SI with its unit."""
    if not si:
        return f"{float(number):.3g}"
    factor, unit = unit_for(kind, si, float(number))
    return f"{float(f'{factor * float(number):.3g}'):,g} {unit}"


def _numbers(k: int, link: Link, damper: Damper, write: Callable[[str, Any], str]) -> Lines:
    """Forces and gap of a link, where it has them, in words and colours."""
    forces, fast = list[str](), link.velocity_friction
    if float(link.friction) or fast:
        forces.append(f"$\\mu_{{{k + 1}}}$ = {write('force', link.friction)}")
    if fast:
        forces.append(f"to {write('force', link.friction + fast.increase)}")
    if damper and isinstance(damper[1].material, PowerLaw | Dashpot):
        _, spec, number = next(walk(damper[1].material, Parameter))
        forces.append(f"${spec.symbol}_{{{damper[0] + 1}}}$ = {write(spec.kind, number)}")
    if link.inerter:
        forces.append(f"$b_{{{k + 1}}}$ = {write('mass', link.inerter.inertance)}")
    words = [("\n".join(forces), COLOURS["damper"])] if forces else []
    if np.isfinite(float(link.gap)):
        words.append((f"$\\xi_{{0,{k + 1}}}$ = {write('length', link.gap)}", COLOURS["ground"]))
    return words


def _link(
    ax: Axes, link: Link, damper: Damper, places: Mapping[int, Place], slab: float, numbers: Lines
) -> None:
    """What is between two floors: a line from the one to the other, and its numbers."""
    pair = two_ends(link.ends)
    if isinstance(link.ends, WeightedMasses) and link.column:  # at the height of the floor
        hit, above, *_ = link.ends.masses
        inset = _WIDTH / 10 if hit < above else -_WIDTH / 10
        places = {**places, above: (places[above][0] + inset, *places[hit][1:])}
    j, i = sorted(pair)  # the ground comes first
    start, up, foot = places[i]
    second = (start, foot, foot) if j <= GROUND else places[j]
    if _has_wall(link):  # to the right where the gap closes as the floor moves to the right
        side = 1 if pair[0] == i else -1
        second = start + side * (_WIDTH + _LINKED), up, foot
        face = second[0] + (side < 0) * (_WIDTH - _WALL)
        ax.add_patch(Rectangle((face, foot), _WALL, up + slab / 2 - foot, **_HATCH))
    (left, low, _), (right, high, _) = sorted((places[i], second))
    between = left != right
    if between:
        x, y = np.array([left + _WIDTH, right]), np.array([low, high])
    else:  # from the lower floor's left to the upper one's right
        x = left + np.array([0.12, 0.88]) * _WIDTH
        y = np.array([low + slab / 2 * (low > 0), high - slab / 2])
    if COLOURS["damper"] in dict(numbers).values():
        slips = float(link.friction) or link.velocity_friction
        symbol: Any = _DASHPOT if damper else _PLATES if slips else _FLYWHEEL
        symbol = symbol | {"color": COLOURS["damper"]}
        ax.plot(x, y, linewidth=1.2, zorder=3 if between else 0.9, color=symbol["color"])
        ax.plot([x.mean()], [y.mean()], zorder=4, **symbol)
    if link.contact is not None:
        for end, up, face in zip(x, y, (0.0, -_PAD), strict=True):
            corner = end + face, up - 0.4 * slab
            ax.add_patch(Rectangle(corner, _PAD, 0.8 * slab, color=COLOURS["pounding"], zorder=3))
    if between:
        away = 0.2 * _LINKED * abs(y[1] - y[0]) / (x[1] - x[0])  # clear of the line's higher end
        sides = (0.6 * slab + away, -0.9 * slab - away)  # above the line, below the arrow
        for (text, colour), side in zip(numbers, sides, strict=False):
            second_line = slab * _LINE / _SLAB / 2 * text.count("\n")
            text_at(ax, x.mean(), y.mean() + side + second_line, text, colour)
        if np.isfinite(float(link.gap)):
            pad = _PAD * (link.contact is not None)
            ends = (x[0] + pad, y[0] - 0.3 * slab), (x[1] - pad, y[1] - 0.3 * slab)
            house.arrow(ax, *ends, COLOURS["ground"], 6, "<|-|>", linewidth=0.6)


def _finish(ax: Axes, links: Sequence[tuple[Link, Damper]], in_metres: bool) -> None:
    """Legend of the symbols, and the axis of heights."""
    marks: list[Any] = []
    style: Any = {"color": COLOURS["damper"], "linewidth": 1.2}
    if any(float(link.friction) or link.velocity_friction for link, _ in links):
        marks.append(Line2D([], [], label=r"damper, slip force $\mu$", **_PLATES, **style))
    if materials := {type(damper[1].material).__name__ for _, damper in links if damper}:
        words = f"damper ({', '.join(sorted(materials))})"
        marks.append(Line2D([], [], label=words, **_DASHPOT, **style))
    if any(link.inerter for link, _ in links):
        marks.append(Line2D([], [], label="inerter, inertance $b$", **_FLYWHEEL, **style))
    if any(np.isfinite(float(link.gap)) for link, _ in links):
        arrow: Any = {"color": COLOURS["ground"], "linewidth": 0.6, "markersize": 4}
        marks.append(Line2D([], [], marker="d", label=r"gap at rest $\xi_0$", **arrow))
    if laws := {type(link.contact).__name__ for link, _ in links if link.contact is not None}:
        words = f"contact ({', '.join(sorted(laws))})"
        marks.append(Patch(color=COLOURS["pounding"], label=words))
    if marks:
        ax.legend(handles=marks, ncols=len(marks), loc="lower center", bbox_to_anchor=(0.5, 1.0))
    ticks = [x for x in ax.get_yticks() if in_metres and 0 <= x <= ax.get_ylim()[1]]
    ax.set(xticks=[], yticks=ticks)
    ax.grid(False)
    ax.spines[:].set_visible(False)
    if in_metres:
        ax.set_ylabel("height (m)", fontsize=house.FONT_SIZE)
        ax.spines["left"].set(visible=True, bounds=(0, ticks[-1]))
        ax.tick_params(labelsize=house.FONT_SIZE)
