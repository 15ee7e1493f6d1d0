"""Optional libraries, and the extra of ``pyproject.toml`` that installs each."""

from __future__ import annotations

import importlib
from typing import Any

from jaxpound._errors import caller

EXTRAS = {  # the extra that installs a library
    "pandas": "tables",
    "pyarrow": "tables",
    "xarray": "xarray",
    "ipywidgets": "notebooks",
}


def require(library: str) -> Any:
    """Import a library; the ``ImportError`` names the caller and the extra that installs it."""
    try:
        return importlib.import_module(library)
    except ModuleNotFoundError as error:
        if error.name != library:  # installed, but one of its own dependencies is not
            raise
        extra = EXTRAS[library]
        remedy = f"the extra {extra!r} brings: pip install '.[{extra}]' in a clone of jaxpound"
        raise ImportError(f"{caller()} needs {library}, which {remedy}") from error
