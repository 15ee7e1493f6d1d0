"""The runs of a search for a limit state, in batches that its folder keeps."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxpound.reliability.limit_state import LimitState
from jaxpound.scenarios.sampling import key_numbers
from jaxpound.store.run_log import RunLog, identity

BatchId = tuple[int, int]


class SearchRuns:
    """Results of batches of runs; those in the folder, if there is one, are not run again.

    Points follow from the key and earlier results: the folder has only results. The first two of
    its ``columns`` identify the batch of a run, the others are its results; ``described`` is all
    else that determines the runs.
    """

    def __init__(
        self,
        folder: str | PathLike[str] | None,
        search: str,
        state: LimitState,
        key: Any,
        columns: tuple[str, ...],
        chunk_size: int,
        **described: Any,
    ) -> None:
        self.identity: dict[str, Any] = {}  # all that determines the runs; empty without a folder
        self._columns, self._log = columns, None
        self._finished: dict[BatchId, np.ndarray] = {}
        if folder is None:
            return
        kind, numbers = key_numbers("rare_event", key)
        described["key"] = {"kind": kind, "numbers": list(numbers)}
        names = ("demand", "threshold", "changes", "scenarios", "grid", "scheme")
        described |= {name: getattr(state, name) for name in names}
        program = (lambda z: state.observed(z, state.changes)), (jnp.zeros(state.dimension),)
        self.identity = identity(search, columns, chunk_size, program, **described)
        self._log = RunLog(folder, self.identity)
        first, second, *results = (self._log.rows[name] for name in columns)
        order = np.lexsort((second, first))  # stable
        pairs = np.column_stack([first, second])[order].astype(int)
        batches, starts = np.unique(pairs, axis=0, return_index=True)
        parts = np.split(np.stack(results)[:, order], starts[1:], axis=1)
        self._finished = {(i, j): x for (i, j), x in zip(batches.tolist(), parts, strict=False)}

    def results(
        self,
        batches: Mapping[BatchId, np.ndarray],
        run: Callable[[np.ndarray], Sequence[np.ndarray]],
    ) -> dict[BatchId, np.ndarray]:
        """Results, shape (m, n), of batches of points; missing ones are run and stored together."""
        missing = {name: z for name, z in batches.items() if name not in self._finished}
        if missing:
            results = np.stack(run(np.concatenate([*missing.values()])))
            sizes = [len(z) for z in missing.values()]
            if self._log is not None:
                rows = (*np.repeat([*missing], sizes, axis=0).T, *results)
                self._log.add(dict(zip(self._columns, rows, strict=True)))
            parts = np.split(results, np.cumsum(sizes)[:-1], axis=1)
            self._finished.update(zip(missing, parts, strict=True))
        # Processes that filled a store at once may have stored a batch twice in succession.
        return {name: self._finished.pop(name)[:, : len(z)] for name, z in batches.items()}
