"""Differentiable simulation of seismic pounding between two adjacent structures.

>>> import jaxpound as jp
>>> response = jp.simulate(jp.paper.structures(), jp.paper.ground(), jp.paper.grid())
>>> bool(response.min_gap > 0.3)
True
"""

from __future__ import annotations

import sys

from jaxpound import _root
from jaxpound._version import __version__ as __version__

TYPE_CHECKING = False  # the module typing takes longer to import than all that is here
if TYPE_CHECKING:
    from typing import Any

    from matplotlib.figure import Figure

_places: dict[str, str] = {}
"""The public names, by the module that holds each; of ``_places_of_names``."""


def _places_of_names() -> dict[str, str]:
    """The public names, by the module that holds each: the stub beside this file has them.

    JAX takes the better part of a second to import, SciPy another; neither is imported before it is
    needed. Nor is what reads the stub: the command line heeds signals only once this module is
    imported.
    """
    if not _places:
        import ast
        import pkgutil

        for statement in ast.parse(pkgutil.get_data(__name__, "__init__.pyi") or b"").body:
            if isinstance(statement, ast.ImportFrom) and statement.module != f"{__name__}._version":
                _places.update((alias.name, statement.module or "") for alias in statement.names)
    return _places


def __getattr__(name: str) -> Any:
    import importlib

    places = _places_of_names()
    if name == "__all__":
        return sorted(places)
    place = places.get(name)
    wings = {module.split(".")[1] for module in places.values() if "." in module}
    if place == __name__ or name in wings:
        return importlib.import_module(f"{__name__}.{name}")
    if place is None:
        message = f"module {__name__!r} has no attribute {name!r}"
        raise AttributeError(message, name=name, obj=sys.modules[__name__])
    return globals().setdefault(name, getattr(importlib.import_module(place), name))


def __dir__() -> list[str]:
    ours = {name for name, x in globals().items() if name[:2] == "__" or _is_module(name, x)}
    return sorted({*ours, *_places_of_names(), "__all__"})


def _is_module(name: str, thing: Any) -> bool:
    return getattr(thing, "__name__", "") == f"{__name__}.{name}"


def _overview(response: Any) -> Figure:
    from jaxpound import plots

    return plots.overview(response)


_root.overview = _overview
