"""The bytes of files; what files of known formats that are not read are, and what reads them."""

from __future__ import annotations

import codecs
import re
import stat
import zipfile
from pathlib import Path

from jaxpound._checks import require_folder
from jaxpound.ground.formats.text import MisreadError, OtherKindError

_MOST_BYTES = 32_000_000  # of the longest run, a million steps in two columns, and a header

_OBSPY = (
    "ObsPy reads it: trace = obspy.read({name!r})[0]; "
    'record = jp.Record(trace.data, trace.stats.delta, units="m/s2") if its data are in m/s²'
)
_RECORD = "record = jp.Record(samples, dt, units=...) takes its samples, which {} reads"
_UNPACK = "unpack it and read a file that it holds"
_BY_BEGINNING = (
    (rb"\x89HDF\r\n", "an HDF5 file", _RECORD.format("h5py (of ASDF: pyasdf)")),
    (rb"[0-9 ]{6}[DRQMV][ \0]|MS\x03", "a miniSEED or SEED file", _OBSPY),
    (rb".{304}(?:[\6\7]\0\0\0|\0\0\0[\6\7]).{324}", "a SAC file", _OBSPY),
    (rb"(?:\s*+[-+0-9.e]++){4,12}?\s++-12345(?:\.0*)?\s", "a SAC file of text", _OBSPY),
    (rb"WID[12] ", "a GSE file", _OBSPY),
    (rb"\x1f\x8b|BZh[1-9]|\xfd7zXZ|.{257}ustar|7z\xbc\xaf|Rar!", "a compressed file", _UNPACK),
    (
        rb"\x93NUMPY|MATLAB 5",
        "a NumPy or MATLAB file",
        _RECORD.format("numpy.load or scipy.io.loadmat"),
    ),
    (rb"\xd0\xcf\x11\xe0", "an Excel workbook", "save its sheet as CSV"),
    (rb"%PDF-|\x89PNG|\xff\xd8\xff", "a picture or a PDF", "a record is a file of numbers"),
    (rb"\s*<(?:!doctype|html)", "a web page", "download the file that it links to"),
    (rb".*Record Sequence Number", "a table of a search", "read the records beside it"),
    (
        rb"[3-6] +(?:veloc|displ|resp|four)",
        "an SMC file of another quantity",
        "read that of accelerations",
    ),
    (rb"\s*<\?xml", "an XML file", "read the file of the accelerations"),
)


def _other_kind(file: Path, data: bytes) -> str | None:
    """What a file of a known format that is not read is, and what reads it; None for others."""
    if data.startswith(b"PK\x03\x04"):
        try:
            with zipfile.ZipFile(file) as archive:
                members = [member for member in archive.namelist() if not member.endswith("/")]
        except zipfile.BadZipFile:
            return f"is a damaged zip archive: {_UNPACK}"
        if "[Content_Types].xml" in members:
            return "is an Excel workbook: save its sheet as CSV"
        listed = ", ".join(members[:6]) + (", ..." if len(members) > 6 else "")
        return f"is a zip archive: {_UNPACK}: {listed}"
    for pattern, kind, advice in _BY_BEGINNING:
        if re.match(pattern, data[:8192], re.S | re.I):
            return f"is {kind}: {advice.format(name=file.name)}"
    return None


def bytes_of(file: Path) -> bytes:
    """The bytes of a file: a regular one, of no other kind, and not too large."""
    try:
        status = file.stat()
    except FileNotFoundError:
        require_folder(file)
        raise FileNotFoundError(f"{file}: no such file") from None
    if not stat.S_ISREG(status.st_mode):
        kind = "directory" if stat.S_ISDIR(status.st_mode) else "device, pipe or socket"
        raise MisreadError(None, f"must be a file, not a {kind}")
    with file.open("rb") as opened:
        data = opened.read(_MOST_BYTES + 1)
    if other_kind := _other_kind(file, data):
        raise OtherKindError(None, other_kind)
    if len(data) > _MOST_BYTES:
        most, size = _MOST_BYTES / 1e6, max(len(data), status.st_size) / 1e6
        raise MisreadError(None, f"must have at most {most:.0f} MB of text, not {size:.4g} MB")
    utf_16 = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))  # of spreadsheets
    return data.decode("utf-16", "replace").encode() if utf_16 else data
