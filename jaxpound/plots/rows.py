"""A drawing of buildings in a row: floors and storeys, and the links between them."""

from __future__ import annotations

import reprlib
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch, Patch, Rectangle

from jaxpound._checks import instance, is_traced, real
from jaxpound.model.contact import ContactLaw, Newton
from jaxpound.model.system import GROUND, Link, Structures, System, floors
from jaxpound.plots.style import (
    COLOURS,
    FIGURE_SIZE,
    FONT_SIZE,
    building_colour,
    in_house_style,
    new_axes,
    unit_for,
)
from jaxpound.units import Scales

Written = Callable[[str, Any], str]
"""Writes a number of a kind."""

_WIDTH, _APART, _FREE = 3.0, 2.6, 0.8  # of a building, between two with links, between others
_PAD = 0.09  # width of the pads of a contact law
_STOREY, _SLAB, _LINE = (
    0.45,
    0.18,
    0.15,
)  # least height of a storey, of a floor, of a number, inches


@in_house_style
def row(
    structures: Structures,
    elevations: Sequence[Any] | None = None,
    ax: Axes | None = None,
    scales: Scales | None = None,
) -> Axes:
    """Buildings from left to right, with the numbers of their floors, storeys and links.

    Masses m stand in the floors, stiffnesses K in the storeys, slip forces μ and gaps at rest ξ0 at
    the links, in SI units if ``scales`` are given, else dimensionless; masses, rods and links have
    the numbers of their series.
    Dampers are green, also braces between floors of one building and dampers to the ground; pads
    are orange where contact has a law; an arrow is a gap.

    Parameters
    ----------
    structures
        ``Row``, ``Storeys``, ``AdjacentStructures`` or a ``System`` of shear buildings, which stand
        in the order of their masses.
    elevations
        For each building the height of its floors above the ground, m
        (``[building.elevations for building in buildings]``); by default all storeys are as high.
    ax
        Where to draw; by default a new figure, high enough for the numbers to be read.
    scales
        The units of the structures (``dimensionless_row`` returns them), for numbers in SI.

    Raises
    ------
    ValueError
        If structures are no shear buildings, traced or a batch, or elevations are not one for each
        floor of each building, finite, from the lowest up.

    Examples
    --------
    >>> from jaxpound.plots import row
    >>> steel = jp.ZenerRod(order=0.5, tau_f=0.01, tau_x=0.05)
    >>> houses = tuple(jp.Storeys((1.0,) * n, jp.Rod(steel, 5.0)) for n in (3, 2))
    >>> links = jp.floor_links(houses, friction=0.1, gap=0.2)
    >>> ax = row(jp.Row(houses, links))
    """
    instance("row", "structures", structures, Structures)
    system = structures.system()
    leaves = jax.tree.leaves(system)
    if is_traced(leaves) or any(np.ndim(leaf) for leaf in leaves):
        raise ValueError("row: structures must be known and one row, not a batch")
    buildings = floors(system.topology)
    heights = floor_heights("row", [len(one) for one in buildings], elevations)
    joined = {frozenset(link.ends) for link in system.links}
    lefts: list[float] = [0.0]
    home: dict[int, int] = {}
    for b, building in enumerate(buildings):
        home |= {mass: b for mass, _ in building}
    for b in range(1, len(buildings)):
        beside = any({home.get(end) for end in ends} == {b - 1, b} for ends in joined)
        lefts.append(lefts[-1] + _WIDTH + (_APART if beside else _FREE))

    top, right = max(each[-1] for each in heights), lefts[-1] + _WIDTH
    storey = min(float(np.diff(each, prepend=0.0).min()) for each in heights)
    write = partial(_written, scales)
    inside = _numbers_inside(system.links, home, write)
    lines = max(map(len, inside.values()), default=0)
    if ax is None:
        storey_inches = _STOREY + _LINE * lines
        inches = storey_inches * top / storey + 0.7
        width = min(2.0, 0.15 * right + 0.3) if right < 14 else 2.0 * right / 14
        ax = new_axes(None, width, inches / FIGURE_SIZE[1])
    slab = storey * _SLAB / (_STOREY + _LINE * lines)
    ax.set_xlim(-0.4, right + 0.4)
    ax.set_ylim(-0.95 * storey, top + 1.2 * slab)
    _ground(ax, right, storey)
    places: dict[int, _Place] = {}
    for b, (building, up, left) in enumerate(zip(buildings, heights, lefts, strict=True)):
        drawn = _Building(ax, left, slab, building_colour(b), write)
        drawn.draw(building, up, system, inside)
        _text(ax, left + _WIDTH / 2, -0.65 * storey, f"building {b + 1}", drawn.colour)
        places |= {mass: _Place(left, h) for (mass, _), h in zip(building, up, strict=True)}
    for k, link in enumerate(system.links):
        _link(ax, link, places, slab, _numbers(k, link, write))
    _finish(ax, system.links, elevations is not None)
    return ax


def floor_heights(
    owner: str, n_floors: Sequence[int], elevations: Sequence[Any] | None
) -> list[np.ndarray]:
    """Height of each floor of each building above the ground: as given, or its number."""
    if elevations is None:
        return [np.arange(1.0, n + 1) for n in n_floors]
    rule = f"one for each of the {len(n_floors)} buildings"
    if isinstance(elevations, str) or not isinstance(elevations, Sequence | np.ndarray):
        raise ValueError(f"{owner}: elevations = {reprlib.repr(elevations)} must be {rule}")
    if len(elevations) != len(n_floors):
        raise ValueError(f"{owner}: elevations, {len(elevations)} of them, must be {rule}")
    return [
        heights_above_ground(owner, f"elevations[{b}]", each, n)
        for b, (each, n) in enumerate(zip(elevations, n_floors, strict=True))
    ]


def heights_above_ground(owner: str, name: str, given: Any, n: int) -> np.ndarray:
    """The heights of a building's n floors, as numbers."""
    heights = np.asarray(real(owner, name, given), float)
    rises = heights.shape == (n,) and (np.diff(heights, prepend=0.0) > 0).all()
    if not (rises and np.isfinite(heights).all()):
        floors = f"{n} floor{'s' * (n > 1)}"
        rule = f"the heights of {floors} above the ground, finite, from the lowest up"
        raise ValueError(f"{owner}: {name} = {reprlib.repr(given)} must be {rule}")
    return heights


class _Place(NamedTuple):
    """Left end and height of a floor."""

    left: float
    up: float


class _Building(NamedTuple):
    ax: Axes
    left: float
    slab: float
    colour: str
    write: Written

    def draw(
        self,
        building: Sequence[tuple[int, int]],
        heights: np.ndarray,
        system: System,
        inside: Mapping[int, list[tuple[str, str]]],
    ) -> None:
        """Floors and storeys with their numbers, and those of the links inside."""
        below, middle = 0.0, self.left + _WIDTH / 2
        for (mass, rod), up in zip(building, heights.tolist(), strict=True):
            under = up - self.slab / 2
            for at in (0.1, 0.9):
                x = self.left + at * _WIDTH
                self.ax.plot([x, x], [below, under], color=self.colour, linewidth=2.2)
            for style in ({"alpha": 0.25, "linewidth": 0}, {"fill": False, "linewidth": 1.0}):
                shape: Any = {"edgecolor": self.colour, "facecolor": self.colour, **style}
                self.ax.add_patch(Rectangle((self.left, under), _WIDTH, self.slab, **shape))
            words = f"$m_{{{mass + 1}}}$ = {self.write('mass', system.masses[mass])}"
            _text(self.ax, middle, up, words, self.colour)
            words = f"$K_{{{rod + 1}}}$ = {self.write('stiffness', system.rods[rod].stiffness)}"
            lines = [(words, self.colour), *inside.get(mass, [])]
            for i, (text, colour) in enumerate(lines):
                at = below + (under - below) * (1 - (i + 0.5) / len(lines))
                if len(lines) == 1:
                    _text(self.ax, middle, at, text, colour)
                else:  # on either side of the brace, which is hidden where a number is wide
                    align, shift = ("right", 0.36) if i else ("left", -0.36)
                    behind = {"facecolor": "white", "linewidth": 0, "pad": 1}
                    _text(self.ax, middle + shift * _WIDTH, at, text, colour, align, behind)
            below = under + self.slab


def _written(scales: Scales | None, kind: str, number: Any) -> str:
    """A dimensionless number, in SI with its unit if there are scales."""
    if scales is None:
        return f"{float(number):.3g}"
    in_si = float(number) * float(scales.unit_of(kind))
    factor, unit = (1e-3, "t") if kind == "mass" else unit_for(kind, True, in_si)
    return f"{factor * in_si:.3g} {unit}"


def _numbers(k: int, link: Link, write: Written) -> list[tuple[str, str]]:
    """Slip force and gap of a link, where it has them, in words and colours."""
    words = []
    if float(link.friction):
        words.append((f"$\\mu_{{{k + 1}}}$ = {write('force', link.friction)}", COLOURS["damper"]))
    if np.isfinite(float(link.gap)):
        words.append((f"$\\xi_{{0,{k + 1}}}$ = {write('length', link.gap)}", COLOURS["ground"]))
    return words


def _numbers_inside(
    links: Sequence[Link], home: Mapping[int, int], write: Written
) -> dict[int, list[tuple[str, str]]]:
    """Numbers of the links inside of buildings, by their upper floor."""
    found: dict[int, list[tuple[str, str]]] = {}
    for k, link in enumerate(links):
        if GROUND in link.ends or home[link.ends[0]] == home[link.ends[1]]:
            found.setdefault(max(link.ends), []).extend(_numbers(k, link, write))
    return found


def _link(
    ax: Axes,
    link: Link,
    places: Mapping[int, _Place],
    slab: float,
    numbers: Sequence[tuple[str, str]],
) -> None:
    """What is between two floors: a line from the one to the other, and its numbers."""
    i, j = link.ends if link.ends[0] != GROUND else link.ends[::-1]
    one = places[i]
    other = _Place(one.left, 0.0) if j == GROUND else places[j]
    between = one.left != other.left
    if between:
        left, right = sorted((one, other))
        x, y = np.array([left.left + _WIDTH, right.left]), np.array([left.up, right.up])
    else:  # from the lower floor's left to the upper one's right
        low, high = sorted((one.up, other.up))
        x = one.left + np.array([0.12, 0.88]) * _WIDTH
        y = np.array([low + slab / 2 * (low > 0), high - slab / 2])
    if float(link.friction):
        style: Any = {"color": COLOURS["damper"]}
        ax.plot(x, y, linewidth=1.2, zorder=3 if between else 0.9, **style)
        ax.plot([x.mean()], [y.mean()], "s", markersize=5, zorder=4, **style)
    if link.contact is not None:
        for end, up, face in zip(x, y, (0.0, -_PAD), strict=True):
            corner = end + face, up - 0.4 * slab
            ax.add_patch(Rectangle(corner, _PAD, 0.8 * slab, color=COLOURS["pounding"], zorder=3))
    if between:
        slope = (y[1] - y[0]) / (x[1] - x[0])
        away = 0.2 * _APART * abs(slope)  # clear of the line's higher end
        sides = (0.6 * slab + away, -0.9 * slab - away)  # above the line, below the arrow
        for (text, colour), side in zip(numbers, sides, strict=False):
            _text(ax, x.mean(), y.mean() + side, text, colour)
        if np.isfinite(float(link.gap)):
            pad = _PAD * (link.contact is not None)
            ends = (x[0] + pad, y[0] - 0.3 * slab), (x[1] - pad, y[1] - 0.3 * slab)
            arrow: Any = {"arrowstyle": "<|-|>", "mutation_scale": 6, "shrinkA": 0, "shrinkB": 0}
            ax.add_patch(FancyArrowPatch(*ends, color=COLOURS["ground"], linewidth=0.6, **arrow))


def _ground(ax: Axes, right: float, storey: float) -> None:
    ax.plot([-0.4, right + 0.4], [0, 0], color=COLOURS["ground"], linewidth=1.0)
    depth = 0.25 * storey
    hatch: Any = {"facecolor": "0.85", "hatch": "////", "edgecolor": "0.6", "linewidth": 0}
    ax.add_patch(Rectangle((-0.4, -depth), right + 0.8, depth, **hatch))


def _finish(ax: Axes, links: Sequence[Link], in_metres: bool) -> None:
    """Legend of the symbols, and the axis of heights."""
    handles: list[Any] = []
    if any(float(link.friction) for link in links):
        style: Any = {"color": COLOURS["damper"], "linewidth": 1.2, "markersize": 5}
        handles.append(Line2D([], [], marker="s", label=r"damper, slip force $\mu$", **style))
    if any(np.isfinite(float(link.gap)) for link in links):
        arrow: Any = {"color": COLOURS["ground"], "linewidth": 0.6, "markersize": 4}
        handles.append(Line2D([], [], marker="d", label=r"gap at rest $\xi_0$", **arrow))
    laws = sorted({_name(link.contact) for link in links if link.contact is not None})
    if laws:
        words = f"contact ({', '.join(laws)})"
        handles.append(Patch(color=COLOURS["pounding"], label=words))
    if handles:
        ax.legend(
            handles=handles, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=len(handles)
        )
    ax.set_xticks([])
    ax.grid(False)
    for side in ("top", "right", "bottom", "left"):
        ax.spines[side].set_visible(side == "left" and in_metres)
    if in_metres:
        ax.set_ylabel("height (m)", fontsize=FONT_SIZE)
        ax.set_yticks([tick for tick in ax.get_yticks() if 0 <= tick <= ax.get_ylim()[1]])
        ax.spines["left"].set_bounds(0, ax.get_yticks()[-1])
        ax.tick_params(labelsize=FONT_SIZE)
    else:
        ax.set_yticks([])


def _name(law: ContactLaw | Newton) -> str:
    return type(law).__name__


def _text(
    ax: Axes,
    x: float,
    y: float,
    words: str,
    colour: str,
    align: str = "center",
    box: dict[str, Any] | None = None,
) -> None:
    ax.text(
        x,
        y,
        words,
        color=colour,
        ha=align,
        va="center",
        fontsize=FONT_SIZE,
        zorder=5,
        bbox=box,
    )
