"""What a study keeps of each earthquake, and where."""

from __future__ import annotations

import dataclasses
import json
import math
import os
from collections.abc import Callable, Mapping
from os import PathLike
from pathlib import Path
from typing import Any

from jaxpound._errors import InvalidInput
from jaxpound._fields import Checked, parameter, part
from jaxpound.store.store import MANIFEST, Store

_SMALLEST, _LARGEST, _CHUNKS = 32, 16_384, 8  # samples of a chunk, and chunks at least


@dataclasses.dataclass(frozen=True, eq=False)
class Storage(Checked):
    """What a study keeps of each earthquake, and where; ``monte_carlo(store=…)`` takes it.

    Raises ``ValueError`` if an argument breaks its rule.

    Parameters
    ----------
    folder
        A folder, made if needed, with one file for each chunk. None keeps columns in memory.
    chunk_size
        Samples per chunk. By default that of an existing folder; else the largest power of 2 that
        makes eight chunks, from 32 to 16,384.
    measures
        Further columns by name: traceable functions of (structures, ground) to one number. A name
        has 1 to 200 printable characters without a slash. A callable dataclass may state what its
        column is, for ``Study.measure``, in a field ``measure``, such as ``"Sa(0.9 s) (g)"``.
    keep_parameters
        Whether the scenarios' parameters are columns too; ``Study.parameters`` can recompute them.
    keep_failures
        Whether failed runs are kept as NaN and left out of all statistics; else they raise.
    notes
        Anything that JSON can hold; the study keeps it in ``about``.
    shard
        (i, k), i from 1 to k: run only every k-th chunk from the i-th, so that k independent
        processes fill one folder. The study is that of these chunks.

    Examples
    --------
    >>> grid = jp.TimeGrid.until(20.0, dt=0.1)
    >>> ground = jp.RandomRicker(1, jp.LogNormal(0.1, 0.5), jp.Uniform(1.0, 4.0), jp.Uniform(1, 7))
    >>> sa = lambda structures, ground: jp.spectral_acceleration(ground, grid, period=2.0)
    >>> kept = jp.Storage(measures={"sa": sa}, keep_parameters=True)
    >>> scenarios = jp.Scenarios(jp.paper.structures(), ground)
    >>> study = jp.monte_carlo(scenarios, 64, grid, store=kept, progress=False)
    >>> study.columns[-5:]
    ('sa', 'amplitude_1', 'period_1', 'arrival_1', 'sign_1')
    """

    folder: str | PathLike[str] | None = part(str, PathLike, default=None)
    chunk_size: int | None = parameter(whole=True, default=None)
    measures: Mapping[str, Callable[[Any, Any], Any]] = part(Mapping, default_factory=dict)
    keep_parameters: bool = False
    keep_failures: bool = False
    notes: Any = None
    shard: tuple[int, int] = (1, 1)

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "measures", dict(self.measures))
        for name, measure in self.measures.items():
            if not callable(measure):
                raise InvalidInput(f"measures[{name!r}]", repr(measure), "must be a function")
        try:
            json.dumps(self.notes, allow_nan=False)
        except (TypeError, ValueError) as error:
            raise InvalidInput("notes", "", f"must be what JSON can hold ({error})") from error
        shard = self.shard
        pair = isinstance(shard, tuple) and len(shard) == 2
        if not (pair and all(isinstance(x, int) for x in shard) and 1 <= shard[0] <= shard[1]):
            raise InvalidInput("shard", repr(shard), "must be (i, k) with 1 ≤ i ≤ k")
        if self.folder is None and shard != (1, 1):
            raise InvalidInput("shard", repr(shard), "must come with a folder to fill")

    def sized(self, n: int) -> int:
        """Samples per chunk of a study of n samples."""
        if self.chunk_size is not None:
            return self.chunk_size
        if self.folder is not None and os.path.lexists(Path(self.folder) / MANIFEST):
            return Store(self.folder).chunk_size
        return min(max(_SMALLEST, 2 ** int(math.log2(n / _CHUNKS))), _LARGEST)

    def chunks(self, n: int, size: int) -> range:
        """Numbers, from 0, of the shard's chunks, of this size, of a study of n samples."""
        (first, shards), chunks = self.shard, range(-(-n // size))
        if first > len(chunks):
            rule = f"must leave a chunk for each shard: the study has {len(chunks)}"
            rule += "; a smaller chunk_size makes more"
            raise InvalidInput("shard", repr(self.shard), rule)
        return chunks[first - 1 :: shards]
