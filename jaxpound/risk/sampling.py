"""Importance sampling: runs are added, batch by batch, until the estimate is as sure as wanted."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from jaxpound.risk.limit_state import LimitState
from jaxpound.study.sampling import Points, as_key, key_numbers, points

BATCH = 256
"""Runs of a batch: sample i is in batch i // 256 on every machine."""
COMPILING = "compiling the runs"
"""What a progress bar says before the first run."""
_FEWEST = 2  # batches before the c.o.v. is believed
_FEWEST_HITS = 10


class Samples(NamedTuple):
    """Samples of a limit state, with weights φ/q."""

    z: Float[np.ndarray, "n d"]
    weights: Float[np.ndarray, " n"]
    values: Float[np.ndarray, " n"]
    times: Float[np.ndarray, " n"]

    def __len__(self) -> int:
        return len(self.z)

    @property
    def parts(self) -> np.ndarray:
        """Each sample's part of n times the estimate."""
        return np.where(self.values >= 0, self.weights, 0.0)

    @property
    def probability(self) -> float:
        """The estimate."""
        return float(self.parts.mean())

    @property
    def cov(self) -> float:
        """Its coefficient of variation; infinite where no sample reaches the limit state."""
        parts = self.parts
        mean = parts.mean()
        if not mean > 0:
            return math.inf
        return float(parts.std(ddof=1) / math.sqrt(len(parts)) / mean)

    def joined(self, other: Samples) -> Samples:
        """Both."""
        return Samples(*(np.concatenate(pair) for pair in zip(self, other, strict=True)))


def normal_points(key: int | jax.Array, state: LimitState) -> Points:
    """Standard normal points of d + 1 numbers: the last chooses a part of the mixture."""
    return points("plain", as_key(*key_numbers("rare_event", key)), state.dimension + 1)


def until_sure(
    draw: Callable[[int], Samples], cov: float, max_runs: int, first: Samples | None = None
) -> Iterator[Samples]:
    """All samples so far, after every batch, until the c.o.v. is the one wanted or below it.

    Parameters
    ----------
    draw
        The samples of a batch, by its number.
    cov
        The c.o.v. wanted.
    max_runs
        Runs at most.
    first
        Batch 0, if it is there already.
    """
    found = draw(0) if first is None else first
    number = 1
    while True:
        yield found
        hits = np.count_nonzero(found.values >= 0)
        sure = found.cov <= cov and hits >= _FEWEST_HITS and number >= _FEWEST
        if sure or (number + 1) * BATCH > max_runs:
            return
        found, number = found.joined(draw(number)), number + 1
