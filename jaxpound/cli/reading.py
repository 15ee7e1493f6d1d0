"""From a TOML file to Structs whose fields state the rules of their values.

msgspec validates a file. Here its errors become messages with the file, the table and the key, the
value as written in the file, and the rule that it breaks.
"""

from __future__ import annotations

import json
import re
import sys
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import NoneType
from typing import Any, Literal, TypeVar, dataclass_transform, get_args, get_origin

import msgspec
from msgspec import inspect

from jaxpound._checks import Range, did_you_mean
from jaxpound._fields import Parameter, walk
from jaxpound._version import __version__
from jaxpound.cli.files import example
from jaxpound.cli.syntax import long_key, syntax_error

_MOST_BYTES = 2**20  # of a file: a configuration is a page of text
_MOST_SHOWN = 80  # characters of a value in a message
_TOP = "the top level"

T = TypeVar("T", bound="Table")


# --- rules of fields ----------------------------------------------------------------------------


@dataclass_transform(frozen_default=True, field_specifiers=(msgspec.field,))
class Table(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """A table of a file, or the whole file.

    A message of a ``ValueError`` in ``__post_init__`` is preceded by the name of the table.
    """


def between(low: float, high: float, unit: str = "", why: str = "") -> msgspec.Meta:
    """Annotation: the range of a number; a whole number needs no unit and reason."""
    return msgspec.Meta(ge=low, le=high, extra={"range": Range(low, high, unit, why)})


def of_field(cls: type, name: str) -> msgspec.Meta:
    """Annotation: the range of a number that is a parameter of one of the library's classes."""
    (allowed,) = (parameter.within for path, parameter, _ in walk(cls, Parameter) if path == name)
    assert allowed is not None
    return between(*allowed)


def says(words: str, allowed: Range | None = None, **rules: Any) -> msgspec.Meta:
    """Annotation of a value that is no number: ``words`` complete 'must be'.

    ``allowed`` is the range of the numbers in it.
    """
    return msgspec.Meta(extra={"says": words, "range": allowed}, **rules)


def each(number: Any, alone: bool = True) -> msgspec.Meta:
    """Annotation of a list with a number for every storey, or where ``alone`` one number for all.

    ``number`` is the type of a number, with its range.
    """
    words = "a list with a number for each storey" + (", or one number for all" if alone else "")
    extra = {"says": words, "each": number, "alone": alone}
    return msgspec.Meta(extra=extra, min_length=None if alone else 1)


Count = between(1, 2**31)
"""Range of a count."""

Seed = between(0, 2**32 - 1)
"""Range of a seed of random numbers: 32 bits."""


def ranges(kind: type[Table]) -> dict[str, Range]:
    """The ranges of a table's numbers, by key."""
    said = {name: _bare(field)[1].get("range") for name, field in entries(kind).items()}
    return {name: allowed for name, allowed in said.items() if allowed}


def _bare(kind: Any) -> tuple[Any, dict[str, Any]]:
    """A field's type as msgspec describes it, without None, and the annotations of the field."""
    info: Any = inspect.type_info(kind)
    said: dict[str, Any] = {}
    while isinstance(info, inspect.Metadata | inspect.UnionType):
        if isinstance(info, inspect.Metadata):
            said |= info.extra or {}
            info = info.type
            continue
        given = [one for one in info.types if not isinstance(one, inspect.NoneType)]
        if len(given) > 1:
            break
        (info,) = given
    return info, said


def entries(kind: Any) -> dict[str, Any]:
    """Types of the values that a table may have, by key; none where keys are not fixed."""
    info, _ = _bare(kind)
    if isinstance(info, inspect.StructType):
        return {field.encode_name: field.type for field in msgspec.structs.fields(info.cls)}
    return {}


def is_table(kind: Any) -> bool:
    """Whether a field is written as a table below a [name], and not as a value after a key."""
    info, said = _bare(kind)
    return isinstance(info, inspect.StructType | inspect.DictType) and "says" not in said


def of_array(kind: Any) -> Any:
    """The tables of an array that is written as tables below [[name]]; None for other fields."""
    info, _ = _bare(kind)
    if not isinstance(info, inspect.ListType):
        return None
    item = info.item_type
    return item.cls if isinstance(item, inspect.StructType) else None


# --- a file -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class File:
    """A configuration file, or the example of a command."""

    name: str
    """The start of every message."""
    text: str
    folder: Path = Path()
    """Folder to which the paths in it are relative."""

    @staticmethod
    def opened(path: Path | None, command: str) -> File:
        """A file, or the example of a command if there is no path.

        Raises
        ------
        OSError
            If it cannot be read.
        ValueError
            If it is too large for a configuration, or no text in UTF-8.
        """
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
        """What a summary begins with: the version, and what the file holds."""
        return {"jaxpound": __version__, "configuration": tomllib.loads(self.text)}

    def read(self, kind: type[T]) -> T:
        """What the file holds.

        Raises
        ------
        ValueError
            If it is not TOML, has a key of more than 20 parts or one that is not allowed, lacks one
            that is needed, or a value is of the wrong type or breaks its rule.
        """
        if fault := long_key(self.text):
            raise ValueError(f"{self.name}{fault}")
        given = self._parsed(self.text)
        for name, entry in entries(kind).items():
            if isinstance(_bare(entry)[0], inspect.DictType) and isinstance(given.get(name), dict):
                given[name] = _by_path(given[name])
        try:
            return msgspec.convert(given, kind)
        except msgspec.ValidationError as error:
            words = _table_fault(kind, given, _TOP, kind) or str(error)
            raise ValueError(f"{self.name}: {words}") from error

    def _parsed(self, text: str) -> dict[str, Any]:
        try:
            return tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise ValueError(f"{self.name}{syntax_error(text, str(error))}") from error
        except RecursionError as error:
            raise ValueError(f"{self.name}: its lists or tables are nested too deeply") from error
        except ValueError:
            # Python reads no whole number of more than 4,300 digits. Cut to 4,300 digits, it still
            # exceeds every range, and the message names its key.
            return self._parsed(re.sub(r"\d[\d_]*", _shortened, text))


def _shortened(digits: re.Match[str]) -> str:
    most = sys.get_int_max_str_digits()
    return digits[0] if len(digits[0]) <= most else digits[0].replace("_", "")[:most]


def _by_path(table: dict[str, Any], above: str = "") -> dict[str, Any]:
    """Flatten ``rod_1.tau_x = ...``, which TOML reads as a nested table if it is not quoted."""
    flat: dict[str, Any] = {}
    for key, value in table.items():
        nested = isinstance(value, dict) and value
        inside = nested and all(isinstance(one, dict) for one in value.values())
        flat |= _by_path(value, f"{above}{key}.") if inside else {f"{above}{key}": value}
    return flat


@contextmanager
def named(
    place: str, units: Mapping[str, str] | None = None, keys: Mapping[str, str] | None = None
) -> Iterator[None]:
    """In messages of the core, replace the name of the class by the place in the file.

    Of runs that end in numbers that are not finite, too. ``units`` are those of the numbers in
    these messages, by name, and ``keys`` are what a file calls the parameters of the core, by path.
    """
    try:
        yield
    except (ValueError, FloatingPointError) as error:
        words = re.sub(r"^[A-Za-z_.]+: ", "", str(error))
        if keys:
            paths = "|".join(map(re.escape, keys))
            words = re.sub(rf"(?<![\w.])({paths})(?!\w)", lambda path: keys[path[0]], words)
        for name, unit in (units or {}).items():
            if unit:
                words = re.sub(rf"(?<!\w)({name} = -?[\w.+-]*\w)", rf"\1 {unit}", words)
        raise ValueError(f"{place} {words}".lstrip()) from error


# --- messages -----------------------------------------------------------------------------------


def _table_fault(kind: Any, given: dict[str, Any], title: str, root: Any) -> str:
    """What is wrong with a table, in words; empty if nothing is.

    ``title`` is ``_TOP`` for the whole file, a [table] of it, the second of the [[tables]] of an
    array, a table in these, or "it" for the value of a key.
    """
    kinds, place = entries(kind), f"{title} " if title.startswith("[") else ""
    if isinstance(_bare(kind)[0], inspect.DictType):  # the keys are judged with the structures
        kinds = dict.fromkeys(given, get_args(kind)[1])
    for key, value in given.items():
        if key not in kinds:
            return unknown_key(title, key, _meant(key, kind, root))
        if item := of_array(kinds[key]):
            words = _array_fault(item, value, key, root)
        elif not is_table(kinds[key]):
            words = _fault(kinds[key], value, f"{place}{key}")
        elif isinstance(value, dict):
            inner = f"[{key}]" if title == _TOP else f"{place}{key}"
            words = _table_fault(kinds[key], value, inner, root)
        else:
            written = f", [{key}]" if title == _TOP else ""
            words = f"{place}{key} = {shown(value)} must be a table{written}"
        if words:
            return words
    for field in getattr(_bare(kind)[0], "fields", ()):
        if field.required and field.encode_name not in given:
            what = "the table [{}]" if is_table(kinds[field.encode_name]) else "the key '{}'"
            return f"{title} lacks {what.format(field.encode_name)}"
    own = _refusal(kind, given)
    return f"{place}{own}" if own else ""


def unknown_key(place: str, key: str, meant: str, what: str = "key") -> str:
    """That a table has a key, or ``what`` else it is, that nobody knows; shortened if it is long.

    ``meant`` is the question or the list that follows.
    """
    return f"{place} has an unknown {what} {_shortened_to_fit(repr(key))}; {meant}"


def _array_fault(kind: type[Table], given: Any, key: str, root: Any) -> str:
    """What is wrong with the tables below [[key]], in words; empty if nothing is."""
    if not isinstance(given, list) or not all(isinstance(one, dict) for one in given):
        return f"{key} = {shown(given)} must be tables, each below a line [[{key}]]"
    faults = (
        _table_fault(kind, one, f"[[{key}]] {number}", root) for number, one in enumerate(given, 1)
    )
    return next(filter(None, faults), "")


def _meant(key: str, kind: Any, root: Any) -> str:
    """The most similar allowed key, or the table in which an unknown key would be allowed."""
    allowed = [*entries(kind)]
    if close := did_you_mean(key.lower(), allowed):
        return close
    tables = {f"[{name}]": x for name, x in entries(root).items() if is_table(x)}
    tables[f"{_TOP}, before the first [table]"] = root
    if homes := [title for title, x in tables.items() if key in entries(x)]:
        return f"it belongs in {' or '.join(homes)}"
    return f"allowed are {', '.join(allowed)}"


def _fault(kind: Any, value: Any, place: str) -> str:
    """What is wrong with the value of a key, in words; empty if nothing is."""
    if not _refusal(kind, value):
        return ""
    info, said = _bare(kind)
    told, allowed = shown(value), said.get("range")
    listed = isinstance(value, list) and value
    if "each" in said and (listed or (said["alone"] and is_number(value))):
        return _fault_of_each(said["each"], value, place)
    if "says" in said:
        rule = said["says"] + _inner_fault(info, value)
    elif allowed:
        if isinstance(info, inspect.IntType) and type(value) is not int:
            rule = "a whole number"
        elif not is_number(value):
            rule = "a finite number"
        else:
            told, rule = allowed.told(told), allowed.rule
    elif isinstance(info, inspect.LiteralType):
        words = _words(kind)
        rule = "one of " + ", ".join(f'"{word}"' for word in words)
        if isinstance(value, str) and (close := did_you_mean(value, words)):
            rule += f"; {close}"
    else:
        words_of: dict[Any, str] = {inspect.BoolType: "true or false", inspect.StrType: "a text"}
        rule = words_of.get(type(info), "a finite number")
    return f"{place} = {told} must be {rule}"


def _inner_fault(info: Any, value: Any) -> str:
    """What is wrong with a table that is the value of a key, if it is one."""
    faults = (
        f"; {_table_fault(inner.cls, value, 'it', inner.cls)}"
        for inner in getattr(info, "types", [info])
        if isinstance(inner, inspect.StructType) and isinstance(value, dict)
    )
    return "".join(faults)


def _fault_of_each(number: Any, value: Any, place: str) -> str:
    """What is wrong with a number for all storeys, or with the first wrong one of a list."""
    if not isinstance(value, list):
        return _fault(number, value, place)
    faults = (_fault(number, x, f"{place}: storey {i}") for i, x in enumerate(value, 1))
    return next(filter(None, faults), "")


def _words(kind: Any) -> tuple[str, ...]:
    """The words of a literal, or of one that may be left out, in their order."""
    if get_origin(kind) is Literal:
        return get_args(kind)
    return next((_words(one) for one in get_args(kind) if one is not NoneType), ())


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
