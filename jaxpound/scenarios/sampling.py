"""Points of a Monte Carlo study: independent standard normal numbers by the sample's index.

The point of index i depends on key, dimension and i alone, not on chunks, devices or processes.
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

from jaxpound._checks import is_whole, require_one_of, seed
from jaxpound._errors import InvalidInput

Points = Callable[[int, int], np.ndarray]  # points start to stop − 1, shape (stop − start, d)

_BITS = 30  # of a Sobol point's coordinate
SAMPLINGS = {"plain": 2**31, "sobol": 2**30}  # kinds of points, and the largest number of each


def require_sampling(sampling: Any) -> int:
    """Largest number of points; an ``InvalidInput`` for an unknown kind of sampling."""
    require_one_of(sampling, [*SAMPLINGS], "sampling")
    return SAMPLINGS[sampling]


def key_numbers(key: Any) -> tuple[str, tuple[int, ...]]:
    """Kind and numbers of a key or a seed, for JSON."""
    if is_whole(key):
        key = jax.random.key(seed("key", key), impl="threefry2x32")
    typed = isinstance(key, jax.Array) and jnp.issubdtype(key.dtype, jax.dtypes.prng_key)
    if isinstance(key, jax.Array) and key.dtype == np.uint32 and key.shape in ((2,), (4,)):
        key, typed = jax.random.wrap_key_data(key), True
    if not typed or key.shape:
        raise InvalidInput("key", repr(key), "must be a whole number or a key of jax.random")
    if (kind := str(jax.random.key_impl(key))) != "threefry2x32":
        rule = "must be of kind threefry2x32: of others, draws depend on the batch they are in"
        raise InvalidInput("key", "", f"of kind {kind} {rule}")
    return kind, tuple(np.asarray(jax.random.key_data(key)).ravel().tolist())


def as_key(kind: str, numbers: tuple[int, ...]) -> jax.Array:
    """The key of this kind and these numbers: the inverse of ``key_numbers``."""
    return jax.random.wrap_key_data(jnp.asarray(numbers, jnp.uint32), impl=kind)


def points(sampling: str, key: jax.Array, dimension: int) -> Points:
    """The points of a study, of a dimension, by a threefry key.

    "plain": independent draws, with the index folded into the key. "sobol": Sobol points scrambled
    by a random linear matrix and a digital shift (scipy's), in order; earlier ones after a reset.
    """
    if sampling == "plain":

        def plain(start: int, stop: int) -> np.ndarray:
            size = 1 << (stop - start - 1).bit_length()  # few sizes, as each is compiled
            indices = np.arange(start, start + size, dtype=np.uint32)
            return np.asarray(_normals(key, indices, dimension))[: stop - start]

        return plain

    from scipy.special import ndtri  # only here: these imports take a second
    from scipy.stats import qmc

    rng = np.random.default_rng(np.asarray(jax.random.key_data(key)).ravel().tolist())
    engine, lock = qmc.Sobol(dimension, scramble=True, bits=_BITS, rng=rng), Lock()

    def sobol(start: int, stop: int) -> np.ndarray:
        with lock, warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # chunks need not be a power of 2
            if start < engine.num_generated:
                engine.reset()
            if start > engine.num_generated:
                engine.fast_forward(start - engine.num_generated)
            shares = engine.random(stop - start)
        # The points are corners of cells; the centres of cells keep all normal numbers finite.
        return ndtri(shares + 0.5 ** (_BITS + 1)).astype(jax.dtypes.canonicalize_dtype(float))

    return sobol


@partial(jax.jit, static_argnames="dimension")
def _normals(key: jax.Array, indices: Any, dimension: int) -> jax.Array:
    def normal(i: jax.Array) -> jax.Array:
        return jax.random.normal(jax.random.fold_in(key, i), (dimension,), float)

    return jax.vmap(normal)(indices)
