"""Runs that are kept as they are done, in whatever order, so that a stopped analysis goes on.

A folder as of ``monte_carlo``: a manifest that says which analysis it is, and archives that are
written whole or not at all. How many runs there will be is not known, nor in which order they are
asked for: each row says itself of which run it is, and chunks are numbered as they are written.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound._version import __version__
from jaxpound.study.archives import digest
from jaxpound.study.store import MOST, Store


def identity(
    search: str,
    columns: tuple[str, ...],
    chunk_size: int,
    program: tuple[Callable[..., Any], tuple[Any, ...]],
    **described: Any,
) -> dict[str, Any]:
    """All that determines the numbers of a search, as JSON.

    Parameters
    ----------
    search
        Its kind, in words.
    columns, chunk_size
        Of its store.
    program
        A traceable function and its arguments, of one run: functions have no other identity.
    described
        What else determines it, as trees of JSON by name.
    """
    function, arguments = program
    lowered = jax.jit(function).trace(*arguments).lower(lowering_platforms=("cpu",))
    versions = {"jaxpound": __version__, "jax": jax.__version__}
    return {
        "search": search,
        "versions": versions,
        "precision": str(jnp.zeros(()).dtype),
        "columns": list(columns),
        "chunk_size": chunk_size,
        **described,
        "program": digest(lowered.as_text().encode()),
    }


class Ledger:
    """The folder of an analysis, new or to be continued; a damaged file of it is told by a warning.

    Parameters
    ----------
    folder
        Made if it does not exist.
    identity
        See ``identity``.

    Raises
    ------
    ValueError
        If the folder holds something else, or another analysis: the message says what differs.
    OSError
        If the folder cannot be made or written to.
    """

    def __init__(self, folder: str | os.PathLike[str], identity: Mapping[str, Any]) -> None:
        size: int = identity["chunk_size"]
        most = MOST // size * size
        self._store = store = Store.create(folder, identity, most, {"notes": identity["search"]})
        self._type = np.dtype(identity["precision"])
        there, names = store.full(), store.columns
        found = dict(store.undamaged(there, "its runs are made anew"))
        self._free = [chunk for chunk in there if chunk not in found]
        self._next = max(there, default=-1) + 1
        none = np.empty(0, self._type)
        held = {name: np.concatenate([none, *(x[name] for x in found.values())]) for name in names}
        known = ~np.isnan(held[names[0]])
        self.rows = {name: x[known] for name, x in held.items()}
        """All that was kept before, by column."""

    def add(self, rows: Mapping[str, np.ndarray]) -> None:
        """Keep rows, by column; the first column of no row is NaN.

        Raises
        ------
        OSError
            If there is no room, or the folder cannot be written to.
        """
        size = self._store.chunk_size
        for start in range(0, len(next(iter(rows.values()))), size):
            chunk = {}
            for name in self._store.columns:
                part = np.asarray(rows[name][start : start + size], self._type)
                chunk[name] = np.concatenate([part, np.full(size - len(part), np.nan, part.dtype)])
            self._store.write(self._number(), chunk)

    def _number(self) -> int:
        """Of the next chunk; damaged ones are replaced first."""
        if self._free:
            return self._free.pop()
        self._next += 1
        return self._next - 1
