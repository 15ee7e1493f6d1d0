"""Rules for input, stated once and applied twice.

A rule is checked with a ``ValueError`` where the value is known, and becomes a traced flag that
turns every result into NaN where it is not (under ``jit``, ``vmap`` or ``grad``).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np


class Rule(NamedTuple):
    """``holds`` is a boolean (array) of the value's shape; ``says`` completes 'must be ...'."""

    name: str
    value: Any
    holds: Any
    says: str


def is_traced(tree: Any) -> bool:
    """Whether any leaf of ``tree`` is known only when the compiled program runs."""
    return any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(tree))


def real(owner: str, name: str, value: Any) -> Any:
    """``value`` if it is a real number, an array of them, or traced; else a ``ValueError``."""
    if isinstance(value, jax.core.Tracer):
        return value
    try:
        array = np.asarray(value)
    except Exception as error:
        raise ValueError(f"{owner}: {name} = {value!r} is not a number ({error})") from error
    if array.dtype.kind not in "fiu":
        raise ValueError(f"{owner}: {name} = {value!r} must be a real number")
    return value if hasattr(value, "dtype") or np.isscalar(value) else array


def finite(x: Any) -> Any:
    """Elementwise finiteness by comparison, for NumPy and traced values alike."""
    return abs(x) < float("inf")


def enforce(owner: str, rules: Iterable[Rule]) -> None:
    """Raise for the first rule that a known value breaks, naming argument, value and rule."""
    for rule in rules:
        if is_traced((rule.value, rule.holds)):
            continue
        holds = np.asarray(rule.holds)
        if not holds.all():
            raise ValueError(f"{owner}: {rule.name} = {_culprit(rule)} must be {rule.says}")


def all_hold(rules: Iterable[Rule]) -> jax.Array:
    """A traced flag: whether every rule holds for every element."""
    flag = jnp.asarray(True)
    for rule in rules:
        flag = flag & jnp.all(rule.holds)
    return flag


def _culprit(rule: Rule) -> str:
    value = np.asarray(rule.value)
    if value.ndim == 0:
        return f"{value.item():.8g}"
    index = np.unravel_index(np.argmin(np.broadcast_to(rule.holds, value.shape)), value.shape)
    place = ", ".join(str(i) for i in index)
    return f"{value[index]:.8g} (at index [{place}])"
