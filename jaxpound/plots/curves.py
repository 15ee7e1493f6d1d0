"""Curves of a run, one for each mass, rod or link, with name and colour, and how they are drawn."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from itertools import count, cycle
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from jaxpound._checks import instance, is_whole
from jaxpound._errors import InvalidInput
from jaxpound.model.places import link_places
from jaxpound.model.topology import floors
from jaxpound.plots import style as house
from jaxpound.plots.contact_paths import ContactPath, followed_contacts
from jaxpound.plots.style import COLOURS, label, new_axes
from jaxpound.results.elements import PLACES
from jaxpound.results.named import PAIR
from jaxpound.results.response import LinkResponse, Response, require_single

_LINE_ALPHA = 0.85  # where two lines run close together, both are seen
_NAMED = 4  # masses, rods or links in a legend; of more, buildings or groups of links are named


class Curve(NamedTuple):
    """A series, its name in the legend, and its colour, if it has one by name in ``COLOURS``."""

    label: str
    colour: str
    values: Any
    times: Any = None  # if they are not the instants
    alone: str = house.CYCLE[0]  # its colour in axes of its own


def is_pair(response: Response) -> bool:
    """Whether a run is of two masses, each on its own rod, with one link between them."""
    return response.topology == PAIR


def of_each(response: Response, group: str, field: str, name: str) -> list[Curve]:
    """A series of each mass or rod: of a pair by ``name`` with its number, else by its place.

    Of many floors of buildings only the buildings are named; floors are from light to full colour.
    """
    series = [getattr(element, field) for element in getattr(response, group)]
    if is_pair(response):
        return [Curve(name.format(i), f"structure {i}", x) for i, x in enumerate(series, 1)]
    is_rod = group == "rods"
    places = PLACES[group](response.topology)
    members = {
        f"building {b}": [floor[is_rod] for floor in building]
        for b, building in enumerate(buildings_of(response), 1)
    }
    if sum(map(len, members.values())) != len(series):  # no buildings, or rods beside each other
        return _named(places, series)
    curves = _grouped(members, map(house.building_colour, count()), series)
    if len(series) <= _NAMED:
        return [curve._replace(label=place) for curve, place in zip(curves, places, strict=True)]
    return curves


def frictions(response: Response) -> dict[int, Curve]:
    """Friction force of each damper by number, or of links without one where there is none at all.

    Of many links those between the same buildings have one name and one colour, from light to full.
    """
    if not response.links:
        raise InvalidInput("response", "", "must have a link")
    links = response.links
    damped = [k for k, link in enumerate(links) if link.has_damper] or [*range(len(links))]
    series = [link.friction if k in damped else None for k, link in enumerate(links)]
    return dict(zip(damped, _of_links("$q$", response, series), strict=True))


def touching(response: Response) -> list[LinkResponse]:
    """The links with a law of contact."""
    return [link for link in response.links if link.contact is not None]


def closed(link: LinkResponse) -> np.ndarray:
    """Whether the gap of a link is closed, at each instant."""
    met = np.asarray(link.gap) <= 0  # by Newton's law it is never below 0 itself
    return met if link.touching is None else met | (np.asarray(link.touching) > 0)


def contacts(response: Response) -> dict[int, tuple[Curve, ContactPath]]:
    """Contact force and path of each link with a law of it; an ``InvalidInput`` if none has one."""
    if not (paths := followed_contacts(response)):
        raise InvalidInput("response", "", "must have a link with a law of contact")
    forces = [paths[k].force if k in paths else None for k in range(len(response.links))]
    curves = _of_links("$p$", response, forces)
    if len(forces) == 1:
        curves = [curves[0]._replace(colour="pounding")]
    both = zip(curves, paths.items(), strict=True)
    return {k: (curve._replace(times=path.time), path) for curve, (k, path) in both}


def gaps_of(response: Response) -> list[Curve]:
    """Gap of each link, NaN in runs without one; an ``InvalidInput`` if no link has one."""
    gaps = [np.asarray(link.gap) for link in response.links]
    finite = [None if np.isposinf(x).all() else np.where(np.isposinf(x), np.nan, x) for x in gaps]
    if not (curves := _of_links(r"$\xi$", response, finite)):
        raise InvalidInput("response", "", "must have a link with a finite gap")
    return curves


def buildings_of(response: Response) -> tuple[tuple[tuple[int, int], ...], ...]:
    """The floors of each building, a mass and the rod of its storey each; () of other systems."""
    with suppress(ValueError):
        return floors(response.topology)
    return ()


def _of_links(symbol: str, response: Response, series: Sequence[Any]) -> list[Curve]:
    """Series of the links that have one, by place; of many, those between two buildings as one."""
    numbers = [k for k, values in enumerate(series) if values is not None]
    if len(series) == 1:
        return [Curve(symbol, "damper", series[k]) for k in numbers]
    places = link_places(response.topology)
    if len(numbers) <= _NAMED or not buildings_of(response):
        curves = _named(places, series)
        return [curves[k] for k in numbers]
    between: dict[str, list[int]] = {}
    for k in numbers:
        between.setdefault(places[k].partition(",")[0], []).append(k)
    return _grouped(between, cycle(house.CYCLE), series)


def _grouped(
    members: Mapping[str, Sequence[int]], colours: Iterable[str], series: Sequence[Any]
) -> list[Curve]:
    """Series by number, each group in one colour from light to full, the last with its name."""
    curves: dict[int, Curve] = {}
    for (name, numbers), colour in zip(members.items(), colours, strict=False):
        for i, tone in zip(numbers, house.tones(colour, len(numbers)), strict=True):
            curves[i] = Curve(name if i == numbers[-1] else "_", tone, series[i], alone=colour)
    return [curves[i] for i in sorted(curves)]


def _named(names: Sequence[str], series: Sequence[Any]) -> list[Curve]:
    """Where there are many, from dark to light, and only the ends of the list named."""
    names, colours = house.ends_named(names), house.numbered_colours(len(series))
    return [Curve(*arguments) for arguments in zip(names, colours, series, strict=True)]


def over_time(
    response: Response,
    ax: Axes | None,
    words: str,
    quantity: str,
    curves: Sequence[Curve],
    symbol: str,
) -> Axes:
    """Curves over time, in the unit for the largest; the axis has their symbols, or ``symbol``."""
    ax = run_axes(response, ax)
    named = all(curve.label.startswith("$") for curve in curves)
    symbols = ", ".join(curve.label for curve in curves) if named else symbol
    series = [curve.values for curve in curves]
    factor, words = series_axis(response, f"{words} {symbols}", quantity, series)
    for curve in curves:
        draw_curve(ax, response.time if curve.times is None else curve.times, factor, curve)
    ax.margins(x=0)
    label(ax, time_label(response), words)
    if len(curves) > 1:
        house.legend(ax, 4 if named else 3)
    return ax


class Loops(NamedTuple):
    """Forces of rods or links over the elongation or slip of each, by number."""

    group: str
    lengths: Any
    curves: Mapping[int, Curve]
    across: str
    up: str


def chosen(loops: Loops, numbers: Any) -> tuple[int, ...]:
    """Numbers of loops to be drawn; an ``InvalidInput`` if they are none of them."""
    listed = numbers if isinstance(numbers, Sequence | np.ndarray) else ()
    if not len(listed) or not all(is_whole(k) and k in loops.curves for k in listed):
        rule = f"must be a list of the {loops.group} to be drawn, from 0: {[*loops.curves]}"
        raise InvalidInput(loops.group, repr(numbers), rule)
    return tuple(map(int, listed))


def draw_loops(response: Response, ax: Axes | None, loops: Loops, numbers: Any = None) -> Axes:
    """The loops of these numbers by place, or all; the unit is that for the largest of all."""
    ax, curves = run_axes(response, ax), loops.curves
    factor, up = series_axis(response, loops.up, "force", [x.values for x in curves.values()])
    if numbers is not None:
        numbers = chosen(loops, numbers)
        places, colours = PLACES[loops.group](response.topology), [curves[numbers[0]].alone]
        if len(numbers) > 1:
            colours = house.numbered_colours(len(numbers))
        both = zip(numbers, colours, strict=True)
        curves = {k: curves[k]._replace(label=places[k], colour=x) for k, x in both}
    for k, curve in curves.items():
        draw_curve(ax, loops.lengths[k], factor, curve)
    label(ax, length_label(response, loops.across), up)
    if len(curves) > 1:
        house.legend(ax, columns=3)
    elif numbers is not None:
        ax.set_title(curves[numbers[0]].label)
    return ax


def run_axes(response: Response, ax: Axes | None) -> Axes:
    """The axes, or those of a new figure; an ``InvalidInput`` for an invalid run."""
    if (invalid := np.ravel(~np.isfinite(response.demand.pga))).any():
        several = f"{invalid.sum()} of {invalid.size} runs are"
        subject = several if invalid.size > 1 else "the run is"
        raise InvalidInput(subject, "", "invalid (NaN)")
    return new_axes(ax)


def require_valid(response: Response) -> None:
    """An ``InvalidInput`` for a batch or an invalid run."""
    require_single(response)
    if not np.isfinite(response.demand.pga):
        raise InvalidInput("the run", "", "is invalid (its results are NaN)")


def same_units(responses: Mapping[str, Response]) -> dict[str, Response]:
    """The runs, at least one and all in the same units."""
    instance("responses", responses, Mapping)
    if not responses:
        raise InvalidInput("responses", "", "must hold at least one run")
    for run, response in responses.items():
        instance(f"responses[{run!r}]", response, Response)
    if len({response.si for response in responses.values()}) > 1:
        raise InvalidInput("responses", "", "must all be in SI units, or all be dimensionless")
    return dict(responses)


def draw_curve(ax: Axes, x: Any, factor: float, curve: Curve, **style: Any) -> None:
    """A curve over x; of a batch the curves of all runs, the fainter the more there are."""
    x, y = np.asarray(x), factor * np.asarray(curve.values)
    style |= {"color": COLOURS.get(curve.colour, curve.colour), "label": curve.label}
    if x.ndim == 1:
        ax.plot(x, y, alpha=_LINE_ALPHA, **style)
        return
    runs = np.stack([x, y], -1).reshape(-1, x.shape[-1], 2)
    alpha = max(0.03, _LINE_ALPHA / len(runs) ** 0.4)
    ax.add_collection(LineCollection(list(runs), alpha=alpha, **style))
    ax.autoscale_view()


def series_axis(response: Response, words: str, kind: str, series: Any) -> tuple[float, str]:
    """Factor of the unit for the largest number of the series, and words with the unit."""
    peak = max((float(np.max(np.abs(x), initial=0.0)) for x in series), default=0.0)
    return house.with_unit(words, kind, response.si, peak)


def time_label(response: Response) -> str:
    """Label of the time axis."""
    return house.with_unit("time $t$", "time", response.si)[1]


def length_label(response: Response, words: str) -> str:
    """Label of an axis of lengths."""
    return house.with_unit(words, "length", response.si)[1]
