"""Parameters of structures by path: ``friction``, ``rod_1.tau_x``, ``rods.3.material.tau_x``.

A path names a ``parameter`` field (see ``_fields``) through any nesting of objects and tuples. In a
pattern ``*`` stands for any number or name: ``buildings.0.rods.*.stiffness``.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import reduce
from typing import Any, TypeVar

from jaxpound._checks import hint
from jaxpound._errors import InvalidInput
from jaxpound._extrema import smaller
from jaxpound._fields import Parameter, walk
from jaxpound.model.topology import faces

T = TypeVar("T")
X = TypeVar("X")

SMALLEST = 1e-30
"""The smallest value of a positive parameter: single precision does not round it to zero."""


def paths(structures: Any) -> tuple[str, ...]:
    """Paths of all parameters, those of the same parameter of several objects together.

    A parameter that bounds another comes before it (τ_f before τ_x), so that they can be drawn in
    this order. ``structures`` may be a class without tuples, whose optional parts are left out.
    """
    groups: dict[Parameter, list[str]] = {}
    for path, parameter, _ in walk(structures, Parameter):
        groups.setdefault(parameter, []).append(path)
    return tuple(path for group in groups.values() for path in group)


def metadata(structures: Any, path: str) -> Parameter:
    """Symbol, kind, words and rule of a parameter; ``structures`` may be a class.

    This and all functions of this module raise an ``InvalidInput`` for an unknown path.
    """
    return _lookup(_table(structures), path)[0]


def name(structures: Any, path: str, *, symbols: bool = True) -> str:
    r"""Name of a parameter in a figure: ``friction $\mu$``, ``rod 1: $\bar\tau_x$``.

    Without ``symbols``, which stand for dimensionless numbers, ``link 1: friction``. ``structures``
    may be a class.
    """
    parameter = metadata(structures, path)
    owner, field, index = _split(path)
    words = parameter.words or field.replace("_", " ")
    symbol = f"${parameter.symbol}$" if parameter.symbol and symbols else ""
    if owner:
        return f"{in_words(path if index else owner)}: {symbol or words}"
    number = str(int(index) + 1) if index else ""
    return " ".join(filter(None, (words, number, symbol)))


def in_words(path: str) -> str:
    """The object of a path in words, numbered from 1: ``building 1, storey 2``."""
    words: list[str] = []
    singular = _OF_BUILDINGS if path.startswith("buildings.") else _OF_SYSTEMS
    for part in path.split("."):
        if part.isdigit() and words:
            words[-1] = f"{singular.get(words[-1], words[-1])} {int(part) + 1}"
        elif part not in ("material", "hysteresis", "zener"):
            words.append(part.replace("_", " "))
    return ", ".join(words)


_OF_SYSTEMS = {"rods": "rod", "masses": "mass", "links": "link"}
_OF_BUILDINGS = {"buildings": "building", "rods": "storey", "masses": "floor", "storeys": "storey"}


def get(structures: Any, path: str) -> Any:
    """Value of a parameter."""
    return _lookup(_table(structures), path)[1]


def put(structures: T, values: Mapping[str, Any]) -> T:
    """Structures with these parameters replaced, all at once; their rules are checked."""
    require_paths(structures, values)
    return replaced(structures, values)


def replaced(structures: T, values: Mapping[str, Any]) -> T:
    """``put`` of paths that are known to be those of parameters."""
    return _rebuilt(structures, {tuple(path.split(".")): x for path, x in values.items()})


def lower(structures: Any, path: str) -> str | None:
    """Path of the parameter that is the lower bound: τ_f of the same rod for τ_x."""
    return _lower(_lookup(_table(structures), path)[0], path)


def interval(
    structures: Any, path: str, others: Mapping[str, Any] | None = None
) -> tuple[Any, Any]:
    """Smallest and largest admissible value of a parameter beside the values of the others.

    ``others`` replaces values of ``structures``, by path; None stands for an undecided parameter,
    which bounds no other.
    """
    table, others = _table(structures), others or {}
    parameter, _ = _lookup(table, path)
    values = {other: others.get(other, x) for other, (_, x) in table.items()}
    if (bound := _lower(parameter, path)) is not None:
        low = values[bound]
        low = interval(structures, bound, others)[0] if low is None else low
    else:
        least = -math.inf if parameter.least is None else parameter.least
        low = float(least) if parameter.above is None else SMALLEST
    bounded = [values[other] for other, (x, _) in table.items() if _lower(x, other) == path]
    highs = [x for x in (parameter.most and float(parameter.most), *bounded) if x is not None]
    return low, reduce(smaller, highs) if highs else math.inf


def expanded(structures: Any, by_pattern: Mapping[str, X]) -> dict[str, X]:
    """Values by path, from values by path or pattern; a path takes precedence over patterns.

    Each pattern must match a path, and no path two patterns. The left faces of links of two faces
    have no friction, and patterns leave it out.
    """
    frictionless = {f"links.{k}.friction" for k in faces(structures.system().topology)}
    values, sources = dict[str, X](), dict[str, str]()
    for key, value in by_pattern.items():
        matched = [key]
        if "*" in key:
            fits = re.compile(re.escape(key).replace(r"\*", "[^.]*"))
            matched = [x for x in paths(structures) if fits.fullmatch(x) and x not in frictionless]
        if not matched:
            general = dict.fromkeys(re.sub(r"\.\d+\b", ".*", path) for path in paths(structures))
            raise InvalidInput("", "", f"no path matches {key!r}; {_hint(key, general)}")
        for path in matched:
            if path != key and path in by_pattern:
                continue
            if path in values:
                patterns = f"{sources[path]!r} and {key!r}"
                raise InvalidInput(patterns, "", f"must not both match {path}")
            values[path], sources[path] = value, key
    require_paths(structures, values)
    return values


def _table(structures: Any) -> dict[str, tuple[Parameter, Any]]:
    """Metadata and value of each parameter, by path."""
    return {path: (parameter, x) for path, parameter, x in walk(structures, Parameter)}


def require_paths(structures: Any, names: Iterable[str]) -> None:
    """An ``InvalidInput`` for a path that names no parameter."""
    table = _table(structures)
    for path in names:
        _lookup(table, path)


def _lookup(table: Mapping[str, tuple[Parameter, Any]], path: str) -> tuple[Parameter, Any]:
    """The entry of a path; for a class ``*`` stands for any index."""
    if not isinstance(path, str):
        raise InvalidInput("path", repr(path), "must be the name of a parameter")
    for key in (path, re.sub(r"\.\d+\b", ".*", path)):
        if key in table:
            return table[key]
    raise InvalidInput("", "", f"unknown path {path!r}; {_hint(path, table)}")


def _hint(path: str, available: Iterable[str]) -> str:
    """The end of a message on an unknown path: the closest path, or why there is none."""
    available, of_contact = list(available), re.compile(r"(?:.*\.)?contact\..*")
    if of_contact.fullmatch(path) and not any(map(of_contact.fullmatch, available)):
        return "links have no contact"
    return hint(path, available)


def _lower(parameter: Parameter, path: str) -> str | None:
    bound = parameter.low
    return ".".join(filter(None, (_split(path)[0], bound))) if isinstance(bound, str) else None


def _split(path: str) -> tuple[str, str, str]:
    """The object's path, the field's name, and the index in it if the field is a tuple."""
    match = re.fullmatch(r"(?:(.+)\.)?([^.\d][^.]*)(?:\.(\d+))?", path)
    assert match is not None
    return match[1] or "", match[2], match[3] or ""


def _rebuilt(node: Any, values: Mapping[Sequence[str], Any]) -> Any:
    """An object, tuple or number with new values, keyed by their paths below it."""
    if () in values:
        return values[()]
    below: dict[str, dict[Sequence[str], Any]] = {}
    for (first, *tail), value in values.items():
        below.setdefault(first, {})[tuple(tail)] = value
    if isinstance(node, tuple | list):
        items = (_rebuilt(x, below[str(i)]) if str(i) in below else x for i, x in enumerate(node))
        return type(node)(items)
    changed = {field: _rebuilt(getattr(node, field), tail) for field, tail in below.items()}
    return dataclasses.replace(node, **changed)
