"""Compiled programs, kept in the user's cache folder from one command to the next."""

from __future__ import annotations

import contextlib
import os
import sys
from pathlib import Path

VARIABLE = "JAXPOUND_CACHE"
"""Environment variable with the folder; "off" keeps no programs."""

_OFF = "off"
_LARGEST = 1 << 30  # bytes, above which those used longest ago are removed
_WORTH_KEEPING = 0.3  # s of compilation


def keep_programs() -> None:
    """Let JAX keep compiled programs, so that a later command need not compile them again.

    Nothing is changed where JAX has a folder of its own (``JAX_COMPILATION_CACHE_DIR``), where
    ``JAXPOUND_CACHE`` is "off", or where the folder cannot be made.
    """
    import jax

    chosen = os.environ.get(VARIABLE, "")
    if chosen == _OFF or getattr(jax.config, "jax_compilation_cache_dir", None):
        return
    folder = Path(chosen) if chosen else _user_folder() / "jaxpound" / "programs"
    with contextlib.suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            _remove_oldest(folder)
            jax.config.update("jax_compilation_cache_dir", str(folder))
            jax.config.update("jax_persistent_cache_min_compile_time_secs", _WORTH_KEEPING)


def _remove_oldest(folder: Path) -> None:
    """Make room for new programs."""
    found = sorted((one.stat().st_atime, one.stat().st_size, one) for one in folder.iterdir())
    excess = sum(size for _, size, _ in found) - _LARGEST
    for _, size, one in found:
        if excess <= 0:
            return
        one.unlink(missing_ok=True)
        excess -= size


def _user_folder() -> Path:
    """The folder for caches of this user, by the conventions of the system."""
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
