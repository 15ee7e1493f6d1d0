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
from functools import partial
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeVar, dataclass_transform, get_args

import msgspec
from msgspec import inspect

from jaxpound._checks import Range, did_you_mean, refusal
from jaxpound._errors import InvalidInput
from jaxpound._fields import Parameter, walk
from jaxpound._version import __version__
from jaxpound.cli.files import example

_MOST_BYTES = 2**20  # of a file: a configuration is a page of text
_MOST_SHOWN = 80  # characters of a value in a message
_MOST_PARTS = 20  # of a key: their number squared takes memory
_LONG_KEY = re.compile(rf"(?<![\w\"'-])(?:[\w\"'-]++[ \t]*+\.[ \t]*+){{{_MOST_PARTS}}}")
_NUMBERS = {  # how TOML has numbers, by what is often written instead
    r"=\s*-?\d+,\d": "a decimal point, not a comma: 0.1",
    r"[=\[,]\s*-?\.\d": "a number begins with a digit: 0.1, not .1",
    r"[=\[,]\s*-?\d+\.(?!\d)": "a digit follows the point: 1.0, not 1.",
}
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

    def require_form(self, *forms: Form) -> Form:
        """The form of the table: of those it may have, that which has most of its keys.

        A ``ValueError`` for a key of another form, or for one that this needs and lacks.
        """
        stated = [key for key in self.stated() if any(key in form.keys for form in forms)]
        known = [len({*stated} & {*form.keys}) for form in forms]
        nearest = [form for form, n in zip(forms, known, strict=True) if n == max(known)]
        whole = (x for x in nearest if {*x.needed} <= {*stated} <= {*x.keys})
        form = next(whole, nearest[0])
        for key in stated:
            if key not in form.keys:
                others = ", or ".join(str(x) for x in forms if x is form or key in x.keys)
                raise ValueError(f"must not have {key} here; give {others}")
        if missing := [key for key in form.needed if key not in stated]:
            give = ", or ".join(map(str, nearest))
            raise ValueError(f"lacks {', '.join(missing)}; give {give}")
        return form


class Form(NamedTuple):
    """Keys that state a table: those that are needed, and those that may be given with them."""

    needed: tuple[str, ...]
    optional: tuple[str, ...] = ()

    @property
    def keys(self) -> tuple[str, ...]:
        """All of them."""
        return self.needed + self.optional

    def __str__(self) -> str:
        optional = f" ({', '.join(self.optional)})" if self.optional else ""
        return f"{', '.join(self.needed)}{optional}".strip()


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


def says(words: str, allowed: Range | None = None, alone: Any = None, **rules: Any) -> msgspec.Meta:
    """Annotation: ``words`` complete 'must be', ``allowed`` is the range of numbers inside.

    A number in the place of a list or table is of the type ``alone``.
    """
    return msgspec.Meta(extra={"says": words, "range": allowed, "alone": alone}, **rules)


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
        content, tables = self._parsed(), entries(kind)
        for name, table in content.items():
            if isinstance(table, dict) and name in tables and _is_dict(tables[name]):
                content[name] = _by_path(table)
        try:
            return msgspec.convert(content, kind)
        except msgspec.ValidationError as error:
            fault = refusal(partial(_require_table, kind, content, _TOP, kind)) or str(error)
            raise ValueError(f"{self.name}: {fault}") from error

    def _parsed(self) -> dict[str, Any]:
        if key := _LONG_KEY.search(self.text):
            place = f"{self.name}:{self.text.count(chr(10), 0, key.start()) + 1}"
            raise ValueError(f"{place}: a key must have at most {_MOST_PARTS} parts, between dots")
        try:
            return tomllib.loads(self.text)
        except tomllib.TOMLDecodeError as error:
            raise ValueError(f"{self.name}{self._syntax_error(str(error))}") from error
        except RecursionError as error:
            raise ValueError(f"{self.name}: its lists or tables are nested too deeply") from error
        except ValueError as error:
            most = f"{sys.get_int_max_str_digits():,} digits"
            raise ValueError(f"{self.name}: a whole number must have at most {most}") from error

    def _syntax_error(self, message: str) -> str:
        """Message for a line that is not TOML: its number, its text, and the reason."""
        if not (number := re.search(r"at line (\d+)", message)):
            return f": {message}"
        line = self.text.splitlines()[int(number[1]) - 1].strip()
        hints = [hint for form, hint in _NUMBERS.items() if re.search(form, line)]
        reason = "; ".join([message, *hints[:1]])
        return f":{number[1]}: {_shortened_to_fit(line)}: {reason}"


def _by_path(table: dict[str, Any], above: str = "") -> dict[str, Any]:
    """Flatten ``rod_1.tau_x = ...``, which TOML reads as a nested table if it is not quoted."""
    flat: dict[str, Any] = {}
    for key, value in table.items():
        nested = isinstance(value, dict) and value
        is_part = nested and all(isinstance(x, dict) for x in value.values())
        flat |= _by_path(value, f"{above}{key}.") if is_part else {f"{above}{key}": value}
    return flat


@contextmanager
def named(place: str, keys: Mapping[str, str] | None = None) -> Iterator[None]:
    """Replace the owner in messages of the library by the place in the file.

    ``keys`` of a file are by the parameter's path.
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
        raise ValueError(f"{place} {by_key(message, keys or {})}".lstrip()) from error


def by_key(message: str, keys: Mapping[str, str]) -> str:
    """A message with the keys of a file for the paths of its parameters."""
    paths = "|".join(map(re.escape, keys)) or "(?!)"
    return re.sub(rf"(?<![\w.])({paths})(?!\w)", lambda path: keys[path[0]], message)


def _require_table(kind: Any, table: dict[str, Any], title: str, root: Any) -> None:
    """A ``ValueError`` for the first fault of a table.

    ``title`` is ``_TOP``, a [table], one of [[tables]] with its number, or "it": a key's value.
    """
    kinds, place = entries(kind), f"{title} " if title.startswith("[") else ""
    if _is_dict(kind):  # the keys are judged with the structures
        kinds = dict.fromkeys(table, get_args(kind)[1])
    for key, value in table.items():
        if key not in kinds:
            raise ValueError(unknown_key(title, key, _meant(key, kind, root)))
        inner = f"[{key}]" if title == _TOP else f"{place}{key}"
        if item := of_array(kinds[key]):
            _require_tables(item, value, key, root)
        elif not is_table(kinds[key]):
            _require(kinds[key], value, f"{place}{key}")
        elif isinstance(value, dict):
            _require_table(kinds[key], value, inner, root)
        else:
            heading = f", {inner}" if title == _TOP else ""
            raise ValueError(f"{place}{key} = {shown(value)} must be a table{heading}")
    for field in getattr(_bare(kind)[0], "fields", ()):
        key = field.encode_name
        if field.required and key not in table:
            noun = f"the table [{key}]" if is_table(kinds[key]) else f"the key '{key}'"
            raise ValueError(f"{title} lacks {noun}")
    if fault := _refusal(kind, table):
        raise ValueError(f"{place}{fault}")


def _require_tables(kind: type[Section], array: Any, key: str, root: Any) -> None:
    if not isinstance(array, list) or not all(isinstance(table, dict) for table in array):
        raise ValueError(f"{key} = {shown(array)} must be tables, each below a line [[{key}]]")
    for i, table in enumerate(array, 1):
        _require_table(kind, table, f"[[{key}]] {i}", root)


def unknown_key(place: str, key: str, meant: str) -> str:
    """The message on an unknown key, with the question or list that says what is ``meant``."""
    return f"{place} has an unknown key {_shortened_to_fit(repr(key))}; {meant}"


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


def _require(kind: Any, value: Any, place: str) -> None:
    """A ``ValueError`` for the value of a key that is not of its type."""
    if not _refusal(kind, value):
        return
    info, annotations = _bare(kind)
    if annotations.get("alone") and is_number(value):
        _require(annotations["alone"], value, place)
    if "each" in annotations and isinstance(value, list):
        for i, x in enumerate(value, 1):
            _require(annotations["each"], x, f"{place}: storey {i}")
    text, rule = shown(value), _rule(info, annotations, value)
    if (allowed := annotations.get("range")) and rule == allowed.rule:
        text = allowed.with_unit(text)
    raise ValueError(f"{place} = {text} must be {rule}")


def _rule(info: Any, annotations: Mapping[str, Any], value: Any) -> str:
    """The rule that a value breaks; completes 'must be'."""
    if "says" in annotations:
        return annotations["says"] + _inner_fault(info, value)
    if allowed := annotations.get("range"):
        if isinstance(info, inspect.IntType) and type(value) is not int:
            return "a whole number"
        return allowed.rule if is_number(value) else "a finite number"
    if isinstance(info, inspect.LiteralType):
        words = [str(word) for word in info.values]
        close = did_you_mean(value, words) if isinstance(value, str) else ""
        return f"one of {', '.join(map(json.dumps, words))}{'; ' * bool(close)}{close}"
    words_of: dict[Any, str] = {inspect.BoolType: "true or false", inspect.StrType: "a text"}
    return words_of.get(type(info), "a finite number")


def _inner_fault(info: Any, value: Any) -> str:
    """The faults of a value as each of the tables that it may be, in words."""
    tables = getattr(info, "types", [info]) if isinstance(value, dict) else []
    kinds = [inner.cls for inner in tables if isinstance(inner, inspect.StructType)]
    return "".join(f"; {refusal(partial(_require_table, x, value, 'it', x))}" for x in kinds)


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
