"""An animation of a run: swaying buildings, dampers and gaps between them, and series over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.animation import FuncAnimation
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, Rectangle

from jaxpound._checks import require_folder
from jaxpound.plots.curves import buildings_of, is_pair
from jaxpound.plots.gap_maps import gap_map, widest_gap
from jaxpound.plots.moving_rows import STAR, MovingRow
from jaxpound.plots.rows import floor_heights
from jaxpound.plots.runs import displacements, friction_force, gap, ground_motion, same_units
from jaxpound.plots.style import (
    COLOURS,
    FONT_SIZE,
    in_house_style,
    new_axes,
    new_figure,
    same_height,
)
from jaxpound.results.response import Response, require_single

_COLUMNS = 20  # points along a bent column
_FLASH = 1 / 30  # duration of a flash as a share of the run: three of a hundred frames


class Scene:
    """A pair of buildings between two instants: blocks on bending columns, and the damper.

    Drawn relative to the ground; motions and gap are to one scale, widths and heights of the
    buildings are not. The damper is two plates on the roofs, pressed together at the mark; the
    arrow is its force q on block 1, to the left where q is positive. With a law of contact a star
    flashes at each impact and fades, the larger the stronger its impulse.

    Parameters
    ----------
    response
        A single run. Without any friction force no damper is drawn.
    ax
        Where to draw.
    reach
        The largest displacement to leave room for; by default that of the run.
    """

    @in_house_style
    def __init__(self, response: Response, ax: Axes, reach: float | None = None) -> None:
        self._x = np.asarray(response.x1), np.asarray(response.x2)
        self._gap = np.asarray(response.gap)
        self._q = np.asarray(response.friction)
        self._stick = np.asarray(response.phase) == 0
        self._shaking = np.asarray(response.ground_acceleration)
        self._time = np.asarray(response.time)
        self._collides = response.links[0].contact is not None
        self._impacts = response.impacts()
        self._hardest = max((impact.impulse for impact in self._impacts), default=1.0)
        self._largest = float(np.abs(self._q).max())
        self._strongest = float(np.abs(self._shaking).max()) or 1.0

        reach = _reach(response) if reach is None else reach
        rest = float(self._gap[0] - self._x[1][0] + self._x[0][0])
        self._rest = rest
        self._width = w = 0.9 * max(rest + reach, 2 * reach) or 1.0
        self._height, self._block = 1.1 * w, 0.5 * w
        left, right = -1.1 * w - reach, rest + 1.1 * w + reach
        ax.set_xlim(left, right)
        ax.set_ylim(-0.42 * w, 2.5 * w)
        ax.set_aspect("equal")
        ax.set_axis_off()
        ax.add_patch(
            Rectangle((left, -0.12 * w), right - left, 0.12 * w, facecolor="0.8", linewidth=0)
        )
        self._bodies, self._columns = [], []
        for base, colour in ((-w, COLOURS["structure 1"]), (rest, COLOURS["structure 2"])):
            body = Rectangle((base, self._height), w, self._block, facecolor=colour, alpha=0.8)
            ax.add_patch(body)
            self._bodies.append(body)
            self._columns.append(
                [ax.plot([], [], color=colour, linewidth=2.2)[0] for _ in range(2)]
            )
        self._roof = self._height + self._block
        (self._plate_1,) = ax.plot([], [], color=COLOURS["structure 1"], linewidth=2)
        (self._plate_2,) = ax.plot([], [], color=COLOURS["structure 2"], linewidth=2)
        (self._clamp,) = ax.plot([], [], "s", markersize=7, zorder=5)
        self._force, self._ground = _arrow(COLOURS["damper"]), _arrow(COLOURS["ground"])
        ax.add_patch(self._force)
        ax.add_patch(self._ground)
        (self._contact,) = ax.plot([], [], color=COLOURS["pounding"], linewidth=5, alpha=0.9)
        (self._flash,) = ax.plot([], [], **STAR)
        self._arrow_at = left + 0.65 * (right - left)
        letters: dict[str, Any] = {"va": "center"}
        self._words = ax.text((left + right) / 2, 2.34 * w, "", ha="center", **letters)
        ax.text(left, -0.3 * w, "ground $u''$", **letters)
        self._force_name = ax.text(0, 0, "$q$", color=COLOURS["damper"], **letters)
        for part in (self._plate_1, self._plate_2, self._clamp, self._force, self._force_name):
            part.set_visible(self._largest > 0)

    def show(self, i: int) -> None:
        """Move everything to instant i of the run."""
        w, roof, faces = self._width, self._roof, []
        for body, columns, x, base in zip(
            self._bodies, self._columns, self._x, (-w, self._rest), strict=True
        ):
            body.set_x(base + x[i])
            s = np.linspace(0, 1, _COLUMNS)
            for line, at in zip(columns, (0.12, 0.88), strict=True):
                line.set_data(base + at * w + x[i] * (3 * s**2 - 2 * s**3), s * self._height)
            faces.append(base + x[i])
        left, right = faces[0] + w, faces[1]
        upper, lower = roof + 0.12 * w, roof + 0.06 * w
        end_1, end_2 = max(left, right) + 0.35 * w, min(left, right) - 0.35 * w
        self._plate_1.set_data([left - 0.15 * w, left - 0.15 * w, end_1], [roof, upper, upper])
        self._plate_2.set_data([right + 0.15 * w, right + 0.15 * w, end_2], [roof, lower, lower])
        self._clamp.set_data([(left + right) / 2], [roof + 0.09 * w])
        state = "stick" if self._stick[i] else "damper"
        self._clamp.set_color(COLOURS[state])
        start = left - 0.15 * w, roof + 0.28 * w  # q pulls block 1 back
        length = 0.6 * w * self._q[i] / (self._largest or 1.0)
        self._force.set_positions(start, (start[0] - length, start[1]))
        self._force_name.set_position((start[0], start[1] + 0.14 * w))
        shift = 0.8 * w * self._shaking[i] / self._strongest
        self._ground.set_positions(
            (self._arrow_at - shift / 2, -0.3 * w), (self._arrow_at + shift / 2, -0.3 * w)
        )
        touching = self._gap[i] <= 0
        across = (left + right) / 2
        self._contact.set_data(
            [across] * 2 if touching else [], [self._height, roof] if touching else []
        )
        self._show_flash(i, across)
        word = "stick" if self._stick[i] else "slip"
        free = "" if not self._largest else f"damper: {word}"
        pounds = "contact" if self._collides else "POUNDING (not modelled)"
        self._words.set_text(pounds if touching else free)
        self._words.set_color(COLOURS["pounding" if touching else state])

    def _show_flash(self, i: int, across: float) -> None:
        """A star for the last impact, if it began a short while ago."""
        lasts = _FLASH * (self._time[-1] - self._time[0])
        begun = [hit for hit in self._impacts if 0 <= self._time[i] - hit.time < lasts]
        self._flash.set_visible(bool(begun))
        if begun:
            self._flash.set_data([across], [(self._height + self._roof) / 2])
            self._flash.set_markersize(8 + 16 * begun[-1].impulse / self._hardest)
            self._flash.set_alpha(1 - (self._time[i] - begun[-1].time) / lasts)


def _arrow(colour: str) -> FancyArrowPatch:
    return FancyArrowPatch(
        (0, 0), (0, 0), arrowstyle="-|>", mutation_scale=8, color=colour, shrinkA=0, shrinkB=0
    )


@in_house_style
def still(
    response: Response,
    time: float,
    ax: Axes | None = None,
    reach: float | None = None,
    elevations: Sequence[Any] | None = None,
) -> Axes:
    """The buildings, a pair or a row, at the instant of a run nearest to ``time``.

    Parameters
    ----------
    response
        A single run, in SI or not.
    time
        Within the run, in its unit.
    ax
        Where to draw.
    reach
        The largest displacement to leave room for, for pictures of several runs to one scale.
    elevations
        For each building of a row the height of its floors above the ground, m; by default all
        storeys are as high.

    Raises
    ------
    ValueError
        If the response is a batch, not that of shear buildings, of a pair without a finite gap, or
        invalid, time is not within the run, or elevations are not one for each floor, finite, from
        the lowest up.
    """
    _require_valid("still", response)
    end = float(response.time[-1])
    if not 0 <= time <= end:
        raise ValueError(f"still: time = {time} must be within the run, from 0 to {end:.6g}")
    ax = new_axes(ax)
    room = _reach(response) if reach is None else reach
    scene = _scene("still", response, ax, room, elevations)
    scene.show(int(np.abs(np.asarray(response.time) - time).argmin()))
    return ax


class _Player(FuncAnimation):
    """Frames in the figure's own resolution, independent of ``savefig.dpi``."""

    def save(self, filename: Any, *args: Any, **kwargs: Any) -> None:
        require_folder(filename)
        if len(args) < 3:
            kwargs.setdefault("dpi", self._fig.dpi)  # type: ignore[attr-defined]
        super().save(filename, *args, **kwargs)


@in_house_style
def animate(
    responses: Response | Mapping[str, Response],
    frames: int = 100,
    seconds: float = 10.0,
    elevations: Sequence[Any] | None = None,
) -> FuncAnimation:
    """An animation of a run, or of several side by side: the buildings, and series over time.

    ``animate(run).to_jshtml()`` is a player in HTML, ``animate(run).save("run.gif")`` a file.
    Beside a single run are its gap and friction force, below each of several its gap; those of a
    row of buildings are displacements and the map of its gaps.

    Parameters
    ----------
    responses
        A single run, in SI or not, or such runs by name, on the same grid.
    frames
        Number of frames ≥ 2, evenly over the run.
    seconds
        Duration of the animation > 0, s.
    elevations
        As in ``still``.

    Raises
    ------
    ValueError
        If a response is a batch, not that of shear buildings, of a pair without a finite gap, or
        invalid, grids or units differ, or frames, seconds or elevations breaks its rule.
    """
    if isinstance(responses, Response):
        runs, single = {"": responses}, True
    else:
        runs, single = same_units("animate", responses), False
    for response in runs.values():
        _require_valid("animate", response)
    if frames < 2 or not 0 < seconds < np.inf:
        rule = "at least 2 frames, and seconds positive and finite"
        raise ValueError(f"animate: frames = {frames}, seconds = {seconds} must be {rule}")
    time = np.asarray(next(iter(runs.values())).time)
    if any(not np.array_equal(time, response.time) for response in runs.values()):
        raise ValueError("animate: responses must be on the same grid")

    low = all(map(is_pair, runs.values()))
    figure = new_figure(2, (1.25 if single else 1.5) + (0.0 if low else 0.4))
    figure.set_dpi(80)  # a player holds every frame
    scenes, over_time = _panels(figure, runs, single, elevations)
    clocks = [
        ax.axvline(time[0], color="white" if ax.images else COLOURS["residual"], linewidth=0.9)
        for ax in over_time
    ]
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # laid out once, so that nothing jumps between frames
    instants = np.linspace(0, time.size - 1, frames).round().astype(int)

    def show(frame: int) -> list[Any]:
        i = instants[frame]
        for scene in scenes:
            scene.show(i)
        for clock in clocks:
            clock.set_xdata([time[i]] * 2)
        return clocks

    return _Player(figure, show, frames=frames, interval=1000 * seconds / frames, blit=False)


def _panels(
    figure: Figure,
    runs: Mapping[str, Response],
    single: bool,
    elevations: Sequence[Any] | None,
) -> tuple[list[Scene | MovingRow], list[Axes]]:
    """The scene of each run, and the series over time beside or below."""
    if single:
        panels = figure.subplot_mosaic([["0", "upper"], ["0", "below 0"]])
    else:
        numbers = range(len(runs))
        layout: Any = [[f"{i}" for i in numbers], [f"below {i}" for i in numbers]]
        panels = figure.subplot_mosaic(layout, height_ratios=[1.4, 1])
    reach = max(map(_reach, runs.values()))
    for i, name in enumerate(runs):
        panels[str(i)].set_title(name, fontsize=FONT_SIZE + 1)
    scenes = [
        _scene("animate", response, panels[str(i)], reach, elevations)
        for i, response in enumerate(runs.values())
    ]
    below = [panels[f"below {i}"] for i in range(len(runs))]
    if single:
        (response,) = runs.values()
        return scenes, _beside(response, panels["upper"], below[0])
    if all(map(is_pair, runs.values())):
        same_height([gap(response, ax) for response, ax in zip(runs.values(), below, strict=True)])
    elif all(np.isfinite(response.min_gap) for response in runs.values()):
        widest = max(map(widest_gap, runs.values()))
        for response, ax in zip(runs.values(), below, strict=True):
            gap_map(response, ax, widest)
    else:
        drawn = [
            displacements(response, ax) for response, ax in zip(runs.values(), below, strict=True)
        ]
        same_height(drawn)
    return scenes, below


def _beside(response: Response, upper: Axes, lower: Axes) -> list[Axes]:
    """Two series of a single run."""
    if is_pair(response):
        gap(response, upper)
        friction_force(response, lower)
    elif np.isfinite(response.min_gap):
        displacements(response, upper)
        gap_map(response, lower)
    else:
        ground_motion(response, upper)
        displacements(response, lower)
    upper.set_xlabel("")
    upper.tick_params(labelbottom=False)
    return [upper, lower]


def _scene(
    owner: str, response: Response, ax: Axes, reach: float, elevations: Sequence[Any] | None
) -> Scene | MovingRow:
    """The pair of the paper as blocks, all else as a row of buildings."""
    if is_pair(response) and elevations is None:
        return Scene(response, ax, reach)
    lasts = _FLASH * float(response.time[-1] - response.time[0])
    heights = floor_heights(owner, [len(one) for one in buildings_of(response)], elevations)
    return MovingRow(response, ax, heights, reach, lasts)


def _reach(response: Response) -> float:
    return max(float(np.abs(mass.x).max()) for mass in response.masses)


def _require_valid(name: str, response: Response) -> None:
    require_single(name, response)
    if not buildings_of(response):
        rule = "of shear buildings: floors one above the other, each on one rod"
        raise ValueError(f"{name}: the run must be {rule}")
    if not np.isfinite(response.demand.pga):
        raise ValueError(f"{name}: the run is invalid (its results are NaN)")
    if is_pair(response) and not np.isfinite(response.min_gap):
        raise ValueError(f"{name}: the gap must be finite, so that the buildings stand somewhere")
