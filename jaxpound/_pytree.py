"""Frozen dataclasses that JAX can trace, batch and differentiate."""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar, dataclass_transform

from jax.tree_util import GetAttrKey, register_pytree_with_keys

T = TypeVar("T")

_ROLE = "jaxpound_role"


def static(**kwargs: Any) -> Any:
    """A field that shapes the compiled program: hashed, never traced."""
    return dataclasses.field(metadata={_ROLE: "static"}, **kwargs)


def label(*, default: Any) -> Any:
    """A field for people: transformations drop it, so that it never causes a recompilation."""
    return dataclasses.field(default=default, metadata={_ROLE: "label"}, compare=False)


@dataclass_transform(frozen_default=True, eq_default=False, field_specifiers=(static, label))
def pytree_dataclass(cls: type[T]) -> type[T]:
    """Make ``cls`` a frozen dataclass and a pytree whose fields are its children.

    JAX rebuilds objects with cotangents, axis numbers or tracers in the place of numbers, and those
    must not be judged as parameters: rebuilding therefore bypasses ``__init__`` and its checks.
    """
    data_cls = dataclasses.dataclass(frozen=True, eq=False)(cls)
    fields = dataclasses.fields(data_cls)  # type: ignore[arg-type]
    data = tuple(f.name for f in fields if _ROLE not in f.metadata)
    statics = tuple(f.name for f in fields if f.metadata.get(_ROLE) == "static")
    labels = {f.name: f.default for f in fields if f.metadata.get(_ROLE) == "label"}

    def flatten_with_keys(obj: T) -> tuple[list[Any], tuple[Any, ...]]:
        children = [(GetAttrKey(name), getattr(obj, name)) for name in data]
        return children, tuple(getattr(obj, name) for name in statics)

    def flatten(obj: T) -> tuple[list[Any], tuple[Any, ...]]:
        return [getattr(obj, name) for name in data], tuple(getattr(obj, name) for name in statics)

    def unflatten(aux: tuple[Any, ...], children: Any) -> T:
        obj = object.__new__(data_cls)
        for name, value in (
            *zip(data, children, strict=True),
            *zip(statics, aux, strict=True),
            *labels.items(),
        ):
            object.__setattr__(obj, name, value)
        return obj

    register_pytree_with_keys(data_cls, flatten_with_keys, unflatten, flatten)
    return data_cls
