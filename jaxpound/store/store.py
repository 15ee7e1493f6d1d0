"""A folder of finished chunks: a manifest that identifies the study, and one archive a chunk.

Each file is written whole under another name and then moved, never edited, so that independent
processes can fill one store at once without a lock: the first manifest stays, a study's full chunk
has the same numbers from every process (but for the last digits, which change with the number of
cores), and an empty file ``samples-N`` requests N samples (the largest N counts). A ``RunLog`` is
for one process: of two, each would replace runs of the other, which are then only run again. The
name of a last chunk with fewer samples states their number; a larger study removes it once it has
written the full chunk. Damaged chunks are computed again and replaced.
"""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import json
import math
import os
import re
import reprlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound._errors import InvalidInput, renamed, warn
from jaxpound._version import __version__
from jaxpound.store import archive

MANIFEST = "manifest.json"
MOST_SAMPLES = 2**31  # of a store
_FORMAT = 2
_LARGEST_LISTED = 16  # entries of an array that a description lists
_SAMPLES = re.compile(r"samples-([1-9]\d{0,9})")
_CHUNK = re.compile(r"chunk-(\d{6,10})(?:-([1-9]\d{0,9}))?\.npz")
_TRIES = 3  # of reading a chunk that another process replaces
_SHOWN = 6  # damaged chunks that a warning names
_LARGEST_MANIFEST = 2**28  # bytes; a larger file could exceed the memory


class Store:
    """An existing store, of which the first ``n`` samples are used: by default all ``requested``.

    Raises ``ValueError`` if the manifest is missing, damaged or of another version's format.
    """

    def __init__(self, folder: str | os.PathLike[str], n: int | None = None) -> None:
        self.folder = Path(folder)
        self.manifest = _read_manifest(self.folder)
        identity = self.manifest["identity"]
        self.columns: tuple[str, ...] = tuple(identity["columns"])
        self.chunk_size: int = identity["chunk_size"]
        self._type = np.dtype(identity["precision"])
        self._study = _checksum(identity)
        self.n: int = self.requested() if n is None else n

    @staticmethod
    def create(
        folder: str | os.PathLike[str], identity: dict[str, Any], n: int, context: dict[str, Any]
    ) -> Store:
        """The store of the study with this identity, new or to be continued to n samples.

        ``identity`` is everything that determines the study's numbers, as JSON, including
        ``columns``, the names of a chunk's columns, ``precision``, their type, and ``chunk_size``,
        their length; ``context`` further entries of the manifest. Raises ``ValueError`` if the
        folder holds something else, or another study (the message says what differs).
        """
        folder, identity = Path(folder), json.loads(json.dumps(identity))
        with renamed(owner=f"store {folder}"):
            _check_identity(identity)
        with _writing(folder):
            folder.mkdir(parents=True, exist_ok=True)
            if not os.path.lexists(folder / MANIFEST):
                names = sorted(x.name for x in folder.iterdir() if not archive.is_part(x.name))
                if names and MANIFEST not in names:  # which another process may have made since
                    rule = f"must be empty or hold a {MANIFEST}, but has {names[0]!r}"
                    raise ValueError(f"store {folder} {rule}")
                content = {"format": _FORMAT, **context, "identity": identity}
                content["sha256"] = _checksum(content)
                sealed = (json.dumps(content, indent=1, allow_nan=False) + "\n").encode()
                if len(sealed) > _LARGEST_MANIFEST:
                    rule = f"must be at most {_LARGEST_MANIFEST:,} bytes with its notes"
                    raise ValueError(f"store {folder}: {MANIFEST} {rule}")
                archive.replace_file(folder / MANIFEST, lambda f: f.write(sealed), True)
        store = Store(folder, n)
        # Last those whose lists or texts are cut, so that they may not show what differs.
        unsorted = _differences(store.manifest["identity"], identity)
        if differences := sorted(unsorted, key=lambda difference: "..." in difference):
            shown = "; ".join(differences[:6]) + ("; ..." if len(differences) > 6 else "")
            remedy = "take another folder, or go on with the version and the input that began it"
            raise ValueError(f"store {folder} holds another study: {shown}; {remedy}")
        if n > store.requested():
            with _writing(folder):
                archive.replace_file(folder / f"samples-{n}", lambda file: None)
        store.sweep()
        return store

    def requested(self) -> int:
        """Largest number of samples that a process has requested."""
        return max(self._requests().values(), default=0)

    def rows(self, chunk: int) -> range:
        """Indices of the samples of a chunk."""
        return range(chunk * self.chunk_size, min((chunk + 1) * self.chunk_size, self.n))

    def chunks(self) -> range:
        """Numbers of all chunks, finished or not."""
        return range(-(-self.n // self.chunk_size))

    def write(self, chunk: int, columns: Mapping[str, np.ndarray]) -> None:
        """Write a chunk, which has fewer samples if the study ends within it."""
        rows = len(next(iter(columns.values())))
        with _writing(self.folder):
            archive.write_archive(self._path(chunk, rows), columns, self._sealed(chunk, rows))

    def read(self, chunk: int, names: Sequence[str] | None = None) -> dict[str, np.ndarray] | None:
        """Columns of a chunk, by default all; None if it is missing, or a ``DamagedError``."""
        damage, rows = None, len(self.rows(chunk))
        for _ in range(_TRIES):
            with contextlib.suppress(FileNotFoundError):  # a longer file has replaced it
                for size, path in self._files(chunk):
                    try:
                        columns = self._read(path, chunk, size, names or self.columns)
                        return {name: x[:rows] for name, x in columns.items()}
                    except archive.DamagedError as error:
                        damage = archive.DamagedError(f"chunk {chunk} is damaged ({error})")
                break
        if damage is not None:
            raise damage
        return None

    def undamaged(
        self, chunks: Iterable[int], consequence: str
    ) -> Iterator[tuple[int, dict[str, np.ndarray]]]:
        """The undamaged ones of these chunks; a warning on the others ends with ``consequence``."""
        damaged = []
        for chunk in chunks:
            try:
                if (columns := self.read(chunk)) is not None:
                    yield chunk, columns
            except archive.DamagedError as error:
                damaged.append(str(error))
        if damaged:
            more = f"; and {len(damaged) - _SHOWN:,} more" if len(damaged) > _SHOWN else ""
            message = f"{'; '.join(damaged[:_SHOWN])}{more}; {consequence}"
            warn([f"store {self.folder}: {message}"], category=UserWarning)

    def has(self, chunk: int) -> bool:
        """Whether there is a file for a chunk."""
        return bool(self._files(chunk))

    def held(self) -> list[int]:
        """Numbers of the chunks that have a file of any size, in order."""
        numbers, chunks = {int(match[1]) for _, match in self._matching(_CHUNK)}, self.chunks()
        return sorted(number for number in numbers if number in chunks)

    def _matching(self, pattern: re.Pattern[str]) -> list[tuple[Path, re.Match[str]]]:
        pairs = ((path, pattern.fullmatch(path.name)) for path in self.folder.iterdir())
        return [(path, match) for path, match in pairs if match]

    def sweep(self) -> None:
        """Remove unfinished files of killed processes, and chunks that longer ones replace."""
        archive.sweep_parts(self.folder)
        requests = self._requests()
        most = max(requests.values(), default=0)
        replaced = [path for path, n in requests.items() if n < most]
        for path, match in self._matching(_CHUNK):
            chunk, size = int(match[1]), int(match[2] or self.chunk_size)
            rows = min(self.chunk_size, most - chunk * self.chunk_size)
            with contextlib.suppress(archive.DamagedError, OSError):
                if size < rows:
                    self._read(self._path(chunk, rows), chunk, rows, self.columns)
                    replaced.append(path)
        for path in replaced:
            with contextlib.suppress(OSError):
                path.unlink()

    def _requests(self) -> dict[Path, int]:
        """Requested numbers of samples by the file of the request."""
        requests = {path: int(match[1]) for path, match in self._matching(_SAMPLES)}
        for path, n in requests.items():
            if n > MOST_SAMPLES:
                raise ValueError(f"store {self.folder}: {path.name} must be at most {MOST_SAMPLES}")
        return requests

    def _path(self, chunk: int, rows: int) -> Path:
        length = "" if rows == self.chunk_size else f"-{rows}"
        return self.folder / f"chunk-{chunk:06d}{length}.npz"

    def _files(self, chunk: int) -> list[tuple[int, Path]]:
        """Sizes and paths of the files that hold all samples of a chunk, the longest first."""
        rows, whole = len(self.rows(chunk)), self._path(chunk, self.chunk_size)
        files = [(self.chunk_size, whole)] if os.path.lexists(whole) else []
        if rows < self.chunk_size:  # only the last chunk has shorter files
            for path, match in self._matching(_CHUNK):
                size = int(match[2] or 0)
                if int(match[1]) == chunk and rows <= size < self.chunk_size:
                    files.append((size, path))
        return sorted(files, reverse=True)

    def _sealed(self, chunk: int, rows: int) -> dict[str, Any]:
        return {"study": self._study, "chunk": chunk, "rows": rows}

    def _read(self, path: Path, chunk: int, rows: int, names: Sequence[str]) -> dict[str, Any]:
        with archive.opened(path) as chunk_file:
            if differences := list(_differences(chunk_file.about, self._sealed(chunk, rows))):
                raise archive.DamagedError("; ".join(differences))
            if {*chunk_file.names} != {*self.columns}:
                raise archive.DamagedError("its columns are others than the study's")
            return {name: chunk_file.read(name, (rows,), self._type) for name in names}


def _read_manifest(folder: Path) -> dict[str, Any]:
    owner = f"store {folder}"
    try:
        with archive.open_file(folder / MANIFEST) as file:
            if len(text := file.read(_LARGEST_MANIFEST + 1)) > _LARGEST_MANIFEST:
                raise archive.DamagedError("it is too large")
            content = json.loads(text)
            intact = content.pop("sha256", None) == _checksum(content)
    except (FileNotFoundError, NotADirectoryError):
        missing = "" if folder.is_dir() else f"; there is no folder {folder.absolute()}"
        raise ValueError(f"{owner} must be a folder with a {MANIFEST}{missing}") from None
    except (ValueError, TypeError, AttributeError, RecursionError) as error:  # no JSON object
        raise ValueError(f"{owner}: {MANIFEST} is damaged ({error})") from error
    if (version := content.get("format")) != _FORMAT:
        rule = f"format {reprlib.repr(version)} must be {_FORMAT}; another version of jaxpound made"
        advice = "use that version, or run the study anew into another folder"
        raise ValueError(f"{owner}: {rule} it: {advice}")
    if not intact:
        raise ValueError(f"{owner}: {MANIFEST} is damaged (its checksum is wrong)")
    with renamed(owner=owner):
        _check_identity(content.get("identity"))
    return content


def _check_identity(identity: Any) -> None:
    """A ``ValueError`` if an identity lacks an entry that reading a chunk needs."""
    entries = identity if isinstance(identity, dict) else {}
    size, names, precision = (entries.get(k) for k in ("chunk_size", "columns", "precision"))
    if not (type(size) is int and 1 <= size <= MOST_SAMPLES):
        raise InvalidInput("chunk_size", _short(size), f"must be from 1 to {MOST_SAMPLES:,}")
    if not (isinstance(names, list) and names):
        raise InvalidInput("columns", _short(names), "must be names")
    for name in names:
        archive.require_name(name)
    if precision not in ("float32", "float64"):
        raise InvalidInput("precision", _short(precision), "must be float32 or float64")


def _checksum(content: Mapping[str, Any]) -> str:
    """Checksum of JSON, independent of its layout."""
    return archive.digest(json.dumps(content, sort_keys=True).encode())


@contextlib.contextmanager
def _writing(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        reason = f"the store cannot be written ({error.strerror}); its finished chunks are kept"
        raise OSError(error.errno, reason, error.filename or str(folder)) from error


def _differences(stored: Any, current: Any, path: str = "") -> Iterator[str]:
    """The differences between two trees of JSON, in words."""
    lists = isinstance(stored, list) and isinstance(current, list)
    if lists and len(stored) == len(current) and any(isinstance(x, dict) for x in stored):
        stored, current = ({str(i): y for i, y in enumerate(x)} for x in (stored, current))
    if isinstance(stored, dict) and isinstance(current, dict):
        for key in dict.fromkeys((*stored, *current)):
            place = f"{path}.{key}" if path else key
            yield from _differences(stored.get(key), current.get(key), place)
    elif stored != current:
        yield f"{path} is {_short(stored)} there and {_short(current)} here"


def _short(value: Any) -> str:
    return "absent" if value is None else reprlib.repr(value)


def program_digest(function: Callable[..., Any], *arguments: Any) -> str:
    """Checksum of a function's name and of its program for arguments, or for their types."""
    lowered = jax.jit(function).trace(*arguments).lower(lowering_platforms=("cpu",))
    return archive.digest(lowered.as_text().encode())


def describe(value: Any) -> Any:
    """The content of an object as a tree of JSON; large arrays as their checksums."""
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)  # JSON has no number for it
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.ndarray | np.generic | jax.Array):
        array = np.asarray(value)
        if array.size <= _LARGEST_LISTED:
            return describe(array.tolist())
        shape, checksum = list(array.shape), archive.digest(array.tobytes())
        return {"shape": shape, "type": str(array.dtype), "sha256": checksum}
    if isinstance(value, Mapping):
        return {str(key): describe(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [describe(entry) for entry in value]
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        listed = {f.name: f.metadata.get("listed", True) for f in dataclasses.fields(value)}
        kept = [k for k, x in listed.items() if x is True or (x and getattr(value, k))]
        return {"type": type(value).__name__, **describe({k: getattr(value, k) for k in kept})}
    if hasattr(value, "__qualname__"):
        return f"{value.__module__}.{value.__qualname__}"
    return type(value).__name__


def identity(
    search: str | None, columns: tuple[str, ...], chunk_size: int, program: str, **inputs: Any
) -> dict[str, Any]:
    """Everything that determines the numbers of an analysis, or without ``search`` of a study.

    It is JSON: ``search`` the kind of analysis, in words; ``program`` a ``program_digest``;
    ``inputs`` all else by name.
    """
    return ({"search": search} if search else {}) | {
        "versions": {"jaxpound": __version__, "jax": jax.__version__},
        "precision": str(jnp.zeros(()).dtype),
        "columns": list(columns),
        "chunk_size": chunk_size,
        **{name: describe(value) for name, value in inputs.items()},
        "program": program,
    }


class RunLog:
    """The runs of an analysis in the folder of a store, in any order, so that it can continue.

    Each row identifies its run; chunks are numbered as written, by one process at a time. A warning
    names damaged files.
    """

    def __init__(self, folder: str | os.PathLike[str], identity: dict[str, Any]) -> None:
        size: int = identity["chunk_size"]
        most = MOST_SAMPLES // size * size
        self._store = store = Store.create(folder, identity, most, {"notes": identity["search"]})
        self._type = np.dtype(identity["precision"])
        stored = store.held()
        chunks = dict(store.undamaged(stored, "its runs are made anew"))
        damaged = [chunk for chunk in reversed(stored) if chunk not in chunks]  # are replaced first
        self._numbers = itertools.chain(damaged, itertools.count(max(stored, default=-1) + 1))
        parts = [dict.fromkeys(store.columns, np.empty(0, self._type)), *chunks.values()]
        rows = {name: np.concatenate([part[name] for part in parts]) for name in store.columns}
        used = ~np.isnan(rows[store.columns[0]])
        self.rows = {name: column[used] for name, column in rows.items()}  # of all earlier runs

    def add(self, rows: Mapping[str, np.ndarray]) -> None:
        """Store rows, by column; NaN in the first column marks an unused row."""
        size = self._store.chunk_size
        for start in range(0, len(next(iter(rows.values()))), size):
            chunk = {name: np.full(size, np.nan, self._type) for name in self._store.columns}
            for name, column in chunk.items():
                part = rows[name][start : start + size]
                column[: len(part)] = part
            self._store.write(next(self._numbers), chunk)
