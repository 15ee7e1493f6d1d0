"""What figures draw of a run: a curve for each mass, rod and link, with its name and colour."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from itertools import cycle
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from jaxpound.model.contact import bound, may_pull
from jaxpound.model.places import link_places, mass_places, rod_places
from jaxpound.model.system import GROUND, floors
from jaxpound.plots.style import CYCLE, building_colour, ends_named, numbered_colours, tones
from jaxpound.results.impacts import Impact
from jaxpound.results.response import LinkResponse, Response

_NAMED = 4  # masses, rods or links in a legend; of more, buildings or groups of links are named


class Curve(NamedTuple):
    """A series, its name in the legend, and its colour, if it has one by name in ``COLOURS``."""

    label: str
    colour: str
    values: Any


def is_pair(response: Response) -> bool:
    """Whether a run is of two masses, each on a rod of its own, with one link between them."""
    rods, links = ([one.ends for one in each] for each in (response.rods, response.links))
    return len(response.masses) == 2 and rods == [(0, GROUND), (1, GROUND)] and links == [(0, 1)]


def of_masses(response: Response, field: str, name: str) -> list[Curve]:
    """A series of each mass: of a pair by ``name`` with its number, else by its place.

    Of many masses that are the floors of buildings only the buildings are named; a building's
    floors are drawn from light to full colour, from the ground up.
    """
    return _of_each(response, "mass", [getattr(one, field) for one in response.masses], name)


def of_rods(response: Response, name: str) -> list[Curve]:
    """Force of each rod: of a pair by ``name`` with its number, else as masses."""
    return _of_each(response, "rod", [rod.force for rod in response.rods], name)


def frictions(owner: str, response: Response) -> list[Curve]:
    """Friction force of each damper, or of links without one where there is no damper at all.

    A ``ValueError`` where there is no link.

    Of many links those between the same buildings have one name and one colour, from light to full.
    """
    if not response.links:
        raise ValueError(f"{owner}: response must have a link")
    damped = dampers(response)
    series = [link.friction if link in damped else None for link in response.links]
    return _of_links("$q$", response, series)


def dampers(response: Response) -> list[LinkResponse]:
    """The links with a damper, or all where none has one."""
    return [link for link in response.links if link.has_damper] or list(response.links)


def touching(response: Response) -> list[LinkResponse]:
    """The links with a law of contact."""
    return [link for link in response.links if link.contact is not None]


def contacts(owner: str, response: Response) -> list[Curve]:
    """Contact force of each link with a law of contact; a ``ValueError`` where there is none."""
    found = touching(response)
    if not found:
        raise ValueError(f"{owner}: response must have a link with a law of contact")
    if len(response.links) == 1:
        return [Curve("$p$", "pounding", found[0].contact)]
    return _of_links("$p$", response, [link.contact for link in response.links])


_LOOP = 60  # points of the loop of an impact


def contact_loops(response: Response, link: LinkResponse) -> list[tuple[np.ndarray, np.ndarray]]:
    """Penetration and contact force along each impact of a link in a single run; [] if not known.

    The motion between the instants is the cubic that has their closings and velocities, and those
    of the touch.
    """
    if response.batch or link.law is None or link.impacts is None:
        return []
    inverse = [1 / float(response.masses[end].mass) for end in link.ends if end != GROUND]
    law, time = bound(link.law, 1 / sum(inverse)), np.asarray(response.time)
    return [_loop(law, impact, time, link) for impact in link.impacts.entries(0)]


def _loop(law: Any, impact: Impact, time: np.ndarray, link: LinkResponse) -> Any:
    end = time[-1] if np.isnan(impact.end) else impact.end
    first, last = np.searchsorted(time, [impact.time, end], "right")
    between = slice(first, last + 1)  # up to the instant after
    motion = CubicHermiteSpline(
        np.append(impact.time, time[between]),
        np.append(0.0, -np.asarray(link.gap)[between]),
        np.append(impact.approach_velocity, np.asarray(link.slip_velocity)[between]),
    )
    at = np.linspace(impact.time, end, _LOOP)
    penetration = np.maximum(motion(at), 0.0)
    force = np.asarray(law.force(penetration, motion(at, 1), impact.approach_velocity))
    force = force if may_pull(link.law) else np.maximum(force, 0.0)
    if not np.isnan(impact.end):  # back to the touch, without a force
        penetration, force = np.append(penetration, [penetration[-1], 0]), np.append(force, [0, 0])
    return np.append(0.0, penetration), np.append(0.0, force)


def gaps_of(owner: str, response: Response) -> list[Curve]:
    """Gap of each link, NaN in runs without one; a ``ValueError`` where there is no gap at all."""
    every = [np.asarray(link.gap) for link in response.links]
    known = [None if np.isposinf(x).all() else np.where(np.isposinf(x), np.nan, x) for x in every]
    found = _of_links(r"$\xi$", response, known)
    if not found:
        raise ValueError(f"{owner}: response must have a link with a finite gap")
    return found


def buildings_of(response: Response) -> tuple[tuple[tuple[int, int], ...], ...]:
    """The floors of each building, a mass and the rod of its storey each; () of other systems."""
    with suppress(ValueError):
        return floors(response.topology)
    return ()


def _of_each(response: Response, what: str, series: Sequence[Any], name: str) -> list[Curve]:
    numbers = range(1, len(series) + 1)
    if is_pair(response):
        named = zip(numbers, series, strict=True)
        return [Curve(name.format(i), f"structure {i}", values) for i, values in named]
    member = what == "rod"
    places = (rod_places if member else mass_places)(response.topology)
    buildings = [[floor[member] for floor in building] for building in buildings_of(response)]
    if not buildings:
        return _named(places, series)
    names: dict[int, str] = {}
    colours: dict[int, str] = {}
    for b, building in enumerate(buildings):
        colours |= dict(zip(building, tones(building_colour(b), len(building)), strict=True))
        names |= dict.fromkeys(building[:-1], "_floor") | {building[-1]: f"building {b + 1}"}
    if len(series) <= _NAMED:
        names = dict(enumerate(places))
    return [Curve(names[i], colours[i], values) for i, values in enumerate(series)]


def _of_links(symbol: str, response: Response, series: Sequence[Any]) -> list[Curve]:
    """Series of the links that have one, by place; of many, those between two buildings as one."""
    if len(series) == 1:
        return [Curve(symbol, "damper", values) for values in series if values is not None]
    given = [k for k, values in enumerate(series) if values is not None]
    places = link_places(response.topology)
    if len(given) <= _NAMED or not buildings_of(response):
        curves = _named(places, series)
        return [curves[k] for k in given]
    between: dict[str, list[int]] = {}
    for k in given:
        between.setdefault(places[k].partition(",")[0], []).append(k)
    names: dict[int, str] = {}
    colours: dict[int, str] = {}
    for (buildings, members), colour in zip(between.items(), cycle(CYCLE), strict=False):
        colours |= dict(zip(members, tones(colour, len(members)), strict=True))
        names |= dict.fromkeys(members[:-1], "_link") | {members[-1]: buildings}
    return [Curve(names[k], colours[k], series[k]) for k in given]


def _named(names: Sequence[str], series: Sequence[Any]) -> list[Curve]:
    """Where there are many, from dark to light, and only the ends of the list named."""
    colours = numbered_colours(len(series))
    return [Curve(*one) for one in zip(ends_named(names), colours, series, strict=True)]
