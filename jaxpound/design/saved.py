"""A search on disk: its state and all that it met, in one file."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound.design.search import Given, Point, Search, State
from jaxpound.study.archives import (
    Archive,
    DamagedError,
    digest,
    opened,
    sweep_parts,
    write_archive,
)
from jaxpound.study.store import describe


class Met(NamedTuple):
    """Where all starts were at an iteration, with a leading axis of starts."""

    shares: np.ndarray
    objective: np.ndarray
    violation: np.ndarray
    prices: np.ndarray
    alive: np.ndarray
    infeasible: np.ndarray  # the best so far
    merit: np.ndarray

    @staticmethod
    def at(here: Point, alive: Any, best: Point) -> Met:
        """Of where all starts are, and the best of each so far."""
        return Met(
            here.shares,
            here.objective,
            here.violation,
            here.prices,
            alive,
            best.infeasible,
            best.merit,
        )


class SavedSearch:
    """A file with the state of a search."""

    def __init__(self, path: Path, identity: dict[str, Any]) -> None:
        self.path, self.identity = path, json.loads(json.dumps(identity))

    def read(self, state: State) -> tuple[State, list[Met]]:
        """The state and what was met, or the state given where there is no file.

        Raises
        ------
        ValueError
            If the file holds something else or is damaged, or no file of arrays can hold such a
            state.
        """
        for leaf in jax.tree.leaves(state):
            if jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key):
                raise ValueError("save cannot keep an optimiser that draws at random")
        with contextlib.suppress(OSError):
            sweep_parts(self.path.parent, self.path.name)
        try:
            with opened(self.path) as archive:
                return self._held(archive, state)
        except FileNotFoundError:
            return state, []
        except DamagedError as error:
            rule = f"holds no search, or a damaged one ({error})"
            raise ValueError(f"save = {self.path} {rule}; move it away to begin anew") from error

    def _held(self, archive: Archive, state: State) -> tuple[State, list[Met]]:
        theirs = archive.about
        if not (isinstance(theirs, dict) and theirs.keys() == self.identity.keys()):
            raise DamagedError("it does not say which search it holds")
        if other := [name for name, x in theirs.items() if self.identity[name] != x]:
            raise ValueError(f"save = {self.path} holds another search: {', '.join(other)} differs")
        leaves, structure = jax.tree.flatten(state)
        held = [
            jnp.asarray(archive.read(f"state_{i}", leaf.shape, leaf.dtype))
            for i, leaf in enumerate(leaves)
        ]
        (n,) = archive.read("iterations", (1,), np.int64).tolist()
        like = zip(Met._fields, Met.at(state.best, state.alive, state.best), strict=True)
        met = [archive.read(name, (n, *x.shape), x.dtype) for name, x in like]
        return jax.tree.unflatten(structure, held), [Met(*rows) for rows in zip(*met, strict=True)]

    def write(self, state: State, met: Sequence[Met]) -> None:
        """Put state and history in the place of what the file held."""
        leaves = {f"state_{i}": np.asarray(x) for i, x in enumerate(jax.tree.leaves(state))}
        rows = {name: np.array([getattr(one, name) for one in met]) for name in Met._fields}
        counted = {"iterations": np.array([len(met)], np.int64)}
        write_archive(self.path, leaves | rows | counted, self.identity)


def search_identity(move: Search, text: str, given: Given, begun: np.ndarray) -> dict[str, Any]:
    """What determines every number of a search."""
    told = {name: np.asarray(getattr(given, name)).tolist() for name in ("limits", "tolerance")}
    leaves = jax.tree.leaves((given.grounds, given.uncertain))
    return {
        "space": describe(move.space),
        "setting": describe(move.setting),
        "objective": describe(move.objective),
        **told,
        "key": np.asarray(jax.random.key_data(given.key)).tolist(),
        "ensemble": [digest(np.asarray(x).tobytes()) for x in leaves],
        "starts": digest(begun.tobytes()),
        "program": digest(text.encode()),
    }
