"""Results by mass, rod and link, their flat names, and results as tables and files.

A result holds tuples, ``masses``, ``rods`` and ``links``. The field of each of their quantities
states its flat name: ``peak_x{}`` of ``MassDemand`` is ``peak_x1`` of the first mass. Names of link
quantities are numbered only where there are several links: ``min_gap``, else ``min_gap_2``.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Iterable, Mapping
from os import PathLike
from typing import TYPE_CHECKING, Any, BinaryIO, ClassVar, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound._checks import did_you_mean, is_traced, require_folder
from jaxpound._errors import InvalidInput
from jaxpound._extras import require
from jaxpound._fields import Quantity, quantities
from jaxpound._version import __version__
from jaxpound.model.places import link_places, mass_places, rod_places
from jaxpound.model.topology import Topology
from jaxpound.quantities import unit

if TYPE_CHECKING:
    from pandas import DataFrame
    from xarray import Dataset


Results = TypeVar("Results", bound="ByElement")

PLACES = {"masses": mass_places, "rods": rod_places, "links": link_places}
"""Names of places of the elements of each group."""

_MAY_BE_INFINITE = ("min_gap", "soft_min_gap", "first_impact_time", "first_yield_time")


class FlatName(NamedTuple):
    """The place of a flat name: group ("" for the result itself), element from 0, and field."""

    group: str
    element: int
    field: str
    quantity: Quantity


class ByElement:
    """A result with ``masses``, ``rods`` and ``links``, whose quantities have flat names too."""

    _elements: ClassVar[dict[str, type]]
    """Class of the elements of each group."""
    si: bool
    topology: Any

    def flat(self, field: str) -> dict[str, Any]:
        """A quantity of all elements that have it, by flat name."""
        group, quantity = _fields_of_elements(type(self))[field]
        items = getattr(self, group)
        names = _flat_names(quantity, len(items))
        return {name: getattr(item, field) for name, item in zip(names, items, strict=True)}

    def columns(self) -> list[tuple[Quantity, list[str]]]:
        """Every quantity and its flat names, in the order of tables."""
        sizes = {group: len(getattr(self, group)) for group in self._elements}
        return columns_of(type(self), sizes)

    @property
    def batch(self) -> tuple[int, ...]:
        """Shape of the batch; () for a single run."""
        return np.shape(next(iter(jax.tree.leaves(self)), 0.0))

    def to_xarray(self) -> Dataset:
        """Quantities of all elements by field, as an ``xarray.Dataset`` that ``to_netcdf`` writes.

        The dimensions are ``run`` of a batch (``run_0`` and so on for several axes), ``masses``,
        ``rods``, ``links`` and ``supports``, whose coordinates are their names in words, and of a
        response ``time``. Each variable has its unit ("1" of a pure number) and its name in words
        as the attributes ``units`` and ``long_name``. Elements without a quantity have NaN.

        An ``ImportError`` without xarray (extra ``xarray``), an ``InvalidInput`` for a batch whose
        runs differ in their instants.
        """
        xarray, batch, time = require("xarray"), self.batch, getattr(self, "time", None)
        instants = () if time is None else np.shape(time)[-1:]
        runs = [*run_numbers(batch)] if batch else []
        variables: dict[str, tuple[list[str], Any, dict[str, str]]] = {}
        for name, (group, quantity, values) in self._by_field().items():
            if any(x is not None for x in values):
                shape = (*batch, *instants)
                each = [np.broadcast_to(np.nan if x is None else x, shape) for x in values]
                stacked = np.stack(each, len(batch)) if group else each[0]
                dimensions = runs + [group] * bool(group) + ["time"] * len(instants)
                words = re.sub(r" of \w+ {}$", "", quantity.words) or name.replace("_", " ")
                attributes = described(unit(quantity.kind, self.si), words)
                variables[name] = dimensions, stacked, attributes
        if instants:
            _, stacked, attributes = variables["time"]
            first = stacked.reshape(-1, *instants)[0]
            if not (stacked == first).all():
                raise InvalidInput("a batch", "", "must have the same instants in all its runs")
            variables["time"] = ["time"], first, attributes
        coordinates: dict[str, Any] = dict(zip(runs, map(np.arange, batch), strict=True))
        for group, words_of in PLACES.items():
            if self.topology and getattr(self, group):
                coordinates[group] = [*words_of(self.topology)]
        return xarray.Dataset(variables, coordinates, {"source": f"jaxpound {__version__}"})

    def _by_field(self) -> dict[str, tuple[str, Quantity, list[Any]]]:
        """Group, metadata and values of each quantity with a flat name, by field."""
        alone = {
            name: ("", quantity, [getattr(self, name)])
            for name, quantity in quantities(type(self)).items()
        }
        return alone | {
            field: (group, quantity, [getattr(item, field) for item in getattr(self, group)])
            for field, (group, quantity) in _fields_of_elements(type(self)).items()
        }

    def __getitem__(self: Results, index: Any) -> Results:
        """Runs of a batch by number, slice or mask, as in an array: ``batch[3]`` is one run."""
        if not (batch := self.batch):
            raise TypeError(f"{type(self).__name__}: only a batch has an index, this is one run")
        index = np.asarray(index) if isinstance(index, list) else index
        np.empty(batch, bool)[index]  # an index outside raises, which JAX would clamp
        # Arrays that the runs of a batch share have no batch axes.
        return jax.tree.map(lambda x: x[index] if jnp.ndim(x) >= len(batch) else x, self)

    def __getattr__(self, name: str) -> Any:
        place = None if name in self._elements or name[:2] == "__" else place_of(type(self), name)
        if place is None or not place.group:
            message = f"{type(self).__name__!r} object has no attribute {name!r}"
            if hasattr(vars(self).get("demand"), name):
                message += f"; its demand has it: .demand.{name}"
            elif name not in self._elements and name[:1] != "_":
                message += f"; {did_you_mean(name, dir(self))}".rstrip("; ")
            raise AttributeError(message, name=name, obj=self)
        group, i, field, quantity = place
        items = getattr(self, group)
        if name in _flat_names(quantity, len(items)):
            return getattr(items[i], field)
        rule = f"{group}[i].{field} has it of each of its {len(items)} {group}"
        raise AttributeError(f"{type(self).__name__} has no {name!r}: {rule}", name=name, obj=self)

    def __dir__(self) -> list[str]:
        flat = [name for _, names in self.columns() for name in names]
        return sorted({*super().__dir__(), *flat})


def columns_of(cls: type[ByElement], sizes: Mapping[str, int]) -> list[tuple[Quantity, list[str]]]:
    """Quantities of a class in the order of tables, with the flat names for sizes of groups."""
    ranked = [(quantity, [name]) for name, quantity in quantities(cls).items()]
    for group, quantity in _fields_of_elements(cls).values():
        ranked.append((quantity, _flat_names(quantity, sizes[group])))
    return sorted(ranked, key=lambda entry: entry[0].rank)


def place_of(cls: type[ByElement], name: str) -> FlatName | None:
    """The place of a flat name in a class of results; None for other names."""
    if name in (fields := quantities(cls)):
        return FlatName("", 0, name, fields[name])
    for field, (group, quantity) in _fields_of_elements(cls).items():
        numbered = quantity.column if "{}" in quantity.column else f"{quantity.column}(?:_{{}})?"
        if match := re.fullmatch(numbered.replace("{}", "([1-9][0-9]*)"), name):
            quantity = quantity.of(match[1]) if match[1] else quantity
            return FlatName(group, int(match[1] or 1) - 1, field, quantity)
    return None


def kind_in(cls: type[ByElement], name: str) -> str | None:
    """Kind of the quantity with a flat name in a class of results; None for a pure number."""
    place = place_of(cls, name)
    return None if place is None else place.quantity.kind


def is_valid(cls: type[ByElement], name: str, values: Any) -> Any:
    """Whether a scalar is finite, or infinite as that of a run without gap, impact or yield is."""
    place = place_of(cls, name)
    may_be_infinite = place is not None and place.field in _MAY_BE_INFINITE
    return values > -np.inf if may_be_infinite else np.isfinite(values)


def _fields_of_elements(cls: type[ByElement]) -> dict[str, tuple[str, Quantity]]:
    """Group and metadata of each quantity of an element that has a flat name, by field."""
    return {
        field: (group, quantity)
        for group, kind in cls._elements.items()
        for field, quantity in quantities(kind).items()
        if quantity.column
    }


def _flat_names(quantity: Quantity, n: int) -> list[str]:
    """The names of a quantity of n elements."""
    name = quantity.column
    return [name.format(i + 1) if "{}" in name else of_link(name, i, n) for i in range(n)]


def sizes_of(topology: Topology) -> dict[str, int]:
    """Number of elements of each group."""
    return {"masses": topology.n_masses, "rods": len(topology.rods), "links": len(topology.links)}


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

    matches = {name: re.fullmatch(_OF_A_DAMPER, name) for name in names}
    return [name for name, match in matches.items() if match is None or not is_idle(match[1])]


def are_concrete(results: Any) -> bool:
    """Whether all values are numbers, not tracers or other placeholders of JAX."""
    leaves = jax.tree.leaves(results)
    numbers = (float, int, np.generic, np.ndarray, jax.Array)
    return bool(leaves) and not is_traced(leaves) and all(isinstance(x, numbers) for x in leaves)


def described(of_unit: str, words: str) -> dict[str, str]:
    """Attributes of a variable of an ``xarray.Dataset``."""
    return {"units": of_unit or "1", "long_name": words}


def run_numbers(batch: tuple[int, ...], each: int = 1) -> dict[str, np.ndarray]:
    """The number of every run along each axis of a batch, repeated for ``each`` rows of a run."""
    return {
        f"run_{axis}" if len(batch) > 1 else "run": np.repeat(x.ravel(), each)
        for axis, x in enumerate(np.indices(batch))
    }


class Columnar:
    """A result that is a table, with a row for each instant, run or sample.

    The names of columns end with the SI unit where the numbers are SI (``x1_m``, ``v1_m_per_s``),
    and have no ending where they are dimensionless. The columns that identify a row (run, instant,
    sample) come first, and are the index of a data frame.
    """

    def _index_and_columns(self) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        raise NotImplementedError

    def to_columns(self) -> dict[str, np.ndarray]:
        """All columns by name, of one length, as NumPy arrays."""
        index, columns = self._index_and_columns()
        return index | columns

    def to_pandas(self) -> DataFrame:
        """All columns as a data frame; an ``ImportError`` without pandas (extra ``tables``)."""
        pandas = require("pandas")
        index, columns = self._index_and_columns()
        return pandas.DataFrame(index | columns).set_index([*index])

    def to_csv(self, file: str | PathLike[str] | BinaryIO) -> None:
        """All columns as comma-separated values, below a line of their names.

        Numbers have 17 digits, so that the same numbers are read back. ``file`` is open for binary
        writing, or a path, whose folder exists (else ``FileNotFoundError``).
        """
        if isinstance(file, str | PathLike):
            require_folder(file)
            with open(file, "wb") as opened:
                self.to_csv(opened)
            return
        columns, heading = self.to_columns(), io.StringIO()
        csv.writer(heading, lineterminator="\n").writerow(columns)
        file.write(heading.getvalue().encode())
        np.savetxt(file, np.column_stack(list(columns.values())), "%.17g", delimiter=",")

    def to_parquet(self, file: str | PathLike[str] | BinaryIO) -> None:
        """All columns as a Parquet file, which is smaller and faster than text.

        ``file`` is as that of ``to_csv``. An ``ImportError`` without pandas or pyarrow (extra
        ``tables``).
        """
        for library in ("pandas", "pyarrow"):
            require(library)
        if isinstance(file, str | PathLike):
            require_folder(file)
        self.to_pandas().to_parquet(file, engine="pyarrow")
