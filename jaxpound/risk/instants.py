"""Series whose largest number over the run is the demand: a limit state for every instant.

A demand over a run is reached if it is reached at some instant. At one instant it is a smooth
function of the ground motion, whose nearest point of failure can be found by gradients; the
largest of all instants is not.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxpound.model.places import link_places, mass_places, rod_places
from jaxpound.model.system import GROUND, Ends, System, elongation, is_closable
from jaxpound.results.demand import Demand
from jaxpound.results.elements import place_of
from jaxpound.risk.demanded import REQUIRED_GAP
from jaxpound.simulation.course import Positions

_PERIOD = 2 * np.pi  # of structure 1, in 1/ω1
_PER_PERIOD = 20
_MOST = 256


class Series(NamedTuple):
    """A linear combination of displacements, closings and gaps at rest."""

    words: str
    """What it is, and where, in words: "drift, storey 2 of building 1"."""
    row: np.ndarray
    """Factors of each mass's displacement, each link's closing and each link's gap at rest."""


def series_of(system: System, demand: Any, pounding: bool) -> tuple[Series, ...]:
    """The series of a demand; none of one that is no largest displacement, drift or closing.

    Parameters
    ----------
    system
        The structures.
    demand
        ``LimitState.demand``.
    pounding
        Whether a closing counts beyond the link's own gap at rest.
    """
    if not isinstance(demand, str):
        return ()
    n, links = system.topology.n_masses, range(len(system.links))
    displacements, closings, gaps = np.split(np.eye(n + 2 * len(links)), [n, n + len(links)])

    def both(words: str, ends: Ends) -> list[Series]:
        row = elongation(ends, [*displacements])
        return [Series(words, row), Series(f"{words}, reversed", -row)]

    if demand == REQUIRED_GAP:
        places = link_places(system.topology)
        what = "overlap" if pounding else "closing"
        return tuple(
            Series(f"{what}, {places[k]}", closings[k] - pounding * gaps[k])
            for k in links
            if is_closable(system.links[k].gap)
        )
    rods = zip(rod_places(system.topology), system.topology.rods, strict=True)
    storeys = [(f"drift, {place}", ends) for place, ends in rods]
    if demand == "peak_drift":
        return tuple(one for words, ends in storeys for one in both(words, ends))
    place = place_of(Demand, demand)
    if place is not None and place.field == "peak_drift":
        return tuple(both(*storeys[place.element]))
    if place is not None and place.field == "peak_x":
        words = f"displacement, {mass_places(system.topology)[place.element]}"
        return tuple(both(words, (place.element, GROUND)))
    return ()


def measured(row: Any, positions: Positions, system: System) -> Float[Array, ""]:
    """The value of a series, given by its ``row``, at an instant; traceable."""
    gaps = [jnp.where(jnp.isfinite(link.gap), link.gap, 0.0) for link in system.links]
    return row @ jnp.stack([*positions.x, *positions.closings, *gaps])


def chosen_instants(n_steps: int, dt: float, n_series: int) -> np.ndarray:
    """Numbers of the instants at which design points are sought, the last being the run's end.

    There are 20 in a period of structure 1, which are some 0.3/ω1 apart, and at most 256; of
    several series fewer each, but at least 16.
    """
    wanted = min(int(np.ceil(n_steps * dt * _PER_PERIOD / _PERIOD)), _MOST)
    n = max(1, min(n_steps, max(wanted // max(1, n_series), 16)))
    return np.round(np.arange(1, n + 1) * n_steps / n).astype(int)
