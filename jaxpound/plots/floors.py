"""Figures over the height of buildings: envelopes of demands, and mode shapes.

Heights are those of the floors above the ground in m where they are given, as a list for each
building (``ShearBuilding.elevations``), else the floors' numbers, from 1. What belongs to a floor
is drawn from floor to floor; what belongs to a storey, drift and shear, is constant over it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from jaxpound._checks import count, hint, instance
from jaxpound._fields import Quantity, quantities
from jaxpound.model.shear_building import ShearBuilding
from jaxpound.model.storeys import Storeys
from jaxpound.model.vibration import modes
from jaxpound.plots.rows import floor_heights, heights_above_ground
from jaxpound.plots.style import (
    CYCLE,
    building_colour,
    in_house_style,
    label,
    legend_above,
    new_axes,
    new_figure,
    shades,
    unit_for,
)
from jaxpound.results.floors import FloorDemands

_BAND = (0.16, 0.5, 0.84)
_APART = 0.12  # between the points of compared runs, in storeys
_TICKS = 4.0  # of the vertical axis, per inch
_FROM_ZERO = "displacement"
_OF_STOREYS = ("drift", "shear")
_DRAWN: dict[str, Quantity] = {
    name: known
    for name, known in quantities(FloorDemands).items()
    if not name.startswith("contact")
} | {"contact": Quantity("force", "peak contact force", symbol="peak $p$")}

Floors = Sequence[FloorDemands]


class _Envelope(NamedTuple):
    """A quantity of a building over its height in a run or batch."""

    demands: FloorDemands
    quantity: str

    @property
    def values(self) -> np.ndarray:
        """Of the valid runs, shape (runs, floors)."""
        values = np.asarray(getattr(self.demands, self.quantity))
        values = values.reshape(-1, values.shape[-1])
        return values[np.isfinite(values).all(-1)]

    def draw(self, ax: Axes, heights: np.ndarray, factor: float, **style: Any) -> None:
        """A single run as a line; the median of a batch, and 16 to 84 % of it as a band."""
        values = factor * self.values
        low, middle, high = np.quantile(values, _BAND, axis=0)
        up = heights
        points: dict[str, Any] = {"marker": "o", "markersize": 2.5, "clip_on": False}
        if self.quantity in _OF_STOREYS:
            up, points = np.repeat(np.append(0.0, heights), 2)[1:-1], {}
            low, middle, high = (np.repeat(one, 2) for one in (low, middle, high))
        elif self.quantity == _FROM_ZERO:
            up = np.append(0.0, heights)
            low, middle, high = (np.append(0.0, one) for one in (low, middle, high))
        ax.plot(middle, up, **points, **style)
        if len(values) > 1:
            ax.fill_betweenx(up, low, high, color=style["color"], alpha=0.2, linewidth=0)

    def draw_apart(self, ax: Axes, heights: np.ndarray, factor: float, **style: Any) -> None:
        """What acts on some floors only: a point for each, and a line from zero to it."""
        values = factor * self.values
        acts = values.any(0)
        if not acts.any():
            return
        values, heights = values[:, acts], heights[acts]
        low, middle, high = np.quantile(values, _BAND, axis=0)
        ax.plot(middle, heights, "o", markersize=3, clip_on=False, **style)
        ax.hlines(heights, 0, middle, color=style["color"], linewidth=0.9)
        if len(values) > 1:
            ax.hlines(heights, low, high, color=style["color"], alpha=0.3, linewidth=4)


@in_house_style
def envelope(
    floors: FloorDemands | Mapping[str, FloorDemands],
    quantity: str = "drift",
    elevations: Any = None,
    ax: Axes | None = None,
) -> Axes:
    """Peak demand of one building over its height, of a run or of several by name.

    Of a batch the line is the median of the valid runs, the band reaches from 16 to 84 %.

    Parameters
    ----------
    floors
        The building's demands, from ``floor_demands``, or such demands by name, to be compared.
    quantity
        "displacement", "drift", "acceleration", "shear" or "contact", the largest force of contact
        from either side.
    elevations
        Height of each floor above the ground, m; by default the floors' numbers.
    ax
        Where to draw.

    Raises
    ------
    ValueError
        If there is no such quantity, no run is valid, elevations are not one for each floor in
        ascending order, or runs to be compared are of other buildings or units.

    Examples
    --------
    >>> from jaxpound.plots import envelope
    >>> steel = jp.ZenerRod(order=0.5, tau_f=0.01, tau_x=0.05)
    >>> row = jp.Row(tuple(jp.Storeys((1.0,) * n, jp.Rod(steel, 5.0)) for n in (3, 2)))
    >>> found = jp.demand(row, jp.Ricker(0.3, 2.0, 4.0), jp.TimeGrid.until(20.0, dt=0.05))
    >>> high, low = jp.floor_demands(row, found)
    >>> envelope(high, "drift").get_ylabel()
    'floor'
    """
    runs = _runs("envelope", floors, FloorDemands)
    if quantity not in _DRAWN:
        words = hint(quantity, _DRAWN)
        raise ValueError(f"envelope: quantity = {quantity!r} must be a demand of floors; {words}")
    one = next(iter(runs.values()))
    ax = new_axes(ax)
    n = len(one.masses)
    heights = np.arange(1.0, n + 1)
    if elevations is not None:
        heights = heights_above_ground("envelope", "elevations", elevations, n)
    lines = [_Envelope(each, quantity) for each in runs.values()]
    for name, line in zip(runs, lines, strict=True):
        _require_valid("envelope", name, line)
    in_metres, styles = elevations is not None, _styles(runs, one.building)
    _draw(ax, lines, heights, in_metres, _unit(lines), styles)
    if len(runs) > 1:
        legend_above(ax, 2)
    return ax


@in_house_style
def envelopes(
    floors: Floors | Mapping[str, Floors],
    elevations: Sequence[Any] | None = None,
    labels: Sequence[str] | None = None,
) -> Figure:
    """Peak demands of buildings over their height: a row of panels for each building.

    The panels of a row are displacement, storey drift, acceleration, storey shear and, where there
    is any, contact force; each has one scale for all buildings. Of a batch the line is the median
    of the valid runs, the band reaches from 16 to 84 %.

    Parameters
    ----------
    floors
        What ``floor_demands`` gives, one for each building, of a run or a batch; or such tuples by
        name, to be compared: the first is grey.
    elevations
        For each building the height of its floors above the ground, m
        (``[building.elevations for building in buildings]``); by default the floors' numbers.
    labels
        A name for each building; by default "building 1" and so on.

    Raises
    ------
    ValueError
        As ``envelope``, or if elevations or labels are not one for each building.

    Examples
    --------
    >>> from jaxpound.plots import envelopes
    >>> steel = jp.ZenerRod(order=0.5, tau_f=0.01, tau_x=0.05)
    >>> row = jp.Row(tuple(jp.Storeys((1.0,) * n, jp.Rod(steel, 5.0)) for n in (3, 2)))
    >>> found = jp.demand(row, jp.Ricker(0.3, 2.0, 4.0), jp.TimeGrid.until(20.0, dt=0.05))
    >>> figure = envelopes(jp.floor_demands(row, found), labels=["tall", "low"])
    >>> len(figure.axes)  # two buildings, four quantities, no contact
    8
    """
    owner = "envelopes"
    runs = _runs(owner, floors, Sequence)
    buildings = next(iter(runs.values()))
    if labels is None:
        labels = [f"building {one.building + 1}" for one in buildings]
    elif len(labels) != len(buildings):
        rule = f"one for each of the {len(buildings)} buildings"
        raise ValueError(f"{owner}: labels, {len(labels)} of them, must be {rule}")
    heights = floor_heights(owner, [len(one.masses) for one in buildings], elevations)
    lines = {
        name: [[_Envelope(each[b], name) for each in runs.values()] for b in range(len(buildings))]
        for name in _DRAWN
    }
    for of_runs in lines[_FROM_ZERO]:
        for name, line in zip(runs, of_runs, strict=True):
            _require_valid(owner, name, line)
    if not any(line.values.any() for of_runs in lines["contact"] for line in of_runs):
        del lines["contact"]

    sizes = [0.5 + 0.06 * one.size for one in heights]
    figure = new_figure(2, sum(sizes) + 0.35)
    panels = figure.subplots(len(buildings), len(lines), squeeze=False, height_ratios=sizes)
    styles = [_styles(runs, one.building) for one in buildings]
    for column, of_buildings in zip(panels.T, lines.values(), strict=True):
        _draw_column(column, of_buildings, heights, elevations is not None, styles)
    for ax, words in zip(panels[:, 0], labels, strict=True):
        ax.set_ylabel(f"{words}\n{ax.get_ylabel()}")
    for ax in panels[:, 1:].flat:
        ax.set_ylabel("")
        ax.tick_params(labelleft=False)
    figure.align_ylabels(panels[:, 0])
    if len(runs) > 1:
        handles = panels[0, 0].get_lines()
        figure.legend(handles, list(runs), loc="outside upper center", ncols=min(4, len(runs)))
    return figure


@in_house_style
def mode_shapes(structures: Storeys | ShearBuilding, n: int = 3, ax: Axes | None = None) -> Axes:
    r"""The first mode shapes of a building over its height, with periods and damping ratios.

    Shapes are the real parts of ``modes``, with the largest entry 1 and the top floor to the right.

    Parameters
    ----------
    structures
        A building, dimensionless or in SI.
    n
        How many modes, from the slowest on, at least 1; of a building with fewer floors all.
    ax
        Where to draw.

    Raises
    ------
    ValueError
        If structures are no such building, traced or a batch, or n is below 1.

    Examples
    --------
    >>> from jaxpound.plots import mode_shapes
    >>> building = jp.ShearBuilding.from_period(5, 300e3, period=0.6, damping_ratio=0.05)
    >>> print(mode_shapes(building, n=2).get_legend().get_texts()[0].get_text())
    mode 1: $T$ = 0.6 s, $\zeta$ = 5 %
    """
    instance("mode_shapes", "structures", structures, Storeys, ShearBuilding)
    n = count("mode_shapes", "n", n)
    si = isinstance(structures, ShearBuilding)
    found = structures.modes() if isinstance(structures, ShearBuilding) else modes(structures)
    heights = (
        structures.elevations
        if isinstance(structures, ShearBuilding)
        else np.arange(1.0, structures.n_floors + 1)
    )
    ax = new_axes(ax, height=1.3)
    unit = unit_for("time", si, 0.0)[1]
    for j in range(min(n, structures.n_floors)):
        shape = found.shapes[:, j].real
        ax.plot(
            np.append(0.0, shape * np.sign(shape[-1])),
            np.append(0.0, heights),
            marker="o",
            markersize=2.5,
            color=CYCLE[j % len(CYCLE)],
            label=f"mode {j + 1}: $T$ = {found.periods[j]:.3g} {unit}, "
            rf"$\zeta$ = {100 * found.damping_ratios[j]:.2g} %",
        )
    ax.axvline(0, color="black", linewidth=0.7, zorder=1)
    label(ax, r"mode shape $\varphi$", "")
    _over_height(ax, heights, si)
    legend_above(ax, 1)
    return ax


def _runs(owner: str, floors: Any, kind: type) -> dict[str, Any]:
    """Runs by name, of the same buildings in the same units."""
    runs = dict(floors) if isinstance(floors, Mapping) else {"": floors}
    if not runs:
        raise ValueError(f"{owner}: floors must hold at least one run")
    kinds = []
    for name, each in runs.items():
        where = f"floors[{name!r}]" if name else "floors"
        instance(owner, where, each, kind)
        buildings = [each] if isinstance(each, FloorDemands) else list(each)
        if not buildings:
            raise ValueError(f"{owner}: {where} = () must hold at least one building")
        for b, one in enumerate(buildings):
            instance(owner, where if one is each else f"{where}[{b}]", one, FloorDemands)
        kinds.append([(one.building, len(one.masses), one.si) for one in buildings])
    if any(one != kinds[0] for one in kinds):
        rule = "of the same buildings, all in SI units or all dimensionless"
        raise ValueError(f"{owner}: floors to be compared must be {rule}")
    return runs


def _require_valid(owner: str, name: str, line: _Envelope) -> None:
    if not line.values.size:
        which = f"all runs of {name!r} are" if name else "the run is"
        raise ValueError(f"{owner}: {which} invalid (NaN)")


def _unit(lines: Sequence[_Envelope]) -> tuple[float, str]:
    largest = max(float(line.values.max()) for line in lines)
    return unit_for(str(_DRAWN[lines[0].quantity].kind), lines[0].demands.si, largest)


def _styles(runs: Mapping[str, Any], building: int) -> list[dict[str, Any]]:
    """Colour and name of each line: of a single run that of the building."""
    colours = shades(len(runs)) if len(runs) > 1 else [building_colour(building)]
    return [{"color": c, "label": name} for c, name in zip(colours, runs, strict=True)]


def _draw(
    ax: Axes,
    lines: Sequence[_Envelope],
    heights: np.ndarray,
    in_metres: bool,
    unit: tuple[float, str],
    styles: Sequence[dict[str, Any]],
) -> None:
    known = _DRAWN[lines[0].quantity]
    apart = _APART * np.diff(heights, prepend=0.0).min()
    for k, (line, style) in enumerate(zip(lines, styles, strict=True)):
        if line.quantity == "contact":
            line.draw_apart(ax, heights - apart * k, unit[0], **style)
        else:
            line.draw(ax, heights, unit[0], **style)
    symbol = known.symbol.partition(" $")[2]
    words = known.words.removeprefix("peak ")
    label(ax, f"{words}\npeak ${symbol} ({unit[1]})", "")
    # Of a batch as far as the band reaches.
    highest = max(float(np.quantile(line.values, _BAND[-1], axis=0).max()) for line in lines)
    ax.set_xlim(0, 1.08 * unit[0] * highest or 1.0)
    _over_height(ax, heights, in_metres)


def _draw_column(
    column: Sequence[Axes],
    of_buildings: Sequence[Sequence[_Envelope]],
    heights: Sequence[np.ndarray],
    in_metres: bool,
    styles: Sequence[Sequence[dict[str, Any]]],
) -> None:
    """A quantity of all buildings, one below the other, to one scale."""
    unit = _unit([line for lines in of_buildings for line in lines])
    for ax, lines, up, style in zip(column, of_buildings, heights, styles, strict=True):
        _draw(ax, lines, up, in_metres, unit, style)
        ax.locator_params(axis="x", nbins=3)
    for ax in column[:-1]:
        ax.set_xlabel("")
        ax.tick_params(labelbottom=False)
    largest = max(ax.get_xlim()[1] for ax in column)
    for ax in column:
        ax.set_xlim(0, largest)


def _over_height(ax: Axes, heights: np.ndarray, in_metres: bool) -> None:
    """The vertical axis: from the ground to the top floor."""
    ax.set_ylabel("height (m)" if in_metres else "floor")
    ax.set_ylim(0, 1.03 * heights[-1])
    drawing: Any = ax.figure
    rows = int(ax.get_position().height * drawing.get_size_inches()[1] * _TICKS)
    ax.yaxis.set_major_locator(
        MaxNLocator(min(max(rows, 2), 8), steps=[1, 2, 3, 5, 10], integer=not in_metres)
    )
