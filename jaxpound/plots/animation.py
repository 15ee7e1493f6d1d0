"""An animation of a run: swaying buildings, dampers and gaps between them, and series over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.animation import FuncAnimation
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxpound._checks import require_folder
from jaxpound._errors import InvalidInput
from jaxpound.plots import style as house
from jaxpound.plots.curves import buildings_of, is_pair, require_valid, same_units
from jaxpound.plots.gap_maps import gap_map, widest_gap
from jaxpound.plots.moving_rows import Scene, largest_displacement
from jaxpound.plots.runs import displacements, friction_force, gap, ground_motion
from jaxpound.plots.style import COLOURS, in_house_style
from jaxpound.results.response import Response


@in_house_style
def still(
    response: Response,
    time: float,
    ax: Axes | None = None,
    reach: float | None = None,
    elevations: Sequence[Any] | None = None,
) -> Axes:
    """The buildings, a pair or a row, of a single run at the instant nearest to ``time``.

    ``time`` is within the run, in its unit. ``reach`` is the largest displacement to leave room
    for, for pictures of several runs to one scale; ``elevations`` are those of ``row``.

    A ``ValueError`` if the response is a batch, not that of shear buildings, of a pair without a
    finite gap, or invalid, time is not within the run, or elevations are not as in ``row``.
    """
    _require_scene(response)
    end = float(response.time[-1])
    if not 0 <= time <= end:
        rule = f"must be within the run, from 0 to {end:.6g}"
        raise InvalidInput("time", str(time), rule)
    ax = house.new_axes(ax)
    scene = Scene(response, ax, reach, elevations)
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

    ``responses`` are a single run, in SI or not, or such runs by name, on the same grid. The number
    of ``frames`` ≥ 2 is spread evenly and lasts ``seconds`` > 0; ``elevations``: see ``row``.

    A ``ValueError`` as by ``still``, or if grids or units differ, or frames or seconds breaks its
    rule.
    """
    single = isinstance(responses, Response)
    runs = {"": responses} if isinstance(responses, Response) else same_units(responses)
    for response in runs.values():
        _require_scene(response)
    if frames < 2 or not 0 < seconds < np.inf:
        rule = "must be at least 2 frames, and seconds positive and finite"
        raise InvalidInput("frames", f"{frames}, seconds = {seconds}", rule)
    time = np.asarray(next(iter(runs.values())).time)
    if any(not np.array_equal(time, response.time) for response in runs.values()):
        raise InvalidInput("responses", "", "must be on the same grid")

    low = all(map(is_pair, runs.values()))
    figure = house.new_figure(2, (1.25 if single else 1.5) + (0.0 if low else 0.4))
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
    figure: Figure, runs: Mapping[str, Response], single: bool, elevations: Sequence[Any] | None
) -> tuple[list[Scene], list[Axes]]:
    """The scene of each run, and the series over time beside or below."""
    numbers = range(len(runs))
    layout: Any = [[f"{i}" for i in numbers], [f"below {i}" for i in numbers]]
    if single:
        layout = [["0", "upper"], ["0", "below 0"]]
    panels = figure.subplot_mosaic(layout, height_ratios=[1, 1] if single else [1.4, 1])
    reach = max(map(largest_displacement, runs.values()))
    scenes = []
    for i, (name, response) in enumerate(runs.items()):
        ax = panels[str(i)]
        ax.set_title(name, fontsize=house.FONT_SIZE + 1)
        scenes.append(Scene(response, ax, reach, elevations))
    below = [panels[f"below {i}"] for i in numbers]
    if single:
        response, upper = runs[""], panels["upper"]
        drawings: Any = (ground_motion, displacements)
        if is_pair(response):
            drawings = (gap, friction_force)
        elif np.isfinite(response.min_gap):
            drawings = (displacements, gap_map)
        for draw, ax in zip(drawings, (upper, below[0]), strict=True):
            draw(response, ax)
        upper.set_xlabel("")
        upper.tick_params(labelbottom=False)
        return scenes, [upper, *below]
    pairs = all(map(is_pair, runs.values()))
    as_maps = not pairs and all(np.isfinite(response.min_gap) for response in runs.values())
    series: Any = gap if pairs else displacements
    if as_maps:
        series = partial(gap_map, widest=max(map(widest_gap, runs.values())))
    for response, ax in zip(runs.values(), below, strict=True):
        series(response, ax)
    if not as_maps:
        house.same_height(below)
    return scenes, below


def _require_scene(response: Response) -> None:
    """An ``InvalidInput`` for a run whose buildings cannot be drawn."""
    require_valid(response)
    if not buildings_of(response):
        rule = "must be of shear buildings: floors one above the other, each on one rod"
        raise InvalidInput("the run", "", rule)
    if is_pair(response) and not np.isfinite(response.min_gap):
        rule = "must be finite, so that the buildings stand somewhere"
        raise InvalidInput("the gap", "", rule)
