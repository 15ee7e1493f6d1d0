"""A note on stderr where a command, which first compiles its program, takes long."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Timer

from jaxpound.model.system import Structures

AFTER = 5.0
"""Seconds until the note."""


@contextmanager
def noted(structures: Structures) -> Iterator[None]:
    """Say what is compiled and run if the block takes longer than ``AFTER``."""
    note = Timer(AFTER, lambda: print(f"jaxpound: {words(structures)}", file=sys.stderr))
    note.daemon = True
    note.start()
    try:
        yield
    finally:
        note.cancel()


def words(structures: Structures) -> str:
    """The note."""
    system = structures.system()
    floors, links = len(system.masses), len(system.links)
    of = f"{floors} floors" if floors > 1 else "1 floor"
    if links:
        of += f" and {links} link{'s' if links > 1 else ''}"
    return f"compiling and running the program for {of} ..."
