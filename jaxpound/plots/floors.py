"""Figures over the height of buildings: envelopes of demands, and mode shapes.

Heights are those of the floors above the ground in m where they are given, as a list for each
building (``ShearBuilding.elevations``), else the floors' numbers, from 1. What belongs to a floor
is drawn from floor to floor; what belongs to a storey, drift and shear, is constant over it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any

import numpy as np
from matplotlib.artist import setp
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from jaxpound._checks import count, hint, instance
from jaxpound._errors import InvalidInput
from jaxpound._fields import Quantity, quantities
from jaxpound.buildings import Buildings
from jaxpound.model.shear_building import ShearBuilding, in_units
from jaxpound.model.structures import Storeys
from jaxpound.model.vibration import modes
from jaxpound.plots import style as house
from jaxpound.plots.rows import floor_heights, stack_heights
from jaxpound.plots.style import in_house_style, label, new_axes, unit_for
from jaxpound.results.floors import FloorDemands

_BAND = (0.16, 0.5, 0.84)
_FROM_ZERO = "displacement"
_OF_MODES = ("-", "--", ":", "-.")
_OF_ALL = ("displacement", "drift", "acceleration", "shear")
_DRAWN = {name: quantities(FloorDemands)[name] for name in _OF_ALL} | {
    "drift_ratio": Quantity(None, "peak storey drift", symbol="peak $|d|/h$"),
    "contact": Quantity("force", "peak contact force", symbol="peak $p$"),
    "ductility": Quantity(None, "ductility", symbol=r"peak $\mu$"),
}

Floors = Sequence[FloorDemands]
Profiles = Sequence[np.ndarray]  # of runs or batches, each (runs, floors)
Unit = tuple[float, str]  # factor and name


def _values(demands: FloorDemands, quantity: str) -> np.ndarray:
    """A quantity of the valid runs, shape (runs, floors); 0 of a building that lacks it."""
    values = getattr(demands, quantity)
    values = np.asarray(0.0 * demands.displacement if values is None else values)
    values = values.reshape(-1, values.shape[-1])
    return values[np.isfinite(values).all(-1)]


@in_house_style
def envelope(
    floors: Floors | Mapping[str, Floors],
    quantity: str = "drift",
    elevations: Sequence[Any] | None = None,
    ax: Axes | None = None,
) -> Axes:
    """One of the peak demands over the height of the buildings that have it, in one diagram.

    The quantity is "displacement", "drift", "drift_ratio", in % of the height of the storey,
    "acceleration", "shear", "contact", the largest force of contact from either side, or
    "ductility", of storeys that yield. Other arguments and batches are as in ``envelopes``.

    A ``ValueError`` as by ``envelopes``, or if there is no such quantity, no building has it, or
    runs to be compared are of several buildings.
    """
    if quantity not in _DRAWN:
        rule = f"must be a demand of floors; {hint(quantity, _DRAWN)}"
        raise InvalidInput("quantity", repr(quantity), rule)
    runs, buildings, heights = _runs(floors, elevations)
    if len(runs) > 1 and len(buildings) > 1:
        rule = "must be of one building; envelopes compares several"
        raise InvalidInput("floors to be compared", "", rule)
    lines: list[Any] = []
    for b, building in enumerate(buildings):
        if any(getattr(run[b], quantity) is not None for run in runs.values()):
            profiles = [_values(run[b], quantity) for run in runs.values()]
            _require_valid(runs, profiles)
            styles = _styles(runs, building.building)
            lines += zip(profiles, [heights[b]] * len(runs), styles, strict=True)
    if not lines:
        raise InvalidInput("floors", "", f"must be of a building with a {quantity}")
    ax, unit = new_axes(ax), _unit(quantity, buildings[0].si, [values for values, *_ in lines])
    _draw(ax, quantity, lines, elevations is not None, unit)
    if len(lines) > 1:
        house.legend_above(ax, 2 if len(runs) > 1 else 3)
    return ax


@in_house_style
def envelopes(
    floors: Floors | Mapping[str, Floors],
    elevations: Sequence[Any] | None = None,
    labels: Sequence[str] | None = None,
) -> Figure:
    """Peak demands of buildings over their height, to one scale, so that colliding floors align.

    Panels side by side are displacement, storey drift, acceleration, storey shear and, where there
    are any, contact force and ductility. The buildings of a run or a batch share them; of runs to
    be compared each building has a row. Drift is in % of the height of storeys, where floors have
    a ``drift_ratio``. Of a batch the line is the median of the valid runs, the band reaches from 16
    to 84 %.

    ``floors`` are what ``floor_demands`` gives, one for each building, of a run or a batch; or such
    tuples by name, to be compared: the first is grey. ``elevations`` are those of ``row``, by
    default the floors' numbers; ``labels`` name the buildings, by default "building 1" and so on.

    A ``ValueError`` if no run is valid, runs to be compared are of other buildings or units,
    elevations or labels are not one for each building, or elevations of a building not one for each
    floor in ascending order.

    Examples
    --------
    >>> from jaxpound.plots import envelopes
    >>> steel = jp.ZenerRod(order=0.5, tau_f=0.01, tau_x=0.05)
    >>> row = jp.Row(tuple(jp.Storeys((1.0,) * n, jp.Rod(steel, 5.0)) for n in (3, 2)))
    >>> found = jp.demand(row, jp.Ricker(0.3, 2.0, 4.0), jp.TimeGrid.until(20.0, dt=0.05))
    >>> figure = envelopes(jp.floor_demands(row, found), labels=["tall", "low"])
    >>> len(figure.axes)  # four quantities, no contact
    4
    """
    runs, buildings, heights = _runs(floors, elevations)
    if labels is None:
        labels = [f"building {building.building + 1}" for building in buildings]
    elif len(labels) != len(buildings):
        rule = f"must be one for each of the {len(buildings)} buildings"
        raise InvalidInput(f"labels, {len(labels)} of them,", "", rule)
    in_shares = all(each.si and each.heights for run in runs.values() for each in run)
    usual = ("displacement", "drift_ratio" if in_shares else "drift", "acceleration", "shear")
    profiles = {
        name: [[_values(run[b], name) for run in runs.values()] for b in range(len(buildings))]
        for name in (*usual, "contact", "ductility")
    }
    for of_runs in profiles[_FROM_ZERO]:
        _require_valid(runs, of_runs)
    shown = [name for name, x in profiles.items() if name in usual or any(map(np.any, chain(*x)))]

    together = len(runs) == 1 and len(buildings) > 1
    rows = [[*range(len(buildings))]] if together else [[b] for b in range(len(buildings))]
    inches = 0.5 + 0.06 * max(building.size for building in heights)
    figure = house.new_figure(2, inches * len(rows) + 0.35)
    panels = figure.subplots(len(rows), len(shown), squeeze=False, sharey=True)
    styles = [_styles(runs, building.building) for building in buildings]
    for column, name in zip(panels.T, shown, strict=True):
        unit = _unit(name, buildings[0].si, [*chain(*profiles[name])])
        for ax, row in zip(column, rows, strict=True):
            of_row = ((profiles[name][b], [heights[b]] * len(runs), styles[b]) for b in row)
            lines = [line for of_building in of_row for line in zip(*of_building, strict=True)]
            _draw(ax, name, lines, elevations is not None, unit)
            ax.locator_params(axis="x", nbins=4 if ax.get_xlim()[1] < 1000 else 3)
        setp(column, xlim=(0, max(ax.get_xlim()[1] for ax in column)))
    _over_height(panels[0, 0], max(heights, key=max), elevations is not None)
    for ax, words in zip(panels[:, 0], labels, strict=False):
        ax.set_ylabel(ax.get_ylabel() if together else f"{words}\n{ax.get_ylabel()}")
    for ax in panels.flat:
        ax.label_outer()
    figure.align_ylabels(panels[:, 0])
    handles, names = panels[0, 0].get_lines(), labels if together else list(runs)
    if len(handles) > 1:
        figure.legend(handles, names, loc="outside upper center", ncols=min(4, len(handles)))
    return figure


@in_house_style
def mode_shapes(
    structures: Storeys | ShearBuilding | Buildings, n: int = 3, ax: Axes | None = None
) -> Axes:
    r"""The first mode shapes of each building over its height, with periods and damping ratios.

    Shapes are the real parts of ``modes``, with the largest entry 1 and the top floor to the right.
    The point of a tuned mass stands alone, above the roof; on soil the footing moves. Of several
    buildings, each has its colour, each mode a line style; links are left out.

    ``structures`` are a building, dimensionless or in SI, or ``Buildings``; drawn are the first
    ``n`` modes of each, at least 1, from the slowest on; of fewer floors all.

    A ``ValueError`` if structures are of another kind, traced or a batch, or n is below 1.

    Examples
    --------
    >>> from jaxpound.plots import mode_shapes
    >>> building = jp.ShearBuilding.from_period(5, 300e3, period=0.6, damping_ratio=0.05)
    >>> print(mode_shapes(building, n=2).get_legend().get_texts()[0].get_text())
    mode 1: $T$ = 0.599 s, $\zeta$ = 5.1 %
    """
    instance("structures", structures, Storeys, ShearBuilding, Buildings)
    n = count("n", n)
    buildings = structures.buildings if isinstance(structures, Buildings) else (structures,)
    si, several = not isinstance(structures, Storeys), len(buildings) > 1
    in_metres = all(isinstance(building, ShearBuilding) for building in buildings)
    ax = new_axes(ax, height=1.3)
    tallest = np.zeros(1)
    for b, building in enumerate(buildings):
        storeys = building if isinstance(building, Storeys) else in_units(building, 1.0, 1.0, 1.0)
        vibration, top = modes(storeys), storeys.n_floors
        in_m = [building.elevations] if in_metres and isinstance(building, ShearBuilding) else None
        (heights,) = stack_heights(storeys.system().topology, in_m)
        tallest = max(tallest, heights, key=lambda floors: floors[-1])
        for j in range(min(n, heights.size)):
            shape = vibration.shapes[:, j].real
            shape = shape * np.sign(shape[top - 1])
            foot = shape[heights.size] if storeys.heights else 0.0  # of a footing on soil
            x, y = np.append(foot, shape[: heights.size]), np.append(0.0, heights)
            if storeys.n_tuned:  # whose points stand alone
                x, y = np.insert(x, top + 1, np.nan), np.insert(y, top + 1, np.nan)
            period = house.in_unit(vibration.periods[j], "time", si, 3)
            damping = 100 * vibration.damping_ratios[j]
            words = rf"mode {j + 1}: $T$ = {period}, $\zeta$ = {damping:.2g} %"
            line: dict[str, Any] = {"color": house.CYCLE[j % len(house.CYCLE)]}
            if several:
                words = f"building {b + 1}, {words}"
                line = {"color": house.building_colour(b), "linestyle": _OF_MODES[j % 4]}
            ax.plot(x, y, marker="o", markersize=2.5, label=words, **line)
    ax.axvline(0, color="black", linewidth=0.7, zorder=1)
    label(ax, r"mode shape $\varphi$", "")
    _over_height(ax, tallest, in_metres)
    house.legend_above(ax, 1)
    return ax


def _runs(floors: Any, elevations: Any) -> tuple[dict[str, Floors], Floors, list[np.ndarray]]:
    """Runs by name, of the same buildings in the same units; those of the first, and heights."""
    if not (runs := dict(floors) if isinstance(floors, Mapping) else {"": floors}):
        raise InvalidInput("floors", "", "must hold at least one run")
    descriptions = set()
    for name, buildings in runs.items():
        place = f"floors[{name!r}]" if name else "floors"
        instance(place, buildings, Sequence)
        if not buildings:
            raise InvalidInput(place, "()", "must hold at least one building")
        for b, building in enumerate(buildings):
            instance(f"{place}[{b}]", building, FloorDemands)
        descriptions.add(tuple((each.building, len(each.masses), each.si) for each in buildings))
    if len(descriptions) > 1:
        rule = "must be of the same buildings, all in SI units or all dimensionless"
        raise InvalidInput("floors to be compared", "", rule)
    first = next(iter(runs.values()))
    return runs, first, floor_heights([len(building.masses) for building in first], elevations)


def _require_valid(runs: Mapping[str, Any], profiles: Profiles) -> None:
    for name, values in zip(runs, profiles, strict=True):
        if not values.size:
            subject = f"all runs of {name!r} are" if name else "the run is"
            raise InvalidInput(subject, "", "invalid (NaN)")


def _unit(quantity: str, si: bool, profiles: Profiles) -> Unit:
    if quantity == "drift_ratio":
        return 100.0, "%"
    largest = max(float(values.max()) for values in profiles)
    kind = _DRAWN[quantity].kind
    return unit_for(kind, si, largest) if kind else (1.0, "")


def _styles(runs: Mapping[str, Any], building: int) -> list[dict[str, Any]]:
    """Colour and name of each line: of a single run those of the building."""
    if len(runs) == 1:
        return [{"color": house.building_colour(building), "label": f"building {building + 1}"}]
    return [{"color": c, "label": x} for c, x in zip(house.shades(len(runs)), runs, strict=True)]


def _draw(ax: Axes, name: str, lines: Sequence[Any], in_metres: bool, unit: Unit) -> None:
    """A quantity of buildings and runs or batches: values, heights and style of each line."""
    factor, field = unit[0], _DRAWN[name]
    for k, (values, heights, style) in enumerate(lines):
        if name == "contact":  # below the points at the same height before
            offset = 0.12 * np.diff(heights, prepend=0.0).min()
            below: Any = sum(np.isin(heights, other[force.any(0)]) for force, other, _ in lines[:k])
            _draw_points(ax, factor * values, heights - offset * below, style)
        else:
            _draw_line(ax, name, factor * values, heights, style)
    symbol = field.symbol.partition(" $")[2] + (f" ({unit[1]})" if unit[1] else "")
    label(ax, f"{field.words.removeprefix('peak ')}\npeak ${symbol}", "")
    if name == "ductility":
        ax.axvline(1, color="black", linewidth=0.7, linestyle=":", zorder=1)
    # Of a batch as far as the band reaches.
    highest = max(float(np.quantile(values, _BAND[-1], axis=0).max()) for values, *_ in lines)
    ax.set_xlim(0, 1.08 * factor * highest or 1.0)
    _over_height(ax, max((heights for _, heights, _ in lines), key=max), in_metres)


def _draw_line(ax: Axes, name: str, values: np.ndarray, heights: np.ndarray, style: Any) -> None:
    """A single run as a line; the median of a batch, and 16 to 84 % of it as a band."""
    curves = np.quantile(values, _BAND, axis=0)
    points: dict[str, Any] = {"marker": "o", "markersize": 2.5, "clip_on": False}
    if name in ("drift", "drift_ratio", "shear", "ductility"):
        heights, points = np.repeat(np.append(0.0, heights), 2)[1:-1], {}
        curves = np.repeat(curves, 2, axis=1)
    elif name == _FROM_ZERO:
        heights, curves = np.append(0.0, heights), np.pad(curves, ((0, 0), (1, 0)))
    low, middle, high = curves
    ax.plot(middle, heights, **points, **style)
    if len(values) > 1:
        ax.fill_betweenx(heights, low, high, color=style["color"], alpha=0.2, linewidth=0)


def _draw_points(ax: Axes, values: np.ndarray, heights: np.ndarray, style: dict[str, Any]) -> None:
    """What acts on some floors only: a point for each, and a line from zero to it."""
    if not (loaded := values.any(0)).any():
        return
    heights = heights[loaded]
    low, middle, high = np.quantile(values[:, loaded], _BAND, axis=0)
    ax.plot(middle, heights, "o", markersize=3, clip_on=False, **style)
    ax.hlines(heights, 0, middle, color=style["color"], linewidth=0.9)
    if len(values) > 1:
        ax.hlines(heights, low, high, color=style["color"], alpha=0.3, linewidth=4)


def _over_height(ax: Axes, heights: np.ndarray, in_metres: bool) -> None:
    """The vertical axis: from the ground to the top floor."""
    ax.set(ylabel="height (m)" if in_metres else "floor", ylim=(0, 1.03 * heights[-1]))
    drawing: Any = ax.figure
    rows = int(ax.get_position().height * drawing.get_size_inches()[1] * 4.0)  # per inch
    most, steps = min(max(rows, 2), 8), [1, 2, 3, 5, 10]
    ax.yaxis.set_major_locator(MaxNLocator(most, steps=steps, integer=not in_metres))
