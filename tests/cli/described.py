"""What docs/files.md says of the files of each command, compared with files."""

import csv
import json
import re
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

PAGE = Path(__file__).parents[2] / "docs" / "files.md"
OPAQUE = {("configuration",), *(("identity", x) for x in ("grid", "scheme", "scenarios"))}
OPAQUE |= {("identity", "measures"), ("identity", "scales")}


class Row(NamedTuple):
    """A key, column or file of the page, as a pattern; ``always`` if no case is stated."""

    parts: tuple[str, ...]
    always: bool


@cache
def page() -> dict[str, dict[str, list[Row]]]:
    """Rows by command and file; a file without a table has none."""
    found: dict[str, dict[str, list[Row]]] = {}
    for command, section in _parts(r"## `jaxpound (\w+)`", PAGE.read_text(encoding="utf-8")):
        files = found.setdefault(command, {})
        for heading, body in _parts(r"### (.+?)", section):
            rows = [
                Row((key,) if heading == "Figures" else _steps(key), not when)
                for keys, when in re.findall(r"^\| (`.+?) \| .* \| ?(.*?) ?\|$", body, re.M)
                for key in re.findall(r"`([^`]+)`", keys)
            ]
            for name in re.findall(r"`([^`]+)`", heading) or [heading]:
                files[name] = rows
    return found


def _parts(heading: str, text: str) -> list[tuple[str, str]]:
    """What is below each heading of a level, up to the next of this level."""
    level = heading.partition(" ")[0]
    return re.findall(rf"^{heading}\n(.*?)(?=^{level} |\Z)", text, re.M | re.S)


def _steps(key: str) -> tuple[str, ...]:
    """The keys that a dotted key joins; there may be dots within ``<…>``."""
    return tuple(re.split(r"\.(?![^<]*>)", key))


def fits(part: str, name: str) -> bool:
    """Whether a name is what a part of a key says, ``<…>`` standing for any words."""
    pattern = re.sub(r"<[^>]+>", ".+", re.escape(part))
    return re.fullmatch(pattern, name) is not None


def leaves(tree, path=()):
    """Paths of a tree of JSON; a table or list of tables that is empty or null ends one."""
    if path not in OPAQUE and tree and isinstance(tree, dict):
        for key, value in tree.items():
            yield from leaves(value, (*path, key))
    elif path not in OPAQUE and tree and isinstance(tree, list) and isinstance(tree[0], dict):
        for value in tree:
            yield from leaves(value, (*path[:-1], f"{path[-1]}[]"))
    else:
        yield path


def begins(parts, path):
    """Whether a path is the beginning of a key, or all of it."""
    names = [part.removesuffix("[]") for part in parts[: len(path)]]
    own = [name.removesuffix("[]") for name in path]
    return len(path) <= len(parts) and all(map(fits, names, own))


def compare(place: str, rows: list[Row], found: set[tuple[str, ...]]) -> None:
    """All that is found is on the page, and all that the page says is always there is found."""
    for path in found:
        told = any(begins(row.parts, path) for row in rows)
        assert told, f"{place}: {'.'.join(path)} is not told"
    for row in rows:
        there = any(begins(row.parts, path) or begins(path, row.parts) for path in found)
        assert there or not row.always, f"{place}: {'.'.join(row.parts)} is not there"


def compare_folder(command: str, folder: Path) -> None:
    """The page's section on a command, with the folder that the command has written."""
    told = page()[command]
    names = {path.name for path in folder.iterdir() if path.is_file() and path.suffix != ".pdf"}
    pictures = {name for name in names if name.endswith(".png")}
    if "Figures" in told:
        compare(f"{command}: figures", told["Figures"], {(name,) for name in pictures})
    for name in names - pictures - {"summary.md"}:
        if command == "montecarlo" and re.match(r"chunk-|samples-", name):
            continue
        assert name in told, f"{command}: {name} is not told"
        if found := contents(folder / name) if told[name] else set():
            compare(f"{command}: {name}", told[name], found)


def contents(path: Path) -> set[tuple[str, ...]]:
    """The keys or columns of a file."""
    if path.suffix == ".json":
        return {*leaves(json.loads(path.read_text(encoding="utf-8")))}
    if path.suffix == ".npz":
        return {(name,) for name in np.load(path).files}
    with path.open(newline="", encoding="utf-8") as file:
        return {(name,) for name in next(csv.reader(file))}
