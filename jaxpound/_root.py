"""What results may call though it stands above them.

Imports run one way, and a result cannot import what draws it. The package's root,
``jaxpound/__init__.py``, stands above both and puts here what it lends to the floors below.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

overview: Callable[[Any], Figure]
"""Draws a response."""
