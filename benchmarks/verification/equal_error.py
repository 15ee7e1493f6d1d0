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

    The other's time is interpolated in logarithms between its measured runs, without those that
    take longer than a run whose error is as small.
    """
    found = []
    panels = list(dict.fromkeys(curve.panel for curve in curves))
    for panel in panels:
        known = {curve.program: curve for curve in curves if curve.panel == panel}
        ours, batch = known.get(OURS), known.get(BATCH)
        for program, other in known.items():
            if ours is None or program in (OURS, BATCH):
                continue
            order = np.argsort(other.seconds)
            times, errors = np.array(other.seconds)[order], np.array(other.errors)[order]
            improves = errors < np.minimum.accumulate(np.r_[np.inf, errors[:-1]])
            times, errors = np.log(times[improves]), np.log(errors[improves])
            for i, error in enumerate(ours.errors):
                if not errors[-1] <= np.log(error) <= errors[0]:
                    continue
                seconds = float(np.exp(np.interp(-np.log(error), -errors, times)))
                of_batch = seconds / batch.seconds[i] if batch else None
                of_run = seconds / ours.seconds[i]
                found.append(Ratio(panel, program, error, seconds, of_run, of_batch, other.version))
    return found
