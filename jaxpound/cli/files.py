"""The files of the command line: the examples that it prints, and the results that it writes."""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from jaxpound import _interruption as interruption

if TYPE_CHECKING:
    from matplotlib.figure import Figure


FORMS = ("pair", "row")
"""Forms of a configuration: two buildings of one storey, and buildings of several in a row."""


def example(command: str, form: str = "pair") -> str:
    """The documented example configuration of a command, in one of the ``FORMS``, as text."""
    name = command if form == "pair" else f"{command}_{form}"
    return (resources.files("jaxpound.cli") / f"{name}.toml").read_text(encoding="utf-8")


def make_folder(out: Path) -> None:
    """Make the output folder before the run, so that no run is lost for want of it.

    Raises
    ------
    ValueError
        If it cannot be made, or nothing can be written to it.
    """
    try:
        interruption.make_folder(out)
        with tempfile.TemporaryFile(dir=out):
            pass
    except OSError as error:
        rule = f"must be a folder that can be made and written to ({error.strerror})"
        raise ValueError(f"argument --out: {out} {rule}") from error


@contextlib.contextmanager
def unfinished_search(out: Path, *inputs: bytes) -> Iterator[Path]:
    """Path of a folder that keeps the search of a command until the command is done.

    It is in the output folder and named after the command's inputs (its configuration, records), so
    that another search never meets it. After an error it stays if something was kept in it, since
    days of runs may be; the next run of the same command goes on from there.
    """
    folder = out / f"unfinished-{hashlib.sha256(repr(inputs).encode()).hexdigest()[:8]}"
    try:
        yield folder
    except ValueError:
        if any(folder.rglob("*.npz")):
            what = "what was finished of the search is kept; remove the folder to begin anew"
            print(f"jaxpound: {folder}: {what}", file=sys.stderr)
        else:
            shutil.rmtree(folder, ignore_errors=True)
        raise
    shutil.rmtree(folder, ignore_errors=True)


def write(path: Path, write_to: Callable[[BinaryIO], Any]) -> None:
    """Write a whole file or none, and print its path.

    Raises
    ------
    OSError
        If it cannot be written; the message names the file.
    """
    from jaxpound.study.archives import replace_file

    replace_file(path, write_to)
    print(path)


def write_text(path: Path, text: str) -> None:
    """Write a text, as ``write``."""
    write(path, lambda file: file.write(text.encode()))


def write_json(path: Path, answers: Any) -> None:
    """Write a tree of results without infinite or NaN numbers, as ``known`` makes it."""
    write_text(path, json.dumps(answers, indent=2, allow_nan=False) + "\n")


def write_figures(figures: Mapping[str, Figure], out: Path, pdf: bool) -> None:
    """Write figures by their names, as PNG and, for print, as PDF too."""
    for name, figure in figures.items():
        for kind in ("png", "pdf") if pdf else ("png",):
            write(out / f"{name}.{kind}", partial(figure.savefig, format=kind, dpi=300))


def known(x: Any) -> Any:
    """A tree that JSON can hold, with None in the place of numbers that are not finite."""
    if isinstance(x, dict):
        return {key: known(value) for key, value in x.items()}
    if isinstance(x, list):
        return [known(value) for value in x]
    return None if isinstance(x, float) and not math.isfinite(x) else x
