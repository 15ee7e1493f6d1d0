"""Parameters of structures by path: ``friction``, ``rod_1.tau_x``, ``rods.3.material.tau_x``.

A path names a field that is a ``parameter``, through any nesting of objects and tuples. That field
holds the parameter's metadata, such as its admissible values (see ``_fields``). In a pattern ``*``
stands for any number or name in its place: ``buildings.0.rods.*.stiffness``.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import reduce
from typing import Any, TypeVar

from jaxpound._checks import hint
from jaxpound._extrema import smaller
from jaxpound._fields import Parameter, walk

T = TypeVar("T")
X = TypeVar("X")

SMALLEST = 1e-30
"""The smallest value of a positive parameter: single precision does not round it to zero."""


def paths(structures: Any) -> tuple[str, ...]:
    """Paths of all parameters; the same parameter of several objects is listed together.

    A parameter that bounds another comes before it (τ_f before τ_x): in this order they can be
    drawn or chosen one after the other. ``structures`` may be a class without tuples, which does
    not know of parts that may be missing, such as a contact law.
    """
    alike: dict[Parameter, list[str]] = {}
    for path, parameter, _ in walk(structures, Parameter):
        alike.setdefault(parameter, []).append(path)
    return tuple(path for group in alike.values() for path in group)


def known(structures: Any, path: str) -> Parameter:
    """Symbol, kind, words and rule of a parameter; ``structures`` may be a class.

    Raises
    ------
    ValueError
        If there is no such parameter; so do all functions of this module.
    """
    return _found(_table(structures), path)[0]


def name(structures: Any, path: str, *, symbols: bool = True) -> str:
    r"""Name of a parameter in a figure: ``friction $\mu$``, ``rod 1: $\bar\tau_x$``.

    Without ``symbols``, which stand for dimensionless numbers, ``link 1: friction``. ``structures``
    may be a class.
    """
    parameter = known(structures, path)
    owner, field, index = _split(path)
    words = parameter.words or field.replace("_", " ")
    symbol = f"${parameter.symbol}$" if parameter.symbol and symbols else ""
    if owner:
        where = f"{owner}.{field}.{index}" if index else owner
        return f"{in_words(where)}: {symbol or words}"
    number = str(int(index) + 1) if index else ""
    return " ".join(filter(None, (words, number, symbol)))


def in_words(path: str) -> str:
    """What a path leads to in words, numbered from 1: ``building 1, storey 2``."""
    words: list[str] = []
    one_of = _OF_BUILDINGS if path.startswith("buildings.") else _OF_SYSTEMS
    for part in path.split("."):
        if part.isdigit() and words:
            words[-1] = f"{one_of.get(words[-1], words[-1])} {int(part) + 1}"
        elif part != "material":
            words.append(part.replace("_", " "))
    return ", ".join(words)


_OF_SYSTEMS = {"rods": "rod", "masses": "mass", "links": "link"}
_OF_BUILDINGS = {"buildings": "building", "rods": "storey", "masses": "floor"}


def get(structures: Any, path: str) -> Any:
    """Value of a parameter."""
    return _found(_table(structures), path, "get")[1]


def put(structures: T, values: Mapping[str, Any]) -> T:
    """Structures with the given parameters replaced; their rules are checked.

    All values are put at once, so that their order does not matter.
    """
    require_paths("put", structures, values)
    return _rebuilt(structures, {tuple(path.split(".")): x for path, x in values.items()})


def lower(structures: Any, path: str) -> str | None:
    """Path of the parameter that bounds this one from below: τ_f of the same rod for τ_x."""
    return _lower(_found(_table(structures), path)[0], path)


def interval(
    structures: Any, path: str, others: Mapping[str, Any] | None = None
) -> tuple[Any, Any]:
    """Smallest and largest value that a parameter may have, given the others.

    Parameters
    ----------
    structures
        The structures, with known or traced parameters.
    path
        The parameter.
    others
        Values of some of the others in the place of those in ``structures``; None for one that is
        not known yet and does not bound this one.
    """
    table, others = _table(structures), others or {}
    parameter, _ = _found(table, path)
    values = {other: others.get(other, x) for other, (_, x) in table.items()}
    bound = _lower(parameter, path)
    if bound is None:
        least = -math.inf if parameter.least is None else parameter.least
        low = float(least) if parameter.above is None else SMALLEST
    else:
        low = values[bound]
        low = interval(structures, bound, others)[0] if low is None else low
    highs: list[Any] = [] if parameter.most is None else [float(parameter.most)]
    highs += [
        values[other]
        for other, (one, _) in table.items()
        if _lower(one, other) == path and values[other] is not None
    ]
    return low, reduce(smaller, highs) if highs else math.inf


def expanded(owner: str, structures: Any, given: Mapping[str, X]) -> dict[str, X]:
    """What is given by path or pattern, by path: a pattern stands for all paths that it matches.

    A path that is given itself goes before a pattern that matches it.

    Raises
    ------
    ValueError
        If a path is unknown, a pattern matches none, or two patterns match the same path.
    """
    found: dict[str, X] = {}
    whose: dict[str, str] = {}
    for key, value in given.items():
        for path in [key] if "*" not in key else _matches(owner, structures, key):
            if path != key and path in given:
                continue
            if path in found:
                raise ValueError(f"{owner}: {whose[path]!r} and {key!r} must not both match {path}")
            found[path], whose[path] = value, key
    require_paths(owner, structures, found)
    return found


def _matches(owner: str, structures: Any, pattern: str) -> list[str]:
    """The paths that a pattern matches, one or more."""
    every = paths(structures)
    fits = re.compile(re.escape(pattern).replace(r"\*", "[^.]*"))
    if matched := [path for path in every if fits.fullmatch(path)]:
        return matched
    general = dict.fromkeys(re.sub(r"\.\d+\b", ".*", path) for path in every)
    raise ValueError(f"{owner}: no path matches {pattern!r}; {_hint(pattern, general)}")


def _table(structures: Any) -> dict[str, tuple[Parameter, Any]]:
    """Metadata and value of each parameter, by path."""
    return {path: (parameter, x) for path, parameter, x in walk(structures, Parameter)}


def require_paths(owner: str, structures: Any, given: Iterable[str]) -> None:
    """A ``ValueError`` for a path that names no parameter."""
    table = _table(structures)
    for path in given:
        _found(table, path, owner)


def _found(
    table: Mapping[str, tuple[Parameter, Any]], path: str, owner: str = "parameters"
) -> tuple[Parameter, Any]:
    """The entry of a path; for a class ``*`` stands for any index."""
    if not isinstance(path, str):
        raise ValueError(f"{owner}: path = {path!r} must be the name of a parameter")
    for there in (path, re.sub(r"\.\d+\b", ".*", path)):
        if there in table:
            return table[there]
    raise ValueError(f"{owner}: unknown path {path!r}; {_hint(path, table)}")


def _hint(path: str, known: Iterable[str]) -> str:
    """What was meant by an unknown path, or why there is no such parameter."""
    known, of_contact = list(known), re.compile(r"(?:.*\.)?contact\..*")
    if of_contact.fullmatch(path) and not any(map(of_contact.fullmatch, known)):
        return "links have no contact"
    return hint(path, known)


def _lower(parameter: Parameter, path: str) -> str | None:
    bound = parameter.low
    return ".".join(filter(None, (_split(path)[0], bound))) if isinstance(bound, str) else None


def _split(path: str) -> tuple[str, str, str]:
    """The object's path, the field's name, and the index in it if the field is a tuple."""
    match = re.fullmatch(r"(?:(.+)\.)?([^.\d][^.]*)(?:\.(\d+))?", path)
    assert match is not None
    return match[1] or "", match[2], match[3] or ""


def _rebuilt(node: Any, values: Mapping[Sequence[str], Any]) -> Any:
    """An object, tuple or number with new values in it, keyed by the rest of their paths."""
    if () in values:
        return values[()]
    below: dict[str, dict[Sequence[str], Any]] = {}
    for (first, *rest), value in values.items():
        below.setdefault(first, {})[tuple(rest)] = value
    if isinstance(node, tuple | list):
        return type(node)(
            _rebuilt(item, below[str(i)]) if str(i) in below else item
            for i, item in enumerate(node)
        )
    changed = {field: _rebuilt(getattr(node, field), rest) for field, rest in below.items()}
    return dataclasses.replace(node, **changed)
