"""From a TOML file to Structs whose fields state the rules of their values.

msgspec validates a file. Here its errors become messages with the file, the table and the key, the
value as written in the file, and the rule that it breaks.
"""

from __future__ import annotations

import json
import re
import sys
import tomllib
from collections.abc import Container, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, Literal, TypeVar, dataclass_transform, get_args, get_origin

import msgspec
from msgspec import inspect

from jaxpound._checks import Range, did_you_mean
from jaxpound._errors import InvalidInput
from jaxpound._fields import Parameter, walk
from jaxpound._version import __version__
from jaxpound.cli.files import example
from jaxpound.cli.syntax import long_key, syntax_error

_MOST_BYTES = 2**20  # of a file: a configuration is a page of text
_MOST_SHOWN = 80  # characters of a value in a message
_TOP = "the top level"

T = TypeVar("T", bound="Section")


@dataclass_transform(frozen_default=True, field_specifiers=(msgspec.field,))
class Section(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """A table of a file, or the whole file.

    A message of a ``ValueError`` in ``__post_init__`` is preceded by the name of the table.
    """

    def stated(self) -> dict[str, Any]:
        """The values that are not left out, by key."""
        return {key: x for key, x in msgspec.structs.asdict(self).items() if x is not None}

    def refuse_any(self, keys: Container[str], rule: str) -> None:
        """A ``ValueError`` for the first of these keys that is stated."""
        for key in self.stated():
            if key in keys:
                raise refused(key, rule)

    def require_all(self, keys: Iterable[str], why: str = "") -> None:
        """A ``ValueError`` for the first of these keys that is left out."""
        for key in keys:
            if getattr(self, key) is None:
                raise ValueError(f"lacks the key {key!r}{why}")


def refused(key: str, rule: str, value: str = "") -> InvalidInput:
    """The error for a key of a table, or for its value as it is printed."""
    return InvalidInput(key, value, rule)


def between(low: float, high: float, unit: str = "", why: str = "") -> msgspec.Meta:
    """Annotation: the range of a number; a whole number needs no unit and reason."""
    most = high if high < float("inf") else None
    return msgspec.Meta(ge=low, le=most, extra={"range": Range(low, high, unit, why)})


def of_field(cls: type, name: str) -> msgspec.Meta:
    """Annotation: the range of a number that is a parameter of one of the library's classes."""
    (parameter,) = (parameter for path, parameter, _ in walk(cls, Parameter) if path == name)
    return between(*parameter.range)


def says(words: str, allowed: Range | None = None, **rules: Any) -> msgspec.Meta:
    """Annotation: ``words`` complete 'must be', ``allowed`` is the range of numbers inside."""
    return msgspec.Meta(extra={"says": words, "range": allowed}, **rules)


def each(number: Any, alone: bool = True) -> msgspec.Meta:
    """Annotation of a list with a number for each storey, or where ``alone`` one for all."""
    words = "a list with a number for each storey" + (", or one number for all" if alone else "")
    extra = {"says": words, "each": number, "alone": number if alone else None}
    return msgspec.Meta(extra=extra, min_length=None if alone else 1)


Numbers = Annotated[list[float], says("a list of two numbers or more", min_length=2)]
Count = between(1, 2**31)
Seed = between(0, 2**32 - 1)


def ranges(kind: type[Section]) -> dict[str, Range]:
    """The ranges of a table's numbers, by key."""
    by_key = {name: _bare(field)[1].get("range") for name, field in entries(kind).items()}
    return {name: allowed for name, allowed in by_key.items() if allowed}


def _bare(kind: Any) -> tuple[Any, dict[str, Any]]:
    """A field's type as msgspec describes it, without None, and the annotations of the field."""
    info: Any = inspect.type_info(kind)
    annotations: dict[str, Any] = {}
    while isinstance(info, inspect.Metadata | inspect.UnionType):
        if isinstance(info, inspect.Metadata):
            annotations |= info.extra or {}
            info = info.type
            continue
        if len(types := [x for x in info.types if not isinstance(x, inspect.NoneType)]) > 1:
            break
        (info,) = types
    return info, annotations


def entries(kind: Any) -> dict[str, Any]:
    """Types of the values that a table may have, by key; none where keys are not fixed."""
    info, _ = _bare(kind)
    fields = msgspec.structs.fields(info.cls) if isinstance(info, inspect.StructType) else ()
    return {field.encode_name: field.type for field in fields}


def is_table(kind: Any) -> bool:
    """Whether a field is written as a table below a [name], and not as a value after a key."""
    info, annotations = _bare(kind)
    return isinstance(info, inspect.StructType | inspect.DictType) and "says" not in annotations


def _is_dict(kind: Any) -> bool:
    return isinstance(_bare(kind)[0], inspect.DictType)


def of_array(kind: Any) -> Any:
    """The tables of an array that is written as tables below [[name]]; None for other fields."""
    return getattr(getattr(_bare(kind)[0], "item_type", None), "cls", None)


@dataclass(frozen=True)
class File:
    """A configuration file, or the example of a command."""

    name: str  # the start of every message
    text: str
    folder: Path = Path()  # to which the paths in the file are relative

    @staticmethod
    def opened(path: Path | None, command: str) -> File:
        """A file of text in UTF-8, or the example of a command if there is no path."""
        if path is None:
            return File(f"example of jaxpound {command}", example(command))
        with path.open("rb") as file:
            content = file.read(_MOST_BYTES + 1)
        if len(content) > _MOST_BYTES:
            raise ValueError(f"{path}: must be a configuration of at most {_MOST_BYTES:,} bytes")
        try:
            return File(str(path), content.decode("utf-8"), path.parent)
        except UnicodeDecodeError as error:
            raise ValueError(f"{path}: must be text in UTF-8 ({error})") from error

    @property
    def origin(self) -> dict[str, Any]:
        """The beginning of a summary: the version, and the content of the file."""
        return {"jaxpound": __version__, "configuration": tomllib.loads(self.text)}

    def read(self, kind: type[T]) -> T:
        """What the file holds; a ``ValueError`` for its first fault."""
        if fault := long_key(self.text):
            raise ValueError(f"{self.name}{fault}")
        content, tables = self._parsed(self.text), entries(kind)
        for name, table in content.items():
            if isinstance(table, dict) and name in tables and _is_dict(tables[name]):
                content[name] = _by_path(table)
        try:
            return msgspec.convert(content, kind)
        except msgspec.ValidationError as error:
            fault = _table_fault(kind, content, _TOP, kind) or str(error)
            raise ValueError(f"{self.name}: {fault}") from error

    def _parsed(self, text: str) -> dict[str, Any]:
        try:
            return tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise ValueError(f"{self.name}{syntax_error(text, str(error))}") from error
        except RecursionError as error:
            raise ValueError(f"{self.name}: its lists or tables are nested too deeply") from error
        except ValueError:
            # Python reads at most 4,300 digits; cut to these, a number still exceeds every range.
            most = sys.get_int_max_str_digits()
            long = rf"(?<![\d_])\d[\d_]{{{most},}}"
            return self._parsed(re.sub(long, lambda x: x[0].replace("_", "")[:most], text))


def _by_path(table: dict[str, Any], above: str = "") -> dict[str, Any]:
    """Flatten ``rod_1.tau_x = ...``, which TOML reads as a nested table if it is not quoted."""
    flat: dict[str, Any] = {}
    for key, value in table.items():
        nested = isinstance(value, dict) and value
        is_part = nested and all(isinstance(x, dict) for x in value.values())
        flat |= _by_path(value, f"{above}{key}.") if is_part else {f"{above}{key}": value}
    return flat


@contextmanager
def named(
    place: str, units: Mapping[str, str] | None = None, keys: Mapping[str, str] | None = None
) -> Iterator[None]:
    """Replace the owner in messages of the library by the place in the file.

    ``units`` of the numbers in them are by name, ``keys`` of a file by the parameter's path.
    """
    try:
        yield
    except (ValueError, FloatingPointError) as error:
        if isinstance(error, InvalidInput):
            part = error.owner.partition(": ")[2]  # of the owner, such as storeys.2
            part = re.sub(r"^storeys\.(\d+)$", lambda i: f"storey {int(i[1]) + 1}", part)
            message = str(error.replaced(owner=part))
        else:
            message = re.sub(r"^[A-Za-z_.]+: ", "", str(error))
        message = by_key(message, keys or {})
        for name, unit in (units or {}).items():
            if unit:
                message = re.sub(rf"(?<!\w)({name} = -?[\w.+-]*\w)", rf"\1 {unit}", message)
        raise ValueError(f"{place} {message}".lstrip()) from error


def by_key(message: str, keys: Mapping[str, str]) -> str:
    """A message with the keys of a file for the paths of its parameters."""
    paths = "|".join(map(re.escape, keys)) or "(?!)"
    return re.sub(rf"(?<![\w.])({paths})(?!\w)", lambda path: keys[path[0]], message)


def _table_fault(kind: Any, table: dict[str, Any], title: str, root: Any) -> str:
    """The fault of a table, in words; empty if it has none.

    ``title`` is ``_TOP``, a [table], one of [[tables]] with its number, or "it": a key's value.
    """
    kinds, place = entries(kind), f"{title} " if title.startswith("[") else ""
    if _is_dict(kind):  # the keys are judged with the structures
        kinds = dict.fromkeys(table, get_args(kind)[1])
    for key, value in table.items():
        if key not in kinds:
            return unknown_key(title, key, _meant(key, kind, root))
        inner = f"[{key}]" if title == _TOP else f"{place}{key}"
        if item := of_array(kinds[key]):
            fault = _array_fault(item, value, key, root)
        elif not is_table(kinds[key]):
            fault = _fault(kinds[key], value, f"{place}{key}")
        elif isinstance(value, dict):
            fault = _table_fault(kinds[key], value, inner, root)
        else:
            heading = f", {inner}" if title == _TOP else ""
            fault = f"{place}{key} = {shown(value)} must be a table{heading}"
        if fault:
            return fault
    for field in getattr(_bare(kind)[0], "fields", ()):
        key = field.encode_name
        if field.required and key not in table:
            noun = f"the table [{key}]" if is_table(kinds[key]) else f"the key '{key}'"
            return f"{title} lacks {noun}"
    return f"{place}{fault}" if (fault := _refusal(kind, table)) else ""


def unknown_key(place: str, key: str, meant: str, noun: str = "key") -> str:
    """The message on an unknown key, with the question or list that says what is ``meant``."""
    return f"{place} has an unknown {noun} {_shortened_to_fit(repr(key))}; {meant}"


def _array_fault(kind: type[Section], array: Any, key: str, root: Any) -> str:
    if not isinstance(array, list) or not all(isinstance(table, dict) for table in array):
        return f"{key} = {shown(array)} must be tables, each below a line [[{key}]]"
    faults = (_table_fault(kind, table, f"[[{key}]] {i}", root) for i, table in enumerate(array, 1))
    return next(filter(None, faults), "")


def _meant(key: str, kind: Any, root: Any) -> str:
    """The most similar allowed key, or the table in which an unknown key would be allowed."""
    allowed = [*entries(kind)]
    if close := did_you_mean(key.lower(), allowed):
        return close
    tables = {f"[{name}]": x for name, x in entries(root).items() if is_table(x)}
    tables[f"{_TOP}, before the first [table]"] = root
    arrays = {f"[[{name}]]": of_array(x) for name, x in entries(root).items()}
    of_key = [[t for t, x in group.items() if key in entries(x)] for group in (tables, arrays)]
    if titles := of_key[0] or of_key[1]:
        return f"it belongs in {' or '.join(titles)}"
    return f"allowed are {', '.join(allowed)}"


def _fault(kind: Any, value: Any, place: str) -> str:
    """The fault of the value of a key, in words; empty if it has none."""
    if not _refusal(kind, value):
        return ""
    info, annotations = _bare(kind)
    text, allowed = shown(value), annotations.get("range")
    if annotations.get("alone") and is_number(value):
        return _fault(annotations["alone"], value, place)
    if "each" in annotations and isinstance(value, list) and value:
        of_storey = enumerate(value, 1)
        faults = (_fault(annotations["each"], x, f"{place}: storey {i}") for i, x in of_storey)
        return next(filter(None, faults), "")
    if "says" in annotations:
        rule = annotations["says"] + _inner_fault(info, value)
    elif allowed:
        if isinstance(info, inspect.IntType) and type(value) is not int:
            rule = "a whole number"
        elif not is_number(value):
            rule = "a finite number"
        else:
            text, rule = allowed.with_unit(text), allowed.rule
    elif isinstance(info, inspect.LiteralType):
        words = _words(kind)
        rule = "one of " + ", ".join(f'"{word}"' for word in words)
        if isinstance(value, str) and (close := did_you_mean(value, words)):
            rule += f"; {close}"
    else:
        words_of: dict[Any, str] = {inspect.BoolType: "true or false", inspect.StrType: "a text"}
        rule = words_of.get(type(info), "a finite number")
    return f"{place} = {text} must be {rule}"


def _inner_fault(info: Any, value: Any) -> str:
    tables = getattr(info, "types", [info]) if isinstance(value, dict) else []
    kinds = [inner.cls for inner in tables if isinstance(inner, inspect.StructType)]
    return "".join(f"; {_table_fault(kind, value, 'it', kind)}" for kind in kinds)


def _words(kind: Any) -> tuple[str, ...]:
    """The words of a literal, or of one that may be left out, in their order."""
    if get_origin(kind) is Literal:
        return get_args(kind)
    return next((_words(x) for x in get_args(kind) if x is not NoneType), ())


def _refusal(kind: Any, value: Any) -> str:
    """The error of msgspec, or of a ``__post_init__``, for a value; empty if there is none."""
    try:
        msgspec.convert(value, kind)
    except msgspec.ValidationError as error:
        return str(error)
    return ""


def is_number(value: Any) -> bool:
    """Whether a value of a file is a finite number."""
    return type(value) in (int, float) and abs(value) <= sys.float_info.max  # false for NaN too


def shown(value: Any) -> str:
    """A value as written in a file, shortened if it is long."""
    return _shortened_to_fit(_shown(value, 3))


def _shortened_to_fit(text: str) -> str:
    return text if len(text) <= _MOST_SHOWN else f"{text[: _MOST_SHOWN - 4]} ..."


def _shown(value: Any, depth: int) -> str:
    if isinstance(value, bool | str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, int) and abs(value) > sys.float_info.max:
        return f"a whole number of more than {sys.float_info.max_10_exp} digits"
    if isinstance(value, float):
        return repr(value) if len(repr(value)) <= 8 else f"{value:.8g}"
    if isinstance(value, dict | list) and not depth:
        return "..."
    if isinstance(value, list):
        return f"[{', '.join(_shown(x, depth - 1) for x in value[:_MOST_SHOWN])}]"
    if isinstance(value, dict):
        shortened = list(value.items())[:_MOST_SHOWN]
        return f"{{{', '.join(f'{key} = {_shown(x, depth - 1)}' for key, x in shortened)}}}"
    return str(value)
