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
import jax.numpy as jnp
import numpy as np

from jaxpound._checks import is_whole

Points = Callable[[int, int], np.ndarray]
"""A function of start and stop: points start to stop − 1, shape (stop − start, d)."""

SAMPLINGS = {"plain": 2**31, "sobol": 2**30}
"""Kinds of points, and how many there are at most."""


def require_sampling(owner: str, sampling: Any) -> int:
    """Largest number of points; a ``ValueError`` for an unknown kind of sampling."""
    if sampling not in SAMPLINGS:
        raise ValueError(f"{owner}: sampling = {sampling!r} must be 'plain' or 'sobol'")
    return SAMPLINGS[sampling]


def key_numbers(owner: str, key: Any) -> tuple[str, tuple[int, ...]]:
    """Kind and numbers of a key or a seed, which JSON can hold."""
    if is_whole(key):
        if not 0 <= key < 2**32:
            raise ValueError(f"{owner}: key = {key} must be from 0 to 2^32 − 1")
        key = jax.random.key(int(key), impl="threefry2x32")
    typed = isinstance(key, jax.Array) and jnp.issubdtype(key.dtype, jax.dtypes.prng_key)
    if isinstance(key, jax.Array) and key.dtype == np.uint32 and key.shape in ((2,), (4,)):
        key, typed = jax.random.wrap_key_data(key), True
    if not typed or key.shape:
        raise ValueError(f"{owner}: key = {key!r} must be a whole number or a key of jax.random")
    kind = str(jax.random.key_impl(key))
    if kind != "threefry2x32":
        rule = "of kind threefry2x32: of others, draws depend on the batch they are in"
        raise ValueError(f"{owner}: key of kind {kind} must be {rule}")
    return kind, tuple(np.asarray(jax.random.key_data(key)).ravel().tolist())


def as_key(kind: str, numbers: tuple[int, ...]) -> jax.Array:
    """The key with these kind and numbers: the inverse of ``key_numbers``."""
    return jax.random.wrap_key_data(jnp.asarray(numbers, jnp.uint32), impl=kind)


def points(sampling: str, key: jax.Array, dimension: int) -> Points:
    """The points of a study.

    Parameters
    ----------
    sampling
        "plain": independent draws, with the index folded into the key. "sobol": Sobol points
        scrambled by a random linear matrix and a digital shift (scipy's), at most 2^30; best if
        their number is a power of 2.
    key
        A threefry key of ``jax.random``: with other kinds, draws under ``vmap`` depend on the
        batch.
    dimension
        Length d of each point.
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
    """Scrambled Sobol points as normals; going on from the last call, or back at the start."""

    def __init__(self, key: jax.Array, dimension: int) -> None:
        from scipy.stats import qmc  # only here: it takes a second to import

        seed = np.random.default_rng(np.asarray(jax.random.key_data(key)).ravel().tolist())
        self.lock = Lock()
        self.engine = qmc.Sobol(dimension, scramble=True, bits=_BITS, rng=seed)

    def __call__(self, start: int, stop: int) -> np.ndarray:
        from scipy.special import ndtri  # only here: it takes as long to import as jaxpound

        with self.lock:
            shares = self.shares(start, stop)
        # The points are corners of cells; at the centre of a cell no normal number is infinite.
        return ndtri(shares + 0.5 ** (_BITS + 1)).astype(jax.dtypes.canonicalize_dtype(float))

    def shares(self, start: int, stop: int) -> np.ndarray:
        """The points as probabilities, from 0 to 1."""
        if start < self.engine.num_generated:
            self.engine.reset()
        if start > self.engine.num_generated:
            self.engine.fast_forward(start - self.engine.num_generated)
        with warnings.catch_warnings():  # ignore: the first chunk is no power of 2
            warnings.simplefilter("ignore", UserWarning)
            return self.engine.random(stop - start)


_BITS = 30
