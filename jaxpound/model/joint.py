"""Joints of a system: each has one closing, with friction and an inerter, and gaps on its sides.

A link is a joint, and has its gap on side 1. A link that is the other face of another
(``topology.faces``) is a gap on side −1 of its joint, and sees the closing with the opposite sign.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from jaxpound.model.ends import WeightedEnds, moving_ends, weighted
from jaxpound.model.topology import faces

if TYPE_CHECKING:
    from jaxpound.model.system import System


class Face(NamedTuple):
    """A link on a side of a joint: its gap closes as the closing grows (1) or as it falls (−1)."""

    link: int
    side: int


class Joint(NamedTuple):
    """Masses that slide along each other, and the links that are their joint."""

    ends: WeightedEnds
    path: WeightedEnds  # ``moving_ends``, along which it closes
    faces: tuple[Face, ...]

    @property
    def link(self) -> int:
        """The link that has the joint's friction and inerter."""
        return self.faces[0].link


def joints(system: System) -> tuple[Joint, ...]:
    """The joints of a system, in the order of their links."""
    first = faces(system.topology)
    opposite = {k: (Face(other, -1),) for other, k in first.items()}
    return tuple(
        Joint(weighted(link), moving_ends(link), (Face(k, 1), *opposite.get(k, ())))
        for k, link in enumerate(system.links)
        if k not in first
    )


def groups(all_joints: Sequence[Joint]) -> list[tuple[Joint, ...]]:
    """Joints that share masses, directly or through others, in the order of the first of each."""
    kept: list[tuple[Joint, ...]] = []
    for joint in all_joints:
        masses = {mass for mass, _ in joint.ends}
        meets = [g for g in kept if any(masses & {i for i, _ in other.ends} for other in g)]
        joined = (*(other for group in meets for other in group), joint)
        number = kept.index(meets[0]) if meets else len(kept)
        kept = [group for group in kept if group not in meets]
        kept.insert(number, joined)
    return kept
