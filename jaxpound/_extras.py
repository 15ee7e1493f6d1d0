"""Libraries that only some of the package needs, and the extra that brings each."""

from __future__ import annotations

import importlib
from typing import Any

EXTRAS = {"pandas": "tables", "pyarrow": "tables", "ipywidgets": "notebooks"}
"""The extra of ``pyproject.toml`` that brings a library."""


def require(owner: str, library: str) -> Any:
    """The library; an ``ImportError`` in the owner's name that says which extra brings it."""
    try:
        return importlib.import_module(library)
    except ModuleNotFoundError as error:
        if error.name != library:  # it is there, and what it needs itself is not
            raise
        extra = EXTRAS[library]
        brings = f"the extra {extra!r} brings: pip install '.[{extra}]' in a clone of jaxpound"
        raise ImportError(f"{owner} needs {library}, which {brings}") from error
