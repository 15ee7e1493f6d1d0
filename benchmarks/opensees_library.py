"""OpenSeesPy's wheel for Linux brings a BLAS library, but does not find it."""

import ctypes
import importlib.util
from contextlib import suppress
from pathlib import Path


def load_blas():
    """Load the library of the wheel, where there is one, before OpenSeesPy is imported."""
    wheel = importlib.util.find_spec("openseespylinux")
    if wheel is not None and wheel.origin is not None:
        with suppress(OSError):
            library = Path(wheel.origin).parent / "lib" / "libblas.so.3"
            ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
