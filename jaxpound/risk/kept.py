"""The files of a search: its design points and its batches, so that a stopped one goes on.

A folder as of ``monte_carlo``: a manifest that says which search it is, and one archive a batch of
samples, written whole or not at all. Samples themselves are drawn again, by their numbers.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxpound.risk.design_points import DesignPoints
from jaxpound.risk.ledger import identity
from jaxpound.risk.limit_state import LimitState
from jaxpound.study.archives import DamagedError, digest, opened, write_archive
from jaxpound.study.sampling import key_numbers
from jaxpound.study.store import Store, describe

COLUMNS = ("values", "times")
_POINTS = "design-points.npz"
_VECTORS, _NUMBERS = ("z", "directions"), ("instants", "series")


def of_limit_state(state: LimitState, key: Any) -> tuple[Any, dict[str, Any]]:
    """The program of a limit state, and what else determines a search, for ``identity``."""
    kind, numbers = key_numbers("rare_event", key)
    described = {
        "key": {"kind": kind, "numbers": list(numbers)},
        "demand": describe(state.demand),
        "threshold": describe(state.threshold),
        "changes": describe(state.changes),
        "scenarios": describe(state.scenarios),
        "grid": describe(state.grid),
        "scheme": describe(state.scheme),
    }
    return (lambda z: state.observed(z, state.changes), (jnp.zeros(state.dimension),)), described


_BEFORE = 2  # plain batches that a search may make of stronger motions, however few runs follow


class Kept:
    """The folder of a search, new or to be continued.

    Parameters
    ----------
    folder
        Made if it does not exist.
    state
        The limit state.
    key
        As ``rare_event``.
    start
        Design points from which the search starts; None or an array.
    batch
        Samples of a batch.
    most
        Runs at most; a later search may ask for more.

    Raises
    ------
    ValueError
        If the folder holds something else, or another search: the message says what differs.
    OSError
        If the folder cannot be made or written to.
    """

    def __init__(
        self,
        folder: str | os.PathLike[str],
        state: LimitState,
        key: Any,
        start: np.ndarray | None,
        batch: int,
        most: int,
    ) -> None:
        program, described = of_limit_state(state, key)
        self._type = jnp.zeros(()).dtype
        start = describe(start)
        known = identity(
            "a search by design points", COLUMNS, batch, program, **described, start=start
        )
        # Plain batches have even numbers, those around design points odd ones.
        samples = 2 * batch * (max(-(-most // batch), _BEFORE) + 1)
        self._store = Store.create(folder, known, samples, {"notes": known["search"]})
        self._seal: dict[str, Any] = {"study": digest(repr(sorted(known.items())).encode())}

    def batch(
        self, number: int, *, plain: bool, run: Callable[[], tuple[np.ndarray, np.ndarray]]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Values and times of a batch: from its file, or of ``run``, which are then written."""
        chunk = 2 * number + (not plain)
        try:
            held = self._store.read(chunk)
        except DamagedError as error:
            self._tell(error)
            held = None
        if held is None:
            values, times = run()
            whole = {"values": values, "times": times}
            held = {name: np.asarray(x, self._type) for name, x in whole.items()}
            self._store.write(chunk, held)
        return held["values"], held["times"]

    def design_points(self, search: Callable[[], DesignPoints]) -> DesignPoints:
        """The design points: from their file, or of ``search``, which are then written."""
        path = self._store.folder / _POINTS
        try:
            with opened(path) as archive:
                about = archive.about
                if about["study"] != self._seal["study"]:
                    raise DamagedError("of another search")
                if "covered" not in about:
                    raise DamagedError("of an older version, which counted no points again")
                k, d = about["shape"]
                z, directions = (archive.read(name, (k, d), np.float64) for name in _VECTORS)
                return DesignPoints(
                    z=z,
                    directions=directions,
                    betas=archive.read("betas", (k,), np.float64),
                    instants=archive.read("instants", (k,), np.int64),
                    series=archive.read("series", (k,), np.int64),
                    gradients=about["gradients"],
                    failed=about["failed"],
                    covered=about["covered"],
                )
        except DamagedError as error:
            self._tell(DamagedError(f"{_POINTS} is damaged ({error})"))
            found = search()
        except FileNotFoundError:
            found = search()
        arrays = {name: np.asarray(getattr(found, name), float) for name in (*_VECTORS, "betas")}
        arrays |= {name: np.asarray(getattr(found, name), np.int64) for name in _NUMBERS}
        numbers = ("gradients", "failed", "covered")
        about = {name: getattr(found, name) for name in numbers} | {"shape": list(found.z.shape)}
        write_archive(path, arrays, self._seal | about)
        return found

    def _tell(self, damage: DamagedError) -> None:
        """Warn of a damaged file."""
        warnings.warn(f"store {self._store.folder}: {damage}; it is made anew", stacklevel=3)
