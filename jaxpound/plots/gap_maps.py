"""The gaps of many links over time, as a map with a row for each link."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, to_rgb
from matplotlib.patches import Patch

from jaxpound._checks import number, positive
from jaxpound.model.places import link_places
from jaxpound.model.system import GROUND, Ends
from jaxpound.plots.curves import buildings_of, gaps_of
from jaxpound.plots.runs import same_units
from jaxpound.plots.style import (
    COLOURS,
    FIGURE_SIZE,
    FONT_SIZE,
    in_house_style,
    label,
    new_axes,
    unit_for,
)
from jaxpound.results.response import Response, require_single

_COLUMNS = 800  # of the map: more would not be seen
_NEAR, _FAR = np.array(to_rgb("#10404f")), np.array(to_rgb("#f2f7f8"))
_GAPS = ListedColormap(
    [tuple(_NEAR + (_FAR - _NEAR) * s) for s in np.linspace(0, 1, 256)]
).with_extremes(under=COLOURS["pounding"])


@in_house_style
def gap_map(response: Response, ax: Axes | None = None, widest: float | None = None) -> Axes:
    """Gap ξ of every link over time: dark where it is narrow, orange where it is closed.

    Links between the same buildings stand together, the higher floors above. A contact is never
    lost between pixels: each has the narrowest gap of its instants. Links without a finite gap are
    left out.

    Parameters
    ----------
    response
        A single run, in SI or not.
    ax
        Where to draw.
    widest
        The gap at the light end of the scale, for maps of several runs to one scale; by default
        that of the run.

    Raises
    ------
    ValueError
        If the response is a batch or invalid, no link has a finite gap, or widest is not positive.

    Examples
    --------
    >>> from jaxpound.plots import gap_map
    >>> run = jp.simulate(jp.paper.structures(), jp.paper.ground(), jp.paper.grid())
    >>> [tick.get_text() for tick in gap_map(run).get_yticklabels()]
    ['1–2, floor 1']
    """
    same_units("gap_map", {"": response})
    if widest is not None:
        (widest,) = positive("gap_map", widest=number("gap_map", "widest", widest))
    require_single("gap_map", response)
    if not np.isfinite(response.demand.pga):
        raise ValueError("gap_map: the run is invalid (its results are NaN)")
    gaps_of("gap_map", response)
    links = [k for k, link in enumerate(response.links) if np.isfinite(link.gap).all()]
    order, groups = _order(response, links)
    gaps = np.array([np.asarray(response.links[k].gap) for k in order])
    for row, k in zip(gaps, order, strict=True):
        touching = response.links[k].touching
        if touching is not None:  # by Newton's law the gap itself is never below 0
            row[np.asarray(touching) > 0] = -1.0
    gaps = np.where(gaps <= 0, -1.0, gaps)

    ax = new_axes(ax, height=max(0.8, (0.17 * len(order) + 0.9) / FIGURE_SIZE[1]))
    time = np.asarray(response.time)
    start = np.unique(np.linspace(0, time.size, min(_COLUMNS, time.size) + 1).astype(int))[:-1]
    extent = (float(time[0]), float(time[-1]), len(order) - 0.5, -0.5)
    shown = ax.imshow(
        np.minimum.reduceat(gaps, start, axis=1),
        cmap=_GAPS,
        vmin=0.0,
        vmax=widest_gap(response) if widest is None else widest,
        aspect="auto",
        interpolation="nearest",
        extent=extent,
    )
    label(ax, f"time $t$ ({unit_for('time', response.si, 0)[1]})", "")
    ax.grid(False)
    places = link_places(response.topology)
    ax.set_yticks(range(len(order)), [places[k] for k in order])
    ax.tick_params(axis="y", length=0)
    for row in range(1, len(order)):
        apart = groups[row] != groups[row - 1]
        ax.axhline(row - 0.5, color="white", linewidth=2.4 if apart else 0.6)
    figure: Any = ax.figure
    bar = figure.colorbar(shown, ax=ax, pad=0.02, aspect=12, extend="min")
    bar.set_label(rf"gap $\xi$ ({unit_for('length', response.si, 0)[1]})", size=FONT_SIZE)
    bar.ax.tick_params(labelsize=FONT_SIZE)
    ax.legend(
        handles=[Patch(color=COLOURS["pounding"], label=_words(response, links))],
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        borderaxespad=0.1,
    )
    return ax


def widest_gap(response: Response) -> float:
    """The widest of all gaps that are finite, or 1 where none opens."""
    gaps = [np.asarray(link.gap) for link in response.links]
    return max(float(np.max(gap, initial=0.0, where=np.isfinite(gap))) for gap in gaps) or 1.0


def _homes(response: Response) -> dict[int, tuple[int, int]]:
    """Building and floor of each mass, and of the ground; {} of other systems than buildings."""
    buildings = buildings_of(response)
    home = {
        mass: (b, i) for b, building in enumerate(buildings) for i, (mass, _) in enumerate(building)
    }
    return home | {GROUND: (GROUND, GROUND)} if home else {}


def _upward(ends: Ends) -> Ends:
    """Ends with the ground last."""
    return ends if ends[0] != GROUND else (ends[1], ends[0])


def _order(response: Response, links: list[int]) -> tuple[list[int], list[Any]]:
    """Links from the top of the map on, and the buildings that each is between."""
    home = _homes(response)
    if not home:
        return links, [0] * len(links)
    places = {k: [home[end] for end in _upward(response.links[k].ends)] for k in links}

    def key(k: int) -> tuple[int, int, int]:
        (a, i), (b, _) = places[k]
        return a, b, -i

    order = sorted(links, key=key)
    return order, [key(k)[:2] for k in order]


def _words(response: Response, links: list[int]) -> str:
    """What the colour of a closed gap stands for."""
    modelled = any(response.links[k].contact is not None for k in links)
    return r"contact, $\xi \leq 0$" if modelled else r"pounding, $\xi \leq 0$"
