"""One program for parts of a system that are alike."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp


def for_each(function: Callable[..., Any], given: Sequence[Any]) -> list[Any]:
    """A function of each of several tuples of arguments; those that are alike go as a batch.

    Alike are arguments of the same structure and shapes: links between the floors of two
    buildings, say, with contact laws of one kind. Following contact takes seconds to compile, once
    instead of for every link; at run time a batch is as fast.
    """
    kinds: dict[Any, list[int]] = {}
    for n, args in enumerate(given):
        shapes = tuple(jnp.shape(leaf) for leaf in jax.tree.leaves(args))
        kinds.setdefault((jax.tree.structure(args), shapes), []).append(n)
    found: dict[int, Any] = {}
    for alike in kinds.values():
        if len(alike) == 1:
            found[alike[0]] = function(*given[alike[0]])
            continue
        stacked = jax.tree.map(lambda *x: jnp.stack(x), *(given[n] for n in alike))
        together = jax.vmap(function)(*stacked)
        for i, n in enumerate(alike):
            found[n] = jax.tree.map(lambda x, i=i: x[i], together)
    return [found[n] for n in range(len(given))]
