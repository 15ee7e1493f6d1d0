"""Wall times of other programs at jaxpound's errors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from benchmarks.verification.batch import BATCH, OURS
from benchmarks.verification.case import Curve

_BATCH = ", " + BATCH.partition(", ")[2]


class Ratio(NamedTuple):
    """How long another program takes for one of jaxpound's errors."""

    panel: str
    program: str
    error: float
    seconds: float
    """The other program's time of one run."""
    of_run: float
    """That time over jaxpound's for one run."""
    of_batch: float | None
    """The time of a run, in a batch if the other program has batches, over jaxpound's for a run of
    a batch."""
    version: str = ""
    """Of the other program."""


def time_at(curve: Curve, error: float) -> float | None:
    """The time for an error, None beyond the curve's range.

    It is interpolated in logarithms between the measured runs, without those that take longer than
    a run whose error is as small.
    """
    order = np.argsort(curve.seconds)
    times, errors = np.array(curve.seconds)[order], np.array(curve.errors)[order]
    improves = errors < np.minimum.accumulate(np.r_[np.inf, errors[:-1]])
    times, errors = np.log(times[improves]), np.log(errors[improves])
    if not errors[-1] <= np.log(error) <= errors[0]:
        return None
    return float(np.exp(np.interp(-np.log(error), -errors, times)))


def ratios(curves: Sequence[Curve]) -> list[Ratio]:
    """Of all panels with a curve of jaxpound's, at its errors within the other's range."""
    rows = []
    for panel in dict.fromkeys(curve.panel for curve in curves):
        known = {curve.program: curve for curve in curves if curve.panel == panel}
        ours, batch = known.get(OURS), known.get(BATCH)
        for program, other in known.items():
            if ours is None or program == OURS or program.endswith(_BATCH):
                continue
            crowd = known.get(program.partition(", ")[0] + _BATCH)
            for i, error in enumerate(ours.errors):
                if (seconds := time_at(other, error)) is None:
                    continue
                in_batch = time_at(crowd, error) if crowd else seconds
                of_batch = in_batch / batch.seconds[i] if batch and in_batch else None
                of_run = seconds / ours.seconds[i]
                rows.append(Ratio(panel, program, error, seconds, of_run, of_batch, other.version))
    return rows
