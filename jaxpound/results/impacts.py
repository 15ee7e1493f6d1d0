"""The impacts of a link in a run, one by one, and its phases of stick and slip."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from jaxpound._fields import pytree_dataclass, quantities, quantity

if TYPE_CHECKING:
    from jaxpound.results.response import LinkResponse

MOST = 256
"""Number of impacts of a link that a response keeps."""


class Impact(NamedTuple):
    """One impact: a touch after the neighbours were apart, until they part again."""

    time: float
    """When they touch."""
    end: float
    """When they part; NaN if the run ends before."""
    link: int
    """Which link, from 0."""
    approach_velocity: float
    """Speed of the closing as they touch."""
    rebound_velocity: float
    """Speed of the opening as they part: 0 if they stay at rest, NaN if the run ends before."""
    impulse: float
    """∫ p dt over the contact."""
    peak_force: float
    """Largest contact force; infinite by Newton's law."""
    between: str = ""
    """Where the link is, in words and numbers from 1: "1–2, floor 2"."""

    def __repr__(self) -> str:
        """Its fields, with ``between`` for the index ``link``, which counts from 0."""
        fields = {"between": self.between} | self._asdict()
        return f"Impact({', '.join(f'{x}={y!r}' for x, y in fields.items() if x != 'link')})"


@pytree_dataclass
class ImpactSeries:
    """The first impacts of a link in order, as arrays of one length that end with NaN.

    Fields are as in ``Impact``, and differentiable, so that a fit to measured impacts can use them.
    """

    time: Any = quantity("time")
    end: Any = quantity("time")
    approach_velocity: Any = quantity("velocity")
    rebound_velocity: Any = quantity("velocity")
    impulse: Any = quantity("impulse")
    peak_force: Any = quantity("force")

    def entries(self, link: int, between: str = "") -> list[Impact]:
        """The impacts of a single run; ``between`` says where the link is."""
        fields = {name: np.asarray(getattr(self, name)) for name in quantities(ImpactSeries)}
        return [
            Impact(link=link, between=between, **{name: float(x[i]) for name, x in fields.items()})
            for i in np.flatnonzero(np.isfinite(fields["time"]))
        ]


class FrictionPhase(NamedTuple):
    """An interval of 'stick', 'slip right' (x1' > x2') or 'slip left', and its ends."""

    kind: str
    """'stick', 'slip right' or 'slip left'."""
    start: float
    """When it begins."""
    end: float
    """When it ends."""
    contact: bool = False
    """Whether the neighbours are in contact, or at rest in touch by Newton's law; to half a step
    where they are after the impacts that ``impacts`` lists, or were from the start."""


def phases_of(link: LinkResponse, time: Any) -> list[FrictionPhase]:
    """Intervals of stick and slip in order, of a single valid run with these instants."""
    time, phase = np.asarray(time), np.asarray(link.phase)
    changes = np.flatnonzero(np.diff(phase)) + 1
    instants = np.clip(np.asarray(link.change_time)[changes], time[0], time[-1])
    bounds = [float(time[0]), *instants.tolist(), float(time[-1])]
    kinds = {0: "stick", 1: "slip right", -1: "slip left"}
    contacts, phases = _contacts(link, time), list[FrictionPhase]()
    directions = phase[[0, *changes]].tolist()
    for direction, ends in zip(directions, itertools.pairwise(bounds), strict=True):
        phases += _split(FrictionPhase(kinds[direction], *ends), contacts)
    return phases


def _contacts(link: LinkResponse, time: np.ndarray) -> list[tuple[float, float]]:
    """Beginnings and ends of contact: of impacts exactly, of all else to half a step."""
    if link.impacts is None:
        return []
    last = float(time[-1])
    entries = link.impacts.entries(0)
    contacts = [(impact.time, last if np.isnan(impact.end) else impact.end) for impact in entries]
    ends = np.clip(time[:, None] + np.array([-0.5, 0.5]) * (time[1] - time[0]), time[0], last)
    covered = np.zeros(time.shape, bool)
    for begin, end in contacts:
        covered |= (begin <= ends[:, 1]) & (end >= ends[:, 0])
    unlisted = np.pad((np.asarray(link.touching) > 0) & ~covered, 1).astype(int)
    first, after = (np.flatnonzero(np.diff(unlisted) == 1), np.flatnonzero(np.diff(unlisted) == -1))
    return [*contacts, *zip(ends[first, 0].tolist(), ends[after - 1, 1].tolist(), strict=True)]


def _split(phase: FrictionPhase, contacts: list[tuple[float, float]]) -> list[FrictionPhase]:
    """A phase cut where contact begins and ends."""
    cuts = {t for contact in contacts for t in contact if phase.start < t < phase.end}
    parts: list[FrictionPhase] = []
    for start, end in itertools.pairwise([phase.start, *sorted(cuts), phase.end]):
        touching = any(a <= (start + end) / 2 < b for a, b in contacts)
        if parts and parts[-1].contact == touching:
            parts[-1] = parts[-1]._replace(end=end)
        else:
            parts.append(FrictionPhase(phase.kind, start, end, touching))
    return parts
