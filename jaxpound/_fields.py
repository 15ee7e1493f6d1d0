"""Frozen dataclasses that JAX can trace, batch and differentiate, with metadata at fields.

A ``parameter`` field states its admissible values, kind of quantity and symbol; a ``quantity``, a
field of a result, its kind and its name in words. ``rules`` and ``walk`` read these metadata.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Iterator
from types import NoneType
from typing import Any, NamedTuple, TypeVar, cast, dataclass_transform

import jax.numpy as jnp
from jax.tree_util import GetAttrKey, register_pytree_with_keys, tree_structure

from jaxpound import _checks
from jaxpound._checks import Range, Rule, enforce, finite, instance, is_traced, number, pytree, real
from jaxpound._tables import dataclass_repr

T = TypeVar("T")

_ROLE, _SPEC = "jaxpound_role", "jaxpound_spec"
_cached = cast("Callable[[T], T]", functools.cache)  # whose own type refuses classes


@dataclasses.dataclass(frozen=True)
class Parameter:
    """Metadata of a parameter: admissible values, kind of quantity, symbol and name.

    Its lower bound is ``above`` (exclusive) or ``least`` (inclusive): 0, or the name of an earlier
    field of the object; its upper bound is ``most`` (inclusive) or ``below`` (exclusive); ``why``,
    a reason, ends the error message. ``single`` refuses arrays, and ``whole`` all but whole numbers
    from 1 on; ``optional`` admits None, of which nothing is asked. ``usual`` is its usual range,
    that of a slider, ``within`` its range in SI, of buildings of every size (``ranges``).
    """

    symbol: str = ""
    kind: str | None = None
    words: str = ""
    above: float | str | None = None
    least: float | str | None = None
    most: float | None = None
    below: float | None = None
    finite: bool = True
    why: str = ""
    single: bool = False
    whole: bool = False
    optional: bool = False
    usual: tuple[float, float] | None = None
    within: Range | None = None

    @property
    def low(self) -> float | str | None:
        """The lower bound: a number, or the name of the field that holds it."""
        return self.least if self.above is None else self.above

    @property
    def range(self) -> Range:
        """The range in SI; of a pure number without one, its bounds."""
        return self.within or Range(cast("float", self.low), cast("float", self.most))

    @property
    def is_ratio(self) -> bool:
        """Whether a logarithmic scale suits it: positive, without an upper limit."""
        return self.most is None and (self.above == 0 or isinstance(self.low, str))

    def rule(self, owner: Any, name: str, value: Any) -> Rule:
        """The rule for a value; ``owner`` is the object whose other fields may bound it."""
        low = getattr(owner, self.low) if isinstance(self.low, str) else self.low
        if low is None:
            holds = finite(value) if self.finite else value == value
        else:
            holds = value >= low if self.above is None else value > low
        if self.most is not None:
            holds = holds & (value <= self.most)
        elif self.below is not None:
            holds = holds & (value < self.below)
        elif self.finite and low is not None:
            holds = holds & (value < float("inf"))
        return Rule(name, value, holds, self._bounds(low) + (f" ({self.why})" if self.why else ""))

    def _bounds(self, low: Any) -> str:
        """Completes 'must be'."""
        relation = "at least" if self.above is None else "above"
        if self.most is not None:
            inside = f"in ({low:g}, {self.most:g}]"
            return f"between {low:g} and {self.most:g}" if self.above is None else inside
        if self.below is not None:
            return f"{relation} {low:g} and below {self.below:g}"
        words = ["finite"] if self.finite and not self.whole else []
        if isinstance(self.low, str):
            is_number = not is_traced(low) and jnp.ndim(low) == 0
            words.append(f"{relation} {self.low}" + (f" = {float(low):.8g}" if is_number else ""))
        elif self.above is not None:
            words.insert(0, "positive")
        elif self.least is not None:
            words.append(f"at least {low:g}" if low else "not negative")
        return " and ".join(words)


class Quantity(NamedTuple):
    """Metadata of a number in a result.

    ``words``, ``column`` and ``symbol`` name it in a sentence, in a table and in a figure; braces
    stand for the number, from 1, of the mass, rod or link that it belongs to, a star for its
    field's name, or in a symbol its column's in words. Tables list lower ranks first. A design may
    be limited in it, or pay for it, if ``limited``; Richardson's method extrapolates ``smooth``
    series. Elements may have it ``only`` if they are links with "contact", at a "column" or one of
    a known "capacity", or in structures on "supports" that move apart, rods that are a "storey"
    between two masses, or may be "yielding".
    """

    kind: str | None
    words: str = ""
    column: str = ""
    symbol: str = ""
    rank: int = 0
    limited: bool = False
    only: str = ""
    smooth: bool = False

    def of(self, number: str) -> Quantity:
        """The same with the number in its names; a name without braces is that of a link."""

        def numbered(name: str) -> str:
            with_link = f"{name} of link {number}" if name else ""
            return name.replace("{}", number) if "{}" in name else with_link

        return self._replace(words=numbered(self.words), symbol=numbered(self.symbol))

    def in_field(self, name: str) -> Quantity:
        """The same in the field of this name, without stars."""
        column = self.column.replace("*", name)
        symbol = self.symbol.replace("*", column.replace("_", " "))
        return self._replace(column=column, symbol=symbol)


def parameter(
    *spec: Any, each: bool = False, default: Any = dataclasses.MISSING, **rules: Any
) -> Any:
    """A field that is a ``Parameter`` of this symbol, kind and words, traced and differentiated.

    ``each`` makes it a tuple of them; the default None makes it optional.
    """
    rules = {"optional": default is None} | rules
    metadata = {_SPEC: Parameter(*spec, **rules), "each": each}
    return dataclasses.field(metadata=metadata, default=default)


def like(cls: type, name: str, within: Range | None = None, **kwargs: Any) -> Any:
    """A field that is the same parameter or part as that of another class, perhaps in a range.

    The default None makes a parameter optional.
    """
    (metadata,) = (dict(f.metadata) for f in dataclasses.fields(cls) if f.name == name)
    if isinstance(spec := metadata.get(_SPEC), Parameter):
        optional = spec.optional or kwargs.get("default", spec) is None
        within = within or spec.within
        metadata[_SPEC] = dataclasses.replace(spec, optional=optional, within=within)
    return dataclasses.field(metadata=metadata, **kwargs)


def quantity(*spec: Any, default: Any = dataclasses.MISSING, **more: Any) -> Any:
    """A field that is a number or series of a result: a ``Quantity`` of this kind and words."""
    return dataclasses.field(metadata={_SPEC: Quantity(*spec, **more)}, default=default)


def part(
    *kinds: type, each: bool = False, traced: bool = False, listed: Any = True, **kwargs: Any
) -> Any:
    """A field that holds an object of one of the kinds, or without kinds a pytree of objects.

    A kind may be a protocol; the default None makes the part optional. ``each`` makes it a tuple of
    such objects, or of a list of them. ``traced`` refuses user-defined objects that are no pytrees.
    ``listed`` is as of a label.
    """
    if kinds and kwargs.get("default", kinds) is None:
        kinds = *kinds, NoneType
    metadata = {_ROLE: "part", "kinds": kinds, "each": each, "traced": traced, "listed": listed}
    return dataclasses.field(metadata=metadata, **kwargs)


def static(listed: Any = True, **kwargs: Any) -> Any:
    """A field that shapes the compiled program: hashed, never traced; ``listed`` as a label."""
    return dataclasses.field(metadata={_ROLE: "static", "static": True, "listed": listed}, **kwargs)


def label(*, default: Any, listed: Any = True) -> Any:
    """A field for display, dropped by transformations: it causes no recompilation.

    A store's identity has it if ``listed``, a truth value, or ``bool``: unless it is 0 or empty.
    """
    metadata = {_ROLE: "label", "listed": listed}
    return dataclasses.field(default=default, metadata=metadata, compare=False)


@dataclass_transform(
    frozen_default=True,
    eq_default=False,
    field_specifiers=(parameter, like, quantity, part, static, label),
)
def pytree_dataclass(cls: type[T]) -> type[T]:
    """Make ``cls`` a frozen dataclass and a pytree whose fields are its children.

    Unless ``cls`` has a ``__post_init__``, ``check`` checks each new object. JAX rebuilds objects
    with cotangents, axis numbers or tracers in the place of numbers: rebuilding makes no checks.
    """
    if not hasattr(cls, "__post_init__"):
        cls.__post_init__ = Checked.__post_init__  # type: ignore[attr-defined]
    if cls.__repr__ is object.__repr__:  # neither the class nor a base prints it
        cls.__repr__ = dataclass_repr  # type: ignore[method-assign]
    data_cls = dataclasses.dataclass(frozen=True, eq=False, repr=False)(cls)
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
        return unchecked(data_cls, **dict(fields), **labels)

    register_pytree_with_keys(data_cls, flatten_with_keys, unflatten, flatten)
    return data_cls


def node_classes(tree: Any) -> tuple[type, ...]:
    """The classes of a pytree's nodes.

    JAX takes classes registered by ``register_dataclass`` for equal if they have equally many
    fields. So a program that is kept for a user's pytree must be kept by these classes, too.
    """

    def classes_in(structure: Any) -> tuple[type, ...]:
        node = structure.node_data()
        return sum(map(classes_in, structure.children()), () if node is None else (node[0],))

    return classes_in(tree_structure(tree))


def unchecked(cls: type[T], **fields: Any) -> T:
    """An object of ``cls`` without ``__init__`` and its checks, from values that need none."""
    obj = object.__new__(cls)
    for name, value in fields.items():
        object.__setattr__(obj, name, value)
    return obj


def check(obj: Any) -> None:
    """Convert parameters to numbers; an ``InvalidInput`` for a field that breaks its rule."""
    for field in dataclasses.fields(obj):
        spec, value = field.metadata.get(_SPEC), getattr(obj, field.name)
        if each := field.metadata.get("each"):
            value = _checks.as_tuple(field.name, value)
            object.__setattr__(obj, field.name, value)
        if isinstance(spec, Parameter):
            as_number = _checks.count if spec.whole else number if spec.single else real
            numbers = tuple(as_number(*entry) for entry in _entries(field, value))
            if each or numbers:
                object.__setattr__(obj, field.name, numbers if each else numbers[0])
        elif kinds := field.metadata.get("kinds"):
            for name, item in _entries(field, value):
                instance(name, item, *kinds)
                if field.metadata["traced"]:
                    pytree(name, item)
    enforce(_rules_of(obj, ""))


class Batch:
    """A dataclass whose parameters may be arrays, which must make one batch."""

    def __post_init__(self) -> None:
        check(self)
        numbers = {name: value for name, _, value in walk(self, Parameter)}
        _checks.require_batch(**numbers)


class BatchInSI(Batch):
    """A ``Batch`` in SI units, whose parameters are in their ranges."""

    def __post_init__(self) -> None:
        super().__post_init__()
        enforce(ranges(self))


def ranges(tree: Any, prefix: str = "") -> list[Rule]:
    """The rules that parameters of objects in SI are in their ranges."""
    parameters = walk(tree, Parameter, prefix)
    return [spec.within.of(path, value) for path, spec, value in parameters if spec.within]


class Checked:
    """A dataclass that is no pytree, whose parameters are checked as it is made."""

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if "__repr__" not in vars(cls):
            cls.__repr__ = dataclass_repr  # type: ignore[method-assign]

    def __post_init__(self) -> None:
        check(self)


def rules(tree: Any, prefix: str = "") -> list[Rule]:
    """The rules of all parameters in a tree of dataclasses, named by their paths from the root."""
    return [rule for path, obj in _objects(tree, prefix) for rule in _rules_of(obj, path)]


def walk(tree: Any, kind: type, prefix: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Path, metadata (``Parameter`` or ``Quantity``) and value of all fields of that kind.

    ``tree`` may be a class: then values are None, ``*`` stands for the index of an entry, and
    optional parts are left out.
    """
    for path, obj in _objects(tree, prefix):
        for field in dataclasses.fields(obj):
            if isinstance(spec := field.metadata.get(_SPEC), kind):
                value = None if isinstance(obj, type) else getattr(obj, field.name)
                for name, entry in _entries(field, value, isinstance(obj, type)):
                    yield path + name, spec, entry


@_cached
def quantities(cls: type) -> dict[str, Quantity]:
    """The quantities of a class of results, by field."""
    specs = {field.name: field.metadata.get(_SPEC) for field in dataclasses.fields(cls)}
    return {name: spec.in_field(name) for name, spec in specs.items() if isinstance(spec, Quantity)}


def converted(tree: Any, convert: Callable[[Quantity, Any], Any]) -> Any:
    """A tree of dataclasses with each quantity that is not None replaced by ``convert``."""
    if isinstance(tree, tuple):
        return tuple(converted(item, convert) for item in tree)
    changes = {}
    for field in dataclasses.fields(tree):
        spec, value = field.metadata.get(_SPEC), getattr(tree, field.name)
        if isinstance(spec, Quantity) and value is not None:
            changes[field.name] = convert(spec, value)
        elif field.metadata.get(_ROLE) == "part" and value is not None:
            changes[field.name] = converted(value, convert)
    return dataclasses.replace(tree, **changes)


def _objects(tree: Any, prefix: str) -> Iterator[tuple[str, Any]]:
    """All dataclasses of a tree, the inner ones first, and the prefix of their fields' paths."""
    if isinstance(tree, tuple | list):
        for i, item in enumerate(tree):
            yield from _objects(item, f"{prefix}{i}.")
    elif dataclasses.is_dataclass(tree):
        for field in dataclasses.fields(tree):
            if field.metadata.get(_ROLE, "part") == "part" and _SPEC not in field.metadata:
                if not isinstance(tree, type):
                    yield from _objects(getattr(tree, field.name), f"{prefix}{field.name}.")
                    continue
                ((name, _),) = _entries(field, None)
                kinds = field.metadata.get("kinds", ())
                for kind in () if NoneType in kinds else kinds:
                    yield from _objects(kind, f"{prefix}{name}.")
        yield prefix, tree


def _entries(
    field: dataclasses.Field[Any], value: Any, of_class: bool = False
) -> list[tuple[str, Any]]:
    """The value of a field by its name, or each entry of a tuple by ``name.index``.

    An optional parameter that is None has none, but that ``of_class``, without an object.
    """
    if value is None and not of_class and getattr(field.metadata.get(_SPEC), "optional", False):
        return []
    if not field.metadata.get("each"):
        return [(field.name, value)]
    entries = [("*", None)] if value is None else enumerate(value)
    return [(f"{field.name}.{i}", x) for i, x in entries]


def _rules_of(obj: Any, prefix: str) -> list[Rule]:
    """The rules of an object's parameters, without those of its parts, and its ``more_rules``."""
    field_rules = [
        spec.rule(obj, prefix + name, value)
        for field in dataclasses.fields(obj)
        if isinstance(spec := field.metadata.get(_SPEC), Parameter)
        for name, value in _entries(field, getattr(obj, field.name))
    ]
    more = getattr(obj, "more_rules", None)
    return field_rules if more is None else [*field_rules, *more(prefix)]
