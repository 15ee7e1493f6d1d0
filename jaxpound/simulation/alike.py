"""A function of many arguments of few kinds, which is compiled once for each kind."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp


def by_kind(trees: Sequence[Any]) -> list[list[int]]:
    """The places of pytrees, those of the same structure and shapes together.

    Values of leaves are not compared; keys of dictionaries are part of the structure.
    """
    kinds: dict[Any, list[int]] = {}
    for n, tree in enumerate(trees):
        shapes = tuple(map(jnp.shape, jax.tree.leaves(tree)))
        kinds.setdefault((jax.tree.structure(tree), shapes), []).append(n)
    return [*kinds.values()]


def stacked(trees: Sequence[Any]) -> Any:
    """Pytrees of the same structure and shapes as one, with a leading axis."""
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *trees)


def unstacked(tree: Any) -> list[Any]:
    """The pytrees of which one is ``stacked``."""
    leaves, structure = jax.tree.flatten(tree)
    # A single one without slices, which would lengthen the program.
    apart = ([y.squeeze(0)] if len(y) == 1 else jnp.unstack(y) for y in leaves)
    return [jax.tree.unflatten(structure, row) for row in zip(*apart, strict=True)]


def map_alike(
    function: Callable[..., Any], arguments: Sequence[tuple[Any, ...]], together: bool
) -> list[Any]:
    """A function of each tuple of arguments; ``together`` by ``vmap`` of those that are alike."""
    if not together:
        return [function(*args) for args in arguments]
    results: list[Any] = [None] * len(arguments)
    for places in by_kind(arguments):
        if len(places) == 1:
            of_kind = [function(*arguments[places[0]])]
        else:
            of_kind = unstacked(jax.vmap(function)(*stacked([arguments[n] for n in places])))
        for n, result in zip(places, of_kind, strict=True):
            results[n] = result
    return results
