"""The table of formats, and the components of a file by it."""

from __future__ import annotations

import re
from collections.abc import Sequence

from jaxpound.ground.formats import (
    at2,
    blocks,
    columns,
    cosmos,
    csmip,
    geonet,
    json_events,
    knet,
    smc,
    spreadsheet,
)
from jaxpound.ground.formats.layout import Channel, Layout
from jaxpound.ground.formats.statements import Stated, Statement
from jaxpound.ground.formats.text import NUMBER, TextFile, TextLine

_LENGTH = re.compile(rf"#?RecordLength\(sec\): *({NUMBER})", re.I)
_TIMESERIES = r"TIMESERIES (?:\w*_)?([A-Z]\w[A-Z0-9])_\w,"  # its network, ..., channel and quality


def _state_length(header: Sequence[TextLine], stated: Stated) -> None:
    """Add the number of samples of a length in s."""
    for number, text in header:
        if (length := _LENGTH.match(text)) and stated.intervals:
            count = round(float(length[1]) / stated.intervals[0].value)
            stated.counts.append(Statement(number, text.strip(), count, 1.0))


LAYOUTS = (
    knet.LAYOUT,
    geonet.LAYOUT,
    csmip.CORRECTED,
    csmip.RAW,
    cosmos.LAYOUT,
    smc.LAYOUT,
    Layout(
        name="SLIST",
        signature=r"TIMESERIES .*\bSLIST\b",
        begin="TIMESERIES ",
        component=_TIMESERIES,
    ),
    Layout(
        name="TSPAIR",
        signature=r"TIMESERIES .*\bTSPAIR\b",
        begin="TIMESERIES ",
        component=_TIMESERIES,
        pairs=(2, 0),
    ),
    Layout(
        name="GeoCSV",
        signature="# ?dataset: GeoCSV",
        component=r"# ?SID: .*?([A-Z]_[A-Z]_[A-Z0-9])$",
    ),
    Layout(
        name="AFAD or TR-NSMN",
        signature="STRONG GROUND MOTION RECORDS OF T",
        component=r"(?:RAW )?PGA VALUES.*?: *\(([^()]+)\)[^()]*\(([^()]+)\)[^()]*\(([^()]+)\)",
        unit="gal",
    ),
    Layout(
        name="Archivo Estándar de Aceleración",
        signature="ARCHIVO ESTANDAR DE ACELERACION",
        behind="DATOS DE ACELERACION",
    ),
    Layout(
        name="CWB or CWA",
        signature="#(?:Earthquake|Station) ?Information|#StationCode",
        component=r"#DataSequence: *Time *([A-Z])\(\+\); *([A-Z])\(\+\); *([A-Z])\(\+\)",
        state=_state_length,
    ),
    Layout(
        name="ESM or ITACA (DYNA)",
        signature="EVENT_NAME:",
        component=r"STREAM: *(\S+)",
        behind="USER5:",
    ),
    at2.LAYOUT,
    Layout(name="columns", signature=""),
)


def channels_of(
    file: TextFile, dt: float | None, form: str | None, notes: list[str]
) -> list[Channel]:
    """The components of a file; ``dt`` and ``form``, what its rows are, are those of the user."""
    if json_events.fits(file.lines):
        return json_events.read(file.lines)
    lines = spreadsheet.in_plain_form(file.lines)
    layout = next(layout for layout in LAYOUTS if layout.fits(lines))
    if layout is knet.LAYOUT:
        return [knet.read(lines, notes)]
    if layout.begin:
        return blocks.read(layout, lines)
    return columns.read(layout, lines, dt, form, notes)
