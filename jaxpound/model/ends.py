"""Masses that rods and joints join, with weights: an elongation is Σ weight × displacement."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np

from jaxpound.model.topology import GROUND, AnyEnds, WeightedMasses

WeightedEnds = tuple[tuple[int, Any], ...]
"""Masses and their weights; the ground, which does not move, is left out."""


@runtime_checkable
class Element(Protocol):
    """A rod, a link, or the response of either."""

    @property
    def ends(self) -> AnyEnds | None:
        """Masses i and j, of which one may be ``GROUND``; or masses with weights."""

    @property
    def weights(self) -> Sequence[Any]:
        """The weights of masses with weights; none between two ends."""


def weighted(element: Element) -> WeightedEnds:
    """Masses and weights of a rod or a link; 1 and −1 if it is stretched by x_i − x_j."""
    ends: Any = element.ends
    if isinstance(ends, WeightedMasses):
        return tuple(zip(ends.masses, element.weights, strict=True))
    return tuple((mass, sign) for mass, sign in zip(ends, (1, -1), strict=True) if mass > GROUND)


def moving_ends(element: Element) -> WeightedEnds:
    """``weighted`` ends, before them a support that may move relative to the ground.

    Support k is the entry −k of displacements, behind those of the masses.
    """
    ends: Any = element.ends
    if isinstance(ends, WeightedMasses) or min(ends) >= GROUND:
        return weighted(element)
    sign = 1 if ends[0] < GROUND else -1
    return (min(ends) - GROUND, sign), *weighted(element)


def link_ends(links: Sequence[Element]) -> tuple[WeightedEnds, ...]:
    """Masses and weights of links; of a left face those of the right face before it, reversed."""
    ends = list[WeightedEnds]()
    for link in links:
        if isinstance(link.ends, WeightedMasses) and link.ends.side < 0:
            ends.append(tuple((mass, -weight) for mass, weight in ends[-1]))
        else:
            ends.append(weighted(link))
    return tuple(ends)


def beside_axis(ends: WeightedEnds) -> WeightedEnds:
    """Ends whose weights, maybe those of a batch, multiply arrays with one axis more."""
    arrays = ((mass, np.asarray(w) if isinstance(w, float) else w) for mass, w in ends)
    return tuple((mass, w if isinstance(w, int) else w[..., None]) for mass, w in arrays)


def elongation(element: Element, x: Sequence[Any]) -> Any:
    """Elongation of a rod, or closing of a link, by displacements of masses; or of velocities."""
    return along(weighted(element), x)


def along(ends: WeightedEnds, x: Any) -> Any:
    """B x of one rod, or C x of one joint, Σ weight × x; also of velocities and accelerations."""
    terms = [times(weight, x[mass]) for mass, weight in ends]
    return sum(terms[1:], terms[0])


def less_ground(pull: Any, influence: Any, ground: Any) -> Any:
    """An acceleration along ends less C ι u'', which drops out where all move with the ground.

    Without ``ground`` it has its part already.
    """
    moves_all = isinstance(influence, int | float) and not influence
    return pull if moves_all or ground is None else pull - influence * ground


def load_on(mass: int, all_ends: Sequence[WeightedEnds], forces: Sequence[Any]) -> Any:
    """Load −Σ weight × f on a mass of forces that pull ends together; 0 without any."""
    pairs = zip(all_ends, forces, strict=True)
    terms = [times(-w, force) for ends, force in pairs for i, w in ends if i == mass]
    return sum(terms[1:], terms[0]) if terms else 0.0


def mobility(ends: WeightedEnds, masses: Sequence[Any]) -> Any:
    """R = Σ weight²/mass, the relative acceleration of ends under a unit force between them."""
    parts = [weight**2 / masses[mass] for mass, weight in ends]
    return sum(parts[1:], parts[0])


def times(weight: Any, y: Any) -> Any:
    """Weight × y; an integer weight of ±1 is a sign, and no operation more."""
    if isinstance(weight, int) and abs(weight) == 1:
        return y if weight == 1 else -y
    return weight * y
