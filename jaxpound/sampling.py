"""Points of a Monte Carlo study: independent standard normal numbers by the sample's index.

The point of index i depends on key, dimension and i alone: not on chunks, devices or processes.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import partial
from threading import Lock
from typing import Any

import jax
import numpy as np
from scipy.special import ndtri
from scipy.stats import qmc

Points = Callable[[int, int], np.ndarray]
"""From start and stop to the points of indices start to stop − 1, shape (stop − start, d)."""

SAMPLINGS = {"plain": 2**31, "sobol": 2**30}
"""Kinds of points, and how many there are at most."""


def points(sampling: str, key: jax.Array, dimension: int) -> Points:
    """The points of a study.

    Parameters
    ----------
    sampling
        "plain": independent draws, of the key folded with the index. "sobol": Sobol points
        scrambled by a random linear matrix and a digital shift (scipy's), at most 2^30; best if
        their number is a power of 2.
    key
        A threefry key of ``jax.random``; under ``vmap`` other kinds draw whole batches from one.
    dimension
        Numbers d of each point.
    """
    if sampling == "plain":
        return lambda start, stop: np.asarray(
            _normals(key, np.arange(start, stop, dtype=np.uint32), dimension)
        )
    return _Sobol(key, dimension)


@partial(jax.jit, static_argnames="dimension")
def _normals(key: jax.Array, indices: Any, dimension: int) -> jax.Array:
    def normal(i: jax.Array) -> jax.Array:
        return jax.random.normal(jax.random.fold_in(key, i), (dimension,), float)

    return jax.vmap(normal)(indices)


class _Sobol:
    """Scrambled Sobol points as normals; forward from where it stands, else from the start."""

    def __init__(self, key: jax.Array, dimension: int) -> None:
        seed = np.random.default_rng(np.asarray(jax.random.key_data(key)).ravel().tolist())
        self.lock = Lock()
        self.engine = qmc.Sobol(dimension, scramble=True, bits=_BITS, rng=seed)

    def __call__(self, start: int, stop: int) -> np.ndarray:
        with self.lock:
            shares = self.shares(start, stop)
        # The points are corners of cells; in the middle of a cell no normal number is infinite.
        return ndtri(shares + 0.5 ** (_BITS + 1)).astype(jax.dtypes.canonicalize_dtype(float))

    def shares(self, start: int, stop: int) -> np.ndarray:
        """The points as shares of probability, from 0 to 1."""
        if start < self.engine.num_generated:
            self.engine.reset()
        if start > self.engine.num_generated:
            self.engine.fast_forward(start - self.engine.num_generated)
        with warnings.catch_warnings():  # that the first chunk is no power of 2
            warnings.simplefilter("ignore", UserWarning)
            return self.engine.random(stop - start)


_BITS = 30
