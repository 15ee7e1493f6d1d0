"""What figures draw of a run: a curve for each mass, rod and link, with its name and colour."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_hex

from jaxpound.model.system import GROUND
from jaxpound.plots.style import CYCLE
from jaxpound.results.response import LinkResponse, Response


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
    """A series of each mass: of a pair by ``name`` with its number, else "mass 3"."""
    return _of_each(response, "mass", [getattr(one, field) for one in response.masses], name)


def of_rods(response: Response, name: str) -> list[Curve]:
    """Force of each rod: of a pair by ``name`` with its number, else "rod 3"."""
    return _of_each(response, "rod", [rod.force for rod in response.rods], name)


def frictions(owner: str, response: Response) -> list[Curve]:
    """Friction force of each link; a ``ValueError`` where there is none."""
    if not response.links:
        raise ValueError(f"{owner}: response must have a link")
    return _of_links("$q$", [link.friction for link in response.links])


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
    every = _of_links("$p$", [link.contact for link in response.links])
    return [curve for curve in every if curve.values is not None]


def gaps_of(owner: str, response: Response) -> list[Curve]:
    """Gap of each link, NaN in runs without one; a ``ValueError`` where there is no gap at all."""
    every = _of_links(r"$\xi$", [np.asarray(link.gap) for link in response.links])
    found = [
        curve._replace(values=np.where(np.isposinf(curve.values), np.nan, curve.values))
        for curve in every
        if not np.isposinf(curve.values).all()
    ]
    if not found:
        raise ValueError(f"{owner}: response must have a link with a finite gap")
    return found


def _of_each(response: Response, what: str, series: Sequence[Any], name: str) -> list[Curve]:
    if not is_pair(response):
        return _numbered(what, series)
    numbers = range(1, len(series) + 1)
    named = zip(numbers, series, strict=True)
    return [Curve(name.format(i), f"structure {i}", values) for i, values in named]


def _of_links(symbol: str, series: Sequence[Any]) -> list[Curve]:
    if len(series) == 1:
        return [Curve(symbol, "damper", series[0])]
    return _numbered("link", series)


def _numbered(what: str, series: Sequence[Any]) -> list[Curve]:
    """By number; colours from dark to light where there are many."""
    n, colours = len(series), CYCLE
    if n > len(CYCLE):
        colours = [to_hex(colour) for colour in colormaps["viridis"](np.linspace(0, 0.92, n))]
    numbers = range(1, n + 1)
    return [
        Curve(f"{what} {i}", colour, values)
        for i, colour, values in zip(numbers, colours, series, strict=False)
    ]
