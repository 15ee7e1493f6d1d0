"""The impacts of a link in a run, one by one."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from jaxpound._fields import pytree_dataclass, quantities, quantity

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


@pytree_dataclass
class ImpactSeries:
    """The first impacts of a link in order, as arrays of one length that end with NaN.

    Fields are as in ``Impact``. They are traced and differentiated, so that a fit to measured
    impacts can use them.
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
