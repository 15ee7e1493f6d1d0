"""A row of buildings in motion: the scene of an animation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import FancyArrowPatch, Rectangle

from jaxpound.model.system import GROUND
from jaxpound.plots.curves import buildings_of
from jaxpound.plots.style import COLOURS, building_colour, in_house_style
from jaxpound.results.response import LinkResponse, Response

STAR: dict[str, Any] = {
    "marker": (11, 1, 0),
    "color": COLOURS["pounding"],
    "zorder": 6,
    "clip_on": False,
    "in_layout": False,
}
"""The flash of an impact: whole at the edge of its axes, for which it makes no room."""

_COLUMN = 12  # points along a bent column


class MovingRow:
    """Buildings in a row between two instants: floors on bending columns, dampers and contacts.

    Drawn relative to the ground; motions and gaps are to one scale, widths and heights of the
    buildings are not. Floors reach out to where the gaps of their links are. Dampers are green,
    those in stick blue; a floor link whose gap is closed is marked in orange, and with a law of
    contact a star flashes at each impact and fades, the larger the stronger its impulse.

    Parameters
    ----------
    response
        A single run of shear buildings, which stand in the order of their masses.
    ax
        Where to draw.
    heights
        For each building the heights of its floors.
    reach
        The largest displacement to leave room for.
    lasts
        How long a flash lasts, in the run's time.
    """

    @in_house_style
    def __init__(
        self,
        response: Response,
        ax: Axes,
        heights: Sequence[Any],
        reach: float,
        lasts: float,
    ) -> None:
        buildings = buildings_of(response)
        home = {mass: b for b, building in enumerate(buildings) for mass, _ in building}
        self._time = np.asarray(response.time)
        self._shaking = np.asarray(response.ground_acceleration)
        self._strongest = float(np.abs(self._shaking).max()) or 1.0
        rests = [_rest(link, response) for link in response.links]
        between = [_between(link, home) for link in response.links]
        gaps = [(r, b) for r, b in zip(rests, between, strict=True) if r is not None]
        apart = [
            max((rest for rest, b in gaps if b == left), default=2.2 * reach)
            for left in range(len(buildings) - 1)
        ]
        self._width = w = 1.1 * max(reach + max(apart, default=0.0), 2 * reach)
        left_ends = np.cumsum([0.0, *(w + one for one in apart)])
        right = float(left_ends[-1]) + w
        top = max(float(each[-1]) for each in heights)
        lowest = min(float(np.diff(each, prepend=0.0).min()) for each in heights)
        storey = min(0.5 * w, 0.8 * (right + 2 * reach) * lowest / top)
        scale = storey / lowest
        self._slab = slab = 0.22 * storey

        ax.set_xlim(-reach - 0.1 * w, right + reach + 0.1 * w)
        deep, high = 0.12 * w, scale * top + slab
        ax.set_ylim(-3.5 * deep, high + 3.0 * deep)
        ax.set_aspect("equal")
        ax.set_axis_off()
        low, far = ax.get_xlim()
        ax.add_patch(Rectangle((low, -deep), far - low, deep, facecolor="0.8", linewidth=0))
        self._floors: dict[int, _Floor] = {}
        for b, (building, up) in enumerate(zip(buildings, heights, strict=True)):
            below = None
            for (mass, _), height in zip(building, up, strict=True):
                x = np.asarray(response.masses[mass].x)
                place = _Place(float(left_ends[b]), w, scale * float(height) - slab, slab)
                below = _Floor(ax, x, place, building_colour(b), below)
                self._floors[mass] = below
        for link, rest, left in zip(response.links, rests, between, strict=True):
            if left is not None and rest is not None and rest < apart[left]:
                for end in link.ends:
                    self._floors[end].reach_out((apart[left] - rest) / 2, home[end] == left)
        hardest = max((impact.impulse for impact in response.impacts()), default=1.0)
        self._links = [
            _MovingLink(ax, response, k, self._floors, _Flash(lasts, hardest))
            for k in range(len(response.links))
        ]
        self._centre, self._deep = (low + far) / 2, deep
        self._words = ax.text(self._centre, high + 1.7 * deep, "", ha="center", va="center")
        ax.text(low, -2.4 * deep, "ground $u''$", va="center")
        self._ground = FancyArrowPatch((0, 0), (0, 0), arrowstyle="-|>", mutation_scale=8)
        self._ground.set(color=COLOURS["ground"])
        ax.add_patch(self._ground)

    def show(self, i: int) -> None:
        """Move everything to instant i of the run."""
        for floor in self._floors.values():
            floor.show(i)
        met = [link for link in self._links if link.show(i, float(self._time[i]))]
        shift = 0.4 * self._width * self._shaking[i] / self._strongest
        self._ground.set_positions(
            (self._centre - shift, -2.4 * self._deep), (self._centre + shift, -2.4 * self._deep)
        )
        modelled = all(link.collides for link in met)
        what = "contact" if modelled else "POUNDING (not modelled)"
        which = f" at {len(met)} of {len(self._links)} links" if len(self._links) > 1 else ""
        self._words.set_text(what + which if met else "")
        self._words.set_color(COLOURS["pounding"])


class _Place(NamedTuple):
    """Left end, width, lower edge and thickness of a floor."""

    left: float
    width: float
    low: float
    slab: float


class _Floor:
    """A floor and the columns below it."""

    def __init__(
        self, ax: Axes, x: np.ndarray, place: _Place, colour: str, below: _Floor | None
    ) -> None:
        self.x, self.place, self._below = x, place, below
        self._out = [0.0, 0.0]
        self._body = Rectangle((0, place.low), 0, place.slab, facecolor=colour, alpha=0.8)
        ax.add_patch(self._body)
        self._columns = [ax.plot([], [], color=colour, linewidth=1.8)[0] for _ in range(2)]

    def reach_out(self, by: float, to_the_right: bool) -> None:
        """Widen the floor on the side of a link with a narrower gap."""
        self._out[to_the_right] = max(self._out[to_the_right], by)

    def face(self, i: int, to_the_right: bool) -> float:
        """Where its side is at instant i."""
        place, x = self.place, float(self.x[i])
        if to_the_right:
            return place.left + place.width + self._out[1] + x
        return place.left - self._out[0] + x

    def middle(self) -> float:
        """Its height."""
        return self.place.low + self.place.slab / 2

    def show(self, i: int) -> None:
        left = self.face(i, False)
        self._body.set_x(left)
        self._body.set_width(self.face(i, True) - left)
        below = self._below
        base = 0.0 if below is None else below.place.low + below.place.slab
        start = 0.0 if below is None else float(below.x[i])
        s = np.linspace(0, 1, _COLUMN)
        bent = start + (float(self.x[i]) - start) * (3 * s**2 - 2 * s**3)
        for line, at in zip(self._columns, (0.1, 0.9), strict=True):
            foot = self.place.left + at * self.place.width
            line.set_data(foot + bent, base + s * (self.place.low - base))


class _Flash(NamedTuple):
    lasts: float
    hardest: float


class _MovingLink:
    """A link: its damper, a mark where its gap is closed, and flashes of its impacts."""

    def __init__(
        self, ax: Axes, response: Response, k: int, floors: dict[int, _Floor], flash: _Flash
    ) -> None:
        link = response.links[k]
        self.collides = link.contact is not None
        self._gap, self._flash = np.asarray(link.gap), flash
        self._touching = None if link.touching is None else np.asarray(link.touching)
        self._stick = np.asarray(link.phase) == 0
        self._impacts = response.impacts(k)
        i, j = link.ends
        self._ends = floors.get(i), floors.get(j)
        known = [floor for floor in self._ends if floor is not None]
        self._inside = len(known) == 1 or known[0].place.left == known[1].place.left
        known.sort(key=lambda floor: floor.place.low if self._inside else floor.place.left)
        self._sorted = known
        acts = bool(np.any(np.asarray(link.friction) != 0))
        (self._line,) = ax.plot([], [], color=COLOURS["damper"], linewidth=1.3, zorder=4)
        (self._clamp,) = ax.plot([], [], "s", markersize=4, zorder=5)
        for part in (self._line, self._clamp):
            part.set_visible(acts)
        (self._mark,) = ax.plot([], [], color=COLOURS["pounding"], linewidth=4, zorder=5)
        (self._star,) = ax.plot([], [], linestyle="none", **STAR)

    def show(self, i: int, time: float) -> bool:
        """Move to instant i; whether the gap is closed there."""
        x, y = self._inner(i) if self._inside else self._outer(i)
        self._line.set_data(x, y)
        across, up = sum(x) / 2, sum(y) / 2
        self._clamp.set_data([across], [up])
        self._clamp.set_color(COLOURS["stick" if self._stick[i] else "damper"])
        closed = bool(self._gap[i] <= 0)
        if self._touching is not None:
            closed = closed or bool(self._touching[i] > 0)
        half = self._sorted[0].place.slab
        faces = [(x[0] + x[1]) / 2] * 2 if closed else []
        self._mark.set_data(faces, [up - half, up] if closed else [])
        begun = [hit for hit in self._impacts if 0 <= time - hit.time < self._flash.lasts]
        self._star.set_visible(bool(begun))
        if begun:
            self._star.set_data([across], [up - half / 2])
            self._star.set_markersize(7 + 13 * begun[-1].impulse / self._flash.hardest)
            self._star.set_alpha(1 - (time - begun[-1].time) / self._flash.lasts)
        return closed

    def _outer(self, i: int) -> tuple[list[float], list[float]]:
        """From the face of one floor to that of its neighbour, above both."""
        left, right = self._sorted
        grip = 0.12 * left.place.width
        x = [left.face(i, True) - grip, right.face(i, False) + grip]
        return x, [left.place.low + left.place.slab, right.place.low + right.place.slab]

    def _inner(self, i: int) -> tuple[list[float], list[float]]:
        """From the lower floor, or the ground, to the upper one."""
        upper = self._sorted[-1]
        inset = 0.14 * upper.place.width
        if len(self._sorted) == 1:
            start, low = upper.place.left + inset, 0.0
        else:
            lower = self._sorted[0]
            start, low = lower.face(i, False) + inset, lower.place.low + lower.place.slab
        return [start, upper.face(i, True) - inset], [low, upper.place.low]


def _rest(link: LinkResponse, response: Response) -> float | None:
    """Gap at rest, if it is finite: it says where buildings stand."""
    gap = float(np.asarray(link.gap)[0])
    for end, sign in zip(link.ends, (1, -1), strict=True):
        gap += 0.0 if end == GROUND else sign * float(np.asarray(response.masses[end].x)[0])
    return gap if np.isfinite(gap) else None


def _between(link: LinkResponse, home: dict[int, int]) -> int | None:
    """The left one of the two neighbouring buildings that a link is between, if it is."""
    if GROUND in link.ends:
        return None
    left, right = sorted(home[end] for end in link.ends)
    return left if right == left + 1 else None
