"""Formats of text headers ahead of columns, whose statements are in prose."""

from __future__ import annotations

import re
from collections.abc import Sequence

from jaxpound.ground.formats.layout import Layout
from jaxpound.ground.formats.statements import Stated, Statement
from jaxpound.ground.formats.text import NUMBER, OtherKindError, TextLine, shown

_LENGTH = re.compile(rf"#?RecordLength\(sec\): *({NUMBER})", re.I)


def _state_length(header: Sequence[TextLine], stated: Stated) -> None:
    """Add the number of samples of a length in s."""
    for number, text in header:
        if (length := _LENGTH.match(text)) and stated.intervals:
            count = round(float(length[1]) / stated.intervals[0].value)
            stated.counts.append(Statement(number, text.strip(), count, 1.0))


def _state_unit(header: Sequence[TextLine], stated: Stated) -> None:
    """Refuse a unit, in the last cell, that is none of accelerations."""
    unit = header[0].text.split(",")[-1].strip()
    if unit not in ("", "FLOAT", "INTEGER") and not stated.units:
        raise OtherKindError(header[0].number, f"{shown(unit)} must be a unit of accelerations")


AFAD = Layout(
    name="AFAD or TR-NSMN",
    signature="STRONG GROUND MOTION RECORDS OF T",
    component=r"(?:RAW )?PGA VALUES.*?: *\(([^()]+)\)[^()]*\(([^()]+)\)[^()]*\(([^()]+)\)",
    unit="gal",
)
UNAM = Layout(
    name="Archivo Estándar de Aceleración",
    signature="ARCHIVO ESTANDAR DE ACELERACION",
    behind=r"DATOS DE ACELERACION",
)
CWB = Layout(
    name="CWB or CWA",
    signature="#(?:Earthquake|Station) ?Information|#StationCode",
    component=r"#DataSequence: *Time *([A-Z])\(\+\); *([A-Z])\(\+\); *([A-Z])\(\+\)",
    state=_state_length,
)
ESM = Layout(
    name="ESM or ITACA (DYNA)",
    signature="EVENT_NAME:",
    component=r"STREAM: *(\S+)",
    behind="USER5:",
)
SLIST = Layout(
    name="SLIST",
    signature=r"TIMESERIES .*\bSLIST\b",
    begin="TIMESERIES ",
    state=_state_unit,
    component=r"TIMESERIES (?:\w*_)?([A-Z]\w[A-Z0-9])_\w,",
)
TSPAIR = Layout(
    name="TSPAIR",
    signature=r"TIMESERIES .*\bTSPAIR\b",
    begin="TIMESERIES ",
    state=_state_unit,
    component=r"TIMESERIES (?:\w*_)?([A-Z]\w[A-Z0-9])_\w,",
    pairs=(2, 0),
)
GEOCSV = Layout(
    name="GeoCSV",
    signature="# ?dataset: GeoCSV",
    component=r"# ?SID: .*?([A-Z]_[A-Z]_[A-Z0-9])$",
)
COLUMNS = Layout(name="columns", signature="")
