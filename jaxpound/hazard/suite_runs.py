"""The runs of an analysis, each a record times a factor.

A finished run is identified by record and factor, and kept in a store if there is one: an analysis
that was stopped requests the same runs again, and only the missing ones are run.
"""

from __future__ import annotations

from os import PathLike
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from tqdm.auto import tqdm

from jaxpound._checks import Rule, array, enforce, positive
from jaxpound._errors import caller, warn
from jaxpound._xla.batches import in_chunks, runs_at_a_time
from jaxpound.ground.record import stacked
from jaxpound.hazard.analysis import Analysis
from jaxpound.store.store import RunLog, identity, program_digest

_COLUMNS = ("record", "factor", "has_slope", "demand", "slope")  # the first three name a run
_ROWS = 256  # of a file


def rising_intensities(intensities: Any) -> Float[np.ndarray, " k"]:
    """Rising intensities > 0 as an array; an ``InvalidInput`` for anything else."""
    levels = array("intensities", intensities, (-1,))
    positive(intensities=levels)
    enforce([Rule("intensities", levels, np.append(True, np.diff(levels) > 0), "rising")])
    return levels


class SuiteRuns:
    """The runs of an analysis in batches of any size, kept in a store, with a progress bar.

    ``highest`` is the largest intensity of each record, or of all. Warns of what is implausible.
    """

    def __init__(
        self, analysis: Analysis, highest: Any, store: str | PathLike[str] | None, progress: bool
    ) -> None:
        warn(analysis.excessive(highest), analysis.strict)
        self.analysis, self.threshold = analysis, analysis.event[1]
        self._log = None if store is None else RunLog(store, _description(analysis))
        stored = self._log.rows if self._log else dict.fromkeys(_COLUMNS, np.empty(0))
        self._finished = _by_run(np.column_stack([stored[name] for name in _COLUMNS]))
        self._part = part = runs_at_a_time() // 4  # runs after which a file is written
        programs = lambda *run: (analysis.value(*run), jnp.nan), analysis.value_and_slope
        self._programs = [in_chunks(program, part) for program in programs]
        self.bar = tqdm(unit=" runs", disable=not progress)

    def run(self, records: Any, intensities: Any, *, slopes: bool = False) -> np.ndarray:
        """Demands of m records, by number, and derivatives by the intensity or NaN, shape (2, m).

        ``intensities``, shape (m,), are those to which the records are scaled.
        """
        unscaled = self.analysis.unscaled[records]
        factors = np.asarray(intensities / unscaled, jnp.zeros(()).dtype)
        runs = [(*run, slopes) for run in zip(records.tolist(), factors.tolist(), strict=True)]
        missing, size = [x for x in runs if x not in self._finished], min(len(runs), self._part)
        self.bar.total = (self.bar.total or 0) + len(runs)
        self.bar.update(len(runs) - len(missing))
        for start in range(0, len(missing), size):
            part = missing[start : start + size]
            # As large as if no run were finished: the same program, and the same rounding.
            record, factor, _ = np.array(part + part[-1:] * (size - len(part))).T
            results = self._programs[slopes](record.astype(int), factor.astype(factors.dtype))
            rows = np.column_stack([part, *(x[: len(part)] for x in results)])
            if self._log is not None:
                self._log.add(dict(zip(_COLUMNS, rows.T, strict=True)))
            self._finished |= _by_run(rows)
            self.bar.update(len(part))
        demands, by_factor = np.array([self._finished[run] for run in runs]).T
        if not (finite := np.isfinite(demands)).all():
            i, name = int(np.argmin(finite)), self.analysis.event[0]
            place = f"{self.analysis.suite.names[records[i]]!r} at {intensities[i]:.6g}"
            rule = f"{name} must be finite, but is {demands[i]}"
            raise FloatingPointError(f"{caller()}: {place}: {rule}")
        return np.stack([demands, by_factor / unscaled])


def _description(analysis: Analysis) -> dict[str, Any]:
    """What determines the results of the runs of an analysis, for a store."""
    search = "runs of a suite", _COLUMNS, _ROWS, program_digest(analysis.value, 0, 1.0)
    inputs: dict[str, Any] = {"demand": analysis.event[0], "records": stacked([*analysis.suite])}
    inputs |= {"structures": analysis.run_structures, "grid": analysis.time_grid}
    return identity(*search, **inputs, scheme=analysis.scheme)


def _by_run(rows: np.ndarray) -> dict[tuple[float, ...], list[float]]:
    """Demand and slope by the number of the record, its factor and whether the run has a slope."""
    return {tuple(row[:3]): row[3:] for row in rows.tolist()}
