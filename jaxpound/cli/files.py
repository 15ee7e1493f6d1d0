"""The files of the command line: the examples that it prints, and the results that it writes."""

from __future__ import annotations

import argparse
import contextlib
import csv
import hashlib
import io
import json
import math
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from importlib import resources
from operator import methodcaller
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import jaxpound as jp
from jaxpound import _interruption as interruption

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from jaxpound._tables import TextTable

Write = Callable[[BinaryIO], Any]  # writes a file to a stream

VERSION = f"jaxpound {jp.__version__}."
FORMS = ("pair", "row")  # of a configuration: two buildings of one storey, or a row of buildings


def example(command: str, form: str = "pair") -> str:
    """The documented example of a command, a configuration by its form or the "record", as text.

    A line ``# <FILE>`` stands for what another file holds: the buildings of several commands.
    """
    folder = resources.files("jaxpound.cli")
    name = command if form == "pair" else f"{command}_{form}"
    text = (folder / f"{name}.{'at2' if form == 'record' else 'toml'}").read_text(encoding="utf-8")
    return re.sub(r"(?m)^# <(.*)>\n", lambda x: (folder / x[1]).read_text(encoding="utf-8"), text)


def make_folder(out: Path) -> None:
    """Make the output folder before the run, so that no results are lost."""
    try:
        interruption.make_folder(out)
        with tempfile.TemporaryFile(dir=out):
            pass
    except OSError as error:
        rule = f"must be a folder that can be made and written to ({error.strerror})"
        raise ValueError(f"argument --out: {out} {rule}") from error


@contextlib.contextmanager
def kept_search(args: argparse.Namespace, key: str, name: str, *inputs: bytes) -> Iterator[None]:
    """Keep the state of a search at the path of the argument ``key`` until the search is done.

    Without it, the path is ``name`` in a new folder inside the output folder, named by a hash of
    the inputs. After an error this stays if it holds finished runs: the same command goes on.
    """
    make_folder(args.out)
    if getattr(args, key):
        yield
        return
    folder = args.out / f"unfinished-{hashlib.sha256(repr(inputs).encode()).hexdigest()[:8]}"
    make_folder(folder)
    setattr(args, key, folder / name)  # reported if the process is interrupted
    try:
        yield
    except ValueError:
        if any(folder.rglob("*.npz")):
            notice = "what was finished of the search is kept; remove the folder to begin anew"
            print(f"jaxpound: {folder}: {notice}", file=sys.stderr)
        else:
            shutil.rmtree(folder, ignore_errors=True)
        raise
    shutil.rmtree(folder, ignore_errors=True)


def write_files(out: Path, files: Mapping[str, str | Write]) -> None:
    """Write files to a folder by name, each whole or not at all, and print their paths.

    A file is a text, or writes itself to a stream. An ``OSError`` names the file.
    """
    from jaxpound.store.archive import replace_file

    for name, content in files.items():
        write = content if callable(content) else methodcaller("write", content.encode())
        replace_file(out / name, write)
        print(out / name)


def json_text(answers: Any) -> str:
    """Results as JSON, with null for numbers that are not finite."""
    return json.dumps(json_safe(answers), indent=2, allow_nan=False) + "\n"


def images(figures: Mapping[str, Figure], pdf: bool) -> dict[str, Write]:
    """Files of figures by their names, as PNG and, for print, as PDF too."""
    from jaxpound.plots.style import in_house_style

    return {
        f"{name}.{kind}": partial(in_house_style(figure.savefig), format=kind, dpi=300)
        for name, figure in figures.items()
        for kind in (("png", "pdf") if pdf else ("png",))
    }


def write_report(
    args: argparse.Namespace,
    answers: Any,
    title: str,
    parts: Iterable[str | TextTable],
    figures: Mapping[str, Figure],
    tables: Mapping[str, str] | None = None,
) -> None:
    """Write a command's summary, its ``page``, tables (CSV by file name) and figures."""
    summary = {"summary.json": json_text(answers), "summary.md": page(title, parts, figures)}
    write_files(args.out, {**summary, **(tables or {}), **images(figures, args.pdf)})


def json_safe(tree: Any) -> Any:
    """A tree of dicts, lists and arrays where None replaces numbers that are not finite."""
    if isinstance(tree, dict):
        return {key: json_safe(value) for key, value in tree.items()}
    tree = tree.tolist() if hasattr(tree, "tolist") else tree
    if isinstance(tree, list | tuple):
        return [json_safe(value) for value in tree]
    return None if isinstance(tree, float) and not math.isfinite(tree) else tree


def page(title: str, parts: Iterable[str | TextTable], figures: Iterable[str]) -> str:
    """A page in Markdown: paragraphs, tables with their titles and notes, and figures by name."""
    paragraphs = [f"# {title}"]
    for part in parts:
        if isinstance(part, str):
            paragraphs.append(part)
            continue
        if part.title:
            paragraphs.append(f"## {part.title}")
        table = part if any(part.columns) else part._replace(columns=("quantity", "value"))
        notes = "\n".join(part.notes).replace(",\n", ", ").splitlines()  # a note may have two lines
        paragraphs += [table.markdown(), *map(sentence, notes)]
    paragraphs.append("\n".join(f"![{name.replace('_', ' ')}]({name}.png)" for name in figures))
    return "\n\n".join(paragraphs) + "\n"


def table_of(rows: Sequence[Mapping[str, Any]]) -> TextTable:
    """A table of rows, by the names of columns; one without a value in any row is left out."""
    from jaxpound._tables import TextTable  # NumPy, which the help does not need

    columns = [name for name in rows[0] if any(row[name] is not None for row in rows)]
    return TextTable.of(columns, [[row[name] for name in columns] for row in rows])


def sentence(note: str) -> str:
    """A note with a capital letter and a full stop."""
    return f"{note[0].upper()}{note[1:].removesuffix('.')}."


def csv_text(columns: Mapping[str, Any]) -> str:
    """Columns by name as CSV; cells of numbers that are not finite, and of None, are empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*map(json_safe, columns.values()), strict=True))
    return text.getvalue()


def of_fragility(curve: jp.study.Fragility) -> dict[str, float]:
    """The parameters of a fragility with their standard errors, for JSON."""
    names = ("median", "median_error", "dispersion", "dispersion_error")
    return {name: getattr(curve, name) for name in names}
