"""Frozen dataclasses that JAX can trace, batch and differentiate, with metadata at fields.

A ``parameter`` field states its admissible values, kind of quantity and symbol; a ``quantity``, a
field of a result, its kind and its name in words. Rules, units, labels and columns are read from
these metadata: ``rules``, ``walk``.
"""

from __future__ import annotations

import dataclasses
import reprlib
from collections.abc import Callable, Iterator
from types import NoneType
from typing import Any, NamedTuple, TypeVar, dataclass_transform

import jax.numpy as jnp
import numpy as np
from jax.tree_util import GetAttrKey, register_pytree_with_keys

from jaxpound._checks import Range, Rule, enforce, finite, instance, is_traced, number, pytree, real

T = TypeVar("T")

_ROLE, _KNOWN = "jaxpound_role", "jaxpound_known"


@dataclasses.dataclass(frozen=True)
class Parameter:
    """Metadata of a parameter: admissible values, kind of quantity, symbol and name."""

    symbol: str
    kind: str | None
    words: str
    above: float | str | None
    least: float | str | None
    most: float | None
    finite: bool
    why: str
    single: bool
    """Whether it must be one number, not an array."""
    usual: tuple[float, float] | None
    """Its usual range."""
    within: Range | None
    """Its range in SI, of buildings of every size."""

    @property
    def low(self) -> float | str | None:
        """The lower bound: a number, or the name of the field that holds it."""
        return self.least if self.above is None else self.above

    @property
    def is_ratio(self) -> bool:
        """Whether a logarithmic scale suits it: positive, without an upper limit."""
        return self.most is None and (self.above == 0 or isinstance(self.low, str))

    def rule(self, owner: Any, name: str, value: Any) -> Rule:
        """The rule for a value; ``owner`` is the object whose other fields may bound it."""
        low = getattr(owner, self.low) if isinstance(self.low, str) else self.low
        holds = finite(value) if self.finite else value == value
        if low is not None:
            holds = holds & (value >= low if self.above is None else value > low)
        if self.most is not None:
            holds = holds & (value <= self.most)
        return Rule(name, value, holds, self._says(low) + (f" ({self.why})" if self.why else ""))

    def _says(self, low: Any) -> str:
        """Completes 'must be'."""
        if self.most is not None:
            inside = f"in ({low:g}, {self.most:g}]"
            return f"between {low:g} and {self.most:g}" if self.above is None else inside
        words = ["finite"] if self.finite else []
        if isinstance(self.low, str):
            words.append(f"{'at least' if self.above is None else 'above'} {self.low}{_shown(low)}")
        elif self.above is not None:
            words.insert(0, "positive")
        elif self.least is not None:
            words.append("not negative")
        return " and ".join(words)


class Quantity(NamedTuple):
    """What is known of a number in a result.

    ``words``, ``column`` and ``symbol`` are its name in a sentence, in a table and in a figure,
    with braces for the number, from 1, of the mass, rod or link that it belongs to.
    """

    kind: str | None
    words: str = ""
    column: str = ""
    symbol: str = ""
    rank: int = 0
    """Where tables have it: those of lower rank come first."""
    limited: bool = False
    """Whether a design may be limited in it, or pay for it."""
    only: str = ""
    """Which elements have it if not all do: links with a law of "contact", rods that are a "storey"
    between two masses."""

    def of(self, number: str) -> Quantity:
        """The same, with the number in its names; names without braces are those of links."""

        def numbered(name: str) -> str:
            own = f"{name} of link {number}" if name else ""
            return name.replace("{}", number) if "{}" in name else own

        return self._replace(words=numbered(self.words), symbol=numbered(self.symbol))


def parameter(
    symbol: str = "",
    kind: str | None = None,
    words: str = "",
    *,
    above: float | str | None = None,
    least: float | str | None = None,
    most: float | None = None,
    finite: bool = True,
    why: str = "",
    each: bool = False,
    single: bool = False,
    usual: tuple[float, float] | None = None,
    within: Range | None = None,
    **kwargs: Any,
) -> Any:
    """A field that is a parameter: a real number or array, traced and differentiated.

    Its lower bound is ``above`` (exclusive) or ``least`` (inclusive): 0, or an earlier field of the
    object by name; its upper bound is ``most``. It is ``finite`` unless said otherwise. ``why`` is
    the reason that ends the error message. ``each`` makes it a tuple of such numbers, ``single``
    refuses arrays. ``usual`` is the range of a slider, ``within`` that of the number in SI
    (``ranges``).
    """
    known = Parameter(symbol, kind, words, above, least, most, finite, why, single, usual, within)
    return dataclasses.field(metadata={_KNOWN: known, "each": each}, **kwargs)


def like(cls: type, name: str, within: Range | None = None, **kwargs: Any) -> Any:
    """A field that is the same parameter, or holds the same part, as a field of another class.

    ``within`` is its range where the object is in SI.
    """
    (field,) = (f for f in dataclasses.fields(cls) if f.name == name)
    if within is None:
        return dataclasses.field(metadata=field.metadata, **kwargs)
    known = dataclasses.replace(field.metadata[_KNOWN], within=within)
    return dataclasses.field(metadata={**field.metadata, _KNOWN: known}, **kwargs)


def quantity(
    kind: str | None,
    words: str = "",
    column: str = "",
    symbol: str = "",
    rank: int = 0,
    limited: bool = False,
    only: str = "",
    **kwargs: Any,
) -> Any:
    """A field that is a number or series of a result; as ``Quantity`` (kind None: a number)."""
    known = Quantity(kind, words, column, symbol, rank, limited, only)
    return dataclasses.field(metadata={_KNOWN: known}, **kwargs)


def part(*kinds: type, each: bool = False, traced: bool = False, **kwargs: Any) -> Any:
    """A field that holds an object of one of the kinds, or a pytree of objects if none is given.

    A kind may be a protocol; ``NoneType`` makes the part one that may be missing. ``each`` makes it
    a tuple of such objects. ``traced`` refuses objects of the user's own that are no pytrees.
    """
    metadata = {_ROLE: "part", "kinds": kinds, "each": each, "traced": traced}
    return dataclasses.field(metadata=metadata, **kwargs)


def static(**kwargs: Any) -> Any:
    """A field that shapes the compiled program: hashed, never traced."""
    return dataclasses.field(metadata={_ROLE: "static", "static": True}, **kwargs)


def label(*, default: Any) -> Any:
    """A field for display: transformations drop it, so that it never causes a recompilation."""
    return dataclasses.field(default=default, metadata={_ROLE: "label"}, compare=False)


@dataclass_transform(
    frozen_default=True,
    eq_default=False,
    field_specifiers=(parameter, like, quantity, part, static, label),
)
def pytree_dataclass(cls: type[T]) -> type[T]:
    """Make ``cls`` a frozen dataclass and a pytree whose fields are its children.

    Where ``cls`` has no ``__post_init__`` of its own, the object is checked as it is made
    (``check``). Its ``__repr__`` is that of a dataclass, but shortened where it is long.

    JAX rebuilds objects with cotangents, axis numbers or tracers in the place of numbers, and those
    must not be judged as parameters: rebuilding therefore bypasses ``__init__`` and its checks.
    """
    if "__post_init__" not in vars(cls):
        cls.__post_init__ = check  # type: ignore[attr-defined]
    if "__repr__" not in vars(cls):
        cls.__repr__ = _shown_object  # type: ignore[method-assign]
    data_cls = dataclasses.dataclass(frozen=True, eq=False)(cls)
    fields = dataclasses.fields(data_cls)  # type: ignore[arg-type]
    labels = {f.name: f.default for f in fields if f.metadata.get(_ROLE) == "label"}
    statics = tuple(f.name for f in fields if f.metadata.get(_ROLE) == "static")
    data = tuple(f.name for f in fields if f.name not in {*labels, *statics})

    def flatten_with_keys(obj: T) -> tuple[list[Any], tuple[Any, ...]]:
        children = [(GetAttrKey(name), getattr(obj, name)) for name in data]
        return children, tuple(getattr(obj, name) for name in statics)

    def flatten(obj: T) -> tuple[list[Any], tuple[Any, ...]]:
        return [getattr(obj, name) for name in data], tuple(getattr(obj, name) for name in statics)

    def unflatten(aux: tuple[Any, ...], children: Any) -> T:
        fields = zip((*data, *statics), (*children, *aux), strict=True)
        return assembled(data_cls, **dict(fields), **labels)

    register_pytree_with_keys(data_cls, flatten_with_keys, unflatten, flatten)
    return data_cls


def assembled(cls: type[T], **fields: Any) -> T:
    """An object of ``cls`` from values that have been checked already: it is not checked again."""
    obj = object.__new__(cls)
    for name, value in fields.items():
        object.__setattr__(obj, name, value)
    return obj


def check(obj: Any) -> None:
    """Convert an object's parameters to numbers, and refuse known ones that break their rules.

    Raises
    ------
    ValueError
        For a parameter that is no real number or breaks its rule, and a part of another type or,
        where it must be one, no pytree.
    """
    owner = type(obj).__name__
    for field in dataclasses.fields(obj):
        known, value = field.metadata.get(_KNOWN), getattr(obj, field.name)
        if isinstance(known, Parameter):
            as_number = number if known.single else real
            numbers = [as_number(owner, *entry) for entry in _entries(field, value)]
            object.__setattr__(
                obj, field.name, tuple(numbers) if field.metadata["each"] else numbers[0]
            )
        elif kinds := field.metadata.get("kinds"):
            for name, item in _entries(field, value):
                instance(owner, name, item, *kinds)
                if field.metadata["traced"]:
                    pytree(owner, name, item)
    enforce(owner, _own_rules(obj, ""))


def ranges(tree: Any, prefix: str = "") -> list[Rule]:
    """The rules that parameters of a tree of our objects in SI are in their ranges."""
    known = walk(tree, Parameter, prefix)
    return [about.within.of(path, value) for path, about, value in known if about.within]


class Checked:
    """A dataclass, not for JAX to trace, whose parameters are checked as it is made."""

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if "__repr__" not in vars(cls):
            cls.__repr__ = _shown_object  # type: ignore[method-assign]

    def __post_init__(self) -> None:
        check(self)


def rules(tree: Any, prefix: str = "") -> list[Rule]:
    """The rules of all parameters in a tree of our objects, each by its path from the root."""
    found: list[Rule] = []
    for path, obj in _objects(tree, prefix):
        found += _own_rules(obj, path)
    return found


def walk(tree: Any, kind: type, prefix: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Path, metadata (``Parameter`` or ``Quantity``) and value of all fields of that kind.

    ``tree`` may be a class: then values are None, ``*`` stands for the index of an entry, and what
    is in a part that may be missing is not known.
    """
    for path, obj in _objects(tree, prefix):
        for field in dataclasses.fields(obj):
            known = field.metadata.get(_KNOWN)
            if isinstance(known, kind):
                for name, value in _entries(field, _value(obj, field)):
                    yield path + name, known, value


def quantities(cls: type) -> dict[str, Quantity]:
    """The quantities of a class of results, by field."""
    return {
        field.name: field.metadata[_KNOWN]
        for field in dataclasses.fields(cls)
        if isinstance(field.metadata.get(_KNOWN), Quantity)
    }


def converted(tree: Any, convert: Callable[[Quantity, Any], Any]) -> Any:
    """A tree of our objects with each quantity that is not None replaced by ``convert``."""
    if isinstance(tree, tuple):
        return tuple(converted(item, convert) for item in tree)
    changes = {}
    for field in dataclasses.fields(tree):
        known, value = field.metadata.get(_KNOWN), getattr(tree, field.name)
        if isinstance(known, Quantity) and value is not None:
            changes[field.name] = convert(known, value)
        elif field.metadata.get(_ROLE) == "part" and value is not None:
            changes[field.name] = converted(value, convert)
    return dataclasses.replace(tree, **changes)


_LONGEST = 800
"""Characters of an object's representation, about ten lines of a terminal; longer ones leave out
entries of tuples and digits of numbers."""


def _shown_object(obj: Any) -> str:
    """``__repr__`` of a dataclass."""
    found = _fields_shown(obj, _in_full)
    return found if len(found) <= _LONGEST else _in_short(obj)


def _fields_shown(obj: Any, show: Callable[[Any], str]) -> str:
    shown = (f"{field.name}={show(getattr(obj, field.name))}" for field in dataclasses.fields(obj))
    return f"{type(obj).__qualname__}({', '.join(shown)})"


def _in_full(value: Any) -> str:
    """``repr`` of a value, where NumPy's numbers are written as Python's are."""
    if type(value) is tuple:
        return f"({', '.join(map(_in_full, value))}{',' if len(value) == 1 else ''})"
    return str(value) if isinstance(value, np.number) else repr(value)


def _in_short(value: Any) -> str:
    """A value with the first and last entries of its tuples, and six digits of its numbers."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return _fields_shown(value, _in_short)
    if isinstance(value, tuple) and value:
        first, *others = map(_in_short, (value[0], *value[1:][-1:]))
        between = [f"<{len(value) - 2} more>"] if len(value) > 2 else []
        return f"({', '.join([first, *between, *others])}{'' if others else ','})"
    if isinstance(value, float | np.floating):
        return f"{float(value):.6g}"
    return reprlib.repr(value)


def _objects(tree: Any, prefix: str) -> Iterator[tuple[str, Any]]:
    """All dataclasses of a tree, the inner ones first, and the prefix of their fields' paths."""
    if isinstance(tree, tuple | list):
        for i, item in enumerate(tree):
            yield from _objects(item, f"{prefix}{i}.")
    elif dataclasses.is_dataclass(tree):
        for field in dataclasses.fields(tree):
            if field.metadata.get(_ROLE, "part") == "part" and _KNOWN not in field.metadata:
                if not isinstance(tree, type):
                    yield from _objects(getattr(tree, field.name), f"{prefix}{field.name}.")
                    continue
                ((name, _),) = _entries(field, None)
                kinds = field.metadata.get("kinds", ())
                for kind in () if NoneType in kinds else kinds:
                    yield from _objects(kind, f"{prefix}{name}.")
        yield prefix, tree


def _value(obj: Any, field: dataclasses.Field[Any]) -> Any:
    return None if isinstance(obj, type) else getattr(obj, field.name)


def _entries(field: dataclasses.Field[Any], value: Any) -> list[tuple[str, Any]]:
    """What a field holds, by name: its value, or each entry of its tuple."""
    if not field.metadata.get("each"):
        return [(field.name, value)]
    entries = [("*", None)] if value is None else enumerate(value)
    return [(f"{field.name}.{i}", x) for i, x in entries]


def _own_rules(obj: Any, prefix: str) -> list[Rule]:
    """The rules of an object's own parameters, and those that it states itself (``more_rules``)."""
    found = [
        known.rule(obj, prefix + name, value)
        for field in dataclasses.fields(obj)
        if isinstance(known := field.metadata.get(_KNOWN), Parameter)
        for name, value in _entries(field, getattr(obj, field.name))
    ]
    more = getattr(obj, "more_rules", None)
    return found if more is None else [*found, *more(prefix)]


def _shown(value: Any) -> str:
    return f" = {float(value):.8g}" if not is_traced(value) and jnp.ndim(value) == 0 else ""
