"""A folder of finished chunks: a manifest that says what they are, and one file a chunk.

A file is written under a temporary name and moved into place, so that it is whole or absent; it is
NumPy's ``npz``, a zip archive whose members carry checksums. Independent processes may fill one
store at once.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import reprlib
import time
import uuid
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jaxpound.interruption import unfinished

MANIFEST = "manifest.json"
_PART = ".part"  # ends the name of a file that is being written
_ABANDONED = 3600.0  # seconds after which nobody is writing a file any more
_FORMAT = 1


class Store:
    """A store that exists. ``Store.create`` makes or continues one, ``Store(folder)`` reads one.

    Raises
    ------
    ValueError
        If the folder has no manifest that can be read.
    """

    def __init__(self, folder: str | os.PathLike[str], n: int | None = None) -> None:
        self.folder = Path(folder)
        path = self.folder / MANIFEST
        try:
            self.manifest: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        except (FileNotFoundError, NotADirectoryError):
            raise ValueError(f"store {self.folder} must be a folder with a {MANIFEST}") from None
        except (json.JSONDecodeError, UnicodeDecodeError) as error:
            raise ValueError(f"store {self.folder}: {MANIFEST} is damaged ({error})") from error
        if self.manifest.get("format") != _FORMAT:
            raise ValueError(
                f"store {self.folder}: format {self.manifest.get('format')!r} must be {_FORMAT}; "
                "another version of jaxpound made it"
            )
        self.n: int = n or self.manifest["n"]
        self.chunk_size: int = self.manifest["identity"]["chunk_size"]

    @staticmethod
    def create(
        folder: str | os.PathLike[str],
        identity: Mapping[str, Any],
        n: int,
        context: Mapping[str, Any],
    ) -> Store:
        """The store in that folder for the study of this identity, new or to be continued.

        Parameters
        ----------
        folder
            Made if it does not exist.
        identity
            What determines every number in it, as JSON has it.
        n
            Number of samples asked for; a store may grow.
        context
            What is kept with them.

        Raises
        ------
        ValueError
            If the folder holds something else, or another study: the message says what differs.
        OSError
            If the folder cannot be made or written to; the message names it.
        """
        folder, identity = Path(folder), json.loads(json.dumps(identity))
        content = {"format": _FORMAT, "n": n, **context, "identity": identity}
        with _writing(folder):
            folder.mkdir(parents=True, exist_ok=True)
            if not (folder / MANIFEST).exists():
                _require_empty(folder)
                replace_file(folder / MANIFEST, _as_json(content), keep_existing=True)
        store = Store(folder, n)
        if differences := list(_differences(store.manifest["identity"], identity)):
            shown = "; ".join(differences[:6]) + ("; ..." if len(differences) > 6 else "")
            raise ValueError(f"store {folder} holds another study: {shown}")
        if n > store.manifest["n"]:
            store.manifest["n"] = n
            with _writing(folder):
                replace_file(folder / MANIFEST, _as_json(store.manifest))
        return store

    def rows(self, chunk: int) -> range:
        """Indices of the samples of a chunk."""
        return range(chunk * self.chunk_size, min((chunk + 1) * self.chunk_size, self.n))

    def chunks(self) -> range:
        """Numbers of all chunks, finished or not."""
        return range(-(-self.n // self.chunk_size))

    def write(self, chunk: int, columns: Mapping[str, np.ndarray]) -> None:
        """Put a chunk in its place.

        Raises
        ------
        OSError
            If there is no room, or the folder cannot be written to.
        """
        with _writing(self.folder):
            replace_file(self._path(chunk), columns)

    def read(self, chunk: int, names: Sequence[str] | None = None) -> dict[str, np.ndarray] | None:
        """Columns of a chunk; None if it is not there, or a checksum or a length is wrong."""
        names = list(names or self.manifest["identity"]["columns"])
        path = self._path(chunk)
        if not path.exists():
            return None
        with path.open("rb") as file:
            try:
                with zipfile.ZipFile(file) as archive:
                    members = {name: archive.read(f"{name}.npy") for name in names}
                columns = {
                    name: np.load(io.BytesIO(data), allow_pickle=False)
                    for name, data in members.items()
                }
            except MemoryError:
                raise
            except Exception:  # whatever a damaged archive leads to, a seek before its start, say
                return None
        rows = len(self.rows(chunk))  # more where the study has grown beyond this n
        whole_columns = all(x.ndim == 1 and x.size >= rows for x in columns.values())
        return {name: x[:rows] for name, x in columns.items()} if whole_columns else None

    def has(self, chunk: int) -> bool:
        """Whether there is a file for a chunk."""
        return self._path(chunk).exists()

    def sweep(self) -> None:
        """Remove what killed processes left half-written, an hour ago or earlier."""
        for path in self.folder.glob(f"*{_PART}"):
            with contextlib.suppress(OSError):
                if time.time() - path.stat().st_mtime > _ABANDONED:
                    path.unlink()

    def _path(self, chunk: int) -> Path:
        return self.folder / f"chunk-{chunk:06d}.npz"


def _as_json(content: Mapping[str, Any]) -> bytes:
    return (json.dumps(content, indent=1, allow_nan=False) + "\n").encode()


def _require_empty(folder: Path) -> None:
    others = [path.name for path in folder.iterdir() if not path.name.endswith(_PART)]
    if others:
        # Another process may have made the store since.
        if MANIFEST in others:
            return
        raise ValueError(
            f"store {folder} must be empty or hold a {MANIFEST}, but has {sorted(others)[0]!r}"
        )


def replace_file(
    path: Path,
    content: bytes | Mapping[str, np.ndarray] | Callable[[Any], object],
    keep_existing: bool = False,
) -> None:
    """Write a whole file or none; ``keep_existing`` leaves one that came first in its place.

    Content is bytes, arrays for an ``npz``, or a function that writes to the file it is given.
    """
    part = path.with_name(f"{path.name}-{uuid.uuid4().hex}{_PART}")
    with unfinished(part):
        with open(part, "xb") as file:
            if isinstance(content, bytes):
                file.write(content)
            elif callable(content):
                content(file)
            else:
                np.savez(file, **content)  # type: ignore[arg-type]
            file.flush()
            os.fsync(file.fileno())
        if keep_existing:
            try:
                os.link(part, path)
            except FileExistsError:
                pass
            except OSError:  # a file system without links
                part.replace(path)
        else:
            part.replace(path)


@contextlib.contextmanager
def _writing(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        what = f"the store cannot be written ({error.strerror}); its finished chunks are kept"
        raise OSError(error.errno, what, str(folder)) from error


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
