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
        brings = f"pip install 'jaxpound[{EXTRAS[library]}]'"
        raise ImportError(f"{owner} needs {library}, which {brings} brings") from error
