"""Files that are written whole or not at all, and archives of arrays that detect damage.

A file is written under a temporary name and moved into place. The temporary name says which process
writes it, so that leftovers of killed processes are recognised and removed.

An archive is NumPy's ``npz``, a zip archive of arrays, with one more member: a seal, which says
what the archive is and has the SHA-256 checksum of every array.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import io
import json
import os
import platform
import re
import stat
import time
import uuid
import zipfile
from collections.abc import Callable, Collection, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from jaxpound._interruption import unfinished

_SEAL = "seal.json"
# host, process, when it began, and a number of the file's own
_PART = re.compile(r"(?P<name>.+)-([0-9a-f]{12})-([1-9]\d{0,9})-(\d+)-[0-9a-f]{8}\.part", re.S)
_ABANDONED = 3600.0  # seconds after which an unfinished file of another host counts as abandoned
_LONGEST_NAME = 200


class DamagedError(ValueError):
    """A file differs from what was written; the message says how."""


# Whole files.


def replace_file(path: Path, write: Callable[[BinaryIO], Any], keep_existing: bool = False) -> None:
    """Write a whole file or none; ``keep_existing`` leaves one that came first in its place.

    Raises
    ------
    OSError
        If it cannot be written; the message names the file.
    """
    writer = f"{_host()}-{os.getpid()}-{_began(os.getpid())}"
    part = path.with_name(f"{path.name}-{writer}-{uuid.uuid4().hex[:8]}.part")
    try:
        with unfinished(part):
            with open(part, "xb") as file:
                write(file)
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
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error


def open_file(path: Path) -> BinaryIO:
    """A file to be read; a ``DamagedError`` for a folder, a pipe or a device.

    Raises
    ------
    OSError
        If there is none, or it may not be read.
    """
    try:
        if not stat.S_ISREG(path.stat().st_mode):  # to open a pipe would wait for its other end
            raise DamagedError("it is no regular file")
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise DamagedError("it is a link to itself") from error
        raise
    return path.open("rb")


def is_part(name: str) -> bool:
    """Whether a file of this name is one that is, or was, being written."""
    return _PART.fullmatch(name) is not None


def sweep_parts(folder: Path, name: str | None = None) -> None:
    """Remove half-written files of processes that have ended, of one name or all in a folder.

    Whether a process of another host has ended is not known here (nor, outside POSIX, of this one):
    its files are removed after an hour.
    """
    for entry in folder.iterdir():
        match = _PART.fullmatch(entry.name)
        if match is None or name not in (None, match["name"]):
            continue
        _, host, process, began = match.groups()
        with contextlib.suppress(OSError):  # another process has removed it, or only it may
            if host == _host() and os.name == "posix":
                abandoned = _is_gone(int(process), began)
            else:
                abandoned = time.time() - entry.stat().st_mtime > _ABANDONED
            if abandoned:
                entry.unlink()


@cache
def _host() -> str:
    """An identifier of the host (machine or container) within which process numbers are unique."""
    known = [platform.node()]
    with contextlib.suppress(OSError):  # not on Linux
        known.append(Path("/proc/sys/kernel/random/boot_id").read_text())
        known.append(os.readlink("/proc/self/ns/pid"))
    return digest("\n".join(known).encode())[:12]


def _is_gone(process: int, began: str) -> bool:
    """Whether a process of this host has ended, even if another has its number now."""
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return True
    except OSError:  # somebody else's
        return False
    return _began(process) != began


def _began(process: int) -> str:
    """Start time of a process in Linux's clock ticks; 0 if it is not known or the process ended."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return "0"
    return "0" if fields[0] in "ZX" else fields[19]  # ended, but not yet reaped by its parent


# Archives.


def require_name(owner: str, name: Any) -> None:
    """A ``ValueError`` for an invalid name of an array in an archive or a column of a table."""
    right = isinstance(name, str) and 0 < len(name) <= _LONGEST_NAME
    if not (right and name.isprintable() and not {*name} & {"/", "\\"}):
        rule = f"of 1 to {_LONGEST_NAME} printable characters, none of them / or \\"
        raise ValueError(f"{owner}: column {name!r} must have a name {rule}")


def write_archive(path: Path, arrays: Mapping[str, np.ndarray], about: Mapping[str, Any]) -> None:
    """Write an archive of arrays; its seal holds ``about``, which describes it in JSON."""

    def write(file: BinaryIO) -> None:
        sums = {}
        # Members have no date, so that equal arrays make equal files.
        with zipfile.ZipFile(file, "w") as archive:
            for name, array in arrays.items():
                data = io.BytesIO()
                np.lib.format.write_array(data, np.asarray(array, order="C"), allow_pickle=False)
                sums[name] = digest(data.getvalue())
                archive.writestr(zipfile.ZipInfo(f"{name}.npy"), data.getvalue())
            seal = json.dumps({"about": about, "sha256": sums}, allow_nan=False)
            archive.writestr(zipfile.ZipInfo(_SEAL), seal)

    replace_file(path, write)


class Archive:
    """An archive that is open; ``opened`` opens one.

    Any damage raises a ``DamagedError``.
    """

    about: Any
    names: Collection[str]

    def __init__(self, file: BinaryIO) -> None:
        self._file, self._size = file, os.fstat(file.fileno()).st_size
        with _noticing():
            self._zip = zipfile.ZipFile(file)
            seal = json.loads(self._member(_SEAL))
            self.about, self._sums = seal["about"], dict(seal["sha256"])
        self.names = self._sums.keys()

    def read(self, name: str, shape: tuple[int, ...], dtype: Any) -> np.ndarray:
        """An array, which must be of this shape and type."""
        if name not in self._sums:
            raise DamagedError(f"it lacks {name!r}")
        with _noticing():
            data = self._member(f"{name}.npy")
            if digest(data) != self._sums[name]:
                raise DamagedError(f"the checksum of {name!r} is wrong")
            file = io.BytesIO(data)
            if np.lib.format.read_magic(file) != (1, 0):
                raise DamagedError(f"{name!r} is no array of plain numbers")
            held, by_columns, kind = np.lib.format.read_array_header_1_0(file)
            if by_columns or kind != np.dtype(dtype) or held != shape:
                wanted = f"{np.dtype(dtype)} of shape {shape}"
                raise DamagedError(f"{name!r} is {kind} of shape {held}, not {wanted}")
            return np.frombuffer(data, kind, offset=file.tell()).reshape(held)

    def _member(self, name: str) -> bytes:
        info = self._zip.getinfo(name)
        plain = info.compress_type == zipfile.ZIP_STORED and info.file_size <= self._size
        if not plain:  # its stated size could fill the memory
            raise DamagedError(f"the size of {name} is wrong")
        return self._zip.read(info)


@contextlib.contextmanager
def opened(path: Path) -> Iterator[Archive]:
    """An archive to be read.

    Raises
    ------
    OSError
        If there is none, or it may not be read.
    DamagedError
        If it differs from what was written.
    """
    with open_file(path) as file:
        yield Archive(file)


@contextlib.contextmanager
def _noticing() -> Iterator[None]:
    """Turn any error that a damaged archive causes, such as a bad seek, into a ``DamagedError``."""
    try:
        yield
    except (DamagedError, MemoryError):
        raise
    except Exception as error:
        said = str(error) or type(error).__name__
        raise DamagedError(" ".join(said.split())) from error


def digest(data: bytes) -> str:
    """SHA-256 in hexadecimal."""
    return hashlib.sha256(data).hexdigest()
