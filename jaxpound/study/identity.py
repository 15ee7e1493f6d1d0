"""Objects in words: what a study was made of, as JSON, so that two studies can be told apart."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Mapping
from typing import Any

import jax
import numpy as np

_SHOWN = 16  # entries of an array that are written out


def describe(thing: Any) -> Any:
    """A tree of JSON that says what an object holds; of a large array, its checksum."""
    if thing is None or isinstance(thing, bool | int | float | str):
        return thing
    if isinstance(thing, np.ndarray | np.generic | jax.Array):
        array = np.asarray(thing)
        if array.size <= _SHOWN:
            return array.tolist()
        return {
            "shape": list(array.shape),
            "type": str(array.dtype),
            "sha256": digest(array.tobytes()),
        }
    if isinstance(thing, Mapping):
        return {str(key): describe(value) for key, value in thing.items()}
    if isinstance(thing, list | tuple):
        return [describe(value) for value in thing]
    if dataclasses.is_dataclass(thing) and not isinstance(thing, type):
        fields = {f.name: describe(getattr(thing, f.name)) for f in dataclasses.fields(thing)}
        return {"type": type(thing).__name__, **fields}
    if hasattr(thing, "__qualname__"):
        return f"{thing.__module__}.{thing.__qualname__}"
    return type(thing).__name__


def digest(data: bytes) -> str:
    """SHA-256 in hexadecimal."""
    return hashlib.sha256(data).hexdigest()
