"""Compiled programs: kept from one process to the next, and told of where compiling takes long."""

from __future__ import annotations

import contextlib
import logging
import os
import re
import shlex
import stat
import sys
import threading
import warnings
import zlib
from functools import cache
from pathlib import Path
from typing import Any

import jax
import jax.monitoring
from jax.experimental.compilation_cache import compilation_cache

VARIABLE = "JAXPOUND_CACHE"
"""Environment variable with the folder for caches; "off" keeps no programs."""

_OFF = "off"
_LARGEST = 1 << 30  # bytes, above which those used longest ago are removed
_WORTH_KEEPING = 0.3  # s of compilation
_ENTRY = re.compile(r".+-[0-9a-f]{64}-(cache|atime)")  # the files of JAX
_MARK = "looked-through"  # an empty file, as old as the last look at the entries
_ZSTANDARD = b"\x28\xb5\x2f\xfd"  # how what is compressed by it begins

AFTER = 10.0
"""Seconds of a compilation until the note."""

_COMPILING = "/jax/core/compile/backend_compile_duration"  # JAX's event


def keep_programs(folder: str | os.PathLike[str] | None = None) -> Path | None:
    """Let JAX keep compiled programs in a folder, so that a later process need not compile them.

    Call it once, before the first run; the command line does so by itself. Programs that took less
    than .3 s to compile are not kept. It sets ``jax_compilation_cache_dir`` and
    ``jax_persistent_cache_min_compile_time_secs`` of ``jax.config``.

    Programs are in the sub-folder ``jaxpound/programs``. Above 1 GiB those used longest ago are
    removed, damaged ones at the next call; no other file ever is. Whoever may write to the folder
    could make you execute any code: the sub-folders are made for you alone, and the folder, those
    above it and these are refused if they belong to somebody else or others may write to them.

    Parameters
    ----------
    folder
        Folder for caches; made if it does not exist. By default that of the environment variable
        ``JAXPOUND_CACHE``, which "off" switches off, or else the user's (``~/.cache`` on Linux);
        nothing is changed then if JAX has a folder of its own (``JAX_COMPILATION_CACHE_DIR``).

    Returns
    -------
    The folder with the programs; None if none are kept.

    Warns
    -----
    UserWarning
        If a folder is refused, or the one that was asked for cannot be made or written to: no
        programs are kept.

    Examples
    --------
    >>> import tempfile
    >>> before = jax.config.jax_compilation_cache_dir
    >>> with tempfile.TemporaryDirectory() as scratch:
    ...     programs = jp.keep_programs(scratch)
    >>> programs.parts[-2:]
    ('jaxpound', 'programs')
    >>> jax.config.update("jax_compilation_cache_dir", before)
    """
    before = jax.config.jax_compilation_cache_dir  # type: ignore[attr-defined]
    chosen = os.fspath(folder or os.environ.get(VARIABLE, ""))
    if folder is None and (before or chosen == _OFF):
        return Path(before) if before else None
    try:
        programs = _private(Path(chosen) if chosen else _user_folder())
        _look_through(programs)
    except (OSError, RuntimeError, _RefusedError) as error:  # RuntimeError: a user without a home
        if chosen or isinstance(error, _RefusedError):
            said = f"keep_programs: {error}; compiled programs are not kept"
            warnings.warn(said, stacklevel=2)
        return None
    jax.config.update("jax_compilation_cache_dir", str(programs))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", _WORTH_KEEPING)
    if before:
        compilation_cache.reset_cache()  # else JAX goes on with the folder before
    return programs


class _RefusedError(Exception):
    """A folder that others could put programs into."""


def _private(caches: Path) -> Path:
    """The folder for programs in one for caches, made if needed.

    Raises
    ------
    OSError
        If it cannot be made or written to.
    _RefusedError
        If somebody else could put programs there.
    """
    caches.mkdir(mode=0o700, parents=True, exist_ok=True)
    caches = caches.resolve()
    ours = caches / "jaxpound"
    programs = ours / "programs"
    for folder in (ours, programs):
        folder.mkdir(mode=0o700, exist_ok=True)
    if hasattr(os, "getuid"):
        user, root = os.getuid(), 0
        for folder in (caches, *caches.parents):
            _require_private(folder, {user, root}, allowed=stat.S_ISVTX)
        for folder in (ours, programs):
            _require_private(folder, {user}, first="empty it, then ")
    return programs


def _require_private(folder: Path, owners: set[int], allowed: int = 0, first: str = "") -> None:
    """Refuse a folder of others, or that others may write to unless a bit of its mode forbids it.

    That bit is the sticky one, as ``/tmp`` has it: nobody replaces the folders of others there.
    The message says what to do, and what must be done ``first``.
    """
    status = folder.lstat()
    shared = status.st_mode & (stat.S_IWGRP | stat.S_IWOTH) and not status.st_mode & allowed
    theirs = status.st_uid not in owners or not stat.S_ISDIR(status.st_mode)
    if theirs or shared:
        rule = "must be a folder of yours that nobody else may write to: what is in it is executed"
        remedy = f"{first}run chmod go-w {shlex.quote(str(folder))}"
        if theirs:
            remedy = f"name another folder by {VARIABLE}"
        raise _RefusedError(f"{folder} {rule}; {remedy}")


def _look_through(programs: Path) -> None:
    """Remove damaged entries, of those written since the last look, and make room for new ones.

    JAX itself replaces no entry, and warns of a damaged one in every process.
    """
    mark = programs / _MARK
    last = mark.stat().st_mtime if mark.exists() else 0.0
    mark.touch()
    entries = []
    for path in programs.iterdir():
        with contextlib.suppress(OSError):  # another process has removed it
            if _ENTRY.fullmatch(path.name):
                status = path.stat()
                if status.st_mtime >= last and _is_damaged(path):
                    path.unlink()
                else:
                    entries.append((status.st_atime, status.st_size, path))
    excess = sum(size for _, size, _ in entries) - _LARGEST
    for _, size, path in sorted(entries):
        if excess <= 0:
            return
        path.unlink(missing_ok=True)
        excess -= size


def _is_damaged(path: Path) -> bool:
    """Whether a compressed entry cannot be read, as one that a killed process has begun to write.

    One that is compressed by a library which is not here is that of another process.
    """
    if path.name.endswith("-atime"):
        return False
    entry = path.read_bytes()
    try:
        if not entry.startswith(_ZSTANDARD):
            zlib.decompress(entry)
        elif sys.version_info >= (3, 14):
            from compression import zstd

            zstd.decompress(entry)
        else:
            import zstandard

            zstandard.ZstdDecompressor().decompress(entry)
    except ImportError:
        return False
    except Exception:  # each library has its own
        return True
    return False


def _user_folder() -> Path:
    """The folder for caches of this user, by the conventions of the system."""
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")


# --- a note -------------------------------------------------------------------------------------

_log = logging.getLogger("jaxpound")
_notes: dict[int, threading.Timer] = {}  # by the thread that compiles


@cache
def note_long_compilations() -> None:
    """From now on say in one line that a program is compiled, if that takes ``AFTER`` seconds.

    By the logger "jaxpound", as a warning: what nobody hears of otherwise.
    """
    jax.monitoring.register_scalar_listener(_begin)
    jax.monitoring.register_event_duration_secs_listener(_finish)


def _begin(event: str, value: float, **_: Any) -> None:
    if event == _COMPILING and threading.get_ident() not in _notes:
        said = (
            f"jaxpound: compiling a program, for {AFTER:g} s so far; it is done once in a process"
        )
        more = f"{said}, or once for all processes after jaxpound.keep_programs()"
        note = _notes[threading.get_ident()] = threading.Timer(AFTER, _log.warning, [more])
        note.daemon = True
        note.start()


def _finish(event: str, duration_secs: float, **_: Any) -> None:
    if event == _COMPILING and (note := _notes.pop(threading.get_ident(), None)):
        note.cancel()
