"""Rules for input, written once for concrete and for traced values.

A concrete value that breaks a rule raises ``InvalidInput``, a ``ValueError``; for a traced one
(under ``jit``, ``vmap`` or ``grad``) the rule is a traced flag that turns every result into NaN.
"""

from __future__ import annotations

import contextlib
import difflib
import os
import re
import reprlib
from collections.abc import Callable, Collection, Iterable, Sequence
from contextlib import AbstractContextManager, nullcontext
from decimal import Decimal
from pathlib import Path
from types import NoneType
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.tree_util import all_leaves

from jaxpound._errors import InvalidInput


class Rule(NamedTuple):
    """``holds`` is a boolean (array) of the value's shape; ``says`` completes 'must be ...'."""

    name: str
    value: Any
    holds: Any
    says: str


class Range(NamedTuple):
    """Range of a number in SI that covers all buildings; ``why``, a reason, ends the message."""

    low: float
    high: float
    unit: str = ""
    why: str = ""

    def __contains__(self, value: object) -> bool:
        return isinstance(value, int | float) and self.low <= value <= self.high

    @property
    def rule(self) -> str:
        """Completes 'must be'."""
        if not self.why:
            return f"from {self.low} to {self.high}"
        return f"between {self.with_unit(f'{self.low:g} and {self.high:g}')} ({self.why})"

    def with_unit(self, number: str) -> str:
        """A number with its unit, if it has one."""
        return f"{number} {self.unit}" if self.unit else number

    def of(self, name: str, value: Any) -> Rule:
        """The rule that a number, or every number of an array, is in the range."""
        return Rule(name, value, (value >= self.low) & (value <= self.high), self.rule)

    def require(self, place: str, value: Any) -> None:
        """An ``InvalidInput``, named by ``place``, for a number outside the range."""
        if (number := float(value)) not in self:
            raise InvalidInput(place, self.with_unit(f"{number:.6g}"), f"must be {self.rule}")


def is_traced(tree: Any) -> bool:
    """Whether any leaf of ``tree`` is a tracer, without a value until the compiled program runs."""
    return any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(tree))


def evaluated(tree: Any) -> AbstractContextManager[None]:
    """A context in which what follows from known numbers is known, also while others are traced.

    It changes nothing where the tree itself is traced.
    """
    return nullcontext() if is_traced(tree) else jax.ensure_compile_time_eval()


def is_known_and_single(tree: Any) -> bool:
    """Whether all leaves of ``tree`` are numbers: neither tracers nor arrays of a batch."""
    return not is_traced(tree) and not any(np.ndim(leaf) for leaf in jax.tree.leaves(tree))


def real(name: str, value: Any) -> Any:
    """``value`` as floating-point numbers if it is real or traced; else an ``InvalidInput``.

    Floats keep their precision; integers become floats, which do not overflow and have gradients.
    Lists, and arrays that JAX refuses (of another byte order, say), become NumPy arrays.
    """
    if isinstance(value, jax.core.Tracer):
        return value
    if isinstance(value, list | tuple) and is_traced(value):
        return jnp.asarray(value)
    try:
        value = float(value) if type(value) is int else value
        array = np.asarray(value)
    except Exception as error:
        raise InvalidInput(name, reprlib.repr(value), f"is not a number ({error})") from error
    if array.dtype.kind not in "fiu":
        none = " (0 stands for none)" if value is None and name.startswith("friction") else ""
        raise InvalidInput(name, reprlib.repr(value), f"must be a real number{none}")
    if isinstance(value, jax.Array):
        return value if array.dtype.kind == "f" else value.astype(float)
    if isinstance(value, float):
        return value
    if array.dtype not in (np.float16, np.float32, np.float64):
        array = array.astype(np.float64)
    return array[()] if isinstance(value, np.generic) else array


def array(name: str, value: Any, *shapes: tuple[int, ...]) -> np.ndarray:
    """Known real numbers as an array of one of some shapes, in which −1 is any length from 1 on."""
    x = np.asarray(real(name, value), float)

    def fits(shape: tuple[int, ...]) -> bool:
        sizes = zip(shape, x.shape, strict=True)
        return len(shape) == x.ndim and all(m == n or m < 0 < n for m, n in sizes)

    if not any(map(fits, shapes)):
        listed = " or ".join(str(shape or "one number") for shape in shapes)
        rule = listed.replace("-1,)", "n,) with n ≥ 1")
        raise InvalidInput(name, "", f"of shape {x.shape} must be {rule}")
    return x


def number(name: str, value: Any) -> Any:
    """``real`` of a single number; an ``InvalidInput`` for an array."""
    if jnp.ndim(value := real(name, value)):
        raise InvalidInput(name, "", f"of shape {jnp.shape(value)} must be one number")
    return value


def is_whole(value: Any) -> bool:
    """Whether a value is a concrete integer, or an array of shape () that holds one; no bool."""
    if isinstance(value, np.ndarray | jax.Array):
        return not is_traced(value) and value.ndim == 0 and jnp.issubdtype(value.dtype, np.integer)
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


def count(name: str, value: Any) -> int:
    """``value`` as an integer; an ``InvalidInput`` if it is not a positive whole number."""
    if not (is_whole(value) and value >= 1):
        raise InvalidInput(name, repr(value), "must be a positive whole number")
    return int(value)


def seed(name: str, value: Any) -> int:
    """``value`` as a seed; an ``InvalidInput`` if it is not a whole number from 0 to 2^32 − 1."""
    if not (is_whole(value) and 0 <= value < 2**32):
        raise InvalidInput(name, repr(value), "must be a whole number from 0 to 2^32 - 1")
    return int(value)


def require_memory(name: str, value: int, size: int) -> None:
    """An ``InvalidInput`` if ``value`` items of together ``size`` bytes or more do not fit."""
    if size > _MOST_MEMORY * (memory := machine_memory()):
        shown = f"{value:,}" if value < 10**15 else f"{Decimal(value):.3g}"
        rule = f"would take {_in_bytes(size)} of memory; this machine has {_in_bytes(memory)}"
        raise InvalidInput(name, shown, rule)


def machine_memory() -> int:
    """Bytes of memory that this process may use, or very many if it is not reported."""
    sizes = [2**60]
    with contextlib.suppress(AttributeError, ValueError, OSError):
        sizes.append(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    for limit in _CONTAINER_LIMITS:
        with contextlib.suppress(ValueError, OSError):  # "max", or no such file
            sizes.append(int(Path(limit).read_text()))
    return min(x for x in sizes if x > 0)


_MOST_MEMORY = 0.8  # share of the machine's: the program itself needs the rest
_CONTAINER_LIMITS = (  # of Linux, and its older interface
    "/sys/fs/cgroup/memory.max",
    "/sys/fs/cgroup/memory/memory.limit_in_bytes",
)


def _in_bytes(size: int) -> str:
    """A number of bytes in the largest decimal unit that it reaches."""
    units = ["bytes", "kB", "MB", "GB", "TB", "PB", "EB"]
    power = min((len(f"{min(size, 10**30)}") - 1) // 3, len(units) - 1)
    return f"{Decimal(size) / 1000**power:.3g} {units[power]}"


def require_share(name: str, value: Any) -> None:
    """An ``InvalidInput`` for a number that is not between 0 and 1."""
    value = number(name, value)
    enforce([Rule(name, value, (value > 0) & (value < 1), "between 0 and 1")])


def did_you_mean(word: str, allowed: Iterable[str]) -> str:
    """A question with the closest of the allowed words; empty if none is close."""
    close = difflib.get_close_matches(word, allowed, n=1)
    return f"did you mean {close[0]!r}?" if close else ""


def hint(word: Any, allowed: Iterable[str]) -> str:
    """``did_you_mean`` for an unknown word, or else the list of all allowed words."""
    allowed = list(allowed)
    return did_you_mean(str(word), allowed) or f"allowed: {', '.join(allowed)}"


def require_one_of(value: Any, allowed: Collection[str], name: str = "") -> None:
    """An ``InvalidInput``, by the value or by a name, for a value that is none of those allowed."""
    if value not in allowed:
        subject = (name, repr(value)) if name else (repr(value), "")
        raise InvalidInput(*subject, f"must be one of {', '.join(allowed)}")


def refusal(call: Callable[[], Any]) -> str:
    """Message of the error that a call with concrete values raises; empty if it raises none."""
    try:
        call()
    except (ValueError, FloatingPointError) as error:
        return str(error)
    return ""


def positive(**values: Any) -> list[Any]:
    """``real`` of each value; an error for a concrete one that is not positive and finite."""
    return _numbers(values, lambda x: x > 0, "positive and finite")


def positive_number(**values: Any) -> list[Any]:
    """``positive`` of values each of which must be one number."""
    return positive(**{name: number(name, x) for name, x in values.items()})


def not_negative(**values: Any) -> list[Any]:
    """``real`` of each value; an error for a concrete one that is negative or not finite."""
    return _numbers(values, lambda x: x >= 0, "finite and not negative")


def _numbers(values: dict[str, Any], holds: Callable[..., Any], says: str) -> list[Any]:
    numbers = {name: real(name, value) for name, value in values.items()}
    enforce([Rule(name, x, holds(x) & finite(x), says) for name, x in numbers.items()])
    return [*numbers.values()]


def require_batch(**values: Any) -> None:
    """An ``InvalidInput`` for arrays whose shapes do not broadcast."""
    shapes = {name: jnp.shape(value) for name, value in values.items()}
    try:
        np.broadcast_shapes(*shapes.values())
    except ValueError:
        listed = ", ".join(f"{name} {shape}" for name, shape in shapes.items())
        raise InvalidInput("", "", f"the shapes of {listed} must make one batch") from None


def instance(name: str, value: Any, *kinds: type) -> None:
    """An ``InvalidInput`` for an object of another type."""
    if isinstance(value, type) or not isinstance(value, kinds):  # a class has a protocol's methods
        types = " or ".join("None" if kind is NoneType else kind.__name__ for kind in kinds)
        rule = f"must be of type {types}{instead(value, types)}"
        raise InvalidInput(name, reprlib.repr(value), rule)


def instead(value: Any, types: str) -> str:
    """Ends a message on a wrong object, in the place of ``types``: the function that takes it."""
    if re.search(r"\bRecord\b", types) and isinstance(value, str | os.PathLike):
        return "; read_record reads one from a file"
    if types == "ScenarioSet":
        return "; Scenarios(structures, ground) makes one"
    if hasattr(value, "pgas"):
        return "; of a suite of records it is one, suite[0], or RandomRecord and Analysis take all"
    first = value[0] if isinstance(value, tuple | list) and value else value
    if hasattr(type(first), "natural_period"):  # a building
        return "; Buildings((left, right), links) makes structures of them"
    if not hasattr(type(first), "system"):
        return ""
    parts = "; its field buildings has each building" if hasattr(first, "buildings") else ""
    return f"; simulate and demand take structures{parts}"


def as_tuple(name: str, value: Any) -> tuple[Any, ...]:
    """A sequence as a tuple; an ``InvalidInput`` for anything else."""
    if not isinstance(value, Sequence | np.ndarray | jax.Array) or isinstance(value, str):
        rule = f"must be a tuple{instead(value, 'tuple') or ', as (x,) is'}"
        raise InvalidInput(name, reprlib.repr(value), rule)
    return tuple(value)


def pytree(name: str, value: Any) -> None:
    """An ``InvalidInput`` for an object that is no pytree: JAX would not see its numbers."""
    if all_leaves([value]):
        both = "@jax.tree_util.register_dataclass and then @dataclasses.dataclass(frozen=True)"
        rule = f"of type {type(value).__name__} must be a pytree: put {both} before its class"
        raise InvalidInput(name, "", rule)


def require_folder(path: str | os.PathLike[str]) -> None:
    """A ``FileNotFoundError`` if the folder of a file to be read or written is missing."""
    if not (folder := Path(path).absolute().parent).is_dir():
        raise FileNotFoundError(f"{os.fspath(path)}: the folder {folder} is missing")


def finite(x: Any) -> Any:
    """Elementwise finiteness by comparison, for NumPy and traced values alike."""
    return abs(x) < float("inf")


def enforce(rules: Iterable[Rule]) -> None:
    """An ``InvalidInput`` for the first rule that a concrete value breaks."""
    for rule in rules:
        if is_traced((rule.value, rule.holds)):
            continue
        if not (holds := np.asarray(rule.holds)).all():
            value, holds = np.broadcast_arrays(rule.value, holds)
            first = np.unravel_index(np.argmin(holds), holds.shape)
            index = f" (at index [{', '.join(map(str, first))}])" if first else ""
            shown = f"{value[first].item():.8g}{index}"
            raise InvalidInput(rule.name, shown, f"must be {rule.says}")


def all_hold(rules: Iterable[Rule]) -> jax.Array:
    """A traced flag: whether every rule holds for every element."""
    flag = jnp.asarray(True)
    for rule in rules:
        flag = flag & (jnp.all(rule.holds) if np.ndim(rule.holds) else rule.holds)
    return flag
