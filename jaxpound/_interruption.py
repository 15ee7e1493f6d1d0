"""Ending a process at a signal: at once, with one line on stderr and no half-written file.

Python raises ``KeyboardInterrupt`` wherever the main thread happens to be. While JAX's libraries
are loaded, or in code that XLA has just compiled, that ends in a segmentation fault; a callback of
the garbage collector swallows it; and no compilation is interrupted. The command line therefore
raises nothing: a thread waits for the signal.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from functools import partial

TYPE_CHECKING = False  # nothing is imported before signals are handled
if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path
    from typing import Any, NoReturn

_SIGNALS = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}
_PATIENCE = 5.0  # seconds for files that are being written
_READER = 1.0  # seconds for the process that reads stdout

_describe_kept: Callable[[], str] = partial(str, "nothing was written")
_changed = threading.Condition()
_unfinished: set[Path] = set()
_made: list[Path] = []
_ending = False


@contextlib.contextmanager
def unfinished(part: Path) -> Iterator[None]:
    """Context in which ``part`` is written and moved into place; its end removes ``part``."""
    with _changed:
        _changed.wait_for(lambda: not _ending)
        _unfinished.add(part)
    try:
        yield
    finally:
        with _changed:
            part.unlink(missing_ok=True)
            _unfinished.discard(part)
            _changed.notify_all()


def make_folder(folder: Path) -> None:
    """Make a folder and its parents, and remember them for ``remove_empty_folders``."""
    with _changed:
        _made.extend(place for place in (folder, *folder.parents) if not place.exists())
        folder.mkdir(parents=True, exist_ok=True)


def remove_empty_folders() -> None:
    """Remove the folders that ``make_folder`` has made and that are still empty."""
    with _changed:
        for folder in sorted(_made, key=lambda place: -len(place.parts)):
            with contextlib.suppress(OSError):
                folder.rmdir()
        _made.clear()


def end_at_a_signal() -> None:
    """From now on end this process when it is interrupted (Ctrl-C) or terminated.

    Files that are being written are finished, or removed after ``_PATIENCE``. The exit status is
    128 plus the signal's number, as in shells. Signals that the process ignores stay ignored.
    """
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    signal.set_wakeup_fd(writer)  # signals write to it at once, whatever the main thread does
    for number in _SIGNALS:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, _begin_the_end)
    threading.Thread(target=_wait, args=(reader,), daemon=True).start()


def report_kept_files(describe: Callable[[], str]) -> None:
    """Set the sentence on files that the process leaves behind, for the line on stderr."""
    global _describe_kept
    _describe_kept = describe


def end(status: int) -> NoReturn:
    """End this process at once, when no file is being written, unless a signal has come before.

    An orderly exit takes JAX a second or two, during which Python ignores signals.
    """
    sys.stderr.flush()
    with _changed:
        _changed.wait_for(lambda: not _ending)
        os._exit(status)


def _begin_the_end(*_: Any) -> None:
    """Note that a signal has come and raise nothing; ``_wait`` ends the process."""
    global _ending
    _ending = True


def _wait(reader: int) -> None:
    global _ending
    while (number := os.read(reader, 1)[0]) not in _SIGNALS:
        pass
    try:
        with _changed:
            _ending = True
            _changed.wait_for(lambda: not _unfinished, _PATIENCE)
            for part in _unfinished:
                part.unlink(missing_ok=True)
            remove_empty_folders()
            message = f"jaxpound: {_SIGNALS[signal.Signals(number)]}; {_describe_kept()}\n"
        after_a_bar = "\n" if os.isatty(2) else ""
        if sys.stdout is not None:
            flush = threading.Thread(target=sys.stdout.flush, daemon=True)
            flush.start()
            flush.join(_READER)  # the reader may have stopped
        os.write(2, f"{after_a_bar}{message}".encode())
    finally:
        os._exit(128 + number)  # threads of XLA may still use what an orderly exit would free
