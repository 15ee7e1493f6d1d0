"""An animation of a run: swaying buildings, dampers and gaps between them, and series over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.animation import FuncAnimation
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from jaxpound._checks import require_folder
from jaxpound._errors import InvalidInput
from jaxpound.model.ends import elongation
from jaxpound.model.places import homes
from jaxpound.model.topology import GROUND, WeightedMasses, masses_of, stacks, two_ends
from jaxpound.plots import style as house
from jaxpound.plots.curves import buildings_of, closed, is_pair, require_valid, same_units
from jaxpound.plots.gap_maps import gap_map, widest_gap
from jaxpound.plots.rows import stack_heights
from jaxpound.plots.runs import displacements, friction_force, gap, ground_motion
from jaxpound.plots.style import COLOURS, arrow, building_colour, in_house_style
from jaxpound.results.response import Response

Pair = tuple[float, float]

_DAMPER = ("damper", "stick")  # its colour in slip and in stick


class Scene:
    """Floors on bending columns, dampers and contacts of a single run, at one instant or another.

    Drawn relative to the ground; motions and gaps are to one scale, widths and heights of the
    buildings are not. Floors reach out to where the gaps of their links are. Dampers are green,
    those in stick blue; of a single one an arrow is its force q on the left building, to the left
    where q is positive. A link whose gap is closed is marked in orange; with a law of contact a
    star flashes at each impact and fades, the larger the stronger its impulse. Columns are red from
    the first yield of their storey on.

    ``reach`` is the largest displacement to leave room for, by default that of the run;
    ``elevations`` are those of ``row``.
    """

    @in_house_style
    def __init__(
        self,
        response: Response,
        ax: Axes,
        reach: float | None = None,
        elevations: Sequence[Any] | None = None,
    ) -> None:
        buildings, tuned = stacks(response.topology), response.topology.tuned
        heights = stack_heights(response.topology, elevations)
        reach = largest_displacement(response) if reach is None else reach
        building_of = {mass: b - 1 for mass, (b, _) in homes(response.topology).items()}
        self._time = np.asarray(response.time)
        self._shaking = np.asarray(response.ground_acceleration)
        self._strongest = float(np.abs(self._shaking).max()) or 1.0
        start = [np.asarray(mass.x)[0] for mass in response.masses]
        between = []  # neighbours: the left one's number, a link's finite gap at rest, its ends
        for link in response.links:
            left, other = sorted(building_of.get(end, GROUND) for end in two_ends(link.ends))
            rest = float(np.asarray(link.gap)[0] + elongation(link, start))
            if left != GROUND and other - left == 1 and np.isfinite(rest):
                between.append((left, rest, two_ends(link.ends)))
        gaps = [[gap for left, gap, _ in between if left == b] for b in range(len(buildings) - 1)]
        spaces = [max(of_links, default=2.2 * reach) for of_links in gaps]
        self._width = w = 1.1 * max(reach + max(spaces, default=0.0), 2 * reach) or 1.0
        left_ends = np.cumsum([0.0, *(w + space for space in spaces)])
        right = float(left_ends[-1]) + w
        top = max(float(floors[-1]) for floors in heights)
        lowest = min(float(np.diff(floors, prepend=0.0).min()) for floors in heights)
        least = max(0.5, 1.4 * lowest / top) * w  # so that buildings are higher than wide
        storey = min(least, 0.8 * (right + 2 * reach) * lowest / top)
        scale, slab = storey / lowest, 0.22 * storey

        low, far = -reach - 0.1 * w, right + reach + 0.1 * w
        deep, high = 0.12 * w, scale * top + slab
        ax.set(xlim=(low, far), ylim=(-3.5 * deep, high + 3.0 * deep), aspect="equal")
        ax.set_axis_off()
        ax.add_patch(Rectangle((low, -deep), far - low, deep, facecolor="0.8", linewidth=0))
        self._floors: dict[int, _Floor] = {}
        for b, (building, ups) in enumerate(zip(buildings, heights, strict=True)):
            below = None
            if isinstance(ends := response.topology.rods[building[0][1]], WeightedMasses):
                footing, corner = ends.masses[1], (float(left_ends[b]), -slab)
                x = np.asarray(response.masses[footing].x)
                below = _Floor(ax, x, corner, (w, slab), building_colour(b), None)
                self._floors[footing] = below
            for (mass, rod), height in zip(building, ups, strict=True):
                x = np.asarray(response.masses[mass].x)
                share = 0.8 if mass in tuned else 1.0
                corner = left_ends[b] + (1 - share) / 2 * w, scale * float(height) - slab
                below = _Floor(ax, x, corner, (share * w, slab), building_colour(b), below)
                self._floors[mass] = below
                below.first_yield_time = response.demand.rods[rod].first_yield_time
                lowest_end = min(two_ends(response.topology.rods[rod]))
                if lowest_end < GROUND:
                    moved = response.supports[GROUND - lowest_end].displacement
                    below.foot = np.asarray(moved)
        for left, rest, ends in between:
            if rest < spaces[left]:
                for end in ends:  # at a column the floor above it, too
                    self._floors[end].reach_out((spaces[left] - rest) / 2, building_of[end] == left)
        self._centre, self._deep = (low + far) / 2, deep
        self._words = ax.text(self._centre, high + 2.4 * deep, "", ha="center", va="center")
        ax.text(low, -2.4 * deep, "ground $u''$", va="center")
        self._ground = arrow(ax, (0, 0), (0, 0), COLOURS["ground"], 8)
        numbers = range(len(response.links))
        self._links = [_MovingLink(ax, response, k, self._floors) for k in numbers]

    def show(self, i: int) -> None:
        """Move everything to instant i of the run."""
        for floor in self._floors.values():
            floor.show(i, self._time[i])
        met = [link for link in self._links if link.show(i, float(self._time[i]))]
        shift = 0.4 * self._width * self._shaking[i] / self._strongest
        low = -2.4 * self._deep
        self._ground.set_positions((self._centre - shift, low), (self._centre + shift, low))
        words, colour = "", "pounding"
        if met:
            modelled = all(link.collides for link in met)
            words = "contact" if modelled else "POUNDING (not modelled)"
            if len(self._links) > 1:
                words += f" at {len(met)} of {len(self._links)} links"
        elif len(self._links) == 1 and self._links[0].has_damper:
            sticks = self._links[0].sticks(i)
            words, colour = f"damper: {'stick' if sticks else 'slip'}", _DAMPER[sticks]
        self._words.set(text=words, color=COLOURS[colour])


class _Floor:
    """A floor and the columns below it, at rest from ``left`` and ``low`` on."""

    def __init__(
        self, ax: Axes, x: np.ndarray, corner: Pair, size: Pair, colour: str, below: _Floor | None
    ) -> None:
        self.x, self._below, self._colour = x, below, colour
        self.first_yield_time: Any = None
        self.foot = 0 * x  # what its support moves, of a lowest floor
        (self.left, self.low), (self.width, slab) = corner, size
        self.high = self.low + slab
        self._extensions = [0.0, 0.0]  # to the left and to the right
        self._body = ax.add_patch(Rectangle(corner, *size, facecolor=colour, alpha=0.8))
        self._columns = [ax.plot([], [], color=colour, linewidth=1.8)[0] for _ in range(2)]

    def reach_out(self, by: float, to_the_right: bool) -> None:
        """Widen the floor on the side of a link with a narrower gap."""
        self._extensions[to_the_right] = max(self._extensions[to_the_right], by)

    def face(self, i: int, to_the_right: bool) -> float:
        """Where its side is at instant i."""
        if to_the_right:
            return self.left + self.width + self._extensions[1] + float(self.x[i])
        return self.left - self._extensions[0] + float(self.x[i])

    def show(self, i: int, time: float) -> None:
        left = self.face(i, False)
        self._body.set(x=left, width=self.face(i, True) - left)
        below = self._below
        base, start = (0.0, self.foot[i]) if below is None else (below.high, float(below.x[i]))
        s = np.linspace(0, 1, 12)
        bent = start + (float(self.x[i]) - start) * (3 * s**2 - 2 * s**3)
        for line, share in zip(self._columns, (0.1, 0.9), strict=True):
            foot = self.left + share * self.width
            line.set_data(foot + bent, base + s * (self.low - base))
            yielded = self.first_yield_time is not None and time >= self.first_yield_time
            line.set_color(COLOURS["limit"] if yielded else self._colour)


class _MovingLink:
    """A link: its damper, a mark where its gap is closed, and flashes of its impacts."""

    def __init__(self, ax: Axes, response: Response, k: int, floors: dict[int, _Floor]) -> None:
        link, time = response.links[k], response.time
        self.collides = link.contact is not None
        self._closed, self._phase = closed(link), np.asarray(link.phase)
        self._impacts = response.impacts(k)
        self._hardest = max((impact.impulse for impact in response.impacts()), default=1.0)
        self._flash = 1 / 30 * float(time[-1] - time[0])  # three of a hundred frames
        ends = [floors[end] for end in two_ends(link.ends) if end in floors]
        self._high = [floor.high for floor in ends]
        if getattr(link.ends, "column", False):  # a column, at the height of the floor
            self._high = [floors[masses_of(link.ends)[0]].high] * 2
        self._inside = len(ends) == 1 or ends[0].left == ends[1].left
        ends.sort(key=lambda floor: floor.low if self._inside else floor.left)
        self._ends, self.has_damper = ends, link.has_damper
        friction = np.asarray(link.friction)
        largest = float(np.abs(friction).max()) or 1.0
        self._pull = 0.6 * ends[0].width * friction / largest
        (self._line,) = ax.plot([], [], color=COLOURS["damper"], linewidth=1.3, zorder=4)
        (self._clamp,) = ax.plot([], [], "s", markersize=4, zorder=5)
        self._arrow = arrow(ax, (0, 0), (0, 0), COLOURS["damper"], 8)
        self._letter = ax.text(0, 0, "$q$", color=COLOURS["damper"], va="center")
        alone = len(response.links) == 1 and not self._inside
        for i, artist in enumerate((self._line, self._clamp, self._arrow, self._letter)):
            artist.set_visible(self.has_damper and (i < 2 or alone))
        (self._mark,) = ax.plot([], [], color=COLOURS["pounding"], linewidth=4, zorder=5)
        star: Any = {"marker": (11, 1, 0), "color": COLOURS["pounding"], "linestyle": "none"}
        # Whole at the edge of its axes, which make no room for it.
        (self._star,) = ax.plot([], [], zorder=6, clip_on=False, in_layout=False, **star)

    def sticks(self, i: int) -> bool:
        """Whether its damper sticks at instant i."""
        return bool(self._phase[i] == 0)

    def show(self, i: int, time: float) -> bool:
        """Move to instant i; whether the gap is closed there."""
        x, y = self._span(i)
        self._line.set_data(x, y)
        across, up = sum(x) / 2, sum(y) / 2
        self._clamp.set(data=([across], [up]), color=COLOURS[_DAMPER[self.sticks(i)]])
        width, slab = self._ends[0].width, self._ends[0].high - self._ends[0].low
        start = x[0], up + 0.14 * width
        self._arrow.set_positions(start, (start[0] - self._pull[i], start[1]))
        self._letter.set_position((start[0], start[1] + 0.1 * width))
        is_closed = bool(self._closed[i])
        self._mark.set_data(*([across] * 2, [up - slab, up]) if is_closed else ([], []))
        recent = [hit for hit in self._impacts if 0 <= time - hit.time < self._flash]
        self._star.set_visible(bool(recent))
        if recent:
            self._star.set_data([across], [up - slab / 2])
            self._star.set_markersize(7 + 13 * recent[-1].impulse / self._hardest)
            self._star.set_alpha(1 - (time - recent[-1].time) / self._flash)
        return is_closed

    def _span(self, i: int) -> tuple[list[float], list[float]]:
        """From a floor's face to that of its neighbour, or from a lower floor to an upper one."""
        first, last = self._ends[0], self._ends[-1]
        if not self._inside:
            grip = 0.12 * first.width
            return [first.face(i, True) - grip, last.face(i, False) + grip], self._high
        inset, start, low = 0.14 * last.width, last.left, 0.0
        if first is not last:  # else the lower end is the ground
            start, low = first.face(i, False), first.high
        return [start + inset, last.face(i, True) - inset], [low, last.low]


def largest_displacement(response: Response) -> float:
    """The largest displacement of any mass."""
    return max(float(np.abs(mass.x).max()) for mass in response.masses)


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
        raise InvalidInput("time", str(time), f"must be within the run, from 0 to {end:.6g}")
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
        raise InvalidInput("the gap", "", "must be finite, so that the buildings stand somewhere")
