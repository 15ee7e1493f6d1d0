"""Files of known formats that are not read: their names, and what reads them."""

from __future__ import annotations

import io
import re
import zipfile

_OBSPY = (
    "ObsPy reads it: trace = obspy.read({name!r})[0]; "
    'record = jp.Record(trace.data, trace.stats.delta, units="m/s2") if its data are in m/s²'
)
_RECORD = "record = jp.Record(samples, dt, units=...) takes its samples, which {} reads"
_NO_RECORD = "read the file of the accelerations"
_UNPACK = "unpack it and read a file that it holds"
_BY_BEGINNING = (
    (rb"[3-6] +(?:veloc|displ|resp|four)", "an SMC file of another quantity", _NO_RECORD),
    (rb"\x89HDF\r\n", "an HDF5 file", _RECORD.format("h5py (of ASDF: pyasdf)")),
    (rb"[0-9 ]{6}[DRQM][ \0]|MS\x03", "a miniSEED file", _OBSPY),
    (rb"[0-9]{6}V ", "a SEED volume", _OBSPY),
    (rb"WID[12] ", "a GSE file", _OBSPY),
    (rb"\x1f\x8b|BZh[1-9]|\xfd7zXZ|.{257}ustar", "a compressed file", _UNPACK),
    (rb"7z\xbc\xaf|Rar!", "an archive", _UNPACK),
    (rb"\x93NUMPY", "a NumPy file", _RECORD.format("numpy.load")),
    (rb"MATLAB 5", "a MATLAB file", _RECORD.format("scipy.io.loadmat")),
    (rb"\xd0\xcf\x11\xe0", "an Excel workbook", "save its sheet as CSV"),
    (rb"%PDF-|\x89PNG|\xff\xd8\xff", "a picture or a PDF", "a record is a file of numbers"),
    (rb"\s*<(?:!doctype|html)", "a web page", "download the file that it links to"),
    (rb"\s*<\?xml", "an XML file", _NO_RECORD),
)
_SAC_VERSION = slice(304, 308)  # word 76 of a header of 632 bytes
_SAC_UNDEFINED = re.compile(rb"(?:\s+-?12345(?:\.0*)?(?=\s)|\s+\S+){5}\s*\n")


def kind_of(name: str, data: bytes) -> str | None:
    """What a file of a known format that is not read is, and what reads it; None for others."""
    if data.startswith(b"PK\x03\x04"):
        return _archive(data)
    for pattern, kind, advice in _BY_BEGINNING:
        if re.match(pattern, data[:512], re.S | re.I):
            return f"is {kind}: {advice.format(name=name)}"
    binary = len(data) >= 632 and data[_SAC_VERSION] in (b"\6\0\0\0", b"\0\0\0\6", b"\7\0\0\0")
    if binary or (_SAC_UNDEFINED.match(data) and data[:400].count(b"-12345") > 5):
        return f"is a SAC file: {_OBSPY.format(name=name)}"
    return None


def _archive(data: bytes) -> str:
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = [member for member in archive.namelist() if not member.endswith("/")]
    except zipfile.BadZipFile:
        return f"is a damaged zip archive: {_UNPACK}"
    if "[Content_Types].xml" in members:
        return "is an Excel workbook: save its sheet as CSV"
    listed = ", ".join(members[:6]) + (", ..." if len(members) > 6 else "")
    return f"is a zip archive: {_UNPACK}: {listed}"
