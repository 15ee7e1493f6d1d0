"""Compiled programs: how they are made and kept; a note where compiling takes long."""

from __future__ import annotations

import contextlib
import logging
import os
import shlex
import stat
import threading
import time
import warnings
from functools import cache, partial
from pathlib import Path
from typing import Any

import jax
import jax.monitoring
from jax.experimental.compilation_cache import compilation_cache
from platformdirs import user_cache_path

VARIABLE = "JAXPOUND_CACHE"  # in the environment: the folder for caches; "off" keeps no programs
AFTER = 3.0  # seconds of tracing and compiling until the note
_LARGEST = 1 << 30  # bytes, above which those used longest ago are removed
_ENTRIES = f"*-{'[0-9a-f]' * 64}-cache"  # the files of JAX
_LOOP_KERNELS = "xla_cpu_small_while_loop_byte_threshold=1000000"  # smaller ones are one kernel
_PHASES = ("jaxpr_trace", "jaxpr_to_mlir_module", "backend_compile")
_EVENTS = frozenset(f"/jax/core/compile/{phase}_duration" for phase in _PHASES)  # of JAX
_PAUSE = 0.5  # s, below which a phase goes on with the same wait


def keep_programs(folder: str | os.PathLike[str] | None = None) -> Path | None:
    """Let JAX keep compiled programs in a folder, so that a later process need not compile them.

    Call it once, before the first run; the command line does so by itself. Programs that took less
    than .3 s to compile are not kept. It sets ``jax_compilation_cache_dir`` and
    ``jax_persistent_cache_min_compile_time_secs`` of ``jax.config``.

    Programs are in the sub-folder ``jaxpound/programs``. Above 1 GiB those used longest ago are
    removed at the next call; no other file ever is. Whoever can write to the folder
    can make you execute any code: it is refused if it, or one above it, belongs to somebody else or
    others may write to it. Returns the folder with the programs, or None if none are kept; a
    ``UserWarning`` says if a folder is refused, or the requested one cannot be made or written to.

    Parameters
    ----------
    folder
        Folder for caches; made if it does not exist. By default that of the environment variable
        ``JAXPOUND_CACHE``, which "off" switches off, or else the user's (``~/.cache`` on Linux);
        then nothing changes if JAX already has a folder (``JAX_COMPILATION_CACHE_DIR``).

    Examples
    --------
    >>> import tempfile
    >>> before = jax.config.jax_compilation_cache_dir
    >>> with tempfile.TemporaryDirectory() as scratch:
    ...     programs = jp.runtime.keep_programs(scratch)
    >>> programs.parts[-2:]
    ('jaxpound', 'programs')
    >>> jax.config.update("jax_compilation_cache_dir", before)
    """
    before = jax.config.jax_compilation_cache_dir  # type: ignore[attr-defined]
    chosen = os.fspath(folder or os.environ.get(VARIABLE, ""))
    if folder is None and (before or chosen == "off"):
        return Path(before) if before else None
    try:
        programs = _private(Path(chosen) if chosen else user_cache_path().expanduser())
        _make_room(programs)
    except (OSError, RuntimeError, ValueError) as error:  # RuntimeError: a user without a home
        if chosen or isinstance(error, ValueError):
            warnings.warn(f"keep_programs: {error}; compiled programs are not kept", stacklevel=2)
        return None
    jax.config.update("jax_compilation_cache_dir", str(programs))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.3)
    compilation_cache.reset_cache()  # else JAX goes on with the folder before
    return programs


def use_loop_kernels() -> None:
    """Let XLA compile a run's loop over its steps as one kernel, on CPUs, in this process.

    From JAX 0.12 on XLA does so by itself, and this function does nothing. Older versions start
    every small operation of a step on its own, some 50 ns each. As one kernel a single run takes a
    third of the time, and a tenth with its gradient; one that collides takes a tenth, and a
    twentieth with its gradient. Batches gain little or nothing. Results differ by rounding at most.
    Call it once, before JAX computes anything; the command line does so by itself. It adds an
    option of XLA to the environment variable ``XLA_FLAGS``, which processes started from this one
    inherit.

    Raises ``RuntimeError`` if JAX is older than 0.12 and has started without it.
    """
    flags = os.environ.get("XLA_FLAGS", "")
    if jax.__version_info__ >= (0, 12) or _LOOP_KERNELS in flags:
        return
    devices = jax.config.jax_num_cpu_devices  # type: ignore[attr-defined]
    try:  # another number, which JAX refuses once it has started
        jax.config.update("jax_num_cpu_devices", 2 if devices == 1 else 1)
    except RuntimeError as error:
        rule = "must be called before JAX computes anything, but it has started"
        raise RuntimeError(f"use_loop_kernels {rule}") from error
    jax.config.update("jax_num_cpu_devices", devices)
    os.environ["XLA_FLAGS"] = f"{flags} --xla_backend_extra_options={_LOOP_KERNELS}".lstrip()


def _private(caches: Path) -> Path:
    """The folder for programs in one for caches, made if needed.

    A ``ValueError`` refuses a folder of others, or that others may write to, unless its mode has
    the sticky bit, as that of ``/tmp`` has: nobody replaces the folders of others there.
    """
    caches = caches.resolve()
    own = caches / "jaxpound", caches / "jaxpound" / "programs"
    for folder in (caches, *own):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    for folder in (caches, *caches.parents, *own) if hasattr(os, "getuid") else ():
        status, is_above = folder.lstat(), folder not in own
        mode, owners = status.st_mode, {os.getuid(), 0} if is_above else {os.getuid()}
        if status.st_uid not in owners or not stat.S_ISDIR(mode):
            remedy = f"name another folder by {VARIABLE}"
        elif mode & (stat.S_IWGRP | stat.S_IWOTH) and not (is_above and mode & stat.S_ISVTX):
            first = "" if is_above else "empty it, then "
            remedy = f"{first}run chmod go-w {shlex.quote(str(folder))}"
        else:
            continue
        rule = "must be a folder of yours that nobody else may write to: what is in it is executed"
        raise ValueError(f"{folder} {rule}; {remedy}")
    return own[1]


def _make_room(programs: Path) -> None:
    """Remove entries above the limit, those first that were used longest ago."""
    size = 0
    with contextlib.suppress(FileNotFoundError):  # another process makes room
        for path in sorted(programs.glob(_ENTRIES), key=lambda x: x.stat().st_atime, reverse=True):
            if (size := size + path.stat().st_size) > _LARGEST:
                path.unlink()


_log = logging.getLogger("jaxpound")
_waits: dict[int, tuple[int, float, threading.Timer | None]] = {}
"""Of each thread: the phases, one within another, that it is in; when that changed; the note."""


@cache
def note_long_compilations() -> None:
    """From now on warn by the logger "jaxpound" where making a program takes ``AFTER`` seconds."""
    jax.monitoring.register_scalar_listener(partial(_count, 1))
    jax.monitoring.register_event_duration_secs_listener(partial(_count, -1))


def _count(change: int, event: str, value: float, **_: Any) -> None:
    """Count the phases of this thread, of which one begins or ends."""
    thread, now = threading.get_ident(), time.monotonic()
    depth, changed, note = _waits.get(thread, (0, 0.0, None))
    if event not in _EVENTS or depth + change < 0:  # of a program begun before the listener
        return
    if not depth and now - changed > _PAUSE:
        if note:
            note.cancel()
        note = threading.Timer(AFTER, _warn, [thread])
        note.daemon = True
        note.start()
    _waits[thread] = depth + change, now, note


def _warn(thread: int) -> None:
    depth, changed, _ = _waits[thread]
    if depth or time.monotonic() - changed < _PAUSE:
        kept = jax.config.jax_compilation_cache_dir  # type: ignore[attr-defined]
        again = "" if kept else ", and later processes after jaxpound.runtime.keep_programs()"
        message = "jaxpound: tracing and compiling a program, for %g s so far; later runs of the "
        _log.warning(message + "same kind and time grid reuse it%s", AFTER, again)
