"""What a study keeps of each earthquake, and where."""

from __future__ import annotations

import dataclasses
import json
import math
import os
from collections.abc import Callable, Mapping
from os import PathLike
from pathlib import Path
from types import NoneType
from typing import Any

import jax

from jaxpound._checks import instance, positive_number
from jaxpound._errors import InvalidInput
from jaxpound._fields import Checked, parameter, part
from jaxpound.grid import TimeGrid
from jaxpound.ground.intensity import spectral_acceleration
from jaxpound.ground.measure import Measure
from jaxpound.ground.motion import GroundLike
from jaxpound.ground.run_input import as_run
from jaxpound.model.system import Structures, gravity_of, in_si
from jaxpound.quantities import unit
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

    folder: str | PathLike[str] | None = part(str, PathLike, NoneType, default=None)
    chunk_size: int | None = parameter(whole=True, optional=True, default=None)
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
                rule = "must be a function"
                raise InvalidInput(f"measures[{name!r}]", repr(measure), rule)
        try:
            json.dumps(self.notes, allow_nan=False)
        except (TypeError, ValueError) as error:
            rule = f"must be what JSON can hold ({error})"
            raise InvalidInput("notes", "", rule) from error
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


@dataclasses.dataclass(frozen=True)
class SpectralAcceleration:
    """Pseudo-spectral acceleration at a period, with 5 % of damping: one of ``measures``.

    Of ``Buildings`` it is in m/s², else in g; ``period`` is in the unit of time of the run.

    Examples
    --------
    >>> grid, steel = jp.TimeGrid.until(8.0, dt=0.1), jp.paper.structures()
    >>> wavelets = jp.RandomRicker(1, jp.Uniform(0.01, 0.1), jp.Uniform(2, 3), jp.Uniform(2, 4))
    >>> at_2 = jp.study.SpectralAcceleration.of(steel, period=2.0, grid=grid)
    >>> scenarios, kept = jp.Scenarios(steel, wavelets), jp.Storage(measures={"sa": at_2})
    >>> study = jp.monte_carlo(scenarios, 16, grid, store=kept, progress=False)
    >>> str(study.measure("sa")), bool((study["sa"] > 0).all())
    ('Sa(2 1/ω1) (g)', True)
    """

    measure: str
    """The measure of intensity with its unit, by which curves and hazards know it."""
    period: float
    grid: TimeGrid

    @classmethod
    def of(cls, structures: Any, period: float, grid: TimeGrid) -> SpectralAcceleration:
        """That of a study of these structures, whose runs have this grid.

        Raises ``ValueError`` for a period that is not positive, and for another grid or structures.
        """
        instance("structures", structures, Structures)
        (period,) = positive_number(period=period)
        instance("grid", grid, TimeGrid)
        of_time, of_acceleration = (unit(x, in_si(structures)) for x in ("time", "acceleration"))
        measure = Measure.spectral_acceleration(period, of_time, of_acceleration)
        return cls(str(measure), period, grid)

    def __call__(self, structures: Any, ground: GroundLike) -> jax.Array:
        """The value in a scenario."""
        motion = as_run(ground, self.grid, gravity_of(structures))
        return spectral_acceleration(motion, self.grid, period=self.period)
