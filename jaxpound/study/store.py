"""A folder of finished chunks: a manifest that says what they are, and one archive a chunk.

No file is ever changed, so that independent processes may fill one store at once without a lock:
the manifest and a full chunk are the same whoever writes them, and an empty file ``samples-N`` says
that N samples are asked for (the largest N counts). The last chunk of a study may have fewer
samples; their number is in its name, and it is kept until a larger study has written the full one.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import math
import os
import re
import reprlib
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

from jaxpound.study.archives import (
    DamagedError,
    digest,
    is_part,
    open_file,
    opened,
    replace_file,
    require_name,
    sweep_parts,
    write_archive,
)

MANIFEST = "manifest.json"
_FORMAT = 2
MOST = 2**31
"""Samples of a store at most."""
_WRITTEN_OUT = 16  # entries of an array that a description writes out
_SAMPLES = re.compile(r"samples-([1-9]\d{0,9})")
_PARTIAL = re.compile(r"chunk-(\d{6,10})-([1-9]\d{0,9})\.npz")
_FULL = re.compile(r"chunk-(\d{6,10})\.npz")
_TRIES = 3
_SHOWN = 6  # damaged chunks that a warning names
_LARGEST_MANIFEST = 2**28  # bytes; a file of any size would fill the memory


class Store:
    """An existing store. ``Store.create`` makes or continues one, ``Store(folder)`` reads one.

    ``n`` is the number of its samples to be used, by default all that are ``asked`` for.

    Raises
    ------
    ValueError
        If the folder has no manifest, or one that is damaged or of another version's format.
    """

    def __init__(self, folder: str | os.PathLike[str], n: int | None = None) -> None:
        self.folder = Path(folder)
        self.manifest = _read_manifest(self.folder)
        identity = self.manifest["identity"]
        self.columns: tuple[str, ...] = tuple(identity["columns"])
        self.chunk_size: int = identity["chunk_size"]
        self._type = np.dtype(identity["precision"])
        self._study = _checksum(identity)
        self.n: int = self.asked() if n is None else n

    @staticmethod
    def create(
        folder: str | os.PathLike[str],
        identity: Mapping[str, Any],
        n: int,
        context: Mapping[str, Any],
    ) -> Store:
        """The store in a folder for the study with this identity, new or to be continued.

        Parameters
        ----------
        folder
            Made if it does not exist.
        identity
            All that determines the study's numbers, as JSON: among it ``columns``, the names of a
            chunk's columns, ``precision``, their type, and ``chunk_size``, their length.
        n
            Number of samples asked for; a store may grow.
        context
            Further information to be kept in the manifest.

        Raises
        ------
        ValueError
            If the folder holds something else, or another study: the message says what differs.
        OSError
            If the folder cannot be made or written to; the message names it.
        """
        folder, identity = Path(folder), json.loads(json.dumps(identity))
        _check_identity(f"store {folder}", identity)
        with _writing(folder):
            folder.mkdir(parents=True, exist_ok=True)
            if not os.path.lexists(folder / MANIFEST):
                _require_empty(folder)
                content = {"format": _FORMAT, **context, "identity": identity}
                sealed = _as_json(content | {"sha256": _checksum(content)})
                if len(sealed) > _LARGEST_MANIFEST:
                    rule = f"at most {_LARGEST_MANIFEST:,} bytes with its notes"
                    raise ValueError(f"store {folder}: {MANIFEST} must be {rule}")
                replace_file(folder / MANIFEST, lambda file: file.write(sealed), keep_existing=True)
        store = Store(folder, n)
        if differences := list(_differences(store.manifest["identity"], identity)):
            shown = "; ".join(differences[:6]) + ("; ..." if len(differences) > 6 else "")
            raise ValueError(f"store {folder} holds another study: {shown}")
        if n > store.asked():
            with _writing(folder):
                replace_file(folder / f"samples-{n}", lambda file: None)
        store.sweep()
        return store

    def asked(self) -> int:
        """Number of samples that any process has asked for."""
        return max(self._asked().values(), default=0)

    def about(self) -> dict[str, Any]:
        """The manifest, with the number of samples that were asked for."""
        return {"n": self.asked(), **self.manifest}

    def rows(self, chunk: int) -> range:
        """Indices of the samples of a chunk."""
        return range(chunk * self.chunk_size, min((chunk + 1) * self.chunk_size, self.n))

    def chunks(self) -> range:
        """Numbers of all chunks, finished or not."""
        return range(-(-self.n // self.chunk_size))

    def write(self, chunk: int, columns: Mapping[str, np.ndarray]) -> None:
        """Write a chunk, or its first samples if the study ends within it.

        Raises
        ------
        OSError
            If there is no room, or the folder cannot be written to.
        """
        rows = len(next(iter(columns.values())))
        with _writing(self.folder):
            write_archive(self._path(chunk, rows), columns, self._sealed(chunk, rows))

    def read(self, chunk: int, names: Sequence[str] | None = None) -> dict[str, np.ndarray] | None:
        """Columns of a chunk, all or those of these names; None if it is not there.

        Raises
        ------
        DamagedError
            If its file differs from what was written for this chunk of this study.
        OSError
            If it may not be read.
        """
        damage, rows = None, len(self.rows(chunk))
        for _ in range(_TRIES):
            held = self._held(chunk)
            for there, path in held:
                try:
                    columns = self._read(path, chunk, there, names or self.columns)
                    return {name: x[:rows] for name, x in columns.items()}
                except DamagedError as error:
                    damage = DamagedError(f"chunk {chunk} is damaged ({error})")
                except FileNotFoundError:  # a longer one has replaced it
                    break
            else:
                break
        if damage is not None:
            raise damage
        return None

    def undamaged(
        self, chunks: Iterable[int], then: str, stacklevel: int = 3
    ) -> Iterator[tuple[int, dict[str, np.ndarray]]]:
        """Those of the given chunks that are there and undamaged, with their columns.

        At the end a warning names the damaged ones, and says what becomes of them (``then``).
        """
        damaged = []
        for chunk in chunks:
            try:
                columns = self.read(chunk)
            except DamagedError as error:
                damaged.append(str(error))
                continue
            if columns is not None:
                yield chunk, columns
        if damaged:
            more = f"; and {len(damaged) - _SHOWN:,} more" if len(damaged) > _SHOWN else ""
            said = f"{'; '.join(damaged[:_SHOWN])}{more}; {then}"
            warnings.warn(f"store {self.folder}: {said}", stacklevel=stacklevel)

    def has(self, chunk: int) -> bool:
        """Whether there is a file for a chunk."""
        return bool(self._held(chunk))

    def full(self) -> list[int]:
        """Numbers of the chunks that have a file of the whole size, in order."""
        found = [_FULL.fullmatch(path.name) for path in self.folder.iterdir()]
        return sorted(int(match[1]) for match in found if match)

    def held(self) -> list[int]:
        """Numbers of the chunks that have a file of any size, in order."""
        names = [path.name for path in self.folder.iterdir()]
        matches = [_FULL.fullmatch(name) or _PARTIAL.fullmatch(name) for name in names]
        numbers = {int(match[1]) for match in matches if match}
        return sorted(numbers.intersection(self.chunks()))

    def sweep(self) -> None:
        """Remove half-written files of killed processes, and chunks that longer ones replace."""
        sweep_parts(self.folder)
        asked = self._asked()
        most = max(asked.values(), default=0)
        replaced = [path for path, n in asked.items() if n < most]
        for path in self.folder.iterdir():
            if match := _PARTIAL.fullmatch(path.name):
                chunk, there = int(match[1]), int(match[2])
                rows = min(self.chunk_size, most - chunk * self.chunk_size)
                with contextlib.suppress(DamagedError, OSError):
                    if there < rows:
                        self._read(self._path(chunk, rows), chunk, rows, self.columns)
                        replaced.append(path)
        for path in replaced:
            with contextlib.suppress(OSError):
                path.unlink()

    def _asked(self) -> dict[Path, int]:
        """Numbers of samples that were asked for, by the file that states each."""
        found = {}
        for path in self.folder.iterdir():
            if match := _SAMPLES.fullmatch(path.name):
                found[path] = n = int(match[1])
                if n > MOST:
                    raise ValueError(f"store {self.folder}: {path.name} must be at most {MOST}")
        return found

    def _path(self, chunk: int, rows: int) -> Path:
        length = "" if rows == self.chunk_size else f"-{rows}"
        return self.folder / f"chunk-{chunk:06d}{length}.npz"

    def _held(self, chunk: int) -> list[tuple[int, Path]]:
        """Sizes and paths of the files that hold all samples of a chunk, the longest first."""
        rows, whole = len(self.rows(chunk)), self._path(chunk, self.chunk_size)
        found = [(self.chunk_size, whole)] if os.path.lexists(whole) else []
        if rows < self.chunk_size:  # only the last chunk has shorter files
            for path in self.folder.glob(f"chunk-{chunk:06d}-*.npz"):
                match = _PARTIAL.fullmatch(path.name)
                if match and rows <= int(match[2]) < self.chunk_size:
                    found.append((int(match[2]), path))
        return sorted(found, reverse=True)

    def _sealed(self, chunk: int, rows: int) -> dict[str, Any]:
        """What the seal of a chunk says."""
        return {"study": self._study, "chunk": chunk, "rows": rows}

    def _read(
        self, path: Path, chunk: int, rows: int, names: Sequence[str]
    ) -> dict[str, np.ndarray]:
        with opened(path) as archive:
            if differences := list(_differences(archive.about, self._sealed(chunk, rows))):
                raise DamagedError("; ".join(differences))
            if {*archive.names} != {*self.columns}:
                raise DamagedError("its columns are others than the study's")
            return {name: archive.read(name, (rows,), self._type) for name in names}


def _read_manifest(folder: Path) -> dict[str, Any]:
    owner = f"store {folder}"
    try:
        with open_file(folder / MANIFEST) as file:
            text = file.read(_LARGEST_MANIFEST + 1)
            if len(text) > _LARGEST_MANIFEST:
                raise DamagedError("it is too large")
            content = json.loads(text)
            checksum = content.pop("sha256", None)
            right = checksum == _checksum(content)
    except (FileNotFoundError, NotADirectoryError):
        missing = "" if folder.is_dir() else f"; there is no folder {folder.absolute()}"
        raise ValueError(f"{owner} must be a folder with a {MANIFEST}{missing}") from None
    except (ValueError, TypeError, AttributeError, RecursionError) as error:  # no JSON object
        raise ValueError(f"{owner}: {MANIFEST} is damaged ({error})") from error
    if (theirs := content.get("format")) != _FORMAT:
        rule = f"format {reprlib.repr(theirs)} must be {_FORMAT}"
        remedy = "use that version, or run the study anew into another folder"
        raise ValueError(f"{owner}: {rule}; another version of jaxpound made it: {remedy}")
    if not right:
        raise ValueError(f"{owner}: {MANIFEST} is damaged (its checksum is wrong)")
    _check_identity(owner, content.get("identity"))
    return content


def _check_identity(owner: str, identity: Any) -> None:
    """A ``ValueError`` if an identity lacks an entry that reading a chunk needs."""
    given = identity if isinstance(identity, dict) else {}
    size, names, precision = (given.get(k) for k in ("chunk_size", "columns", "precision"))
    if not (type(size) is int and 1 <= size <= MOST):
        raise ValueError(f"{owner}: chunk_size = {_short(size)} must be from 1 to {MOST:,}")
    if not (isinstance(names, list) and names):
        raise ValueError(f"{owner}: columns = {_short(names)} must be names")
    for name in names:
        require_name(owner, name)
    if precision not in ("float32", "float64"):
        raise ValueError(f"{owner}: precision = {_short(precision)} must be float32 or float64")


def _as_json(content: Mapping[str, Any]) -> bytes:
    return (json.dumps(content, indent=1, allow_nan=False) + "\n").encode()


def _checksum(content: Mapping[str, Any]) -> str:
    """Checksum of a JSON object, independent of its layout."""
    return digest(json.dumps(content, sort_keys=True).encode())


def _require_empty(folder: Path) -> None:
    others = [path.name for path in folder.iterdir() if not is_part(path.name)]
    if others:
        # Another process may have made the store since.
        if MANIFEST in others:
            return
        raise ValueError(
            f"store {folder} must be empty or hold a {MANIFEST}, but has {sorted(others)[0]!r}"
        )


@contextlib.contextmanager
def _writing(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        what = f"the store cannot be written ({error.strerror}); its finished chunks are kept"
        raise OSError(error.errno, what, error.filename or str(folder)) from error


def _differences(theirs: Any, ours: Any, path: str = "") -> Iterator[str]:
    """What differs between two trees of JSON, in words."""
    if isinstance(theirs, dict) and isinstance(ours, dict):
        for key in dict.fromkeys((*theirs, *ours)):
            place = f"{path}.{key}" if path else key
            yield from _differences(theirs.get(key), ours.get(key), place)
    elif theirs != ours:
        yield f"{path} is {_short(theirs)} there and {_short(ours)} here"


def _short(value: Any) -> str:
    return "absent" if value is None else reprlib.repr(value)


def describe(thing: Any) -> Any:
    """What an object holds, as a tree of JSON; large arrays as their checksums."""
    if isinstance(thing, float) and not math.isfinite(thing):
        return str(thing)  # JSON has no number for it
    if thing is None or isinstance(thing, bool | int | float | str):
        return thing
    if isinstance(thing, np.ndarray | np.generic | jax.Array):
        array = np.asarray(thing)
        if array.size <= _WRITTEN_OUT:
            return describe(array.tolist())
        return {
            "shape": list(array.shape),
            "type": str(array.dtype),
            "sha256": digest(array.tobytes()),
        }
    if isinstance(thing, Mapping):
        return {str(key): describe(value) for key, value in thing.items()}
    if isinstance(thing, list | tuple):
        return [describe(value) for value in thing]
    if dataclasses.is_dataclass(thing) and not isinstance(thing, type):
        fields = {f.name: describe(getattr(thing, f.name)) for f in dataclasses.fields(thing)}
        return {"type": type(thing).__name__, **fields}
    if hasattr(thing, "__qualname__"):
        return f"{thing.__module__}.{thing.__qualname__}"
    return type(thing).__name__
