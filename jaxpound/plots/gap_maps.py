"""The gaps of many links over time, as a map with a row for each link."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.patches import Patch

from jaxpound._checks import positive_number
from jaxpound.model.places import homes, link_places
from jaxpound.model.topology import GROUND, WeightedMasses
from jaxpound.plots import curves
from jaxpound.plots import style as house
from jaxpound.plots.style import COLOURS, in_house_style, label, new_axes
from jaxpound.results.response import Response

_COLUMNS = 800  # of the map: more would not be seen
_GAPS = LinearSegmentedColormap.from_list("gaps", ["#10404f", "#f2f7f8"]).with_extremes(
    under=COLOURS["pounding"]
)


@in_house_style
def gap_map(response: Response, ax: Axes | None = None, widest: float | None = None) -> Axes:
    """Gap ξ of every link over time: dark where it is narrow, orange where it is closed.

    Links between the same buildings stand together, the higher floors above. A contact is never
    lost between pixels: each has the narrowest gap of its instants. Links without a finite gap are
    left out.

    ``response`` is a single run, in SI or not; ``widest`` the gap at the light end of the scale,
    for maps of several runs to one scale, by default that of the run.

    A ``ValueError`` if the response is a batch or invalid, no link has a finite gap, or widest is
    not positive.

    Examples
    --------
    >>> from jaxpound.plots import gap_map
    >>> run = jp.simulate(jp.paper.structures(), jp.paper.ground(), jp.paper.grid())
    >>> [tick.get_text() for tick in gap_map(run).get_yticklabels()]
    ['1–2, floor 1']
    """
    curves.same_units({"": response})
    if widest is not None:
        (widest,) = positive_number(widest=widest)
    curves.require_valid(response)
    curves.gaps_of(response)
    links = [k for k, link in enumerate(response.links) if np.isfinite(link.gap).all()]
    home = homes(response.topology)

    def place(k: int) -> tuple[int, int, int]:
        """The buildings that a link is between, and its floor from the top of the map on."""
        ends = response.links[k].ends
        assert not isinstance(ends, WeightedMasses)
        ends = ends if ends[0] > GROUND else ends[::-1]
        (a, i), (b, _) = (home.get(end, (GROUND, GROUND)) for end in ends)
        return a, b, -i

    has_buildings = bool(home) and not any(response.links[k].weights for k in links)
    order = sorted(links, key=place) if has_buildings else links
    ordered = [response.links[k] for k in order]
    gaps = np.array([np.where(curves.closed(link), -1.0, link.gap) for link in ordered])

    ax = new_axes(ax, height=max(0.8, (0.17 * len(order) + 0.9) / house.FIGURE_SIZE[1]))
    time = np.asarray(response.time)
    start = np.unique(np.linspace(0, time.size, min(_COLUMNS, time.size) + 1).astype(int))[:-1]
    extent = (float(time[0]), float(time[-1]), len(order) - 0.5, -0.5)
    scale: Any = {"cmap": _GAPS, "vmin": 0.0, "vmax": widest or widest_gap(response)}
    image: Any = {"aspect": "auto", "interpolation": "nearest", "extent": extent}
    shown = ax.imshow(np.minimum.reduceat(gaps, start, axis=1), **scale, **image)
    label(ax, curves.time_label(response), "")
    ax.grid(False)
    places = link_places(response.topology)
    ax.set_yticks(range(len(order)), [places[k] for k in order])
    ax.tick_params(axis="y", length=0)
    for row in range(1, len(order)):
        apart = has_buildings and place(order[row])[:2] != place(order[row - 1])[:2]
        ax.axhline(row - 0.5, color="white", linewidth=2.4 if apart else 0.6)
    figure: Any = ax.figure
    bar = figure.colorbar(shown, ax=ax, pad=0.02, aspect=12, extend="min")
    bar.set_label(curves.length_label(response, r"gap $\xi$"), size=house.FONT_SIZE)
    bar.ax.tick_params(labelsize=house.FONT_SIZE)
    modelled = any(response.links[k].contact is not None for k in links)
    words = rf"{'contact' if modelled else 'pounding'}, $\xi \leq 0$"
    closed = Patch(color=COLOURS["pounding"], label=words)
    ax.legend(handles=[closed], loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1)
    return ax


def widest_gap(response: Response) -> float:
    """The widest of all finite gaps, or 1 where none opens."""
    gaps = [np.asarray(link.gap) for link in response.links]
    return max(float(np.max(gap, initial=0.0, where=np.isfinite(gap))) for gap in gaps) or 1.0
