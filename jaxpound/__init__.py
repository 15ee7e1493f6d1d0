"""Differentiable simulation of seismic pounding between two adjacent structures.

>>> import jaxpound as jp
>>> response = jp.simulate(jp.paper.structures(), jp.paper.ground(), jp.paper.grid())
>>> bool(response.min_gap > 0.3)
True
"""

from __future__ import annotations

import ast
import importlib
import pkgutil
import sys
from typing import TYPE_CHECKING, Any

from jaxpound import _root
from jaxpound._version import __version__ as __version__

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# The public names, by the module that holds each: the stub beside this file has them. JAX takes the
# better part of a second to import, SciPy another; neither is imported before it is needed.
_STUB = ast.parse(pkgutil.get_data(__name__, "__init__.pyi") or b"")
_PLACES = {
    alias.name: statement.module
    for statement in _STUB.body
    if isinstance(statement, ast.ImportFrom) and statement.module != f"{__name__}._version"
    for alias in statement.names
}

_WINGS = {place.split(".")[1] for place in _PLACES.values() if "." in place}

__all__ = sorted(_PLACES)


def __getattr__(name: str) -> Any:
    place = _PLACES.get(name)
    if place == __name__ or name in _WINGS:
        return importlib.import_module(f"{__name__}.{name}")
    if place is None:
        message = f"module {__name__!r} has no attribute {name!r}"
        raise AttributeError(message, name=name, obj=sys.modules[__name__])
    return globals().setdefault(name, getattr(importlib.import_module(place), name))


def __dir__() -> list[str]:
    ours = {name for name, x in globals().items() if name[:2] == "__" or _is_module(name, x)}
    return sorted({*ours, *_PLACES})


def _is_module(name: str, thing: Any) -> bool:
    return getattr(thing, "__name__", "") == f"{__name__}.{name}"


def _overview(response: Any) -> Figure:
    from jaxpound import plots

    return plots.overview(response)


_root.overview = _overview
