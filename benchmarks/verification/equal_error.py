"""Wall times of other programs at jaxpound's errors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from benchmarks.verification.batch import BATCH, OURS
from benchmarks.verification.case import Curve


class Ratio(NamedTuple):
    """How long another program takes for one of jaxpound's errors."""

    panel: str
    program: str
    error: float
    seconds: float
    """The other program's time."""
    of_run: float
    """That time over jaxpound's for one run."""
    of_batch: float | None
    """That time over jaxpound's for a run of a batch."""
    version: str = ""
    """Of the other program."""


def ratios(curves: Sequence[Curve]) -> list[Ratio]:
    """Of all panels with a curve of jaxpound's, at its errors within the other's range.

    Errors of programs that do not find the instants of events scatter about a power of the step:
    the other's time is that of the line fitted to log(error) over log(time).
    """
    found = []
    panels = list(dict.fromkeys(curve.panel for curve in curves))
    for panel in panels:
        known = {curve.program: curve for curve in curves if curve.panel == panel}
        ours, batch = known.get(OURS), known.get(BATCH)
        for program, other in known.items():
            if ours is None or program in (OURS, BATCH):
                continue
            slope, height = np.polyfit(np.log(other.seconds), np.log(other.errors), 1)
            for i, error in enumerate(ours.errors):
                if not min(other.errors) <= error <= max(other.errors):
                    continue
                seconds = float(np.exp((np.log(error) - height) / slope))
                of_batch = seconds / batch.seconds[i] if batch else None
                of_run = seconds / ours.seconds[i]
                found.append(Ratio(panel, program, error, seconds, of_run, of_batch, other.version))
    return found
