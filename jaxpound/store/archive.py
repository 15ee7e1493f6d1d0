"""Files that are written whole or not at all, and archives of arrays that detect damage.

A file is written under a temporary name, which identifies the writing process so that unfinished
files of killed processes can be removed, and moved into place. An archive is NumPy's ``npz`` with
one more member: a seal, which describes it and has the SHA-256 checksum of every array.
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
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from jaxpound._errors import InvalidInput
from jaxpound._interruption import unfinished

_SEAL = "seal.json"
# host, process, its start time, and a random number of the file
_PART = re.compile(r"(?P<name>.+)-([0-9a-f]{12})-([1-9]\d{0,9})-(\d+)-[0-9a-f]{8}\.part", re.S)
_ABANDONED = 3600.0  # seconds after which an unfinished file of another host counts as abandoned
_LONGEST_NAME = 200


class DamagedError(ValueError):
    """A file differs from what was written; the message says how."""


def replace_file(path: Path, write: Callable[[BinaryIO], Any], keep_existing: bool = False) -> None:
    """Write a whole file or none; with ``keep_existing`` none where another process wrote one."""
    writer = f"{_host()}-{os.getpid()}-{_start_time(os.getpid())}"
    part = path.with_name(f"{path.name}-{writer}-{uuid.uuid4().hex[:8]}.part")
    try:
        with unfinished(part):
            with open(part, "xb") as file:
                write(file)
                file.flush()
                os.fsync(file.fileno())
            try:
                if keep_existing:
                    path.hardlink_to(part)
            except FileExistsError:
                return
            except OSError:  # a file system without links
                keep_existing = False
            if not keep_existing:
                part.replace(path)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error


def open_file(path: Path) -> BinaryIO:
    """Open a file for reading; a folder, a pipe or a device raises a ``DamagedError``."""
    try:
        if not stat.S_ISREG(path.stat().st_mode):  # opening a pipe would block
            raise DamagedError("it is no regular file")
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise DamagedError("it is a link to itself") from error
        raise
    return path.open("rb")


def is_part(name: str) -> bool:
    """Whether this is the name of an unfinished file."""
    return _PART.fullmatch(name) is not None


def sweep_parts(folder: Path, name: str | None = None) -> None:
    """Remove unfinished files of one name, or all, of processes that have ended.

    Where an end cannot be detected (on another host, or outside POSIX) it is assumed after an hour.
    """
    for entry in folder.iterdir():
        match = _PART.fullmatch(entry.name)
        if match is None or name not in (None, match["name"]):
            continue
        _, host, process, started = match.groups()
        with contextlib.suppress(OSError):  # another process removed it, or this one may not
            if host == _host() and os.name == "posix":
                abandoned = _is_gone(int(process), started)
            else:
                abandoned = time.time() - entry.stat().st_mtime > _ABANDONED
            if abandoned:
                entry.unlink()


@cache
def _host() -> str:
    """The machine or container within which process numbers are unique."""
    identifiers = [platform.node()]
    with contextlib.suppress(OSError):  # not on Linux
        identifiers.append(Path("/proc/sys/kernel/random/boot_id").read_text())
        identifiers.append(os.readlink("/proc/self/ns/pid"))
    return digest("\n".join(identifiers).encode())[:12]


def _is_gone(process: int, started: str) -> bool:
    """Whether a process of this host has ended, even if another has its number now."""
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return True
    except OSError:  # it belongs to another user
        return False
    return _start_time(process) != started


def _start_time(process: int) -> str:
    """Start time of a process in Linux's clock ticks; 0 if it is unknown or the process ended."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return "0"
    return "0" if fields[0] in "ZX" else fields[19]  # ended, but not yet reaped by its parent


def require_name(name: Any) -> None:
    """An ``InvalidInput`` for an invalid name of an array in an archive or a column of a table."""
    fits = isinstance(name, str) and 0 < len(name) <= _LONGEST_NAME
    if not (fits and name.isprintable() and not {*name} & {"/", "\\"}):
        length = f"1 to {_LONGEST_NAME} printable characters"
        rule = f"must have a name of {length}, none of them / or \\"
        raise InvalidInput(f"column {name!r}", "", rule)


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
    """An open archive (see ``opened``). Any damage raises a ``DamagedError``."""

    def __init__(self, file: BinaryIO) -> None:
        self._file, self._size = file, os.fstat(file.fileno()).st_size
        with _errors_as_damage():
            self._zip = zipfile.ZipFile(file)
            seal = json.loads(self._member(_SEAL))
            self.about, self._sums = seal["about"], dict(seal["sha256"])
        self.names = self._sums.keys()

    def read(self, name: str, shape: tuple[int, ...], dtype: Any) -> np.ndarray:
        """The array of this name, which must have this shape and type."""
        if name not in self._sums:
            raise DamagedError(f"it lacks {name!r}")
        with _errors_as_damage():
            data = self._member(f"{name}.npy")
            if digest(data) != self._sums[name]:
                raise DamagedError(f"the checksum of {name!r} is wrong")
            array = np.lib.format.read_array(io.BytesIO(data), allow_pickle=False)
            if array.dtype != np.dtype(dtype) or array.shape != shape:
                expected = f"{np.dtype(dtype)} of shape {shape}"
                raise DamagedError(
                    f"{name!r} is {array.dtype} of shape {array.shape}, not {expected}"
                )
            return array

    def _member(self, name: str) -> bytes:
        info = self._zip.getinfo(name)
        if info.compress_type != zipfile.ZIP_STORED or info.file_size > self._size:
            raise DamagedError(f"the size of {name} is wrong")  # it could exceed the memory
        return self._zip.read(info)


@contextlib.contextmanager
def opened(path: Path) -> Iterator[Archive]:
    """Open an archive for reading."""
    with open_file(path) as file:
        yield Archive(file)


@contextlib.contextmanager
def _errors_as_damage() -> Iterator[None]:
    """Turn every error that a damaged archive causes into a ``DamagedError``."""
    try:
        yield
    except (DamagedError, MemoryError):
        raise
    except Exception as error:
        raise DamagedError(" ".join((str(error) or type(error).__name__).split())) from error


def digest(data: bytes) -> str:
    """SHA-256 in hexadecimal."""
    return hashlib.sha256(data).hexdigest()
