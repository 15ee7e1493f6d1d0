"""The runs of subset simulation, part by part, kept in files so that a stopped one goes on."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from os import PathLike
from typing import Any

import numpy as np

from jaxpound.risk.kept import of_limit_state
from jaxpound.risk.ledger import Ledger, identity
from jaxpound.risk.levels import Place
from jaxpound.risk.limit_state import LimitState

PART = 2048
"""Runs after which a file is written, but for requests of more."""

_COLUMNS = ("repeat", "request", "value")


class SubsetRuns:
    """Values of a limit state for ``side_by_side``; what a store has of them is not run again.

    The points that are asked for are drawn again by those who ask: they follow from key, repeat and
    the values before. So a store has only values, which do not depend on the number of repeats.

    Parameters
    ----------
    state
        The limit state.
    bar
        A progress bar.
    store
        A folder; None keeps nothing.
    key, n, p0
        As ``subset_simulation``.

    Raises
    ------
    ValueError
        If the folder holds something else, or another search: the message says what differs.
    OSError
        If the folder cannot be made or written to.
    """

    def __init__(
        self,
        state: LimitState,
        bar: Any,
        store: str | PathLike[str] | None,
        *,
        key: Any,
        n: int,
        p0: float,
    ) -> None:
        self.count = 0
        """Number of runs, those from the store among them."""
        self.failed = 0
        """Number of those that have no result."""
        self._state, self._bar, self._part = state, bar, max(n, PART)
        self._ledger: Ledger | None = None
        self._held: dict[Place, np.ndarray] = {}
        if store is not None:
            program, described = of_limit_state(state, key)
            how = described | {"n": n, "p0": float(p0), "numpy": np.__version__}  # it draws
            self._ledger = Ledger(
                store, identity("a subset simulation", _COLUMNS, self._part, program, **how)
            )
            self._held = _by_place(self._ledger.rows)

    def __call__(self, asked: Mapping[Place, np.ndarray]) -> dict[Place, np.ndarray]:
        """Values of points by place; −∞ of runs that fail."""
        found = {}
        for part in self._parts(asked):
            missing = {place: asked[place] for place in part if place not in self._held}
            if missing:
                self._run(missing)
            for place in part:
                values = self._held.pop(place)[: len(asked[place])]  # asked for only once
                found[place] = np.where(np.isnan(values), -np.inf, values)
                self.failed += int(np.isnan(values).sum())
            runs = sum(len(asked[place]) for place in part)
            self.count += runs
            self._bar.update(runs)
        return found

    def _parts(self, asked: Mapping[Place, np.ndarray]) -> Iterator[list[Place]]:
        """Places of requests that are run and written together.

        They are the same whatever is held: then so is every batch, and its rounding.
        """
        part: list[Place] = []
        size = 0
        for place, points in asked.items():
            if part and size + len(points) > self._part:
                yield part
                part, size = [], 0
            part.append(place)
            size += len(points)
        yield part

    def _run(self, missing: Mapping[Place, np.ndarray]) -> None:
        values = self._state.values(np.concatenate([*missing.values()]))
        sizes = [len(points) for points in missing.values()]
        places = np.repeat(np.array([*missing]), sizes, axis=0)
        if self._ledger is not None:
            self._ledger.add(dict(zip(_COLUMNS, (*places.T, values), strict=True)))
        parts = np.split(np.asarray(values, float), np.cumsum(sizes)[:-1])
        self._held.update(zip(missing, parts, strict=True))


def _by_place(rows: Mapping[str, np.ndarray]) -> dict[Place, np.ndarray]:
    """Values by place, in the order in which they were kept.

    Processes that filled a store at once may have kept those of a place twice, one after the other.
    """
    repeats, requests, values = (rows[name] for name in _COLUMNS)
    order = np.lexsort((requests, repeats))  # stable
    places = np.column_stack([repeats, requests])[order].astype(int)
    known, first = np.unique(places, axis=0, return_index=True)
    parts = np.split(values[order].astype(float), first[1:])
    return {(r, k): part for (r, k), part in zip(known.tolist(), parts[: len(known)], strict=True)}
