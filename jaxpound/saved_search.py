"""A search on disk: its state and all that it met, in one file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound._describe import describe, digest
from jaxpound.search import Given, Search, State
from jaxpound.store import replace_file


class Met(NamedTuple):
    """Where all starts were at an iteration, with a leading axis of starts."""

    shares: np.ndarray
    objective: np.ndarray
    violation: np.ndarray
    prices: np.ndarray
    alive: np.ndarray
    infeasible: np.ndarray  # the best so far
    merit: np.ndarray


class SavedSearch:
    """A file with the state of a search."""

    def __init__(self, path: Path, identity: dict[str, Any]) -> None:
        self.path, self.identity = path, json.dumps(identity, sort_keys=True)

    def read(self, state: State) -> tuple[State, list[Met]]:
        """The state and what was met, or the state given where there is no file.

        Raises
        ------
        ValueError
            If the file holds something else, or no file of arrays can hold such a state.
        """
        for leaf in jax.tree.leaves(state):
            if jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key):
                raise ValueError("save cannot keep an optimiser that draws at random")
        if not self.path.exists():
            return state, []
        try:
            with np.load(self.path, allow_pickle=False) as file:
                held = dict(file)
            theirs = str(held["identity"])
        except Exception as error:
            raise ValueError(f"save = {self.path} holds no search ({error})") from error
        if theirs != self.identity:
            ours = json.loads(self.identity)
            other = [k for k, x in json.loads(theirs).items() if ours.get(k) != x]
            raise ValueError(f"save = {self.path} holds another search: {', '.join(other)} differs")
        leaves, structure = jax.tree.flatten(state)
        held_leaves = [jnp.asarray(held[f"state_{i}"]) for i in range(len(leaves))]
        state = jax.tree.unflatten(structure, held_leaves)
        met = [Met(*rows) for rows in zip(*(held[name] for name in Met._fields), strict=True)]
        return state, met

    def write(self, state: State, met: Sequence[Met]) -> None:
        """Put state and history in the place of what the file held."""
        leaves = {f"state_{i}": np.asarray(x) for i, x in enumerate(jax.tree.leaves(state))}
        rows = {name: np.array([getattr(one, name) for one in met]) for name in Met._fields}
        replace_file(self.path, {**leaves, **rows, "identity": np.array(self.identity)})


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
