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


def in_array(numbers: Sequence[Any]) -> jax.Array:
    """Numbers as an array, (n,).

    Not by ``stack``: a batch of it lies along its last axis, so that a step, whose state has other
    axes than its result then, is traced and compiled twice.
    """
    return jnp.concatenate([jnp.expand_dims(x, 0) for x in numbers])


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
    kinds = by_kind(arguments) if together else [[n] for n in range(len(arguments))]
    results = dict[int, Any]()
    for places in kinds:
        of_kind = [arguments[n] for n in places]
        if len(places) == 1:
            results[places[0]] = function(*of_kind[0])
        else:
            results |= zip(places, unstacked(jax.vmap(function)(*stacked(of_kind))), strict=True)
    return [results[n] for n in range(len(arguments))]
