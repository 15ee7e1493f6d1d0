"""Results by mass, rod and link, and their flat names in tables and scripts.

A result holds tuples, ``masses``, ``rods`` and ``links``. The field of each of their quantities
states its flat name: ``peak_x{}`` of ``MassDemand`` is ``peak_x1`` of the first mass. Names of link
quantities are numbered only where there are several links: ``min_gap``, else ``min_gap_2``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from typing import Any, ClassVar, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound._checks import is_traced
from jaxpound._fields import Quantity, quantities

T = TypeVar("T")

GROUPS = ("masses", "rods", "links")


class Place(NamedTuple):
    """Where a flat name belongs: group ("" for the result itself), element from 0, and field."""

    group: str
    element: int
    field: str
    known: Quantity


class ByElement:
    """A result with ``masses``, ``rods`` and ``links``, whose quantities have flat names too."""

    _elements: ClassVar[dict[str, type]]
    """Class of the elements of each group."""

    def flat(self, field: str) -> dict[str, Any]:
        """A quantity of all elements that have it, by flat name."""
        group, known = _fields_of_elements(type(self))[field]
        items = getattr(self, group)
        return {
            _flat_name(known, i, len(items)): getattr(item, field) for i, item in enumerate(items)
        }

    def columns(self) -> list[tuple[Quantity, list[str]]]:
        """Every quantity and its flat names, in the order of tables."""
        return columns_of(type(self), {group: len(getattr(self, group)) for group in GROUPS})

    def __getattr__(self, name: str) -> Any:
        place = None if name in GROUPS or name[:2] == "__" else place_of(type(self), name)
        if place is None or not place.group:
            message = f"{type(self).__name__!r} object has no attribute {name!r}"
            if hasattr(vars(self).get("demand"), name):
                message += f"; its demand has it: .demand.{name}"
            raise AttributeError(message, name=name, obj=self)
        group, i, field, known = place
        items = getattr(self, group)
        if i < len(items) and _flat_name(known, i, len(items)) == name:
            return getattr(items[i], field)
        rule = f"{group}[i].{field} has it of each of its {len(items)} {group}"
        raise AttributeError(f"{type(self).__name__} has no {name!r}: {rule}", name=name, obj=self)

    def __dir__(self) -> list[str]:
        flat = [name for _, names in self.columns() for name in names]
        return sorted({*super().__dir__(), *flat})


def columns_of(cls: type[ByElement], sizes: Mapping[str, int]) -> list[tuple[Quantity, list[str]]]:
    """Every quantity of a class of results, and its flat names, in the order of tables.

    ``sizes`` are the numbers of masses, rods and links.
    """
    ranked = [(known, [name]) for name, known in quantities(cls).items()]
    for group, known in _fields_of_elements(cls).values():
        n = sizes[group]
        ranked.append((known, [_flat_name(known, i, n) for i in range(n)]))
    return sorted(ranked, key=lambda one: one[0].rank)


def place_of(cls: type[ByElement], name: str) -> Place | None:
    """Where a flat name belongs in a class of results; None if it is no such name."""
    if name in (own := quantities(cls)):
        return Place("", 0, name, own[name])
    for field, (group, known) in _fields_of_elements(cls).items():
        if found := re.fullmatch(_pattern(known), name):
            known = known.of(found[1]) if found[1] else known
            return Place(group, int(found[1] or 1) - 1, field, known)
    return None


def _fields_of_elements(cls: type[ByElement]) -> dict[str, tuple[str, Quantity]]:
    """Group and metadata of each quantity of an element that has a flat name, by field."""
    return {
        field: (group, known)
        for group, kind in cls._elements.items()
        for field, known in quantities(kind).items()
        if known.column
    }


def _flat_name(known: Quantity, i: int, n: int) -> str:
    if "{}" in known.column:
        return known.column.format(i + 1)
    return of_link(known.column, i, n)


def of_link(name: str, link: int, n_links: int) -> str:
    """The name of a link's column: numbered, from 1, where there are several links."""
    return name if n_links == 1 else f"{name}_{link + 1}"


_OF_A_DAMPER = r"(?:damper_force|slip_distance|friction_work)((?:_[1-9][0-9]*)?)"


def without_idle_dampers(names: Iterable[str], largest: Callable[[str], float]) -> list[str]:
    """Names of scalars, without the slip of links whose friction is 0 in all runs.

    ``largest`` is the largest value of a scalar in all runs. A link has no friction if its ends
    move relative to each other and its damper takes no energy.
    """
    names = list(names)

    def is_idle(link: str) -> bool:
        work, slip = f"friction_work{link}", f"slip_distance{link}"
        return {work, slip} <= {*names} and largest(work) == 0 < largest(slip)

    found = {name: re.fullmatch(_OF_A_DAMPER, name) for name in names}
    return [name for name, match in found.items() if match is None or not is_idle(match[1])]


def _pattern(known: Quantity) -> str:
    if "{}" in known.column:
        return known.column.replace("{}", "([1-9][0-9]*)")
    return f"{known.column}(?:_([1-9][0-9]*))?"


def are_known(results: Any) -> bool:
    """Whether all values are numbers, and not tracers or other placeholders of JAX."""
    leaves = jax.tree.leaves(results)
    numbers = (float, int, np.generic, np.ndarray, jax.Array)
    return bool(leaves) and not is_traced(leaves) and all(isinstance(x, numbers) for x in leaves)


def run_numbers(batch: tuple[int, ...], each: int = 1) -> dict[str, np.ndarray]:
    """The number of every run along each axis of a batch, repeated for ``each`` rows of a run."""
    names = ["run"] if len(batch) == 1 else [f"run_{axis}" for axis in range(len(batch))]
    numbers = np.indices(batch)
    return {name: np.repeat(x.ravel(), each) for name, x in zip(names, numbers, strict=True)}


def chosen(results: T, index: Any, batch: tuple[int, ...]) -> T:
    """Results at the index of their batch; an index outside raises (JAX would clamp it)."""
    if not batch:
        raise TypeError(f"{type(results).__name__}: only a batch has an index, this is one run")
    index = np.asarray(index) if isinstance(index, list) else index
    np.empty(batch, bool)[index]
    # Arrays that the runs of a batch share have no batch axes.
    return jax.tree.map(lambda x: x[index] if jnp.ndim(x) >= len(batch) else x, results)
