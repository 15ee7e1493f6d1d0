"""The error for input that breaks a rule, and the warning of input that is implausible."""

from __future__ import annotations

import functools
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")


class InvalidInput(ValueError):  # noqa: N818  (its name says what is wrong)
    """An argument breaks a rule: ``owner: name = value must be ...``.

    ``owner`` is the class or function that was called, ``name`` the argument or the path to it,
    ``value`` its value as it is printed, ``rule`` the rest of the sentence, such as "must be
    positive and finite"; each of the first three may be empty. A caller that knows the argument by
    another name replaces a field (``replaced``).
    """

    def __init__(self, owner: str, name: str, value: str, rule: str) -> None:
        super().__init__(owner, name, value, rule)  # as arguments, so that an error can be copied
        self.owner, self.name, self.value, self.rule = owner, name, value, rule

    def __str__(self) -> str:
        subject = f"{self.name} = {self.value}" if self.value else self.name
        sentence = f"{subject} {self.rule}".strip()
        return f"{self.owner}: {sentence}" if self.owner else sentence

    def replaced(self, **fields: Any) -> InvalidInput:
        """The same error with other fields, by name."""
        names = ("owner", "name", "value", "rule")
        return InvalidInput(**{name: getattr(self, name) for name in names} | fields)


@contextmanager
def renamed(owner: str, names: Mapping[str, str] | None = None) -> Iterator[None]:
    """Errors are those of ``owner``, whose arguments ``names`` has by the name in the error."""
    try:
        yield
    except InvalidInput as error:
        raise error.replaced(owner=owner, name=(names or {}).get(error.name, error.name)) from error


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
    owner: str,
    findings: list[str],
    strict: bool = False,
    category: type[Warning] = PlausibilityWarning,
) -> None:
    """Warn of each finding, at the line that called the library; refuse them all if ``strict``."""
    if strict and findings:
        raise InvalidInput(owner, "", "", "; ".join(findings))
    level, frame = 1, sys._getframe()
    internal = ("jaxpound.", "jaxtyping.")  # jaxtyping's frames check annotations
    while frame.f_back and frame.f_globals.get("__name__", "").startswith(internal):
        level, frame = level + 1, frame.f_back
    for finding in findings:
        warnings.warn(f"{owner}: {finding}", category, stacklevel=level)


InvalidInput.__module__ = PlausibilityWarning.__module__ = "jaxpound"  # as tracebacks show them
