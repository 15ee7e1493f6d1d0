"""Functions of higher layers that results call.

Imports run one way, and a result cannot import the module that draws it. The package's root,
``jaxpound/__init__.py``, imports both and stores here the functions that lower layers call.
"""

from __future__ import annotations

TYPE_CHECKING = False  # as in the package's root, which imports this module
if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

    from matplotlib.figure import Figure

overview: Callable[[Any], Figure]
"""Draws a response."""
