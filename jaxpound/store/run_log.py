"""Finished runs of an analysis, stored in any order, so that a stopped analysis can continue.

The folder is that of a ``Store``. The number and the order of the runs are not fixed in advance:
each row identifies its run, and chunks are numbered as they are written.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound._version import __version__
from jaxpound.store.store import MOST_SAMPLES, Store, describe, program_digest


def identity(
    search: str,
    columns: tuple[str, ...],
    chunk_size: int,
    program: tuple[Callable[..., Any], tuple[Any, ...]],
    **inputs: Any,
) -> dict[str, Any]:
    """Everything that determines the numbers of an analysis, as JSON.

    ``search`` is its kind, in words; ``program`` a traceable function of one run, and its arguments
    (``program_digest``); ``inputs`` everything else, by name.
    """
    function, arguments = program
    return {
        "search": search,
        "versions": {"jaxpound": __version__, "jax": jax.__version__},
        "precision": str(jnp.zeros(()).dtype),
        "columns": list(columns),
        "chunk_size": chunk_size,
        **{name: describe(value) for name, value in inputs.items()},
        "program": program_digest(function, *arguments),
    }


class RunLog:
    """The runs in a folder, as ``Store.create`` opens it; a warning names damaged files."""

    def __init__(self, folder: str | os.PathLike[str], identity: dict[str, Any]) -> None:
        size: int = identity["chunk_size"]
        most = MOST_SAMPLES // size * size
        self._store = store = Store.create(folder, identity, most, {"notes": identity["search"]})
        self._type = np.dtype(identity["precision"])
        stored = store.held()
        chunks = dict(store.undamaged(stored, "its runs are made anew"))
        damaged = [chunk for chunk in reversed(stored) if chunk not in chunks]  # are replaced first
        self._numbers = itertools.chain(damaged, itertools.count(max(stored, default=-1) + 1))
        parts = [dict.fromkeys(store.columns, np.empty(0, self._type)), *chunks.values()]
        used = [~np.isnan(part[store.columns[0]]) for part in parts]
        self.rows = {
            name: np.concatenate([part[name][rows] for part, rows in zip(parts, used, strict=True)])
            for name in store.columns
        }  # of all earlier runs, by column

    def add(self, rows: Mapping[str, np.ndarray]) -> None:
        """Store rows, by column; NaN in the first column marks an unused row."""
        size = self._store.chunk_size
        for start in range(0, len(next(iter(rows.values()))), size):
            chunk = {name: np.full(size, np.nan, self._type) for name in self._store.columns}
            for name, column in chunk.items():
                part = rows[name][start : start + size]
                column[: len(part)] = part
            self._store.write(next(self._numbers), chunk)
