"""The error for input that breaks a rule, and the warning of input that is implausible."""

from __future__ import annotations

import functools
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from types import FrameType
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

_INTERNAL = {"jaxpound", "jax", "jaxtyping", "beartype"}
_INTERNAL |= {"contextlib", "copy", "dataclasses", "functools"}
_COMMAND, _COMMAND_LINE = "jaxpound", "jaxpound.cli"


def _calls() -> Iterator[FrameType]:
    """The calls from here outwards to that which the user's program, or the command line, made."""
    frame: FrameType | None = sys._getframe(1)
    while frame and _module(frame).split(".")[0] in _INTERNAL and not _is_of_command_line(frame):
        yield frame
        frame = frame.f_back


def _module(frame: FrameType) -> str:
    return str(frame.f_globals.get("__name__", ""))


def _is_of_command_line(frame: FrameType | None) -> bool:
    return frame is not None and _module(frame).startswith(_COMMAND_LINE)


def caller() -> str:
    """The function or method that the user called, or the class of an object that is being made.

    Of functions that call each other it is the outermost, of constructors of public classes the
    innermost, whose arguments break a rule; of the command line it is the command.
    """
    owner = ""
    for frame in _calls():
        code, argument = frame.f_code, [*frame.f_code.co_varnames[:1]]
        cls, _, name = code.co_qualname.rpartition(".")
        if argument in (["self"], ["cls"]):  # by the object: a method may be inherited
            obj = frame.f_locals[argument[0]]
            kind = obj if isinstance(obj, type) else type(obj)
            cls = kind.__name__
            if name == "__post_init__" and _is_public(kind):
                return cls
        if "<" in code.co_qualname or cls.startswith("_") or _module(frame) == __name__:
            continue
        if not name.startswith("_") or name.startswith("__"):
            owner = cls if name.startswith("__") else f"{cls}.{name}".lstrip(".")
    return _COMMAND if _is_of_command_line(frame.f_back) else owner


def _is_public(cls: type) -> bool:
    """Whether a class is the user's own, or a name of the package or one of its wings."""
    package, wing = (cls.__module__.split(".")[:n] for n in (1, 2))
    modules = (sys.modules.get(".".join(names)) for names in (package, wing))
    return package != ["jaxpound"] or any(
        cls.__name__ in getattr(module, "__all__", ()) for module in modules
    )


class InvalidInput(ValueError):  # noqa: N818  (its name says what is wrong)
    """An argument breaks a rule: ``owner: name = value must be ...``.

    ``name`` is the argument or the path to it, ``value`` its value as it is printed, ``rule`` the
    rest of the sentence, such as "must be positive and finite"; the first two may be empty.
    ``owner`` is by default the ``caller``; messages of the command line leave its name out.
    """

    def __init__(self, name: str, value: str, rule: str, *, owner: str | None = None) -> None:
        self.owner = caller() if owner is None else owner
        super().__init__(name, value, rule)
        self.name, self.value, self.rule = name, value, rule

    def __reduce__(self) -> tuple[Any, ...]:  # of another process it keeps its owner
        make = functools.partial(InvalidInput, owner=self.owner)
        return make, (self.name, self.value, self.rule)

    def __str__(self) -> str:
        subject = f"{self.name} = {self.value}" if self.value else self.name
        sentence = f"{subject} {self.rule}".strip()
        owner = self.owner.removeprefix(_COMMAND).removeprefix(": ")
        return f"{owner}: {sentence}" if owner else sentence

    def replaced(self, **fields: Any) -> InvalidInput:
        """The same error with other fields, by name."""
        names = ("name", "value", "rule", "owner")
        return InvalidInput(**{name: getattr(self, name) for name in names} | fields)


@contextmanager
def renamed(
    part: str = "", names: Mapping[str, str] | None = None, owner: str | None = None
) -> Iterator[None]:
    """Errors are those of a part of the caller, or of ``owner``, whose arguments are by ``names``.

    A name is that in the error where ``names`` lacks it.
    """
    try:
        yield
    except InvalidInput as error:
        whole = ": ".join(filter(None, (caller() if owner is None else owner, part)))
        raise error.replaced(owner=whole, name=(names or {}).get(error.name, error.name)) from error


class PlausibilityWarning(UserWarning):
    """Input that the time grid does not resolve, or that is implausible: see ``simulate``."""


def resumable(argument: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorator of a function that goes on from the file or folder of an argument, by keyword.

    Ctrl-C says in one line what is kept there.
    """

    def decorated(function: Callable[P, R]) -> Callable[P, R]:
        @functools.wraps(function)
        def call(*args: P.args, **kwargs: P.kwargs) -> R:
            try:
                return function(*args, **kwargs)
            except KeyboardInterrupt as stop:
                if stop.args:  # of a function within this one
                    raise
                kept = f"nothing is kept, as there is no {argument}"
                path = kwargs.get(argument)
                if (path := getattr(path, "folder", path)) is not None:  # of a ``Storage``
                    kept = f"what was finished is kept in {path}, and the same call goes on"
                raise KeyboardInterrupt(f"{function.__name__}: interrupted; {kept}") from None

        return call

    return decorated


def warn(
    findings: list[str], strict: bool = False, category: type[Warning] = PlausibilityWarning
) -> None:
    """Warn of each finding, at the line that called the library; refuse them all if ``strict``."""
    if not findings:
        return
    if strict:
        raise InvalidInput("", "", "; ".join(findings))
    level = 1 + len([*_calls()])
    prefix = f"{owner}: " if (owner := caller()) else ""
    for finding in findings:
        warnings.warn(prefix + finding, category, stacklevel=level)


InvalidInput.__module__ = PlausibilityWarning.__module__ = "jaxpound"  # as tracebacks show them
